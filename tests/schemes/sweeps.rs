//! Sweeps, compared with closed forms: the response of a damped plate, grazing, hysteresis at a
//! hardening stop, and Lyapunov exponents and periods of maps and motions where they are known.

use crate::common::models::UNIT;
use crate::common::scenes::close;
use rebond::linalg::{Engine, Form, Native};
use rebond::lock_step::SharedModes;
use rebond::scene::Scene;
use rebond::scheme::{NewmarkParameters, Solution, Start};
use rebond::simulation::Model;
use rebond::sweep::lyapunov::{Exponent, Neighbours};
use rebond::sweep::{CarriedState, Direction, Loader, Measures, SweepRecord, SweepRow, conduct, repetition};
use std::f64::consts::{LN_2, PI, TAU};

/// Record that knows nothing from before.
#[derive(Default)]
pub struct Fresh(pub Vec<SweepRow>);

impl SweepRecord for Fresh {
    fn is_known(&self, _: usize) -> bool {
        false
    }

    fn state(&self, _: usize) -> Option<CarriedState> {
        None
    }

    fn done(&mut self, _: usize, row: SweepRow, _: Option<&CarriedState>) -> rebond::Result<()> {
        self.0.push(row);
        Ok(())
    }
}

/// Returns the rows of a scene's sweep, in the order of the plan.
pub fn rows_of(scene: &Scene, load: &Loader) -> Vec<SweepRow> {
    let mut made = Fresh::default();
    conduct(scene.sweep.as_ref().unwrap(), load, &mut made, 2, &|| false).unwrap();
    made.0.sort_by_key(|row| row.index);
    made.0
}

/// Returns values, direction and measures of the runs of a sweep.
fn sweep(text: &str) -> Vec<(f64, Direction, Measures)> {
    let load = |settings: &[String]| Scene::from_str(text, "sweep.toml", settings);
    let scene = load(&[]).unwrap();
    let rows = rows_of(&scene, &load);
    let measured = |row: SweepRow| {
        let why = row.failure.unwrap_or_default();
        (row.values[0], row.direction, row.measures.unwrap_or_else(|| panic!("{why}")))
    };
    rows.into_iter().map(measured).collect()
}

/// Damping rate (1/s) and load (Pa) of [`heave`].
const DECAY: f64 = 0.05;
pub const LOAD: f64 = 0.1;

/// Returns the scene of a free plate of 1 kg/m2 on a bed of 1 N/m3 under an even pressure, which
/// moves like a single mass: u'' + 0.05 u' + u = 0.1 sin(w t) between its obstacles.
pub fn heave(obstacles: &str, sweep: &str) -> String {
    [
        UNIT,
        &format!("parameters = {{ w = 1.09, p = {LOAD} }}\n"),
        "mesh = { element = \"fvs\", cells = [1, 1] }\nfoundation = [{ stiffness = 1 }]\n",
        &format!("load = {{ pressure = \"p*sin(w*t)\" }}\ndamping = {{ mass = {DECAY} }}\n"),
        "time = { scheme = \"newmark\", mass = \"singular\", step = 0.04, end = 1 }\n",
        "output = { probes = [{ name = \"u\", at = [0, 0] }] }\n",
        obstacles,
        sweep,
    ]
    .concat()
}

/// Returns the amplitude of the single mass without obstacles under 1 Pa.
pub fn linear(w: f64) -> f64 {
    1.0 / (1.0 - w * w).hypot(DECAY * w)
}

/// Loads that grow slowly to just under the value at which the plate grazes its stop meet nothing,
/// and one just over it hits.
#[test]
fn a_single_mass_grazes_its_stop_at_the_load_of_its_amplitude() {
    let grazing = 0.8 / linear(1.3);
    // No transient motion overshoots its load by more than the step of the load.
    let loads: Vec<f64> =
        [0.45, 0.7, 0.84, 0.91, 0.95, 0.97, 0.98, 1.02].iter().map(|share| share * grazing).collect();
    let over = loads.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let rows = sweep(
        &heave(
            "obstacle = [{ side = \"below\", height = -0.8 }]\n",
            &format!(
                "sweep = {{ over = [\"p={over}\"], direction = \"up\", period = \"2*pi/w\", periods = 70, settle = 66 }}\n"
            ),
        )
        .replace("w = 1.09", "w = 1.3"),
    );
    let (.., hit) = rows.last().unwrap();
    assert!(hit.impacts > 0.0 && hit.peak_force > 0.0 && hit.impact_velocity > 0.0, "{hit:?}");
    for (p, _, free) in &rows[..rows.len() - 1] {
        assert_eq!((free.impacts, free.peak_force, free.impulse, free.period), (0.0, 0.0, 0.0, Some(1)));
        close("amplitude", free.probes[0].amplitude, p * linear(1.3), 5e-3);
        // Without contact damping takes what the load gives.
        close("energy", free.work, PI * DECAY * 1.3 * (p * linear(1.3)).powi(2), 1e-2);
        close("balance", free.loss, free.work, 1e-2);
    }
}

/// Single mass u'' + c u' + u + k min(u + g, 0) = sin(w t), which meets a stop of stiffness k at
/// -g, by the closed forms of its two linear motions (Shaw and Holmes, Journal of Sound and
/// Vibration 90 (1983) 129-155).
#[derive(Clone, Copy)]
struct Bilinear {
    w: f64,
    c: f64,
    k: f64,
    g: f64,
}

impl Bilinear {
    /// Returns the state [u, u'] a time s after the instant t, without a change of contact.
    fn flow(&self, [u, v]: [f64; 2], t: f64, s: f64, touches: bool) -> [f64; 2] {
        let Bilinear { w, c, k, g } = *self;
        let (stiffness, rest) = if touches { (1.0 + k, -k * g / (1.0 + k)) } else { (1.0, 0.0) };
        let amplitude = 1.0 / (stiffness - w * w).hypot(c * w);
        let lag = (c * w).atan2(stiffness - w * w);
        let forced = |t: f64| {
            let (sine, cosine) = (w * t - lag).sin_cos();
            [rest + amplitude * sine, amplitude * w * cosine]
        };
        let (rate, [from_u, from_v], [to_u, to_v]) =
            ((stiffness - 0.25 * c * c).sqrt(), forced(t), forced(t + s));
        let (a, b) = (u - from_u, (v - from_v + 0.5 * c * (u - from_u)) / rate);
        let (sine, cosine) = (rate * s).sin_cos();
        let decay = (-0.5 * c * s).exp();
        let free = decay * (a * cosine + b * sine);
        [to_u + free, to_v - 0.5 * c * free + decay * rate * (b * cosine - a * sine)]
    }

    /// Returns the state one period of the drive later.
    fn after_period(&self, mut state: [f64; 2]) -> [f64; 2] {
        let end = TAU / self.w;
        let (mut t, mut touches) = (0.0, state[0] < -self.g);
        while t < end {
            let step = (end / 200.0).min(end - t);
            let has_changed = |state: [f64; 2]| (state[0] < -self.g) != touches;
            let mut later = self.flow(state, t, step, touches);
            if !has_changed(later) {
                (t, state) = (if step < end - t { t + step } else { end }, later);
                continue;
            }
            let (mut low, mut high) = (0.0, step);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                later = self.flow(state, t, middle, touches);
                *(if has_changed(later) { &mut high } else { &mut low }) = middle;
            }
            state = self.flow(state, t, high, touches);
            (t, touches) = (t + high, !touches);
        }
        state
    }

    /// Returns the state of the motion with the period of the drive, near a state, and 1 + trace +
    /// determinant of its map, which is zero where the period doubles.
    fn doubling(&self, mut state: [f64; 2]) -> ([f64; 2], f64) {
        let mut value = f64::NAN;
        for _ in 0..20 {
            let column = |k: usize| {
                let moved = |by: f64| {
                    let mut state = state;
                    state[k] += by;
                    self.after_period(state)
                };
                let (more, less) = (moved(1e-6), moved(-1e-6));
                [0, 1].map(|i| (more[i] - less[i]) / 2e-6)
            };
            let [[a, c], [b, d]] = [column(0), column(1)];
            value = 1.0 + a + d + (a * d - b * c);
            let [x, y] = self.after_period(state);
            let (x, y) = (x - state[0], y - state[1]);
            // Newton's step solves (J - 1) z = -(x, y).
            let (a, d) = (a - 1.0, d - 1.0);
            let determinant = a * d - b * c;
            state[0] -= (d * x - b * y) / determinant;
            state[1] -= (a * y - c * x) / determinant;
        }
        (state, value)
    }
}

/// At a stop of eight times its stiffness the period of a driven mass doubles at the frequency that
/// the closed form tells. Just beyond it the square of the distance of the two branches grows in
/// proportion, so that two frequencies tell where it begins: at 0.9999 of the known one with steps
/// of 1/440 of the period. The plate must be stiff to move like a single mass: with a rigidity of
/// 1 N m, not 1e4 N m, it bends over the stops at its corners, and the period doubles 0.35 % lower.
#[test]
fn the_period_of_a_mass_at_a_stop_doubles_at_the_known_frequency() {
    let of = |w: f64| Bilinear { w, c: 0.2, k: 8.0, g: 0.05 };
    let settled = (0..200).fold([0.0; 2], |state, _| of(2.25).after_period(state));
    let (mut state, mut low) = (settled, 2.25);
    let (mut step, mut value) = (0.01, of(low).doubling(state).1);
    assert!(value > 0.0, "{value}");
    while step > 1e-9 {
        let (next, beyond) = of(low + step).doubling(state);
        if beyond > 0.0 {
            (state, low, value) = (next, low + step, beyond)
        } else {
            step *= 0.5
        }
        assert!(low < 2.6, "no doubling: {value}");
    }
    let shares = [0.998, 1.001, 1.002];
    let over = shares.map(|share| format!("{}", share * low)).join(",");
    let text = heave(
        "obstacle = [{ side = \"below\", height = -0.05, stiffness = 8 }]\n",
        &format!("sweep = {{ over = [\"w={over}\"], period = \"2*pi/w\", periods = 300, settle = 270 }}\n"),
    );
    let text = text
        .replace(&format!("p = {LOAD}"), "p = 1.0")
        .replace(&format!("mass = {DECAY}"), "mass = 0.2")
        .replace("youngs_modulus = 10.92", "youngs_modulus = 10.92e4")
        .replace("step = 0.04", "step = 0.00625");
    // Median distance of successive points of the section.
    let distances: Vec<f64> = sweep(&text)
        .into_iter()
        .map(|(.., measures)| {
            let section = &measures.probes[0].section;
            let mut apart: Vec<f64> = section.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
            apart.sort_by(f64::total_cmp);
            apart[apart.len() / 2]
        })
        .collect();
    let [single, first, second] = [0, 1, 2].map(|k| distances[k].powi(2));
    let begins = shares[1] - (shares[2] - shares[1]) * first / (second - first);
    println!("doubles at {low}: distances {distances:?}, begins at {begins} of it");
    assert!(single < 1e-8 && first > 1e-3, "{distances:?}");
    assert!((begins - 1.0).abs() < 1e-3, "{begins}");
}

/// Between compliant stops that double the stiffness, two motions exist over an interval of
/// frequencies: the one without contact from w^2 = 1.1 on, where its amplitude falls below the gap,
/// and one through the stops up to about 1.14, by harmonic balance of the stops. Up and down each
/// follow theirs.
#[test]
fn a_hardening_stop_has_two_motions_that_the_directions_find() {
    let stop = |side: &str, height: f64| format!("{{ side = \"{side}\", height = {height}, stiffness = 1 }}");
    let rows = sweep(&heave(
        &format!("obstacle = [{}, {}]\n", stop("below", -1.0), stop("above", 1.0)),
        "sweep = { over = [\"w=1.01..1.19:10\"], direction = \"up_and_down\", period = \"2*pi/w\", periods = 56, settle = 50 }\n",
    ));
    assert_eq!(rows.len(), 20);
    let amplitude = |direction: Direction, w: f64| {
        let near = |row: &&(f64, Direction, Measures)| row.1 == direction && (row.0 - w).abs() < 1e-9;
        rows.iter().find(near).unwrap().2.probes[0].amplitude
    };
    for w in [1.07, 1.09] {
        let (up, down) = (amplitude(Direction::Up, w), amplitude(Direction::Down, w));
        assert!(up > 1.2 && down < 1.0, "{w}: {up} {down}");
        close("without contact", down, LOAD * linear(w), 1e-2);
        // Harmonic balance: (1 - w^2 + N(A)) A and the damping balance the load.
        let share = 1.0 / up;
        let stiff = 1.0 - 2.0 / PI * (share.asin() + share * (1.0 - share * share).sqrt());
        let load = up * (1.0 - w * w + stiff).hypot(DECAY * w);
        close("harmonic balance", load, LOAD, 0.1);
    }
    // Outside the interval both directions show the one motion there is.
    for w in [1.01, 1.17, 1.19] {
        close("one motion", amplitude(Direction::Up, w), amplitude(Direction::Down, w), 1e-2);
    }
}

/// Runs that share their matrices go in lock step. Their numbers are the same, to the bit, in
/// whatever company they are made, and those of a run by itself but for rounding.
#[test]
fn a_run_does_not_depend_on_its_company() {
    let of_loads = |cells: &str, mass: &str, more: &str, loads: &[f64]| {
        let over = loads.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let text = [
            UNIT,
            &format!("mesh = {{ element = \"fvs\", cells = {cells} }}\n"),
            "parameters = { p = 1.0 }\nload = { pressure = \"p*(1 + x)*sin(3*t) + 0.02*y*cos(6*t) + 0.01*x\" }\n",
            "obstacle = [{ side = \"below\", height = -0.05, where = \"x > 0.9\" }, { side = \"above\", height = \"0.05 + 0.01*y\", where = \"x > 0.9\" }]\n",
            &format!("time = {{ scheme = \"newmark\", mass = \"{mass}\", restitution = 0.2, step = 0.01, end = 1 }}\n"),
            "output = { probes = [{ name = \"tip\", at = [1, 0.5] }, { name = \"middle\", at = [0.4, 0.5] }] }\n",
            &format!("sweep = {{ over = [\"p={over}\"], period = \"2*pi/3\", periods = 6, settle = 4 }}\n"),
            more,
        ]
        .concat();
        sweep(&text)
    };
    let clamp = "support = [{ edge = \"left\", kind = \"clamped\" }]\n";
    let damped = &*format!("{clamp}damping = {{ mass = 1.0, stiffness = 0.01 }}\n");
    let thrown = &*format!("{clamp}damping = {{ mass = 1.0 }}\ninitial = {{ velocity = \"0.02*x*y\" }}\n");
    let by_mode = &*format!("{clamp}damping = {{ modal = [0.1, 0.05] }}\n");
    // Rigid motions are no modes of a mass of cells, and the last mesh has too many dofs for all
    // modes with inertia.
    let free = "damping = { mass = 1.0 }\n";
    let scenes = [
        ("[4, 2]", "singular", damped),
        ("[4, 2]", "singular", thrown),
        ("[4, 2]", "consistent", damped),
        ("[4, 2]", "modal", damped),
        ("[4, 2]", "modal", thrown),
        ("[4, 2]", "modal", by_mode),
        ("[4, 2]", "singular", free),
        ("[4, 2]", "modal", free),
        ("[24, 8]", "singular", damped),
    ];
    for (cells, mass, more) in scenes {
        let loads: Vec<f64> = (1..=11).map(|k| 0.05 * f64::from(k)).collect();
        let all = of_loads(cells, mass, more, &loads);
        assert!(
            (all[0].2.impacts == 0.0) != (more == free) && all[10].2.impacts > 0.0,
            "{cells} {mass} {more}"
        );
        let few = of_loads(cells, mass, more, &[loads[0], loads[10], loads[7]]);
        assert_eq!(few, [all[0].clone(), all[10].clone(), all[7].clone()], "{cells} {mass} {more}");
        for k in [0, 7, 10] {
            let (alone, found) = (&of_loads(cells, mass, more, &[loads[k]])[0].2, &all[k].2);
            for (alone, found) in alone.probes.iter().zip(&found.probes) {
                close("rms", found.rms, alone.rms, 1e-8);
                close("amplitude", found.amplitude, alone.amplitude, 1e-8);
            }
            close("work", found.work, alone.work, 1e-8);
            close("loss", found.loss, alone.loss, 1e-8);
            assert!((found.impulse - alone.impulse).abs() <= 1e-7 * alone.impulse);
            assert_eq!((found.impacts, found.period), (alone.impacts, alone.period));
        }
    }
}

/// The response of a damped cantilever is that of its matrices: amplitude and phase to 1e-4.
#[test]
fn a_linear_response_is_that_of_the_matrices() {
    let text = [
        UNIT,
        "support = [{ edge = \"left\", kind = \"clamped\" }]\nmesh = { element = \"fvs\", cells = [2, 1] }\n",
        "parameters = { w = 3.0 }\nload = { pressure = \"(1 + x)*sin(w*t)\" }\n",
        "damping = { mass = 1.0, stiffness = 0.01 }\n",
        "time = { scheme = \"newmark\", mass = \"consistent\", step = 0.0015, end = 1.5 }\n",
        "output = { probes = [{ name = \"tip\", at = [1, 1] }] }\n",
        "sweep = { over = [\"w=2,3.2,5,8\"], period = \"2*pi/w\", periods = 26, settle = 25 }\n",
    ]
    .concat();
    let model = Model::new(&Scene::from_str(&text, "sweep.toml", &[]).unwrap()).unwrap();
    let system = &model.system;
    let n = system.engine.dofs();
    let quarter = 0.25 * TAU / 3.0;
    let mut load = vec![0.0; n];
    for term in &system.drive.terms {
        let factor = (term.factor)(quarter).unwrap();
        load.iter_mut().zip(&term.load).for_each(|(sum, f)| *sum += factor * f);
    }
    let [stiffness, mass] = [&system.stiffness, &system.mass].map(|form| matrix(&system.engine, form));
    for (w, _, measures) in sweep(&text) {
        let damping: Vec<f64> = mass.iter().zip(&stiffness).map(|(m, k)| m + 0.01 * k).collect();
        let u = response([&stiffness, &mass, &damping], &load, w);
        let tip: [f64; 2] = [0, 1].map(|part| {
            model.probes[0].weights().iter().map(|&(dof, weight)| weight * u[part * n + dof]).sum()
        });
        let (amplitude, phase) = (tip[0].hypot(tip[1]), tip[1].atan2(tip[0]));
        let found = &measures.probes[0];
        close("amplitude", found.amplitude, amplitude, 1e-4);
        assert!((found.phase - phase).abs() < 1e-4, "{w}: {} {phase}", found.phase);
        assert_eq!((measures.impacts, measures.impact_velocity), (0.0, 0.0));
        close("energy balance", measures.work, measures.loss, 1e-3);
    }
}

/// Returns a form as a dense matrix, stored by rows.
fn matrix(engine: &Native, form: &Form) -> Vec<f64> {
    let n = engine.dofs();
    let mut matrix = vec![0.0; n * n];
    let mut unit = vec![0.0; n];
    for (dof, row) in matrix.chunks_exact_mut(n).enumerate() {
        unit[dof] = 1.0;
        engine.multiply(form, &unit, row).unwrap();
        unit[dof] = 0.0;
    }
    matrix
}

/// Returns the factors of sin(w t) and then of cos(w t) in the steady motion under F sin(w t), with
/// the matrices K, M and D.
fn response([k, m, d]: [&[f64]; 3], load: &[f64], w: f64) -> Vec<f64> {
    let n = load.len();
    let mut a = faer::Mat::<f64>::zeros(2 * n, 2 * n);
    let mut b = faer::Mat::<f64>::zeros(2 * n, 1);
    for i in 0..n {
        b[(i, 0)] = load[i];
        for j in 0..n {
            let (stiff, damped) = (k[i * n + j] - w * w * m[i * n + j], w * d[i * n + j]);
            (a[(i, j)], a[(i, n + j)]) = (stiff, -damped);
            (a[(n + i, j)], a[(n + i, n + j)]) = (damped, stiff);
        }
    }
    let x = faer::linalg::solvers::Solve::solve(&a.partial_piv_lu(), &b);
    (0..2 * n).map(|i| x[(i, 0)]).collect()
}

/// Two neighbouring orbits of a map on the unit interval.
struct Orbits {
    map: fn(f64) -> f64,
    at: [f64; 2],
}

impl Neighbours for Orbits {
    fn distance(&mut self) -> rebond::Result<f64> {
        Ok((self.at[1] - self.at[0]).abs())
    }

    fn rescale(&mut self, ratio: f64) -> rebond::Result<()> {
        let [first, second] = self.at;
        let apart = ratio * (second - first);
        // Both orbits stay within the interval.
        let inside = (0.0..=1.0).contains(&(first + apart));
        self.at[1] = if inside { first + apart } else { first - apart };
        Ok(())
    }
}

/// Returns the exponent per iteration of a map.
fn exponent(map: fn(f64) -> f64, iterations: u64) -> f64 {
    let mut orbits = Orbits { map, at: [0.3123, 0.3123 + 1e-9] };
    let mut exponent = Exponent::new(&mut orbits, iterations).unwrap();
    for _ in 0..iterations {
        orbits.at = orbits.at.map(orbits.map);
        exponent.note(&mut orbits).unwrap();
    }
    exponent.per_period().unwrap()
}

/// The logistic map has the exponent ln 2 at r = 4. At r = 3.2 its orbit a, b of period 2 has half
/// the logarithm of r^2 (1 - 2 a) (1 - 2 b) = 4 + 2 r - r^2.
#[test]
fn exponents_of_maps_are_the_known_ones() {
    let chaotic = exponent(|x| 4.0 * x * (1.0 - x), 200_000);
    assert!((chaotic - LN_2).abs() < 5e-3, "{chaotic}");
    let periodic = exponent(|x| 3.2 * x * (1.0 - x), 10_000);
    let product: f64 = 4.0 + 2.0 * 3.2 - 3.2 * 3.2;
    assert!((periodic - 0.5 * product.ln()).abs() < 1e-3, "{periodic}");
}

/// The logistic map doubles its period at r = 3 and at 1 + sqrt(6), has period 3 from 1 + sqrt(8)
/// on, and no period at 4.
#[test]
fn periods_of_a_map_are_the_known_ones() {
    let section = |r: f64| {
        let mut x = 0.3123;
        (0..20_000).for_each(|_| x = r * x * (1.0 - x));
        let next = |_| {
            x = r * x * (1.0 - x);
            x
        };
        (0..200).map(next).collect::<Vec<f64>>()
    };
    let doubled = 1.0 + 6.0_f64.sqrt();
    let window = 1.0 + 8.0_f64.sqrt();
    for (r, period) in [
        (2.98, Some(1)),
        (3.02, Some(2)),
        (doubled - 0.02, Some(2)),
        (doubled + 0.02, Some(4)),
        (window + 0.005, Some(3)),
        (4.0, None),
    ] {
        assert_eq!(repetition(&[(&section(r), 1.0)], 1e-3), period, "{r}");
    }
    // Two probes repeat together: with periods 2 and 3 after 6.
    let [two, three] = [2, 3].map(|period| (0..60).map(|i| f64::from(i % period)).collect::<Vec<f64>>());
    assert_eq!(repetition(&[(&two, 1.0), (&three, 1.0)], 1e-3), Some(6));
}

/// Neighbours of the damped motion of a single mass approach it at half its damping rate.
#[test]
fn the_exponent_of_a_damped_motion_is_minus_its_decay_rate() {
    let rows = sweep(&heave(
        "",
        "sweep = { over = [\"p=0.1,0.2\"], period = \"2*pi/w\", periods = 120, settle = 20, lyapunov = true }\n",
    ));
    for (.., measures) in rows {
        close("exponent", measures.lyapunov.unwrap(), -0.5 * DECAY, 1e-2);
    }
}

/// The energies that the guard of a sweep takes from coordinates are those of the matrices, at
/// every step of motions that touch an obstacle.
#[test]
fn energies_of_coordinates_are_those_of_the_matrices() {
    let scene = |mass: &str, load: f64| {
        let text = [
            UNIT,
            "mesh = { element = \"fvs\", cells = [4, 2] }\nsupport = [{ edge = \"left\", kind = \"clamped\" }]\n",
            &format!("load = {{ pressure = \"{load}*(1 + x)*sin(3*t) + 0.02*y*cos(6*t) + 0.05*x\" }}\n"),
            "initial = { static_pressure = -0.02, velocity = \"0.1*x*y\" }\n",
            "obstacle = [{ side = \"below\", height = -0.05, where = \"x > 0.9\" }, { side = \"above\", height = 0.05, where = \"x > 0.9\" }]\n",
            &format!(
                "time = {{ scheme = \"newmark\", mass = \"{mass}\", restitution = 0.2, step = 0.01, end = 1 }}\n"
            ),
        ];
        Scene::from_str(&text.concat(), "sweep.toml", &[]).unwrap()
    };
    let parameters = NewmarkParameters { beta: 0.5, restitution: 0.2, step: 0.01 };
    for mass in ["singular", "consistent", "modal"] {
        let models = [0.3, 0.7].map(|load| Model::new(&scene(mass, load)).unwrap());
        let systems: Vec<_> = models.iter().map(|model| &model.system).collect();
        let starts: Vec<Start> = models.iter().map(|model| model.start.clone()).collect();
        let modes = SharedModes::modes(systems[0]).unwrap().unwrap();
        let shared = SharedModes::new(systems[0], &modes).unwrap();
        let mut runs = shared.start(&systems, parameters, &starts).unwrap();
        let mut touched = 0;
        for step in 0..100 {
            let found = runs.energies();
            for (lane, found) in found.iter().enumerate() {
                let from_matrices = runs.lane(lane).energies().unwrap();
                let size = from_matrices.kinetic + from_matrices.elastic;
                let near = |what, a: f64, b: f64| {
                    assert!((a - b).abs() <= 1e-9 * size, "{mass}, step {step}, {what}: {a} {b} of {size}");
                };
                near("kinetic", found.kinetic, from_matrices.kinetic);
                near("elastic", found.elastic, from_matrices.elastic);
                touched += usize::from(runs.lane(lane).record().reaction.iter().any(|r| *r != 0.0));
            }
            runs.advance().unwrap();
        }
        assert!(touched > 10, "{mass}: {touched} steps in contact");
    }
}
