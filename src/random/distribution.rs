//! Distributions of random numbers, written as `normal(1e-3, 1e-4)`.

use super::normal;
use crate::error::suggestion;

/// Family of distributions: its name, its numbers, and its quantiles.
struct Family {
    name: &'static str,
    /// Numbers in words.
    numbers: &'static str,
    /// Returns whether numbers belong to a distribution.
    takes: fn(&[f64]) -> bool,
    /// Returns the value that a share of all numbers is below.
    quantile: fn(&[f64], f64) -> f64,
}

/// All families.
const FAMILIES: [Family; 6] = [
    Family {
        name: "normal",
        numbers: "mean, deviation > 0",
        takes: |numbers| matches!(numbers, [_, deviation] if *deviation > 0.0),
        quantile: |numbers, share| numbers[0] + numbers[1] * normal::quantile(share),
    },
    Family {
        name: "lognormal",
        numbers: "mean of the logarithm, its deviation > 0",
        takes: |numbers| matches!(numbers, [_, deviation] if *deviation > 0.0),
        quantile: |numbers, share| (numbers[0] + numbers[1] * normal::quantile(share)).exp(),
    },
    Family {
        name: "uniform",
        numbers: "low, high > low",
        takes: |numbers| matches!(numbers, [low, high] if low < high),
        quantile: |numbers, share| numbers[0] + (numbers[1] - numbers[0]) * share,
    },
    Family {
        name: "triangular",
        numbers: "low, peak >= low, high >= peak, high > low",
        takes: |numbers| matches!(numbers, [low, peak, high] if low <= peak && peak <= high && low < high),
        quantile: |numbers, share| {
            let [low, peak, high] = [numbers[0], numbers[1], numbers[2]];
            let width = high - low;
            if share * width < peak - low {
                low + (share * width * (peak - low)).sqrt()
            } else {
                high - ((1.0 - share) * width * (high - peak)).sqrt()
            }
        },
    },
    Family {
        name: "truncated_normal",
        numbers: "mean, deviation > 0, low, high > low",
        takes: |numbers| matches!(numbers, [_, deviation, low, high] if *deviation > 0.0 && low < high),
        quantile: truncated,
    },
    Family {
        name: "values",
        numbers: "value, value, ..., all equally probable",
        takes: |numbers| !numbers.is_empty(),
        quantile: |numbers, share| numbers[(share * numbers.len() as f64) as usize],
    },
];

/// Returns a quantile of a normal distribution between two limits.
fn truncated(numbers: &[f64], share: f64) -> f64 {
    let [mean, deviation, low, high] = [numbers[0], numbers[1], numbers[2], numbers[3]];
    let ends = [low, high].map(|end| (end - mean) / deviation);
    // Probabilities near 1 would lose their digits.
    let sign = if ends[0] > 0.0 { -1.0 } else { 1.0 };
    let [first, last] = ends.map(|end| normal::probability_below(sign * end));
    let value = mean + sign * deviation * normal::quantile(first + share * (last - first));
    value.clamp(low, high)
}

/// Distribution of a random number.
#[derive(Debug, Clone, PartialEq)]
pub struct Distribution {
    /// Index into [`FAMILIES`].
    family: usize,
    numbers: Vec<f64>,
}

impl Distribution {
    /// Parses a distribution such as `normal(1e-3, 1e-4)`.
    ///
    /// # Errors
    /// Returns what is wrong and what was expected, in words.
    pub fn parse(text: &str) -> Result<Distribution, String> {
        let parts = text.trim().strip_suffix(')').and_then(|text| text.split_once('('));
        let Some((name, list)) = parts else {
            return Err(format!("{text:?} is no distribution; {}", Distribution::expected()));
        };
        let name = name.trim();
        let Some(family) = FAMILIES.iter().position(|family| family.name == name) else {
            let hint = suggestion(name, &FAMILIES.map(|family| family.name));
            return Err(format!("{name:?} is no distribution{hint}; {}", Distribution::expected()));
        };
        let number = |text: &str| match text.trim().parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(format!("{:?} is not a finite number", text.trim())),
        };
        let numbers = list.split(',').map(number).collect::<Result<Vec<f64>, String>>()?;
        let row = &FAMILIES[family];
        match (row.takes)(&numbers) {
            true => Ok(Distribution { family, numbers }),
            false => Err(format!("{text:?} has other numbers; expected {name}({})", row.numbers)),
        }
    }

    /// Returns the value that a share of all numbers, between 0 and 1, is below.
    pub fn quantile(&self, share: f64) -> f64 {
        (FAMILIES[self.family].quantile)(&self.numbers, share)
    }

    /// Returns the forms of all distributions in words.
    fn expected() -> String {
        let forms = FAMILIES.map(|Family { name, numbers, .. }| format!("{name}({numbers})"));
        format!("expected one of {}", forms.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::Distribution;

    fn quantile(text: &str, share: f64) -> f64 {
        Distribution::parse(text).unwrap_or_else(|wrong| panic!("{wrong}")).quantile(share)
    }

    /// Closed forms, and for the normal distribution table 26.1 of Abramowitz and Stegun.
    #[test]
    fn quantiles_are_the_known_ones() {
        let upper = 1.959_963_984_540_054_f64;
        let table = [
            ("normal(2, 3)", 0.975, 2.0 + 3.0 * upper),
            ("lognormal(-1, 0.5)", 0.975, (-1.0 + 0.5 * upper).exp()),
            ("uniform(-2, 6)", 0.25, 0.0),
            ("triangular(0, 1, 4)", 0.25, 1.0),
            ("triangular(0, 1, 4)", 0.75, 4.0 - 3_f64.sqrt()),
            ("triangular(0, 0, 2)", 0.75, 1.0),
            ("truncated_normal(1, 2, 1, 9e9)", 0.95, 1.0 + 2.0 * upper),
            // Far out an interval of the tail is exponential: both ends keep their digits.
            ("truncated_normal(0, 1, 30, 40)", 0.5, 30.023_068_6),
            ("truncated_normal(0, 1, -40, -30)", 0.5, -30.023_068_6),
            ("values(3, 5, 5, 8)", 0.24, 3.0),
            ("values(3, 5, 5, 8)", 0.5, 5.0),
            ("values(3, 5, 5, 8)", 0.999, 8.0),
        ];
        for (text, share, value) in table {
            assert!((quantile(text, share) - value).abs() < 1e-7 * value.abs() + 1e-15, "{text} {share}");
        }
    }

    #[test]
    fn what_is_no_distribution_is_said() {
        let refused = [
            (
                "normal 1, 2",
                "\"normal 1, 2\" is no distribution; expected one of normal(mean, deviation > 0), ",
            ),
            ("nromal(1, 2)", "\"nromal\" is no distribution (did you mean normal?)"),
            ("normal(1, 0)", "has other numbers; expected normal(mean, deviation > 0)"),
            ("normal(1)", "expected normal(mean, deviation > 0)"),
            ("uniform(2, 1)", "expected uniform(low, high > low)"),
            ("uniform(1, inf)", "\"inf\" is not a finite number"),
            ("triangular(1, 3, 2)", "expected triangular(low, peak >= low, high >= peak, high > low)"),
            ("values()", "\"\" is not a finite number"),
        ];
        for (text, wrong) in refused {
            let said = Distribution::parse(text).unwrap_err();
            assert!(said.contains(wrong), "{said}");
        }
    }
}
