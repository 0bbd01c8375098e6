//! Supports whose motion has kinks, compared with the exact motion of each mode, for which each
//! jump of the velocity is an impulse.

use crate::common::Random;
use crate::common::models::{PAPER_PLATE, STRIP};
use crate::common::scenes::{Instant, grid, read, run, run_to_end, scene};
use faer::{Mat, Side};
use rebond::field::{Field, Names};
use rebond::linalg::{Engine, Form, Native};
use rebond::mesh::Point;
use rebond::simulation::Model;

const END: f64 = 0.5;

fn text(mass: &str, scheme: &str, step: f64, motion: &str, more: &str) -> String {
    format!(
        "{STRIP}{}support = [{{ edge = \"left\", kind = \"clamped\", motion = \"{motion}\" }}]\n\
         time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = {step:?}, end = {END:?}{more} }}\n\
         output.probes = [{{ name = \"tip\", at = [1, 0.05] }}]\n",
        grid("fvs", 3, 1)
    )
}

fn dense(engine: &Native, form: &Form) -> Mat<f64> {
    let n = engine.dofs();
    let mut unit = vec![0.0; n];
    let mut matrix = Mat::zeros(n, n);
    for dof in 0..n {
        unit[dof] = 1.0;
        engine.multiply(form, &unit, matrix.col_as_slice_mut(dof)).unwrap();
        unit[dof] = 0.0;
    }
    matrix
}

/// Mode of the strip in the frame of its support.
struct Mode {
    /// Frequency, in rad/s.
    omega: f64,
    /// Acceleration of the mode over that of the support.
    share: f64,
    /// Deflection of the tip in the mode.
    tip: f64,
    /// Initial velocity of the mode over that of a plate that moves uniformly at 1 m/s.
    start: f64,
}

/// Returns the modes that have inertia.
fn modes(mass: &str) -> Vec<Mode> {
    // The inertia of a rigid motion equals a pressure of the mass per area, 1 kg/m2.
    let text = text(mass, "newmark", 1e-3, "0*t", "") + "load.pressure = 1\ninitial.velocity = 1\n";
    let Model { system, start, probes, .. } = Model::new(&scene(&text)).unwrap();
    let engine = &system.engine;
    let (k, m) = (dense(engine, &system.stiffness), dense(engine, &system.mass));
    let stiff = k.self_adjoint_eigen(Side::Lower).unwrap();
    let n = engine.dofs();
    let root = Mat::from_fn(n, n, |i, j| stiff.U()[(i, j)] / stiff.S()[j].sqrt());
    let reduced = root.transpose() * &m * &root;
    let eigen = reduced.self_adjoint_eigen(Side::Lower).unwrap();
    let shapes = &root * eigen.U();
    let mut momentum = vec![0.0; n];
    engine.multiply(&system.mass, &start.velocity, &mut momentum).unwrap();
    let load = system.load.unwrap();
    let largest = eigen.S()[n - 1];
    let of = |k: usize| {
        let shape: Vec<f64> = (0..n).map(|i| shapes[(i, k)]).collect();
        let along = |x: &[f64]| x.iter().zip(&shape).map(|(x, y)| x * y).sum::<f64>();
        let inertia = eigen.S()[k];
        Mode {
            omega: inertia.powf(-0.5),
            share: along(&load) / inertia,
            tip: probes[0].deflection(&shape),
            start: along(&momentum) / inertia,
        }
    };
    (0..n).filter(|&k| eigen.S()[k] > 1e-10 * largest).map(of).collect()
}

/// Returns the deflection of the tip at some instants, for a strip at rest until its support moves.
/// It is exact for a support that moves uniformly between instants that are `PARTS` times as dense.
fn truth(modes: &[Mode], motion: &Field, step: f64) -> Vec<f64> {
    const PARTS: usize = 16;
    let place = |t: f64| motion.value(Point::origin(), t).unwrap();
    let h = step / PARTS as f64;
    let count = (END / step).round() as usize;
    let first = motion.jet(Point::origin(), 0.0).unwrap().first;
    let mut tips: Vec<f64> = (0..=count).map(|n| place(n as f64 * step)).collect();
    for Mode { omega, share, tip, start } in modes {
        let (cosine, sine) = ((omega * h).cos(), (omega * h).sin());
        let (mut q, mut v, mut rate) = (0.0, -start * first, first);
        for part in 0..count * PARTS {
            let next = (place((part + 1) as f64 * h) - place(part as f64 * h)) / h;
            v -= share * (next - rate);
            rate = next;
            (q, v) = (cosine * q + sine * v / omega, cosine * v - omega * sine * q);
            if (part + 1) % PARTS == 0 {
                tips[(part + 1) / PARTS] += tip * q;
            }
        }
    }
    tips
}

const SCHEMES: [(&str, &str, &str); 6] = [
    ("singular", "newmark", ""),
    ("consistent", "newmark", ""),
    ("singular", "midpoint", ""),
    ("singular", "midpoint", ", massless = \"reflected\""),
    ("consistent", "midpoint", ""),
    ("singular", "conserving", ""),
];

/// Returns the root mean square error of the tip, and the root mean square of its motion.
fn error(rows: &[Instant], expected: &[f64]) -> [f64; 2] {
    let mean = |of: &dyn Fn(usize) -> f64| {
        ((0..rows.len()).map(|n| of(n).powi(2)).sum::<f64>() / rows.len() as f64).sqrt()
    };
    assert_eq!(rows.len(), expected.len());
    [mean(&|n| rows[n].probes[0] - expected[n]), mean(&|n| expected[n])]
}

/// Returns a motion without jumps, composed of nested random pieces.
fn piece(random: &mut Random, depth: usize) -> String {
    let number = |random: &mut Random, size: f64| format!("{:.3}", size * random.signed());
    if depth == 0 {
        let [a, b, c] = [1.0, 25.0, 3.0].map(|size| number(random, size));
        return match random.below(4) {
            0 => format!("{a}*sin({b}*t + {c})"),
            1 => format!("({a} + {c}*t)"),
            2 => format!("{b}*t^2"),
            _ => format!("{c}*t*exp({a}*t)"),
        };
    }
    let f = piece(random, depth - 1);
    let other = random.below(depth);
    let g = piece(random, other);
    // Some instants are those of the repeatedly halved run, which a search by halving evaluates
    // itself.
    let at = match random.below(4) {
        0 => format!("{}", END * (1 + random.below(15)) as f64 / 16.0),
        _ => format!("{:.4}", 0.02 + 0.45 * random.unit()),
    };
    match random.below(11) {
        0 => format!("max({f}, {g})"),
        1 => format!("min({f}, {g}, 0.3)"),
        2 => format!("abs({f})"),
        3 => format!("clamp({f}, -0.2, {at})"),
        4 => format!("({g})*step(t - {at})*(t - {at})"),
        5 => format!("if(t < {at}, {f}, ({f}) + 3*(t - {at}))"),
        6 => format!("sign({f})*({f})^2"),
        7 => format!("2*abs(mod(t, {at}) - 0.5*{at}) + {f}"),
        8 => format!("(mod(t, 1) - t)*floor(t/{at}) + 0.5*{f}"),
        9 => format!("(floor(t/{at}) + mod(t/{at}, 1))*{at} - {g}"),
        _ => format!("({f}) - 0.3*({g})"),
    }
}

/// Returns the largest rate of a motion within the run, per s.
fn fastest(motion: &str) -> f64 {
    let field = Field::parse(motion, Names::T).unwrap();
    let rate = |k: u32| field.jet(Point::origin(), END * f64::from(k) / 1000.0).unwrap().first.abs();
    (0..=1000).map(rate).fold(0.0, f64::max)
}

fn kinks_have_their_impulse(tries: usize) {
    let mut random = Random::new(14);
    let of_mass = [("singular", modes("singular")), ("consistent", modes("consistent"))];
    let (mut refused, mut worst) = (0, 0.0f64);
    for tried in 0..tries {
        let depth = 1 + random.below(3);
        let piece = piece(&mut random, depth);
        // Velocities are far below the speed of sound, 3.5 m/s, at which the guard would end the
        // run.
        let size = (1.0 / fastest(&piece)).min(0.05);
        let mut motion = format!("{size:.3e}*({piece})");
        let jumps = random.below(8) == 0;
        if jumps {
            let at = match random.below(2) {
                0 => format!("{}", END * (1 + random.below(15)) as f64 / 16.0),
                _ => format!("{:.5}", 0.02 + 0.45 * random.unit()),
            };
            motion = format!("{motion} + 0.1*step(t - {at})");
        }
        let (mass, scheme, more) = SCHEMES[tried % SCHEMES.len()];
        let read = read(&text(mass, scheme, 1e-3, &motion, more));
        if jumps {
            let said = read.err().unwrap_or_else(|| panic!("{motion} is taken")).to_string();
            assert!(said.contains("support.0.motion: jumps by"), "{motion}: {said}");
            refused += 1;
            continue;
        }
        let field = Field::parse(&motion, Names::T).unwrap();
        let (_, modes) = of_mass.iter().find(|(name, _)| *name == mass).unwrap();
        let of_step = |step: f64| {
            let [error, size] =
                error(&run(&text(mass, scheme, step, &motion, more)), &truth(modes, &field, step));
            error / size.max(1e-3)
        };
        let [coarse, fine] = [2e-3, 5e-4].map(of_step);
        worst = worst.max(fine);
        // Many kinks excite many fast modes, which only shorter steps begin to resolve.
        let follows = || [1.25e-4, 3.125e-5].into_iter().any(|step| of_step(step) <= 2e-2);
        assert!(
            fine <= 0.2 && (fine <= 2e-2 || fine <= 0.4 * coarse || follows()),
            "{scheme}, {mass}: {motion}: {coarse:e}, {fine:e}"
        );
    }
    println!("{refused} of {tries} refused; worst {worst:e}");
}

#[test]
fn random_kinks_have_their_impulse() {
    kinks_have_their_impulse(24);
}

#[test]
#[ignore = "long"]
fn ten_thousand_random_kinks_have_their_impulse() {
    kinks_have_their_impulse(10_000);
}

/// Every scheme is of second order for a corner at an instant anywhere within a step.
#[test]
fn a_corner_is_of_second_order() {
    let motion = "0.1*max(0, t - 0.0503)";
    let field = Field::parse(motion, Names::T).unwrap();
    for (mass, scheme, more) in SCHEMES {
        let modes = modes(mass);
        let errors = [4e-3, 1e-3, 2.5e-4].map(|step| {
            let [error, size] =
                error(&run(&text(mass, scheme, step, motion, more)), &truth(&modes, &field, step));
            error / size
        });
        println!("{scheme}, {mass}: {errors:?}");
        assert!(errors[2] <= 2e-3 && errors[2] <= 0.15 * errors[0], "{scheme}, {mass}: {errors:?}");
    }
}

/// The paper's plate on a support that starts at 0.1 m/s: the kinetic energy is that of the corner
/// rounded over 10 us, 0.18 J.
#[test]
fn a_corner_moves_the_plate_as_one_that_is_rounded() {
    let plate = |motion: &str, scheme: &str| {
        format!(
            "{PAPER_PLATE}mesh = {{ element = \"fvs\", cells = [10, 4] }}\n\
             support = [{{ edge = \"left\", kind = \"clamped\", motion = \"{motion}\" }}]\n\
             time = {{ scheme = \"{scheme}\", mass = \"singular\", step = 1e-5, end = 0.02 }}\n\
             output = {{ every = 10, probes = [{{ name = \"tip\", at = [1.2, 0] }}] }}\n"
        )
    };
    let rounded = "0.1*if(t < 0.01, 0, if(t < 0.01001, (t - 0.01)^2/2e-5, t - 0.010005))";
    for scheme in ["newmark", "midpoint", "conserving"] {
        let (round, _) = run_to_end(&plate(rounded, scheme));
        for corner in [
            "0.1*max(0, t - 0.010005)",
            "if(t < 0.010005, 0, 0.1*t - 0.0010005)",
            "0.1*clamp(t - 0.010005, 0, 1)",
            "0.05*(abs(t - 0.010005) + t - 0.010005)",
            "0.1*step(t - 0.010005)*(t - 0.010005)",
        ] {
            let (sharp, outcome) = run_to_end(&plate(corner, scheme));
            assert!((outcome.energy.end).abs() < 1e-3, "{scheme}: {}", outcome.energy.end);
            for (one, other) in sharp.iter().zip(&round) {
                let off = (one.probes[0] - other.probes[0]).abs();
                assert!(off < 3e-8, "{scheme}, {corner}, t = {}: {off:e}", one.time);
            }
            // The tip stays in its place while the support moves away.
            assert!(sharp.last().unwrap().probes[0].abs() < 5e-4 && sharp[100].probes[0] == 0.0);
        }
    }
}
