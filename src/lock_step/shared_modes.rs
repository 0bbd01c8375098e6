//! Modes and compliance that equal systems in lock step share.

use super::lane_coordinates::Coordinate;
use super::lane_levels::{Equations, MasslessPart};
use super::load_laws::KnownFactors;
use crate::error::Result;
use crate::linalg::{Engine, Form, MassModes, Native};
use crate::modes::modes_with_mass;
use crate::scheme::massless::modal_saddle_point::ModalSaddlePoint;
use crate::scheme::modal::all_bounds::AllBounds;
use crate::scheme::modal::contact_model::{BoundRows, ContactModel};
use crate::scheme::{NewmarkParameters, System};
use faer::Mat;
use std::rc::Rc;

/// Largest numbers of dofs and of bounds for which all modes with inertia pay.
const MOST_DOFS: usize = 600;
const MOST_BOUNDS: usize = 24;
/// Largest number of mode shapes at bounds for which steps in lock step, which evaluate all of
/// them, cost less than those of [`ModalScheme`](crate::scheme::ModalScheme), which seldom do.
const MOST_SHAPES: usize = 2000;

/// Modes and compliance of equal systems whose runs go in lock step.
pub struct SharedModes<'s> {
    pub(super) system: &'s System<Native>,
    pub(super) modes: Rc<MassModes>,
    pub(super) massless: MasslessPart,
    pub(super) saddle: ModalSaddlePoint<'s, Native>,
    pub(super) global: Rc<AllBounds>,
    /// Massless responses at all bounds; without candidates where there are none.
    pub(super) model: ContactModel,
    /// Mode shapes at the bounds, one column each.
    pub(super) rows: Mat<f64>,
    pub(super) factors: KnownFactors,
}

/// Returns whether the plate only bends, nothing but loads of given shape depends on time, no bound
/// has a law of its own or friction, and without a modal mass no damping acts on single modes.
fn is_plain(System { bounds, drive, mass, .. }: &System<Native>) -> bool {
    drive.stretching.is_none()
        && drive.supports.is_empty()
        && drive.bounds.is_none()
        && drive.load.is_none()
        && drive.dashpots.is_none()
        && drive.friction.is_none()
        && (drive.modal.is_none() || matches!(mass, Form::Modal { .. }))
        && bounds.laws.are_rigid()
}

impl<'s> SharedModes<'s> {
    /// Returns whether another system can go in lock step: it has the same matrices and bounded
    /// dofs.
    pub fn fit(&self, other: &System<Native>) -> bool {
        let System { stiffness, mass, damping, bounds, .. } = self.system;
        let rates = |system: &System<Native>| system.drive.modal.as_ref().map(|modal| modal.rates.clone());
        let are_same = *damping == other.damping && bounds.dofs == other.bounds.dofs;
        is_plain(other)
            && are_same
            && rates(self.system) == rates(other)
            && stiffness.equals(&other.stiffness)
            && mass.equals(&other.mass)
    }

    /// Returns the modes in which a system goes in lock step with others; `None` where it does not:
    /// something other than loads of given shape moves, damping acts on single modes of a mass of
    /// cells, there are too many modes, or rounding spoils them.
    ///
    /// # Errors
    /// Returns the errors of the dense eigenvalues.
    pub fn modes(system: &System<Native>) -> Result<Option<Rc<MassModes>>> {
        let System { engine, stiffness, mass, bounds, .. } = system;
        if !is_plain(system) {
            return Ok(None);
        }
        if let Form::Modal { modes, .. } = mass {
            return Ok((modes.count() * bounds.len() <= MOST_SHAPES).then(|| modes.clone()));
        }
        if engine.dofs() > MOST_DOFS || bounds.len() > MOST_BOUNDS {
            return Ok(None);
        }
        Ok(modes_with_mass(engine, stiffness, mass)?.map(Rc::new))
    }

    /// Computes the massless responses of a system with given modes, at all bounds.
    ///
    /// # Errors
    /// Returns [`crate::error::Error::Usage`] where the modes leave the bounded dofs no compliance
    /// of their own, and the errors of the engine.
    pub fn new(system: &'s System<Native>, modes: &Rc<MassModes>) -> Result<SharedModes<'s>> {
        let System { engine, mass, bounds, .. } = system;
        let (massless, inertia) = match mass {
            Form::Modal { consistent, .. } => (MasslessPart::Follows, Form::Cells(consistent.clone())),
            _ if modes.count() == engine.dofs() => (MasslessPart::None, mass.clone()),
            _ => (MasslessPart::Swings, mass.clone()),
        };
        let saddle = ModalSaddlePoint::new(system, &inertia, modes)?;
        let global = Rc::new(AllBounds::new(system));
        let comm = engine.comm();
        let rows = global.shapes(comm, modes)?;
        let mut model = ContactModel::new(bounds.size);
        let numbers: Vec<usize> = (0..bounds.len()).collect();
        if massless != MasslessPart::None && !numbers.is_empty() {
            let rows_at = BoundRows { shapes: &rows, places: &numbers, lanes: numbers.len() };
            model.extend(&saddle, &global, &global.limits(comm, bounds), rows_at, &numbers)?;
        }
        Ok(SharedModes {
            system,
            modes: modes.clone(),
            massless,
            saddle,
            global,
            model,
            rows,
            factors: KnownFactors::default(),
        })
    }

    /// Returns the equations of a number of coordinates.
    pub(super) fn equations(&self, parameters: NewmarkParameters, size: usize) -> Equations {
        let [of_mass, of_stiffness, of_rate] = parameters.matrix_weights();
        let (modes, squares) = (self.modes.count(), &self.modes.squares);
        let massless = size - modes;
        let slow = if self.massless == MasslessPart::Swings { self.system.damping.stiffness } else { 0.0 };
        let mut decay = self.system.decay_rates(&self.modes);
        decay.extend(vec![slow; massless]);
        let mut stiffness = squares.clone();
        stiffness.extend(vec![1.0; massless]);
        let inverse = |j: usize| {
            let inertia = if j < modes { of_mass } else { 0.0 };
            1.0 / (inertia + of_stiffness * stiffness[j] + of_rate * decay[j])
        };
        let coordinate = |j: usize| Coordinate {
            stiffness: stiffness[j],
            decay: decay[j] / parameters.step,
            inverse: inverse(j),
        };
        let coordinates: Vec<Coordinate> = (0..size).map(coordinate).collect();
        let compliance = &self.model.compliance;
        let row = |i: usize| {
            let mut row = self.rows.col_as_slice(i).to_vec();
            row.extend((0..compliance.ncols()).map(|j| compliance[(i, j)]));
            row
        };
        let rows: Vec<Vec<f64>> = (0..self.rows.ncols()).map(row).collect();
        let entry = |i: usize, j: usize| {
            let inertial: f64 = (0..modes).map(|k| coordinates[k].inverse * rows[i][k] * rows[j][k]).sum();
            inertial
                + rows[i].get(modes + j).map_or(0.0, |deflection| deflection * coordinates[modes + j].inverse)
        };
        Equations {
            compliance: Mat::from_fn(rows.len(), rows.len(), |i, j| 0.5 * (entry(i, j) + entry(j, i))),
            parameters,
            massless: self.massless,
            modes,
            coordinates,
            rows,
        }
    }
}
