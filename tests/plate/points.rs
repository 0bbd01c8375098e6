//! Warnings of what has no limit under refinement, because it is held or loaded at a point.

use rebond::scene::Scene;
use rebond::simulation::Model;
use rebond::study;

/// Returns the warnings of a square sheet that speak of a limit, in a check and in a run.
fn warnings(support: &str, more: &str) -> Vec<String> {
    let text = format!(
        "plate = {{ length = 0.18, width = 0.18, thickness = 0.001, youngs_modulus = 2.1e11, poissons_ratio = 0.3, density = 7800 }}\n\
         mesh = {{ element = \"hct\", cells = [6, 6], diagonal = \"alternating\" }}\nsupport = [{support}]\n\
         time = {{ scheme = \"newmark\", mass = \"consistent\", step = 1e-5, end = 1e-5 }}\n{more}"
    );
    let scene = Scene::from_str(&text, "sheet.toml", &[]).unwrap_or_else(|error| panic!("{error}\n{text}"));
    let of_limits = |mut warnings: Vec<String>| {
        warnings.retain(|warning| warning.contains("limit under refinement"));
        warnings
    };
    let checked = of_limits(study::check(&scene).unwrap().warnings);
    assert_eq!(checked, of_limits(study::warnings(&scene, &Model::new(&scene).unwrap())));
    checked
}

const EDGE: &str = r#"{ edge = "left", kind = "clamped" }"#;

/// A clamped point has 62.6, 54.6, 49.1, 45.1, 41.9 Hz on finer and finer meshes; simply supported
/// points and clamped edges have limits.
#[test]
fn a_point_holds_no_slope() {
    for kind in ["clamped", "guided"] {
        let said = warnings(&format!(r#"{{ at = [0.09, 0.09], kind = "{kind}" }}, {EDGE}"#), "");
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(said[0].contains("support.0.at") && said[0].contains("washer"), "{said:?}");
    }
    let pinned = r#"{ at = [0.09, 0.09], kind = "simply_supported" }"#;
    assert_eq!(warnings(&format!("{pinned}, {EDGE}"), ""), [""; 0]);
    // Equal warnings are joined, and name all supports.
    let bolt = |at: f64, name: &str| format!(r#"{{ at = [{at}, {at}], kind = "clamped"{name} }}"#);
    let bolts = [bolt(0.03, ""), bolt(0.06, r#", name = "bolt""#), bolt(0.09, ""), EDGE.to_owned()];
    let said = warnings(&bolts.join(", "), "");
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].starts_with("support 1, 2 (\"bolt\") and 3: at: a point cannot hold"), "{said:?}");
}

/// The largest stress of a run grows too where a point is held or loaded, but not under a washer.
#[test]
fn the_largest_stress_has_no_limit_beside_a_point() {
    let pinned = |more: &str| format!(r#"{EDGE}, {{ at = [0.09, 0.09], kind = "simply_supported"{more} }}"#);
    for (support, more, expected) in [
        (pinned(""), "output.extremes = true", &["output.extremes: ", "support.1"][..]),
        (pinned(""), "output = { fields_every = 1, stresses = true }", &["output.stresses: ", "support.1"]),
        (
            EDGE.into(),
            "output.extremes = true\nload.force = [{ at = [0.1, 0.1], value = 1 }]",
            &["load.force.0"],
        ),
        (EDGE.into(), "output.extremes = true", &[]),
        (pinned(", radius = 0.05"), "output.extremes = true", &[]),
        (pinned(""), "output = { fields_every = 1 }", &[]),
    ] {
        let said = warnings(&support, more);
        assert_eq!(said.len(), usize::from(!expected.is_empty()), "{more}: {said:?}");
        assert!(expected.iter().all(|word| said[0].contains(word)), "{said:?}");
    }
}

/// Moments grow as the logarithm of the distance from a point force.
#[test]
fn a_stress_beside_a_point_force_has_no_limit() {
    let probes = |quantity: &str, x: f64| {
        format!(
            "load.force = [{{ at = [0.09, 0.09], value = 1 }}]\n\
             output.probes = [{{ name = \"p\", at = [{x}, 0.1], quantity = \"{quantity}\" }}]\n"
        )
    };
    let said = warnings(EDGE, &probes("von_mises_top", 0.095));
    assert!(said.len() == 1 && said[0].contains("load.force.0"), "{said:?}");
    assert_eq!(warnings(EDGE, &probes("deflection", 0.095)), [""; 0]);
    assert_eq!(warnings(EDGE, &probes("von_mises_top", 0.155)), [""; 0]);
    for (table, keys) in [
        ("obstacle", "side = \"below\", height = -1"),
        ("ball", "mass = 1, height = 1"),
        ("slider", "force = 1"),
    ] {
        let beside = |x: f64| {
            let attached = format!("{table} = [{{ at = [0.09, 0.09], {keys} }}]\n");
            warnings(EDGE, &[attached, probes("von_mises_top", x).lines().skip(1).collect()].concat())
        };
        let said = beside(0.095);
        assert!(said.len() == 1 && said[0].contains(&format!("{table}.0")), "{said:?}");
        assert_eq!(beside(0.155), [""; 0], "{table}");
    }
}

/// Two squares that share one corner pass on no slope there.
#[test]
fn a_node_joins_no_parts() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/hard/scene.toml");
    let text = "plate = { thickness = 0.01, youngs_modulus = 2.1e11, poissons_ratio = 0.3, density = 7800 }\n\
                mesh = { file = \"one-node-joint.msh\" }\nsupport = [{ edge = \"left\", kind = \"clamped\" }]\n\
                time = { scheme = \"newmark\", mass = \"consistent\", step = 1e-5, end = 1e-5 }\n";
    let scene = Scene::from_str(text, path, &[]).unwrap_or_else(|error| panic!("{error}"));
    let said = study::check(&scene).unwrap().warnings;
    assert!(said.iter().any(|warning| warning.contains("at (1, 1) by a single node")), "{said:?}");
}
