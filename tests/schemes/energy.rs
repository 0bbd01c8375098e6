//! Energy behaves as theory predicts: it is constant in free flight, never rises for e = 0, and the
//! guard stops a run in which it grows.

use crate::common::models::PAPER_START;
use rebond::energy::Energies;
use rebond::field::{Field, Names};
use rebond::scene::{FieldInput, Scene};
use rebond::scheme::{Newmark, NewmarkParameters, Scheme, Solution};
use rebond::simulation::{self, Model, Observer, Row};

/// Returns the paper's plate, at rest under 14600 Pa.
fn released_plate(element: &str, mass: &str, scheme: &str, step: f64, end: f64, obstacle: bool) -> Scene {
    let obstacle = if obstacle { "obstacle = [{ side = \"below\", height = -0.1 }]" } else { "" };
    let text = format!(
        r#"
        {PAPER_START}
        mesh = {{ element = "{element}", cells = [10, 4] }}
        {obstacle}
        time = {{ scheme = "{scheme}", mass = "{mass}", step = {step:e}, end = {end} }}
        "#
    );
    Scene::from_str(&text, "plate", &[]).expect("a valid scene")
}

const KINDS: [(&str, &str); 4] =
    [("fvs", "singular"), ("fvs", "consistent"), ("hct", "singular"), ("hct", "consistent")];

const NEWMARK: NewmarkParameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step: 1e-5 };

/// Returns the largest relative difference of values from the first.
fn drift(mut values: impl Iterator<Item = f64>) -> f64 {
    let start = values.next().expect("a start");
    values.map(|value| (value / start - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn newmark_conserves_its_invariant_in_free_flight() {
    for (element, mass) in KINDS {
        let model = Model::new(&released_plate(element, mass, "newmark", 1e-5, 1.0, false)).unwrap();
        let mut scheme = Newmark::new(&model.system, NEWMARK, model.start.clone()).unwrap();
        let invariant = (0..100_000).map(|step| {
            if step > 0 {
                scheme.advance().unwrap();
            }
            scheme.invariant().unwrap()
        });
        let drift = drift(invariant);
        assert!(drift <= 1e-9, "{element} {mass}: {drift:e}");
    }
}

#[test]
fn midpoint_conserves_energy_in_free_flight() {
    for (element, mass) in KINDS {
        let scene = released_plate(element, mass, "midpoint", 1e-5, 1.0, false);
        let model = Model::new(&scene).unwrap();
        let mut scheme = model.scheme(&scene).unwrap();
        let energy = (0..100_000).map(|step| {
            if step > 0 {
                scheme.advance().unwrap();
            }
            scheme.energies().unwrap().total()
        });
        let drift = drift(energy);
        assert!(drift <= 1e-9, "{element} {mass}: {drift:e}");
    }
}

#[test]
fn newmark_without_restitution_never_gains_energy() {
    for (element, mass) in KINDS {
        let model = Model::new(&released_plate(element, mass, "newmark", 1e-5, 0.5, true)).unwrap();
        let mut scheme = Newmark::new(&model.system, NEWMARK, model.start.clone()).unwrap();
        let start = scheme.invariant().unwrap();
        let (mut last, mut contacts) = (start, 0);
        for step in 1..=50_000 {
            scheme.advance().unwrap();
            let now = scheme.invariant().unwrap();
            assert!(now <= last + 1e-10 * start, "{element} {mass}: step {step}, {last} J to {now} J");
            last = now;
            contacts += u32::from(scheme.reaction().iter().any(|r| *r != 0.0));
        }
        assert!(last < start && contacts > 1000, "{element} {mass}: {contacts} steps in contact");
    }
}

struct Rows(Vec<Energies>);

impl Observer for Rows {
    fn row(&mut self, row: &Row) -> rebond::Result<()> {
        self.0.push(Energies { kinetic: row.kinetic, elastic: row.elastic, work: row.work });
        Ok(())
    }
}

#[test]
fn the_guard_stops_the_unstable_scheme_by_name_and_keeps_its_rows() {
    let mut scene = released_plate("fvs", "consistent", "midpoint", 1e-4, 0.5, true);
    scene.solver.energy_guard = 2.0;
    let model = Model::new(&scene).unwrap();
    let mut rows = Rows(Vec::new());
    let (outcome, ended) = simulation::run(&scene, &model, &simulation::condensed, &mut rows).unwrap();
    let error = ended.unwrap_err();
    assert_eq!(error.exit_code(), 5);
    assert!(error.to_string().contains("singular"), "{error}");
    assert!(outcome.steps < scene.time.steps());
    assert_eq!(rows.0.len() as u64, outcome.steps + 1, "every row was kept");
    let [start, .., last] = &rows.0[..] else { panic!() };
    assert!(last.total() > 2.0 * start.total(), "with that which the guard stopped at");
}

/// An obstacle moves the plate by 0.4 m within a step. The total energy hides this, since the plate
/// has only the energy that this work gave it, but no plate can have so much.
#[test]
fn the_guard_sees_the_energy_that_work_hides() {
    for scheme in ["newmark", "midpoint", "conserving"] {
        let mut scene = released_plate("fvs", "singular", scheme, 1e-5, 0.01, true);
        let height = "-0.1 + 0.4*clamp((t - 0.001)/1e-6, 0, 1)";
        let height = Field::parse(height, Names::XYT).unwrap();
        scene.obstacles[0].height = FieldInput::new("obstacle.0.height", height);
        let model = Model::new(&scene).unwrap();
        let mut rows = Rows(Vec::new());
        let (outcome, ended) = simulation::run(&scene, &model, &simulation::condensed, &mut rows).unwrap();
        let error = ended.unwrap_err();
        assert_eq!(error.exit_code(), 5, "{scheme}: {error}");
        assert!(error.to_string().contains("speed of sound"), "{scheme}: {error}");
        assert!((99..=102).contains(&outcome.steps), "{scheme}: {}", outcome.steps);
        let last = rows.0.last().unwrap();
        // Contact dissipates some of the energy; the midpoint scheme adds to it.
        let kept = scheme == "midpoint" || last.total().abs() < 0.2 * last.work;
        assert!(kept, "{scheme}: {} of {} J", last.total(), last.work);
    }
}

#[test]
fn a_load_does_work_and_the_total_stays() {
    let mut scene = released_plate("hct", "singular", "midpoint", 1e-4, 0.1, false);
    scene.initial.static_pressure = FieldInput::new("initial.static_pressure", 0.0);
    let pressure = FieldInput::new("load.pressure", 5000.0);
    scene.load = Some(rebond::scene::Load::of_pressure(pressure));
    let model = Model::new(&scene).unwrap();
    let mut rows = Rows(Vec::new());
    simulation::run(&scene, &model, &simulation::condensed, &mut rows).unwrap().1.unwrap();
    let most_work = rows.0.iter().map(|row| row.work).fold(0.0, f64::max);
    assert!(most_work > 1.0, "{most_work} J");
    for row in &rows.0 {
        assert!(row.total().abs() <= 1e-10 * most_work, "{} J of {most_work} J", row.total());
    }
}
