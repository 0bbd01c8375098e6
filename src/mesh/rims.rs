//! Names of the rims of a mesh: the outline, and the holes.

use super::{Mesh, Point};
use std::collections::BTreeMap;

/// Name of the outline of all parts.
const OUTLINE: &str = "boundary";

/// Area of a slit, relative to the areas that its sides make with the origin, up to rounding.
const SLIT: f64 = 1e-12;

impl Mesh {
    /// Names the outline of all parts `boundary`, and the rims of holes `hole_1`, `hole_2`, ...
    /// from left to right, by the means of their nodes, where the mesh has no such edges.
    pub fn name_rims(&mut self) {
        let mut holes: Vec<(Point, Vec<[usize; 2]>)> = Vec::new();
        let mut outline = Vec::new();
        for rim in self.rims() {
            let twice_area: f64 = rim.iter().map(|&side| self.cross(side)).sum();
            let size: f64 = rim.iter().map(|&side| self.cross(side).abs()).sum();
            // Cells lie to the left of a rim, so that it turns about a hole clockwise.
            if twice_area > SLIT * size {
                outline.extend(rim);
            } else {
                let sum = rim.iter().fold(Point::origin(), |sum, &[a, _]| sum + self.nodes[a].coords);
                holes.push((sum / rim.len() as f64, rim));
            }
        }
        holes.sort_by(|(a, _), (b, _)| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        let named = (1..).zip(holes).map(|(number, (_, rim))| (format!("hole_{number}"), rim));
        let named: BTreeMap<_, _> = named.collect();
        // Numbers of holes would mislead beside others.
        if named.keys().all(|name| !self.edges.contains_key(name)) {
            self.edges.extend(named);
        }
        self.edges.entry(OUTLINE.to_owned()).or_insert(outline);
    }

    /// Returns the closed rims of the mesh, each as the sides of cells in their order.
    fn rims(&self) -> Vec<Vec<[usize; 2]>> {
        let mut border = self.border();
        border.sort_unstable_by_key(|&[a, b]| [a.min(b), a.max(b)]);
        let mut next: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        border.into_iter().for_each(|[a, b]| next.entry(a).or_default().push(b));
        let mut rims = Vec::new();
        while let Some((&first, _)) = next.first_key_value() {
            let (mut rim, mut node) = (Vec::new(), first);
            while let Some(ends) = next.get_mut(&node) {
                let Some(end) = ends.pop() else { break };
                if ends.is_empty() {
                    next.remove(&node);
                }
                rim.push([node, end]);
                node = end;
            }
            rims.push(rim);
        }
        rims
    }

    /// Returns twice the area between a side and the origin, in m^2, signed.
    fn cross(&self, [a, b]: [usize; 2]) -> f64 {
        let [from, to] = [self.nodes[a], self.nodes[b]];
        from.x * to.y - to.x * from.y
    }
}
