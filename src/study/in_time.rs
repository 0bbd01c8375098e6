//! Warnings about functions of time that the time step does not resolve.

use crate::field::{Interpolation, WINDOW};
use crate::mesh::Point;
use crate::output::text::significant;
use crate::scene::{FieldInput, Load, Scene};

/// Number of places at which fields that depend on place and time are sampled.
const PLACES: usize = 9;

/// Overshoot of a spline that causes no warning, relative to the range of the table's values.
const BEYOND: f64 = 0.1;

/// Returns warnings of unresolved functions of time and of splines that overshoot.
///
/// Each key of a load, a support motion or an obstacle height has at most one warning of each kind.
pub(super) fn warnings(scene: &Scene) -> Vec<String> {
    let places = places(scene);
    let mut warnings = Vec::new();
    for load in scene.load.iter().flat_map(Load::fields).filter(|given| given.changes()) {
        // In a sum of products each time factor is tested, in other fields the values at some
        // places.
        let missed = match load.terms() {
            Some(terms) => worst(terms.iter().map(|[time, _]| (time, Point::origin(), 0.0)), scene),
            None => worst(places.iter().map(|&place| (load, place, 0.0)), scene),
        };
        warnings.extend(missed.map(|(time, share)| {
            format!(
                "{}: around t = {time} s steps of {} s miss {share} % of its impulse over {WINDOW} steps: take a smaller time.step, \
                 or a longer pulse of the same impulse",
                load.key,
                significant(scene.time.step)
            )
        }));
    }
    let heights = scene.obstacles.iter().map(|obstacle| &obstacle.height);
    for moving in scene.motions().chain(heights).filter(|given| given.changes()) {
        let places = if moving.is_even() { &places[..1] } else { &places };
        // An obstacle's height needs a value only where the plate can touch the obstacle.
        let from = places.iter().filter_map(|&place| Some((moving, place, moving.at(place, 0.0).ok()?)));
        warnings.extend(worst(from, scene).map(|(time, share)| {
            format!(
                "{}: around t = {time} s steps of {} s miss {share} % of its motion over {WINDOW} steps: take a smaller time.step",
                moving.key,
                significant(scene.time.step)
            )
        }));
    }
    warnings.extend(scene.of_time().filter_map(|given| overshoot(given, scene.time.end)));
    warnings
}

/// Returns places spread over a rectangular plate, or the probes of a plate from a file.
fn places(scene: &Scene) -> Vec<Point> {
    if scene.file.is_some() {
        let probes = scene.output.probes.iter().map(|probe| probe.at.into());
        return std::iter::once(Point::origin()).chain(probes).take(PLACES).collect();
    }
    let share = |k: usize| (2 * k + 1) as f64 / 6.0;
    let place = |k: usize| Point::new(scene.plate.length * share(k % 3), scene.plate.width * share(k / 3));
    (0..PLACES).map(place).collect()
}

/// Returns the instant (s) and the share (%) of the function that steps resolve least.
///
/// Each function has a place and its value at the start, which is subtracted.
fn worst<'g>(
    functions: impl Iterator<Item = (&'g FieldInput, Point, f64)>,
    scene: &Scene,
) -> Option<(String, String)> {
    let missed = functions.filter_map(|(given, place, start)| given.missed(place, start, &scene.time));
    let worst = missed.max_by(|a, b| a.share.total_cmp(&b.share))?;
    Some((significant(worst.time), format!("{:.0}", 100.0 * worst.share)))
}

/// Returns the warning of a spline that overshoots the values of its table.
fn overshoot(given: &FieldInput, end: f64) -> Option<String> {
    let spline = given.table.as_ref().filter(|table| table.interpolation == Interpolation::Spline)?;
    let beyond = spline.rows.overshoot().filter(|beyond| beyond.share > BEYOND && beyond.time < end)?;
    Some(format!(
        "{}: at t = {} s the spline goes to {}, beyond the table's values by {} of their range: give more rows, or take \
         interpolation = \"linear\"",
        given.key,
        significant(beyond.time),
        significant(beyond.value),
        significant(beyond.share)
    ))
}
