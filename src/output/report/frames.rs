//! Snapshots of a run as frames of the page: one fixed set of points, and fields over them.

use super::blob::PageData;
use crate::error::{Error, Result};
use crate::geometry::range;
use crate::output::plot::{coarse, perspective};
use crate::output::vtu::{self, Surface, boundary};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::PathBuf;

/// Largest number of frames of a page.
pub const MOST_FRAMES: usize = 300;
/// Number of frames that even the finest surface has, if the run has as many snapshots.
const LEAST_FRAMES: usize = 60;
/// Approximate limit on the values of all fields in all frames.
const MOST_VALUES: usize = 700_000;

/// Frames of a run.
#[derive(Debug, Default)]
pub struct Frames {
    /// Times of the frames, in s.
    pub times: Vec<f64>,
    /// Number of snapshots of the run, of which the frames are some.
    pub snapshots: usize,
    /// Number of points of a snapshot.
    pub points_of_snapshot: usize,
    /// Points, faces and mesh lines.
    shown: ShownPoints,
    deflection: Vec<Vec<f64>>,
    von_mises: Vec<Vec<f64>>,
    obstacles: [Vec<Vec<f64>>; 2],
    /// Points in contact, by frame.
    touching: Vec<Vec<u32>>,
    /// Points of balls, by frame.
    balls: Vec<Vec<[f64; 4]>>,
}

impl Frames {
    /// Reads snapshots (times in s, files); `None` without any.
    ///
    /// Snapshots are left out, evenly, where there are too many for a page of moderate size.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where a file cannot be read, or where snapshots differ in their mesh.
    pub fn read(index: &[(f64, PathBuf)]) -> Result<Option<Frames>> {
        let Some((_, path)) = index.first() else { return Ok(None) };
        let first = vtu::read(path)?;
        let shown = ShownPoints::of(&first);
        let fields = if first.von_mises.is_empty() { 1 } else { 2 };
        let most = MOST_VALUES / (fields * shown.points.len().max(1));
        let most = most.clamp(LEAST_FRAMES, MOST_FRAMES);
        let (snapshots, points_of_snapshot) = (index.len(), first.points.len());
        let mut frames = Frames { snapshots, points_of_snapshot, shown, ..Frames::default() };
        for (time, path) in perspective::spread(index, most) {
            let surface = vtu::read(path)?;
            let same = |a: &[f64], b: &[f64]| a.is_empty() == b.is_empty();
            if surface.points != first.points || !same(&surface.von_mises, &first.von_mises) {
                let what = format!("other points or arrays than {}", index[0].1.display());
                return Err(Error::invalid(path, what));
            }
            frames.times.push(*time);
            frames.add(&surface);
        }
        Ok(Some(frames))
    }

    fn add(&mut self, surface: &Surface) {
        let points = &self.shown.points;
        let taken = |values: &[f64]| points.iter().map(|&point| values[point]).collect::<Vec<f64>>();
        self.deflection.push(taken(&surface.deflection));
        if !surface.von_mises.is_empty() {
            self.von_mises.push(taken(&surface.von_mises));
        }
        for (frames, heights) in self.obstacles.iter_mut().zip(&surface.obstacles) {
            if heights.iter().any(|height| height.is_finite()) {
                frames.push(taken(heights));
            }
        }
        self.balls.push(surface.balls.clone());
        let touched = surface.reaction.iter().enumerate().filter(|(_, reaction)| **reaction != 0.0);
        let touched: Vec<usize> = touched.map(|(point, _)| point).collect();
        let mut touching: Vec<u32> =
            touched.into_iter().map(|point| self.shown.nearest(surface, point)).collect();
        touching.sort_unstable();
        touching.dedup();
        self.touching.push(touching);
    }

    /// Returns the number of points of a frame.
    pub fn points(&self) -> usize {
        self.shown.points.len()
    }

    /// Returns the least and greatest deflection, in m, and the sides of the rectangle around the
    /// plate, in m.
    pub fn extent(&self) -> ([f64; 2], [f64; 2]) {
        let size = [0, 1].map(|axis| {
            let [low, high] = range(self.shown.places.iter().map(|place| place[axis]));
            high - low
        });
        (range(self.deflection.iter().flatten().copied().filter(|w| w.is_finite())), size)
    }

    /// Adds the arrays of the frames, and returns what colours can show, with unit and quantum.
    pub fn store(&self, data: &mut PageData) -> Value {
        let ShownPoints { places, faces, edges, .. } = &self.shown;
        data.doubles("frame_times", &self.times);
        data.floats("x", places.iter().map(|place| place[0]));
        data.floats("y", places.iter().map(|place| place[1]));
        let fan = |face: &Vec<u32>| {
            (1..face.len().saturating_sub(1))
                .flat_map(|i| [face[0], face[i], face[i + 1]])
                .collect::<Vec<_>>()
        };
        data.indices("triangles", &faces.iter().flat_map(fan).collect::<Vec<u32>>());
        data.indices("edges", &edges.iter().flatten().copied().collect::<Vec<u32>>());
        data.indices("held", &self.held());
        let ends = self.touching.iter().scan(0, |end, points| {
            *end += points.len() as u32;
            Some(*end)
        });
        data.indices("touch_ends", &ends.collect::<Vec<u32>>());
        data.indices("touch", &self.touching.concat());
        data.floats("balls", self.balls.concat().as_flattened().iter().copied());

        let quantum = data.levels("deflection", &self.deflection);
        let mut colors =
            vec![json!({ "name": "deflection", "label": "deflection", "unit": "m", "quantum": quantum })];
        for (name, heights) in ["floor", "ceiling"].into_iter().zip(&self.obstacles) {
            let Some(first) = heights.first() else { continue };
            if heights.len() != self.times.len() {
                continue; // an obstacle without a height in some frame has none at all
            }
            let same = |other: &Vec<f64>| other.iter().zip(first).all(|(a, b)| a.to_bits() == b.to_bits());
            let is_still = heights.iter().all(same);
            data.levels(name, if is_still { &heights[..1] } else { heights });
        }
        if self.obstacles.iter().any(|heights| !heights.is_empty()) {
            colors.push(json!({ "name": "gap", "label": "gap to the nearest obstacle", "unit": "m" }));
        }
        if !self.von_mises.is_empty() {
            let quantum = data.levels("von_mises", &self.von_mises);
            let label = "von Mises stress";
            colors.push(json!({ "name": "von_mises", "label": label, "unit": "Pa", "quantum": quantum }));
        }
        colors.into()
    }

    /// Returns the ends of the border's edges that stay at zero while other points move.
    fn held(&self) -> Vec<u32> {
        let held = vtu::held_points(self.deflection.iter().map(Vec::as_slice));
        let border = self.shown.border.iter();
        border.filter(|ends| ends.iter().all(|&end| held[end as usize])).flatten().copied().collect()
    }
}

/// Points of a snapshot that a page shows, and the faces between them.
#[derive(Debug, Default)]
struct ShownPoints {
    /// Numbers of the points in the snapshot.
    points: Vec<usize>,
    /// Coordinates of the points, in m.
    places: Vec<[f64; 2]>,
    faces: Vec<Vec<u32>>,
    /// Lines between cells of the mesh, and the border.
    edges: Vec<[u32; 2]>,
    border: Vec<[u32; 2]>,
    /// Index of the shown point for points of the snapshot that were asked for.
    shown: HashMap<usize, u32>,
}

impl ShownPoints {
    /// Chooses all points, those of the mesh, or those of a grid, as in the pictures of snapshots.
    fn of(surface: &Surface) -> ShownPoints {
        // The deflection carries the number of each point through the choice.
        let numbers = (0..surface.points.len()).map(|number| number as f64).collect();
        let bare = Surface {
            points: surface.points.clone(),
            cells: surface.cells.clone(),
            parents: surface.parents.clone(),
            deflection: numbers,
            ..Surface::default()
        };
        let coarse = coarse::coarsened(bare);
        let number = |point: usize| coarse.deflection[point] as usize;
        let mut points: Vec<usize> = coarse.cells.iter().flatten().map(|&point| number(point)).collect();
        points.extend([0, 1].into_iter().flat_map(|side| surface.wall(side).1));
        points.sort_unstable();
        points.dedup();
        sort_by_place(&mut points, &surface.points);
        let shown: HashMap<usize, u32> =
            points.iter().enumerate().map(|(i, &point)| (point, i as u32)).collect();
        let face = |cell: &Vec<usize>| cell.iter().map(|&point| shown[&number(point)]).collect();
        let faces: Vec<Vec<u32>> = coarse.cells.iter().map(face).collect();
        // Without parents the faces are no cells of a mesh, and there is the border only.
        let mut of_parents: BTreeMap<Option<&usize>, Vec<&Vec<u32>>> = BTreeMap::new();
        for (number, face) in faces.iter().enumerate() {
            of_parents.entry(coarse.parents.get(number)).or_default().push(face);
        }
        let edges: BTreeSet<[u32; 2]> = of_parents.into_values().flat_map(boundary).collect();
        let (edges, border) = (edges.into_iter().collect(), boundary(&faces));
        let places = points.iter().map(|&point| surface.points[point]).collect();
        ShownPoints { places, points, faces, edges, border, shown }
    }

    /// Returns the shown point that is nearest to a point of the snapshot.
    fn nearest(&mut self, surface: &Surface, point: usize) -> u32 {
        let places = &self.places;
        *self.shown.entry(point).or_insert_with(|| {
            let [x, y] = surface.points[point];
            let distance = |place: &[f64; 2]| (place[0] - x).hypot(place[1] - y);
            let order = |a: &(usize, f64), b: &(usize, f64)| a.1.total_cmp(&b.1);
            places.iter().map(distance).enumerate().min_by(order).map_or(0, |(i, _)| i as u32)
        })
    }
}

/// Sorts points by strips of the plate, since differences between neighbours take few bytes.
fn sort_by_place(points: &mut [usize], places: &[[f64; 2]]) {
    let ends = |axis: usize| range(points.iter().map(|&point| places[point][axis]));
    let [[left, right], [front, back]] = [ends(0), ends(1)];
    let strip = 0.7 * ((right - left) * (back - front) / points.len() as f64).sqrt();
    let row = |point: usize| if strip > 0.0 { ((places[point][1] - front) / strip).round() } else { 0.0 };
    points.sort_by(|&a, &b| row(a).total_cmp(&row(b)).then(places[a][0].total_cmp(&places[b][0])));
}
