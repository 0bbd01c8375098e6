//! Figures: panels of curves in rows and columns, with titles, keys, axes and remarks.

use super::axis::{Axis, Fitted, is_near};
use super::paper::{Anchor, At, Canvas, Color, Pen, Type, png};
use crate::error::{Error, Result};
use crate::output::write_atomic;
use std::fs;
use std::path::Path;

/// Widths of a journal's column (85 mm) and page (180 mm), in points.
const COLUMN: f64 = 240.94;
const PAGE: f64 = 510.24;

const MARGIN: f64 = 4.0;
const TITLE: Type = Type { bold: true, ..Type::new(7.5) };
const LABEL: Type = Type::new(7.0);
const TICK_LABEL: Type = Type::new(6.5);
const KEY: Type = Type::new(6.5);
const REMARK: Type = Type { color: Color::GREY, halo: true, ..Type::new(6.0) };
const NOTE: Type = Type { color: Color::GREY, ..Type::new(4.5) };

const FRAME: Pen = Pen::solid(Color::BLACK, 0.5);
const RULE: Pen = Pen { color: Color::GREY, dashes: &[1.2, 1.8], width: 0.6 };
const SOLID_EDGE: Pen = Pen::solid(Color::GREY, 0.5);
const TICK: f64 = 2.6;
const HATCH: f64 = 4.0;
/// Length of a curve's sample in the key, in points.
const SAMPLE: f64 = 20.0;
const MARKER: f64 = 2.1;

/// Palette of Okabe and Ito (2008), darkest first, distinct for every kind of colour vision.
const COLORS: [Color; 7] = [
    Color(0, 114, 178),
    Color(213, 94, 0),
    Color(0, 158, 115),
    Color(204, 121, 167),
    Color(230, 159, 0),
    Color(86, 180, 233),
    Color::BLACK,
];
/// Dash patterns, distinct without colours.
const DASHES: [&[f64]; 5] = [&[], &[4.0, 2.0], &[5.0, 1.6, 1.0, 1.6], &[8.0, 2.2], &[1.0, 1.4]];
const MARKERS: [Marker; 6] =
    [Marker::Circle, Marker::Square, Marker::Triangle, Marker::Diamond, Marker::Cross, Marker::Plus];

/// Length of a dashed curve, in widths of its panel, above which it is drawn solid.
///
/// The dashes of a longer curve would hide data.
const MOST_DASHED: f64 = 8.0;

/// Symbol at each point of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Marker {
    Circle,
    Square,
    Triangle,
    Diamond,
    Cross,
    Plus,
}

/// A curve, a set of marks, or both.
#[derive(Debug, Clone)]
pub struct Curve {
    name: String,
    points: Vec<[f64; 2]>,
    pen: Pen,
    line: bool,
    marker: Option<Marker>,
    is_open: bool,
    /// Size of the markers relative to the default.
    size: f64,
}

impl Curve {
    /// Creates a line through points (x, y), with a gap at each point that is not finite.
    ///
    /// A curve without a name has no entry in the key.
    pub fn new(name: impl Into<String>, points: Vec<[f64; 2]>) -> Curve {
        let pen = Pen::solid(Color::BLACK, 0.9);
        Curve { name: name.into(), points, pen, line: true, marker: None, is_open: false, size: 1.0 }
    }

    /// Creates a curve from columns, such as times and values.
    pub fn of(name: impl Into<String>, x: &[f64], y: &[f64]) -> Curve {
        Curve::new(name, x.iter().zip(y).map(|(&x, &y)| [x, y]).collect())
    }

    /// Sets the `index`-th combination of colour and dashes.
    ///
    /// There are 35 combinations; the first five differ in their dashes.
    pub fn style(mut self, index: usize) -> Curve {
        self.pen.color = COLORS[index % COLORS.len()];
        self.pen.dashes = DASHES[index % DASHES.len()];
        self
    }

    /// Sets the colour.
    pub fn color(mut self, color: Color) -> Curve {
        self.pen.color = color;
        self
    }

    /// Sets the `index`-th colour of the palette.
    pub fn palette(self, index: usize) -> Curve {
        self.color(COLORS[index % COLORS.len()])
    }

    /// Sets the `index`-th dash pattern; 0 is solid.
    pub fn dashes(mut self, index: usize) -> Curve {
        self.pen.dashes = DASHES[index % DASHES.len()];
        self
    }

    /// Sets the line width in points instead of 0.9.
    pub fn width(mut self, points: f64) -> Curve {
        self.pen.width = points;
        self
    }

    /// Sets the `index`-th marker at each point.
    pub fn marks(mut self, index: usize) -> Curve {
        self.marker = Some(MARKERS[index % MARKERS.len()]);
        self.is_open = index / MARKERS.len() % 2 == 1;
        self
    }

    /// Makes the markers hollow.
    pub fn open(mut self) -> Curve {
        self.is_open = true;
        self
    }

    /// Multiplies the width of the markers.
    pub fn size(mut self, times: f64) -> Curve {
        self.size = times;
        self
    }

    /// Removes the line.
    pub fn scattered(mut self) -> Curve {
        self.line = false;
        self
    }
}

/// Rigid obstacle, drawn as a hatched band, or as a line if it faces only a part of the plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Obstacle {
    /// Obstacle below the whole plate, at this height in m.
    Below(f64),
    /// Obstacle above the whole plate, at this height in m.
    Above(f64),
    /// Obstacle that faces a part of the plate, at this height in m.
    Part(f64),
}

impl Obstacle {
    /// Returns the height in m.
    pub fn height(self) -> f64 {
        match self {
            Obstacle::Below(height) | Obstacle::Above(height) | Obstacle::Part(height) => height,
        }
    }
}

/// Bar along x at a height of the y axis, such as an interval of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bar {
    /// Ends along x.
    pub x: [f64; 2],
    /// Ends along y.
    pub y: [f64; 2],
    /// Colour of the bar.
    pub color: Color,
}

/// Colour scale with its label and its ends.
#[derive(Debug, Clone)]
pub struct Ramp {
    /// Label: the quantity with its unit.
    pub label: String,
    /// Values at the two ends.
    pub ends: [String; 2],
    /// Colour for a share from 0 to 1.
    pub color: fn(f64) -> Color,
}

/// Frame of a panel, in points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

/// Drawing function of a panel without axes.
type Drawing = Box<dyn Fn(&mut Canvas, Frame)>;

/// Panel of a figure.
pub struct Panel {
    axes: Option<[Axis; 2]>,
    heading: String,
    height: f64,
    has_x_labels: bool,
    curves: Vec<Curve>,
    obstacles: Vec<Obstacle>,
    bars: Vec<Bar>,
    ramp: Option<Ramp>,
    rules: Vec<([Option<f64>; 2], String)>,
    slopes: Vec<(f64, [f64; 2])>,
    labels: Vec<([f64; 2], String)>,
    drawing: Option<Drawing>,
}

impl Panel {
    /// Creates an empty panel with its axes.
    pub fn new(x: Axis, y: Axis) -> Panel {
        Panel {
            axes: Some([x, y]),
            heading: String::new(),
            height: 90.0,
            has_x_labels: true,
            curves: Vec::new(),
            obstacles: Vec::new(),
            bars: Vec::new(),
            ramp: None,
            rules: Vec::new(),
            slopes: Vec::new(),
            labels: Vec::new(),
            drawing: None,
        }
    }

    /// Creates a panel without axes.
    pub(super) fn drawing(draw: impl Fn(&mut Canvas, Frame) + 'static) -> Panel {
        let nothing = || Axis::linear("", "");
        Panel { axes: None, drawing: Some(Box::new(draw)), ..Panel::new(nothing(), nothing()) }
    }

    /// Sets a line above the panel, such as "(a) triangles".
    pub fn heading(self, heading: impl Into<String>) -> Panel {
        Panel { heading: heading.into(), ..self }
    }

    /// Sets the height of the frame in points instead of 90.
    pub fn height(self, points: f64) -> Panel {
        Panel { height: points, ..self }
    }

    /// Removes the texts of the x axis, if the panel below has the same axis.
    pub fn without_x_labels(self) -> Panel {
        Panel { has_x_labels: false, ..self }
    }

    /// Adds a curve; earlier curves are drawn on top.
    pub fn curve(mut self, curve: Curve) -> Panel {
        self.curves.push(curve);
        self
    }

    /// Adds curves.
    pub fn curves(mut self, curves: impl IntoIterator<Item = Curve>) -> Panel {
        self.curves.extend(curves);
        self
    }

    /// Adds obstacles at heights along y; one far beyond the curves is left out.
    pub fn obstacles(mut self, obstacles: &[Obstacle]) -> Panel {
        self.obstacles.extend(obstacles);
        self
    }

    /// Adds bars.
    pub fn bars(mut self, bars: impl IntoIterator<Item = Bar>) -> Panel {
        self.bars.extend(bars);
        self
    }

    /// Explains the colours of the bars above the panel.
    pub fn ramp(self, ramp: Ramp) -> Panel {
        Panel { ramp: Some(ramp), ..self }
    }

    /// Adds a thin vertical line with a remark at its upper end.
    pub fn rule_at_x(mut self, x: f64, remark: impl Into<String>) -> Panel {
        self.rules.push(([Some(x), None], remark.into()));
        self
    }

    /// Adds a thin horizontal line with a remark at its right end.
    pub fn rule_at_y(mut self, y: f64, remark: impl Into<String>) -> Panel {
        self.rules.push(([None, Some(y)], remark.into()));
        self
    }

    /// Adds the line y ~ x^order through a point on logarithmic axes, labelled with its order.
    pub fn slope(mut self, order: f64, through: [f64; 2]) -> Panel {
        self.slopes.push((order, through));
        self
    }

    /// Adds a remark to the right of a point.
    pub fn remark(mut self, at: [f64; 2], text: impl Into<String>) -> Panel {
        self.labels.push((at, text.into()));
        self
    }

    fn values(&self, axis: usize) -> impl Iterator<Item = f64> + '_ {
        let curves =
            self.curves.iter().flat_map(move |curve| curve.points.iter().map(move |point| point[axis]));
        let bars = self.bars.iter().flat_map(move |bar| if axis == 0 { bar.x } else { bar.y });
        curves.chain(bars)
    }

    fn near_obstacles(&self) -> Vec<Obstacle> {
        let is_near = |of: &&Obstacle| is_near(of.height(), self.values(1));
        self.obstacles.iter().filter(is_near).copied().collect()
    }

    fn fit(&self, width: f64) -> Option<[Fitted; 2]> {
        let [x, y] = self.axes.as_ref()?;
        let heights = self.near_obstacles().into_iter().map(Obstacle::height);
        let ticks = |length: f64, apart: f64| ((length / apart) as usize).max(2);
        Some([
            x.fit(self.values(0), ticks(width, 30.0)),
            y.fit(self.values(1).chain(heights), ticks(self.height, 19.0)),
        ])
    }
}

/// Entry of a key.
enum Key<'p> {
    Curve(&'p Curve),
    Obstacle,
    Part,
    Ramp(&'p Ramp),
}

impl Key<'_> {
    fn all(panel: &Panel) -> Vec<Key<'_>> {
        let curves = panel.curves.iter().filter(|curve| !curve.name.is_empty()).map(Key::Curve);
        let (parts, whole): (Vec<_>, Vec<_>) =
            panel.near_obstacles().into_iter().partition(|of| matches!(of, Obstacle::Part(_)));
        let obstacle = (!whole.is_empty()).then_some(Key::Obstacle);
        let part = (!parts.is_empty()).then_some(Key::Part);
        curves.chain(obstacle).chain(part).chain(panel.ramp.as_ref().map(Key::Ramp)).collect()
    }

    fn name(&self) -> &str {
        match self {
            Key::Curve(curve) => &curve.name,
            Key::Obstacle => "obstacle",
            Key::Part => "partial obstacle",
            Key::Ramp(ramp) => &ramp.label,
        }
    }

    fn sample(&self) -> f64 {
        match self {
            Key::Ramp(ramp) => 2.5 * SAMPLE + 6.0 + ramp.ends.iter().map(|end| KEY.width(end)).sum::<f64>(),
            Key::Curve(curve) if !curve.line => 4.0 * MARKER,
            _ => SAMPLE,
        }
    }

    fn width(&self) -> f64 {
        self.sample() + 3.0 + KEY.width(self.name()) + 8.0
    }

    fn draw(&self, paper: &mut Canvas, [x, y]: At) {
        let end = x + self.sample();
        match self {
            Key::Curve(curve) => {
                if curve.line {
                    paper.polyline(&[[x, y], [end, y]], curve.pen);
                }
                if let Some(marker) = curve.marker {
                    draw_marker(paper, [0.5 * (x + end), y], marker, curve);
                }
            }
            Key::Obstacle => draw_solid(paper, [x, y - 0.5 * HATCH], [end, y + 0.5 * HATCH], HATCH),
            Key::Part => paper.line([x, y], [end, y], RULE),
            Key::Ramp(ramp) => {
                paper.text(&ramp.ends[0], [x, y], KEY, Anchor::Start);
                let start = x + KEY.width(&ramp.ends[0]) + 3.0;
                let parts = 25;
                let width = 2.5 * SAMPLE / f64::from(parts);
                for i in 0..parts {
                    let left = start + width * f64::from(i);
                    let color = (ramp.color)((f64::from(i) + 0.5) / f64::from(parts));
                    // A small overlap avoids visible seams.
                    paper.rectangle([left, y - 2.2], [left + 1.1 * width, y + 2.2], color);
                }
                paper.text(&ramp.ends[1], [end, y], KEY, Anchor::End);
            }
        }
        paper.text(self.name(), [end + 3.0, y], KEY, Anchor::Start);
    }
}

/// Figure for a journal's column (85 mm wide) or page (180 mm wide).
pub struct Figure {
    title: String,
    note: String,
    width: f64,
    columns: usize,
    ramp: Option<Ramp>,
    panels: Vec<Panel>,
}

impl Figure {
    /// Creates a figure of one column; the title may be empty.
    pub fn new(title: impl Into<String>) -> Figure {
        Figure {
            title: title.into(),
            note: String::new(),
            width: COLUMN,
            columns: 1,
            ramp: None,
            panels: Vec::new(),
        }
    }

    /// Makes the figure as wide as a page.
    pub fn page(self) -> Figure {
        Figure { width: PAGE, ..self }
    }

    /// Arranges the panels in columns, row by row.
    pub fn columns(self, columns: usize) -> Figure {
        Figure { columns: columns.max(1), ..self }
    }

    /// Adds a small line at the foot, such as the command that made the figure.
    pub fn note(self, note: impl Into<String>) -> Figure {
        Figure { note: note.into(), ..self }
    }

    /// Explains colours that all panels share, below the title.
    pub fn ramp(self, ramp: Ramp) -> Figure {
        Figure { ramp: Some(ramp), ..self }
    }

    /// Adds a panel.
    pub fn panel(mut self, panel: Panel) -> Figure {
        self.panels.push(panel);
        self
    }

    /// Writes `path` with the extensions `svg` and `png`, each whole or not at all.
    ///
    /// The folder is created if necessary.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where a file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let svg = self.svg();
        let png_path = path.with_extension("png");
        write_in_folder(&path.with_extension("svg"), svg.as_bytes())?;
        write_atomic(&png_path, &png(&svg, &png_path)?)
    }

    /// Writes the SVG alone.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where the file cannot be written.
    pub fn write_svg(&self, path: &Path) -> Result<()> {
        write_in_folder(path, self.svg().as_bytes())
    }

    /// Returns the figure as SVG.
    pub fn svg(&self) -> String {
        let mut paper = Canvas::new();
        let inside = self.width - 2.0 * MARGIN;
        let mut y = MARGIN;
        for line in wrapped(&self.title, TITLE, inside) {
            paper.text(&line, [0.5 * self.width, y + 0.5 * TITLE.line()], TITLE, Anchor::Middle);
            y += TITLE.line();
        }

        if let Some(ramp) = &self.ramp {
            let key = Key::Ramp(ramp);
            let start = 0.5 * (self.width - key.width() + 8.0);
            key.draw(&mut paper, [start.max(MARGIN), y + 0.5 * KEY.line()]);
            y += KEY.line() + 2.0;
        }

        let pitch = inside / self.columns as f64;
        let fitted: Vec<Option<[Fitted; 2]>> =
            self.panels.iter().map(|panel| panel.fit(0.8 * pitch)).collect();
        // Frames in one column are aligned.
        let sides = |column: usize| {
            let of_column = self.panels.iter().zip(&fitted).skip(column).step_by(self.columns);
            of_column.fold([0.0, 0.0_f64], |[left, right]: [f64; 2], (panel, axes)| {
                let Some([x, y]) = axes else { return [left, right] };
                let label = panel.y_label(y).len() as f64 * LABEL.line();
                let ticks = y.ticks.iter().map(|(_, text)| TICK_LABEL.width(text)).fold(0.0, f64::max);
                let last = x.ticks.last().map_or(0.0, |(_, text)| 0.5 * TICK_LABEL.width(text));
                [left.max(label + 3.0 + ticks + 2.5), right.max(last)]
            })
        };
        for row in 0..self.panels.len().div_ceil(self.columns) {
            let numbers =
                (row * self.columns..(row + 1) * self.columns).take_while(|&i| i < self.panels.len());
            let frames: Vec<(usize, f64, f64)> = numbers
                .map(|i| {
                    let column = i % self.columns;
                    let [before, after] = sides(column);
                    let left = MARGIN + column as f64 * pitch;
                    let gap = if column + 1 < self.columns { 4.0 } else { 0.0 };
                    (i, left + before, left + pitch - after.max(1.0) - gap)
                })
                .collect();
            let heads: Vec<Head> =
                frames.iter().map(|&(i, left, right)| Head::new(&self.panels[i], right - left)).collect();
            y += heads.iter().map(Head::height).fold(0.0, f64::max) + 2.0;
            let tallest = frames.iter().map(|&(i, ..)| self.panels[i].height).fold(0.0, f64::max);
            for (&(i, left, right), head) in frames.iter().zip(&heads) {
                let panel = &self.panels[i];
                let frame = Frame { left, top: y, right, bottom: y + panel.height };
                head.draw(&mut paper, frame);
                match (&fitted[i], &panel.drawing) {
                    (Some(axes), _) => {
                        let start = MARGIN + (i % self.columns) as f64 * pitch;
                        panel.draw(&mut paper, frame, axes, start);
                    }
                    (None, Some(draw)) => draw(&mut paper, frame),
                    (None, None) => {}
                }
            }
            let has_labels =
                frames.iter().any(|&(i, ..)| self.panels[i].axes.is_some() && self.panels[i].has_x_labels);
            y += tallest + if has_labels { 3.0 + TICK_LABEL.line() + LABEL.line() } else { 2.0 };
        }
        for line in wrapped(&self.note, NOTE, inside) {
            paper.text(&line, [MARGIN, y + 0.5 * NOTE.line()], NOTE, Anchor::Start);
            y += NOTE.line();
        }
        paper.finish([self.width, y + MARGIN])
    }
}

/// Texts above a panel, where they never cover data.
struct Head<'p> {
    heading: Vec<String>,
    rows: Vec<Vec<Key<'p>>>,
}

impl<'p> Head<'p> {
    fn new(panel: &'p Panel, width: f64) -> Head<'p> {
        let mut rows: Vec<Vec<Key>> = Vec::new();
        let mut used = f64::INFINITY;
        for key in Key::all(panel) {
            // The gap after the last entry may extend beyond the width.
            if used + key.width() - 8.0 > width {
                rows.push(Vec::new());
                used = 0.0;
            }
            used += key.width();
            rows.last_mut().expect("a row was begun").push(key);
        }
        Head { heading: wrapped(&panel.heading, LABEL, width), rows }
    }

    fn height(&self) -> f64 {
        let (heading, keys) = (self.heading.len() as f64 * LABEL.line(), self.rows.len() as f64 * KEY.line());
        heading + keys + 2.0
    }

    fn draw(&self, paper: &mut Canvas, frame: Frame) {
        let mut y = frame.top - self.height();
        for line in &self.heading {
            paper.text(line, [frame.left, y + 0.5 * LABEL.line()], LABEL, Anchor::Start);
            y += LABEL.line();
        }
        for row in &self.rows {
            let mut x = frame.left;
            for key in row {
                key.draw(paper, [x, y + 0.5 * KEY.line()]);
                x += key.width();
            }
            y += KEY.line();
        }
    }
}

impl Panel {
    /// Wraps the label of the y axis into as many lines as its height requires.
    fn y_label(&self, axis: &Fitted) -> Vec<String> {
        wrapped(&axis.label, LABEL, self.height + 6.0)
    }

    fn draw(&self, paper: &mut Canvas, frame: Frame, axes: &[Fitted; 2], start: f64) {
        let Frame { left, top, right, bottom } = frame;
        let [x_axis, y_axis] = axes;
        let at_x = |value: f64| x_axis.share(value).map(|share| left + share * (right - left));
        let at_y = |value: f64| y_axis.share(value).map(|share| bottom - share * (bottom - top));
        let at = |[x, y]: [f64; 2]| Some([at_x(x)?, at_y(y)?]);
        let within = |low: f64, high: f64| move |value: &f64| (low - 0.1..=high + 0.1).contains(value);
        paper.clipped([left, top], [right, bottom], |paper| {
            for obstacle in self.near_obstacles() {
                let Some(y) = at_y(obstacle.height()) else { continue };
                match obstacle {
                    Obstacle::Below(_) => draw_solid(paper, [left, y], [right, bottom], HATCH),
                    Obstacle::Above(_) => draw_solid(paper, [left, y], [right, top], -HATCH),
                    Obstacle::Part(_) => paper.line([left, y], [right, y], RULE),
                }
            }
            for bar in &self.bars {
                if let (Some(a), Some(b)) = (at([bar.x[0], bar.y[1]]), at([bar.x[1], bar.y[0]])) {
                    // A minimal size keeps short bars visible.
                    paper.rectangle(a, [b[0].max(a[0] + 0.4), b[1].max(a[1] + 0.3)], bar.color);
                }
            }
            for (place, remark) in &self.rules {
                match place {
                    [Some(x), _] => {
                        let Some(x) = at_x(*x).filter(within(left, right)) else { continue };
                        paper.line([x, top], [x, bottom], RULE);
                        let is_late = x + REMARK.width(remark) + 3.0 > right;
                        let (x, anchor) =
                            if is_late { (x - 2.0, Anchor::End) } else { (x + 2.0, Anchor::Start) };
                        paper.text(remark, [x, top + 0.7 * REMARK.line()], REMARK, anchor);
                    }
                    [_, Some(y)] => {
                        let Some(y) = at_y(*y).filter(within(top, bottom)) else { continue };
                        paper.line([left, y], [right, y], RULE);
                        paper.text(remark, [right - 4.0, y - 0.55 * REMARK.line()], REMARK, Anchor::End);
                    }
                    [None, None] => {}
                }
            }
            for &(order, [x0, y0]) in &self.slopes {
                let line = |x: f64| at([x, y0 * (x / x0).powf(order)]);
                let (Some(a), Some(b), Some(middle)) = (line(x_axis.low), line(x_axis.high), at([x0, y0]))
                else {
                    continue;
                };
                paper.line(a, b, RULE);
                paper.text(
                    &format!("order {order}"),
                    [middle[0] + 3.0, middle[1] + 0.6 * REMARK.line()],
                    REMARK,
                    Anchor::Start,
                );
            }
        });
        let lines: Vec<Vec<Vec<At>>> = self
            .curves
            .iter()
            .map(|curve| {
                let detail = (4000 / self.curves.len()).clamp(50, 700);
                thinned(curve.points.iter().map(|&point| at(point)), left, right - left, detail)
            })
            .collect();
        paper.clipped([left, top - 1.0], [right, bottom + 1.0], |paper| {
            for (curve, lines) in self.curves.iter().zip(&lines).rev().filter(|(curve, _)| curve.line) {
                for line in lines {
                    draw_line(paper, line, curve.pen, right - left);
                }
            }
        });
        // Markers on the frame are not clipped.
        for curve in self.curves.iter().rev() {
            let Some(marker) = curve.marker else { continue };
            for at in curve.points.iter().filter_map(|&point| at(point)) {
                if within(left, right)(&at[0]) && within(top, bottom)(&at[1]) {
                    draw_marker(paper, at, marker, curve);
                }
            }
        }
        for (place, text) in &self.labels {
            let Some([x, y]) = at(*place).filter(|at| within(left, right)(&at[0])) else { continue };
            let is_late = x + REMARK.width(text) + 4.0 > right;
            let (x, anchor) = if is_late { (x - 3.0, Anchor::End) } else { (x + 3.0, Anchor::Start) };
            paper.text(text, [x, y - 0.5 * REMARK.line()], REMARK, anchor);
        }
        if self.bars.is_empty() && lines.iter().all(Vec::is_empty) {
            paper.text("no data", [0.5 * (left + right), 0.5 * (top + bottom)], LABEL, Anchor::Middle);
        }
        self.draw_frame(paper, frame, axes, start, at_x, at_y);
    }

    fn draw_frame(
        &self,
        paper: &mut Canvas,
        Frame { left, top, right, bottom }: Frame,
        [x_axis, y_axis]: &[Fitted; 2],
        start: f64,
        at_x: impl Fn(f64) -> Option<f64>,
        at_y: impl Fn(f64) -> Option<f64>,
    ) {
        let mut tick = |a: At, b: At| paper.line(a, b, FRAME);
        let x_ticks = x_axis.ticks.iter().map(|(value, _)| (*value, TICK));
        for (x, long) in x_ticks.chain(x_axis.minor.iter().map(|&value| (value, 0.55 * TICK))) {
            if let Some(x) = at_x(x) {
                tick([x, bottom], [x, bottom - long]);
                tick([x, top], [x, top + long]);
            }
        }
        let y_ticks = y_axis.ticks.iter().map(|(value, _)| (*value, TICK));
        for (y, long) in y_ticks.chain(y_axis.minor.iter().map(|&value| (value, 0.55 * TICK))) {
            if let Some(y) = at_y(y) {
                tick([left, y], [left + long, y]);
                tick([right, y], [right - long, y]);
            }
        }
        paper.polyline(&[[left, top], [right, top], [right, bottom], [left, bottom], [left, top]], FRAME);
        for (value, text) in &y_axis.ticks {
            if let Some(y) = at_y(*value) {
                paper.text(text, [left - 2.5, y], TICK_LABEL, Anchor::End);
            }
        }
        for (line, text) in self.y_label(y_axis).iter().enumerate() {
            let x = start + (line as f64 + 0.5) * LABEL.line();
            paper.text_upwards(text, [x, 0.5 * (top + bottom)], LABEL);
        }
        if !self.has_x_labels {
            return;
        }
        let below = bottom + 2.0 + 0.5 * TICK_LABEL.line();
        let mut free_from = f64::NEG_INFINITY;
        for (value, text) in &x_axis.ticks {
            let Some(x) = at_x(*value) else { continue };
            let half = 0.5 * TICK_LABEL.width(text);
            if x - half > free_from {
                paper.text(text, [x, below], TICK_LABEL, Anchor::Middle);
                free_from = x + half + 2.0;
            }
        }
        let under = bottom + 2.0 + TICK_LABEL.line() + 0.5 * LABEL.line();
        paper.text(&x_axis.label, [0.5 * (left + right), under], LABEL, Anchor::Middle);
    }
}

/// Draws a solid body, shaded, with its edge hatched `depth` points deep (upwards if negative).
fn draw_solid(paper: &mut Canvas, [left, y]: At, [right, end]: At, depth: f64) {
    paper.line([left, y], [right, y], SOLID_EDGE);
    paper.rectangle([left, y.min(end)], [right, y.max(end)], Color::SHADE);
    paper.line([left, y], [right, y], SOLID_EDGE);
    let depth = if depth > 0.0 { depth.min(end - y) } else { depth.max(end - y) };
    let run = depth.abs();
    let strokes = ((right - left - run) / HATCH).max(-1.0) as i64;
    for i in 0..=strokes {
        let x = left + run + HATCH * i as f64;
        paper.line([x, y], [x - run, y + depth], SOLID_EDGE);
    }
}

fn draw_line(paper: &mut Canvas, line: &[At], pen: Pen, width: f64) {
    if let [at] = *line {
        return paper.circle(at, pen.width, pen.color, None);
    }
    let length: f64 =
        line.windows(2).map(|ends| (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1])).sum();
    let dashes = if length > MOST_DASHED * width { &[] } else { pen.dashes };
    paper.polyline(line, Pen { dashes, ..pen });
}

fn draw_marker(paper: &mut Canvas, [x, y]: At, marker: Marker, curve: &Curve) {
    let pen = Pen::solid(curve.pen.color, 0.8);
    let fill = if curve.is_open { Color::WHITE } else { curve.pen.color };
    let r = MARKER * curve.size;
    match marker {
        Marker::Circle => paper.circle([x, y], r, fill, Some(pen)),
        Marker::Square => {
            let r = 0.88 * r;
            paper.polygon(&[[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]], fill, Some(pen));
        }
        Marker::Triangle => {
            paper.polygon(
                &[[x, y - 1.2 * r], [x + 1.1 * r, y + 0.8 * r], [x - 1.1 * r, y + 0.8 * r]],
                fill,
                Some(pen),
            );
        }
        Marker::Diamond => {
            let r = 1.25 * r;
            paper.polygon(&[[x, y - r], [x + r, y], [x, y + r], [x - r, y]], fill, Some(pen));
        }
        Marker::Cross => {
            paper.line([x - r, y - r], [x + r, y + r], pen);
            paper.line([x - r, y + r], [x + r, y - r], pen);
        }
        Marker::Plus => {
            let r = 1.3 * r;
            paper.line([x - r, y], [x + r, y], pen);
            paper.line([x, y - r], [x, y + r], pen);
        }
    }
}

/// Splits a curve at its gaps and removes points that cannot be told apart.
///
/// A curve with increasing x keeps the least and greatest value of each of `columns` columns; any
/// other curve keeps points at a visible distance.
fn thinned(points: impl Iterator<Item = Option<At>>, left: f64, width: f64, columns: usize) -> Vec<Vec<At>> {
    let mut lines: Vec<Vec<At>> = vec![Vec::new()];
    for point in points {
        match (point, lines.last_mut()) {
            (Some(at), Some(line)) => line.push(at),
            (None, Some(line)) if !line.is_empty() => lines.push(Vec::new()),
            _ => {}
        }
    }
    lines.retain(|line| !line.is_empty());
    for line in &mut lines {
        if line.windows(2).all(|ends| ends[0][0] <= ends[1][0]) {
            if line.len() > 2 * columns {
                *line = extremes(line, left, width, columns);
            }
        } else {
            let apart = |[a, b]: At, [c, d]: At| (c - a).hypot(d - b) > 0.3;
            let mut kept = line[0];
            let last = line[line.len() - 1];
            line.retain(|&at| {
                let keep = at == kept || apart(kept, at);
                if keep {
                    kept = at;
                }
                keep
            });
            let stride = line.len().div_ceil(8 * columns);
            *line = line.iter().copied().step_by(stride).chain([last]).collect();
        }
    }
    lines
}

/// Returns the points of least and greatest value in each column, in their order.
fn extremes(line: &[At], left: f64, width: f64, columns: usize) -> Vec<At> {
    let column = |at: &At| ((at[0] - left) / width * columns as f64) as i64;
    let mut kept = Vec::new();
    for part in line.chunk_by(|a, b| column(a) == column(b)) {
        let order = |a: &&At, b: &&At| a[1].total_cmp(&b[1]);
        let (least, greatest) = (part.iter().min_by(order), part.iter().max_by(order));
        if let (Some(&least), Some(&greatest)) = (least, greatest) {
            let pair = if least[0] <= greatest[0] { [least, greatest] } else { [greatest, least] };
            kept.extend(&pair[..if least == greatest { 1 } else { 2 }]);
        }
    }
    kept
}

/// Wraps a text into as few lines as fit.
fn wrapped(text: &str, look: Type, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if look.width(line) + look.width(" ") + look.width(word) <= width => {
                *line = format!("{line} {word}");
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

fn write_in_folder(path: &Path, bytes: &[u8]) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
    }
    write_atomic(path, bytes)
}
