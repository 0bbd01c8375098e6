//! Coarser faces for fine surfaces, of which a picture shows no more.

use crate::geometry::range;
use crate::output::vtu::{Surface, boundary};
use std::collections::{BTreeMap, HashMap, HashSet};

/// Number of faces above which a surface is drawn on a coarser grid with about as many.
const MOST_FACES: usize = 3000;

/// Cosine of the angle up to which the sides of a rim run straight on.
const STRAIGHT: f64 = 0.9;

/// Replaces the faces of a fine surface by one face per cell of the mesh.
fn merged(mut surface: Surface) -> Surface {
    // Each corner of a cell belongs to one of the small faces into which the cell is divided.
    let mut corners: BTreeMap<usize, BTreeMap<usize, usize>> = BTreeMap::new();
    for (face, &parent) in surface.cells.iter().zip(&surface.parents) {
        let of_parent = corners.entry(parent).or_default();
        face.iter().for_each(|&point| *of_parent.entry(point).or_default() += 1);
    }
    surface.parents = corners.keys().copied().collect();
    let points = &surface.points;
    let around = |faces: BTreeMap<usize, usize>| {
        let mut face: Vec<usize> =
            faces.into_iter().filter(|(_, faces)| *faces == 1).map(|(point, _)| point).collect();
        let middle =
            [0, 1].map(|axis| face.iter().map(|&p| points[p][axis]).sum::<f64>() / face.len() as f64);
        let angle = |point: usize| (points[point][1] - middle[1]).atan2(points[point][0] - middle[0]);
        face.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)));
        face
    };
    surface.cells = corners.into_values().map(around).collect();
    let mut is_corner = vec![false; surface.points.len()];
    surface.cells.iter().flatten().for_each(|&point| is_corner[point] = true);
    for heights in &mut surface.obstacles {
        let others = heights.iter_mut().zip(&is_corner).filter(|(_, is_corner)| !**is_corner);
        others.for_each(|(height, _)| *height = f64::NAN);
    }
    surface
}

/// Reduces the faces of a fine surface to the cells of the mesh or, where the mesh has too many
/// as well, by clustering of its points (Rossignac and Borrel, *Multi-resolution 3D approximations
/// for rendering complex scenes*, 1993). Rims, holes and corners stay.
pub fn coarsened(surface: Surface) -> Surface {
    if surface.cells.len() <= MOST_FACES {
        return surface;
    }
    let cells = surface.parents.iter().collect::<HashSet<_>>().len();
    if cells <= MOST_FACES { merged(surface) } else { clustered(&surface) }
}

/// Replaces the points in each square of a grid by one of them: a corner of the rim, else the point
/// of the rim or, inside, of all that is nearest to the square's centre.
fn clustered(surface: &Surface) -> Surface {
    let ends = |axis: usize| range(surface.points.iter().map(|point| point[axis]));
    let [[left, right], [front, back]] = [ends(0), ends(1)];
    let spacing = ((right - left) * (back - front) / MOST_FACES as f64).sqrt();
    let ranks = ranks(surface);
    let mut chosen: HashMap<[i64; 2], (u8, f64, usize)> = HashMap::new();
    let square = |[x, y]: [f64; 2]| [(x - left) / spacing, (y - front) / spacing];
    for (number, &point) in surface.points.iter().enumerate() {
        let [i, j] = square(point);
        let distance = (i - i.floor() - 0.5).hypot(j - j.floor() - 0.5);
        let candidate = (ranks[number], distance, number);
        let best = chosen.entry([i.floor() as i64, j.floor() as i64]).or_insert(candidate);
        if (candidate.0, candidate.1) < (best.0, best.1) {
            *best = candidate;
        }
    }
    let representative = |point: usize| chosen[&square(surface.points[point]).map(|i| i.floor() as i64)].2;
    let mut kept: Vec<usize> = chosen.values().map(|(.., point)| *point).collect();
    // Points in contact and stops keep their positions.
    kept.extend((0..surface.reaction.len()).filter(|&point| surface.reaction[point] != 0.0));
    kept.extend([0, 1].into_iter().flat_map(|side| surface.wall(side).1));
    kept.sort_unstable();
    kept.dedup();
    let numbers: HashMap<usize, usize> =
        kept.iter().enumerate().map(|(number, &point)| (point, number)).collect();
    let take = |values: &[f64]| kept.iter().filter_map(|&point| values.get(point).copied()).collect();
    let mut faces = HashSet::new();
    let face = |corners: &Vec<usize>| {
        let mut face: Vec<usize> = corners.iter().map(|&corner| numbers[&representative(corner)]).collect();
        face.dedup();
        if face.len() > 1 && face.first() == face.last() {
            face.pop();
        }
        let mut key = face.clone();
        key.sort_unstable();
        (face.len() > 2 && faces.insert(key)).then_some(face)
    };
    Surface {
        cells: surface.cells.iter().filter_map(face).collect(),
        points: kept.iter().map(|&point| surface.points[point]).collect(),
        deflection: take(&surface.deflection),
        reaction: take(&surface.reaction),
        obstacles: [take(&surface.obstacles[0]), take(&surface.obstacles[1])],
        von_mises: take(&surface.von_mises),
        parents: Vec::new(),
        balls: surface.balls.clone(),
    }
}

/// Returns 0 for points at corners of the rim, 1 on the rest of the rim, and 2 inside.
fn ranks(surface: &Surface) -> Vec<u8> {
    let mut sides: HashMap<usize, Vec<[f64; 2]>> = HashMap::new();
    for [a, b] in boundary(&surface.cells) {
        let [from, to] = [a, b].map(|point| surface.points[point]);
        let along = [to[0] - from[0], to[1] - from[1]];
        sides.entry(a).or_default().push(along);
        sides.entry(b).or_default().push(along.map(|x| -x));
    }
    let mut ranks = vec![2; surface.points.len()];
    for (point, sides) in sides {
        // Two sides in one line point away from each other.
        let is_straight = matches!(sides[..], [[a, b], [c, d]]
            if -(a * c + b * d) > STRAIGHT * a.hypot(b) * c.hypot(d));
        ranks[point] = u8::from(is_straight);
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::{MOST_FACES, coarsened};
    use crate::output::vtu::Surface;

    /// A stop at a point of a fine mesh is at the same point of the coarser faces.
    #[test]
    fn stops_stay_in_a_coarser_surface() {
        let side = 80;
        let number = |i: usize, j: usize| i * (side + 1) + j;
        let squares = (0..side * side).map(|cell| [cell / side, cell % side]);
        let corners = |[i, j]: [usize; 2]| [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
        let cells: Vec<Vec<usize>> =
            squares.map(|cell| corners(cell).map(|[i, j]| number(i, j)).to_vec()).collect();
        let count = (side + 1) * (side + 1);
        let mut ceiling = vec![f64::NAN; count];
        ceiling[number(33, 52)] = 2.0;
        let fine = Surface {
            points: (0..count)
                .map(|point| [point / (side + 1), point % (side + 1)].map(|x| x as f64))
                .collect(),
            parents: (0..cells.len()).collect(),
            cells,
            deflection: vec![0.0; count],
            obstacles: [vec![f64::NAN; count], ceiling],
            ..Surface::default()
        };
        let coarse = coarsened(fine);
        assert!(coarse.cells.len() < 2 * MOST_FACES && coarse.points.len() < count);
        let stops = coarse.wall(1).1;
        assert_eq!(stops.iter().map(|&stop| coarse.points[stop]).collect::<Vec<_>>(), [[33.0, 52.0]]);
        assert_eq!(coarse.obstacles[1][stops[0]], 2.0);
    }
}
