//! Figures: panels in rows and columns, with titles, keys and notes.

use super::axis::Fitted;
use super::panel::{Curve, Frame, Obstacle, Panel, Ramp};
use super::paper::{Anchor, At, Canvas, Color, Type, png, rgb};
use super::strokes::{HATCH, LABEL, MARKER, RULE, Stroke, TICK_LABEL, draw_markers, draw_solid, wrapped};
use crate::error::{Error, Result};
use crate::input::create_parent;
use crate::output::write_atomic;
use std::num::NonZero;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Dots per inch of files in PNG.
const DOTS_PER_INCH: f32 = 400.0;
/// Widths of a journal's column (85 mm) and page (180 mm), in points.
const COLUMN: f64 = 240.94;
const PAGE: f64 = 510.24;

const MARGIN: f64 = 4.0;
const TITLE: Type = Type { bold: true, ..Type::new(7.5) };
const KEY: Type = Type::new(6.5);
const NOTE: Type = Type { color: Color::GREY, ..Type::new(4.5) };
/// Length of a curve's sample in the key, in points.
const SAMPLE: f64 = 20.0;

/// Figure for a journal's column (85 mm wide) or page (180 mm wide).
#[derive(Default)]
pub struct Figure {
    title: String,
    note: String,
    width: f64,
    columns: usize,
    ramp: Option<Ramp>,
    panels: Vec<Panel>,
}

impl Figure {
    /// Creates a figure of one column; the title may be empty.
    pub fn new(title: impl Into<String>) -> Figure {
        Figure { title: title.into(), width: COLUMN, columns: 1, ..Figure::default() }
    }

    /// Makes the figure as wide as a page.
    pub fn page(self) -> Figure {
        Figure { width: PAGE, ..self }
    }

    /// Arranges the panels in columns, row by row.
    pub fn columns(self, columns: usize) -> Figure {
        Figure { columns: columns.max(1), ..self }
    }

    /// Adds a small line at the foot, such as the command that made the figure.
    pub fn note(self, note: impl Into<String>) -> Figure {
        Figure { note: note.into(), ..self }
    }

    /// Explains colours that all panels share, below the title.
    pub fn ramp(self, ramp: Ramp) -> Figure {
        Figure { ramp: Some(ramp), ..self }
    }

    /// Adds a panel.
    pub fn panel(mut self, panel: Panel) -> Figure {
        self.panels.push(panel);
        self
    }

    /// Writes `path` with the extensions `svg` and `png`, each whole or not at all.
    ///
    /// The folder is created if necessary.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where a file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_both(path, &self.svg())
    }

    /// Writes figures with their names into a folder as [`Figure::write`] does, several at once.
    /// Returns the names of the files, one line for each figure.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where a file cannot be written.
    pub fn write_all(folder: &Path, figures: &[(impl AsRef<Path>, Figure)]) -> Result<String> {
        let drawn: Vec<(PathBuf, String)> =
            figures.iter().map(|(name, figure)| (folder.join(name), figure.svg())).collect();
        let next = AtomicUsize::new(0);
        let write = || {
            while let Some((path, svg)) = drawn.get(next.fetch_add(1, Ordering::Relaxed)) {
                write_both(path, svg)?;
            }
            Ok::<_, Error>(())
        };
        let count = thread::available_parallelism().map_or(1, NonZero::get).min(drawn.len());
        thread::scope(|scope| {
            // This thread writes too, so that none need start.
            let start = |_| thread::Builder::new().spawn_scoped(scope, write).ok();
            let threads: Vec<_> = (1..count).map_while(start).collect();
            let result = write();
            let mut others =
                threads.into_iter().map(|thread| thread.join().unwrap_or_else(|why| resume_unwind(why)));
            others.try_for_each(|other| other).and(result)
        })?;
        Ok(drawn.iter().map(|(path, _)| format!("{}.svg, .png\n", path.display())).collect())
    }

    /// Returns width and height and three bytes per pixel, row by row, at a number of pixels per
    /// column of a journal (85 mm).
    pub(super) fn rgb(&self, width: u32, path: &Path) -> Result<([u32; 2], Vec<u8>)> {
        rgb(&self.svg(), width as f32 / (COLUMN * 96.0 / 72.0) as f32, path)
    }

    /// Writes the SVG alone.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where the file cannot be written.
    pub fn write_svg(&self, path: &Path) -> Result<()> {
        write_in_folder(path, self.svg().as_bytes())
    }

    /// Returns the figure as SVG.
    pub fn svg(&self) -> String {
        let mut paper = Canvas::new();
        let inside = self.width - 2.0 * MARGIN;
        let mut y = MARGIN;
        for line in wrapped(&self.title, TITLE, inside) {
            paper.text(&line, [0.5 * self.width, y + 0.5 * TITLE.line()], TITLE, Anchor::Middle);
            y += TITLE.line();
        }

        if let Some(ramp) = &self.ramp {
            let key = Key::Ramp(ramp);
            let start = 0.5 * (self.width - key.width() + 8.0);
            key.draw(&mut paper, [start.max(MARGIN), y + 0.5 * KEY.line()], &[]);
            y += KEY.line() + 2.0;
        }

        let pitch = inside / self.columns as f64;
        let fitted: Vec<Option<[Fitted; 2]>> =
            self.panels.iter().map(|panel| panel.fit(0.8 * pitch)).collect();
        // Frames in one column are aligned.
        let sides = |column: usize| {
            let of_column = self.panels.iter().zip(&fitted).skip(column).step_by(self.columns);
            of_column.fold([0.0, 0.0_f64], |[left, right]: [f64; 2], (panel, axes)| {
                let Some([x, y]) = axes else { return [left, right] };
                let label = panel.y_label(y).len() as f64 * LABEL.line();
                let ticks = y.ticks.iter().map(|(_, text)| TICK_LABEL.width(text)).fold(0.0, f64::max);
                let last = x.ticks.last().map_or(0.0, |(_, text)| 0.5 * TICK_LABEL.width(text));
                [left.max(label + 3.0 + ticks + 2.5), right.max(last)]
            })
        };
        for row in 0..self.panels.len().div_ceil(self.columns) {
            let numbers =
                (row * self.columns..(row + 1) * self.columns).take_while(|&i| i < self.panels.len());
            let frames: Vec<(usize, f64, f64)> = numbers
                .map(|i| {
                    let column = i % self.columns;
                    let [before, after] = sides(column);
                    let left = MARGIN + column as f64 * pitch;
                    let gap = if column + 1 < self.columns { 4.0 } else { 0.0 };
                    (i, left + before, left + pitch - after.max(1.0) - gap)
                })
                .collect();
            let heads: Vec<Head> =
                frames.iter().map(|&(i, left, right)| Head::new(&self.panels[i], right - left)).collect();
            y += heads.iter().map(Head::height).fold(0.0, f64::max) + 2.0;
            let tallest = frames.iter().map(|&(i, ..)| self.panels[i].height).fold(0.0, f64::max);
            for (&(i, left, right), head) in frames.iter().zip(&heads) {
                let panel = &self.panels[i];
                let frame = Frame { left, top: y, right, bottom: y + panel.height };
                let frame = panel.shaped(frame, fitted[i].as_ref());
                let strokes = fitted[i].as_ref().map_or(Vec::new(), |axes| panel.strokes(frame, axes));
                head.draw(&mut paper, frame, &strokes);
                match (&fitted[i], &panel.drawing) {
                    (Some(axes), _) => {
                        let start = MARGIN + (i % self.columns) as f64 * pitch;
                        panel.draw(&mut paper, frame, axes, &strokes, start);
                    }
                    (None, Some(draw)) => draw(&mut paper, frame),
                    (None, None) => {}
                }
            }
            let has_labels =
                frames.iter().any(|&(i, ..)| self.panels[i].axes.is_some() && self.panels[i].has_x_labels);
            y += tallest + if has_labels { 3.0 + TICK_LABEL.line() + LABEL.line() } else { 2.0 };
        }
        for line in wrapped(&self.note, NOTE, inside) {
            paper.text(&line, [MARGIN, y + 0.5 * NOTE.line()], NOTE, Anchor::Start);
            y += NOTE.line();
        }
        paper.finish([self.width, y + MARGIN])
    }
}

/// Texts above a panel, where they never cover data.
struct Head<'p> {
    heading: Vec<String>,
    rows: Vec<Vec<Key<'p>>>,
}

impl<'p> Head<'p> {
    fn new(panel: &'p Panel, width: f64) -> Head<'p> {
        let mut rows: Vec<Vec<Key>> = Vec::new();
        let mut used = f64::INFINITY;
        for key in Key::all(panel) {
            // The gap after the last entry may extend beyond the width.
            if used + key.width() - 8.0 > width {
                rows.push(Vec::new());
                used = 0.0;
            }
            used += key.width();
            rows.last_mut().expect("a row was begun").push(key);
        }
        Head { heading: wrapped(&panel.heading, LABEL, width), rows }
    }

    fn height(&self) -> f64 {
        let (heading, keys) = (self.heading.len() as f64 * LABEL.line(), self.rows.len() as f64 * KEY.line());
        heading + keys + 2.0
    }

    fn draw(&self, paper: &mut Canvas, frame: Frame, strokes: &[Stroke]) {
        let mut y = frame.top - self.height();
        for line in &self.heading {
            paper.text(line, [frame.left, y + 0.5 * LABEL.line()], LABEL, Anchor::Start);
            y += LABEL.line();
        }
        for row in &self.rows {
            let mut x = frame.left;
            for key in row {
                key.draw(paper, [x, y + 0.5 * KEY.line()], strokes);
                x += key.width();
            }
            y += KEY.line();
        }
    }
}

/// Entry of a key.
enum Key<'p> {
    /// Curve and its number in the panel.
    Curve(&'p Curve, usize),
    Obstacle(&'p str),
    /// Names of obstacles that face a part of the plate.
    Part(String),
    Ramp(&'p Ramp),
}

impl Key<'_> {
    fn all(panel: &Panel) -> Vec<Key<'_>> {
        let named = panel.curves.iter().zip(0..).filter(|(curve, _)| !curve.name.is_empty());
        let curves = named.map(|(curve, number)| Key::Curve(curve, number));
        let (parts, whole): (Vec<_>, Vec<_>) =
            panel.near_obstacles().into_iter().partition(|obstacle| matches!(obstacle, Obstacle::Part(..)));
        let obstacle =
            (!whole.is_empty()).then_some(Key::Obstacle(panel.band.as_deref().unwrap_or("obstacle")));
        let mut names: Vec<&str> = Vec::new();
        for obstacle in parts {
            if let Obstacle::Part(_, name) = obstacle
                && !names.contains(&name.as_str())
            {
                names.push(name);
            }
        }
        let part = (!names.is_empty()).then(|| Key::Part(names.join(", ")));
        curves.chain(obstacle).chain(part).chain(panel.ramp.as_ref().map(Key::Ramp)).collect()
    }

    fn name(&self) -> &str {
        match self {
            Key::Curve(curve, _) => &curve.name,
            Key::Obstacle(name) => name,
            Key::Part(names) => names,
            Key::Ramp(ramp) => &ramp.label,
        }
    }

    fn sample(&self) -> f64 {
        match self {
            Key::Ramp(ramp) => 2.5 * SAMPLE + 6.0 + ramp.ends.iter().map(|end| KEY.width(end)).sum::<f64>(),
            Key::Curve(curve, _) if !curve.line => 4.0 * MARKER,
            _ => SAMPLE,
        }
    }

    fn width(&self) -> f64 {
        self.sample() + 3.0 + KEY.width(self.name()) + 8.0
    }

    fn draw(&self, paper: &mut Canvas, [x, y]: At, strokes: &[Stroke]) {
        let end = x + self.sample();
        match self {
            Key::Curve(curve, number) => {
                if curve.line {
                    let pen = strokes.get(*number).map_or(curve.pen, |stroke| stroke.pen);
                    paper.polyline(&[[x, y], [end, y]], pen);
                }
                if let Some(marker) = curve.marker {
                    draw_markers(paper, &[[0.5 * (x + end), y]], marker, curve);
                }
            }
            Key::Obstacle(_) => draw_solid(paper, [x, y - 0.5 * HATCH], [end, y + 0.5 * HATCH], HATCH),
            Key::Part(_) => paper.line([x, y], [end, y], RULE),
            Key::Ramp(ramp) => {
                paper.text(&ramp.ends[0], [x, y], KEY, Anchor::Start);
                let start = x + KEY.width(&ramp.ends[0]) + 3.0;
                let parts = 25;
                let width = 2.5 * SAMPLE / f64::from(parts);
                for i in 0..parts {
                    let left = start + width * f64::from(i);
                    let color = (ramp.color)((f64::from(i) + 0.5) / f64::from(parts));
                    // A small overlap avoids visible seams.
                    paper.rectangle([left, y - 2.2], [left + 1.1 * width, y + 2.2], color);
                }
                paper.text(&ramp.ends[1], [end, y], KEY, Anchor::End);
            }
        }
        paper.text(self.name(), [end + 3.0, y], KEY, Anchor::Start);
    }
}

/// Writes a figure, given as SVG, as SVG and PNG.
fn write_both(path: &Path, svg: &str) -> Result<()> {
    let png_path = path.with_extension("png");
    write_in_folder(&path.with_extension("svg"), svg.as_bytes())?;
    write_atomic(&png_path, &png(svg, DOTS_PER_INCH, &png_path)?)
}

fn write_in_folder(path: &Path, bytes: &[u8]) -> Result<()> {
    create_parent(path)?;
    write_atomic(path, bytes)
}
