//! Table `[sweep]`: the runs that `rebond sweep` makes.

use super::SweepOrder;
use super::document::{Document, join, quote};
use super::entry::{Kind, flat_if, table};
use super::kinds::{assigned, count, field_text, of_text, positive, string, truth, word};
use super::random_keys::RandomKeys;
use crate::error::Result;
use crate::field::{Field, Names};

/// Largest number of values of a key, and of combinations of values.
const MOST_VALUES: usize = 1_000_000;

/// Default number of periods of each run.
const PERIODS: u64 = 200;

const EXPECTED: &str =
    "expected KEY=FROM..TO:COUNT or KEY=VALUE,VALUE,..., such as \"load.pressure=90..250:161\"";

table! {
    /// Sweep over keys of a scene.
    #[derive(Debug, Clone, PartialEq)]
    pub struct SweepSpec {
        /// Swept keys, texts `"KEY=FROM..TO:COUNT"` or `"KEY=VALUE,VALUE,..."`; KEY is any key of
        /// the scene that takes a number, such as `plate.thickness` or `obstacle.0.height`, or a
        /// parameter. Two keys give a map, more keys all combinations of their values. Needed,
        /// unless `random` is given.
        over: Vec<SweptKey> = swept().array(EXPECTED).or_silent(Vec::new());
        /// Keys with random values.
        random: Option<RandomKeys> = flat_if();
        /// `"apart"`: each run starts as the scene says; `"up"`, `"down"`, `"up_and_down"`: each
        /// run starts where the one before ended.
        direction: SweepOrder = word().or(SweepOrder::Apart);
        /// Period of the drive: a number, or a formula of the parameters such as `"1/frequency"`.
        period: Field = period();
        /// Periods of each run.
        periods: u64 = count("a number of periods", 1).says("of each run").or(PERIODS);
        /// Periods of each run before the measured ones; by default half of them.
        settle: u64 = count("a number of periods", 0).says("periods before the measured ones").or_else(half);
        /// Distance of points of a section that count as equal, relative to the range of the
        /// motion.
        tolerance: f64 = positive("a distance relative to the range of the motion", "")
            .says("of equal points, relative to the range of the motion").or(1e-3);
        /// `true` measures the largest Lyapunov exponent too.
        lyapunov: bool = truth().says("largest Lyapunov exponent").or_silent(false);
        /// `true` tells the attractors that the runs settle on, and their shares.
        basins: bool = truth().says("attractors and their shares").or_silent(false);
    } then checked
}

/// Key of the scene with the values that it takes.
#[derive(Debug, Clone, PartialEq)]
pub struct SweptKey {
    /// Name as written, which heads a column.
    pub name: String,
    /// Key of the scene, which for a parameter begins with `parameters.`.
    pub key: String,
    /// Values, in the order of the sweep.
    pub values: Vec<f64>,
    /// Values as written.
    pub text: String,
}

impl SweepSpec {
    /// Returns the period of the drive, in s.
    pub fn period(&self) -> f64 {
        self.period.constant().unwrap_or_default()
    }

    /// Returns names and keys of what differs among the runs, in the order of its values.
    pub fn keys(&self) -> impl Iterator<Item = (&str, &str)> {
        let random = self.random.iter().flat_map(|random| &random.keys);
        let random = random.map(|random| (random.name.as_str(), random.key.as_str()));
        self.over.iter().map(|swept| (swept.name.as_str(), swept.key.as_str())).chain(random)
    }

    /// Returns whether pictures or attractors need the sections of all runs.
    pub fn shows_sections(&self) -> bool {
        self.random.is_none() || self.basins
    }
}

/// Returns half of the periods.
fn half(doc: &Document) -> Result<u64> {
    Ok(doc.figure("sweep.periods").map_or(PERIODS, |periods| periods as u64) / 2)
}

/// Refuses a repeated key, too many combinations, and runs without measured periods.
fn checked(sweep: SweepSpec, doc: &Document, table: &str) -> Result<SweepSpec> {
    let SweepSpec { over, random, direction, periods, settle, .. } = &sweep;
    match (over.is_empty(), random.is_some()) {
        (true, false) => return Err(doc.missing(&join(table, "over"), EXPECTED)),
        (false, true) => {
            let wrong = "is given with sweep.over; expected one of the two";
            return Err(doc.fault(&join(table, "random"), wrong));
        }
        _ => {}
    }
    if random.is_some() && *direction != SweepOrder::Apart {
        let wrong = "runs with random values do not continue each other; expected \"apart\"";
        return Err(doc.fault(&join(table, "direction"), wrong));
    }
    for (index, swept) in over.iter().enumerate() {
        if over[..index].iter().any(|other| other.key == swept.key) {
            let wrong = format!("{} is swept already; expected another key", swept.name);
            return Err(doc.fault(&join(table, &format!("over.{index}")), wrong));
        }
    }
    let runs = over.iter().fold(1, |runs: usize, swept| runs.saturating_mul(swept.values.len()));
    if runs > MOST_VALUES {
        let wrong = format!("{runs} combinations of values; expected at most {MOST_VALUES}");
        return Err(doc.fault(&join(table, "over"), wrong));
    }
    if settle >= periods {
        let wrong = format!("{settle} periods leave none of {periods} to measure");
        let wrong = format!("{wrong}; expected fewer than sweep.periods");
        return Err(doc.fault(&join(table, "settle"), wrong));
    }
    Ok(sweep)
}

/// Period of the drive.
fn period() -> Kind<Field> {
    let kind =
        positive("the period of the drive in s, or a formula of the parameters", "").field(Names::NONE);
    let (expected, read, schema) = (kind.expected, kind.read, kind.schema);
    let read = move |doc: &Document, key: &str| match read(doc, key)?.formula {
        field if field.constant().is_some_and(|period| period > 0.0) => Ok(field),
        _ => Err(doc.fault(key, "is not positive; expected a period in s greater than 0")),
    };
    let write = |period: &Field, _| {
        // A formula of the parameters stays one, since its value changes with them.
        let text = period.to_string();
        if text.parse::<f64>().is_ok() { field_text(period) } else { string(&text) }
    };
    Kind { unit: "s", ..Kind::new(expected, schema, read, write).says("s, of the drive") }
}

/// Key with its values, such as `load.pressure=90..250:161`.
fn swept() -> Kind<SweptKey> {
    let read = |doc: &Document, key: &str| {
        let [name, swept, values] = assigned(doc, key, EXPECTED)?;
        let numbers = parse(&values).map_err(|wrong| doc.fault(key, format!("{wrong}; {EXPECTED}")))?;
        Ok(SweptKey { name, key: swept, values: numbers, text: values })
    };
    Kind::new(EXPECTED, of_text, read, |swept: &SweptKey, _| {
        string(&format!("{}={}", swept.name, swept.text))
    })
}

/// Parses `FROM..TO:COUNT` or values separated by commas.
fn parse(text: &str) -> std::result::Result<Vec<f64>, String> {
    let number = |text: &str| match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("{} is not a finite number", quote(text.trim()))),
    };
    let Some((from, rest)) = text.split_once("..") else {
        let values: Vec<f64> = text.split(',').map(number).collect::<std::result::Result<_, _>>()?;
        let repeated = values.iter().enumerate().find(|(i, value)| values[..*i].contains(value));
        return repeated.map_or(Ok(values.clone()), |(_, value)| Err(format!("{value} occurs twice")));
    };
    let Some((to, count)) = rest.split_once(':') else { return Err(format!("{} has no \":\"", quote(text))) };
    let (from, to) = (number(from)?, number(to)?);
    let count = count.trim().parse::<usize>().ok().filter(|count| (2..=MOST_VALUES).contains(count));
    let Some(count) = count else {
        return Err(format!("{} has no number of values from 2 to {MOST_VALUES}", quote(text)));
    };
    if from == to {
        return Err(format!("{} begins and ends with the same value", quote(text)));
    }
    let last = (count - 1) as f64;
    Ok((0..count).map(|i| if i + 1 == count { to } else { from + (to - from) * (i as f64 / last) }).collect())
}
