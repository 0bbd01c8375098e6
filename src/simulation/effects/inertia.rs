//! Mass matrix: consistent, singular, or modal.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::{CellForm, Engine, Form};
use crate::modes::{self, ModeRange};
use crate::partition::Partition;
use crate::scene::Mass;
use crate::simulation::phase;

/// Default number of modes that carry the inertia. On the paper's plate they reach 12 kHz; more
/// modes change the motion by less than other methods differ from each other.
const MODES: usize = 200;

/// Default number of modes of a plate that stretches, and the largest: the strains of all pairs are
/// kept, and a step takes the time of their products.
const STRETCHING_MODES: usize = 20;
const MOST_STRETCHING_MODES: usize = 60;

/// Largest number of modes, as a fraction of the dofs: up to a third the compliance of the rest is
/// well conditioned; from about two thirds on it is singular, and modes above half belong to the
/// mesh rather than to the plate.
const ADVISED: usize = 3;
const REFUSED: usize = 2;

/// Relative difference of squared frequencies below which rounding mixes their modes.
const EQUAL: f64 = 1e-7;

/// Usual and largest number of modes.
struct ModeCount {
    usual: usize,
    most: usize,
}

/// Returns the mass matrix of a scene, and a warning where it is not unique; `mechanism` tells
/// whether the plate can move rigidly. Collective.
///
/// # Errors
/// Returns the errors of [`modal_mass`], and [`Error::Singular`] for a rigid motion without
/// inertia.
pub(super) fn mass<E: OfCells, P: Partition>(
    engine: &E,
    ground: &BuildContext<P>,
    stiffness: &Form,
    mechanism: bool,
) -> Result<(Form, Option<String>)> {
    let time = &ground.scene.time;
    let mass = match time.mass {
        Mass::Singular => {
            if mechanism {
                ground.refuse_weightless()?;
            }
            engine.native().averages(ground.singular_mass())
        }
        Mass::Consistent | Mass::Modal => engine.native().form(ground.consistent_mass()),
    };
    engine.require_memory(&(stiffness + &mass), time.factors())?;
    match mass {
        Form::Cells(consistent) if time.mass == Mass::Modal => {
            phase("modes");
            // Bodies are loose too: their rigid motions are modes as well.
            let count = match ground.scene.stretches() {
                true => ModeCount { usual: STRETCHING_MODES, most: MOST_STRETCHING_MODES },
                false => ModeCount { usual: MODES, most: usize::MAX },
            };
            let mechanism = mechanism || ground.bodies() > 0;
            modal_mass(engine, stiffness, consistent, (time.modes, count), mechanism)
        }
        mass => Ok((mass, None)),
    }
}

/// Returns the singular mass of the lowest modes of a consistent mass, and a warning where it is
/// not unique. Collective.
///
/// # Errors
/// Returns [`Error::Scene`] for more modes than half the dofs, or too few for any vibration, and
/// the errors of [`modes::lowest_basis`].
fn modal_mass<E: Engine>(
    engine: &E,
    stiffness: &Form,
    consistent: CellForm,
    (range, number): (Option<ModeRange>, ModeCount),
    mechanism: bool,
) -> Result<(Form, Option<String>)> {
    let mass = Form::Cells(consistent.clone());
    // The tips of compliant stops are dofs without mass, which give the plate no further modes.
    let masses = engine.diagonal(&(&mass).into())?;
    let dofs = engine.comm().all_reduce_sum(masses.iter().filter(|mass| **mass > 0.0).count());
    let default = ModeRange::Count(number.usual.min(dofs / ADVISED).max(1));
    let too_many = |key: &str, count: usize| {
        let most = dofs / ADVISED;
        Err(Error::Scene(format!(
            "time.{key}: {count} modes of {dofs} dofs leave the rest of the plate too stiff for contact; expected at most \
             {most} modes"
        )))
    };
    if let Some(ModeRange::Count(count)) = range
        && count > dofs / REFUSED
    {
        return too_many("modes", count);
    }
    let range = range.unwrap_or(default);
    let (modes, next) =
        modes::kept_basis(modes::current_store(), engine, [stiffness, &mass], range, mechanism)?;
    let squares = &modes.squares;
    if squares.len() > number.most {
        return Err(Error::Scene(format!(
            "time.modes: {} modes have too many pairs for in_plane.stretching; expected at most {}",
            squares.len(),
            number.most
        )));
    }
    if matches!(range, ModeRange::UpTo(_)) && squares.len() > dofs / REFUSED {
        return too_many("up_to", squares.len());
    }
    if squares.last().is_none_or(|square| *square == 0.0) {
        return Err(Error::Scene(format!(
            "time.{}: {} modes contain no vibration; expected more",
            if matches!(range, ModeRange::UpTo(_)) { "up_to" } else { "modes" },
            squares.len()
        )));
    }
    let doubt = divided_group(squares, next);
    Ok((Form::Modal { consistent, modes: modes.into() }, doubt))
}

/// Returns a warning where the next mode has the frequency of the last ones.
fn divided_group(squares: &[f64], next: f64) -> Option<String> {
    let below = squares.partition_point(|square| *square < (1.0 - EQUAL) * next);
    (below < squares.len()).then(|| {
        format!(
            "time.modes = {}: the next mode has the frequency of the last, and rounding decides which of their \
             combinations carry inertia; take {below} modes, or more",
            squares.len()
        )
    })
}
