//! Warning of deflections at which a plate is no longer linear.
//!
//! Two effects that the model of Kirchhoff and Love leaves out grow with the deflection:
//!
//! - **Stretching.** A plate that is held around cannot bend without stretching its mid-plane, if
//!   its supports hold it in its plane too. A clamped disc of thickness h under a pressure that
//!   deflects its centre by w is stiffer than the linear disc by a factor of 1 + 0.546 (w/h)^2 at
//!   Poisson's ratio 0.3. At [`MAX_SHARE_OF_THICKNESS`] that is 5 per cent.
//! - **Rotation.** A plate that is held along one line bends without stretching, but the linear
//!   curvature neglects the square of the slope beside 1. A cantilever under a force that deflects
//!   its tip by a fifth of its length, with a slope of [`MAX_SLOPE`] there, deflects 4 per cent
//!   less than the linear one (K. E. Bisshopp, D. C. Drucker, Large deflection of cantilever beams,
//!   Quarterly of Applied Mathematics 3, 1945).
//!
//! The deflections examined are the one of the start, in scenes without contact the one under the
//! constant load, and after a run its largest one.

use crate::dof_map::{DofMap, PER_NODE};
use crate::error::Result;
use crate::linalg::Engine;
use crate::mesh::{Mesh, Point};
use crate::output::text::{engineering, short, significant};
use crate::scene::Scene;
use crate::simulation::{self, Model, Outcome};

/// Deflection over thickness above which stretching counts.
const MAX_SHARE_OF_THICKNESS: f64 = 0.3;

/// Slope above which rotation counts.
const MAX_SLOPE: f64 = 0.3;

/// Deflection over distance from the support, of a plate held along one line, above which rotation
/// counts.
const MAX_SHARE_OF_REACH: f64 = 0.2;

/// First words of the warnings of static deflections.
const STATIC: &str = "the static deflection";

/// Distance from a line that counts as none, relative to the size of the plate.
const ON_LINE: f64 = 1e-6;

/// Distance of the variable of stretching from the root of its energy, relative to the largest
/// root, that is warned of.
const MAX_GAP: f64 = 0.01;

/// Returns the warning of a scene, if its static deflections are too large for a linear plate.
pub(super) fn warning(scene: &Scene, model: &Model) -> Option<String> {
    if scene.stretches() {
        return None;
    }
    // An error here has been reported by what needs the deflections.
    let mesh = simulation::mesh(scene).ok()?;
    let space = simulation::space(scene, &mesh).ok()?;
    let loaded = under_load(scene, model).ok()?;
    let [mut deflection, mut slope] = [0.0_f64; 2];
    for u in std::iter::once(&model.start.displacement).chain(&loaded) {
        for node in space.shape(u).chunks_exact(PER_NODE) {
            deflection = deflection.max(node[0].abs());
            slope = slope.max(node[1].hypot(node[2]));
        }
    }
    let thickness = largest_thickness(scene);
    if deflection > MAX_SHARE_OF_THICKNESS * thickness && matches!(held(&mesh, &space), HeldNodes::Around) {
        return Some(of_stretching(STATIC, deflection, thickness));
    }
    let steep = format!("with slopes up to {}", short(slope));
    let limit = format!("limit: {MAX_SLOPE}");
    (slope > MAX_SLOPE).then(|| of_rotation(STATIC, deflection, &steep, &limit))
}

/// Returns the warning of a run whose largest deflection is too large for a linear plate; `None`
/// where the warnings before the run said so.
///
/// A plate that stretches is warned of where the variable of its energy has left the energy.
pub fn of_run(scene: &Scene, outcome: &Outcome, warnings: &[String]) -> Option<String> {
    if let Some(gap) = outcome.stretching_gap.filter(|gap| *gap > MAX_GAP) {
        return Some(format!(
            "the variable by which the scheme knows the energy of stretching is {} % off its root: take a smaller \
             time.step, or time.scheme = \"conserving\", which has no such variable",
            significant(100.0 * gap)
        ));
    }
    let is_said = warnings.iter().any(|warning| warning.starts_with(STATIC));
    // Deflections are relative to the ground, and supports that move carry the plate along.
    if is_said || scene.stretches() || scene.motions().next().is_some() {
        return None;
    }
    let [deflection, thickness] = [outcome.largest_deflection?.value.abs(), largest_thickness(scene)];
    if deflection <= MAX_SHARE_OF_THICKNESS * thickness {
        return None;
    }
    let mesh = simulation::mesh(scene).ok()?;
    let largest = "the largest deflection";
    match held(&mesh, &simulation::space(scene, &mesh).ok()?) {
        HeldNodes::Around => Some(of_stretching(largest, deflection, thickness)),
        HeldNodes::AlongLine { reach } if deflection > MAX_SHARE_OF_REACH * reach => {
            let share = format!("{} times the length that juts out", short(deflection / reach));
            let limit = format!("limit: {MAX_SHARE_OF_REACH} times");
            Some(of_rotation(largest, deflection, &share, &limit))
        }
        HeldNodes::AlongLine { .. } | HeldNodes::Loosely => None,
    }
}

/// Returns the warning of a deflection at which a plate that is held around stretches.
fn of_stretching(what: &str, deflection: f64, thickness: f64) -> String {
    let [w, h] = [engineering(deflection, "m"), short(deflection / thickness)];
    format!(
        "{what} is {w}, {h} times the thickness: where the supports hold the plate in its plane too, it stretches \
         and is stiffer than this linear plate by more than 5 % (limit: {MAX_SHARE_OF_THICKNESS} times the thickness); \
         in_plane.stretching = true computes it"
    )
}

/// Returns the warning of a deflection at which squares of slopes count.
fn of_rotation(what: &str, deflection: f64, share: &str, limit: &str) -> String {
    let w = engineering(deflection, "m");
    format!(
        "{what} is {w}, {share}: the linear plate neglects the squares of slopes beside 1, which is more than 4 % of the \
         deflection ({limit})"
    )
}

/// Returns the largest thickness of the plate and its parts, in m.
fn largest_thickness(scene: &Scene) -> f64 {
    let parts = scene.parts.iter().map(|part| part.plate.thickness);
    parts.fold(scene.plate.plate.thickness, f64::max)
}

/// Returns the deflection under the constant load; `None` without one, in contact, or where nothing
/// holds the plate.
fn under_load(scene: &Scene, model: &Model) -> Result<Option<Vec<f64>>> {
    let system = &model.system;
    let Some(load) = system.load.as_ref().filter(|_| !scene.has_contact() && model.mechanism.is_none())
    else {
        return Ok(None);
    };
    let mut u = load.clone();
    system.engine.factor(&(&system.stiffness).into(), &[])?.solve(&mut u)?;
    Ok(Some(u))
}

/// Nodes without deflection.
enum HeldNodes {
    /// There are none, or a single one.
    Loosely,
    /// They lie on one straight line.
    AlongLine {
        /// Largest distance of a node from the line, in m.
        reach: f64,
    },
    /// They do not.
    Around,
}

/// Returns where the nodes without deflection lie.
fn held(mesh: &Mesh, space: &DofMap) -> HeldNodes {
    let held: Vec<Point> = (0..mesh.nodes.len())
        .filter(|&node| space.deflection(node).is_none())
        .map(|node| mesh.nodes[node])
        .collect();
    let Some(first) = held.first() else { return HeldNodes::Loosely };
    let distance = |node: &&Point| nalgebra::distance(first, *node);
    let Some(far) = held.iter().max_by(|a, b| distance(a).total_cmp(&distance(b))) else {
        return HeldNodes::Loosely;
    };
    let along = far - first;
    let length = along.norm();
    if length == 0.0 {
        return HeldNodes::Loosely;
    }
    let off = |node: &Point| along.perp(&(node - first)).abs() / length;
    match held.iter().any(|node| off(node) > ON_LINE * length) {
        true => HeldNodes::Around,
        false => HeldNodes::AlongLine { reach: mesh.nodes.iter().map(off).fold(0.0, f64::max) },
    }
}
