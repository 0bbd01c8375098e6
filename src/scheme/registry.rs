//! Registry of the schemes: what each is called, needs, takes and promises, and how it starts.
//!
//! Scenes, studies and commands ask this registry and name no scheme themselves, unless they are
//! about that very scheme. A new scheme is a file of its own, a variant of [`SchemeName`] and of
//! [`SchemeSpec`] with a row of [`Capabilities`] here, and the reading of its options in a scene.

use super::{
    Conserving, Exact, Massless, Midpoint, ModalScheme, Newmark, NewmarkParameters, Scheme, Start, System,
    exact,
};
use crate::error::{Error, Result};
use crate::linalg::{Engine, Form};
use crate::vi::SolverFactory;
use serde::{Deserialize, Serialize};

/// Name of a time scheme, without its options.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SchemeName {
    /// Newmark scheme with beta and restitution e.
    Newmark,
    /// Implicit midpoint scheme.
    Midpoint,
    /// Implicit midpoint scheme with relaxation to the initial energy.
    Conserving,
    /// Event-driven scheme.
    Exact,
}

/// Row of the registry: what a scheme needs and takes, whatever its options.
#[derive(Debug)]
pub struct Capabilities {
    /// Name in a scene.
    pub name: &'static str,
    /// Keys of the table `[time]` that only this scheme takes.
    pub options: &'static [&'static str],
    /// Reason why the scheme refuses the consistent mass; `None` where it takes either mass.
    pub needs_singular_mass: Option<&'static str>,
    /// Whether contact with the consistent mass is stable at short enough steps.
    pub bounces_with_consistent_mass: bool,
    /// Whether damping by the stiffness and of single modes is possible, besides that by the mass,
    /// with the paper's singular mass.
    pub takes_any_damping: bool,
    /// Whether compliant stops may have dashpots: with the paper's masses, and with the modal mass.
    pub takes_stop_damping: [bool; 2],
    /// Whether bounds may yield by laws of contact.
    pub takes_laws: bool,
    /// Whether sliders may dissipate energy.
    pub takes_sliders: bool,
    /// Whether obstacles may have friction.
    pub takes_friction: bool,
    /// Whether loads, obstacles and supports may depend on time.
    pub takes_time_dependence: bool,
    /// Whether the scheme runs on several processes.
    pub is_distributed: bool,
    /// Whether the scheme finds the instants of contact, so that no result depends on the step.
    pub is_event_driven: bool,
    /// Whether the scheme keeps the energy through impacts at any step.
    pub keeps_energy: bool,
    /// Number of factors of the same size that the scheme holds, with the singular mass and with
    /// the consistent one.
    pub factors: [usize; 2],
}

const NEWMARK: Capabilities = Capabilities {
    name: "newmark",
    options: &["beta", "restitution"],
    needs_singular_mass: None,
    bounces_with_consistent_mass: true,
    takes_any_damping: true,
    takes_stop_damping: [true, false],
    takes_laws: true,
    takes_sliders: true,
    takes_friction: true,
    takes_time_dependence: true,
    is_distributed: true,
    is_event_driven: false,
    keeps_energy: false,
    factors: [1, 1],
};

const MIDPOINT: Capabilities = Capabilities {
    name: "midpoint",
    options: &["massless"],
    bounces_with_consistent_mass: false,
    // With the singular mass a second factor serves the velocities, if nothing else.
    factors: [2, 1],
    ..NEWMARK
};

const CONSERVING: Capabilities = Capabilities {
    name: "conserving",
    options: &[],
    needs_singular_mass: Some(
        "with this mass velocities jump at impacts, and nothing says what energy is left",
    ),
    takes_any_damping: false,
    takes_stop_damping: [false, true],
    takes_sliders: false,
    keeps_energy: true,
    factors: [2, 2],
    ..NEWMARK
};

const EXACT: Capabilities = Capabilities {
    name: "exact",
    options: &[],
    needs_singular_mass: Some("with this mass an impact has no law of its own to follow"),
    takes_any_damping: false,
    takes_stop_damping: [false, false],
    takes_laws: false,
    takes_sliders: false,
    takes_friction: false,
    takes_time_dependence: false,
    is_distributed: false,
    is_event_driven: true,
    keeps_energy: true,
    ..NEWMARK
};

impl SchemeName {
    /// All schemes.
    pub const ALL: [SchemeName; 4] =
        [SchemeName::Newmark, SchemeName::Midpoint, SchemeName::Conserving, SchemeName::Exact];

    /// Returns the row of the scheme in the registry.
    pub const fn capabilities(self) -> &'static Capabilities {
        match self {
            SchemeName::Newmark => &NEWMARK,
            SchemeName::Midpoint => &MIDPOINT,
            SchemeName::Conserving => &CONSERVING,
            SchemeName::Exact => &EXACT,
        }
    }

    /// Returns whether results depend on the time step.
    pub fn has_step(self) -> bool {
        !self.capabilities().is_event_driven
    }

    /// Returns the scheme with the options that are its own.
    pub fn with(self, options: SchemeOptions) -> SchemeSpec {
        let SchemeOptions { beta, restitution, massless } = options;
        match self {
            SchemeName::Newmark => SchemeSpec::Newmark { beta, restitution },
            SchemeName::Midpoint => SchemeSpec::Midpoint { massless },
            SchemeName::Conserving => SchemeSpec::Conserving,
            SchemeName::Exact => SchemeSpec::Exact,
        }
    }
}

/// Options of all schemes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SchemeOptions {
    /// Newmark parameter beta.
    pub beta: f64,
    /// Coefficient of restitution e.
    pub restitution: f64,
    /// Treatment of the massless part of the displacement.
    pub massless: Massless,
}

/// Time scheme with its options.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "scheme", rename_all = "snake_case")]
pub enum SchemeSpec {
    /// Newmark scheme with beta and the restitution coefficient e of Paoli and Schatzman.
    Newmark {
        /// Parameter beta, at least 1/4.
        beta: f64,
        /// Restitution coefficient e of Paoli and Schatzman, from 0 to 1.
        restitution: f64,
    },
    /// Implicit midpoint scheme.
    Midpoint {
        /// Treatment of the massless part of the displacement.
        massless: Massless,
    },
    /// Implicit midpoint scheme with relaxation to conserve the energy; singular mass only.
    Conserving,
    /// Event-driven scheme without time discretisation error; singular mass only.
    Exact,
}

/// Promise of a scheme about the energy of a plate without damping.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EnergyPromise {
    /// The energy stays the same.
    Constant,
    /// The invariant of the scheme never rises.
    NeverRises,
    /// Nothing is promised.
    Nothing,
}

impl SchemeSpec {
    /// Returns the name of the scheme.
    pub fn name(self) -> SchemeName {
        match self {
            SchemeSpec::Newmark { .. } => SchemeName::Newmark,
            SchemeSpec::Midpoint { .. } => SchemeName::Midpoint,
            SchemeSpec::Conserving => SchemeName::Conserving,
            SchemeSpec::Exact => SchemeName::Exact,
        }
    }

    /// Returns the row of the scheme in the registry.
    pub fn capabilities(self) -> &'static Capabilities {
        self.name().capabilities()
    }

    /// Returns the coefficient of restitution e; `None` where impacts follow no such law.
    pub fn restitution(self) -> Option<f64> {
        match self {
            SchemeSpec::Newmark { restitution, .. } => Some(restitution),
            _ => None,
        }
    }

    /// Returns the promise about the energy.
    pub fn promise(self) -> EnergyPromise {
        match self {
            SchemeSpec::Newmark { beta: 0.5, restitution: 0.0 } => EnergyPromise::NeverRises,
            _ if self.capabilities().keeps_energy => EnergyPromise::Constant,
            _ => EnergyPromise::Nothing,
        }
    }

    /// Returns the relative error of the period of a mode with angular frequency w, divided by
    /// `$(w \Delta t)^2$`.
    pub fn period_error(self) -> f64 {
        match self {
            SchemeSpec::Newmark { beta, .. } => 0.5 * beta - 1.0 / 24.0,
            SchemeSpec::Midpoint { .. } | SchemeSpec::Conserving => 1.0 / 12.0,
            SchemeSpec::Exact => 0.0,
        }
    }

    /// Returns what improves the energy balance, as advice for the user; `None` where no option
    /// does.
    pub fn advice_on_energy(self, is_singular: bool) -> Option<&'static str> {
        match (self, is_singular) {
            (SchemeSpec::Midpoint { .. }, false) => Some(
                "the midpoint scheme is unstable with the consistent mass at every step: set time.mass = \"singular\"",
            ),
            (SchemeSpec::Midpoint { .. }, true) => {
                Some("a smaller time.step conserves better, and time.scheme = \"conserving\" at every step")
            }
            (SchemeSpec::Newmark { restitution, .. }, _) if restitution > 0.0 => {
                Some("a smaller time.step or time.restitution conserves better")
            }
            _ => None,
        }
    }

    /// Returns the memory of the scheme's dense arrays for so many dofs, cells and bounds, in
    /// bytes.
    pub fn dense_memory(self, dofs: usize, cells: usize, bounds: usize) -> usize {
        match self {
            SchemeSpec::Exact => exact::estimated_memory(dofs, cells, bounds),
            _ => 0,
        }
    }

    /// Returns every scheme with the options worth comparing for a mass.
    pub fn representatives(is_singular: bool) -> Vec<SchemeSpec> {
        let newmark = |restitution| SchemeSpec::Newmark { beta: 0.5, restitution };
        let midpoint = |massless| SchemeSpec::Midpoint { massless };
        let mut schemes = [0.0, 0.5, 1.0].map(newmark).to_vec();
        if is_singular {
            schemes.push(midpoint(Massless::Equilibrium));
        }
        schemes.extend([midpoint(Massless::Reflected), SchemeSpec::Conserving, SchemeSpec::Exact]);
        schemes.retain(|scheme| is_singular || scheme.capabilities().needs_singular_mass.is_none());
        schemes
    }

    /// Starts the scheme with steps of `dt` seconds and contact solvers from a factory.
    ///
    /// # Errors
    /// Returns the errors of the scheme and of the solver on its matrix.
    pub fn start<'m, E: Engine>(
        self,
        system: &'m System<E>,
        dt: f64,
        start: Start,
        solver: &'m SolverFactory<E>,
    ) -> Result<Box<dyn Scheme + 'm>> {
        let System { engine, bounds, .. } = system;
        let is_modal = matches!(system.mass, Form::Modal { .. });
        Ok(match self {
            SchemeSpec::Newmark { beta, restitution } => {
                let parameters = NewmarkParameters { beta, restitution, step: dt };
                if is_modal {
                    return Ok(Box::new(ModalScheme::newmark(system, parameters, start)?));
                }
                let solver = solver(engine, &Newmark::matrix(system, parameters), bounds.len())?;
                Box::new(Newmark::with_solver(system, parameters, start, solver)?)
            }
            SchemeSpec::Midpoint { massless: Massless::Reflected } if is_modal => {
                let why = "time.massless = \"reflected\" contradicts time.mass = \"modal\"";
                return Err(Error::Usage(format!("{why}; expected \"equilibrium\"")));
            }
            SchemeSpec::Midpoint { .. } if is_modal => Box::new(ModalScheme::midpoint(system, dt, start)?),
            SchemeSpec::Midpoint { massless } => {
                let solver = solver(engine, &Midpoint::matrix(system, dt), bounds.len())?;
                Box::new(Midpoint::with_solver(system, dt, massless, start, solver)?)
            }
            SchemeSpec::Conserving if is_modal => Box::new(ModalScheme::conserving(system, dt, start)?),
            SchemeSpec::Conserving => Box::new(Conserving::with_solver(system, dt, start, solver)?),
            SchemeSpec::Exact => Box::new(Exact::new(system, dt, start)?),
        })
    }
}
