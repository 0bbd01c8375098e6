//! Plots for publication, drawn as SVG and, from the same SVG, as PNG.
//!
//! A [`Figure`] has [`Panel`]s; a panel has [`Axis`] and [`Curve`]s. Lengths are in points for a
//! column of 85 mm (or a page of 180 mm), with letters of 6 to 8 points. Series differ in colour
//! (the palette of Okabe and Ito, for every kind of colour vision), in dashes and in markers, so
//! that they are distinct in grey. PNGs have 400 dots per inch and need no font on the machine.
//!
//! Extremes survive: a long curve keeps the least and greatest value of each column of the picture.
//! Values that are not finite leave a gap, and no data make a drawing fail.
//!
//! ```
//! use rebond::output::plot::{Axis, Curve, Figure, Panel};
//!
//! let errors = Panel::new(Axis::log("step", "s"), Axis::log("error", ""))
//!     .curve(Curve::new("midpoint", vec![[1e-4, 2e-2], [1e-5, 2e-4]]).style(0).marks(0))
//!     .slope(2.0, [3e-5, 3e-3]);
//! assert!(Figure::new("Errors").panel(errors).svg().contains("10⁻⁴"));
//! ```

pub mod animation;
mod axis;
pub mod coarse;
pub mod forces;
mod layout;
mod panel;
mod paper;
pub mod perspective;
pub mod plan;
pub mod run;
mod strokes;

use super::remove;
use crate::error::Result;
use std::path::Path;

pub use axis::{Axis, short};
pub use layout::Figure;
pub use panel::{Bar, Curve, Obstacle, Panel, Ramp};
pub use paper::{Color, Pen};
pub(in crate::output) use paper::{escaped, png};

/// Name of the folder of plots in the run folder.
pub const FOLDER: &str = "plots";

/// Names of a run's plots, without their extensions, and what they show, in order of importance.
pub const PICTURES: [(&str, &str); 10] = [
    ("history", "Probes, forces and energies over time"),
    ("snapshots", "Snapshots of the plate, coloured by deflection"),
    ("contacts", "Contacts of nodes over time, and where they are on the plate"),
    ("energy", "Energies, change of their sum, and force of the obstacles over time"),
    ("extremes", "Plan of the largest von Mises stress, with contour lines and its place"),
    ("forces", "Forces of obstacles over time and over the gap, impulses of rigid ones"),
    ("spectrum", "Spectra of the probes, with the numbers of the natural modes"),
    ("stresses", "Snapshots of the plate, coloured by von Mises stress"),
    ("phase", "Phase portraits of the probes"),
    (animation::NAME, "Moving picture of the plate"),
];

/// Removes the plots of a run from its folder.
///
/// # Errors
/// Returns [`Error::Io`](crate::Error::Io) where a file cannot be removed.
pub fn clear(folder: &Path) -> Result<()> {
    let pictures =
        PICTURES.iter().flat_map(|(name, _)| ["svg", "png", "gif"].map(|end| format!("{name}.{end}")));
    pictures.into_iter().try_for_each(|name| remove(&folder.join(FOLDER).join(name)))
}
