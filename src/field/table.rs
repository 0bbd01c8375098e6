//! Tables of values over time, read from CSV and interpolated by piecewise polynomials.

use std::path::Path;

use super::Derivatives;
use crate::error::{Result, cut, error_at};
use crate::geometry::range;
use crate::input;

/// Interpolation between the rows of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// Straight lines; the slope jumps at the rows.
    Linear,
    /// Natural cubic spline: two continuous derivatives, no curvature at the ends.
    Spline,
}

/// Largest size of a table file, in bytes.
const LARGEST: u64 = 1_000_000_000;

/// Interpolated function of time; constant before the first and after the last row.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    pub(super) times: Vec<f64>,
    values: Vec<f64>,
    /// Coefficients of 1, s, s^2, s^3 per interval, where s is the time since its start.
    pub(super) pieces: Vec<[f64; 4]>,
}

impl Table {
    /// Reads a CSV file of `time,value` rows (s, and any unit), see [`Table::from_csv`].
    pub fn read(path: &Path, interpolation: Interpolation) -> Result<Table> {
        let bytes = input::read(path, LARGEST)?;
        Table::from_csv(&String::from_utf8_lossy(&bytes), &path.display().to_string(), interpolation)
    }

    /// Parses rows of `time,value` with ascending times and an optional header; `#` starts a
    /// comment.
    ///
    /// At least two rows are needed. An error names the line of `file`.
    pub fn from_csv(text: &str, file: &str, interpolation: Interpolation) -> Result<Table> {
        let fault = |line: usize, wrong: String| error_at(&format!("{file}:{line}"), &wrong);
        let (mut times, mut values, mut lines) = (Vec::new(), Vec::new(), Vec::<usize>::new());
        let mut has_begun = false;
        for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
            let line_number = index + 1;
            let row = line.split('#').next().unwrap_or_default().trim();
            let is_number = |cell: &str| cell.trim().parse::<f64>().is_ok();
            let is_header = !has_begun && !row.split(',').any(is_number);
            has_begun |= !row.is_empty();
            if row.is_empty() || is_header {
                continue;
            }
            let expected = || {
                let hint = match row.contains(';') {
                    true => format!(", such as {}", cut(&row.replace(',', ".").replace(';', ","))),
                    false if row.split(',').count() > 2 => "; a decimal point is written .".to_owned(),
                    false => String::new(),
                };
                format!("expected a time in s and a value, separated by a comma{hint}")
            };
            let Some((time, value)) = row.split_once(',').filter(|(_, value)| !value.contains(',')) else {
                return Err(fault(line_number, format!("found {}; {}", cut(row), expected())));
            };
            let number = |cell: &str| match cell.trim().parse::<f64>() {
                Ok(number) if number.is_finite() => Ok(number),
                _ => {
                    let wrong = format!("{:?} is not a finite number; {}", cut(cell.trim()), expected());
                    Err(fault(line_number, wrong))
                }
            };
            let (time, value) = (number(time)?, number(value)?);
            if let (Some(&before), Some(line)) = (times.last(), lines.last())
                && time <= before
            {
                let wrong =
                    format!("time {time:?} is not after {before:?} of line {line}; expected ascending times");
                return Err(fault(line_number, wrong));
            }
            times.push(time);
            values.push(value);
            lines.push(line_number);
        }
        if times.len() < 2 {
            let wrong = format!("the table ends after {} rows; expected at least 2", times.len());
            return Err(fault(text.lines().count().max(1), wrong));
        }
        let pieces = pieces(&times, &values, interpolation);
        if let Some(steep) = pieces.iter().position(|piece| piece.iter().any(|c| !c.is_finite())) {
            return Err(fault(lines[steep + 1], "the slope to this row is not a finite number".to_owned()));
        }
        Ok(Table { times, values, pieces })
    }

    /// Returns the table whose clock starts at an instant (s) of this one.
    pub fn from_time(&self, start: f64) -> Table {
        Table { times: self.times.iter().map(|time| time - start).collect(), ..self.clone() }
    }

    /// Returns the value at a time (s).
    pub fn value(&self, t: f64) -> f64 {
        self.jet(t).value
    }

    /// Returns the value and its first two derivatives at a time (s); at a row, those just after
    /// it.
    pub fn jet(&self, t: f64) -> Derivatives {
        let after = self.times.partition_point(|&time| time <= t);
        let held = |value| Derivatives { value, first: 0.0, second: 0.0 };
        if after == 0 {
            return held(self.values[0]);
        }
        let Some([a, b, c, d]) = self.pieces.get(after - 1) else { return held(self.values[after - 1]) };
        let s = t - self.times[after - 1];
        Derivatives {
            value: a + s * (b + s * (c + s * d)),
            first: b + s * (2.0 * c + s * 3.0 * d),
            second: 2.0 * c + s * 6.0 * d,
        }
    }

    /// Returns the largest overshoot of the curve beyond all row values; `None` where it stays
    /// within.
    pub fn overshoot(&self) -> Option<Overshoot> {
        let [low, high] = range(self.values.iter().copied());
        let mut worst: Option<Overshoot> = None;
        for ([_, b, c, d], ends) in self.pieces.iter().zip(self.times.windows(2)) {
            // Zeros of b + 2 c s + 3 d s^2.
            let root = (c * c - 3.0 * b * d).max(0.0).sqrt();
            let sum = -(c + root.copysign(*c));
            for s in [sum / (3.0 * d), b / sum] {
                if !(s > 0.0 && s < ends[1] - ends[0]) {
                    continue;
                }
                let time = ends[0] + s;
                let value = self.value(time);
                let share = (value - high).max(low - value) / (high - low);
                if share > 0.0 && worst.is_none_or(|worst| share > worst.share) {
                    worst = Some(Overshoot { time, value, share });
                }
            }
        }
        worst
    }
}

/// Overshoot of a spline beyond the values of its rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overshoot {
    /// Time of the largest overshoot, in s.
    pub time: f64,
    /// Value at that time.
    pub value: f64,
    /// Distance from the nearest row value, relative to the range of the rows.
    pub share: f64,
}

fn pieces(times: &[f64], values: &[f64], interpolation: Interpolation) -> Vec<[f64; 4]> {
    let lengths: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let slopes: Vec<f64> = values.windows(2).zip(&lengths).map(|(pair, h)| (pair[1] - pair[0]) / h).collect();
    let curvatures = match interpolation {
        Interpolation::Linear => vec![0.0; times.len()],
        Interpolation::Spline => natural_curvatures(&lengths, &slopes),
    };
    let piece = |i: usize| {
        let (left, right, h) = (curvatures[i], curvatures[i + 1], lengths[i]);
        [values[i], slopes[i] - h * (2.0 * left + right) / 6.0, left / 2.0, (right - left) / (6.0 * h)]
    };
    (0..lengths.len()).map(piece).collect()
}

/// Returns the second derivatives m at the rows, 0 at both ends, that make the first derivatives
/// continuous: h[i-1] m[i-1] + 2 (h[i-1] + h[i]) m[i] + h[i] m[i+1] = 6 (slope[i] - slope[i-1]),
/// solved by elimination.
fn natural_curvatures(lengths: &[f64], slopes: &[f64]) -> Vec<f64> {
    let count = lengths.len();
    let mut m = vec![0.0; count + 1];
    let mut ratios = vec![0.0; count];
    for i in 1..count {
        let pivot = 2.0 * (lengths[i - 1] + lengths[i]) - lengths[i - 1] * ratios[i - 1];
        ratios[i] = lengths[i] / pivot;
        m[i] = (6.0 * (slopes[i] - slopes[i - 1]) - lengths[i - 1] * m[i - 1]) / pivot;
    }
    for i in (1..count).rev() {
        m[i] -= ratios[i] * m[i + 1];
    }
    m
}
