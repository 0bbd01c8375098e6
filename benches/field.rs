//! Cost of a formula at the quadrature points of a 160x64 mesh, compared with the same formula
//! written in Rust.

use divan::{Bencher, black_box};
use rebond::field::{Derivatives, Field, Names};
use rebond::mesh::Point;

const POINTS: usize = 160 * 64 * 9;
const FORMULAS: [&str; 3] = ["100*(1 - x)*y^2*t", "100*sin(2*pi*50*t)*(1 - x)", "sin(3*x - 50*t)*exp(-y^2)"];

fn points() -> Vec<Point> {
    (0..POINTS).map(|i| Point::new((i % 480) as f64 / 480.0, (i / 480) as f64 / 192.0)).collect()
}

#[divan::bench(args = FORMULAS)]
fn values(bencher: Bencher, text: &str) {
    let field = Field::parse(text, Names::XYT).expect("a formula");
    let (points, mut values) = (points(), vec![0.0; POINTS]);
    bencher.bench_local(|| field.values(&points, black_box(0.01), &mut values));
}

#[divan::bench]
fn values_in_rust(bencher: Bencher) {
    let (points, mut values) = (points(), vec![0.0; POINTS]);
    bencher.bench_local(|| {
        let t = black_box(0.01);
        for (value, at) in values.iter_mut().zip(&points) {
            *value = (3.0 * at.x - 50.0 * t).sin() * (-at.y * at.y).exp();
        }
    });
}

#[divan::bench(args = FORMULAS)]
fn jets(bencher: Bencher, text: &str) {
    let field = Field::parse(text, Names::XYT).expect("a formula");
    let (points, mut jets) = (points(), vec![Derivatives { value: 0.0, first: 0.0, second: 0.0 }; POINTS]);
    bencher.bench_local(|| field.jets(&points, black_box(0.01), &mut jets));
}

#[divan::bench(args = FORMULAS)]
fn parse(text: &str) -> Field {
    Field::parse(text, Names::XYT).expect("a formula")
}

fn main() {
    divan::main();
}
