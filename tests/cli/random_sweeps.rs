//! `rebond sweep` with random values: equal draws in any company, answers, messages.

use crate::common::command::{self, assert_fails, rebond, succeeds, text};
use crate::sweep;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

const GAP: &str = "gap=truncated_normal(5e-3, 2e-3, 1e-3, 9e-3)";

fn folder(test: &str) -> PathBuf {
    // Fewer periods than in other sweeps.
    let scene = sweep::SCENE.replace("periods = 12, settle = 8", "periods = 6, settle = 4");
    command::folder(&format!("random-{test}"), &scene)
}

fn table(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name).join("sweep.csv")).unwrap()
}

fn report(folder: &Path, name: &str) -> Value {
    serde_json::from_slice(&fs::read(folder.join(name).join("sweep.json")).unwrap()).unwrap()
}

/// A row depends, to the bit, on seed and number alone: not on the jobs, on the number of runs, on
/// what was made before, or on the others.
#[test]
fn a_row_depends_on_seed_and_number_alone() {
    let folder = folder("bits");
    let sweep = |out: &str, more: &[&str]| {
        let fixed = ["sweep", "fall.toml", "--quiet", "--out", out, "--random", GAP];
        succeeds(&rebond(&folder, &[&fixed[..], more].concat()));
        table(&folder, out)
    };
    let one = sweep("one", &["--runs", "20", "--seed", "7"]);
    assert_eq!(one.lines().count(), 21);
    assert_eq!(sweep("two", &["--runs", "20", "--seed", "7", "--jobs", "2"]), one);
    let few = sweep("few", &["--runs", "5", "--seed", "7"]);
    assert_eq!(few.lines().collect::<Vec<_>>(), one.lines().take(6).collect::<Vec<_>>());
    assert_ne!(sweep("other", &["--runs", "20", "--seed", "8"]), one);
    // A sweep that lost all but three of its rows, the last in the middle, goes on.
    let rows = fs::read_to_string(folder.join("one/rows.jsonl")).unwrap();
    let kept: Vec<&str> =
        rows.lines().enumerate().filter(|(i, _)| [0, 2, 9, 15].contains(i)).map(|(_, line)| line).collect();
    fs::write(folder.join("one/rows.jsonl"), kept.join("\n") + "\n{\"index\":3").unwrap();
    assert_eq!(sweep("one", &["--runs", "20", "--seed", "7", "--jobs", "2"]), one);
    // One run alone has the same measures, and `rebond run` makes its motion.
    let alone = ["sweep", "fall.toml", "--random", GAP, "--seed", "7", "--runs", "20", "--only", "13"];
    let row: Value =
        serde_json::from_str(&succeeds(&rebond(&folder, &[&alone[..], &["--json"]].concat()))).unwrap();
    assert_eq!(row, report(&folder, "one")["rows"][13]);
    let said = succeeds(&rebond(&folder, &alone));
    let gap = row["values"][0].as_f64().unwrap();
    assert!(
        said.starts_with(&format!(
            "rebond run fall.toml --set parameters.gap={gap:?} --set time.step=0.001 "
        )),
        "{said}"
    );
    let beyond = ["sweep", "fall.toml", "--only", "4"];
    assert_fails(&rebond(&folder, &beyond), 2, &["run 4: the sweep has the runs 0 to 3"]);
    assert_fails(&rebond(&folder, &[&beyond[..3], &["1", "--up"]].concat()), 2, &["run 1 continues others"]);
}

/// The answer comes first; draws that a key does not take are rows that say why, and bound the
/// probability from both sides.
#[test]
fn probabilities_are_told_and_bounded() {
    let folder = folder("answer");
    let arguments = [
        "sweep",
        "fall.toml",
        "--random",
        GAP,
        "--random",
        "plate.density=values(7770, 7770, 7770, -1)",
        "--runs",
        "40",
        "--criterion",
        "impacts > 0",
        "--criterion",
        "-corner_min < gap - 1e-6 and plate.density > 0",
    ];
    let output = rebond(&folder, &arguments);
    let said = succeeds(&output);
    let report = report(&folder, "sweeps/fall");
    let rows = report["rows"].as_array().unwrap();
    let failed = rows.iter().filter(|row| row["measures"].is_null()).count();
    assert!((4..16).contains(&failed), "{failed}");
    assert!(text(&output.stderr).contains("-1 is not positive"), "{}", text(&output.stderr));
    let hits = rows
        .iter()
        .filter(|row| row["measures"]["impacts"].as_f64().is_some_and(|impacts| impacts > 0.0))
        .count();
    let criterion = &report["criteria"][0];
    let number = |name: &str| criterion[name].as_f64().unwrap();
    assert_eq!(criterion["expression"], "impacts > 0");
    assert_eq!(
        [number("runs"), number("fulfilled"), number("undecided")],
        [40.0, hits as f64, failed as f64]
    );
    assert_eq!(number("probability"), hits as f64 / (40 - failed) as f64);
    assert!(
        number("low") < hits as f64 / 40.0 && number("high") > (hits + failed) as f64 / 40.0,
        "{criterion}"
    );
    assert!(said.starts_with("P(impacts > 0) = 0."), "{said}");
    assert!(said.contains(&format!("(40 runs, {failed} without an answer)")), "{said}");
    // Where the plate does not meet the floor, it stays above; the two criteria exclude each other.
    assert_eq!(report["criteria"][1]["fulfilled"], 40 - failed - hits);
    for picture in ["histograms", "distributions"] {
        assert!(folder.join(format!("sweeps/fall/plots/{picture}.png")).exists(), "{picture}");
    }
    let drawn = succeeds(&rebond(&folder, &["plot", "sweeps/fall"]));
    assert!(drawn.contains("histograms.svg") && !drawn.contains("response"), "{drawn}");
    succeeds(&rebond(&folder, &["report", "sweeps/fall"]));
    let page = fs::read_to_string(folder.join("sweeps/fall/report.html")).unwrap();
    assert!(page.contains("Numbers of runs by their measures"));
}

/// A linear plate follows its load: the load alone causes the variance of the deflection, and a
/// floor that is out of reach none.
#[test]
fn sensitivities_are_told() {
    let folder = folder("saltelli");
    let arguments = [
        "sweep",
        "fall.toml",
        "--random",
        "a=uniform(90, 110)",
        "--random",
        "gap=uniform(1, 2)",
        "--points",
        "saltelli",
        "--runs",
        "256",
    ];
    let said = succeeds(&rebond(&folder, &arguments));
    assert!(said.contains("corner_max    a  1.00 ± "), "{said}");
    let report = report(&folder, "sweeps/fall");
    let indices: Vec<&Value> = report["sensitivities"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|index| index["measure"] == "corner_max")
        .collect();
    for (index, (key, share)) in indices.iter().zip([("a", 1.0), ("gap", 0.0)]) {
        assert_eq!(index["key"], key);
        for order in ["first", "total"] {
            assert!((index[order].as_f64().unwrap() - share).abs() < 0.03, "{index}");
        }
    }
    assert!(folder.join("sweeps/fall/plots/sensitivities.png").exists());
}

#[test]
fn what_random_values_cannot_be_is_said() {
    let folder = folder("refused");
    let refuses = |more: &[&str], words: &[&str]| {
        let arguments = [&["sweep", "fall.toml", "--random", GAP][..], more].concat();
        assert_fails(&rebond(&folder, &arguments), 2, words);
    };
    let names = "random keys, parameters and corner_max, corner_min";
    refuses(
        &["--criterion", "peak_forc > 1"],
        &["fall.toml: sweep.criterion.0: column 1", "did you mean peak_force?", names],
    );
    refuses(&["--criterion", "peak_force"], &["sweep.criterion.0", "condition"]);
    refuses(&["--random", "a=nromal(1, 2)"], &["sweep.random.1", "did you mean normal?"]);
    refuses(&["--random", "plate.thick=normal(1, 2)"], &["plate.thick: unknown key"]);
    refuses(&["--random", "gap=normal(1, 2)"], &["sweep.random.1: gap is random already"]);
    refuses(
        &["--points", "saltelli", "--runs", "100"],
        &["sweep.runs: 100 is no multiple of 3", "expected 99 or 102"],
    );
    refuses(&["--correlation", "gap,b=0.5"], &["sweep.correlation: \"b\" is no key of sweep.random"]);
    refuses(&["--up"], &["sweep.direction", "do not continue each other"]);
    let fixed = ["sweep", "fall.toml", "--criterion", "peak_force > 1"];
    assert_fails(&rebond(&folder, &fixed), 2, &["sweep.criterion", "has no use without sweep.random"]);
}
