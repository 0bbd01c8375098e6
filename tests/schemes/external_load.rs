//! Loads that the caller of a model adds act as those of its scene.

use crate::common::difference;
use crate::common::models::PAPER_PLATE;
use rebond::linalg::{Engine, Native};
use rebond::scene::Scene;
use rebond::simulation::Model;

/// Force at the free corner, in N, at a time in s. It is constant in the first step, for which
/// Newmark's scheme asks twice at its start.
fn push(time: f64) -> f64 {
    200.0 + 3e3 * (300.0 * (time - 1e-4).max(0.0)).sin()
}

/// Returns the paper's plate beside a near floor, with more keys.
fn scene(time: &str, load: &str) -> Scene {
    let text = format!(
        "{load}\nmesh = {{ element = \"fvs\", cells = [4, 2] }}\n{PAPER_PLATE}time = {{ {time}, step = 1e-4, end = 0.02 }}\n\
         support = [{{ edge = \"left\", kind = \"clamped\", name = \"clamp\" }}]\n\
         obstacle = [{{ side = \"below\", height = -2e-4 }}]\n\
         output = {{ probes = [{{ name = \"corner\", at = [1.2, 0.4] }}] }}\n"
    );
    Scene::from_str(&text, "push.toml", &[]).unwrap()
}

const FORCE: &str =
    "load = { force = [{ at = [1.2, 0.4], value = \"200 + 3e3*sin(300*max(t - 1e-4, 0))\" }] }";

/// Motion of a plate: displacements, reactions and forces of the clamp at all steps, and the last
/// energies.
struct Followed {
    displacements: Vec<f64>,
    reactions: Vec<f64>,
    clamp: Vec<f64>,
    energies: [f64; 3],
}

/// Steps a model to the end of its scene; `before` is called before each step.
fn follow(scene: &Scene, model: &Model, mut before: impl FnMut()) -> Followed {
    let mut scheme = model.scheme(scene).unwrap();
    scheme.keep_balance().unwrap();
    let (mut displacements, mut reactions, mut clamp) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..scene.time.steps() {
        before();
        scheme.advance().unwrap();
        displacements.extend_from_slice(scheme.displacement());
        reactions.extend_from_slice(scheme.reaction());
        clamp.extend(model.support_forces(scheme.as_mut()).unwrap().concat());
    }
    let energies = scheme.energies().unwrap();
    Followed {
        displacements,
        reactions,
        clamp,
        energies: [energies.kinetic, energies.elastic, energies.work],
    }
}

/// Asserts that two motions are equal up to `most`, relative to their largest values.
fn assert_equal(name: &str, a: &Followed, b: &Followed, most: f64) {
    let largest = |x: &[f64]| x.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    assert!(largest(&a.reactions) > 100.0, "{name}: no contact");
    for (what, a, b) in [
        ("displacements", &a.displacements, &b.displacements),
        ("reactions", &a.reactions, &b.reactions),
        ("forces of the clamp", &a.clamp, &b.clamp),
        ("energies", &a.energies.to_vec(), &b.energies.to_vec()),
    ] {
        let apart = difference(a, b) / largest(b);
        assert!(apart < most, "{name}: {what} are {apart:e} apart");
    }
}

/// Returns the load of a unit force at the corner.
fn unit(model: &Model<Native>) -> Vec<f64> {
    let mut unit = vec![0.0; model.system.engine.dofs()];
    model.probes[0].push(1.0, &mut unit);
    unit
}

#[test]
fn a_load_set_step_by_step_acts_as_that_of_the_scene() {
    for time in [
        "scheme = \"newmark\", mass = \"singular\", restitution = 0.5",
        "scheme = \"newmark\", mass = \"singular\", beta = 0.25",
        "scheme = \"midpoint\", mass = \"singular\"",
        "scheme = \"newmark\", mass = \"modal\"",
        "scheme = \"midpoint\", mass = \"modal\"",
    ] {
        let own = scene(time, FORCE);
        let expected = follow(&own, &Model::new(&own).unwrap(), || ());

        let bare = scene(time, "");
        let mut model = Model::new(&bare).unwrap();
        let load = model.external_load(&bare);
        let unit = unit(&model);
        let set = || {
            let size = push(load.next_time());
            load.set(&unit.iter().map(|weight| size * weight).collect::<Vec<_>>());
        };
        set();
        assert_equal(time, &follow(&bare, &model, set), &expected, 1e-8);
    }
}

#[test]
fn a_load_by_a_function_acts_as_that_of_the_scene() {
    for time in [
        "scheme = \"newmark\", mass = \"singular\"",
        "scheme = \"midpoint\", mass = \"singular\"",
        "scheme = \"conserving\", mass = \"singular\"",
        "scheme = \"conserving\", mass = \"modal\"",
    ] {
        let own = scene(time, FORCE);
        let expected = follow(&own, &Model::new(&own).unwrap(), || ());

        let bare = scene(time, "");
        let mut model = Model::new(&bare).unwrap();
        let unit = unit(&model);
        model.add_load(move |time, sum| {
            sum.iter_mut().zip(&unit).for_each(|(sum, weight)| *sum += push(time) * weight);
            Ok(())
        });
        assert_equal(time, &follow(&bare, &model, || ()), &expected, 1e-8);
    }
}

#[test]
fn loads_add_up_and_are_linear_between_the_instants() {
    let scene = scene("scheme = \"newmark\", mass = \"singular\"", "load = { pressure = \"1e3*sin(x*t)\" }");
    let mut model = Model::new(&scene).unwrap();
    let at = |model: &Model, time: f64| {
        let mut sum = vec![0.0; model.system.engine.dofs()];
        model.system.drive.load.as_ref().unwrap()(time, &mut sum).unwrap();
        sum
    };
    let (own, step) = (at(&model, 1e-3), scene.time.step);
    let first = model.external_load(&scene);
    let dofs = own.len();
    first.set(&vec![1.0; dofs]);
    at(&model, 0.0);
    first.set(&vec![3.0; dofs]);
    assert_eq!(first.next_time(), step);
    let middle = at(&model, 0.25 * step);
    assert_eq!(first.next_time(), 2.0 * step);
    first.set(&vec![-7.0; dofs]);
    let wave = |time: f64| {
        let mut alone = at(&Model::new(&scene).unwrap(), time);
        alone.truncate(dofs);
        alone
    };
    for (found, (load, time)) in
        [(middle, (1.5, 0.25)), (at(&model, step), (3.0, 1.0)), (at(&model, 0.5 * step), (2.0, 0.5))]
    {
        let expected: Vec<f64> = wave(time * step).iter().map(|wave| wave + load).collect();
        assert!(difference(&found, &expected) < 1e-12, "{time}");
    }
    // A second load adds to the first.
    let second = model.external_load(&scene);
    second.set(&vec![10.0; dofs]);
    let expected: Vec<f64> = own.iter().map(|wave| wave - 7.0 + 10.0).collect();
    assert!(difference(&at(&model, 1e-3), &expected) < 1e-9);
}
