//! Damped stops with the conserving scheme of the modal mass, compared with the closed form of an
//! impact, with the consistent mass, and with balances of energy.

use crate::common::models::PAPER_START;
use crate::common::scenes::{grid, refusal, run, run_to_end, scene};
use rebond::archive::Archive;
use rebond::scheme::Scheme;
use rebond::simulation::Model;

/// A stiff free plate of 6.24 kg comes down on a mat under its whole area.
fn on_a_mat(stiffness: f64, damping: f64, step: f64) -> String {
    let mesh = grid("fvs", 4, 4);
    format!(
        "plate = {{ length = 0.2, width = 0.2, thickness = 0.02, youngs_modulus = 210e9, poissons_ratio = 0.3, \
         density = 7800 }}\n{mesh}\
         obstacle = [{{ side = \"below\", height = -1e-3, stiffness = {stiffness:e}, damping = {damping:e} }}]\n\
         initial = {{ velocity = -0.5 }}\n\
         time = {{ scheme = \"conserving\", mass = \"modal\", modes = 12, step = {step:e}, end = 0.02 }}\n\
         output = {{ every = 1 }}\n"
    )
}

/// A mass that comes with v on a spring and a dashpot (Kelvin and Voigt) leaves where the force
/// vanishes, at tan(w t) = -2 d w / (w^2 - d^2).
#[test]
fn a_plate_leaves_a_mat_as_the_closed_form_says() {
    const MASS: f64 = 7800.0 * 0.2 * 0.2 * 0.02;
    const SPEED: f64 = 0.5;
    for ratio in [0.05, 0.2, 0.6] {
        let stiffness: f64 = 1.54e6;
        let w0 = (stiffness * 0.04 / MASS).sqrt();
        let d = ratio * w0;
        let w = (w0 * w0 - d * d).sqrt();
        let end = (2.0 * d * w).atan2(d * d - w * w) / w;
        let speed = -SPEED * (-d * end).exp() * ((w * end).cos() - d / w * (w * end).sin());
        let text =
            on_a_mat(stiffness, 2.0 * ratio * w0 * MASS / 0.04, 2e-5).replace("end = 0.02", "end = 0.2");
        let (rows, outcome) = run_to_end(&text);
        let last = rows.last().unwrap();
        assert!(outcome.contact_steps > 0 && last.contact_force == 0.0);
        let kept = last.energy / (0.5 * MASS * SPEED * SPEED);
        let known = (speed / SPEED).powi(2);
        println!("{ratio}: {kept} of the energy for {known}, kkt {:e}", outcome.worst_kkt);
        assert!((kept - known).abs() <= 1e-4 * known, "{ratio}: {kept} for {known}");
        assert!(outcome.worst_kkt <= 1e-12);
        let pressed = rows.iter().filter(|row| row.contact_force > 0.0);
        let left = pressed.map(|row| row.time).fold(0.0, f64::max);
        assert!((left - 2e-3 - end).abs() <= 4e-5, "{ratio}: {left}");
    }
}

/// While a rigid plate is on the mat, damping and the mat take energy as alpha m to c; before,
/// damping has braked the plate from v to v less alpha times the way. The ledger has both, and
/// their sum is what the plate has lost.
#[test]
fn damping_and_a_mat_share_the_energy_as_their_coefficients() {
    const MASS: f64 = 7800.0 * 0.2 * 0.2 * 0.02;
    let (alpha, damping, speed) = (40.0, 2e4, 0.5);
    let text = on_a_mat(1.54e6, damping, 2e-6).replace("end = 0.02", "end = 0.006");
    let scene = scene(&format!("{text}damping = {{ mass = {alpha} }}\n"));
    let model = Model::new(&scene).unwrap();
    let mut scheme = model.scheme(&scene).unwrap();
    let start = scheme.energies().unwrap().total();
    while scheme.time() < 0.006 - 1e-9 {
        scheme.advance().unwrap();
    }
    let ledger = scheme.statistics().relaxation.unwrap();
    let [stops, plate] = [ledger.dissipated_by_stops, ledger.dissipated - ledger.dissipated_by_stops];
    let lost = start - scheme.energies().unwrap().total();
    assert!((stops + plate - lost).abs() <= 1e-12 * start, "{stops} + {plate} for {lost}");
    let braked = 0.5 * MASS * (speed * speed - (speed - alpha * 1e-3_f64).powi(2));
    let ratio = (plate - braked) / stops / (alpha * MASS / (damping * 0.04));
    println!("{stops} and {plate} J of {start} J, {ratio} of the closed form");
    assert!((ratio - 1.0).abs() <= 2e-3, "{ratio}");
}

/// The paper's plate between damped stops at points.
fn between_stops(stiffness: f64, damping: f64, time: &str) -> String {
    let stop = format!("stiffness = {stiffness:e}, damping = {damping:e}");
    let mesh = grid("fvs", 10, 4);
    format!(
        "{PAPER_START}{mesh}obstacle = [{{ side = \"below\", height = -0.1, at = [1.2, 0], {stop} }}, \
         {{ side = \"above\", height = 0.15, at = [0.6, 0.2], {stop} }}]\ntime = {{ {time} }}\n\
         output = {{ every = 1, probes = [{{ name = \"corner\", at = [1.2, 0] }}] }}\n"
    )
}

/// The plate loses as much as the dashpots take, at any step and any ratio of the two.
#[test]
fn energy_and_what_the_dashpots_take_are_constant() {
    for (stiffness, damping) in [(1e4, 10.0), (1e6, 100.0), (1e6, 1e5), (1e9, 1e5)] {
        let time = "scheme = \"conserving\", mass = \"modal\", modes = 40, step = 1e-4, end = 0.3";
        let model = Model::new(&scene(&between_stops(stiffness, damping, time))).unwrap();
        let scene = scene(&between_stops(stiffness, damping, time));
        let mut scheme = model.scheme(&scene).unwrap();
        let start = scheme.energies().unwrap().total();
        let (mut last, mut drift) = (start, 0.0_f64);
        let taken = |scheme: &dyn Scheme| scheme.statistics().relaxation.unwrap().dissipated;
        while scheme.time() < 0.3 - 1e-9 {
            scheme.advance().unwrap();
            let total = scheme.energies().unwrap().total();
            assert!(total <= last + 1e-12 * start, "{stiffness:e}, {damping:e}: {total} after {last}");
            last = total;
            drift = drift.max(((total + taken(&*scheme)) / start - 1.0).abs());
        }
        println!("{stiffness:e}, {damping:e}: {:e} taken, drift {drift:e}", taken(&*scheme) / start);
        assert!(drift <= 1e-12, "{stiffness:e}, {damping:e}: {drift:e}");
        assert!(taken(&*scheme) > 1e-3 * start, "{stiffness:e}, {damping:e}");
    }
}

/// Both elements of the model, the modes and the rule of the step, converge to the motion of the
/// consistent mass in Newmark's scheme.
#[test]
fn more_modes_approach_the_consistent_mass() {
    let corner = |time: &str| run(&between_stops(1e5, 300.0, time)).last().unwrap().probes[0];
    let consistent = corner("scheme = \"newmark\", mass = \"consistent\", step = 1e-6, end = 0.07");
    let error = |modes: usize| {
        let time =
            format!("scheme = \"conserving\", mass = \"modal\", modes = {modes}, step = 2e-6, end = 0.07");
        (corner(&time) - consistent).abs()
    };
    let errors = [6, 12, 24].map(error);
    println!("{errors:?}");
    assert!(errors.windows(2).all(|pair| pair[1] <= 0.5 * pair[0]), "{errors:?}");
}

/// A run that is saved in contact goes on to the bit.
#[test]
fn a_restored_scheme_goes_on_to_the_bit() {
    goes_on_to_the_bit("scheme = \"conserving\", mass = \"modal\", modes = 40, step = 5e-5, end = 0.2");
    goes_on_to_the_bit("scheme = \"newmark\", mass = \"singular\", step = 1e-4, end = 0.2");
}

fn goes_on_to_the_bit(time: &str) {
    let scene = scene(&between_stops(1e5, 300.0, time));
    let model = Model::new(&scene).unwrap();
    let mut scheme = model.scheme(&scene).unwrap();
    while scheme.reaction().iter().all(|r| *r == 0.0) {
        scheme.advance().unwrap();
    }
    let mut archive = Archive::Saves(Vec::new());
    scheme.archive(&mut archive).unwrap();
    let mut resumed = model.scheme(&scene).unwrap();
    let entries = archive.into_entries().into_iter();
    resumed.archive(&mut Archive::Restores { entries, same_processes: true }).unwrap();
    for _ in 0..400 {
        scheme.advance().unwrap();
        resumed.advance().unwrap();
        let bits = |scheme: &dyn Scheme| -> Vec<u64> {
            let taken = scheme.dissipated_by_obstacles();
            let values = scheme.displacement().iter().chain(scheme.reaction()).chain(scheme.impulses());
            values
                .chain(&taken)
                .map(|x| x.to_bits())
                .chain([scheme.energies().unwrap().total().to_bits()])
                .collect()
        };
        assert!(bits(&*resumed) == bits(&*scheme));
    }
}

/// The dashpots of each stop take the same in all schemes, and with nothing else to take energy
/// this is what the plate loses, up to the energy that the paper's midpoint scheme keeps in its
/// massless part.
#[test]
fn each_stop_takes_the_same_in_every_scheme() {
    let shares = |time: &str| {
        let text = between_stops(1e4, 100.0, &format!("{time}, end = 0.3"))
            .replace("height = 0.15", "height = 0.02");
        let (rows, outcome) = run_to_end(&text);
        let taken = ["obstacle_1", "obstacle_2"].map(|name| outcome.dissipated[name] / rows[0].energy);
        let lost = 1.0 - rows.last().unwrap().energy / rows[0].energy;
        println!("{time}: {taken:?}, {lost}");
        assert!(taken[0] > 0.1 && taken[1] > 1e-3, "{time}: {taken:?}");
        (taken, lost - taken[0] - taken[1])
    };
    let (known, _) = shares("scheme = \"conserving\", mass = \"modal\", modes = 40, step = 5e-5");
    for (time, gap) in [
        ("scheme = \"newmark\", mass = \"singular\", step = 5e-5", 1e-3),
        ("scheme = \"newmark\", mass = \"consistent\", step = 5e-5", 1e-3),
        ("scheme = \"midpoint\", massless = \"reflected\", mass = \"singular\", step = 5e-5", 1e-2),
    ] {
        let (taken, rest) = shares(time);
        assert!(rest.abs() <= gap, "{time}: {rest:e}");
        for (taken, known) in taken.into_iter().zip(known) {
            assert!((taken - known).abs() <= 0.05 * known, "{time}: {taken} for {known}");
        }
    }
}

#[test]
fn other_schemes_refuse_them_by_name() {
    for (scheme, words) in [
        ("scheme = \"exact\", mass = \"modal\", modes = 30", "expected 0, or time.scheme = \"conserving\""),
        ("scheme = \"conserving\", mass = \"singular\"", "\"conserving\" with time.mass = \"modal\""),
    ] {
        let text = between_stops(1e5, 300.0, &format!("{scheme}, step = 1e-4, end = 0.1"));
        let error = refusal(&text).to_string();
        assert!(error.contains("obstacle.0.damping: ") && error.contains(words), "{error}");
    }
}
