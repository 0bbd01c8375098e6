//! Laws that a motion obeys, whatever the scene.

use super::comparison::{Columns, both, difference, moves_alike, run};
use super::scene::Drawn;
use super::view::{Group, PLAIN};
use crate::common::command::{rebond, succeeds};
use crate::common::models::plate;
use crate::common::plates::Matrices;
use rebond::assembly;
use rebond::linalg::vectors::dot;
use rebond::mesh::Mesh;
use std::path::Path;

/// Without contact twice the loads and the start give twice the motion.
pub(super) fn doubles(drawn: &Drawn, folder: &Path) {
    let once = Drawn { obstacles: Vec::new(), ball: None, slider: None, ..drawn.clone() };
    let (size, grows, omega) = once.pressure;
    let twice = Drawn {
        pressure: (2.0 * size, grows, omega),
        gravity: 2.0 * once.gravity,
        force: once.force.map(|(point, value)| (point, 2.0 * value)),
        motion: once.motion.map(|[amplitude, omega]| [2.0 * amplitude, omega]),
        speed: 2.0 * once.speed,
        ..once.clone()
    };
    let tomls = [&once, &twice].map(|drawn| drawn.toml(&PLAIN, ""));
    let Some([mut plain, twice]) = both(folder, ["once", "twice"], tomls) else { return };
    for (name, values) in &mut plain {
        let is_energy = matches!(PLAIN.column(name), Some((_, Group::Energy)));
        values.iter_mut().for_each(|value| *value *= if is_energy { 4.0 } else { 2.0 });
    }
    let (share, column) = difference(&plain, &twice, &PLAIN);
    assert!(share <= 1.0, "{}: doubled: {column} is off by {share:e}", folder.display());
}

/// Supports at a uniform velocity are obstacles at the opposite one, where nothing else is fixed to
/// the ground.
pub(super) fn has_no_absolute_velocity(drawn: &Drawn, folder: &Path) {
    let is_held = |(_, kind, _): &(usize, &str, [f64; 2])| matches!(*kind, "clamped" | "simply_supported");
    if drawn.scheme == "exact" || !drawn.supports.iter().all(is_held) {
        return;
    }
    let drawn =
        Drawn { springs: Vec::new(), foundation: None, slider: None, damping: [0.0; 2], ..drawn.clone() };
    let velocity = 0.2 * drawn.speed;
    let carried = Drawn { drift: [velocity, 0.0, velocity], ..drawn.clone() };
    let beside = Drawn { drift: [0.0, -velocity, 0.0], ..drawn.clone() };
    let tomls = [&carried, &beside].map(|drawn| drawn.toml(&PLAIN, ""));
    let Some([mut carried, mut plain]) = both(folder, ["carried", "beside"], tomls) else { return };
    plain.retain(|name, _| !matches!(PLAIN.column(name), None | Some((_, Group::Energy))));
    let times = carried["time"].clone();
    for (name, values) in &mut carried {
        if let Some((_, Group::Deflection)) = PLAIN.column(name) {
            values.iter_mut().zip(&times).for_each(|(value, time)| *value -= velocity * time);
        }
    }
    moves_alike(&beside, folder, [&plain, &carried], &PLAIN, "carried");
}

/// Two schemes differ by no more than their steps explain.
pub(super) fn schemes_meet(drawn: &Drawn, folder: &Path) {
    if drawn.slider.is_some() || drawn.damping[1] > 0.0 {
        return;
    }
    let points = |scheme: &'static str, finer: usize| {
        let (step, steps) = (drawn.step / finer as f64, 60 * finer);
        let fine = Drawn { scheme, mass: "singular", beta: 0.3, step, steps, ..drawn.clone() };
        let columns = run(folder, &format!("{scheme}-{finer}"), &fine.toml(&PLAIN, "")).ok()?;
        let names = (0..3).map(|i| format!("point{i}"));
        Some(names.flat_map(|name| columns[&name].clone().into_iter().step_by(finer)).collect::<Vec<_>>())
    };
    let runs = ["newmark", "conserving"].map(|scheme| [2, 4].map(|finer| points(scheme, finer)));
    let [[Some(a), Some(fine_a)], [Some(b), Some(fine_b)]] = &runs else { return };
    let size = fine_a.iter().fold(f64::MIN_POSITIVE, |size, value| size.max(value.abs()));
    let distance =
        |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |worst, (a, b)| worst.max((a - b).abs() / size));
    let (apart, explained) = (distance(fine_a, fine_b), distance(a, fine_a) + distance(b, fine_b));
    assert!(
        apart <= 6.0 * explained + 3e-4,
        "{}: two schemes are {apart:e} apart, and {explained:e} is explained",
        folder.display()
    );
}

pub(super) fn keeps_its_energy(drawn: &Drawn, plain: &Columns, folder: &Path) {
    let largest = |name: &str| plain[name].iter().fold(0.0_f64, |size, value| size.max(value.abs()));
    let size = largest("kinetic").max(largest("elastic")).max(largest("work"));
    let steps = plain["energy"].windows(2).map(|pair| (pair[1] - pair[0]) / size);
    let bound = 1e-9;
    let worst =
        steps.fold(0.0_f64, |worst, step| worst.max(if drawn.damping[0] > 0.0 { step } else { step.abs() }));
    assert!(worst < bound, "{}: the energy changes by {worst:e} in a step", folder.display());
}

/// Quantities at the nodes from which the force of a foundation follows, which is no column.
const NODAL: [&str; 3] = ["deflection", "slope_x", "slope_y"];

/// Returns probes of the deflection and its slopes at the nodes of a mesh.
fn nodal_probes(mesh: &Mesh) -> String {
    let probe = |node: usize, quantity: &str| {
        let [x, y]: [f64; 2] = mesh.nodes[node].into();
        format!("{{ name = \"{quantity}{node}\", at = [{x:e}, {y:e}], quantity = \"{quantity}\" }}, ")
    };
    (0..mesh.nodes.len()).flat_map(|node| NODAL.map(|quantity| probe(node, quantity))).collect()
}

/// Returns the force of a foundation at the start of a run, in N, given its stiffness in N/m3.
fn foundation_force(stiffness: f64, mesh: Mesh, columns: &Columns) -> f64 {
    let start = |node: usize| NODAL.map(|quantity| columns[&format!("{quantity}{node}")][0]);
    let shape: Vec<f64> = (0..mesh.nodes.len()).flat_map(start).collect();
    let cells = Matrices::new(mesh, plate(), &[]).cells;
    dot(&assembly::uniform_load(&cells, shape.len(), -stiffness), &shape)
}

/// An equilibrium under constant loads stays at rest, and its supports carry the loads.
pub(super) fn stays_at_rest(drawn: &Drawn, folder: &Path) {
    let mut drawn = Drawn { motion: None, ball: None, ..drawn.clone() };
    drawn.pressure.2 = 0.0;
    drawn.obstacles.iter_mut().for_each(|obstacle| obstacle.swing = None);
    if drawn.scheme == "exact" {
        drawn.scheme = "newmark";
    }
    let toml = drawn.toml(&PLAIN, "equilibrium = true");
    let probes = format!("probes = [{}", nodal_probes(&drawn.mesh()));
    let toml = if drawn.foundation.is_some() { toml.replace("probes = [", &probes) } else { toml };
    let Ok(rest) = run(folder, "rest", &toml) else { return };
    let size =
        (0..3).flat_map(|i| &rest[&format!("point{i}")]).fold(f64::MIN_POSITIVE, |size, w| size.max(w.abs()));
    for point in 0..3 {
        let values = &rest[&format!("point{point}")];
        let drift = values.iter().fold(0.0_f64, |drift, w| drift.max((w - values[0]).abs())) / size;
        assert!(drift < 1e-7, "{}: the equilibrium moves by {drift:e} of itself", folder.display());
    }
    let forces = rest.iter().filter(|(name, _)| name.starts_with("force_")).map(|(_, values)| values[0]);
    let springs = drawn.springs.iter().map(|(_, stiffness)| -stiffness * rest["spring"][0]);
    let foundation = drawn.foundation.map(|stiffness| foundation_force(stiffness, drawn.mesh(), &rest));
    let parts: Vec<f64> = forces.chain(springs).chain(foundation).chain([drawn.load()]).collect();
    let (sum, scale) = (parts.iter().sum::<f64>(), parts.iter().map(|part| part.abs()).sum::<f64>());
    assert!(sum.abs() <= 1e-8 * scale, "{}: {parts:?} N are not in balance", folder.display());
}

/// A run to half the end that is resumed to the end leaves the same bytes as a run in one go.
pub(super) fn survives_an_interruption(drawn: &Drawn, folder: &Path) {
    let half = folder.join("half");
    let file = drawn.toml(&PLAIN, "");
    std::fs::write(folder.join("half.toml"), file).unwrap();
    let half_time = format!("time.end={:e}", drawn.step * (drawn.steps / 2) as f64);
    succeeds(&rebond(folder, &["run", "half.toml", "--out", "half", "--quiet", "--set", &half_time]));
    let end = format!("{:e}", drawn.step * drawn.steps as f64);
    succeeds(&rebond(folder, &["resume", "half", "--until", &end, "--quiet"]));
    let read = |folder: &Path| std::fs::read(folder.join("history.csv")).unwrap();
    assert!(read(&half) == read(&folder.join("plain")), "{}: not the same bytes", half.display());
}
