//! Energy of stretching as the square of a variable, which makes a step linear.
//!
//! With `$\psi = \sqrt{2 V}$` and `$g = V'(U) / \psi$` the force of stretching is `$\psi\, g$`. A
//! scheme takes g at a known displacement and advances `$\psi$` by `$g \cdot \Delta U$`: its step
//! matrix gains a term `$c\, g g^T$`, and the part `$\tfrac12 \psi^2$` of its energy balance closes
//! as the elastic one does (scalar auxiliary variable: Shen, Xu and Yang 2018). V grows with the
//! fourth power of U: g vanishes with it.
//!
//! The step driver solves for the number `$s = g \cdot x$`: `$x(s)$` solves the problem without
//! the further term and with the force `$-c\, s\, g$`. `$g \cdot x(s)$` falls with s, whatever the
//! contact, so that the root of `$g \cdot x(s) - s$` lies between s and `$g \cdot x(s)$` for every
//! s. Any contact solver serves.
//!
//! `$\psi$` is a variable of its own, whose distance from `$\sqrt{2 V}$` tells how far the motion
//! is from the one of the true energy.
//!
//! # Singular mass
//!
//! V is taken at the displacement that the means over cells have without obstacles: the massless
//! rest only bends, and g acts on the means alone. If the rest stretched too, its deflections a
//! about their equilibrium would obey `$K a^{n+1} + K a^{n-1} = -2 K_G a^n$` with the stiffness
//! `$K_G$` of the forces in the plane, at every step: they would never die, and grow where `$K_G$`
//! exceeds K. With the penalty s of [`super::massless::penalty`] and `$S = K + s M$`,
//!
//! ```math
//! \bar U = U + S^{-1} (F - K U), \qquad \psi\, g = V'(\bar U) + K h, \qquad h = -S^{-1} V'(\bar U),
//! ```
//!
//! which is the gradient of `$V(\bar U(U))$`. The means of `$\bar U$` miss the means of U by the
//! share `$\omega^2 / (\omega^2 + s)$` of each vibration of angular frequency `$\omega$`, at most
//! 1e-3.

use super::drive::StretchingEnergy;
use super::massless::penalty::PenalisedStiffness;
use super::{StepBalance, System};
use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{add, axpy, scale, subtract};

/// Largest number of solves for the root of a step.
const SOLVES: u32 = 60;
/// Multiple of the rounding error from which on differences count.
const NOISE: f64 = 1e6;

/// Term `$c\, g g^T$` of a step matrix.
pub(super) struct RankOne<'q> {
    /// Weight c, dimensionless.
    pub weight: f64,
    /// Gradient g, in N/J^1/2, one entry per dof.
    pub gradient: &'q [f64],
    /// Variable `$\psi$` against which `$g \cdot x$` is rounding, in J^1/2.
    pub scale: f64,
}

/// Displacements of the singular mass.
struct EnergyOfMeans<'s> {
    stiffness: PenalisedStiffness<'s>,
    /// Displacement `$\bar U$` where the gradient was taken, in m, one entry per dof.
    u: Vec<f64>,
    /// Response h of the massless rest to the force of stretching, in m, one entry per dof.
    response: Vec<f64>,
}

impl EnergyOfMeans<'_> {
    /// Moves a displacement U (m) to `$\bar U$`. Collective.
    fn relax<E: Engine>(&mut self, system: &System<E>, u: &mut [f64]) -> Result<()> {
        let mut change = vec![0.0; u.len()];
        system.force(u, &mut change)?;
        self.stiffness.solve(&system.bounds, &mut change)?;
        add(&change, u);
        Ok(())
    }
}

/// Quadratised energy of stretching.
pub(super) struct Quadratisation<'s, E: Engine> {
    system: &'s System<E>,
    energy: &'s dyn StretchingEnergy,
    /// `None` with a regular mass.
    means: Option<EnergyOfMeans<'s>>,
    /// Gradient g, in N/J^1/2, one entry per dof.
    pub gradient: Vec<f64>,
    /// Variable `$\psi$`, in J^1/2.
    pub root: f64,
    /// Value of `$\psi$` in the force of the last step, in J^1/2.
    pub applied: f64,
    /// True energy V where the gradient was taken, in J.
    pub stored: f64,
    /// Largest `$\sqrt{2 V}$` and largest distance of `$\psi$` from it, in J^1/2.
    largest: f64,
    distance: f64,
}

impl<'s, E: Engine> Quadratisation<'s, E> {
    /// Starts at a displacement (m, one entry per dof); `None` for a plate that only bends.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the energy.
    pub fn new(system: &'s System<E>, u: &[f64]) -> Result<Option<Quadratisation<'s, E>>> {
        let Some(energy) = &system.drive.membrane else { return Ok(None) };
        let means = || {
            let [displacement, response] = [(); 2].map(|()| vec![0.0; u.len()]);
            Ok(EnergyOfMeans { stiffness: PenalisedStiffness::new(system)?, u: displacement, response })
        };
        let mut quadratisation = Quadratisation {
            system,
            energy: energy.as_ref(),
            means: system.mass.is_singular().then(means).transpose()?,
            gradient: vec![0.0; u.len()],
            root: 0.0,
            applied: 0.0,
            stored: 0.0,
            largest: 0.0,
            distance: 0.0,
        };
        quadratisation.linearise(u)?;
        quadratisation.root = (2.0 * quadratisation.stored).sqrt();
        Ok(Some(quadratisation))
    }

    /// Takes the gradient at a displacement. Collective.
    ///
    /// # Errors
    /// Returns the errors of the energy.
    pub fn linearise(&mut self, u: &[f64]) -> Result<()> {
        let Quadratisation { system, energy, means, gradient, stored, .. } = self;
        match means {
            None => *stored = energy.evaluate(u, gradient)?,
            Some(means) => {
                let mut place = u.to_vec();
                means.relax(system, &mut place)?;
                let (mut force, mut response) = (vec![0.0; u.len()], vec![0.0; u.len()]);
                *stored = energy.evaluate(&place, &mut force)?;
                subtract(&force, &mut response);
                means.stiffness.solve(&system.bounds, &mut response)?;
                system.engine.multiply(&system.stiffness, &response, gradient)?;
                add(&force, gradient);
                (means.u, means.response) = (place, response);
            }
        }
        let root = (2.0 * self.stored).sqrt();
        scale(if root > 0.0 { root.recip() } else { 0.0 }, &mut self.gradient);
        Ok(())
    }

    /// Returns the energy V of a displacement (m), in J. Collective.
    ///
    /// # Errors
    /// Returns the errors of the energy.
    pub fn energy(&mut self, u: &[f64]) -> Result<f64> {
        let mut place = u.to_vec();
        self.means.as_mut().map_or(Ok(()), |means| means.relax(self.system, &mut place))?;
        self.energy.evaluate(&place, &mut vec![0.0; u.len()])
    }

    /// Returns `$g \cdot x$`, in J^1/2. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn along(&self, x: &[f64]) -> Result<f64> {
        self.system.engine.dot(&self.gradient, x)
    }

    /// Returns the term of a step matrix with a weight.
    pub fn term(&self, weight: f64) -> RankOne<'_> {
        RankOne { weight, gradient: &self.gradient, scale: self.root }
    }

    /// Subtracts the force of stretching at a value of `$\psi$` from b, in N.
    pub fn subtract_force(&self, root: f64, b: &mut [f64]) {
        axpy(-root, &self.gradient, b);
    }

    /// Adds the force of the last step, at an instant (s) and the displacement (m) of
    /// [`Self::linearise`], to a balance.
    pub fn add_to(&self, balance: &mut StepBalance, time: f64, u: &[f64]) {
        let factor = if self.stored > 0.0 { self.applied / (2.0 * self.stored).sqrt() } else { 0.0 };
        let mut place = u;
        if let Some(means) = &self.means {
            place = &means.u;
            // K times the response is what the means do not feel of the force.
            axpy(factor, &means.response, &mut balance.displacement);
        }
        balance.follow(self.system, [factor, 0.0], time, place);
    }

    /// Compares `$\psi$` with the true energy, in J, of the same instant.
    pub fn compare(&mut self, root: f64, energy: f64) {
        let exact = (2.0 * energy).sqrt();
        self.largest = self.largest.max(exact);
        self.distance = self.distance.max((root - exact).abs());
    }

    /// Returns the largest distance of `$\psi$` from `$\sqrt{2 V}$` so far, relative to the
    /// largest `$\sqrt{2 V}$`.
    pub fn gap(&self) -> f64 {
        if self.largest > 0.0 { self.distance / self.largest } else { 0.0 }
    }

    /// Saves or restores the state.
    ///
    /// # Errors
    /// Returns [`crate::Error::Checkpoint`] where the archive does not fit.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.vector(VectorKind::Dofs, &mut self.gradient)?;
        if let Some(EnergyOfMeans { u, response, .. }) = &mut self.means {
            archive.vector(VectorKind::Dofs, u)?;
            archive.vector(VectorKind::Dofs, response)?;
        }
        for value in
            [&mut self.root, &mut self.applied, &mut self.stored, &mut self.largest, &mut self.distance]
        {
            archive.value(value)?;
        }
        Ok(())
    }
}

/// Search for the root s of each step, which begins at the root of the step before.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct RootSearch {
    /// Root of the last step.
    pub last: f64,
    /// Slope of `$s - g \cdot x(s)$` there, at least 1; 0 before the first step.
    pub slope: f64,
}

impl RootSearch {
    /// Finds the root of `$g \cdot x(s) - s$`, given that function of s; the last evaluation is at
    /// the root, to rounding of `scale`. Returns the value there.
    ///
    /// # Errors
    /// Returns the errors of the function.
    pub fn run(&mut self, scale: f64, mut excess: impl FnMut(f64) -> Result<f64>) -> Result<f64> {
        let (mut s, mut slope) = (self.last, self.slope.max(1.0));
        let mut value = excess(s)?;
        let mut bracket = if value > 0.0 { [s, s + value] } else { [s + value, s] };
        let rounding = f64::EPSILON * scale.abs().max(s.abs()).max((s + value).abs());
        for _ in 1..SOLVES {
            if value.abs() <= rounding {
                break;
            }
            let [low, high] = bracket;
            let newton = s + value / slope;
            let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
            if next == s {
                break;
            }
            let before = std::mem::replace(&mut value, excess(next)?);
            // Differences near rounding tell no slope.
            if before.abs() > NOISE * rounding {
                slope = ((before - value) / (next - s)).max(1.0);
            }
            s = next;
            bracket[usize::from(value <= 0.0)] = s;
            if before.abs() <= NOISE * rounding && value.abs() >= 0.5 * before.abs() {
                break;
            }
        }
        (self.last, self.slope) = (s, slope);
        Ok(value)
    }
}
