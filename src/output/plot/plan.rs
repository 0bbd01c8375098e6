//! Plan of the plate: a field in bands between contour lines, with its colour bar.

use super::axis::{Fitted, unit};
use super::perspective::{Corner, above, depth};
use super::{Axis, Bar, Color, Curve, Figure, Panel};
use crate::geometry::range;
use crate::output::plot::coarse::coarsened;
use crate::output::text::{engineering, place_in, typeset};
use crate::output::vtu::Surface;

/// Largest height of a plan, in points, and its width.
const TALLEST: f64 = 200.0;
const WIDTH: f64 = 200.0;
/// Approximate number of contour lines.
const LINES: usize = 12;

/// Creates an empty plan of a plate with an outline, as pairs of points in m, and other points
/// that it must show; and tells the size (m) that chooses the unit of its axes.
pub(super) fn plan(
    outline: &[[[f64; 2]; 2]],
    others: impl Iterator<Item = [f64; 2]> + Clone,
) -> (Panel, f64) {
    let places = || outline.iter().flatten().copied().chain(others.clone());
    let [[left, right], [front, back]] = [0, 1].map(|axis| range(places().map(|place| place[axis])));
    let size = (right - left).max(back - front);
    let [length, width] =
        [right - left, back - front].map(|side| side.max(0.1 * size).max(f64::MIN_POSITIVE));
    let ends = |low: f64, high: f64| [low - 0.04 * size, high + 0.04 * size];
    let axis = |name, [low, high]: [f64; 2]| Axis::linear(name, "m").in_unit_of(size).within(low, high);
    // A NaN interrupts the line.
    let edges = outline.iter().flat_map(|&[a, b]| [a, b, [f64::NAN; 2]]).collect();
    let plan = Panel::new(axis("x", ends(left, right)), axis("y", ends(front, back)))
        .height((WIDTH * width / length).clamp(30.0, TALLEST))
        .equal_scales()
        .curve(Curve::new("", edges).color(Color::GREY).width(0.6));
    (plan, size)
}

/// Draws the von Mises stress of a surface, the larger of both faces of the plate, with a mark at
/// its largest value; `what` tells which stress it is, and `told` the place (m) and the time (s) of
/// the largest, where the run tells them.
pub fn stress(surface: Surface, title: &str, what: &str, told: Option<([f64; 2], f64)>) -> Figure {
    let values = surface.von_mises.iter().copied().zip(&surface.points);
    let peak = values.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(value, &place)| (value, place));
    let surface = coarsened(surface);
    let ends = range(surface.von_mises.iter().copied().filter(|value| value.is_finite()));
    let axis = Axis::linear("von Mises stress", "Pa").ticks(LINES).within(ends[0], ends[1]);
    let bands = Bands::of(&axis.fit([].into_iter(), LINES));
    let (mut areas, mut lines) = (Vec::new(), Vec::new());
    for face in &surface.cells {
        let corners: Vec<Corner> =
            face.iter().map(|&point| (surface.points[point], surface.von_mises[point])).collect();
        bands.divide(&corners, &mut areas, &mut lines);
    }
    let (plan, size) = plan(&surface.outline(), [].into_iter());
    let mut plan = plan.heading(what).areas(areas);
    if let Some((value, place)) = peak {
        let (place, time) = told.map_or((place, None), |(place, time)| (place, Some(time)));
        let (metre, scale) = unit("m", size);
        let mut name = format!("largest: {} at {}", engineering(value, "Pa"), place_in(place, scale, &metre));
        time.into_iter().for_each(|time| name += &typeset(&format!(", {}", engineering(time, "s"))));
        plan = plan.curve(Curve::new(name, vec![place]).palette(1).marks(0).scattered());
    }
    let plan = plan.curve(Curve::new("", lines).color(Color::BLACK).width(0.35));
    let scale = Panel::new(axis, Axis::linear("", "").named([String::new()]).within(0.5, 1.5));
    Figure::new(title).panel(plan).panel(scale.height(8.0).bars(bands.bars()))
}

/// Bands of values: the ends of the range and the levels of contour lines between them.
struct Bands(Vec<f64>);

impl Bands {
    fn of(axis: &Fitted) -> Bands {
        let inside =
            axis.ticks.iter().map(|tick| tick.0).filter(|&level| level > axis.low && level < axis.high);
        Bands([axis.low].into_iter().chain(inside).chain([axis.high]).collect())
    }

    /// Returns the colour of the band that begins at a level.
    fn color(&self, band: usize) -> Color {
        depth((band as f64 + 0.5) / (self.0.len() - 1) as f64)
    }

    fn bars(&self) -> Vec<Bar> {
        let bar = |(band, ends): (usize, &[f64])| Bar {
            x: [ends[0], ends[1]],
            y: [0.5, 1.5],
            color: self.color(band),
        };
        self.0.windows(2).enumerate().map(bar).collect()
    }

    /// Divides a face into areas of one band each, and adds its pieces of contour lines.
    fn divide(&self, face: &[Corner], areas: &mut Vec<(Vec<[f64; 2]>, Color)>, lines: &mut Vec<[f64; 2]>) {
        let band = |value: f64| self.0[1..self.0.len() - 1].partition_point(|&level| level <= value);
        let [low, high] = range(face.iter().map(|corner| corner.1)).map(band);
        areas.push((face.iter().map(|corner| corner.0).collect(), self.color(low)));
        if low == high {
            return;
        }
        // Values are linear in the triangles around the middle.
        let mean = |value: &dyn Fn(&Corner) -> f64| face.iter().map(value).sum::<f64>() / face.len() as f64;
        let middle = ([mean(&|corner| corner.0[0]), mean(&|corner| corner.0[1])], mean(&|corner| corner.1));
        for (&a, &b) in face.iter().zip(face.iter().cycle().skip(1)) {
            for (band, &level) in self.0.iter().enumerate().take(high + 1).skip(low + 1) {
                let (above, ends) = above(&[a, b, middle], level);
                if above.len() > 2 {
                    areas.push((above.into_iter().map(|corner| corner.0).collect(), self.color(band)));
                }
                if let [from, to] = ends[..] {
                    lines.extend([from, to, [f64::NAN; 2]]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Bands;

    /// Over a plane the bands are strips, whose areas and lines are known.
    #[test]
    fn bands_of_a_plane_are_strips() {
        let bands = Bands(vec![0.0, 1.0, 2.0, 4.0]);
        let face = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]].map(|place| (place, place[0]));
        let (mut areas, mut lines) = (Vec::new(), Vec::new());
        bands.divide(&face, &mut areas, &mut lines);
        // Bands are painted one over another: each area is all that lies above its level.
        let area = |points: &[[f64; 2]]| {
            let next = points.iter().cycle().skip(1);
            0.5 * points.iter().zip(next).map(|([a, b], [c, d])| a * d - b * c).sum::<f64>()
        };
        for (band, expected) in [(0, 12.0), (1, 9.0), (2, 6.0)] {
            let painted = areas.iter().filter(|(_, color)| *color == bands.color(band));
            let sum: f64 = painted.map(|(points, _)| area(points)).sum();
            assert!((sum - expected).abs() < 1e-12, "band {band}: {sum}");
        }
        let length = |x: f64| {
            let ends = lines.chunks(3).filter(|ends| ends[0][0] == x && ends[1][0] == x);
            ends.map(|ends| (ends[1][1] - ends[0][1]).abs()).sum::<f64>()
        };
        assert!([1.0, 2.0].map(length).iter().all(|length| (length - 3.0).abs() < 1e-12), "{lines:?}");
    }
}
