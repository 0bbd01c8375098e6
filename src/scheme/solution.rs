//! Solution of a scheme at an instant: what every scheme tells of its motion.

use super::coulomb::NodalFriction;
use crate::archive::{Archive, VectorKind};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::vectors::{axpy, clear, is_zero};
use crate::obstacle::Bounds;
use crate::vi::StepReport;

/// State of a bounded dof just before the contact of the present step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Time, in s.
    pub time: f64,
    /// Deflection, in m.
    pub deflection: f64,
    /// Velocity, in m/s.
    pub velocity: f64,
}

impl Approach {
    /// Returns the initial states of all bounds, given displacement (m) and velocity (m/s), one
    /// entry per dof.
    pub(super) fn at_start(bounds: &Bounds, displacement: &[f64], velocity: &[f64]) -> Vec<Approach> {
        let state =
            |&dof: &usize| Approach { time: 0.0, deflection: displacement[dof], velocity: velocity[dof] };
        bounds.dofs.iter().map(state).collect()
    }

    /// Saves or restores approaches, one per bound.
    pub(super) fn archive(approaches: &mut [Approach], archive: &mut Archive) -> Result<()> {
        archive.items(
            VectorKind::Bounds,
            approaches,
            |approach| [approach.time, approach.deflection, approach.velocity],
            |[time, deflection, velocity]| Approach { time, deflection, velocity },
        )
    }
}

/// Quantities that every scheme reports about the step to the present instant.
#[derive(Debug, Clone)]
pub struct StepRecord {
    /// Index n of the present instant; 0 at the start.
    pub step: u64,
    /// Length of a step, in s.
    pub dt: f64,
    /// Bounded configuration of the step (the paper's `$U^{n+1,e}$` or `$U^{n+1/2}$`), in m, one
    /// entry per bound.
    pub admissible: Vec<f64>,
    /// Reactions of the obstacles, in N, one entry per bound, positive upwards.
    pub reaction: Vec<f64>,
    /// Impulses of the obstacles over the step, from the scheme's own balance of momentum, in N s,
    /// one entry per bound, positive upwards. They are zero at the start.
    pub impulses: Vec<f64>,
    /// Bounds that may be in contact, ascending; `None` for all of them. The other bounds have no
    /// reaction, and their entries of the configuration may be of an earlier instant.
    pub candidates: Option<Vec<usize>>,
    /// Iterations and accuracy of the last solve.
    pub report: StepReport,
}

impl StepRecord {
    pub(crate) fn new(dt: f64, bounds: usize) -> StepRecord {
        let zeros = vec![0.0; bounds];
        StepRecord {
            step: 0,
            dt,
            admissible: zeros.clone(),
            reaction: zeros.clone(),
            impulses: zeros,
            candidates: None,
            report: StepReport::default(),
        }
    }

    /// Returns the bounds that may be in contact, ascending.
    pub fn candidates(&self) -> impl Iterator<Item = usize> + '_ {
        let numbers = if self.candidates.is_none() { 0..self.reaction.len() } else { 0..0 };
        self.candidates.iter().flatten().copied().chain(numbers)
    }

    /// Returns whether nothing touches: no bound has a reaction or an impulse, and the bounded
    /// configuration lies within `limits`. Where there are candidates, the answer may be no.
    pub fn is_free(&self, limits: &Bounds) -> bool {
        // Without an early end the loops have no branches.
        let all_zero = |values: &[f64]| values.iter().fold(true, |zero, value| zero & (*value == 0.0));
        let within = || {
            let sides = limits.lower.iter().zip(&limits.upper);
            self.admissible
                .iter()
                .zip(sides)
                .fold(true, |within, (z, (lower, upper))| within & (*lower <= *z) & (*z <= *upper))
        };
        self.candidates.is_none() && all_zero(&self.reaction) && all_zero(&self.impulses) && within()
    }

    /// Returns the time of the present instant, in s.
    pub fn time(&self) -> f64 {
        self.step as f64 * self.dt
    }

    pub(super) fn begin_step(&mut self) {
        self.step += 1;
        clear(&mut self.impulses);
    }

    /// Takes the reactions (N) at the end of a step, whose impulses are the trapezoidal sum of
    /// them and those before.
    pub(super) fn end_step(&mut self, reaction: &[f64]) {
        let half = 0.5 * self.dt;
        for ((r, before), impulse) in reaction.iter().zip(&mut self.reaction).zip(&mut self.impulses) {
            *impulse = half * *before + half * r;
            *before = *r;
        }
    }

    /// Adds the impulses of the recorded reactions over a duration, in s.
    pub(super) fn add_impulses(&mut self, seconds: f64) {
        if !is_zero(&self.reaction) {
            axpy(seconds, &self.reaction, &mut self.impulses);
        }
    }

    pub(super) fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.step)?;
        archive.value(&mut self.report)?;
        for vector in [&mut self.admissible, &mut self.reaction, &mut self.impulses] {
            archive.vector(VectorKind::Bounds, vector)?;
        }
        Ok(())
    }
}

/// Solution at an instant of the grid of steps.
pub trait Solution {
    /// Returns the record of the step to the present instant. Each scheme states the instant that
    /// its reactions belong to.
    fn record(&self) -> &StepRecord;

    /// Returns [`StepRecord::step`].
    fn step(&self) -> u64 {
        self.record().step
    }

    /// Returns [`StepRecord::time`].
    fn time(&self) -> f64 {
        self.record().time()
    }

    /// Returns [`StepRecord::admissible`].
    fn admissible(&self) -> &[f64] {
        &self.record().admissible
    }

    /// Returns [`StepRecord::reaction`].
    fn reaction(&self) -> &[f64] {
        &self.record().reaction
    }

    /// Returns [`StepRecord::impulses`].
    fn impulses(&self) -> &[f64] {
        &self.record().impulses
    }

    /// Returns [`StepRecord::report`].
    fn step_report(&self) -> StepReport {
        self.record().report
    }

    /// Returns the displacement `$U^n$`, in m, one entry per dof.
    fn displacement(&self) -> &[f64];

    /// Returns the displacement `$U^n$` of one dof, in m, with the bits of
    /// [`Solution::displacement`]. It is cheap
    /// also for a scheme whose steps compute no displacement.
    fn displacement_of(&self, dof: usize) -> f64 {
        self.displacement()[dof]
    }

    /// Returns the rate of U at the present instant, in m/s, one entry per displacement dof. The
    /// product of M with it is the momentum of the scheme, whose change is the impulse of loads,
    /// damping and [`StepRecord::impulses`]. The call does not change later steps. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn velocity(&mut self) -> Result<Vec<f64>>;

    /// Returns [`Solution::velocity`] at some dofs. It is cheap also for a scheme whose steps
    /// compute no displacement. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn velocity_of(&mut self, dofs: &[usize]) -> Result<Vec<f64>> {
        let velocity = self.velocity()?;
        Ok(dofs.iter().map(|&dof| velocity[dof]).collect())
    }

    /// Returns the support velocities that [`Solution::velocity`] is relative to, in m/s, one entry
    /// per motion.
    ///
    /// # Errors
    /// Returns the errors of the support motions.
    fn support_rates(&self) -> Result<Vec<f64>> {
        Ok(Vec::new())
    }

    /// Returns the bounds that [`StepRecord::admissible`] satisfies, in m.
    fn limits(&self) -> &Bounds;

    /// Returns the kinetic energy, elastic energy and work of the scheme at the present instant, in
    /// J.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn energies(&self) -> Result<Energies>;

    /// Returns the discrete energy that the scheme conserves in free flight at any step size, in J.
    /// By default this is the total of [`Solution::energies`].
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn invariant(&self) -> Result<f64> {
        Ok(self.energies()?.total())
    }

    /// Returns the state of a bounded dof (an index into the bounds) just before the present step.
    fn approach(&self, bound: usize) -> Approach;

    /// Returns the friction at this rank's nodes that touched in the last step.
    fn friction_at_nodes(&self) -> Vec<NodalFriction> {
        Vec::new()
    }
}
