//! Checks warn of parts of loads and motions that the time steps miss.

use crate::common::models::{CLAMPED, STRIP};
use crate::common::scenes::{grid, newmark, scene};
use rebond::study;
use std::fs;
use std::path::PathBuf;

/// Returns the warnings of a check of a strip with steps of 1 ms, 1 s long, that concern one of its
/// keys.
fn warnings(more: &str, key: &str) -> Vec<String> {
    let text = format!(
        "{STRIP}{}support = [{{ edge = \"left\", kind = \"clamped\" }}]\n{}{more}\n",
        grid("fvs", 2, 1),
        newmark("singular", 1e-3, 1.0)
    );
    let all = study::check(&scene(&text)).unwrap().warnings;
    all.into_iter().filter(|warning| warning.starts_with(key)).collect()
}

fn of_pressure(pressure: &str) -> Vec<String> {
    warnings(&format!("load.pressure = {pressure}"), "load.pressure")
}

#[test]
fn impulses_that_steps_miss_are_said() {
    for (pressure, words) in [
        // The pulses are: one between two instants, one of three steps, a smooth one, one on a long
        // load, and one that an instant overestimates.
        ("\"1e6*step(t - 0.5002)*step(0.5008 - t)\"", ["t = 0.501 s", "100 %"]),
        ("\"1e3*step(t - 0.5009)*step(0.5031 - t)\"", ["t = 0.50", "%"]),
        ("\"1e6*exp(-((t - 0.30042)/1e-5)^2)\"", ["t = 0.301 s", "100 %"]),
        ("\"100 + 1e6*step(t - 0.5002)*step(0.5008 - t)\"", ["t = 0.501 s", "%"]),
        ("\"1e6*step(t - 0.49999)*step(0.50001 - t)\"", ["t = 0.5", "%"]),
        // The oscillations have three steps per period: a plain one, a growing one, and a product
        // with place. The last load is no sum of products.
        ("\"sin(2*pi*t/0.003)\"", ["t = ", "%"]),
        ("\"exp(5*t)*sin(2*pi*t/0.003)\"", ["t = ", "%"]),
        ("\"x*y*sin(2*pi*t/0.003) + 1e-3*x\"", ["t = ", "%"]),
        ("\"exp(-((x - 500*t + 200)/0.1)^2)\"", ["t = 0.4", "%"]),
    ] {
        let said = of_pressure(pressure);
        assert_eq!(said.len(), 1, "{pressure}: {said:?}");
        for word in words {
            assert!(said[0].contains(word), "{pressure}: {said:?}");
        }
    }
    let force = "load.force = [{ at = [1, 0], value = \"5*step(t - 0.10003)*step(0.1001 - t)\" }]";
    let said = warnings(force, "load.force.0.value");
    assert!(said.len() == 1 && said[0].contains("t = 0.101 s"), "{said:?}");
}

#[test]
fn loads_that_steps_see_pass() {
    for pressure in [
        "\"100*sin(2*pi*t/0.02)\"",
        "\"100*sin(2*pi*t/0.02)^3 + 5*t\"",
        "\"300*step(sin(2*pi*5*t))\"",
        "\"1e3*step(t - 0.5004)*step(0.5334 - t)\"",
        "\"1e3*max(0, t - 0.5004)\"",
        "\"(4e4*max(0, sin(2*pi*50*t)) - 2e3)*step(x - 0.5)\"",
        "\"exp(-((t - 0.5)/0.01)^2)\"",
        "\"exp(-((x - 3*t)/0.1)^2)\"",
        "\"if(t < 0.5, 1e3*t, 500*exp(-10*(t - 0.5)))\"",
        "\"1 - 1e-5*t\"",
    ] {
        assert_eq!(of_pressure(pressure), [""; 0], "{pressure}");
    }
}

/// The work is bounded for any number of steps; a search that examined each of them would take
/// minutes.
#[test]
fn long_runs_are_looked_at_too() {
    use rebond::field::{Field, Names};
    use rebond::mesh::Point;
    let missed =
        |text: &str| Field::parse(text, Names::T).unwrap().missed(Point::origin(), 0.0, 1e-6, 1_000_000_000);
    let pulse = missed("1e3 + 1e9*exp(-((t - 777.7777777)/1e-8)^2)").unwrap();
    assert!((pulse.time - 777.777778).abs() < 1e-9 && pulse.share > 0.9, "{pulse:?}");
    let pulse = missed("step(t - 123.4567894)*step(123.4567896 - t)").unwrap();
    assert!((pulse.time - 123.45679).abs() < 1e-9 && pulse.share > 0.9, "{pulse:?}");
    assert!(missed("sin(2*pi*3e5*t)").is_some());
    assert!(missed("sin(2*pi*50*t) + step(sin(t))").is_none());
}

#[test]
fn tables_are_looked_at_too() {
    let file = |name: &str, rows: &str| {
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
        fs::write(&path, rows).unwrap();
        path.to_string_lossy().into_owned()
    };
    let table = |file: &str, interpolation: &str| {
        format!("{{ table = '{file}', interpolation = \"{interpolation}\" }}")
    };
    let hammer = file("hammer.csv", "0,0\n0.3001,0\n0.3004,1e5\n0.3009,0\n");
    let said = of_pressure(&table(&hammer, "linear"));
    assert!(said.len() == 1 && said[0].contains("t = 0.301 s"), "{said:?}");
    let slow = file("slow.csv", "0,0\n0.2,10\n0.5,-3\n0.6,1\n");
    for interpolation in ["linear", "spline"] {
        assert_eq!(of_pressure(&table(&slow, interpolation)), [""; 0]);
    }
    // A spline through 0, 0, 1, 0, 0 in rows of uneven spacing goes far beyond these values.
    let rough = file("rough.csv", "0,0\n0.4,0\n0.4001,1\n0.8,0\n");
    let moves = format!("obstacle = [{{ side = \"below\", height = {} }}]", table(&rough, "spline"));
    let said: Vec<_> =
        warnings(&moves, "obstacle.0.height").into_iter().filter(|said| said.contains("spline")).collect();
    assert!(said.len() == 1 && said[0].contains("beyond the table's values by"), "{said:?}");
}

#[test]
fn motions_between_instants_are_said() {
    let height = |height: &str| {
        warnings(&format!("obstacle = [{{ side = \"below\", height = \"{height}\" }}]"), "obstacle.0.height")
    };
    assert_eq!(height("-0.1 + 0.09*sin(2*pi*20*t)"), [""; 0]);
    assert_eq!(height("-0.1 + 0.3*clamp(3*t, 0, 1)"), [""; 0]);
    let said = height("-0.1 + 0.3*exp(-((t - 0.5004)/2e-5)^2)");
    assert!(said.len() == 1 && said[0].contains("t = 0.501 s"), "{said:?}");
}

#[test]
fn the_largest_load_lies_between_any_instants() {
    // Magnitude of the peak (N) by calculus: a hammer's pulse of 80 us, a sine of which a thousand
    // instants see no peak, one that decays, and a jump at the end of a ramp.
    let text = "t,F\n0,0\n0.0123,0\n0.01234,80\n0.01238,0\n0.03,0\n";
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("pulse.csv");
    fs::write(&file, text).unwrap();
    let pulse = format!("{{ table = '{}', interpolation = \"linear\" }}", file.display());
    let decaying = 80.0 * (-(400.0_f64).atan() / 400.0).exp() * (400.0_f64).atan().sin();
    for (value, peak) in [
        (pulse.as_str(), 80.0),
        ("\"80*sin(2*pi*1e5/3*t)\"", 80.0),
        ("\"80*exp(-t/0.01)*sin(4e4*t)\"", decaying),
        ("\"if(t < 0.012345678, 1e4*t, 1)\"", 123.45678),
    ] {
        let text = format!(
            "{STRIP}{}{CLAMPED}{}load = {{ force = [{{ at = [1.0, 0.05], value = {value} }}] }}\n",
            grid("fvs", 2, 1),
            newmark("singular", 1e-5, 0.03)
        );
        let loads = study::check(&scene(&text)).unwrap().loads;
        let largest = loads[0].largest.as_ref().unwrap().1.force.abs();
        assert!((largest / peak - 1.0).abs() <= 2e-6, "{value}: {largest}");
    }
}

#[test]
fn runs_that_stop_at_their_first_step_are_said() {
    let said = warnings("load.pressure = \"1e20*step(t - 0.0005)\"", "the run stops early: step ");
    assert!(said.len() == 1 && said[0].contains("energy"), "{said:?}");
}
