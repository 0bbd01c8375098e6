//! Command `rebond compare`.

use super::arguments::{SceneArgs, refuse_petsc_options};
use super::command::{Execute, Program};
use super::launch;
#[cfg(feature = "petsc")]
use super::ranks::{self, PATIENCE, ended};
use crate::error::{Error, Result};
#[cfg(feature = "petsc")]
use crate::output::checkpoint::Identity;
#[cfg(feature = "petsc")]
use crate::petsc::Context;
#[cfg(feature = "petsc")]
use crate::scene::EngineName;
use crate::scene::{Mass, Scene};
use crate::simulation::{self, Model};
use crate::study::compare::{Comparison, Contender};
use clap::Args;
#[cfg(feature = "petsc")]
use std::rc::Rc;

const EXAMPLES: &str = "\
Examples:
  rebond compare plate.toml --set time.end=0.06
  rebond compare plate.toml --with native,petsc,petsc:tao:gpcg";

/// Run a scene on several engines and contact solvers: how far they differ, what each costs
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Compare {
    #[command(flatten)]
    scene: SceneArgs,
    /// Engines and contact solvers, separated by commas: native, petsc, petsc:snes, petsc:tao, the
    /// latter two also with one of PETSc's types, as in petsc:tao:bnls; default: those that serve
    /// best
    #[arg(long = "with", value_name = "NAMES", value_delimiter = ',')]
    with: Vec<String>,
}

/// Default contenders.
const DEFAULT: &[&str] = if cfg!(feature = "petsc") {
    &["native", "petsc", "petsc:snes:vinewtonrsls", "petsc:tao:tron", "petsc:tao:bnls"]
} else {
    &["native"]
};

impl Execute for Compare {
    fn execute(&self, _: Program) -> Result<()> {
        if self.scene.engine.is_some() || self.scene.vi.is_some() {
            return Err(Error::Usage("compare takes engines and contact solvers by --with".into()));
        }
        let scene = self.scene.load()?;
        // Only the condensed solver has the contact problem of modes.
        let serves = |name: &&&str| scene.time.mass != Mass::Modal || !name.contains(':');
        let names: Vec<&str> = match self.with[..] {
            [] => DEFAULT.iter().filter(serves).copied().collect(),
            _ => self.with.iter().map(String::as_str).collect(),
        };
        let contenders = names.into_iter().map(Contender::parse).collect::<Result<Vec<_>>>()?;
        let _cache = self.scene.open_cache();
        #[cfg(feature = "petsc")]
        if contenders.iter().any(|contender| contender.engine == EngineName::Petsc) {
            return self.on_petsc(&scene, &contenders);
        }
        launch::one_process("the native engine runs")?;
        refuse_petsc_options(&self.scene.petsc)?;
        let mut comparison = Comparison::new(&scene, 1);
        for contender in &contenders {
            run_native(&mut comparison, &scene, contender, Ok)?;
        }
        self.scene.voice.print(&comparison, &comparison)?;
        comparison.verdict()
    }
}

impl Compare {
    /// Compares on all ranks; an error that only some ranks have ends all.
    #[cfg(feature = "petsc")]
    fn on_petsc(&self, scene: &Scene, contenders: &[Contender]) -> Result<()> {
        let context = ranks::start(&self.scene.petsc, None, &Identity::of(scene)?)?;
        let recover = |error: Error| {
            if context.everyone.arrive(Some(PATIENCE)) { Ok(error) } else { context.fail(&error) }
        };
        let run = || {
            check_options(&context, scene, contenders, recover)?;
            let mut comparison = Comparison::new(scene, context.size());
            for contender in contenders {
                match contender.engine {
                    EngineName::Native => run_native(&mut comparison, scene, contender, recover)?,
                    EngineName::Petsc => context.with_option(contender.option(), || {
                        let model = |scene: &Scene| Model::distributed(scene, &context);
                        comparison.run(scene, contender, model, Model::solver, recover)
                    })?,
                }
            }
            if context.rank() == 0 {
                self.scene.voice.print(&comparison, &comparison)?;
            }
            comparison.verdict()
        };
        ended(&context, run())
    }
}

/// Refuses options that cannot work or that nothing uses, before the comparison.
///
/// While there are options that nothing has looked up, each contender makes one step.
#[cfg(feature = "petsc")]
fn check_options(
    context: &Rc<Context>,
    scene: &Scene,
    contenders: &[Contender],
    recover: impl Fn(Error) -> Result<Error>,
) -> Result<()> {
    let on_petsc = || contenders.iter().filter(|contender| contender.engine == EngineName::Petsc);
    for contender in on_petsc() {
        let scene = contender.scene(scene);
        context.with_option(contender.option(), || simulation::check_options(&scene, context))?;
    }
    for contender in on_petsc() {
        if context.unused_options()?.is_empty() {
            break;
        }
        let scene = contender.scene(scene);
        let step = || {
            let model = Model::distributed(&scene, context)?;
            model.scheme_with(&scene, &model.solver(&scene))?.advance()
        };
        if let Err(why) = context.with_option(contender.option(), step) {
            // The comparison will report this error; the options of this contender remain unknown.
            return recover(why).map(drop);
        }
    }
    context.refuse_unused_options()
}

/// Runs the native engine, independently on every rank.
fn run_native(
    comparison: &mut Comparison,
    scene: &Scene,
    contender: &Contender,
    recover: impl Fn(Error) -> Result<Error>,
) -> Result<()> {
    let solver =
        |_: &Model, _: &Scene| -> Box<simulation::SolverFactory<_>> { Box::new(simulation::condensed) };
    comparison.run(scene, contender, Model::new, solver, recover)
}
