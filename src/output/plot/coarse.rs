//! Coarser faces for fine surfaces, of which a picture shows no more.

use crate::geometry::range;
use crate::output::vtu::Surface;
use std::collections::{BTreeMap, HashMap, HashSet};

/// Number of faces above which a surface is drawn on a coarser grid with about as many.
const MOST_FACES: usize = 3000;

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

/// Reduces the faces of a fine surface to those of the mesh, or to those of a grid.
///
/// The grid serves where the mesh has too many faces as well; its points take the nearest values.
pub fn coarsened(surface: Surface) -> Surface {
    if surface.cells.len() <= MOST_FACES {
        return surface;
    }
    let cells = surface.parents.iter().collect::<HashSet<_>>().len();
    if cells <= MOST_FACES {
        return merged(surface);
    }
    let ends = |axis: usize| range(surface.points.iter().map(|point| point[axis]));
    let [[left, right], [front, back]] = [ends(0), ends(1)];
    let spacing = ((right - left) * (back - front) / MOST_FACES as f64).sqrt();
    let parts = |length: f64| (length / spacing).round().max(1.0) as usize;
    let [nx, ny] = [parts(right - left), parts(back - front)];
    let [dx, dy] = [(right - left) / nx as f64, (back - front) / ny as f64];
    // The map has the distance to the nearest point, and that point, by position in the grid.
    let mut nearest: HashMap<(usize, usize), (f64, usize)> = HashMap::new();
    for (number, &[x, y]) in surface.points.iter().enumerate() {
        let [i, j] = [(x - left) / dx, (y - front) / dy];
        let distance = (i - i.round()).hypot(j - j.round());
        let best = nearest.entry((i.round() as usize, j.round() as usize)).or_insert((distance, number));
        if distance < best.0 {
            *best = (distance, number);
        }
    }
    let mut coarse = Surface::default();
    let mut numbers = HashMap::new();
    for (&(i, j), &(_, point)) in &nearest {
        numbers.insert((i, j), coarse.points.len());
        coarse.points.push([left + dx * i as f64, front + dy * j as f64]);
        coarse.deflection.push(surface.deflection[point]);
        coarse.von_mises.extend(surface.von_mises.get(point));
        for (coarse, fine) in coarse.obstacles.iter_mut().zip(&surface.obstacles) {
            coarse.extend(fine.get(point));
        }
    }
    for j in 0..ny {
        for i in 0..nx {
            let corners =
                [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|place| numbers.get(&place).copied());
            if let [Some(a), Some(b), Some(c), Some(d)] = corners {
                coarse.cells.push(vec![a, b, c, d]);
            }
        }
    }
    // Points in contact keep their positions.
    let points = surface.points.iter().zip(surface.deflection.iter().zip(&surface.reaction));
    for (number, (&place, (&w, &r))) in points.enumerate() {
        coarse.reaction.resize(coarse.points.len(), 0.0);
        if r != 0.0 {
            coarse.points.push(place);
            coarse.deflection.push(w);
            coarse.von_mises.extend(surface.von_mises.get(number));
            coarse.reaction.push(r);
            coarse.obstacles.iter_mut().for_each(|heights| heights.push(f64::NAN));
        }
    }
    coarse
}
