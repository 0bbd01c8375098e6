//! Command `rebond plot`.

use super::printing::print;
use crate::error::{Error, Result};
use crate::output::plot::{Obstacle, forces, perspective, run};
use crate::output::vtu::{self, Surface};
use crate::output::{contacts, extremes, history};
use crate::scene::ProbeQuantity;
use crate::sweep::{self, SweepReport};
use clap::Args;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// Draw a run: history, energies, contacts, phase portraits, spectra and snapshots, as SVG and PNG.
#[derive(Debug, Args)]
pub struct Plot {
    /// Folder of a run or of a sweep
    folder: PathBuf,
}

impl Plot {
    pub(super) fn execute(&self) -> Result<()> {
        let folder = &self.folder;
        if folder.join(sweep::JSON).is_file() {
            return draw_sweep(folder);
        }
        let summary = self.summary()?;
        let scene = &summary["scene"];
        let title = scene["title"].as_str().unwrap_or_default();
        let opposite = serde_json::from_value(summary["opposite"].clone()).unwrap_or_default();
        let obstacles = obstacles(scene, &opposite);
        let table = history::read(folder)?.with_quantities(|name| quantity(scene, name));
        let index = vtu::read_index(folder)?;
        let read = |(time, path): &(f64, PathBuf)| Ok((*time, vtu::read(path)?));
        let snapshots: Vec<(f64, Surface)> =
            perspective::chosen(&index).into_iter().map(read).collect::<Result<_>>()?;
        let outline = match snapshots.first() {
            Some((_, surface)) => surface.outline(),
            None => rectangle(scene),
        };

        let mut figures = vec![
            ("history", run::history(&table, title, &obstacles)),
            ("energy", run::energy(&table, title)),
        ];
        figures.extend(forces::over_gap(&table, scene, title, &opposite).map(|figure| ("forces", figure)));
        let mut absent = Vec::new();
        match contacts::read(folder)? {
            Some(contacts) if !contacts.is_empty() => {
                figures.push(("contacts", run::contacts(&contacts, &table, title, outline)));
            }
            Some(_) => absent.push("no contacts: nothing touched"),
            None => absent.push("no contacts: the scene has neither obstacles nor balls"),
        }
        if table.deflections().next().is_some() {
            figures.push(("phase", run::phase(&table, title, &opposite)));
            figures.push(("spectrum", run::spectrum(&table, title)));
        } else {
            absent.push(
                "no phase portraits and spectra: the scene has no probes of deflections (output.probes)",
            );
        }
        if snapshots.is_empty() {
            absent.push("no snapshots: the run wrote no fields (output.fields_every)");
        } else {
            if snapshots.iter().all(|(_, surface)| !surface.von_mises.is_empty()) {
                figures.push(("stresses", perspective::stresses(snapshots.clone(), title)));
            }
            figures.push(("snapshots", perspective::snapshots(snapshots, title)));
        }
        if let Some(path) = extremes::find(folder) {
            figures.push(("extremes", perspective::envelope(vtu::read(&path)?, title)));
        }
        let mut report = String::new();
        for (name, figure) in figures {
            let path = folder.join("plots").join(name);
            figure.write(&path)?;
            report += &format!("{}.svg, .png\n", path.display());
        }
        for what in absent {
            report += &format!("{what}\n");
        }
        print(&report)
    }

    fn summary(&self) -> Result<Value> {
        let path = self.folder.join("summary.json");
        let text = std::fs::read_to_string(&path).map_err(Error::io(&path))?;
        serde_json::from_str(&text)
            .map_err(|why| Error::io(path)(io::Error::new(io::ErrorKind::InvalidData, why)))
    }
}

/// Draws the pictures of a sweep.
fn draw_sweep(folder: &Path) -> Result<()> {
    let names = sweep::draw(&SweepReport::read(folder)?, folder)?;
    let line = |name: &str| format!("{}.svg, .png\n", folder.join("plots").join(name).display());
    print(&names.into_iter().map(line).collect::<String>())
}

/// Returns the quantity of a probe of a resolved scene.
pub(super) fn quantity(scene: &Value, probe: &str) -> ProbeQuantity {
    let probes = scene["output"]["probes"].as_array();
    let found = probes.into_iter().flatten().find(|of| of["name"] == probe);
    let named = found.and_then(|of| of["quantity"].as_str()).and_then(ProbeQuantity::named);
    named.unwrap_or_default()
}

/// Returns the obstacles of a resolved scene that have one constant height, without repetition.
///
/// Obstacles that face a part of the plate count if some probe faces them.
pub(super) fn obstacles(scene: &Value, opposite: &BTreeMap<String, Vec<f64>>) -> Vec<Obstacle> {
    let mut obstacles = Vec::new();
    for obstacle in scene["obstacle"].as_array().into_iter().flatten() {
        let Some(height) = obstacle["height"].as_f64() else { continue };
        let is_part = ["where", "group", "at", "line"].iter().any(|key| !obstacle[key].is_null());
        let obstacle = match (is_part, obstacle["side"] == "below") {
            (true, _) => Obstacle::Part(height),
            (false, true) => Obstacle::Below(height),
            (false, false) => Obstacle::Above(height),
        };
        let is_seen = !is_part || opposite.values().flatten().any(|of| *of == height);
        if is_seen && !obstacles.contains(&obstacle) {
            obstacles.push(obstacle);
        }
    }
    obstacles
}

/// Returns the sides of a resolved scene's rectangle, in m; none where a file gives the mesh.
fn rectangle(scene: &Value) -> Vec<[[f64; 2]; 2]> {
    let side = |name| scene["plate"][name].as_f64().filter(|side| *side > 0.0);
    let (Some(length), Some(width)) = (side("length"), side("width")) else { return Vec::new() };
    let corners = [[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]];
    (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect()
}
