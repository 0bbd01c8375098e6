//! Evaluation of a study: Pareto fronts, the cheapest run per accuracy, and orders of convergence.

use super::plan::distinct;
use super::trajectory::{Deviation, Parts};
use super::truth::Family;
use super::{Accuracy, Limit, Run};
use crate::scene::{Horizon, Mass};
use serde::Serialize;

/// Ratio below which two costs count as equal, so that a front does not depend on timing noise.
const SAME_COST: f64 = 1.25;

/// Relative accuracies for which the cheapest run is named.
pub const ACCURACIES: [f64; 4] = [1e-1, 1e-2, 1e-3, 1e-4];

/// Relative error below which points count for an order of convergence.
const ORDERLY: f64 = 0.1;

/// Relative error below which an error is rounding and counts for no order.
const ROUNDING: f64 = 1e-13;

/// Error by which runs are ranked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Axis {
    /// Error in time, among the runs of one mesh with one limit.
    Time,
    /// Sum of both errors, among all runs.
    Whole,
}

impl Axis {
    /// Returns this error of a run, relative.
    pub fn error(self, run: &Run) -> f64 {
        match self {
            Axis::Time => run.time_error.unwrap_or(f64::NAN),
            Axis::Whole => run.error(),
        }
    }
}

/// Returns the indices on the Pareto front of (cost, error) pairs, cheapest first.
///
/// A pair is on the front if no other has a smaller error at the same cost or less.
pub fn pareto(points: &[(f64, f64)]) -> Vec<usize> {
    let beats = |one: &(f64, f64), other: &(f64, f64)| {
        one.0 <= SAME_COST * other.0 && (one.1 < other.1 || one.1 == other.1 && one.0 < other.0)
    };
    let on_front = |number: &usize| {
        let point = &points[*number];
        point.1.is_finite() && !points.iter().any(|other| beats(other, point))
    };
    let mut front: Vec<usize> = (0..points.len()).filter(on_front).collect();
    front.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0));
    front
}

/// Returns the [Pareto front](pareto) of some runs.
pub fn front<'r>(runs: &[&'r Run], axis: Axis) -> Vec<&'r Run> {
    let points: Vec<(f64, f64)> = runs.iter().map(|run| (run.seconds(), axis.error(run))).collect();
    pareto(&points).into_iter().map(|number| runs[number]).collect()
}

/// Returns the least-squares slope of log y over log x; `None` for fewer than two points.
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let (sx, sy) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / count, b + y / count));
    let (sxx, sxy) =
        logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + (x - sx) * (x - sx), b + (x - sx) * (y - sy)));
    (logs.len() > 1 && sxx > 0.0).then(|| sxy / sxx)
}

/// Order of convergence of a method with its step, on one mesh.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TimeOrder {
    /// Name of the mesh.
    pub mesh: String,
    /// Name of the method.
    pub method: String,
    /// Order up to the first impact.
    pub first_impact: Option<f64>,
    /// Order up to the second impact.
    pub second_impact: Option<f64>,
    /// Order over the whole run.
    pub end: Option<f64>,
}

/// Order of convergence in space, between two meshes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpaceOrder {
    /// Coarser and finer mesh.
    pub meshes: [String; 2],
    /// Family of methods whose limits these are.
    pub family: String,
    /// Order of the deflection in the L2 norm, up to the first impact.
    pub l2: Option<f64>,
    /// Order of the deflection in the energy norm, up to the first impact.
    pub energy: Option<f64>,
}

impl Accuracy {
    /// Returns the names of the meshes, without repetition, in the order of limits and runs.
    pub fn meshes(&self) -> Vec<String> {
        let of_limits = self.limits.iter().map(|limit| limit.mesh.clone());
        distinct(of_limits.chain(self.runs.iter().map(|run| run.mesh.clone())))
    }

    /// Returns the runs on a mesh.
    pub fn runs_on(&self, mesh: &str) -> Vec<&Run> {
        self.runs.iter().filter(|run| run.mesh == mesh).collect()
    }

    /// Returns the runs on a mesh that are ranked, and the error that ranks them.
    ///
    /// Runs that share a limit are ranked by their error in time. These are the runs with the
    /// paper's singular mass, or all runs if there are none. Runs of a study without limits, or on
    /// a mesh with runs of the modal mass, whose limits differ, are ranked by their whole error.
    pub fn ranked_on(&self, mesh: &str) -> (Vec<&Run>, Axis) {
        let runs = self.runs_on(mesh);
        let differs = |run: &&Run| run.case.method.mass == Mass::Modal || run.time_error.is_none();
        if runs.iter().any(differs) {
            return (runs, Axis::Whole);
        }
        let singular = |run: &&&Run| run.case.method.mass == Mass::Singular;
        let ranked: Vec<&Run> = runs.iter().filter(singular).copied().collect();
        (if ranked.is_empty() { runs } else { ranked }, Axis::Time)
    }

    /// Returns whether a run is on the front among the ranked runs on its mesh.
    pub fn is_on_front(&self, run: &Run) -> bool {
        let (ranked, axis) = self.ranked_on(&run.mesh);
        front(&ranked, axis).iter().any(|other| std::ptr::eq(*other, run))
    }

    /// Computes the order of each method on each mesh.
    ///
    /// Errors count if they are below `ORDERLY` and above three times the limit's own error.
    pub fn time_orders(&self) -> Vec<TimeOrder> {
        let mut orders = Vec::new();
        for mesh in self.meshes() {
            let runs = self.runs_on(&mesh);
            let stepping = runs.iter().filter(|run| run.case.method.scheme.name().has_step());
            for method in distinct(stepping.map(|run| run.case.method.to_string())) {
                let of_method: Vec<&&Run> =
                    runs.iter().filter(|run| run.case.method.to_string() == method).collect();
                let order = |part: fn(&Parts<Deviation>) -> Option<Deviation>| {
                    let floor = of_method.first().map_or(0.0, |run| self.resolved(&mesh, run, part));
                    let error =
                        |run: &Run| Some(part(&run.time.as_ref()?.probes)?.rms / self.scales.deflection);
                    let points: Vec<(f64, f64)> = of_method
                        .iter()
                        .filter_map(|run| Some((run.case.step, error(run)?)))
                        .filter(|(_, error)| *error < ORDERLY && *error > floor.max(ROUNDING))
                        .collect();
                    slope(&points)
                };
                orders.push(TimeOrder {
                    first_impact: order(|parts| parts.first_impact),
                    second_impact: order(|parts| parts.second_impact),
                    end: order(|parts| Some(parts.end)),
                    mesh: mesh.clone(),
                    method,
                });
            }
        }
        orders
    }

    /// Returns the error below which a run on a mesh is not resolved from its limit.
    fn resolved(&self, mesh: &str, run: &Run, part: fn(&Parts<Deviation>) -> Option<Deviation>) -> f64 {
        let is_modal = run.case.method.mass == Mass::Modal;
        let limits = self.limits.iter().filter(|limit| {
            limit.mesh == mesh
                && (limit.mass == Mass::Modal) == is_modal
                && (!is_modal || limit.family == Family::of(&run.case.method).to_string())
        });
        super::FLOOR * limits.filter_map(|limit| part(&limit.own_error)).map(|d| d.rms).fold(0.0, f64::max)
    }

    /// Computes the orders between each mesh and the next finer one with the same element and
    /// family, for the singular masses.
    pub fn space_orders(&self) -> Vec<SpaceOrder> {
        let element = |limit: &Limit| limit.mesh.split(' ').next().map(str::to_owned);
        let finer = |coarse: &Limit| {
            self.limits
                .iter()
                .filter(|fine| fine.family == coarse.family && element(fine) == element(coarse))
                .filter(|fine| fine.size < coarse.size * (1.0 - 1e-9))
                .max_by(|a, b| a.size.total_cmp(&b.size))
        };
        let singular = self.limits.iter().filter(|limit| limit.mass.is_singular());
        let order = |coarse: &Limit| {
            let fine = finer(coarse)?;
            let between = |norm: fn(&Limit) -> Option<f64>| {
                slope(&[(coarse.size, norm(coarse)?), (fine.size, norm(fine)?)])
            };
            Some(SpaceOrder {
                meshes: [coarse.mesh.clone(), fine.mesh.clone()],
                family: coarse.family.clone(),
                l2: between(|limit| limit.space.l2.map(|parts| parts.at(Horizon::FirstImpact).rms)),
                energy: between(|limit| limit.space.energy.map(|parts| parts.at(Horizon::FirstImpact).rms)),
            })
        };
        singular.filter_map(order).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{pareto, slope};

    #[test]
    fn a_front_does_not_hang_on_the_noise_of_a_clock() {
        let points = [(1.0, 0.1), (10.0, 0.01), (5.0, 0.2), (9.0, 0.02), (100.0, 1e-4), (1.0, f64::NAN)];
        assert_eq!(pareto(&points), [0, 1, 4]);
        let noisy: Vec<(f64, f64)> =
            points.iter().zip([1.1, 0.95, 1.1, 1.1, 0.9, 1.0]).map(|((c, e), f)| (c * f, *e)).collect();
        assert_eq!(pareto(&noisy), [0, 1, 4]);
        assert_eq!(pareto(&[]), [0_usize; 0]);
    }

    #[test]
    fn a_slope_is_the_power() {
        let points: Vec<(f64, f64)> = [1.0, 0.5, 0.25, 0.1].map(|h: f64| (h, 3.0 * h.powi(2))).to_vec();
        assert!((slope(&points).unwrap() - 2.0).abs() < 1e-12);
        assert_eq!(slope(&points[..1]), None);
        assert_eq!(slope(&[(1.0, 0.0), (2.0, 1.0)]), None);
    }
}
