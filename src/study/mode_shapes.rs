//! Shapes of the lowest natural modes of a scene's plate.

use super::frequencies::on_native_engine;
use crate::error::Result;
use crate::linalg::Engine;
use crate::modes::{self, Mode};
use crate::output::plot::perspective::{self, Bolt};
use crate::output::plot::{self, Figure};
use crate::output::text::{Table, engineering, grouped};
use crate::output::vtu::Surface;
use crate::output::{shapes, summary, write_atomic};
use crate::scene::{Initial, Mass, Scene, Snapshots, Support, SupportLocation};
use crate::scheme::System;
use crate::simulation::{Lattice, Model};
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Name of the table of frequencies in the folder of the modes.
const TABLE: &str = "modes.csv";

/// Name of the summary in that folder.
const SUMMARY: &str = "modes.json";

/// Number of parts of each edge of a cell at which shapes are evaluated, unless the scene says.
const PARTS: usize = 4;

/// Largest number of shapes in a picture.
const MOST_DRAWN: usize = 100;

/// Lowest natural modes of a scene, with the consistent mass.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModeShapes {
    /// Title of the scene.
    pub title: String,
    /// Number of free dofs.
    pub dofs: usize,
    /// Frequencies, in Hz, ascending; 0 for rigid motions.
    pub frequencies: Vec<f64>,
    /// Shapes on a fine grid, each with 1 as its largest value.
    #[serde(skip)]
    shapes: Vec<Surface>,
    /// Supports at points.
    #[serde(skip)]
    bolts: Vec<Bolt>,
}

impl ModeShapes {
    /// Computes the `count` lowest modes of a scene, or fewer if there are no more. Nothing
    /// touches; balls are in the air.
    ///
    /// # Errors
    /// Returns the errors of [`Model::new`] and of [`modes::shapes`].
    pub fn new(scene: &Scene, count: usize) -> Result<ModeShapes> {
        let mut scene = on_native_engine(scene);
        scene.time.mass = Mass::Consistent;
        scene.initial = Initial::flat();
        scene.attachments.balls.clear();
        scene.output.probes.clear();
        let subdivide = scene.output.fields.map_or(PARTS, |fields| fields.subdivide);
        scene.output.fields = Some(Snapshots { every: 1, subdivide, stresses: false, precision: 64 });
        let model = Model::new(&scene)?;
        let System { engine, stiffness, mass, .. } = &model.system;
        let modes = modes::shapes(engine, [stiffness, mass], count, model.mechanism.is_some())?;
        let shape = |mode: &Mode| {
            let (Lattice { points, cells, parents }, w) = model.fields.as_ref()?.surface(&mode.shape);
            let largest =
                w.iter().fold(0.0, |largest: f64, w| if w.abs() > largest.abs() { *w } else { largest });
            Some(Surface {
                points: points.clone(),
                cells: cells.clone(),
                parents: parents.clone(),
                deflection: w.into_iter().map(|w| w / largest).collect(),
                ..Surface::default()
            })
        };
        let bolt = |support: &Support| match support.stand {
            SupportLocation::At([x, y], radius) => Some([x, y, radius.unwrap_or_default()]),
            _ => None,
        };
        Ok(ModeShapes {
            bolts: scene.supports.iter().filter_map(bolt).collect(),
            title: scene.title.clone(),
            dofs: engine.dofs(),
            shapes: modes.iter().filter_map(shape).collect(),
            frequencies: modes.into_iter().map(|mode| mode.frequency).collect(),
        })
    }

    /// Returns whether a folder of modes has a file or folder of a name.
    pub fn is_file(name: &str) -> bool {
        [TABLE, SUMMARY, shapes::FILE, plot::FOLDER, shapes::FOLDER].contains(&name)
    }

    /// Writes frequencies, pictures, and the shapes for ParaView.
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] where a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let rows = self.frequencies.iter().enumerate();
        let rows: String = rows.map(|(i, frequency)| format!("{},{frequency}\n", i + 1)).collect();
        shapes::write(folder, self.frequencies.iter().copied().zip(&self.shapes))?;
        write_atomic(&folder.join(TABLE), format!("mode,frequency\n{rows}").as_bytes())?;
        Figure::write_all(&folder.join(plot::FOLDER), &[("modes", self.figure())])?;
        summary::write_json(&folder.join(SUMMARY), self)
    }

    /// Draws the first shapes, at most a hundred, with their nodal lines, frequencies and bolts.
    pub fn figure(&self) -> Figure {
        let modes = self.frequencies.iter().copied().zip(self.shapes.iter().cloned());
        perspective::modes(modes.take(MOST_DRAWN).collect(), &self.title, &self.bolts)
    }
}

impl fmt::Display for ModeShapes {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{}: {} dofs, consistent mass", self.title, grouped(self.dofs as u64))?;
        let mut table = Table::new(&["mode", "frequency", "period"]);
        for (number, &frequency) in self.frequencies.iter().enumerate() {
            let [frequency, period] = match frequency {
                0.0 => ["0 Hz, rigid motion".into(), "-".into()],
                frequency => [engineering(frequency, "Hz"), engineering(1.0 / frequency, "s")],
            };
            table.row([(number + 1).to_string(), frequency, period]);
        }
        write!(f, "{table}")?;
        match self.frequencies.len() {
            0..=MOST_DRAWN => Ok(()),
            count => writeln!(f, "the picture has the first {MOST_DRAWN} of these {count} modes"),
        }
    }
}
