//! Measures of a periodically driven motion, from its steps; `docs/sweeps.md` defines each.

use crate::communicator::Communicator;
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::Scheme;
use crate::simulation::StepMonitor;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Number of steps without contact after which the next contact is another impact.
const APART: u64 = 2;

/// Largest number of periods after which a motion is seen to repeat.
const LONGEST: usize = 64;

/// Measures of a run, over its periods after the settling ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measures {
    /// Measures of each probe, in the order of the scene.
    pub probes: Vec<ProbeMeasures>,
    /// Number of periods of the drive after which the motion repeats; `None` if it does not.
    pub period: Option<usize>,
    /// Largest Lyapunov exponent, in 1/s; `None` unless asked for.
    pub lyapunov: Option<f64>,
    /// Largest sum of the magnitudes of all reactions at one instant, in N.
    pub peak_force: f64,
    /// Sum of the magnitudes of the impulses of all nodes per period, in N s.
    pub impulse: f64,
    /// Number of impacts per period.
    pub impacts: f64,
    /// Largest speed at which a gap closed, in m/s.
    pub impact_velocity: f64,
    /// Work of loads, supports and moving obstacles per period, in J.
    pub work: f64,
    /// Energy that damping and impacts take per period, in J.
    pub loss: f64,
}

/// Measures of the quantity at a probe, in its unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProbeMeasures {
    /// Values at the ends of the periods.
    pub section: Vec<f64>,
    /// Largest value of all steps.
    pub max: f64,
    /// Least value of all steps.
    pub min: f64,
    /// Root of the mean square of the deviation from the mean.
    pub rms: f64,
    /// Amplitude of the part that oscillates with the drive.
    pub amplitude: f64,
    /// Phase of that part, in rad: it is `amplitude sin(2 pi t / T + phase)`.
    pub phase: f64,
}

/// Returns the smallest number of points after which all sections repeat, up to `tolerance` times
/// the range of each; `None` where there is none that two repetitions show.
///
/// A section comes with the range of its motion.
pub fn repetition(sections: &[(&[f64], f64)], tolerance: f64) -> Option<usize> {
    let count = sections.iter().map(|(section, _)| section.len()).min()?;
    let repeats = |after: usize| {
        sections.iter().all(|(section, range)| {
            let pairs = section.iter().zip(&section[after..]);
            pairs.into_iter().all(|(a, b)| (a - b).abs() <= tolerance * range)
        })
    };
    (1..=LONGEST.min(count / 2)).find(|&after| repeats(after))
}

/// Sums over the steps at a probe.
struct ProbeSums {
    section: Vec<f64>,
    max: f64,
    min: f64,
    /// First value, from which the sums count.
    origin: f64,
    sum: f64,
    squares: f64,
    sine: f64,
    cosine: f64,
}

/// Measures of the steps of a run so far.
pub(super) struct PeriodRecorder<'m, E: Engine> {
    monitor: StepMonitor<'m, E>,
    /// Sine and cosine of the phase of the drive, one pair per step of a period.
    phases: Vec<[f64; 2]>,
    /// Number of steps before the measured ones.
    settle: u64,
    values: Vec<f64>,
    probes: Vec<ProbeSums>,
    /// Steps since the last contact.
    free: u64,
    peak_force: f64,
    impulse: f64,
    impacts: u64,
    impact_velocity: f64,
    /// Energies at the beginning of the measured periods.
    energies: Energies,
}

impl<'m, E: Engine> PeriodRecorder<'m, E> {
    /// Prepares the measures of a run with a number of probes.
    pub fn new(
        monitor: StepMonitor<'m, E>,
        probes: usize,
        per_period: u64,
        settle: u64,
    ) -> PeriodRecorder<'m, E> {
        let sums = || ProbeSums {
            section: Vec::new(),
            max: f64::NEG_INFINITY,
            min: f64::INFINITY,
            origin: 0.0,
            sum: 0.0,
            squares: 0.0,
            sine: 0.0,
            cosine: 0.0,
        };
        let phase = |step: u64| (TAU * step as f64 / per_period as f64).sin_cos().into();
        PeriodRecorder {
            monitor,
            phases: (0..per_period).map(phase).collect(),
            settle,
            values: vec![0.0; probes],
            probes: std::iter::repeat_with(sums).take(probes).collect(),
            free: APART,
            peak_force: 0.0,
            impulse: 0.0,
            impacts: 0,
            impact_velocity: 0.0,
            energies: Energies::default(),
        }
    }

    /// Checks and records the step just made; the start is step 0. Collective.
    pub fn note(&mut self, scheme: &mut dyn Scheme) -> Result<()> {
        self.monitor.note(scheme, &mut self.values)?;
        let step = scheme.step();
        let is_measured = step > self.settle;
        self.note_contact(scheme, is_measured)?;
        if step == self.settle {
            self.energies = scheme.energies()?;
            for (sums, value) in self.probes.iter_mut().zip(&self.values) {
                sums.origin = *value;
            }
        }
        if is_measured {
            let place = (step % self.phases.len() as u64) as usize;
            for (sums, &value) in self.probes.iter_mut().zip(&self.values) {
                sums.note(value, self.phases[place], place == 0);
            }
        }
        Ok(())
    }

    /// Records forces, impulses and impacts of the step.
    fn note_contact(&mut self, scheme: &mut dyn Scheme, is_measured: bool) -> Result<()> {
        let events = scheme.take_events();
        let record = scheme.record();
        let (mut force, mut impulse) = (0.0, 0.0);
        for bound in record.candidates() {
            force += record.reaction[bound].abs();
            impulse += record.impulses[bound].abs();
        }
        let [force, impulse] = self.monitor.comm().all_reduce_sum([force, impulse]);
        let touches = force > 0.0 || !events.is_empty();
        let is_impact = touches && self.free >= APART;
        self.free = if touches { 0 } else { self.free.saturating_add(1) };
        if !is_measured {
            return Ok(());
        }
        self.peak_force = events.iter().fold(self.peak_force.max(force), |peak, of| peak.max(of.force.abs()));
        self.impulse += impulse;
        self.impacts += u64::from(is_impact);
        let closing = events.iter().filter(|event| event.closes).map(|event| event.velocity.abs());
        self.impact_velocity = closing.fold(self.impact_velocity, f64::max);
        if is_impact && events.is_empty() {
            let met = self.monitor.impact(scheme)?;
            self.impact_velocity = met.map_or(0.0, |met| met.velocity.abs()).max(self.impact_velocity);
        }
        Ok(())
    }

    /// Returns the measures of the run, at its end.
    pub fn measures(self, scheme: &dyn Scheme, tolerance: f64, lyapunov: Option<f64>) -> Result<Measures> {
        let steps = scheme.step() - self.settle;
        let periods = steps as f64 / self.phases.len() as f64;
        let now = scheme.energies()?;
        let probes: Vec<ProbeMeasures> =
            self.probes.into_iter().map(|sums| sums.measures(steps as f64)).collect();
        let sections: Vec<(&[f64], f64)> =
            probes.iter().map(|of| (of.section.as_slice(), of.max - of.min)).collect();
        Ok(Measures {
            period: repetition(&sections, tolerance),
            lyapunov,
            peak_force: self.peak_force,
            impulse: self.impulse / periods,
            impacts: self.impacts as f64 / periods,
            impact_velocity: self.impact_velocity,
            work: (now.work - self.energies.work) / periods,
            loss: (self.energies.total() - now.total()) / periods,
            probes,
        })
    }
}

impl ProbeSums {
    /// Adds the value of a step, given sine and cosine of the drive's phase.
    fn note(&mut self, value: f64, [sine, cosine]: [f64; 2], ends_period: bool) {
        if ends_period {
            self.section.push(value);
        }
        (self.max, self.min) = (self.max.max(value), self.min.min(value));
        let value = value - self.origin;
        self.sum += value;
        self.squares += value * value;
        self.sine += value * sine;
        self.cosine += value * cosine;
    }

    fn measures(self, count: f64) -> ProbeMeasures {
        let mean = self.sum / count;
        // The sums over whole periods are those of a discrete Fourier transform.
        let [sine, cosine] = [self.sine, self.cosine].map(|sum| 2.0 * sum / count);
        ProbeMeasures {
            section: self.section,
            max: self.max,
            min: self.min,
            rms: (self.squares / count - mean * mean).max(0.0).sqrt(),
            amplitude: sine.hypot(cosine),
            phase: cosine.atan2(sine),
        }
    }
}
