//! Schemes for the modal mass that move the modes in steps. The conserving scheme rotates the modes
//! exactly between kicks of the contact forces, with a relaxation that keeps the energy; the
//! midpoint rule and the Newmark scheme take implicit steps.
//!
//! With the [mass of the lowest modes](crate::linalg::MassModes) a displacement splits into modes q
//! and a massless rest, which follows at once. The bounded deflections are
//!
//! ```math
//! x = A q + R r + G W, \qquad A = G \Phi,
//! ```
//!
//! with the compliance R of the rest and its response W to the loads, and the reactions r solve the
//! bound-constrained problem [in compliance form](crate::vi::compliance). They are a Lipschitz
//! function of q, so that
//!
//! ```math
//! \ddot q + D \dot q + \Omega^2 q = \Phi^T F + A^T r(q)
//! ```
//!
//! is an ordinary differential equation, with the energy
//! `$E = \tfrac12 |\dot q|^2 + \tfrac12 q^T \Omega^2 q + \tfrac12 r^T R\, r$` besides the work of
//! loads. A step changes the velocity by `$\tfrac12 \Delta t\, A^T r$`, moves the modes exactly
//! over the step, and changes the velocity again by half the impulse of the reactions at the new
//! position (Strang splitting: explicit, symplectic, of second order, stable while
//! `$\Delta t < 2 / w$` for the fastest motion in contact). No step solves for more than the
//! reactions of the nodes in contact. Certificates prove that the other nodes, and in flight the
//! candidates too, cannot touch; in flight a step is then a rotation of the modes and no more. Two
//! costs depend on the mesh: renewing the certificates, and the compliance of each node that
//! becomes a candidate, by solves with K.
//!
//! Without contact a step is exact, and keeps the energy to rounding whatever its length. In
//! contact the scheme takes the relaxed step `$(q + \gamma\, dq,\; \dot q + \gamma\, d \dot q)$`,
//! `$t + \gamma \Delta t$`, with gamma such that the energy changes by the work of loads and
//! obstacles and by damping alone, as [`super::conserving`] does. A step without such a gamma is
//! repeated with half the length.
//!
//! # Damping, loads, obstacles and supports in time
//!
//! Damping acts on the modes, each with its own decay rate: alpha + beta w^2, and twice the damping
//! ratio times w. The rest of the displacement has no rate of its own and stays elastic. Loads and
//! bounds are linear in time between the instants of a step; the modes move under the mean force,
//! so that the balance of energy holds to rounding in flight. Moving supports are treated as in
//! [`super::midpoint`]: the frame moves uniformly during a step, and its change of velocity is an
//! impulse.
//!
//! # Reported quantities
//!
//! In flight states lie on the grid of the output. In contact, where steps of length gamma dt pass
//! the grid instants, the reported state is the cubic interpolation of q from the two states around
//! the instant, with the reactions that belong to it, and is computed where it is asked for;
//! energies are those of the state at or just after it. Impulses, mean reactions and the bounded
//! configuration, which is linear between the two states, are those of [`super::conserving`].

pub(crate) mod all_bounds;
mod balance;
mod candidates;
mod checkpoint;
pub(crate) mod contact_model;
mod coordinates;
pub(crate) mod data;
mod flight;
mod forecast;
mod groups;
mod implicit;
mod increments;
mod limits;
mod mean_balance;
mod midpoint;
mod newmark;
mod reach;
mod relaxation;
pub mod return_map;
mod rotation;
mod scheme;
mod shown;
mod state;
mod stepping;
mod stretching;
mod viscous_tips;

use super::massless::modal_saddle_point::ModalSaddlePoint;
use super::{Approach, NewmarkParameters, RelaxationStatistics, Start, StepRecord, System};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::dot;
use crate::linalg::{Engine, Form, MassModes};
use crate::vi::ComplianceSolver;
use all_bounds::AllBounds;
use contact_model::ContactModel;
use data::ModalLoads;
use faer::Mat;
use flight::Flight;
use implicit::{Implicit, StepRule};
use increments::Increments;
use limits::Limits;
use mean_balance::MeanBalance;
use pulp::Arch;
use reach::Reach;
use rotation::Rotation;
use shown::Shown;
use state::State;
use std::f64::consts::TAU;
use std::rc::Rc;
use stretching::Stretching;
use viscous_tips::ViscousTips;

/// Longest part of a step, in periods of the fastest mode.
const PART: f64 = 0.1;

/// Most parts of a step. In contact each of them is computed, which takes seconds for this many.
const MOST_PARTS: f64 = 1e7;

/// Scheme for the modal mass; see the [module page](self).
pub struct ModalScheme<'s, E: Engine> {
    system: &'s System<E>,
    modes: Rc<MassModes>,
    saddle: ModalSaddlePoint<'s, E>,
    global: Rc<AllBounds>,
    model: ContactModel,
    loads: ModalLoads,
    /// Decay rates of the modes, in 1/s.
    decays: Vec<f64>,
    is_damped: bool,
    implicit: Implicit,
    /// Exact motion over a part of a step, and over the last step of another length.
    rotation: Rotation,
    other: Rotation,
    /// Length of the next step in contact, in s.
    length: f64,
    contact: ComplianceSolver,
    tips: ViscousTips,
    stretching: Stretching,
    reach: Reach,
    flight: Flight,
    /// Mode shapes at the candidates, one column each.
    rows: Mat<f64>,
    /// Candidates in the order in which they came near, each time ascending.
    grown: Vec<Vec<usize>>,
    now: State,
    before: State,
    increments: Increments,
    /// Bounds at the present gamma; used only where they change in time.
    present: Limits,
    balance: Balance,
    /// Time between the two states, and from the grid instant to the later one, in s.
    span: f64,
    ahead: f64,
    /// Whether there were reactions between the two states, and their means, in N.
    presses: bool,
    mean: Vec<f64>,
    shown: Shown,
    /// Last states before contact, one entry per bound of this rank.
    free: Vec<Approach>,
    relaxation: RelaxationStatistics,
    /// Wall time for the compliance of candidates that steps have added, in s.
    compliance_seconds: f64,
    record: StepRecord,
    /// Whether the record lists candidates.
    is_listed: bool,
    /// Mean balance of forces, if it is kept.
    mean_balance: Option<MeanBalance>,
    arch: Arch,
}

/// Balance of energy, in J.
#[derive(Default)]
struct Balance {
    /// Energy at the start besides that of the constant load, and its change since by work. For the
    /// Newmark scheme the former is the work of the constant load on the initial position.
    start: f64,
    work: f64,
    /// Difference of the reported total energy and the scheme's own at the start.
    offset: f64,
}

impl<'s, E: Engine> ModalScheme<'s, E> {
    /// Starts the conserving scheme with steps of `dt` seconds.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for a mass that is not modal, too many modes for the compliance of
    /// the contact, or a step that is too long for its fastest mode, and the errors of the engine.
    pub fn conserving(system: &'s System<E>, dt: f64, start: Start) -> Result<ModalScheme<'s, E>> {
        ModalScheme::with_rule(system, dt, start, StepRule::Splitting)
    }

    /// Starts the midpoint rule with steps of `dt` seconds.
    ///
    /// # Errors
    /// Returns the same errors as [`ModalScheme::conserving`].
    pub fn midpoint(system: &'s System<E>, dt: f64, start: Start) -> Result<ModalScheme<'s, E>> {
        ModalScheme::with_rule(system, dt, start, StepRule::Midpoint)
    }

    /// Starts the Newmark scheme.
    ///
    /// # Errors
    /// Returns the same errors as [`ModalScheme::conserving`], and [`Error::Usage`] for beta = 1/4,
    /// with which the massless rest oscillates more and more.
    pub fn newmark(
        system: &'s System<E>,
        parameters: NewmarkParameters,
        start: Start,
    ) -> Result<ModalScheme<'s, E>> {
        let beta = parameters.beta;
        if beta <= 0.25 {
            return Err(Error::Usage(format!(
                "time.beta = {beta} lets the massless rest oscillate more and more; expected more than 0.25"
            )));
        }
        ModalScheme::with_rule(system, parameters.step, start, StepRule::Newmark(parameters))
    }

    /// Starts the scheme with a rule.
    fn with_rule(system: &'s System<E>, dt: f64, start: Start, rule: StepRule) -> Result<ModalScheme<'s, E>> {
        let Form::Modal { consistent, modes } = &system.mass else {
            return Err(Error::Usage("this scheme needs time.mass = \"modal\"".into()));
        };
        if rule != StepRule::Splitting {
            system.drive.refuse_viscous_tips()?;
        }
        if system.drive.stretching.is_some() && rule != StepRule::Splitting {
            return Err(Error::Usage("in_plane.stretching: expected time.scheme = \"conserving\"".into()));
        }
        let modes = modes.clone();
        let saddle = ModalSaddlePoint::new(system, &Form::Cells(consistent.clone()), &modes)?;
        let global = Rc::new(AllBounds::new(system));
        let comm = system.engine.comm();
        let loads = ModalLoads::new(system, &modes, &saddle, &global)?;
        let shapes = global.shapes(comm, &modes)?;
        let decays = system.decay_rates(&modes);
        let now = State {
            data: loads.at(system, &modes, &saddle, &[], 0.0)?.into(),
            ..State::at_start(system, &start)?
        };
        let bounds = &system.bounds;
        let fastest = modes.squares.last().map_or(0.0, |square| square.sqrt() / TAU);
        let parts = (dt * fastest / PART).ceil().max(1.0);
        if rule == StepRule::Splitting && parts > MOST_PARTS {
            return Err(Error::Usage(format!(
                "time.step = {dt:e} s: the fastest of {} modes has {fastest:.1e} Hz, so that a step in contact \
                 is divided into {parts:.0e} parts; expected at most {MOST_PARTS:.0e}",
                modes.count()
            )));
        }
        let part = dt / parts;
        let mut scheme = ModalScheme {
            implicit: Implicit::new(rule, dt, &modes.squares, &decays),
            is_damped: decays.iter().any(|decay| *decay > 0.0),
            rotation: Rotation::new(&modes.squares, &decays, part),
            other: Rotation::new(&modes.squares, &decays, part),
            length: part,
            contact: ComplianceSolver::new(0),
            tips: ViscousTips::new(system, &global),
            stretching: Stretching::new(system),
            reach: Reach::new(shapes, [&modes.squares, &decays], part, !system.drive.varies()),
            flight: Flight::default(),
            rows: Mat::new(),
            grown: Vec::new(),
            increments: Increments::new(modes.count()),
            present: Limits::default(),
            balance: Balance::default(),
            span: 0.0,
            ahead: 0.0,
            presses: false,
            mean: Vec::new(),
            shown: Shown::new(bounds.clone()),
            free: Approach::at_start(bounds, &start.displacement, &start.velocity),
            relaxation: RelaxationStatistics::default(),
            compliance_seconds: 0.0,
            record: StepRecord { candidates: Some(Vec::new()), ..StepRecord::new(dt, bounds.len()) },
            is_listed: false,
            mean_balance: None,
            before: now.clone(),
            now,
            system,
            modes,
            saddle,
            global,
            model: ContactModel::new(comm.all_reduce_max(bounds.size)),
            loads,
            decays,
            arch: Arch::new(),
        };
        scheme.record.admissible = bounds.dofs.iter().map(|&dof| start.displacement[dof]).collect();
        scheme.begin()?;
        if let Some(parameters) = scheme.newmark_parameters() {
            scheme.begin_newmark(parameters)?;
        }
        scheme.compliance_seconds = 0.0;
        Ok(scheme)
    }

    /// Finds candidates, reactions and energies of the initial state.
    fn begin(&mut self) -> Result<()> {
        self.stretching.evaluate(&self.now.q);
        // Reactions lift further nodes, or press them.
        while self.admit_near()? {
            self.settle(f64::INFINITY);
        }
        let State { q, reaction, data, .. } = &self.now;
        let [kinetic, elastic] = self.now.energies(&self.modes.squares);
        let rest = self.loads.elastic(data) + dot(reaction, &data.near.shift);
        let offset = rest - self.loads.work(data, q, &self.model.candidates, reaction);
        let stored = self.model.laws.stored_under(&self.now.reaction) + self.stretching.energy();
        self.balance = Balance { start: kinetic + elastic + stored, work: 0.0, offset };
        self.before = self.now.clone();
        self.list_candidates();
        self.show();
        for &(k, i) in &self.model.own {
            self.record.reaction[i] = self.now.reaction[k];
        }
        Ok(())
    }
}
