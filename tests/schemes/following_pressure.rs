//! Pressures that depend on the deflection: equilibria and their end in closed form, and the energy
//! in time.

use crate::common::scenes::{close, grid, inspect, model, newmark, refusal, run, run_until_it_ends, scene};
use rebond::Error;
use rebond::field::{Field, Names};
use rebond::geometry::Point;
use rebond::scene::FieldInput;

const EPSILON: f64 = 8.854e-12;

/// A stiff square of 1 m2 on a foundation of k = 1 MN/m, over an electrode at 1 mm: a piston.
fn piston(volts: f64, element: &str, more: &str) -> String {
    format!(
        "plate = {{ length = 1, width = 1, thickness = 0.1, youngs_modulus = 200e9, poissons_ratio = 0.3, \
         density = 1000 }}\n{}foundation = [{{ stiffness = 1e6 }}]\nparameters.v = {volts:?}\n\
         load.pressure = \"-0.5*{EPSILON:e}*v^2/(1e-3 + w)^2\"\ninitial.equilibrium = true\n{}\
         output = {{ probes = [{{ name = \"c\", at = [0.3, 0.6] }}] }}\n{more}\n",
        grid(element, 2, 2),
        newmark("consistent", 1e-4, 1e-3)
    )
}

/// A piston is pulled in at a third of its gap, at `$V^2 = 8 k g^3 / (27 \varepsilon A)$`.
#[test]
fn a_piston_is_pulled_in_at_a_third_of_its_gap() {
    let square = 8.0 * 1e6 * 1e-9 / (27.0 * EPSILON);
    for element in ["fvs", "hct"] {
        let factor = inspect(&piston(3000.0, element, "")).pull_in_factor.unwrap();
        close("pull-in", factor, square / 9e6, 2e-4);
        // k w (g + w)^2 = -eps V^2 / 2
        let rows = run(&piston(5000.0, element, ""));
        let w = rows[0].probes[0];
        close("equilibrium", -1e6 * w * (1e-3 + w).powi(2), 0.5 * EPSILON * 25e6, 1e-9);
        assert!(rows.iter().all(|row| row.kinetic <= 1e-16 * rows[0].elastic));
        let near = run(&piston((0.9999 * square).sqrt(), element, ""))[0].probes[0];
        assert!((-1e-3 / 3.0..-3.2e-4).contains(&near), "{near}");
        let error = refusal(&piston((1.05 * square).sqrt(), element, "")).to_string();
        assert!(error.contains("pulls the plate in") && error.contains("0.952"), "{error}");
        // On a stop before the electrode it rests.
        let stop = "obstacle = [{ side = \"below\", height = -6e-4 }]";
        let stopped = run(&piston((1.05 * square).sqrt(), element, stop));
        // The plate bends a little between the nodes.
        close("stopped", stopped[0].probes[0], -6e-4, 1e-4);
        let force = 0.5 * EPSILON * 1.05 * square / 0.16e-6 - 600.0;
        close("force", stopped[0].contact_force, force, 1e-4);
    }
}

/// A clamped strip is pulled in at `$\varepsilon V^2 L^4 / (2 D g^3) = 70.095$` (finite differences,
/// extrapolated).
#[test]
fn a_clamped_strip_is_pulled_in_as_a_beam() {
    let factor = |cells: usize| {
        let text = format!(
            "plate = {{ length = 1, width = 0.1, thickness = 1e-2, youngs_modulus = 12e6, poissons_ratio = 0, density = 100 }}\n\
             support = [{{ edge = \"left\", kind = \"clamped\" }}, {{ edge = \"right\", kind = \"clamped\" }}]\n{}\
             load.pressure = \"-50/(1 + w)^2\"\n{}",
            grid("fvs", cells, 1),
            newmark("singular", 1e-3, 1e-3)
        );
        50.0 * inspect(&text).pull_in_factor.unwrap()
    };
    let [coarse, fine] = [6, 12].map(factor);
    println!("{coarse}, {fine}");
    assert!((coarse - 70.095).abs() >= 2.0 * (fine - 70.095).abs(), "{coarse}, {fine}");
    close("pull-in", fine, 70.095, 5e-3);
}

/// The invariant with the work of the pressure never rises through impacts, and the work is that of
/// the pressure to the second order of the step.
#[test]
fn the_invariant_of_newmark_never_rises() {
    let mut off = Vec::new();
    for step in [4e-5, 2e-5] {
        let text = piston(3000.0, "fvs", "obstacle = [{ side = \"below\", height = -6e-5 }]")
            .replace("initial.equilibrium = true\n", "")
            .replace(
                "mass = \"consistent\", step = 0.0001, end = 0.001",
                &format!("mass = \"singular\", step = {step:?}, end = 0.06"),
            );
        let (scene, model) = (scene(&text), model(&text));
        let mut scheme = model.scheme(&scene).unwrap();
        let mut last = scheme.invariant().unwrap();
        let (mut touched, mut worst) = (false, 0.0_f64);
        let potential = |w: f64| -0.5 * EPSILON * 9e6 * (1.0 / (1e-3 + w) - 1e3);
        while scheme.time() < 0.06 {
            scheme.advance().unwrap();
            let energies = scheme.energies().unwrap();
            let now = scheme.invariant().unwrap();
            assert!(
                now - last <= 1e-12 * energies.elastic.max(energies.kinetic).max(1e-6),
                "{:e}",
                now - last
            );
            last = now;
            if !touched {
                let w = scheme.displacement()[0];
                worst = worst.max((energies.work + potential(w)).abs() / energies.work.abs().max(1e-4));
            }
            touched |= scheme.reaction().iter().any(|r| *r != 0.0);
        }
        assert!(touched);
        off.push(worst);
    }
    println!("{off:?}");
    assert!(off[1] <= 0.35 * off[0] && off[1] <= 1e-2, "{off:?}");
}

/// Plate, springs and the potential of the pressure add up to what they were, through impacts.
#[test]
fn the_conserving_scheme_counts_the_potential() {
    for step in [2e-4, 5e-5] {
        let text = piston(3000.0, "fvs", "obstacle = [{ side = \"below\", height = -6e-5 }]")
            .replace("initial.equilibrium = true\n", "")
            .replace(
                "scheme = \"newmark\", mass = \"consistent\", step = 0.0001, end = 0.001",
                &format!("scheme = \"conserving\", mass = \"singular\", step = {step:e}, end = 0.1"),
            );
        let (scene, model) = (scene(&text), model(&text));
        let mut scheme = model.scheme(&scene).unwrap();
        let potential = |w: f64| -0.5 * EPSILON * 9e6 * (1.0 / (1e-3 + w) - 1e3);
        let (mut contacts, mut is_free) = (0, true);
        while scheme.time() < 0.1 {
            scheme.advance().unwrap();
            let energies = scheme.energies().unwrap();
            let scale = energies.elastic.max(energies.work);
            assert!(energies.total().abs() <= 1e-12 * scale, "{step}: {energies:?}");
            is_free &= scheme.reaction().iter().all(|r| *r == 0.0);
            if is_free {
                close("work", energies.work, -potential(scheme.displacement()[0]), 1e-4);
            }
            contacts += usize::from(scheme.reaction().iter().any(|r| *r != 0.0));
        }
        assert!(contacts > 3, "{contacts}");
    }
}

/// A voltage that changes in time: the motion is of second order in the step.
#[test]
fn motions_under_a_load_in_time_converge_with_order_two() {
    let last = |step: f64| {
        let text = piston(3000.0, "hct", "")
            .replace("initial.equilibrium = true\n", "")
            .replace("*v^2", "*(v*sin(150*t))^2")
            .replace(
                "scheme = \"newmark\", mass = \"consistent\", step = 0.0001, end = 0.001",
                &format!("scheme = \"conserving\", mass = \"singular\", step = {step:e}, end = 0.08"),
            );
        let rows = run(&text);
        rows[rows.len() - 1].probes[0]
    };
    let [a, b, c] = [2e-4, 1e-4, 5e-5].map(last);
    let order = ((a - b) / (b - c)).abs().log2();
    println!("{order}: {a}, {b}, {c}");
    assert!((1.7..=2.3).contains(&order), "{order}");
}

#[test]
fn what_does_not_follow_is_refused() {
    let time = "time = { scheme = \"newmark\", mass = \"consistent\", step = 0.0001, end = 0.001 }";
    for (other, key) in [
        ("scheme = \"conserving\", mass = \"modal\"", "time.mass"),
        ("scheme = \"exact\", mass = \"singular\"", "time.scheme"),
        ("scheme = \"newmark\", mass = \"modal\"", "time.mass"),
        ("scheme = \"midpoint\", mass = \"singular\"", "time.massless"),
    ] {
        let text = piston(3000.0, "fvs", "");
        assert!(text.contains(time), "{text}");
        let text = text.replace(time, &format!("time = {{ {other}, step = 1e-4, end = 1e-3 }}"));
        let error = refusal(&text).to_string();
        assert!(error.contains(key) && error.contains("depends on w"), "{error}");
    }
    // A parameter of the name hides the deflection.
    let hidden = piston(3000.0, "fvs", "").replace("parameters.v", "parameters.w = 0\nparameters.v");
    assert!(inspect(&hidden).pull_in_factor.is_none());
}

/// Nothing stops a piston whose voltage comes at once: the run ends where it passes the electrode.
#[test]
fn a_piston_that_nothing_stops_ends_its_run_at_the_electrode() {
    let ended = |text: &str| {
        let text = text.replace("initial.equilibrium = true\n", "").replace("end = 0.001", "end = 0.2");
        let (_, outcome, ended) = run_until_it_ends(&text);
        (outcome.largest_deflection, ended)
    };
    let conserving = |text: &str| {
        text.replace(
            "scheme = \"newmark\", mass = \"consistent\"",
            "scheme = \"conserving\", mass = \"singular\"",
        )
    };
    for text in [piston(9e3, "fvs", ""), conserving(&piston(9e3, "fvs", ""))] {
        let (largest, ended) = ended(&text);
        let Err(Error::PulledIn { key, w, .. }) = &ended else { panic!("{ended:?}\n{text}") };
        assert_eq!(key, "load.pressure");
        close("the electrode", *w, -1e-3, 1e-6);
        assert!(largest.unwrap().value < -1e-3, "{largest:?}");
    }
    // Before the electrode nothing is refused, nor where the formula has no pole.
    ended(&piston(3e3, "fvs", "")).1.unwrap();
    ended(&piston(9e3, "fvs", "obstacle = [{ side = \"below\", height = -6e-4 }]")).1.unwrap();
    let (largest, ended) = ended(&piston(9e3, "fvs", "").replace("(1e-3 + w)^2", "max(1e-3 + w, 5e-4)^2"));
    assert!(largest.unwrap().value < -1e-3 && ended.is_ok(), "{largest:?}, {ended:?}");
}

/// Formulas without a pole have none, whatever their bounds are at 0, at kinks and at jumps.
#[test]
fn poles_are_those_of_the_formula() {
    let pole = |formula: &str, w: f64| {
        let field = Field::parse(formula, Names::XYTW).unwrap();
        FieldInput::new("load.pressure", field).of_deflection(0.1).pole(Point::new(0.3, 0.2), w)
    };
    for formula in [
        "-1e9*w",
        "w^3 - 2*w",
        "-2*abs(w)^1.5",
        "-sqrt(abs(w))",
        "-1e3*step(-w - 1e-4)*(-w - 1e-4)^1.5",
        "-1/max(1e-3 + w, 1e-5)^2",
        "if(w > -5e-4, -1/(1e-3 + w)^2, -4e6)",
        "1/(1 + w^2)",
        "exp(-w/1e-4)",
        "-1/(2e-3 + w)^2",
        "sin(w)/cos(w)",
        "min(w, 0)^2*t",
        "1/(1e-3 + abs(w))",
        "x*y*w + mod(w, 1e-4)",
    ] {
        for w in [-1.5e-3, -1e-9, 0.0, 1e-9, 1.5e-3] {
            assert_eq!(pole(formula, w), None, "{formula} to {w}");
        }
    }
    for (formula, w, place) in [
        ("-1/(1e-3 + w)^2", -1.5e-3, -1e-3),
        ("t/(1e-3*(1 + x) + w)", -1.5e-3, -1.3e-3),
        ("1/(1e-3 + w)^2 - 1/(1e-3 - w)^2", 1.5e-3, 1e-3),
    ] {
        close(formula, pole(formula, w).unwrap(), place, 1e-6);
        assert_eq!(pole(formula, 0.99 * place), None, "{formula}");
    }
}
