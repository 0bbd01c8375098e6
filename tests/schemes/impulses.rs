//! Impulses of the obstacles: their sum is the change of momentum minus the impulses of loads and
//! damping, at any step.

use crate::common::models::{STRIP, UNIT};
use crate::common::scenes::{close, grid, read, run_to_end, scene};
use crate::common::{Random, difference, largest, scenes};
use rebond::linalg::Engine;
use rebond::simulation::{self, Contact, Model, NodeEvent, Observer, Row};
use rebond::{Error, Result};

/// Scheme, mass and parameters of every kind.
const METHODS: [(&str, &str, &str); 9] = [
    ("newmark", "singular", ""),
    ("newmark", "singular", ", restitution = 0.7"),
    ("newmark", "singular", ", beta = 0.25, restitution = 1"),
    ("newmark", "consistent", ", restitution = 0.3"),
    ("midpoint", "singular", ""),
    ("midpoint", "singular", ", massless = \"reflected\""),
    ("midpoint", "consistent", ", massless = \"reflected\""),
    ("conserving", "singular", ""),
    ("exact", "singular", ""),
];

/// Relative rounding error of a balance of momentum.
const ROUNDING: f64 = 1e-10;

fn time((scheme, mass, more): (&str, &str, &str), step: f64, end: f64) -> String {
    format!("time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = {step:?}, end = {end:?}{more} }}\n")
}

/// Upward momentum of a free plate and of everything attached to it, as a functional of a rate over
/// its dofs; the `plate` dofs come first.
struct Upward {
    /// Rise of the plate by 1 m: 1 for each deflection.
    rise: Vec<f64>,
}

impl Upward {
    /// Returns the functional of a model with some balls, whose gaps come last.
    fn new(model: &Model, balls: usize) -> Upward {
        let dofs = model.system.engine.dofs();
        let is_deflection = |dof: usize| dof.is_multiple_of(3) && dof + balls < dofs;
        Upward { rise: (0..dofs).map(|dof| f64::from(is_deflection(dof))).collect() }
    }

    fn dot(&self, x: &[f64]) -> f64 {
        x.iter().zip(&self.rise).map(|(x, rise)| x * rise).sum()
    }

    /// Returns the momentum of a rate in m/s, in kg m/s.
    fn momentum(&self, model: &Model, rate: &[f64]) -> f64 {
        let mut product = vec![0.0; rate.len()];
        model.system.engine.multiply(&model.system.mass, rate, &mut product).unwrap();
        self.dot(&product)
    }
}

/// Contacts that a run reported.
#[derive(Default)]
struct Watched {
    contacts: Vec<Contact>,
    events: Vec<NodeEvent>,
    forces: Vec<[f64; 2]>,
}

impl Observer for Watched {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.forces.push([row.time, row.contact_force]);
        Ok(())
    }

    fn contacts(&mut self, ended: &[Contact]) -> Result<()> {
        self.contacts.extend(ended);
        Ok(())
    }

    fn event(&mut self, event: &NodeEvent) -> Result<()> {
        self.events.push(*event);
        Ok(())
    }
}

/// Runs a scene of a free plate and asserts the balance of momentum at each instant, and that the
/// impulses add up to those of the reported contacts. Returns the sum of their magnitudes, and the
/// worst error relative to this sum and to the momenta.
fn balance(text: &str, balls: usize, tolerance: f64) -> Result<[f64; 2]> {
    let scene = read(text)?;
    let model = Model::new(&scene)?;
    let upward = Upward::new(&model, balls);
    let step = scene.time.step;
    let weight = upward.dot(model.system.load.as_deref().unwrap_or(&vec![0.0; upward.rise.len()]));
    let drag = model.system.damping.mass;
    let newmark = text.contains("newmark");
    let mut scheme = model.scheme(&scene)?;
    let start = upward.momentum(&model, &scheme.velocity()?);
    let first = scheme.displacement().to_vec();
    let (mut given, mut whole, mut lost, mut worst) = (0.0, 0.0, 0.0, 0.0f64);
    let mut every = vec![0.0; model.system.bounds.len()];
    let mut scale = start.abs();
    // Newmark's damping acts on the central velocity, and at the start on the chord of the first
    // step.
    let (mut before, mut central) = (first.clone(), start);
    assert!(scheme.impulses().iter().all(|impulse| *impulse == 0.0));
    for n in 1..=scene.time.steps() {
        scheme.advance()?;
        let momentum = upward.momentum(&model, &scheme.velocity()?);
        let chord = |from: &[f64], to: &[f64]| {
            upward.momentum(&model, &to.iter().zip(from).map(|(to, from)| to - from).collect::<Vec<_>>())
        };
        if newmark {
            let chord = chord(&before, scheme.displacement()) / step;
            let from = if n == 1 { chord } else { central };
            lost += 0.5 * step * drag * (from + momentum);
            central = momentum;
            before.copy_from_slice(scheme.displacement());
        } else {
            lost = drag * chord(&first, scheme.displacement());
        }
        for (i, impulse) in scheme.impulses().iter().enumerate() {
            let outer = upward.rise[model.system.bounds.dofs[i]];
            given += outer * impulse;
            whole += outer * impulse.abs();
            every[i] += impulse;
        }
        let falls = weight * scheme.time();
        scale = scale.max(momentum.abs()).max(falls.abs()).max(whole);
        let error = momentum - start - falls - given + lost;
        worst = worst.max(error.abs() / scale);
        if error.is_nan() || error.abs() > tolerance * scale {
            panic!("t = {}: {error:e} of {scale:e} N s\n{text}", scheme.time());
        }
    }
    drop(scheme);
    let mut watched = Watched::default();
    let (outcome, ended) = simulation::run(&scene, &model, &simulation::condensed, &mut watched)?;
    match ended {
        // The guard ends the run, but the balance holds until then.
        Err(Error::EnergyGuard { .. } | Error::NotConverged { .. }) => return Ok([whole, worst]),
        ended => ended?,
    }
    assert_eq!(outcome.node_contacts, watched.contacts.len() as u64);
    let told: f64 = watched.contacts.iter().map(|contact| contact.impulse).sum();
    let booked = (told - every.iter().sum::<f64>()).abs();
    assert!(booked <= 1e-12 * scale.max(largest(&every)), "contacts.csv is {booked:e} N s off\n{text}");
    one_story(&watched, step, text);
    Ok([whole, worst])
}

/// Asserts that history, contacts and events name the same instants.
fn one_story(watched: &Watched, step: f64, text: &str) {
    for &[time, force] in &watched.forces {
        let near = |contact: &&Contact| contact.begin <= time && time <= contact.end;
        assert!(
            force == 0.0 || watched.contacts.iter().any(|of| near(&of)),
            "no contact at {time} s\n{text}"
        );
    }
    for NodeEvent { node, event, .. } in &watched.events {
        let mut of_node = watched.contacts.iter().filter(|contact| contact.node == *node);
        let told = of_node.any(|contact| contact.begin <= event.time && event.time <= contact.end);
        assert!(told, "no contact of node {node} at {} s\n{text}", event.time);
    }
    if watched.events.is_empty() {
        let rows: Vec<f64> = watched.forces.iter().map(|[time, _]| *time).collect();
        for contact in &watched.contacts {
            let is_row = |time: f64| rows.iter().any(|row| (row - time).abs() < 1e-6 * step);
            assert!(is_row(contact.begin) && is_row(contact.end), "{contact:?}\n{text}");
        }
    }
}

/// A free plate of 1 kg falls by 0.05 m onto a floor under 9.81 N.
#[test]
fn a_plate_falls_on_a_floor() {
    for method in METHODS {
        for step in [1e-2, 1e-3, 1e-4] {
            // The plate is not level, and lands on an edge first.
            let text = format!(
                "{UNIT}{}obstacle = [{{ side = \"below\", height = \"-0.05 + 0.01*x + 0.002*y\" }}]\n\
                 load = {{ pressure = -9.81 }}\n{}output.every = 1\n",
                grid("fvs", 3, 2),
                time(method, step, 0.3)
            );
            let [whole, worst] = balance(&text, 0, ROUNDING).unwrap();
            println!("{method:?}, {step:e} s: {whole:.3} N s, {worst:.1e}");
            assert!(whole > 0.5, "{whole}");
        }
    }
}

/// The plate lies on the floor from the start: the impulse is its weight times the time.
#[test]
fn a_plate_rests_on_a_floor() {
    for method in METHODS {
        let text = format!(
            "{UNIT}{}obstacle = [{{ side = \"below\", height = 0 }}]\nload = {{ pressure = -9.81 }}\ninitial.equilibrium = true\n{}output.every = 1\n",
            grid("fvs", 2, 2),
            time(method, 1e-3, 0.02)
        );
        balance(&text, 0, ROUNDING).unwrap();
        let scene = scene(&text);
        let model = Model::new(&scene).unwrap();
        let mut watched = Watched::default();
        simulation::run(&scene, &model, &simulation::condensed, &mut watched).unwrap().1.unwrap();
        let total: f64 = watched.contacts.iter().map(|contact| contact.impulse).sum();
        close(&format!("{method:?}"), total, 9.81 * 0.02, 1e-9);
    }
}

/// The scenes have two stops, a moving obstacle with mass-proportional damping, and a ball that
/// rides on the plate.
#[test]
fn momentum_is_balanced_between_stops_and_on_balls() {
    for (k, method) in METHODS.into_iter().enumerate() {
        let exact = method.0 == "exact";
        let floor = if exact { "-0.01" } else { "\"-0.01 + 0.004*sin(40*t)\"" };
        let text = format!(
            "{UNIT}{}obstacle = [{{ side = \"below\", height = {floor} }}, {{ side = \"above\", height = 0.02, where = \"x > 0.3\" }}]\n\
             load = {{ pressure = -3 }}\ndamping.mass = 1.5\ninitial.velocity = \"1 + 0.3*x\"\n{}",
            grid("hct", 2, 2),
            time(method, 1.3e-3, 0.26)
        );
        match balance(&text, 0, ROUNDING) {
            Ok([whole, worst]) => {
                println!("{method:?}: {whole:.3} N s, {worst:.1e}");
                assert!(whole > 0.1, "{whole}");
            }
            Err(why) => println!("{method:?}: {why}"),
        }
        let step = [2e-3, 3e-4][k % 2];
        let text = format!(
            "{UNIT}{}obstacle = [{{ side = \"below\", height = -0.02, where = \"x < 0.3\" }}]\n\
             ball = [{{ at = [0.7, 0.5], mass = 0.5, height = 0.01, velocity = -3 }}]\nload.gravity = 9.81\n{}",
            grid("fvs", 4, 4),
            time(method, step, 0.15)
        );
        // A ball in the air next to a stiff plate is too slow a motion for modes.
        if !exact {
            let [whole, worst] = balance(&text, 1, ROUNDING).unwrap();
            println!("{method:?}, ball: {whole:.3} N s, {worst:.1e}");
            assert!(whole > 0.1, "{whole}");
        }
    }
}

/// Returns a random scene.
fn drawn(random: &mut Random) -> (String, usize) {
    let method = METHODS[random.below(METHODS.len())];
    let exact = method.0 == "exact";
    let (element, balls) = (["fvs", "hct"][random.below(2)], usize::from(random.below(4) == 0));
    let step = 10f64.powf(-4.0 + 2.5 * random.unit());
    let floor = -0.02 * random.unit() * f64::from(random.below(4) > 0);
    let shape = ["", " - 0.004*x", " - 0.01*y"][random.below(3)];
    let moves = if exact || random.below(3) > 0 {
        String::new()
    } else {
        format!(" - 0.01*sin({:?}*t)^2", 60.0 * random.unit())
    };
    let mut text = format!(
        "{UNIT}{}obstacle = [{{ side = \"below\", height = \"{floor:?}{shape}{moves}\" }}",
        grid(element, 1 + random.below(3), 1 + random.below(3)),
    );
    if random.below(3) == 0 {
        text += &format!(
            ", {{ side = \"above\", height = {:?}, where = \"x > 0.4\" }}",
            0.001 + 0.03 * random.unit()
        );
    }
    text += &format!("]\nload.gravity = {:?}\n", 10.0 * random.unit());
    if random.below(2) == 0 {
        text += &format!("initial.velocity = \"{:?} + {:?}*x\"\n", 2.0 * random.signed(), random.signed());
    }
    if random.below(3) == 0 {
        text += &format!("damping.mass = {:?}\n", 10f64.powf(3.0 * random.signed()));
    }
    if balls == 1 {
        let at = 0.1 + 0.8 * random.unit();
        text += &format!(
            "ball = [{{ at = [{at:?}, 0.37], mass = {:?}, height = {:?}, velocity = {:?} }}]\n",
            10f64.powf(random.signed()),
            0.02 * random.unit(),
            random.signed()
        );
    }
    (text + &time(method, step, 50.0 * step), balls)
}

fn draws_are_balanced(seed: u64, tries: u32) {
    let mut random = Random::new(seed);
    let (mut touched, mut refused, mut worst) = (0, 0, 0.0f64);
    for _ in 0..tries {
        let (text, balls) = drawn(&mut random);
        match balance(&text, balls, ROUNDING) {
            Ok([whole, error]) => {
                touched += u32::from(whole > 0.0);
                worst = worst.max(error);
            }
            // Scenes without the inf-sup condition, or with a mechanism of a single cell, have no
            // motion that could be wrong.
            Err(Error::Singular(_) | Error::Usage(_) | Error::Scene(_) | Error::Mesh(_)) => refused += 1,
            Err(why) => panic!("{why}\n{text}"),
        }
    }
    println!("{touched} of {tries} touched, {refused} refused, off by {worst:.1e} at most");
    assert!(touched > tries / 3 && refused < tries / 2, "{touched} touched, {refused} refused of {tries}");
}

#[test]
fn momentum_is_balanced_whatever_the_scene() {
    draws_are_balanced(1, 120);
}

#[test]
#[ignore = "minutes"]
fn momentum_is_balanced_in_ten_thousand_scenes() {
    draws_are_balanced(2, 10_000);
}

/// A freely falling plate has the velocity of its own instant, -g t everywhere.
#[test]
fn a_falling_plate_is_as_fast_as_it_falls() {
    for method in METHODS {
        let text = format!(
            "{UNIT}{}obstacle = [{{ side = \"below\", height = -1 }}]\nload = {{ pressure = -9.81 }}\n{}",
            grid("fvs", 3, 2),
            time(method, 1e-3, 0.1)
        );
        let scene = scene(&text);
        let model = Model::new(&scene).unwrap();
        let mut scheme = model.scheme(&scene).unwrap();
        for _ in 0..scene.time.steps() {
            scheme.advance().unwrap();
            let velocity = scheme.velocity().unwrap();
            let falls: Vec<f64> = (0..velocity.len())
                .map(|dof| if dof.is_multiple_of(3) { -9.81 * scheme.time() } else { 0.0 })
                .collect();
            let error = difference(&velocity, &falls);
            assert!(error <= 1e-9, "{method:?}, t = {}: {error:e}", scheme.time());
        }
    }
}

/// Returns a strip pressed on a stop, around which it vibrates and which it never leaves.
fn pressed(method: (&str, &str, &str), step: f64) -> String {
    format!(
        "{STRIP}{}support = [{{ edge = \"left\", kind = \"clamped\" }}]\n\
         obstacle = [{{ side = \"below\", height = -0.02, where = \"x > 0.99\" }}]\n\
         load = {{ pressure = -1 }}\ninitial = {{ static_pressure = -1.05 }}\n{}",
        grid("fvs", 5, 1),
        time(method, step, 0.4)
    )
}

/// Velocities converge to those of the exact motion with order 2, in lasting contact too.
#[test]
fn velocities_are_of_order_two() {
    let at_end = |method, step: f64| {
        let scene = scene(&pressed(method, step));
        let model = Model::new(&scene).unwrap();
        let mut scheme = model.scheme(&scene).unwrap();
        let mut touched = true;
        for _ in 0..scene.time.steps() {
            scheme.advance().unwrap();
            touched &= scheme.reaction().iter().all(|r| *r != 0.0);
        }
        assert!(touched, "{method:?}: it leaves the stop");
        scheme.velocity().unwrap()
    };
    let exact = at_end(METHODS[8], 1e-3);
    for method in [METHODS[0], METHODS[4], METHODS[5], METHODS[7]] {
        let errors =
            [4e-4, 2e-4, 1e-4].map(|step| difference(&at_end(method, step), &exact) / largest(&exact));
        println!("{method:?}: {errors:?}");
        assert!(errors[2] < 0.1 && errors[2] < errors[1] / 3.0, "{method:?}: {errors:?}");
    }
}

/// Evaluating velocities does not change the motion.
#[test]
fn looking_at_velocities_changes_nothing() {
    for method in METHODS {
        let text = format!(
            "{UNIT}{}obstacle = [{{ side = \"below\", height = \"-0.01 + 0.004*x\" }}]\nload = {{ pressure = -9.81 }}\n{}",
            grid("fvs", 3, 3),
            time(method, 1e-3, 0.2)
        );
        let scene = scene(&text);
        let model = Model::new(&scene).unwrap();
        let [mut seen, mut unseen] = [model.scheme(&scene).unwrap(), model.scheme(&scene).unwrap()];
        for _ in 0..scene.time.steps() {
            seen.advance().unwrap();
            unseen.advance().unwrap();
            seen.velocity().unwrap();
            assert_eq!(seen.displacement(), unseen.displacement(), "{method:?}");
        }
    }
}

/// A rising floor hits a plate at rest: the closing speed is that of the floor, whichever of them
/// moves.
#[test]
fn a_floor_that_rises_closes_at_its_speed() {
    for method in METHODS.into_iter().filter(|method| method.0 != "exact") {
        let text = |height: &str, velocity: f64| {
            format!(
                "{UNIT}{}obstacle = [{{ side = \"below\", height = \"{height}\" }}]\ninitial.velocity = {velocity:?}\n{}",
                grid("fvs", 2, 2),
                time(method, 1e-4, 0.01)
            )
        };
        for (height, velocity) in [("-0.002 + 0.5*t", 0.0), ("-0.002", -0.5), ("-0.002 - 1.5*t", -2.0)] {
            let impact = run_to_end(&text(height, velocity)).1.first_impact.unwrap();
            close(&format!("{method:?}, {height}: velocity"), impact.velocity, -0.5, 1e-7);
            close(&format!("{method:?}, {height}: time"), impact.time, 0.004, 1e-7);
        }
    }
}

/// Returns a stiff block on n x n cells that a ball of some mass hits.
fn block(n: usize, ball: &str, scheme: &str, step: f64, end: f64) -> String {
    format!(
        "plate = {{ length = 0.1, width = 0.1, thickness = 0.05, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7800 }}\n\
         {}{}foundation = [{{ stiffness = 1e5 }}]\n\
         ball = [{{ at = [0.05, 0.05], height = 1e-5, velocity = -1.0, {ball} }}]\n\
         output.probes = [{{ name = \"v\", ball = 0, quantity = \"velocity\" }}]\n\
         time = {{ scheme = \"{scheme}\", mass = \"singular\", step = {step:e}, end = {end:e} }}\n",
        scenes::all_round("guided"),
        grid("fvs", n, n)
    )
}

/// Returns the speed of the ball at the end.
fn speed(text: &str) -> f64 {
    scenes::run(text).last().map(|row| row.probes[0]).unwrap()
}

/// A rigid ball on a stiff block leaves with what the block's fastest motion gives it. With the
/// advised step its speed is that of the exact motion, which has no step.
#[test]
fn the_advised_step_follows_a_rigid_ball() {
    let conserving = |step: f64| block(4, "mass = 1", "conserving", step, 6e-5);
    let exact = speed(&block(4, "mass = 1", "exact", 1e-5, 6e-5));
    let check = rebond::study::check(&scene(&conserving(1e-5))).unwrap();
    let advised = check.advised_step.unwrap();
    let found = speed(&conserving(advised));
    println!("{advised:e} s: {found} m/s, exact {exact} m/s");
    assert!((found / exact - 1.0).abs() <= 0.01, "{advised:e} s: {found} m/s, exact {exact} m/s");
    assert!(check.warnings.iter().any(|said| said.contains("the rebound of a rigid ball")), "{check:?}");
}

/// The mesh decides how fast a rigid ball leaves if the ball is light beside a cell, and a warning
/// says so; a heavy ball and a compliant one leave alike from every mesh.
#[test]
fn a_light_rigid_ball_depends_on_the_mesh() {
    for (ball, scheme, is_light) in [
        ("mass = 1", "exact", true),
        ("mass = 40", "exact", false),
        ("mass = 1, stiffness = 1e8", "conserving", false),
    ] {
        let texts = [4, 8].map(|n| block(n, ball, scheme, 1e-6, 1e-3));
        let check = rebond::study::check(&scene(&texts[0])).unwrap();
        let warns = check.warnings.iter().any(|said| said.contains("depends on the mesh: give the ball"));
        let [coarse, fine] = texts.map(|text| speed(&text));
        println!("{ball}: {coarse} and {fine} m/s");
        assert_eq!([(coarse - fine).abs() > 0.02, warns], [is_light; 2], "{ball}: {coarse}, {fine} m/s");
    }
}
