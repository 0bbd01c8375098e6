//! Attractors that the runs of a sweep settle on, and the shares of the runs: with keys of the
//! start, basins of attraction.

use super::measures::{Measures, ProbeMeasures};
use super::row::SweepRow;
use super::rows::SweepRows;
use super::statistics::wilson;
use crate::output::text::{Table, significant_digits};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// Distance of points of equal attractors, in the tolerance of points of one section: each of two
/// runs may still be on its way.
const SAME: f64 = 10.0;

/// Largest number of attractors that are printed.
const MOST_SHOWN: usize = 12;

/// Attractors of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Basins {
    /// Attractors, the one of most runs first.
    pub attractors: Vec<Attractor>,
    /// Number of runs whose motion does not repeat: chaos, or one that has not settled.
    pub unsettled: usize,
    /// Index of the attractor of each run that has settled, by the index of the run.
    pub labels: BTreeMap<usize, usize>,
}

/// Periodic motion that runs settle on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Attractor {
    /// Number of periods of the drive after which the motion repeats.
    pub period: usize,
    /// Number of runs.
    pub runs: usize,
    /// Share of the runs that did not fail.
    pub fraction: f64,
    /// Lower end of Wilson's interval of 95 per cent for the share.
    pub low: f64,
    /// Upper end of that interval.
    pub high: f64,
    /// Points of the section, `period` numbers per probe, of the first run.
    pub points: Vec<Vec<f64>>,
    /// Mean of the points, one number per probe.
    pub centroid: Vec<f64>,
}

/// Last points of a probe's section.
fn last(probe: &ProbeMeasures, count: usize) -> &[f64] {
    &probe.section[probe.section.len() - count..]
}

/// Returns whether the motions of two runs are the same, but for whole periods of the drive.
fn are_same(one: &Measures, other: &Measures, tolerance: f64) -> bool {
    let Some(period) = one.period.filter(|_| one.period == other.period) else { return false };
    (0..period).any(|shift| {
        one.probes.iter().zip(&other.probes).all(|(a, b)| {
            let range = (a.max - a.min).max(b.max - b.min);
            let shifted = last(b, period).iter().cycle().skip(shift);
            last(a, period).iter().zip(shifted).all(|(a, b)| (a - b).abs() <= tolerance * range)
        })
    })
}

impl Basins {
    /// Finds the attractors of some runs, given the tolerance of points of a section.
    pub fn new(rows: &SweepRows, tolerance: f64) -> Basins {
        let mut first: Vec<Measures> = Vec::new();
        let mut labels = BTreeMap::new();
        let mut measured = 0;
        for SweepRow { index, measures, .. } in rows.iter() {
            let Some(run) = measures else { continue };
            measured += 1;
            if run.period.is_some() && !run.probes.is_empty() {
                let label = first.iter().position(|other| are_same(&run, other, SAME * tolerance));
                labels.insert(index, label.unwrap_or(first.len()));
                first.extend(label.is_none().then_some(run));
            }
        }
        let runs = |label: usize| labels.values().filter(|of_run| **of_run == label).count();
        let mut order: Vec<(usize, usize)> = (0..first.len()).map(|label| (label, runs(label))).collect();
        order.sort_by_key(|(_, runs)| std::cmp::Reverse(*runs));
        let attractor = |&(label, runs): &(usize, usize)| {
            let period = first[label].period.unwrap_or(1);
            let points: Vec<Vec<f64>> =
                first[label].probes.iter().map(|probe| last(probe, period).to_vec()).collect();
            let [low, high] = wilson(runs, measured);
            Attractor {
                period,
                runs,
                fraction: runs as f64 / measured as f64,
                low,
                high,
                centroid: points.iter().map(|points| points.iter().sum::<f64>() / period as f64).collect(),
                points,
            }
        };
        let place = |label: usize| order.iter().position(|(other, _)| *other == label).unwrap_or(label);
        Basins {
            attractors: order.iter().map(attractor).collect(),
            unsettled: measured - order.iter().map(|(_, runs)| runs).sum::<usize>(),
            labels: labels.iter().map(|(index, label)| (*index, place(*label))).collect(),
        }
    }
}

impl fmt::Display for Basins {
    /// Formats the attractors with their shares of the runs.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut table = Table::new(&["attractor", "period", "share", "95 %", "mean of the points"]);
        let number = |value: f64| significant_digits(value, 3);
        for (index, attractor) in self.attractors.iter().enumerate().take(MOST_SHOWN) {
            let Attractor { period, fraction, low, high, centroid, .. } = attractor;
            let centroid: Vec<String> = centroid.iter().map(|value| number(*value)).collect();
            table.row([
                (index + 1).to_string(),
                period.to_string(),
                number(*fraction),
                format!("{} to {}", number(*low), number(*high)),
                centroid.join(", "),
            ]);
        }
        if self.attractors.len() > MOST_SHOWN {
            table.note(format!("and {} more, all in sweep.json", self.attractors.len() - MOST_SHOWN));
        }
        if self.unsettled > 0 {
            table.note(format!("{} runs have not settled", self.unsettled));
        }
        table.fmt(f)
    }
}
