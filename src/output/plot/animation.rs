//! Animated pictures: figures of one size as the frames of an animated PNG (APNG) or of a GIF.
//!
//! Browsers, slides and LibreOffice show an APNG; programs that know PNG alone show its first
//! frame. A frame has only the rectangle that differs from the frame before.

use super::Figure;
use super::paper::encoder;
use crate::error::{Error, Result};
use crate::output::write_atomic;
use png::{EncodingError, Writer};
use std::io;
use std::path::Path;
use std::time::Duration;

/// Name of the animated picture of a run, without its extension.
pub const NAME: &str = "animation";

/// Speed with which the colours of a GIF are chosen, from 1 for the best to 30.
const QUANTISATION: i32 = 10;

/// Picture: its width and height, and three bytes per pixel.
struct Frame {
    size: [usize; 2],
    rgb: Vec<u8>,
}

/// Rectangle of pixels: left, top, width and height.
type Rectangle = [usize; 4];

impl Frame {
    fn new(figure: &Figure, width: u32, path: &Path) -> Result<Frame> {
        let (size, rgb) = figure.rgb(width, path)?;
        Ok(Frame { size: size.map(|length| length as usize), rgb })
    }

    fn row(&self, y: usize, from: usize, width: usize) -> &[u8] {
        let start = 3 * (y * self.size[0] + from);
        &self.rgb[start..start + 3 * width]
    }

    /// Returns the smallest rectangle outside which two frames of one size are equal, of at least
    /// one pixel.
    fn change_from(&self, before: &Frame) -> Rectangle {
        let [width, height] = self.size;
        let differs = |y: &usize| self.row(*y, 0, width) != before.row(*y, 0, width);
        let Some(top) = (0..height).find(differs) else { return [0, 0, 1, 1] };
        let bottom = (top..height).rev().find(differs).unwrap_or(top);
        let column = |x: &usize| (top..=bottom).any(|y| self.row(y, *x, 1) != before.row(y, *x, 1));
        let left = (0..width).find(column).unwrap_or(0);
        let right = (left..width).rev().find(column).unwrap_or(left);
        [left, top, right + 1 - left, bottom + 1 - top]
    }

    fn part(&self, [left, top, width, height]: Rectangle) -> Vec<u8> {
        (top..top + height).flat_map(|y| self.row(y, left, width)).copied().collect()
    }
}

/// Formats of animated pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Animated PNG, in all colours
    #[value(alias = "apng")]
    Png,
    /// GIF, in 256 colours per frame, for programs that do not know animated PNG
    Gif,
}

impl Format {
    /// Returns the format that the extension of a file names.
    pub fn of(path: &Path) -> Option<Format> {
        <Format as clap::ValueEnum>::from_str(path.extension()?.to_str()?, true).ok()
    }

    /// Returns the extension of files.
    pub fn extension(self) -> &'static str {
        match self {
            Format::Png => "png",
            Format::Gif => "gif",
        }
    }
}

/// Writes figures as the frames of an animated picture of a width in pixels, which is repeated
/// without end. Each frame is shown for `delay`, at most a minute. The file is written whole or not
/// at all.
///
/// # Errors
/// Returns [`Error::Io`] where there is no figure, where figures differ in size, or where the file
/// cannot be written.
pub fn write(path: &Path, format: Format, figures: &[Figure], width: u32, delay: Duration) -> Result<()> {
    let bytes = match format {
        Format::Png => png(path, figures, width, delay)?,
        Format::Gif => gif(path, figures, width, delay)?,
    };
    write_atomic(path, &bytes)
}

/// Returns the bytes of an animated PNG.
fn png(path: &Path, figures: &[Figure], width: u32, delay: Duration) -> Result<Vec<u8>> {
    let failed = |why: EncodingError| Error::io(path)(io::Error::other(why));
    let first = first(path, figures, width)?;
    let mut bytes = Vec::new();
    let mut encoder = encoder(&mut bytes, first.size.map(|length| length as u32));
    encoder.set_animated(figures.len() as u32, 0).map_err(failed)?;
    let millis = u16::try_from(delay.as_millis()).unwrap_or(u16::MAX).min(60_000);
    encoder.set_frame_delay(millis, 1000).map_err(failed)?;
    let mut writer = encoder.write_header().map_err(failed)?;
    changes(path, figures, first, |rgb, change| put(&mut writer, rgb, change).map_err(failed))?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}

/// Returns the bytes of an animated GIF.
fn gif(path: &Path, figures: &[Figure], width: u32, delay: Duration) -> Result<Vec<u8>> {
    let failed = |why: gif::EncodingError| Error::io(path)(io::Error::other(why));
    let first = first(path, figures, width)?;
    let size = first.size.map(u16::try_from);
    let [Ok(width), Ok(height)] = size else { return Err(invalid(path, "the picture is too large")) };
    let mut bytes = Vec::new();
    let mut encoder = gif::Encoder::new(&mut bytes, width, height, &[]).map_err(failed)?;
    encoder.set_repeat(gif::Repeat::Infinite).map_err(failed)?;
    // Delays are whole hundredths of a second, whose rounding must not add up. Browsers show frames
    // of less than two for ten.
    let mut ends = (1..).map(|frame: u32| (100.0 * delay.as_secs_f64().min(60.0) * f64::from(frame)).round());
    let mut start = 0.0;
    changes(path, figures, first, |rgb, change| {
        let [left, top, width, height] = change.map(|length| length as u16);
        let end = ends.next().unwrap_or(start);
        let delay = (end - start).max(2.0) as u16;
        start = end;
        let colors = gif::Frame::from_rgb_speed(width, height, rgb, QUANTISATION);
        encoder.write_frame(&gif::Frame { delay, left, top, ..colors }).map_err(failed)
    })?;
    drop(encoder);
    Ok(bytes)
}

fn invalid(path: &Path, why: &str) -> Error {
    Error::io(path)(io::Error::new(io::ErrorKind::InvalidInput, why.to_owned()))
}

/// Draws the first figure.
fn first(path: &Path, figures: &[Figure], width: u32) -> Result<Frame> {
    let first = figures.first().ok_or_else(|| invalid(path, "no figure to animate"))?;
    Frame::new(first, width, path)
}

/// Calls `put` with the pixels and the place of the first frame, and of the part of each further
/// one that differs from the frame before.
fn changes(
    path: &Path,
    figures: &[Figure],
    first: Frame,
    mut put: impl FnMut(&[u8], Rectangle) -> Result<()>,
) -> Result<()> {
    let [width, height] = first.size;
    put(&first.rgb, [0, 0, width, height])?;
    let mut before = first;
    for figure in &figures[1..] {
        let next = Frame::new(figure, width as u32, path)?;
        if next.size != before.size {
            return Err(invalid(path, "frames of several sizes"));
        }
        let change = next.change_from(&before);
        put(&next.part(change), change)?;
        before = next;
    }
    Ok(())
}

/// Writes a rectangle of a frame.
fn put(
    writer: &mut Writer<&mut Vec<u8>>,
    rgb: &[u8],
    change: Rectangle,
) -> std::result::Result<(), EncodingError> {
    let [left, top, width, height] = change.map(|length| length as u32);
    // Position and size are checked against each other, so that the position goes back first.
    writer.set_frame_position(0, 0)?;
    writer.set_frame_dimension(width, height)?;
    writer.set_frame_position(left, top)?;
    writer.write_image_data(rgb)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames put one into the other, at their places, are the pictures of the figures.
    #[test]
    fn frames_add_up_to_the_figures() {
        let path = std::env::temp_dir().join(format!("rebond-animation-{}.png", std::process::id()));
        let figures = ["a", "plate", "falls"].map(Figure::new);
        write(&path, Format::Png, &figures, 200, Duration::from_millis(40)).unwrap();
        let file = io::BufReader::new(std::fs::File::open(&path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut picture: Vec<u8> = Vec::new();
        for figure in &figures {
            let (size, rgb) = figure.rgb(200, &path).unwrap();
            let mut part = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut part).unwrap();
            let frame = *reader.info().frame_control().unwrap();
            picture.resize(rgb.len(), 0);
            let width = 3 * frame.width as usize;
            for (y, row) in part.chunks_exact(width).take(frame.height as usize).enumerate() {
                let start = (frame.y_offset as usize + y) * size[0] as usize + frame.x_offset as usize;
                picture[3 * start..][..width].copy_from_slice(row);
            }
            assert!(picture == rgb);
        }
        std::fs::remove_file(&path).unwrap();
        assert!(write(&path, Format::Png, &[], 200, Duration::ZERO).is_err() && !path.exists());
    }

    #[test]
    fn a_frame_has_the_rectangle_that_differs() {
        let frame = |dark: &[[usize; 2]]| {
            let mut rgb = vec![255; 3 * 20];
            dark.iter().for_each(|[x, y]| rgb[3 * (5 * y + x) + 1] = 0);
            Frame { size: [5, 4], rgb }
        };
        assert_eq!(frame(&[]).change_from(&frame(&[])), [0, 0, 1, 1]);
        assert_eq!(frame(&[[1, 2]]).change_from(&frame(&[])), [1, 2, 1, 1]);
        let change = frame(&[[3, 1], [1, 3]]).change_from(&frame(&[[2, 2]]));
        assert_eq!(change, [1, 1, 3, 3]);
        let part = frame(&[[3, 1], [1, 3]]).part(change);
        assert_eq!(part.len(), 27);
        assert_eq!((part[3 * 2 + 1], part[3 * 6 + 1], part[3 * 4 + 1]), (0, 0, 255));
    }
}
