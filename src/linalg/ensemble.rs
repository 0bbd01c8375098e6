//! Engine of several equal systems side by side, whose runs go in lock step.
//!
//! Systems with the same matrices differ in loads, obstacles and initial conditions only. Their
//! vectors are interleaved: entry 8 i + k belongs to dof i of system k. Every scheme takes such a
//! vector for that of one system with eight times the dofs, whose matrix consists of equal blocks,
//! and needs no code of its own for many runs. The engine knows better: each lane of the
//! processor's registers computes for one system, and a single factor, read from memory once per
//! solve, serves all.
//!
//! No lane depends on the others, so that the motion of a system is the same, to the bit, in
//! whatever company it is computed.

use super::lane_values::LANES;
use super::native::{in_double_doubles, in_doubles};
use super::{Cholesky, Engine, Factor, Form, LinearCombination, MOST_SPOILT, Native, RowCoupling};
use crate::communicator::SelfComm;
use crate::error::{Error, Result};
use faer::Mat;

/// Engine of eight equal systems side by side, one in each lane of the vectors: entry 8 i + k of a
/// vector belongs to dof i of system k. All have one factor.
#[derive(Debug)]
pub struct Ensemble {
    /// Engine of all dofs, whose forms have one system per lane.
    all: Native,
}

impl Ensemble {
    /// Number of systems side by side.
    pub const SYSTEMS: usize = LANES;

    /// Creates an engine for systems of `dofs` free dofs each.
    pub fn new(dofs: usize) -> Ensemble {
        Ensemble { all: Native::new(LANES * dofs) }
    }

    /// Creates a form of all systems from that of one; `None` for a modal mass.
    pub fn form(&self, of_one: &Form) -> Option<Form> {
        self.all.side_by_side(of_one)
    }

    /// Copies a vector of one system into its lane of a vector of all.
    pub fn put(system: usize, of_one: &[f64], all: &mut [f64]) {
        for (group, value) in all.chunks_exact_mut(LANES).zip(of_one) {
            group[system] = *value;
        }
    }

    /// Returns the vector of one system among those of all.
    pub fn take(system: usize, all: &[f64]) -> Vec<f64> {
        all.chunks_exact(LANES).map(|group| group[system]).collect()
    }

    /// Returns the contact dofs of one system, given those of all.
    fn contact_dofs(&self, of_all: &[usize]) -> Result<Vec<usize>> {
        let is_same = |group: &[usize]| (0..).zip(group).all(|(system, &dof)| dof == group[0] + system);
        match of_all.chunks(LANES).all(|group| group.len() == LANES && is_same(group)) {
            true => Ok(of_all.iter().step_by(LANES).map(|dof| dof / LANES).collect()),
            false => Err(alone("its own contact dofs")),
        }
    }
}

/// Returns the error for what systems side by side do not take.
fn alone(what: &str) -> Error {
    Error::Usage(format!("a system in lock step with others cannot have {what}"))
}

impl Engine for Ensemble {
    type Factor = SharedFactor;
    type Comm = SelfComm;
    const REPEATS: bool = true;

    fn comm(&self) -> &SelfComm {
        &SelfComm
    }

    fn dofs(&self) -> usize {
        self.all.dofs()
    }

    fn systems(&self) -> usize {
        LANES
    }

    fn dot(&self, x: &[f64], y: &[f64]) -> Result<f64> {
        self.all.dot(x, y)
    }

    fn multiply(&self, form: &Form, x: &[f64], y: &mut [f64]) -> Result<f64> {
        self.all.multiply(form, x, y)
    }

    fn multiply_with_magnitude(
        &self,
        sum: &LinearCombination,
        x: &[f64],
        y: &mut [f64],
        m: &mut [f64],
    ) -> Result<()> {
        self.all.multiply_with_magnitude(sum, x, y, m)
    }

    fn multiply_with_part(
        &self,
        sum: &LinearCombination,
        part: &Form,
        x: &[f64],
        products: (&mut [f64], &mut [f64]),
    ) -> Result<bool> {
        self.all.multiply_with_part(sum, part, x, products)
    }

    fn couplings(&self, sum: &LinearCombination) -> Result<Vec<RowCoupling>> {
        let of_one = Native::new(self.dofs() / LANES).couplings(sum)?;
        let of_all = |coupling: RowCoupling| {
            (0..LANES as u32)
                .map(move |lane| RowCoupling { to: LANES as u32 * coupling.to + lane, ..coupling })
        };
        Ok(of_one.into_iter().flat_map(of_all).collect())
    }

    fn velocities(&self, mass: &Form) -> usize {
        match mass {
            Form::SingularMassCells(averages) => LANES * averages.cells(),
            _ => self.dofs(),
        }
    }

    fn project(&self, mass: &Form, x: &[f64], v: &mut [f64]) -> Result<()> {
        self.all.project(mass, x, v)
    }

    fn project_transpose(&self, mass: &Form, v: &[f64], y: &mut [f64]) -> Result<()> {
        self.all.project_transpose(mass, v, y)
    }

    fn mass_norm_squared(&self, mass: &Form, v: &[f64]) -> Result<f64> {
        match mass {
            Form::SingularMassCells(averages) => {
                let squares = v.chunks_exact(LANES).map(|group| group.iter().map(|v| v * v).sum::<f64>());
                Ok(averages.masses().iter().zip(squares).map(|(mass, square)| mass * square).sum())
            }
            _ => self.all.mass_norm_squared(mass, v),
        }
    }

    fn diagonal(&self, sum: &LinearCombination) -> Result<Vec<f64>> {
        let of_one = Native::new(self.dofs() / LANES).diagonal(sum)?;
        Ok(of_one.into_iter().flat_map(|entry| [entry; LANES]).collect())
    }

    /// Factors the sum of one system, which is the same for all.
    fn factor(&self, sum: &LinearCombination, contact_dofs: &[usize]) -> Result<SharedFactor> {
        let dofs = self.dofs() / LANES;
        let contact_dofs = self.contact_dofs(contact_dofs)?;
        if let Some(factor) = in_doubles(dofs, sum, &contact_dofs)? {
            let mut factor = SharedFactor(factor);
            if self.estimate_factor_error(sum, &mut factor)? <= MOST_SPOILT {
                return Ok(factor);
            }
        }
        Ok(SharedFactor(in_double_doubles(dofs, sum, &contact_dofs)?))
    }
}

/// Factor of the matrix of one system, which solves for all at once.
#[derive(Debug)]
pub struct SharedFactor(Cholesky);

impl Factor for SharedFactor {
    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        self.0.solve_lanes(x);
        Ok(())
    }

    fn schur(&self) -> &Mat<f64> {
        self.0.schur()
    }

    fn systems(&self) -> usize {
        LANES
    }

    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64]) -> Result<()> {
        self.0.forward_lanes(b, h);
        Ok(())
    }

    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()> {
        self.0.backward_lanes(values, x);
        Ok(())
    }

    fn solve_schur(&self, h: &mut [f64]) {
        self.0.solve_schur_lanes(h);
    }

    fn pin(&mut self, _: &[usize]) -> Result<()> {
        Err(alone("pinned dofs"))
    }
}
