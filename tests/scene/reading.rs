//! The meaning of scene files, and the errors of invalid ones.

use std::fs;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use rebond::Error;
use rebond::scene::{
    ContactSolver, Diagonal, ElementKind, EngineName, FieldInput, Mass, Obstacle, Region, Scene, SchemeSpec,
    Side, Snapshots, SourcePosition, Support, SupportKind, SupportLocation,
};

const MINIMAL: &str = r#"
plate = { length = 2, width = 1, thickness = 0.01, youngs_modulus = 1e9, poissons_ratio = 0, density = 1000 }
mesh.element = "hct"
mesh.cells = [3, 2]

[time]
scheme = "newmark"
mass = "consistent"
step = 1e-3
end = 1
"#;

const FULL: &str = r#"
title = 'the "full" one, \ and é'

[plate]
length = 1.2
width = 0.4
thickness = 1e-2
youngs_modulus = 210e9
poissons_ratio = -0.25
density = 7770

[mesh]
element = "hct"
cells = [10, 4]
diagonal = "alternating"
refine = 2

[[support]]
edge = "left"
kind = "clamped"

[[support]]
edge = "top"
kind = "simply_supported"

[[obstacle]]
side = "below"
height = -0.1

[[obstacle]]
side = "above"
height = 0.3333333333333333

[load]
pressure = -1e-300

[initial]
static_pressure = 14600.0
velocity = -0.5

[time]
scheme = "newmark"
mass = "singular"
beta = 0.25
restitution = 0.5
step = 5e-6
end = 0.5

[solver]
engine = "petsc"
vi = "snes"
tolerance = 1e-8
energy_guard = 1e3

[output]
every = 20
fields_every = 2000
checkpoint_every = 30000
subdivide = 3
probes = [{ name = "corner", at = [1.2, 0] }, { name = "côté # libre", at = [0.1, 0.4] }]
"#;

fn support(edge: &str, kind: SupportKind) -> Support {
    Support {
        name: None,
        stand: SupportLocation::Edge { edge: edge.into(), part: None },
        kind,
        elastic: None,
        motion: None,
        in_plane: None,
    }
}

fn read(text: &str, overrides: &[&str]) -> rebond::Result<Scene> {
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    Scene::from_str(text, "dir/my scene.toml", &overrides)
}

fn message(text: &str, overrides: &[&str]) -> String {
    read(text, overrides).unwrap_err().to_string()
}

fn toml_files(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    files.sort();
    files
}

/// The first line of each bad scene, `# expect: part | part`, has parts that its message must
/// contain.
#[test]
fn every_bad_scene_is_told_what_is_wrong_and_where() {
    let files = toml_files("tests/data/bad");
    assert!(files.len() >= 75);
    let mut faults = Vec::new();
    for path in files {
        let bytes = fs::read(&path).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        let first = text.lines().next().unwrap().trim_start_matches('\u{feff}');
        let parts = first.strip_prefix("# expect: ").unwrap_or_else(|| panic!("{path:?}: no expectation"));

        let error = Scene::load(&path, &[]).expect_err(&format!("{path:?} was accepted"));
        assert!(matches!(error, Error::Scene(_)), "{path:?}: {error:?}");
        assert_eq!(error.exit_code(), 2);
        let message = error.to_string();
        assert!(message.starts_with(&format!("{}:", path.display())), "{message}");
        assert!(!message.contains(char::is_control), "{message:?}");
        let lacking = parts.split(" | ").filter(|part| !message.contains(part.trim()));
        faults.extend(lacking.map(|part| format!("{message}\n  lacks {part:?}\n")));
    }
    assert!(faults.is_empty(), "{}", faults.concat());
}

#[test]
fn defaults_are_filled_in() {
    let scene = read(MINIMAL, &[]).unwrap();
    assert_eq!(scene.title, "my scene");
    assert_eq!(scene.plate.length, 2.0);
    assert_eq!(scene.mesh.diagonal, Some(Diagonal::Right));
    assert_eq!(scene.mesh.refine, 0);
    assert!(scene.supports.is_empty() && scene.obstacles.is_empty() && scene.load.is_none());
    assert!(scene.initial.static_pressure.is_zero() && scene.initial.velocity.is_zero());
    assert_eq!(scene.time.scheme, SchemeSpec::Newmark { beta: 0.5, restitution: 0.0 });
    assert_eq!(scene.time.steps(), 1000);
    assert_eq!((scene.solver.engine, scene.solver.vi), (EngineName::Native, ContactSolver::Condensed));
    assert_eq!((scene.solver.tolerance, scene.solver.energy_guard), (1e-10, 100.0));
    assert_eq!((scene.output.every, scene.output.fields), (1, None));
    assert!(scene.output.probes.is_empty());
    assert!(scene.effects().is_empty());
}

#[test]
fn the_finer_the_mesh_the_less_snapshots_cut_it() {
    let subdivide = |cells: &str| {
        let scene = read(MINIMAL, &["output.fields_every=10", &format!("mesh.cells={cells}")]).unwrap();
        scene.output.fields.unwrap().subdivide
    };
    assert_eq!(["[10, 4]", "[100, 40]", "[400, 100]"].map(subdivide), [4, 2, 1]);
}

#[test]
fn every_key_is_read() {
    let scene = read(FULL, &[]).unwrap();
    assert_eq!(scene.title, r#"the "full" one, \ and é"#);
    assert_eq!(scene.plate.plate.density, 7770.0);
    assert_eq!(scene.mesh.element, ElementKind::Hct);
    assert_eq!((scene.mesh.cells, scene.mesh.refine), ([10, 4], 2));
    assert_eq!(scene.supports[1], support("top", SupportKind::SimplySupported));
    let height = FieldInput::new("obstacle.0.height", -0.1);
    assert_eq!(
        scene.obstacles[0],
        Obstacle {
            name: None,
            side: Side::Below,
            height,
            region: Region::All,
            compliance: None,
            position: SourcePosition::default(),
            friction: None,
            velocity: None,
        }
    );
    assert_eq!(scene.obstacles[1].height.number(), Some(0.3333333333333333));
    assert_eq!(scene.time.mass, Mass::Singular);
    assert_eq!(scene.time.steps(), 100_000);
    assert_eq!(
        scene.output.fields,
        Some(Snapshots { every: 2000, subdivide: 3, stresses: false, precision: 32 })
    );
    assert_eq!(scene.output.checkpoint_every, Some(30_000));
    assert_eq!(scene.output.probes[1].name, "côté # libre");
    let effects = [
        "contact below",
        "contact above",
        "constant load",
        "initial static deflection",
        "initial velocity",
        "restitution e = 0.5",
    ];
    assert_eq!(scene.effects(), effects);
}

#[test]
fn the_resolved_scene_reads_back_to_itself() {
    let midpoint = ["time.scheme=midpoint", "mesh.element=fvs", "mesh.cells=[1,1]"];
    for scene in [read(FULL, &[]), read(MINIMAL, &[]), read(MINIMAL, &midpoint)].map(Result::unwrap) {
        let resolved = scene.resolved();
        let again = Scene::from_str(&resolved, "other.toml", &[])
            .unwrap_or_else(|error| panic!("{error}\n{resolved}"));
        assert_eq!(again, scene);
        assert_eq!(again.resolved(), resolved);
        assert_eq!(again.hash(), scene.hash());
    }
}

#[test]
fn the_resolved_scene_is_aligned_and_names_its_units() {
    let resolved = read(MINIMAL, &[]).unwrap().resolved();
    let expected = r#"title = "my scene"

[plate]
length         = 2.0     # m, along x
width          = 1.0     # m, along y
thickness      = 0.01    # m
youngs_modulus = 1e9     # Pa
"#;
    assert!(resolved.starts_with(expected), "{resolved}");
}

#[test]
fn the_hash_follows_the_scene_and_not_its_spelling() {
    let hash = |overrides| read(MINIMAL, overrides).unwrap().hash();
    assert_eq!(hash(&[]).len(), 16);
    assert_eq!(hash(&[]), hash(&["time.beta=0.50"]));
    assert_ne!(hash(&[]), hash(&["time.beta=0.51"]));
}

/// The summary uses the words of the scene file.
#[test]
fn json_says_what_the_scene_file_says() {
    let scene = read(FULL, &[]).unwrap();
    let json = serde_json::to_value(&scene).unwrap();
    let toml: toml::Value = toml::from_str(&scene.resolved()).unwrap();
    assert_eq!(json, serde_json::to_value(toml).unwrap());
}

#[test]
fn overrides_change_add_and_append() {
    let scene = read(
        FULL,
        &[
            "time.step=1e-6",
            " time.end = 0.25 ",
            "time.mass=consistent",
            "title=two words",
            "obstacle.0.height=-0.2",
            "output.probes.0.name=tip",
            "output.probes.2={ name = 'mid', at = [0.5, 0.2] }",
            "support.2.edge=\"right\"",
            "support.2.kind=guided",
            "mesh.cells=[5, 2]",
            "mesh.cells.1=3",
        ],
    )
    .unwrap();
    assert_eq!(scene.time.steps(), 250_000);
    assert_eq!(scene.time.mass, Mass::Consistent);
    assert_eq!(scene.title, "two words");
    assert_eq!(scene.obstacles[0].height.number(), Some(-0.2));
    assert_eq!(scene.output.probes[0].name, "tip");
    assert_eq!(scene.output.probes[2].at, [0.5, 0.2]);
    assert_eq!(scene.supports[2], support("right", SupportKind::Guided));
    assert_eq!(scene.mesh.cells, [5, 3]);

    let scene = read(MINIMAL, &["load.pressure=3", "obstacle.0.side=above", "obstacle.0.height=1"]).unwrap();
    assert_eq!(scene.effects(), ["contact above", "constant load"]);
}

#[test]
fn a_choice_by_override_drops_the_parameters_of_the_files() {
    let own = ["time.scheme=newmark", "time.beta=0.25", "mesh.element=hct", "mesh.diagonal=left"];
    let file = read(MINIMAL, &own).unwrap().resolved();
    let scene = read(&file, &["time.scheme=exact", "time.mass=singular", "mesh.element=fvs"]).unwrap();
    assert_eq!((scene.time.scheme, scene.mesh.diagonal), (SchemeSpec::Exact, None));
    let both = ["time.scheme=exact", "time.mass=singular", "time.beta=0.3"];
    assert!(message(&file, &both).contains("time.beta: contradicts"), "{}", message(&file, &both));
}

/// The limits themselves are out of range, and all values between them are valid.
#[test]
fn poissons_ratio_lies_between_its_limits() {
    for ratio in ["-0.999", "-0.5", "0", "0.4999999"] {
        read(MINIMAL, &[&format!("plate.poissons_ratio={ratio}")]).unwrap();
    }
    for ratio in ["-1", "0.5", "0.7", "-3"] {
        let message = message(MINIMAL, &[&format!("plate.poissons_ratio={ratio}")]);
        let expected = "is out of range; expected Poisson's ratio greater than -1 and less than 0.5";
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn the_last_override_wins() {
    let scene = read(MINIMAL, &["time.step=0.1", "time.step=0.01"]).unwrap();
    assert_eq!(scene.time.step, 0.01);
}

#[test]
fn bad_overrides_are_named() {
    let deep = format!("plate{}=1", ".a".repeat(100_000));
    let cases = [
        (
            "time.step=0",
            "--set time.step=0: time.step: 0 is not positive; expected a time step in s greater than 0",
        ),
        (
            "time.step=fast",
            "--set time.step=fast: time.step: found the string \"fast\"; expected a time step",
        ),
        ("time.step=", "--set time.step=: time.step: invalid TOML: "),
        ("time.step=.5", "--set time.step=.5: time.step: invalid TOML: invalid mantissa; expected digits"),
        (
            "time.step=20us",
            "--set time.step=20us: time.step: found a number with a unit; expected the number alone, in s",
        ),
        (
            "plate.thickness=0,001",
            "plate.thickness: invalid TOML: unexpected content; a decimal point is written .",
        ),
        ("time.step=1\n2", "--set time.step=1\\n2: time.step: invalid TOML: unexpected content"),
        ("time.stepp=1", "--set time.stepp=1: time.stepp: unknown key; expected one of scheme,"),
        ("tame.step=1", "--set tame.step=1: tame: unknown key; expected one of title,"),
        (
            "time.step.x=1",
            "--set time.step.x=1: time.step.x: found the number 0.001 before \"x\"; expected a table",
        ),
        (
            "time.step=1e-3,time.end=2",
            "time.end=2: time.step: the value goes on with another key, \"time.end\"; expected one --set per key",
        ),
        ("time.scheme=exact, time.mass=singular", "another key, \"time.mass\"; expected one --set per key"),
        ("title=a,title = b", "another key, \"title\"; expected one --set per key"),
        ("time=1", "--set time=1: time: found the integer 1; expected a table"),
        ("time={ mass = 3 }", "--set time={ mass = 3 }: time.scheme: missing; expected"),
        (
            "obstacle.1.height=1",
            "obstacle.1.height: \"1\" is no entry; expected an index from 0 to 0, 0 to add one",
        ),
        ("mesh.cells.x=1", "mesh.cells.x: \"x\" is no entry; expected an index from 0 to 2"),
        (
            "obstacle.0.side=above",
            "--set obstacle.0.side=above: obstacle.0.height: missing; expected a height in m",
        ),
        ("time.step", "--set time.step: there is no \"=\"; expected --set key=value"),
        ("=1", "--set =1: \"\" is no key; expected --set key=value"),
        ("time..step=1", "--set time..step=1: \"time..step\" is no key"),
        (&deep, "is no key; expected --set key=value"),
    ];
    for (text, expected) in cases {
        let first = if text.starts_with("obstacle.1") { vec!["obstacle=[]", text] } else { vec![text] };
        let message = message(MINIMAL, &first);
        assert!(message.starts_with("--set ") && message.contains(expected), "{message}\nlacks {expected:?}");
        assert!(!message.contains(char::is_control));
    }
}

/// Commas and comparisons within a value belong to the value.
#[test]
fn a_value_with_commas_is_one_value() {
    for value in ["a, b", "'a,b=2'", "if(x >= 1, y == 2, y <= 3)", "min(x, y), z"] {
        read(MINIMAL, &[&format!("title={value}")]).unwrap();
    }
    read(MINIMAL, &["output={ every = 2, probes = [{ name = 'a', at = [1, 0] }] }"]).unwrap();
}

#[test]
fn a_formula_needs_no_quotes() {
    for formula in ["100*step(t - 0.1)", "(1 + x)*3", "-2*y^2", "sin(t)", "2/(1 + t)"] {
        let [bare, quoted] = ["", "\""].map(|quote| {
            let scene = read(MINIMAL, &[&format!("load.pressure={quote}{formula}{quote}")]).unwrap();
            format!("{:?}", scene.load)
        });
        assert_eq!(bare, quoted, "{formula}");
    }
    let wrong = message(MINIMAL, &["load.pressure=100*stp(t)"]);
    assert!(
        wrong.starts_with("--set load.pressure=100*stp(t): load.pressure: ") && wrong.contains("stp"),
        "{wrong}"
    );
    let open = message(MINIMAL, &["load.pressure=\"100*sin(t)"]);
    assert!(open.contains("invalid TOML"), "{open}");
    let in_one_line = message("plate = { length = 0.4, thickness = 2,5e-3, density = 7800 }\n", &[]);
    assert!(in_one_line.ends_with("; a decimal point is written ."), "{in_one_line}");
}

/// Returns the four numbers that the message suggests.
fn offers(message: &str) -> Vec<String> {
    let (_, expected) = message.split_once("expected ").unwrap();
    let offer = |part: &str| {
        let (key, values) = part.split_once(" = ").unwrap();
        values
            .split(" or ")
            .map(|value| format!("{}={value}", key.trim_start_matches("or ")))
            .collect::<Vec<_>>()
    };
    expected.split(", ").flat_map(offer).collect()
}

#[test]
fn an_end_between_two_steps_is_refused_with_what_fits() {
    let between = message(MINIMAL, &["time.step=3e-4", "time.end=0.1"]);
    let words = "time.end: 0.1 s is no whole number of steps of 0.0003 s, but 333.333333 of them; expected time.step = \
                 0.0003003003003 or 0.000299401197605, or time.end = 0.0999 or 0.1002";
    assert!(between.ends_with(words), "{between}");
    assert_eq!(offers(&between).len(), 4);
    // The message names the step if only the step was changed, and the line of the end if the file
    // contains it.
    assert!(message(MINIMAL, &["time.step=3e-4"]).starts_with("--set time.step=3e-4: time.step: 1.0 s"));
    let file = message(&MINIMAL.replace("end = 1", "end = 1.0005"), &[]);
    assert!(file.starts_with("dir/my scene.toml:10:7: time.end: 1.0005 s"), "{file}");
    for (step, end) in [("5e-6", "0.25"), ("1e-4", "0.3"), ("3.3333333333333335e-5", "1"), ("1e-3", "1e3")] {
        read(MINIMAL, &[&format!("time.step={step}"), &format!("time.end={end}")]).unwrap();
    }
}

#[test]
fn an_override_is_blamed_only_for_itself() {
    let text = FULL.replace("velocity = -0.5", "velocity = nan");
    let message = message(&text, &["time.step=1e-6"]);
    assert!(
        message.starts_with("dir/my scene.toml:39:12: initial.velocity: nan is not a finite number;"),
        "{message}"
    );
}

#[test]
fn a_byte_order_mark_and_long_keys_are_harmless() {
    assert!(read(&format!("\u{feff}{MINIMAL}"), &[]).is_ok());
    let message = message(&format!("{}a = 1\n{MINIMAL}", "a.".repeat(100_000)), &[]);
    assert!(message.contains(":1:"), "{message}");
}

#[test]
fn a_missing_file_is_an_input_error() {
    let error = Scene::load("no such folder/scene.toml", &[]).unwrap_err();
    assert_eq!(error.exit_code(), 4);
    assert!(error.to_string().contains("no such folder/scene.toml"));
}

#[test]
fn the_scenes_of_the_paper_are_valid() {
    let files = toml_files("scenes/csma2013");
    assert_eq!(files.len(), 6);
    for (path, number) in files.iter().zip(1..) {
        let scene = Scene::load(path, &[]).unwrap();
        assert!(scene.title.contains(&format!("figure {number}")), "{}", scene.title);
        let element = if number % 2 == 1 { ElementKind::Hct } else { ElementKind::Fvs };
        assert_eq!(scene.mesh.element, element);
        assert_eq!(matches!(scene.time.scheme, SchemeSpec::Midpoint { .. }), number > 4);
        assert_eq!(scene.time.steps(), 100_000);
        assert_eq!(scene.effects(), ["contact below", "initial static deflection"]);
    }
}

#[test]
fn the_scenes_for_studies_are_valid() {
    let files = toml_files("scenes/study");
    assert_eq!(files.len(), 5);
    for path in files {
        let scene = Scene::load(&path, &[]).unwrap();
        let study = scene.study.clone().unwrap();
        assert_eq!(scene.study(), study);
        let read = Scene::from_str(&scene.resolved(), "resolved.toml", &[]).unwrap();
        assert_eq!(read, scene);
    }
}

/// Every `--set` line in the comments of the paper's scenes works.
#[test]
fn the_variants_of_the_paper_are_valid() {
    for path in toml_files("scenes/csma2013") {
        let text = fs::read_to_string(&path).unwrap();
        for line in text.lines().filter(|line| line.contains("--set")) {
            let words = line.split_whitespace().collect::<Vec<_>>();
            let overrides: Vec<String> =
                words.windows(2).filter(|pair| pair[0] == "--set").map(|pair| pair[1].to_owned()).collect();
            assert_ne!(Scene::load(&path, &overrides).unwrap(), Scene::load(&path, &[]).unwrap(), "{line}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// For any step and end, a scene that is read ends on its last step, and the suggestions of a
    /// refusal are accepted.
    #[test]
    fn runs_end_on_their_last_step(step in -7.0..0.0_f64, steps in 1.0..1e6_f64, whole in any::<bool>()) {
        let step = 10_f64.powf(step);
        let end = step * if whole { steps.round() } else { steps };
        let with = |more: &str| {
            read(MINIMAL, &[&format!("time.step={step:e}"), &format!("time.end={end:e}"), more])
        };
        match with("title=as it is") {
            Ok(scene) => prop_assert!((scene.time.steps() as f64 * step - end).abs() <= 1.01e-9 * end),
            Err(error) => {
                prop_assert!(!whole);
                for offer in offers(&error.to_string()) {
                    prop_assert!(with(&offer).is_ok(), "{error}: {offer}");
                }
            }
        }
    }
}

/// Replaces, inserts or removes bytes at some places.
fn mutate(text: &str, edits: &[(prop::sample::Index, u8, Option<u8>)]) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for (index, kind, byte) in edits {
        let at = index.index(bytes.len());
        match (kind % 3, byte) {
            (0, Some(byte)) => bytes[at] = *byte,
            (1, Some(byte)) => bytes.insert(at, *byte),
            _ => drop(bytes.remove(at)),
        }
    }
    bytes
}

/// Returns a strategy for bytes that mostly have a meaning in TOML; some have none anywhere.
fn any_byte() -> impl Strategy<Value = u8> {
    prop_oneof![4 => prop::sample::select(b"[]{}=.,\"'#-+_0123456789eina \n\r\t".to_vec()), 1 => any::<u8>()]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_cause_a_panic(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), prop::option::of(any_byte())), 1..8)
    ) {
        match Scene::from_bytes(&mutate(FULL, &edits), "scene.toml", &[]) {
            Ok(scene) => prop_assert_eq!(&Scene::from_str(&scene.resolved(), "", &[]).unwrap(), &scene),
            Err(Error::Scene(message)) => {
                prop_assert!(message.starts_with("scene.toml:") && !message.contains(char::is_control))
            }
            Err(other) => prop_assert!(false, "{other:?}"),
        }
    }

    #[test]
    fn no_override_causes_a_panic(key in "[a-z.0-3]{0,12}|(time|mesh|output)[.][a-z.0-2]{0,9}", value in "[^=]{0,12}") {
        let answer = read(FULL, &[&format!("{key}={value}")]);
        prop_assert!(matches!(answer, Ok(_) | Err(Error::Scene(_))));
    }
}
