//! Rayleigh damping: closed forms of one mode, decay of a plate's modes, and impacts with damping
//! by the exact scheme.

use crate::common::block;
use crate::common::models::{PAPER_PLATE, PAPER_START};
use crate::common::momentum::Upward;
use crate::common::scenes::{refusal, run, scene};
use rebond::linalg::{CellClass, Engine, Native, SingularMassCell};
use rebond::modes::{self, Mode};
use rebond::obstacle::Bounds;
use rebond::scene::Scene;
use rebond::scheme::{
    Conserving, Damping, Exact, Massless, Midpoint, ModalDamping, Newmark, NewmarkParameters, Potential,
    Scheme, Solution, Start, System, TimeDependence,
};
use rebond::simulation::Model;
use std::f64::consts::TAU;

const MASS: f64 = 2.0;
const K: f64 = 2e4;
const GRAVITY: f64 = 9.81;

fn by_mass(mass: f64) -> Damping {
    Damping { mass, stiffness: 0.0 }
}

/// Returns a ball on a spring of stiffness k, under gravity.
fn oscillator(k: f64, alpha: f64) -> System<Native> {
    let engine = Native::new(1);
    let average = SingularMassCell {
        dofs: [Some(0)].into(),
        row: [MASS].into(),
        mass: MASS,
        class: CellClass::Plate(0),
    };
    System {
        stiffness: engine.form(vec![block(&[Some(0)], &[k], 0)]),
        mass: engine.averages(vec![average]),
        damping: by_mass(alpha),
        load: Some(vec![-MASS * GRAVITY]),
        bounds: Bounds::default(),
        bound_numbers: None,
        drive: TimeDependence::default(),
        engine,
    }
}

/// Returns position and speed at a time, for y'' + alpha y' + w^2 y = -g.
fn motion(w: f64, alpha: f64, [place, speed]: [f64; 2], t: f64) -> [f64; 2] {
    let decay = 0.5 * alpha;
    if w == 0.0 && alpha * t < 0.1 {
        // The series keeps the digits that the closed form loses in differences.
        let series = |of: u32| -> f64 {
            let term = |k: u32| (-alpha * t).powi(k as i32) / (1..=k + of).map(f64::from).product::<f64>();
            (0..9).map(term).sum()
        };
        let [left, once, twice] = [0, 1, 2].map(series);
        return [place + speed * t * once - GRAVITY * t * t * twice, speed * left - GRAVITY * t * once];
    }
    if w == 0.0 {
        let (left, tends) = ((-alpha * t).exp(), -GRAVITY / alpha);
        return [place + tends * t + (speed - tends) * (1.0 - left) / alpha, tends + (speed - tends) * left];
    }
    let rest = -GRAVITY / (w * w);
    let y = place - rest;
    let slope = speed + decay * y;
    let square = w * w - decay * decay;
    let left = (-decay * t).exp();
    let [at, rate] = if square > 0.0 {
        let omega = square.sqrt();
        let (s, c) = (omega * t).sin_cos();
        [y * c + slope / omega * s, slope * c - y * omega * s]
    } else if square < 0.0 {
        let omega = (-square).sqrt();
        let (s, c) = ((omega * t).sinh(), (omega * t).cosh());
        [y * c + slope / omega * s, slope * c + y * omega * s]
    } else {
        [y + slope * t, slope]
    };
    [rest + left * at, left * (rate - decay * at)]
}

#[test]
fn the_exact_scheme_has_the_closed_forms_of_one_mode() {
    // The frequency is w = 100 / s: weak, moderate, strong, critical and overcritical damping, and
    // free fall in air.
    for (k, alpha) in [
        (K, 1e-6),
        (K, 3.0),
        (K, 190.0),
        (K, 200.0 - 1e-6),
        (K, 200.0),
        (K, 200.0 + 1e-6),
        (K, 230.0),
        (K, 1e4),
        (0.0, 1e-9),
        (0.0, 1e-3),
        (0.0, 0.5),
        (0.0, 40.0),
    ] {
        let system = oscillator(k, alpha);
        let w = (k / MASS).sqrt();
        for step in [1e-4, 1e-2] {
            let start = Start { displacement: vec![0.3], velocity: vec![2.0] };
            let mut scheme = Exact::new(&system, step, start).unwrap();
            let (mut energy, mut worst) = (scheme.energies().unwrap().total(), 0.0f64);
            for _ in 0..100 {
                scheme.advance().unwrap();
                let [place, _] = motion(w, alpha, [0.3, 2.0], scheme.time());
                worst = worst.max((scheme.displacement()[0] - place).abs() / 0.3);
                let now = scheme.energies().unwrap().total();
                assert!(now <= energy + 1e-12, "{now} after {energy}");
                energy = now;
            }
            println!("k = {k}, alpha = {alpha}, step {step}: {worst:.1e}");
            assert!(worst <= 1e-12, "k = {k}, alpha = {alpha}: {worst:e}");
        }
    }
}

/// Returns a ball on a massless tip with a spring between them, above a floor: dofs (tip, ball).
fn bouncer(alpha: f64) -> System<Native> {
    let engine = Native::new(2);
    let average = SingularMassCell {
        dofs: [Some(1)].into(),
        row: [MASS].into(),
        mass: MASS,
        class: CellClass::Plate(0),
    };
    System {
        stiffness: engine.form(vec![block(&[Some(0), Some(1)], &[K, -K, -K, K], 0)]),
        mass: engine.averages(vec![average]),
        damping: by_mass(alpha),
        load: Some(vec![0.0, -MASS * GRAVITY]),
        bounds: Bounds::uniform(vec![0], 0.0, f64::INFINITY),
        bound_numbers: None,
        drive: TimeDependence::default(),
        engine,
    }
}

/// Returns the last argument before a change of sign of a function, to the last digit.
fn zero(f: impl Fn(f64) -> f64, mut inside: f64, mut outside: f64) -> f64 {
    let sign = f(inside).signum();
    for _ in 0..200 {
        let middle = 0.5 * (inside + outside);
        if f(middle).signum() == sign { inside = middle } else { outside = middle }
    }
    outside
}

#[test]
fn a_damped_ball_bounces_by_its_closed_form() {
    for alpha in [0.1, 2.0, 10.0] {
        let system = bouncer(alpha);
        let start = Start { displacement: vec![1.0, 1.0], velocity: vec![0.0; 2] };
        let mut scheme = Exact::new(&system, 0.01, start).unwrap();
        let (mut state, mut time) = ([1.0, 0.0], 0.0);
        let mut bounces = 0;
        let mut events = Vec::new();
        while scheme.time() < 10.0 {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt <= 1e-11);
            events.extend(scheme.take_events());
        }
        let w = (K / MASS).sqrt();
        for pair in events.chunks_exact(2) {
            // The ball falls from above 0 to 0, and rises from below 0 to 0, past the turning
            // point.
            let fall = |t: f64| motion(0.0, alpha, state, t)[0];
            let mut later = 1e-3;
            while fall(later) > 0.0 {
                later += 1e-3;
            }
            let landing = zero(fall, (later - 1e-3).max(1e-9), later);
            state = [0.0, motion(0.0, alpha, state, landing)[1]];
            time += landing;
            let closes = pair[0];
            assert!(closes.closes && (closes.time - time).abs() <= 1e-11, "{} {time}", closes.time);
            assert!((closes.velocity - state[1]).abs() <= 1e-10, "{} {}", closes.velocity, state[1]);
            let press = |t: f64| motion(w, alpha, state, t)[0];
            let mut later = 1e-4;
            while press(later) < 0.0 {
                later += 1e-4;
            }
            let contact = zero(press, (later - 1e-4).max(1e-9), later);
            state = [0.0, motion(w, alpha, state, contact)[1]];
            time += contact;
            let opens = pair[1];
            assert!(!opens.closes && (opens.time - time).abs() <= 1e-11, "{} {time}", opens.time);
            bounces += 1;
        }
        println!("alpha = {alpha}: {bounces} bounces");
        assert!(bounces >= 1, "{events:?}");
    }
}

/// Returns the paper's plate at rest under 14600 Pa, damped.
fn damped_plate(damping: Damping, obstacle: bool) -> Model {
    let obstacle = if obstacle { "obstacle = [{ side = \"below\", height = -0.1 }]" } else { "" };
    let text = format!(
        r#"
        {PAPER_START}
        mesh = {{ element = "fvs", cells = [10, 4] }}
        {obstacle}
        time = {{ scheme = "newmark", mass = "singular", step = 1e-3, end = 0.1 }}
        output = {{ probes = [{{ name = "corner", at = [1.2, 0] }}] }}
        "#
    );
    let scene = Scene::from_str(&text, "damped", &[]).expect("a valid scene");
    let mut model = Model::new(&scene).unwrap();
    model.system.damping = damping;
    model
}

type Make = for<'s> fn(&'s Model, f64) -> Box<dyn Scheme + 's>;

fn newmark(model: &Model, step: f64) -> Box<dyn Scheme + '_> {
    let parameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step };
    Box::new(Newmark::new(&model.system, parameters, model.start.clone()).unwrap())
}

fn reflected(model: &Model, step: f64) -> Box<dyn Scheme + '_> {
    Box::new(Midpoint::new(&model.system, step, Massless::Reflected, model.start.clone()).unwrap())
}

fn midpoint(model: &Model, step: f64) -> Box<dyn Scheme + '_> {
    Box::new(Midpoint::new(&model.system, step, Massless::Equilibrium, model.start.clone()).unwrap())
}

fn conserving(model: &Model, step: f64) -> Box<dyn Scheme + '_> {
    Box::new(Conserving::new(&model.system, step, model.start.clone()).unwrap())
}

#[test]
fn all_schemes_tend_to_the_exact_one_with_damping_by_mass() {
    let model = damped_plate(by_mass(10.0), true);
    let corner = |scheme: &dyn Scheme| model.probes[0].deflection(scheme.displacement());
    let (look, end) = (1e-3, 0.07);
    let mut truth = Exact::new(&model.system, look, model.start.clone()).unwrap();
    let mut energy = truth.energies().unwrap().total();
    let start = energy;
    let mut expected = Vec::new();
    for _ in 0..(end / look).round() as usize {
        truth.advance().unwrap();
        assert!(truth.step_report().kkt <= 1e-11);
        let now = truth.energies().unwrap().total();
        assert!(now < energy);
        energy = now;
        expected.push(corner(&truth));
    }
    assert!(truth.statistics().events.unwrap().events > 10);
    let schemes: [(&str, Make); 4] = [
        ("newmark", newmark),
        ("midpoint, reflected", reflected),
        ("midpoint", midpoint),
        ("conserving", conserving),
    ];
    for (name, make) in schemes {
        let errors = [2e-5, 2.5e-6].map(|step: f64| {
            let mut scheme = make(&model, step);
            let mut sum = 0.0;
            for expected in &expected {
                for _ in 0..(look / step).round() as usize {
                    scheme.advance().unwrap();
                }
                sum += (corner(scheme.as_ref()) - expected).powi(2);
            }
            if let Some(relaxation) = scheme.statistics().relaxation {
                assert!((relaxation.dissipated / (start - energy) - 1.0).abs() <= 100.0 * step);
            }
            (sum / expected.len() as f64).sqrt()
        });
        println!("{name}: rms {errors:?} m");
        assert!(errors[1] <= errors[0] / 4.0 && errors[1] <= 1e-5, "{name}: {errors:?}");
    }
}

/// Returns the lowest modes, of unit modal mass, with their frequencies in rad/s, by inverse
/// iteration one after the other.
fn lowest_modes<const N: usize>(model: &Model) -> [(f64, Vec<f64>); N] {
    let System { engine, stiffness, mass, .. } = &model.system;
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let mut factor = engine.factor(&stiffness.into(), &[]).unwrap();
    let mut duals: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
    std::array::from_fn(|number| {
        let mut x: Vec<f64> = (0..engine.dofs()).map(|i| ((i * (number + 3)) as f64).sin()).collect();
        let (mut dual, mut value) = (vec![0.0; x.len()], 0.0);
        for _ in 0..600 {
            for (mode, dual) in &duals {
                let share = dot(&x, dual);
                x.iter_mut().zip(mode).for_each(|(x, m)| *x -= share * m);
            }
            let norm = engine.multiply(mass, &x, &mut dual).unwrap().sqrt();
            x.iter_mut().for_each(|x| *x /= norm);
            value = engine.multiply(stiffness, &x, &mut dual).unwrap();
            engine.multiply(mass, &x, &mut dual).unwrap();
            let mut next = dual.clone();
            factor.solve(&mut next).unwrap();
            std::mem::swap(&mut x, &mut next);
        }
        let norm = engine.multiply(mass, &x, &mut dual).unwrap().sqrt();
        x.iter_mut().chain(&mut dual).for_each(|x| *x /= norm);
        duals.push((x.clone(), dual));
        (value.sqrt(), x)
    })
}

#[test]
fn modes_of_a_plate_decay_by_their_ratios() {
    let damping = Damping { mass: 3.0, stiffness: 2e-4 };
    let mut model = damped_plate(damping, false);
    let shapes: [_; 3] = lowest_modes(&model);
    for (number, (w, shape)) in shapes.into_iter().enumerate() {
        let ratio = 0.5 * (damping.mass / w + damping.stiffness * w);
        let (decay, omega) = (ratio * w, w * (1.0 - ratio * ratio).sqrt());
        let size = 0.01;
        model.start.displacement = shape.iter().map(|x| size * x).collect();
        model.start.velocity = vec![0.0; shape.len()];
        let System { engine, mass, .. } = &model.system;
        let mut dual = vec![0.0; shape.len()];
        engine.multiply(mass, &shape, &mut dual).unwrap();
        for (name, make) in [("newmark", newmark as Make), ("midpoint", reflected as Make)] {
            let period = TAU / w;
            let errors = [100, 200, 400].map(|steps| {
                let mut scheme = make(&model, period / f64::from(steps));
                let mut worst = 0.0f64;
                for _ in 0..3 * steps {
                    scheme.advance().unwrap();
                    let t = scheme.time();
                    let q: f64 = scheme.displacement().iter().zip(&dual).map(|(u, d)| u * d).sum();
                    let (s, c) = (omega * t).sin_cos();
                    let expected = size * (-decay * t).exp() * (c + decay / omega * s);
                    worst = worst.max((q - expected).abs() / size);
                }
                worst
            });
            println!("mode {}, {w:.2} rad/s, ratio {ratio:.4}, {name}: {errors:?}", number + 1);
            for pair in errors.windows(2) {
                let order = (pair[0] / pair[1]).log2();
                assert!((1.95..2.05).contains(&order), "{name}: {errors:?}");
            }
            assert!(errors[2] <= 1e-3);
        }
    }
}

#[test]
fn single_modes_are_damped_by_ratios_of_their_own() {
    let ratios = [0.05, 0.02];
    let mut model = damped_plate(Damping::default(), false);
    let System { engine, stiffness, mass, .. } = &model.system;
    let shapes = modes::shapes(engine, [stiffness, mass], 3, false).unwrap();
    for (Mode { frequency, shape }, (w, other)) in shapes.iter().zip(lowest_modes::<3>(&model)) {
        let w_here = TAU * frequency;
        assert!((w_here / w - 1.0).abs() <= 1e-10, "{w_here} {w}");
        let sign = shape[0].signum() * other[0].signum();
        let apart = shape.iter().zip(&other).map(|(a, b)| (a - sign * b).abs()).fold(0.0, f64::max);
        assert!(apart <= 1e-6 * crate::common::largest(&other), "{apart:e}");
    }
    let duals: Vec<Vec<f64>> = shapes
        .iter()
        .map(|mode| {
            let mut dual = vec![0.0; mode.shape.len()];
            engine.multiply(mass, &mode.shape, &mut dual).unwrap();
            dual
        })
        .collect();
    model.system.drive.modal = Some(ModalDamping::new(engine, mass, &shapes[..2], &ratios).unwrap());
    let size = 0.01;
    let along = |k: usize| shapes.iter().map(|mode| mode.shape[k]).sum::<f64>();
    model.start.displacement = (0..duals[0].len()).map(|k| size * along(k)).collect();
    for (name, make) in
        [("newmark", newmark as Make), ("reflected", reflected as Make), ("midpoint", midpoint as Make)]
    {
        let errors = [4e-4, 2e-4, 1e-4].map(|step: f64| {
            let mut scheme = make(&model, step);
            let mut worst = [0.0f64; 3];
            for _ in 0..(0.1 / step).round() as usize {
                scheme.advance().unwrap();
                assert!(scheme.step_report().kkt <= 1e-10);
                let t = scheme.time();
                for (k, dual) in duals.iter().enumerate() {
                    let ratio = ratios.get(k).copied().unwrap_or(0.0);
                    let w = TAU * shapes[k].frequency;
                    let (decay, omega) = (ratio * w, w * (1.0 - ratio * ratio).sqrt());
                    let q: f64 = scheme.displacement().iter().zip(dual).map(|(u, d)| u * d).sum();
                    let (s, c) = (omega * t).sin_cos();
                    let expected = size * (-decay * t).exp() * (c + decay / omega * s);
                    worst[k] = worst[k].max((q - expected).abs() / size);
                }
            }
            worst
        });
        println!("{name}: {errors:?}");
        for k in 0..3 {
            for pair in errors.windows(2) {
                let order = (pair[0][k] / pair[1][k]).log2();
                assert!((1.9..2.1).contains(&order), "{name}, mode {}: {errors:?}", k + 1);
            }
        }
    }
    // Steps that are too long for the extrapolation are refused, and schemes without modal damping.
    let start = || model.start.clone();
    let parameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step: 0.05 };
    for refused in [
        Newmark::new(&model.system, parameters, start()).map(drop),
        Midpoint::new(&model.system, 0.05, Massless::Reflected, start()).map(drop),
        Conserving::new(&model.system, 1e-3, start()).map(drop),
        Exact::new(&model.system, 1e-3, start()).map(drop),
    ] {
        let error = refused.unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("damping.modal"), "{error}");
    }
}

#[test]
fn what_a_scheme_cannot_do_is_refused_with_what_can() {
    let mut model = damped_plate(Damping { mass: 0.0, stiffness: 1e-5 }, true);
    let refusal = |error: rebond::Error, words: &[&str]| {
        assert_eq!(error.exit_code(), 2);
        for word in words {
            assert!(error.to_string().contains(word), "{error}");
        }
    };
    let (system, start) = (&model.system, || model.start.clone());
    let by_stiffness = ["damping.stiffness", "newmark"];
    refusal(Exact::new(system, 1e-3, start()).map(drop).unwrap_err(), &by_stiffness);
    refusal(Conserving::new(system, 1e-3, start()).map(drop).unwrap_err(), &by_stiffness);
    refusal(Potential::new(system).map(drop).unwrap_err(), &by_stiffness);
    let settled = Midpoint::new(system, 1e-3, Massless::Equilibrium, start());
    refusal(settled.map(drop).unwrap_err(), &["damping.stiffness", "reflected", "newmark"]);
    model.system.damping = Damping::default();
    model.system.drive.load = Some(Box::new(|_, _| Ok(())));
    let refused = Exact::new(&model.system, 1e-3, model.start.clone());
    refusal(refused.map(drop).unwrap_err(), &["do not change with time", "conserving", "newmark"]);
}

/// A stiff plate on equal springs and dashpots at its corners moves as one damped mass:
/// x = x0 e^{-d t} (cos w t + d / w sin w t).
#[test]
fn a_plate_on_dashpots_is_a_damped_mass() {
    const MASS: f64 = 6.24;
    let (stiffness, damping): (f64, f64) = (2.5e4, 60.0);
    let corners = |key: &str, value: f64| {
        let ends = [[0.0, 0.0], [0.2, 0.0], [0.0, 0.2], [0.2, 0.2]];
        let entries = ends.map(|[x, y]| format!("{{ at = [{x}, {y}], {key} = {value} }}"));
        format!("[{}]", entries.join(", "))
    };
    let (springs, dashpots) = (corners("stiffness", stiffness), corners("damping", damping));
    let d = 2.0 * damping / MASS;
    let w = (4.0 * stiffness / MASS - d * d).sqrt();
    for (element, time, step) in [
        ("fvs", "scheme = \"newmark\", mass = \"consistent\", beta = 0.25", 1e-4),
        ("hct", "scheme = \"newmark\", mass = \"singular\", beta = 0.25", 1e-4),
        ("fvs", "scheme = \"midpoint\", mass = \"singular\"", 1e-4),
        ("hct", "scheme = \"midpoint\", mass = \"consistent\"", 1e-4),
    ] {
        let error = |step: f64| {
            let text = format!(
                "plate = {{ length = 0.2, width = 0.2, thickness = 0.02, youngs_modulus = 210e12, \
                 poissons_ratio = 0.3, density = 7800 }}\nmesh = {{ element = \"{element}\", cells = [2, 2] }}\n\
                 spring = {springs}\ndashpot = {dashpots}\ninitial = {{ deflection = 1e-3 }}\n\
                 time = {{ {time}, step = {step:e}, end = 0.1 }}\n\
                 output = {{ every = 1, probes = [{{ name = \"w\", at = [0.1, 0.1] }}] }}\n"
            );
            let moved = |t: f64| 1e-3 * (-d * t).exp() * ((w * t).cos() + d / w * (w * t).sin());
            let rows = run(&text);
            rows.iter().map(|row| (row.probes[0] - moved(row.time)).abs()).fold(0.0, f64::max) / 1e-3
        };
        let errors = [step, 0.5 * step].map(error);
        let order = (errors[0] / errors[1]).log2();
        println!("{element}, {time}: {errors:?}, order {order}");
        assert!(errors[1] <= 2e-3 && (order - 2.0).abs() <= 0.2, "{element}, {time}: {errors:?}");
    }
}

/// Schemes and masses that follow modes, or parts of the plate in equilibrium, refuse dashpots.
#[test]
fn dashpots_are_refused_by_name() {
    for (time, words) in [
        (
            "scheme = \"conserving\", mass = \"modal\", modes = 20",
            "time.mass: \"modal\" takes no [[dashpot]]",
        ),
        ("scheme = \"conserving\", mass = \"singular\"", "time.scheme: \"conserving\" takes no [[dashpot]]"),
        ("scheme = \"exact\", mass = \"singular\"", "time.scheme: \"exact\" takes no [[dashpot]]"),
        (
            "scheme = \"midpoint\", mass = \"singular\", massless = \"equilibrium\"",
            "time.massless: \"equilibrium\" contradicts a dashpot",
        ),
    ] {
        let mesh =
            "mesh = { element = \"fvs\", cells = [10, 4] }\ndashpot = [{ at = [1.2, 0], damping = 5 }]\n";
        let error = refusal(&format!("{PAPER_START}{mesh}time = {{ {time}, step = 1e-4, end = 0.1 }}\n"));
        assert!(error.to_string().contains(words), "{error}");
    }
}

/// The impulses of the supports are the change of momentum and the way of the dashpots times their
/// damping, also where a dashpot pulls at a cell of the held edge.
#[test]
fn supports_bear_what_dashpots_pull() {
    const GRAVITY: f64 = 9.81;
    for (element, time) in [
        ("fvs", "scheme = \"midpoint\", mass = \"singular\""),
        ("hct", "scheme = \"midpoint\", mass = \"consistent\""),
    ] {
        let text = format!(
            "{PAPER_PLATE}mesh = {{ element = \"{element}\", cells = [6, 4] }}\n\
             support = [{{ name = \"root\", edge = \"left\", kind = \"clamped\" }}]\nload.gravity = {GRAVITY}\n\
             dashpot = [{{ at = [0.13, 0.17], damping = 900 }}, {{ at = [1.1, 0.3], damping = 30 }}]\n\
             time = {{ {time}, step = 1e-4, end = 0.1 }}\n\
             output.probes = [{{ name = \"near\", at = [0.13, 0.17] }}, {{ name = \"far\", at = [1.1, 0.3] }}]\n"
        );
        let scene = scene(&text);
        let model = Model::new(&scene).unwrap();
        let load = model.system.load.clone().unwrap();
        let mass = 7770.0 * 1.2 * 0.4 * 0.01;
        let upward = Upward::new(&model, &load, GRAVITY, mass);
        let mut scheme = model.scheme(&scene).unwrap();
        scheme.keep_balance().unwrap();
        let (mut before, mut worst, mut largest) = (0.0, 0.0_f64, 0.0_f64);
        let mut places = [0.0; 2];
        while scheme.time() < 0.1 - 1e-9 {
            scheme.advance().unwrap();
            let momentum = upward.momentum(&scheme.velocity().unwrap(), &[]).unwrap();
            let mut force = (momentum - before) / 1e-4 + mass * GRAVITY;
            for ((probe, damping), place) in model.probes.iter().zip([900.0, 30.0]).zip(&mut places) {
                let now = probe.deflection(scheme.displacement());
                force += damping * (now - *place) / 1e-4;
                *place = now;
            }
            before = momentum;
            let [borne, ..] = model.support_forces(&mut *scheme).unwrap()[0];
            worst = worst.max((borne - force).abs());
            largest = largest.max(borne.abs());
        }
        println!("{element}: {worst:e} of {largest:e}");
        assert!(worst <= 1e-9 * largest, "{element}: {worst:e} of {largest:e}");
    }
}
