//! Keys of `[sweep]` for runs with random values, and what is asked of their measures.

use super::document::{Document, join, quote};
use super::entry::{Kind, table};
use super::kinds::{assigned, count, name, of_text, shortest, string, word};
use crate::error::Result;
use crate::random::{Correlation, Distribution, DrawnPoints, PointSet};

/// Largest number of runs.
const MOST_RUNS: u64 = 1_000_000;

const EXPECTED: &str =
    "expected KEY=DISTRIBUTION(NUMBER, ...), such as \"plate.thickness=normal(1e-3, 1e-5)\"";

const EXPECTED_PAIR: &str = "expected KEY,KEY=NUMBER, such as \"plate.thickness,plate.density=-0.3\"";

const EXPECTED_CRITERION: &str =
    "expected a condition on columns of sweep.csv and parameters, such as \"peak_force > 100\"";

table! {
    /// Random values of a sweep.
    #[derive(Debug, Clone, PartialEq)]
    pub struct RandomKeys {
        /// Keys with random values, texts `"KEY=DISTRIBUTION(NUMBER, ...)"` with KEY as in `over`.
        /// The distributions are `normal(mean, deviation)`, `lognormal(mean, deviation)` of the
        /// logarithm, `uniform(low, high)`, `triangular(low, peak, high)`,
        /// `truncated_normal(mean, deviation, low, high)` and `values(value, value, ...)`, all
        /// equally probable.
        keys as "random": Vec<RandomKey> = random().list();
        /// Correlated pairs of random keys, texts `"KEY,KEY=NUMBER"` with the correlation of the
        /// normal numbers behind their values.
        correlation: Vec<CorrelatedPair> = pair().list().or_silent(Vec::new());
        /// Number of runs with random values.
        runs: u64 = count("a number of runs", 1).or(1000);
        /// Seed of the random values.
        seed: u64 = count("a seed", 0).or(1);
        /// `"plain"`: independent draws; `"latin"`: a Latin hypercube; `"sobol"`: Sobol' points
        /// with a random shift; `"saltelli"`: sensitivity indices, with k + 2 runs per draw of k
        /// keys.
        points: PointSet = word().or(PointSet::Plain);
        /// Conditions whose probability counts, such as `"peak_force > 100"`, on numeric columns of
        /// `sweep.csv` and parameters.
        criterion: Vec<String> = name(EXPECTED_CRITERION).list().or_silent(Vec::new());
    } then of_one_kind
}

/// Key of the scene with the distribution of its values.
#[derive(Debug, Clone, PartialEq)]
pub struct RandomKey {
    /// Name as written, which heads a column.
    pub name: String,
    /// Key of the scene, which for a parameter begins with `parameters.`.
    pub key: String,
    /// Distribution of the values.
    pub distribution: Distribution,
    /// Distribution as written.
    pub text: String,
}

/// Correlated pair of random keys.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelatedPair {
    /// Names of the keys.
    pub names: [String; 2],
    /// Correlation of the normal numbers behind their values.
    pub correlation: f64,
}

impl RandomKeys {
    /// Returns the correlation of all keys, if any are correlated; an error is what is wrong with
    /// it, in words.
    pub fn correlation(&self) -> std::result::Result<Option<Correlation>, String> {
        if self.correlation.is_empty() {
            return Ok(None);
        }
        let place = |name: &String| {
            let place = self.keys.iter().position(|key| key.name == *name);
            place.ok_or_else(|| format!("{} is no key of sweep.random", quote(name)))
        };
        let pair = |pair: &CorrelatedPair| {
            let [one, other] = [place(&pair.names[0])?, place(&pair.names[1])?];
            match one == other {
                true => Err(format!("{} is correlated with itself", pair.names[0])),
                false => Ok(([one, other], pair.correlation)),
            }
        };
        let pairs = self.correlation.iter().map(pair).collect::<std::result::Result<Vec<_>, _>>()?;
        let correlation = Correlation::new(self.keys.len(), &pairs);
        correlation.map(Some).ok_or_else(|| "no random numbers can have these correlations".into())
    }

    /// Returns the values of the runs.
    pub fn draws(&self) -> Draws<'_> {
        let correlation = self.correlation().unwrap_or_default();
        Draws {
            keys: self,
            correlation,
            points: self.points.points(self.seed, self.runs as usize, self.keys.len()),
        }
    }

    /// Returns the medians of all keys.
    pub fn medians(&self) -> Vec<f64> {
        let mut point = vec![0.5; self.keys.len()];
        self.set(&mut point);
        point
    }

    /// Makes the numbers in (0, 1) of a point those of the distributions.
    fn set(&self, point: &mut [f64]) {
        let keys = self.keys.iter().zip(point);
        keys.for_each(|(key, share)| *share = key.distribution.quantile(*share));
    }
}

/// Values of the runs of a sweep with random keys, each made when it is asked for.
pub struct Draws<'k> {
    keys: &'k RandomKeys,
    correlation: Option<Correlation>,
    points: DrawnPoints,
}

impl Draws<'_> {
    /// Returns the values of a run, one per key.
    pub fn values(&self, run: usize) -> Vec<f64> {
        let mut point = self.points.point(run);
        self.correlation.iter().for_each(|correlation| correlation.apply(&mut point));
        self.keys.set(&mut point);
        point
    }
}

/// Refuses repeated keys, numbers of runs and keys that do not fit the points, and correlations
/// that cannot be.
fn of_one_kind(random: RandomKeys, doc: &Document, table: &str) -> Result<RandomKeys> {
    let RandomKeys { keys, runs, points, .. } = &random;
    let fault = |key: &str, wrong: String| Err(doc.fault(&join(table, key), wrong));
    for (index, key) in keys.iter().enumerate() {
        if keys[..index].iter().any(|other| other.key == key.key) {
            let wrong = format!("{} is random already; expected another key", key.name);
            return fault(&format!("random.{index}"), wrong);
        }
    }
    let most = points.most_keys();
    if keys.len() > most {
        return fault("random", format!("{} keys; these points have at most {most}", keys.len()));
    }
    let block = points.block(keys.len()) as u64;
    if *runs > MOST_RUNS {
        return fault("runs", format!("{runs} is too large; expected at most {MOST_RUNS}"));
    }
    if !runs.is_multiple_of(block) {
        let [less, more] = [runs / block, runs / block + 1].map(|blocks| (blocks * block).max(block));
        let wrong = format!("{runs} is no multiple of {block}, the number of keys and 2");
        return fault("runs", format!("{wrong}; expected {less} or {more}"));
    }
    match random.correlation() {
        Err(wrong) => fault("correlation", format!("{wrong}; {EXPECTED_PAIR}")),
        Ok(Some(_)) if *points == PointSet::Saltelli => {
            fault("correlation", "sensitivity indices need independent keys; expected other points".into())
        }
        Ok(_) => Ok(random),
    }
}

/// Key with its distribution.
fn random() -> Kind<RandomKey> {
    let read = |doc: &Document, key: &str| {
        let [name, full, text] = assigned(doc, key, EXPECTED)?;
        let distribution = Distribution::parse(&text).map_err(|wrong| doc.fault(key, wrong))?;
        Ok(RandomKey { name, key: full, distribution, text })
    };
    let write = |random: &RandomKey, _| string(&format!("{}={}", random.name, random.text));
    Kind::new(EXPECTED, of_text, read, write)
}

/// Two keys with their correlation.
fn pair() -> Kind<CorrelatedPair> {
    let read = |doc: &Document, key: &str| {
        let text = doc.text(key, EXPECTED_PAIR)?;
        let parts = text.split_once('=').and_then(|(names, number)| {
            let (one, other) = names.split_once(',')?;
            let correlation = number.trim().parse::<f64>().ok().filter(|number| number.abs() < 1.0)?;
            Some(CorrelatedPair { names: [one, other].map(|name| name.trim().to_owned()), correlation })
        });
        let wrong = || format!("{} has no correlation between -1 and 1; {EXPECTED_PAIR}", quote(text));
        parts.ok_or_else(|| doc.fault(key, wrong()))
    };
    let write = |pair: &CorrelatedPair, _| {
        string(&format!("{}={}", pair.names.join(","), shortest(pair.correlation)))
    };
    Kind::new(EXPECTED_PAIR, of_text, read, write)
}
