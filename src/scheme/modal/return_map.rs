//! Return map of a driven plate: the state of the modes after a period, and its derivative.
//!
//! A step is the one of the conserving scheme without relaxation: half a kick by the reactions and
//! by stretching, the exact motion under the mean load, and the other half of the kick. A step in
//! which a contact begins or ends is divided there, so that the map is smooth, with a root where
//! the plate grazes. The derivative M is the product of the derivatives of the parts: of the
//! rotation, and of a kick
//!
//! ```math
//! \dot q \leftarrow \dot q + \tau\, (A^T r(q) - \nabla V(q)), \qquad
//! \frac{\partial}{\partial q} A^T r = -A_c^T R_{cc}^{-1} A_c
//! ```
//!
//! with the compliance R and the rows A of the nodes c in contact. No velocity jumps where contact
//! begins or ends, so that no other term appears there. All steps of a period are short enough for
//! the fastest motion in contact.

mod steps;
mod variation;

use super::Start;
use super::all_bounds::AllBounds;
use super::contact_model::{BoundRows, ContactModel, extended};
use super::data::{ModalData, ModalLoads};
use super::rotation::Rotation;
use super::state::State;
use crate::assembly::Probe;
use crate::error::{Error, Result};
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Engine, Form, MassModes, Native};
use crate::membrane::{QuarticForm, Stretch};
use crate::scheme::System;
use crate::scheme::massless::contact_compliance::ContactCompliance;
use crate::scheme::massless::modal_saddle_point::ModalSaddlePoint;
use crate::vi::ComplianceSolver;
use faer::Mat;
use std::rc::Rc;
use variation::Variation;

/// Largest difference of loads and obstacles one period apart, relative to their range, and number
/// of instants at which they are compared.
const REPEATS: f64 = 1e-6;
const COMPARED: usize = 8;

/// Longest step, in periods of the fastest motion in contact, and the largest number of steps.
const PART: f64 = 0.05;
const MOST_STEPS: usize = 1_000_000;

/// Return map; see the [module page](self).
pub struct ReturnMap<'s> {
    system: &'s System<Native>,
    /// Modes of the plate.
    pub(crate) modes: Rc<MassModes>,
    saddle: ModalSaddlePoint<'s, Native>,
    global: Rc<AllBounds>,
    /// Mode shapes at all bounds and at the candidates, one column each.
    shapes: Mat<f64>,
    rows: Mat<f64>,
    loads: ModalLoads,
    model: ContactModel,
    contact: ComplianceSolver,
    decays: Vec<f64>,
    form: Option<Rc<QuarticForm>>,
    /// Period, in s, the least number of steps in it, and their number.
    period: f64,
    least_steps: usize,
    steps: usize,
    rotation: Rotation,
    /// Motion over a part of a step.
    part: Rotation,
    /// Loads and obstacles at the instants of a period; a single entry where they are constant.
    data: Vec<ModalData>,
}

/// State at an instant of a period.
pub struct Passing<'p> {
    map: &'p ReturnMap<'p>,
    state: &'p State,
    /// Step of the period.
    pub step: usize,
    /// Smallest distance from an obstacle that nodes would have without reactions, in m.
    pub gap: f64,
    /// Largest sum of the magnitudes of all reactions since the last instant, in N.
    pub force: f64,
}

/// State after a period, and its derivative by the state before, modal coordinates first.
pub struct Passage {
    /// Modal coordinates and their rates, in m and m/s times the root of kg.
    pub end: Vec<f64>,
    /// Derivative M, if it was asked for.
    pub derivative: Option<Mat<f64>>,
}

/// State within a period with its stretching.
#[derive(Clone)]
struct Phase {
    state: State,
    stretch: Stretch,
}

/// Nodes that touch without being candidates.
struct Late(Vec<usize>);

impl<'s> ReturnMap<'s> {
    /// Prepares the map over a period (s) in a number of steps or more, with some candidates for
    /// contact.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for a mass that is not modal, and for what has memory of its own or
    /// does not repeat after the period, and the errors of the engine.
    pub fn new(
        system: &'s System<Native>,
        period: f64,
        steps: usize,
        candidates: &[usize],
    ) -> Result<ReturnMap<'s>> {
        let Form::Modal { consistent, modes } = &system.mass else {
            return Err(Error::Usage(
                "time.mass: periodic motions are those of modes; expected \"modal\"".into(),
            ));
        };
        if system.drive.viscous_tips.is_some() {
            return Err(Error::Usage(
                "obstacle.damping: periodic motions have no damped stops; expected 0".into(),
            ));
        }
        let modes = modes.clone();
        let saddle = ModalSaddlePoint::new(system, &Form::Cells(consistent.clone()), &modes)?;
        let global = Rc::new(AllBounds::new(system));
        let comm = system.engine.comm();
        let loads = ModalLoads::new(system, &modes, &saddle, &global)?;
        let decays = system.decay_rates(&modes);
        let mut map = ReturnMap {
            shapes: global.shapes(comm, &modes)?,
            rows: Mat::zeros(modes.count(), 0),
            model: ContactModel::new(system.bounds.size),
            contact: ComplianceSolver::new(0),
            form: system.drive.stretching.clone(),
            rotation: Rotation::new(&modes.squares, &decays, period / steps as f64),
            part: Rotation::new(&modes.squares, &decays, period / steps as f64),
            data: Vec::new(),
            system,
            modes,
            saddle,
            global,
            loads,
            decays,
            period,
            least_steps: steps,
            steps,
        };
        match candidates.is_empty() {
            true => map.set_period(period, steps)?,
            false => map.admit(candidates)?,
        }
        Ok(map)
    }

    /// Changes the period (s) and the least number of steps.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] where loads or obstacles do not repeat after the period.
    pub fn set_period(&mut self, period: f64, steps: usize) -> Result<()> {
        (self.period, self.least_steps) = (period, steps);
        self.steps = self.enough_steps()?;
        let seconds = period / self.steps as f64;
        self.rotation.set(&self.modes.squares, &self.decays, seconds);
        let varies = self.system.drive.varies();
        let instants = if varies { self.steps + 1 } else { 1 };
        self.data = (0..instants).map(|step| self.data_at(step as f64 * seconds)).collect::<Result<_>>()?;
        if varies { self.check_repetition(period) } else { Ok(()) }
    }

    /// Returns the number of steps, a multiple of the least one, that the fastest motion in contact
    /// needs.
    fn enough_steps(&self) -> Result<usize> {
        let squares = self.modes.squares.clone();
        let shapes = self.rows.transpose().to_owned();
        let contact = ContactCompliance { compliance: self.model.compliance.clone(), shapes, squares };
        // A compliance of zero has laws of its own, whose stiffness depends on the depth.
        let fastest = if self.model.candidates.is_empty() { 0.0 } else { contact.fastest().unwrap_or(0.0) };
        let parts = (self.period * fastest / (PART * self.least_steps as f64)).ceil().max(1.0);
        let steps = parts * self.least_steps as f64;
        if steps > MOST_STEPS as f64 {
            let wrong = format!("a period takes {steps:.0e} steps, with {fastest:.1e} Hz in contact");
            let expected = "a longer step, fewer modes, or stops that yield";
            return Err(Error::Usage(format!("time.step: {wrong}; expected {expected}")));
        }
        Ok(steps as usize)
    }

    /// Returns the candidates for contact, ascending numbers of bounds.
    pub fn candidates(&self) -> &[usize] {
        &self.model.candidates
    }

    /// Returns loads, obstacles and supports at an instant, in s.
    fn data_at(&self, time: f64) -> Result<ModalData> {
        self.loads.at(self.system, &self.modes, &self.saddle, &self.model.candidates, time)
    }

    /// Refuses loads, obstacles and supports that differ after a period, in s.
    fn check_repetition(&self, period: f64) -> Result<()> {
        let values = |data: &ModalData| -> Vec<f64> {
            let limits = [&data.all.lower, &data.all.upper, &data.all.shift].into_iter().flatten();
            data.force.iter().chain(limits).copied().filter(|value| value.is_finite()).collect()
        };
        let first: Vec<Vec<f64>> = self.data.iter().map(values).collect();
        let size = |k: usize| first.iter().map(|values| values[k].abs()).fold(0.0, f64::max);
        for part in 0..COMPARED {
            let step = part * self.steps / COMPARED;
            let time = step as f64 * self.rotation.seconds + period;
            for (k, after) in values(&self.data_at(time)?).into_iter().enumerate() {
                if (after - first[step][k]).abs() > REPEATS * size(k) {
                    let wrong = "loads or obstacles do not repeat after the period";
                    return Err(Error::Usage(format!(
                        "{wrong} of {period} s; expected --period of the drive"
                    )));
                }
            }
        }
        Ok(())
    }

    /// Returns whether the motion loses energy.
    pub fn is_damped(&self) -> bool {
        self.decays.iter().any(|decay| *decay > 0.0)
    }

    /// Returns the modal coordinates of initial conditions, and their rates.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn project(&self, start: &Start) -> Result<Vec<f64>> {
        let State { q, v, .. } = State::at_start(self.system, start)?;
        Ok([q, v].concat())
    }

    /// Returns the positions of the modes in equilibrium with the constant loads, and no rates.
    pub fn rest(&self) -> Vec<f64> {
        let squares = &self.modes.squares;
        let pairs = self.data[0].force.iter().zip(squares);
        let mut rest: Vec<f64> =
            pairs.map(|(force, square)| if *square > 0.0 { force / square } else { 0.0 }).collect();
        rest.resize(2 * squares.len(), 0.0);
        rest
    }

    /// Returns the rates of the modal coordinates and of their rates at the start of a period.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn rate(&mut self, start: &[f64]) -> Result<Vec<f64>> {
        let mut moment = self.moment(start);
        self.settle(&mut moment, 0, 0.0);
        while let Err(Late(more)) = self.require_candidates(&moment.state, 0) {
            self.admit(&more)?;
            moment = self.moment(start);
            self.settle(&mut moment, 0, 0.0);
        }
        let rates = moment.state.v.clone();
        moment.state.data = Rc::new(self.data[0].clone());
        moment.state.v = moment.state.pull(&self.modes.squares);
        self.kick(&mut moment, 1.0);
        Ok([rates, moment.state.v].concat())
    }

    /// Returns the state at the start of a period, without reactions so far.
    fn moment(&self, start: &[f64]) -> Phase {
        let (q, v) = start.split_at(self.modes.count());
        let none = vec![0.0; self.model.candidates.len()];
        let state =
            State { q: q.to_vec(), v: v.to_vec(), x: none.clone(), reaction: none, ..State::default() };
        Phase { state, stretch: Stretch::default() }
    }

    /// Returns the state after a period and, if asked for, its derivative. The start and the end of
    /// every step are shown to `note`, which begins anew at each step 0.
    ///
    /// # Errors
    /// Returns the errors of the engine, and [`Error::Usage`] where the motion grows without limit.
    pub fn pass(
        &mut self,
        start: &[f64],
        wants_derivative: bool,
        note: &mut dyn FnMut(&Passing),
    ) -> Result<Passage> {
        loop {
            match self.try_pass(start, wants_derivative, note) {
                Ok(passage) if passage.end.iter().all(|value| value.is_finite()) => return Ok(passage),
                Ok(_) => return Err(Error::Usage("the motion grows without limit".into())),
                Err(Late(more)) => self.admit(&more)?,
            }
        }
    }

    /// Adds candidates for contact, ascending numbers of bounds.
    fn admit(&mut self, more: &[usize]) -> Result<()> {
        let places: Vec<usize> = (0..self.shapes.ncols()).collect();
        let rows = BoundRows { shapes: &self.shapes, places: &places, lanes: places.len() };
        let old = self.model.candidates.clone();
        self.model.extend(&self.saddle, &self.global, &self.loads.limits, rows, more)?;
        let candidates = &self.model.candidates;
        self.rows =
            Mat::from_fn(self.shapes.nrows(), candidates.len(), |k, i| self.shapes[(k, candidates[i])]);
        self.contact = extended(&self.contact, &self.model, &old);
        self.set_period(self.period, self.least_steps)
    }

    /// Makes the steps of a period, up to the first node that touches without being a candidate.
    fn try_pass(
        &mut self,
        start: &[f64],
        wants_derivative: bool,
        note: &mut dyn FnMut(&Passing),
    ) -> std::result::Result<Passage, Late> {
        let count = self.modes.count();
        let mut moment = self.moment(start);
        self.settle(&mut moment, 0, 0.0);
        self.require_candidates(&moment.state, 0)?;
        let stiffness = self.stiffness(&moment.stretch, &moment.touching());
        let mut variation = wants_derivative.then(|| Variation::new(count, stiffness));
        note(&self.passing(&moment.state, 0, moment.force()));
        for step in 0..self.steps {
            self.follow_supports(&mut moment.state.v, step);
            let force = self.make_step(&mut moment, step, &mut variation);
            self.require_candidates(&moment.state, step + 1)?;
            note(&self.passing(&moment.state, step + 1, force));
        }
        let State { q, v, .. } = moment.state;
        Ok(Passage { end: [q, v].concat(), derivative: variation.map(Variation::end) })
    }

    /// Returns the data of the end of a step.
    fn data(&self, step: usize) -> &ModalData {
        &self.data[step.min(self.data.len() - 1)]
    }

    /// Requires that no node has passed its bound at the end of a step without being a candidate.
    fn require_candidates(&self, state: &State, step: usize) -> std::result::Result<(), Late> {
        let bounds = &self.data(step).all;
        let pressed = || state.reaction.iter().enumerate().filter(|(_, r)| **r != 0.0);
        let is_late = |number: &usize| {
            let pushed: f64 = pressed().map(|(k, r)| r * self.model.at_bounds[k][*number]).sum();
            let place = bounds.shift[*number] + dot(self.shapes.col_as_slice(*number), &state.q) + pushed;
            place < bounds.lower[*number] || place > bounds.upper[*number]
        };
        let late: Vec<usize> = self.others().filter(is_late).collect();
        if late.is_empty() { Ok(()) } else { Err(Late(late)) }
    }

    /// Returns the numbers of the bounds that are no candidates.
    fn others(&self) -> impl Iterator<Item = usize> {
        (0..self.shapes.ncols()).filter(|number| self.model.candidates.binary_search(number).is_err())
    }

    /// Changes rates of the modes from the frame of the supports in the step before to their frame
    /// in this step. The last step of the period comes before the first.
    fn follow_supports(&self, v: &mut [f64], step: usize) {
        let rate = |step: usize, motion: usize| {
            let [from, to] = [self.data(step), self.data(step + 1)].map(|data| data.places[motion]);
            (to - from) / self.rotation.seconds
        };
        let before = if step == 0 { self.steps - 1 } else { step - 1 };
        for motion in 0..self.loads.support_momenta.ncols() {
            let change = rate(before, motion) - rate(step, motion);
            axpy(change, self.loads.support_momenta.col_as_slice(motion), v);
        }
    }

    /// Returns the state at the end of a step as it is shown.
    fn passing<'p>(&'p self, state: &'p State, step: usize, force: f64) -> Passing<'p> {
        let data = self.data(step);
        let distance = |place: f64, lower: f64, upper: f64| (place - lower).min(upper - place);
        let near = state.y.iter().zip(data.near.lower.iter().zip(&data.near.upper));
        let near = near.map(|(place, (lower, upper))| distance(*place, *lower, *upper));
        let far = self.others().map(|number| {
            let place = data.all.shift[number] + dot(self.shapes.col_as_slice(number), &state.q);
            distance(place, data.all.lower[number], data.all.upper[number])
        });
        Passing { map: self, state, step, gap: near.chain(far).fold(f64::INFINITY, f64::min), force }
    }
}

impl Passing<'_> {
    /// Returns the deflection at a probe (m), given its share of every lift by a support.
    pub fn deflection(&self, (probe, lifts): &(Probe, Vec<f64>)) -> f64 {
        let ReturnMap { modes, loads, model, .. } = self.map;
        let State { q, reaction, .. } = self.state;
        let data = self.map.data(self.step);
        let at_dof = |dof: usize| {
            let inertial: f64 = q.iter().enumerate().map(|(k, q)| q * modes.shapes[(dof, k)]).sum();
            let pressed = reaction.iter().enumerate().filter(|(_, r)| **r != 0.0);
            let pressed: f64 = pressed.map(|(k, r)| r * model.flexibility[k][dof]).sum();
            inertial + loads.response_at(data, dof).sum::<f64>() + pressed
        };
        let framed: f64 = probe.weights().iter().map(|&(dof, weight)| weight * at_dof(dof)).sum();
        framed + dot(lifts, &data.places)
    }

    /// Returns kinetic and elastic energy less the work of the constant loads, in J; 0 for a flat
    /// plate at rest under them.
    pub fn energy(&self) -> f64 {
        let ReturnMap { modes, model, form, .. } = self.map;
        let State { q, v, reaction, x, y, .. } = self.state;
        let rest = self.map.rest();
        let modal: f64 =
            (0..q.len()).map(|k| v[k] * v[k] + modes.squares[k] * (q[k] - rest[k]).powi(2)).sum();
        let pressed: f64 = reaction.iter().zip(x.iter().zip(y)).map(|(r, (x, y))| r * (x - y)).sum();
        let mut stretch = Stretch::default();
        let stretched = form.as_ref().map_or(0.0, |form| {
            form.evaluate(q, &mut stretch);
            stretch.energy()
        });
        0.5 * (modal + pressed) + model.laws.stored_under(reaction) + stretched
    }
}
