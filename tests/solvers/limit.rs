//! Upper limit of the KKT residual at the cost of one product, which spares most steps the check
//! itself.

use crate::common::models::PAPER_FALL;
use rebond::linalg::Engine;
use rebond::random::SplitMix64;
use rebond::scene::Scene;
use rebond::scheme::{Newmark, NewmarkParameters};
use rebond::simulation::Model;
use rebond::vi::kkt::KktCheck;
use rebond::vi::{Answer, Problem};

/// Returns numbers between -1 and 1.
fn noise(size: usize) -> Vec<f64> {
    let mut random = SplitMix64::new(18);
    (0..size).map(|_| random.signed()).collect()
}

/// Largest ratio of the limit to the residual for the shape of a static load.
const CLOSE: f64 = 30.0;

/// Compares the limit with the residual for an answer x and forces b close to A x, and the product
/// with K x. In contact, every fifth bound has a reaction, and a part of b is a further term.
fn compare(model: &Model, dt: f64, x: &[f64], share: f64, touches: bool) -> f64 {
    let system = &model.system;
    let engine = &system.engine;
    let matrix = Newmark::matrix(system, NewmarkParameters { beta: 0.5, restitution: 0.0, step: dt });
    let (mut b, mut m) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    engine.multiply_with_magnitude(&matrix, x, [&mut b, &mut m]).unwrap();
    for ((b, m), error) in b.iter_mut().zip(&m).zip(noise(x.len())) {
        *b += share * error * m;
    }
    let (mut bounds, mut term) = (system.bounds.clone(), Vec::new());
    let (mut x, mut reaction) = (x.to_vec(), vec![0.0; bounds.len()]);
    if touches {
        for (i, r) in reaction.iter_mut().enumerate().step_by(5) {
            let dof = bounds.dofs[i];
            (*r, bounds.lower[i]) = (0.5 * m[dof], x[dof]);
            b[dof] -= *r;
        }
        term = b.iter().zip(noise(b.len())).map(|(b, share)| 0.25 * share * b).collect();
        b.iter_mut().zip(&term).for_each(|(b, term)| *b -= term);
    }
    let more = [&*term];
    let mut check = KktCheck::new(engine, &matrix).unwrap();
    let problem = Problem { matrix: &matrix, rhs: &b, bounds: &bounds, length: 1.0 };
    let answer = Answer { x: &mut x, reaction: &mut reaction };
    let residual = check.residual(engine, &problem, &more, &answer).unwrap();
    let forces = check.forces().to_vec();
    let mut product = vec![0.0; b.len()];
    let part = (&system.stiffness, &mut product[..]);
    let limit = check.limit(engine, &problem, &more, &answer, part).unwrap().unwrap();
    assert!(limit >= residual * (1.0 - 1e-6), "{limit:e} {residual:e}");
    for ((a, b), m) in check.forces().iter().zip(&forces).zip(&m) {
        assert!((a - b).abs() <= 1e-14 * m, "{a:e} {b:e} {m:e}");
    }
    let (mut expected, mut magnitude) = (vec![0.0; b.len()], vec![0.0; b.len()]);
    let stiffness = (&system.stiffness).into();
    engine.multiply_with_magnitude(&stiffness, answer.x, [&mut expected, &mut magnitude]).unwrap();
    for ((a, b), m) in product.iter().zip(&expected).zip(&magnitude) {
        assert!((a - b).abs() <= 1e-14 * m, "{a:e} {b:e} {m:e}");
    }
    limit / residual
}

#[test]
fn the_limit_is_never_below_the_residual_and_close_to_it() {
    for element in ["fvs", "hct"] {
        for mass in ["singular", "consistent"] {
            let text = format!(
                r#"
                {PAPER_FALL}
                mesh = {{ element = "{element}", cells = [20, 8] }}
                time = {{ scheme = "newmark", mass = "{mass}", step = 1e-5, end = 1 }}
                "#
            );
            let model = Model::new(&Scene::from_str(&text, "limit", &[]).unwrap()).unwrap();
            for dt in [1e-3, 1e-4, 1e-5] {
                for touches in [false, true] {
                    let shape = &model.start.displacement;
                    let of_shape = compare(&model, dt, shape, 1e-12, touches);
                    let at_random = compare(&model, dt, &noise(shape.len()), 1e-12, touches);
                    let of = format!("{element}, {mass}, dt = {dt}, {touches}");
                    println!("{of}: {of_shape:.1} and {at_random:.1} times the residual");
                    assert!(of_shape <= CLOSE, "{of_shape}");
                }
            }
        }
    }
}
