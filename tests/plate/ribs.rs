//! Ribs: energies of polynomial deflections along lines in any direction, closed forms of strips
//! with a rib, and what is refused.

use crate::common::models::{CLAMPED, STRIP, UNIT};
use crate::common::scenes::{Drawing, STILL, close, grid, inspect, read, refusal, scene, start};
use rebond::linalg::{Engine, Native};
use rebond::scene::Scene;
use rebond::simulation;
use std::f64::consts::TAU;

/// Returns twice the elastic energy, and twice the kinetic energy with both masses, of the shape
/// of a quadratic polynomial a x^2 + b x y + c y^2 + d.
pub fn energies(text: &str, [a, b, c, d]: [f64; 4]) -> [f64; 3] {
    let scene = scene(text);
    let mesh = simulation::mesh(&scene).unwrap();
    let matrices = simulation::matrices(&scene, &mesh, false).unwrap();
    let at = |p: &rebond::mesh::Point| {
        let (x, y) = (p.x, p.y);
        [a * x * x + b * x * y + c * y * y + d, 2.0 * a * x + b * y, b * x + 2.0 * c * y]
    };
    let u: Vec<f64> = mesh.nodes.iter().flat_map(at).collect();
    let engine = Native::new(u.len());
    let mut product = vec![0.0; u.len()];
    let stiffness = engine.form(matrices.stiffness);
    let consistent = engine.form(matrices.consistent);
    let singular = engine.averages(matrices.singular);
    let mut v = vec![0.0; engine.velocities(&singular)];
    engine.project(&singular, &u, &mut v).unwrap();
    [
        engine.multiply(&stiffness, &u, &mut product).unwrap(),
        engine.multiply(&consistent, &u, &mut product).unwrap(),
        engine.mass_norm_squared(&singular, &v).unwrap(),
    ]
}

/// Lines in any direction through triangles and quadrilaterals, along sides and diagonals, and
/// along edges: second derivatives of a quadratic polynomial are constant, and its square has
/// degree 4.
#[test]
fn ribs_bend_and_twist_with_the_plate() {
    let shape = [0.7, -1.3, 0.4, 0.2];
    let [a, b, c, d] = shape;
    let w = |x: f64, y: f64| a * x * x + b * x * y + c * y * y + d;
    let skewed = Drawing::grid([4, 3], [1.0, 1.0], false, |x, y| {
        [x + 0.1 * (x * (1.0 - x) * y).sin(), y - 0.2 * x * y * (1.0 - y)]
    })
    .write("ribs-skewed.msh");
    let keys = "thickness = 1, youngs_modulus = 10.92, poissons_ratio = 0.3, density = 1";
    // Triangles and quadrilaterals, as Gmsh made them and refined.
    let mixed = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/gmsh/square_41_text.msh");
    let plates = [
        [UNIT, &grid("fvs", 3, 4)].concat(),
        [UNIT, &grid("hct", 3, 4)].concat(),
        format!("plate = {{ {keys} }}\nmesh.file = \"{skewed}\"\n"),
        format!("plate = {{ {keys} }}\nmesh.file = \"{mixed}\"\n"),
        format!("plate = {{ {keys} }}\nmesh = {{ file = \"{mixed}\", refine = 2 }}\n"),
    ];
    let lines = [
        [[0.0, 0.0], [1.0, 1.0]],
        [[0.05, 0.1], [0.93, 0.41]],
        [[0.0, 0.5], [1.0, 0.5]],
        [[1.0, 0.25], [0.0, 0.25]],
        [[1.0 / 3.0, 0.0], [1.0 / 3.0, 0.9]],
        [[0.2, 0.0], [0.2, 1.0]],
        [[0.41, 0.43], [0.44, 0.42]],
    ];
    let time = STILL;
    for plate in &plates {
        let bare = energies(&format!("{plate}{time}"), shape);
        let check = |path: &str, [[x0, y0], [x1, y1]]: [[f64; 2]; 2]| {
            let rib = format!("rib = [{{ {path}, bending = 3, torsion = 2, mass = 5 }}]\n");
            let ribbed = energies(&format!("{plate}{rib}{time}"), shape);
            let length = (x1 - x0).hypot(y1 - y0);
            let (cos, sin) = ((x1 - x0) / length, (y1 - y0) / length);
            let bent = 2.0 * (a * cos * cos + b * cos * sin + c * sin * sin);
            let twisted = 2.0 * (c - a) * cos * sin + b * (cos * cos - sin * sin);
            let elastic = length * (3.0 * bent * bent + 2.0 * twisted * twisted);
            close(path, ribbed[0] - bare[0], elastic, 1e-9);
            // Simpson's rule on ten thousand parts.
            let parts = 10_000;
            let square = |k: usize| {
                let share = k as f64 / (2 * parts) as f64;
                w(x0 + share * (x1 - x0), y0 + share * (y1 - y0)).powi(2)
            };
            let sum: f64 =
                (0..parts).map(|k| square(2 * k) + 4.0 * square(2 * k + 1) + square(2 * k + 2)).sum();
            let kinetic = 5.0 * length * sum / (6 * parts) as f64;
            close(path, ribbed[1] - bare[1], kinetic, 1e-9);
            // Means over cells have less energy than the deflection itself.
            let mean = ribbed[2] - bare[2];
            assert!(mean > 0.6 * kinetic && mean <= (1.0 + 1e-9) * kinetic, "{path}: {mean}, {kinetic}");
        };
        for line in lines {
            check(&format!("line = {line:?}"), line);
        }
        check("edge = \"left\"", [[0.0, 0.0], [0.0, 1.0]]);
        // A uniform motion has the whole mass, with both masses.
        let rib = "rib = [{ line = [[0.1, 0.2], [0.7, 1.0]], bending = 3, mass = 5 }]\n";
        for (k, energy) in energies(&format!("{plate}{rib}{time}"), [0.0, 0.0, 0.0, 1.0]).iter().enumerate() {
            let bare = energies(&format!("{plate}{time}"), [0.0, 0.0, 0.0, 1.0])[k];
            let expected = if k == 0 { 0.0 } else { 5.0 };
            assert!((energy - bare - expected).abs() <= 1e-9, "{k}: {energy}");
        }
    }
}

/// With the singular mass, ribs add no velocities, wherever they lie in the cells, and the mass is
/// that of plate and ribs together. Two equal ribs on one line are one rib of twice the mass, and a
/// rib is the sum of its halves.
#[test]
fn ribs_with_mass_add_no_velocities() {
    let plate = [UNIT, &grid("fvs", 8, 8), CLAMPED].concat();
    let rows = |ribs: &str| {
        let scene = scene(&format!("{plate}rib = [{ribs}]\n{STILL}"));
        let mesh = simulation::mesh(&scene).unwrap();
        simulation::matrices(&scene, &mesh, false).unwrap().singular
    };
    for [[x0, y0], [x1, y1]] in [
        [[0.0, 0.5], [1.0, 0.5]],
        [[0.0, 0.5625], [1.0, 0.5625]],
        [[0.0, 0.0], [1.0, 1.0]],
        [[0.1, 0.2], [0.9, 0.63]],
    ] {
        let rib = |[a, b]: [[f64; 2]; 2], mass: f64| {
            format!("{{ line = [{a:?}, {b:?}], bending = 1, mass = {mass} }}")
        };
        let (start, end, middle) = ([x0, y0], [x1, y1], [0.5 * (x0 + x1), 0.5 * (y0 + y1)]);
        let one = rows(&rib([start, end], 20.0));
        assert_eq!(one.len(), 64);
        let total: f64 = one.iter().map(|row| row.mass).sum();
        close("mass", total, 1.0 + 20.0 * (x1 - x0).hypot(y1 - y0), 1e-12);
        let twice = [rib([start, end], 10.0), rib([end, start], 10.0)].join(", ");
        let halves = [rib([start, middle], 20.0), rib([middle, end], 20.0)].join(", ");
        for parts in [twice, halves] {
            for (part, whole) in rows(&parts).iter().zip(&one) {
                // Places along a rib count as one up to 1e-9 of its length.
                close("mass of a cell", part.mass, whole.mass, 1e-7);
                for (part, whole) in part.row.iter().zip(&*whole.row) {
                    assert!((part - whole).abs() <= 1e-7 * one[0].mass.max(1.0), "{part}, {whole}");
                }
            }
        }
    }
}

/// A strip without Poisson effect and a rib along its middle are one beam: bending stiffnesses and
/// masses per length add up. The tip's deflection under a force is exact on quadrilaterals, and
/// frequencies converge.
#[test]
fn a_strip_with_a_rib_is_a_beam() {
    // 0.1 N m2 and 0.1 kg/m, and the rib's.
    let (rigidity, mass): (f64, f64) = (0.1 + 0.3, 0.1 + 0.2);
    // The plate's share of the force is spread along its tip: two points of each side have the work
    // of a force that is. The rib's share acts at its end.
    let gauss = 0.5 / 3.0_f64.sqrt();
    for across in [1, 2] {
        let sides = (0..across).flat_map(|side| [-gauss, gauss].map(|of| f64::from(side) + 0.5 + of));
        let spread = sides.map(|side| (0.1 * side / f64::from(across), -0.0375 / f64::from(across)));
        let forces: Vec<String> = spread
            .chain([(0.05, -0.225)])
            .map(|(y, value)| format!("{{ at = [1, {y:?}], value = {value:?} }}"))
            .collect();
        let forces = forces.join(", ");
        let text = format!(
            "{STRIP}{}{CLAMPED}rib = [{{ line = [[0, 0.05], [1, 0.05]], bending = 0.3 }}]\nload.force = [{forces}]\n\
             initial.equilibrium = true\noutput.probes = [{{ name = \"tip\", at = [1, 0.05] }}]\n{STILL}",
            grid("fvs", 10, across as usize),
        );
        close("tip", start(&text)[0], -0.3 / (3.0 * rigidity), 1e-9);
    }
    let first = 1.875104068711961_f64.powi(2) * (rigidity / mass).sqrt() / TAU;
    let figures = |element: &str, along: usize, across: usize| {
        inspect(&format!(
            "{STRIP}{}{CLAMPED}rib = [{{ line = [[0, 0.05], [1, 0.05]], bending = 0.3, mass = 0.2 }}]\n{STILL}",
            grid(element, along, across)
        ))
    };
    // Where a cell of mass m and variance v of x moves with its mean, the motion w lacks the
    // kinetic energy m v w'^2 / 2. The integral of w'^2 of the first mode is as follows, relative
    // to the integral of w^2 (D. Young and R. P. Felgar, 1949).
    let root = 1.875104068711961_f64;
    let shape = root * (root.sinh() - root.sin()) / (root.cosh() + root.cos());
    let slopes = shape * (2.0 + shape);
    // Masses times variances per length, over the square of the length of the cells: rectangles of
    // plate and rib alike; triangles, of which each second one has a side on the rib, whose middle
    // is a sixth of that length from their own.
    let rectangles = mass / 12.0;
    let triangles = 0.1 / 18.0 + 0.2 / 12.0 + 0.05 * 0.2 / (0.05 + 0.2) / 36.0;
    for (element, across, most, lost) in
        [("fvs", 1, 1e-6, rectangles), ("fvs", 2, 1e-6, rectangles), ("hct", 2, 3e-5, triangles)]
    {
        let mut errors = [0.0; 3];
        for (along, error) in [8, 16, 32].into_iter().zip(&mut errors) {
            let of = figures(element, along, across);
            close("mass", of.mass, 0.3, 1e-12);
            *error = of.singular.lowest[0] / first - 1.0;
            if along == 32 {
                close("consistent", of.consistent.lowest[0], first, most);
            }
        }
        // Means over cells are of second order.
        assert!(errors.windows(2).all(|pair| pair[1].abs() < 0.27 * pair[0].abs()), "{element}: {errors:?}");
        let expected = 0.5 * lost / mass * slopes / 32.0_f64.powi(2);
        assert!((errors[2] - expected).abs() < 0.01 * expected + most, "{element}: {errors:?}, {expected}");
    }
}

#[test]
fn keys_are_read_written_and_refused() {
    let with =
        |rib: &str| [UNIT, &grid("fvs", 4, 4), CLAMPED, &format!("rib = [{{ {rib} }}]\n"), STILL].concat();
    for rib in [
        "line = [[0, 0.5], [1, 0.25]], bending = 2.5, torsion = 1, mass = 3",
        "edge = \"top\", bending = 1e3",
    ] {
        let scene = read(&with(rib)).unwrap();
        assert!(scene.effects().iter().any(|on| on == "ribs"));
        assert_eq!(Scene::from_str(&scene.resolved(), "resolved", &[]).unwrap(), scene);
    }
    let line = "line = [[0, 0.5], [1, 0.25]]";
    let cases = [
        (line.to_owned(), "rib.0.bending: missing"),
        (
            format!("{line}, bending = 0"),
            "rib.0.bending: 0 is not positive; expected a bending stiffness in N m2 greater than 0",
        ),
        (
            format!("{line}, bending = 1, torsion = -1"),
            "rib.0.torsion: -1 is negative; expected a torsional stiffness in N m2 of at least 0",
        ),
        (
            format!("{line}, bending = 1, mass = -1"),
            "rib.0.mass: -1 is negative; expected a mass per length in kg/m of at least 0",
        ),
        (
            format!("{line}, bending = 1, edge = \"top\""),
            "rib.0.line: contradicts rib.0.edge; expected only one of line, edge",
        ),
        ("bending = 1".into(), "rib.0.line: missing; expected [[x, y], [x, y]] in m, or edge"),
        ("line = [[0.5, 0.5], [0.5, 0.5]], bending = 1".into(), "rib.0.line: both ends are [0.5, 0.5]"),
        ("line = [[0, 0.5], [1.5, 0.5]], bending = 1".into(), "rib.0.line.1: [1.5, 0.5] is off the plate"),
        ("edge = \"middle\", bending = 1".into(), "rib.0.edge: the mesh has no edge named \"middle\""),
    ];
    for (rib, expected) in cases {
        let said = refusal(&with(&rib)).to_string();
        assert!(said.contains(expected), "{said}\n{expected}");
    }
    // A line that leaves a plate of any shape.
    let file = Drawing::disc(4).write("ribs-disc.msh");
    let disc = |line: &str| {
        format!(
            "plate = {{ thickness = 1, youngs_modulus = 10.92, poissons_ratio = 0.3, density = 1 }}\nmesh.file = \"{file}\"\nsupport = [{{ edge = \"rim\", kind = \"clamped\" }}]\nrib = [{{ {line}, bending = 1 }}]\n{STILL}"
        )
    };
    let said = refusal(&disc("line = [[0, 0], [0, 1.5]]")).to_string();
    assert!(said.contains("rib.0.line: it leaves the plate between (0.000000, 1.000000)"), "{said}");
    let said = refusal(&disc("line = [[2, 0], [2, 1]]")).to_string();
    assert!(said.contains("rib.0.line: it leaves the plate between"), "{said}");
    inspect(&disc("edge = \"rim\""));
}
