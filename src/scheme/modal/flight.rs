//! Free flight of the candidates: the time before which none of them can touch.
//!
//! The certificate is that of a tier in [`super::reach`], without tests between checks: it holds as
//! long as the modes move freely under constant data. Until its end the steps need no deflections
//! of candidates and no contact problem.

use super::forecast::{Forecast, distance};
use super::reach::{ROUNDING, Reach};
use super::state::State;
use crate::archive::Archive;
use crate::error::Result;
use crate::kernels::lanes::{dots, norm};
use crate::kernels::wide::widest;
use pulp::Arch;

/// Time after which a certificate is tried again, in steps.
const AGAIN: f64 = 8.0;

/// Certificate of free flight; see the [module page](self).
#[derive(Debug, Default)]
pub(super) struct Flight {
    /// Index of the last horizon, and time of the last check, in s.
    level: usize,
    since: f64,
    /// End of the flight, in s.
    end: f64,
    /// Time of the next check after one without success, in s.
    next: f64,
    /// Index of the candidate with the least slack in the last check, which is the first of the
    /// next one.
    nearest: usize,
}

impl Flight {
    /// Returns whether no candidate can touch within `seconds`, from a state without contact under
    /// the pull h - w^2 q on the modes.
    pub fn lasts(
        &mut self,
        seconds: f64,
        reach: &Reach,
        candidates: &[usize],
        state: &State,
        pull: impl Fn() -> Vec<f64>,
    ) -> bool {
        let end = reach.elapsed + seconds;
        if end > self.end && reach.elapsed >= self.next {
            self.check(reach, candidates, state, &pull());
        }
        end <= self.end
    }

    /// Looks for the longest horizon before which no candidate touches.
    fn check(&mut self, reach: &Reach, candidates: &[usize], state: &State, pull: &[f64]) {
        let rounding = ROUNDING * norm(&state.q);
        let error = |forecast: &Forecast| forecast.error(&state.v, pull) + rounding;
        let mut level = reach.next_level(self.level, self.since);
        let least = error(&reach.forecasts[0]);
        let mut motion = Default::default();
        self.since = reach.elapsed;
        loop {
            let forecast = &reach.forecasts[level];
            forecast.motion(&state.q, &state.v, pull, &mut motion);
            let motion = motion.each_ref().map(|coefficients: &Vec<f64>| &**coefficients);
            let slack = |k: usize| {
                let i = candidates[k];
                let mut y = dots(reach.shapes.col_as_slice(i), motion);
                y[0] += state.data.near.shift[k];
                distance(y, &state.data.near, k, forecast.seconds) / reach.sizes[i]
            };
            // The candidate that has prevented the last flight is likely to prevent this one too.
            let (mut nearest, mut radius) = (self.nearest, f64::INFINITY);
            widest(
                Arch::new(),
                #[inline(always)]
                || {
                    for k in std::iter::once(nearest).chain(0..candidates.len()) {
                        let slack = if k < candidates.len() { slack(k) } else { f64::INFINITY };
                        if slack < radius {
                            (nearest, radius) = (k, slack);
                        }
                        if radius < least {
                            break;
                        }
                    }
                },
            );
            self.nearest = nearest;
            if radius >= error(forecast) {
                (self.level, self.end) = (level, reach.elapsed + forecast.seconds);
                return;
            }
            let Some(less) = (0..level).rev().find(|&less| error(&reach.forecasts[less]) <= radius) else {
                (self.level, self.next) = (0, reach.elapsed + AGAIN * reach.step);
                return;
            };
            level = less;
        }
    }

    /// Ends the flight: a reaction acts, or there are more candidates.
    pub fn end(&mut self) {
        self.end = 0.0;
    }

    /// Saves or restores the certificate.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.level)?;
        archive.value(&mut self.since)?;
        archive.value(&mut self.end)?;
        archive.value(&mut self.next)
    }
}
