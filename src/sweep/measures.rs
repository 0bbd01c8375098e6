//! Measures of a periodically driven motion, from its steps; `docs/sweeps.md` defines each.

use crate::energy::Energies;
use crate::kernels::Lanes;
use crate::kernels::wide::widest;
use pulp::Arch;
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

/// Sums over the steps at a probe, one per run.
#[derive(Default)]
struct ProbeSums {
    /// Values at the ends of the periods.
    section: Vec<Lanes>,
    max: Lanes,
    min: Lanes,
    /// First value, from which the sums count.
    origin: Lanes,
    sum: Lanes,
    squares: Lanes,
    sine: Lanes,
    cosine: Lanes,
}

/// Contact during a step.
#[derive(Clone, Copy, Default)]
pub(super) struct TotalContact {
    /// Whether the plate touches an obstacle.
    pub touches: bool,
    /// Sum of the magnitudes of all reactions at the end of the step, in N.
    pub force: f64,
    /// Largest force of an event within the step, in N.
    pub peak: f64,
    /// Sum of the magnitudes of all impulses, in N s.
    pub impulse: f64,
}

/// Contacts of a run so far.
#[derive(Clone, Copy, Default)]
struct ContactSums {
    /// Last step with contact.
    touched: Option<u64>,
    peak_force: f64,
    impulse: f64,
    impacts: u64,
    impact_velocity: f64,
}

/// Measures of the steps so far of one run, or of several in lock step.
pub(super) struct PeriodRecorder {
    /// Sine and cosine of the phase of the drive, one pair per step of a period.
    phases: Vec<[f64; 2]>,
    /// Number of steps before the measured ones.
    settle: u64,
    probes: Vec<ProbeSums>,
    contacts: [ContactSums; Lanes::COUNT],
    /// Energies at the beginning of the measured periods.
    energies: [Energies; Lanes::COUNT],
}

impl PeriodRecorder {
    /// Prepares the measures of runs with a number of probes.
    pub fn new(probes: usize, per_period: u64, settle: u64) -> PeriodRecorder {
        let equal = |value: f64| Lanes([value; Lanes::COUNT]);
        let (max, min) = (equal(f64::NEG_INFINITY), equal(f64::INFINITY));
        let sums = || ProbeSums { max, min, ..ProbeSums::default() };
        let phase = |step: u64| (TAU * step as f64 / per_period as f64).sin_cos().into();
        PeriodRecorder {
            phases: (0..per_period).map(phase).collect(),
            settle,
            probes: std::iter::repeat_with(sums).take(probes).collect(),
            contacts: Default::default(),
            energies: Default::default(),
        }
    }

    /// Returns whether a step belongs to the measured periods.
    pub fn measures_step(&self, step: u64) -> bool {
        step > self.settle
    }

    /// Returns whether the measures begin after a step.
    pub fn begins_after(&self, step: u64) -> bool {
        step == self.settle
    }

    /// Takes the energies of a run at the step after which the measures begin.
    pub fn begin(&mut self, run: usize, energies: Energies) {
        self.energies[run] = energies;
    }

    /// Records the values at the probes at the end of a step, which are one number per run. Step 0
    /// is the start.
    pub fn note(&mut self, step: u64, values: &[Lanes]) {
        let PeriodRecorder { phases, settle, probes, .. } = self;
        let probes = probes.iter_mut().zip(values);
        if step == *settle {
            probes.for_each(|(sums, value)| sums.origin = *value);
        } else if step > *settle {
            let place = (step % phases.len() as u64) as usize;
            probes.for_each(|(sums, value)| sums.note(*value, phases[place], place == 0));
        }
    }

    /// Records the contact of a run during a step. Returns whether it is a measured impact.
    pub fn note_contact(&mut self, run: usize, step: u64, contact: TotalContact) -> bool {
        let TotalContact { touches, force, peak, impulse } = contact;
        let sums = &mut self.contacts[run];
        let is_impact = touches && sums.touched.is_none_or(|touched| step - touched > APART);
        if touches {
            sums.touched = Some(step);
        }
        if step <= self.settle {
            return false;
        }
        sums.peak_force = sums.peak_force.max(force).max(peak);
        sums.impulse += impulse;
        sums.impacts += u64::from(is_impact);
        is_impact
    }

    /// Records the speed at which a gap closed in a run, in m/s.
    pub fn note_closing(&mut self, run: usize, speed: f64) {
        let sums = &mut self.contacts[run];
        sums.impact_velocity = speed.max(sums.impact_velocity);
    }

    /// Returns the measures of a run after its last step, with its energies there.
    pub fn measures(
        &self,
        run: usize,
        step: u64,
        now: Energies,
        tolerance: f64,
        lyapunov: Option<f64>,
    ) -> Measures {
        let steps = (step - self.settle) as f64;
        let periods = steps / self.phases.len() as f64;
        let probes: Vec<ProbeMeasures> = self.probes.iter().map(|sums| sums.measures(run, steps)).collect();
        let sections: Vec<(&[f64], f64)> =
            probes.iter().map(|probe| (probe.section.as_slice(), probe.max - probe.min)).collect();
        let ContactSums { peak_force, impulse, impacts, impact_velocity, .. } = self.contacts[run];
        Measures {
            period: repetition(&sections, tolerance),
            lyapunov,
            peak_force,
            impulse: impulse / periods,
            impacts: impacts as f64 / periods,
            impact_velocity,
            work: (now.work - self.energies[run].work) / periods,
            loss: (self.energies[run].total() - now.total()) / periods,
            probes,
        }
    }
}

impl ProbeSums {
    /// Adds the value of a step, given sine and cosine of the drive's phase.
    fn note(&mut self, value: Lanes, [sine, cosine]: [f64; 2], ends_period: bool) {
        if ends_period {
            self.section.push(value);
        }
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                (self.max, self.min) = (self.max.max(value), self.min.min(value));
                let value = value - self.origin;
                self.sum += value;
                self.squares += value * value;
                self.sine += sine * value;
                self.cosine += cosine * value;
            },
        );
    }

    fn measures(&self, run: usize, count: f64) -> ProbeMeasures {
        let mean = self.sum.0[run] / count;
        // The sums over whole periods are those of a discrete Fourier transform.
        let [sine, cosine] = [self.sine, self.cosine].map(|sum| 2.0 * sum.0[run] / count);
        ProbeMeasures {
            section: self.section.iter().map(|values| values.0[run]).collect(),
            max: self.max.0[run],
            min: self.min.0[run],
            rms: (self.squares.0[run] / count - mean * mean).max(0.0).sqrt(),
            amplitude: sine.hypot(cosine),
            phase: cosine.atan2(sine),
        }
    }
}
