//! Statistics of a sweep with random values: probabilities of criteria, quantiles of measures, and
//! sensitivity indices.

use super::quantities::{Quantity, is_main, quantities};
use super::row::{ProbeHead, SweepRow};
use super::rows::SweepRows;
use crate::field::{Condition, Names, Parameters};
use crate::geometry::Point;
use crate::output::text::{Table, significant_digits};
use crate::scene::{RandomKeys, Scene};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::slice::from_ref;

/// Number of standard deviations on either side of an interval of 95 per cent.
const DEVIATIONS: f64 = 1.959_963_984_540_054;

/// Statistics of the runs of a sweep with random values.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SweepStatistics {
    /// Probabilities of the criteria.
    pub criteria: Vec<Criterion>,
    /// Distributions of the measures that some runs have.
    pub quantiles: Vec<MeasureStatistics>,
    /// Sensitivity indices of each measure that varies to each key; empty without Saltelli's
    /// points.
    pub sensitivities: Vec<Sensitivity>,
}

/// Probability of a criterion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Criterion {
    /// Condition as written.
    pub expression: String,
    /// Share of the runs with an answer that fulfil it; `None` where no run has one.
    pub probability: Option<f64>,
    /// Lower end of an interval of 95 per cent; runs without an answer count as unfulfilled.
    pub low: f64,
    /// Upper end of an interval of 95 per cent; runs without an answer count as fulfilled.
    pub high: f64,
    /// Number of runs.
    pub runs: usize,
    /// Number of runs that fulfil it.
    pub fulfilled: usize,
    /// Number of runs without an answer: they failed, or lack the measure.
    pub undecided: usize,
}

/// Distribution of a measure, in its unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "quantiles are named by their shares in per cent")]
pub struct MeasureStatistics {
    /// Name of the measure.
    pub measure: String,
    /// Unit.
    pub unit: String,
    /// Number of runs that have it.
    pub runs: usize,
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
    pub min: f64,
    pub q05: f64,
    pub q25: f64,
    pub median: f64,
    pub q75: f64,
    pub q95: f64,
    pub max: f64,
}

/// Sensitivity of a measure to a key: shares of the variance, with standard errors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sensitivity {
    /// Name of the measure.
    pub measure: String,
    /// Name of the key.
    pub key: String,
    /// Share of the variance that the key causes by itself.
    pub first: f64,
    /// Standard error of `first`.
    pub first_error: f64,
    /// Share of the variance that the key causes by itself and together with others.
    pub total: f64,
    /// Standard error of `total`.
    pub total_error: f64,
}

/// Names of keys, parameters and measures in criteria.
struct Vocabulary<'v> {
    keys: Vec<&'v str>,
    parameters: &'v Parameters,
    quantities: &'v [Quantity<'v>],
}

impl Vocabulary<'_> {
    /// Reads a criterion, given the values of the keys, and the value of each measure that there
    /// is.
    fn read(
        &self,
        expression: &str,
        values: &[f64],
        value: impl Fn(&Quantity) -> Option<f64>,
    ) -> Result<bool, String> {
        let (mut text, mut names) = (expression.to_owned(), self.parameters.clone());
        let measures =
            self.quantities.iter().filter_map(|quantity| Some((&*quantity.name, value(quantity)?)));
        for (name, value) in measures.chain(self.keys.iter().copied().zip(values.iter().copied())) {
            // Formulas have no names such as obstacle.0.height.
            let word = name.replace(|letter: char| !letter.is_alphanumeric(), "_");
            if word != name {
                text = text.replace(name, &word);
            }
            names.set(&word, value);
        }
        let condition = Condition::parse(&text, Names::NONE, &names);
        let holds = condition.and_then(|condition| condition.holds(Point::origin(), 0.0));
        holds.map_err(|wrong| wrong.to_string())
    }
}

/// Refuses criteria of a scene's sweep over measures that it has not.
///
/// # Errors
/// Returns key, place and what was expected, in words.
pub fn check_criteria(scene: &Scene) -> Result<(), String> {
    let Some(random) = scene.sweep.as_ref().and_then(|sweep| sweep.random.as_ref()) else { return Ok(()) };
    let probes = ProbeHead::of_scene(scene);
    let quantities = quantities(&probes);
    let vocabulary = Vocabulary::new(random, &scene.parameters, &quantities);
    for (index, expression) in random.criterion.iter().enumerate() {
        let tried = vocabulary.read(expression, &random.medians(), |_| Some(0.7));
        tried.map_err(|wrong| {
            let names: Vec<&str> = quantities.iter().map(|quantity| &*quantity.name).collect();
            let names = names.join(", ");
            format!("sweep.criterion.{index}: {wrong}; expected a condition on random keys, parameters and {names}")
        })?;
    }
    Ok(())
}

impl<'v> Vocabulary<'v> {
    fn new(random: &'v RandomKeys, parameters: &'v Parameters, quantities: &'v [Quantity]) -> Vocabulary<'v> {
        Vocabulary { keys: random.keys.iter().map(|key| &*key.name).collect(), parameters, quantities }
    }
}

impl SweepStatistics {
    /// Returns the statistics of rows.
    pub(super) fn new(
        random: &RandomKeys,
        parameters: &Parameters,
        probes: &[ProbeHead],
        rows: &SweepRows,
    ) -> SweepStatistics {
        let quantities = quantities(probes);
        let vocabulary = Vocabulary::new(random, parameters, &quantities);
        let keys = random.keys.len();
        let draws = || rows.iter().filter(|row| random.points.is_independent(row.index, keys));
        let block = random.points.block(keys);
        let criterion = |expression: &String| criterion(&vocabulary, expression, draws());
        let quantiles: Vec<MeasureStatistics> =
            quantities.iter().filter_map(|quantity| distribution(quantity, draws())).collect();
        let varying = quantities.iter().filter(|quantity| {
            block > 1 && quantiles.iter().any(|measure| measure.measure == quantity.name && measure.varies())
        });
        let sensitivities = varying.flat_map(|quantity| {
            let outcomes: Vec<(usize, Option<f64>)> =
                rows.iter().map(|row| (row.index / block, quantity.of_row(&row))).collect();
            let outcomes =
                outcomes.chunk_by(|one, other| one.0 == other.0).filter(|rows| rows.len() == block);
            let outcomes: Vec<Vec<f64>> =
                outcomes.filter_map(|rows| rows.iter().map(|(_, value)| *value).collect()).collect();
            let named = vocabulary.keys.clone().into_iter().zip(indices(&outcomes));
            named.map(|(key, indices)| Sensitivity {
                measure: quantity.name.clone(),
                key: key.to_owned(),
                ..indices
            })
        });
        SweepStatistics {
            criteria: random.criterion.iter().map(criterion).collect(),
            sensitivities: sensitivities.collect(),
            quantiles,
        }
    }
}

/// Counts the runs that fulfil a criterion.
fn criterion(vocabulary: &Vocabulary, expression: &str, draws: impl Iterator<Item = SweepRow>) -> Criterion {
    let (mut runs, mut fulfilled, mut undecided) = (0, 0, 0);
    for row in draws {
        let run = row.measures.as_ref();
        let answer = run
            .and_then(|run| vocabulary.read(expression, &row.values, |quantity| (quantity.value)(run)).ok());
        runs += 1;
        fulfilled += usize::from(answer == Some(true));
        undecided += usize::from(answer.is_none());
    }
    let answers = runs - undecided;
    let probability = (answers > 0).then(|| fulfilled as f64 / answers as f64);
    let (low, high) = (wilson(fulfilled, runs)[0], wilson(fulfilled + undecided, runs)[1]);
    Criterion { expression: expression.to_owned(), probability, low, high, runs, fulfilled, undecided }
}

/// Returns the ends of Wilson's interval of 95 per cent for a probability (E. B. Wilson, Journal of
/// the American Statistical Association 22 (1927) 209-212).
pub(super) fn wilson(fulfilled: usize, runs: usize) -> [f64; 2] {
    if runs == 0 {
        return [0.0, 1.0];
    }
    let (n, square) = (runs as f64, DEVIATIONS * DEVIATIONS);
    let p = fulfilled as f64 / n;
    let half = DEVIATIONS * (p * (1.0 - p) / n + square / (4.0 * n * n)).sqrt();
    let ends = [-half, half].map(|half| (p + square / (2.0 * n) + half) / (1.0 + square / n));
    // Rounding must not leave a probability of 0 or 1 outside.
    [if fulfilled == 0 { 0.0 } else { ends[0] }, if fulfilled == runs { 1.0 } else { ends[1] }]
}

/// Returns the distribution of a measure, if any run has it.
fn distribution(quantity: &Quantity, draws: impl Iterator<Item = SweepRow>) -> Option<MeasureStatistics> {
    let mut values: Vec<f64> = draws.filter_map(|row| quantity.of_row(&row)).collect();
    values.sort_by(f64::total_cmp);
    let runs = values.len();
    let (min, max) = (*values.first()?, *values.last()?);
    let mean = values.iter().sum::<f64>() / runs as f64;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    let quantile = |share: f64| quantile(&values, share);
    Some(MeasureStatistics {
        measure: quantity.name.clone(),
        unit: quantity.unit.to_owned(),
        runs,
        mean,
        deviation: (squares / (runs.max(2) - 1) as f64).sqrt(),
        min,
        q05: quantile(0.05),
        q25: quantile(0.25),
        median: quantile(0.5),
        q75: quantile(0.75),
        q95: quantile(0.95),
        max,
    })
}

/// Returns the quantile of sorted values, linear between two of them.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    below + place.fract() * (above - below)
}

/// Returns the sensitivity indices to each key, without names, from blocks of Saltelli's scheme:
/// the values at both points of a pair, and at the first with one number from the second for each
/// key.
///
/// First-order indices are those of Saltelli et al. (Computer Physics Communications 181 (2010)
/// 259-270), total ones those of Jansen (Computer Physics Communications 117 (1999) 35-43).
fn indices(blocks: &[Vec<f64>]) -> Vec<Sensitivity> {
    let count = blocks.len() as f64;
    let pairs = || blocks.iter().map(|block| [block[0], block[1]]);
    let mean = pairs().flatten().sum::<f64>() / (2.0 * count);
    let variances: Vec<f64> =
        pairs().map(|pair| pair.map(|value| (value - mean).powi(2)).iter().sum::<f64>() / 2.0).collect();
    let variance = variances.iter().sum::<f64>() / count;
    // Share of the variance, with the standard error of the ratio of two means.
    let share = |parts: &dyn Fn(&[f64]) -> f64| {
        let parts: Vec<f64> = blocks.iter().map(|block| parts(block)).collect();
        let share = parts.iter().sum::<f64>() / count / variance;
        let deviations = parts.iter().zip(&variances).map(|(part, variance)| part - share * variance);
        let error = (deviations.map(|deviation| deviation.powi(2)).sum::<f64>() / count).sqrt();
        (share, error / count.sqrt() / variance)
    };
    let keys = 2..blocks.first().map_or(2, Vec::len);
    let indices = keys.map(|key| {
        let (first, first_error) = share(&|block| (block[1] - mean) * (block[key] - block[0]));
        let (total, total_error) = share(&|block| (block[0] - block[key]).powi(2) / 2.0);
        let (measure, key) = (String::new(), String::new());
        Sensitivity { measure, key, first, first_error, total, total_error }
    });
    indices.collect()
}

impl SweepStatistics {
    /// Returns the probabilities and the tables for a terminal.
    pub fn text(&self) -> String {
        let criteria = self.criteria.iter().map(|criterion| format!("{criterion}\n"));
        let tables = self.tables().into_iter().map(|(_, lines)| {
            let heads: Vec<&str> = lines[0].iter().map(String::as_str).collect();
            let mut table = Table::new(&heads);
            lines[1..].iter().for_each(|line| _ = table.row(line.clone()));
            table.to_string()
        });
        criteria.chain(tables).collect()
    }

    /// Returns the tables of the measures that vary, and of the indices of the main ones, that
    /// have any lines below their heads, with their names.
    pub fn tables(&self) -> Vec<(&'static str, Vec<Vec<String>>)> {
        let digits = |value: f64| significant_digits(value, 3);
        let heads = |names: &[&str]| vec![names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>()];
        let mut measures = heads(&["measure", "5 %", "median", "95 %", "mean", "deviation", "unit"]);
        for measure in self.quantiles.iter().filter(|measure| measure.varies()) {
            let MeasureStatistics { measure, unit, q05, median, q95, mean, deviation, .. } = measure;
            let numbers = [q05, median, q95, mean, deviation].map(|value| digits(*value));
            measures.push([from_ref(measure), &numbers, from_ref(unit)].concat());
        }
        let mut indices = heads(&["measure", "key", "first order", "total"]);
        for index in self.sensitivities.iter().filter(|index| is_main(&index.measure)) {
            let share = |share: f64, error: f64| format!("{share:.2} ± {error:.2}");
            let cells = [share(index.first, index.first_error), share(index.total, index.total_error)];
            indices.push([&[index.measure.clone(), index.key.clone()], &cells[..]].concat());
        }
        let tables = [("Distributions of the measures", measures), ("Sensitivity indices", indices)];
        tables.into_iter().filter(|(_, lines)| lines.len() > 1).collect()
    }
}

impl fmt::Display for Criterion {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let digits = |value: f64| significant_digits(value, 3);
        let Criterion { expression, probability, low, high, runs, undecided, .. } = self;
        let probability = probability.map_or("unknown".into(), digits);
        let undecided =
            if *undecided > 0 { format!(", {undecided} without an answer") } else { String::new() };
        let (low, high) = (digits(*low), digits(*high));
        write!(f, "P({expression}) = {probability}, 95 %: {low} to {high} ({runs} runs{undecided})")
    }
}

impl MeasureStatistics {
    /// Returns whether the values differ by more than rounding.
    pub(super) fn varies(&self) -> bool {
        self.max - self.min > 1e-9 * self.max.abs().max(self.min.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::{indices, quantile, wilson};
    use crate::random::{Distribution, PointSet};
    use std::f64::consts::PI;

    /// Ishigami's function, whose indices have closed forms (Ishigami and Homma, ISUMA 1990).
    #[test]
    fn indices_of_ishigamis_function_are_the_known_ones() {
        let (a, b) = (7.0, 0.1);
        let key = Distribution::parse("uniform(-3.141592653589793, 3.141592653589793)").unwrap();
        let value = |point: &[f64]| {
            let [x, y, z] = [0, 1, 2].map(|i| key.quantile(point[i]));
            x.sin() + a * y.sin().powi(2) + b * z.powi(4) * x.sin()
        };
        let points = PointSet::Saltelli.points(1, 5 * 4096, 3);
        let block = |block: usize| (5 * block..5 * block + 5).map(|run| value(&points.point(run))).collect();
        let blocks: Vec<Vec<f64>> = (0..4096).map(block).collect();
        let [p4, p8] = [4, 8].map(|power| PI.powi(power));
        let parts = [0.5 * (1.0 + b * p4 / 5.0).powi(2), a * a / 8.0, 0.0];
        let both = b * b * p8 * 8.0 / 225.0;
        let variance = parts.iter().sum::<f64>() + both;
        let together = [both, 0.0, both];
        for (i, index) in indices(&blocks).iter().enumerate() {
            let (first, total) = (parts[i] / variance, (parts[i] + together[i]) / variance);
            assert!((index.first - first).abs() < 0.01, "{i}: {index:?}, {first}");
            assert!((index.total - total).abs() < 0.01, "{i}: {index:?}, {total}");
            assert!(index.first_error < 0.03 && index.total_error < 0.03, "{index:?}");
        }
    }

    /// Standard errors are those of independent draws, and Sobol' points are closer: the indices of
    /// a linear function are within four of them.
    #[test]
    fn indices_of_a_linear_function_are_its_squares() {
        let points = PointSet::Saltelli.points(5, 4 * 512, 2);
        let value = |point: &[f64]| 3.0 * point[0] + 4.0 * point[1];
        let block = |block: usize| (4 * block..4 * block + 4).map(|run| value(&points.point(run))).collect();
        let blocks: Vec<Vec<f64>> = (0..512).map(block).collect();
        for (index, share) in indices(&blocks).iter().zip([0.36, 0.64]) {
            assert!((index.first - share).abs() < 4.0 * index.first_error, "{index:?}");
            assert!((index.total - share).abs() < 4.0 * index.total_error, "{index:?}");
        }
    }

    /// Newcombe, Statistics in Medicine 17 (1998) 857-872, table I.
    #[test]
    fn intervals_are_wilsons() {
        let table = [(81, 263, [0.2553, 0.3662]), (15, 148, [0.0624, 0.1605]), (0, 20, [0.0, 0.1611])];
        for (fulfilled, runs, ends) in table {
            for (end, published) in wilson(fulfilled, runs).into_iter().zip(ends) {
                assert!((end - published).abs() < 5e-5, "{fulfilled} {runs}: {end}");
            }
        }
        assert_eq!((wilson(29, 29)[1], wilson(0, 0)), (1.0, [0.0, 1.0]));
    }

    #[test]
    fn quantiles_lie_between_values() {
        let sorted = [1.0, 2.0, 4.0];
        assert_eq!(
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|share| quantile(&sorted, share)),
            [1.0, 1.5, 2.0, 3.0, 4.0]
        );
    }
}
