//! `rebond continue` as a user calls it.

use crate::common::command::{assert_fails, folder, rebond, succeeds};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

const HARDENING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/gallery/hardening.toml");

/// Returns the rows of a table, by the names of their columns.
fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(|line| line.split(','));
    let heads: Vec<&str> = lines.next().unwrap().collect();
    let row = |cells| heads.iter().map(|head| (*head).to_owned()).zip(cells).collect();
    lines.map(|cells| row(cells.map(str::to_owned).collect::<Vec<_>>())).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap()
}

/// The runs of a sweep up and down lie on the stable parts of the branch, and change from one part
/// to the other beyond its folds.
#[test]
fn runs_lie_on_the_branch_and_jump_at_its_folds() {
    let folder = folder("continue-hardening", "");
    let given = ["sweep", HARDENING, "--over", "frequency=21.6..24.6:6", "--up-and-down", "--out", "runs"];
    succeeds(&rebond(&folder, &[&given[..], &["--periods", "300", "--settle", "290"]].concat()));
    let given = ["continue", HARDENING, "--over", "frequency=20..26", "--sweep", "runs", "--out", "branch"];
    let said = succeeds(&rebond(&folder, &given));
    assert!(said.contains("the range is covered") && said.contains("branch/branch.csv"), "{said}");
    for file in ["branch.json", "plots/branch.png", "plots/multipliers.svg"] {
        assert!(folder.join("branch").join(file).is_file(), "{file}");
    }
    // The page of the branch lists both folds.
    let said = succeeds(&rebond(&folder, &["report", "branch"]));
    let page = fs::read_to_string(folder.join("branch/report.html")).unwrap();
    let branch = rows(&folder.join("branch/branch.csv"));
    assert!(said.contains(&format!("({} rows, 2 pictures", branch.len())), "{said}");
    assert_eq!(page.matches(">fold</td>").count(), 2 * 2);
    assert!(page.contains("rebond continue scene.toml --over frequency=20..26 --out again"));
    let folds: Vec<f64> =
        branch.iter().filter(|row| row["point"] == "fold").map(|row| number(row, "frequency")).collect();
    let [upper, lower] = folds[..] else { panic!("{} folds", folds.len()) };
    assert!((23.5..23.9).contains(&upper) && (22.1..22.4).contains(&lower), "{upper}, {lower}");
    // Stable motions at a frequency, the small one first.
    let stable = |frequency: f64| {
        let crosses = |pair: &&[BTreeMap<String, String>]| {
            let [from, to] = [&pair[0], &pair[1]].map(|row| number(row, "frequency"));
            pair.iter().all(|row| row["stable"] == "1") && (from - frequency) * (to - frequency) <= 0.0
        };
        let mut values: Vec<f64> = branch
            .windows(2)
            .filter(crosses)
            .map(|pair| {
                let [from, to] = [&pair[0], &pair[1]].map(|row| number(row, "frequency"));
                let share = (frequency - from) / (to - from);
                let [from, to] = [&pair[0], &pair[1]].map(|row| number(row, "tip_max"));
                from + share * (to - from)
            })
            .collect();
        values.sort_by(f64::total_cmp);
        values
    };
    for row in rows(&folder.join("runs/sweep.csv")) {
        let (frequency, tip) = (number(&row, "frequency"), number(&row, "tip_max"));
        let possible = stable(frequency);
        let is_large = frequency < upper && (row["direction"] == "up" || frequency < lower);
        let expected = if is_large { possible[possible.len() - 1] } else { possible[0] };
        assert!(
            (tip / expected - 1.0).abs() < 0.01,
            "{frequency}, {}: {tip} for {expected}",
            row["direction"]
        );
        assert_eq!(possible.len(), if (lower..upper).contains(&frequency) { 2 } else { 1 }, "{frequency}");
    }
    // Pictures are drawn again, and nothing is replaced unasked.
    succeeds(&rebond(&folder, &["plot", "branch"]));
    let again = ["continue", HARDENING, "--over", "frequency=20..26", "--out", "branch"];
    assert_fails(&rebond(&folder, &again), 2, &["holds a branch"]);
    let other = ["continue", HARDENING, "--over", "damping.mass=3..4", "--sweep", "runs", "--out", "other"];
    assert_fails(&rebond(&folder, &other), 2, &["--sweep", "expected a sweep over damping.mass"]);
}

/// Starts of the strip lead to two motions: a large one on the pads, and one that meets neither.
#[test]
fn starts_lead_to_two_motions() {
    const BASINS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/gallery/basins.toml");
    let folder = folder("basins", "");
    let given = ["--over", "deflection=-4e-3..4e-3:5", "--over", "speed=-0.6..0.6:5", "--out", "out"];
    let said = succeeds(&rebond(&folder, &[&["sweep", BASINS][..], &given].concat()));
    assert!(said.contains("attractor  period") && folder.join("out/plots/basins.png").is_file(), "{said}");
    let told: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("out/sweep.json")).unwrap()).unwrap();
    let attractors = told["basins"]["attractors"].as_array().unwrap();
    assert!(attractors.len() == 2 && attractors.iter().all(|one| one["period"] == 1), "{said}");
    assert_eq!(told["basins"]["unsettled"], 0);
    let runs = rows(&folder.join("out/sweep.csv"));
    for (label, attractor) in ["1", "2"].into_iter().zip(attractors) {
        let counted: Vec<_> = runs.iter().filter(|row| row["attractor"] == label).collect();
        assert_eq!(attractor["runs"], counted.len());
        let share = attractor["fraction"].as_f64().unwrap();
        assert!(
            (share - counted.len() as f64 / 25.0).abs() < 1e-12 && attractor["low"].as_f64().unwrap() < share
        );
        assert!(counted.iter().all(|row| (number(row, "impacts") > 0.0) == (label == "1")));
    }
    assert!(attractors[1]["runs"].as_u64().unwrap() > 0);
    let blind = ["--set", "output.probes=[]"];
    assert_fails(
        &rebond(&folder, &[&["sweep", BASINS][..], &blind].concat()),
        2,
        &["sweep.basins", "expected at least one of output.probes"],
    );
}

#[test]
fn what_cannot_be_followed_is_refused() {
    let folder = folder("continue-refused", "");
    let refused = |given: &[&str], why: &str| {
        assert_fails(&rebond(&folder, &[&["continue", HARDENING][..], given].concat()), 2, &[why]);
    };
    refused(&["--over", "frequency=18"], "expected KEY=FROM..TO");
    refused(&["--over", "frequenzy=18..20"], "frequenzy");
    refused(&["--over", "frequency=18..18"], "expected KEY=FROM..TO");
    refused(&["--over", "frequency=18..20", "--period", "0.06"], "do not repeat after the period");
    refused(&["--over", "frequency=18..20", "--step", "0"], "--step 0: expected");
    refused(&["--over", "frequency=18..20", "--periods", "0"], "--periods");
    refused(
        &["--over", "frequency=18..20", "--set", "time.mass=singular", "--set", "time.scheme=newmark"],
        "time.m",
    );
    refused(&["--over", "mesh.refine=0..2"], "expected a number of uniform refinements");
    let velocity = "output.probes=[{ name = \"tip\", at = [0.2, 0.025], quantity = \"velocity\" }]";
    refused(&["--over", "frequency=18..20", "--set", velocity], "expected probes of deflections");
    refused(&["--energy", "1e-6..1e-3"], "the plate is driven");
    refused(&["--energy", "0..1e-3"], "expected FROM..TO in J");
    let still = ["--set", "load.pressure=0"];
    refused(&[&["--over", "damping.mass=3..4"][..], &still].concat(), "nothing in the scene changes in time");
    refused(&[&["--energy", "1e-6..1e-3"][..], &still].concat(), "the plate is damped");
    let undamped = [&still[..], &["--set", "damping.mass=0"]].concat();
    refused(
        &[&["--energy", "1e-6..1e-3", "--mode", "9"][..], &undamped].concat(),
        "--mode 9: expected a number from 1 to 6",
    );
}
