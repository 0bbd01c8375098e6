//! Branches of periodic motions for tests.

use super::scenes::{model, scene};
use rebond::continuation::{BranchLimits, BranchRow, Driven, DrivenScene, Family, Follower, Free};
use rebond::simulation::Model;

/// Follows a family over a range by steps of a largest length.
#[track_caller]
pub fn follow(family: &mut dyn Family, range: [f64; 2], step: f64) -> Vec<BranchRow> {
    let mut rows = Vec::new();
    let mut note = |motion: &_| {
        rows.push(BranchRow::new(motion));
        Ok(())
    };
    let follower = Follower::new(family, BranchLimits { range, step, most: 1000 });
    let ending = follower.follow(&mut note, &|| false).unwrap();
    assert_eq!(ending, "the range is covered");
    rows
}

/// Follows the driven motions of scenes over a key, given the period of the drive, with so many
/// periods in one of the motion and so many steps in one of the drive.
#[track_caller]
pub fn driven(
    text: impl Fn(f64) -> String,
    period: impl Fn(f64) -> f64,
    range: [f64; 2],
    [periods, steps]: [usize; 2],
    step: f64,
) -> Vec<BranchRow> {
    let build = |key: f64| Ok(DrivenScene { model: Model::new(&scene(&text(key)))?, period: period(key) });
    follow(&mut Driven::new(&build, range, [periods, steps, 200]), range, step)
}

/// Follows the free vibrations of a scene over their energy (J), from its first mode on.
#[track_caller]
pub fn free(text: &str, range: [f64; 2], step: f64) -> Vec<BranchRow> {
    let model = model(text);
    let seconds = scene(text).time.step;
    follow(&mut Free::new(&model, seconds, range[0], 1).unwrap(), range, step)
}

/// Returns a value of the motion at which another one, which grows along the branch, reaches a
/// number: by the parabola through the nearest motions.
pub fn interpolated(
    rows: &[BranchRow],
    number: f64,
    x: impl Fn(&BranchRow) -> f64,
    y: impl Fn(&BranchRow) -> f64,
) -> f64 {
    let distance = |k: usize| (x(&rows[k]) - number).abs();
    let middle = (1..rows.len() - 1).min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap();
    let near = &rows[middle - 1..middle + 2];
    let weight = |i: usize| {
        let others = (0..3).filter(|j| *j != i).map(|j| (number - x(&near[j])) / (x(&near[i]) - x(&near[j])));
        others.product::<f64>()
    };
    (0..3).map(|i| weight(i) * y(&near[i])).sum()
}
