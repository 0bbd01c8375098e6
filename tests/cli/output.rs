//! Files that a run leaves: they are exact and complete, and drawn for any data.

use rebond::error::Error;
use rebond::output::history::{self, COLUMNS, History, Row, Table};
use rebond::output::plot::{self, Color, Obstacle, Ramp};
use rebond::output::summary::write_json;
use rebond::output::text::{Report, grouped, significant};
use std::fs;
use std::path::{Path, PathBuf};

/// Folder for one test, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("rebond-output-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir(&path).unwrap();
        Folder(path)
    }

    /// Returns a path below a regular file, where nobody can write, not even root.
    fn impossible(&self) -> PathBuf {
        let file = self.0.join("file");
        fs::write(&file, "").unwrap();
        file.join("run")
    }

    fn names(&self) -> Vec<String> {
        fs::read_dir(&self.0)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn names(probes: &[&str]) -> Vec<String> {
    probes.iter().map(|name| name.to_string()).collect()
}

fn row(step: u64, value: f64, probes: &[f64]) -> Row<'_> {
    Row {
        step,
        time: step as f64 * 1e-5,
        energy: value,
        kinetic: value,
        elastic: value,
        work: value,
        contact_nodes: 2,
        contact_force: value,
        vi_iterations: 3,
        kkt: value,
        probes,
        forces: &[],
    }
}

#[test]
fn the_header_is_the_documented_one() {
    let folder = Folder::new("header");
    let run = folder.0.join("runs/deep");
    let mut history = History::create(&run, &names(&["corner", "middle"]), &[]).unwrap();
    let header =
        "step,time,energy,kinetic,elastic,work,contact_nodes,contact_force,vi_iterations,kkt,corner,middle\n";
    assert_eq!(fs::read_to_string(run.join("history.csv")).unwrap(), header, "before any row");
    history.flush().unwrap();
}

#[test]
fn numbers_read_back_bit_for_bit() {
    let folder = Folder::new("bits");
    let mut values =
        vec![0.0, -0.0, 0.1 + 0.2, 1e-3, 9.999e-4, 1e7, f64::MIN_POSITIVE, 5e-324, f64::MAX, f64::MIN];
    values.extend([f64::INFINITY, f64::NEG_INFINITY, std::f64::consts::PI, 0.2076]);
    // These values have every exponent, with all bits of the mantissa in use.
    values.extend((0..2047).map(|exponent: u64| f64::from_bits(exponent << 52 | 0x000A_BCDE_F012_3457)));
    let mut history = History::create(&folder.0, &names(&["tip"]), &[]).unwrap();
    for (step, &value) in values.iter().enumerate() {
        history.push(&row(step as u64, value, &[value])).unwrap();
    }
    history.push(&row(u32::MAX.into(), f64::NAN, &[f64::NAN])).unwrap();
    history.flush().unwrap();

    let table = history::read(&folder.0).unwrap();
    assert_eq!(table.rows(), values.len() + 1);
    for name in ["energy", "kinetic", "elastic", "work", "contact_force", "kkt", "tip"] {
        let (last, read) = table.column(name).unwrap().split_last().unwrap();
        assert!(last.is_nan());
        assert!(read.iter().map(|v| v.to_bits()).eq(values.iter().map(|v| v.to_bits())), "{name}");
    }
    assert_eq!(table.column("step").unwrap().last(), Some(&f64::from(u32::MAX)));
    assert!(table.column("time").unwrap().iter().take(9).enumerate().all(|(i, &t)| t == i as f64 * 1e-5));
    assert_eq!(table.column("absent"), None);
    assert_eq!(table.probes().map(|(name, _)| name).collect::<Vec<_>>(), ["tip"]);
}

#[test]
fn numbers_are_short() {
    let folder = Folder::new("short");
    let mut history = History::create(&folder.0, &[], &[]).unwrap();
    history
        .push(&Row { energy: 813.25, kinetic: 1.5e-9, elastic: 2.5e7, work: -0.001, ..row(7, 0.0, &[]) })
        .unwrap();
    history.flush().unwrap();
    let text = fs::read_to_string(folder.0.join(history::FILE)).unwrap();
    assert_eq!(text.lines().nth(1), Some("7,7.000000000000001e-5,813.25,1.5e-9,2.5e7,-0.001,2,0,3,0"));
}

#[test]
fn a_dropped_history_keeps_its_rows() {
    let folder = Folder::new("dropped");
    let mut history = History::create(&folder.0, &[], &[]).unwrap();
    for step in 0..10 {
        history.push(&row(step, 1.0, &[])).unwrap();
    }
    drop(history);
    assert_eq!(history::read(&folder.0).unwrap().rows(), 10);
}

#[test]
fn rows_reach_the_file_whole_and_within_a_second_or_so() {
    let folder = Folder::new("flushed");
    let mut history = History::create(&folder.0, &[], &[]).unwrap();
    for step in 0..5000 {
        history.push(&row(step, 1.0 / 3.0, &[])).unwrap();
    }
    let full = history::read(&folder.0).unwrap().rows();
    assert!(full > 0, "a full buffer is written");
    std::thread::sleep(std::time::Duration::from_millis(1100));
    history.push(&row(5000, 1.0, &[])).unwrap();
    assert_eq!(history::read(&folder.0).unwrap().rows(), 5001, "an old row is written");
}

#[test]
fn probe_names_that_would_spoil_the_header_are_refused() {
    let folder = Folder::new("names");
    for bad in [&["a,b"][..], &["say \"a\""], &["two\nlines"], &[""], &["time"], &["a", "a"]] {
        let error = History::create(&folder.0, &names(bad), &[]).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().starts_with("probe name"), "{error}");
    }
    assert!(folder.names().is_empty(), "nothing is written");
}

#[test]
fn errors_name_the_path() {
    let folder = Folder::new("errors");
    let run = folder.impossible();
    let shown = run.display().to_string();
    let table = history_of(&folder.0.join("good"), &["tip"], 3, |_| (1.0, vec![0.0]));
    for error in [
        History::create(&run, &[], &[]).unwrap_err(),
        history::read(&run).unwrap_err(),
        write_json(&run.join("summary.json"), &1).unwrap_err(),
        plot::run::history(&table, "", &[]).write_svg(&run.join("history.svg")).unwrap_err(),
    ] {
        assert!(error.to_string().starts_with(&shown), "{error}");
        assert_eq!(error.exit_code(), 4);
    }
}

#[test]
fn malformed_files_are_refused_with_the_line() {
    let folder = Folder::new("malformed");
    let header = COLUMNS.join(",");
    let cases = [
        ("".to_owned(), "line 1: expected a header that starts with step,time,"),
        ("time,step\n".to_owned(), "line 1: expected a header that starts with step,time,"),
        (format!("{header}\n1,2\n"), "line 2: expected 10 values, found 2"),
        (
            format!("{header}\n0,0,0,0,0,0,0,0,0,0\n1,2,three,0,0,0,0,0,0,0\n"),
            "line 3: energy is not a number: \"three\"",
        ),
        (format!("{header}\n0,0,0,0,0,0,0,0,0,0"), "line 2: cut short; delete this line to read the others"),
    ];
    let path = folder.0.join(history::FILE);
    for (text, expected) in cases {
        fs::write(&path, text).unwrap();
        let error = history::read(&folder.0).unwrap_err();
        let Error::Io { source, .. } = &error else { panic!("{error}") };
        assert_eq!(source.kind(), std::io::ErrorKind::InvalidData);
        assert!(error.to_string().starts_with(&format!("{}: {expected}", path.display())), "{error}");
    }
    fs::write(&path, b"step\xff\n").unwrap();
    assert!(history::read(&folder.0).unwrap_err().to_string().ends_with("line 1: not text"));
}

#[test]
fn summaries_are_whole_or_not_there() {
    #[derive(serde::Serialize)]
    struct Summary {
        steps: u64,
        energy: f64,
    }
    let folder = Folder::new("summary");
    let path = folder.0.join("summary.json");
    write_json(&path, &Summary { steps: 1, energy: 0.1 }).unwrap();
    write_json(&path, &Summary { steps: 2, energy: f64::NAN }).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "{\n  \"steps\": 2,\n  \"energy\": null\n}\n");
    assert_eq!(folder.names(), ["summary.json"], "no temporary file stays");

    // A folder of the same name cannot be replaced: it stays, and the temporary file is removed.
    let taken = folder.0.join("taken");
    fs::create_dir(&taken).unwrap();
    write_json(&taken, &1).unwrap_err();
    let unserialisable = std::collections::BTreeMap::from([(vec![1], 1)]);
    write_json(&path, &unserialisable).unwrap_err();
    let mut left = folder.names();
    left.sort();
    assert_eq!(left, ["summary.json", "taken"]);
}

/// Writes and reads back a history whose energies and probes are functions of time from 0 to 1.
fn history_of(folder: &Path, probes: &[&str], rows: u64, f: impl Fn(f64) -> (f64, Vec<f64>)) -> Table {
    let mut history = History::create(folder, &names(probes), &[]).unwrap();
    for step in 0..rows {
        let time = step as f64 / rows as f64;
        let (energy, probes) = f(time);
        history.push(&Row { time, ..row(step, energy, &probes) }).unwrap();
    }
    history.flush().unwrap();
    history::read(folder).unwrap()
}

/// Draws a history, checks that the XML is well-formed and within the canvas, and returns it.
fn drawn(folder: &Folder, table: &Table, title: &str, obstacles: &[Obstacle]) -> String {
    let path = folder.0.join("plots/history.svg");
    plot::run::history(table, title, obstacles).write_svg(&path).unwrap();
    let svg = fs::read_to_string(path).unwrap();
    let mut open = Vec::new();
    for tag in svg.split('<').skip(1) {
        let (tag, text) = tag.split_once('>').expect("every tag ends");
        assert!(tag.matches('"').count() % 2 == 0 && !text.contains('>'), "{tag}");
        assert!(!text.chars().any(|c| c.is_control() && c != '\n'), "{text:?}");
        match tag.strip_prefix('/') {
            Some(name) => assert_eq!(open.pop(), Some(name)),
            None if tag.ends_with('/') => {}
            None => open.push(tag.split(' ').next().unwrap()),
        }
    }
    assert!(open.is_empty() && svg.starts_with("<svg "), "all tags are closed");
    for word in ["NaN", "inf", "2147483647"] {
        assert!(!svg.contains(word), "{word}");
    }
    svg
}

/// Returns all points of the curves of a colour.
fn points(svg: &str, color: &str) -> Vec<(f64, f64)> {
    let lines = svg.lines().filter(|line| line.starts_with("<polyline") && line.contains(color));
    let points =
        lines.flat_map(|line| line.split("points=\"").nth(1).unwrap().split('"').next().unwrap().split(' '));
    let points = points.filter_map(|pair| pair.split_once(','));
    points.map(|(x, y)| (x.parse().unwrap(), y.parse().unwrap())).collect()
}

const FIRST_PROBE: &str = "#0072B2";

#[test]
fn pictures_survive_any_data() {
    let folder = Folder::new("pictures");
    let walls =
        [Obstacle::Below(-0.1), Obstacle::Above(0.3), Obstacle::Below(f64::NAN), Obstacle::Below(f64::MIN)];
    type Case = (&'static str, u64, fn(f64) -> (f64, f64));
    let cases: [Case; 14] =
        [
            ("empty", 0, |_| (0.0, 0.0)),
            ("one row", 1, |_| (1.0, 0.2)),
            ("zero", 50, |_| (0.0, 0.0)),
            ("constant", 50, |_| (3.0, -0.1)),
            ("almost constant", 50, |t| (1.0 + 1e-15 * t, 1.0 + 1e-14 * t)),
            ("NaN", 50, |_| (f64::NAN, f64::NAN)),
            ("NaN here and there", 50, |t| {
                if (10.0 * t).fract() < 0.5 { (1.0, t) } else { (f64::NAN, f64::NAN) }
            }),
            ("infinite", 50, |_| (f64::INFINITY, f64::NEG_INFINITY)),
            ("greatest", 50, |t| if t < 0.5 { (f64::MAX, f64::MAX) } else { (f64::MIN, f64::MIN) }),
            ("great", 50, |t| (1e99 * t, -9e99 * t)),
            ("tiny", 50, |t| (5e-324, 5e-324 * (9.0 * t).round())),
            ("small", 50, |t| (1e-98 * t, 2e-99 * t)),
            ("negative energy", 50, |t| (-t - 1.0, t)),
            ("blown up", 50, |t| ((200.0 * t).exp(), (-200.0 * t).exp())),
        ];
    for (name, rows, f) in cases {
        let table = history_of(&folder.0, &["tip"], rows, |t| (f(t).0, vec![f(t).1]));
        let svg = drawn(&folder, &table, "", &walls);
        assert!(svg.len() < 300_000, "{name}: {} bytes", svg.len());
        drawn(&folder, &table, "", &[]);
    }
    let no_probes = history_of(&folder.0, &[], 5, |t| (t, vec![]));
    let svg = drawn(&folder, &no_probes, "", &walls);
    assert!(!svg.contains("no data") && !svg.contains("deflection"));
}

#[test]
fn texts_are_escaped_and_long_titles_wrapped() {
    let folder = Folder::new("texts");
    let table = history_of(&folder.0, &["a<b & \u{201c}c\u{201d}"], 5, |t| (1.0, vec![t]));
    let title = format!("e > 0 & e < 1\u{1}\t{}", "a title that goes on ".repeat(20));
    let svg = drawn(&folder, &table, &title, &[]);
    assert!(svg.contains("e &gt; 0 &amp; e &lt; 1") && svg.contains("a&lt;b &amp;"));
    let texts = svg.split(['<', '>']).filter(|text| text.contains("goes on"));
    let longest = texts.map(|text| text.chars().count()).max();
    assert!((10..75).contains(&longest.unwrap()), "{longest:?}");
}

#[test]
fn a_long_history_makes_a_small_picture_that_keeps_its_extremes() {
    let folder = Folder::new("long");
    let rows = 200_000;
    let spike = |t: f64| (t * rows as f64).round() as u64 == 123_457;
    let tip = |t: f64| if spike(t) { -3.0 } else { (4321.0 * t).sin() };
    for probes in [1, 12] {
        let names: Vec<String> = (0..probes).map(|i| format!("probe {i}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let table = history_of(&folder.0, &names, rows, |t| (2.0 + (999.0 * t).sin(), vec![tip(t); probes]));
        let svg = drawn(&folder, &table, "long", &[Obstacle::Below(-3.0)]);
        assert!(svg.len() < 300_000, "{probes} probes: {} bytes", svg.len());

        // However dense the curve, its dashes leave no holes: kinetic energy is the dashed curve of
        // its panel.
        let kinetic = svg.lines().filter(|line| line.starts_with("<polyline") && line.contains("#E69F00"));
        assert!(kinetic.map(|line| line.split("points=").nth(1).unwrap().len()).max() > Some(1000));

        // The spike touches the obstacle, whose edge is the first line drawn in a panel.
        let panel = svg.split("<g clip-path").nth(1).unwrap();
        let edge = panel.lines().find(|line| line.starts_with("<line")).unwrap();
        let edge: f64 = edge.split("y1=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
        let deflections = points(&svg, FIRST_PROBE);
        let lowest = deflections.iter().filter(|&&(_, y)| y <= edge).map(|&(_, y)| y).fold(0.0, f64::max);
        assert_eq!(lowest, edge);
    }
}

#[test]
fn a_gap_in_the_data_is_a_gap_in_the_curve() {
    let folder = Folder::new("gap");
    let table = history_of(&folder.0, &["tip"], 100, |t| {
        (f64::NAN, vec![if (0.4..0.6).contains(&t) { f64::NAN } else { t }])
    });
    let svg = drawn(&folder, &table, "gap", &[]);
    let curves =
        svg.lines().filter(|line| line.starts_with("<polyline") && line.contains(FIRST_PROBE)).count();
    assert_eq!(curves, 1 + 2 + 1, "the keys of the probe and of the elastic energy, and two pieces of curve");
}

#[test]
fn far_obstacles_do_not_squash_the_curves() {
    let folder = Folder::new("far");
    let table = history_of(&folder.0, &["tip"], 100, |t| (1.0, vec![1e-3 * (9.0 * t).sin()]));
    assert!(!drawn(&folder, &table, "far", &[Obstacle::Below(-1.0)]).contains("obstacle"));
    assert!(drawn(&folder, &table, "near", &[Obstacle::Below(-2e-3)]).contains("obstacle"));
}

#[test]
fn axes_are_written_in_fitting_units() {
    let folder = Folder::new("units");
    let cases = [
        (3.0, "deflection (m)"),
        (2e-1, "deflection (mm)"),
        (2e-2, "deflection (mm)"),
        (2e-4, "deflection (µm)"),
        (2e-6, "deflection (µm)"),
        (2e-9, "deflection (nm)"),
        (2e13, "deflection (10¹² m)"),
    ];
    for (size, label) in cases {
        let table = history_of(&folder.0, &["tip"], 100, |t| (0.0, vec![size * (t - 0.5)]));
        let svg = drawn(&folder, &table, "units", &[]);
        assert!(svg.contains(label) && svg.contains("energy (J)") && svg.contains("time (ms)"), "{label}");
    }
    let table = history_of(&folder.0, &[], 100, |t| (8.0 - t, vec![]));
    assert!(drawn(&folder, &table, "units", &[]).contains(">energy / initial<"));
}

#[test]
fn colours_are_explained_in_the_units_of_axes() {
    let cases = [
        ("m", [-4.8e-4, 2e-3], ["\u{2212}0.48", "2"], "quantity (mm)"),
        ("m", [-0.094, 0.21], ["\u{2212}94", "210"], "quantity (mm)"),
        ("m", [-0.94, 2.1], ["\u{2212}0.94", "2.1"], "quantity (m)"),
        ("Pa", [2.2e6, 5.8e8], ["2.2", "580"], "quantity (MPa)"),
        ("N s", [3e-6, 3e-3], ["0.003", "3"], "quantity (mN s)"),
        ("N s", [1.2e-7, 1.2e-4], ["0.12", "120"], "quantity (µN s)"),
        ("N s", [1.2e-7, 1.2e-3], ["120 nN s", "1.2 mN s"], "quantity"),
        ("1/s", [0.0, 4e-3], ["0", "4"], "quantity (10⁻³ 1/s)"),
        ("m", [f64::INFINITY, f64::NEG_INFINITY], ["", ""], "quantity (m)"),
    ];
    for (unit, values, ends, label) in cases {
        let ramp = Ramp::new("quantity", unit, values, |_| Color::BLACK);
        assert_eq!((ramp.label.as_str(), ramp.ends), (label, ends.map(str::to_owned)));
    }
}

#[test]
fn numbers_are_shown_with_sensible_digits() {
    let cases = [
        (0.0, "0"),
        (0.2076, "0.2076"),
        (9.99999, "10"),
        (14600.0, "14600"),
        (123456.7, "123457"),
        (1e6, "1e6"),
        (-0.00123456, "-0.0012346"),
        (1.23456e-12, "1.2346e-12"),
        (f64::NAN, "NaN"),
        (f64::INFINITY, "inf"),
    ];
    for (value, text) in cases {
        assert_eq!(significant(value), text);
    }
    assert_eq!([0, 999, 1000, 1_234_567].map(grouped), ["0", "999", "1 000", "1 234 567"]);
}

#[test]
fn reports_align_on_the_decimal_point() {
    let mut report = Report::new("done");
    report.text("effects", "contact, load").number("tip", -0.25, "m").number("worst KKT residual", 3e-15, "");
    report.number("energy", 812.5, "J").count("steps", 100_000, "");
    let expected = "\
done
  effects             contact, load
  tip                      -0.25 m
  worst KKT residual        3e-15
  energy                  812.5  J
  steps               100 000
";
    assert_eq!(report.to_string(), expected);
}
