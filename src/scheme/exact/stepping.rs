//! Steps of the event-driven scheme, from event to event.

use super::event_detection::EventSearch;
use super::event_resolution;
use super::motion::ModalSolution;
use super::options::ExactOptions;
use super::reduction::ReducedModel;
use super::{Exact, Shape, grow};
use crate::archive::Archive;
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::scheme::{
    Approach, Event, EventStatistics, Scheme, Solution, Statistics, StepBalance, StepRecord,
};
use crate::vi::BoundStatus;
use faer::Mat;

/// Number of grid instants per check of the residual; instants after an event are always checked.
const CHECK_EVERY: u64 = 16;

/// Numbers of events and of grid instants per check of the residual with velocities of modes, whose
/// shape costs as much as many steps. It is also checked after nodes came into reach.
const EVENTS_PER_SHAPE: u64 = 16;
const STEPS_PER_SHAPE: u64 = 256;

impl<E: Engine> Exact<'_, E> {
    /// Adds the impulses of the present motion over a duration (s) from the state on; `step` tells
    /// that the duration is a grid step.
    fn add_impulses(&mut self, seconds: f64, step: bool) {
        let modes = self.motion.modes.clone();
        let touching: Vec<usize> =
            (0..modes.sides.len()).filter(|&i| modes.sides[i] != BoundStatus::Free).collect();
        if touching.is_empty() || seconds == 0.0 {
            return;
        }
        let integral = self.motion.integral(&self.state, seconds, step);
        let (candidates, impulses) = (&self.reduction.candidates, &mut self.record.impulses);
        touching.iter().for_each(|&i| impulses[candidates[i]] += seconds * modes.offset[i]);
        for (k, integral) in integral.into_iter().enumerate() {
            let column = modes.rows.col_as_slice(k);
            touching.iter().for_each(|&i| impulses[candidates[i]] += integral * column[i]);
        }
        if let Some(coupling) = &modes.coupling {
            for (k, moved) in self.motion.increments(&self.state, seconds).into_iter().enumerate() {
                let column = coupling.rows.col_as_slice(k);
                touching.iter().for_each(|&i| impulses[candidates[i]] += moved * column[i]);
            }
        }
    }

    /// Switches the active set at an event of the present motion, `seconds` after its start.
    fn resolve_event(&mut self, seconds: f64, candidate: usize) -> Result<()> {
        self.move_to(seconds);
        let before = self.motion.modes.clone();
        let mut undecided = self.search.at_limit(&self.motion, &self.watched);
        if undecided.iter().all(|(i, _)| *i != candidate) {
            let middle = 0.5 * (before.limits[candidate][0] + before.limits[candidate][1]);
            let side = match before.sides[candidate] {
                BoundStatus::Free if self.watched[(candidate, 0)] > middle => BoundStatus::Upper,
                BoundStatus::Free => BoundStatus::Lower,
                side => side,
            };
            undecided.push((candidate, side));
        }
        let state = before.place(&self.state);
        let reduction = &self.reduction;
        let sides = event_resolution::next_sides(
            reduction,
            &before.sides,
            &undecided,
            &state,
            &self.reactions(),
            self.options.roundings,
        );
        let arriving = self.watched.clone();
        let force = self.record.reaction.iter().sum();
        let time = self.motion.start + seconds;
        self.begin_motion(time, &state, &sides)?;
        for (i, (&was, &is)) in before.sides.iter().zip(&sides).enumerate() {
            if was == is {
                continue;
            }
            let closes = is != BoundStatus::Free;
            let velocity = if closes { arriving[(i, 1)] } else { self.watched[(i, 1)] };
            let bound = self.reduction.candidates[i];
            self.events.push(Event { time, bound, closes, velocity, force });
            self.statistics.events += 1;
            if closes {
                self.touches[bound] = Approach { time, deflection: self.record.admissible[bound], velocity };
            }
        }
        let near = self.check_reach(0.0);
        self.admit(0.0, near)
    }

    /// Returns numbers that change when the residual of velocities of modes is due.
    fn shapes_due(&self) -> [u64; 3] {
        let candidates = self.reduction.candidates.len() as u64;
        [self.record.step / STEPS_PER_SHAPE, self.statistics.events / EVENTS_PER_SHAPE, candidates]
    }

    /// Saves or restores the candidates. They are added again in the same order, so that the
    /// matrices are the same to the last bit.
    fn archive_reach(&mut self, archive: &mut Archive) -> Result<()> {
        let Some(reach) = &mut self.reach else { return Ok(()) };
        let grown = reach.grown.clone();
        reach.archive(archive)?;
        if archive.saves() {
            return Ok(());
        }
        let bounds = self.system.bounds.len();
        let fits =
            reach.grown.starts_with(&grown) && reach.grown.iter().flatten().all(|&bound| bound < bounds);
        if !fits {
            return Err(Error::Checkpoint("the checkpoint has other nodes in reach than its scene".into()));
        }
        for near in reach.grown.iter().skip(grown.len()) {
            self.reduction.extend(self.system, &*self.saddle, near)?;
        }
        self.watched = Mat::zeros(self.reduction.candidates.len(), 2);
        Ok(())
    }

    /// Begins a motion at a time (s) from position and velocity z, z' (columns), with the sides of
    /// the candidates.
    fn begin_motion(&mut self, time: f64, state: &Mat<f64>, sides: &[BoundStatus]) -> Result<()> {
        let before = self.motion.modes.clone();
        let modes = self.cache.get(self.system, &self.reduction, sides, Some(&before))?;
        let modal = modes.state(state);
        self.statistics.evaluations += self.search.evaluations;
        let ExactOptions { stride, roundings, .. } = self.options;
        self.motion = ModalSolution::new(modes, time, &modal);
        self.search = EventSearch::new(&self.motion, stride, roundings, self.search.level);
        self.move_to(0.0);
        Ok(())
    }

    /// Returns the nodes out of reach that come into reach soon after an instant of the present
    /// motion, and determines the time of the next check.
    fn check_reach(&mut self, time: f64) -> Vec<usize> {
        let Some(reach) = &mut self.reach else { return Vec::new() };
        let near = reach.check(&self.reduction, &self.system.bounds, &self.motion, time);
        self.record_far();
        near
    }

    /// Adds nodes to the candidates at the present state, `seconds` after the start of the
    /// motion, which continues unchanged.
    fn admit(&mut self, seconds: f64, near: Vec<usize>) -> Result<()> {
        if near.is_empty() {
            return Ok(());
        }
        let before = self.motion.modes.clone();
        let old = self.reduction.candidates.clone();
        let Exact { system, saddle, reduction, reach, .. } = self;
        grow(system, &**saddle, reduction, reach, near)?;
        let mut sides = vec![BoundStatus::Free; self.reduction.candidates.len()];
        for (side, &bound) in before.sides.iter().zip(&old) {
            let place = self.reduction.candidates.partition_point(|&candidate| candidate < bound);
            sides[place] = *side;
        }
        self.watched = Mat::zeros(sides.len(), 2);
        let state = before.place(&self.state);
        self.begin_motion(self.motion.start + seconds, &state, &sides)
    }
}

impl<E: Engine> Solution for Exact<'_, E> {
    /// Returns the record of the last step. Its reactions are those of the present instant, and its
    /// impulses the integrals of the reactions, in closed form from event to event.
    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        &self.shape().displacement
    }

    fn velocity(&mut self) -> Result<Vec<f64>> {
        let ReducedModel { lift, flexibility, .. } = &self.reduction;
        let modes = &self.motion.modes;
        let touching = |i: usize| modes.sides[i] != BoundStatus::Free;
        let forces =
            Mat::from_fn(modes.sides.len(), 1, |i, _| if touching(i) { self.watched[(i, 1)] } else { 0.0 });
        let rates = lift * (&modes.spectrum.vectors * modes.coordinates(&self.state).get(.., 1..))
            + flexibility * forces;
        Ok(rates.col_as_slice(0).to_vec())
    }

    fn limits(&self) -> &Bounds {
        &self.system.bounds
    }

    fn energies(&self) -> Result<Energies> {
        if self.reach.is_some() {
            return self.modal_energies();
        }
        let Shape { displacement, velocity, .. } = self.shape();
        let elastic = self.system.force(displacement, &mut vec![0.0; displacement.len()])?;
        let kinetic = 0.5 * self.system.engine.mass_norm_squared(&self.system.mass, velocity)?;
        Ok(Energies { kinetic, elastic, work: self.system.work(displacement)? })
    }

    fn approach(&self, bound: usize) -> Approach {
        self.touches[bound]
    }
}

impl<E: Engine> Scheme for Exact<'_, E> {
    fn advance(&mut self) -> Result<()> {
        let before = self.shapes_due();
        self.record.begin_step();
        let time = self.time();
        let mut events = 0;
        let mut is_same_motion = true;
        // Time of the state, counted from the start of the motion.
        let mut from = (self.record.step - 1) as f64 * self.record.dt - self.motion.start;
        loop {
            let check = self.reach.as_ref().map_or(f64::INFINITY, |reach| reach.next);
            let until = time.min(check) - self.motion.start;
            self.search.extend(&self.motion, until);
            let Some((seconds, candidate)) = self.search.next.filter(|(seconds, _)| *seconds <= until) else {
                if time <= check {
                    break;
                }
                let near = self.check_reach(until);
                if !near.is_empty() {
                    self.add_impulses(until - from, false);
                    self.move_to(until);
                    self.admit(until, near)?;
                    (from, is_same_motion) = (0.0, false);
                }
                continue;
            };
            let bound = self.reduction.candidates[candidate];
            if events == self.options.events_per_step {
                let place = format!("bound {bound}");
                return Err(Error::Events {
                    step: self.record.step,
                    time: self.motion.start + seconds,
                    count: events,
                    bound,
                    place,
                });
            }
            events += 1;
            self.add_impulses(seconds - from, false);
            self.resolve_event(seconds, candidate)?;
            (from, is_same_motion) = (0.0, false);
        }
        match is_same_motion {
            true => self.add_impulses(self.record.dt, true),
            false => self.add_impulses(time - self.motion.start, false),
        }
        self.motion.walk(time - self.motion.start, self.record.dt, &mut self.state);
        self.watch();
        let is_due = match &self.reach {
            Some(_) => self.shapes_due() != before,
            None => events > 0 || self.record.step.is_multiple_of(CHECK_EVERY),
        };
        if is_due {
            self.check_shape()?;
        }
        self.record.report.iterations = u32::try_from(events).unwrap_or(u32::MAX);
        Ok(())
    }

    /// Returns the balance at the instant.
    fn balance(&mut self) -> Result<StepBalance> {
        let Shape { displacement, acceleration, .. } = self.shape();
        Ok(StepBalance {
            displacement: displacement.clone(),
            acceleration: acceleration.clone(),
            ..StepBalance::zero(self.system)
        })
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.record.archive(archive)?;
        archive.value(&mut self.statistics)?;
        archive.value(&mut self.events)?;
        Approach::archive(&mut self.touches, archive)?;
        self.archive_reach(archive)?;
        let mut state = [0, 1].map(|j| self.state.col_as_slice(j).to_vec());
        archive.value(&mut state)?;
        let mut sides = self.motion.modes.sides.clone();
        archive.value(&mut sides)?;
        let mut lineage = self.motion.modes.spectrum.lineage.clone();
        archive.value(&mut lineage)?;
        if !archive.saves() {
            self.state = Mat::from_fn(self.state.nrows(), 2, |k, j| state[j][k]);
            let modes = self.cache.restore(self.system, &self.reduction, &sides, lineage)?;
            self.motion = ModalSolution::new(modes, 0.0, &self.state);
        }
        self.cache.archive(archive)?;
        self.motion.archive(archive)?;
        if !archive.saves() {
            let ExactOptions { stride, roundings, .. } = self.options;
            self.search = EventSearch::new(&self.motion, stride, roundings, 0);
            self.watch();
        }
        self.search.archive(&self.motion, archive)
    }

    fn take_events(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events)
    }

    fn statistics(&self) -> Statistics {
        let factorisations = self.cache.computed;
        let events = EventStatistics {
            active_sets: factorisations,
            cached_bytes: self.cache.peak,
            evaluations: self.statistics.evaluations + self.search.evaluations,
            ..self.statistics
        };
        Statistics { factorisations, events: Some(events), ..Statistics::default() }
    }
}
