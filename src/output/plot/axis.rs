//! Axes with their ranges, ticks and units.

use crate::geometry::range;
use crate::output::text;

/// Largest magnitude that counts as finite; its inverse is the smallest range that counts.
const GREATEST: f64 = 1e100;
const LEAST: f64 = 1e-100;

/// Scale of an axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Scale {
    /// Linear scale.
    #[default]
    Linear,
    /// Logarithmic scale, on which values that are not positive are not shown.
    Log,
}

/// Axis of a panel, with a quantity, a unit and a scale; by default it fits its curves.
#[derive(Debug, Clone, Default)]
pub struct Axis {
    quantity: String,
    symbol: String,
    scale: Scale,
    /// Fixed ends.
    ends: Option<[f64; 2]>,
    /// Values that the axis must include.
    shown: Vec<f64>,
    /// Data value that corresponds to 1 on the ticks.
    per: f64,
    /// Margin at both ends, relative to the range.
    pad: f64,
    /// Names of the values 1, 2, ..., if they have any; ticks are then at whole numbers only.
    names: Vec<String>,
    /// Magnitude that chooses the SI prefix; by default the ends of a linear axis choose it, and a
    /// logarithmic one has none.
    magnitude: Option<f64>,
    /// Approximate number of ticks, where it does not follow from the length of the axis.
    wanted: Option<usize>,
}

impl Axis {
    /// Creates a linear axis; `symbol` is the unit, which takes an SI prefix, or empty.
    pub fn linear(quantity: impl Into<String>, symbol: impl Into<String>) -> Axis {
        let (quantity, symbol) = (quantity.into(), symbol.into());
        Axis { quantity, symbol, per: 1.0, pad: 0.06, ..Axis::default() }
    }

    /// Creates a logarithmic axis; `symbol` is the unit, or empty.
    pub fn log(quantity: impl Into<String>, symbol: impl Into<String>) -> Axis {
        Axis { scale: Scale::Log, ..Axis::linear(quantity, symbol) }
    }

    /// Fixes the ends of the axis; data beyond them are cut off.
    pub fn within(self, low: f64, high: f64) -> Axis {
        Axis { ends: Some([low, high]), ..self }
    }

    /// Extends the axis to include these values.
    pub fn with(mut self, values: impl IntoIterator<Item = f64>) -> Axis {
        self.shown.extend(values);
        self
    }

    /// Removes the margins, so that curves reach the ends.
    pub fn tight(self) -> Axis {
        Axis { pad: 0.0, ..self }
    }

    /// Labels the values 1, 2, ... by names.
    pub fn named(self, names: impl IntoIterator<Item = String>) -> Axis {
        Axis { names: names.into_iter().collect(), ..self }
    }

    /// Counts the axis in multiples of `unit` of the data.
    pub fn per(self, unit: f64) -> Axis {
        Axis { per: unit, ..self }
    }

    /// Counts the axis in the unit of a linear one whose values reach a magnitude, such as another
    /// axis of the same plan.
    pub fn in_unit_of(self, magnitude: f64) -> Axis {
        Axis { magnitude: Some(magnitude), ..self }
    }

    /// Sets the approximate number of ticks.
    pub fn ticks(self, wanted: usize) -> Axis {
        Axis { wanted: Some(wanted), ..self }
    }

    /// Fits the axis to values, with about `wanted` ticks.
    pub(super) fn fit(&self, values: impl Iterator<Item = f64>, wanted: usize) -> Fitted {
        let drawn = |value: &f64| value.abs() < GREATEST && (self.scale == Scale::Linear || *value > LEAST);
        let range = match self.ends {
            Some(mut ends) => {
                ends.sort_by(f64::total_cmp);
                range(ends.into_iter().filter(drawn))
            }
            None => range(values.chain(self.shown.iter().copied()).filter(drawn)),
        };
        let pad = if self.ends.is_some() { 0.0 } else { self.pad };
        let per = if drawn(&self.per) && self.per.abs() > LEAST { self.per } else { 1.0 };
        let mut fitted = match self.scale {
            Scale::Linear => self.fit_linear(range, pad, per, self.wanted.unwrap_or(wanted)),
            Scale::Log => self.fit_log(range, pad, per),
        };
        for (value, text) in &mut fitted.ticks {
            let name = (value.round() as usize).checked_sub(1).and_then(|thing| self.names.get(thing));
            name.into_iter().for_each(|name| name.clone_into(text));
        }
        fitted
    }

    fn fit_linear(&self, range: [f64; 2], pad: f64, per: f64, wanted: usize) -> Fitted {
        let magnitude = self.magnitude.unwrap_or(range[0].abs().max(range[1].abs()));
        let [low, high] = wide_enough(range);
        let pad = pad * (high - low);
        let [low, high] = [low - pad, high + pad];
        let exponent = exponent(magnitude / per, &self.symbol);
        let unit = per * 10f64.powi(exponent);
        let (first, last) = (low / unit, high / unit);
        let slack = 1e-9;
        let count = |step: f64| (last / step + slack).floor() - (first / step - slack).ceil() + 1.0;
        let mut step = round_step((last - first) / wanted as f64);
        // A scale needs at least three ticks.
        for _ in 0..3 {
            if count(step) < 3.0 {
                step = round_step(0.4 * step);
            }
        }
        if !self.names.is_empty() {
            step = step.max(1.0 / unit);
        }
        let decimals = (-step.log10() - slack).ceil().max(0.0) as usize;
        let ticks = ((first / step - slack).ceil() as i64..=(last / step + slack).floor() as i64).map(|i| {
            let value = i as f64 * step;
            (value * unit, format!("{value:.decimals$}").replace('-', "\u{2212}"))
        });
        Fitted {
            scale: Scale::Linear,
            low,
            high,
            ticks: ticks.collect(),
            minor: Vec::new(),
            label: self.label(exponent),
        }
    }

    fn fit_log(&self, [low, high]: [f64; 2], pad: f64, per: f64) -> Fitted {
        let [low, high] = if low > high { [0.1, 10.0] } else { [low, high] };
        let [low, high] = [low.log10(), high.log10()];
        // A logarithmic axis needs most of a decade.
        let (middle, half) = (0.5 * (low + high), (0.5 * (high - low)).max(0.35));
        let half = half * (1.0 + 2.0 * pad);
        let [low, high] = [middle - half, middle + half];
        let exponent = self.magnitude.map_or(0, |magnitude| exponent(magnitude / per, &self.symbol));
        let shift = per.log10() + f64::from(exponent);
        let decades = (low - shift).floor() as i32..=(high - shift).ceil() as i32;
        let stride = (((high - low) / 7.0).ceil() as i32).max(1);
        let narrow = high - low < 1.6;
        let (mut ticks, mut minor) = (Vec::new(), Vec::new());
        for decade in decades {
            for digit in 1..10 {
                let place = shift + f64::from(decade) + f64::from(digit).log10();
                if !(low - 1e-9..=high + 1e-9).contains(&place) {
                    continue;
                }
                let value = 10f64.powf(place);
                if digit == 1 && decade.rem_euclid(stride) == 0 {
                    ticks.push((value, power_of_ten(decade)));
                } else if narrow && [2, 5].contains(&digit) {
                    ticks.push((value, times_power_of_ten(digit, decade)));
                } else if stride == 1 || digit == 1 {
                    minor.push(value);
                }
            }
        }
        Fitted {
            scale: Scale::Log,
            low: 10f64.powf(low),
            high: 10f64.powf(high),
            ticks,
            minor,
            label: self.label(exponent),
        }
    }

    fn label(&self, exponent: i32) -> String {
        match prefixed(&self.symbol, exponent) {
            unit if unit.is_empty() => self.quantity.clone(),
            unit => format!("{} ({unit})", self.quantity),
        }
    }
}

/// Returns whether a unit has a prefix for a power of ten.
fn takes_prefix(symbol: &str, exponent: i32) -> bool {
    // Inverse units such as 1/s take no prefix, and few units take one of large numbers.
    let is_large = exponent > 0;
    let is_usual = !is_large || ["J", "Hz", "N", "Pa"].contains(&symbol) || (symbol, exponent) == ("N s", 3);
    is_usual && !symbol.is_empty() && !symbol.starts_with('1')
}

/// Returns the unit of numbers that are multiples of a power of ten of a unit.
fn prefixed(symbol: &str, exponent: i32) -> String {
    match text::prefix_of(exponent).filter(|_| takes_prefix(symbol, exponent)) {
        _ if exponent == 0 => symbol.to_owned(),
        Some(prefix) => format!("{}{symbol}", prefix.replace('u', "µ")),
        None if symbol.is_empty() => power_of_ten(exponent),
        None => format!("{} {symbol}", power_of_ten(exponent)),
    }
}

/// Returns the unit of an axis whose values reach a magnitude, and its value in terms of `symbol`.
pub(super) fn unit(symbol: &str, magnitude: f64) -> (String, f64) {
    let exponent = exponent(magnitude, symbol);
    (prefixed(symbol, exponent), 10f64.powi(exponent))
}

/// Formats two significant digits for a picture.
pub fn short(value: f64) -> String {
    text::short(value).replace('-', "\u{2212}")
}

/// Axis with fixed ends and ticks.
pub(super) struct Fitted {
    scale: Scale,
    pub low: f64,
    pub high: f64,
    /// Data values of the ticks, with their texts.
    pub ticks: Vec<(f64, String)>,
    /// Ticks without a text.
    pub minor: Vec<f64>,
    pub label: String,
}

impl Fitted {
    /// Returns the position of a value along the axis, from 0 to 1; `None` if it cannot be drawn.
    pub fn share(&self, value: f64) -> Option<f64> {
        let share = match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log if value > LEAST => (value / self.low).ln() / (self.high / self.low).ln(),
            Scale::Log => return None,
        };
        (value.abs() < GREATEST && share.is_finite()).then_some(share)
    }
}

/// Returns whether a height can be shown without compressing the values too much.
pub(super) fn is_near(height: f64, values: impl Iterator<Item = f64>) -> bool {
    let [low, high] = range(values.filter(|value| value.abs() < GREATEST));
    let span = high - low;
    height.abs() < GREATEST && (span <= 0.0 || low - 2.0 * span <= height && height <= high + 2.0 * span)
}

/// Widens a range that is empty or too narrow for ticks.
fn wide_enough([low, high]: [f64; 2]) -> [f64; 2] {
    if low > high {
        return [0.0, 1.0];
    }
    let magnitude = low.abs().max(high.abs());
    if high - low > LEAST.max(1e-6 * magnitude) {
        return [low, high];
    }
    let half = if magnitude > LEAST { 0.5 * magnitude } else { 0.5 };
    [low - half, high + half]
}

/// Returns the power of ten, a multiple of three, that gives short tick texts.
fn exponent(magnitude: f64, symbol: &str) -> i32 {
    if !(LEAST..GREATEST).contains(&magnitude) {
        return 0;
    }
    // The largest number has one to three digits before the point, as in answers; without a prefix
    // it is from 0.1 up to 100, or plain.
    let (one, _) = text::prefix(magnitude);
    let exponent = one.log10().round() as i32;
    match takes_prefix(symbol, exponent) {
        true if magnitude > 0.1 * one => exponent,
        false if (1e-2..1e4).contains(&magnitude) => 0,
        _ => 3 * ((magnitude.log10() + 1.0) / 3.0).floor() as i32,
    }
}

/// Rounds up to 1, 2 or 5 times a power of ten.
fn round_step(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power);
    steps.into_iter().find(|&s| s >= step * (1.0 - 1e-9)).unwrap_or(step)
}

fn times_power_of_ten(digit: i32, exponent: i32) -> String {
    match exponent {
        -2..0 => format!("{:.*}", -exponent as usize, f64::from(digit) * 10f64.powi(exponent)),
        0..3 => (digit * 10_i32.pow(exponent as u32)).to_string(),
        _ => format!("{digit}·{}", power_of_ten(exponent)),
    }
}

fn power_of_ten(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let superscript = |c: char| c.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize]);
    match exponent {
        0 => "1".to_owned(),
        1 => "10".to_owned(),
        _ => format!("10{}", exponent.to_string().chars().map(superscript).collect::<String>()),
    }
}

#[cfg(test)]
mod tests {
    use super::unit;

    #[test]
    fn units_are_those_of_answers() {
        let name = |symbol, magnitude| unit(symbol, magnitude).0;
        assert_eq!([name("Pa", 1.7e8), name("Pa", 2.1e11), name("Pa", 5e3)], ["MPa", "GPa", "kPa"]);
        assert_eq!([name("s", 1e-4), name("s", 0.05), name("s", 0.5)], ["\u{b5}s", "ms", "ms"]);
        assert_eq!([name("m", 2e-4), name("N", 500.0), name("N s", 2e-16)], ["\u{b5}m", "N", "fN s"]);
        assert_eq!([name("m", 0.7), name("m", 2e3), name("N", 2e3)], ["mm", "m", "kN"]);
        assert_eq!([name("m", 0.0), name("1/s", 0.05), name("", 2e-5)], ["m", "1/s", "10⁻⁶"]);
    }
}
