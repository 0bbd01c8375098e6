//! Stretching: the energy of the mid-plane, in the modes that carry the inertia.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use crate::error::{Error, Result};
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Form, MassModes};
use crate::membrane::{Membrane, QuarticForm, Stretch};
use crate::partition::Partition;
use crate::scheme::System;
use crate::simulation::plate_assembly::PlateAssembly;
use crate::simulation::{membrane_forces, phase};
use faer::Mat;
use faer::linalg::solvers::Solve;

/// Largest number of Newton's iterations, and of halvings of one.
const ITERATIONS: usize = 100;
const HALVINGS: i32 = 40;

/// Residuals of an equilibrium, relative to the load: the one at which the iteration ends, and the
/// largest where rounding ends it.
const SETTLED: f64 = 1e-13;
const ROUNDING: f64 = 1e-10;

/// Returns the energy of stretching in the modes of the mass; `None` where the scene has none.
///
/// # Errors
/// Returns the errors of the supports and of the membrane.
pub(super) fn form<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    system: &System<E>,
) -> Result<Option<QuarticForm>> {
    let BuildContext { scene, mesh, space, .. } = *ground;
    let (true, Form::Modal { modes, .. }) = (scene.stretches(), &system.mass) else { return Ok(None) };
    phase("stretching");
    let spaces = membrane_forces::spaces(scene, mesh)?;
    let mut membrane = Membrane::new(mesh, &spaces, &PlateAssembly::new(scene, mesh, ground.comm())?)?;
    let shape = |k: usize| space.shape(modes.shapes.col_as_slice(k));
    let shapes: Vec<Vec<f64>> = (0..modes.count()).map(shape).collect();
    QuarticForm::new(&mut membrane, &shapes, &modes.squares).map(Some)
}

/// Moves the equilibrium of a plate that only bends, in m, to the one of the plate that stretches:
/// the modes follow
///
/// ```math
/// \Omega^2 q + \nabla V(q) = \Omega^2 q_0
/// ```
///
/// from the modal coordinates q_0 of the former, and the rest stays.
///
/// # Errors
/// Returns [`Error::Scene`] where the former touches an obstacle, [`Error::Unfinished`] where
/// Newton's method ends elsewhere, and the errors of the engine.
pub(super) fn settle<E: OfCells>(key: &str, system: &System<E>, displacement: &mut [f64]) -> Result<()> {
    let (Some(form), Form::Modal { modes, .. }) = (&system.drive.stretching, &system.mass) else {
        return Ok(());
    };
    let bounds = &system.bounds;
    let limits = bounds.dofs.iter().zip(bounds.lower.iter().zip(&bounds.upper));
    if limits.into_iter().any(|(&dof, (lower, upper))| !(*lower..*upper).contains(&displacement[dof])) {
        return Err(Error::Scene(format!(
            "{key}: the plate that only bends touches an obstacle at rest, from which in_plane.stretching finds no \
             equilibrium; expected a start without contact"
        )));
    }
    let mut start = vec![0.0; modes.count()];
    system.engine.project(&system.mass, displacement, &mut start)?;
    let q = equilibrium(form, modes, &start)?;
    let change: Vec<f64> = q.iter().zip(&start).map(|(q, start)| q - start).collect();
    modes.add_shapes(&change, displacement);
    Ok(())
}

/// Returns the modal coordinates of the equilibrium, given those without stretching.
fn equilibrium(form: &QuarticForm, modes: &MassModes, start: &[f64]) -> Result<Vec<f64>> {
    let squares = &modes.squares;
    let load: Vec<f64> = start.iter().zip(squares).map(|(q, square)| square * q).collect();
    let mut stretch = Stretch::default();
    let energy = |q: &[f64], stretch: &mut Stretch| {
        form.evaluate(q, stretch);
        let bending: f64 = q.iter().zip(squares).map(|(q, square)| 0.5 * square * q * q).sum();
        bending + stretch.energy() - dot(&load, q)
    };
    let size = dot(&load, &load).sqrt();
    let (mut q, mut residual) = (vec![0.0; start.len()], size);
    for _ in 0..ITERATIONS {
        let least = energy(&q, &mut stretch);
        let mut pull = load.clone();
        pull.iter_mut().zip(q.iter().zip(squares)).for_each(|(pull, (q, square))| *pull -= square * q);
        stretch.add_gradient(-1.0, &mut pull);
        residual = dot(&pull, &pull).sqrt();
        if residual <= SETTLED * size {
            break;
        }
        let mut tangent = form.hessian(&stretch);
        squares.iter().enumerate().for_each(|(k, square)| tangent[(k, k)] += square);
        let right = Mat::from_fn(pull.len(), 1, |k, _| pull[k]);
        let step = tangent.partial_piv_lu().solve(&right);
        let shorter = (0..HALVINGS).map(|halving| {
            let mut next = q.clone();
            axpy(0.5_f64.powi(halving), step.col_as_slice(0), &mut next);
            next
        });
        // At the end rounding hides the descent.
        let most = least + f64::EPSILON * least.abs();
        let Some(next) = shorter.into_iter().find(|next| energy(next, &mut stretch) <= most) else { break };
        q = next;
    }
    if residual <= ROUNDING * size {
        return Ok(q);
    }
    Err(Error::Unfinished("initial: no equilibrium of the plate that stretches was reached".into()))
}
