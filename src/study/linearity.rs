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
//! The deflection examined is that of the start and, in scenes without contact, that under the
//! constant load.

use crate::dof_map::{DofMap, PER_NODE};
use crate::error::Result;
use crate::linalg::Engine;
use crate::mesh::Mesh;
use crate::output::text::short;
use crate::scene::Scene;
use crate::simulation::{self, Model};

/// Deflection over thickness above which stretching counts.
const MAX_SHARE_OF_THICKNESS: f64 = 0.3;

/// Slope above which rotation counts.
const MAX_SLOPE: f64 = 0.3;

/// Distance from a line that counts as none, relative to the size of the plate.
const ON_LINE: f64 = 1e-6;

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
    let parts = scene.parts.iter().map(|part| part.plate.thickness);
    let thickness = parts.fold(scene.plate.plate.thickness, f64::max);
    let [w, h, steep] = [deflection, deflection / thickness, slope].map(short);
    if is_held_around(&mesh, &space) && deflection > MAX_SHARE_OF_THICKNESS * thickness {
        return Some(format!(
            "the static deflection is {w} m, {h} times the thickness: where the supports hold the plate in its plane too, it stretches \
             and is stiffer than this linear plate by more than 5 % (limit: {MAX_SHARE_OF_THICKNESS} times the thickness); \
             in_plane.stretching = true computes it"
        ));
    }
    (slope > MAX_SLOPE).then(|| {
        format!(
            "the static deflection is {w} m, with slopes up to {steep}: the linear plate neglects their squares beside 1, \
             which is more than 4 % of the deflection (limit: {MAX_SLOPE})"
        )
    })
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

/// Returns whether the nodes without deflection do not lie on one straight line.
fn is_held_around(mesh: &Mesh, space: &DofMap) -> bool {
    let held: Vec<_> = (0..mesh.nodes.len())
        .filter(|&node| space.deflection(node).is_none())
        .map(|node| mesh.nodes[node])
        .collect();
    let Some(first) = held.first() else { return false };
    let distance = |node: &&_| nalgebra::distance(first, *node);
    let Some(far) = held.iter().max_by(|a, b| distance(a).total_cmp(&distance(b))) else { return false };
    let along = far - first;
    let off = |node: &nalgebra::Point2<f64>| along.perp(&(node - first)).abs();
    held.iter().any(|node| off(node) > ON_LINE * along.norm_squared())
}
