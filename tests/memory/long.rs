//! A million steps of the paper's plate: the energy behaves as theory predicts to the end, and
//! memory does not grow.

use crate::models::PAPER_FALL;
use crate::{MEMORY, alone};
use rebond::scene::Scene;
use rebond::simulation::Model;

const STEPS: u64 = 1_000_000;

/// Maximum growth of the allocated memory between the first tenth and the end of a run, in bytes.
const GROWTH: usize = 1 << 20;

/// Promise of a scheme on its energy.
#[derive(Clone, Copy, PartialEq)]
enum Promise {
    /// The energy never exceeds its earlier values by more than this fraction of the initial
    /// energy.
    NeverRises(f64),
    /// The energy differs from the initial one by at most this fraction of it.
    Constant(f64),
    /// The energy stays below this multiple of the initial one.
    Bounded(f64),
}

fn run(time: &str, promise: Promise) {
    let text = format!(
        r#"
        {PAPER_FALL}
        mesh = {{ element = "fvs", cells = [10, 4] }}
        time = {{ {time}, step = 5e-6, end = 5 }}
        "#
    );
    let scene = Scene::from_str(&text, "long", &[]).unwrap();
    assert_eq!(scene.time.steps(), STEPS);
    let model = Model::new(&scene).unwrap();
    let mut scheme = model.scheme(&scene).unwrap();
    let start = scheme.energies().unwrap().total();
    let (mut least, mut contact_steps, mut held) = (start, 0_u64, 0);
    for step in 1..=STEPS {
        scheme.advance().unwrap();
        contact_steps += u64::from(scheme.reaction().iter().any(|r| *r != 0.0));
        drop(scheme.take_events());
        assert!(scheme.step_report().kkt <= 1e-10, "step {step}");
        if step % 16 == 0 {
            let now = scheme.invariant().unwrap();
            match promise {
                Promise::NeverRises(share) => {
                    assert!(now <= least + share * start, "step {step}: {least} J to {now} J")
                }
                Promise::Constant(share) => {
                    assert!((now - start).abs() <= share * start, "step {step}: {now} J")
                }
                Promise::Bounded(times) => assert!(now <= times * start, "step {step}: {now} J"),
            }
            least = least.min(now);
        }
        if step == STEPS / 10 {
            held = MEMORY.current_usage();
        }
    }
    let grown = MEMORY.current_usage().saturating_sub(held);
    println!(
        "{time}: {contact_steps} steps in contact, energy {} of its start, {grown} bytes more",
        least / start
    );
    assert!(contact_steps > 1000 && grown <= GROWTH, "{contact_steps} steps in contact, {grown} bytes more");
}

#[test]
#[ignore = "ten minutes"]
fn a_million_steps() {
    let _alone = alone();
    run(r#"scheme = "newmark", mass = "singular", restitution = 0"#, Promise::NeverRises(1e-10));
    run(r#"scheme = "newmark", mass = "consistent", restitution = 0"#, Promise::NeverRises(1e-10));
    run(r#"scheme = "newmark", mass = "singular", restitution = 0.5"#, Promise::Bounded(1.5));
    run(r#"scheme = "newmark", mass = "singular", restitution = 1"#, Promise::Bounded(10.0));
    run(r#"scheme = "midpoint", mass = "singular""#, Promise::Bounded(1.5));
    run(r#"scheme = "conserving", mass = "singular""#, Promise::Constant(1e-10));
    run(r#"scheme = "exact", mass = "singular""#, Promise::Constant(1e-9));
}
