//! Path along a branch of periodic motions by steps in its arc length (H. B. Keller, in:
//! Applications of Bifurcation Theory, Academic Press 1977, 359-384).

use super::family::{Family, ShootingEquations};
use super::orbit::Orbit;
use super::points::{PointKind, Test, between};
use crate::error::{Error, Result};
use crate::linalg::vectors::dot;

/// Relative residual at which a motion counts as periodic, and the one that is accepted where
/// rounding keeps it larger.
const PERIODIC: f64 = 1e-11;
const ROUNDING: f64 = 1e-8;

/// Largest number of Newton iterations for a step, and for the first motion.
const ITERATIONS: usize = 12;
const FIRST_ITERATIONS: usize = 60;

/// Largest change of the unknowns by one iteration, in their magnitudes.
const LARGEST: f64 = 0.3;

/// Number of iterations up to which the next step is longer, and how much.
const EASY: usize = 8;
const LONGER: f64 = 1.5;

/// Smallest step, in the largest one.
const SHORTEST: f64 = 1e-8;

/// Smallest cosine of the angle between two steps.
const STRAIGHT: f64 = 0.9;

/// Relative accuracy of special motions, in the step that leads past them.
const LOCATED: f64 = 1e-7;
const TRIALS: usize = 60;

/// How far a branch is followed.
#[derive(Debug, Clone, Copy)]
pub struct BranchLimits {
    /// Values of the parameter between which the branch is followed, from the first to the second.
    pub range: [f64; 2],
    /// Largest step, in magnitudes of the state.
    pub step: f64,
    /// Largest number of motions.
    pub most: usize,
}

/// Motion of a branch.
pub struct PeriodicMotion {
    /// Measures of a period.
    pub orbit: Orbit,
    /// Value of the parameter.
    pub parameter: f64,
    /// Kind of a special motion; `None` for others.
    pub point: Option<PointKind>,
    unknowns: Vec<f64>,
    magnitudes: Vec<f64>,
    /// Direction of the branch in magnitudes of the unknowns, a unit vector.
    tangent: Vec<f64>,
}

/// Path along the branch of a family.
pub struct Follower<'f> {
    family: &'f mut dyn Family,
    limits: BranchLimits,
    /// Why the last step failed.
    failure: Option<Error>,
}

impl<'f> Follower<'f> {
    /// Creates the path of a family.
    pub fn new(family: &'f mut dyn Family, limits: BranchLimits) -> Follower<'f> {
        Follower { family, limits, failure: None }
    }

    /// Follows the branch and passes its motions on in order. Returns why it ends.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] where no first motion is found, the errors of the receiver and
    /// [`Error::Stopped`] once `interrupts` says so.
    pub fn follow(
        mut self,
        told: &mut dyn FnMut(&PeriodicMotion) -> Result<()>,
        interrupts: &dyn Fn() -> bool,
    ) -> Result<String> {
        let BranchLimits { range: [from, to], step: longest, most } = self.limits;
        let mut last = self.first()?;
        let first = (last.unknowns.clone(), last.magnitudes.clone());
        told(&last)?;
        let (mut step, mut made) = (0.2 * longest, 1);
        while made < most {
            if interrupts() {
                return Err(Error::Stopped(format!("interrupted: {made} motions are written")));
            }
            let Some((next, iterations)) = self.next(&last, &mut step, longest)? else {
                let why = self.failure.as_ref().map_or(String::new(), |why| format!(": {why}"));
                return Ok(format!("no further motion was found{why}"));
            };
            let mut passed = self.special(&last, &next, step)?;
            let onwards = (next.parameter - last.parameter) * (to - from) > 0.0;
            let beyond = Some(if onwards { to } else { from });
            let beyond = beyond.filter(|end| (last.parameter - end) * (next.parameter - end) < 0.0);
            let end = beyond.map_or(Ok(None), |end| {
                self.locate(&last, step, [last.parameter - end, next.parameter - end], true, &|motion| {
                    motion.parameter - end
                })
            })?;
            if let Some((place, end)) = end {
                passed.retain(|(special, _)| *special < place);
                passed.into_iter().try_for_each(|(_, motion)| told(&motion))?;
                told(&end)?;
                return Ok("the range is covered".into());
            }
            made += 1 + passed.len();
            passed.into_iter().try_for_each(|(_, motion)| told(&motion))?;
            told(&next)?;
            self.family.accept(&next.unknowns)?;
            let apart = next.unknowns.iter().zip(&first.0).zip(&first.1);
            let apart = apart.map(|((a, b), magnitude)| ((a - b) / magnitude).powi(2)).sum::<f64>().sqrt();
            if made > 20 && apart < step {
                return Ok("the branch closes".into());
            }
            last = next;
            if iterations <= EASY {
                step = (LONGER * step).min(longest);
            }
        }
        Ok(format!("it has {most} motions; --most allows more"))
    }

    /// Finds the first motion.
    fn first(&mut self) -> Result<PeriodicMotion> {
        let guess = self.family.begin()?;
        let held = self.family.held();
        let mut row = vec![0.0; guess.len()];
        row[held] = 1.0;
        let missing = || Error::Usage("no periodic motion was found at the start of the range".into());
        let Some((mut first, _)) = self.correct(guess, &row, FIRST_ITERATIONS)? else {
            return Err(self.failure.take().unwrap_or_else(missing));
        };
        let [from, to] = self.limits.range;
        let forwards = if self.family.folds() { (to - from).signum() } else { 1.0 };
        if first.tangent[held] * forwards < 0.0 {
            first.tangent.iter_mut().for_each(|value| *value = -*value);
        }
        self.family.accept(&first.unknowns)?;
        Ok(first)
    }

    /// Finds the next motion, with half the step as often as Newton's method fails; `None` where
    /// the step becomes too short.
    fn next(
        &mut self,
        last: &PeriodicMotion,
        step: &mut f64,
        longest: f64,
    ) -> Result<Option<(PeriodicMotion, usize)>> {
        while *step > SHORTEST * longest {
            let moved = self.move_by(last, *step)?;
            if let Some(next) = moved.filter(|(next, _)| dot(&next.tangent, &last.tangent) > STRAIGHT) {
                return Ok(Some(next));
            }
            *step *= 0.5;
        }
        Ok(None)
    }

    /// Returns the motion at a distance along the branch, with the number of iterations.
    fn move_by(&mut self, last: &PeriodicMotion, step: f64) -> Result<Option<(PeriodicMotion, usize)>> {
        let moved = last.unknowns.iter().zip(last.magnitudes.iter().zip(&last.tangent));
        let guess: Vec<f64> = moved.map(|(x, (magnitude, along))| x + step * magnitude * along).collect();
        self.correct(guess, &last.tangent, ITERATIONS)
    }

    /// Corrects unknowns by Newton's method across a direction; `None` where that fails.
    fn correct(
        &mut self,
        mut x: Vec<f64>,
        row: &[f64],
        most: usize,
    ) -> Result<Option<(PeriodicMotion, usize)>> {
        let mut last = f64::INFINITY;
        let magnitudes = self.family.magnitudes(&x);
        for iteration in 0..most {
            let solved = self.family.equations(&x).and_then(|equations| {
                let solution = equations.solve(&magnitudes, row)?;
                Ok((equations, solution))
            });
            let (equations, [change, along]) = match solved {
                Ok(solved) => solved,
                Err(why) => {
                    self.failure = Some(why);
                    return Ok(None);
                }
            };
            let error = equations.error();
            if error <= PERIODIC || error <= ROUNDING && error > 0.5 * last {
                return Ok(Some((self.motion(x, equations, &along, row), iteration)));
            }
            last = error;
            let size = dot(&change, &change).sqrt();
            if most == ITERATIONS && size > LARGEST {
                return Ok(None);
            }
            let share = (LARGEST / size).min(1.0);
            for ((x, change), magnitude) in x.iter_mut().zip(&change).zip(&magnitudes) {
                *x += share * magnitude * change;
            }
        }
        Ok(None)
    }

    /// Returns the motion of some unknowns, whose direction follows the one before.
    fn motion(
        &self,
        unknowns: Vec<f64>,
        equations: ShootingEquations,
        along: &[f64],
        before: &[f64],
    ) -> PeriodicMotion {
        let size = dot(along, along).sqrt().copysign(dot(along, before));
        let magnitudes = self.family.magnitudes(&unknowns);
        let tangent = along.iter().map(|value| value / size).collect();
        let ShootingEquations { orbit, .. } = equations;
        let parameter = self.family.parameter(&unknowns, &orbit);
        PeriodicMotion { orbit, parameter, point: None, unknowns, magnitudes, tangent }
    }

    /// Returns the special motions between two, with their distances from the first, in order.
    fn special(
        &mut self,
        last: &PeriodicMotion,
        next: &PeriodicMotion,
        step: f64,
    ) -> Result<Vec<(f64, PeriodicMotion)>> {
        let held = self.family.held();
        let ends = [last, next].map(|motion| (&motion.orbit, motion.tangent[held]));
        let mut passed = Vec::new();
        for (kind, test) in between(ends[0], ends[1], self.family.folds()) {
            let located = match test {
                Test::Crossing(value) => {
                    let values = ends.map(|(orbit, direction)| value(orbit, direction));
                    let value = |motion: &PeriodicMotion| value(&motion.orbit, motion.tangent[held]);
                    self.locate(last, step, values, true, &value)?
                }
                Test::Count(count) => {
                    let before = count(&last.orbit);
                    let value =
                        |motion: &PeriodicMotion| if count(&motion.orbit) == before { -1.0 } else { 1.0 };
                    self.locate(last, step, [-1.0, 1.0], false, &value)?
                }
            };
            if let Some((place, motion)) = located {
                passed.push((place, PeriodicMotion { point: Some(kind), ..motion }));
            }
        }
        passed.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(passed)
    }

    /// Returns the motion at which a function is zero, and its distance from the last one, given
    /// the values of the function at both ends of a step: by false position, in the manner of
    /// Illinois, or by bisection for a function with jumps.
    fn locate(
        &mut self,
        last: &PeriodicMotion,
        step: f64,
        values: [f64; 2],
        is_smooth: bool,
        value: &dyn Fn(&PeriodicMotion) -> f64,
    ) -> Result<Option<(f64, PeriodicMotion)>> {
        let ([mut low, mut high], mut ends) = ([0.0, step], values);
        let (mut best, mut moved): (Option<(f64, PeriodicMotion)>, _) = (None, None);
        for _ in 0..TRIALS {
            if high - low <= LOCATED * step {
                break;
            }
            let place = match is_smooth {
                true => low + (high - low) * (ends[0] / (ends[0] - ends[1])).clamp(0.01, 0.99),
                false => 0.5 * (low + high),
            };
            let Some((motion, _)) = self.move_by(last, place)? else {
                high = place;
                continue;
            };
            let here = value(&motion);
            let is_near = best.as_ref().is_some_and(|(before, _)| (place - before).abs() <= LOCATED * step);
            best = Some((place, motion));
            if here == 0.0 || is_near && is_smooth {
                break;
            }
            let side = usize::from(here * ends[1] > 0.0);
            if side == 0 {
                low = place;
            } else {
                high = place;
            }
            ends[side] = here;
            if moved.replace(side) == Some(side) {
                ends[1 - side] *= 0.5;
            }
        }
        Ok(best)
    }
}
