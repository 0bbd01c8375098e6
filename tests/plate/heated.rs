//! Forces in the plane by temperature and by loads on edges, compared with closed forms.

use crate::common::scenes::{Drawing, all_round, close, grid, inspect, refusal, run};
use serde_json::Value;
use std::f64::consts::PI;

/// Modulus E in Pa, thickness in m, and expansion in 1/K. Poisson's ratio is 0.3.
const MODULUS: f64 = 10.92e6;
const THICKNESS: f64 = 0.01;
const EXPANSION: f64 = 1e-5;

/// Plate with the thermal expansion of steel, and the time of a still scene.
fn plate(sides: &str) -> String {
    format!(
        "plate = {{ {sides} thickness = {THICKNESS}, youngs_modulus = {MODULUS}, poissons_ratio = 0.3, \
         density = 100, expansion = {EXPANSION} }}\n\
         time = {{ scheme = \"newmark\", mass = \"consistent\", step = 1e-3, end = 1e-3 }}\n"
    )
}

fn square(element: &str, [nx, ny]: [usize; 2]) -> String {
    plate("length = 1, width = 1,") + &grid(element, nx, ny)
}

/// Asserts that values at two resolutions, one twice as fine, tend to the exact one with order 2.
fn converges(what: &str, exact: f64, [coarse, fine]: [f64; 2], tolerance: f64) {
    let order = ((coarse / exact - 1.0) / (fine / exact - 1.0)).log2();
    println!("{what}: {coarse}, {fine} for {exact}, order {order:.2}");
    assert!((1.5..=2.6).contains(&order), "{what}: order {order}");
    close(what, fine + (fine - coarse) / 3.0, exact, tolerance);
}

/// A square with held edges buckles at `$\Delta T = k \pi^2 h^2 / (12 (1 + \nu) \alpha b^2)$`, with
/// the factor k of biaxial pressure.
#[test]
fn held_squares_buckle_when_heated() {
    let reference: Value = serde_json::from_str(include_str!("../data/inplane.json")).unwrap();
    for (name, kind) in [("SSSS", "simply_supported"), ("CCCC", "clamped")] {
        let k = reference["buckling_k_uniaxial_biaxial_shear"][name][1].as_f64().unwrap();
        let exact = k * PI * PI * THICKNESS.powi(2) / (12.0 * 1.3 * EXPANSION);
        for element in ["fvs", "hct"] {
            let value = |cells| {
                let scene = square(element, [cells, cells]) + &all_round(kind) + "in_plane.temperature = 1\n";
                inspect(&scene).buckling_factor.unwrap()
            };
            converges(&format!("{name}, {element}"), exact, [8, 16].map(value), 1e-3);
        }
    }
}

/// A clamped disc of radius a buckles at `$N a^2 / D = -14.68197$`, on a mesh from a file.
#[test]
fn a_held_disc_buckles_when_heated() {
    let exact = 14.6819706421 * THICKNESS.powi(2) / (12.0 * 1.3 * EXPANSION);
    let value = |rings: usize| {
        let file = Drawing::disc(rings).write(&format!("heated-{rings}.msh"));
        let scene = plate("")
            + &format!(
                "mesh = {{ file = \"{file}\" }}\nsupport = [{{ edge = \"rim\", kind = \"clamped\" }}]\n"
            )
            + "in_plane.temperature = '1 + 0*x'\n";
        inspect(&scene).buckling_factor.unwrap()
    };
    converges("disc", exact, [6, 12].map(value), 2e-3);
}

/// Probes of the stresses xx, yy and xy of the upper surface.
fn stresses(scene: &str) -> Vec<f64> {
    let probe = |quantity: &str| {
        format!("{{ name = \"{quantity}\", at = [0.3, 0.4], quantity = \"stress_{quantity}_top\" }}")
    };
    let probes = ["xx", "yy", "xy"].map(probe).join(", ");
    run(&format!("{scene}output.probes = [{probes}]\n"))[0].probes.clone()
}

/// A plate that is free in its plane takes a linear temperature without stress, and dead loads in
/// equilibrium as they are.
#[test]
fn a_free_plate_has_the_stresses_of_its_loads_alone() {
    let free = all_round("simply_supported").replace(" }", ", in_plane = \"free\" }");
    for element in ["fvs", "hct"] {
        let scene = square(element, [6, 5])
            + &free
            + "in_plane.temperature = '20*x - 30*y'\n"
            + "in_plane.traction = [{ edge = \"right\", force = [3, 1] }, { edge = \"left\", force = [-3, -1] },\n\
               { edge = \"top\", force = [1, -2] }, { edge = \"bottom\", force = [-1, 2] }]\n";
        for (value, force) in stresses(&scene).into_iter().zip([3.0, -2.0, 1.0]) {
            close(element, value, force / THICKNESS, 1e-9);
        }
        let heated = stresses(&scene.replace("'20*x - 30*y'", "'20*x*x'"));
        assert!((heated[0] - 3.0 / THICKNESS).abs() > 1.0, "{heated:?}");
    }
}

/// A held plate has the stress `$-E \alpha T / (1 - \nu)$`, and with rollers along two sides
/// `$-E \alpha T$`; given tension adds to it.
#[test]
fn a_held_plate_has_the_stress_of_its_expansion() {
    let heated = "in_plane = { temperature = 4, tension = { xx = 2 } }\n";
    let held = stresses(&(square("hct", [4, 3]) + &all_round("clamped") + heated));
    let stress = -MODULUS * EXPANSION * 4.0 / 0.7;
    close("xx", held[0], stress + 2.0 / THICKNESS, 1e-12);
    close("yy", held[1], stress, 1e-12);
    let rollers = "support = [{ edge = \"left\", kind = \"clamped\", in_plane = \"normal\" }, \
                   { edge = \"right\", kind = \"clamped\", in_plane = \"normal\" }]\n";
    let rolled = stresses(&(square("fvs", [4, 3]) + rollers + heated));
    close("xx", rolled[0], -MODULUS * EXPANSION * 4.0 + 2.0 / THICKNESS, 1e-9);
    assert!(rolled[1].abs() <= 1e-9 * rolled[0].abs(), "{rolled:?}");
}

/// A temperature that jumps at the abscissa of a quadrature point of a cell, beside tension that is
/// a hundred times larger than its forces: the mirrored plate buckles alike.
#[test]
fn a_jump_of_temperature_keeps_its_mirror_image() {
    for element in ["fvs", "hct"] {
        let factor = |condition: &str, diagonal: &str| {
            let scene = square(element, [4, 4]).replace("[4, 4]", &format!("[4, 4]{diagonal}"))
                + &all_round("clamped")
                + &format!("in_plane.temperature = \"if({condition}, 3, 0)\"\nin_plane.tension.yy = -1e-2\n");
            inspect(&scene).buckling_factor.unwrap()
        };
        let diagonals =
            if element == "hct" { [", diagonal = 'right'", ", diagonal = 'left'"] } else { [""; 2] };
        let right = factor("x > 2/3", diagonals[0]);
        close(element, factor("1 - x > 2/3", diagonals[1]), right, 1e-9);
    }
}

/// A sweep passes through zero: supports in the plane stay, and the plate only bends.
#[test]
fn no_temperature_and_no_tension_are_nothing() {
    let frequency = |supports: &str, more: &str| {
        let scene = square("fvs", [4, 4]) + supports + more;
        inspect(&scene.replace(", expansion = 0.00001", "")).consistent.lowest[0]
    };
    let supports = all_round("clamped");
    let bent = frequency(&supports, "");
    let free = supports.replace(" }", ", in_plane = \"free\" }");
    let cold = inspect(&(square("fvs", [4, 4]) + &free + "in_plane.temperature = 0\n")).consistent.lowest[0];
    assert_eq!(cold, bent);
    assert_eq!(frequency(&supports, "in_plane.tension.xx = 0\n"), bent);
}

#[test]
fn what_cannot_be_heated_or_loaded_is_refused() {
    let supports = all_round("simply_supported");
    let scene = |more: &str| square("fvs", [3, 3]) + &supports + more;
    let cold = |more: &str| scene(more).replace(&format!(", expansion = {EXPANSION}"), "");
    let free = supports.replace(" }", ", in_plane = \"free\" }");
    let pulled = |force: &str| {
        let traction = format!("in_plane.traction = [{{ edge = \"right\", force = {force} }}]\n");
        cold(&traction).replace(&supports, &free)
    };
    for (text, words) in [
        (scene(""), "plate.expansion: has no use without in_plane.temperature"),
        (cold("in_plane.temperature = 1\n"), "plate.expansion: missing; expected a thermal expansion in 1/K"),
        (
            pulled("[1, 0]"),
            "in_plane.traction.0: the loads move the plate along x, which no support prevents",
        ),
        (pulled("[0, 1]"), "the loads move the plate"),
        (
            scene("in_plane.traction = [{ edge = \"rim\", force = [1, 0] }]\n")
                .replace(", expansion = 0.00001", ""),
            "named \"rim\"",
        ),
        (scene("in_plane.temperature = 26\n"), "in_plane.temperature: the plate buckles at 0.5"),
    ] {
        let error = refusal(&text).to_string();
        assert!(error.contains(words) && !error.contains('\n'), "{words}: {error}");
    }
}
