//! `rebond plot`.

use super::print;
use crate::error::{Error, Result};
use crate::output::plot::{Obstacle, perspective, run};
use crate::output::{contacts, history, vtu};
use clap::Args;
use serde_json::Value;
use std::io;
use std::path::PathBuf;

/// Draw a run: history, energies, contacts, phase portraits, spectra and snapshots, as SVG and PNG.
#[derive(Debug, Args)]
pub struct Plot {
    /// Run folder
    folder: PathBuf,
}

impl Plot {
    pub(super) fn execute(&self) -> Result<()> {
        let folder = &self.folder;
        let summary = self.summary()?;
        let scene = &summary["scene"];
        let title = scene["title"].as_str().unwrap_or_default();
        let obstacles = obstacles(scene);
        let table = history::read(folder)?;
        let side = |name| scene["plate"][name].as_f64().filter(|side| *side > 0.0).unwrap_or(1.0);
        let sides = [side("length"), side("width")];

        let mut figures = vec![
            ("history", run::history(&table, title, &obstacles)),
            ("energy", run::energy(&table, title)),
        ];
        let mut absent = Vec::new();
        match contacts::read(folder)? {
            Some(contacts) if !contacts.is_empty() => {
                figures.push(("contacts", run::contacts(&contacts, &table, title, sides)));
            }
            Some(_) => absent.push("no contacts: nothing touched"),
            None => absent.push("no contacts: the scene has no obstacle"),
        }
        if table.probes().next().is_some() {
            figures.push(("phase", run::phase(&table, title, &obstacles)));
            figures.push(("spectrum", run::spectrum(&table, title)));
        } else {
            absent.push("no phase portraits and spectra: the scene has no probes (output.probes)");
        }
        let index = vtu::read_index(folder)?;
        if index.is_empty() {
            absent.push("no snapshots: the run wrote no fields (output.fields_every)");
        } else {
            let chosen = perspective::chosen(&index);
            let read = |(time, path): &(f64, PathBuf)| Ok((*time, vtu::read(path)?));
            let snapshots = chosen.into_iter().map(read).collect::<Result<Vec<_>>>()?;
            figures.push(("snapshots", perspective::snapshots(snapshots, title, &obstacles)));
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

/// The obstacles of a resolved scene.
fn obstacles(scene: &Value) -> Vec<Obstacle> {
    let obstacle = |obstacle: &Value| {
        let height = obstacle["height"].as_f64()?;
        Some(if obstacle["side"] == "below" { Obstacle::Below(height) } else { Obstacle::Above(height) })
    };
    scene["obstacle"].as_array().into_iter().flatten().filter_map(obstacle).collect()
}
