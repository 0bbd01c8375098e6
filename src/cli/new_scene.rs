//! Command `rebond new`.

use super::command::{Execute, Program};
use super::printing::print;
use crate::error::{Error, Result};
use crate::output::write_atomic;
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  rebond new                  # plate.toml
  rebond new gmsh             # gmsh.toml, with the drawing and the mesh of its plate
  rebond new shaker --out rig/strip.toml";

/// Write a commented scene to begin with: a falling plate, a Gmsh mesh, a shaker, ...
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct NewScene {
    /// Kind of scene
    #[arg(value_enum, default_value_t = Template::Plate)]
    kind: Template,
    /// Scene file; default: the kind, with the extension toml
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace files that exist
    #[arg(long)]
    overwrite: bool,
}

/// Scene to begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Template {
    /// A plate, clamped at one edge, falls on a floor
    Plate,
    /// A bracket of a Gmsh mesh in millimetres strikes a pin
    Gmsh,
    /// A strip on a moving support between two stops, with a sweep over the frequency
    Shaker,
    /// A hinged cover drops on a rubber stop under one corner
    Stop,
    /// A ball jumps on a plate
    Ball,
    /// A plate on a fine mesh, by its lowest modes, falls on two rails
    Modal,
    /// A strip on a shaker table, by its measured acceleration, strikes a stop
    Measured,
    /// A round plate, clamped at its rim, drums on a stop
    Disc,
    /// A plate without obstacles rings at its natural frequencies
    Free,
}

/// Returns a file of a folder of `scenes`, by default `new`, which the program includes.
macro_rules! included {
    ($name:literal) => {
        included!("new", $name)
    };
    ($folder:literal, $name:literal) => {
        ($name, include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/", $folder, "/", $name)))
    };
}

impl Template {
    /// Returns the files of the kind with their contents, the scene first.
    fn files(self) -> Vec<(&'static str, &'static str)> {
        match self {
            Template::Plate => vec![included!("plate.toml")],
            Template::Gmsh => {
                vec![included!("gmsh.toml"), included!("bracket.geo"), included!("bracket.msh")]
            }
            Template::Shaker => vec![included!("shaker.toml")],
            Template::Stop => vec![included!("stop.toml")],
            Template::Ball => vec![included!("ball.toml")],
            Template::Modal => vec![included!("modal.toml")],
            Template::Measured => vec![included!("measured.toml"), included!("measured.csv")],
            Template::Disc => {
                vec![included!("disc.toml"), included!("disc.geo"), included!("gallery", "disc.msh")]
            }
            Template::Free => vec![included!("free.toml")],
        }
    }
}

impl Execute for NewScene {
    fn execute(&self, _: Program) -> Result<()> {
        let files = self.kind.files();
        let template = files[0].0;
        let scene = self.out.clone().unwrap_or_else(|| template.into());
        let Some(name) = scene.file_name() else {
            let wrong = format!("--out {}: names no file; expected one such as {template}", scene.display());
            return Err(Error::Usage(wrong));
        };
        // The comments of a scene name its file and the folder of its run.
        let name = name.to_string_lossy();
        let stem = |name: &str| name.strip_suffix(".toml").unwrap_or(name).to_owned();
        let text = files[0].1.replace(template, &name);
        let text = text.replace(&format!("runs/{}", stem(template)), &format!("runs/{}", stem(&name)));
        let text = text.replace(&format!("sweeps/{}", stem(template)), &format!("sweeps/{}", stem(&name)));
        let folder = scene.parent().unwrap_or(Path::new(""));
        let beside = files[1..].iter().map(|(name, text)| (folder.join(name), (*text).to_owned()));
        let files: Vec<(PathBuf, String)> = std::iter::once((scene.clone(), text)).chain(beside).collect();
        // A symbolic link without a target counts as a file.
        let there = |(path, _): &&(PathBuf, String)| std::fs::symlink_metadata(path).is_ok();
        if let (false, Some((path, _))) = (self.overwrite, files.iter().find(there)) {
            let expected = "--out FILE names another file, --overwrite replaces it";
            return Err(Error::Usage(format!("{} is there already: {expected}", path.display())));
        }
        std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
        for (path, text) in &files {
            write_atomic(path, text.as_bytes())?;
        }
        let listed: String = files.iter().map(|(path, _)| format!("{}\n", path.display())).collect();
        print(&format!("{listed}\nrebond check {0}\nrebond run {0}\n", scene.display()))
    }
}
