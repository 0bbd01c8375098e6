//! An elastic bar that hits a wall with period 3: the singular mass where the exact motion is
//! known.
//!
//! The problem is u_tt = u_xx on (0, 1), u(1) = 0, u(0) >= 0, released at rest from u = (1 - x)/2.
//! The tip u(0, t) is 1/2 - t/2, then 0, then (t - 2)/2, on thirds of a period 3; the energy is
//! 1/8. Displacements are quadratic on each cell and velocities constant: the mass is singular, and
//! the pair satisfies the inf-sup condition.
//!
//! These are the expected results, measured here. The KKT conditions hold at every step. With
//! Newmark and e = 0 the invariant H never rises. Tip and energy converge as mesh and step are
//! refined together. At a fixed mesh the restitution ceases to matter as the step goes to 0,
//! because the singular mass needs no law of restitution. The linear start is no equilibrium of the
//! massless modes next to the tip: they oscillate from step to step about one, with an energy of
//! order h, which contact dissipates. On a fixed mesh, therefore, neither error tends to zero with
//! the step alone.

use crate::common::block;
use rebond::linalg::{CellClass, Native, SingularMassCell};
use rebond::obstacle::Bounds;
use rebond::scheme::{
    Conserving, Damping, Exact, Massless, Midpoint, Newmark, NewmarkParameters, Scheme, Solution, Start,
    System, TimeDependence,
};

/// Returns the exact position of the tip.
fn tip(t: f64) -> f64 {
    let t = t.rem_euclid(3.0);
    if t < 1.0 {
        0.5 - 0.5 * t
    } else if t < 2.0 {
        0.0
    } else {
        0.5 * (t - 2.0)
    }
}

/// Returns the discrete bar, u_tt = u_xx on (0, 1) with u(1) = 0 and u(0) >= 0, with `cells`
/// quadratic cells with a constant velocity each.
fn bar(cells: usize) -> System<Native> {
    let h = 1.0 / cells as f64;
    let size = 2 * cells;
    let engine = Native::new(size);
    let dofs = |cell: usize| -> Vec<Option<usize>> {
        (2 * cell..2 * cell + 3).map(|d| (d < size).then_some(d)).collect()
    };
    let k = [7.0, -8.0, 1.0, -8.0, 16.0, -8.0, 1.0, -8.0, 7.0].map(|k| k / (3.0 * h));
    let stiffness = engine.form((0..cells).map(|cell| block(&dofs(cell), &k, 0)).collect());
    let row: std::rc::Rc<[f64]> = [h / 6.0, 4.0 * h / 6.0, h / 6.0].into();
    let mass = engine.averages(
        (0..cells)
            .map(|cell| SingularMassCell {
                dofs: dofs(cell).into(),
                row: row.clone(),
                mass: h,
                class: CellClass::Plate(0),
            })
            .collect(),
    );
    System {
        engine,
        stiffness,
        mass,
        damping: Damping::default(),
        load: None,
        bounds: Bounds::uniform(vec![0], 0.0, f64::INFINITY),
        bound_numbers: None,
        drive: TimeDependence::default(),
    }
}

fn start(cells: usize) -> Start {
    let displacement = (0..2 * cells).map(|d| 0.5 * (1.0 - d as f64 / (2 * cells) as f64)).collect();
    Start { displacement, velocity: vec![0.0; 2 * cells] }
}

fn newmark(system: &System<Native>, cells: usize, e: f64, step: f64) -> Newmark<'_, Native> {
    Newmark::new(system, NewmarkParameters { beta: 0.5, restitution: e, step }, start(cells)).unwrap()
}

/// Returns the number of instants until `end`.
fn count(end: f64, step: f64) -> usize {
    (end / step).round() as usize
}

/// Numbers of cells of the four meshes, whose steps are a tenth of a cell.
const MESHES: [usize; 4] = [10, 20, 40, 80];

/// Asserts that each mesh improves on the one before by at least this factor.
fn falls(name: &str, values: [f64; 4], factor: f64, cap: f64) {
    println!("{name}: {values:.6?}");
    assert!(values.windows(2).all(|pair| pair[0] >= factor * pair[1]), "{name}: {values:?}");
    assert!(values[3] <= cap, "{name}: {values:?}");
}

#[test]
fn the_start_has_the_exact_energy() {
    for cells in MESHES {
        let system = bar(cells);
        let scheme = newmark(&system, cells, 0.0, 0.1 / cells as f64);
        assert!((scheme.energies().unwrap().total() - 0.125).abs() <= 1e-12);
        assert_eq!(scheme.displacement()[0], 0.5);
    }
}

#[test]
fn newmark_converges_and_its_invariant_never_rises() {
    let results = MESHES.map(|cells| {
        let (system, step) = (bar(cells), 0.1 / cells as f64);
        let mut scheme = newmark(&system, cells, 0.0, step);
        let mut invariant = scheme.invariant().unwrap();
        let (mut error, mut loss) = (0.0f64, 0.0f64);
        for _ in 0..count(6.0, step) {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt <= 1e-10);
            assert!(scheme.admissible()[0] >= -1e-14);
            let now = scheme.invariant().unwrap();
            assert!(now <= invariant + 1e-13, "t = {}: {:e}", scheme.time(), now - invariant);
            invariant = now;
            error = error.max((scheme.displacement()[0] - tip(scheme.time())).abs());
            loss = loss.max((1.0 - scheme.energies().unwrap().total() / 0.125).abs());
        }
        assert_eq!(scheme.statistics().factorisations, 2);
        [error, 1.0 - invariant / 0.125, loss]
    });
    falls("Newmark, largest error of the tip", results.map(|r| r[0]), 1.4, 0.025);
    falls("Newmark, loss of H", results.map(|r| r[1]), 1.8, 0.006);
    falls("Newmark, largest loss of E_n", results.map(|r| r[2]), 1.8, 0.006);
}

#[test]
fn midpoint_converges() {
    let results = MESHES.map(|cells| {
        let (system, step) = (bar(cells), 0.1 / cells as f64);
        let mut scheme = Midpoint::new(&system, step, Massless::Reflected, start(cells)).unwrap();
        let (mut error, mut drift) = (0.0f64, 0.0f64);
        for _ in 0..count(6.0, step) {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt <= 1e-10);
            assert!(scheme.admissible()[0] >= -1e-14);
            // The wall bounds the configuration in the middle of the step.
            error = error.max((scheme.admissible()[0] - tip(scheme.time() - 0.5 * step)).abs());
            drift = drift.max((scheme.energies().unwrap().total() / 0.125 - 1.0).abs());
        }
        [error, drift]
    });
    falls("midpoint, largest error of the tip", results.map(|r| r[0]), 1.3, 0.025);
    falls("midpoint, largest change of energy", results.map(|r| r[1]), 1.7, 0.015);
}

/// The conserving scheme starts from the equilibrium of the massless modes, of energy 1/8 - O(h),
/// and conserves this energy.
#[test]
fn the_conserving_scheme_keeps_the_energy_and_converges() {
    let results = MESHES.map(|cells| {
        let (system, step) = (bar(cells), 0.1 / cells as f64);
        let mut scheme = Conserving::new(&system, step, start(cells)).unwrap();
        let energy = scheme.energies().unwrap().total();
        let mut error = 0.0f64;
        for _ in 0..count(12.0, step) {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt <= 1e-10);
            assert!(scheme.displacement()[0] >= -1e-14);
            let drift = (scheme.energies().unwrap().total() / energy - 1.0).abs();
            assert!(drift <= 1e-12, "t = {}: {drift:e}", scheme.time());
            error = error.max((scheme.displacement()[0] - tip(scheme.time())).abs());
        }
        [error, 1.0 - energy / 0.125]
    });
    falls("conserving, largest error of the tip", results.map(|r| r[0]), 1.3, 0.03);
    falls("conserving, energy of the massless modes at the start", results.map(|r| r[1]), 1.9, 0.01);
}

#[test]
fn without_contact_both_schemes_conserve_energy() {
    let cells = 20;
    let mut system = bar(cells);
    system.bounds.lower[0] = -10.0;
    let step = 0.1 / cells as f64;
    let mut scheme = newmark(&system, cells, 0.0, step);
    let invariant = scheme.invariant().unwrap();
    let mut other = Midpoint::new(&system, step, Massless::Reflected, start(cells)).unwrap();
    for _ in 0..count(6.0, step) {
        scheme.advance().unwrap();
        other.advance().unwrap();
        assert!(
            (scheme.invariant().unwrap() - invariant).abs() <= 1e-13,
            "{:e}",
            scheme.invariant().unwrap() - invariant
        );
        assert!(
            (other.energies().unwrap().total() - 0.125).abs() <= 1e-13,
            "{:e}",
            other.energies().unwrap().total() - 0.125
        );
    }
}

#[test]
fn as_the_step_goes_to_zero_the_restitution_ceases_to_matter() {
    let cells = 20;
    let system = bar(cells);
    let results = [0.1, 0.025, 0.00625, 0.0015625].map(|share| {
        let step = share / cells as f64;
        let [mut absorbing, mut elastic] = [0.0, 1.0].map(|e| newmark(&system, cells, e, step));
        let mut apart = 0.0f64;
        // The means are those on which K acts, (U^{n+1} + U^{n-1}) / 2: massless modes oscillate
        // about them from step to step.
        let mut earlier = [[0.5; 2]; 2];
        for n in 0..count(3.0, step) {
            absorbing.advance().unwrap();
            elastic.advance().unwrap();
            let now = [absorbing.displacement()[0], elastic.displacement()[0]];
            let mean = [0, 1].map(|k| 0.5 * (now[k] + earlier[0][k]));
            if n > 0 {
                apart = apart.max((mean[0] - mean[1]).abs());
            }
            earlier = [earlier[1], now];
        }
        apart
    });
    falls("e = 0 from e = 1, tip", results, 1.5, 1e-3);
}

/// The dispersion of the mesh eventually destroys the period of the motion, so some touches more
/// than one per period are correct. They are counted twice: from the events, and by observing the
/// tip at instants some hundred times denser than the fastest period of the coarsest mesh.
#[test]
fn the_exact_scheme_follows_a_hundred_periods_and_misses_no_bounce() {
    // A bounce is a touch after a flight of this length: vibration may lift the tip now and then
    // while it rests.
    const FLIGHT: f64 = 0.5;
    let results = [(10, 1e-3), (20, 1e-3), (40, 5e-3), (80, 5e-3)].map(|(cells, step)| {
        let system = bar(cells);
        let mut scheme = Exact::new(&system, step, start(cells)).unwrap();
        let energy = scheme.energies().unwrap().total();
        let (mut drift, mut error) = (0.0f64, 0.0f64);
        let (mut bounces, mut left) = (0, f64::NEG_INFINITY);
        let (mut seen, mut seen_touching) = (0, f64::NEG_INFINITY);
        let mut open = false;
        for n in 1..=count(300.0, step) {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt <= 1e-11);
            for event in scheme.take_events() {
                assert_eq!(event.closes, !open, "t = {}", event.time);
                open = event.closes;
                if !open {
                    left = event.time;
                } else if event.time - left > FLIGHT {
                    bounces += 1;
                }
            }
            let (gap, reaction, time) = (scheme.admissible()[0], scheme.reaction()[0], scheme.time());
            // A missed event would cause penetration or a pulling reaction.
            assert!(gap >= -1e-14 && reaction >= -1e-12, "t = {time}: {gap:e}, {reaction:e}");
            assert_eq!(reaction != 0.0, open, "t = {time}");
            if reaction != 0.0 {
                seen += u32::from(time - seen_touching > FLIGHT);
                seen_touching = time;
            }
            if n % 10 == 0 {
                drift = drift.max((scheme.energies().unwrap().total() / energy - 1.0).abs());
            }
            if time <= 6.0 {
                error = error.max((scheme.displacement()[0] - tip(time)).abs());
            }
        }
        println!(
            "{cells} cells: E0 {energy}, drift {drift:.1e}, {bounces} bounces, {:?}",
            scheme.statistics().events
        );
        assert!(drift <= 1e-10, "{cells} cells: {drift:e}");
        assert_eq!(bounces, seen, "{cells} cells");
        assert!((100..=103).contains(&bounces), "{cells} cells: {bounces}");
        // At the start the massless modes go to their equilibrium at once, which takes a part of
        // order h of the energy.
        assert!(energy <= 0.125 && energy >= 0.125 * (1.0 - 1.0 / cells as f64), "{cells} cells: {energy}");
        error
    });
    falls("exact, largest error of the tip over two periods", results, 1.3, 0.025);
}
