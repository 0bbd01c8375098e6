//! Supports, shapes and sections of plates, compared with published frequencies, exact beams, and
//! the same plate in another position.

use crate::common::models::{CLAMPED, STRIP, UNIT, UNIT_SECTION};
use crate::common::scenes::{
    Drawing, STILL, all_round, close, grid, inspect, newmark, refusal, run, same, start,
};
use std::f64::consts::{PI, TAU};

/// Returns the lowest frequencies with the consistent mass, without rigid motions, in Hz.
fn frequencies(text: &str) -> Vec<f64> {
    inspect(text).consistent.lowest.into_iter().filter(|f| *f > 0.0).collect()
}

/// Keys of a plate table for the steel of the benchmarks of NAFEMS, 5 cm thick.
const NAFEMS_SECTION: &str = "thickness = 0.05, youngs_modulus = 200e9, poissons_ratio = 0.3, density = 8000";

/// NAFEMS, *The Standard NAFEMS Benchmarks*, TNSB rev. 3, 1990: free plate FV12, cantilever FV16,
/// and the simply supported square, all 10 x 10 x 0.05 m. Conforming elements with the consistent
/// mass converge from above.
#[test]
fn nafems_squares() {
    let steel = format!("plate = {{ length = 10, width = 10, {NAFEMS_SECTION} }}\n");
    let cases = [
        ("", &[1.622, 2.360, 2.922, 4.233, 4.233][..]),
        (CLAMPED, &[0.421, 1.029, 2.582, 3.306, 3.753, 6.555]),
        (&all_round("simply_supported"), &[2.377, 5.942, 5.942, 9.507, 11.884, 11.884]),
    ];
    for (supports, published) in cases {
        let values = frequencies(&[&steel, &grid("fvs", 20, 20), supports, STILL].concat());
        for (value, published) in values.iter().zip(published) {
            // Published values have three decimals; those of FV12 and FV16 are Ritz bounds up to
            // 0.8 % high.
            assert!((-9e-3..6e-3).contains(&(value / published - 1.0)), "{value}, published {published}");
        }
    }
}

/// NAFEMS FV15 is a rhombus of 45 degrees with all edges clamped, two of them oblique.
#[test]
fn nafems_rhombus() {
    let shear = |x: f64, y: f64| [x + y * (PI / 4.0).cos(), y * (PI / 4.0).sin()];
    let published = [7.938, 12.835, 17.941, 19.133, 24.009, 27.922];
    let of = |count: usize, triangles: bool| {
        let mesh = Drawing::grid([count; 2], [10.0; 2], triangles, shear);
        let file = mesh.write(&format!("rhombus-{count}-{triangles}.msh"));
        let plate = format!("plate = {{ {NAFEMS_SECTION} }}\n");
        frequencies(&[&plate, &format!("mesh.file = '{file}'\n"), &all_round("clamped"), STILL].concat())
    };
    // Triangles as acute as these are far from convergence in the higher modes.
    for (triangles, modes) in [(false, 6), (true, 2)] {
        let (coarse, fine) = (of(10, triangles), of(20, triangles));
        for ((coarse, fine), published) in coarse.iter().zip(&fine).zip(published).take(modes) {
            assert!(fine < coarse, "{triangles}: {coarse}, {fine}, published {published}");
            close("FV15", (4.0 * fine - coarse) / 3.0, published, 1.5e-2);
        }
    }
}

/// For any supports and any grain, the plate vibrates, bends and rebounds in the same way when
/// everything is rotated.
#[test]
fn a_turned_plate_is_the_same_plate() {
    let angle: f64 = 0.4;
    let turn = |x: f64, y: f64| [x * angle.cos() - y * angle.sin(), x * angle.sin() + y * angle.cos()];
    let supports = [
        all_round("simply_supported"),
        "support = [{ edge = \"left\", kind = \"simply_supported\" }, { edge = \"right\", kind = \"guided\" }]\n".into(),
        "support = [{ edge = \"left\", kind = \"guided\" }, { edge = \"bottom\", kind = \"simply_supported\" }, { edge = \"top\", kind = \"clamped\" }]\n".into(),
        "support = [{ edge = \"left\", kind = \"elastic\", rotation = 3e3 }, { edge = \"top\", kind = \"elastic\", stiffness = 2e4, rotation = 50 }]\n".into(),
    ];
    let sides = [1.2, 0.8];
    for triangles in [false, true] {
        for (number, supports) in supports.iter().enumerate() {
            let scene = |turned: bool| {
                let file =
                    Drawing::grid([6, 4], sides, triangles, |x, y| if turned { turn(x, y) } else { [x, y] })
                        .write(&format!("turned-{triangles}-{number}-{turned}.msh"));
                let grain = 20.0 + if turned { angle.to_degrees() } else { 0.0 };
                let [x, y] = if turned { turn(0.7, 0.3) } else { [0.7, 0.3] };
                format!(
                    r#"
                    plate = {{ thickness = 0.01, youngs_modulus = 12e9, youngs_modulus_across = 1e9, shear_modulus = 0.7e9,
                              poissons_ratio = 0.35, density = 500, grain = {grain:?} }}
                    mesh.file = '{file}'
                    {supports}
                    obstacle = [{{ side = "below", height = -2e-3 }}]
                    load = {{ pressure = -2000 }}
                    time = {{ scheme = "newmark", mass = "singular", step = 1e-4, end = 0.02 }}
                    output.probes = [{{ name = "inside", at = [{x:?}, {y:?}] }}]
                    "#
                )
            };
            let (straight, turned) = (scene(false), scene(true));
            for (a, b) in frequencies(&straight).iter().zip(frequencies(&turned)) {
                close(&format!("{triangles} {supports}"), b, *a, 1e-9);
            }
            let (straight, turned) = (run(&straight), run(&turned));
            assert!(straight.iter().any(|row| row.contact_force > 0.0));
            same(&straight, &turned, 1e-11);
        }
    }
}

/// Leissa, *Vibration of Plates*, NASA SP-160, 1969, table 2.2, gives omega R^2 sqrt(rho h / D) =
/// 4.935 for nu = 0.3. If both slopes were held at the corners of the polygon, the value would be
/// 10.216, that of a clamped plate (Babuska's paradox).
#[test]
fn a_simply_supported_disc_is_no_clamped_one() {
    let value = |rings: usize, kind: &str| {
        let file = Drawing::disc(rings).write(&format!("disc-{rings}-{kind}.msh"));
        let plate = format!("plate = {{ {UNIT_SECTION} }}\n");
        let support = format!("support = [{{ edge = \"rim\", kind = \"{kind}\" }}]\n");
        TAU * frequencies(&[&plate, &format!("mesh.file = '{file}'\n"), &support, STILL].concat())[0]
    };
    // The values are the roots of J1/J0 + I1/I0 = 2 l / (1 - nu) and J0 I1 + I0 J1 = 0.
    let errors = [4, 8, 16].map(|rings| (value(rings, "simply_supported") / 4.935_149_04 - 1.0).abs());
    assert!(errors[0] < 1e-4 && errors[1] < errors[0] && errors[2] < 1e-5, "{errors:?}");
    let errors = [4, 8, 16].map(|rings| value(rings, "clamped") / 10.215_826_23 - 1.0);
    assert!(errors[1] < errors[0] / 3.0 && errors[2] < errors[1] / 3.0 && errors[2] > 0.0, "{errors:?}");
}

/// The supports are points at the corners of a square (Leissa 1973: omega a^2 sqrt(rho h / D) =
/// 7.11 for nu = 0.3), and parts of an edge.
#[test]
fn points_and_parts_of_edges() {
    let corners = [[0, 0], [1, 0], [0, 1], [1, 1]];
    let supports: Vec<String> =
        corners.iter().map(|at| format!("{{ at = {at:?}, kind = \"simply_supported\" }}")).collect();
    let supports = format!("support = [{}]\n", supports.join(", "));
    let value = TAU * frequencies(&[UNIT, &grid("fvs", 16, 16), &supports, STILL].concat())[0];
    close("corners", value, 7.11, 3e-3);

    // Parts that make up an edge are equivalent to the edge.
    let parts = r#"support = [{ edge = "left", where = "y <= 0.5", kind = "clamped" }, { edge = "left", where = "y >= 0.5", kind = "clamped" }]
"#;
    let of = |supports: &str| frequencies(&[UNIT, &grid("hct", 8, 8), supports, STILL].concat());
    assert_eq!(of(CLAMPED), of(parts));
    let part = "support = [{ edge = \"left\", where = \"y <= 0.5\", kind = \"clamped\" }]\n";
    assert!(of(part)[0] < 0.9 * of(CLAMPED)[0]);
}

/// The error names the motions that are not held.
#[test]
fn mechanisms_are_named() {
    let hinge = "support = [{ edge = \"left\", kind = \"simply_supported\" }]\n";
    let guided =
        "support = [{ edge = \"left\", kind = \"guided\" }, { edge = \"bottom\", kind = \"guided\" }]\n";
    let slide = "support = [{ edge = \"left\", kind = \"guided\" }]\n";
    let springs = |of: &str| format!("support = [{{ edge = \"left\", kind = \"elastic\", {of} }}]\n");
    let cases = [
        (&*springs("stiffness = 7"), "it can turn about a line"),
        (&springs("stiffness = 0, rotation = 7"), "it can move up and down and turn about a line"),
        (hinge, "it can turn about a line"),
        (guided, "it can move up and down"),
        (slide, "it can move up and down and turn about a line"),
        ("", "nothing holds it"),
    ];
    for (supports, words) in cases {
        for initial in [
            "initial = { static_pressure = 1 }\n",
            "initial = { equilibrium = true }\nload = { gravity = 1 }\n",
        ] {
            let error = refusal(&[UNIT, &grid("fvs", 4, 4), supports, initial, STILL].concat());
            assert_eq!(error.exit_code(), 2);
            let key = if initial.contains("static") {
                "initial.static_pressure: "
            } else {
                "initial.equilibrium: "
            };
            let error = error.to_string();
            assert!(error.starts_with(key) && error.ends_with(words), "{error}");
        }
        // The plate can still run, and a foundation makes it a structure.
        run(&[UNIT, &grid("fvs", 4, 4), supports, "load = { gravity = 1 }\n", STILL].concat());
        let under = "foundation = [{ stiffness = 1 }]\ninitial = { static_pressure = 1 }\n";
        run(&[UNIT, &grid("fvs", 4, 4), supports, under, STILL].concat());
    }
}

/// A beam on equal springs at both ends has the symmetric mode w = A cos(b s) + B cosh(b s) about
/// its centre, with t = tan(b / 2) + tanh(b / 2): t = -2 b D / (r L) where springs turn the held
/// ends, and b^3 t = 2 k L^3 / D where springs bear the ends. Soft springs give b^4 = 2 k L^3 / D,
/// stiff ones the simply supported beam; springs that turn held ends lead from the simply supported
/// to the clamped beam.
#[test]
fn springs_at_the_ends_of_a_beam() {
    let root = |of: &dyn Fn(f64) -> f64, [mut low, mut high]: [f64; 2]| {
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if of(middle) * of(high) > 0.0 { high = middle } else { low = middle }
        }
        high
    };
    let t = |b: f64| (0.5 * b).tan() + (0.5 * b).tanh();
    let value = |springs: &str| {
        let supports = format!(
            "support = [{{ edge = \"left\", kind = \"elastic\", {springs} }}, {{ edge = \"right\", kind = \"elastic\", {springs} }}]\n"
        );
        (TAU * frequencies(&[STRIP, &grid("fvs", 20, 1), &supports, STILL].concat())[0]).sqrt()
    };
    for rotation in [0.03, 1.0, 20.0, 1e5] {
        let b = root(&|b| t(b) + 2.0 * b / rotation, [PI + 1e-9, 4.7300408]);
        close(&format!("rotation {rotation}"), value(&format!("rotation = {rotation:?}")), b, 2e-6);
    }
    for stiffness in [0.01, 3.0, 100.0, 1e6] {
        let b = root(&|b| b.powi(3) * t(b) - 2.0 * stiffness, [1e-3, PI - 1e-12]);
        close(&format!("stiffness {stiffness}"), value(&format!("stiffness = {stiffness:?}")), b, 2e-6);
    }
}

/// A hinge that moves keeps its springs against rotation: a plate on two such edges that rise
/// together moves as in the frame of its supports.
#[test]
fn springs_against_rotation_ride_on_a_moving_edge() {
    let of = |motion: &str, pressure: &str| {
        let edge =
            |side: &str| format!("{{ edge = \"{side}\", kind = \"elastic\", rotation = 0.4{motion} }}");
        run(&format!(
            "{STRIP}{}support = [{}, {}]\nload = {{ pressure = {pressure} }}\n{}\
             output.probes = [{{ name = \"middle\", at = [0.5, 0.05] }}]\n",
            grid("fvs", 6, 1),
            edge("left"),
            edge("right"),
            newmark("consistent", 1e-3, 0.5),
        ))
    };
    // The supports start with the velocity 0 and have the acceleration 2 m/s2.
    let (moving, pressed) = (of(", motion = \"t^2\"", "0"), of("", "-2"));
    for (moving, pressed) in moving.iter().zip(&pressed) {
        let relative = moving.probes[0] - moving.time * moving.time;
        assert!((relative - pressed.probes[0]).abs() < 1e-11, "{relative} {}", pressed.probes[0]);
    }
}

/// Asserts the shape of a strip with a support `root` at its left end, whose right end is pushed up
/// by 1 m without a moment there: w'' = F (1 - x) / EI.
fn pushed_strip(plate: &str, root: &str, expected: impl Fn(f64) -> f64, tolerances: [f64; 2]) {
    for (element, tolerance) in ["fvs", "hct"].into_iter().zip(tolerances) {
        let places: Vec<f64> = (1..10).map(|k| 0.1 * f64::from(k)).collect();
        let probes: Vec<String> =
            places.iter().map(|x| format!("{{ name = \"{x:.1}\", at = [{x:?}, 0.03] }}")).collect();
        let text = format!(
            "{plate}{}{STILL}output.probes = [{}]\n\
             support = [{{ edge = \"left\", {root} }}, {{ edge = \"right\", kind = \"simply_supported\", motion = 1 }}]\n\
             initial.equilibrium = true\n",
            grid(element, 10, 1),
            probes.join(", ")
        );
        for (x, w) in places.iter().zip(start(&text)) {
            assert!(
                (w - expected(*x)).abs() <= tolerance,
                "{element}: {w} at {x}, expected {}",
                expected(*x)
            );
        }
    }
}

/// Keys of a support that clamps.
const FIXED: &str = "kind = \"clamped\"";

/// The root of a strip of unit rigidity deflects by P / k and turns by P L / r under the force P at
/// the tip: w = P / k + P x / r + P (x^2 / 2 - x^3 / 6).
#[test]
fn a_root_of_springs_deflects_and_turns() {
    for (springs, per_k, per_r) in [
        ("stiffness = 5, rotation = 0.7", 1.0 / 5.0, 1.0 / 0.7),
        ("rotation = 0.7", 0.0, 1.0 / 0.7),
        ("stiffness = 5e10, rotation = 7e10", 0.0, 0.0),
    ] {
        let w = |x: f64| per_k + per_r * x + x * x / 2.0 - x.powi(3) / 6.0;
        let root = format!("kind = \"elastic\", {springs}");
        pushed_strip(STRIP, &root, |x| w(x) / w(1.0), [2e-10, 2e-3]);
    }
}

/// The solution has cubic pieces, which quadrilaterals contain exactly, and triangles do not.
#[test]
fn strips_of_one_and_two_thicknesses() {
    pushed_strip(STRIP, FIXED, |x| 0.5 * x * x * (3.0 - x), [1e-10, 2e-3]);
    // The strip is half as thick from the middle on: EI is 1, then 1/8. In meshes of triangles the
    // thickness must jump along an edge.
    let thick = |x: f64| x * x / 2.0 - x.powi(3) / 6.0;
    let moved = |x: f64| {
        if x <= 0.5 {
            return thick(x);
        }
        let (w, slope) = (thick(0.5), 0.5 - 0.125);
        // This is the second integral of 8 (1 - x) from 0.5 on.
        let s = x - 0.5;
        w + slope * s + 8.0 * (0.25 * s * s - s.powi(3) / 6.0)
    };
    let plate = |region: &str| format!("{STRIP}part = [{{ {region}, thickness = 0.5 }}]\n");
    pushed_strip(&plate("where = \"x > 0.5\""), FIXED, |x| moved(x) / moved(1.0), [1e-9, 5e-3]);
    // Of several parts in one place the last counts, and repeating it changes nothing.
    let twice = format!(
        "{STRIP}part = [{{ where = \"x > 0.2\", thickness = 2 }}, {{ where = \"x < 2\", thickness = 1 }}]\n"
    );
    pushed_strip(&twice, FIXED, |x| 0.5 * x * x * (3.0 - x), [1e-10, 2e-3]);
}

/// With EI = (1 - x / 2)^3, the curvature w'' = F (1 - x) / (1 - x/2)^3 is integrated twice by
/// Simpson's rule.
#[test]
fn a_tapered_strip() {
    let plate = STRIP.replace("thickness = 1", "thickness = \"1 - x/2\"");
    let curvature = |s: f64| (1.0 - s) / (1.0 - s / 2.0).powi(3);
    let w = |x: f64| {
        let n = 200;
        let term = |k: usize| {
            let s = x * k as f64 / f64::from(n);
            let weight = if k == 0 || k == n as usize { 1.0 } else { 2.0 + 2.0 * (k % 2) as f64 };
            weight * (x - s) * curvature(s)
        };
        (0..=n as usize).map(term).sum::<f64>() * x / (3.0 * f64::from(n))
    };
    pushed_strip(&plate, FIXED, |x| w(x) / w(1.0), [3e-4, 3e-3]);
    // A formula with a constant value equals that number.
    let same = STRIP.replace("thickness = 1", "thickness = \"1 + 0*x\"");
    pushed_strip(&same, FIXED, |x| 0.5 * x * x * (3.0 - x), [1e-10, 2e-3]);
    // The mass follows from thickness and density, and is 3/4 of the uniform one here.
    let inspection = inspect(&[&plate, &grid("fvs", 4, 2)[..], STILL].concat());
    close("mass", inspection.mass, 0.075, 1e-13);
}

/// Lekhnitskii, *Anisotropic Plates*, 1968: a simply supported plate has omega^2 rho h = D1 a^4 + 2
/// (D1 nu21 + 2 Dk) a^2 b^2 + D2 b^4, with a = m pi / length, b = n pi / width.
#[test]
fn an_orthotropic_plate() {
    let (e1, e2, g, nu, h, rho) = (12e9, 1e9, 0.7e9, 0.35, 0.01, 500.0);
    let [length, width] = [1.2, 0.8];
    let plate = |e1: f64, e2: f64, nu: f64, grain: f64| {
        format!(
            "plate = {{ length = {length}, width = {width}, thickness = {h}, youngs_modulus = {e1:?}, youngs_modulus_across = {e2:?}, \
             shear_modulus = {g:?}, poissons_ratio = {nu:?}, density = {rho:?}, grain = {grain:?} }}\n"
        )
    };
    let of = |plate: &str| {
        frequencies(&[plate, &grid("fvs", 24, 16), &all_round("simply_supported"), STILL].concat())
    };
    let cube = h * h * h / 12.0;
    let ratio: f64 = 1.0 - nu * nu * e2 / e1;
    let [d1, d2] = [e1, e2].map(|e| e * cube / ratio);
    let both = nu * d2 + 2.0 * g * cube;
    let mut exact: Vec<f64> = Vec::new();
    for (m, n) in (1..8).flat_map(|m| (1..8).map(move |n| (f64::from(m), f64::from(n)))) {
        let [a, b] = [m * PI / length, n * PI / width].map(|k| k * k);
        exact.push(((d1 * a * a + 2.0 * both * a * b + d2 * b * b) / (rho * h)).sqrt() / TAU);
    }
    exact.sort_by(f64::total_cmp);
    for (value, exact) in of(&plate(e1, e2, nu, 0.0)).iter().zip(exact) {
        assert!((0.0..2e-2).contains(&(value / exact - 1.0)), "{value}, exact {exact}");
    }
    // After a rotation by a right angle, the values along and across are exchanged.
    for (a, b) in of(&plate(e1, e2, nu, 90.0)).iter().zip(of(&plate(e2, e1, nu * e2 / e1, 0.0))) {
        close("grain", *a, b, 1e-9);
    }
    // With one modulus for all directions the plate is isotropic.
    let isotropic = format!(
        "plate = {{ length = {length}, width = {width}, thickness = {h}, youngs_modulus = {e1:?}, poissons_ratio = {nu}, density = {rho:?} }}\n"
    );
    let equal = plate(e1, e1, nu, 33.0)
        .replace("shear_modulus = 700000000.0", &format!("shear_modulus = {:?}", e1 / 2.7));
    for (a, b) in of(&isotropic).iter().zip(of(&equal)) {
        close("isotropic", *a, b, 1e-9);
    }
}

/// Equal parts, by condition and by group, make up the whole; triangles and quadrilaterals may be
/// mixed.
#[test]
fn parts_of_a_mixed_mesh() {
    let plate = format!("plate = {{ {UNIT_SECTION} }}\nmesh.file = 'gmsh/square_41_text.msh'\n");
    let supports = all_round("clamped");
    let part = |group| format!("{{ group = \"{group}\", thickness = 1 }}");
    let parts = format!("part = [{}]\n", ["steel", "rubber", "whole"].map(part).join(", "));
    let of = |parts: &str| frequencies(&[&plate, &supports, parts, STILL].concat());
    let whole = of("");
    for (a, b) in whole.iter().zip(of(&parts)) {
        close("groups", *a, b, 1e-11);
    }
    close("CCCC", TAU * whole[0], 35.985, 3e-2);
}
