//! Arguments that several commands share.

use super::cache::{CacheArgs, ModeCache};
use super::launch;
use super::printing::OutputMode;
use crate::error::{Error, Result};
use crate::scene::{EngineName, Scene};
use clap::Args;
use serde::Serialize;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Scene file with overrides and solver settings.
#[derive(Debug, Args)]
pub(super) struct SceneArgs {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Change a key of the scene, such as time.step=1e-6; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Linear algebra: native | petsc
    #[arg(long, value_name = "ENGINE")]
    pub engine: Option<String>,
    /// Contact solver: condensed | snes | tao
    #[arg(long, value_name = "SOLVER")]
    pub vi: Option<String>,
    #[command(flatten)]
    pub cache: CacheArgs,
    #[command(flatten)]
    pub voice: OutputMode,
    /// Options for PETSc, after --
    #[arg(last = true, value_name = "PETSC OPTIONS")]
    pub petsc: Vec<String>,
}

impl SceneArgs {
    /// Returns the folder of the results: the one given, or one of the scene file's name.
    pub fn folder(&self, out: Option<&Path>, parent: &str) -> PathBuf {
        let stem = self.scene.file_stem().unwrap_or(self.scene.as_os_str());
        out.map_or_else(|| Path::new(parent).join(stem), Path::to_path_buf)
    }

    /// Opens the cache of natural modes.
    pub fn open_cache(&self) -> ModeCache {
        self.cache.open(self.voice.is_silent())
    }

    /// Loads the scene.
    ///
    /// A scene that names no engine gets the one that works with the number of started processes.
    pub fn load(&self) -> Result<Scene> {
        self.load_with(&[])
    }

    /// Loads the scene with additional overrides.
    pub fn load_with(&self, more: &[&[String]]) -> Result<Scene> {
        let named = [("solver.engine", &self.engine), ("solver.vi", &self.vi)];
        let named = named.into_iter().filter_map(|(key, name)| Some(format!("{key}={}", name.as_ref()?)));
        let overrides: Vec<String> =
            self.overrides.iter().cloned().chain(named).chain(more.concat()).collect();
        let parallel = cfg!(feature = "petsc") && launch::size() > 1;
        let engine = if parallel { EngineName::Petsc } else { EngineName::Native };
        Scene::load_for(&self.scene, &overrides, engine)
    }
}

/// Refuses PETSc options on a run that does not read them.
pub(super) fn refuse_petsc_options(options: &[String]) -> Result<()> {
    options.first().map_or(Ok(()), |option| {
        Err(Error::Usage(format!("{option}: options after -- are for PETSc; choose it with --engine petsc")))
    })
}

/// Returns the options that are given as overrides of the keys of a table, so that they are checked
/// like keys of the scene; each option is a text in TOML, or a flag.
pub(super) fn overrides(table: &str, options: &impl Serialize) -> Vec<String> {
    let options = serde_json::to_value(options).unwrap_or_default();
    let setting = |(key, value): (&String, &Value)| match value {
        Value::String(text) => Some(format!("{table}.{key}={text}")),
        Value::Bool(true) => Some(format!("{table}.{key}=true")),
        _ => None,
    };
    options.as_object().into_iter().flatten().filter_map(setting).collect()
}

/// Parsers of options, which return values of keys in TOML.
pub(super) mod toml {
    type Parsed = Result<String, std::convert::Infallible>;

    pub fn word(text: &str) -> Parsed {
        Ok(format!("{text:?}"))
    }

    pub fn words(text: &str) -> Parsed {
        list(text, word)
    }

    pub fn numbers(text: &str) -> Parsed {
        list(text, |number| Ok(number.to_owned()))
    }

    /// Parses the numbers of cells of a mesh, such as 10x4.
    pub fn pair(text: &str) -> Parsed {
        numbers(&text.replace('x', ","))
    }

    pub fn pairs(text: &str) -> Parsed {
        list(text, pair)
    }

    fn list(text: &str, item: fn(&str) -> Parsed) -> Parsed {
        let items: Result<Vec<String>, _> = text.split(',').map(|text| item(text.trim())).collect();
        Ok(format!("[{}]", items?.join(", ")))
    }
}
