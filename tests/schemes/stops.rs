//! Compliant stops, compared with code_aster's tests of stops (SDND101, SDND121, SDND122), closed
//! forms, balances of energy and momentum, and the rigid obstacle as their limit.

use crate::common::block;
use crate::common::models::{PAPER_START, UNIT};
use crate::common::scenes::{close, grid, run, run_to_end};
use rebond::linalg::{CellClass, Native, SingularMassCell};
use rebond::obstacle::Bounds;
use rebond::scheme::{
    Conserving, Damping, Exact, LoadTerm, Massless, Midpoint, Newmark, NewmarkParameters, Scheme, Solution,
    Start, System, TimeDependence, ViscousTip,
};
use std::f64::consts::PI;

/// Mass m (kg) on a spring k (N/m), with a stop of stiffness K (N/m) and damping c (N s/m): dof 0
/// is the mass, dof 1 the massless tip of the stop, kept between two bounds (m).
struct OneMass {
    mass: f64,
    spring: f64,
    stop: f64,
    damping: f64,
    bounds: [f64; 2],
}

impl OneMass {
    fn system(&self, is_singular: bool) -> System<Native> {
        let engine = Native::new(2);
        let between = |k: f64, class| block(&[Some(0), Some(1)], &[k, -k, -k, k], class);
        let stiffness = engine.form(vec![block(&[Some(0)], &[self.spring], 0), between(self.stop, 1)]);
        let row = SingularMassCell {
            dofs: [Some(0)].into(),
            row: [self.mass].into(),
            mass: self.mass,
            class: CellClass::Plate(0),
        };
        let mass = match is_singular {
            true => engine.averages(vec![row]),
            false => engine.form(vec![block(&[Some(0)], &[self.mass], 0)]),
        };
        let dashpots = (self.damping > 0.0).then(|| engine.form(vec![between(self.damping, 0)]));
        let damping = self.damping;
        let tip = ViscousTip { bound: 0, dofs: [0, 1], obstacle: 0, stiffness: self.stop, damping };
        let viscous_tips = dashpots.is_some().then(|| vec![tip]);
        System {
            engine,
            stiffness,
            mass,
            damping: Damping::default(),
            load: None,
            bounds: Bounds::uniform(vec![1], self.bounds[0], self.bounds[1]),
            bound_numbers: None,
            drive: TimeDependence { dashpots, viscous_tips, ..TimeDependence::default() },
        }
    }
}

/// Returns the start of mass and tip at u (m) with the velocity v (m/s).
fn from(u: f64, v: f64) -> Start {
    Start { displacement: vec![u; 2], velocity: vec![v; 2] }
}

const HALF: NewmarkParameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step: 1e-6 };

/// SDND101: m = 100 kg, k = 1e4 N/m, K = 1e6 N/m, 1 m/s at the stop: contact lasts 0.0312600 s,
/// 9.95037e-3 m deep, with at most 9950.37 N and 198.020 N s.
#[test]
fn a_mass_hits_a_stop() {
    let bounds = [0.0, f64::INFINITY];
    let of = OneMass { mass: 100.0, spring: 1e4, stop: 1e6, damping: 0.0, bounds };
    let (singular, consistent) = (of.system(true), of.system(false));
    let dt = 1e-6;
    // Without inertia at the tip, the law of restitution has nothing to act on.
    let elastic = NewmarkParameters { restitution: 1.0, ..HALF };
    let schemes: [Box<dyn Scheme>; 6] = [
        Box::new(Newmark::new(&consistent, elastic, from(0.0, -1.0)).unwrap()),
        Box::new(Newmark::new(&consistent, HALF, from(0.0, -1.0)).unwrap()),
        Box::new(Newmark::new(&singular, HALF, from(0.0, -1.0)).unwrap()),
        Box::new(Midpoint::new(&singular, dt, Massless::Equilibrium, from(0.0, -1.0)).unwrap()),
        Box::new(Conserving::new(&singular, dt, from(0.0, -1.0)).unwrap()),
        Box::new(Exact::new(&singular, dt, from(0.0, -1.0)).unwrap()),
    ];
    for mut scheme in schemes {
        let (mut deepest, mut largest, mut impulse, mut end) = (0.0_f64, 0.0_f64, 0.0, 0.0);
        while scheme.time() < 0.035 {
            scheme.advance().unwrap();
            deepest = deepest.max(-scheme.displacement()[0]);
            largest = largest.max(scheme.reaction()[0]);
            impulse += scheme.impulses()[0];
            if scheme.reaction()[0] > 0.0 {
                end = scheme.time();
            }
        }
        assert!((end - 0.0312600).abs() <= 2e-6, "{end}");
        close("depth", deepest, 9.95037e-3, 1e-6);
        close("force", largest, 9950.37, 1e-6);
        close("impulse", impulse, 198.020, 1e-5);
    }
}

/// Driven mass beside a compliant stop, whose flights and contacts have closed forms.
struct Rattle {
    mass: f64,
    spring: f64,
    stop: f64,
    gap: f64,
    /// Amplitude (N) and angular frequency (1/s) of the force on the mass.
    force: [f64; 2],
}

impl Rattle {
    /// Returns the first instants (s) at which the mass, at rest at the start, touches the stop.
    ///
    /// In flight and in contact the motion is a forced harmonic oscillation, as in code_aster's
    /// V5.01.121. Its crossings of the gap are sought in steps of 1 us, and bisected.
    fn touches(&self, count: usize) -> Vec<f64> {
        let &Rattle { mass, spring, stop, gap, force: [amplitude, frequency] } = self;
        let [mut start, mut x, mut v] = [0.0; 3];
        let (mut closed, mut touches) = (false, Vec::new());
        while touches.len() < count {
            let (k, pull) = if closed { (spring + stop, stop * gap) } else { (spring, 0.0) };
            let (own, rest) = ((k / mass).sqrt(), pull / k);
            let forced = amplitude / (k - mass * frequency * frequency);
            let c = x - rest - forced * (frequency * start).sin();
            let s = (v - forced * frequency * (frequency * start).cos()) / own;
            let place = |t: f64| {
                let (sin, cos) = (own * (t - start)).sin_cos();
                rest + forced * (frequency * t).sin() + c * cos + s * sin
            };
            let speed = |t: f64| {
                let (sin, cos) = (own * (t - start)).sin_cos();
                forced * frequency * (frequency * t).cos() + own * (s * cos - c * sin)
            };
            let stays = |t: f64| (place(t) > gap) == closed;
            let mut before = start + 5e-7;
            while stays(before + 1e-6) {
                before += 1e-6;
            }
            let mut after = before + 1e-6;
            for _ in 0..60 {
                let middle = 0.5 * (before + after);
                *(if stays(middle) { &mut before } else { &mut after }) = middle;
            }
            (x, v, start) = (gap, speed(after), after);
            if !closed {
                touches.push(after);
            }
            closed = !closed;
        }
        touches
    }
}

/// SDND121: m = 156 kg, k = 2e6 N/m, a stop of 1e10 N/m 1 mm away, and 3 kN sin(2 pi 5 t) on the
/// mass at rest: the instants of its first ten contacts, of which code_aster's test has four.
#[test]
fn a_driven_mass_rattles_at_a_stop() {
    let rattle = Rattle { mass: 156.0, spring: 2e6, stop: 1e10, gap: 1e-3, force: [3e3, 2.0 * PI * 5.0] };
    let expected = rattle.touches(10);
    for (contact, published) in [0.02486788, 0.04632852, 0.06625224, 0.20819141].into_iter().enumerate() {
        assert!((expected[contact] - published).abs() <= 5e-9, "{contact}: {expected:?}");
    }
    let Rattle { mass, spring, stop, gap, force: [amplitude, frequency] } = rattle;
    let of = OneMass { mass, spring, stop, damping: 0.0, bounds: [f64::NEG_INFINITY, gap] };
    let mut system = of.system(false);
    let factor = Box::new(move |t: f64| Ok(amplitude * (frequency * t).sin()));
    system.drive.terms = vec![LoadTerm { factor, law: None, load: vec![1.0, 0.0] }];
    let step = 1e-7;
    let mut scheme = Newmark::new(&system, NewmarkParameters { step, ..HALF }, from(0.0, 0.0)).unwrap();
    let (mut touches, mut before, mut was_open) = (Vec::new(), 0.0, true);
    while touches.len() < expected.len() {
        scheme.advance().unwrap();
        let (u, closed) = (scheme.displacement()[0], scheme.displacement()[0] > gap);
        if closed && was_open {
            touches.push(scheme.time() - step * (u - gap) / (u - before));
        }
        (before, was_open) = (u, !closed);
    }
    for (touch, expected) in touches.iter().zip(&expected) {
        assert!((touch - expected).abs() <= 1e-7, "{touch} for {expected}");
    }
}

/// SDND122: m = 1 kg, k = 10 N/m, a stop of 50 N/m 10 mm away: the frequency of the free motion
/// with 1e-3 J is 0.556889 Hz, with 1e-2 J 0.658956 Hz.
#[test]
fn the_frequency_of_a_mass_beside_a_stop_depends_on_its_energy() {
    let of = OneMass { mass: 1.0, spring: 10.0, stop: 50.0, damping: 0.0, bounds: [f64::NEG_INFINITY, 0.01] };
    let system = of.system(true);
    for (energy, expected) in [(1e-3, "0.556889"), (1e-2, "0.658956")] {
        let v = (2.0_f64 * energy).sqrt();
        let mut scheme = Exact::new(&system, 0.1, from(0.0, v)).unwrap();
        let mut closings = Vec::new();
        while closings.len() < 3 {
            scheme.advance().unwrap();
            closings.extend(scheme.take_events().into_iter().filter(|of| of.closes).map(|of| of.time));
        }
        assert_eq!(format!("{:.6}", 2.0 / (closings[2] - closings[0])), expected);
    }
}

/// A damped stop is a spring and a dashpot (Kelvin and Voigt): a mass that comes with v leaves when
/// the force vanishes, and not later, when the spring would be relaxed: it never pulls. With
/// x = v e^{-d t} sin(w t) / w the force k x + c x' vanishes where tan(w t) = -2 d w / (w^2 - d^2).
#[test]
fn a_damped_stop_does_not_pull() {
    let (mass, stop, speed) = (2.0_f64, 1e4_f64, 0.5);
    let damping = 2.0 * 0.2 * (stop * mass).sqrt();
    let of = OneMass { mass, spring: 0.0, stop, damping, bounds: [0.0, f64::INFINITY] };
    let (w0, d) = ((stop / mass).sqrt(), 0.2 * (stop / mass).sqrt());
    let w = (w0 * w0 - d * d).sqrt();
    let end = (2.0 * d * w).atan2(d * d - w * w) / w;
    let leaves = -speed * (-d * end).exp() * ((w * end).cos() - d / w * (w * end).sin());
    assert!(leaves > 0.5 * speed && leaves < speed);
    let (singular, consistent) = (of.system(true), of.system(false));
    let step = 1e-5;
    let schemes: [Box<dyn Scheme>; 3] = [
        Box::new(Newmark::new(&consistent, NewmarkParameters { step, ..HALF }, from(0.0, -speed)).unwrap()),
        Box::new(Newmark::new(&singular, NewmarkParameters { step, ..HALF }, from(0.0, -speed)).unwrap()),
        Box::new(Midpoint::new(&singular, step, Massless::Reflected, from(0.0, -speed)).unwrap()),
    ];
    for mut scheme in schemes {
        let (mut ended, mut impulse) = (0.0, 0.0);
        while scheme.time() < 3.0 * end {
            scheme.advance().unwrap();
            assert!(scheme.reaction()[0] >= 0.0);
            impulse += scheme.impulses()[0];
            if scheme.reaction()[0] > 0.0 {
                ended = scheme.time();
            }
        }
        assert!((ended - end).abs() <= 3.0 * step, "{ended} for {end}");
        close("velocity", scheme.velocity().unwrap()[0], leaves, 1e-3);
        close("impulse", impulse, mass * (speed + leaves), 1e-3);
        // The dashpot has taken what the mass has lost.
        let lost = 0.5 * mass * (speed * speed - leaves * leaves);
        close("taken", scheme.dissipated_by_obstacles()[0], lost, 1e-3);
    }
    // The tip of a damped stop is in no equilibrium.
    let refused = Midpoint::new(&singular, step, Massless::Equilibrium, from(0.0, 0.0)).err().unwrap();
    assert!(refused.to_string().starts_with("obstacle.damping: "), "{refused}");
    assert!(Conserving::new(&singular, step, from(0.0, 0.0)).is_err());
}

/// A free plate that starts as a whole below its stops compresses them evenly: the force is
/// stiffness times length or area, for every kind of region, element and side.
#[test]
fn stiffness_is_per_point_length_and_area() {
    let stops = [
        ("at = [1, 1]", 1.0),
        ("line = [[0.1, 0.5], [0.8, 0.5]]", 0.7),
        ("line = [[0.15, 0.2], [0.65, 0.9]]", 0.74_f64.sqrt()),
        ("where = \"x > 0.5\"", 0.5),
        ("where = \"x + y < 3\"", 1.0),
    ];
    for element in ["fvs", "hct"] {
        for (region, measure) in stops {
            let side = "side = \"below\", height = 0.25, stiffness = 8";
            let text = format!(
                "{UNIT}{}obstacle = [{{ {side}, {region} }}]\ninitial = {{ deflection = 0.125 }}\n\
                 time = {{ scheme = \"newmark\", mass = \"consistent\", step = 1e-9, end = 1e-9 }}\n",
                grid(element, 6, 4)
            );
            let start = &run(&text)[0];
            close(region, start.contact_force, 8.0 * measure * 0.125, 1e-9);
            close(region, start.energy, 4.0 * measure * 0.125 * 0.125, 1e-9);
        }
    }
}

const RUBBER: &str = "obstacle = [{ side = \"below\", height = -0.1, stiffness = 2e6, line = [[1.2, 0], [1.2, 0.4]] }, { side = \"above\", height = 0.15, stiffness = 1e8, at = [0.6, 0.2] }]\n";

fn on_rubber(cells: [usize; 2], time: &str) -> String {
    let mesh = grid("fvs", cells[0], cells[1]);
    let probes = "output = { every = 1, probes = [{ name = \"corner\", at = [1.2, 0] }] }\n";
    format!("{PAPER_START}{mesh}{RUBBER}time = {{ {time} }}\n{probes}")
}

/// Returns the largest relative change of energy of a run.
fn drift(cells: [usize; 2], end: f64, mass: &str) -> f64 {
    let time = format!("scheme = \"conserving\", mass = \"{mass}\", step = 1e-4, end = {end:?}");
    let (rows, outcome) = run_to_end(&on_rubber(cells, &time));
    assert!(outcome.contact_steps > 0);
    rows.iter().fold(0.0, |worst: f64, row| worst.max((row.energy / rows[0].energy - 1.0).abs()))
}

#[test]
fn the_conserving_scheme_keeps_the_energy_of_plate_and_stops() {
    for mass in ["singular", "modal"] {
        let drift = drift([10, 4], 0.3, mass);
        assert!(drift <= 1e-12, "{mass}: {drift:e}");
    }
}

#[test]
fn the_conserving_scheme_keeps_the_energy_for_two_seconds() {
    for cells in [[10, 4], [20, 8]] {
        for mass in ["singular", "modal"] {
            let drift = drift(cells, 2.0, mass);
            assert!(drift <= 1e-12, "{cells:?}, {mass}: {drift:e}");
        }
    }
}

/// The schemes converge to the trajectory of the exact one.
#[test]
fn schemes_follow_the_exact_one_on_stops() {
    let corner = |time: &str| {
        let rows = run(&on_rubber([10, 4], &format!("{time}, end = 0.07")));
        rows.last().unwrap().probes[0]
    };
    let exact = corner("scheme = \"exact\", mass = \"singular\", step = 1e-3");
    for (scheme, tolerance) in [("conserving", 2e-7), ("midpoint", 2e-7), ("newmark", 5e-7)] {
        let error =
            (corner(&format!("scheme = \"{scheme}\", mass = \"singular\", step = 5e-6")) - exact).abs();
        assert!(error <= tolerance, "{scheme}: {error:e}");
    }
}

/// Stiff stops converge to the rigid obstacle, and the error is of first order in 1/k.
#[test]
fn a_stiff_stop_is_a_rigid_obstacle() {
    let deflection = |stiffness: &str| {
        let obstacle = format!(
            "obstacle = [{{ side = \"below\", height = -0.1, line = [[1.2, 0], [1.2, 0.4]]{stiffness} }}]\n"
        );
        let text = format!(
            "{PAPER_START}{}{obstacle}time = {{ scheme = \"exact\", mass = \"singular\", step = 1e-3, end = 0.06 }}\n\
             output = {{ probes = [{{ name = \"corner\", at = [1.2, 0] }}] }}\n",
            grid("fvs", 10, 4)
        );
        run(&text).last().unwrap().probes[0]
    };
    let rigid = deflection("");
    let errors: Vec<f64> =
        (9..=12).map(|power| (deflection(&format!(", stiffness = 1e{power}")) - rigid).abs()).collect();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log10();
        assert!(order >= 0.95, "order {order} in 1/k: {errors:?}");
    }
    assert!(errors[3] <= 2e-7, "{errors:?}");
}
