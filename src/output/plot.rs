//! `plots/history.svg`: deflection and energy against time, fit for one column of a journal.
//!
//! All lengths here are in *units* of a twentieth of a millimetre of an 85 mm wide column; the drawing scales. Values are
//! turned to units before `plotters` sees them, so no data, however odd, can upset it.

use super::history::Table;
use super::write_atomic;
use crate::error::{Error, Result};
use plotters::prelude::{
    BLACK, Color, DrawingBackend, FontTransform, RGBColor, SVGBackend, ShapeStyle, TextStyle, WHITE,
};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::fs;
use std::io;
use std::path::Path;

/// A rigid obstacle, drawn as a shaded band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Obstacle {
    /// The plate stays above this height, m.
    Below(f64),
    /// The plate stays below this height, m.
    Above(f64),
}

/// Draws a history: the probes' deflection with the obstacles above, the energies over their start below.
///
/// Extremes survive: each column of the picture keeps its least and greatest value. Values that are not finite leave a
/// gap. An obstacle much farther away than the plate moves is left out. The folder is created if need be.
pub fn history(path: &Path, table: &Table, title: &str, obstacles: &[Obstacle]) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
    }
    let svg = draw(table, title, obstacles).map_err(Error::io(path))?;
    write_atomic(path, svg.as_bytes())
}

const WIDTH: i32 = 1700;
/// Width of the drawing where nothing else sizes it, mm.
const NOMINAL_WIDTH: i32 = 170;
const MARGIN: i32 = 30;
const DEFLECTION_HEIGHT: i32 = 640;
const ENERGY_HEIGHT: i32 = 460;

/// Font sizes in units: 7 and 8 points at 85 mm.
const LABEL: i32 = 49;
const TITLE: i32 = 56;
const LINE_SPACING: f64 = 1.35;
/// Mean width of a sans-serif character over its font size.
const CHARACTER: f64 = 0.56;

const AXIS_STROKE: u32 = 3;
const CURVE_STROKE: u32 = 4;
const TICK: i32 = 14;
const SAMPLE: i32 = 120;
const HATCH: i32 = 26;
/// Most that a dash pattern stretches.
const MOST_STRETCH: f64 = 3.0;

/// Values beyond are treated as not finite, and ranges below as zero.
const GREATEST: f64 = 1e100;
const LEAST: f64 = 1e-100;

const SHADE: RGBColor = RGBColor(222, 222, 222);
const SHADE_EDGE: RGBColor = RGBColor(110, 110, 110);
/// The palette of Okabe and Ito, told apart by every kind of colour vision, and dashes, told apart without colours.
const BLUE: RGBColor = RGBColor(0, 114, 178);
const VERMILION: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const PURPLE: RGBColor = RGBColor(204, 121, 167);
const ORANGE: RGBColor = RGBColor(230, 159, 0);
const SKY: RGBColor = RGBColor(86, 180, 233);
const SOLID: &[f64] = &[];
const DASHED: &[f64] = &[28.0, 14.0];
const DOTTED: &[f64] = &[7.0, 11.0];
const DASH_DOT: &[f64] = &[34.0, 12.0, 7.0, 12.0];
const LONG: &[f64] = &[60.0, 18.0];

const PROBE_COLORS: [RGBColor; 6] = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY];
const PROBE_DASHES: [&[f64]; 5] = [SOLID, DASHED, DASH_DOT, LONG, DOTTED];

const ENERGY_PENS: [(&str, Pen); 3] = [
    ("energy", Pen { color: BLACK, dashes: SOLID, stroke: CURVE_STROKE + 3 }),
    ("elastic", Pen { color: BLUE, dashes: SOLID, stroke: CURVE_STROKE }),
    ("kinetic", Pen { color: VERMILION, dashes: DASHED, stroke: CURVE_STROKE }),
];

#[derive(Clone, Copy)]
struct Pen {
    color: RGBColor,
    dashes: &'static [f64],
    stroke: u32,
}

impl Pen {
    /// The pen of a probe: thirty differ, and each of the first five has dashes of its own.
    fn of_probe(index: usize) -> Self {
        let color = PROBE_COLORS[index % PROBE_COLORS.len()];
        Pen { color, dashes: PROBE_DASHES[index % PROBE_DASHES.len()], stroke: CURVE_STROKE }
    }
}

/// How finely curves are drawn, which bounds the size of the file whatever the data.
#[derive(Clone, Copy)]
struct Detail {
    /// Columns of the picture that keep their extremes.
    columns: usize,
    /// Most periods of a dash pattern along one curve.
    periods: f64,
}

impl Detail {
    /// The full detail for one curve, shared when there are many.
    fn for_curves(count: usize) -> Self {
        Detail { columns: (6000 / count).clamp(50, 700), periods: (1000 / count).clamp(5, 150) as f64 }
    }
}

struct Curve<'a> {
    name: &'a str,
    values: &'a [f64],
    pen: Pen,
}

fn draw(table: &Table, title: &str, obstacles: &[Obstacle]) -> io::Result<String> {
    let column = |name| table.column(name).unwrap_or_default();
    let times = column("time");
    let deflections: Vec<Curve> = table
        .probes()
        .enumerate()
        .map(|(index, (name, values))| Curve { name, values, pen: Pen::of_probe(index) })
        .collect();
    let energies = ENERGY_PENS.map(|(name, pen)| Curve { name, values: column(name), pen });

    let deflection_range = Range::of(deflections.iter().flat_map(|curve| curve.values));
    let obstacles: Vec<Obstacle> =
        obstacles.iter().copied().filter(|&obstacle| deflection_range.is_near(obstacle.height())).collect();
    let deflection_axis = Axis::new(
        deflection_range.with_all(obstacles.iter().map(|obstacle| obstacle.height())).padded(),
        "deflection",
        "m",
        5,
    );
    let energy_range = Range::of(energies.iter().flat_map(|curve| curve.values)).with_all([0.0]);
    let start = energies[0].values.iter().copied().find(|&energy| drawable(energy)).unwrap_or(0.0);
    let energy_axis = if start > LEAST.max(1e-9 * energy_range.magnitude()) {
        Axis::new(energy_range.padded(), "energy / initial", "", 5).per(start)
    } else {
        Axis::new(energy_range.padded(), "energy", "J", 5)
    };
    let time_axis = Axis::new(Range::of(times).or_unit(), "time", "s", 8);

    let left =
        MARGIN + line_height(LABEL) + 40 + deflection_axis.label_width().max(energy_axis.label_width());
    let right = WIDTH - MARGIN - time_axis.label_width() / 2;
    let title = wrapped_title(title, right - left);
    let deflection_legend = Legend::new(&deflections, !obstacles.is_empty(), right - left);
    let energy_legend = Legend::new(&energies, false, right - left);

    let top = MARGIN + title.len() as i32 * line_height(TITLE) + deflection_legend.height();
    let upper = Panel { left, right, top, bottom: top + DEFLECTION_HEIGHT };
    let top = upper.bottom + MARGIN + energy_legend.height();
    let lower = Panel { left, right, top, bottom: top + ENERGY_HEIGHT };
    let height = lower.bottom + 2 * line_height(LABEL) + MARGIN;

    let mut svg = String::new();
    let mut paper = Paper(SVGBackend::with_string(&mut svg, (WIDTH as u32, height as u32)));
    paper.rectangle((0, 0), (WIDTH, height), WHITE)?;
    for (i, line) in title.iter().enumerate() {
        let y = MARGIN + i as i32 * line_height(TITLE) + line_height(TITLE) / 2;
        paper.text(line, ((left + right) / 2, y), TITLE, HPos::Center, false)?;
    }

    let detail = Detail::for_curves(deflections.len() + energies.len());
    for &obstacle in &obstacles {
        upper.draw_obstacle(&mut paper, &deflection_axis, obstacle)?;
    }
    upper.draw_curves(&mut paper, times, &deflections, &time_axis, &deflection_axis, detail)?;
    upper.draw_frame(&mut paper, &time_axis, &deflection_axis, false)?;
    deflection_legend.draw(&mut paper, &upper)?;
    lower.draw_curves(&mut paper, times, &energies, &time_axis, &energy_axis, detail)?;
    lower.draw_frame(&mut paper, &time_axis, &energy_axis, true)?;
    energy_legend.draw(&mut paper, &lower)?;
    paper.0.present().map_err(io::Error::other)?;
    drop(paper);

    // The backend speaks of pixels; let the drawing have a size on paper, and no spikes where curves turn sharply.
    let pixels = format!("width=\"{WIDTH}\" height=\"{height}\"");
    let nominal_height = f64::from(height * NOMINAL_WIDTH) / f64::from(WIDTH);
    let on_paper =
        format!("width=\"{NOMINAL_WIDTH}mm\" height=\"{nominal_height:.1}mm\" stroke-linejoin=\"round\"");
    Ok(svg.replacen(&pixels, &on_paper, 1))
}

impl Obstacle {
    fn height(self) -> f64 {
        match self {
            Obstacle::Below(height) | Obstacle::Above(height) => height,
        }
    }
}

fn drawable(value: f64) -> bool {
    value.abs() < GREATEST
}

/// The interval that some values span; empty while `low > high`.
#[derive(Clone, Copy)]
struct Range {
    low: f64,
    high: f64,
}

impl Range {
    fn of<'a>(values: impl IntoIterator<Item = &'a f64>) -> Self {
        Range { low: f64::INFINITY, high: f64::NEG_INFINITY }.with_all(values.into_iter().copied())
    }

    fn with_all(self, values: impl IntoIterator<Item = f64>) -> Self {
        values
            .into_iter()
            .filter(|&value| drawable(value))
            .fold(self, |range, value| Range { low: range.low.min(value), high: range.high.max(value) })
    }

    fn magnitude(self) -> f64 {
        if self.low > self.high { 0.0 } else { self.low.abs().max(self.high.abs()) }
    }

    /// Whether showing that height still leaves a good part of the picture to the values.
    fn is_near(self, height: f64) -> bool {
        let span = self.high - self.low;
        drawable(height)
            && (span <= 0.0 || self.low - 2.0 * span <= height && height <= self.high + 2.0 * span)
    }

    /// The range itself, or when its values hardly differ or there are none, one wide enough to carry ticks.
    fn or_unit(self) -> Self {
        let magnitude = self.magnitude();
        if self.high - self.low > LEAST.max(1e-6 * magnitude) {
            return self;
        }
        if self.low > self.high {
            return Range { low: 0.0, high: 1.0 };
        }
        let half = if magnitude > LEAST { 0.5 * magnitude } else { 0.5 };
        Range { low: self.low - half, high: self.high + half }
    }

    /// A little larger on both sides.
    fn padded(self) -> Self {
        let Range { low, high } = self.or_unit();
        let pad = 0.08 * (high - low);
        Range { low: low - pad, high: high + pad }
    }
}

/// An axis: its range, its ticks and what is written along it.
struct Axis {
    range: Range,
    /// Data over what the ticks count.
    unit: f64,
    quantity: &'static str,
    symbol: &'static str,
    wanted: usize,
}

impl Axis {
    fn new(range: Range, quantity: &'static str, symbol: &'static str, wanted: usize) -> Self {
        Axis { range, unit: 1.0, quantity, symbol, wanted }
    }

    /// The same axis counted in multiples of `unit`.
    fn per(self, unit: f64) -> Self {
        Axis { unit, ..self }
    }

    /// The power of ten, a multiple of three, that makes ticks short to write.
    fn exponent(&self) -> i32 {
        let magnitude = self.range.magnitude() / self.unit;
        // 0.1 up to 100 of a unit.
        let exponent = 3 * ((magnitude.log10() + 1.0) / 3.0).floor() as i32;
        if (1e-2..1e4).contains(&magnitude) && (exponent > 0 || self.symbol.is_empty()) {
            0
        } else {
            exponent
        }
    }

    fn label(&self) -> String {
        let exponent = self.exponent();
        let unit = match (self.symbol, exponent) {
            ("", 0) => return self.quantity.to_owned(),
            ("", _) => power_of_ten(exponent),
            (symbol, 0) => symbol.to_owned(),
            ("J", 3) => "kJ".to_owned(),
            ("J", 6) => "MJ".to_owned(),
            (symbol, -3) => format!("m{symbol}"),
            (symbol, -6) => format!("µ{symbol}"),
            (symbol, -9) => format!("n{symbol}"),
            (symbol, _) => format!("{} {symbol}", power_of_ten(exponent)),
        };
        format!("{} ({unit})", self.quantity)
    }

    /// Where in the data the ticks are, and their texts.
    fn ticks(&self) -> Vec<(f64, String)> {
        let unit = self.unit * 10f64.powi(self.exponent());
        let (low, high) = (self.range.low / unit, self.range.high / unit);
        let slack = 1e-9;
        let step = round_step((high - low) / self.wanted as f64);
        let decimals = (-step.log10() - slack).ceil().max(0.0) as usize;
        let first = (low / step - slack).ceil() as i64;
        let last = (high / step + slack).floor() as i64;
        (first..=last)
            .map(|i| {
                let value = i as f64 * step;
                (value * unit, format!("{value:.decimals$}").replace('-', "\u{2212}"))
            })
            .collect()
    }

    fn label_width(&self) -> i32 {
        self.ticks().iter().map(|(_, text)| text_width(text, LABEL)).max().unwrap_or(0)
    }

    /// Where a value lies along the axis, from 0 to 1.
    fn fraction(&self, value: f64) -> f64 {
        (value - self.range.low) / (self.range.high - self.range.low)
    }
}

/// The least of 1, 2 and 5 times a power of ten that is not less.
fn round_step(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|digit| digit * power)
        .into_iter()
        .find(|&s| s >= step * (1.0 - 1e-9))
        .unwrap_or(step)
}

fn power_of_ten(exponent: i32) -> String {
    let superscript = |c| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32('⁰' as u32 + digit as u32 - '0' as u32).unwrap_or(digit),
    };
    format!("10{}", exponent.to_string().chars().map(superscript).collect::<String>())
}

fn line_height(font: i32) -> i32 {
    (LINE_SPACING * font as f64) as i32
}

fn text_width(text: &str, font: i32) -> i32 {
    (CHARACTER * font as f64 * text.chars().count() as f64) as i32
}

/// Packs items of given widths into as few rows as order allows; tells the row of each.
fn rows(widths: impl IntoIterator<Item = i32>, available: i32) -> Vec<usize> {
    let (mut row, mut used) = (0, 0);
    widths
        .into_iter()
        .map(|width| {
            if used > 0 && used + width > available {
                (row, used) = (row + 1, 0);
            }
            used += width;
            row
        })
        .collect()
}

fn wrapped_title(title: &str, available: i32) -> Vec<String> {
    let words: Vec<&str> = title.split_whitespace().collect();
    let widths = words.iter().map(|word| text_width(word, TITLE) + text_width(" ", TITLE));
    let mut lines: Vec<String> = Vec::new();
    for (row, word) in rows(widths, available).into_iter().zip(words) {
        match lines.get_mut(row) {
            Some(line) => *line = format!("{line} {word}"),
            None => lines.push(word.to_owned()),
        }
    }
    lines
}

/// The key to a panel's curves, above it so that it never covers data.
struct Legend {
    entries: Vec<Entry>,
}

struct Entry {
    name: String,
    /// A curve's pen; the obstacle's shade has none.
    pen: Option<Pen>,
    row: usize,
    width: i32,
}

impl Legend {
    fn new(curves: &[Curve], with_obstacle: bool, available: i32) -> Self {
        let names = curves.iter().map(|curve| (curve.name, Some(curve.pen)));
        let mut entries: Vec<Entry> = names
            .chain(with_obstacle.then_some(("obstacle", None)))
            .map(|(name, pen)| Entry {
                name: name.to_owned(),
                pen,
                row: 0,
                width: SAMPLE + 20 + text_width(name, LABEL) + 50,
            })
            .collect();
        let rows = rows(entries.iter().map(|entry| entry.width), available);
        entries.iter_mut().zip(rows).for_each(|(entry, row)| entry.row = row);
        Legend { entries }
    }

    fn height(&self) -> i32 {
        let rows = self.entries.last().map_or(0, |entry| entry.row as i32 + 1);
        rows * line_height(LABEL) + 12
    }

    fn draw(&self, paper: &mut Paper, panel: &Panel) -> io::Result<()> {
        let (mut x, mut row) = (panel.left, 0);
        for entry in &self.entries {
            if entry.row != row {
                (x, row) = (panel.left, entry.row);
            }
            let y = panel.top - self.height() + row as i32 * line_height(LABEL) + line_height(LABEL) / 2;
            match entry.pen {
                Some(pen) => {
                    let ends = [x, x + SAMPLE].map(|x| (x as f64, y as f64));
                    paper.curve(&ends, pen, f64::INFINITY)?;
                }
                None => {
                    let half = HATCH / 2;
                    paper.rectangle((x, y - half), (x + SAMPLE, y + half), SHADE)?;
                    paper.hatch(x, x + SAMPLE, y - half, HATCH)?;
                }
            }
            paper.text(&entry.name, (x + SAMPLE + 20, y), LABEL, HPos::Left, false)?;
            x += entry.width;
        }
        Ok(())
    }
}

/// The rectangle in which curves are drawn.
struct Panel {
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
}

impl Panel {
    fn x(&self, axis: &Axis, value: f64) -> f64 {
        self.left as f64 + axis.fraction(value) * (self.right - self.left) as f64
    }

    fn y(&self, axis: &Axis, value: f64) -> f64 {
        self.bottom as f64 - axis.fraction(value) * (self.bottom - self.top) as f64
    }

    fn draw_obstacle(&self, paper: &mut Paper, axis: &Axis, obstacle: Obstacle) -> io::Result<()> {
        let y = self.y(axis, obstacle.height()).round() as i32;
        let (end, depth) = match obstacle {
            Obstacle::Below(_) => (self.bottom, HATCH.min(self.bottom - y)),
            Obstacle::Above(_) => (self.top, (-HATCH).max(self.top - y)),
        };
        paper.rectangle((self.left, y.min(end)), (self.right, y.max(end)), SHADE)?;
        paper.hatch(self.left, self.right, y, depth)
    }

    fn draw_curves(
        &self,
        paper: &mut Paper,
        times: &[f64],
        curves: &[Curve],
        time_axis: &Axis,
        axis: &Axis,
        detail: Detail,
    ) -> io::Result<()> {
        let mut anything = false;
        // The first curve ends up on top.
        for curve in curves.iter().rev() {
            let points =
                times.iter().zip(curve.values).map(|(&time, &value)| (time_axis.fraction(time), value));
            for line in decimated(points, detail.columns) {
                let width = (self.right - self.left) as f64;
                let line: Vec<_> = line
                    .iter()
                    .map(|&(x, value)| (self.left as f64 + x * width, self.y(axis, value)))
                    .collect();
                paper.curve(&line, curve.pen, detail.periods)?;
                anything = true;
            }
        }
        if !anything {
            let middle = ((self.left + self.right) / 2, (self.top + self.bottom) / 2);
            paper.text("no data", middle, LABEL, HPos::Center, false)?;
        }
        Ok(())
    }

    fn draw_frame(
        &self,
        paper: &mut Paper,
        time_axis: &Axis,
        axis: &Axis,
        with_times: bool,
    ) -> io::Result<()> {
        let &Panel { left, right, top, bottom } = self;
        let (middle, row) = (line_height(LABEL) / 2, line_height(LABEL));
        for (time, text) in time_axis.ticks() {
            let x = self.x(time_axis, time).round() as i32;
            paper.line(&[(x, bottom), (x, bottom - TICK)])?;
            paper.line(&[(x, top), (x, top + TICK)])?;
            if with_times {
                paper.text(&text, (x, bottom + middle + 8), LABEL, HPos::Center, false)?;
            }
        }
        for (value, text) in axis.ticks() {
            let y = self.y(axis, value).round() as i32;
            paper.line(&[(left, y), (left + TICK, y)])?;
            paper.line(&[(right, y), (right - TICK, y)])?;
            paper.text(&text, (left - 14, y), LABEL, HPos::Right, false)?;
        }
        paper.line(&[(left, top), (right, top), (right, bottom), (left, bottom), (left, top)])?;
        paper.text(&axis.label(), (MARGIN + middle, (top + bottom) / 2), LABEL, HPos::Center, true)?;
        if with_times {
            let position = ((left + right) / 2, bottom + row + middle + 8);
            paper.text(&time_axis.label(), position, LABEL, HPos::Center, false)?;
        }
        Ok(())
    }
}

/// Keeps the least and the greatest value of each of `columns` columns over `x` in 0 to 1, in their order.
///
/// A column without any drawable value ends a line and the next begins another.
fn decimated(points: impl IntoIterator<Item = (f64, f64)>, columns: usize) -> Vec<Vec<(f64, f64)>> {
    struct Column {
        index: usize,
        extremes: Option<[(f64, f64); 2]>,
    }
    let mut lines = vec![Vec::new()];
    let mut close = |column: Column| match (column.extremes, lines.last_mut()) {
        (Some([least, greatest]), Some(line)) => {
            line.push(if least.0 <= greatest.0 { least } else { greatest });
            if least.0 != greatest.0 {
                line.push(if least.0 <= greatest.0 { greatest } else { least });
            }
        }
        _ => lines.push(Vec::new()),
    };

    let mut current: Option<Column> = None;
    for point in points.into_iter().filter(|point| point.0.is_finite()) {
        let index = (point.0 * columns as f64) as usize;
        if let Some(column) = current.take_if(|column| column.index != index) {
            close(column);
        }
        let column = current.get_or_insert(Column { index, extremes: None });
        if drawable(point.1) {
            let [least, greatest] = column.extremes.get_or_insert([point; 2]);
            if point.1 < least.1 {
                *least = point;
            }
            if point.1 > greatest.1 {
                *greatest = point;
            }
        }
    }
    if let Some(column) = current {
        close(column);
    }
    lines.retain(|line| !line.is_empty());
    lines
}

/// What is drawn on, with the few verbs that the picture needs.
struct Paper<'a>(SVGBackend<'a>);

impl Paper<'_> {
    fn rectangle(&mut self, from: (i32, i32), to: (i32, i32), color: RGBColor) -> io::Result<()> {
        self.0.draw_rect(from, to, &color.filled(), true).map_err(io::Error::other)
    }

    fn line(&mut self, points: &[(i32, i32)]) -> io::Result<()> {
        self.0.draw_path(points.iter().copied(), &BLACK.stroke_width(AXIS_STROKE)).map_err(io::Error::other)
    }

    /// The edge of something solid: a line with short oblique strokes that reach `depth` into it.
    fn hatch(&mut self, left: i32, right: i32, y: i32, depth: i32) -> io::Result<()> {
        let style = SHADE_EDGE.stroke_width(AXIS_STROKE);
        self.0.draw_line((left, y), (right, y), &style).map_err(io::Error::other)?;
        let run = depth.abs();
        for x in (left + run..=right).step_by(HATCH as usize) {
            self.0.draw_line((x, y), (x - run, y + depth), &style).map_err(io::Error::other)?;
        }
        Ok(())
    }

    fn curve(&mut self, points: &[(f64, f64)], pen: Pen, periods: f64) -> io::Result<()> {
        let style: ShapeStyle = pen.color.stroke_width(pen.stroke);
        if let [(x, y)] = *points {
            let center = (x.round() as i32, y.round() as i32);
            return self
                .0
                .draw_circle(center, 2 * pen.stroke, &style.filled(), true)
                .map_err(io::Error::other);
        }
        for dash in dashes(points, pen.dashes, periods) {
            self.0.draw_path(dash, &style).map_err(io::Error::other)?;
        }
        Ok(())
    }

    /// Text centred on a height; `upwards` text is read from the right.
    fn text(&mut self, text: &str, at: (i32, i32), font: i32, anchor: HPos, upwards: bool) -> io::Result<()> {
        let visible: String = text.chars().filter(|c| !c.is_control()).collect();
        // The SVG backend divides font sizes by 1.24.
        let mut style =
            TextStyle::from(("sans-serif", 1.24 * font as f64)).pos(Pos::new(anchor, VPos::Center));
        if upwards {
            style = style.transform(FontTransform::Rotate270);
        }
        self.0.draw_text(&visible, &style, at).map_err(io::Error::other)
    }
}

/// Cuts a line into the drawn pieces of a dash pattern (lengths drawn and skipped in turn; none: the whole line).
///
/// The pattern stretches so that no more than so many `periods` are drawn; but a line stays whole when it is so long and dense
/// that the stretched pattern would leave holes in the data.
fn dashes(points: &[(f64, f64)], pattern: &[f64], periods: f64) -> Vec<Vec<(i32, i32)>> {
    let rounded = |(x, y): (f64, f64)| (x.round() as i32, y.round() as i32);
    let distance = |a: (f64, f64), b: (f64, f64)| (b.0 - a.0).hypot(b.1 - a.1);
    let length: f64 = points.windows(2).map(|ends| distance(ends[0], ends[1])).sum();
    let period: f64 = pattern.iter().sum();
    let stretch = (length / (periods * period)).max(1.0);
    if period == 0.0 || length == 0.0 || stretch > MOST_STRETCH {
        return vec![points.iter().copied().map(rounded).collect()];
    }

    let mut pieces = vec![vec![rounded(points[0])]];
    let mut lengths = pattern.iter().map(|length| length * stretch).cycle();
    let (mut drawn, mut left) = (true, lengths.next().unwrap_or(length));
    for ends in points.windows(2) {
        let (mut from, to) = (ends[0], ends[1]);
        let mut rest = distance(from, to);
        while rest > left {
            let share = left / rest;
            from = (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1));
            rest -= left;
            match pieces.last_mut() {
                Some(piece) if drawn => piece.push(rounded(from)),
                _ => pieces.push(vec![rounded(from)]),
            }
            (drawn, left) = (!drawn, lengths.next().unwrap_or(length));
        }
        left -= rest;
        if let (true, Some(piece)) = (drawn, pieces.last_mut()) {
            piece.push(rounded(to));
        }
    }
    pieces
}
