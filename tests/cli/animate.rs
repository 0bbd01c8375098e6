//! Animated pictures of runs.

use crate::common::command::{self, assert_fails, rebond, succeeds};
use crate::common::models::literal;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;

const SCENE: &str = concat!(
    "title = \"a short fall\"\n",
    literal!(PAPER_FALL),
    r#"
mesh = { element = "fvs", cells = [4, 2] }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.05 }
output = { every = 10, fields_every = 50, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);

/// Animated picture, read by the decoder of the crate `png`.
struct Animation {
    size: [u32; 2],
    plays: u32,
    /// Time (s) for which each frame is shown.
    delays: Vec<f64>,
    /// Whole pictures, three bytes per pixel, with each frame put into the one before.
    pictures: Vec<Vec<u8>>,
}

fn read(path: &Path) -> Animation {
    let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let size = [reader.info().width, reader.info().height];
    let control = *reader.info().animation_control().expect("an animation");
    let mut picture = vec![0; 3 * (size[0] * size[1]) as usize];
    let (mut delays, mut pictures) = (Vec::new(), Vec::new());
    for _ in 0..control.num_frames {
        let mut part = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut part).unwrap();
        let frame = *reader.info().frame_control().expect("a frame");
        delays.push(f64::from(frame.delay_num) / f64::from(frame.delay_den));
        for y in 0..frame.height as usize {
            let width = 3 * frame.width as usize;
            let at = 3 * ((frame.y_offset as usize + y) * size[0] as usize + frame.x_offset as usize);
            picture[at..at + width].copy_from_slice(&part[y * width..][..width]);
        }
        pictures.push(picture.clone());
    }
    Animation { size, plays: control.num_plays, delays, pictures }
}

/// Reads an animated GIF by the decoder of the crate `gif`.
fn read_gif(path: &Path) -> Animation {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut reader = options.read_info(BufReader::new(File::open(path).unwrap())).unwrap();
    let size = [reader.width(), reader.height()].map(u32::from);
    let mut picture = vec![0; 3 * (size[0] * size[1]) as usize];
    let (mut delays, mut pictures) = (Vec::new(), Vec::new());
    while let Some(frame) = reader.read_next_frame().unwrap() {
        delays.push(f64::from(frame.delay) / 100.0);
        for (index, rgba) in frame.buffer.chunks_exact(4).enumerate() {
            let [x, y] = [index % usize::from(frame.width), index / usize::from(frame.width)];
            let [x, y] = [x + usize::from(frame.left), y + usize::from(frame.top)];
            picture[3 * (y * size[0] as usize + x)..][..3].copy_from_slice(&rgba[..3]);
        }
        pictures.push(picture.clone());
    }
    let plays = if reader.repeat() == gif::Repeat::Infinite { 0 } else { 1 };
    Animation { size, plays, delays, pictures }
}

/// Frames are snapshots: they are white around, the first one is that of the start, and each shows
/// the plate at another place.
#[test]
fn a_run_becomes_an_animated_picture() {
    let folder = command::folder("animate", SCENE);
    succeeds(&rebond(&folder, &["run", "fall.toml", "--quiet"]));
    let said = succeeds(&rebond(&folder, &["animate", "runs/fall"]));
    assert!(said.starts_with("runs/fall/plots/animation.png (11 frames, "), "{said}");
    let whole = read(&folder.join("runs/fall/plots/animation.png"));
    assert_eq!((whole.size[0], whole.plays, whole.pictures.len()), (720, 0, 11));
    assert!((whole.delays.iter().sum::<f64>() - 6.0).abs() < 0.02);
    let white = |picture: &[u8]| picture.chunks_exact(3).filter(|rgb| *rgb == [255; 3]).count() as f64;
    for (before, picture) in whole.pictures.iter().zip(&whole.pictures[1..]) {
        assert_ne!(before, picture);
        let share = white(picture) / (picture.len() / 3) as f64;
        assert!((0.3..0.95).contains(&share), "{share}");
    }

    // A GIF shows the same, in fewer colours, and as long: white stays white.
    let said = succeeds(&rebond(&folder, &["animate", "runs/fall", "--format", "gif"]));
    assert!(said.starts_with("runs/fall/plots/animation.gif (11 frames, "), "{said}");
    let quantised = read_gif(&folder.join("runs/fall/plots/animation.gif"));
    assert_eq!((quantised.size, quantised.plays, quantised.pictures.len()), (whole.size, 0, 11));
    assert!((quantised.delays.iter().sum::<f64>() - 6.0).abs() < 1e-9);
    for (picture, exact) in quantised.pictures.iter().zip(&whole.pictures) {
        let differences = picture.iter().zip(exact).map(|(&a, &b)| f64::from(a.abs_diff(b)));
        let mean = differences.sum::<f64>() / exact.len() as f64;
        assert!(mean < 0.5, "{mean} of 255");
        assert!((white(picture) - white(exact)).abs() < 1e-3 * white(exact));
    }

    // Left-out snapshots leave the first and the last, at the same scale.
    let few = ["--frames", "2", "--duration", "1", "--out", "slides/fall.png"];
    let said = succeeds(&rebond(&folder, &[&["animate", "runs/fall"], &few[..]].concat()));
    assert!(said.starts_with("slides/fall.png (2 frames of 11 snapshots, "), "{said}");
    let ends = read(&folder.join("slides/fall.png"));
    assert_eq!(ends.delays, [0.5, 0.5]);
    assert_eq!(ends.pictures[0].len(), whole.pictures[0].len());
    let by_name = |name| rebond(&folder, &["animate", "runs/fall", "--frames", "2", "--out", name]);
    succeeds(&by_name("slides/fall.GIF"));
    assert_eq!(read_gif(&folder.join("slides/fall.GIF")).delays, [3.0, 3.0]);
    succeeds(&by_name("slides/fall.apng"));
    let by_format = ["animate", "runs/fall", "--frames", "2", "--format", "apng", "--out", "slides/same.png"];
    succeeds(&rebond(&folder, &by_format));
    let bytes = |name| fs::read(folder.join(name)).unwrap();
    assert!(bytes("slides/fall.apng") == bytes("slides/same.png"));
    assert_fails(&by_name("x.mp4"), 2, &["--out x.mp4", ".png, .apng or .gif"]);
    assert!(!folder.join("x.mp4").exists());

    // A new run removes the pictures of the old one.
    succeeds(&rebond(&folder, &["run", "fall.toml", "--quiet", "--overwrite"]));
    for name in ["animation.png", "animation.gif"] {
        assert!(!folder.join("runs/fall/plots").join(name).exists());
    }
}

#[test]
fn what_cannot_be_animated_is_said_in_one_line() {
    let folder = command::folder("animate-refused", SCENE);
    let run =
        |out: &str, set: &str| rebond(&folder, &["run", "fall.toml", "--quiet", "--out", out, "--set", set]);
    let animate = |of: &str| rebond(&folder, &["animate", of]);
    assert_fails(&animate("nowhere"), 4, &["nowhere"]);
    fs::create_dir(folder.join("foreign")).unwrap();
    fs::write(folder.join("foreign/summary.json"), "{}").unwrap();
    assert_fails(&animate("foreign"), 4, &["summary.json", "not the summary of a run"]);

    succeeds(&run("plain", "output={ every = 10 }"));
    assert_fails(&animate("plain"), 2, &["0 snapshots", "output.fields_every"]);

    // Each step to 1e-18 fails, so that the run ends before its first step.
    assert!(!run("failed", "solver.tolerance=1e-18").status.success());
    let said = animate("failed");
    assert!(matches!(said.status.code(), Some(2 | 4)), "{said:?}");

    succeeds(&run("damaged", "time.end=0.02"));
    let last = folder.join("damaged").join(
        fs::read_to_string(folder.join("damaged/fields.pvd"))
            .unwrap()
            .split("file=\"")
            .last()
            .unwrap()
            .split('"')
            .next()
            .unwrap(),
    );
    let bytes = fs::read(&last).unwrap();
    fs::write(&last, &bytes[..bytes.len() / 2]).unwrap();
    assert_fails(&animate("damaged"), 4, &[last.file_name().unwrap().to_str().unwrap()]);
    assert!(!folder.join("damaged/plots/animation.png").exists());
    fs::remove_file(folder.join("damaged/summary.json")).unwrap();
    assert_fails(&animate("damaged"), 4, &["unfinished"]);
    for wrong in [["--duration", "0"], ["--duration", "nan"], ["--frames", "1"], ["--width", "9"]] {
        assert_eq!(rebond(&folder, &[&["animate", "plain"], &wrong[..]].concat()).status.code(), Some(2));
    }
}
