//! The modal mass: eigenvectors by changes of one node, motion backwards in time, and the limit of
//! many modes.

use crate::common::difference;
use crate::common::models::PAPER_FALL;
use crate::exact::{corners, table};
use crate::modal::modal_scene;
use rebond::archive::Archive;
use rebond::linalg::{Engine, Native};
use rebond::scene::{Scene, SchemeSpec};
use rebond::scheme::{Exact, ExactOptions, Scheme, Solution, Start};
use rebond::simulation::Model;

/// Numbers of dofs of the paper's plate with 10x4 cells, and of modes.
const DOFS: usize = 150;
const MODES: usize = 50;

/// Options with which the eigenvectors of all sets follow by changes of one node.
fn by_changes() -> ExactOptions {
    ExactOptions { changes_from: 0, ..ExactOptions::default() }
}

fn falling(element: &str, step: f64) -> (Scene, Model<Native>) {
    let scene = modal_scene(PAPER_FALL, element, [10, 4], MODES, step);
    let model = Model::new(&scene).unwrap();
    (scene, model)
}

#[test]
fn eigenvectors_by_changes_give_the_motion_of_an_independent_program() {
    for element in ["fvs", "hct"] {
        let (_, model) = falling(element, 1e-3);
        let mut scheme = Exact::with_options(&model.system, 1e-3, model.start.clone(), by_changes()).unwrap();
        let energy = scheme.energies().unwrap().total();
        let (mut error, mut drift, mut kkt) = (0.0f64, 0.0f64, 0.0f64);
        for (n, row) in table(&format!("modal_{element}_10x4_m50.csv")).iter().enumerate() {
            if n > 0 {
                scheme.advance().unwrap();
            }
            error = error.max((corners(&model, &scheme)[0] - row[1]).abs());
            drift = drift.max((scheme.energies().unwrap().total() / energy - 1.0).abs());
            kkt = kkt.max(scheme.step_report().kkt);
        }
        println!(
            "{element}: error {error:.1e} m, drift {drift:.1e}, residual {kkt:.1e}, {:?}",
            scheme.statistics().events
        );
        assert!(error <= 1e-9 && drift <= 1e-10 && kkt <= 1e-11, "{element}: {error:e}, {drift:e}, {kkt:e}");
    }
}

/// Archives keep no eigenvectors, but the changes from which they follow.
#[test]
fn eigenvectors_by_changes_are_restored_to_the_bit() {
    let damped = format!("{PAPER_FALL}damping = {{ stiffness = 1e-6 }}\n");
    let models = [PAPER_FALL, &damped]
        .map(|tables| Model::new(&modal_scene(tables, "fvs", [10, 4], MODES, 1e-3)).unwrap());
    // Each set replaces the one before in the cache, or all are kept.
    for (model, memory) in [(&models[0], 0), (&models[0], 1 << 29), (&models[1], 0), (&models[1], 1 << 29)] {
        let options = ExactOptions { memory, ..by_changes() };
        let begin = || Exact::with_options(&model.system, 1e-3, model.start.clone(), options).unwrap();
        let bits = |scheme: &mut Exact<Native>| -> Vec<u64> {
            scheme.advance().unwrap();
            scheme.displacement().iter().chain(scheme.reaction()).map(|x| x.to_bits()).collect()
        };
        let mut whole = begin();
        (0..54).for_each(|_| whole.advance().unwrap());
        let mut saved = Vec::new();
        for _ in 0..8 {
            let mut archive = Archive::Saves(Vec::new());
            whole.archive(&mut archive).unwrap();
            saved.push((archive.into_entries().into_iter(), bits(&mut whole)));
        }
        for k in 0..saved.len() {
            let (entries, same_processes) = (saved[k].0.clone(), true);
            let mut resumed = begin();
            resumed.archive(&mut Archive::Restores { entries, same_processes }).unwrap();
            for (_, expected) in &saved[k..] {
                assert!(bits(&mut resumed) == *expected, "memory {memory}, after {k} milliseconds");
            }
        }
    }
}

/// Returns the state of a scheme with its velocity reversed.
fn reversed(there: &mut dyn Scheme) -> Start {
    let velocity = there.velocity().unwrap().into_iter().map(|v| -v).collect();
    Start { displacement: there.displacement().to_vec(), velocity }
}

#[test]
fn the_exact_motion_runs_backwards_along_its_own_path() {
    for element in ["fvs", "hct"] {
        let (_, model) = falling(element, 1e-3);
        let run = |start: Start| {
            let mut scheme = Exact::new(&model.system, 1e-3, start).unwrap();
            (0..60).for_each(|_| scheme.advance().unwrap());
            scheme
        };
        let begin = Exact::new(&model.system, 1e-3, model.start.clone()).unwrap();
        let mut there = run(model.start.clone());
        let mut back = run(reversed(&mut there));
        let events = [&mut there, &mut back].map(|scheme| scheme.take_events().len());
        let place = difference(back.displacement(), begin.displacement());
        let rate = difference(&back.velocity().unwrap(), &model.start.velocity);
        println!("{element}: {events:?} events, {place:.1e} m, {rate:.1e} m/s");
        assert!(events[0] > 10 && events[0] == events[1], "{element}: {events:?}");
        // Rounding grows by less than three digits in the first impact.
        assert!(place <= 1e-11 && rate <= 1e-8, "{element}: {place:e} m, {rate:e} m/s");
    }
}

#[test]
fn the_conserving_motion_runs_backwards_up_to_the_error_of_its_steps() {
    for element in ["fvs", "hct"] {
        let mut last = f64::INFINITY;
        for step in [1e-5, 2.5e-6] {
            let (mut scene, mut model) = falling(element, step);
            scene.time.scheme = SchemeSpec::Conserving;
            let begin = model.scheme(&scene).unwrap().displacement().to_vec();
            for _ in 0..2 {
                let mut scheme = model.scheme(&scene).unwrap();
                for _ in 0..(0.06 / step).round() as usize {
                    scheme.advance().unwrap();
                }
                let turned = reversed(&mut *scheme);
                drop(scheme);
                model.start = turned;
            }
            let apart = difference(&model.start.displacement, &begin);
            println!("{element}, step {step:e}: {apart:.1e} m");
            // Contact is of first order where the step just resolves its fastest motion.
            assert!(apart <= 0.4 * last && apart <= 50.0 * step, "{element}, {step:e}: {apart:e} m");
            last = apart;
        }
    }
}

/// In flight a mode moves the plate the less, the higher it is, so that the motions of ever more
/// modes approach that of half of all.
#[test]
fn motions_of_more_modes_approach_each_other_up_to_the_impact() {
    for element in ["fvs", "hct"] {
        let fall = |share: usize| -> (Vec<[f64; 2]>, f64) {
            let model = Model::new(&modal_scene(PAPER_FALL, element, [10, 4], DOFS / share, 1e-3)).unwrap();
            assert_eq!(model.system.engine.dofs(), DOFS);
            let mut scheme = Exact::new(&model.system, 1e-3, model.start.clone()).unwrap();
            let flight = (0..54).map(|_| {
                scheme.advance().unwrap();
                corners(&model, &scheme)
            });
            let flight = flight.collect();
            scheme.advance().unwrap();
            (flight, scheme.take_events()[0].time)
        };
        let (most, impact) = fall(2);
        // Bounds of the differences of the corners, in m, and of the instant of impact, in s.
        for (share, places, times) in [(10, 5e-6, 5e-7), (5, 8e-7, 4e-8), (3, 2e-7, 8e-9)] {
            let (flight, at) = fall(share);
            let apart = difference(flight.as_flattened(), most.as_flattened());
            let late = (at - impact).abs();
            println!("{element}, {} modes: {apart:.1e} m, {late:.1e} s", DOFS / share);
            assert!(apart <= places && late <= times, "{element}, {share}: {apart:e} m, {late:e} s");
        }
    }
}

/// Compliant stops add dofs, but none that carries inertia: they make room for no further mode.
#[test]
fn stops_make_room_for_no_modes() {
    for stops in [&["obstacle=[]"][..], &["obstacle=[{ side = \"below\", height = -0.1, stiffness = 1e6 }]"]]
    {
        let refusal = |modes: usize| {
            let mut scene = modal_scene(PAPER_FALL, "fvs", [10, 4], modes, 1e-5);
            let stops: Vec<String> = stops.iter().map(ToString::to_string).collect();
            scene = Scene::from_str(&scene.resolved(), "stops", &stops).unwrap();
            Model::new(&scene).err().map(|why| why.to_string())
        };
        assert_eq!(refusal(DOFS / 2), None, "{stops:?}");
        let said = refusal(DOFS / 2 + 1).unwrap();
        assert!(said.contains("76 modes of 150 dofs"), "{stops:?}: {said}");
    }
}
