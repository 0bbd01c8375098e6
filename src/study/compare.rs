//! Comparison of engines and contact solvers on one scene, step by step with a reference.
//!
//! The reference is the native engine with the condensed solver. Each contender advances in turn
//! with a reference of its own; after each step their deflections are compared at every node. On
//! several ranks, each rank compares the nodes that it owns with a reference that it computes
//! itself. Only the contender's calls are timed, after a synchronisation of all ranks.

use super::accuracy::plan::solver_name;
use super::frequencies::on_native_engine;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::geometry::range;
use crate::linalg::Engine;
use crate::output::text::{TableColumns, engineering, grouped, two_digits};
use crate::scene::{ContactSolver, EngineName, Scene};
use crate::scheme::Solution;
use crate::simulation::{self, DeflectionDof, Model, SolverFactory};
use serde::Serialize;
use std::collections::HashMap;
use std::fmt;
use std::time::Instant;

/// Number of impacts that a report shows; JSON output has all.
const MOST_IMPACTS: usize = 3;

/// Engine with a contact solver.
#[derive(Debug, Clone, PartialEq)]
pub struct Contender {
    /// Linear algebra engine.
    pub engine: EngineName,
    /// Contact solver.
    pub vi: ContactSolver,
    /// Method of the contact solver: one of PETSc's types, which overrides the options.
    pub method: Option<String>,
}

impl Contender {
    /// Parses `native`, `petsc`, `petsc:snes`, `petsc:tao:bnls` and the like.
    ///
    /// The words are the engine, the contact solver (by default condensed), and its method.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for other words. Whether a build has the contender shows when it
    /// starts.
    pub fn parse(name: &str) -> Result<Contender> {
        let mut words = name.split(':');
        let engine = match words.next() {
            Some("native") => EngineName::Native,
            Some("petsc") => EngineName::Petsc,
            _ => return Err(unknown(name)),
        };
        let named = |word| ContactSolver::ALL.into_iter().find(|vi| vi.name() == word);
        let vi = words.next().map_or(Some(ContactSolver::Condensed), named).ok_or_else(|| unknown(name))?;
        let method = words.next().map(String::from);
        if words.next().is_some() || method.is_some() && vi.method_option().is_none() {
            return Err(unknown(name));
        }
        Ok(Contender { engine, vi, method })
    }

    /// Returns PETSc's option for the method, and its value.
    pub fn option(&self) -> Option<(&'static str, &str)> {
        Some((self.vi.method_option()?, self.method.as_deref()?))
    }

    /// Returns the scene with this engine and solver.
    pub fn scene(&self, scene: &Scene) -> Scene {
        let mut scene = scene.clone();
        (scene.solver.engine, scene.solver.vi) = (self.engine, self.vi);
        scene
    }
}

fn unknown(name: &str) -> Error {
    Error::Usage(format!(
        "{name:?} cannot be compared; expected native, petsc, petsc:snes, petsc:tao, or with a type, such as petsc:tao:bnls"
    ))
}

impl fmt::Display for Contender {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&solver_name(self.engine, self.vi))?;
        self.method.as_ref().map_or(Ok(()), |method| write!(f, ":{method}"))
    }
}

/// Times of a contender on the slowest rank, in s.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Time of mesh, matrices, static start, first factorisation and first solve, in s.
    pub set_up: f64,
    /// Mean time of a step without contact, in s; `None` if there was none.
    pub free_step: Option<f64>,
    /// Mean time of a step in contact, in s; `None` if there was none.
    pub contact_step: Option<f64>,
}

/// Results of a contender.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Entry {
    /// Name of the contender.
    pub name: String,
    /// Reason why it did not reach the end.
    pub failure: Option<String>,
    /// Number of steps made.
    pub steps: u64,
    /// Number of steps in contact.
    pub contact_steps: u64,
    /// Largest difference of a deflection from the reference over all steps, in m.
    pub difference: f64,
    /// Largest difference up to each impact of the reference, in m.
    pub difference_up_to_impact: Vec<f64>,
    /// Worst relative KKT residual.
    pub worst_kkt: f64,
    /// Number of iterations of the contact solver.
    pub vi_iterations: u64,
    /// Number of numeric factorisations.
    pub factorisations: u64,
    /// Number of steps that were solved again in a safer way.
    pub retries: u64,
    /// Times of the parts of the run.
    pub seconds: Seconds,
}

/// Comparison of several contenders.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Title of the scene.
    pub title: String,
    /// Number of processes.
    pub ranks: usize,
    /// Number of free dofs.
    pub dofs: usize,
    /// Starts of the reference's contacts, in s.
    pub impacts: Vec<f64>,
    /// Results, one entry per contender.
    pub entries: Vec<Entry>,
}

impl Comparison {
    /// Creates a comparison without contenders.
    pub fn new(scene: &Scene, ranks: usize) -> Comparison {
        Comparison { title: scene.title.clone(), ranks, dofs: 0, impacts: Vec::new(), entries: Vec::new() }
    }

    /// Runs a contender beside the reference. Collective.
    ///
    /// `set_up` creates its model and `solver` its contact solver. `recover` receives an error of
    /// the contender, and decides whether the comparison goes on.
    ///
    /// # Errors
    /// Returns errors of the reference, and those that `recover` returns.
    pub fn run<E: Engine>(
        &mut self,
        scene: &Scene,
        contender: &Contender,
        set_up: impl FnOnce(&Scene) -> Result<Model<E>>,
        solver: impl FnOnce(&Model<E>, &Scene) -> Box<SolverFactory<E>>,
        recover: impl Fn(Error) -> Result<Error>,
    ) -> Result<()> {
        let adapted = contender.scene(scene);
        let mut entry = Entry { name: contender.to_string(), ..Entry::default() };
        let reference = Reference::new(scene)?;
        self.dofs = reference.model.system.engine.dofs();
        let clock = Instant::now();
        let failure = match set_up(&adapted) {
            Err(why) => Some(recover(why)?),
            Ok(model) => {
                entry.seconds.set_up = clock.elapsed().as_secs_f64();
                let solver = solver(&model, &adapted);
                let opponent = Opponent { scene: &adapted, model: &model, solver: &*solver };
                self.run_scheme(&reference, opponent, &mut entry, recover)?
            }
        };
        entry.failure = failure.map(|why| why.to_string());
        self.entries.push(entry);
        Ok(())
    }

    /// Checks that all contenders reached the end.
    ///
    /// # Errors
    /// Returns [`Error::Unfinished`] naming those that did not, with their reasons.
    pub fn verdict(&self) -> Result<()> {
        let failed = |entry: &Entry| Some(format!("{} ({})", entry.name, entry.failure.as_ref()?));
        let failed: Vec<String> = self.entries.iter().filter_map(failed).collect();
        if failed.is_empty() {
            return Ok(());
        }
        let (some, count) = (failed.len(), self.entries.len());
        Err(Error::Unfinished(format!("{some} of {count} did not reach the end: {}", failed.join(", "))))
    }

    /// Advances both to the end, or until the contender fails, and returns its error.
    fn run_scheme<E: Engine>(
        &mut self,
        reference: &Reference,
        Opponent { scene, model, solver }: Opponent<E>,
        entry: &mut Entry,
        recover: impl Fn(Error) -> Result<Error>,
    ) -> Result<Option<Error>> {
        let engine = &model.system.engine;
        let pairs = reference.pairs(&model.sites)?;
        let mut truth = reference.model.scheme(&reference.scene)?;
        let clock = Instant::now();
        let mut scheme = match model.scheme_with(scene, solver) {
            Ok(scheme) => scheme,
            Err(why) => return recover(why).map(Some),
        };
        entry.seconds.set_up += clock.elapsed().as_secs_f64();
        // Seconds and numbers of steps, without contact and in contact.
        let mut spent = [(0.0, 0_u64); 2];
        let mut contacts = Vec::new();
        let failure = loop {
            let (u, exact) = (scheme.displacement(), truth.displacement());
            let differs = |&(dof, other): &(usize, usize)| {
                let difference = (u[dof] - exact[other]).abs();
                if difference.is_nan() { f64::INFINITY } else { difference }
            };
            entry.difference = pairs.iter().map(differs).fold(entry.difference, f64::max);
            if touches(truth.as_ref()) {
                simulation::add_contact(&mut contacts, scene.time.step, truth.time());
                if contacts.len() > entry.difference_up_to_impact.len() {
                    entry.difference_up_to_impact.push(entry.difference);
                }
            }
            let verdict = scheme.step_report();
            entry.worst_kkt = entry.worst_kkt.max(verdict.kkt);
            entry.vi_iterations += u64::from(verdict.iterations);
            entry.retries += u64::from(verdict.retries > 0);
            let checked =
                simulation::check_residual(scheme.step(), scheme.time(), verdict.kkt, scene.solver.tolerance);
            if let Err(why) = checked {
                break Some(recover(why)?);
            }
            entry.steps = scheme.step();
            if entry.steps == scene.time.steps() {
                break None;
            }
            truth.advance()?;
            // This synchronises all ranks before the clock starts.
            engine.comm().barrier();
            let clock = Instant::now();
            if let Err(why) = scheme.advance() {
                break Some(recover(why)?);
            }
            let seconds = clock.elapsed().as_secs_f64();
            let in_contact = engine.comm().all_reduce_any(touches(scheme.as_ref()));
            let (total, steps) = &mut spent[usize::from(in_contact)];
            *total += seconds;
            *steps += 1;
        };
        entry.factorisations = scheme.statistics().factorisations;
        entry.contact_steps = spent[1].1;
        let worst = |value: &mut f64| *value = engine.comm().all_reduce_max(*value);
        worst(&mut entry.difference);
        worst(&mut entry.worst_kkt);
        worst(&mut entry.seconds.set_up);
        spent.iter_mut().for_each(|(total, _)| worst(total));
        // Rank 0 determines the number of impacts, because another machine's reference may round
        // differently.
        let counts = engine.comm().all_gather_one(entry.difference_up_to_impact.len());
        entry.difference_up_to_impact.resize(counts[0], entry.difference);
        entry.difference_up_to_impact.iter_mut().for_each(worst);
        let mean = |(total, steps): (f64, u64)| (steps > 0).then(|| total / steps as f64);
        (entry.seconds.free_step, entry.seconds.contact_step) = (mean(spent[0]), mean(spent[1]));
        let impacts: Vec<f64> = contacts.iter().map(|[begin, _]| *begin).collect();
        if impacts.len() > self.impacts.len() {
            self.impacts = impacts;
        }
        Ok(failure)
    }
}

/// Returns whether an obstacle acts on this process's nodes.
fn touches(scheme: &dyn Solution) -> bool {
    scheme.reaction().iter().any(|&r| r != 0.0)
}

/// Contender that is set up: its scene, model and contact solver.
struct Opponent<'a, E: Engine> {
    scene: &'a Scene,
    model: &'a Model<E>,
    solver: &'a SolverFactory<E>,
}

/// Reference of a comparison.
struct Reference {
    scene: Scene,
    model: Model,
    /// Deflection dof at each position on a grid far finer than any mesh; `None` where a ball
    /// shares it.
    places: HashMap<[i64; 2], Option<usize>>,
    /// Spacing of that grid, in m.
    spacing: f64,
}

impl Reference {
    fn new(scene: &Scene) -> Result<Reference> {
        let scene = on_native_engine(scene);
        let model = Model::new(&scene)?;
        let size = |axis: usize| {
            let [low, high] = range(model.sites.iter().map(|site| site.at[axis]));
            high - low
        };
        let spacing = 1e-8 * size(0).max(size(1)).max(f64::MIN_POSITIVE);
        let mut places = HashMap::new();
        for site in model.sites.iter().filter(|site| !site.is_tip) {
            let dof = places.entry(place(spacing, site.at)).or_insert(Some(site.dof));
            *dof = dof.filter(|dof| *dof == site.dof);
        }
        Ok(Reference { scene, model, places, spacing })
    }

    /// Pairs the contender's deflection dofs with those of the reference at the same nodes.
    fn pairs(&self, sites: &[DeflectionDof]) -> Result<Vec<(usize, usize)>> {
        let pair = |site: &DeflectionDof| {
            let [x, y] = place(self.spacing, site.at);
            // A rounding error may move a position to the adjacent grid point.
            let near = (0..9).find_map(|k| self.places.get(&[x + k % 3 - 1, y + k / 3 - 1]));
            let [x, y] = site.at;
            let missing = || Error::Mesh(format!("the reference has no free node at ({x}, {y})"));
            Ok(near.ok_or_else(missing)?.map(|dof| (site.dof, dof)))
        };
        sites.iter().filter(|site| !site.is_tip).map(pair).filter_map(Result::transpose).collect()
    }
}

/// Rounds a position to the grid.
fn place(spacing: f64, position: [f64; 2]) -> [i64; 2] {
    position.map(|x| (x / spacing).round() as i64)
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let ranks = if self.ranks == 1 { "1 rank".into() } else { format!("{} ranks", self.ranks) };
        writeln!(f, "{}: {} dofs, {ranks}", self.title, grouped(self.dofs as u64))?;
        let shown = self.impacts.len().min(MOST_IMPACTS);
        let time = |seconds: Option<f64>| seconds.map_or("-".into(), |s| format!("{:.1}", 1e6 * s));
        let mut columns = TableColumns::default();
        columns.add("solver", |entry: &Entry| entry.name.clone());
        columns.add("largest\ndifference, m", |entry| two_digits(entry.difference));
        for k in 0..shown {
            let upto = move |entry: &Entry| entry.difference_up_to_impact.get(k).copied();
            let cell = move |entry: &Entry| upto(entry).map_or("-".into(), two_digits);
            columns.add(format!("up to\ncontact {}", k + 1), cell);
        }
        columns.add("worst KKT\nresidual", |entry| two_digits(entry.worst_kkt));
        columns.add("VI\niterations", |entry| grouped(entry.vi_iterations));
        columns.add("factori-\nsations", |entry| grouped(entry.factorisations));
        columns.add("solved\nagain", |entry| grouped(entry.retries));
        columns.add("contact\nsteps", |entry| grouped(entry.contact_steps));
        columns.add("us a\nfree step", |entry| time(entry.seconds.free_step));
        columns.add("us a\ncontact step", |entry| time(entry.seconds.contact_step));
        columns.add("set-up,\nms", |entry| format!("{:.1}", 1e3 * entry.seconds.set_up));
        let mut table = columns.table([]);
        for entry in &self.entries {
            if entry.steps > 0 || entry.failure.is_none() {
                table.row(columns.row(entry));
            } else {
                table.row([entry.name.clone()]);
            }
            match &entry.failure {
                Some(why) if entry.steps > 0 => {
                    table.note(format!("stopped after {} steps: {why}", grouped(entry.steps)))
                }
                Some(why) => table.note(why),
                None => &mut table,
            };
        }
        write!(f, "{table}")?;
        if let Some(shown) = self.impacts.get(..shown).filter(|shown| !shown.is_empty()) {
            let times: Vec<String> = shown.iter().map(|time| engineering(*time, "s")).collect();
            writeln!(f, "  contacts at {}; {} in all", times.join(", "), self.impacts.len())?;
        }
        Ok(())
    }
}
