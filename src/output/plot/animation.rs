//! Animated pictures: figures of one size as the frames of an animated PNG (APNG).
//!
//! Browsers, slides and LibreOffice show the animation; programs that know PNG alone show its first
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

/// Picture: its width and height, and three bytes per pixel.
struct Frame {
    size: [usize; 2],
    rgb: Vec<u8>,
}

/// Rectangle of pixels: left, top, width and height.
type Rectangle = [usize; 4];

impl Frame {
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

/// Writes figures as the frames of an animated PNG of a width in pixels, which is repeated without
/// end. Each frame is shown for `delay`, at most a minute. The file is written whole or not at all.
///
/// # Errors
/// Returns [`Error::Io`] where there is no figure, where figures differ in size, or where the file
/// cannot be written.
pub fn write(path: &Path, figures: &[Figure], width: u32, delay: Duration) -> Result<()> {
    let failed = |why: EncodingError| Error::io(path)(io::Error::other(why));
    let invalid = |why: &str| Error::io(path)(io::Error::new(io::ErrorKind::InvalidInput, why.to_owned()));
    let frame = |figure: &Figure| {
        let (size, rgb) = figure.rgb(width, path)?;
        Ok::<_, Error>(Frame { size: size.map(|length| length as usize), rgb })
    };
    let Some(first) = figures.first() else { return Err(invalid("no figure to animate")) };
    let mut before = frame(first)?;
    let mut bytes = Vec::new();
    let mut encoder = encoder(&mut bytes, before.size.map(|length| length as u32));
    encoder.set_animated(figures.len() as u32, 0).map_err(failed)?;
    let millis = u16::try_from(delay.as_millis()).unwrap_or(u16::MAX).min(60_000);
    encoder.set_frame_delay(millis, 1000).map_err(failed)?;
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&before.rgb).map_err(failed)?;
    for figure in &figures[1..] {
        let next = frame(figure)?;
        if next.size != before.size {
            return Err(invalid("frames of several sizes"));
        }
        let change = next.change_from(&before);
        put(&mut writer, &next, change).map_err(failed)?;
        before = next;
    }
    writer.finish().map_err(failed)?;
    write_atomic(path, &bytes)
}

/// Writes a rectangle of a frame.
fn put(
    writer: &mut Writer<&mut Vec<u8>>,
    frame: &Frame,
    change: Rectangle,
) -> std::result::Result<(), EncodingError> {
    let [left, top, width, height] = change.map(|length| length as u32);
    // Position and size are checked against each other, so that the position goes back first.
    writer.set_frame_position(0, 0)?;
    writer.set_frame_dimension(width, height)?;
    writer.set_frame_position(left, top)?;
    writer.write_image_data(&frame.part(change))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames put one into the other, at their places, are the pictures of the figures.
    #[test]
    fn frames_add_up_to_the_figures() {
        let path = std::env::temp_dir().join(format!("rebond-animation-{}.png", std::process::id()));
        let figures = ["a", "plate", "falls"].map(Figure::new);
        write(&path, &figures, 200, Duration::from_millis(40)).unwrap();
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
        assert!(write(&path, &[], 200, Duration::ZERO).is_err() && !path.exists());
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
