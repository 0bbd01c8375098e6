//! Forces in the plane of a plate: frequencies, buckling loads and stresses, compared with closed
//! forms and with series of another program.

use crate::common::scenes::{Drawing, all_round, close, grid, inspect, refusal, run};
use serde_json::Value;
use std::f64::consts::{PI, TAU};

/// Plate of 1 m x 1 m with D = 1 N m and rho h = 1 kg/m2, so that lambda = omega and tau = N.
const SQUARE: &str = "plate = { length = 1, width = 1, thickness = 0.01, youngs_modulus = 10.92e6, \
                      poissons_ratio = 0.3, density = 100 }\n";

fn reference() -> Value {
    serde_json::from_str(include_str!("../data/inplane.json")).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn scene(supports: &str, tension: &str, element: &str, cells: usize) -> String {
    let mesh = grid(element, cells, cells);
    format!(
        "{SQUARE}{supports}{mesh}in_plane.tension = {{ {tension} }}\n\
         time = {{ scheme = \"newmark\", mass = \"consistent\", step = 1e-3, end = 1e-3 }}\n"
    )
}

/// Asserts that values on 8 and 16 cells tend to the exact one with order 2, and that their
/// extrapolation is within 1e-3.
fn converges(what: &str, exact: f64, value: impl Fn(usize) -> f64) {
    let [coarse, fine] = [8, 16].map(&value);
    let [first, second] = [coarse, fine].map(|value| (value / exact - 1.0).abs());
    let extrapolated = fine + (fine - coarse) / 3.0;
    let order = (first / second).log2();
    println!("{what}: {coarse}, {fine} for {exact}, order {order:.2}");
    assert!(second <= 1e-4 || (1.5..=4.5).contains(&order), "{what}: order {order}");
    close(what, extrapolated, exact, 1e-3);
}

/// Angular frequencies of the lowest modes with the consistent mass, in rad/s.
fn frequencies(supports: &str, tension: &str, element: &str, cells: usize) -> Vec<f64> {
    let lowest = inspect(&scene(supports, tension, element, cells)).consistent.lowest;
    lowest.into_iter().map(|frequency| TAU * frequency).collect()
}

#[test]
fn frequencies_of_a_simply_supported_square() {
    let supports = all_round("simply_supported");
    for element in ["fvs", "hct"] {
        for [x, y] in [[10.0, 10.0], [-15.0, -3.0], [1000.0, 200.0]] {
            let mode = |m: f64, n: f64| {
                (PI.powi(4) * (m * m + n * n).powi(2) + PI * PI * (x * m * m + y * n * n)).sqrt()
            };
            let pairs = [[1.0, 1.0], [1.0, 2.0], [2.0, 1.0], [1.0, 3.0]];
            let mut exact = pairs.map(|[m, n]| mode(m, n));
            exact.sort_by(f64::total_cmp);
            for (k, exact) in exact.into_iter().enumerate().take(3) {
                let tension = format!("xx = {x}, yy = {y}");
                let value = |cells| frequencies(&supports, &tension, element, cells)[k];
                converges(&format!("{element}, {tension}, mode {k}"), exact, value);
            }
        }
    }
}

/// Cells by another program, and drawn ones whose sides are curved or whose nodes are displaced.
#[test]
fn frequencies_on_distorted_meshes() {
    let exact = (4.0 * PI.powi(4) + PI * PI * 5.0).sqrt();
    let waves = |x: f64, y: f64| {
        let shift = 0.04 * (TAU * x).sin() * (TAU * y).sin();
        [x + shift, y - shift]
    };
    let jitter = |cells: usize| {
        let size = 1.0 / cells as f64;
        let shift = move |x: f64, y: f64| 0.2 * size * (1e4 * (x + 0.7 * y).sin()).sin();
        let is_inside = |x: f64| x > 1e-9 && x < 1.0 - 1e-9;
        move |x: f64, y: f64| match is_inside(x) && is_inside(y) {
            true => [x + shift(x, y), y + shift(y, 2.0 * x)],
            false => [x, y],
        }
    };
    let lowest = |mesh: String| {
        let text = scene(&all_round("simply_supported"), "xx = 10, yy = -5", "fvs", 2);
        let drawn = text.replace(&grid("fvs", 2, 2), &mesh).replace("length = 1, width = 1, ", "");
        TAU * inspect(&drawn).consistent.lowest[0]
    };
    let drawn =
        |drawing: Drawing, name: String| lowest(format!("mesh.file = \"{}\"\n", drawing.write(&name)));
    for triangles in [false, true] {
        converges(&format!("waves, {triangles}"), exact, |cells| {
            let drawing = Drawing::grid([cells; 2], [1.0; 2], triangles, waves);
            drawn(drawing, format!("tension-waves-{triangles}-{cells}.msh"))
        });
        let errors = [8, 16, 32].map(|cells| {
            let drawing = Drawing::grid([cells; 2], [1.0; 2], triangles, jitter(cells));
            drawn(drawing, format!("tension-jitter-{triangles}-{cells}.msh")) / exact - 1.0
        });
        println!("jitter, {triangles}: {errors:?}");
        assert!(errors[2] > 0.0 && errors[2] <= errors[0] / 9.0, "{errors:?}");
    }
    converges("Gmsh", exact, |cells| {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/gmsh/square_41_text.msh");
        lowest(format!("mesh = {{ file = \"{file}\", refine = {} }}\n", cells / 8 - 1))
    });
}

/// Square of a frequency, added to the one without tension: errors are shares of the bending
/// stiffness, most of which pressure may cancel.
fn stiffness(lambda: f64, bent: f64) -> f64 {
    lambda.powi(2) + bent.powi(2)
}

#[test]
fn frequencies_of_clamped_and_cantilevered_squares() {
    let reference = reference();
    let clamped = &reference["CCCC_square_lambda_biaxial_uniaxial_by_tau"];
    let bent = numbers(&clamped["0"][0])[0];
    for tau in ["-50", "10"] {
        for (which, tension) in [(0, format!("xx = {tau}, yy = {tau}")), (1, format!("xx = {tau}"))] {
            let exact = stiffness(numbers(&clamped[tau][which])[0], bent);
            let value =
                |cells| stiffness(frequencies(&all_round("clamped"), &tension, "fvs", cells)[0], bent);
            converges(&format!("clamped, {tension}"), exact, value);
        }
    }
    let root = "support = [{ edge = \"left\", kind = \"clamped\" }]\n";
    let cantilever = &reference["CFFF_square_lambda_uniaxial_by_tau"];
    let bent = numbers(&cantilever["0"])[0];
    for tau in ["1", "100", "-2"] {
        let exact = stiffness(numbers(&cantilever[tau])[0], bent);
        let value = |cells| stiffness(frequencies(root, &format!("xx = {tau}"), "hct", cells)[0], bent);
        converges(&format!("cantilever, {tau}"), exact, value);
    }
}

#[test]
fn buckling_loads_of_squares() {
    let reference = &reference()["buckling_k_uniaxial_biaxial_shear"];
    for (name, kind) in [("SSSS", "simply_supported"), ("CCCC", "clamped")] {
        let loads = numbers(&reference[name]);
        for element in ["fvs", "hct"] {
            for (k, tension) in loads.iter().zip(["xx = -1", "xx = -1, yy = -1", "xy = 1"]) {
                let value = |cells| {
                    let factor = inspect(&scene(&all_round(kind), tension, element, cells)).buckling_factor;
                    factor.unwrap().abs() / (PI * PI)
                };
                converges(&format!("{name}, {element}, {tension}"), *k, value);
                assert!(value(8) > *k, "from above");
            }
        }
    }
}

/// A force that grows along the plate, on a mesh that resolves it: the factor is the one of the
/// mean force for a mode that is symmetric in x (first order), and of opposite sign for tension.
#[test]
fn signs_and_formulas() {
    let supports = all_round("simply_supported");
    let factor = |tension: &str| inspect(&scene(&supports, tension, "fvs", 8)).buckling_factor;
    let even = factor("xx = -1").unwrap();
    close("as a formula", factor("xx = '-1 + 0*x'").unwrap(), even, 1e-9);
    close("reversed", factor("xx = 1").unwrap(), -even, 1e-9);
    let graded = factor("xx = '-2*x'").unwrap();
    assert!(graded < even && graded > 0.8 * even, "{graded}, {even}");
}

#[test]
fn a_buckled_plate_is_refused_with_its_load() {
    let supports = all_round("simply_supported");
    let error = refusal(&scene(&supports, "xx = -40", "fvs", 12)).to_string();
    let factor: f64 = error.split("buckles at ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    close("factor", factor, 4.0 * PI * PI / 40.0, 1e-2);
    assert!(error.contains("in_plane.tension: "), "{error}");
    let free = refusal(&scene("", "xx = -1", "fvs", 4)).to_string();
    assert!(free.contains("in_plane.tension: forces press a plate"), "{free}");
    let none = refusal(&scene(&supports, "", "fvs", 4)).to_string();
    assert!(none.contains("in_plane.tension: ") && none.contains("xx, yy and xy"), "{none}");
}

/// At rest the stresses of both surfaces are N / h; bending adds to them with opposite signs.
#[test]
fn stresses_have_their_membrane_part() {
    let quantities = [
        "stress_xx_top",
        "stress_yy_bottom",
        "stress_xy_top",
        "von_mises_top",
        "von_mises_bottom",
        "membrane_xx",
        "membrane_yy",
        "membrane_xy",
    ];
    let probes = quantities
        .map(|quantity| format!("{{ name = \"{quantity}\", at = [0.3, 0.4], quantity = \"{quantity}\" }}"));
    let probes = probes.join(", ");
    let text = |load: &str| {
        let plate = scene(&all_round("clamped"), "xx = 300, yy = 200, xy = -100", "hct", 6);
        format!("{plate}{load}output = {{ extremes = true, probes = [{probes}] }}\n")
    };
    let rest = run(&text(""))[0].probes.clone();
    let [xx, yy, xy]: [f64; 3] = [3e4, 2e4, -1e4];
    let von_mises = (xx * xx - xx * yy + yy * yy + 3.0 * xy * xy).sqrt();
    for (value, expected) in rest.iter().zip([xx, yy, xy, von_mises, von_mises, 300.0, 200.0, -100.0]) {
        close("at rest", *value, expected, 1e-12);
    }
    let bent = run(&text("initial.static_pressure = 100\n"))[0].probes.clone();
    let flat = run(&text("initial.static_pressure = 100\n")
        .replace("xx = 300, yy = 200, xy = -100", "xx = 300, yy = 200"))[0]
        .probes
        .clone();
    assert!(bent[3] != bent[4] && flat[0] != bent[0]);
    assert_eq!(bent[5..], rest[5..]);
    assert!((bent[0] - xx).abs() > 1e3, "{bent:?}");
}

/// A plate under tension and shear falls on stops: the energy is kept through the impacts.
#[test]
fn contact_keeps_the_energy() {
    let scheme = |time: &str| {
        let text = format!(
            "{SQUARE}{}in_plane.tension = {{ xx = 30, yy = '5 - 10*y', xy = 4 }}\n\
             support = [{{ edge = \"left\", kind = \"clamped\" }}, {{ edge = \"right\", kind = \"simply_supported\" }}]\n\
             obstacle = [{{ side = \"below\", height = -1e-3, where = \"x > 0.4 and x < 0.6\" }}]\n\
             initial.static_pressure = 0.5\ntime = {{ {time}, step = 1e-2, end = 3 }}\n",
            grid("fvs", 4, 4)
        );
        let rows = run(&text);
        let start = rows[0].energy;
        let worst = rows.iter().map(|row| (row.energy / start - 1.0).abs()).fold(0.0, f64::max);
        (rows.iter().filter(|row| row.contact_force > 0.0).count(), worst)
    };
    for time in [
        "scheme = 'conserving', mass = 'modal', modes = 8",
        "scheme = 'conserving', mass = 'singular'",
        "scheme = 'exact', mass = 'singular'",
    ] {
        let (contact, worst) = scheme(time);
        assert!(contact >= 5 && worst <= 1e-12, "{time}: {contact} rows in contact, {worst:e}");
    }
}
