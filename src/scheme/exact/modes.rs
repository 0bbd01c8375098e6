//! Vibration modes of an active set, and a cache of them.
//!
//! While the set A of nodes in contact does not change, their reactions hold them at their bounds
//! g:
//!
//! ```math
//! r = \rho - W z, \qquad W = S_{AA}^{-1} R_A, \quad \rho = S_{AA}^{-1} (g - G_A U_F),
//! ```
//!
//! and the motion is linear, `$z'' + \alpha z' = h - H_A z$` with `$H_A = H + R_A^T W$`,
//! `$h = h_F + R_A^T \rho$`. In the eigenvectors V of `$H_A$` the coordinates `$q = V^T z$` are
//! decoupled.
//!
//! A dense eigenvalue solver has errors as large as the rounding error of the largest eigenvalue,
//! which is 10^6 to 10^12 times the lowest; so have the entries of `$H_A$`. The mode shapes
//! `$X = (R - S_A W) V$` are more accurate: with K applied cell by cell, `$X^T K X = V^T H_A V$`
//! has entries accurate relative to their own size, and is nearly diagonal. A few Jacobi-like
//! sweeps, rotating all pairs of modes by first-order perturbation, complete the diagonalisation. V
//! is kept orthogonal to rounding throughout, because the state passes from one set's modes to the
//! next's as `$V V^T z$`.

use super::reduction::ReducedModel;
use crate::archive::Archive;
use crate::error::{Error, Result};
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::{Engine, Form};
use crate::scheme::System;
use crate::vi::BoundStatus;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side as Triangle};
use std::collections::HashMap;
use std::rc::Rc;

/// Multiple of the rounding error of the largest eigenvalue below which an eigenvalue is that of a
/// rigid motion.
const RIGID: f64 = 4.0;
/// Part of |x|^T |K| |x| that replaces the largest eigenvalue where all motions are rigid and it is
/// rounding itself.
const STIFF: f64 = 1e-4;

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

/// Modes of one active set.
#[derive(Debug)]
pub(super) struct Modes {
    /// Contact status of each candidate.
    pub sides: Vec<BoundStatus>,
    /// Angular frequencies, in rad/s, ascending; rigid motions come first with 0.
    pub frequencies: Vec<f64>,
    /// Number of rigid motions.
    pub rigid: usize,
    /// Damping coefficient alpha, in 1/s.
    pub damping: f64,
    /// Eigenvectors V, N x N.
    pub vectors: Mat<f64>,
    /// Modal forces V^T h, N entries.
    pub force: Vec<f64>,
    /// Watched quantity `offset + rows q` per candidate: the deflection (m) where the node is free,
    /// the reaction (N) where it is in contact.
    pub offset: Vec<f64>,
    pub rows: Mat<f64>,
    /// Interval in which the quantity must stay: between the obstacles, or the admissible sign of
    /// the reaction.
    pub limits: Vec<[f64; 2]>,
}

impl Modes {
    /// Diagonalises the motion with the bounds of `sides` active.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the eigenvalue solver does not converge.
    pub fn new<E: Engine>(
        system: &System<E>,
        reduction: &ReducedModel,
        sides: &[BoundStatus],
    ) -> Result<Modes> {
        let ReducedModel {
            stiffness, force, bounds, rest_at, lift, flexibility, lift_at, compliance, ..
        } = reduction;
        let (cells, bounded) = (stiffness.nrows(), sides.len());
        let active: Vec<usize> = (0..bounded).filter(|&i| sides[i] != BoundStatus::Free).collect();
        let failed =
            |what: &str| Error::Singular(format!("the modes of {} nodes in contact: {what}", active.len()));
        // Solve at once for all columns S_AA^-1 R_A and S_AA^-1 (g - G_A U_F).
        let mut held = Mat::from_fn(active.len(), cells + 1, |k, j| match active[k] {
            i if j < cells => lift_at[(i, j)],
            i if sides[i] == BoundStatus::Lower => bounds.lower[i] - rest_at[(i, 0)],
            i => bounds.upper[i] - rest_at[(i, 0)],
        });
        if !active.is_empty() {
            let block = Mat::from_fn(active.len(), active.len(), |i, j| compliance[(active[i], active[j])]);
            let llt = block
                .llt(Triangle::Lower)
                .map_err(|_| failed("their compliance is not positive definite"))?;
            llt.solve_in_place(&mut held);
        }
        let lift_active = Mat::from_fn(active.len(), cells, |k, j| lift_at[(active[k], j)]);
        let (w, rho) = (held.get(.., ..cells), held.get(.., cells..));
        let matrix = stiffness + lift_active.transpose() * w;
        let h = force + lift_active.transpose() * rho;
        let (values, mut vectors) =
            symmetric_eigen(matrix.as_ref()).map_err(|_| failed("they do not converge"))?;
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
                polish(system, &(lift - columns * w), &mut vectors)?
            }
        };
        let largest = values.iter().copied().fold(STIFF * magnitude, f64::max);
        let floor = RIGID * f64::EPSILON * largest;
        let rigid = values.iter().take_while(|value| **value <= floor).count();
        let frequencies =
            values.iter().map(|value| if *value <= floor { 0.0 } else { value.sqrt() }).collect();
        // Watched quantities as functions of z.
        let coupling = Mat::from_fn(bounded, active.len(), |i, k| compliance[(i, active[k])]);
        let mut rows = lift_at - &coupling * w;
        let mut offset = rest_at + &coupling * rho;
        for (k, &i) in active.iter().enumerate() {
            rows.row_mut(i).copy_from(-w.row(k));
            offset[(i, 0)] = rho[(k, 0)];
        }
        let limit = |i: usize| match sides[i] {
            _ if bounds.holds(i) => [f64::NEG_INFINITY, f64::INFINITY],
            BoundStatus::Free => [bounds.lower[i], bounds.upper[i]],
            BoundStatus::Lower => [0.0, f64::INFINITY],
            BoundStatus::Upper => [f64::NEG_INFINITY, 0.0],
        };
        Ok(Modes {
            sides: sides.to_vec(),
            frequencies,
            rigid,
            damping: system.damping.mass,
            force: (vectors.transpose() * h).col_as_slice(0).to_vec(),
            offset: offset.col_as_slice(0).to_vec(),
            rows: rows * &vectors,
            limits: (0..bounded).map(limit).collect(),
            vectors,
        })
    }

    /// Returns the memory of the arrays, in bytes.
    fn bytes(&self) -> usize {
        let entries = self.vectors.nrows() * self.vectors.ncols() + self.rows.nrows() * self.rows.ncols();
        let vectors = 2 * self.frequencies.len() + 3 * self.sides.len();
        (entries + vectors) * size_of::<f64>() + self.sides.len()
    }
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
        engine.multiply_with_magnitude(&stiffness.into(), x, force, &mut sizes)?;
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

/// Cache of the modes of active sets, with the least recently used ones evicted first.
#[derive(Debug)]
pub(super) struct Cache {
    /// Modes of each set and the time of their last use. Modes restored from an archive are
    /// recomputed on demand.
    sets: HashMap<Vec<BoundStatus>, (Option<Rc<Modes>>, u64)>,
    limit: usize,
    bytes: usize,
    clock: u64,
    /// Number of diagonalisations so far.
    pub computed: u64,
    /// Peak memory, in bytes.
    pub peak: usize,
}

impl Cache {
    /// Builds an empty cache of at most `limit` bytes (and at least one set).
    pub fn new(limit: usize) -> Cache {
        Cache { sets: HashMap::new(), limit, bytes: 0, clock: 0, computed: 0, peak: 0 }
    }

    /// Returns the modes of a set, from the cache or computed.
    ///
    /// # Errors
    /// Returns the same errors as [`Modes::new`].
    pub fn get<E: Engine>(
        &mut self,
        system: &System<E>,
        reduction: &ReducedModel,
        sides: &[BoundStatus],
    ) -> Result<Rc<Modes>> {
        self.clock += 1;
        if let Some((modes, used)) = self.sets.get_mut(sides) {
            *used = self.clock;
            let known = match modes.take() {
                Some(known) => known,
                None => Rc::new(Modes::new(system, reduction, sides)?),
            };
            return Ok(modes.insert(known).clone());
        }
        let modes = Rc::new(Modes::new(system, reduction, sides)?);
        self.computed += 1;
        self.bytes += modes.bytes();
        while self.bytes > self.limit && !self.sets.is_empty() {
            let oldest = self.sets.iter().min_by_key(|(_, (_, used))| *used).map(|(sides, _)| sides.clone());
            oldest.and_then(|sides| self.sets.remove(&sides));
            // All sets have the same size.
            self.bytes -= modes.bytes();
        }
        self.peak = self.peak.max(self.bytes);
        self.sets.insert(sides.to_vec(), (Some(modes.clone()), self.clock));
        Ok(modes)
    }

    /// Forgets all sets, as their candidates change.
    pub fn clear(&mut self) {
        self.sets.clear();
        self.bytes = 0;
    }

    /// Saves or restores the list of known sets, from which their modes follow.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        let used = |(sides, (_, used)): (&Vec<BoundStatus>, &(_, u64))| (*used, sides.clone());
        let mut sets: Vec<(u64, Vec<BoundStatus>)> = self.sets.iter().map(used).collect();
        sets.sort_unstable_by_key(|(used, _)| *used);
        archive.value(&mut sets)?;
        archive.value(&mut self.clock)?;
        archive.value(&mut self.computed)?;
        archive.value(&mut self.bytes)?;
        archive.value(&mut self.peak)?;
        if !archive.saves() {
            let mut known = std::mem::take(&mut self.sets);
            let set = |(used, sides)| {
                let modes = known.remove(&sides).and_then(|(modes, _)| modes);
                (sides, (modes, used))
            };
            self.sets = sets.into_iter().map(set).collect();
        }
        Ok(())
    }
}
