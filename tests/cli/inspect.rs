//! Reports on a scene before it runs.

use crate::common::plates::close;
use rebond::scene::{Scene, SchemeSpec};
use rebond::study::{self, Frequencies, StaticReaction, advised_step, energy_step};

fn scene(figure: u32, overrides: &[&str]) -> Scene {
    let path = format!("{}/scenes/csma2013/fig{figure}.toml", env!("CARGO_MANIFEST_DIR"));
    Scene::load(path, &overrides.iter().map(|o| o.to_string()).collect::<Vec<_>>()).unwrap()
}

/// Figure 4 has quadrilaterals, and Newmark's scheme with e = 0 and the singular mass.
#[test]
fn the_plate_of_the_paper() {
    let inspection = study::inspect(&scene(4, &[])).unwrap();
    let sizes = [inspection.nodes, inspection.cells, inspection.dofs, inspection.bounded_dofs];
    assert_eq!(sizes, [55, 40, 150, 50]);
    close("mass", inspection.mass, 37.296, 1e-13);
    close("E_0", inspection.initial_energy.unwrap(), 289.36622567, 1e-9);
    assert_eq!(inspection.deflections[0].probe, "corner");
    close("corner", inspection.deflections[0].start.unwrap(), 0.2076308761, 1e-9);
    assert_eq!(inspection.deflections[0].loaded, None);
    assert_eq!(inspection.singular.lowest.len(), 6);
    close("f1, singular", inspection.singular.lowest[0], 5.965529775, 1e-9);
    close("f1, consistent", inspection.consistent.lowest[0], 5.953822665, 1e-9);
    close("highest, singular", inspection.singular.highest.unwrap(), 9142.18, 1e-6);
    close("inf-sup", inspection.inf_sup.raw.unwrap(), 5.6393574385e-3, 1e-8);
    assert_eq!(inspection.advised_step, Some(2e-5));
    // This is the paper's own step.
    assert_eq!(inspection.energy_step, Some(5e-6));
    assert!(inspection.warnings.is_empty() && inspection.mechanism.is_none());

    let report = inspection.to_string();
    assert!(
        report.lines().any(|line| line.split_whitespace().eq(["initial", "energy", "289.37", "J"])),
        "{report}"
    );
    let json = serde_json::to_value(&inspection).unwrap();
    assert_eq!(json["inf_sup"]["raw"], inspection.inf_sup.raw.unwrap());
}

/// The clamp bears 14600 Pa on 1.2 m x 0.4 m, with an arm of half the length; the loads of an
/// equilibrium likewise. Elastic edges share the load of a plate that leans on them evenly.
#[test]
fn supports_react_to_the_load_of_the_start() {
    let force = 14600.0 * 1.2 * 0.4;
    let own = scene(4, &["support.0.name=clamp"]);
    let gravity = ["initial.static_pressure=0", "initial.equilibrium=true", "load.pressure=14600"];
    for (scene, name) in [(own, "clamp"), (scene(4, &gravity), "support_1")] {
        let inspection = study::inspect(&scene).unwrap();
        let [StaticReaction { support, force: found, moments }] = &inspection.reactions[..] else { panic!() };
        assert_eq!(support, name);
        close("force", *found, -force, 1e-11);
        close("moment", moments[1], 0.6 * force, 1e-11);
        assert_eq!(moments[0], 0.0);
        assert!(inspection.to_string().contains("-7008 N"), "{inspection}");
    }
    let elastic = "support=[{ edge = \"left\", kind = \"elastic\", stiffness = 1e6 }, { edge = \"right\", kind = \"elastic\", stiffness = 1e6 }]";
    let inspection = study::inspect(&scene(4, &[elastic])).unwrap();
    assert_eq!(inspection.reactions.len(), 2);
    inspection.reactions.iter().for_each(|of| close(&of.support, of.force, -0.5 * force, 1e-9));
    // A plate that starts from a deflection has no static load.
    let thrown = scene(4, &["initial.static_pressure=0", "initial.deflection=0.1*x^2"]);
    assert!(study::inspect(&thrown).unwrap().reactions.is_empty());
}

#[test]
fn a_constant_load_has_its_own_equilibrium() {
    let inspection = study::inspect(&scene(4, &["load.pressure=7300", "obstacle=[]"])).unwrap();
    let corner = &inspection.deflections[0];
    close("half the pressure", corner.loaded.unwrap(), 0.5 * corner.start.unwrap(), 1e-12);
    // The energy is the elastic energy E minus the work of half the load that caused it, E - E.
    assert!(inspection.initial_energy.unwrap().abs() < 1e-9);
}

#[test]
fn a_mechanism_is_named_and_has_no_statics() {
    let inspection = study::inspect(&scene(4, &["support=[]"])).unwrap();
    assert_eq!(inspection.mechanism, Some("nothing holds it"));
    assert_eq!((inspection.initial_energy, inspection.deflections[0].start), (None, None));
    assert_eq!(inspection.consistent.lowest[..3], [0.0; 3]);
    assert_eq!(inspection.singular.lowest[..3], [0.0; 3]);
    assert_eq!(inspection.inf_sup.energy, None);
    assert!(inspection.warnings[0].contains("nothing holds it"), "{:?}", inspection.warnings);
}

#[test]
fn warnings_say_what_will_go_wrong() {
    let said = |figure, overrides: &[&str], words: &str| {
        let warnings = study::inspect(&scene(figure, overrides)).unwrap().warnings;
        assert!(warnings.iter().any(|warning| warning.contains(words)), "{words}: {warnings:?}");
    };
    said(4, &["time.step=1e-3"], "the deflection up to the second impact to 1 %: 2e-5 s is advised");
    said(4, &["time.step=1e-3"], "keep the energy at impacts to 1 %, which takes 5e-6 s");
    said(
        4,
        &["time.step=1e-3", "obstacle=[]"],
        "the periods of the first six modes to 1 %: 1e-4 s is advised",
    );
    said(4, &["time.mass=\"consistent\""], "does not vanish with the step");
    said(6, &["time.mass=\"consistent\""], "unstable");
    // The plate of eight triangles has one free node and is clamped all around.
    let clamped = r#"support=[{edge="left",kind="clamped"},{edge="right",kind="clamped"},{edge="top",kind="clamped"},{edge="bottom",kind="clamped"}]"#;
    said(3, &["mesh.cells=[2,2]", clamped], "inf-sup condition fails");
}

#[test]
fn a_check_resolves_the_scene_and_tells_its_cost() {
    let scene = scene(3, &[]);
    let check = study::check(&scene).unwrap();
    assert_eq!(Scene::from_str(&check.scene, "resolved", &[]).unwrap(), scene);
    assert_eq!(check.effects, scene.effects());
    assert_eq!((check.dofs, check.steps, check.step), (150, 100_000, 5e-6));
    assert_eq!(check.frequencies.lowest.len(), 6);
    close("f1", check.frequencies.lowest[0], 5.977992778, 1e-9);
    assert!(check.factor_entries >= 150 && check.memory > 8 * check.factor_entries);
    assert!(check.expected_seconds >= 1e5 * check.seconds_per_step && check.seconds_per_step > 0.0);
    assert_eq!((check.advised_step, check.energy_step), (Some(2e-5), Some(5e-7)));
    let text = check.to_string();
    let words =
        ["55 nodes, 80 cells, 150 dofs, of which 50 may touch", "20 us is advised", "100 000 steps, about"];
    assert!(words.iter().all(|words| text.contains(words)) && !text.contains(&check.scene), "{text}");
}

/// A check refuses a scene that could not start to run.
#[test]
fn a_check_refuses_what_a_run_would() {
    let error = study::check(&scene(4, &["support=[]"])).unwrap_err();
    assert!(error.to_string().contains("mechanism"), "{error}");
}

const NEWMARK: SchemeSpec = SchemeSpec::Newmark { beta: 0.5, restitution: 0.0 };

#[test]
fn advised_steps_are_round_and_bounded() {
    let frequencies = |highest| Frequencies { lowest: vec![0.0, 5.0, 40.0], highest };
    let advise = |highest| advised_step(NEWMARK, &frequencies(highest), true);
    // The advised step is a fraction of the first period, however fast the fastest motion is, and
    // never shorter than that motion requires.
    assert_eq!(
        [advise(Some(9142.0)), advise(Some(1e9)), advise(Some(50.0))],
        [Some(2e-5), Some(2e-5), Some(1e-3)]
    );
    assert_eq!(advise(None), None);
    let free = |scheme| advised_step(scheme, &frequencies(Some(9142.0)), false);
    assert_eq!([free(NEWMARK), free(SchemeSpec::Conserving)], [Some(5e-4), Some(1e-3)]);
    assert_eq!(energy_step(&frequencies(Some(9142.0))), Some(5e-6));
}

/// A run can follow the advised step, and finer meshes do not shorten it. For `conserving` no step
/// is advised for the energy.
#[test]
fn finer_meshes_advise_the_same_step() {
    for cells in ["mesh.cells=[5, 2]", "mesh.cells=[20, 8]", "mesh.cells=[40, 16]"] {
        let check = study::check(&scene(4, &[cells, "time.end=1e-4"])).unwrap();
        assert_eq!(check.advised_step, Some(2e-5), "{cells}");
        let check = study::check(&scene(4, &[cells, "time.end=1e-4", "time.scheme=conserving"])).unwrap();
        assert_eq!((check.advised_step, check.energy_step), (Some(2e-5), None), "{cells}");
        assert!(check.warnings.is_empty(), "{:?}", check.warnings);
    }
}

/// A plate in millimetres has no modes to be found; the question about its units is asked all the
/// same. Moments alone have no force, but for rounding.
#[test]
fn odd_numbers_are_asked_about() {
    let plate = |length: f64, [scheme, mass]: [&str; 2], more: &str| {
        let text = format!(
            "plate = {{ length = {length}, width = 0.1, thickness = 0.001, youngs_modulus = 7e10, poissons_ratio = 0.3, density = 2700 }}\n\
             mesh = {{ element = \"fvs\", cells = [4, 2] }}\nsupport = [{{ edge = \"left\", kind = \"clamped\" }}]\n\
             time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = 1e-5, end = 1e-4 }}\n{more}"
        );
        study::check(&Scene::from_str(&text, "odd.toml", &[]).unwrap())
    };
    let modal = ["conserving", "modal"];
    for mass in [["newmark", "consistent"], modal] {
        let refused = plate(200.0, mass, "").unwrap_err().to_string();
        assert!(
            refused.contains("residual") && refused.contains("is plate.length in millimetres?"),
            "{refused}"
        );
    }
    let warnings = plate(0.2, modal, "damping.modal = 1.5").unwrap().warnings;
    assert!(warnings[0].starts_with("damping.modal = 1.5 is more than critical"), "{warnings:?}");
    // Inside a cell, and at a node.
    for at in [[0.03, 0.033], [0.2, 0.1]] {
        let moment = format!("load.moment = [{{ at = {at:?}, about = \"x\", value = 1e-3 }}]");
        let start = plate(0.2, modal, &moment).unwrap().loads[0].start;
        assert_eq!(start.force, 0.0);
        assert!((start.moments[0] - 1e-3).abs() < 1e-15, "{start:?}");
    }
}

/// With the advised step a cosine in the relevant mode has the correct period within 1 %; with a
/// step three times as long it has not.
#[test]
fn the_advised_step_keeps_periods_to_one_per_cent() {
    let pi = std::f64::consts::PI;
    for (scheme, error) in [(NEWMARK, 5.0 / 24.0), (SchemeSpec::Conserving, 1.0 / 12.0)] {
        for highest in [40.0, 57.0, 83.0] {
            let frequencies = Frequencies { lowest: vec![5.0, highest], highest: None };
            let step = advised_step(scheme, &frequencies, false).unwrap();
            let turned = 0.5 * 2.0 * pi * highest * step;
            // The discrete frequency of Newmark's scheme satisfies sin(w dt / 2)^2 = x^2 / (1 + 4
            // beta x^2), where x is half the exact angle.
            let beta = 2.0 * (error + 1.0 / 24.0);
            let period = turned / (turned / (4.0 * beta * turned * turned + 1.0).sqrt()).asin() - 1.0;
            assert!(period < 0.0101 && period > 0.01 / 9.0, "{step}: {period}");
        }
    }
}
