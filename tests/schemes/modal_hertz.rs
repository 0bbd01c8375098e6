//! Stops by the law of Hertz with the modal mass, compared with the closed form of an impact, with
//! the consistent mass, with the rigid obstacle, and with balances of energy.

use crate::common::scenes::run;
use crate::hertz::{assert_energy_is_kept, assert_invariant_never_rises, between_pins, errors_of_bounces};

/// A ball bounces off the clamped edge as the closed form says. The plate has no compliance there,
/// so that the law alone yields.
#[test]
fn a_ball_bounces_off_a_held_point() {
    for stiffness in [1e3, 1e6, 1e9, 1e12, 1e15] {
        for (scheme, energy) in [
            ("scheme = \"conserving\", mass = \"modal\", modes = 8", 1e-12),
            ("scheme = \"midpoint\", mass = \"modal\", modes = 8", 1e-4),
            ("scheme = \"newmark\", mass = \"modal\", modes = 8, restitution = 1", 2e-4),
        ] {
            let errors = errors_of_bounces(stiffness, scheme, energy);
            let order = (errors[0] / errors[1]).log2();
            println!("{stiffness:e}, {scheme}: order {order}: {errors:?}");
            // The conserving scheme divides steps that are longer than a tenth of the fastest
            // period; the shorter of the two is then that of the longer one.
            let divides = scheme.contains("conserving") && stiffness < 1e6;
            let is_second = if divides { order == 0.0 } else { (order - 2.0).abs() <= 0.3 };
            assert!(is_second && errors[1] <= 1e-4, "{stiffness:e}, {scheme}: order {order}: {errors:?}");
        }
    }
}

#[test]
fn the_conserving_scheme_keeps_the_energy_for_two_seconds() {
    assert_energy_is_kept("mass = \"modal\", modes = 40");
}

#[test]
fn the_invariant_of_newmark_never_rises() {
    assert_invariant_never_rises("mass = \"modal\", modes = 40");
}

/// Returns the place of a corner after the first contact.
fn corner(stiffness: f64, time: &str) -> f64 {
    let text = between_pins(stiffness, &format!("{time}, end = 0.07"));
    run(&text).last().unwrap().probes[0]
}

/// All schemes converge to one motion through several contacts.
#[test]
fn schemes_agree() {
    let of = |time: &str| corner(1e7, &format!("{time}, mass = \"modal\", modes = 40"));
    let reference = of("scheme = \"conserving\", step = 1e-6");
    for (scheme, tolerance) in [
        ("scheme = \"conserving\", step = 5e-6", 1e-6),
        ("scheme = \"midpoint\", step = 5e-6", 1e-6),
        ("scheme = \"newmark\", restitution = 1, step = 5e-6", 1e-6),
        ("scheme = \"newmark\", step = 5e-6", 1e-4),
    ] {
        let error = (of(scheme) - reference).abs();
        println!("{scheme}: {error:e}");
        assert!(error <= tolerance, "{scheme}: {error:e}");
    }
}

/// With more and more modes the motion becomes that of the consistent mass.
#[test]
fn more_modes_approach_the_consistent_mass() {
    let consistent = corner(1e5, "scheme = \"midpoint\", mass = \"consistent\", step = 2e-6");
    let error = |modes: usize| {
        let time = format!("scheme = \"conserving\", mass = \"modal\", modes = {modes}, step = 2e-6");
        (corner(1e5, &time) - consistent).abs()
    };
    let errors = [6, 12, 24].map(error);
    println!("{errors:?}");
    assert!(errors.windows(2).all(|pair| pair[1] <= 0.5 * pair[0]), "{errors:?}");
}

/// Stiff stops converge to the rigid obstacle.
#[test]
fn a_stiff_stop_is_a_rigid_obstacle() {
    let time = "scheme = \"conserving\", mass = \"modal\", modes = 40, step = 2e-6";
    let rigid = {
        let text = between_pins(1.0, &format!("{time}, end = 0.07"));
        let law = "law = \"hertz\", stiffness = 1e0";
        assert!(text.contains(law));
        run(&text.replace(&format!(", {law}"), "")).last().unwrap().probes[0]
    };
    let errors = [10, 11, 12, 13].map(|power| (corner(10f64.powi(power), time) - rigid).abs());
    println!("{errors:?}");
    assert!(errors.windows(2).all(|pair| pair[1] <= 0.5 * pair[0]), "{errors:?}");
}
