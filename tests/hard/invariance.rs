//! Invariance of the results under changes of units, under changes of position and numbering of the
//! mesh, and under obstacles out of reach.

use crate::common::Random;
use crate::common::models::plate;
use crate::common::plates::{Alternating, CLAMPED_LEFT, Fvs, Hct, Matrices, Right};
use rebond::assembly;
use rebond::mesh::{Cell, Diagonal, ElementKind, Mesh, Point};
use rebond::obstacle::Bounds;
use rebond::scene::Scene;
use rebond::scheme::{Conserving, Exact, Massless, Midpoint, Newmark, NewmarkParameters};
use rebond::scheme::{Scheme, Start, System};
use rebond::simulation::Model;

const METHODS: &[(&str, &str)] = &[
    ("newmark", "restitution = 0"),
    ("newmark", "restitution = 0.5"),
    ("newmark", "restitution = 1"),
    ("midpoint", "massless = \"equilibrium\""),
    ("midpoint", "massless = \"reflected\""),
    ("conserving", ""),
    ("exact", ""),
];

/// Units of length, mass and time, in SI units.
struct Units {
    length: f64,
    mass: f64,
    time: f64,
}

/// Returns the scene of a plate that is dropped on an obstacle and hits it, in the given units.
fn scene(element: &str, (scheme, more): (&str, &str), units: &Units, changes: &[&str]) -> Scene {
    let Units { length, mass, time } = units;
    let pressure = mass / length / time / time;
    let text = format!(
        r#"
        [plate]
        length = {:e}
        width = {:e}
        thickness = {:e}
        youngs_modulus = {:e}
        poissons_ratio = 0.3
        density = {:e}
        [mesh]
        element = "{element}"
        cells = [6, 2]
        [[support]]
        edge = "left"
        kind = "clamped"
        [[obstacle]]
        side = "below"
        height = {:e}
        [load]
        pressure = {:e}
        [initial]
        static_pressure = {:e}
        velocity = {:e}
        [time]
        scheme = "{scheme}"
        mass = "singular"
        {more}
        step = {:e}
        end = {:e}
        "#,
        1.2 * length,
        0.4 * length,
        0.01 * length,
        210e9 * pressure,
        7770.0 * mass / length.powi(3),
        -0.1 * length,
        -762.0 * pressure,
        14600.0 * pressure,
        -1.0 * length / time,
        1e-4 * time,
        0.1 * time,
    );
    let changes: Vec<String> = changes.iter().map(ToString::to_string).collect();
    Scene::from_str(&text, "units", &changes).unwrap()
}

/// Returns the deflections at all nodes at every tenth step, in units of length.
fn motion(scene: &Scene, length: f64) -> Vec<f64> {
    let model = Model::new(scene).unwrap();
    let mut scheme = model.scheme(scene).unwrap();
    let mut motion = Vec::new();
    let mut contact_steps = 0;
    for step in 1..=scene.time.steps() {
        scheme.advance().unwrap();
        contact_steps += u32::from(scheme.reaction().iter().any(|r| *r != 0.0));
        if step % 10 == 0 {
            motion.extend(model.sites.iter().map(|site| scheme.displacement()[site.dof] / length));
        }
    }
    assert!(scene.obstacles.is_empty() || contact_steps > 20, "{contact_steps} steps in contact");
    motion
}

const SI: Units = Units { length: 1.0, mass: 1.0, time: 1.0 };

#[test]
fn units_do_not_matter() {
    let micro = Units { length: 1e-6, mass: 1e-18, time: 1e-6 };
    let giant = Units { length: 1e3, mass: 1e3, time: 7e4 };
    for element in ["fvs", "hct"] {
        for &method in METHODS {
            let usual = motion(&scene(element, method, &SI, &[]), 1.0);
            for units in [&micro, &giant] {
                let other = motion(&scene(element, method, units, &[]), units.length);
                let difference = crate::common::difference(&usual, &other);
                assert!(difference <= 1e-9, "{element} {method:?}: {difference:e}");
            }
        }
    }
}

/// A power of four scales every number, and its square root, without rounding, so that no bit may
/// differ. A tolerance that is not relative to a quantity of its own unit fails this test.
#[test]
fn units_that_are_powers_of_four_do_not_change_a_bit() {
    let units = Units { length: 4f64.powi(-10), mass: 4f64.powi(-25), time: 4f64.powi(-6) };
    for element in ["fvs", "hct"] {
        // The exact scheme is excluded, since its dense eigenvalues come from a library and agree
        // only to rounding.
        for &method in METHODS.iter().filter(|(scheme, _)| *scheme != "exact") {
            let usual = motion(&scene(element, method, &SI, &[]), 1.0);
            let other = motion(&scene(element, method, &units, &[]), units.length);
            assert!(usual == other, "{element} {method:?}: {:e}", crate::common::difference(&usual, &other));
        }
    }
}

#[test]
fn an_obstacle_out_of_reach_does_not_change_a_bit() {
    for element in ["fvs", "hct"] {
        for &method in METHODS {
            let far = scene(element, method, &SI, &["obstacle.0.height=-1000"]);
            let none = scene(element, method, &SI, &["obstacle=[]"]);
            let [there, alone] = [Model::new(&far).unwrap(), Model::new(&none).unwrap()];
            assert!(!there.system.bounds.is_empty() && alone.system.bounds.is_empty());
            let (mut with, mut without) = (there.scheme(&far).unwrap(), alone.scheme(&none).unwrap());
            for _ in 0..500 {
                with.advance().unwrap();
                without.advance().unwrap();
                assert_eq!(with.displacement(), without.displacement(), "{element} {method:?}");
            }
            assert_eq!(with.step_report().iterations, 0);
        }
    }
}

/// Returns a mesh without symmetry, whose interior nodes are displaced at random.
fn jittered(element: ElementKind, diagonal: Diagonal) -> Mesh {
    let mut mesh = Mesh::rectangle(1.2, 0.4, [6, 3], element, diagonal).unwrap();
    let mut random = Random::new(3);
    for node in &mut mesh.nodes {
        let inside = node.x > 0.0 && node.x < 1.2 - 1e-9 && node.y > 0.0 && node.y < 0.4 - 1e-9;
        let shift = [0.04 * random.signed(), 0.025 * random.signed()];
        if inside {
            (node.x, node.y) = (node.x + shift[0], node.y + shift[1]);
        }
    }
    mesh.check().unwrap();
    mesh
}

/// Returns the mesh in other coordinates; `turns` is true if these are left-handed.
fn placed(mesh: &Mesh, to: impl Fn(Point) -> Point, turns: bool) -> Mesh {
    let mut mesh = mesh.clone();
    mesh.nodes.iter_mut().for_each(|node| *node = to(*node));
    if turns {
        for cell in &mut mesh.cells {
            match cell {
                Cell::Triangle(nodes) => nodes.reverse(),
                Cell::Quadrilateral(nodes) => nodes.reverse(),
            }
        }
    }
    mesh.check().unwrap();
    mesh
}

/// Returns the same mesh with nodes and cells in another order, and with cells that begin at
/// another node, and the new number of each node.
fn renumbered(mesh: &Mesh, random: &mut Random) -> (Mesh, Vec<usize>) {
    let mut shuffle = |count: usize| {
        let mut order: Vec<usize> = (0..count).collect();
        for i in (1..count).rev() {
            order.swap(i, random.below(i + 1));
        }
        order
    };
    let (number, cells) = (shuffle(mesh.nodes.len()), shuffle(mesh.cells.len()));
    let mut other = mesh.clone();
    for (old, &new) in number.iter().enumerate() {
        other.nodes[new] = mesh.nodes[old];
    }
    for (old, &new) in cells.iter().enumerate() {
        other.cells[new] = match mesh.cells[old] {
            Cell::Triangle(mut nodes) => {
                nodes.rotate_left(old % 3);
                Cell::Triangle(nodes.map(|node| number[node]))
            }
            Cell::Quadrilateral(mut nodes) => {
                nodes.rotate_left(old % 4);
                Cell::Quadrilateral(nodes.map(|node| number[node]))
            }
        };
    }
    for edge in other.edges.values_mut().flatten() {
        *edge = edge.map(|node| number[node]);
    }
    other.check().unwrap();
    (other, number)
}

/// Returns the deflections at all nodes of the paper's plate on a mesh, held at the edge "left" and
/// released from 14600 Pa above an obstacle.
fn flight(mesh: &Mesh, method: &str) -> Vec<Vec<f64>> {
    let plate = Matrices::new(mesh.clone(), plate(), CLAMPED_LEFT);
    let displacement = plate.statics(14600.0);
    let dofs = plate.space.dofs();
    let load = Some(assembly::uniform_load(&plate.cells, dofs, -500.0));
    let bounds = Bounds::uniform(plate.deflections(), -0.1, f64::INFINITY);
    let Matrices { engine, stiffness, singular: mass, space, .. } = plate;
    let (damping, drive) = Default::default();
    let system = System { engine, stiffness, mass, damping, load, bounds, bound_numbers: None, drive };
    let start = Start { displacement, velocity: vec![0.0; dofs] };
    let step = 2e-4;
    let newmark = |restitution| NewmarkParameters { beta: 0.5, restitution, step };
    let mut scheme: Box<dyn Scheme> = match method {
        "newmark" => Box::new(Newmark::new(&system, newmark(0.0), start).unwrap()),
        "bouncing" => Box::new(Newmark::new(&system, newmark(1.0), start).unwrap()),
        "midpoint" => Box::new(Midpoint::new(&system, step, Massless::Equilibrium, start).unwrap()),
        "conserving" => Box::new(Conserving::new(&system, step, start).unwrap()),
        _ => Box::new(Exact::new(&system, step, start).unwrap()),
    };
    let mut touched = false;
    let motion = (0..350)
        .map(|_| {
            scheme.advance().unwrap();
            touched |= scheme.reaction().iter().any(|r| *r != 0.0);
            let u = scheme.displacement();
            (0..mesh.nodes.len()).map(|node| space.deflection(node).map_or(0.0, |dof| u[dof])).collect()
        })
        .collect();
    assert!(touched);
    motion
}

#[test]
fn mirrors_turns_and_numbers_do_not_matter() {
    let mut random = Random::new(17);
    for (element, diagonal) in [(Fvs, Right), (Hct, Right), (Hct, Alternating)] {
        let mesh = jittered(element, diagonal);
        let (sine, cosine) = 0.7f64.sin_cos();
        let others = [
            placed(&mesh, |p| Point::new(-p.x, p.y), true),
            placed(&mesh, |p| Point::new(p.x, 3.0 - p.y), true),
            placed(&mesh, |p| Point::new(-p.y, p.x), false),
            placed(&mesh, |p| Point::new(10.0 + cosine * p.x - sine * p.y, sine * p.x + cosine * p.y), false),
        ];
        let (shuffled, number) = renumbered(&mesh, &mut random);
        for method in ["newmark", "bouncing", "midpoint", "conserving", "exact"] {
            let usual = flight(&mesh, method);
            let mut apart = [0.0f64; 2];
            for other in &others {
                for (usual, other) in usual.iter().zip(flight(other, method)) {
                    apart[0] = apart[0].max(crate::common::difference(usual, &other));
                }
            }
            for (usual, other) in usual.iter().zip(flight(&shuffled, method)) {
                let back: Vec<f64> = number.iter().map(|&new| other[new]).collect();
                apart[1] = apart[1].max(crate::common::difference(usual, &back));
            }
            println!(
                "{element:?} {diagonal:?} {method}: placed {:.1e} m, renumbered {:.1e} m",
                apart[0], apart[1]
            );
            assert!(apart.iter().all(|apart| *apart <= 1e-9 * 0.2), "{element:?} {method}: {apart:?} m");
        }
    }
}

/// A flat plate at rest stays at rest to the last bit.
#[test]
fn nothing_begets_nothing() {
    for element in ["fvs", "hct"] {
        for &method in METHODS {
            let scene = scene(
                element,
                method,
                &SI,
                &["load.pressure=0", "initial.static_pressure=0", "initial.velocity=0"],
            );
            let model = Model::new(&scene).unwrap();
            let mut scheme = model.scheme(&scene).unwrap();
            for _ in 0..100 {
                scheme.advance().unwrap();
                assert!(scheme.displacement().iter().all(|u| *u == 0.0), "{element} {method:?}");
                assert_eq!((scheme.step_report().kkt, scheme.energies().unwrap().total()), (0.0, 0.0));
            }
        }
    }
}
