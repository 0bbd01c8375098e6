//! Effects on two ranks: the numbers equal those of the native engine, and a fault that one rank
//! alone finds gives one message.

use crate::common::command;
use crate::common::command::{assert_fails, history, on, rebond, succeeds};
use crate::common::models::{CLAMPED, PAPER_PLATE, PAPER_SECTION};
use crate::common::scenes::Drawing;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn folder(test: &str, scene: &str) -> PathBuf {
    command::folder(&format!("effects-{test}"), scene)
}

fn rows(folder: &Path, ranks: usize) -> Vec<Vec<f64>> {
    let out = format!("on-{ranks}");
    let engine = if ranks == 0 { "native" } else { "petsc" };
    let arguments = ["run", "fall.toml", "--quiet", "--engine", engine, "--out", &out];
    let output = if ranks == 0 { rebond(folder, &arguments) } else { on(folder, ranks, &arguments) };
    succeeds(&output);
    history(&folder.join(out))
}

/// Asserts that two ranks and one process agree: energies and deflections to 1e-9 of the largest,
/// since impacts amplify rounding.
fn agree(test: &str, scene: &str, touches: bool) {
    let folder = folder(test, scene);
    let (native, two) = (rows(&folder, 0), rows(&folder, 2));
    assert_eq!(native.len(), two.len());
    assert_eq!(native.iter().any(|row| row[6] > 0.0), touches, "contact");
    for column in (2..6).chain(10..native[0].len()) {
        let largest =
            native.iter().fold(0.0, |m: f64, row| row[if column < 6 { 2 } else { column }].abs().max(m));
        let tolerance = 1e-9 * largest;
        assert!(largest > 0.0, "column {column}");
        for (a, b) in native.iter().zip(&two) {
            assert_eq!((a[0], a[1], a[6]), (b[0], b[1], b[6]), "step, time, nodes in contact");
            assert!(
                (a[column] - b[column]).abs() <= tolerance,
                "t = {}, column {column}: {:e}, {:e}",
                a[1],
                a[column],
                b[column]
            );
        }
    }
}

#[test]
fn shaken_between_stops() {
    agree(
        "shaken",
        &format!(
            r#"
            {PAPER_PLATE}
            mesh = {{ element = "fvs", cells = [10, 4] }}
            support = [{{ edge = "left", kind = "clamped", motion = "2e-3*sin(2*pi*5.5*t)" }}]
            obstacle = [{{ side = "below", height = -0.0015, where = "x > 1.1" }}, {{ side = "above", height = 0.002, line = [[1.2, 0], [1.2, 0.4]] }}]
            load = {{ gravity = 0.1, force = [{{ at = [0.61, 0.2], value = "3*t" }}] }}
            damping = {{ mass = 0.5, stiffness = 1e-5 }}
            time = {{ scheme = "newmark", mass = "singular", step = 5e-4, end = 0.2 }}
            output = {{ every = 10, probes = [{{ name = "corner", at = [1.2, 0.0] }}, {{ name = "root", at = [0.0, 0.2] }}, {{ name = "in", at = [0.6, 0.33] }}] }}
            "#
        ),
        true,
    );
}

/// Supports move apart, with kinks, over a stop; each kink gives an impulse on both ranks.
#[test]
fn kinks_of_supports() {
    for scheme in ["conserving", "midpoint"] {
        agree(
            &format!("kinks-{scheme}"),
            &format!(
                r#"
                {PAPER_PLATE}
                mesh = {{ element = "fvs", cells = [6, 2] }}
                support = [{{ edge = "left", kind = "clamped", motion = "0.2*max(0, t - 0.0031)" }}, {{ edge = "right", kind = "simply_supported", motion = "1e-3*abs(sin(200*t))" }}]
                obstacle = [{{ side = "above", height = 0.004, where = "x > 0.4" }}]
                time = {{ scheme = "{scheme}", mass = "singular", step = 2e-4, end = 0.04 }}
                output = {{ probes = [{{ name = "centre", at = [0.6, 0.2] }}] }}
                "#
            ),
            true,
        );
    }
}

/// The mid-plane stretches under a pressure that follows the deflection, from an equilibrium on,
/// through impacts, on named supports; stresses follow.
#[test]
fn stretching() {
    for (number, time) in [
        r#"scheme = "newmark", mass = "singular", restitution = 0.3"#,
        r#"scheme = "newmark", mass = "consistent""#,
        r#"scheme = "midpoint", mass = "singular""#,
        r#"scheme = "conserving", mass = "singular""#,
    ]
    .iter()
    .enumerate()
    {
        agree(
            &format!("stretching-{number}"),
            &format!(
                r#"
                {PAPER_PLATE}
                mesh = {{ element = "fvs", cells = [8, 3] }}
                support = [{{ name = "left", edge = "left", kind = "clamped" }}, {{ edge = "right", kind = "simply_supported" }}, {{ edge = "top", where = "x > 0.7", kind = "guided" }}]
                obstacle = [{{ side = "below", height = -0.004, where = "x > 0.4" }}, {{ side = "above", height = 0.02 }}]
                in_plane = {{ stretching = true, tension = {{ xx = 1e4, yy = 2e3, xy = 0 }} }}
                load = {{ pressure = "-300/(0.1 + w)^2*(1 + x)" }}
                initial = {{ equilibrium = true, velocity = "-30*x*(1.2 - x)" }}
                time = {{ {time}, step = 1e-4, end = 0.03 }}
                output = {{ extremes = true, probes = [{{ name = "centre", at = [0.6, 0.2] }}, {{ name = "stress", at = [0.6, 0.2], quantity = "stress_xx_top" }}] }}
                "#
            ),
            true,
        );
    }
}

#[test]
fn a_ball_and_all_that_is_attached() {
    let heated = PAPER_PLATE.replace(" }", ", expansion = 1.2e-5 }");
    agree(
        "ball",
        &format!(
            r#"
            {heated}
            mesh = {{ element = "hct", cells = [4, 2], refine = 1, diagonal = "alternating" }}
            support = [{{ edge = "left", kind = "simply_supported", motion = "1e-3*sin(30*t)" }}, {{ edge = "right", kind = "simply_supported" }}, {{ edge = "top", where = "x < 0.5", kind = "guided" }}, {{ edge = "bottom", kind = "elastic", stiffness = 3e4, rotation = 2e3 }}]
            ball = [{{ at = [0.6, 0.2], mass = 5.0, height = 2e-3 }}, {{ at = [0.93, 0.11], side = "below", mass = 0.2, height = -5e-3, velocity = 0.4 }}]
            load = {{ gravity = 9.81 }}
            initial = {{ equilibrium = true }}
            spring = [{{ at = [0.25, 0.25], stiffness = 1e4 }}]
            mass = [{{ at = [0.75, 0.35], mass = 2 }}, {{ at = [0.6, 0.1], mass = 3 }}, {{ at = [0.0, 0.2], mass = 4 }}]
            foundation = [{{ stiffness = "2e4*x", where = "y < 0.2" }}]
            in_plane.tension = {{ xx = 2e4, yy = "-1e3*x", xy = "exp(9*y)" }}
            in_plane.temperature = "4 - 3*x*y"
            in_plane.traction = [{{ edge = "top", force = [1e3, 2e3] }}]
            rib = [{{ line = [[0.1, 0.05], [1.15, 0.3]], bending = 2e3, torsion = 5e2, mass = 4 }}, {{ edge = "top", bending = 1e3, mass = 2 }}]
            time = {{ scheme = "newmark", mass = "singular", step = 2e-4, end = 0.08 }}
            output = {{ probes = [{{ name = "centre", at = [0.6, 0.2] }}, {{ name = "ball", ball = 0 }}, {{ name = "other", ball = 1 }}] }}
            "#
        ),
        true,
    );
}

/// A mixed mesh with groups and a point, which rank 0 alone reads, and a patch of load that travels
/// between the points of any quadrature rule. The scheme gains energy at each impact; the run ends
/// before impacts have amplified rounding to the tolerance.
#[test]
fn a_mesh_of_groups() {
    let mesh = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/gmsh/square_41_text.msh");
    let mesh = mesh.display();
    agree(
        "groups",
        &format!(
            r#"
            plate = {{ thickness = "0.01 + 0.002*x", youngs_modulus = 12e9, youngs_modulus_across = 1e9, shear_modulus = 0.7e9, poissons_ratio = 0.35, density = 500, grain = 30 }}
            mesh = {{ file = "{mesh}", scale = 1, merge = 1e-9 }}
            part = [{{ group = "steel", thickness = 0.008, grain = 0 }}]
            support = [{{ edge = "left", kind = "clamped" }}]
            obstacle = [{{ side = "below", height = "-0.001*(1 + y) + 0.0004*sin(40*t)", group = "rubber" }}, {{ side = "below", height = -0.004 }}, {{ side = "below", height = -0.002, point = "peak" }}]
            load = {{ pressure = "-40*exp(x - t)*(1 + y) - 500*step(0.02 - hypot(x - 0.3 - t, y - 0.4))" }}
            foundation = [{{ stiffness = "1e3 + 1e6*step(0.01 - hypot(x - 0.31, y - 0.42))", group = "steel" }}]
            time = {{ scheme = "midpoint", mass = "consistent", step = 5e-4, end = 0.06 }}
            output = {{ every = 5, probes = [{{ name = "corner", at = [1, 1] }}, {{ name = "in", at = [0.4, 0.3] }}] }}
            "#
        ),
        true,
    );
}

/// A disc is simply supported on its oblique edges all around, and is released from a deflection
/// over a point.
#[test]
fn a_disc_over_a_point() {
    let file = Drawing::disc(4).write("disc-on-ranks.msh");
    agree(
        "disc",
        &format!(
            r#"
            plate = {{ {PAPER_SECTION} }}
            mesh.file = "{file}"
            support = [{{ edge = "rim", kind = "simply_supported" }}]
            obstacle = [{{ side = "below", height = -1e-3, at = [0, 0] }}]
            initial = {{ deflection = "2e-3*(1 - x^2 - y^2)", velocity = "0.1*(1 - x^2 - y^2)" }}
            load = {{ pressure = "-2000*(1 + x)*cos(50*t)" }}
            time = {{ scheme = "newmark", mass = "consistent", restitution = 0.5, step = 5e-4, end = 0.05 }}
            output = {{ every = 2, probes = [{{ name = "centre", at = [0, 0] }}, {{ name = "in", at = [0.5, 0.3] }}] }}
            "#
        ),
        true,
    );
}

/// Only stops and a rail hold a plate, none of them at nodes of the grid; the plate is pushed up
/// and falls.
#[test]
fn a_cover_on_stops_between_nodes() {
    agree(
        "cover",
        &format!(
            r#"
            {PAPER_PLATE}
            mesh = {{ element = "fvs", cells = [5, 2], refine = 1 }}
            obstacle = [{{ side = "below", height = 0.002, at = [0.13, 0.17] }}, {{ side = "below", height = -0.0015, line = [[1.01, 0.03], [1.07, 0.36]] }}]
            load = {{ gravity = 9.81, force = [{{ at = [1.1, 0.2], value = "200*max(0, sin(200*t))^2" }}] }}
            initial = {{ equilibrium = true }}
            time = {{ scheme = "newmark", mass = "singular", step = 2e-4, end = 0.04 }}
            output = {{ every = 5, probes = [{{ name = "corner", at = [1.2, 0.0] }}, {{ name = "in", at = [0.6, 0.33] }}] }}
            "#
        ),
        true,
    );
    let folder = folder(
        "no-cover",
        &format!(
            r#"
            {PAPER_PLATE}
            mesh = {{ element = "hct", cells = [5, 2] }}
            obstacle = [{{ side = "below", height = 0, where = "x > 0.9" }}]
            load = {{ gravity = 9.81 }}
            initial = {{ equilibrium = true }}
            time = {{ scheme = "newmark", mass = "singular", step = 2e-4, end = 0.04 }}
            "#
        ),
    );
    let words = ["initial.equilibrium: the plate has no equilibrium", "tip about the line through (0.96"];
    assert_fails(&on(&folder, 2, &["run", "fall.toml"]), 2, &words);
}

/// A disc from a file, whose stop and support lie between nodes, is refined where it was read.
#[test]
fn a_disc_on_points_between_nodes() {
    let file = Drawing::disc(2).write("disc-on-points.msh");
    agree(
        "points",
        &format!(
            r#"
            plate = {{ {PAPER_SECTION} }}
            mesh = {{ file = "{file}", refine = 1 }}
            support = [{{ at = [0.11, 0.07], kind = "clamped" }}]
            obstacle = [{{ side = "below", height = -2e-4, at = [0.52, -0.34] }}]
            load = {{ pressure = "-200*(1 + x)*sin(50*t)" }}
            time = {{ scheme = "newmark", mass = "singular", step = 5e-4, end = 0.05 }}
            output = {{ every = 2, probes = [{{ name = "stop", at = [0.52, -0.34] }}, {{ name = "in", at = [0.5, 0.3] }}] }}
            "#
        ),
        true,
    );
}

/// Formulas fail on a part of the plate that may belong to one rank alone, and later than at the
/// start.
#[test]
fn a_fault_of_one_rank_ends_all() {
    let cases = [
        ("load.pressure = \"sqrt(1.1 - x)\"", &["load.pressure: column 1: sqrt(1.1 - x) is NaN"][..]),
        ("load.pressure = \"exp(x - t)*sqrt(1.25 - x - t)\"", &["load.pressure: "]),
        ("load.pressure = \"t*exp(-sqrt(1.1 - x))\"", &["load.pressure: "]),
        (
            "obstacle = [{ side = \"below\", height = \"-1.3 + x + 30*t\" }, { side = \"above\", height = 0.3, at = [1.2, 0.4] }]",
            &["obstacle: at (1.2, 0.4) those below and above leave no room at t = "],
        ),
        (
            "ball = [{ at = [0.6, 0.2], mass = 1, height = 0.1 }]\nspring = [{ at = [0.1, 0.1], stiffness = 1 }]\nfoundation = [{ stiffness = \"1.1 - x\" }]",
            &["foundation.0.stiffness: -"],
        ),
        ("initial.deflection = \"x^2*sqrt(1.1 - x)\"", &["initial.deflection: "]),
        (
            "initial.deflection = \"0.01 - y\"",
            &["initial.deflection: ", "where a support holds the plate at 0"],
        ),
        ("part = [{ where = \"x > 1\", thickness = \"1.1 - x\" }]", &["part.0.thickness: "]),
        (
            "obstacle = [{ side = \"below\", height = -1, where = \"sqrt(1.1 - x) > 0\" }]",
            &["obstacle.0.where: "],
        ),
    ];
    let scene = format!(
        "{PAPER_PLATE}mesh = {{ element = \"fvs\", cells = [6, 2] }}\n{CLAMPED}\
         time = {{ scheme = \"newmark\", mass = \"singular\", step = 1e-3, end = 0.1 }}\n"
    );
    for (number, (more, words)) in cases.into_iter().enumerate() {
        let folder = folder(&format!("fault-{number}"), &format!("{scene}{more}\n"));
        assert_fails(&on(&folder, 2, &["run", "fall.toml"]), 2, words);
    }
}

/// A free plate falls on a moving floor. Two ranks report the same impulses as one process, and
/// their sum is the weight of the plate times the time.
#[test]
fn impulses_of_contacts() {
    for scheme in ["newmark", "midpoint", "conserving"] {
        let folder = folder(
            &format!("impulses-{scheme}"),
            &format!(
                r#"
                {PAPER_PLATE}
                mesh = {{ element = "fvs", cells = [5, 2] }}
                obstacle = [{{ side = "below", height = "-0.002 + 0.001*x - 0.0005*sin(50*t)^2" }}]
                load = {{ gravity = 9.81 }}
                time = {{ scheme = "{scheme}", mass = "singular", step = 2e-4, end = 0.05 }}
                output = {{ fields_every = 50, subdivide = 1 }}
                "#
            ),
        );
        let sums = [0, 2].map(|ranks| {
            rows(&folder, ranks);
            let text = std::fs::read_to_string(folder.join(format!("on-{ranks}/contacts.csv"))).unwrap();
            let mut impulses = BTreeMap::new();
            for line in text.lines().skip(1) {
                let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
                // Nodes are compared by their places, since ranks number nodes differently.
                let place = [numbers[1], numbers[2]].map(|at| (1e6 * at).round() as i64);
                *impulses.entry(place).or_insert(0.0) += numbers[5];
            }
            impulses
        });
        let [one, two]: &[BTreeMap<[i64; 2], f64>; 2] = &sums;
        let total: f64 = one.values().sum();
        assert!(total > 5.0, "{scheme}: {total} N s");
        assert_eq!(one.len(), two.len(), "{scheme}");
        for (place, impulse) in one {
            let off = (two[place] - impulse).abs();
            assert!(off <= 1e-8 * total, "{scheme}: at {place:?} {impulse} or {} N s", two[place]);
        }
    }
}

/// Compliant stops on a line, over an area and at a point, with damping, a compliant ball, and
/// supports that move; on the triangles of one rank, two and three.
#[test]
fn rattling_on_compliant_stops() {
    let scene = format!(
        r#"
            {PAPER_PLATE}
            mesh = {{ element = "hct", cells = [10, 4] }}
            support = [{{ edge = "left", kind = "clamped", motion = "2e-3*sin(2*pi*5.5*t)" }}]
            obstacle = [
                {{ side = "below", height = -0.0015, where = "x > 0.6", stiffness = 1e8, damping = 1e3 }},
                {{ side = "above", height = 0.002, line = [[1.2, 0], [1.2, 0.4]], stiffness = 1e6 }},
                {{ side = "below", height = "-0.001 - 0.001*t", at = [1.2, 0.4], stiffness = 1e5, damping = 10 }},
                {{ side = "below", height = -0.01 }},
            ]
            ball = [{{ at = [0.55, 0.21], mass = 0.2, height = 1e-4, stiffness = 1e6 }}]
            load = {{ gravity = 0.1 }}
            damping = {{ mass = 0.5, stiffness = 1e-5 }}
            time = {{ scheme = "newmark", mass = "singular", step = 1e-4, end = 0.05 }}
            output = {{ probes = [{{ name = "tip", at = [1.2, 0.2] }}, {{ name = "ball", ball = 0 }}] }}
        "#
    );
    agree("stops", &scene, true);
    let folder = folder("stops", &scene);
    let (two, three) = (rows(&folder, 2), rows(&folder, 3));
    for (a, b) in two.iter().zip(&three) {
        assert_eq!(a[6], b[6], "nodes in contact");
        (10..12).for_each(|k| assert!((a[k] - b[k]).abs() <= 1e-11, "t = {}: {:e}, {:e}", a[1], a[k], b[k]));
    }
}

/// Sliders with and without a spring beside a floor; on one rank, two and three.
#[test]
fn dry_friction_beside_a_floor() {
    for (scheme, mass) in [("newmark", "singular"), ("midpoint", "consistent")] {
        let scene = format!(
            r#"
                {PAPER_PLATE}
                {CLAMPED}
                mesh = {{ element = "fvs", cells = [10, 4] }}
                initial.velocity = -0.4
                slider = [
                    {{ name = "pad", at = [1.2, 0.2], force = 3 }},
                    {{ at = [0.6, 0.4], force = 5, stiffness = 2e4 }},
                ]
                obstacle = [{{ side = "below", height = -0.002, where = "x < 0.5 or x > 0.7 and x < 1.1" }}]
                load = {{ pressure = "300*sin(200*t)" }}
                time = {{ scheme = "{scheme}", mass = "{mass}", step = 1e-4, end = 0.04 }}
                output = {{ probes = [{{ name = "tip", at = [1.2, 0.2] }}] }}
            "#
        );
        agree(&format!("slider-{scheme}"), &scene, true);
    }
}

/// Obstacles with friction on both sides of the plate, one of which moves in its plane, beside one
/// without; on one rank, two and three.
#[test]
fn friction_on_a_belt() {
    for (scheme, mass) in [("newmark", "singular"), ("midpoint", "consistent"), ("conserving", "singular")] {
        let scene = format!(
            r#"
                {PAPER_PLATE}
                {CLAMPED}
                mesh = {{ element = "hct", cells = [10, 4] }}
                initial.velocity = -0.4
                part = [{{ where = "x > 0.6", thickness = 0.012 }}]
                obstacle = [
                    {{ name = "belt", side = "below", height = -0.002, where = "x > 0.7", friction = 0.6, velocity = [0.3, "0.2*sin(90*t)"] }},
                    {{ side = "above", height = 0.001, where = "x > 0.5", friction = 0.2 }},
                    {{ side = "below", height = -0.003, where = "x < 0.5" }},
                ]
                load = {{ pressure = "300*sin(200*t) - 900" }}
                time = {{ scheme = "{scheme}", mass = "{mass}", step = 1e-4, end = 0.024 }}
                output = {{ probes = [
                    {{ name = "tip", at = [1.2, 0.2] }},
                    {{ name = "moment", at = [1.2, 0.2], quantity = "friction_moment_x" }},
                ] }}
            "#
        );
        agree(&format!("friction-{scheme}"), &scene, true);
        // Ranks that face no obstacle take part all the same, in the turn by a moving support too.
        let moved = r#"{ at = [0.24, 0.2], kind = "simply_supported", motion = "2e-4*sin(300*t)" }"#;
        let at_tip = scene
            .replace(r#"{ side = "below", height = -0.003, where = "x < 0.5" },"#, "")
            .replace("x > 0.5", "x > 1.1")
            .replace("x > 0.7", "x > 1.1")
            .replace("end = 0.024", "end = 0.012")
            .replace("\"clamped\" }", &format!("\"clamped\" }}, {moved}"));
        agree(&format!("friction-at-the-tip-{scheme}"), &at_tip, true);
    }
}

/// Stops by the law of Hertz at points of both parts, one of which moves, beside a rigid obstacle,
/// and two balls; on one rank, two and three.
#[test]
fn rattling_on_stops_by_the_law_of_hertz() {
    for (scheme, mass) in [
        ("newmark", "\"consistent\""),
        ("midpoint", "\"singular\""),
        ("conserving", "\"singular\""),
        ("conserving", "\"modal\", modes = 30"),
        ("newmark", "\"modal\", modes = 30"),
    ] {
        let scene = format!(
            r#"
                {PAPER_PLATE}
                {CLAMPED}
                mesh = {{ element = "fvs", cells = [10, 4] }}
                obstacle = [
                    {{ name = "pin", side = "below", height = -0.001, at = [1.2, 0], law = "hertz", stiffness = 1e8 }},
                    {{ side = "below", height = "-0.001 - 0.001*sin(50*t)", at = [0.6, 0.4], law = "hertz", stiffness = 1e6 }},
                    {{ side = "above", height = 0.002, where = "x > 1.1" }},
                ]
                ball = [
                    {{ at = [0.55, 0.21], mass = 0.2, height = 1e-4, velocity = -0.5, law = "hertz", stiffness = 1e9 }},
                    {{ at = [0, 0.2], mass = 0.1, height = 1e-4, velocity = -0.5, law = "hertz", stiffness = 1e7 }},
                ]
                load = {{ gravity = 9.81 }}
                time = {{ scheme = "{scheme}", mass = {mass}, step = 5e-5, end = 0.02 }}
                output = {{ probes = [{{ name = "tip", at = [1.2, 0.2] }}, {{ name = "ball", ball = 0 }}, {{ name = "other", ball = 1 }}] }}
            "#
        );
        let test = format!("hertz-{scheme}-{}", mass.len());
        agree(&test, &scene, true);
        let folder = folder(&test, &scene);
        let (one, three) = (rows(&folder, 1), rows(&folder, 3));
        for (a, b) in one.iter().zip(&three) {
            assert_eq!(a[6], b[6], "nodes in contact");
            (10..13).for_each(|k| {
                assert!((a[k] - b[k]).abs() <= 1e-10, "{scheme}, t = {}: {:e}, {:e}", a[1], a[k], b[k])
            });
        }
    }
}

/// Stresses where thickness varies, parts differ and supports move apart: the quantities of probes,
/// and the largest stress on one and three ranks with the envelope of each.
#[test]
fn stresses() {
    let quantities = [
        "velocity",
        "acceleration",
        "slope_y",
        "moment_xx",
        "moment_xy",
        "moment_max",
        "stress_min_bottom",
        "von_mises_top",
    ];
    let probes: Vec<String> = quantities
        .iter()
        .map(|quantity| format!("{{ name = \"{quantity}\", at = [0.47, 0.17], quantity = \"{quantity}\" }}"))
        .collect();
    let scene = format!(
        r#"
        {PAPER_PLATE}
        mesh = {{ element = "hct", cells = [8, 4] }}
        part = [{{ where = "x > 0.6", thickness = "0.008 + 0.001*y" }}]
        support = [{{ edge = "left", kind = "clamped", motion = "2e-3*sin(2*pi*5.5*t)" }}, {{ edge = "right", kind = "simply_supported" }}]
        obstacle = [{{ side = "below", height = -0.0015 }}]
        time = {{ scheme = "newmark", mass = "consistent", step = 5e-4, end = 0.05 }}
        output = {{ every = 5, fields_every = 50, stresses = true, extremes = true, probes = [{{ name = "node", at = [0.6, 0.2], quantity = "von_mises_top" }}, {}] }}
        "#,
        probes.join(", ")
    );
    agree("stresses", &scene, false);
    let folder = folder("stresses-ranks", &scene);
    let extremes = |ranks: usize| {
        rows(&folder, ranks);
        let run = folder.join(format!("on-{ranks}"));
        let summary = command::summary(&run);
        let peak = summary["extremes"]["von_mises"].clone();
        let list = std::fs::read_to_string(run.join("extremes.pvtu")).unwrap_or_default();
        assert_eq!(list.matches("<Piece").count(), if ranks > 1 { ranks } else { 0 });
        peak
    };
    let native = extremes(0);
    for ranks in [1, 3] {
        let peak = extremes(ranks);
        let number = |of: &serde_json::Value, key: &str| of[key].as_f64().unwrap();
        let (a, b) = (number(&native, "value"), number(&peak, "value"));
        assert!((a - b).abs() <= 1e-8 * a, "{a:e}, {b:e}");
        assert_eq!(native["time"], peak["time"]);
        assert_eq!(native["surface"], peak["surface"]);
    }
}

/// Forces of named supports and obstacles on three ranks, with springs and masses at held nodes.
#[test]
fn forces_by_name() {
    let scene = format!(
        r#"
        {PAPER_PLATE}
        mesh = {{ element = "hct", cells = [6, 3] }}
        support = [{{ name = "clamp", edge = "left", kind = "clamped", motion = "2e-3*sin(2*pi*5.5*t)" }}, {{ name = "rest", edge = "right", where = "y < 0.3", kind = "simply_supported", motion = "2e-3*sin(2*pi*5.5*t)" }}]
        obstacle = [{{ name = "stop", side = "below", height = -0.0015, where = "x > 0.5" }}]
        spring = [{{ at = [0.05, 0.02], stiffness = 1e4 }}]
        load = {{ gravity = 0.1, pressure = "-3000*exp(-(x - 3*t)^2)" }}
        time = {{ scheme = "newmark", mass = "singular", step = 5e-4, end = 0.1 }}
        output = {{ every = 4 }}
        "#
    );
    let folder = folder("names", &scene);
    let (native, three) = (rows(&folder, 0), rows(&folder, 3));
    assert_eq!((native.len(), native[0].len()), (three.len(), 20));
    assert!(native.iter().any(|row| row[18] > 0.0), "the stop pushes");
    // The moments of the edges about x come last in size.
    for column in [10, 11, 13, 14, 15, 17, 18, 19] {
        let largest = native.iter().fold(0.0, |m: f64, row| row[column].abs().max(m));
        for (a, b) in native.iter().zip(&three) {
            let error = (a[column] - b[column]).abs();
            assert!(error <= 1e-8 * largest, "t = {}, column {column}: {error:e} of {largest:e}", a[1]);
        }
    }
    let lines =
        |out: &str| std::fs::read_to_string(folder.join(out).join("reactions.csv")).unwrap().lines().count();
    assert_eq!(lines("on-0"), lines("on-3"));
}
