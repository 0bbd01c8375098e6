//! Every scene of scenes/hard with every method. Each scheme keeps its promise on the energy, every
//! step is solved to the last digits, and scenes without a solution are refused with a helpful
//! message. `rebond stability` prints the same results as a table.

use rebond::scene::{ContactSolver, EngineName, Mass, Scene, SchemeSpec};
use rebond::study::stability::{Ending, Trial, run_native, variants};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Trials of schemes with a promise on the energy that do not end in "holds".
const EXCEPTIONS: &[(&str, &str, &str)] = &[
    // The slowest motions are 1e8 times slower than those of a pair of triangles, and the dense
    // matrices contain both.
    ("flatter-cells", "hct 10x1, exact singular", "refused"),
    // The same range of motions spoils the digits of the natural modes.
    ("flatter-cells", "conserving modal", "refused"),
    ("flatter-cells", "exact modal", "refused"),
    ("flat-cells", "exact modal", "drifts"),
    // Where U(p) does not exist, these schemes are undefined.
    ("no-inf-sup", "midpoint singular", "refused"),
    ("no-inf-sup", "conserving singular", "refused"),
    ("no-inf-sup", "exact singular", "refused"),
];

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/hard")
}

/// Returns the verdict that theory predicts for a trial that ended well.
fn expected(scene: &str, trial: &Trial) -> Option<&'static str> {
    let method = trial.method.to_string();
    let of_mesh = format!("{}, {method}", trial.mesh);
    let of_method = |of: &str| of == method || of == of_mesh;
    let exception = EXCEPTIONS.iter().find(|(name, of, _)| *name == scene && of_method(of));
    let promising = match trial.method.scheme {
        SchemeSpec::Newmark { restitution, .. } => restitution == 0.0,
        SchemeSpec::Midpoint { .. } => false,
        SchemeSpec::Conserving | SchemeSpec::Exact => true,
    };
    exception.map(|(_, _, word)| *word).or(promising.then_some("holds"))
}

fn judge(name: &str, trial: &Trial) {
    let what = format!("{name}, {}, {}: {trial:?}", trial.mesh, trial.method);
    assert!(!matches!(trial.ending, Ending::Fails(_)), "{what}");
    if let Some(word) = expected(name, trial) {
        assert_eq!(trial.ending.told().0, word, "{what}");
    }
    if let Some(figures) = &trial.figures {
        assert!(figures.worst_kkt <= 1e-10 && figures.penetration <= 1e-12, "{what}");
    }
    // The message names the scheme that is unstable by nature, and one that is stable.
    if trial.method.mass == Mass::Consistent
        && matches!(trial.method.scheme, SchemeSpec::Midpoint { .. })
        && let Some(why) = trial.ending.told().1
    {
        assert!(why.contains("midpoint") && why.contains("time.mass = \"singular\""), "{what}");
    }
}

fn holds(name: &str) -> Vec<Trial> {
    let scene = Scene::load(folder().join(name).with_extension("toml"), &[]).unwrap();
    let trials: Vec<Trial> = variants(&scene, EngineName::Native, ContactSolver::Condensed)
        .into_iter()
        .map(|(scene, method)| run_native(&scene, method))
        .collect();
    trials.iter().for_each(|trial| judge(name, trial));
    trials
}

macro_rules! scenes {
    ($($test:ident $name:literal),* $(,)?) => {
        $(#[test]
        fn $test() {
            holds($name);
        })*

        #[test]
        fn no_scene_is_left_out() {
            let here: BTreeSet<String> = [$($name),*].iter().map(ToString::to_string).chain(["never-reached".into()]).collect();
            let files = std::fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path());
            let scenes = files.filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
            let files: BTreeSet<String> = scenes.map(|path| path.file_stem().unwrap().to_string_lossy().into_owned()).collect();
            assert_eq!(here, files);
        }
    };
}

scenes! {
    all_in_contact "all-in-contact", beds_of_stops "beds-of-stops", caps "caps", chatter "chatter", closed_at_a_point "closed-at-a-point", closed_gap "closed-gap", dented "dented", dropped_flat "dropped-flat", fine "fine",
    flat_cells "flat-cells", flatter_cells "flatter-cells", gap_zero "gap-zero", graded "graded", graded_cut "graded-cut", grazing "grazing", hertz_stops "hertz-stops", incompatible_start "incompatible-start",
    kilometre "kilometre", micrometre "micrometre", needles "needles", no_inf_sup "no-inf-sup", one_node "one-node", point_obstacle "point-obstacle", poisson_0 "poisson-0",
    poisson_0_499 "poisson-0.499", preload "preload", resting "resting", slender "slender", soft "soft", step_1 "step-1", step_obstacle "step-obstacle",
    step_1e_8 "step-1e-8", stiff "stiff", thick "thick", thin "thin", thrown_into "thrown-into", tight_gap "tight-gap", turned "turned", unequal_stops "unequal-stops", wedge "wedge",
}

#[test]
fn what_is_never_reached_is_never_felt() {
    for trial in holds("never-reached") {
        let figures = trial.figures.unwrap();
        assert_eq!((figures.contact_steps, figures.most_contact_nodes), (0, 0));
        assert_eq!(trial.ending, Ending::Holds);
    }
}
