//! The examples of `docs/scenes.md` are valid scenes, and the page has a row for each key.

use crate::common::models::{CLAMPED, PAPER_PLATE};
use crate::common::scenes;
use rebond::scene::{Scene, schema};
use rebond::simulation::Model;
use serde_json::Value;

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

/// Returns the rows of the page for the keys of a table.
fn rows(schema: &Value) -> String {
    let names = |list: &Value| -> Vec<String> {
        list.as_array().into_iter().flatten().map(|name| format!("`{}`", name.as_str().unwrap())).collect()
    };
    let needed = names(&schema["required"]);
    let choices: Vec<Vec<String>> =
        schema["oneOf"].as_array().into_iter().flatten().map(|choice| names(&choice["required"])).collect();
    let row = |(key, schema): (&String, &Value)| {
        let key = format!("`{key}`");
        let description = schema["description"].as_str().unwrap();
        let split = description.strip_prefix('[').and_then(|rest| rest.split_once("] "));
        let (head, help) = split.unwrap_or(("", description));
        let (unit, default) = head.split_once("default ").unwrap_or((head, ""));
        let others: Vec<String> =
            choices.iter().filter(|choice| !choice.contains(&key)).flatten().cloned().collect();
        let default = match (needed.contains(&key), others.len() < choices.concat().len()) {
            (true, _) => "needed".to_owned(),
            (_, true) => format!("needed, or {}", others.join(" or ")),
            _ if default.is_empty() => String::new(),
            _ => format!("`{default}`"),
        };
        format!("| {key} | {} | {default} | {help} |\n", unit.trim_end_matches("; "))
    };
    schema["properties"].as_object().unwrap().iter().map(row).collect()
}

/// Returns the name and the schema of each table within a table.
fn tables(schema: &Value) -> Vec<(String, &Value)> {
    let mut tables = Vec::new();
    for (key, of) in schema["properties"].as_object().unwrap() {
        for table in [of, &of["items"], &of["anyOf"][1]].into_iter().filter(|of| of["properties"].is_object())
        {
            tables.push((key.clone(), table));
            tables.extend(self::tables(table));
        }
    }
    tables
}

/// The page has the row of every key of every table, as its schema tells unit, default and meaning.
#[test]
fn every_key_is_documented() {
    let schema = schema();
    let tables = tables(&schema);
    assert!(tables.len() >= 20, "{}", tables.len());
    for (name, table) in tables {
        let rows = rows(table);
        assert!(PAGE.contains(&rows), "docs/scenes.md lacks these rows of {name}:\n{rows}");
    }
    for name in schema["properties"].as_object().unwrap().keys() {
        let said = [format!("`{name}`"), format!("`[{name}]`"), format!("`[[{name}]]`")];
        assert!(said.iter().any(|said| PAGE.contains(said)), "{name}");
    }
}

/// Reports and pictures find the unit of a key in its row.
#[test]
fn units_of_keys_are_told() {
    let told = [
        ("load.pressure", "Pa"),
        ("spring.0.stiffness", "N/m"),
        ("rib.mass", "kg/m"),
        ("load.gravity", "m/s2"),
    ];
    for (key, unit) in told {
        assert_eq!(rebond::scene::unit(key).as_deref(), Some(unit), "{key}");
    }
    for key in ["mesh.refine", "obstacle.0.stiffness", "support.0.at.x", "nonsense", ""] {
        assert_eq!(rebond::scene::unit(key), None, "{key}");
    }
}
