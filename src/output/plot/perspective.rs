//! Perspective view of the deformed plate between its obstacles.

use super::axis::is_near;
use super::coarse::coarsened;
use super::panel::Frame;
use super::paper::{Anchor, At, Canvas, Color, Pen, Type, blend};
use super::{Figure, Panel, Ramp};
use crate::geometry::range;
use crate::output::text::engineering;
use crate::output::vtu::{Surface, boundary, held_points};
use std::f64::consts::TAU;

/// Largest number of snapshots in a figure.
pub const MOST: usize = 6;
/// Viewing direction: rotation about the vertical and elevation, in radians.
const TURN: f64 = -0.60;
const RISE: f64 = 0.42;
/// Distance of the eye relative to the size of the scene.
const DISTANCE: f64 = 4.0;
/// Least height of the drawn deflections relative to the plate's length.
const RELIEF: f64 = 0.3;

/// Height of the shape of a mode relative to the plate's length.
const MODE: f64 = 0.1;

const OUTLINE: Pen = Pen::solid(Color::GREY, 0.5);
const HIDDEN: Pen = Pen { color: Color::GREY, dashes: &[1.2, 1.6], width: 0.5 };
/// Pens for obstacles behind the plate, light on dark, so that they show on all its colours.
const BEHIND: [Pen; 2] =
    [Pen::solid(Color::BLACK, 0.9), Pen { color: Color::SHADE, dashes: &[1.2, 0.7], width: 0.6 }];
const HELD: Pen = Pen::solid(Color::BLACK, 2.4);
/// Rim of a washer, so that a small one is seen.
const WASHER: Pen = Pen::solid(Color::BLACK, 1.0);
/// Number of corners of a washer's rim.
const RIM: u32 = 24;
/// Magnitude of a mode shape below which it is rounding.
const ROUNDING: f64 = 1e-9;
/// Magnitude of a mode shape below which a face has no nodal line: beside clamps signs alternate.
const STILL: f64 = 1e-3;
const NODAL: Pen = Pen::solid(Color::BLACK, 0.7);
const REMARK: Type = Type { halo: true, ..Type::new(6.5) };
/// Largest distance of a snapshot from an event that it shows, relative to its time.
const NEAR: f64 = 1e-9;
/// Height of the line with the time, in points.
const BAND: f64 = 10.0;
/// Height of a peg, in points.
const PEG: f64 = 4.0;
/// Radius of a bolt, a support at a single point, in points.
const BOLT: f64 = 1.4;
/// Radius of a ball, in points; a scene gives none.
const BALL: f64 = 3.0;
/// Mark at a point in contact.
const MARK: Color = Color(213, 94, 0);
/// Width of the view in one of two columns, in points.
const HALF: f64 = 108.0;
/// Largest height of a view, relative to its width.
const TALLEST: f64 = 10.0 / 9.0;

type Space = [f64; 3];

/// Returns at most `most` evenly chosen entries, including the first and the last.
pub fn spread<T>(items: &[T], most: usize) -> Vec<&T> {
    let count = items.len().min(most);
    (0..count).map(|i| &items[if count > 1 { i * (items.len() - 1) / (count - 1) } else { 0 }]).collect()
}

/// Quantity that colours a surface.
#[derive(Clone, Copy, PartialEq)]
pub enum ColorBy {
    /// Deflection.
    Deflection,
    /// Von Mises stress.
    VonMises,
    /// Shape of a mode, with its nodal lines.
    Mode,
}

impl ColorBy {
    fn values(self, surface: &Surface) -> &[f64] {
        match self {
            ColorBy::Deflection | ColorBy::Mode => &surface.deflection,
            ColorBy::VonMises => &surface.von_mises,
        }
    }

    /// Returns the quantity and its unit.
    fn quantity(self) -> [&'static str; 2] {
        match self {
            ColorBy::Deflection => ["deflection", "m"],
            ColorBy::VonMises => ["von Mises stress", "Pa"],
            ColorBy::Mode => ["mode shape", ""],
        }
    }
}

/// Event of a run and its time in s.
pub type Occasion = (String, f64);

/// Snapshot: its time in s, the event near it, if it was chosen for one, and its surface.
pub type Shot = (f64, Option<Occasion>, Surface);

/// Support at a point: its coordinates and the radius of its washer, 0 without one, in m.
pub type Bolt = [f64; 3];

/// Draws each snapshot in a figure of its own, coloured by deflection, at one scale, with bolts.
pub fn frames(snapshots: Vec<Shot>, title: &str, bolts: &[Bolt]) -> Vec<Figure> {
    let snapshots = snapshots.into_iter().map(|(time, _, surface)| (instant(time), surface));
    let (ramp, panels) = views(snapshots.collect(), ColorBy::Deflection, HALF, bolts);
    panels.into_iter().map(|panel| Figure::new(title).ramp(ramp.clone()).panel(panel)).collect()
}

/// Draws snapshots side by side at one scale, with bolts.
pub fn colored(snapshots: Vec<Shot>, title: &str, by: ColorBy, bolts: &[Bolt]) -> Figure {
    let caption = |time: f64, event: Option<Occasion>| match event {
        None => instant(time),
        Some((event, when)) => {
            let link = if (when - time).abs() <= NEAR * time { "at" } else { "near" };
            format!("{event} {link} {}", instant(time))
        }
    };
    let snapshots = snapshots.into_iter().map(|(time, event, surface)| (caption(time, event), surface));
    let columns = snapshots.len().clamp(1, 2);
    let (ramp, panels) = views(snapshots.collect(), by, 2.0 * HALF / columns as f64, bolts);
    panels.into_iter().fold(Figure::new(title).columns(columns).ramp(ramp), Figure::panel)
}

/// Draws the shapes of modes (frequency in Hz, surface) in their order, with their nodal lines and
/// bolts.
pub fn modes(modes: Vec<(f64, Surface)>, title: &str, bolts: &[Bolt]) -> Figure {
    let caption = |(number, (frequency, surface)): (i32, (f64, Surface))| {
        (format!("{number}: {}", engineering(frequency, "Hz")), surface)
    };
    let columns = modes.len().clamp(1, 3);
    let modes = (1..).zip(modes).map(caption).collect();
    let (ramp, panels) = views(modes, ColorBy::Mode, 2.0 * HALF / columns as f64, bolts);
    panels.into_iter().fold(Figure::new(title).columns(columns).ramp(ramp), Figure::panel)
}

fn instant(time: f64) -> String {
    format!("t = {}", engineering(time, "s").replace('u', "\u{b5}"))
}

/// Returns the colours and one view per surface, with its caption and bolts, all at one scale, for
/// a width in points.
fn views(snapshots: Vec<(String, Surface)>, by: ColorBy, width: f64, bolts: &[Bolt]) -> (Ramp, Vec<Panel>) {
    let held = held(&snapshots);
    let mut snapshots: Vec<(String, Surface)> =
        snapshots.into_iter().map(|(caption, surface)| (caption, coarsened(surface))).collect();
    let range = |values: &mut dyn Iterator<Item = f64>| range(values.filter(|value| value.is_finite()));
    let deflections = |(_, surface): &(String, Surface)| surface.deflection.clone();
    let [low, high] = range(&mut snapshots.iter().flat_map(deflections));
    // A distant obstacle is left out, because it would make the plate too small.
    let heights = snapshots.iter_mut().flat_map(|(_, surface)| surface.obstacles.iter_mut().flatten());
    heights.filter(|height| !is_near(**height, [low, high].into_iter())).for_each(|far| *far = f64::NAN);
    let is_shown = move |height: f64| is_near(height, [low, high].into_iter());

    let points = || snapshots.iter().flat_map(|(_, surface)| surface.points.iter());
    let sides = [0, 1].map(|axis| range(&mut points().map(|point| point[axis])));
    let size = sides.iter().map(|[low, high]| high - low).fold(0.0, f64::max);
    let heights = snapshots.iter().flat_map(|(_, surface)| surface.obstacles.iter().flatten().copied());
    let heights = range(&mut heights.chain([low, high, 0.0]));
    let scale = match by {
        ColorBy::Mode => MODE * size,
        _ => relief_scale(heights[0], heights[1], size),
    };

    let view = View { sides, size, scale };
    let wall =
        |(_, surface): &(String, Surface)| [0, 1].map(|side| Wall::of(surface, side, &view, low, high));
    let walls: Vec<[Wall; 2]> = snapshots.iter().map(wall).collect();
    // All snapshots share one window.
    let surfaces =
        snapshots.iter().flat_map(|(_, surface)| (0..surface.points.len()).map(|p| surface.place(p)));
    let walls_seen = walls.iter().flatten().flat_map(|wall| wall.faces.iter().flatten().chain(&wall.stops));
    let balls = snapshots.iter().flat_map(|(_, surface)| &surface.balls);
    // Balls above and below the plate have room beyond the window.
    let [over, under] =
        [1.0, -1.0].map(|side| if balls.clone().any(|ball| ball[3] == side) { 2.0 * BALL } else { 0.0 });
    let balls = balls.filter(|ball| is_shown(ball[2])).map(|&[x, y, z, _]| [x, y, z]);
    let seen: Vec<[f64; 2]> =
        surfaces.chain(walls_seen.copied()).chain(balls).map(|point| view.see(point)).collect();
    let window = Window([0, 1].map(|axis| self::range(seen.iter().map(|point| point[axis]))));
    // A value much smaller than the others is a rounding error.
    let [low, high] = range(&mut snapshots.iter().flat_map(|(_, surface)| by.values(surface).to_vec()));
    let end = |w: f64| if w.abs() < 1e-4 * (high - low) { 0.0 } else { w };
    let share = move |w: f64| if high > low { (w - low) / (high - low) } else { 0.5 };
    let [quantity, symbol] = by.quantity();
    let mut ramp = Ramp::new(quantity, symbol, [low, high].map(end), depth);
    if scale != 1.0 && by != ColorBy::Mode {
        ramp.label += &format!(", drawn ×{scale}");
    }
    let mut panels = Vec::new();
    for ((caption, surface), [floor, ceiling]) in snapshots.into_iter().zip(walls) {
        let (held, bolts) = (held.clone(), bolts.to_vec());
        let [across, up] = window.size();
        let height = (width * up / across).clamp(20.0, TALLEST * width) + BAND + over + under;
        let draw = move |paper: &mut Canvas, frame: Frame| {
            let (top, bottom) = (frame.top + BAND + over, frame.bottom - under);
            let below = Frame { top, bottom, ..frame };
            let drawn = |point: Space| window.at(below, view.see(point));
            for face in &floor.faces {
                let corners: Vec<_> = face.iter().map(|&corner| drawn(corner)).collect();
                paper.polygon(&corners, Color::SHADE, Some(Pen::solid(Color::SHADE, 0.3)));
            }
            floor.edges.iter().for_each(|edge| paper.polyline(&edge.map(drawn), OUTLINE));
            let pegs = |stops: &[Space], down| stops.iter().map(|&stop| peg(drawn(stop), down)).collect();
            let [standing, hanging]: [Vec<[At; 3]>; 2] =
                [pegs(&floor.stops, 1.0), pegs(&ceiling.stops, -1.0)];
            standing.iter().for_each(|peg| paper.polygon(peg, Color::SHADE, Some(OUTLINE)));
            // The plate covers the inner half of these lines.
            held.iter().for_each(|edge| paper.polyline(&edge.map(|[x, y]| drawn([x, y, 0.0])), HELD));
            let mut faces = Vec::new();
            for face in view.sorted(&surface) {
                let corners: Vec<_> = face.iter().map(|&point| drawn(surface.place(point))).collect();
                let mean = face.iter().map(|&p| by.values(&surface)[p]).sum::<f64>() / face.len() as f64;
                let color = depth(share(mean));
                paper.polygon(&corners, color, Some(Pen::solid(color.towards(Color::BLACK, 0.18), 0.15)));
                faces.push(corners);
            }
            let edges = floor.edges.iter().map(|edge| edge.map(drawn).to_vec());
            for line in edges.chain(standing.iter().map(|&[a, b, c]| vec![a, b, c, a])) {
                if line.iter().all(|&end| faces.iter().any(|face| encloses(face, end))) {
                    BEHIND.iter().for_each(|&pen| paper.polyline(&line, pen));
                }
            }
            if by == ColorBy::Mode {
                let lines = surface.cells.iter().flat_map(|face| nodal_lines(&surface, face));
                lines.for_each(|line| paper.polyline(&line.map(drawn), NODAL));
            }
            for [x, y, radius] in &bolts {
                let distance = |point: &[f64; 2]| (point[0] - x).hypot(point[1] - y);
                let distances = surface.points.iter().map(distance).zip(&surface.deflection);
                if let Some((_, &w)) = distances.min_by(|a, b| a.0.total_cmp(&b.0)) {
                    let rim = |(sin, cos): (f64, f64)| drawn([x + radius * cos, y + radius * sin, w]);
                    let rim =
                        (0..RIM).map(|corner| rim((TAU * f64::from(corner) / f64::from(RIM)).sin_cos()));
                    match *radius > 0.0 {
                        true => paper.polygon(&rim.collect::<Vec<_>>(), Color::BLACK, Some(WASHER)),
                        false => paper.circle(drawn([*x, *y, w]), BOLT, Color::BLACK, None),
                    }
                }
            }
            for (point, _) in surface.reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
                paper.circle(drawn(surface.place(point)), 0.9, MARK, None);
            }
            for (above, edge, place) in [(1.0, top, "above"), (-1.0, bottom, "below")] {
                let far = surface.balls.iter().filter(|ball| ball[3] == above && !is_shown(ball[2]));
                let heights = self::range(far.clone().map(|ball| ball[2].abs()));
                let [near, most] = heights.map(|height| engineering(height, "m").replace('u', "\u{b5}"));
                let words = match far.clone().count() {
                    0 => continue,
                    1 => format!("ball {near} {place}"),
                    _ => format!("balls {near} to {most} {place}"),
                };
                let [first, last] = self::range(far.map(|&[x, y, ..]| drawn([x, y, 0.0])[0]));
                let [before, after] = [first - frame.left, frame.right - last];
                let (x, anchor) = match before > after {
                    true => (first - 1.5 * BALL, Anchor::End),
                    false => (last + 1.5 * BALL, Anchor::Start),
                };
                let look = fitted(&words, before.max(after).max(10.0 * BALL) - 2.0 * BALL);
                paper.text(&words, [x, edge - above * BALL], look, anchor);
            }
            for &[x, y, z, side] in &surface.balls {
                let edge = if side > 0.0 { top } else { bottom };
                let [right, down] =
                    if is_shown(z) { drawn([x, y, z]) } else { [drawn([x, y, 0.0])[0], edge] };
                paper.circle([right, down - side * BALL], BALL, Color::GREY, Some(OUTLINE));
            }
            ceiling.edges.iter().for_each(|edge| paper.polyline(&edge.map(drawn), HIDDEN));
            hanging.iter().for_each(|peg| paper.polygon(peg, Color::SHADE, Some(OUTLINE)));
            let look = fitted(&caption, frame.right - frame.left - 2.0);
            paper.text(&caption, [frame.left + 2.0, frame.top + 4.0], look, Anchor::Start);
        };
        panels.push(Panel::drawing(draw).height(height));
    }
    (ramp, panels)
}

/// Returns the type of a remark that fits into a width, in points.
fn fitted(words: &str, room: f64) -> Type {
    Type { size: REMARK.size * (room / REMARK.width(words)).min(1.0), ..REMARK }
}

/// Returns the edges of the plate's border that stay at zero in all snapshots while others move,
/// each a little longer at both ends, so that no seam shows between neighbours.
fn held(snapshots: &[(String, Surface)]) -> Vec<[[f64; 2]; 2]> {
    let Some((_, first)) = snapshots.first() else { return Vec::new() };
    let held = held_points(snapshots.iter().map(|(_, surface)| &*surface.deflection));
    boundary(&first.cells)
        .into_iter()
        .filter(|side| side.iter().all(|&point| held[point]))
        .map(|[a, b]| {
            let [a, b] = [first.points[a], first.points[b]];
            let beyond = |from: [f64; 2], to: [f64; 2]| [0, 1].map(|axis| 1.1 * to[axis] - 0.1 * from[axis]);
            [beyond(b, a), beyond(a, b)]
        })
        .collect()
}

/// Returns the ends of the nodal lines of a mode in a face, where it moves; where two cross there
/// may be two.
fn nodal_lines(surface: &Surface, face: &[usize]) -> Vec<[Space; 2]> {
    if face.iter().all(|&point| surface.deflection[point].abs() < STILL) {
        return Vec::new();
    }
    let sides = face.iter().zip(face.iter().cycle().skip(1));
    let crossing = |(&a, &b): (&usize, &usize)| {
        let [from, to] = [surface.deflection[a], surface.deflection[b]];
        let share = (from / (from - to)).clamp(0.0, 1.0);
        let between = |axis: usize| {
            let [from, to] = [a, b].map(|point| surface.points[point][axis]);
            from + share * (to - from)
        };
        // Points on the line itself count as above it, whatever their rounding: no gap opens.
        let crosses = (from < -ROUNDING) != (to < -ROUNDING);
        crosses.then(|| [between(0), between(1), 0.0])
    };
    sides.filter_map(crossing).collect::<Vec<_>>().as_chunks().0.to_vec()
}

/// Returns the corners of an obstacle at a single point: a peg that stands below the plate or hangs
/// above it.
fn peg([x, y]: At, down: f64) -> [At; 3] {
    let base = y + down * PEG;
    [[x, y], [x + 0.4 * PEG, base], [x - 0.4 * PEG, base]]
}

/// Returns whether a polygon encloses a point.
fn encloses(corners: &[At], [x, y]: At) -> bool {
    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
    let is_right = |(a, b): &(&At, &At)| {
        (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
    };
    sides.filter(is_right).count() % 2 == 1
}

/// Point with the value there.
pub(super) type Corner = ([f64; 2], f64);

/// Returns the part of a polygon above a level, and the points where its sides cross the level.
pub(super) fn above(corners: &[Corner], level: f64) -> (Vec<Corner>, Vec<[f64; 2]>) {
    let (mut part, mut ends) = (Vec::new(), Vec::new());
    for (&(place, value), &(next, next_value)) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        if value >= level {
            part.push((place, value));
        }
        if (value >= level) != (next_value >= level) {
            let share = (level - value) / (next_value - value);
            let crossing = [0, 1].map(|axis| place[axis] + share * (next[axis] - place[axis]));
            part.push((crossing, level));
            ends.push(crossing);
        }
    }
    (part, ends)
}

/// Reach of the drawing of a curved obstacle beyond the deflections, relative to their range.
const REACH: f64 = 0.5;
/// Depths of the contour lines of a curved obstacle, relative to the drawn part.
const CONTOURS: [f64; 2] = [0.3, 1.0];

/// Drawing of an obstacle.
struct Wall {
    faces: Vec<Vec<Space>>,
    /// Edges of the faces, and contour lines.
    edges: Vec<[Space; 2]>,
    /// Points without a face.
    stops: Vec<Space>,
}

impl Wall {
    /// Returns the obstacle below (side 0) or above (side 1) a surface.
    ///
    /// A level obstacle that faces the whole surface becomes a slightly larger rectangle. One that
    /// curves away ends not far beyond the deflections from `low` to `high`, in m, since enlarged
    /// heights would draw its rim far from the plate.
    fn of(surface: &Surface, side: usize, view: &View, low: f64, high: f64) -> Wall {
        let heights = &surface.obstacles[side];
        let place = |point: usize| [surface.points[point][0], surface.points[point][1], heights[point]];
        let mut of_faces = surface.cells.iter().flatten().map(|&point| heights.get(point).copied());
        if let Some(Some(height)) = of_faces.next()
            && of_faces.all(|other| other == Some(height))
        {
            let [a, b, c, d] = view.plane(height);
            let edges = vec![[a, b], [b, c], [c, d], [d, a]];
            return Wall { faces: vec![vec![a, b, c, d]], edges, stops: Vec::new() };
        }
        let (faces, stops) = surface.wall(side);
        // Heights towards the plate.
        let (sign, lowest) = if side == 0 { (1.0, low) } else { (-1.0, -high) };
        let corner = |point: usize| (surface.points[point], sign * heights[point]);
        let [farthest, nearest] = range(faces.iter().copied().flatten().map(|&point| corner(point).1));
        let end = farthest.max(nearest.min(lowest) - REACH * (high - low));
        let space = |([x, y], height): Corner| [x, y, sign * height];
        let part = |points: &[usize], level: f64| {
            above(&points.iter().map(|&point| corner(point)).collect::<Vec<_>>(), level)
        };
        let drawn = |points: &[usize]| part(points, end).0.into_iter().map(space).collect::<Vec<_>>();
        let rims = boundary(faces.iter().copied()).into_iter().map(|side| drawn(&side));
        let levels = CONTOURS.map(|share| nearest - share * (nearest - end)).into_iter();
        let lines = levels.filter(|_| nearest > farthest).flat_map(|level| {
            let crossings = faces.iter().map(move |face| (level, part(face, level).1));
            crossings.map(|(level, ends)| ends.into_iter().map(|place| space((place, level))).collect())
        });
        Wall {
            stops: stops.into_iter().map(place).collect(),
            edges: rims
                .chain(lines)
                .filter_map(|ends: Vec<Space>| Some([*ends.first()?, *ends.get(1)?]))
                .collect(),
            faces: faces.iter().map(|face| drawn(face)).filter(|face| face.len() > 2).collect(),
        }
    }
}

/// Returns the scale at which heights between two bounds (m) are visible on a plate of that size
/// (m).
pub fn relief_scale(low: f64, high: f64, size: f64) -> f64 {
    if high > low { exaggeration(RELIEF * size / (high - low)) } else { 1.0 }
}

/// Returns the largest of 1, 2, 5, 10, ... that does not exceed a number.
fn exaggeration(most: f64) -> f64 {
    if !(most.is_finite() && most > 1.0) {
        return 1.0;
    }
    let power = 10f64.powf(most.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|digit| digit * power).find(|&scale| scale <= most).unwrap_or(1.0)
}

/// Returns a colour from dark to light, as in the palette "viridis".
pub(super) fn depth(share: f64) -> Color {
    let stops =
        [Color(68, 1, 84), Color(59, 82, 139), Color(33, 145, 140), Color(94, 201, 98), Color(253, 231, 37)];
    blend(&stops, share)
}

impl Surface {
    fn place(&self, point: usize) -> Space {
        let [x, y] = self.points[point];
        [x, y, self.deflection[point]]
    }
}

/// View of the plate from the eye.
#[derive(Clone, Copy)]
struct View {
    sides: [[f64; 2]; 2],
    size: f64,
    /// Scale of the deflections.
    scale: f64,
}

impl View {
    /// Rotates a point to coordinates right, up and away, in sizes of the plate.
    fn turned(&self, [x, y, w]: Space) -> Space {
        let centred = |value: f64, [low, high]: [f64; 2]| (value - 0.5 * (low + high)) / self.size;
        let (x, y, z) = (centred(x, self.sides[0]), centred(y, self.sides[1]), self.scale * w / self.size);
        let (sin, cos) = TURN.sin_cos();
        let (x, y) = (cos * x - sin * y, sin * x + cos * y);
        let (sin, cos) = RISE.sin_cos();
        [x, sin * y + cos * z, cos * y - sin * z]
    }

    /// Projects a point to coordinates right and up on the picture.
    fn see(&self, point: Space) -> [f64; 2] {
        let [right, up, away] = self.turned(point);
        [right, up].map(|length| length * DISTANCE / (DISTANCE + away))
    }

    /// Returns a rectangle slightly larger than the plate, at a height.
    fn plane(&self, height: f64) -> [Space; 4] {
        let more = 0.08 * self.size;
        let [[left, right], [front, back]] = self.sides.map(|[low, high]| [low - more, high + more]);
        [[left, front, height], [right, front, height], [right, back, height], [left, back, height]]
    }

    /// Returns the faces of a surface, sorted from far to near.
    fn sorted<'s>(&self, surface: &'s Surface) -> Vec<&'s [usize]> {
        let away = |face: &[usize]| {
            face.iter().map(|&point| self.turned(surface.place(point))[2]).sum::<f64>() / face.len() as f64
        };
        let mut faces: Vec<(f64, &[usize])> =
            surface.cells.iter().map(|face| (away(face), face.as_slice())).collect();
        faces.sort_by(|a, b| b.0.total_cmp(&a.0));
        faces.into_iter().map(|(_, face)| face).collect()
    }
}

/// Visible part of the picture plane: its ends to the right and upwards.
#[derive(Clone, Copy)]
struct Window([[f64; 2]; 2]);

impl Window {
    fn size(&self) -> [f64; 2] {
        self.0.map(|[low, high]| high - low)
    }

    fn at(&self, frame: Frame, [right, up]: [f64; 2]) -> [f64; 2] {
        let [width, height] = self.size();
        let scale = ((frame.right - frame.left) / width).min((frame.bottom - frame.top) / height);
        let middle = self.0.map(|[low, high]| 0.5 * (low + high));
        [
            0.5 * (frame.left + frame.right) + scale * (right - middle[0]),
            0.5 * (frame.top + frame.bottom) - scale * (up - middle[1]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::{Surface, nodal_lines};

    #[test]
    fn what_does_not_move_has_no_nodal_line() {
        let points = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let lines = |w: f64| {
            let deflection = vec![-w, w, w, -w];
            nodal_lines(&Surface { points: points.clone(), deflection, ..Surface::default() }, &[0, 1, 2, 3])
        };
        assert_eq!(lines(2e-3), [[[0.5, 0.0, 0.0], [0.5, 1.0, 0.0]]]);
        assert!(lines(5e-4).is_empty());
    }
}
