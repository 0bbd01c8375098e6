//! Stretching: the energy of the mid-plane, in the modes that carry the inertia.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, PER_NODE};
use crate::error::{Error, Result};
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Form, MassModes};
use crate::membrane::{Membrane, QuarticForm, Stretch};
use crate::partition::Partition;
use crate::scheme::System;
use crate::simulation::plate_assembly::PlateAssembly;
use crate::simulation::{membrane_forces, phase};
use faer::Mat;

/// Largest number of Newton's iterations, and of halvings of one.
const ITERATIONS: usize = 100;
const HALVINGS: i32 = 40;

/// Stiffness relative to the largest one, below which a direction counts as without stiffness.
const FLAT: f64 = 1e-12;

/// Residuals of an equilibrium, relative to the load: the one at which the iteration ends, and the
/// largest where rounding ends it.
const SETTLED: f64 = 1e-13;
const ROUNDING: f64 = 1e-10;

/// Returns the energy of stretching in the modes of the mass, with the geometric stiffness of
/// forces that buckle the plate; `None` where the scene has none.
///
/// # Errors
/// Returns the errors of the supports and of the membrane.
pub(super) fn form<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    system: &System<E>,
    geometric: Option<&Form>,
) -> Result<Option<QuarticForm>> {
    let BuildContext { scene, mesh, space, .. } = *ground;
    let (true, Form::Modal { modes, .. }) = (scene.stretches(), &system.mass) else { return Ok(None) };
    phase("stretching");
    let spaces = membrane_forces::spaces(scene, mesh)?;
    let mut membrane = Membrane::new(mesh, &spaces, &PlateAssembly::new(scene, mesh, ground.comm())?)?;
    let shape = |k: usize| space.shape(modes.shapes.col_as_slice(k));
    let shapes: Vec<Vec<f64>> = (0..modes.count()).map(shape).collect();
    let mut form = QuarticForm::new(&mut membrane, &shapes, &modes.squares)?;
    if let Some(geometric) = geometric {
        let mut products = Mat::zeros(modes.shapes.nrows(), modes.count());
        for k in 0..modes.count() {
            let (shape, product) = (modes.shapes.col_as_slice(k), products.col_as_slice_mut(k));
            system.engine.multiply(geometric, shape, product)?;
        }
        form.add_geometric(&(modes.shapes.transpose() * products));
        let flat = vec![0.0; modes.count()];
        let (_, least) = equilibrium(&form, modes, [&flat, &flat], space)?;
        form.count_from(least);
    }
    Ok(Some(form))
}

/// Moves the equilibrium of a plate that only bends, in m, to the one of the plate that stretches:
/// the modes follow
///
/// ```math
/// \Omega^2 q + \nabla V(q) = \Omega^2 q_0
/// ```
///
/// from the modal coordinates q_0 of the former, and the rest stays. The equilibrium is a minimum
/// of the energy, sought from `initial.deflection` on. Without it a plate that buckles without a
/// load takes the side on which its largest deflection points upwards.
///
/// # Errors
/// Returns [`Error::Scene`] where the former touches an obstacle, [`Error::Unfinished`] where
/// Newton's method ends elsewhere, and the errors of the engine.
pub(super) fn settle<E: OfCells, P: Partition>(
    key: &str,
    ground: &BuildContext<P>,
    system: &System<E>,
    displacement: &mut [f64],
) -> Result<()> {
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
    let shape = ground.comm().all_ok(ground.shape_of(&ground.scene.initial.deflection))?;
    let mut first = vec![0.0; modes.count()];
    let guess = ground.owned(&ground.space.interpolate(&shape), system.engine.dofs());
    system.engine.project(&system.mass, &guess, &mut first)?;
    let (q, _) = equilibrium(form, modes, [&start, &first], ground.space)?;
    let change: Vec<f64> = q.iter().zip(&start).map(|(q, start)| q - start).collect();
    modes.add_shapes(&change, displacement);
    Ok(())
}

/// Returns the modal coordinates of the equilibrium and its energy in J, given the coordinates
/// without stretching and those where the search begins.
fn equilibrium(
    form: &QuarticForm,
    modes: &MassModes,
    [bent, first]: [&[f64]; 2],
    space: &DofMap,
) -> Result<(Vec<f64>, f64)> {
    let squares = &modes.squares;
    let load: Vec<f64> = bent.iter().zip(squares).map(|(q, square)| square * q).collect();
    let mut stretch = Stretch::default();
    let energy = |q: &[f64], stretch: &mut Stretch| {
        form.evaluate(q, stretch);
        let bending: f64 = q.iter().zip(squares).map(|(q, square)| 0.5 * square * q * q).sum();
        bending + stretch.energy() - dot(&load, q)
    };
    let lowest = squares.iter().copied().find(|square| *square > 0.0).unwrap_or(1.0);
    let scales: Vec<f64> = squares.iter().map(|square| square.max(lowest).sqrt().recip()).collect();
    let mut q = first.to_vec();
    for _ in 0..ITERATIONS {
        let least = energy(&q, &mut stretch);
        let mut pull = load.clone();
        pull.iter_mut().zip(q.iter().zip(squares)).for_each(|(pull, (q, square))| *pull -= square * q);
        // The forces of bending and the load, against which the sum is rounding.
        let size = dot(&pull, &pull).sqrt().max(dot(&load, &load).sqrt());
        stretch.add_gradient(-1.0, &mut pull);
        let residual = dot(&pull, &pull).sqrt();
        // In coordinates of equal bending energy the lowest eigenvector of a flat plate is the
        // lowest buckling mode.
        let mut tangent = form.hessian(&stretch);
        squares.iter().enumerate().for_each(|(k, square)| tangent[(k, k)] += square);
        let scaled = Mat::from_fn(q.len(), q.len(), |i, j| scales[i] * scales[j] * tangent[(i, j)]);
        let (values, vectors) = symmetric_eigen(scaled.as_ref())?;
        let direction = |k: usize| -> Vec<f64> {
            vectors.col_as_slice(k).iter().zip(&scales).map(|(part, scale)| part * scale).collect()
        };
        let stiffest = values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let descending = values.iter().position(|value| *value < -FLAT * stiffest);
        // Newton's step, downhill along directions in which the energy is not convex.
        let mut step = vec![0.0; q.len()];
        for (k, value) in values.iter().enumerate() {
            let direction = direction(k);
            axpy(dot(&direction, &pull) / value.abs().max(FLAT * stiffest), &direction, &mut step);
        }
        let shorter = (0..HALVINGS).map(|halving| {
            let mut next = q.clone();
            axpy(0.5_f64.powi(halving), &step, &mut next);
            next
        });
        // At the end rounding hides the descent.
        let most = least + f64::EPSILON * least.abs();
        let is_settled = residual <= SETTLED * size;
        let next = shorter.into_iter().find(|next| !is_settled && energy(next, &mut stretch) <= most);
        q = match (next, descending) {
            (Some(next), _) => next,
            (None, _) if residual > ROUNDING * size => break,
            (None, Some(k)) => departure(form, &q, (values[k], &direction(k)), (modes, space)),
            (None, None) => return Ok((q, least)),
        };
    }
    Err(Error::Unfinished("initial: no equilibrium of the plate that stretches was reached".into()))
}

/// Returns a place of less energy beside an equilibrium that is no minimum, along a direction with
/// its negative stiffness; its largest deflection points upwards.
fn departure(
    form: &QuarticForm,
    q: &[f64],
    (stiffness, direction): (f64, &[f64]),
    (modes, space): (&MassModes, &DofMap),
) -> Vec<f64> {
    let mut shape = vec![0.0; modes.shapes.nrows()];
    modes.add_shapes(direction, &mut shape);
    let deflections = space.shape(&shape).into_iter().step_by(PER_NODE);
    let largest = deflections.fold(0.0_f64, |most, w| if w.abs() > most.abs() { w } else { most });
    let mut stretch = Stretch::default();
    form.evaluate(direction, &mut stretch);
    // Along the direction the energy is -|k| a^2/2 + s a^4/2, with the least value at this a.
    let size = (-stiffness / (2.0 * stretch.strain_square())).sqrt();
    let mut next = q.to_vec();
    axpy(size.copysign(largest), direction, &mut next);
    next
}
