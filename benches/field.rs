//! Cost of a formula at the quadrature points of a 160x64 mesh, compared with the same formula
//! written in Rust.

use rebond::field::{Field, Names};
use rebond::mesh::Point;
use std::hint::black_box;
use std::time::Duration;

mod turns;
use turns::{Part, Times, part};

const POINTS: usize = 160 * 64 * 9;
const FORMULAS: [&str; 3] = ["100*(1 - x)*y^2*t", "100*sin(2*pi*50*t)*(1 - x)", "sin(3*x - 50*t)*exp(-y^2)"];

const WATCH: Duration = Duration::from_secs(3);

/// Instant of the evaluations, in s.
const TIME: f64 = 0.01;

/// Returns the parts of a formula: its values, their time derivatives, and its compilation.
fn parts<'p>(text: &'p str, points: &'p [Point]) -> [Part<'p>; 3] {
    let field = Field::parse(text, Names::XYT).expect("a formula");
    let (same, mut values) = (field.clone(), vec![0.0; POINTS]);
    [
        part(&format!("values of {text}"), move || {
            field.values(points, black_box(TIME), &mut values).expect("finite values");
        }),
        part(&format!("jets of {text}"), move || {
            points.iter().for_each(|point| {
                black_box(same.jet(*point, black_box(TIME)).expect("finite values"));
            });
        }),
        part(&format!("parsing of {text}"), || Field::parse(text, Names::XYT).expect("a formula")),
    ]
}

fn main() {
    let points: Vec<Point> =
        (0..POINTS).map(|i| Point::new((i % 480) as f64 / 480.0, (i / 480) as f64 / 192.0)).collect();
    let mut values = vec![0.0; POINTS];
    let in_rust = part(&format!("{} in Rust", FORMULAS[2]), || {
        let t = black_box(TIME);
        for (value, point) in values.iter_mut().zip(&points) {
            *value = (3.0 * point.x - 50.0 * t).sin() * (-point.y * point.y).exp();
        }
        black_box(&values);
    });
    let mut parts: Vec<Part> = FORMULAS.iter().flat_map(|text| parts(text, &points)).collect();
    parts.insert(0, in_rust);
    let mut times = Times::default();
    times.measure(&mut parts, WATCH);
    println!("{:<44}{:>12}{:>8}", "", "median, us", "ratio");
    for (k, (name, _)) in parts.iter().enumerate() {
        println!("{name:<44}{:>12.2}{:>8.2}", 1e6 * times.quartiles(k)[1], times.ratio(k, 0));
    }
}
