//! The conserving scheme where the lowest modes carry all inertia, compared with the exact motion
//! of the same modes, with other methods, and with theory.

use crate::common::difference;
use crate::common::models::{CLAMPED, PAPER_FALL, PAPER_PLATE, PAPER_START};
use crate::common::scenes;
use crate::exact::table;
use rebond::linalg::Engine;
use rebond::scene::Scene;
use rebond::scheme::Scheme;
use rebond::simulation::{DeflectionDof, Model};

/// Returns a scene with given tables, on fvs cells.
fn scene(tables: &str, time: &str, cells: [usize; 2]) -> Scene {
    let text = format!(
        r#"
        {tables}
        mesh = {{ element = "fvs", cells = {cells:?} }}
        time = {{ {time}, end = 0.2 }}
        output = {{ probes = [{{ name = "corner", at = [1.2, 0.0] }}] }}
        "#
    );
    Scene::from_str(&text, "plate", &[]).expect("a valid scene")
}

fn modal(tables: &str, modes: usize, step: f64) -> (Scene, Model) {
    let time = format!("scheme = \"conserving\", mass = \"modal\", modes = {modes}, step = {step:e}");
    let scene = scene(tables, &time, [10, 4]);
    let model = Model::new(&scene).unwrap();
    (scene, model)
}

/// Returns the deflection of the corner every millisecond, and the largest relative change of
/// energy.
fn run(scene: &Scene, model: &Model, instants: usize) -> (Vec<f64>, f64) {
    let mut scheme = model.scheme(scene).unwrap();
    let every = (1e-3 / scene.time.step).round() as usize;
    let start = scheme.energies().unwrap().total();
    let mut corners = vec![model.probes[0].deflection(scheme.displacement())];
    let mut drift = 0.0f64;
    for _ in 0..instants {
        for _ in 0..every {
            scheme.advance().unwrap();
            drift = drift.max((scheme.energies().unwrap().total() / start - 1.0).abs());
        }
        assert!(scheme.step_report().kkt <= 1e-12, "{:e}", scheme.step_report().kkt);
        corners.push(model.probes[0].deflection(scheme.displacement()));
    }
    (corners, drift)
}

#[test]
fn shorter_steps_approach_the_exact_motion_and_all_keep_the_energy() {
    let exact: Vec<f64> = table("modal_fvs_10x4_m50.csv").iter().map(|row| row[1]).collect();
    let mut last = f64::INFINITY;
    for (step, most) in [(1e-3, 5e-3), (2e-5, 2e-3), (5e-6, 5e-4), (1e-6, 1e-4)] {
        let (scene, model) = modal(PAPER_FALL, 50, step);
        let (corners, drift) = run(&scene, &model, 100);
        let flight = difference(&corners[..54], &exact[..54]);
        let error = difference(&corners, &exact[..corners.len()]);
        println!(
            "step {step:e} s: {flight:.1e} m before the impact, {error:.1e} m after it, energy {drift:.1e}"
        );
        // Free flight has no error of the step.
        assert!(flight <= 1e-9, "{step:e}: {flight:e}");
        assert!(error <= most && error <= 1.5 * last, "{step:e}: {error:e}");
        assert!(drift <= 1e-11, "{step:e}: {drift:e}");
        last = error;
    }
}

#[test]
fn without_contact_all_effects_agree_with_newmark_and_the_consistent_mass() {
    let cases = [
        ("free vibration", "", 1e-6),
        ("pressure in time", "load = { pressure = '3000 * sin(2*pi*30*t) - 500' }\n", 1e-6),
        ("wave", "load = { pressure = '2000 * sin(5*x - 200*t)' }\n", 1e-6),
        ("damping", "damping = { mass = 5, stiffness = 1e-6 }\n", 1e-6),
        ("damped modes", "damping = { modal = [0.02, 0.01, 0.01] }\n", 2e-5),
        ("shaken support", "", 1e-5),
    ];
    for (name, tables, most) in cases {
        let start = match name {
            "shaken support" => PAPER_START
                .replace("kind = \"clamped\"", "kind = \"clamped\", motion = '0.01*sin(2*pi*20*t)^2'"),
            _ => PAPER_START.to_string(),
        };
        let tables = format!("{start}{tables}");
        let (of_modes, model) = modal(&tables, 75, 1e-4);
        let (corners, _) = run(&of_modes, &model, 20);
        let of_all = scene(&tables, "scheme = \"newmark\", mass = \"consistent\", step = 1e-5", [10, 4]);
        let (others, _) = run(&of_all, &Model::new(&of_all).unwrap(), 20);
        let apart = difference(&corners, &others);
        println!("{name}: {apart:.1e} m");
        assert!(apart <= most, "{name}: {apart:e} m");
    }
}

#[test]
fn a_free_plate_on_a_moving_floor_balances_momentum_and_energy() {
    let tables = format!(
        "{PAPER_PLATE}obstacle = [{{ side = \"below\", height = '-0.01 - 0.02*x + 0.005*sin(2*pi*50*t)' }}]\n\
         load = {{ gravity = 9.81 }}\n"
    );
    let (scene, model) = modal(&tables, 40, 1e-5);
    let mut scheme = model.scheme(&scene).unwrap();
    let dofs = model.system.engine.dofs();
    let mut upward = vec![0.0; dofs];
    model.sites.iter().for_each(|DeflectionDof { dof, .. }| upward[*dof] = 1.0);
    let mass = 1.2 * 0.4 * 0.01 * 7770.0;
    let momentum = |scheme: &mut Box<dyn Scheme + '_>| -> f64 {
        let (rate, mut momentum) = (scheme.velocity().unwrap(), vec![0.0; dofs]);
        model.system.engine.multiply(&model.system.mass, &rate, &mut momentum).unwrap();
        momentum.iter().zip(&upward).map(|(p, e)| p * e).sum()
    };
    let start = scheme.energies().unwrap().total();
    let (mut impulse, mut unbalanced, mut drift, mut most, mut touched) = (0.0, 0.0f64, 0.0f64, 0.0f64, 0);
    for _ in 0..10_000 {
        scheme.advance().unwrap();
        impulse += scheme.impulses().iter().sum::<f64>();
        let expected = impulse - mass * 9.81 * scheme.time();
        unbalanced = unbalanced.max((momentum(&mut scheme) - expected).abs());
        let energies = scheme.energies().unwrap();
        drift = drift.max((energies.total() - start).abs());
        most = most.max(energies.kinetic);
        touched += usize::from(scheme.reaction().iter().any(|r| *r != 0.0));
        let deepest = model.system.bounds_at(scheme.time()).unwrap().violation(scheme.displacement());
        // In contact the bounds are linear in time within a step.
        assert!(deepest <= 1e-6, "{deepest:e} m at {} s", scheme.time());
    }
    println!(
        "{touched} steps in contact, impulse {impulse} N s, momentum off by {unbalanced:.1e} N s, energy by {drift:.1e} \
         of {most} J"
    );
    assert!(touched > 50 && unbalanced <= 1e-9 * impulse && drift <= 1e-10 * most);
}

#[test]
fn the_displacement_of_one_dof_has_the_bits_of_that_of_all() {
    let wave = "load = { pressure = '2000 * sin(5*x - 200*t)' }\n";
    let (scene, model) = modal(&format!("{PAPER_FALL}{wave}"), 40, 2e-5);
    let mut scheme = model.scheme(&scene).unwrap();
    let mut touched = 0;
    while scheme.time() < 0.06 {
        scheme.advance().unwrap();
        let touches = scheme.reaction().iter().any(|r| *r != 0.0);
        if touches || scheme.step().is_multiple_of(100) {
            touched += usize::from(touches);
            let dofs = 0..model.system.engine.dofs();
            let single: Vec<u64> = dofs.map(|dof| scheme.displacement_of(dof).to_bits()).collect();
            let all = scheme.displacement().iter().map(|u| u.to_bits());
            assert!(all.eq(single), "step {}", scheme.step());
        }
    }
    assert!(touched > 20, "{touched} steps in contact");
}

#[test]
fn no_node_of_the_mesh_penetrates() {
    // All nodes are evaluated after each step, while the certificates let most of them alone. The
    // obstacles are met by the edge, by many nodes, while they move, and along a ridge.
    let obstacles = [
        ("flat", "-0.1", 0.075),
        ("slope", "-0.004 - 0.08 * x", 0.06),
        ("moving", "-0.08 + 0.02 * sin(2*pi*60*t)", 0.07),
        ("ridge", "-0.03 - 0.5 * abs(x - 0.73) - 0.2 * y", 0.06),
    ];
    for (name, height, end) in obstacles {
        let tables = PAPER_FALL.replace("height = -0.1", &format!("height = '{height}'"));
        no_node_penetrates(name, &tables, end);
    }
}

#[test]
fn nodes_that_an_impact_throws_at_another_obstacle_stop_there() {
    // The plate falls flat onto a rail at its edge. Without the rail it would not come up again for
    // half a period of 0.14 s; the impact throws its middle against a ceiling after 20 ms.
    let tables = format!(
        "{PAPER_PLATE}\n{CLAMPED}\ninitial = {{ velocity = -1 }}\nobstacle = [\
         {{ side = \"below\", height = -0.005, line = [[1.2, 0.0], [1.2, 0.4]] }}, \
         {{ side = \"above\", height = 1e-3, where = \"x < 1.1\" }}]\n"
    );
    no_node_penetrates("thrown", &tables, 0.04);
    // Nothing moves until a ball strikes the plate, and no node could touch the floor for long.
    let tables = format!(
        "{PAPER_PLATE}\n{CLAMPED}\nobstacle = [{{ side = \"below\", height = -3e-4 }}]\n\
         ball = [{{ at = [0.9, 0.2], mass = 1, height = 1e-3, velocity = -1 }}]\n"
    );
    no_node_penetrates("struck", &tables, 0.015);
}

/// Asserts that no node is beyond its obstacle after any step, up to an instant (s), and that the
/// energy is kept.
fn no_node_penetrates(name: &str, tables: &str, end: f64) {
    let time = "scheme = \"conserving\", mass = \"modal\", modes = 60, step = 1e-5";
    let scene = scene(tables, time, [40, 16]);
    let model = Model::new(&scene).unwrap();
    let mut scheme = model.scheme(&scene).unwrap();
    let energy = scheme.energies().unwrap().total();
    let (mut deepest, mut drift, mut most, mut touched) = (0.0f64, 0.0f64, 0, 0);
    while scheme.time() < end {
        scheme.advance().unwrap();
        deepest = deepest.max(scheme.limits().violation(scheme.displacement()));
        drift = drift.max((scheme.energies().unwrap().total() / energy - 1.0).abs());
        most = most.max(scheme.record().candidates().count());
        touched += usize::from(scheme.reaction().iter().any(|r| *r != 0.0));
    }
    let nodes = model.system.bounds.len();
    println!(
        "{name}: {touched} steps in contact, {most} candidates of {nodes} nodes, at most {deepest:.1e} m deep, \
         energy {drift:.1e}"
    );
    assert!(touched > 20 && most < nodes / 2, "{name}: {touched}, {most}");
    assert!(deepest <= 1e-12 && drift <= 1e-11, "{name}: {deepest:e}, {drift:e}");
}

/// A damped plate is pressed against a line by its supports, or by the line itself: the energy, of
/// which the work of what moves is the largest part, tends to that of the midpoint rule. Kicks that
/// stand for a steady force must not count as damped motion, and the work counts in every step.
#[test]
fn damped_plates_that_are_pressed_balance_the_work_of_what_moves() {
    let energy = |time: &str, damping: &str, [motion, height]: [&str; 2]| {
        let held = |edge: &str, kind: &str| {
            format!("{{ edge = \"{edge}\", kind = \"{kind}\", motion = \"{motion}\" }}")
        };
        let supports = [held("bottom", "clamped"), held("right", "clamped"), held("top", "simply_supported")];
        let rows = scenes::run(&format!(
            "plate = {{ length = 1.768, width = 0.631, thickness = 0.0072, youngs_modulus = 70e9, poissons_ratio = 0.3, \
             density = 2700 }}\n{}support = [{}]\ndamping = {{ {damping} }}\n\
             obstacle = [{{ side = \"above\", height = {height}, line = [[1.326, 0], [1.326, 0.631]] }}]\n\
             time = {{ {time}, mass = \"modal\", modes = 20, end = 0.15 }}\noutput.every = 100\n",
            scenes::grid("fvs", 4, 4),
            supports.join(", ")
        ));
        rows.last().unwrap().energy - rows[0].energy
    };
    let [moving, still] = ["0.0033*sin(23*t)", "0"];
    for (damping, moves, most) in [
        ("stiffness = 3e-4", [moving, "0.001"], 0.02),
        ("stiffness = 3e-4", [moving, "0.001, stiffness = 1e7"], 0.02),
        ("stiffness = 3e-4", [still, "\"0.001 - 0.0033*sin(23*t)\""], 0.03),
        ("stiffness = 3e-3", [moving, "0.001"], 0.02),
        ("mass = 20", [moving, "0.001"], 0.06),
    ] {
        let expected = energy("scheme = \"midpoint\", step = 2e-5", damping, moves);
        let off = [1e-4, 5e-5].map(|step| {
            let change = energy(&format!("scheme = \"conserving\", step = {step:e}"), damping, moves);
            (change / expected - 1.0).abs()
        });
        println!("{damping}, {moves:?}: {expected} J, off by {off:?}");
        assert!(off[0] <= most && off[1] <= most, "{damping}, {moves:?}: {expected} J, off by {off:?}");
    }
}
