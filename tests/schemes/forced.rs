//! Time-dependent loads: closed forms, and an energy balance that holds to rounding.

use crate::common::models::PAPER_START;
use crate::common::{block, largest};
use rebond::linalg::{CellClass, Engine, Native, SingularMassCell};
use rebond::obstacle::Bounds;
use rebond::scene::Scene;
use rebond::scheme::{
    Conserving, Damping, Massless, Midpoint, Newmark, NewmarkParameters, Scheme, Solution, Start, System,
    TimeDependence,
};
use rebond::simulation::Model;

const MASS: f64 = 2.5;
const STIFFNESS: f64 = 1000.0;
const FORCE: f64 = 30.0;
const PLACE: f64 = 0.02;
const SPEED: f64 = -0.3;

/// Returns m u'' + (alpha m + beta k) u' + k u = F sin(W t), with the mass in a cell of its own.
fn oscillator(damping: Damping, frequency: f64) -> System<Native> {
    let engine = Native::new(1);
    let stiffness = engine.form(vec![block(&[Some(0)], &[STIFFNESS], 0)]);
    let mass = engine.averages(vec![SingularMassCell {
        dofs: [Some(0)].into(),
        row: [MASS].into(),
        mass: MASS,
        class: CellClass::Plate(0),
    }]);
    let load = move |time: f64, load: &mut [f64]| {
        load[0] += FORCE * (frequency * time).sin();
        Ok(())
    };
    let drive = TimeDependence { load: Some(Box::new(load)), ..TimeDependence::default() };
    System {
        engine,
        stiffness,
        mass,
        damping,
        load: None,
        bounds: Bounds::default(),
        bound_numbers: None,
        drive,
    }
}

/// Returns the position by the textbook: a steady oscillation and a decaying free one.
fn place(damping: Damping, frequency: f64, t: f64) -> f64 {
    let resistance = damping.mass * MASS + damping.stiffness * STIFFNESS;
    let (real, imaginary) = (STIFFNESS - MASS * frequency * frequency, resistance * frequency);
    let size = FORCE / real.hypot(imaginary);
    let phase = imaginary.atan2(real);
    let decay = 0.5 * resistance / MASS;
    let omega = (STIFFNESS / MASS - decay * decay).sqrt();
    let cosine = PLACE + size * phase.sin();
    let sine = (SPEED - size * frequency * phase.cos() + decay * cosine) / omega;
    let free = (-decay * t).exp() * (cosine * (omega * t).cos() + sine * (omega * t).sin());
    size * (frequency * t - phase).sin() + free
}

fn start() -> Start {
    Start { displacement: vec![PLACE], velocity: vec![SPEED] }
}

fn newmark(system: &System<Native>, step: f64) -> Box<dyn Scheme + '_> {
    let parameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step };
    Box::new(Newmark::new(system, parameters, start()).unwrap())
}

fn midpoint(system: &System<Native>, step: f64) -> Box<dyn Scheme + '_> {
    Box::new(Midpoint::new(system, step, Massless::Reflected, start()).unwrap())
}

fn equilibrium(system: &System<Native>, step: f64) -> Box<dyn Scheme + '_> {
    Box::new(Midpoint::new(system, step, Massless::Equilibrium, start()).unwrap())
}

fn conserving(system: &System<Native>, step: f64) -> Box<dyn Scheme + '_> {
    Box::new(Conserving::new(system, step, start()).unwrap())
}

type Make = for<'s> fn(&'s System<Native>, f64) -> Box<dyn Scheme + 's>;

const NONE: Damping = Damping { mass: 0.0, stiffness: 0.0 };
const BY_MASS: Damping = Damping { mass: 1.5, stiffness: 0.0 };
const BOTH: Damping = Damping { mass: 0.4, stiffness: 2e-3 };

#[test]
fn an_oscillator_follows_its_closed_form_with_order_2() {
    let schemes: [(&str, Make, &[Damping]); 4] = [
        ("newmark", newmark, &[NONE, BY_MASS, BOTH]),
        ("midpoint, reflected", midpoint, &[NONE, BY_MASS, BOTH]),
        ("midpoint", equilibrium, &[NONE, BY_MASS]),
        ("conserving", conserving, &[NONE, BY_MASS]),
    ];
    for (name, make, dampings) in schemes {
        for &damping in dampings {
            let frequency = 13.0;
            let errors = [8e-3, 4e-3, 2e-3, 1e-3].map(|step: f64| {
                let system = oscillator(damping, frequency);
                let mut scheme = make(&system, step);
                let mut worst = 0.0f64;
                for _ in 0..(2.0 / step).round() as usize {
                    scheme.advance().unwrap();
                    let error = scheme.displacement()[0] - place(damping, frequency, scheme.time());
                    worst = worst.max(error.abs());
                    assert!(scheme.step_report().kkt <= 1e-12);
                }
                worst
            });
            println!("{name}, {damping:?}: {errors:?}");
            for pair in errors.windows(2) {
                let order = (pair[0] / pair[1]).log2();
                assert!((1.9..2.1).contains(&order), "{name}, {damping:?}: {errors:?}");
            }
        }
    }
}

/// Returns the paper's plate at rest under 14600 Pa, pressed by 3 kPa at 12 Hz, with or without an
/// obstacle.
fn forced_plate(element: &str, scheme: &str, step: f64, obstacle: bool, damping: Damping) -> (Scene, Model) {
    let obstacle = if obstacle { "obstacle = [{ side = \"below\", height = -0.1 }]" } else { "" };
    let text = format!(
        r#"
        {PAPER_START}
        mesh = {{ element = "{element}", cells = [10, 4] }}
        {obstacle}
        load = {{ pressure = 1000 }}
        time = {{ scheme = "{scheme}", mass = "singular", step = {step:e}, end = 1 }}
        "#
    );
    let scene = Scene::from_str(&text, "forced", &[]).expect("a valid scene");
    let mut model = Model::new(&scene).unwrap();
    let shape = model.system.load.clone().unwrap();
    model.system.drive.load = Some(Box::new(move |time: f64, load: &mut [f64]| {
        let factor = 3.0 * (75.0 * time).sin();
        load.iter_mut().zip(&shape).for_each(|(f, one)| *f += factor * one);
        Ok(())
    }));
    model.system.damping = damping;
    (scene, model)
}

/// Returns V^T D V, in W.
fn loss(model: &Model, rate: &[f64]) -> f64 {
    let System { engine, stiffness, mass, damping, .. } = &model.system;
    let mut product = vec![0.0; rate.len()];
    let of_mass = engine.multiply(mass, rate, &mut product).unwrap();
    damping.mass * of_mass + damping.stiffness * engine.multiply(stiffness, rate, &mut product).unwrap()
}

/// Returns the velocity in the middle of a step, on which damping acts; `before` becomes `after`.
fn middle(before: &mut [f64], after: &[f64], step: f64) -> Vec<f64> {
    let rate = before.iter().zip(after).map(|(before, after)| (after - before) / step).collect();
    before.copy_from_slice(after);
    rate
}

const RAYLEIGH: Damping = Damping { mass: 2.0, stiffness: 1e-4 };

#[test]
fn newmark_balances_work_and_damping_in_its_invariant() {
    for (element, damping) in [("fvs", NONE), ("hct", NONE), ("fvs", RAYLEIGH), ("hct", RAYLEIGH)] {
        let step = 1e-4;
        let (_, model) = forced_plate(element, "newmark", step, false, damping);
        let parameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step };
        let mut scheme = Newmark::new(&model.system, parameters, model.start.clone()).unwrap();
        let start = scheme.invariant().unwrap();
        let (mut lost, mut worst, mut given) = (0.0, 0.0f64, 0.0f64);
        for _ in 0..5000 {
            scheme.advance().unwrap();
            lost += step * loss(&model, &scheme.velocity().unwrap());
            worst = worst.max((scheme.invariant().unwrap() + lost - start).abs());
            given = given.max(scheme.energies().unwrap().work.abs());
        }
        println!("{element}, {damping:?}: {worst:.1e} J of {given} J given, {lost} J lost");
        assert!(worst <= 1e-10 * given, "{element}, {damping:?}: {worst:e} J");
        assert!(given > 10.0 && (lost > 10.0) == (damping != NONE));
    }
}

#[test]
fn midpoint_balances_work_and_damping() {
    for (element, scheme, damping) in [
        ("fvs", "midpoint", NONE),
        ("hct", "midpoint", Damping { mass: 2.0, stiffness: 0.0 }),
        ("hct", "conserving", Damping { mass: 2.0, stiffness: 0.0 }),
        ("fvs", "conserving", NONE),
    ] {
        let step = 1e-4;
        let (scene, model) = forced_plate(element, scheme, step, false, damping);
        let mut scheme = model.scheme(&scene).unwrap();
        let start = scheme.energies().unwrap().total();
        let (mut lost, mut worst, mut given) = (0.0, 0.0f64, 0.0f64);
        let mut before = scheme.displacement().to_vec();
        for _ in 0..5000 {
            scheme.advance().unwrap();
            lost += step * loss(&model, &middle(&mut before, scheme.displacement(), step));
            let energies = scheme.energies().unwrap();
            worst = worst.max((energies.total() + lost - start).abs());
            given = given.max(energies.work.abs());
        }
        println!(
            "{element}, {damping:?}: {worst:.1e} J, {given} J, {lost} J, {:?}",
            scheme.statistics().relaxation
        );
        assert!(worst <= 1e-10 * given, "{element}, {damping:?}: {worst:e} J");
        if let Some(relaxation) = scheme.statistics().relaxation {
            // A free step is a step of the midpoint rule; only changes by rounding are corrected.
            assert!(relaxation.relaxed_steps == 0);
            assert!((relaxation.least_gamma - 1.0).abs() <= 1e-6, "{relaxation:?}");
            assert!((relaxation.largest_gamma - 1.0).abs() <= 1e-6, "{relaxation:?}");
        }
    }
}

#[test]
fn reflected_midpoint_balances_damping_by_stiffness() {
    let step = 1e-4;
    let (_, model) = forced_plate("fvs", "midpoint", step, false, RAYLEIGH);
    let mut scheme = Midpoint::new(&model.system, step, Massless::Reflected, model.start.clone()).unwrap();
    let start = scheme.energies().unwrap().total();
    let (mut lost, mut worst) = (0.0, 0.0f64);
    let mut before = scheme.displacement().to_vec();
    for _ in 0..5000 {
        scheme.advance().unwrap();
        lost += step * loss(&model, &middle(&mut before, scheme.displacement(), step));
        worst = worst.max((scheme.energies().unwrap().total() + lost - start).abs());
    }
    println!("{worst:.1e} J, {lost} J lost");
    assert!(worst <= 1e-10 * start.abs() && lost > 10.0, "{worst:e} J");
}

#[test]
fn conserving_balances_work_and_damping_through_impacts() {
    for (element, step, damping) in [
        ("fvs", 1e-4, NONE),
        ("hct", 1e-4, NONE),
        ("fvs", 5e-4, Damping { mass: 2.0, stiffness: 0.0 }),
        ("hct", 1e-4, Damping { mass: 4.0, stiffness: 0.0 }),
    ] {
        let (scene, model) = forced_plate(element, "conserving", step, true, damping);
        let bounds = &model.system.bounds;
        let mut scheme = model.scheme(&scene).unwrap();
        let start = scheme.energies().unwrap();
        let mut scale = largest(&[start.kinetic, start.elastic, start.work]);
        let (mut worst, mut contacts) = (0.0f64, 0);
        for _ in 0..5000 {
            scheme.advance().unwrap();
            let energies = scheme.energies().unwrap();
            scale = scale.max(energies.work.abs());
            let balance =
                energies.total() + scheme.statistics().relaxation.unwrap().dissipated - start.total();
            worst = worst.max(balance.abs() / scale);
            contacts += u32::from(scheme.reaction().iter().any(|r| *r != 0.0));
            assert!(bounds.violation(scheme.displacement()) <= 1e-12);
            assert!(scheme.step_report().kkt <= 1e-10);
        }
        let relaxation = scheme.statistics().relaxation.unwrap();
        println!("{element}, {step:e} s, {damping:?}: {worst:.1e}, {contacts} in contact, {relaxation:?}");
        assert!(worst <= 1e-11, "{element}, {step:e}, {damping:?}: {worst:e}");
        assert!(contacts > 10 && relaxation.relaxed_steps > 10, "{contacts}, {relaxation:?}");
        assert_eq!(relaxation.dissipated > 0.0, damping != NONE);
    }
}
