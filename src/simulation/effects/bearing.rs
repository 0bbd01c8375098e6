//! Equilibrium of a plate that is a mechanism on its supports and is held by obstacles.
//!
//! An equilibrium exists if and only if some non-negative reactions of the obstacles balance the
//! load on the unrestrained rigid motions (Farkas' lemma). Otherwise there is a rigid motion that
//! no obstacle stops and on which the load does work, and the error message names it.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use crate::assembly;
use crate::communicator::Communicator;
use crate::dof_map::Rigid;
use crate::error::{Error, Result};
use crate::linalg::Form;
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scheme::{self, System};
use crate::simulation::check_residual;
use nalgebra::{DMatrix, Vector3};

/// Stiffness of the proximal steps on the rigid motions, relative to the plate's lowest bending
/// mode.
const HOLD: f64 = 1e-4;

/// Largest unbalanced part of a load, relative to the whole, that counts as rounding.
const BALANCED: f64 = 1e-10;

/// Slope of a rigid motion times the plate size, relative to its deflection, up to which it counts
/// as a translation.
const STRAIGHT: f64 = 1e-3;

/// Largest number of exchanges in the search for reactions that balance a load.
const MOST_EXCHANGES: usize = 1000;

/// Computes the equilibrium under a load of a plate that is a mechanism, within the bounds.
/// Collective.
///
/// # Errors
/// Returns [`Error::Singular`], with `key` and the motion, where no equilibrium exists.
pub(super) fn equilibrium<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    key: &str,
    system: &System<E>,
    stiffness: &Form,
    load: &[f64],
    bounds: &Bounds,
) -> Result<Vec<f64>> {
    let engine = &system.engine;
    let rigid = ground.rigid(&[]);
    if let Some(escape) = escape(ground, &rigid, system, load, bounds)? {
        let loose = rigid.mechanism().unwrap_or_default();
        return Err(Error::Singular(format!(
            "{key}: the plate has no equilibrium, for its supports leave it a mechanism ({loose}), and no obstacle keeps its \
             load from moving it: {}",
            in_words(&rigid, escape)
        )));
    }
    // Square of the angular frequency of a plate bending to a bowl.
    let (centre, size) = rigid.frame();
    let bowl = ground.mesh.nodes.iter().flat_map(|node| {
        let arm = (node - centre) / size;
        [arm.norm_squared(), 2.0 * arm.x / size, 2.0 * arm.y / size]
    });
    let squares = assembly::squares(ground.mesh, &ground.cells, &bowl.collect::<Vec<_>>());
    let [bent, curved] = ground.comm().all_reduce_sum(squares);
    let mass = engine.native().form(assembly::consistent_mass(&ground.cells));
    let hold = &mass * (HOLD * bent / curved);
    let (u, _, verdict) = scheme::equilibrium_on_bounds(engine, stiffness, hold, load, bounds)?;
    check_residual(0, 0.0, verdict.kkt, ground.scene.solver.tolerance)?;
    Ok(u)
}

/// Returns the rigid motion a + b x + c y along which a load drives the plate away from all bounds;
/// `None` if reactions balance the load. Collective.
fn escape<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    rigid: &Rigid,
    system: &System<E>,
    load: &[f64],
    bounds: &Bounds,
) -> Result<Option<Vector3<f64>>> {
    let engine = &system.engine;
    let (centre, size) = rigid.frame();
    let motions = rigid.free();
    let sizes: Vec<f64> = load.iter().map(|f| f.abs()).collect();
    let mut shapes = Vec::new();
    let (mut force, mut total) = (Vector3::zeros(), 0.0_f64);
    for (k, motion) in motions.iter().enumerate() {
        let shape = ground.mesh.nodes.iter().flat_map(|node| {
            let arm = (node - centre) / size;
            [motion.dot(&Vector3::new(1.0, arm.x, arm.y)), motion[1] / size, motion[2] / size]
        });
        let shape = ground.owned(&ground.space.interpolate(&shape.collect::<Vec<_>>()), engine.dofs());
        force[k] = engine.dot(load, &shape)?;
        let shape_sizes: Vec<f64> = shape.iter().map(|w| w.abs()).collect();
        total = total.max(engine.dot(&sizes, &shape_sizes)?);
        shapes.push(shape);
    }
    if total == 0.0 {
        return Ok(None);
    }
    // Force of a unit reaction at a bound on the rigid motions.
    let push = |dof: usize| Vector3::from_fn(|k, _| shapes.get(k).map_or(0.0, |shape| shape[dof]));
    let reactions = || {
        bounds.dofs.iter().enumerate().flat_map(move |(i, &dof)| {
            let up = bounds.lower[i].is_finite().then(|| push(dof));
            let down = bounds.upper[i].is_finite().then(|| -push(dof));
            up.into_iter().chain(down).filter(|reaction| reaction.norm() > 0.0)
        })
    };
    // Reaction of all processes that reduces the remainder most.
    let most = |rest: Vector3<f64>| {
        let units = reactions().map(|reaction| reaction.normalize());
        let best = units.min_by(|a, b| a.dot(&rest).total_cmp(&b.dot(&rest))).unwrap_or_default();
        let bests = ground.comm().all_gather_one::<[f64; 3]>(best.into()).into_iter().map(Vector3::from);
        bests.min_by(|a, b| a.dot(&rest).total_cmp(&b.dot(&rest))).unwrap_or_default()
    };
    let rest = unbalanced(force / total, most);
    let motion = || motions.iter().zip(rest.iter()).map(|(motion, part)| motion * *part).sum();
    Ok((rest.norm() > BALANCED).then(motion))
}

/// Returns the smallest remainder of a force after non-negative multiples of reactions are added
/// (Lawson and Hanson's NNLS). The closure `most` returns the reaction that reduces a remainder
/// most.
fn unbalanced(force: Vector3<f64>, most: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vector3<f64> {
    let mut taken: Vec<(Vector3<f64>, f64)> = Vec::new();
    let mut rest = force;
    for _ in 0..MOST_EXCHANGES {
        let reaction = most(rest);
        let is_taken = taken.iter().any(|(taken, _)| *taken == reaction);
        if is_taken || reaction.dot(&rest) >= -f64::EPSILON * force.norm() {
            break;
        }
        taken.push((reaction, 0.0));
        // Remove the reactions that would have to pull.
        while !taken.is_empty() {
            let columns: Vec<Vector3<f64>> = taken.iter().map(|(reaction, _)| *reaction).collect();
            let svd = DMatrix::from_fn(3, columns.len(), |i, j| columns[j][i]).svd(true, true);
            let Ok(wanted) = svd.solve(&DMatrix::from_fn(3, 1, |i, _| -force[i]), BALANCED) else { break };
            let pulls = taken.iter().zip(wanted.iter()).filter(|(_, wanted)| **wanted <= 0.0);
            let part = pulls.map(|((_, now), wanted)| now / (now - wanted)).fold(f64::INFINITY, f64::min);
            let step = part.min(1.0);
            taken.iter_mut().zip(wanted.iter()).for_each(|((_, now), wanted)| *now += step * (wanted - *now));
            if part.is_infinite() {
                break;
            }
            taken.retain(|(_, now)| *now > f64::EPSILON * force.norm());
        }
        let sum: Vector3<f64> = taken.iter().map(|(reaction, now)| reaction * *now).sum();
        rest = force + sum;
    }
    rest
}

/// Describes a rigid motion in words.
fn in_words(rigid: &Rigid, motion: Vector3<f64>) -> String {
    let (centre, size) = rigid.frame();
    let slope = motion.yz();
    if slope.norm() <= STRAIGHT * motion.x.abs() {
        return format!("it would {} for ever", if motion.x > 0.0 { "rise" } else { "fall" });
    }
    let along = slope / slope.norm();
    let on_line = centre - along * (size * motion.x / slope.norm());
    format!(
        "it would tip about the line through ({:.4}, {:.4}) along ({:.4}, {:.4})",
        on_line.x, on_line.y, -along.y, along.x
    )
}
