//! Output of a run for inspection: snapshots and contacts agree with the history, and pictures can
//! be drawn from them.

use crate::common::models::literal;
use rebond::output::{contacts, history, plot, vtu};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SCENE: &str = concat!(
    "title = \"a short fall\"\n",
    literal!(PAPER_FALL),
    r#"
mesh = { element = "hct", cells = [4, 2] }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.08 }
output = { fields_every = 250, subdivide = 3, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);

/// Makes a folder for a test, with a scene.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fields-{test}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("fall.toml"), SCENE).unwrap();
    folder
}

fn rebond(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rebond")).current_dir(folder).args(arguments).output().unwrap()
}

fn succeeds(folder: &Path, arguments: &[&str]) -> String {
    let output = rebond(folder, arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Asserts exit code 4 and a message of one line that contains some words.
fn assert_unreadable(output: &Output, words: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(4), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    for word in words {
        assert!(message.contains(word), "no {word:?} in: {message}");
    }
}

/// Snapshots have the point of a ball that touches the plate, and pictures the ball.
#[test]
fn snapshots_have_balls() {
    let folder = folder("balls");
    let ball = "ball=[{ at = [0.9, 0.2], mass = 0.1, height = 0.25, velocity = -10.0 }]";
    let probe = "output.probes=[{ name = \"corner\", at = [1.2, 0.0] }, { name = \"height\", ball = 0 }]";
    succeeds(&folder, &[&RUN[..], &["--set", ball, "--set", probe, "--set", "time.end=0.02"]].concat());
    let run = folder.join("run");
    let (table, snapshots) = (history::read(&run).unwrap(), vtu::read_index(&run).unwrap());
    let heights = table.column("height").unwrap();
    for (time, path) in &snapshots {
        let row = table.column("time").unwrap().iter().position(|other| other == time).unwrap();
        let balls = vtu::read(path).unwrap().balls;
        assert_eq!((balls.len(), balls[0][..2].to_vec(), balls[0][3]), (1, vec![0.9, 0.2], 1.0));
        assert!((balls[0][2] - heights[row]).abs() <= 1e-15, "{} for {}", balls[0][2], heights[row]);
    }
    let text = String::from_utf8_lossy(&fs::read(&snapshots[0].1).unwrap()).into_owned();
    assert!(text.contains("\"floor\"") && !text.contains("\"ceiling\"") && !text.contains("\"rank\""));
    assert!(snapshots.len() > 1 && heights.iter().any(|height| *height < 0.2));
    succeeds(&folder, &["plot", "run"]);
    succeeds(&folder, &["report", "run"]);
}

const RUN: [&str; 6] = ["run", "fall.toml", "--quiet", "--overwrite", "--out", "run"];

/// A check tells the size of snapshots on the disk, also where the plate starts flat and at rest.
#[test]
fn a_check_tells_the_size_of_snapshots() {
    let folder = folder("size");
    for refine in ["mesh.refine=0", "mesh.refine=3"] {
        let start = ["--set", "initial.static_pressure=0", "--set", "load.pressure=1e3"];
        let more = [&start[..], &["--set", refine, "--set", "output.fields_every=100"]].concat();
        succeeds(&folder, &[&RUN[..], &more].concat());
        let check = succeeds(&folder, &[&["check", "fall.toml", "--json"], &more[..]].concat());
        let check: serde_json::Value = serde_json::from_str(&check).unwrap();
        let files = fs::read_dir(folder.join("run/fields")).unwrap();
        let size: u64 = files.map(|file| file.unwrap().metadata().unwrap().len()).sum();
        let told = check["snapshots"].as_f64().unwrap() / size as f64;
        assert!((told - 1.0).abs() < 0.2, "{refine}: {told} of the size");
    }
}

#[test]
fn snapshots_come_when_asked_and_agree_with_the_history() {
    let folder = folder("agree");
    succeeds(&folder, &[&RUN[..], &["--set", "output.precision=64"]].concat());
    let run = folder.join("run");
    let table = history::read(&run).unwrap();
    let snapshots = vtu::read_index(&run).unwrap();
    let times: Vec<f64> = snapshots.iter().map(|(time, _)| *time).collect();
    let rows = [0, 250, 500, 750, 800];
    assert_eq!(times, rows.map(|row| table.column("time").unwrap()[row]), "every 250 steps and at the end");
    for ((_, path), row) in snapshots.iter().zip(rows) {
        let surface = vtu::read(path).unwrap();
        assert_eq!((surface.points.len(), surface.cells.len()), (13 * 7, 2 * 4 * 2 * 9));
        let corner = surface.points.iter().position(|&at| at == [1.2, 0.0]).unwrap();
        let (snapshot, probe) = (surface.deflection[corner], table.column("corner").unwrap()[row]);
        assert!((snapshot - probe).abs() <= 1e-15 * probe.abs(), "{snapshot} {probe}");
        let exact = std::fs::metadata(path).unwrap().len();
        succeeds(&folder, &[&RUN[..5], &["seven-digits"]].concat());
        let shorter = folder.join("seven-digits").join(path.strip_prefix(&run).unwrap());
        let rounded = vtu::read(&shorter).unwrap();
        assert!(std::fs::metadata(&shorter).unwrap().len() < exact);
        for (w, exact) in rounded.deflection.iter().zip(&surface.deflection) {
            assert!((w - exact).abs() <= 6e-8 * exact.abs(), "{w} for {exact}");
        }
        let clamped = surface.points.iter().zip(&surface.deflection).filter(|([x, _], _)| *x == 0.0);
        assert!(clamped.map(|(_, w)| w).all(|w| *w == 0.0));
        let force: f64 = surface.reaction.iter().sum();
        assert!((force - table.column("contact_force").unwrap()[row]).abs() <= 1e-9 * force.abs());
    }
}

#[test]
fn contacts_carry_the_whole_impulse() {
    let folder = folder("contacts");
    succeeds(&folder, &RUN);
    let run = folder.join("run");
    let contacts = contacts::read(&run).unwrap().unwrap();
    let table = history::read(&run).unwrap();
    let force: f64 = table.column("contact_force").unwrap().iter().sum();
    let impulse: f64 = contacts.iter().map(|contact| contact.impulse).sum();
    assert!(impulse > 10.0 && (impulse / (1e-4 * force) - 1.0).abs() < 1e-12, "{impulse} N s");
    assert!(contacts.iter().all(|contact| contact.impulse > 0.0 && contact.begin <= contact.end));
    // At each instant there are as many contacts as nodes in the history, except for nodes that are
    // released for one step.
    for (time, nodes) in table.column("time").unwrap().iter().zip(table.column("contact_nodes").unwrap()) {
        let open = contacts.iter().filter(|contact| (contact.begin..=contact.end).contains(time)).count();
        assert!(open as f64 >= *nodes, "{open} contacts of {nodes} nodes at {time} s");
    }
    let first = contacts.iter().map(|contact| contact.begin).fold(f64::INFINITY, f64::min);
    let touched = table.column("contact_nodes").unwrap().iter().position(|nodes| *nodes > 0.0).unwrap();
    assert_eq!(first, table.column("time").unwrap()[touched]);
}

#[test]
fn a_run_removes_what_an_earlier_one_left() {
    let folder = folder("again");
    succeeds(&folder, &RUN);
    assert!(folder.join("run/fields/step-000000250.vtu").exists());
    let scene = SCENE.replace("fields_every = 250, subdivide = 3, ", "");
    let scene = scene.replace("obstacle = [{ side = \"below\", height = -0.1 }]", "");
    fs::write(folder.join("fall.toml"), scene).unwrap();
    succeeds(&folder, &RUN);
    assert!(!folder.join("run/fields.pvd").exists() && !folder.join("run/contacts.csv").exists());
    assert_eq!(fs::read_dir(folder.join("run/fields")).unwrap().count(), 0);
    let said = succeeds(&folder, &["plot", "run"]);
    for words in [
        "no snapshots: the run wrote no fields (output.fields_every)",
        "no contacts: the scene has neither obstacles nor balls",
    ] {
        assert!(said.contains(words), "no {words:?} in: {said}");
    }
}

#[test]
fn plot_draws_all_that_a_run_left() {
    let folder = folder("plot");
    succeeds(&folder, &RUN);
    succeeds(&folder, &["plot", "run"]);
    let plots = folder.join("run/plots");
    let pictures = [
        ("history", "deflection (mm)"),
        ("energy", "obstacle force"),
        ("contacts", "contact node"),
        ("phase", "velocity (m/s)"),
        ("spectrum", "frequency (Hz)"),
        ("forces", "impulse of obstacle_1 (N s)"),
        ("snapshots", "t = 25 ms"),
    ];
    for (name, words) in pictures {
        let svg = fs::read_to_string(plots.join(name).with_extension("svg")).unwrap();
        assert!(svg.contains(words) && svg.contains("a short fall"), "{name}");
        assert!(svg.contains("width=\"85mm\""), "{name}");
        let png = fs::read(plots.join(name).with_extension("png")).unwrap();
        let width = u32::from_be_bytes(png[16..20].try_into().unwrap());
        assert_eq!((&png[1..4], width), (&b"PNG"[..], 1339), "{name}");
    }
}

/// The rows of the contact map have the numbers of nodes in contacts.csv.
#[test]
fn the_contact_map_numbers_nodes_as_the_file_does() {
    let contact =
        |node: usize, x: f64| contacts::Contact { node, at: [x, 0.0], begin: 0.1, end: 0.2, impulse: 1.0 };
    let all = [contact(731, 0.1), contact(54, 0.2), contact(209, 0.3)];
    let folder = folder("numbers");
    let columns = rebond::scene::HISTORY_COLUMNS.join(",");
    fs::write(folder.join("history.csv"), format!("{columns}\n0,0,0,0,0,0,0,0,0,0\n1,1,0,0,0,0,0,0,0,0\n"))
        .unwrap();
    let table = history::read(&folder).unwrap();
    let path = folder.join("contacts.svg");
    plot::run::contacts(&all, &table, "", &[]).write_svg(&path).unwrap();
    let svg = fs::read_to_string(path).unwrap();
    for number in ["731", "54", "209"] {
        assert!(svg.contains(&format!(">{number}<")), "{number} in {svg}");
    }
}

/// A snapshot that was chosen for an event tells it, and has a dot at each bolt.
#[test]
fn snapshots_have_their_events_and_bolts() {
    let surface = vtu::Surface {
        points: vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
        cells: vec![vec![0, 1, 2]],
        deflection: vec![0.0, 1e-3, 0.0],
        parents: vec![0],
        ..vtu::Surface::default()
    };
    let shot = |time: f64| (time, Some(("first impact".to_owned(), 1.0)), surface.clone());
    let bolts = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.1]];
    let by = plot::perspective::ColorBy::Deflection;
    let svg = plot::perspective::colored(vec![shot(1.0), shot(2.0)], "", by, &bolts).svg();
    assert!(svg.contains("first impact at t = 1 s") && svg.contains("first impact near t = 2 s"), "{svg}");
    assert_eq!(svg.matches("r=\"1.4\" fill=\"#000000\"").count(), 4, "{svg}");
    assert_eq!(svg.matches("<polygon fill=\"#000000\"").count(), 2, "a washer in each: {svg}");
}

/// A dome ends not far below a plate whose deflections are enlarged; a floor lies where it is.
#[test]
fn a_curved_obstacle_is_drawn_near_the_plate() {
    let grid: Vec<usize> = (0..25).collect();
    let place = |i: &usize| [0.25 * (i % 5) as f64, 0.25 * (i / 5) as f64];
    let corners = grid.iter().filter(|i| *i % 5 < 4 && **i < 20);
    let picture_height = |height: &dyn Fn([f64; 2]) -> f64| {
        let surface = vtu::Surface {
            points: grid.iter().map(place).collect(),
            cells: corners.clone().map(|i| vec![*i, i + 1, i + 6, i + 5]).collect(),
            deflection: grid.iter().map(place).map(|[x, y]| 1e-3 * (x + y - 1.0)).collect(),
            obstacles: [grid.iter().map(place).map(height).collect(), Vec::new()],
            parents: (0..16).collect(),
            ..vtu::Surface::default()
        };
        let by = plot::perspective::ColorBy::Deflection;
        let svg = plot::perspective::colored(vec![(0.0, None, surface)], "", by, &[]).svg();
        svg.split("mm\" height=\"").nth(1).unwrap().split("mm").next().unwrap().parse::<f64>().unwrap()
    };
    let dome = picture_height(&|[x, y]| -1.2e-3 - 7.2e-3 * ((x - 0.5).powi(2) + (y - 0.5).powi(2)));
    let floor = picture_height(&|[x, y]| if x + y > 0.0 { -4.8e-3 } else { f64::NAN });
    assert!(dome < 0.9 * floor, "{dome} mm and {floor} mm");
}

/// A curve whose dashes would hide data is solid in the key, too; others are dashed in both.
#[test]
fn the_key_shows_curves_as_they_are_drawn() {
    let dashed = |turns: f64| {
        let points = (0..2000).map(|i| f64::from(i) / 2000.0).map(|x| [x, (turns * x).sin()]).collect();
        let panel = plot::Panel::new(plot::Axis::linear("x", "m"), plot::Axis::linear("w", "m"))
            .curve(plot::Curve::new("wave", points).style(1));
        plot::Figure::new("").panel(panel).svg().matches("stroke-dasharray").count()
    };
    assert_eq!([dashed(10.0), dashed(1000.0)], [2, 0]);
}

/// With a Hann window an oscillation in the middle of a bin has its amplitude there, half of it in
/// the bins beside, and none elsewhere.
#[test]
fn spectra_tell_amplitudes() {
    let times: Vec<f64> = (0..1000).map(|i| 1e-3 * f64::from(i)).collect();
    let tones = [(10.0, 3e-2), (200.0, 1e-5)];
    let wave = |t: f64| {
        5.0 + tones.iter().map(|(f, a)| a * (std::f64::consts::TAU * f * t + 0.3).sin()).sum::<f64>()
    };
    let spectrum = plot::run::amplitudes(&times, &times.iter().map(|&t| wave(t)).collect::<Vec<f64>>());
    assert_eq!((spectrum.len(), spectrum[499][0].round()), (500, 500.0));
    for [frequency, amplitude] in spectrum {
        let share = |f: f64| match (frequency - f).abs().round() {
            0.0 => 1.0,
            1.0 => 0.5,
            _ => 0.0,
        };
        let expected: f64 = tones.iter().map(|(f, a)| a * share(*f)).sum();
        assert!((amplitude - expected).abs() < 1e-13, "{amplitude} at {frequency} Hz");
    }
}

/// A title twice as long makes more ink, so letters are drawn even on a machine without any font.
#[test]
fn letters_need_no_font_of_the_machine() {
    let folder = folder("letters");
    let size = |title: &str| {
        let path = folder.join("letters");
        plot::Figure::new(title).write(&path).unwrap();
        fs::metadata(path.with_extension("png")).unwrap().len()
    };
    let sizes = ["", "Rebond", "Rebond, élan, 10⁻³ µm × 2"].map(size);
    assert!(sizes[0] + 500 < sizes[1] && sizes[1] + 500 < sizes[2], "{sizes:?}");
}

#[test]
fn files_that_cannot_be_written_or_read_are_named() {
    let folder = folder("unreadable");
    fs::create_dir(folder.join("run")).unwrap();
    fs::write(folder.join("run/fields"), "in the way").unwrap();
    assert_unreadable(&rebond(&folder, &RUN), &["run/fields"]);
    fs::remove_file(folder.join("run/fields")).unwrap();

    succeeds(&folder, &RUN);
    let snapshot = folder.join("run/fields/step-000000000.vtu");
    let bytes = fs::read(&snapshot).unwrap();
    for broken in [&bytes[..bytes.len() / 2], &bytes[..100], b""] {
        fs::write(&snapshot, broken).unwrap();
        assert_unreadable(&rebond(&folder, &["plot", "run"]), &["step-000000000.vtu"]);
    }
    fs::write(&snapshot, &bytes).unwrap();
    fs::write(folder.join("run/contacts.csv"), "node,x,y,begin,end,impulse\n1,2\n").unwrap();
    assert_unreadable(&rebond(&folder, &["plot", "run"]), &["contacts.csv", "line 2"]);
}
