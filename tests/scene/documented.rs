//! The examples of `docs/scenes.md` are valid scenes, and the page lists the keys that the reader
//! knows.

use crate::common::models::{CLAMPED, PAPER_PLATE};
use crate::common::scenes;
use rebond::scene::Scene;
use rebond::simulation::Model;

const PAGE: &str = include_str!("../../docs/scenes.md");

/// Tables that are added to an example which omits them.
const MESH: &str = "mesh = { element = \"fvs\", cells = [4, 2] }\n";
const TIME: &str = "time = { scheme = \"newmark\", mass = \"singular\", step = 1e-5, end = 1e-2 }\n";

fn examples() -> Vec<String> {
    let blocks = PAGE.split("```toml\n").skip(1);
    blocks.map(|block| block.split("```").next().unwrap().to_owned()).collect()
}

#[test]
fn every_example_runs() {
    let examples = examples();
    assert!(examples.len() >= 10);
    for example in examples {
        let names = |table: &str| {
            let starts = [format!("[{table}]"), format!("[[{table}]]"), format!("{table} =")];
            example.lines().any(|line| starts.iter().any(|start| line.starts_with(start)))
        };
        let parts = [("plate", PAPER_PLATE), ("mesh", MESH), ("support", CLAMPED), ("time", TIME)];
        let left_out: String =
            parts.into_iter().filter(|(table, _)| !names(table)).map(|(_, text)| text).collect();
        let text = left_out + &example;
        let scene = scenes::scene(&text);
        let model = Model::new(&scene).unwrap_or_else(|error| panic!("{error}\n{text}"));
        let mut scheme = model.scheme(&scene).unwrap();
        for _ in 0..3 {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt < 1e-10, "{text}");
        }
        let again = Scene::from_str(&scene.resolved(), "again.toml", &[]).unwrap();
        assert_eq!(again.resolved(), scene.resolved());
    }
}

/// Every table and key that the reader lists in its error for an unknown one is in the document.
#[test]
fn every_key_is_documented() {
    let base = [PAPER_PLATE, MESH, TIME].concat();
    let wrong = "nonsense";
    let list = |text: &str| {
        let error = scenes::read(text).unwrap_err().to_string();
        let keys = error.split("expected one of ").nth(1).unwrap_or_else(|| panic!("{error}"));
        let keys = keys.split(" (did").next().unwrap().trim_end_matches('.');
        keys.split(", ").map(str::to_owned).collect::<Vec<_>>()
    };
    let tables = list(&format!("{wrong} = 1\n{base}"));
    assert!(tables.len() >= 17);
    for table in &tables {
        let said = [format!("`{table}`"), format!("`[{table}]`"), format!("`[[{table}]]`")];
        assert!(said.iter().any(|said| PAGE.contains(said)), "{table}");
        // Parameters have names of their own.
        if table == "title" || table == "parameters" {
            continue;
        }
        let of_many = ["part", "support", "obstacle", "foundation", "spring", "mass", "rib", "ball"]
            .contains(&&**table);
        let key = if of_many { format!("{table}.0.{wrong}=1") } else { format!("{table}.{wrong}=1") };
        let error = Scene::from_str(&base, "a.toml", &[key]).unwrap_err().to_string();
        let keys = error.split("expected one of ").nth(1).unwrap_or_else(|| panic!("{error}"));
        for key in keys.split(" (did").next().unwrap().split(", ") {
            let said = [format!("`{key}`"), format!("[[{table}.{key}]]")];
            assert!(said.iter().any(|said| PAGE.contains(said)), "{table}.{key}");
        }
    }
}
