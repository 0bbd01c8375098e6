//! Many lowest natural modes, with none missed.
//!
//! [Block Lanczos](super::krylov) on a factored K finds the modes, Rayleigh-Ritz with the
//! cell-by-cell K gives them their last digits, and the inertia of `$K - \sigma M$` counts them.
//! Rounding the entries of the assembled K perturbs the low modes as h^-4, but hardly the span of
//! all modes up to one, which is all that the factor is used for.

use super::blocks::{columns_of, eigen, multiply, product, random_block, scalar_products};
use super::inverse::ShiftedInverse;
use super::krylov::{BLOCK, Krylov};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Engine, Form};
use faer::{Mat, Side};
use std::f64::consts::TAU;

/// Number of modes computed beyond the wanted ones. The count takes place in the widest gap between
/// them, so that multiple eigenvalues stay together.
const GUARDS: usize = 8;

/// Growth of the Krylov space between two looks at its Ritz pairs.
const GROWTH: f64 = 1.1;

/// Share of the largest eigenvalue below which an eigenvalue of a mechanism is rounding and belongs
/// to a rigid motion.
const RIGID: f64 = 1e-11;

/// Residual at which refinement ends, number of refinements, and largest residual of a mode that is
/// accepted; see [`ModalBasis::residuals`].
const REFINED: f64 = 1e-9;
const MAX_REFINEMENTS: usize = 4;
const ACCEPTED: f64 = 1e-5;

/// Relative distance of squared frequencies above which a count tells them apart.
const APART: f64 = 1e-9;

/// Number of searches for modes that the count has found missing.
const MAX_SEARCHES: usize = 5;

/// Number of wanted modes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ModeRange {
    /// Given number of lowest modes.
    Count(usize),
    /// All modes up to a frequency, in Hz.
    UpTo(f64),
}

/// Lowest natural modes, `$K x = \omega^2 M x$`, with their multiplicity.
#[derive(Debug, Clone)]
pub struct ModalBasis {
    /// Squared angular frequencies, ascending, in (rad/s)^2; exactly 0 for rigid motions.
    pub squares: Vec<f64>,
    /// Shapes, M-orthonormal to rounding (modal masses of 1 kg), one column per mode and one row
    /// per dof of this rank.
    pub shapes: Mat<f64>,
    /// Momenta M x of the shapes, one column per mode.
    pub momenta: Mat<f64>,
    /// Residuals `$r = K x - \omega^2 M x$` in the norm of `$S^{-1}$`, where S is the factored
    /// matrix (K, or K + s M for a mechanism or a cluster), relative to the same norm of `$S x$`
    /// or, in a cluster, of `$K x$` times the relative distance of `$\omega^2$` from the shift. The
    /// relative error of a squared frequency is of the order of the squared residual, divided by
    /// the relative distance to the first mode outside the basis or to the shift.
    pub residuals: Vec<f64>,
    /// Squared angular frequency of the next mode, in (rad/s)^2; infinite where none is known.
    pub next: f64,
    /// Number of systems of equations solved.
    pub solves: usize,
    /// Whether the inertia of `$K - \sigma M$` has confirmed that no mode is missing. An engine
    /// that [cannot count](Engine::factor_beyond) leaves this open. Modes of a cluster whose
    /// squared frequencies differ relatively by less than 1e-9 are equal here, right to 1e-8,
    /// and none is missing below the cluster.
    pub is_complete: bool,
}

impl ModalBasis {
    /// Returns the frequencies, in Hz.
    pub fn frequencies(&self) -> Vec<f64> {
        self.squares.iter().map(|square| square.sqrt() / TAU).collect()
    }
}

/// Returns the lowest natural modes. Collective.
///
/// `mechanism` says that K is singular: the rigid motions come first, at exactly 0.
///
/// # Errors
/// Returns [`Error::Singular`] where fewer modes exist than asked for, because the mass has a lower
/// rank, where K is singular without `mechanism`, and where modes stay missing or inaccurate.
/// Returns [`Error::Memory`] where the vectors do not fit, and the errors of the engine.
pub fn lowest_basis<E: Engine>(
    engine: &E,
    forms: [&Form; 2],
    range: ModeRange,
    mechanism: bool,
) -> Result<ModalBasis> {
    refuse_more_than(most_modes(engine, forms[1]), range)?;
    let basis = lowest_existing(engine, forms, range, mechanism)?;
    refuse_more_than(basis.squares.len(), range)?;
    Ok(basis)
}

/// Returns the modes of [`lowest_basis`], or fewer if there are no more.
pub(super) fn lowest_existing<E: Engine>(
    engine: &E,
    forms: [&Form; 2],
    range: ModeRange,
    mechanism: bool,
) -> Result<ModalBasis> {
    let limit = most_modes(engine, forms[1]);
    let range = range.limited_to(limit);
    let estimate = |quotient: f64| range.estimate_largest(quotient, limit);
    let mut inverse = ShiftedInverse::new(engine, forms, mechanism, estimate)?;
    let start = random_block(engine, BLOCK, 0);
    search(&mut inverse, range, start)
}

/// Returns a bound on the number of modes: that of the dofs, or of the velocities of a singular
/// mass.
fn most_modes<E: Engine>(engine: &E, mass: &Form) -> usize {
    let [dofs, velocities] = engine.comm().all_reduce_sum([engine.dofs(), engine.velocities(mass)]);
    dofs.min(velocities)
}

/// Refuses a number of modes above that of the existing ones.
fn refuse_more_than(existing: usize, range: ModeRange) -> Result<()> {
    match range {
        ModeRange::Count(count) if count > existing => Err(Error::Singular(format!(
            "{count} natural modes are asked for, but the mass allows {existing} only"
        ))),
        _ => Ok(()),
    }
}

impl ModeRange {
    /// Returns the range with no more than a number of modes.
    fn limited_to(self, modes: usize) -> ModeRange {
        match self {
            ModeRange::Count(count) => ModeRange::Count(count.min(modes)),
            ModeRange::UpTo(_) => self,
        }
    }

    /// Estimates the largest wanted eigenvalue from the Rayleigh quotient of a random vector, which
    /// is near the largest of all: eigenvalues of plates grow as the squares of their numbers.
    fn estimate_largest(self, quotient: f64, modes: usize) -> f64 {
        match self {
            ModeRange::Count(count) => quotient * ((count + GUARDS) as f64 / modes as f64).powi(2),
            ModeRange::UpTo(frequency) => (TAU * frequency).powi(2).min(quotient),
        }
    }

    /// Returns the number of wanted modes among those with the given eigenvalues, ascending.
    fn wanted(self, squares: &[f64]) -> usize {
        match self {
            ModeRange::Count(count) => count,
            ModeRange::UpTo(frequency) => {
                squares.partition_point(|square| *square <= (TAU * frequency).powi(2))
            }
        }
    }

    /// Returns the size of the Krylov space at the first look at its Ritz pairs.
    fn first_look(self) -> usize {
        match self {
            ModeRange::Count(count) => 2 * (count + GUARDS) + 4 * BLOCK,
            ModeRange::UpTo(_) => 10 * BLOCK,
        }
    }
}

/// Searches for modes until the count confirms that none is missing.
fn search<E: Engine>(
    inverse: &mut ShiftedInverse<E>,
    range: ModeRange,
    mut start: Mat<f64>,
) -> Result<ModalBasis> {
    let mut modes = RitzModes::none(inverse.engine);
    for number in 1..=MAX_SEARCHES {
        let (vectors, is_whole) = ritz_vectors(inverse, &modes, start, range)?;
        modes = refined(inverse, vectors, range)?;
        let count = range.wanted(&modes.squares).min(modes.squares.len());
        match modes.missing(inverse, count, is_whole)? {
            Some(missing) if missing > 0 => start = random_block(inverse.engine, BLOCK, number * BLOCK),
            verdict => return modes.basis(inverse, count, verdict.is_some()),
        }
    }
    let most = most_modes(inverse.engine, inverse.mass);
    Err(Error::Singular(format!(
        "natural modes are still missing after {MAX_SEARCHES} searches; there are at most {most}, expected fewer"
    )))
}

/// Returns converged Ritz vectors of the wanted modes and of the guards, and whether these are all
/// modes.
fn ritz_vectors<E: Engine>(
    inverse: &mut ShiftedInverse<E>,
    modes: &RitzModes,
    start: Mat<f64>,
    range: ModeRange,
) -> Result<(Mat<f64>, bool)> {
    let mut look = modes.squares.len() + range.first_look();
    let expected = look + look / 4;
    let mut locked = (modes.shapes.clone(), modes.squares.clone());
    let begin = |inverse: &mut ShiftedInverse<E>, (shapes, squares): &(Mat<f64>, Vec<f64>)| {
        Krylov::new(inverse, shapes, squares, start.clone(), expected)
    };
    let mut space = begin(inverse, &locked)?;
    loop {
        while space.size() < look && !space.is_exhausted() {
            space.expand(inverse)?;
        }
        let pairs = space.ritz_pairs(inverse)?;
        let wanted = (range.wanted(&pairs.squares) + GUARDS).min(pairs.squares.len());
        if inverse.adapt(wanted.checked_sub(1).map_or(0.0, |last| pairs.squares[last]))? {
            space = begin(inverse, &locked)?;
            continue;
        }
        if space.is_exhausted() || pairs.converged >= range.wanted(&pairs.squares) + GUARDS {
            let is_whole = space.is_exhausted() && wanted == pairs.squares.len();
            return Ok((space.vectors(&pairs, wanted), is_whole));
        }
        if let Some(below) = inverse.approach(&pairs.squares[..wanted], pairs.converged)? {
            if below > 0 {
                locked = (space.vectors(&pairs, below), pairs.squares[..below].to_vec());
            }
            space = begin(inverse, &locked)?;
            continue;
        }
        look = (space.size() as f64 * GROWTH) as usize + BLOCK;
    }
}

/// Modes under refinement, with their products.
struct RitzModes {
    squares: Vec<f64>,
    shapes: Mat<f64>,
    momenta: Mat<f64>,
    /// Forces K x.
    forces: Mat<f64>,
    residuals: Vec<f64>,
}

/// Returns the modes in the span of some vectors, corrected by solves with their residuals until
/// those of the wanted modes are small.
fn refined<E: Engine>(
    inverse: &mut ShiftedInverse<E>,
    mut vectors: Mat<f64>,
    range: ModeRange,
) -> Result<RitzModes> {
    let mut round = 0;
    loop {
        let mut modes = RitzModes::in_span_of(inverse, &vectors)?;
        let corrections = modes.measure_residuals(inverse)?;
        let wanted = modes.residuals.iter().take(range.wanted(&modes.squares));
        let worst = wanted.fold(0.0_f64, |worst, residual| worst.max(*residual));
        if worst <= REFINED {
            return Ok(modes);
        }
        if round == MAX_REFINEMENTS {
            return if worst <= ACCEPTED { Ok(modes) } else { Err(inaccurate(worst)) };
        }
        vectors = &modes.shapes - corrections;
        round += 1;
    }
}

fn inaccurate(residual: f64) -> Error {
    Error::Singular(format!("the natural modes were found with a relative residual of {residual:.1e} only"))
}

impl RitzModes {
    fn none<E: Engine>(engine: &E) -> RitzModes {
        let none = || Mat::zeros(engine.dofs(), 0);
        RitzModes { squares: vec![], shapes: none(), momenta: none(), forces: none(), residuals: vec![] }
    }

    /// Returns the modes in the span of independent vectors, by the method of Rayleigh and Ritz
    /// with the cell-by-cell matrices.
    fn in_span_of<E: Engine>(inverse: &ShiftedInverse<E>, vectors: &Mat<f64>) -> Result<RitzModes> {
        let ShiftedInverse { engine, stiffness, mass, .. } = *inverse;
        let (momenta, _) = multiply(engine, mass, vectors)?;
        let (forces, energies) = multiply(engine, stiffness, vectors)?;
        let [gram] = scalar_products(engine, [vectors.as_ref()], momenta.as_ref());
        let [mut reduced] = scalar_products(engine, [vectors.as_ref()], forces.as_ref());
        for (i, energy) in energies.iter().enumerate() {
            reduced[(i, i)] = *energy;
        }
        let rotation = generalized_eigenvectors(engine, &reduced, &gram)?;
        let shapes = product(vectors.as_ref(), rotation.as_ref());
        // The eigenvalues of the dense matrix have the rounding of its largest; these quotients
        // have their own.
        let (momenta, masses) = multiply(engine, mass, &shapes)?;
        let (forces, energies) = multiply(engine, stiffness, &shapes)?;
        let quotients = || energies.iter().zip(&masses).map(|(energy, mass)| energy / mass);
        let largest = quotients().fold(0.0, f64::max).max(inverse.shift);
        let rigid = if inverse.mechanism { RIGID * largest } else { 0.0 };
        let squares = quotients().map(|square| if square <= rigid { 0.0 } else { square });
        // Rounding may swap equal eigenvalues.
        let squares = squares.scan(0.0_f64, |most, square| {
            *most = most.max(square);
            Some(*most)
        });
        let squares = squares.collect();
        Ok(RitzModes { squares, shapes, momenta, forces, residuals: vec![] })
    }

    /// Measures the residuals and returns the corrections S^-1 r that would remove them.
    fn measure_residuals<E: Engine>(&mut self, inverse: &mut ShiftedInverse<E>) -> Result<Mat<f64>> {
        let mut residuals = self.forces.clone();
        for (j, square) in self.squares.iter().enumerate() {
            axpy(-square, self.momenta.col_as_slice(j), residuals.col_as_slice_mut(j));
        }
        let mut corrections = residuals.clone();
        inverse.solve(&mut corrections)?;
        let columns = 0..self.squares.len();
        let products: Vec<f64> =
            columns.map(|j| dot(residuals.col_as_slice(j), corrections.col_as_slice(j))).collect();
        let sums = inverse.engine.comm().all_reduce_sum_slice(&products);
        let relative = |(sum, square): (&f64, &f64)| {
            let distance = (square + inverse.shift).abs();
            (sum.abs() * distance).sqrt() / distance.max(*square)
        };
        self.residuals = sums.iter().zip(&self.squares).map(relative).collect();
        Ok(corrections)
    }

    /// Counts the eigenvalues below the [widest gap](RitzModes::widest_gap) and returns how
    /// many of them are missing here; `None` where the engine cannot count. `is_whole`
    /// says that no modes follow.
    fn missing<E: Engine>(
        &self,
        inverse: &ShiftedInverse<E>,
        count: usize,
        is_whole: bool,
    ) -> Result<Option<usize>> {
        let ShiftedInverse { engine, stiffness, mass, .. } = *inverse;
        let Some((below, sigma)) = self.widest_gap(count, is_whole, inverse.shift) else { return Ok(None) };
        let counted = engine.factor_beyond(stiffness, mass, sigma)?.map(|factor| factor.negative);
        // Orthonormal modes with small residuals exist: a lower count is rounding.
        Ok(counted.and_then(|counted| counted.checked_sub(below)))
    }

    /// Returns the widest relative gap after the first `count` modes or, where a cluster reaches
    /// beyond the last mode, the gap below the cluster: the number of modes below it and its
    /// middle.
    fn widest_gap(&self, count: usize, is_whole: bool, least: f64) -> Option<(usize, f64)> {
        let mut squares = self.squares.clone();
        if is_whole {
            // Past the last mode of all, any distance will do.
            squares.push((2.0 * squares.last().copied().unwrap_or(0.0)).max(least));
        }
        let before = |i: usize| i.checked_sub(1).map_or(0.0, |i| squares[i]);
        let width = |i: usize| 1.0 - before(i) / squares[i];
        let is_gap = |i: &usize| squares[*i] > 0.0 && width(*i) > APART;
        let gaps = (count..squares.len()).filter(is_gap);
        let widest = gaps.max_by(|&i, &j| width(i).total_cmp(&width(j)));
        let widest = widest.or_else(|| (0..count.min(squares.len())).rev().find(is_gap))?;
        Some((widest, 0.5 * (before(widest) + squares[widest])))
    }

    /// Returns the first modes, orthonormal to the last digit.
    fn basis<E: Engine>(
        self,
        inverse: &ShiftedInverse<E>,
        count: usize,
        is_complete: bool,
    ) -> Result<ModalBasis> {
        let (shapes, momenta) = (columns_of(&self.shapes, 0..count), columns_of(&self.momenta, 0..count));
        let [gram] = scalar_products(inverse.engine, [shapes.as_ref()], momenta.as_ref());
        // One step of Newton's method for gram^(-1/2).
        let correction = Mat::from_fn(count, count, |i, j| {
            (if i == j { 1.5 } else { 0.0 }) - 0.25 * (gram[(i, j)] + gram[(j, i)])
        });
        Ok(ModalBasis {
            squares: self.squares[..count].to_vec(),
            shapes: product(shapes.as_ref(), correction.as_ref()),
            momenta: product(momenta.as_ref(), correction.as_ref()),
            residuals: self.residuals[..count].to_vec(),
            next: self.squares.get(count).copied().unwrap_or(f64::INFINITY),
            solves: inverse.solves,
            is_complete,
        })
    }
}

/// Returns the eigenvectors Y of A Y = G Y D for symmetric A and a Gram matrix G near the identity,
/// with Y^T G Y = 1 and ascending eigenvalues, the same on every rank. Collective.
fn generalized_eigenvectors<E: Engine>(engine: &E, a: &Mat<f64>, gram: &Mat<f64>) -> Result<Mat<f64>> {
    let dependent = |_| Error::Singular("the natural modes are linearly dependent".into());
    let root = engine.comm().all_ok(gram.llt(Side::Lower).map_err(dependent))?;
    // A becomes L^-1 A L^-T.
    let lower = root.L();
    let mut half = a.clone();
    lower.solve_lower_triangular_in_place(half.as_mut());
    let mut reduced = half.transpose().to_owned();
    lower.solve_lower_triangular_in_place(reduced.as_mut());
    let (_, mut vectors) = eigen(engine, reduced.as_ref())?;
    lower.transpose().solve_upper_triangular_in_place(vectors.as_mut());
    Ok(vectors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::{ElementMatrix, Native};

    const HALF: usize = 200;

    /// Two halves that do not know of each other: `$\omega = 2, 4, 6, ...$` and `$3, 5, 7, ...$`
    fn halves(engine: &Native) -> [Form; 2] {
        let form = |entry: fn(usize) -> f64| {
            let cell = |dof: usize| ElementMatrix {
                dofs: [Some(dof)].into(),
                matrix: [entry(dof)].into(),
                bending: None,
                class: crate::linalg::CellClass::Plate(dof),
            };
            engine.form((0..2 * HALF).map(cell).collect())
        };
        let square = |dof| ((2 * (dof % HALF + 1) + dof / HALF) as f64).powi(2);
        [form(square), form(|_| 1.0)]
    }

    /// Returns a start that does not see the second half.
    fn blind_start(engine: &Native) -> Mat<f64> {
        let mut start = random_block(engine, BLOCK, 0);
        for j in 0..BLOCK {
            start.col_as_slice_mut(j)[HALF..].fill(0.0);
        }
        start
    }

    #[test]
    fn missing_modes_are_counted_and_found() {
        let engine = Native::new(2 * HALF);
        let [stiffness, mass] = &halves(&engine);
        let range = ModeRange::Count(12);
        let mut inverse = ShiftedInverse::new(&engine, [stiffness, mass], false, |_| 0.0).unwrap();

        let none = RitzModes::none(&engine);
        let (vectors, is_whole) = ritz_vectors(&mut inverse, &none, blind_start(&engine), range).unwrap();
        let modes = refined(&mut inverse, vectors, range).unwrap();
        for (i, square) in modes.squares.iter().enumerate() {
            assert!((square.sqrt() - 2.0 * (i + 1) as f64).abs() < 1e-12, "{square}");
        }
        assert!(modes.missing(&inverse, 12, is_whole).unwrap() > Some(10));

        let basis = search(&mut inverse, range, blind_start(&engine)).unwrap();
        assert!(basis.is_complete);
        assert_eq!(basis.squares.len(), 12);
        for (i, square) in basis.squares.iter().enumerate() {
            assert!((square.sqrt() - (i + 2) as f64).abs() < 1e-12, "{square}");
        }
    }
}
