//! Parameters of a scene in its formulas, conditions and tables, and the keys of a sweep.

use crate::common::models::PAPER_PLATE;
use rebond::field::{Field, Names, Parameters};
use rebond::geometry::Point;
use rebond::scene::{Scene, SweepOrder};

const SCENE: &str = r#"
parameters = { a = 3.0, half_width = 0.2, rate = 40 }
mesh = { element = "fvs", cells = [4, 2] }
obstacle = [{ side = "below", height = "-0.1*a", where = "y > half_width" }]
load = { pressure = "a*sin(2*pi*rate*t)" }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 1e-2 }
sweep = { over = ["a=1..2:5", "plate.width=0.3,0.5"], period = "1/rate", direction = "up", periods = 30 }
"#;

fn scene(settings: &[&str]) -> Scene {
    let settings: Vec<String> = settings.iter().map(ToString::to_string).collect();
    Scene::from_str(&[SCENE, PAPER_PLATE].concat(), "parameters.toml", &settings).unwrap()
}

#[test]
fn formulas_and_conditions_use_parameters() {
    for (settings, a) in [(&[][..], 3.0), (&["parameters.a=7"], 7.0)] {
        let scene = scene(settings);
        let load = scene.load.as_ref().unwrap();
        let value = load.pressure.at(Point::origin(), 0.25 / 40.0).unwrap();
        assert!((value - a).abs() < 1e-14, "{value}");
        let height = scene.obstacles[0].height.number();
        assert_eq!(height, Some(-0.1 * a));
        let again = Scene::from_str(&scene.resolved(), "again.toml", &[]).unwrap();
        assert_eq!((again.resolved(), again.parameters), (scene.resolved(), scene.parameters));
    }
    assert_ne!(scene(&[]).hash(), scene(&["parameters.a=4"]).hash());
}

/// A formula with a parameter is the formula with its number.
#[test]
fn a_parameter_is_its_number() {
    let mut parameters = Parameters::default();
    parameters.set("k", 2.5);
    let field = Field::parse_with("k*x^2 + k", Names::XY, &parameters).unwrap();
    let same = Field::parse("2.5*x^2 + 2.5", Names::XY).unwrap();
    let at = Point::new(0.3, 0.1);
    assert_eq!(field.value(at, 0.0), same.value(at, 0.0));
    assert_eq!(field.degree(), Some(2));
    let constant = Field::parse_with("2*k", Names::NONE, &parameters).unwrap();
    assert_eq!(constant.constant(), Some(5.0));
}

/// A clock that starts later shifts formulas of time.
#[test]
fn a_later_clock_shifts_the_load() {
    let (scene, start) = (scene(&[]), 0.0123);
    let later = scene.from_time(start);
    for t in [0.0, 1e-3, 0.02] {
        let [now, then] = [(&later, t), (&scene, start + t)]
            .map(|(scene, t)| scene.load.as_ref().unwrap().pressure.at(Point::origin(), t).unwrap());
        assert!((now - then).abs() < 1e-12, "{now} {then}");
    }
}

#[test]
fn a_sweep_has_its_values_and_its_period() {
    let scene = scene(&[]);
    let sweep = scene.sweep.unwrap();
    assert_eq!(sweep.over[0].key, "parameters.a");
    assert_eq!(sweep.over[0].values, [1.0, 1.25, 1.5, 1.75, 2.0]);
    assert_eq!((sweep.over[1].name.as_str(), &sweep.over[1].values[..]), ("plate.width", &[0.3, 0.5][..]));
    assert_eq!((sweep.period(), sweep.periods, sweep.settle), (0.025, 30, 15));
    assert_eq!(sweep.direction, SweepOrder::Up);
}

/// A name may be long, and the parameters of a scene are read once, not once per formula and
/// parameter.
#[test]
fn names_may_be_long_and_many() {
    let long = "a".repeat(61);
    let many: String = (0..20_000).map(|i| format!("p{i} = {i}.0, ")).collect();
    let scene = SCENE
        .replace("{ a = 3.0", &format!("{{ {many}{long} = 2.0, a = 3.0"))
        .replace("a*sin(2*pi*rate*t)", &format!("{long}*p19999"));
    let scene = Scene::from_str(&[&scene, PAPER_PLATE].concat(), "many.toml", &[]).unwrap();
    let pressure = &scene.load.as_ref().unwrap().pressure;
    assert_eq!(pressure.at(Point::origin(), 0.0).unwrap(), 39998.0);
}
