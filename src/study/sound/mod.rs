//! Sound of a finished run: the velocity of a probe, or the sound pressure at a point.

mod baffle;
mod kernel;

use crate::error::{Error, Result, suggestion};
use crate::output::checkpoint::Checkpoint;
use crate::output::plot::run::uniform;
use crate::output::run_folder::RunFolder;
use crate::output::text::{engineering, grouped, significant};
use crate::output::{history, wav};
use crate::scene::ProbeQuantity;
use crate::study::frequencies::on_native_engine;
use kernel::Kernel;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Smallest number of rows that make a sound.
const FEWEST_ROWS: usize = 8;

/// Longest sound, in s.
const LONGEST: f64 = 600.0;

/// Pressure at the level of 0 dB, in Pa.
const THRESHOLD: f64 = 20e-6;

/// Source of a sound.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// Velocity of the probe of that name.
    Probe(String),
    /// Sound pressure at a point (m), with the plate in an infinite rigid baffle.
    Point([f64; 3]),
}

/// Sound of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sound {
    /// Title of the scene.
    pub title: String,
    /// Physical quantity, in words.
    pub quantity: String,
    /// Unit of the quantity: m/s or Pa.
    pub unit: &'static str,
    /// Largest magnitude, which is full scale in the file, in the unit of the quantity.
    pub full_scale: f64,
    /// Root of the mean square, in the same unit.
    pub rms: f64,
    /// Level of the mean square of a pressure, in dB re 20 uPa; `None` for a velocity or silence.
    pub level: Option<f64>,
    /// Duration of the sound, in s.
    pub duration: f64,
    /// Factor by which it is slower than the motion.
    pub slow: f64,
    /// Rows per second of the motion from which it is made.
    pub rows_per_second: f64,
    /// Quantity at each sample.
    #[serde(skip)]
    pub samples: Vec<f64>,
}

impl Sound {
    /// Makes the sound of a finished run, slower than the motion by a factor. For a pressure the
    /// run is repeated.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for an unknown or unfit probe or point and for a sound of more than
    /// ten minutes, [`Error::Io`] for a folder without a run, and the errors of the repeated run.
    pub fn new(folder: &Path, source: &Source, slow: f64) -> Result<Sound> {
        let run = RunFolder::read(folder)?;
        let interval = 1.0 / (f64::from(wav::RATE) * slow);
        let end = run.table.column("time").and_then(|times| times.last()).copied().unwrap_or_default();
        if end * slow > LONGEST {
            return Err(Error::Usage(format!(
                "--slow {slow}: the sound would last {}; expected at most {LONGEST} s",
                engineering(end * slow, "s")
            )));
        }
        let (quantity, unit, (samples, rows_per_second)) = match source {
            Source::Probe(name) => {
                let (quantity, heard) = velocity(&run, name, interval)?;
                (quantity, "m/s", heard)
            }
            Source::Point(point) => {
                let (last, _) = Checkpoint::newest(folder, true)
                    .map_err(|why| Error::Checkpoint(format!("--at repeats the run: {why}")))?;
                let mut scene = on_native_engine(&last.read_scene(folder)?);
                scene.output.probes.clear();
                scene.output.fields = None;
                scene.output.extremes = false;
                let [x, y, z] = point.map(significant);
                let quantity =
                    format!("sound pressure at ({x}, {y}, {z}) m, the plate in an infinite rigid baffle");
                (quantity, "Pa", baffle::pressure(&scene, *point, interval)?)
            }
        };
        let full_scale = samples.iter().fold(0.0, |most: f64, sample| most.max(sample.abs()));
        let square = samples.iter().map(|sample| sample * sample).sum::<f64>() / samples.len() as f64;
        let rms = square.sqrt();
        Ok(Sound {
            title: run.summary["scene"]["title"].as_str().unwrap_or_default().to_owned(),
            quantity,
            unit,
            full_scale,
            rms,
            level: (unit == "Pa" && rms > 0.0).then(|| 20.0 * (rms / THRESHOLD).log10()),
            duration: samples.len() as f64 / f64::from(wav::RATE),
            slow,
            rows_per_second,
            samples,
        })
    }

    /// Writes the WAV file.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        wav::write(path, &self.samples, self.full_scale)
    }
}

impl fmt::Display for Sound {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Sound { title, quantity, unit, full_scale, rms, slow, duration, rows_per_second: rows, .. } =
            self;
        writeln!(f, "{title}: {quantity}")?;
        let (peak, rms) = (engineering(*full_scale, unit), engineering(*rms, unit));
        let level = self.level.map_or(String::new(), |level| format!(", {level:.1} dB re 20 uPa"));
        match *full_scale {
            0.0 => writeln!(f, "silence")?,
            _ => writeln!(f, "peak {peak}, which is full scale; rms {rms}{level}")?,
        }
        let pace = match *slow {
            1.0 => String::new(),
            slow => format!(", {} times slower than the motion", significant(slow)),
        };
        writeln!(f, "{} of sound at {} Hz{pace}", engineering(*duration, "s"), grouped(wav::RATE.into()))?;
        if *rows < f64::from(wav::RATE) * slow {
            let [rows, most] = [*rows, 0.5 * rows].map(|value| engineering(value, "Hz"));
            writeln!(f, "the run has rows at {rows}: nothing above {most} can be heard")?;
        }
        Ok(())
    }
}

/// Returns the quantity in words, the velocity (m/s) of a probe at multiples of an interval (s)
/// from the first row to the last, and the number of rows per second.
fn velocity(run: &RunFolder, name: &str, interval: f64) -> Result<(String, (Vec<f64>, f64))> {
    let shown = run.folder.display();
    let heard = |quantity: ProbeQuantity| match quantity {
        ProbeQuantity::Velocity => Some((0, "")),
        ProbeQuantity::Deflection => Some((1, ", differentiated from its deflection")),
        _ => None,
    };
    let probes: Vec<(&str, ProbeQuantity, &[f64])> = run.table.probes_with_quantities().collect();
    let names = |is_chosen: &dyn Fn(ProbeQuantity) -> bool| -> Vec<&str> {
        probes.iter().filter(|(_, quantity, _)| is_chosen(*quantity)).map(|(name, ..)| *name).collect()
    };
    let Some(&(_, quantity, values)) = probes.iter().find(|(other, ..)| *other == name) else {
        let names = names(&|_| true);
        let expected = match names.is_empty() {
            true => "the run has no probes (output.probes)".to_owned(),
            false => format!("the run has {}", names.join(", ")),
        };
        let suggestion = suggestion(name, &names);
        return Err(Error::Usage(format!("--probe {name}: no probe of {shown}{suggestion}; {expected}")));
    };
    let Some((order, how)) = heard(quantity) else {
        let fit = names(&|quantity| heard(quantity).is_some());
        let fit = if fit.is_empty() { String::new() } else { format!(": {}", fit.join(", ")) };
        return Err(Error::Usage(format!(
            "--probe {name}: records {}; expected the probe of a deflection or of a velocity{fit}",
            quantity.name()
        )));
    };

    let times = run.table.column("time").unwrap_or_default();
    let count = uniform(times);
    let file = run.folder.join(history::FILE);
    if count < FEWEST_ROWS {
        let wrong =
            format!("{count} evenly spaced rows make no sound; expected {FEWEST_ROWS} (output.every)");
        return Err(Error::invalid(file, wrong));
    }
    // Only the last row may come early.
    if count + 1 < times.len() {
        let wrong = format!("the rows are unevenly spaced after t = {} s", significant(times[count - 1]));
        return Err(Error::invalid(file, wrong));
    }
    if let Some(row) = values.iter().position(|value| !value.is_finite()) {
        let time = significant(times[row]);
        return Err(Error::invalid(file, format!("{name} is {} at t = {time} s", values[row])));
    }
    let dt = (times[count - 1] - times[0]) / (count - 1) as f64;
    let samples = resampled(&values[..count], dt, order, interval);
    Ok((format!("velocity of \"{name}\"{how}"), (samples, 1.0 / dt)))
}

/// Returns a signal with one value per `dt` (s), or its derivative, at multiples of an interval
/// (s), without what is faster than half their rate. Velocities are mirrored at the ends.
fn resampled(values: &[f64], dt: f64, order: i32, interval: f64) -> Vec<f64> {
    let kernel = Kernel::new(0.5 / dt.max(interval), order);
    let last = values.len() as isize - 1;
    let value = |row: isize| {
        let (end, mirrored) = if row < 0 { (0, -row) } else { (last, 2 * last - row) };
        let mirrored = values[mirrored.clamp(0, last) as usize];
        match order {
            _ if (0..=last).contains(&row) => values[row as usize],
            0 => mirrored,
            _ => 2.0 * values[end as usize] - mirrored,
        }
    };
    let reach = (kernel.reach() / dt) as isize + 1;
    let sample = |number: usize| {
        let time = number as f64 * interval;
        let middle = (time / dt) as isize;
        // The derivative of a constant is zero, but for the side lobes of the window.
        let level = if order == 0 { 0.0 } else { value(middle) };
        let near = middle - reach..=middle + reach + 1;
        near.map(|row| (value(row) - level) * dt * kernel.value(time - row as f64 * dt)).sum()
    };
    (0..=(last as f64 * dt / interval) as usize).map(sample).collect()
}
