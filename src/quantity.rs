//! Numbers and quantities as texts: significant digits, prefixes of units, places.

/// SI prefixes of the powers of 1000 from -5 to 4.
pub const PREFIXES: [&str; 10] = ["f", "p", "n", "u", "m", "", "k", "M", "G", "T"];

/// Formats five significant digits without trailing zeros, with an exponent outside 0.001 to 1e6.
pub fn significant(value: f64) -> String {
    significant_digits(value, 5)
}

/// Formats some significant digits as [`significant`] formats five.
pub fn significant_digits(value: f64, digits: usize) -> String {
    if value == 0.0 {
        return "0".into(); // which -0.0 is too
    }
    if !value.is_finite() {
        return value.to_string();
    }
    let magnitude = value.abs().log10().floor();
    if !(-3.0..6.0).contains(&magnitude) {
        let digits = format!("{value:.*e}", digits - 1);
        let (mantissa, exponent) = digits.split_once('e').unwrap_or((&digits, "0"));
        return format!("{}e{exponent}", without_idle_zeros(mantissa));
    }
    let decimals = (digits as f64 - 1.0 - magnitude).max(0.0) as usize;
    without_idle_zeros(&format!("{value:.decimals$}")).to_owned()
}

/// Formats a number in SI units with four significant digits and the prefix of the unit that leaves
/// one to three digits before the point.
///
/// ```
/// use rebond::quantity::engineering;
///
/// assert_eq!(engineering(-0.2085, "m"), "-208.5 mm");
/// assert_eq!(engineering(20.169e6, "Pa"), "20.17 MPa");
/// assert_eq!(engineering(0.0, "N s"), "0 N s");
/// ```
pub fn engineering(value: f64, unit: &str) -> String {
    let (scale, prefix) = prefix(value);
    format!("{} {prefix}{unit}", significant_digits(value / scale, 4))
}

/// Raises the exponents of a unit.
pub fn raised(unit: &str) -> String {
    unit.replace("m2", "m²").replace("m3", "m³").replace("s2", "s²")
}

/// Sets a text: micro, minus and times signs, and each unit beside its number.
pub fn typeset(text: &str) -> String {
    let mut words: Vec<String> = Vec::new();
    for word in text.split(' ') {
        let unit = word.trim_end_matches([',', ';']);
        let bare = |prefix: &&str| unit.strip_prefix(*prefix);
        let is_unit = PREFIXES.iter().filter_map(bare).any(|unit| UNITS.contains(&unit));
        let is_number = |last: &String| last.ends_with(|c: char| c.is_ascii_digit() || ")N".contains(c));
        match (words.last_mut(), word.strip_prefix('u')) {
            (Some(last), Some(rest)) if is_unit && is_number(last) => *last += &format!("\u{a0}\u{b5}{rest}"),
            (Some(last), None) if is_unit && is_number(last) => *last += &format!("\u{a0}{word}"),
            _ if word == "x" => words.push("\u{d7}".into()),
            _ => words.push(word.replace('-', "\u{2212}")),
        }
    }
    words.join(" ")
}

/// Units in texts.
const UNITS: [&str; 17] = [
    "m", "s", "Pa", "N", "J", "Hz", "g", "%", "m/s", "W", "N/m", "N/m²", "N/m³", "N/m^1.5", "s/m", "s/m²",
    "s/m³",
];

/// Formats the coordinates of a point, given in m, with four digits of the larger one.
pub fn place(point: [f64; 2]) -> String {
    let largest = point[0].abs().max(point[1].abs());
    let (scale, prefix) = prefix(largest);
    place_in(point, scale, &format!("{prefix}m"))
}

/// Formats the coordinates of a point, given in m, in a unit of some metres.
pub fn place_in(point: [f64; 2], scale: f64, unit: &str) -> String {
    let largest = point[0].abs().max(point[1].abs());
    let decimals = (3.0 - (largest / scale).log10().floor()).clamp(0.0, 6.0) as usize;
    let [x, y] = point.map(|x| {
        let digits = format!("{:.decimals$}", x / scale);
        let digits = without_idle_zeros(&digits);
        if digits == "-0" { "0".to_owned() } else { digits.to_owned() }
    });
    format!("({x}, {y}) {unit}")
}

/// Returns the power of 1000 that leaves one to three digits of a value before the point, after
/// rounding to four digits, and its prefix.
pub fn prefix(value: f64) -> (f64, &'static str) {
    if value == 0.0 || !value.is_finite() {
        return (1.0, "");
    }
    // 0.99995 and more round up to 1.
    let power = ((value.abs() / 0.99995).log10() / 3.0).floor().clamp(-5.0, 4.0);
    (1000_f64.powf(power), prefix_of(3 * power as i32).unwrap_or_default())
}

/// Returns the SI prefix of a power of ten; `None` where it has none.
pub fn prefix_of(exponent: i32) -> Option<&'static str> {
    let number = usize::try_from(exponent / 3 + 5).ok().filter(|_| exponent % 3 == 0)?;
    PREFIXES.get(number).copied()
}

/// Formats two digits as [`significant`] formats five.
pub fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return significant(value);
    }
    let digit = 10f64.powf(value.abs().log10().floor() - 1.0);
    significant((value / digit).round() * digit)
}

/// Formats two significant digits with an exponent, as errors and residuals are told.
pub fn two_digits(value: f64) -> String {
    if value == 0.0 { "0".into() } else { format!("{value:.1e}") }
}

fn without_idle_zeros(decimal: &str) -> &str {
    if decimal.contains('.') { decimal.trim_end_matches('0').trim_end_matches('.') } else { decimal }
}
