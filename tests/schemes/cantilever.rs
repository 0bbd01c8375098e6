//! A cantilever that hits a compliant stop, compared with code_aster's test SDNL104.
//!
//! The beam is 1 m long and has a round section of radius 0.1 m (E = 1e10 Pa, rho = 1e6 kg/m3). A
//! force of 1000 N pushes its tip from t = 0 on onto a stop of 1e8 N/m, 0.1 mm below. With ten beam
//! elements and steps of 1e-4 s code_aster has -1.85334e-6 m at 0.1315 s and -4.63284e-3 m/s at
//! 0.1566 s.
//!
//! A beam of cubic elements with average acceleration gives these very digits, and shows what they
//! owe to the step: with finer elements and steps the deflection, which passes through zero there,
//! stays between -1.835e-6 and -1.849e-6 m, since the impact excites modes that no step resolves.
//! Other schemes agree with the finer beam.

use crate::common::scenes::{Instant, close, run};
use crate::common::solve_dense;
use std::f64::consts::PI;

/// Stiffness of the stop (N/m), its gap (m) and the force (N).
const STOP: f64 = 1e8;
const GAP: f64 = 1e-4;
const FORCE: f64 = -1e3;

/// Stiffness and mass of a cantilever of cubic Hermite elements, dense, stored by rows, over
/// deflection and slope of each node but the clamped one.
fn beam(elements: usize) -> [Vec<f64>; 2] {
    let (radius, h) = (0.1_f64, 1.0 / elements as f64);
    let (rigidity, mass) = (1e10 * PI * radius.powi(4) / 4.0, 1e6 * PI * radius * radius);
    let bend = [
        [12.0, 6.0 * h, -12.0, 6.0 * h],
        [6.0 * h, 4.0 * h * h, -6.0 * h, 2.0 * h * h],
        [-12.0, -6.0 * h, 12.0, -6.0 * h],
        [6.0 * h, 2.0 * h * h, -6.0 * h, 4.0 * h * h],
    ];
    let carry = [
        [156.0, 22.0 * h, 54.0, -13.0 * h],
        [22.0 * h, 4.0 * h * h, 13.0 * h, -3.0 * h * h],
        [54.0, 13.0 * h, 156.0, -22.0 * h],
        [-13.0 * h, -3.0 * h * h, -22.0 * h, 4.0 * h * h],
    ];
    let size = 2 * elements;
    [(bend, rigidity / h.powi(3)), (carry, mass * h / 420.0)].map(|(local, factor)| {
        let mut whole = vec![0.0; size * size];
        for element in 0..elements {
            for (i, row) in local.iter().enumerate() {
                for (j, entry) in row.iter().enumerate() {
                    // The first node is clamped.
                    let place = |k: usize| (2 * element + k).checked_sub(2);
                    if let (Some(i), Some(j)) = (place(i), place(j)) {
                        whole[i * size + j] += factor * entry;
                    }
                }
            }
        }
        whole
    })
}

/// Returns deflection (m) and velocity (m/s) of the tip at the instants of average acceleration
/// (Newmark, beta = 1/4 and gamma = 1/2), with the force of the stop at the instants themselves.
fn average_acceleration(elements: usize, step: f64) -> Vec<[f64; 2]> {
    let [stiffness, mass] = beam(elements);
    let (size, tip) = (2 * elements, 2 * elements - 2);
    let product = |matrix: &[f64], x: &[f64]| -> Vec<f64> {
        matrix.chunks_exact(size).map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect()
    };
    let inverse = |matrix: &[f64]| -> Vec<f64> {
        let unit = |k: usize| (0..size).map(|i| f64::from(u8::from(i == k))).collect::<Vec<_>>();
        (0..size).flat_map(|k| solve_dense(matrix, &unit(k)).unwrap()).collect()
    };
    let quarter = 0.25 * step * step;
    let mut matrix: Vec<f64> = mass.iter().zip(&stiffness).map(|(m, k)| m + quarter * k).collect();
    let open = inverse(&matrix);
    matrix[tip * size + tip] += quarter * STOP;
    let closed = inverse(&matrix);
    let mut load = vec![0.0; size];
    load[tip] = FORCE;
    let (mut u, mut v, mut a) = (vec![0.0; size], vec![0.0; size], product(&inverse(&mass), &load));
    let mut rows = vec![[0.0; 2]];
    for _ in 0..(0.1567 / step).round() as usize {
        let ahead: Vec<f64> = (0..size).map(|i| u[i] + step * v[i] + quarter * a[i]).collect();
        let mut force: Vec<f64> = load.iter().zip(product(&stiffness, &ahead)).map(|(f, k)| f - k).collect();
        let mut next = product(&open, &force);
        if ahead[tip] + quarter * next[tip] < -GAP {
            force[tip] += STOP * (-GAP - ahead[tip]);
            next = product(&closed, &force);
        }
        for i in 0..size {
            u[i] = ahead[i] + quarter * next[i];
            v[i] += 0.5 * step * (a[i] + next[i]);
        }
        a = next;
        rows.push([u[tip], v[tip]]);
    }
    rows
}

#[test]
fn average_acceleration_has_the_published_digits() {
    let rows = average_acceleration(10, 1e-4);
    assert_eq!(format!("{:.5e}", rows[1315][0]), "-1.85334e-6");
    assert_eq!(format!("{:.5e}", rows[1566][1]), "-4.63284e-3");
}

/// The strip has the same bending stiffness and mass per length as the beam; it is narrow, so that
/// nothing bends across it.
fn strip(cells: usize, time: &str) -> Vec<Instant> {
    run(&format!(
        r#"
        plate = {{ length = 1, width = 0.01, thickness = 0.17320508, youngs_modulus = 1.81379936e11, poissons_ratio = 0, density = 1.81379936e7 }}
        mesh = {{ element = "fvs", cells = [{cells}, 1] }}
        support = [{{ edge = "left", kind = "clamped" }}]
        obstacle = [{{ side = "below", height = -1e-4, line = [[1, 0], [1, 0.01]], stiffness = 1e10 }}]
        load = {{ force = [{{ at = [1, 0], value = -500 }}, {{ at = [1, 0.01], value = -500 }}] }}
        time = {{ end = 0.1566, {time} }}
        output = {{ probes = [{{ name = "tip", at = [1, 0] }}, {{ name = "rate", at = [1, 0], quantity = "velocity" }}] }}
        "#
    ))
}

/// The midpoint rule differs from average acceleration only in the steps in which the stop opens or
/// closes: on as many cells and with the same steps, it comes near the published numbers.
#[test]
fn the_midpoint_rule_comes_near_the_published_digits() {
    let rows =
        strip(10, "scheme = \"midpoint\", mass = \"consistent\", massless = \"reflected\", step = 1e-4");
    close("deflection", rows[1315].probes[0], -1.85334e-6, 3e-4);
    close("velocity", rows[1566].probes[1], -4.63284e-3, 3e-4);
}

#[test]
fn a_cantilever_hits_a_stop() {
    let step = 1e-5;
    let fine = average_acceleration(20, step);
    let row = |time: f64| fine[(time / step).round() as usize];
    let at_zero = row(0.1315)[0];
    let deepest = fine.iter().map(|row| row[0]).fold(0.0, f64::min);
    close("deflection of the beam", at_zero, -1.8439e-6, 5e-3);
    close("depth of the beam", deepest, -1.2785e-4, 1e-4);
    // The deflection passes through zero at 0.1315 s; the tip moves by 1.3e-4 m.
    let cases = [
        (10, "scheme = \"newmark\", mass = \"consistent\", step = 1e-4", 2.5e-8),
        (20, "scheme = \"newmark\", mass = \"consistent\", step = 1e-5", 1.2e-8),
        (20, "scheme = \"exact\", mass = \"modal\", step = 1e-4", 1.2e-8),
        (40, "scheme = \"conserving\", mass = \"modal\", step = 1e-5", 1.2e-8),
    ];
    for (cells, time, tolerance) in cases {
        let rows = strip(cells, time);
        let at = |time: f64| &rows.iter().find(|row| (row.time - time).abs() < 1e-7).unwrap().probes;
        let error = at(0.1315)[0] - at_zero;
        let lowest = rows.iter().min_by(|a, b| a.probes[0].total_cmp(&b.probes[0])).unwrap();
        let apart = rows.iter().map(|of| (of.probes[0] - row(of.time)[0]).abs()).fold(0.0, f64::max);
        assert!(error.abs() <= tolerance, "{cells}, {time}: {error:e}");
        assert!(apart <= 7e-8, "{cells}, {time}: {apart:e}");
        // Modes that no step resolves are part of the velocity.
        close("velocity", at(0.1566)[1], -4.63284e-3, 0.05);
        close("deepest", lowest.probes[0], deepest, 2e-4);
        assert!((lowest.time - 0.0781).abs() <= 3e-4, "{cells}, {time}: {}", lowest.time);
    }
}
