//! Stability study behind `rebond stability`: every method on hard scenes.
//!
//! A *trial* is a scene on an element with a method: a scheme with its parameters, a mass, an
//! engine and a contact solver. It runs to its end, the KKT residual of every step is checked, and
//! its energy is compared with the promise of its scheme:
//!
//! | scheme | promise |
//! |---|---|
//! | newmark, beta = 1/2, e = 0 | `$H^{n+1/2}$` never rises, nor exceeds the initial energy |
//! | conserving, exact | the energy stays equal to the initial energy |
//! | the others | none: energy changes at impacts, less with smaller steps |
//!
//! `$H^{n+1/2}$` is the invariant of [`crate::scheme::Newmark`]. An energy gain of a scheme without
//! a promise is not a failure of the program: the table shows the gain and a remedy.

use super::accuracy::plan::{Method, distinct, mesh_name, solver_name};
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::output::text::{Table, TableColumns, grouped};
use crate::scene::{ContactSolver, ElementKind, EngineName, Mass, Scene, SchemeSpec};
use crate::scheme::{self, EnergyPromise};
use crate::simulation::{self, Model, Observer, Outcome, Row, SolverFactory};
use serde::Serialize;
use std::fmt;
use std::time::Instant;

/// Ratio of the energy to its start at which a trial is stopped.
const GUARD: f64 = 10.0;

/// Relative errors of a promised energy: up to the first it is kept, up to the second it drifts.
///
/// The errors are relative to the largest part of the energy (kinetic, elastic, work) during the
/// run.
const KEPT: f64 = 1e-9;
const DRIFTS: f64 = 1e-4;

/// Relative gain of energy above which a trial is reported as gaining.
const GAINED: f64 = 0.01;

/// Number of cells up to which the exact scheme is tried with the mass of the cells, because its
/// matrices are dense.
const MOST_EXACT_CELLS: usize = 640;

/// Ending of a trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "is", content = "why")]
pub enum Ending {
    /// End reached, with the promised energy, or without a promise and without a gain worth
    /// mention.
    Holds,
    /// End reached, but rounding moved the promised energy by more than 1e-9 of its largest part.
    ///
    /// The text tells by how much.
    Drifts(String),
    /// End reached with more energy than at the start, which the scheme permits; the text is a
    /// remedy.
    Gains(String),
    /// Stopped by the energy guard, without a promise; the text is the guard's message.
    Guarded(String),
    /// Refused before or during the run; the text is the reason.
    Refused(String),
    /// Failure that must not happen.
    Fails(String),
}

impl Ending {
    /// Returns the ending in one word, and the program's message, if there is one.
    pub fn told(&self) -> (&'static str, Option<&str>) {
        match self {
            Ending::Holds => ("holds", None),
            Ending::Drifts(why) => ("drifts", Some(why)),
            Ending::Gains(why) => ("gains", Some(why)),
            Ending::Guarded(why) => ("guard", Some(why)),
            Ending::Refused(why) => ("refused", Some(why)),
            Ending::Fails(why) => ("FAILS", Some(why)),
        }
    }
}

/// Trial: a scene on an element with a method, and its results.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trial {
    /// Element and cells, or the mesh file.
    pub mesh: String,
    /// Method of the trial.
    #[serde(flatten)]
    pub method: Method,
    /// Ending of the trial.
    pub ending: Ending,
    /// Measurements; `None` if the trial did not begin.
    #[serde(flatten)]
    pub figures: Option<Figures>,
}

/// Measurements of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// Number of steps made.
    pub steps: u64,
    /// Number of steps in contact.
    pub contact_steps: u64,
    /// Largest number of nodes in contact at once.
    pub most_contact_nodes: usize,
    /// Least energy relative to its start.
    ///
    /// For a start with almost no energy, it is 1 plus the change relative to the energy's largest
    /// part.
    pub energy_min: f64,
    /// Largest energy, relative in the same way as the least.
    pub energy_max: f64,
    /// Largest violation of the scheme's promise; `None` without a promise.
    ///
    /// It is relative to the largest part of the energy during the run, to which rounding errors
    /// are proportional.
    pub broken: Option<f64>,
    /// Worst relative KKT residual.
    pub worst_kkt: f64,
    /// Largest violation of a bound relative to the largest deflection.
    pub penetration: f64,
    /// Number of iterations of the contact solver.
    pub vi_iterations: u64,
    /// Number of steps that were solved again in a safer way.
    pub retries: u64,
    /// Time per step, in s.
    pub seconds_a_step: f64,
}

/// Returns the methods to try with an engine and a contact solver.
pub fn methods(engine: EngineName, vi: ContactSolver) -> Vec<Method> {
    let masses = [Mass::Singular, Mass::Consistent, Mass::Modal];
    let methods = masses.into_iter().flat_map(|mass| {
        let schemes = SchemeSpec::representatives(mass != Mass::Consistent);
        schemes.into_iter().map(move |scheme| Method { scheme, mass, modes: None, engine, vi })
    });
    // With the modal mass the others are there for comparison.
    let is_advised =
        |method: &Method| method.mass != Mass::Modal || method.scheme.capabilities().keeps_energy;
    let serves = |method: &Method| {
        let is_distributed = method.scheme.capabilities().is_distributed && method.mass != Mass::Modal;
        engine == EngineName::Native || is_distributed
    };
    methods.filter(is_advised).filter(serves).collect()
}

/// Returns all elements in the order of the tables, the last of the registry first.
fn elements() -> impl Iterator<Item = ElementKind> {
    ElementKind::ALL.into_iter().rev()
}

/// Returns the variants of a scene: each element with each method.
///
/// Elements are all kinds on a grid, or those of the mesh file.
pub fn variants(scene: &Scene, engine: EngineName, vi: ContactSolver) -> Vec<(Scene, Method)> {
    let mut variants = Vec::new();
    let count = if scene.file.is_some() { 1 } else { ElementKind::ALL.len() };
    for element in elements().take(count) {
        let mesh = match scene.file {
            Some(_) => scene.mesh,
            None => scene.mesh.with(element, scene.mesh.cells, scene.mesh.refine),
        };
        let variant = Scene { mesh, ..scene.clone() };
        // A mesh that cannot be made is reported by the trials.
        let cells = simulation::mesh(&variant).map_or(0, |mesh| mesh.cells.len());
        let yields = scene.yielding_stop().is_some();
        let serves = |method: &Method| {
            let takes_stops = !yields || method.scheme.capabilities().takes_laws;
            takes_stops && scene.is_friction_taken(method.scheme, method.mass)
        };
        for method in methods(engine, vi).into_iter().filter(serves) {
            let is_dense = method.scheme == SchemeSpec::Exact && method.mass != Mass::Modal;
            if is_dense && cells > MOST_EXACT_CELLS {
                continue;
            }
            let mut scene = variant.clone();
            method.set_in(&mut scene);
            scene.solver.energy_guard = scene.solver.energy_guard.min(GUARD);
            (scene.output.every, scene.output.fields) = (1, None);
            variants.push((scene, method));
        }
    }
    variants
}

/// Observer of a trial that records the extremes of its energies and the violation of its promise.
#[derive(Debug)]
struct PropertyCheck {
    promise: EnergyPromise,
    start: Option<Energies>,
    /// Largest magnitude of a part of the energy, at the start and during the run.
    parts: [f64; 2],
    /// Least and largest energy, in J.
    range: [f64; 2],
    /// Energy to which the invariant is compared (its start, or its least value so far), and the
    /// largest departure from it, in J.
    lowest: f64,
    broken: f64,
    /// Largest deflection, in m.
    length: f64,
}

impl PropertyCheck {
    fn new(promise: EnergyPromise) -> PropertyCheck {
        let (range, lowest) = ([f64::INFINITY, f64::NEG_INFINITY], f64::INFINITY);
        PropertyCheck { promise, start: None, parts: [0.0; 2], range, lowest, broken: 0.0, length: 0.0 }
    }

    /// Returns the scale of relative energies: the largest part of the initial energy.
    ///
    /// If the start has almost none, the largest part during the run counts.
    fn scale(&self) -> f64 {
        let [first, ever] = self.parts;
        if first > 1e-6 * ever { first } else { ever }
    }

    /// Returns an energy relative to its start.
    fn relative(&self, energy: f64) -> f64 {
        let (start, scale) = (self.start.unwrap_or_default().total(), self.scale());
        if scale == 0.0 { 1.0 } else { 1.0 + (energy - start) / scale }
    }
}

impl Observer for PropertyCheck {
    fn row(&mut self, row: &Row) -> Result<()> {
        let now = Energies { kinetic: row.kinetic, elastic: row.elastic, work: row.work };
        let part = now.kinetic.abs().max(now.elastic.abs()).max(now.work.abs());
        if self.start.is_none() {
            (self.start, self.parts[0], self.lowest) = (Some(now), part, row.energy);
        }
        self.parts[1] = self.parts[1].max(part);
        let [least, most] = self.range;
        self.range = [least.min(row.energy), most.max(row.energy)];
        Ok(())
    }

    fn state(&mut self, scheme: &dyn scheme::Solution) -> Result<()> {
        let largest = scheme.displacement().iter().chain(scheme.admissible());
        self.length = largest.fold(self.length, |length, u| length.max(u.abs()));
        let above = scheme.invariant()? - self.lowest;
        match self.promise {
            EnergyPromise::Constant => self.broken = self.broken.max(above.abs()),
            EnergyPromise::NeverRises => {
                self.broken = self.broken.max(above);
                self.lowest += above.min(0.0);
            }
            EnergyPromise::Nothing => {}
        }
        Ok(())
    }
}

/// Runs a trial on a model of its scene; errors become the ending of the trial.
pub fn attempt<E: Engine>(
    scene: &Scene,
    method: Method,
    model: Result<Model<E>>,
    solver: impl FnOnce(&Model<E>) -> Box<SolverFactory<E>>,
) -> Trial {
    let mut witness = PropertyCheck::new(method.scheme.promise());
    let clock = Instant::now();
    let ran = model.and_then(|model| {
        let solver = solver(&model);
        simulation::run(scene, &model, &*solver, &mut witness)
    });
    let seconds = clock.elapsed().as_secs_f64();
    let mesh = scene.file.as_ref().map_or_else(|| mesh_name(&scene.mesh), |file| file.file.clone());
    let (outcome, ended) = match ran {
        Ok(ran) => ran,
        Err(why) => return Trial { mesh, method, ending: ended_by(&why), figures: None },
    };
    let figures = figures(&witness, &outcome, seconds);
    let ending = match ended {
        Err(why @ Error::EnergyGuard { .. }) if witness.promise == EnergyPromise::Nothing => {
            Ending::Guarded(why.to_string())
        }
        Err(why) => ended_by(&why),
        Ok(()) => match figures.broken {
            Some(broken) if broken <= KEPT => Ending::Holds,
            Some(broken) => {
                let why = format!(
                    "the energy departs by {broken:.0e} of its largest part from what the scheme promises"
                );
                if broken <= DRIFTS { Ending::Drifts(why) } else { Ending::Fails(why) }
            }
            None if figures.energy_max > 1.0 + GAINED => Ending::Gains(simulation::advice(scene).into()),
            _ => Ending::Holds,
        },
    };
    Trial { mesh, method, ending, figures: Some(figures) }
}

/// Returns the ending by an error: one that the user is to mend refuses the trial.
fn ended_by(why: &Error) -> Ending {
    let ending = if why.exit_code() == 2 { Ending::Refused } else { Ending::Fails };
    ending(why.to_string())
}

/// Runs a trial on the native engine.
pub fn run_native(scene: &Scene, method: Method) -> Trial {
    attempt(scene, method, Model::new(scene), |_| Box::new(simulation::condensed))
}

fn figures(witness: &PropertyCheck, outcome: &Outcome, seconds: f64) -> Figures {
    let over = |value: f64, scale: f64| if value == 0.0 { 0.0 } else { value / scale };
    Figures {
        steps: outcome.steps,
        contact_steps: outcome.contact_steps,
        most_contact_nodes: outcome.most_contact_nodes,
        energy_min: witness.relative(witness.range[0]),
        energy_max: witness.relative(witness.range[1]),
        broken: (witness.promise != EnergyPromise::Nothing).then(|| over(witness.broken, witness.parts[1])),
        worst_kkt: outcome.worst_kkt,
        penetration: over(outcome.worst_penetration, witness.length),
        vi_iterations: outcome.vi_iterations,
        retries: outcome.retries,
        seconds_a_step: over(seconds, outcome.steps as f64),
    }
}

/// Hard scene with its trials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    /// Name of the scene: that of its file, without the extension.
    pub name: String,
    /// Title of the scene.
    pub title: String,
    /// Trials of the scene.
    pub trials: Vec<Trial>,
}

/// Results of all hard scenes.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Stability {
    /// Cases, one per scene.
    pub cases: Vec<Case>,
}

impl Stability {
    /// Checks that no trial failed.
    ///
    /// # Errors
    /// Returns [`Error::Unfinished`] naming the failed trials.
    pub fn verdict(&self) -> Result<()> {
        let trials = self.cases.iter().flat_map(|case| case.trials.iter().map(move |trial| (case, trial)));
        let (count, failed) = (
            trials.clone().count(),
            trials.filter_map(|(case, trial)| {
                let Trial { mesh, method, ending: Ending::Fails(why), .. } = trial else { return None };
                Some(format!("{}, {mesh}, {method}: {why}", case.name))
            }),
        );
        let failed: Vec<String> = failed.collect();
        if failed.is_empty() {
            return Ok(());
        }
        Err(Error::Unfinished(format!("{} of {count} trials fail: {}", failed.len(), failed.join("; "))))
    }

    /// Creates the table of all cases, scenes down and methods across, of one engine and contact
    /// solver.
    fn overview(&self, engine: EngineName, vi: ContactSolver) -> Table {
        let methods = methods(engine, vi);
        let mut heads = vec![elements().map(ElementKind::name).collect::<Vec<_>>().join(" | ")];
        for method in &methods {
            let alone = Method { engine: EngineName::Native, vi: ContactSolver::Condensed, ..*method };
            heads.push(alone.to_string().replace(' ', "\n"));
        }
        if engine != EngineName::Native {
            heads[0].insert_str(0, &(solver_name(engine, vi) + "\n"));
        }
        let mut table = Table::new(&heads.iter().map(String::as_str).collect::<Vec<_>>());
        for case in &self.cases {
            let word = |trial: &Trial| match (&trial.ending, &trial.figures) {
                (Ending::Gains(_), Some(figures)) => format!("x{:.2}", figures.energy_max),
                (ending, _) => ending.told().0.into(),
            };
            let verdict = |method: &Method| {
                let words: Vec<String> =
                    case.trials.iter().filter(|trial| trial.method == *method).map(word).collect();
                match &words[..] {
                    [] => "-".into(),
                    [one, others @ ..] if others.iter().all(|other| other == one) => one.clone(),
                    words => words.join(" | "),
                }
            };
            table.row(std::iter::once(case.name.clone()).chain(methods.iter().map(verdict)));
        }
        table
    }
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{}: {}", self.name, self.title)?;
        let mut columns = TableColumns::default();
        columns.add("mesh, method", |trial: &Trial| format!("{}, {}", trial.mesh, trial.method));
        let mut add = |head: &str, cell: &'static dyn Fn(&Figures) -> String| {
            columns.add(head, move |trial: &Trial| trial.figures.as_ref().map_or(String::new(), cell));
        };
        add("steps", &|figures| grouped(figures.steps));
        add("in\ncontact", &|figures| grouped(figures.contact_steps));
        add("most\nnodes", &|figures| grouped(figures.most_contact_nodes as u64));
        add("energy over\nstart, least", &|figures| format!("{:.4}", figures.energy_min));
        add("most", &|figures| format!("{:.4}", figures.energy_max));
        add("promise\nbroken by", &|figures| figures.broken.map_or("-".into(), one_digit));
        add("worst KKT\nresidual", &|figures| one_digit(figures.worst_kkt));
        add("pene-\ntration", &|figures| one_digit(figures.penetration));
        add("VI itera-\ntions", &|figures| grouped(figures.vi_iterations));
        add("solved\nagain", &|figures| grouped(figures.retries));
        add("us a\nstep", &|figures| format!("{:.0}", 1e6 * figures.seconds_a_step));
        columns.add("verdict", |trial| trial.ending.told().0.into());
        let mut table = columns.table([]);
        let mut said: Vec<&str> = Vec::new();
        for trial in &self.trials {
            table.row(columns.row(trial));
            if let Some(why) = trial.ending.told().1
                && !said.contains(&why)
            {
                said.push(why);
                table.note(why);
            }
        }
        write!(f, "{table}")
    }
}

/// Formats one significant digit with an exponent.
fn one_digit(value: f64) -> String {
    if value == 0.0 { "0".into() } else { format!("{value:.0e}") }
}

impl fmt::Display for Stability {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for case in &self.cases {
            writeln!(f, "{case}")?;
        }
        let trials = self.cases.iter().flat_map(|case| &case.trials);
        let contenders = distinct(trials.map(|trial| (trial.method.engine, trial.method.vi)));
        let tables = contenders.into_iter().map(|(engine, vi)| self.overview(engine, vi).to_string());
        f.write_str(&tables.collect::<Vec<_>>().join("\n"))
    }
}
