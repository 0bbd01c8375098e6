//! Sound pressure of a plate in an infinite rigid baffle, by the Rayleigh integral.
//!
//! ```math
//! p(r, t) = \frac{\rho}{2 \pi} \int \frac{\ddot w(x, t - R / c)}{R}\,dA, \quad R = |r - x|
//! ```
//!
//! The integral of the retarded velocities over R is a sum over time slots: each slot has a sum
//! over dofs, whose weights are the integrals of the basis functions over R, where the delay R / c
//! falls into the slot. Each row of the run puts its velocities into the slots that they reach; the
//! [kernel](super::kernel) differentiates what they make.

use super::kernel::Kernel;
use crate::dof_map::PER_NODE;
use crate::element::quadrature::DEGREE_2;
use crate::error::{Error, Result};
use crate::linalg::vectors::axpy;
use crate::mesh::{Mesh, Point};
use crate::output::text::engineering;
use crate::scene::Scene;
use crate::simulation::{self, Model};
use nalgebra::Point3;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Density of air at 20 degrees and 1013 hPa, in kg/m^3.
const DENSITY: f64 = 1.204;

/// Speed of sound in this air, in m/s.
const SPEED: f64 = 343.0;

/// Number of rows per sample of the sound, where the step permits.
const ROWS: f64 = 2.0;

/// Number of slots per period of the fastest vibration that is kept.
const SLOTS: f64 = 16.0;

/// Number of parts of an edge per wave length in air of that vibration.
const PARTS: f64 = 3.0;

/// Largest number of parts of an edge.
const MOST_PARTS: f64 = 64.0;

/// Returns the sound pressure (Pa) at a point (m) at multiples of an interval (s), from the start
/// of a scene to its end, and the number of rows per second that it comes from.
///
/// Before the start, and after the end, the velocities are those of the start and of the end.
///
/// # Errors
/// Returns the errors of a run, and [`Error::Usage`] for a point that is too near or so far that
/// the sound arrives after the end.
pub(super) fn pressure(scene: &Scene, point: [f64; 3], interval: f64) -> Result<(Vec<f64>, f64)> {
    let (step, steps) = (scene.time.step, scene.time.steps());
    let end = step * steps as f64;
    let every = ((interval / ROWS / step) as u64).clamp(1, steps.max(1));
    let dt = step * every as f64;
    let limit = 0.5 / dt.max(interval);
    let slots = (dt * SLOTS * limit).ceil() as usize;
    let slot = dt / slots as f64;

    let model = Model::new(scene)?;
    let mesh = simulation::mesh(scene)?;
    let point = Point3::from(point);
    simulation::phase("sound");
    let retarded = RetardedSum::new(&mesh, point, limit, slot)?;
    if retarded.first >= end {
        return Err(Error::Usage(format!(
            "--at: the sound takes {} to the point, and the run ends at {}; expected a point nearer than {}",
            engineering(retarded.first, "s"),
            engineering(end, "s"),
            engineering(SPEED * end, "m")
        )));
    }
    let kernel = Kernel::new(limit, 1);
    let mut sums = vec![0.0; ((end + kernel.reach()) / slot) as usize + 1];
    let mut scheme = model.scheme(scene)?;
    let start = model.nodal_rates(&mut *scheme)?;
    let mut rates = vec![0.0; start.len()];
    for step in 1..=steps {
        scheme.advance()?;
        let kkt = scheme.step_report().kkt;
        simulation::check_residual(step, scheme.time(), kkt, scene.solver.tolerance)?;
        if step.is_multiple_of(every) {
            rates = model.nodal_rates(&mut *scheme)?;
            axpy(-1.0, &start, &mut rates);
            retarded.add(&mesh, &rates, (step / every) as usize * slots, &mut sums);
        }
    }
    for departure in ((steps / every + 1) as usize * slots..sums.len()).step_by(slots) {
        retarded.add(&mesh, &rates, departure, &mut sums);
    }

    // The other side of the plate hears the opposite.
    let factor = point.z.signum() * DENSITY / (2.0 * PI) * dt;
    let reach = (kernel.reach() / slot) as usize;
    let sample = |number: usize| {
        let time = number as f64 * interval;
        let middle = (time / slot) as usize;
        let near = middle.saturating_sub(reach)..(middle + reach + 2).min(sums.len());
        factor * near.map(|i| sums[i] * kernel.value(time - i as f64 * slot)).sum::<f64>()
    };
    Ok(((0..=(end / interval) as usize).map(sample).collect(), 1.0 / dt))
}

/// Retarded velocities of a plate over their distances, integrated over the plate.
struct RetardedSum {
    /// Share of each cell in each slot of delay.
    terms: Vec<RetardedTerm>,
    /// Delay of the nearest point, in s.
    first: f64,
}

/// Share of a cell in a slot.
struct RetardedTerm {
    /// Number of slots of delay.
    slot: usize,
    cell: usize,
    /// Weights of the dofs of the cell, in m.
    weights: Vec<f64>,
}

impl RetardedSum {
    /// Integrates over the plate; vibrations are slower than a limit (Hz).
    fn new(mesh: &Mesh, point: Point3<f64>, limit: f64, slot: f64) -> Result<RetardedSum> {
        let (mut terms, mut first) = (Vec::new(), f64::INFINITY);
        for cell in 0..mesh.cells.len() {
            let element = mesh.element(cell)?;
            let mut slots: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
            let pieces: Result<Vec<_>> =
                element.pieces().iter().map(|piece| parts(piece, point, limit)).collect();
            for triangle in pieces?.into_iter().flatten() {
                let (a, b) = (triangle[1] - triangle[0], triangle[2] - triangle[0]);
                for ([u, v, w], weight) in DEGREE_2 {
                    let place =
                        Point::from(u * triangle[0].coords + v * triangle[1].coords + w * triangle[2].coords);
                    let distance = (point - Point3::new(place.x, place.y, 0.0)).norm();
                    first = first.min(distance / SPEED);
                    let delay = distance / SPEED / slot;
                    let amount = weight * 0.5 * a.perp(&b).abs() / distance;
                    let values: Vec<f64> = element.basis_at(place).iter().map(|basis| basis.value).collect();
                    for (number, share) in [(0, 1.0 - delay.fract()), (1, delay.fract())] {
                        let weights =
                            slots.entry(delay as usize + number).or_insert_with(|| vec![0.0; values.len()]);
                        axpy(share * amount, &values, weights);
                    }
                }
            }
            terms.extend(slots.into_iter().map(|(slot, weights)| RetardedTerm { slot, cell, weights }));
        }
        Ok(RetardedSum { terms, first })
    }

    /// Adds rates of all deflections and slopes, which leave the plate in a slot.
    fn add(&self, mesh: &Mesh, rates: &[f64], departure: usize, sums: &mut [f64]) {
        for RetardedTerm { slot, cell, weights } in &self.terms {
            let Some(sum) = sums.get_mut(departure + slot) else { continue };
            let nodes = mesh.cells[*cell].nodes().iter();
            let rates = nodes.flat_map(|node| &rates[PER_NODE * node..][..PER_NODE]);
            *sum += rates.zip(weights).map(|(rate, weight)| rate * weight).sum::<f64>();
        }
    }
}

/// Divides a triangle finely enough for its distance from a point and for the shortest waves in
/// air.
///
/// # Errors
/// Returns [`Error::Usage`] where the point is too near.
fn parts(corners: &[Point; 3], point: Point3<f64>, limit: f64) -> Result<Vec<[Point; 3]>> {
    let [a, b, c] = *corners;
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    let centre = Point::from((a.coords + b.coords + c.coords) / 3.0);
    let beside = (point.xy() - centre).norm() - longest;
    let near = point.z.abs().max(beside);
    let finest = (SPEED / limit / PARTS).max(longest / MOST_PARTS).min(near);
    let count = (longest / finest).ceil();
    if count > MOST_PARTS {
        let least = engineering(longest / MOST_PARTS, "m");
        return Err(Error::Usage(format!(
            "--at: the point is {} from a cell that is {} long; expected at least {least}",
            engineering(near.max(0.0), "m"),
            engineering(longest, "m")
        )));
    }
    let count = count as usize;
    let place = |i: usize, j: usize| a + ((b - a) * i as f64 + (c - a) * j as f64) / count as f64;
    let mut triangles = Vec::with_capacity(count * count);
    for j in 0..count {
        for i in 0..count - j {
            triangles.push([place(i, j), place(i + 1, j), place(i, j + 1)]);
            if i + j + 2 <= count {
                triangles.push([place(i + 1, j), place(i + 1, j + 1), place(i, j + 1)]);
            }
        }
    }
    Ok(triangles)
}
