//! Command `rebond stability`.

use super::cache::CacheArgs;
use super::command::{Execute, Program};
use super::hard_scenes::HardScenes;
use super::printing::OutputMode;
use crate::error::{Error, Result};
use crate::output::paths_in;
#[cfg(feature = "petsc")]
use crate::petsc::Context;
#[cfg(feature = "petsc")]
use crate::scene::EngineName;
use crate::scene::Scene;
#[cfg(feature = "petsc")]
use crate::simulation::Model;
use crate::study::accuracy::plan::Method;
use crate::study::compare::Contender;
use crate::study::stability::{self, Case, Stability, Trial};
use clap::Args;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  rebond stability
  rebond stability plate.toml --with native,petsc:tao";

/// Try every method on hard scenes, and judge its energy, residual and penetration
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Stable {
    /// Scene files, or folders of them; default: the hard scenes that come with the program
    #[arg(value_name = "SCENES")]
    scenes: Vec<PathBuf>,
    /// Change a key of every scene, such as time.step=1e-6; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Engines and contact solvers, separated by commas: native, petsc, petsc:snes, petsc:tao, the
    /// latter two also with one of PETSc's types, as in petsc:tao:bnls
    #[arg(long = "with", value_name = "NAMES", value_delimiter = ',', default_value = "native")]
    with: Vec<String>,
    #[command(flatten)]
    cache: CacheArgs,
    #[command(flatten)]
    voice: OutputMode,
}

impl Execute for Stable {
    fn execute(&self, _: Program) -> Result<()> {
        let _cache = self.cache.open(self.voice.is_silent());
        let contenders = self.with.iter().map(|name| Contender::parse(name)).collect::<Result<Vec<_>>>()?;
        let unpacked = if self.scenes.is_empty() { Some(HardScenes::unpack()?) } else { None };
        let given = self.scenes.iter().map(PathBuf::as_path);
        let mut scenes = Vec::new();
        for path in given.chain(unpacked.as_ref().map(|scenes| &*scenes.0)) {
            for file in files(path)? {
                let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                scenes.push((name, Scene::load(&file, &self.overrides)?));
            }
        }
        #[cfg(feature = "petsc")]
        if contenders.iter().any(|contender| contender.engine == EngineName::Petsc) {
            let context = Context::start(&[])?;
            let attempt = |contender: &Contender, scene: &Scene, method| match contender.engine {
                EngineName::Native => Ok(stability::run_native(scene, method)),
                EngineName::Petsc => context.with_option(contender.option(), || {
                    let model = Model::distributed(scene, &context);
                    Ok(stability::attempt(scene, method, model, |model| model.solver(scene)))
                }),
            };
            return self.report(scenes, &contenders, attempt).and_then(|()| context.refuse_unused_options());
        }
        self.report(scenes, &contenders, |_, scene, method| Ok(stability::run_native(scene, method)))
    }
}

impl Stable {
    /// Runs all trials and reports them.
    fn report(
        &self,
        scenes: Vec<(String, Scene)>,
        contenders: &[Contender],
        attempt: impl Fn(&Contender, &Scene, Method) -> Result<Trial>,
    ) -> Result<()> {
        let mut stability = Stability::default();
        for (name, scene) in scenes {
            let mut case = Case { name, title: scene.title.clone(), trials: Vec::new() };
            for contender in contenders {
                for (scene, method) in stability::variants(&scene, contender.engine, contender.vi) {
                    case.trials.push(attempt(contender, &scene, method)?);
                }
            }
            stability.cases.push(case);
        }
        self.voice.print(&stability, &stability)?;
        stability.verdict()
    }
}

/// Returns a scene file, or the scene files of a folder by name.
fn files(path: &Path) -> Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut files = paths_in(path)?;
    files.retain(|file| file.extension().is_some_and(|extension| extension == "toml"));
    if files.is_empty() {
        return Err(Error::Usage(format!("{}: no scene in this folder", path.display())));
    }
    Ok(files)
}
