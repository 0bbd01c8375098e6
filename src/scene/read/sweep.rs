//! Table `[sweep]`: swept keys, periods and measures.

use crate::error::{Result, suggestion};
use crate::field::Names;
use crate::scene::document::{Document, quote};
use crate::scene::keys::{TableKeys, ValueKind, key, words};
use crate::scene::typed::{Quantity, Range};
use crate::scene::{SweepOrder, SweepSpec, SweptKey, Value};

/// Largest number of values of a key.
const MOST_VALUES: usize = 1_000_000;

/// Periods of each run, and those before the measured ones, where the scene does not tell them.
const PERIODS: u64 = 200;

/// Distance of points of a section that counts as none, relative to the range of the motion.
const TOLERANCE: f64 = 1e-3;

const PERIOD: Quantity = Quantity::new("a period in s", Range::POSITIVE);
const DISTANCE: Quantity = Quantity::new("a distance relative to the range of the motion", Range::POSITIVE);

const EXPECTED: &str =
    "expected KEY=FROM..TO:COUNT or KEY=VALUE,VALUE,..., such as \"load.pressure=90..250:161\"";

pub(super) static SWEEP: TableKeys = TableKeys {
    groups: &[&[
        key(
            "over",
            ValueKind::List(&ValueKind::Text),
            "one or two texts KEY=FROM..TO:COUNT or KEY=VALUE,VALUE,...",
        ),
        key(
            "direction",
            ValueKind::Word(words::<SweepOrder>),
            "where each run starts; default apart: as the scene says",
        ),
        key(
            "period",
            ValueKind::Field(&PERIOD, Names::NONE),
            "s, period of the drive: a number, or a formula of the parameters",
        ),
        key("periods", ValueKind::Count(1), "periods of each run; default 200"),
        key(
            "settle",
            ValueKind::Count(0),
            "periods of each run before the measured ones; default half of them",
        ),
        key(
            "tolerance",
            ValueKind::Number(&DISTANCE),
            "distance of equal points of a section, relative to the range; default 1e-3",
        ),
        key("lyapunov", ValueKind::Truth, "true: measure the largest Lyapunov exponent too"),
    ]],
    needed: &["over", "period"],
    one_of: &[],
};

pub(super) fn read(doc: &Document) -> Result<Option<SweepSpec>> {
    doc.allow("sweep", &SWEEP)?;
    if doc.get("sweep").is_none() {
        return Ok(None);
    }
    let over = doc.list("sweep.over", |key| swept(doc, key))?;
    let over = over.ok_or_else(|| doc.missing("sweep.over", EXPECTED))?;
    if over.len() > 2 {
        let wrong = format!("{} keys; expected one, or two for a map", over.len());
        return Err(doc.fault("sweep.over", wrong));
    }
    if let [one, other] = &over[..]
        && one.key == other.key
    {
        return Err(doc.fault("sweep.over.1", format!("{} is swept already; expected another key", one.name)));
    }
    let hint = Quantity { what: "the period of the drive in s, or a formula of the parameters", ..PERIOD };
    let period = match doc.needed("sweep.period", &hint, Names::NONE)?.value {
        Value::Formula(field) if field.constant().is_some_and(|period| period > 0.0) => field,
        _ => return Err(doc.fault("sweep.period", "is not positive; expected a period in s greater than 0")),
    };
    let periods = doc.optional_count("sweep.periods", "a number of periods", 1)?.unwrap_or(PERIODS);
    let settle = doc.optional_count("sweep.settle", "a number of periods", 0)?.unwrap_or(periods / 2);
    if settle >= periods {
        let wrong = format!("{settle} periods leave none of {periods} to measure");
        return Err(doc.fault("sweep.settle", format!("{wrong}; expected fewer than sweep.periods")));
    }
    Ok(Some(SweepSpec {
        over,
        direction: doc.optional_choice("sweep.direction")?.unwrap_or(SweepOrder::Apart),
        period,
        periods,
        settle,
        tolerance: doc.optional_number("sweep.tolerance", &DISTANCE)?.unwrap_or(TOLERANCE),
        lyapunov: doc.optional_truth("sweep.lyapunov")?.unwrap_or(false),
    }))
}

/// Reads a key with its values, such as `load.pressure=90..250:161`.
fn swept(doc: &Document, at: &str) -> Result<SweptKey> {
    let text = doc.optional_text(at, EXPECTED)?.unwrap_or_default();
    let Some((name, values)) = text.split_once('=') else {
        return Err(doc.fault(at, format!("{} has no \"=\"; {EXPECTED}", quote(text))));
    };
    let (name, values) = (name.trim(), values.trim());
    let parameters = doc.parameters()?;
    let key = if parameters.get(name).is_some() { format!("parameters.{name}") } else { name.to_owned() };
    let is_word = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_alphanumeric() || c == '_');
    if !key.contains('.') || !key.split('.').all(is_word) {
        let known: Vec<&str> = parameters.names().collect();
        let hint = suggestion(name, &known);
        let wrong = format!("{} is neither a parameter nor a key such as load.pressure{hint}", quote(name));
        return Err(doc.fault(at, format!("{wrong}; {EXPECTED}")));
    }
    let read = parse(values).map_err(|wrong| doc.fault(at, format!("{wrong}; {EXPECTED}")))?;
    Ok(SweptKey { name: name.to_owned(), key, values: read, text: values.to_owned() })
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
