//! Branches of periodic motions against closed forms, other integrations and runs.

use crate::common::branches::{driven, free};
use crate::common::scenes::{all_round, close, grid, model, run};
use rebond::continuation::{BranchRow, PointKind};
use rebond::linalg::{Form, MassModes, Native};
use rebond::membrane::Stretch;
use rebond::scheme::{ContactCompliance, System};
use std::f64::consts::PI;

/// Returns the special motions of a kind.
fn points(rows: &[BranchRow], kind: PointKind) -> Vec<&BranchRow> {
    rows.iter().filter(|row| row.point == Some(kind)).collect()
}

/// A cantilever of steel on 6x2 cells, given further tables.
fn strip(element: &str, modes: usize, more: &str) -> String {
    format!(
        "plate = {{ length = 0.2, width = 0.05, thickness = 1e-3, youngs_modulus = 210e9, poissons_ratio = 0.3, \
         density = 7800 }}\n{}support = [{{ edge = \"left\", kind = \"clamped\" }}]\n\
         time = {{ scheme = \"conserving\", mass = \"modal\", modes = {modes}, step = 1e-5, end = 1e-5 }}\n\
         output.probes = [{{ name = \"tip\", at = [0.2, 0.025] }}]\n{more}\n",
        grid(element, 6, 2)
    )
}

/// Returns the pressure of a frequency (Hz), in phase with a sine.
fn pressure(amplitude: f64, frequency: f64) -> String {
    format!("load.pressure = \"{amplitude:?}*sin(2*pi*{frequency:?}*t)\"\n")
}

fn modes(system: &System<Native>) -> &MassModes {
    let Form::Modal { modes, .. } = &system.mass else { panic!("no modal mass") };
    modes
}

/// Returns the modal forces of the drive at its amplitude.
fn modal_forces(system: &System<Native>) -> Vec<f64> {
    let load = &system.drive.terms[0].load;
    let work =
        |k: usize| modes(system).shapes.col(k).iter().zip(load).map(|(shape, load)| shape * load).sum();
    (0..modes(system).count()).map(work).collect()
}

/// Returns the deflection of each mode at the first probe.
fn at_probe(system: &System<Native>, weights: &[(usize, f64)]) -> Vec<f64> {
    let shapes = &modes(system).shapes;
    (0..shapes.ncols())
        .map(|k| weights.iter().map(|(dof, weight)| weight * shapes[(*dof, k)]).sum())
        .collect()
}

/// Returns the amplitude of the tip of a strip of given thickness (m) under a pressure of 2 Pa of a
/// frequency (Hz): the damped modes add up, and the rest follows at once.
fn linear_amplitude(element: &str, thickness: f64, frequency: f64) -> f64 {
    let of_thickness = |text: String| text.replace("thickness = 1e-3", &format!("thickness = {thickness:?}"));
    let built = model(&of_thickness(strip(element, 6, &pressure(2.0, frequency))));
    let still = of_thickness(strip(element, 6, "load.pressure = 2\ninitial.equilibrium = true\n"));
    let mut sum = [run(&still)[0].probes[0], 0.0];
    let (forces, shapes) = (modal_forces(&built.system), at_probe(&built.system, built.probes[0].weights()));
    let w = 2.0 * PI * frequency;
    for (k, square) in modes(&built.system).squares.iter().enumerate() {
        let [re, im] = [square - w * w, w * (3.0 + 1e-5 * square)];
        let share = shapes[k] * forces[k];
        sum[0] += share * (re / (re * re + im * im) - 1.0 / square);
        sum[1] -= share * im / (re * re + im * im);
    }
    sum[0].hypot(sum[1])
}

/// Without contact the motion is that of the modes, over the frequency and over a key that changes
/// them.
#[test]
fn linear_responses_are_sums_of_modes() {
    let damped = "damping = { mass = 3, stiffness = 1e-5 }\n";
    for element in ["fvs", "hct"] {
        let text = |frequency: f64| strip(element, 6, &(pressure(2.0, frequency) + damped));
        let rows = driven(text, |frequency| 1.0 / frequency, [20.5, 22.0], [1, 6000], 0.3);
        assert!(rows.len() > 5 && rows.iter().all(|row| row.stable && row.point.is_none()));
        for row in rows {
            let amplitude = linear_amplitude(element, 1e-3, row.parameter);
            close(&format!("{element}, {} Hz", row.parameter), row.amplitude(0), amplitude, 1e-6);
        }
        let thinner =
            |thickness: f64| text(21.0).replace("thickness = 1e-3", &format!("thickness = {thickness:?}"));
        for row in driven(thinner, |_| 1.0 / 21.0, [1e-3, 9.5e-4], [1, 6000], 0.3) {
            let amplitude = linear_amplitude(element, row.parameter, 21.0);
            close(&format!("{element}, {} m", row.parameter), row.amplitude(0), amplitude, 1e-6);
        }
    }
}

/// Returns the frequency (Hz) of a mass m on a spring k beside a stop K at a distance j that moves
/// with an energy: half a period consists of arcs of two harmonic motions.
fn beside_a_stop(m: f64, k: f64, stop: f64, j: f64, energy: f64) -> f64 {
    let (w, pressed) = ((k / m).sqrt(), ((k + stop) / m).sqrt());
    let farthest = (2.0 * energy / k).sqrt();
    if farthest <= j {
        return w / (2.0 * PI);
    }
    let speed = ((2.0 * energy - k * j * j) / m).sqrt();
    let depth = j - stop * j / (k + stop);
    let half =
        (0.5 * PI + (j / farthest).asin()) / w + (0.5 * PI - (depth * pressed / speed).atan()) / pressed;
    0.5 / half
}

/// One mode beside a stop has the frequencies of a mass on a spring, such as those of code_aster's
/// SDND122.
#[test]
fn frequencies_beside_a_stop_grow_with_the_energy() {
    for (energy, expected) in [(1e-3, "0.556889"), (1e-2, "0.658956")] {
        assert_eq!(format!("{:.6}", beside_a_stop(1.0, 10.0, 50.0, 0.01, energy)), expected);
    }
    let text = strip(
        "fvs",
        1,
        "obstacle = [{ side = \"above\", height = 1e-3, at = [0.2, 0.025], stiffness = 2000 }]",
    );
    let built = model(&text);
    let system = &built.system;
    let ContactCompliance { compliance, shapes, squares } =
        ContactCompliance::new(system, &system.bounds.dofs).unwrap();
    let [a, r] = [shapes[(0, 0)], compliance[(0, 0)]];
    let frequency = |energy: f64| beside_a_stop(1.0, squares[0], a * a / r, 1e-3 / a.abs(), energy);
    let rows = free(&text, [1e-5, 1e-2], 0.3);
    assert_eq!(points(&rows, PointKind::Grazing).len(), 1);
    for row in &rows {
        close(&format!("{} J", row.parameter), 1.0 / row.period, frequency(row.parameter), 1e-5);
    }
    assert!(rows[rows.len() - 1].period < 0.8 * rows[0].period);
}

/// Driven oscillator q'' + d q' + w^2 q + force(q, s) = f s with s = sin(W t), integrated by the
/// classical rule of Runge and Kutta.
struct Oscillator<'f> {
    square: f64,
    damping: f64,
    load: f64,
    force: &'f dyn Fn(f64, f64) -> f64,
    /// Distance from the place where the force has a kink, at which a step is divided.
    kink: &'f dyn Fn(f64, f64) -> f64,
}

impl Oscillator<'_> {
    const STEPS: usize = 2000;

    /// Returns the state after a period of a frequency, in Hz.
    fn pass(&self, frequency: f64, mut z: [f64; 2]) -> [f64; 2] {
        let h = 1.0 / (frequency * Self::STEPS as f64);
        let drive = |t: f64| (2.0 * PI * frequency * t).sin();
        let rate = |t: f64, [q, v]: [f64; 2]| {
            [v, self.load * drive(t) - self.damping * v - self.square * q - (self.force)(q, drive(t))]
        };
        let step = |t: f64, h: f64, [q, v]: [f64; 2]| {
            let beside = |rate: [f64; 2], part: f64| [q + part * h * rate[0], v + part * h * rate[1]];
            let a = rate(t, [q, v]);
            let b = rate(t + 0.5 * h, beside(a, 0.5));
            let c = rate(t + 0.5 * h, beside(b, 0.5));
            let d = rate(t + h, beside(c, 1.0));
            [0, 1].map(|k| [q, v][k] + h / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]))
        };
        let distance = |t: f64, z: [f64; 2]| (self.kink)(z[0], drive(t));
        for k in 0..Self::STEPS {
            let t = k as f64 * h;
            let (before, end) = (distance(t, z), step(t, h, z));
            if before * distance(t + h, end) >= 0.0 {
                z = end;
                continue;
            }
            let (mut low, mut high) = (0.0, h);
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                let is_before = before * distance(t + middle, step(t, middle, z)) > 0.0;
                *(if is_before { &mut low } else { &mut high }) = middle;
            }
            z = step(t + low, h - low, step(t, low, z));
        }
        z
    }

    /// Returns the derivative of the map of some periods by the state, by differences.
    fn derivative(&self, frequency: f64, [q, v]: [f64; 2]) -> [[f64; 2]; 2] {
        let size = q.abs() + v.abs() / self.square.sqrt();
        let changes = [[1e-6 * size, 0.0], [0.0, 1e-6 * size * self.square.sqrt()]];
        changes.map(|[dq, dv]| {
            let [up, down] = [1.0, -1.0].map(|s| self.pass(frequency, [q + s * dq, v + s * dv]));
            [(up[0] - down[0]) / (2.0 * (dq + dv)), (up[1] - down[1]) / (2.0 * (dq + dv))]
        })
    }

    /// Returns the periodic motion near a state, with the derivative there, by Newton's method.
    fn periodic(&self, frequency: f64, mut z: [f64; 2]) -> Option<([f64; 2], [[f64; 2]; 2])> {
        for _ in 0..12 {
            let end = self.pass(frequency, z);
            let m = self.derivative(frequency, z);
            let residual = [end[0] - z[0], end[1] - z[1]];
            let [[a, c], [b, d]] = [[m[0][0] - 1.0, m[0][1]], [m[1][0], m[1][1] - 1.0]];
            let det = a * d - b * c;
            let step = [(d * residual[0] - b * residual[1]) / det, (a * residual[1] - c * residual[0]) / det];
            let size = (step[0] / z[0]).abs().max((step[1] / z[1]).abs());
            z = [z[0] - step[0], z[1] - step[1]];
            if size < 1e-9 {
                return Some((z, m));
            }
        }
        None
    }

    /// Returns the state after many periods from rest.
    fn settled(&self, frequency: f64, periods: usize) -> [f64; 2] {
        (0..periods).fold([0.0; 2], |z, _| self.pass(frequency, z))
    }
}

/// A single mode that stretches is an oscillator of Duffing, whose resonance folds.
#[test]
fn the_resonance_of_a_mode_that_stretches_folds() {
    let text = |frequency: f64| {
        format!(
            "plate = {{ length = 1, width = 1, thickness = 0.01, youngs_modulus = 10.92e6, poissons_ratio = 0.3, \
             density = 100 }}\n{}{}in_plane.stretching = true\n{}damping.mass = 0.5\n\
             time = {{ scheme = \"conserving\", mass = \"modal\", modes = 1, step = 1e-3, end = 1e-3 }}\n\
             output.probes = [{{ name = \"centre\", at = [0.5, 0.5] }}]\n",
            all_round("simply_supported").replace("kind", "in_plane = \"held\", kind"),
            grid("fvs", 4, 4),
            pressure(0.06, frequency),
        )
    };
    let built = model(&text(3.0));
    let system = &built.system;
    let mut stretch = Stretch::default();
    system.drive.stretching.as_ref().unwrap().evaluate(&[1.0], &mut stretch);
    let cubic = 4.0 * stretch.energy();
    let load = modal_forces(system)[0];
    let oscillator = Oscillator {
        square: modes(system).squares[0],
        damping: 0.5,
        load,
        force: &|q, _| cubic * q.powi(3),
        kink: &|_, _| 1.0,
    };
    let rows = driven(text, |frequency| 1.0 / frequency, [3.0, 5.0], [1, 2000], 0.1);
    let folds = points(&rows, PointKind::Fold);
    assert_eq!(folds.len(), 2);
    let fold = folds[0].parameter;
    // The stable motion of the oscillator is followed until it ends.
    let (mut frequency, mut step) = (3.0, 0.05);
    let mut z = oscillator.settled(frequency, 60);
    while step > 1e-7 {
        match oscillator.periodic(frequency + step, z) {
            Some((next, m)) if m[0][0] + m[1][1] < 1.0 + m[0][0] * m[1][1] - m[0][1] * m[1][0] => {
                (z, frequency) = (next, frequency + step);
            }
            _ => step *= 0.5,
        }
    }
    println!("fold at {fold}, {frequency}");
    close("fold", fold, frequency, 1e-5);
    // Between the folds lie three motions, the middle one unstable.
    let inside: Vec<bool> = rows.iter().map(|row| row.stable).collect();
    let changes = inside.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert!(inside[0] && inside[inside.len() - 1] && changes == 2, "{changes} changes of stability");
}

/// A strip driven near twice its frequency against a stop grazes it where its linear response
/// reaches the stop, and doubles its period between two frequencies.
#[test]
fn a_strip_against_a_stop_doubles_its_period() {
    let gap = 2e-5;
    let text = |frequency: f64| {
        let stop = "obstacle = [{ side = \"below\", height = -2e-5, at = [0.2, 0.025], stiffness = 5000 }]\n";
        strip("fvs", 1, &(pressure(20.0, frequency) + stop + "damping.mass = 8\n"))
    };
    let built = model(&text(50.0));
    let system = &built.system;
    let ContactCompliance { compliance, shapes, squares } =
        ContactCompliance::new(system, &system.bounds.dofs).unwrap();
    let [shape, soft, square] = [shapes[(0, 0)], compliance[(0, 0)], squares[0]];
    let still = strip("fvs", 1, "load.pressure = 20\ninitial.equilibrium = true\n");
    let whole = run(&still)[0].probes[0];
    let load = modal_forces(system)[0];
    // The rest of the deflection follows the load at once.
    let rest = whole - shape * load / square;
    let kink = |q: f64, drive: f64| shape * q + rest * drive + gap;
    let force = |q: f64, drive: f64| shape / soft * kink(q, drive).min(0.0);
    let oscillator = Oscillator { square, damping: 8.0, load, force: &force, kink: &kink };
    let rows = driven(text, |frequency| 1.0 / frequency, [45.0, 85.0], [1, 3000], 0.3);

    let grazing = points(&rows, PointKind::Grazing);
    assert_eq!(grazing.len(), 1);
    let w = 2.0 * PI * grazing[0].parameter;
    let [re, im] = [square - w * w, 8.0 * w];
    let share = shape * load / (re * re + im * im);
    close("grazing", (share * re + rest).hypot(share * im), gap, 1e-6);

    let flips = points(&rows, PointKind::Flip);
    assert_eq!(flips.len(), 2);
    for (flip, side) in flips.into_iter().zip([-1.0, 1.0]) {
        let near = oscillator.settled(flip.parameter + side, 300);
        // 1 + tr M + det M is the product of both multipliers plus 1.
        let product = |frequency: f64| {
            let (_, m) = oscillator.periodic(frequency, near).unwrap();
            1.0 + m[0][0] + m[1][1] + m[0][0] * m[1][1] - m[0][1] * m[1][0]
        };
        let [low, high] = [0.999, 1.001].map(|part| part * flip.parameter);
        let [below, above] = [low, high].map(product);
        let frequency = low + (high - low) * below / (below - above);
        println!("flip at {}, {frequency}", flip.parameter);
        close("flip", flip.parameter, frequency, 1e-5);
    }
    let stable = |row: &&BranchRow| row.stable != (48.1..76.7).contains(&row.parameter);
    assert_eq!(rows.iter().filter(stable).count(), rows.len());
}

/// Runs that have settled between springs move as the branch tells, with contact and several
/// modes, under each pressure on whichever of two motions their start leads to.
#[test]
fn runs_settle_on_the_branch() {
    const STEPS: usize = 2000;
    // Time over which a start dies out, in times of the damping.
    const FADING: f64 = 90.0;
    let stops = "obstacle = [{ side = \"below\", height = -1e-3, where = \"x > 0.16\", stiffness = 1e5 }, \
                 { side = \"above\", height = 1e-3, where = \"x > 0.16\", stiffness = 1e5 }]\n";
    let mut large = Vec::new();
    // Frequency in Hz, tip at the start in m, pressure in Pa, damping in 1/s.
    for (frequency, start, amplitude, damping) in [
        (21.5, 0.0, 30.0, 20.0),
        (23.0, 0.0, 14.0, 6.0),
        (23.0, -2e-3, 14.0, 6.0),
        (23.0, -2e-3, 12.0, 6.0),
        (23.0, 4e-3, 12.0, 6.0),
    ] {
        let given =
            format!("{stops}damping.mass = {damping:?}\n[initial]\ndeflection = \"{start:?}*(x/0.2)^2\"\n");
        let text = |frequency: f64| strip("fvs", 6, &(pressure(amplitude, frequency) + &given));
        let range = [frequency, frequency + 0.02];
        let row = &driven(text, |frequency| 1.0 / frequency, range, [1, STEPS], 1.0)[0];
        assert!(row.stable);
        large.push(row.contacts == 2);
        let step = 1.0 / (frequency * STEPS as f64);
        let timing =
            format!("step = {step:?}, end = {:?}", (FADING / damping * frequency).round() / frequency);
        let rows = run(&text(frequency).replace("step = 1e-5, end = 1e-5", &timing));
        let last = rows[rows.len() - STEPS..].iter().map(|row| row.probes[0]);
        let [low, high] = last.fold([0.0_f64; 2], |[low, high], tip| [low.min(tip), high.max(tip)]);
        let name = format!("half the range at {frequency} Hz and {amplitude} Pa from {start} m");
        close(&name, 0.5 * (high - low), row.amplitude(0), 1e-6);
    }
    assert_eq!(large, [true, false, true, true, false]);
}
