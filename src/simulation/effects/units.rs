//! Check for lengths that cannot be in metres.

use super::ground::BuildContext;
use crate::partition::Partition;

/// Ratio of span to thickness above which a warning asks for the unit: 600 m for 3 mm is 200,000, a
/// foil of 1 m for 0.1 mm 10,000.
const FOIL: f64 = 2e4;

/// Ratio of span to thickness below which a warning asks for the unit: the plate is thicker than
/// wide.
const BLOCK: f64 = 1.0;

/// Span and thickness, in m, from which both are taken for millimetres.
const HUGE: [f64; 2] = [100.0, 0.5];

/// Span, in m, from which it is taken for millimetres whatever the thickness.
const LONGEST: f64 = 1e3;

/// Returns a warning that asks whether lengths are in metres, for a plate much too wide or too
/// narrow for its thickness. A mesh with the key `mesh.scale` is not questioned. Collective.
pub(super) fn question<P: Partition>(ground: &BuildContext<P>) -> Option<String> {
    let scene = ground.scene;
    let [right, top, left, bottom] = ground.farthest();
    let (span, thickness) = ((right + left).max(top + bottom), scene.plate.plate.thickness);
    let ratio = span / thickness;
    let is_told = scene.file.as_ref().is_some_and(|file| file.scale.is_some());
    let is_huge = span > LONGEST || span > HUGE[0] && thickness >= HUGE[1];
    if is_told || !ratio.is_finite() || !is_huge && (BLOCK..=FOIL).contains(&ratio) {
        return None;
    }
    let asked = match (&scene.file, ratio > FOIL) {
        (Some(_), true) => {
            "is the mesh in millimetres? mesh.scale = 1e-3 makes metres of them, mesh.scale = 1 says it is not"
        }
        _ if is_huge => "are lengths in millimetres? they are in metres",
        (None, true) => "is plate.length in millimetres? lengths are in metres",
        (_, false) => "is plate.thickness in millimetres? lengths are in metres",
    };
    Some(format!("the plate spans {span} m and is {thickness} m thick: {asked}"))
}
