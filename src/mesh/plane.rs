//! Plane of a mesh in space, and the axes in it that become x and y.

use super::Point;
use nalgebra::Vector3;

/// Largest distance of a node from the plane, relative to the size of the mesh. Numbers with six
/// digits lie within it, and a plate within it is flat to a fraction of its thickness.
pub const FLAT: f64 = 1e-5;

/// Plane with the directions, in the coordinates of a file, of x and y.
pub struct Plane {
    axes: [Vector3<f64>; 2],
    /// Sentence on a plane other than z = 0 or parallel to it.
    pub note: Option<String>,
}

/// Node that lies off the plane of the others: its index, and what is wrong.
pub struct OffPlane {
    pub index: usize,
    pub wrong: String,
}

impl Plane {
    /// Returns the plane of some positions, which is parallel to coordinates where it can.
    ///
    /// Coordinates of such a plane keep their digits. In a vertical plane y goes upwards, and in
    /// any other x is the direction nearest to the file's x.
    pub fn of(positions: &[[f64; 3]]) -> Result<Plane, OffPlane> {
        let first = Vector3::from(positions.first().copied().unwrap_or_default());
        let arms = || positions.iter().map(|position| Vector3::from(*position) - first);
        let extents = arms().fold(Vector3::zeros(), |extents, arm| arm.abs().sup(&extents));
        let size = extents.max();
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        let is_flat = |axis: usize| extents[axis] <= FLAT * size;
        let parallel = |axis: usize, axes: [Vector3<f64>; 2], words: &str| {
            let name = ["x", "y", "z"][axis];
            let note = format!("the mesh lies in the plane {name} = {}: {words}", first[axis]);
            Plane { axes, note: Some(note) }
        };
        if is_flat(2) {
            return Ok(Plane::default());
        }
        if is_flat(0) {
            return Ok(parallel(0, [y, z], "its y is x here, its z is y, and its x points up"));
        }
        if is_flat(1) {
            return Ok(parallel(1, [x, z], "its x is x here, its z is y, and its y points down"));
        }
        // The plane goes through the first node, the farthest, and the farthest from their line.
        let arms: Vec<Vector3<f64>> = arms().map(|arm| arm / size).collect();
        let farthest = |distance: &dyn Fn(&Vector3<f64>) -> f64| {
            let distances = arms.iter().map(distance).enumerate();
            distances.fold((0, 0.0), |most, next| if next.1 > most.1 { next } else { most })
        };
        let (second, length) = farthest(&|arm| arm.norm());
        let along = arms[second] / length;
        let (third, width) = farthest(&|arm| along.cross(arm).norm());
        if width <= FLAT {
            // The cells have no area in any plane.
            return Ok(Plane::default());
        }
        let normal = along.cross(&arms[third]).normalize();
        let (index, height) = farthest(&|arm| normal.dot(arm).abs());
        if height > FLAT {
            let wrong = format!(
                "lies {height:.1e} of the size of the mesh off the plane of three others: a plate is flat; expected at \
                 most {FLAT:e}"
            );
            return Err(OffPlane { index, wrong });
        }
        let across = if normal.z.abs() <= FLAT {
            let level = normal.cross(&z).normalize();
            let is_against = if level.x.abs() > FLAT { level.x < 0.0 } else { level.y < 0.0 };
            [if is_against { -level } else { level }, z]
        } else {
            let up = normal * normal.z.signum();
            let level = (x - up * up.x).normalize();
            [level, up.cross(&level)]
        };
        let [x, y] = across.map(direction);
        let note =
            format!("the mesh lies in an oblique plane: x here goes along {x} of the file, y along {y}");
        Ok(Plane { axes: across, note: Some(note) })
    }

    /// Returns the coordinates x and y of a position.
    pub fn point(&self, position: [f64; 3]) -> Point {
        let position = Vector3::from(position);
        let [x, y] = self.axes.map(|axis| axis.dot(&position));
        Point::new(x, y)
    }
}

impl Default for Plane {
    fn default() -> Plane {
        Plane { axes: [Vector3::x(), Vector3::y()], note: None }
    }
}

/// Formats a direction with five digits after the point, which show every plane that is not flat.
fn direction(axis: Vector3<f64>) -> String {
    let [x, y, z] = [axis.x, axis.y, axis.z].map(|part| (part * 1e5).round() / 1e5 + 0.0);
    let [x, y, z] = [x, y, z].map(|part| part.to_string());
    format!("({x}, {y}, {z})")
}
