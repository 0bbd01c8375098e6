//! Random plates, meshes, obstacles and loads: what must hold of each. A failure is shrunk to a small scene, which is printed.

use crate::common::lift;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::test_runner::{Config, RngSeed, TestRunner};
use rebond::scene::{EngineName, Scene, ViName};
use rebond::scheme::{Exact, ExactOptions, Scheme, Start};
use rebond::simulation::Model;
use rebond::study::stability::{Ending, natively, variants};
use std::fmt;

const STEPS: u32 = 80;

/// A scene, in units of its own: deflections of a tenth of the length, times of the first period of a strip.
#[derive(Clone)]
struct Drawn {
    element: &'static str,
    diagonal: &'static str,
    cells: [usize; 2],
    /// Length in m, width over length, thickness over length, Young's modulus in Pa, Poisson's ratio, density in kg/m3.
    plate: [f64; 6],
    /// Of left, right, bottom, top.
    supports: [Option<&'static str>; 4],
    /// Heights, pressures and velocity in units of the scene.
    below: Option<f64>,
    above: Option<f64>,
    load: f64,
    pressure: f64,
    velocity: f64,
    /// Step over the period, as a power of ten.
    step: f64,
}

impl Drawn {
    fn text(&self) -> String {
        let [length, width, thickness, modulus, ratio, density] = self.plate;
        let (width, thickness) = (width * length, thickness * length);
        let rigidity = modulus * thickness.powi(3) / (12.0 * (1.0 - ratio * ratio));
        let deflection = 0.1 * length;
        let pressure = 8.0 * rigidity * deflection / length.powi(4);
        let period = 2.0 * length * length * (density * thickness / rigidity).sqrt();
        let step = 10f64.powf(self.step) * period;
        let mut text = format!(
            "plate = {{ length = {length:e}, width = {width:e}, thickness = {thickness:e}, youngs_modulus = {modulus:e}, \
             poissons_ratio = {ratio}, density = {density:e} }}\n"
        );
        let diagonal = match self.element {
            "hct" => format!(", diagonal = \"{}\"", self.diagonal),
            _ => String::new(),
        };
        text += &format!("mesh = {{ element = \"{}\", cells = {:?}{diagonal} }}\n", self.element, self.cells);
        let edges = ["left", "right", "bottom", "top"];
        let held = edges
            .iter()
            .zip(self.supports)
            .filter_map(|(edge, kind)| Some(format!("{{ edge = \"{edge}\", kind = \"{}\" }}", kind?)));
        text += &format!("support = [{}]\n", held.collect::<Vec<_>>().join(", "));
        let height = |side: &str, height: Option<f64>| {
            Some(format!("{{ side = \"{side}\", height = {:e} }}", height? * deflection))
        };
        let obstacles = [height("below", self.below.map(|h| -h)), height("above", self.above)];
        text += &format!("obstacle = [{}]\n", obstacles.into_iter().flatten().collect::<Vec<_>>().join(", "));
        text += &format!("load = {{ pressure = {:e} }}\n", self.load * pressure);
        text += &format!(
            "initial = {{ static_pressure = {:e}, velocity = {:e} }}\n",
            self.pressure * pressure,
            self.velocity * deflection / period
        );
        text += "time = { scheme = \"newmark\", mass = \"singular\", ";
        text += &format!("step = {step:e}, end = {:e} }}\n", f64::from(STEPS) * step);
        text
    }

    fn scene(&self) -> Scene {
        Scene::from_str(&self.text(), "drawn.toml", &[]).unwrap()
    }
}

impl fmt::Debug for Drawn {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "\n{}", self.text())
    }
}

fn support() -> impl Strategy<Value = Option<&'static str>> {
    prop_oneof![
        3 => Just(None),
        2 => select(vec![Some("clamped"), Some("simply_supported"), Some("guided")])
    ]
}

fn decades(from: f64, to: f64) -> impl Strategy<Value = f64> {
    (from..to).prop_map(|power| 10f64.powf(power))
}

/// A number that is often 0.
fn maybe(range: std::ops::Range<f64>) -> impl Strategy<Value = f64> {
    prop_oneof![2 => Just(0.0), 3 => range]
}

fn drawn() -> impl Strategy<Value = Drawn> {
    let mesh =
        (select(vec!["fvs", "hct"]), select(vec!["right", "left", "alternating"]), [1..5_usize, 1..4_usize]);
    let plate = (
        decades(-3.0, 3.0),
        0.3..2.0,
        decades(-3.0, -1.0),
        decades(0.0, 12.0),
        select(vec![0.0, 0.3, 0.499, -0.5]),
        decades(0.0, 4.0),
    );
    let bounds = (prop::option::weighted(0.8, maybe(0.0..1.0)), prop::option::weighted(0.3, maybe(0.0..1.0)));
    let forces = (maybe(-1.0..1.0), maybe(-1.0..1.0), maybe(-5.0..5.0));
    (mesh, plate, [support(), support(), support(), support()], bounds, forces, -4.0..-0.5).prop_map(
        |((element, diagonal, cells), plate, supports, (below, above), (load, pressure, velocity), step)| {
            Drawn {
                element,
                diagonal,
                cells,
                plate: plate.into(),
                supports,
                below,
                above,
                load,
                pressure,
                velocity,
                step,
            }
        },
    )
}

fn check(cases: u32, seed: u64, property: impl Fn(Drawn) -> Result<(), TestCaseError>) {
    let rng_seed = RngSeed::Fixed(seed);
    let config =
        Config { cases, rng_seed, failure_persistence: None, max_shrink_iters: 2000, ..Config::default() };
    TestRunner::new(config).run(&drawn(), property).unwrap_or_else(|why| panic!("{why}"));
}

/// What a scene may be refused for: none of it is a matter of luck.
const REFUSALS: &[&str] = &[
    "mechanism",
    "nothing can move",
    "inf-sup",
    "nothing oscillates",
    "neither stiffness nor inertia",
    "not positive definite",
];

fn every_method_holds(drawn: Drawn) -> Result<(), TestCaseError> {
    let scene = drawn.scene();
    for (own, method) in variants(&scene, EngineName::Native, ViName::Condensed) {
        if own.mesh.element != scene.mesh.element {
            continue;
        }
        let trial = natively(&own, method);
        match &trial.ending {
            Ending::Holds | Ending::Gains(_) | Ending::Guarded(_) => {}
            Ending::Refused(why) => {
                prop_assert!(REFUSALS.iter().any(|known| why.contains(known)), "{method}: {why}")
            }
            Ending::Drifts(why) | Ending::Fails(why) => prop_assert!(false, "{method}: {why}: {trial:?}"),
        }
        if let Some(figures) = trial.figures {
            prop_assert!(figures.worst_kkt <= 1e-10 && figures.penetration <= 1e-12, "{method}: {trial:?}");
        }
    }
    Ok(())
}

#[test]
fn every_method_holds_on_random_plates() {
    check(150, 1, every_method_holds);
}

#[test]
#[ignore = "minutes"]
fn every_method_holds_on_ten_thousand_random_plates() {
    check(10_000, 2, every_method_holds);
}

/// A plate whose bottom and top are held alike moves as its mirror image does.
fn mirror_images_move_alike(mut drawn: Drawn) -> Result<(), TestCaseError> {
    drawn.element = "fvs";
    drawn.supports[3] = drawn.supports[2];
    let scene = drawn.scene();
    let Ok(model) = Model::new(&scene) else { return Ok(()) };
    let Ok(mut scheme) = model.scheme(&scene) else { return Ok(()) };
    let width = scene.plate.width;
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * scene.plate.length;
    let twin = |at: [f64; 2]| {
        let twin = model.sites.iter().find(|site| near(site.at[0], at[0]) && near(site.at[1], width - at[1]));
        twin.unwrap().dof
    };
    let pairs: Vec<(usize, usize)> = model.sites.iter().map(|site| (site.dof, twin(site.at))).collect();
    let mut largest = 0.0f64;
    for _ in 0..STEPS {
        scheme.advance().unwrap();
        let u = scheme.displacement();
        largest = pairs.iter().map(|(dof, _)| u[*dof].abs()).fold(largest, f64::max);
        let apart = pairs.iter().map(|(one, other)| (u[*one] - u[*other]).abs()).fold(0.0, f64::max);
        prop_assert!(apart <= 1e-9 * largest, "step {}: {apart:e} of {largest:e}", scheme.step());
    }
    Ok(())
}

#[test]
fn mirror_images_move_alike_on_random_plates() {
    check(200, 3, mirror_images_move_alike);
}

/// Events after which roundings may have grown too far to go back.
const MOST_EVENTS: u64 = 10;

/// The exact motion goes back the way it came.
fn time_runs_backwards(mut drawn: Drawn) -> Result<(), TestCaseError> {
    drawn.step = drawn.step.min(-2.0);
    // Held all around, cells have velocities that no displacement gives, and so none to turn.
    drawn.supports[1] = None;
    let scene = drawn.scene();
    let Ok(model) = Model::new(&scene) else { return Ok(()) };
    let options = ExactOptions { events_per_step: MOST_EVENTS, ..ExactOptions::default() };
    let exact = |start: Start| Exact::with_options(&model.system, scene.time.step, start, options);
    let Ok(mut there) = exact(model.start.clone()) else { return Ok(()) };
    let begin = there.displacement().to_vec();
    let mut largest = crate::common::largest(&begin);
    for _ in 0..STEPS {
        if there.advance().is_err() {
            return Ok(()); // Too many events.
        }
        largest = largest.max(crate::common::largest(there.displacement()));
    }
    if there.tally().is_some_and(|tally| tally.events > MOST_EVENTS) {
        return Ok(());
    }
    let velocity = lift(&model.system, there.cell_velocity()).into_iter().map(|v| -v).collect();
    let start = Start { displacement: there.displacement().to_vec(), velocity };
    let mut back = exact(start).unwrap();
    for _ in 0..STEPS {
        prop_assert!(back.advance().is_ok());
    }
    let apart = crate::common::difference(&begin, back.displacement());
    prop_assert!(apart <= 1e-6 * largest, "{apart:e} of {largest:e}");
    Ok(())
}

#[test]
fn time_runs_backwards_on_random_plates() {
    check(150, 4, time_runs_backwards);
}
