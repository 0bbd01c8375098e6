//! Forces by name: which of several moving obstacles exerts a force, a strip whose deflection,
//! moment and stress are known in closed form, and the summary of one mass at a stop.

use crate::common::models::{STRIP, UNIT};
use crate::common::momentum::force_rows;
use crate::common::scenes::{close, grid, run, run_to_end, scene};
use rebond::simulation::{self, Model, NamedForce, ObstacleForce};

/// A plate at rest on one obstacle is taken over by another that rises faster, on either side: the
/// whole force belongs to the first one before, and to the second one after.
#[test]
fn the_nearest_of_moving_obstacles_exerts_the_force() {
    for (side, sign, more) in [("below", 1.0, ""), ("above", -1.0, ""), ("below", 1.0, ", stiffness = 1e5")] {
        for scheme in ["newmark", "midpoint", "conserving"] {
            // The heights cross at t = 0.02 s.
            let text = format!(
                "{UNIT}{}obstacle = [\
                 {{ name = \"first\", side = \"{side}\", height = \"{sign:?}*0.05*t\"{more} }}, \
                 {{ name = \"second\", side = \"{side}\", height = \"{sign:?}*(-0.001 + 0.1*t)\", where = \"x < 2\" }}, \
                 {{ name = \"away\", side = \"{side}\", height = \"{sign:?}*(-0.002 - t)\", where = \"y < 2\" }}]\n\
                 initial.velocity = \"{sign:?}*0.05\"\nload.pressure = \"-10*{sign:?}\"\n\
                 time = {{ scheme = \"{scheme}\", mass = \"singular\", step = 1e-3, end = 0.05 }}\noutput.every = 1\n",
                grid("fvs", 3, 3),
            );
            let scene = scene(&text);
            let model = Model::new(&scene).unwrap_or_else(|error| panic!("{error}\n{text}"));
            let rows = force_rows(&scene, &model, &simulation::condensed).unwrap();
            let mut impulses = [0.0; 2];
            for (n, row) in rows.iter().enumerate().skip(1) {
                let [first, of_first, second, of_second, away, of_away] = row[..] else { panic!("{row:?}") };
                assert_eq!((away, of_away), (0.0, 0.0), "step {n}\n{text}");
                assert!(sign * first >= 0.0 && sign * second >= 0.0, "step {n}: {row:?}\n{text}");
                // A compliant stop yields, and both then push.
                if n < 20 && more.is_empty() {
                    assert_eq!((second, of_second), (0.0, 0.0), "step {n}: {row:?}\n{text}");
                }
                if n > 21 && more.is_empty() {
                    assert_eq!((first, of_first), (0.0, 0.0), "step {n}: {row:?}\n{text}");
                }
                impulses[0] += of_first;
                impulses[1] += of_second;
            }
            assert!(impulses.iter().all(|of| sign * of > 0.15), "{impulses:?}\n{text}");
        }
    }
}

/// A cantilever strip bent by a force P at its tip: deflection P L^3 / (3 EI), at the clamp the
/// force P, the moment P L and the stress 6 P L / (b h^2).
#[test]
fn a_strip_loaded_at_its_tip() {
    // L = 1 m, b = 0.1 m, h = 1 m, EI = 0.1 N m2.
    let (force, length, width, rigidity) = (0.3, 1.0_f64, 0.1, 0.1);
    let tip = -force * length.powi(3) / (3.0 * rigidity);
    let moment = force * length;
    // Half the force at each of two points of the tip has the work of a force spread along it.
    let gauss = 0.05 / 3.0_f64.sqrt();
    for element in ["fvs", "hct"] {
        let text = format!(
            "{STRIP}{}support = [{{ name = \"clamp\", edge = \"left\", kind = \"clamped\" }}]\n\
             load.force = [{{ at = [1, {:?}], value = -0.15 }}, {{ at = [1, {:?}], value = -0.15 }}]\n\
             initial.equilibrium = true\n\
             time = {{ scheme = \"newmark\", mass = \"singular\", step = 1e-3, end = 1e-3 }}\n\
             output = {{ every = 1, probes = [{{ name = \"tip\", at = [1, 0.05] }}, {{ name = \"bend\", at = [0, 0.05], quantity = \"moment_xx\" }}, \
             {{ name = \"top\", at = [0, 0.05], quantity = \"stress_xx_top\" }}] }}\n",
            grid(element, 10, 1),
            0.05 - gauss,
            0.05 + gauss,
        );
        let start = &run(&text)[0];
        let scene = scene(&text);
        let model = Model::new(&scene).unwrap();
        let forces = &force_rows(&scene, &model, &simulation::condensed).unwrap()[0];
        // The cubic deflection is one of the quadrilaterals' own.
        let [exact, bent] = if element == "fvs" { [1e-9, 1e-9] } else { [2e-3, 3e-2] };
        close("tip", start.probes[0], tip, exact);
        close("shear", forces[0], force, 1e-9);
        close("moment at the clamp", forces[3].abs(), moment, 1e-9);
        close("moment", start.probes[1].abs(), moment / width, bent);
        close("stress", start.probes[2].abs(), 6.0 * moment / width, bent);
    }
}

/// A rigid plate of 100 kg on a foundation of 1e4 N/m falls at 1 m/s onto a stop of 1e6 N/m. It is
/// the mass of code_aster's test SDND101: each contact lasts 0.0312600 s and gives 198.020 N s with
/// 9950.37 N at most. Between two contacts the plate makes half a vibration, of 0.314159 s. The
/// summary of the obstacle tells all of this, with the speed and the energy of the approach.
#[test]
fn the_summary_of_an_obstacle_is_that_of_one_mass_at_a_stop() {
    for (scheme, mass, step) in [
        ("midpoint", "consistent", 2e-5),
        ("conserving", "singular", 2e-5),
        ("newmark", "singular", 2e-5),
        ("exact", "singular", 1e-4),
    ] {
        let text = format!(
            "plate = {{ length = 0.5, width = 0.5, thickness = 0.1, youngs_modulus = 2e15, poissons_ratio = 0.3, \
             density = 4000 }}\n{}foundation = [{{ stiffness = 4e4 }}]\n\
             obstacle = [{{ name = \"stop\", side = \"below\", height = 0, stiffness = 4e6 }}]\n\
             initial.velocity = 1\n\
             time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = {step:?}, end = 0.7 }}\n",
            grid("fvs", 2, 2)
        );
        let outcome = run_to_end(&text).1;
        let NamedForce::Obstacle(stop) = &outcome.forces["stop"] else { panic!("{outcome:?}") };
        let ObstacleForce { peak, time_of_peak, impulse, impacts, time_in_contact, .. } = *stop;
        let hardest = stop.hardest.unwrap();
        println!("{scheme}: {stop:?}");
        let half = 0.1 * std::f64::consts::PI;
        let is_near = |time: f64, first: f64| {
            let second = first + half + 0.0312600;
            (time - first).abs().min((time - second).abs()) <= 1.5 * step
        };
        assert_eq!(impacts, 2, "{scheme}");
        close("peak", peak, 9950.37, 1e-5);
        assert!(is_near(time_of_peak.unwrap(), half + 0.0156300), "{scheme}: {time_of_peak:?}");
        close("impulse", impulse, 2.0 * 198.020, 1e-5);
        let most = if scheme == "exact" { 1e-7 } else { 4.0 * step };
        assert!((time_in_contact - 2.0 * 0.0312600).abs() <= most, "{scheme}: {time_in_contact}");
        close("impulse of the hardest", hardest.impulse, 198.020, 1e-5);
        assert!(is_near(hardest.time, half), "{scheme}: {}", hardest.time);
        close("approach", hardest.approach_velocity, -1.0, 1e-5);
        // Within a step the spring takes a part of the energy that is of second order.
        close("kinetic energy", hardest.kinetic_energy, 50.0, 1e-4);
    }
}
