//! The balance of forces of every scheme: it holds at every free dof, and the reactions of supports
//! and obstacles, the loads and the damping add up to the change of momentum of the whole plate.

use crate::common::largest;
use crate::common::models::{STRIP, UNIT};
use crate::common::momentum::{self, Acting, ROUNDING, STILL, Upward};
use crate::common::scenes::{close, grid, scene};
use rebond::Result;
use rebond::linalg::vectors::{axpy, dot};
use rebond::linalg::{Engine, Form};
use rebond::scene::Scene;
use rebond::scheme::{Scheme, StepBalance};
use rebond::simulation::{self, Model, NamedForce, NodeReaction, Observer, Row};

/// Scheme, mass and parameters of every kind.
pub const METHODS: [(&str, &str, &str); 11] = [
    ("newmark", "singular", ", restitution = 0.5"),
    ("newmark", "consistent", ", beta = 0.3, restitution = 0.3"),
    ("midpoint", "singular", ""),
    ("midpoint", "singular", ", massless = \"reflected\""),
    ("midpoint", "consistent", ", massless = \"reflected\""),
    ("conserving", "singular", ""),
    ("exact", "singular", ""),
    ("conserving", "modal", ", modes = 9"),
    ("exact", "modal", ", modes = 9"),
    ("newmark", "modal", ", modes = 9, beta = 0.3, restitution = 0.3"),
    ("midpoint", "modal", ", modes = 9"),
];

pub fn time((scheme, mass, more): (&str, &str, &str), step: f64, steps: u32) -> String {
    let end = step * f64::from(steps);
    format!("time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = {step:?}, end = {end:?}{more} }}\n")
}

/// Returns the largest residual of a balance at the free dofs, relative to the largest force.
fn residual(model: &Model, scheme: &dyn Scheme, balance: &StepBalance) -> f64 {
    let system = &model.system;
    let mut force = vec![0.0; balance.displacement.len()];
    let mut product = force.clone();
    system.engine.multiply(&system.stiffness, &balance.displacement, &mut force).unwrap();
    let mut scale = largest(&force);
    system.engine.project_transpose(&system.mass, &balance.acceleration, &mut product).unwrap();
    scale = scale.max(largest(&product));
    axpy(1.0, &product, &mut force);
    for followed in &balance.followed {
        if let Some(membrane) = &system.drive.membrane {
            membrane.evaluate(&followed.displacement, &mut product).unwrap();
            scale = scale.max(largest(&product));
            axpy(followed.stretching, &product, &mut force);
        }
        if let Some(load) = &system.drive.following {
            load.force(followed.time, &followed.displacement, &mut product).unwrap();
            scale = scale.max(largest(&product));
            axpy(-followed.load, &product, &mut force);
        }
    }
    if let Some(load) = &system.load {
        scale = scale.max(largest(load));
        axpy(-1.0, load, &mut force);
    }
    for (time, weight) in &balance.loads {
        for term in &system.drive.terms {
            axpy(-weight * (term.factor)(*time).unwrap(), &term.load, &mut force);
        }
    }
    for (k, motion) in system.drive.supports.iter().enumerate() {
        let mut momentum = motion.momentum.clone();
        if let Form::Modal { modes, .. } = &system.mass {
            // Inertia acts on the modes alone.
            let v: Vec<f64> =
                (0..modes.count()).map(|k| dot(modes.shapes.col_as_slice(k), &momentum)).collect();
            system.engine.project_transpose(&system.mass, &v, &mut momentum).unwrap();
        }
        axpy(balance.support_accelerations[k], &momentum, &mut force);
        if let Some(stiffness) = &motion.stiffness {
            axpy(balance.places[k], stiffness, &mut force);
        }
    }
    for (r, &dof) in scheme.reaction().iter().zip(&system.bounds.dofs) {
        scale = scale.max(r.abs());
        force[dof] -= r;
    }
    // All is zero at a start without loads.
    largest(&force) / scale.max(f64::MIN_POSITIVE)
}

fn force_rows(scene: &Scene, model: &Model) -> Vec<Vec<f64>> {
    momentum::force_rows(scene, model, &simulation::condensed).unwrap()
}

/// Asserts the balance of the whole plate at every step, and of a linear one also at the free dofs.
/// The plate has 1 m2 and 1 kg. Returns the columns of forces of every row.
fn check(text: &str, acting: &Acting) -> Vec<Vec<f64>> {
    let scene = scene(text);
    let model = Model::new(&scene).unwrap_or_else(|error| panic!("{error}\n{text}"));
    let weighed = Scene::from_str(text, "weighed", &["load={ gravity = 1 }".to_owned()]).unwrap();
    let weight = Model::new(&weighed).unwrap().system.load.unwrap();
    let is_at_rest = text.contains("equilibrium");
    let mut at = |scheme: &mut dyn Scheme| {
        // Without a step the reflected midpoint rule knows no acceleration.
        let is_known = scheme.step() > 0 || is_at_rest || !text.contains("reflected");
        if is_known && !text.contains("stretching") {
            let balance = scheme.balance().unwrap();
            let residual = residual(&model, scheme, &balance);
            assert!(residual <= ROUNDING, "step {}: residual {residual:e}\n{text}", scheme.step());
        }
    };
    let scheme = model.scheme(&scene).unwrap();
    Upward::new(&model, &weight, 1.0, 1.0).check(&scene, scheme, acting, &mut at).unwrap()
}

/// Supports of the test scenes: a clamped edge, and a point or an edge that shares a corner with
/// it.
const HELD: &str = "support = [{ name = \"clamp\", edge = \"left\", kind = \"clamped\"MOTION }, \
     { name = \"roll\", edge = \"bottom\", where = \"x < 0.6\", kind = \"simply_supported\"MOTION }]\n";

fn held(motion: &str) -> String {
    let motion = if motion.is_empty() { String::new() } else { format!(", motion = \"{motion}\"") };
    HELD.replace("MOTION", &motion)
}

const STOPS: &str = "obstacle = [{ name = \"floor\", side = \"below\", height = -0.02 }, \
     { name = \"post\", side = \"below\", height = -0.01, at = [1, 1] }]\n";

/// Stop by the law of Hertz beside the others.
const NIB: &str =
    ", { name = \"nib\", side = \"above\", height = 0, at = [1, 1], law = \"hertz\", stiffness = 2e4 }]\n";

#[test]
fn forces_add_up_to_the_change_of_momentum_in_contact() {
    for method in METHODS {
        for (element, drag) in [("fvs", 0.0), ("hct", 2.0)] {
            let in_time = method.0 != "exact";
            let load = if in_time {
                "load = { gravity = 0.5, pressure = \"0.6*cos(40*t)\" }"
            } else {
                "load.gravity = 0.5"
            };
            // Exact motions are linear between events. The midpoint scheme gains energy without end
            // with the consistent mass, and its forces add up nevertheless.
            let stops =
                if in_time { [STOPS.trim_end_matches("]\n"), NIB].concat() } else { STOPS.to_owned() };
            let text = format!(
                "{UNIT}{}{}{stops}{load}\ninitial.velocity = \"-3*x*y\"\ndamping.mass = {drag:?}\n\
                 {}output.every = 1\nsolver.energy_guard = 1e9\n",
                grid(element, 3, 3),
                held(""),
                time(method, 1.3e-3, 150),
            );
            // The trapezoidal impulse of an event-driven scheme is not that of its motion.
            if !in_time {
                free_dofs(&text);
                continue;
            }
            let pressure = |t: f64| 0.6 * (40.0 * t).cos();
            let rows = check(&text, &Acting { constant: -0.5, pressure: &pressure, drag, ..STILL });
            let columns = scene(&text).force_columns();
            let nib = columns.iter().position(|name| name == "force_nib").unwrap();
            assert!(rows.iter().any(|row| row[nib] < 0.0), "{text}");
        }
    }
}

/// The plate stretches between two edges by more than its bending.
#[test]
fn forces_of_stretching_add_up_too() {
    for method in [
        ("newmark", "singular", ""),
        ("newmark", "consistent", ", beta = 0.3, restitution = 0.3"),
        ("midpoint", "singular", ", massless = \"reflected\""),
        ("midpoint", "consistent", ", massless = \"reflected\""),
        ("conserving", "singular", ""),
    ] {
        for element in ["fvs", "hct"] {
            let ends = "support = [{ name = \"one\", edge = \"left\", kind = \"clamped\" }, \
                        { name = \"other\", edge = \"right\", kind = \"simply_supported\" }]\n";
            let text = format!(
                "{UNIT}{}{ends}obstacle = [{{ name = \"floor\", side = \"below\", height = -0.02 }}]\n\
                 in_plane.stretching = true\nload.gravity = 0.5\ninitial.velocity = \"-9*x*(1 - x)\"\n\
                 damping.mass = 0.5\n{}output.every = 1\nsolver.energy_guard = 1e9\n",
                grid(element, 3, 3),
                time(method, 1.3e-3, 150),
            );
            let rows = check(&text, &Acting { constant: -0.5, drag: 0.5, ..STILL });
            let columns = scene(&text).force_columns();
            let floor = columns.iter().position(|name| name == "force_floor").unwrap();
            assert!(rows.iter().any(|row| row[floor] > 0.0), "{text}");
        }
    }
}

/// Forces in the plane of a plate that stretches give it no momentum.
#[test]
fn a_free_plate_that_stretches_keeps_its_momentum() {
    let methods = [("conserving", "modal", ", modes = 9"), ("conserving", "singular", "")];
    for (element, method) in ["fvs", "hct"].into_iter().flat_map(|element| methods.map(|one| (element, one)))
    {
        let text = format!(
            "{UNIT}{}in_plane.stretching = true\n{STOPS}load.gravity = 0.5\ninitial.velocity = \"-9*x*y\"\n\
             {}output.every = 1\n",
            grid(element, 3, 3),
            time(method, 1.3e-3, 150),
        );
        let rows = check(&text, &Acting { constant: -0.5, ..STILL });
        assert!(rows.iter().filter(|row| row.iter().any(|value| *value != 0.0)).count() > 50);
    }
}

/// Asserts the balance at the free dofs alone.
fn free_dofs(text: &str) {
    let scene = scene(text);
    let model = Model::new(&scene).unwrap_or_else(|error| panic!("{error}\n{text}"));
    let mut scheme = model.scheme(&scene).unwrap();
    scheme.keep_balance().unwrap();
    let mut touched = 0;
    for n in 0..=scene.time.steps() {
        let balance = scheme.balance().unwrap();
        touched += usize::from(scheme.reaction().iter().any(|r| *r != 0.0));
        let residual = residual(&model, scheme.as_ref(), &balance);
        // The modes that damping acts on have errors of their own.
        let most = if text.contains("modal = [") { 10.0 * ROUNDING } else { ROUNDING };
        assert!(residual <= most, "step {n}: residual {residual:e}\n{text}");
        if n < scene.time.steps() {
            scheme.advance().unwrap();
        }
    }
    assert!(model.system.bounds.is_empty() || touched > 3, "{touched}");
}

#[test]
fn forces_add_up_on_moving_supports_and_under_loads_in_time() {
    for method in METHODS.into_iter().filter(|method| method.0 != "exact") {
        for drag in [0.0, 1.5] {
            let text = format!(
                "{UNIT}{}{}load.pressure = \"sin(30*t)*2\"\ndamping.mass = {drag:?}\n{}output.every = 1\n",
                grid("fvs", 3, 3),
                held("0.01*sin(25*t)"),
                time(method, 1.3e-3, 80),
            );
            // The modal mass leaves the rest of the plate without the inertia of its supports.
            if method.1 == "modal" {
                free_dofs(&text);
            } else {
                let (pressure, place) = (|t: f64| 2.0 * (30.0 * t).sin(), |t: f64| 0.01 * (25.0 * t).sin());
                check(&text, &Acting { constant: 0.0, pressure: &pressure, place: &place, drag });
            }
        }
    }
}

/// A plate that moves at the constant speed of all its supports feels no force, from the first step
/// on. On triangles held all around, the singular mass has velocities that no deflection attains.
#[test]
fn supports_at_a_constant_speed_exert_no_force() {
    let support = |edge: &str| {
        format!("{{ name = \"{edge}\", edge = \"{edge}\", kind = \"clamped\", motion = \"0.2*t\" }}")
    };
    let supports = ["left", "right", "bottom", "top"].map(support).join(", ");
    let rib = "rib = [{ line = [[0, 0.1], [0.9, 0.8]], bending = 0.4, torsion = 0.1, mass = 0.5 }]\n";
    for method in METHODS.into_iter().filter(|method| method.0 != "exact") {
        for more in ["", rib] {
            let step = 1e-3;
            let text = format!(
                "{UNIT}{}support = [{supports}]\n{more}initial.velocity = 0.2\n{}output.every = 1\n",
                grid("hct", 4, 4),
                time(method, step, 3),
            );
            let scene = scene(&text);
            let most = largest(&force_rows(&scene, &Model::new(&scene).unwrap()).concat());
            // The momentum of 1 kg at 0.2 m/s, if a step gave it.
            assert!(most <= ROUNDING * 0.2 / step, "{most:e} N\n{text}");
        }
    }
}

/// Damping by the stiffness and of modes, springs, foundations, masses and supports that move
/// apart.
#[test]
fn every_effect_is_in_the_balance() {
    let effects = "spring = [{ at = [0.8, 0.9], stiffness = 40 }, { at = [0.1, 0.1], stiffness = 25 }]\n\
         foundation = [{ stiffness = 30, where = \"x < 0.5\" }]\nmass = [{ at = [0.9, 0.2], mass = 0.3 }]\nrib = [{ line = [[0, 0.1], [0.9, 0.8]], bending = 0.4, torsion = 0.1, mass = 0.5 }, \
         { edge = \"bottom\", bending = 0.2, mass = 0.3 }]\n";
    for method in METHODS.into_iter().filter(|method| method.0 != "exact") {
        let any = method.0 != "conserving" && !method.2.is_empty();
        let dampings = if any || method.1 == "modal" {
            ["stiffness = 1e-4", "modal = [0.03, 0.01]"]
        } else {
            ["mass = 0.7"; 2]
        };
        for damping in dampings {
            for motion in ["", "0.01*sin(25*t)"] {
                let text = format!(
                    "{UNIT}{}{}{effects}load.pressure = \"x*sin(30*t)\"\ndamping = {{ {damping} }}\n\
                     initial.velocity = \"x*x*y\"\n{}",
                    grid("fvs", 3, 3),
                    held("")
                        .replace(
                            "\"simply_supported\" }",
                            &match motion {
                                "" => "\"simply_supported\" }".to_owned(),
                                motion => format!("\"simply_supported\", motion = \"{motion}\" }}"),
                            }
                        )
                        .replace(
                            "edge = \"left\"",
                            if motion.is_empty() { "edge = \"left\"" } else { "edge = \"right\"" }
                        ),
                    time(method, 4e-4, 60),
                );
                free_dofs(&text);
            }
        }
    }
}

/// A simply supported unit square with D = 1 under 1 Pa: the corner force is 0.065 q a^2 downwards
/// on the plate's corners (Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells, table 8),
/// and all supports together carry the load.
#[test]
fn the_corners_of_a_square_are_held_down() {
    let mut errors = Vec::new();
    for cells in [8, 16, 32] {
        let support =
            |edge: &str| format!("{{ name = \"{edge}\", edge = \"{edge}\", kind = \"simply_supported\" }}");
        let supports = ["left", "right", "bottom", "top"].map(support).join(", ");
        let text = format!(
            "{UNIT}{}support = [{supports}]\nload.pressure = -1\ninitial.equilibrium = true\n{}",
            grid("fvs", cells, cells),
            time(METHODS[0], 1e-3, 2),
        );
        let scene = scene(&text);
        let model = Model::new(&scene).unwrap();
        let mut nodes = Corners::default();
        let (outcome, ended) = simulation::run(&scene, &model, &simulation::condensed, &mut nodes).unwrap();
        ended.unwrap();
        let total: f64 = nodes.0.iter().map(|of| of.force).sum();
        assert!((total - 1.0).abs() < 1e-11, "{total}");
        let peaks: f64 = outcome
            .forces
            .values()
            .map(|of| match of {
                NamedForce::Support(support) => support.peak,
                NamedForce::Obstacle(_) => panic!("no obstacle"),
            })
            .sum();
        assert!((peaks - 1.0).abs() < 1e-9, "{peaks}");
        let corner = nodes.0.iter().find(|of| of.at == [0.0, 0.0]).unwrap().force;
        errors.push(corner / -CORNER - 1.0);
    }
    println!("{errors:?}");
    let falls = errors.windows(2).all(|pair| pair[1].abs() < 0.32 * pair[0].abs());
    assert!(falls && errors[2].abs() < 0.026, "{errors:?}");
}

/// Corner force of the simply supported square, q a^2, from Navier's series.
const CORNER: f64 = 0.06496469348726648;

/// Reactions at the nodes at the start.
#[derive(Default)]
struct Corners(Vec<NodeReaction>);

impl Observer for Corners {
    fn row(&mut self, _: &Row) -> Result<()> {
        Ok(())
    }

    fn reactions(&mut self, step: u64, _: f64, rows: &[NodeReaction]) -> Result<()> {
        if step == 0 {
            self.0 = rows.to_vec();
        }
        Ok(())
    }
}

/// Strips of 1 m x 0.1 m and 1 kg/m2 under their weight at 10 m/s2: shear and moment at the root
/// of a cantilever, and of one with a prop at its tip, which carries 3/8 of the weight.
#[test]
fn the_root_of_a_strip_bears_shear_and_moment() {
    let weight = 1.0;
    let clamp = "{ name = \"clamp\", edge = \"left\", kind = \"clamped\" }";
    let prop = ", { name = \"prop\", edge = \"right\", kind = \"simply_supported\" }";
    for (more, [shear, moment, tip]) in [("", [1.0, 0.5, 0.0]), (prop, [0.625, 0.125, 0.375])] {
        for method in METHODS {
            let text = format!(
                "{STRIP}{}support = [{clamp}{more}]\nload.gravity = 10\ninitial.equilibrium = true\n{}output.every = 1\n",
                grid("fvs", 4, 1),
                time((method.0, method.1, method.2.replace("= 9", "= 5").as_str()), 1e-3, 3),
            );
            let scene = scene(&text);
            let model = Model::new(&scene).unwrap();
            for row in force_rows(&scene, &model) {
                close(&format!("shear {method:?}"), row[0], shear * weight, 1e-9);
                // The support turns the root against the weight, about -y.
                close(&format!("moment {method:?}"), row[3].abs(), moment * weight, 1e-9);
                if !more.is_empty() {
                    close(&format!("prop {method:?}"), row[4], tip * weight, 1e-9);
                }
            }
        }
    }
}

/// The force of an elastic edge is that of its springs, also at a corner that a clamp holds.
#[test]
fn an_elastic_edge_bears_what_its_springs_bear() {
    let text = format!(
        "{UNIT}{}support = [{{ name = \"clamp\", edge = \"left\", kind = \"clamped\" }}, \
         {{ name = \"bed\", edge = \"bottom\", kind = \"elastic\", stiffness = 50, rotation = 3 }}, \
         {{ name = \"hinge\", edge = \"top\", kind = \"elastic\", rotation = 2 }}]\n\
         load.pressure = -1\ninitial.equilibrium = true\n{}output.every = 1\n",
        grid("fvs", 4, 4),
        time(METHODS[0], 1e-3, 2),
    );
    let scene = scene(&text);
    let model = Model::new(&scene).unwrap();
    for row in force_rows(&scene, &model) {
        let [clamp, bed, hinge] = [row[0], row[4], row[8]];
        assert!(bed > 0.05 && hinge > 0.05, "{row:?}");
        close("sum", clamp + bed + hinge, 1.0, 1e-10);
    }
    check(
        &text.replace("initial.equilibrium = true", "initial.velocity = \"x\""),
        &Acting { constant: -1.0, ..STILL },
    );
}
