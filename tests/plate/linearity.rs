//! The warning of deflections that are too large for a linear plate, at its limits.

use crate::common::models::STRIP;
use crate::common::scenes::{self, STILL};
use rebond::scene::Scene;
use rebond::simulation::Model;
use rebond::study;

/// Returns the warnings of a scene that speak of a linear plate.
fn warnings(text: &str) -> Vec<String> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/gallery/scene.toml");
    let scene = Scene::from_str(text, path, &[]).unwrap_or_else(|error| panic!("{error}\n{text}"));
    let mut warnings = study::warnings(&scene, &Model::new(&scene).unwrap());
    warnings.retain(|warning| warning.contains("linear plate"));
    warnings
}

/// A pressure q deflects the centre of a clamped disc by q a^4 / (64 D); the limit is 0.3
/// thicknesses. Under a load in place of a static start the warning is the same.
#[test]
fn a_clamped_disc_stretches_from_a_third_of_its_thickness_on() {
    let [thickness, modulus, radius, nu] = [2e-3_f64, 210e9, 0.2_f64, 0.3];
    let rigidity = modulus * thickness.powi(3) / (12.0 * (1.0 - nu * nu));
    let disc = |share: f64, start: &str| {
        let pressure = share * thickness * 64.0 * rigidity / radius.powi(4);
        format!(
            "mesh = {{ file = \"disc.msh\" }}\nsupport = [{{ edge = \"rim\", kind = \"clamped\" }}]\n{STILL}\
             plate = {{ thickness = {thickness}, youngs_modulus = {modulus}, poissons_ratio = {nu}, density = 7800 }}\n\
             {start} = {pressure}\n"
        )
    };
    for start in ["initial.static_pressure", "load.pressure"] {
        assert_eq!(warnings(&disc(0.28, start)), [""; 0]);
        let said = warnings(&disc(0.32, start));
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(said[0].contains("0.32 times the thickness") && said[0].contains("stretches"), "{said:?}");
    }
}

/// A cantilever does not stretch, whatever its deflection in thicknesses: its limit is a slope of
/// 0.3, which a pressure q reaches at the tip where q L^3 / (6 EI) = 0.3.
#[test]
fn a_cantilever_is_linear_up_to_a_slope_of_three_tenths() {
    let strip = |slope: f64| {
        // STRIP has EI = 1 N m2 per metre of width, and the length 1 m.
        let thin = STRIP.replace("thickness = 1,", "thickness = 1e-3,").replace("= 12,", "= 12e9,");
        assert_ne!(thin, STRIP);
        let mesh = scenes::grid("fvs", 20, 2);
        format!(
            "{thin}{mesh}{STILL}support = [{{ edge = \"left\", kind = \"clamped\" }}]\ninitial.static_pressure = {}\n",
            6.0 * slope
        )
    };
    assert_eq!(warnings(&strip(0.28)), [""; 0]);
    let said = warnings(&strip(0.32));
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].contains("slopes up to 0.32"), "{said:?}");
}

/// Obstacles keep the plate from its static deflection under a load, which then tells nothing.
#[test]
fn a_load_that_an_obstacle_bears_causes_no_warning() {
    let text = format!(
        "{}{}{STILL}support = [{{ edge = \"left\", kind = \"clamped\" }}]\nload.pressure = -1e3\n",
        STRIP.replace("thickness = 1,", "thickness = 1e-3,").replace("= 12,", "= 12e9,"),
        scenes::grid("fvs", 10, 2),
    );
    assert_eq!(warnings(&text).len(), 1);
    assert_eq!(warnings(&(text + "obstacle = [{ side = \"below\", height = 0 }]\n")), [""; 0]);
}

/// A run judges the deflection that it reached, once: not where its scene was warned of already,
/// nor where the plate stretches or its support carries it along.
#[test]
fn a_run_judges_its_own_largest_deflection() {
    let warning = |text: &str| {
        let (scene, (_, outcome)) = (scenes::scene(text), scenes::run_to_end(text));
        let before = study::warnings(&scene, &Model::new(&scene).unwrap());
        study::warning_of_run(&scene, &outcome, &before)
    };
    let thin = STRIP.replace("thickness = 1,", "thickness = 1e-3,").replace("= 12,", "= 12e9,");
    let plate = format!("{thin}{}", scenes::grid("fvs", 10, 2));
    let time = "time = { scheme = \"conserving\", mass = \"modal\", step = 2e-4, end = 0.06 }\n";
    // A pressure that acts suddenly bends the plate twice as far as it does at rest.
    let pushed = |supports: &str, pressure: f64| {
        format!("{plate}{time}{supports}load.pressure = '{pressure} * cos(t)'\n")
    };
    let held =
        "support = [{ edge = \"left\", kind = \"clamped\" }, { edge = \"right\", kind = \"clamped\" }]\n";
    // q L^4 / (384 EI) = q / 384 m at rest.
    assert_eq!(warning(&pushed(held, 0.05)), None);
    let said = warning(&pushed(held, 0.07)).unwrap();
    assert!(said.starts_with("the largest deflection is ") && said.contains("stretches"), "{said}");
    assert_eq!(warning(&(pushed(held, 0.07) + "in_plane.stretching = true\n")), None);
    let constant = format!("{plate}{time}{held}load.pressure = 0.7\n");
    assert_eq!(warning(&constant), None, "the static deflection is judged before the run");
    // q L^4 / (8 EI) = q / 8 m at rest.
    let root = "support = [{ edge = \"left\", kind = \"clamped\" }]\n";
    assert_eq!(warning(&pushed(root, 0.7)), None);
    let said = warning(&pushed(root, 0.9)).unwrap();
    assert!(said.contains("times the length that juts out"), "{said}");
    let carried = "support = [{ edge = \"left\", kind = \"clamped\", motion = '0.3*sin(t)' }]\n";
    assert_eq!(warning(&format!("{plate}{time}{carried}")), None);
}

/// Steel in MPa or in g/cm3 is asked about, though rubber and foam have such moduli and densities.
#[test]
fn a_material_in_other_units_is_asked_about() {
    let is_asked = |modulus: &str, density: &str| {
        let text = format!(
            "{}support = [{{ edge = \"left\", kind = \"clamped\" }}]\n{STILL}\
             plate = {{ length = 1, width = 1, thickness = 1e-2, youngs_modulus = {modulus}, \
             poissons_ratio = 0.3, density = {density} }}\n",
            scenes::grid("fvs", 2, 2)
        );
        let scene = scenes::scene(&text);
        let warnings = study::warnings(&scene, &Model::new(&scene).unwrap());
        warnings.iter().any(|text| text.contains("of no material: steel has"))
    };
    for (modulus, density) in [("210e3", "7850"), ("210e9", "7.85"), ("70e3", "2700"), ("3e9", "1.4")] {
        assert!(is_asked(modulus, density), "{modulus}, {density}");
    }
    for (modulus, density) in [("210e9", "7850"), ("1e6", "1100"), ("1e12", "3500"), ("1e5", "20")] {
        assert!(!is_asked(modulus, density), "{modulus}, {density}");
    }
}
