//! Hard scenes on PETSc, on 1 and 2 ranks, judged as `rebond stability` judges them in one process.

use crate::common::ranks::{Case, case, long};
use rebond::Result;
use rebond::petsc::Context;
use rebond::scene::{ContactSolver, EngineName, Scene};
use rebond::simulation::Model;
use rebond::study::accuracy::plan::Method;
use rebond::study::stability::{Ending, attempt, variants};
use std::path::{Path, PathBuf};
use std::rc::Rc;

pub const CASES: &[Case] = &[
    Case {
        each_kernel: true,
        ..case("slender_cells_keep_their_promise", &[1, 2], slender_cells_keep_their_promise)
    },
    case("a_start_without_deflection_keeps_its_promise", &[1, 2], a_start_without_deflection),
    long("hard_scenes_keep_their_promise", &[2], hard_scenes_keep_their_promise),
];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/hard")
}

fn hard(name: &str) -> Result<Scene> {
    Scene::load(folder().join(format!("{name}.toml")), &[])
}

/// Applies the methods with a promise to a scene and asserts that they keep it; `refused` allows
/// some to be refused. Returns how many keep it.
fn keeps_its_promise(
    context: &Rc<Context>,
    scene: &Scene,
    vi: ContactSolver,
    refused: bool,
) -> Result<usize> {
    let mut kept = 0;
    for (own, method) in variants(scene, EngineName::Petsc, vi) {
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
        assert!(as_told, "{}: {trial:?}", scene.title);
        kept += usize::from(matches!(trial.ending, Ending::Holds));
    }
    Ok(kept)
}

fn has_promise(method: &Method) -> bool {
    let name = method.to_string();
    name.starts_with("newmark e=0 ") || name.starts_with("conserving")
}

/// Cells are a hundred or a thousand times as long as wide, and their assembled matrix has lost
/// digits: contact solvers correct their answers, and where the factor of MUMPS has none left, one
/// with twice the digits takes its place. Which it is depends on the kernel; the promises do not.
fn slender_cells_keep_their_promise(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let trials = [
        ("flat-cells", ContactSolver::Condensed, false),
        ("flat-cells", ContactSolver::Snes, false),
        ("flatter-cells", ContactSolver::Condensed, false),
    ];
    for (name, vi, refused) in trials {
        let mut scene = hard(name)?;
        scene.time.end = 150.0 * scene.time.step;
        let kept = keeps_its_promise(&context, &scene, vi, refused)?;
        assert_eq!(kept, 6, "{name}, {vi:?}");
    }
    Ok(())
}

/// A plate at rest on its obstacle, under a load that lifts it, has no deflection that could serve
/// as a scale for gaps. This is a random plate.
fn a_start_without_deflection(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let text = r#"
        plate = { length = 0.102, width = 0.0516, thickness = 4.95e-3, youngs_modulus = 4.48e11, poissons_ratio = 0.499, density = 6752.0 }
        mesh = { element = "fvs", cells = [4, 3] }
        support = [{ edge = "left", kind = "clamped" }, { edge = "right", kind = "guided" }, { edge = "top", kind = "simply_supported" }]
        obstacle = [{ side = "below", height = 0.0 }]
        load = { pressure = 1.77e6 }
        time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 2e-3 }
    "#;
    let scene = Scene::from_str(text, "drawn", &[])?;
    keeps_its_promise(&context, &scene, ContactSolver::Condensed, false).map(drop)
}

/// All hard scenes keep their promises.
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
        // The message for a clamped plate of a few cells is tested elsewhere.
        let refused = name == "no-inf-sup";
        keeps_its_promise(&context, &hard(&name)?, ContactSolver::Condensed, refused)?;
    }
    Ok(())
}
