//! Folder of a finished run, read for pictures and for the report.

use super::checkpoint::{Checkpoint, Identity};
use super::contacts::Contact;
use super::history::Table;
use super::plot::perspective::{self, Bolt, ColorBy, Occasion, Shot};
use super::plot::{Figure, Obstacle, forces, plan, run};
use super::resolved::{obstacles, quantity};
use super::vtu::{self, Surface};
use super::{checkpoint, contacts, extremes, history, if_there, summary};
use crate::error::{Error, Result};
use crate::input;
use crate::scene::Scene;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Files of a run.
pub(crate) struct RunFolder {
    pub folder: PathBuf,
    pub summary: Value,
    pub table: Table,
    /// Contacts of nodes; `None` where the scene has neither obstacles nor balls.
    pub contacts: Option<Vec<Contact>>,
    /// Times (s) and files of the snapshots.
    pub snapshots: Vec<(f64, PathBuf)>,
    /// Heights of the obstacles at each probe, in m.
    opposite: BTreeMap<String, Vec<f64>>,
}

/// Stress of the plan; in pure bending it is the same at both faces.
const LARGEST: &str = "Largest at either face,";
/// Largest number of snapshots that are read for this.
const MOST_STRESSES: usize = 100;

/// Surface with the largest stress at each point, which stress that is, and place (m) and time (s)
/// of the largest of all, where the run tells them.
type LargestStress = (Surface, String, Option<([f64; 2], f64)>);

/// Pictures of a run by name, and remarks on those that it lacks.
type RunPictures = (Vec<(&'static str, Figure)>, Vec<&'static str>);

impl RunFolder {
    /// Reads the files of a folder, except the snapshots themselves.
    pub fn read(folder: &Path) -> Result<RunFolder> {
        let summary = read_summary(folder)?;
        let table = history::read(folder)?.with_quantities(|name| quantity(&summary["scene"], name));
        if table.rows() == 0 {
            return Err(Error::invalid(folder.join(history::FILE), "no rows"));
        }
        Ok(RunFolder {
            folder: folder.to_owned(),
            opposite: serde_json::from_value(summary["opposite"].clone()).unwrap_or_default(),
            contacts: contacts::read(folder)?,
            snapshots: vtu::read_index(folder)?,
            summary,
            table,
        })
    }

    /// Returns the file of the scene, to which the files that the scene names are relative.
    pub fn scene_file(&self) -> String {
        let file = self.state().map(|state| state.scene_file);
        file.unwrap_or_else(|| "scene.toml".into()).to_string_lossy().into_owned()
    }

    /// Reads the scene; `None` where a file that it names is not as it was.
    pub fn scene(&self) -> Option<Scene> {
        let Checkpoint { scene, scene_file, identity, .. } = self.state()?;
        let scene = Scene::from_str(&scene, &scene_file.to_string_lossy(), &[]).ok()?;
        Identity::of(&scene).is_ok_and(|same| same == identity).then_some(scene)
    }

    /// Reads the newest state of the run that its folder has.
    fn state(&self) -> Option<Checkpoint> {
        Checkpoint::newest(&self.folder, true).ok().map(|(state, _)| state)
    }

    /// Returns the obstacles of constant height.
    pub fn obstacles(&self) -> Vec<Obstacle> {
        obstacles(&self.summary["scene"], &self.opposite)
    }

    /// Returns the supports at points.
    pub fn bolts(&self) -> Vec<Bolt> {
        let supports = self.summary["scene"]["support"].as_array().into_iter().flatten();
        let bolt = |support: &Value| {
            let [x, y] = serde_json::from_value(support["at"].clone()).ok()?;
            Some([x, y, support["radius"].as_f64().unwrap_or_default()])
        };
        supports.filter_map(bolt).collect()
    }

    /// Reads at most `most` snapshots: those nearest to the start, the first impact, the largest
    /// deflection, the lowest and the highest position of a probe, and the end; others between them
    /// where these are fewer. A snapshot near several of them tells all.
    pub fn surfaces(&self, most: usize) -> Result<Vec<Shot>> {
        let nearest = |time: f64| {
            let distance = |(other, _): &(f64, PathBuf)| (other - time).abs();
            let order = |a: &&(f64, PathBuf), b: &&(f64, PathBuf)| distance(a).total_cmp(&distance(b));
            self.snapshots.iter().min_by(order)
        };
        let told = self.moments().into_iter().filter_map(|event| Some((nearest(event.1)?, Some(event))));
        let others = perspective::spread(&self.snapshots, most).into_iter().map(|snapshot| (snapshot, None));
        let mut chosen: Vec<(&(f64, PathBuf), Option<Occasion>)> = Vec::new();
        for (snapshot, event) in told.chain(others) {
            let has_room = chosen.len() < most;
            match (chosen.iter_mut().find(|(other, _)| *other == snapshot), event) {
                (Some((_, Some((names, time)))), Some((name, other))) => {
                    *names += &format!(", {name}");
                    // The snapshot shows all of its events if it shows the farthest one.
                    let distance = |time: f64| (time - snapshot.0).abs();
                    *time = if distance(other) > distance(*time) { other } else { *time };
                }
                (None, event) if has_room => chosen.push((snapshot, event)),
                _ => {}
            }
        }
        chosen.sort_by(|a, b| a.0.0.total_cmp(&b.0.0));
        chosen.into_iter().map(|((time, path), event)| Ok((*time, event, vtu::read(path)?))).collect()
    }

    /// Returns the events that a reader wants to see with their times (s), the most important ones
    /// first.
    fn moments(&self) -> Vec<Occasion> {
        let RunFolder { summary, table, .. } = self;
        let times = table.column("time").unwrap_or_default();
        let told = |event: &str| summary[event]["time"].as_f64();
        let mut moments = vec![
            ("start".to_owned(), times.first().copied()),
            ("end".to_owned(), times.last().copied()),
            ("first impact".to_owned(), told("first_impact")),
            ("largest deflection".to_owned(), told("largest_deflection")),
        ];
        if let Some((_, probe, values)) = table.deflections().next() {
            let order = |a: &(&f64, &f64), b: &(&f64, &f64)| a.1.total_cmp(b.1);
            let ends = [times.iter().zip(values).min_by(order), times.iter().zip(values).max_by(order)];
            let names = ["lowest", "highest"].map(|end| format!("{probe} {end}"));
            moments.extend(names.into_iter().zip(ends.map(|end| end.map(|(time, _)| *time))));
        }
        moments.into_iter().filter_map(|(event, time)| Some((event, time?))).collect()
    }

    /// Draws all pictures; spectra have natural frequencies (Hz), where these are known.
    pub fn pictures(&self, natural: &[f64]) -> Result<RunPictures> {
        let RunFolder { summary, table, contacts, opposite, .. } = self;
        let scene = &summary["scene"];
        let title = scene["title"].as_str().unwrap_or_default();
        let (snapshots, bolts) = (self.surfaces(perspective::MOST)?, self.bolts());
        let outline = match snapshots.first() {
            Some((.., surface)) => surface.outline(),
            None => rectangle(scene),
        };

        let mut figures = vec![
            ("history", run::history(table, title, &self.obstacles())),
            ("energy", run::energy(table, title)),
        ];
        let touched = contacts.as_deref().unwrap_or_default();
        let forces = forces::forces(table, touched, summary, title, opposite);
        figures.extend(forces.map(|figure| ("forces", figure)));
        let mut absent = Vec::new();
        match contacts {
            Some(contacts) if !contacts.is_empty() => {
                figures.push(("contacts", run::contacts(contacts, table, title, &outline)));
            }
            Some(_) => absent.push("no contacts: nothing touched"),
            None => absent.push("no contacts: the scene has neither obstacles nor balls"),
        }
        if table.deflections().next().is_some() {
            figures.push(("phase", run::phase(table, title, opposite, &self.obstacles())));
        } else {
            absent.push("no phase portraits: the scene has no probes of deflections (output.probes)");
        }
        if table.axes().is_empty() {
            absent.push("no spectra: the scene has no probes (output.probes)");
        } else {
            figures.push(("spectrum", run::spectrum(table, title, natural)));
        }
        if snapshots.is_empty() {
            absent.push("no snapshots: the run wrote no fields (output.fields_every)");
        } else {
            if snapshots.iter().all(|(.., surface)| !surface.von_mises.is_empty()) {
                let stresses = perspective::colored(snapshots.clone(), title, ColorBy::VonMises, &bolts);
                figures.push(("stresses", stresses));
            }
            figures.push(("snapshots", perspective::colored(snapshots, title, ColorBy::Deflection, &bolts)));
        }
        if let Some((surface, what, told)) = self.largest_stress()? {
            figures.push(("extremes", plan::stress(surface, title, &what, told)));
        } else {
            absent.push("no plan of stresses: the run watched none (output.extremes or output.stresses)");
        }
        Ok((figures, absent))
    }

    /// Reads the largest stress at each point of the plate, over all steps or, where the run did
    /// not watch these, over its snapshots; tells which, and place (m) and time (s) of the largest.
    fn largest_stress(&self) -> Result<Option<LargestStress>> {
        if let Some(path) = extremes::find(&self.folder) {
            let told = &self.summary["extremes"]["von_mises"];
            let place = serde_json::from_value(told["at"].clone()).ok();
            let what = format!("{LARGEST} of all steps");
            return Ok(Some((vtu::read(&path)?, what, place.zip(told["time"].as_f64()))));
        }
        let mut sum: Option<Surface> = None;
        let snapshots = perspective::spread(&self.snapshots, MOST_STRESSES);
        for (_, path) in &snapshots {
            let surface = vtu::read(path)?;
            if surface.von_mises.is_empty() {
                return Ok(None);
            }
            match &mut sum {
                Some(sum) => {
                    let stresses = sum.von_mises.iter_mut().zip(surface.von_mises);
                    stresses.for_each(|(sum, stress)| *sum = sum.max(stress));
                }
                None => sum = Some(surface),
            }
        }
        Ok(sum.map(|surface| (surface, format!("{LARGEST} of {} snapshots", snapshots.len()), None)))
    }
}

/// Reads `summary.json`, and tells what a folder without one is.
fn read_summary(folder: &Path) -> Result<Value> {
    input::refuse_file(folder)?;
    let path = folder.join(summary::FILE);
    let Some(text) = if_there(&path, fs::read_to_string(&path))? else {
        let shown = folder.display();
        let (absent, what) = if !folder.is_dir() {
            (folder, format!("there is no such folder{}", input::nearest(folder, Path::is_dir)))
        } else if checkpoint::any(folder)? {
            (&*path, format!("not there, the run is unfinished: `rebond resume {shown}` goes on with it"))
        } else if folder.join(history::FILE).exists() {
            (&*path, "not there, the run is unfinished: `rebond run` makes it anew".to_owned())
        } else {
            (&*path, "not there, the folder holds no run".to_owned())
        };
        return Err(Error::io(absent)(io::Error::new(io::ErrorKind::NotFound, what)));
    };
    let summary: Value =
        serde_json::from_str(&text).map_err(|why| Error::invalid(&path, format!("damaged: {why}")))?;
    if summary["program"] != env!("CARGO_PKG_NAME") || !summary["scene"].is_object() {
        return Err(Error::invalid(&path, "not the summary of a run of rebond"));
    }
    Ok(summary)
}

/// Returns the sides of a resolved scene's rectangle, in m; none where a file gives the mesh.
fn rectangle(scene: &Value) -> Vec<[[f64; 2]; 2]> {
    let side = |name| scene["plate"][name].as_f64().filter(|side| *side > 0.0);
    let (Some(length), Some(width)) = (side("length"), side("width")) else { return Vec::new() };
    let corners = [[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]];
    (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect()
}
