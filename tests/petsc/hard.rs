//! Hard scenes on PETSc, on 1 and 2 ranks: what `rebond stability` asks of one process.

use crate::common::ranks::{Case, case, long};
use rebond::Result;
use rebond::petsc::Context;
use rebond::scene::{EngineName, Scene, ViName};
use rebond::simulation::Model;
use rebond::study::accuracy::plan::Method;
use rebond::study::stability::{Ending, attempt, variants};
use std::path::{Path, PathBuf};
use std::rc::Rc;

pub const CASES: &[Case] = &[
    case("slender_cells_keep_their_promise", &[1, 2], slender_cells_keep_their_promise),
    long("hard_scenes_keep_their_promise", &[2], hard_scenes_keep_their_promise),
];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/hard")
}

/// Puts the methods with a promise to a scene, for at most so many steps; whether some may be refused.
fn keeps_its_promise(context: &Rc<Context>, name: &str, vi: ViName, steps: f64, refused: bool) -> Result<()> {
    let mut scene = Scene::load(folder().join(format!("{name}.toml")), &[])?;
    scene.time.end = scene.time.end.min(steps * scene.time.step);
    for (own, method) in variants(&scene, EngineName::Petsc, vi) {
        if !has_promise(&method) {
            continue;
        }
        let model = Model::distributed(&own, context);
        let trial = attempt(&own, method, model, |model| model.solver(&own));
        let as_told = match &trial.ending {
            Ending::Holds => true,
            Ending::Refused(_) => refused,
            _ => false,
        };
        assert!(as_told, "{name}: {trial:?}");
    }
    Ok(())
}

fn has_promise(method: &Method) -> bool {
    let name = method.to_string();
    name.starts_with("newmark e=0 ") || name.starts_with("conserving")
}

/// Cells a hundred times as long as wide, whose assembled matrix has lost digits: contact solvers correct their answers.
fn slender_cells_keep_their_promise(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    for vi in [ViName::Condensed, ViName::Snes] {
        keeps_its_promise(&context, "flat-cells", vi, 150.0, false)?;
    }
    Ok(())
}

/// All of them.
fn hard_scenes_keep_their_promise(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            names.push(path.file_stem().unwrap().to_str().unwrap().to_owned());
        }
    }
    names.sort();
    assert!(names.len() > 30);
    for name in names {
        // Cells of aspect ratio 1000, and a clamped plate in a few cells: the message is tested elsewhere.
        let refused = ["flatter-cells", "no-inf-sup"].contains(&name.as_str());
        keeps_its_promise(&context, &name, ViName::Condensed, f64::INFINITY, refused)?;
    }
    Ok(())
}
