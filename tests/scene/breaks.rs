//! Kinks and jumps of formulas of time: they are located, and jumps are refused where no rigid body
//! can follow them.

use crate::common::Random;
use crate::common::models::STRIP;
use crate::common::scenes::{grid, newmark, read, refusal, run};
use rebond::field::{Breaks, Field, MOST_LOOKS, Names};
use rebond::mesh::Point;
use rebond::simulation::Model;
use std::f64::consts::PI;
use std::fs;
use std::path::PathBuf;

fn breaks(text: &str, end: f64) -> Breaks {
    let field = Field::parse(text, Names::T).unwrap_or_else(|fault| panic!("{text}: {fault}"));
    field.breaks(Point::origin(), 0.0, end, MOST_LOOKS)
}

/// Instant with the jumps of the value and of the rate.
type Expected = (f64, f64, f64);

#[test]
fn breaks_are_found_to_rounding() {
    let every = |count: usize, period: f64, jump: f64, kink: f64| {
        (1..=count).map(|k| (k as f64 * period, jump, kink)).collect::<Vec<_>>()
    };
    let triangle: Vec<_> =
        (0..5).map(|k| ((0.5 + f64::from(k)) * PI / 3.0, 0.0, if k % 2 == 0 { -6.0 } else { 6.0 })).collect();
    let signs = (1..=9).map(|k| (0.1 * f64::from(k), if k % 2 == 0 { 2.0 } else { -2.0 }, 0.0)).collect();
    let cases: Vec<(&str, f64, Vec<Expected>)> = vec![
        ("(-1)^floor(10*t)", 0.95, signs),
        ("0.1*max(0, t - 0.01)", 1.0, vec![(0.01, 0.0, 0.1)]),
        ("0.1*max(t - 0.01, 0)", 1.0, vec![(0.01, 0.0, 0.1)]),
        ("-2*min(t, 0.5, 1 - t)", 1.0, vec![(0.5, 0.0, 4.0)]),
        ("clamp(5*t - 1, 0, 1)", 1.0, vec![(0.2, 0.0, 5.0), (0.4, 0.0, -5.0)]),
        ("abs(sin(2*pi*5*t))", 0.95, every(9, 0.1, 0.0, 20.0 * PI)),
        ("mod(t, 0.1)", 0.95, every(9, 0.1, -0.1, 0.0)),
        ("3*floor(10*t)", 0.95, every(9, 0.1, 3.0, 0.0)),
        ("ceil(10*t) - round(10*t - 0.5)", 0.95, Vec::new()),
        ("floor(10*t) + mod(10*t, 1)", 0.95, Vec::new()),
        ("abs(mod(t, 2) - 1)", 3.5, vec![(1.0, 0.0, 2.0), (2.0, 0.0, -2.0), (3.0, 0.0, 2.0)]),
        ("if(t < 0.3, t^2, 0.6*t - 0.09)", 1.0, Vec::new()),
        ("if(t < 0.3, t^2, 0.09)", 1.0, vec![(0.3, 0.0, -0.6)]),
        ("if(t > 0.3 and t <= 0.5, 1, 0)", 1.0, vec![(0.3, 1.0, 0.0), (0.5, -1.0, 0.0)]),
        ("if(not t > 0.3 or t > 0.5, 1, 2)", 1.0, vec![(0.3, 1.0, 0.0), (0.5, -1.0, 0.0)]),
        ("step(t - 0.2)*(t - 0.2)", 1.0, vec![(0.2, 0.0, 1.0)]),
        ("step(t) + heaviside(t - 2)", 1.0, Vec::new()),
        ("if(t > 0, 0.1, 0)", 1.0, vec![(0.0, 0.1, 0.0)]),
        ("sqrt((t - 0.4)^2)", 1.0, vec![(0.4, 0.0, 2.0)]),
        ("hypot(t - 0.4, 0)", 1.0, vec![(0.4, 0.0, 2.0)]),
        ("((t - 0.4)^2)^0.5", 1.0, vec![(0.4, 0.0, 2.0)]),
        ("asin(sin(3*t))", 5.0, triangle),
        ("atan(1/(t - 0.25))", 1.0, vec![(0.25, PI, 0.0)]),
        ("atan2(0.25 - t, -1)", 1.0, vec![(0.25, -2.0 * PI, 0.0)]),
        ("max(t^2 - t + 0.25, 0)", 1.0, Vec::new()),
        ("max(sin(9*t), 1.5) + sign(cos(t) + 2) + tan(t)", 1.5, Vec::new()),
        ("sin(40*t)^2*exp(-t)/(1 + t)*cosh(t) + ln(1 + t)", 1.0, Vec::new()),
        (
            "abs(sin(2*t))*max(0, t - 0.7) + min(t, 0.2)*cos(t)",
            1.5,
            vec![(0.2, 0.0, -0.2f64.cos()), (0.7, 0.0, 1.4f64.sin())],
        ),
    ];
    for (text, end, expected) in cases {
        let Breaks { found, complete } = breaks(text, end);
        assert!(complete, "{text}");
        assert_eq!(found.len(), expected.len(), "{text}: {found:?}");
        // Within 1e-8 of its maximum a sine is rounded to 1.
        let [near, steep] = if text.starts_with("asin") { [1e-7, 1e-1] } else { [1e-14, 1e-6] };
        for (of, (time, jump, kink)) in found.iter().zip(expected) {
            assert!((of.time - time).abs() < near * end.max(1.0), "{text}: {of:?}, expected {time}");
            assert!((of.jump - jump).abs() < 1e-12, "{text}: {of:?}, expected {jump}");
            assert!((of.kink - kink).abs() < steep, "{text}: {of:?}, expected {kink}");
        }
    }
}

/// Where there are too many breaks, the first ones are found in bounded time.
#[test]
fn a_search_ends() {
    for text in ["abs(sin(1e7*t))", "mod(t, 1e-7)", "step(sin(1e9*t^2))"] {
        let Breaks { found, complete } = breaks(text, 1e3);
        assert!(!complete && !found.is_empty(), "{text}: {}", found.len());
    }
}

/// Returns an instant before an end: with six digits, round, or one that a search by halving
/// evaluates itself.
fn instant(random: &mut Random, end: f64) -> f64 {
    let share = match random.below(3) {
        0 => 0.1 + 0.8 * random.unit(),
        1 => 0.1 * (1 + random.below(9)) as f64,
        _ => {
            let halves = 1 << (1 + random.below(6));
            (1 + random.below(halves - 1)) as f64 / halves as f64
        }
    };
    format!("{:.6}", end * share).parse().unwrap()
}

/// Returns sums of ramps and steps at known instants before an end, hidden in other functions.
fn hidden(random: &mut Random, end: f64) -> (String, Vec<(f64, f64)>) {
    let mut text = format!("{:.3}*sin({:.3}*t)", random.signed(), 20.0 * random.signed());
    let mut jumps = Vec::new();
    for _ in 0..1 + random.below(3) {
        let (at, size) = (instant(random, end), 0.1 + random.unit());
        if jumps.iter().any(|(other, _)| *other == at) {
            continue;
        }
        let size: f64 = format!("{size:.6}").parse().unwrap();
        let (term, jump) = match random.below(9) {
            0 => (format!("{size}*step(t - {at})"), size),
            1 => (format!("if(t < {at}, 0, {size})"), size),
            2 => (format!("{size}*floor(t - {at})"), size),
            3 => (format!("{size}*mod(t - {at}, 1)"), -size),
            4 => (format!("{size}*max(step(t - {at}), 0.5*t)"), size * (1.0 - 0.5 * at)),
            5 => (format!("-{size}*sign({at} - t)*(1 + t)"), 2.0 * size * (1.0 + at)),
            6 => (format!("{size}*max(0, t - {at})"), 0.0),
            7 => (format!("{size}*abs(sin(t - {at}))"), 0.0),
            _ => (format!("{size}*if(t > {at} and t < 2, (t - {at})^2, 0)"), 0.0),
        };
        text = match random.below(3) {
            0 => format!("{text} + {term}"),
            1 => format!("({text}) - -1*({term})"),
            _ => format!("min({text}, 1e3) + {term}"),
        };
        if jump != 0.0 {
            jumps.push((at, jump));
        }
    }
    jumps.sort_by(|a, b| a.0.total_cmp(&b.0));
    (text, jumps)
}

fn jumps_are_found(tries: usize) {
    let mut random = Random::new(20);
    for _ in 0..tries {
        let end = [1.0, 0.5, 0.2, 0.1, 0.3][random.below(5)];
        let (text, expected) = hidden(&mut random, end);
        let Breaks { found, complete } = breaks(&text, end);
        let found: Vec<_> = found.into_iter().filter(|of| of.jump != 0.0).collect();
        assert!(complete && found.len() == expected.len(), "{text}: {found:?}, expected {expected:?}");
        for (of, (time, jump)) in found.iter().zip(expected) {
            assert!((of.time - time).abs() < 1e-14, "{text}: {of:?}, expected {time}");
            assert!((of.jump - jump).abs() < 1e-9, "{text}: {of:?}, expected {jump}");
        }
    }
}

#[test]
fn random_jumps_are_found() {
    jumps_are_found(300);
}

#[test]
#[ignore = "long"]
fn ten_thousand_random_jumps_are_found() {
    jumps_are_found(10_000);
}

fn strip(motion: &str, more: &str) -> String {
    format!(
        "{STRIP}{}support = [{{ edge = \"left\", kind = \"clamped\", motion = {motion} }}]\n{}{more}\
         output.probes = [{{ name = \"tip\", at = [1, 0] }}]\n",
        grid("fvs", 3, 1),
        newmark("singular", 1e-3, 0.5)
    )
}

#[test]
fn places_that_jump_are_refused() {
    for (motion, instant) in [
        ("\"0.1*step(t - 0.01)\"", "t = 0.01 s"),
        ("\"if(t > 0, 0.1, 0)\"", "t = 0.0 s"),
        ("\"mod(t, 0.2)\"", "t = 0.2 s"),
        ("\"t + 1e-3*floor(3*t)\"", "t = 0.33333"),
        // The jump follows two branches that separate very slowly, or two identical branches.
        ("\"min(12*t^2, 24*t^2, 0.06) + 0.1*step(t - 0.0217)\"", "t = 0.0217 s"),
        ("\"max(t, abs(t)) + 0.1*step(t - 0.0217)\"", "t = 0.0217 s"),
        ("\"1e-9*abs(sin(1e7*t)) + 0.1*step(t - 0.4217)\"", "t = 0.4217 s"),
        // The jump is where a search by halving ends one interval and begins the next.
        ("\"0.1*step(t - 0.25)\"", "t = 0.25 s"),
        ("\"0.1*step(t - 0.0625)\"", "t = 0.0625 s"),
    ] {
        let error = refusal(&strip(motion, ""));
        let said = error.to_string();
        assert_eq!(error.exit_code(), 2);
        assert!(said.contains(": support.0.motion: jumps by ") && said.contains(instant), "{said}");
        assert!(said.contains("clamp(") && said.lines().count() == 1, "{said}");
    }
    for height in ["-0.1 + 0.4*step(t - 0.3)", "if(x > 0.4 and t > 0.3, 0.3, -0.1)", "-0.3*step(t - x/3)"] {
        let obstacle = format!("obstacle = [{{ side = \"below\", height = \"{height}\" }}]\n");
        let said = refusal(&strip("0", &obstacle)).to_string();
        assert!(said.contains("obstacle.0.height: jumps by "), "{said}");
    }
    // Heights matter only where the obstacle faces the plate, and a jump after the end is none.
    let beyond = "obstacle = [{ side = \"below\", height = \"-0.1 + step(t - 0.3)*step(0.1 - x)\", where = \"x > 0.5\" }]\n";
    let late = "obstacle = [{ side = \"below\", height = \"-0.1 + step(t - 0.6)\" }]\n";
    for obstacle in [beyond, late] {
        Model::new(&read(&strip("0", obstacle)).unwrap()).unwrap();
    }
}

/// A table with linear interpolation moves a support as the same lines in a formula do.
#[test]
fn a_linear_table_moves_a_support() {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("kinked.csv");
    fs::write(&path, "0,0\n0.0513,0\n0.1513,0.02\n0.3,-0.01\n").unwrap();
    let table = format!("{{ table = '{}', interpolation = \"linear\" }}", path.display());
    let formula = "\"0.2*clamp(t - 0.0513, 0, 0.1) - 0.03/0.1487*clamp(t - 0.1513, 0, 0.1487)\"";
    let [one, other] = [&table, formula].map(|motion| run(&strip(motion, "")));
    let mut most = 0.0f64;
    for (one, other) in one.iter().zip(&other) {
        assert!((one.probes[0] - other.probes[0]).abs() < 1e-12, "{}", one.time);
        most = most.max(one.probes[0].abs());
    }
    assert!(most > 0.02);
}
