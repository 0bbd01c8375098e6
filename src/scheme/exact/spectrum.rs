//! Eigenvalues and eigenvectors of the stiffness of an active set.
//!
//! While the set A of nodes in contact does not change, their reactions hold them at their bounds
//! g:
//!
//! ```math
//! r = \rho - W z, \qquad W = S_{AA}^{-1} R_A, \quad \rho = S_{AA}^{-1} (g - G_A U_F),
//! ```
//!
//! and the stiffness in z is `$H_A = H + R_A^T W$`.
//!
//! The force `$h = h_F + R_A^T \rho$` at z = 0 holds the structure at its bounds. Where these are
//! far from there, as for a loose plate, the rounding of `$H_A$` times the distance is a force of
//! its own. h is therefore taken from the rigid displacement `$z_r$` that comes nearest to the
//! bounds, where the reactions are small:
//!
//! ```math
//! V^T h = \Lambda V^T z_r + V^T (h_F - H z_r + R_A^T r_r), \qquad r_r = S_{AA}^{-1} (g - G_A U_F - R_A z_r).
//! ```
//!
//! At `$z_r$` only the reactions keep the nodes at their bounds, against cells that stay in place
//! on average: they may be 10^5 times those of the motion, and their rounding errors a force that
//! moves the slow modes. About the equilibrium `$z_e = V \Lambda^{-1} V^T h$` of the modes, with
//! the displacement `$U_e = U_F + R z_e + S_A r_e$` and its reactions `$r_e = \rho - W z_e$`,
//!
//! ```math
//! V^T h = \Lambda V^T z_e + V^T (R - S_A W)^T (F - K U_e) ,
//! ```
//!
//! where K is applied cell by cell. The errors of this formula are the roundings of `$U_e$`, a
//! force `$\lambda\,\varepsilon\,|z_e|$` on a mode of eigenvalue `$\lambda$`; the slow modes take
//! it, and the fast ones the formula before.
//!
//! # Eigenproblem
//!
//! A dense eigenvalue solver has errors as large as the rounding error of the largest eigenvalue,
//! which is 10^6 to 10^12 times the lowest; so have the entries of `$H_A$`. The mode shapes
//! `$X = (R - S_A W) V$` are more accurate: with K applied cell by cell, `$X^T K X = V^T H_A V$`
//! has entries accurate relative to their own size, and is nearly diagonal. A few Jacobi-like
//! sweeps, rotating all pairs of modes by first-order perturbation, complete the diagonalisation. V
//! is kept orthogonal to rounding throughout, because the state passes from one set's modes to the
//! next's as `$V V^T z$`.
//!
//! # Change of one node
//!
//! With velocities of modes H is diagonal, and free of these errors. A node i that touches or
//! leaves, with A the set without it, changes the stiffness by a product of rank one,
//!
//! ```math
//! H_{A \cup i} = H_A + z z^T, \qquad
//! z = \frac{R_i - S_{iA} S_{AA}^{-1} R_A}{(S_{ii} - S_{iA} S_{AA}^{-1} S_{Ai})^{1/2}} ,
//! ```
//!
//! so that the eigenvectors of one set follow from those of the other by a secular equation
//! ([`super::secular`]), at a fraction of the cost of the eigenproblem. Each change adds
//! the rounding of the largest eigenvalue, as the eigenproblem does; after a number of changes in
//! succession an eigenproblem starts anew, and without contact the eigenvectors are unit vectors.

use super::reduction::ReducedModel;
use super::secular::{Change, changed_eigen};
use crate::error::{Error, Result};
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::{Engine, Form};
use crate::scheme::System;
use crate::vi::BoundStatus;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side as Triangle};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Coupling of two modes, relative to their energies, below which they are not rotated; between
/// fast modes it is rounding.
const COUPLING: f64 = 1e-12;
const MAX_TURNS: usize = 4;

/// Largest number of corrections of a rotation towards orthogonality, and the defect (Frobenius
/// norm) whose square is below rounding.
const MAX_CORRECTIONS: usize = 8;
const SETTLED: f64 = 1e-8;

/// Largest rotation angle. Modes that would rotate by more have nearly equal eigenvalues, for which
/// the choice of basis does not matter.
const LARGEST_ANGLE: f64 = 1e-3;

/// Multiple of the rounding error of the largest eigenvalue below which an eigenvalue is that of a
/// rigid motion.
const RIGID: f64 = 4.0;
/// Part of |x|^T |K| |x| that replaces the largest eigenvalue where all motions are rigid and it is
/// rounding itself.
const STIFF: f64 = 1e-4;

/// Singular value, relative to the size of all motions at the nodes, below which a combination of
/// rigid motions moves no node in contact.
const INDEPENDENT: f64 = 1e-6;

/// Elastic force of a mode at its equilibrium, relative to the largest part of the forces at the
/// rigid displacement, below which its force is found from the equilibrium. Products of norms, as
/// the parts are, exceed the terms whose rounding counts by two powers of ten.
const SLOW: f64 = 1e-2;

/// Largest number of changes in succession, each of which adds rounding errors.
const MAX_CHANGES: usize = 16;

/// Largest number of changes at a time. Four cost as much as the eigenproblem.
const MAX_AT_ONCE: usize = 3;

/// Nodes in contact as indices into the bounds of the system, ascending, with their sides.
pub(super) type Contacts = Vec<(usize, BoundStatus)>;

/// Returns the nodes in contact, given the sides of all candidates.
pub(super) fn contacts(reduction: &ReducedModel, sides: &[BoundStatus]) -> Contacts {
    let candidates = reduction.candidates.iter().copied().zip(sides.iter().copied());
    candidates.filter(|(_, side)| *side != BoundStatus::Free).collect()
}

/// Nodes in contact of an active set, and what holds them; see the [module page](self).
pub(super) struct Held {
    /// Contact status of each candidate.
    pub sides: Vec<BoundStatus>,
    /// Candidates in contact, ascending.
    pub active: Vec<usize>,
    /// Displacements R of these per unit z, a x N.
    pub lift: Mat<f64>,
    /// W, then rho and r_r in the last columns, a x (N + 2).
    reactions: Mat<f64>,
    /// Rigid displacement z_r, N entries.
    rigid: Mat<f64>,
}

impl Held {
    /// Solves for the reactions of the nodes in contact.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where their compliance is not positive definite.
    pub fn new(reduction: &ReducedModel, sides: &[BoundStatus]) -> Result<Held> {
        let ReducedModel { stiffness, bounds, rest_at, lift_at, compliance, .. } = reduction;
        let cells = stiffness.nrows();
        let active: Vec<usize> = (0..sides.len()).filter(|&i| sides[i] != BoundStatus::Free).collect();
        let gap = |i: usize| match sides[i] {
            BoundStatus::Lower => bounds.lower[i] - rest_at[(i, 0)],
            _ => bounds.upper[i] - rest_at[(i, 0)],
        };
        let lift = Mat::from_fn(active.len(), cells, |k, j| lift_at[(active[k], j)]);
        let gap = Mat::from_fn(active.len(), 1, |k, _| gap(active[k]));
        let rigid = nearest_rigid(stiffness, &lift, &gap);
        let beyond = &gap - &lift * &rigid;
        // Solve at once for all columns.
        let mut reactions = Mat::from_fn(active.len(), cells + 2, |k, j| match j.checked_sub(cells) {
            None => lift[(k, j)],
            Some(0) => gap[(k, 0)],
            Some(_) => beyond[(k, 0)],
        });
        if !active.is_empty() {
            factored(compliance, &active)?.solve_in_place(&mut reactions);
        }
        Ok(Held { sides: sides.to_vec(), active, lift, reactions, rigid })
    }

    /// Returns the reactions W per unit z, a x N.
    pub fn w(&self) -> faer::MatRef<'_, f64> {
        self.reactions.get(.., ..self.lift.ncols())
    }

    /// Returns the reactions rho at z = 0, a entries.
    pub fn rho(&self) -> faer::MatRef<'_, f64> {
        self.reactions.get(.., self.lift.ncols()..self.lift.ncols() + 1)
    }

    /// Returns the modal forces V^T h, N entries; see the [module page](self).
    ///
    /// # Errors
    /// Returns the errors of the product with the stiffness.
    pub fn modal_force<E: Engine>(
        &self,
        system: &System<E>,
        reduction: &ReducedModel,
        spectrum: &Spectrum,
    ) -> Result<Mat<f64>> {
        let ReducedModel { force, stiffness, .. } = reduction;
        let reactions = self.reactions.get(.., self.lift.ncols() + 1..);
        let Spectrum { values, vectors, .. } = spectrum;
        let mut place = vectors.transpose() * &self.rigid;
        let mut modal =
            vectors.transpose() * (force - stiffness * &self.rigid + self.lift.transpose() * reactions);
        for (k, value) in values.iter().enumerate() {
            modal[(k, 0)] += value * place[(k, 0)];
        }
        if matches!(system.mass, Form::Modal { .. }) {
            return Ok(modal);
        }
        let floor = spectrum.floor();
        for (k, value) in values.iter().enumerate().filter(|(_, value)| **value > floor) {
            place[(k, 0)] = modal[(k, 0)] / value;
        }
        let largest = force.norm_l2() + self.lift.norm_l2() * reactions.norm_l2();
        let slow = SLOW * largest / place.norm_l2();
        let pull = vectors.transpose() * self.pull_at(system, reduction, &(vectors * &place))?;
        for (k, value) in values.iter().enumerate().take_while(|(_, value)| **value < slow) {
            modal[(k, 0)] = value * place[(k, 0)] + pull[(k, 0)];
        }
        Ok(modal)
    }

    /// Returns the force h - H_A z, N entries, of the displacement at a place z.
    fn pull_at<E: Engine>(
        &self,
        system: &System<E>,
        reduction: &ReducedModel,
        place: &Mat<f64>,
    ) -> Result<Mat<f64>> {
        let System { engine, stiffness, load, .. } = system;
        let ReducedModel { rest, lift, flexibility, .. } = reduction;
        let reactions = self.rho() - self.w() * place;
        let mut displacement = rest + lift * place;
        for (k, &i) in self.active.iter().enumerate() {
            displacement += flexibility.get(.., i..i + 1) * faer::Scale(reactions[(k, 0)]);
        }
        let mut forces = Mat::zeros(displacement.nrows(), 1);
        engine.multiply(stiffness, displacement.col_as_slice(0), forces.col_as_slice_mut(0))?;
        for (i, force) in forces.col_as_slice_mut(0).iter_mut().enumerate() {
            *force = load.as_ref().map_or(0.0, |load| load[i]) - *force;
        }
        let at_active = Mat::from_fn(self.active.len(), 1, |k, _| {
            let column = flexibility.col(self.active[k]);
            column.transpose() * forces.col(0)
        });
        Ok(lift.transpose() * forces - self.w().transpose() * at_active)
    }
}

/// Returns the rigid displacement z (N entries) that comes nearest to given deflections (a entries)
/// of the nodes in contact, whose displacements per unit z are R (a x N). It is zero for a plate
/// that cannot move without stiffness.
///
/// The rows are weighted by their norms over all motions, against which what a rigid motion of a
/// ball leaves at the nodes of a plate is rounding, even where no other node is in contact.
fn nearest_rigid(stiffness: &Mat<f64>, lift: &Mat<f64>, gap: &Mat<f64>) -> Mat<f64> {
    let count = (0..stiffness.nrows()).take_while(|&j| stiffness[(j, j)] == 0.0).count();
    let mut z = Mat::zeros(stiffness.nrows(), 1);
    if count > 0 && gap.nrows() > 0 {
        let weight = |size: f64| if size > 0.0 { size.recip() } else { 0.0 };
        let weights: Vec<f64> = (0..gap.nrows()).map(|k| weight(lift.row(k).norm_l2())).collect();
        let of_rigid = DMatrix::from_fn(gap.nrows(), count, |k, j| weights[k] * lift[(k, j)]);
        let gap = DMatrix::from_fn(gap.nrows(), 1, |k, _| weights[k] * gap[(k, 0)]);
        let nearest = of_rigid.svd(true, true).solve(&gap, INDEPENDENT).unwrap_or_default();
        nearest.iter().enumerate().for_each(|(j, value)| z[(j, 0)] = *value);
    }
    z
}

/// Returns the Cholesky factor of the compliance of some candidates.
///
/// # Errors
/// Returns [`Error::Singular`] where it is not positive definite.
pub(super) fn factored(compliance: &Mat<f64>, nodes: &[usize]) -> Result<Llt<f64>> {
    let block = Mat::from_fn(nodes.len(), nodes.len(), |i, j| compliance[(nodes[i], nodes[j])]);
    block.llt(Triangle::Lower).map_err(|_| failed(nodes.len(), INDEFINITE))
}

const INDEFINITE: &str = "their compliance is not positive definite";

fn failed(touching: usize, what: &str) -> Error {
    Error::Singular(format!("the modes of {touching} nodes in contact: {what}"))
}

/// Active set of an eigenproblem and the changes that lead from it to another set. The eigenvectors
/// follow from it to the last bit.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Lineage {
    /// Whether the first set is that without contact, whose eigenvectors are unit vectors.
    is_free: bool,
    root: Contacts,
    /// Bounds of the system that touched or left, in turn.
    changes: Vec<usize>,
}

impl Lineage {
    /// Returns the nodes in contact, as indices into the bounds of the system.
    fn touching(&self) -> BTreeSet<usize> {
        let mut touching = self.root.iter().map(|(bound, _)| *bound).collect();
        for bound in &self.changes {
            toggle(&mut touching, *bound);
        }
        touching
    }
}

/// Adds a node to a set, or removes it.
fn toggle(touching: &mut BTreeSet<usize>, bound: usize) {
    if !touching.remove(&bound) {
        touching.insert(bound);
    }
}

/// Eigenvalues and eigenvectors of the stiffness of an active set.
#[derive(Debug, Clone)]
pub(super) struct Spectrum {
    pub lineage: Lineage,
    /// Eigenvalues, ascending, not negative, in (rad/s)^2.
    pub values: Vec<f64>,
    /// Largest |x|^T |K| |x| of a mode shape x, 0 for velocities of modes.
    pub magnitude: f64,
    /// Eigenvectors V, N x N.
    pub vectors: Mat<f64>,
}

impl Spectrum {
    /// Returns the eigenvalue up to which a motion counts as rigid, in (rad/s)^2.
    pub fn floor(&self) -> f64 {
        let largest = self.values.iter().copied().fold(STIFF * self.magnitude, f64::max);
        RIGID * f64::EPSILON * largest
    }

    /// Returns the eigenpairs of an active set by the eigenproblem.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the eigenvalue solver does not converge.
    pub fn new<E: Engine>(system: &System<E>, reduction: &ReducedModel, held: &Held) -> Result<Spectrum> {
        Spectrum::solved(system, reduction, held, contacts(reduction, &held.sides))
    }

    /// Returns the eigenpairs of an active set with velocities of modes, from those of another set
    /// or of no contact where few nodes differ, and by the eigenproblem otherwise.
    ///
    /// # Errors
    /// Returns the errors of [`Spectrum::new`].
    pub fn near<E: Engine>(
        system: &System<E>,
        reduction: &ReducedModel,
        held: &Held,
        from: Option<&Spectrum>,
    ) -> Result<Spectrum> {
        let touching = contacts(reduction, &held.sides).into_iter().map(|(bound, _)| bound).collect();
        let changes = |spectrum: &Spectrum| -> Vec<usize> {
            spectrum.lineage.touching().symmetric_difference(&touching).copied().collect()
        };
        let is_near = |changes: usize, before: usize| {
            changes < touching.len() && changes <= MAX_AT_ONCE && before + changes <= MAX_CHANGES
        };
        let from = from.filter(|from| is_near(changes(from).len(), from.lineage.changes.len()));
        let mut spectrum = match from {
            Some(from) => from.clone(),
            None if touching.len() <= MAX_AT_ONCE => Spectrum::free(reduction),
            None => return Spectrum::new(system, reduction, held),
        };
        for bound in changes(&spectrum) {
            spectrum = spectrum.changed(reduction, bound)?;
        }
        Ok(spectrum)
    }

    /// Returns the eigenpairs again that a lineage tells.
    ///
    /// # Errors
    /// Returns the errors of [`Spectrum::new`], and [`Error::Checkpoint`] where the lineage names
    /// nodes that are no candidates.
    pub fn restored<E: Engine>(
        system: &System<E>,
        reduction: &ReducedModel,
        lineage: &Lineage,
    ) -> Result<Spectrum> {
        let mut spectrum = if lineage.is_free {
            Spectrum::free(reduction)
        } else {
            let mut sides = vec![BoundStatus::Free; reduction.candidates.len()];
            for (bound, side) in &lineage.root {
                sides[position(reduction, *bound)?] = *side;
            }
            Spectrum::solved(system, reduction, &Held::new(reduction, &sides)?, lineage.root.clone())?
        };
        for bound in &lineage.changes {
            spectrum = spectrum.changed(reduction, *bound)?;
        }
        Ok(spectrum)
    }

    /// Returns the eigenpairs without contact, with velocities of modes.
    fn free(reduction: &ReducedModel) -> Spectrum {
        let size = reduction.stiffness.nrows();
        Spectrum {
            lineage: Lineage { is_free: true, ..Lineage::default() },
            values: (0..size).map(|k| reduction.stiffness[(k, k)]).collect(),
            magnitude: 0.0,
            vectors: Mat::identity(size, size),
        }
    }

    /// Solves the eigenproblem.
    fn solved<E: Engine>(
        system: &System<E>,
        reduction: &ReducedModel,
        held: &Held,
        root: Contacts,
    ) -> Result<Spectrum> {
        let ReducedModel { stiffness, lift, flexibility, .. } = reduction;
        let active = &held.active;
        let matrix = stiffness + held.lift.transpose() * held.w();
        let (values, mut vectors) =
            symmetric_eigen(matrix.as_ref()).map_err(|_| failed(active.len(), "they do not converge"))?;
        let (values, magnitude) = match system.mass {
            // The entries of H are as accurate as the frequencies of the modes. The rotations of
            // the eigenvalue solver lengthen the eigenvectors a little, and each event the state
            // with them.
            Form::Modal { .. } => {
                orthogonalise(&mut vectors);
                (values.into_iter().map(|value| value.max(0.0)).collect(), 0.0)
            }
            _ => {
                let columns =
                    Mat::from_fn(flexibility.nrows(), active.len(), |i, k| flexibility[(i, active[k])]);
                polish(system, &(lift - columns * held.w()), &mut vectors)?
            }
        };
        Ok(Spectrum {
            lineage: Lineage { is_free: false, root, changes: Vec::new() },
            values,
            magnitude,
            vectors,
        })
    }

    /// Returns the eigenpairs once a node has touched or left; see the [module page](self).
    fn changed(&self, reduction: &ReducedModel, bound: usize) -> Result<Spectrum> {
        let ReducedModel { lift_at, compliance, .. } = reduction;
        let mut others = self.lineage.touching();
        let change = if others.remove(&bound) { Change::Subtract } else { Change::Add };
        let others =
            others.into_iter().map(|bound| position(reduction, bound)).collect::<Result<Vec<_>>>()?;
        let i = position(reduction, bound)?;
        let (mut row, mut pivot) = (lift_at.row(i).to_owned(), compliance[(i, i)]);
        if !others.is_empty() {
            let coupling = Mat::from_fn(others.len(), 1, |k, _| compliance[(others[k], i)]);
            let forces = factored(compliance, &others)?.solve(&coupling);
            for (k, &other) in others.iter().enumerate() {
                row -= lift_at.row(other) * faer::Scale(forces[(k, 0)]);
                pivot -= coupling[(k, 0)] * forces[(k, 0)];
            }
        }
        if pivot <= 0.0 {
            return Err(failed(others.len() + 1, INDEFINITE));
        }
        let z = self.vectors.transpose() * row.transpose() * faer::Scale(1.0 / pivot.sqrt());
        let z = z.iter().copied().collect();
        let (values, vectors) = changed_eigen(&self.values, &self.vectors, z, change);
        let mut lineage = self.lineage.clone();
        lineage.changes.push(bound);
        let values = values.into_iter().map(|value| value.max(0.0)).collect();
        Ok(Spectrum { lineage, values, magnitude: 0.0, vectors })
    }
}

/// Returns the candidate at a bound of the system.
fn position(reduction: &ReducedModel, bound: usize) -> Result<usize> {
    let position = reduction.candidates.binary_search(&bound);
    position.map_err(|_| Error::Checkpoint("the checkpoint has contacts at nodes out of reach".into()))
}

/// Improves the eigenvectors of the energy of z -> shape z. Returns the eigenvalues and the largest
/// |x|^T |K| |x| of a shape x. See the [module page](self).
fn polish<E: Engine>(
    system: &System<E>,
    shape: &Mat<f64>,
    vectors: &mut Mat<f64>,
) -> Result<(Vec<f64>, f64)> {
    let System { engine, stiffness, .. } = system;
    let shapes = shape * &*vectors;
    let mut forces = Mat::zeros(shapes.nrows(), shapes.ncols());
    let (mut sizes, mut largest) = (vec![0.0; shapes.nrows()], 0.0_f64);
    for k in 0..shapes.ncols() {
        let (x, force) = (shapes.col_as_slice(k), forces.col_as_slice_mut(k));
        engine.multiply_with_magnitude(&stiffness.into(), x, [force, &mut sizes])?;
        largest = largest.max(x.iter().zip(&sizes).map(|(x, size)| x.abs() * size).sum());
    }
    let mut energies = shapes.transpose() * forces;
    diagonalise(&mut energies, vectors);
    Ok(((0..energies.nrows()).map(|k| energies[(k, k)].max(0.0)).collect(), largest))
}

/// Rotates the vectors until the matrix, symmetric and nearly diagonal, is diagonal. All pairs are
/// rotated at once to first order, and the rotation is made orthogonal to rounding, since z must be
/// recovered exactly when the active set changes.
fn diagonalise(matrix: &mut Mat<f64>, vectors: &mut Mat<f64>) {
    let size = matrix.nrows();
    for _ in 0..MAX_TURNS {
        let mut settled = true;
        let mut turn = Mat::<f64>::identity(size, size);
        for j in 1..size {
            for i in 0..j {
                let (a, b) = (matrix[(i, i)], matrix[(j, j)]);
                let coupling = 0.5 * (matrix[(i, j)] + matrix[(j, i)]);
                let share = coupling * coupling / (a.max(0.0) * b.max(0.0));
                let angle = coupling / (b - a);
                if share > COUPLING * COUPLING && angle.abs() <= LARGEST_ANGLE {
                    settled = false;
                    (turn[(i, j)], turn[(j, i)]) = (angle, -angle);
                }
            }
        }
        if settled {
            break;
        }
        orthogonalise(&mut turn);
        *matrix = turn.transpose() * &*matrix * &turn;
        *vectors = &*vectors * &turn;
    }
}

/// Replaces a nearly orthogonal matrix by the nearest orthogonal one with the Newton-Schulz
/// iteration G (3 - G^T G) / 2, until the defect is rounding.
fn orthogonalise(matrix: &mut Mat<f64>) {
    let size = matrix.nrows();
    for _ in 0..MAX_CORRECTIONS {
        let defect = Mat::<f64>::identity(size, size) - matrix.transpose() * &*matrix;
        *matrix += &*matrix * &defect * faer::Scale(0.5);
        // The next defect is 3/4 of the square of this one.
        if defect.norm_l2() <= SETTLED {
            break;
        }
    }
}
