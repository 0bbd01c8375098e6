//! Panels of a figure: curves, obstacles, bars and remarks between two axes.

use super::axis::{Axis, Fitted, is_near, short, unit};
use super::paper::{Canvas, Color, Pen};
use crate::geometry::range;
use std::collections::BTreeSet;

/// Numbers of points of a curve that differ, across and upwards.
const GRAIN: [f64; 2] = [1600.0, 800.0];

/// Number of a colour scale below which it has an SI prefix of its own.
const TINY: f64 = 1e-3;

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
/// Circle, square, triangle, diamond, cross and plus.
const MARKERS: [Marker; 6] = [
    Marker::Circle,
    Marker::Body(&[[-0.88, -0.88], [0.88, -0.88], [0.88, 0.88], [-0.88, 0.88]]),
    Marker::Body(&[[0.0, -1.2], [1.1, 0.8], [-1.1, 0.8]]),
    Marker::Body(&[[0.0, -1.25], [1.25, 0.0], [0.0, 1.25], [-1.25, 0.0]]),
    Marker::Lines([[1.0, 1.0], [1.0, -1.0]]),
    Marker::Lines([[1.3, 0.0], [0.0, 1.3]]),
];

/// Symbol at each point of a curve, for a circle of radius 1.
#[derive(Debug, Clone, Copy)]
pub(super) enum Marker {
    /// Circle.
    Circle,
    /// Closed shape with these corners.
    Body(&'static [[f64; 2]]),
    /// Lines through the point, each to this end and as far beyond.
    Lines([[f64; 2]; 2]),
}

impl Color {
    /// Returns the `index`-th colour of the palette.
    pub fn of_palette(index: usize) -> Color {
        COLORS[index % COLORS.len()]
    }
}

/// A curve, a set of marks, or both.
#[derive(Debug, Clone)]
pub struct Curve {
    pub(super) name: String,
    pub(super) points: Vec<[f64; 2]>,
    pub(super) pen: Pen,
    pub(super) line: bool,
    pub(super) marker: Option<Marker>,
    pub(super) is_open: bool,
    /// Size of the markers relative to the default.
    pub(super) size: f64,
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

    /// Keeps one of all points that a picture shows at the same place.
    pub fn distinct(mut self) -> Curve {
        let grain = [0, 1].map(|axis| {
            let [low, high] = range(self.points.iter().map(|point| point[axis]));
            [low, GRAIN[axis] / (high - low).max(f64::MIN_POSITIVE)]
        });
        let mut seen = BTreeSet::new();
        self.points.retain(|point| {
            let place = [0, 1].map(|axis| ((point[axis] - grain[axis][0]) * grain[axis][1]).round() as i64);
            seen.insert(place)
        });
        self.points.shrink_to_fit();
        self
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
        self.color(Color::of_palette(index))
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
#[derive(Debug, Clone, PartialEq)]
pub enum Obstacle {
    /// Obstacle below the whole plate, at this height in m.
    Below(f64),
    /// Obstacle above the whole plate, at this height in m.
    Above(f64),
    /// Obstacle that faces a part of the plate, at this height in m, and what the key says of it.
    Part(f64, String),
}

impl Obstacle {
    /// Returns the height in m.
    pub fn height(&self) -> f64 {
        match self {
            Obstacle::Below(height) | Obstacle::Above(height) | Obstacle::Part(height, _) => *height,
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

impl Ramp {
    /// Creates a scale whose numbers have the SI prefix that an axis of them would have; `symbol`
    /// is the unit. Where one end is much smaller than the other, each has its own. An end that is
    /// not finite has no number.
    pub fn new(quantity: &str, symbol: &str, ends: [f64; 2], color: fn(f64) -> Color) -> Ramp {
        let finite = ends.into_iter().filter(|end| end.is_finite());
        let (name, one) = unit(symbol, finite.map(f64::abs).fold(0.0, f64::max));
        let is_tiny = |value: f64| value != 0.0 && value.abs() < TINY * one && !symbol.is_empty();
        let has_tiny = ends.into_iter().any(is_tiny);
        let end = |value: f64| match value.is_finite() {
            true if has_tiny => {
                let (name, one) = unit(symbol, value.abs());
                format!("{} {name}", short(value / one))
            }
            true => short(value / one),
            false => String::new(),
        };
        let has_unit = !name.is_empty() && !has_tiny;
        let label = if has_unit { format!("{quantity} ({name})") } else { quantity.to_owned() };
        Ramp { label, ends: ends.map(end), color }
    }
}

/// Frame of a panel, in points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

impl Frame {
    /// Returns the horizontal place of a value on an axis, in points; `None` if it cannot be drawn.
    pub fn x(&self, axis: &Fitted, value: f64) -> Option<f64> {
        axis.share(value).map(|share| self.left + share * (self.right - self.left))
    }

    /// Returns the vertical place of a value on an axis, in points; `None` if it cannot be drawn.
    pub fn y(&self, axis: &Fitted, value: f64) -> Option<f64> {
        axis.share(value).map(|share| self.bottom - share * (self.bottom - self.top))
    }
}

/// Drawing function of a panel without axes.
type Drawing = Box<dyn Fn(&mut Canvas, Frame)>;

/// Panel of a figure.
#[derive(Default)]
pub struct Panel {
    pub(super) axes: Option<[Axis; 2]>,
    pub(super) heading: String,
    pub(super) height: f64,
    pub(super) has_x_labels: bool,
    pub(super) curves: Vec<Curve>,
    pub(super) obstacles: Vec<Obstacle>,
    /// Name of a hatched band that is no obstacle.
    pub(super) band: Option<String>,
    pub(super) bars: Vec<Bar>,
    /// Closed shapes below all curves.
    pub(super) areas: Vec<(Vec<[f64; 2]>, Color)>,
    /// Whether lengths along both axes have the same scale.
    pub(super) has_equal_scales: bool,
    pub(super) ramp: Option<Ramp>,
    pub(super) rules: Vec<(f64, String)>,
    pub(super) slopes: Vec<(f64, [f64; 2])>,
    pub(super) drawing: Option<Drawing>,
}

impl Panel {
    /// Creates an empty panel with its axes.
    pub fn new(x: Axis, y: Axis) -> Panel {
        Panel { axes: Some([x, y]), height: 90.0, has_x_labels: true, ..Panel::default() }
    }

    /// Creates a panel without axes.
    pub(super) fn drawing(draw: impl Fn(&mut Canvas, Frame) + 'static) -> Panel {
        Panel { height: 90.0, drawing: Some(Box::new(draw)), ..Panel::default() }
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
        self.obstacles.extend_from_slice(obstacles);
        self
    }

    /// Adds the hatched band below a value of the y axis, if there is one, with its name in the
    /// key.
    pub fn band_below(mut self, y: Option<f64>, name: &str) -> Panel {
        self.obstacles.extend(y.map(Obstacle::Below));
        Panel { band: y.map(|_| name.to_owned()), ..self }
    }

    /// Adds bars.
    pub fn bars(mut self, bars: impl IntoIterator<Item = Bar>) -> Panel {
        self.bars.extend(bars);
        self
    }

    /// Adds closed shapes, given by their corners, below all curves.
    pub fn areas(mut self, areas: impl IntoIterator<Item = (Vec<[f64; 2]>, Color)>) -> Panel {
        self.areas.extend(areas);
        self
    }

    /// Gives lengths along both axes the same scale, as in a plan; the frame shrinks accordingly.
    pub fn equal_scales(self) -> Panel {
        Panel { has_equal_scales: true, ..self }
    }

    /// Explains the colours of the bars above the panel.
    pub fn ramp(self, ramp: Ramp) -> Panel {
        Panel { ramp: Some(ramp), ..self }
    }

    /// Adds a thin vertical line with a remark at its upper end.
    pub fn rule_at_x(mut self, x: f64, remark: impl Into<String>) -> Panel {
        self.rules.push((x, remark.into()));
        self
    }

    /// Adds the line y ~ x^order through a point on logarithmic axes, labelled with its order.
    pub fn slope(mut self, order: f64, through: [f64; 2]) -> Panel {
        self.slopes.push((order, through));
        self
    }

    /// Returns all data along an axis: 0 for x, 1 for y.
    fn values(&self, axis: usize) -> impl Iterator<Item = f64> + '_ {
        let curves =
            self.curves.iter().flat_map(move |curve| curve.points.iter().map(move |point| point[axis]));
        let bars = self.bars.iter().flat_map(move |bar| if axis == 0 { bar.x } else { bar.y });
        curves.chain(bars)
    }

    /// Returns the obstacles that are not far beyond the curves.
    pub(super) fn near_obstacles(&self) -> Vec<&Obstacle> {
        let is_near =
            |obstacle: &&Obstacle| self.band.is_some() || is_near(obstacle.height(), self.values(1));
        self.obstacles.iter().filter(is_near).collect()
    }

    /// Returns the largest frame within another one in which scales are equal, where they must be.
    pub(super) fn shaped(&self, frame: Frame, axes: Option<&[Fitted; 2]>) -> Frame {
        let Some([x, y]) = axes.filter(|_| self.has_equal_scales) else { return frame };
        let per_point = ((x.high - x.low) / (frame.right - frame.left))
            .max((y.high - y.low) / (frame.bottom - frame.top));
        let [width, height] = [x, y].map(|axis| (axis.high - axis.low) / per_point);
        Frame { right: frame.left + width, bottom: frame.top + height, ..frame }
    }

    /// Fits the axes to the data, for a frame of this width in points.
    pub(super) fn fit(&self, width: f64) -> Option<[Fitted; 2]> {
        let [x, y] = self.axes.as_ref()?;
        let heights = self.near_obstacles().into_iter().map(Obstacle::height);
        let ticks = |length: f64, apart: f64| ((length / apart) as usize).max(2);
        Some([
            x.fit(self.values(0), ticks(width, 30.0)),
            y.fit(self.values(1).chain(heights), ticks(self.height, 19.0)),
        ])
    }
}
