//! Strokes of a panel: hatches, lines, markers, ticks and texts.

use super::axis::Fitted;
use super::panel::{Curve, Frame, Marker, Obstacle, Panel};
use super::paper::{Anchor, At, Canvas, Color, Pen, Type};

pub(super) const LABEL: Type = Type::new(7.0);
pub(super) const TICK_LABEL: Type = Type::new(6.5);
const REMARK: Type = Type { color: Color::GREY, halo: true, ..Type::new(6.0) };

const FRAME: Pen = Pen::solid(Color::BLACK, 0.5);
pub(super) const RULE: Pen = Pen { color: Color::GREY, dashes: &[1.2, 1.8], width: 0.6 };
const SOLID_EDGE: Pen = Pen::solid(Color::GREY, 0.5);
const TICK: f64 = 2.6;
pub(super) const HATCH: f64 = 4.0;
pub(super) const MARKER: f64 = 2.1;

/// Length of a dashed line, in widths of its panel, above which its curve is drawn solid.
///
/// The dashes of a longer curve would hide data.
const MOST_DASHED: f64 = 8.0;

/// Curve as it is drawn: its lines and their pen.
pub(super) struct Stroke {
    lines: Vec<Vec<At>>,
    pub pen: Pen,
}

impl Panel {
    /// Wraps the label of the y axis into as many lines as its height requires.
    pub(super) fn y_label(&self, axis: &Fitted) -> Vec<String> {
        wrapped(&axis.label, LABEL, self.height + 6.0)
    }

    /// Returns the strokes of all curves in a frame.
    pub(super) fn strokes(&self, frame: Frame, [x_axis, y_axis]: &[Fitted; 2]) -> Vec<Stroke> {
        let width = frame.right - frame.left;
        let detail = (4000 / self.curves.len().max(1)).clamp(50, 700);
        let stroke = |curve: &Curve| {
            let drawn = |[x, y]: [f64; 2]| Some([frame.x(x_axis, x)?, frame.y(y_axis, y)?]);
            let places = curve.points.iter().map(|&point| drawn(point));
            let lines = thinned(places, frame.left, width, detail);
            let is_long = lines.iter().any(|line| length(line) > MOST_DASHED * width);
            let dashes = if is_long { &[] } else { curve.pen.dashes };
            Stroke { lines, pen: Pen { dashes, ..curve.pen } }
        };
        self.curves.iter().map(stroke).collect()
    }

    /// Draws the panel in its frame, with the strokes of its curves; the label of the y axis begins
    /// `start` points from the left.
    pub(super) fn draw(
        &self,
        paper: &mut Canvas,
        frame: Frame,
        axes: &[Fitted; 2],
        strokes: &[Stroke],
        start: f64,
    ) {
        let Frame { left, top, right, bottom } = frame;
        let [x_axis, y_axis] = axes;
        let (at_x, at_y) = (|x: f64| frame.x(x_axis, x), |y: f64| frame.y(y_axis, y));
        let drawn = |[x, y]: [f64; 2]| Some([at_x(x)?, at_y(y)?]);
        let within = |low: f64, high: f64| move |value: &f64| (low - 0.1..=high + 0.1).contains(value);
        paper.clipped([left, top], [right, bottom], |paper| {
            for obstacle in self.near_obstacles() {
                let Some(y) = at_y(obstacle.height()) else { continue };
                match obstacle {
                    Obstacle::Below(_) => draw_solid(paper, [left, y], [right, bottom], HATCH),
                    Obstacle::Above(_) => draw_solid(paper, [left, y], [right, top], -HATCH),
                    Obstacle::Part(..) => paper.line([left, y], [right, y], RULE),
                }
            }
            for (corners, color) in &self.areas {
                let corners: Vec<At> = corners.iter().filter_map(|&corner| drawn(corner)).collect();
                // An edge of the same colour covers the seams between neighbours.
                paper.polygon(&corners, *color, Some(Pen::solid(*color, 0.2)));
            }
            for bar in &self.bars {
                if let (Some(a), Some(b)) = (drawn([bar.x[0], bar.y[1]]), drawn([bar.x[1], bar.y[0]])) {
                    // A minimal size keeps short bars visible.
                    paper.rectangle(a, [b[0].max(a[0] + 0.4), b[1].max(a[1] + 0.3)], bar.color);
                }
            }
            let lines = self.rules.iter().filter_map(|(x, _)| at_x(*x).filter(within(left, right)));
            lines.for_each(|x| paper.line([x, top], [x, bottom], RULE));
            for &(order, [x0, y0]) in &self.slopes {
                let line = |x: f64| drawn([x, y0 * (x / x0).powf(order)]);
                let (Some(a), Some(b), Some(middle)) = (line(x_axis.low), line(x_axis.high), drawn([x0, y0]))
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
        for (_, stroke) in self.curves.iter().zip(strokes).rev().filter(|(curve, _)| curve.line) {
            // A curve along the frame is drawn in its full width, one that leaves it ends there.
            let leaves = stroke.lines.iter().flatten().any(|point| !within(top, bottom)(&point[1]));
            let margin = if leaves { 0.0 } else { 1.0 };
            paper.clipped([left, top - margin], [right, bottom + margin], |paper| {
                stroke.lines.iter().for_each(|line| draw_line(paper, line, stroke.pen));
            });
        }
        // Markers on the frame are not clipped.
        for curve in self.curves.iter().rev() {
            let Some(marker) = curve.marker else { continue };
            let is_inside = |point: &At| within(left, right)(&point[0]) && within(top, bottom)(&point[1]);
            let places = curve.points.iter().filter_map(|&point| drawn(point)).filter(is_inside);
            draw_markers(paper, &places.collect::<Vec<_>>(), marker, curve);
        }
        // Remarks are drawn over the curves, and none over another.
        let mut covered: Vec<[f64; 2]> = Vec::new();
        for (x, remark) in self.rules.iter().filter(|(_, remark)| !remark.is_empty()) {
            let Some(x) = at_x(*x).filter(within(left, right)) else { continue };
            let width = REMARK.width(remark);
            let start = if x + width + 3.0 > right { x - 2.0 - width } else { x + 2.0 };
            if covered.iter().all(|[from, to]| start > *to || start + width < *from) {
                paper.text(remark, [start, top + 0.7 * REMARK.line()], REMARK, Anchor::Start);
                covered.push([start, start + width]);
            }
        }
        if self.bars.is_empty() && strokes.iter().all(|stroke| stroke.lines.is_empty()) {
            paper.text("no data", [0.5 * (left + right), 0.5 * (top + bottom)], LABEL, Anchor::Middle);
        }
        self.draw_frame(paper, frame, axes, start);
    }

    /// Draws the frame with ticks and labels; the label of the y axis begins `start` points from
    /// the left.
    fn draw_frame(&self, paper: &mut Canvas, frame: Frame, [x_axis, y_axis]: &[Fitted; 2], start: f64) {
        let Frame { left, top, right, bottom } = frame;
        let (at_x, at_y) = (|x: f64| frame.x(x_axis, x), |y: f64| frame.y(y_axis, y));
        let mut tick = |a: At, b: At| paper.line(a, b, FRAME);
        let marks = |axis: &Fitted| {
            let long = axis.ticks.iter().map(|(value, _)| (*value, TICK));
            long.chain(axis.minor.iter().map(|&value| (value, 0.55 * TICK))).collect::<Vec<_>>()
        };
        for (x, long) in marks(x_axis).into_iter().filter_map(|(x, long)| Some((at_x(x)?, long))) {
            tick([x, bottom], [x, bottom - long]);
            tick([x, top], [x, top + long]);
        }
        for (y, long) in marks(y_axis).into_iter().filter_map(|(y, long)| Some((at_y(y)?, long))) {
            tick([left, y], [left + long, y]);
            tick([right, y], [right - long, y]);
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
pub(super) fn draw_solid(paper: &mut Canvas, [left, y]: At, [right, end]: At, depth: f64) {
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

/// Returns the length of a line, in points.
fn length(line: &[At]) -> f64 {
    line.windows(2).map(|ends| (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1])).sum()
}

fn draw_line(paper: &mut Canvas, line: &[At], pen: Pen) {
    match *line {
        [point] => paper.circle(point, pen.width, pen.color, None),
        _ => paper.polyline(line, pen),
    }
}

/// Draws the markers of a curve.
pub(super) fn draw_markers(paper: &mut Canvas, places: &[At], marker: Marker, curve: &Curve) {
    let pen = Pen::solid(curve.pen.color, 0.8);
    let fill = if curve.is_open { Color::WHITE } else { curve.pen.color };
    let r = MARKER * curve.size;
    if matches!(marker, Marker::Circle) && !curve.is_open {
        return paper.discs(places, r + 0.5 * pen.width, fill);
    }
    for &[x, y] in places {
        let shifted = |[a, b]: At, r: f64| [x + r * a, y + r * b];
        match marker {
            Marker::Circle => paper.circle([x, y], r, fill, Some(pen)),
            Marker::Body(corners) => {
                let corners: Vec<At> = corners.iter().map(|&corner| shifted(corner, r)).collect();
                paper.polygon(&corners, fill, Some(pen));
            }
            Marker::Lines(ends) => {
                ends.iter().for_each(|&end| paper.line(shifted(end, -r), shifted(end, r), pen));
            }
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
            (Some(point), Some(line)) => line.push(point),
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
            line.retain(|&point| {
                let keep = point == kept || apart(kept, point);
                if keep {
                    kept = point;
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
    let column = |point: &At| ((point[0] - left) / width * columns as f64) as i64;
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

/// Wraps a text into as few lines as fit, between words that no-break spaces do not join.
pub(super) fn wrapped(text: &str, look: Type, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    let is_gap = |c: char| c.is_whitespace() && c != '\u{a0}';
    for word in text.split(is_gap).filter(|word| !word.is_empty()) {
        match lines.last_mut() {
            Some(line) if look.width(line) + look.width(" ") + look.width(word) <= width => {
                *line = format!("{line} {word}");
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
