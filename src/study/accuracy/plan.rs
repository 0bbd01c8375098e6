//! Plan of a study: the combinations of its lists, and those it leaves out.

use crate::dof_map::DofMap;
use crate::error::{self, Error};
use crate::mesh::Mesh;
use crate::modes::ModeRange;
use crate::scene::{
    ContactSolver, Diagonal, EngineName, Grid, Mass, Massless, Scene, SchemeName, SchemeSpec, Study,
};
use crate::scheme::registry::SchemeOptions;
use crate::simulation;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Number of cells up to which the exact scheme is tried with the paper's mass; an active set costs
/// its cube.
pub(super) const EXACT_CELLS: usize = 320;

/// Number of modes up to which the exact scheme computes limits of the modal mass; an active set
/// costs its cube here too.
pub(super) const EXACT_MODES: usize = 200;

/// Method: a scheme with its parameters, a mass, an engine and a contact solver.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Method {
    /// Time scheme.
    #[serde(flatten)]
    pub scheme: SchemeSpec,
    /// Mass matrix.
    pub mass: Mass,
    /// Number of modes that carry the inertia; of the modal mass only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modes: Option<usize>,
    /// Linear algebra engine.
    pub engine: EngineName,
    /// Contact solver.
    pub vi: ContactSolver,
}

impl Method {
    /// Creates a method on the native engine.
    pub(super) fn native(scheme: SchemeSpec, mass: Mass, modes: Option<usize>) -> Method {
        Method { scheme, mass, modes, engine: EngineName::Native, vi: ContactSolver::Condensed }
    }

    /// Sets this method in a scene.
    pub(in crate::study) fn set_in(&self, scene: &mut Scene) {
        (scene.time.scheme, scene.time.mass) = (self.scheme, self.mass);
        scene.time.modes = self.modes.map(ModeRange::Count);
        (scene.solver.engine, scene.solver.vi) = (self.engine, self.vi);
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Method { scheme, mass, modes, engine, vi } = self;
        write!(f, "{}", scheme.name())?;
        if let Some(restitution) = scheme.restitution() {
            write!(f, " e={restitution}")?;
        }
        if let SchemeSpec::Midpoint { massless } = scheme
            && *massless != mass.massless()
        {
            f.write_str(" reflected")?;
        }
        write!(f, " {mass}")?;
        if let Some(modes) = modes {
            write!(f, " m={modes}")?;
        }
        match (engine, vi) {
            (EngineName::Native, ContactSolver::Condensed) => Ok(()),
            (engine, vi) => write!(f, " {}", solver_name(*engine, *vi)),
        }
    }
}

/// Returns the name of an engine with a contact solver: `petsc`, `petsc:snes`.
pub(in crate::study) fn solver_name(engine: EngineName, vi: ContactSolver) -> String {
    if vi == ContactSolver::Condensed { engine.to_string() } else { format!("{engine}:{vi}") }
}

/// Returns items without repetition, in their order.
pub(in crate::study) fn distinct<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut distinct = Vec::new();
    for item in items {
        if !distinct.contains(&item) {
            distinct.push(item);
        }
    }
    distinct
}

/// Builds the mesh of a grid and its free dofs.
pub(super) fn mesh_and_space(base: &Scene, grid: Grid) -> error::Result<(Mesh, DofMap)> {
    let scene = Scene { mesh: grid, ..base.clone() };
    let mesh = simulation::mesh(&scene)?;
    let space = simulation::space(&scene, &mesh)?;
    Ok((mesh, space))
}

/// Returns the name of a mesh: `fvs 10x4` after refinement, or `file refine 1`.
pub fn mesh_name(grid: &Grid) -> String {
    if grid.is_of_file() {
        return if grid.refine == 0 { "file".into() } else { format!("file refine {}", grid.refine) };
    }
    let [nx, ny] = grid.cells.map(|count| count << grid.refine);
    let diagonal = grid.diagonal.filter(|diagonal| *diagonal != Diagonal::Right);
    let diagonal = diagonal.map_or(String::new(), |diagonal| format!(" {diagonal:?}").to_lowercase());
    format!("{} {nx}x{ny}{diagonal}", grid.element)
}

/// Case: one run of a method with a step on a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// Mesh.
    pub grid: Grid,
    /// Method.
    #[serde(flatten)]
    pub method: Method,
    /// Time step in s.
    pub step: f64,
}

impl Case {
    /// Returns the scene of this run, with rows `interval` seconds apart.
    pub fn scene(&self, base: &Scene, interval: f64) -> Scene {
        let mut scene = base.clone();
        scene.mesh = self.grid;
        self.method.set_in(&mut scene);
        scene.time.step = self.step;
        scene.output.every = ((interval / self.step).round() as u64).max(1);
        scene
    }

    /// Returns whether all of some words, separated by spaces, are in the name.
    fn has(&self, words: &str) -> bool {
        let name = self.to_string().replace(',', "");
        words.split_whitespace().all(|word| name.split_whitespace().any(|part| part == word))
    }
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}, {}", mesh_name(&self.grid), self.method)?;
        if self.method.scheme.name().has_step() { write!(f, ", {:e} s", self.step) } else { Ok(()) }
    }
}

/// Run that did not reach its end, or combinations that a study leaves out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Absent {
    /// Name of the run, or name that the combinations have in common.
    pub what: String,
    /// Reason of the failure, or reason why none of the combinations runs.
    pub why: String,
}

/// Adds combinations that are left out, once, with a reason up to its remedy.
pub(super) fn leave_out(dropped: &mut Vec<Absent>, what: String, why: &str) {
    let one = Absent { what, why: without_remedy(why).to_owned() };
    if !dropped.contains(&one) {
        dropped.push(one);
    }
}

/// Returns a message up to its remedy.
pub(super) fn without_remedy(message: &str) -> &str {
    message.split(';').next().unwrap_or(message)
}

/// Plan of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Meshes without repetition.
    pub grids: Vec<Grid>,
    /// Methods without repetition.
    pub methods: Vec<Method>,
    /// All runs: mesh by mesh, method by method, long steps first.
    pub cases: Vec<Case>,
    /// Combinations left out.
    pub dropped: Vec<Absent>,
}

impl Plan {
    /// Expands the lists of a study.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for words in `skip` that are in no run's name.
    pub fn new(scene: &Scene, study: &Study) -> error::Result<Plan> {
        let mut dropped = Vec::new();
        let methods = methods(scene, study, &mut dropped);
        let mut grids: Vec<Grid> = Vec::new();
        for &element in &study.elements {
            for &cells in &study.cells {
                for &refine in &study.refinements {
                    let grid = scene.mesh.with(element, cells, refine);
                    if !grids.iter().any(|other| mesh_name(other) == mesh_name(&grid)) {
                        grids.push(grid);
                    }
                }
            }
        }
        let mut steps = study.steps.clone();
        steps.sort_by(|a, b| b.total_cmp(a));
        let interval = study.interval(scene.time.end).unwrap_or(scene.time.step);
        let mut cases = Vec::new();
        for &grid in &grids {
            let depends = |method: &Method| method.modes.is_some() || method.scheme == SchemeSpec::Exact;
            // A mesh that cannot be made is reported by its runs.
            let mesh = methods.iter().any(depends).then(|| mesh_and_space(scene, grid).ok()).flatten();
            for &method in &methods {
                // Without contact the scene's own modes may be any number.
                let is_modal = method.modes.is_some() && !scene.has_contact();
                if let Some((what, why)) = forbidden(&method, mesh.as_ref())
                    && !(is_modal && method.modes.map(ModeRange::Count) == scene.time.modes)
                {
                    leave_out(&mut dropped, format!("{}, {what}", mesh_name(&grid)), why);
                    continue;
                }
                // A scheme without a step of its own runs once, with the instants of comparison as
                // steps.
                let steps = if method.scheme.name().has_step() { &steps[..] } else { &[interval] };
                cases.extend(steps.iter().map(|&step| Case { grid, method, step }));
            }
        }
        for words in &study.skip {
            let count = cases.len();
            cases.retain(|case| !case.has(words));
            if cases.len() == count {
                return Err(Error::Usage(format!(
                    "study.skip: no run left has the words \"{words}\" in its name; expected words of names such as \
                     \"{}\"",
                    cases.first().map_or(String::new(), Case::to_string)
                )));
            }
            leave_out(&mut dropped, words.clone(), "study.skip names these runs");
        }
        Ok(Plan { grids, methods, cases, dropped })
    }
}

/// Returns a method's name and the reason if it makes no sense on a mesh of the given size.
fn forbidden(method: &Method, mesh: Option<&(Mesh, DofMap)>) -> Option<(String, &'static str)> {
    let (mesh, space) = mesh?;
    match method.modes {
        Some(modes) if modes > space.dofs() / 2 => {
            Some((format!("m={modes}"), "more modes than half of the dofs"))
        }
        None if method.scheme == SchemeSpec::Exact && mesh.cells.len() > EXACT_CELLS => {
            Some((method.to_string(), "more than 320 cells"))
        }
        _ => None,
    }
}

fn methods(scene: &Scene, study: &Study, dropped: &mut Vec<Absent>) -> Vec<Method> {
    let beta = match scene.time.scheme {
        SchemeSpec::Newmark { beta, .. } => beta,
        _ => 0.5,
    };
    let massless = |mass: Mass| match scene.time.scheme {
        _ if !scene.sliders.is_empty() => Massless::Reflected,
        SchemeSpec::Midpoint { massless } if scene.time.mass == mass => massless,
        _ => mass.massless(),
    };
    let mut methods = Vec::new();
    for &name in &study.schemes {
        for &mass in &study.masses {
            let yields = scene.yielding_stop().is_some();
            if let Err(why) = serves(name, mass, !scene.obstacles.is_empty(), yields) {
                leave_out(dropped, format!("{name} {mass}"), why);
                continue;
            }
            for &engine in &study.engines {
                for &vi in &study.vi {
                    let is_native = engine == EngineName::Native;
                    if is_native && !vi.runs_on_any_engine() {
                        let why = "the native engine has the condensed solver only";
                        leave_out(dropped, format!("native:{vi}"), why);
                        continue;
                    } else if mass == Mass::Modal && vi != ContactSolver::Condensed {
                        let why = "the modal mass solves contact in compliance form";
                        leave_out(dropped, format!("{name} {mass} {vi}"), why);
                        continue;
                    } else if !name.capabilities().is_distributed && !is_native {
                        leave_out(dropped, format!("{name} {engine}"), "it runs on the native engine");
                        continue;
                    }
                    let with = |restitution| {
                        name.with(SchemeOptions { beta, restitution, massless: massless(mass) })
                    };
                    let bounces = name.capabilities().options.contains(&"restitution");
                    let restitutions = if bounces { &study.restitutions[..] } else { &[0.0] };
                    for scheme in restitutions.iter().map(|&restitution| with(restitution)) {
                        let with = |modes| Method { scheme, mass, modes, engine, vi };
                        if !scene.is_friction_taken(scheme, mass) {
                            leave_out(dropped, with(None).to_string(), "it takes no friction");
                            continue;
                        }
                        match mass {
                            Mass::Modal => methods.extend(study.modes.iter().map(|&modes| with(Some(modes)))),
                            Mass::Singular | Mass::Consistent => methods.push(with(None)),
                        }
                    }
                }
            }
        }
    }
    methods
}

/// Returns an error with the reason if a scheme makes no sense with a mass.
fn serves(scheme: SchemeName, mass: Mass, obstacles: bool, yields: bool) -> Result<(), &'static str> {
    let scheme = scheme.capabilities();
    match mass {
        _ if yields && !scheme.takes_laws => Err("it takes no stops with laws of their own"),
        Mass::Consistent if scheme.needs_singular_mass.is_some() => Err("it needs the singular mass"),
        Mass::Consistent if obstacles && !scheme.bounces_with_consistent_mass => {
            Err("unstable in contact at every step with the consistent mass")
        }
        _ => Ok(()),
    }
}
