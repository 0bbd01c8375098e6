//! Runs of drawn scenes, and comparisons of their histories.

use super::scene::Drawn;
use super::view::{Group, PLAIN, View};
use crate::common::command::{rebond, text};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub(super) type Columns = BTreeMap<String, Vec<f64>>;

/// Runs a scene. Returns the columns of its history, or the message with which it is refused.
pub(super) fn run(folder: &Path, name: &str, toml: &str) -> Result<Columns, String> {
    let file = format!("{name}.toml");
    std::fs::write(folder.join(&file), toml).unwrap();
    let output = rebond(folder, &["run", &file, "--out", name, "--quiet", "--overwrite"]);
    let said = text(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 2 | 3)), "{file} in {}: {said}", folder.display());
    if !output.status.success() {
        return Err(said);
    }
    let history = std::fs::read_to_string(folder.join(name).join("history.csv")).unwrap();
    let mut lines = history.lines();
    let names = lines.next().unwrap().split(',');
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|number| number.parse().unwrap()).collect()).collect();
    Ok(names
        .enumerate()
        .map(|(i, name)| (name.to_owned(), rows.iter().map(|row| row[i]).collect()))
        .collect())
}

/// Returns the largest difference of the columns of a view from the plain scene's, in parts
/// of the tolerance, and its column.
pub(super) fn difference(plain: &Columns, seen: &Columns, view: &View) -> (f64, String) {
    let compared: Vec<_> =
        plain.iter().filter_map(|(name, values)| Some((name, values, view.column(name)?))).collect();
    let mut scales = BTreeMap::<Group, f64>::new();
    for (_, values, (factor, group)) in &compared {
        let scale = scales.entry(*group).or_insert(f64::MIN_POSITIVE);
        *scale = values.iter().fold(*scale, |scale, value| scale.max((factor * value).abs()));
    }
    let mut worst = (0.0, String::new());
    for (name, values, (factor, group)) in compared {
        let Some(others) = seen.get(name).filter(|others| others.len() == values.len()) else {
            return (f64::INFINITY, format!("{name} is missing"));
        };
        for (value, other) in values.iter().zip(others) {
            let share = (factor * value - other).abs() / scales[&group] / group.tolerance();
            if share > worst.0 || share.is_nan() {
                worst = (if share.is_nan() { f64::INFINITY } else { share }, name.clone());
            }
        }
    }
    worst
}

pub(super) fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("drawn-{test}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Asserts that a scene seen otherwise moves like the plain one.
pub(super) fn moves_alike(
    drawn: &Drawn,
    folder: &Path,
    [plain, seen]: [&Columns; 2],
    view: &View,
    name: &str,
) {
    let (share, column) = difference(plain, seen, view);
    if share > 1.0 {
        // Impacts amplify rounding, as they do a change of the moduli by a millionth of it.
        let nudged = View { nudge: 1.0 + 1e-12, ..PLAIN };
        let nudged = run(folder, "nudged", &drawn.toml(&nudged, "")).unwrap();
        let (explained, _) = difference(plain, &nudged, &PLAIN);
        assert!(
            share <= 30.0 * explained,
            "{}: {name}: {column} is off by {share:e}, and {explained:e} is explained",
            folder.display()
        );
    }
}

/// Runs two scenes that are both refused or both run. Returns their columns.
pub(super) fn both(folder: &Path, names: [&str; 2], tomls: [String; 2]) -> Option<[Columns; 2]> {
    let [one, other] = [0, 1].map(|i| run(folder, names[i], &tomls[i]));
    assert_eq!(one.is_err(), other.is_err(), "{}: {one:?}, {other:?}", folder.display());
    Some([one.ok()?, other.ok()?])
}
