//! The page of a run: whole, small, without a network, and with the numbers of the run's files.

use crate::common::command::{assert_fails, folder, rebond, succeeds, text};
use crate::common::models::{CLAMPED, literal};
use base64::Engine as _;
use rebond::output::{history, vtu};
use serde_json::Value;
use std::collections::HashMap;
use std::fs;
use std::io::Read;
use std::path::Path;

const SCENE: &str = concat!(
    "title = \"a <short> fall & \\\"more\\\" </script>\"\n",
    literal!(PAPER_FALL),
    r#"
mesh = { element = "hct", cells = [4, 2] }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.08 }

[output]
every = 2
fields_every = 20
subdivide = 3
stresses = true
probes = [{ name = "corner", at = [1.2, 0.0] }, { name = "speed", at = [1.2, 0.0], quantity = "velocity" }]
"#
);
/// Panel on bolts between stops with and without names, and a ball by the law of Hertz.
const PANEL: &str = r#"
title = "a panel"
plate = { length = 0.6, width = 0.4, thickness = 1.2e-3, youngs_modulus = 7e10, poissons_ratio = 0.33, density = 2700 }
mesh = { element = "fvs", cells = [12, 8] }
support = [
  { at = [0.05, 0.05], kind = "clamped", radius = 0.02 },
  { at = [0.55, 0.05], kind = "clamped", radius = 0.02 },
  { at = [0.3, 0.35], kind = "clamped" },
]
obstacle = [
  { name = "rubber", side = "below", height = -0.5e-3, at = [0.3, 0.2], stiffness = 2e4, damping = 50 },
  { side = "below", height = -0.5e-3, where = "x < 0.1", stiffness = 2e6 },
  { side = "below", height = -0.5e-3, where = "x < 0.1", stiffness = 2e6 },
]
ball = [{ at = [0.5, 0.2], mass = 0.01, height = 1e-5, velocity = -1, law = "hertz", stiffness = 1e8 }]
initial = { velocity = -0.4 }
time = { scheme = "newmark", mass = "singular", step = 2e-5, end = 0.01 }
output = { fields_every = 100, probes = [{ name = "under", at = [0.5, 0.2] }, { name = "height", ball = 0 }] }
"#;
const RUN: [&str; 6] = ["run", "fall.toml", "--quiet", "--overwrite", "--out", "run"];

/// Returns the text between two marks of a page.
fn between<'p>(page: &'p str, begin: &str, end: &str) -> &'p str {
    let rest = page.split_once(begin).unwrap_or_else(|| panic!("no {begin}")).1;
    rest.split_once(end).unwrap().0
}

fn meta(page: &str) -> Value {
    serde_json::from_str(between(page, "id=\"meta\">", "</script>")).unwrap()
}

/// Decodes the arrays of a page as its script does; the frames of a field follow each other.
fn arrays(page: &str) -> HashMap<String, Vec<f64>> {
    let packed = between(page, "id=\"data\">", "</script>");
    let packed = base64::engine::general_purpose::STANDARD.decode(packed).unwrap();
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(packed.as_slice()).read_to_end(&mut bytes).unwrap();
    let (mut at, mut arrays) = (0, HashMap::new());
    for array in meta(page)["arrays"].as_array().unwrap() {
        let count = array["count"].as_u64().unwrap() as usize;
        let kind = array["kind"].as_str().unwrap();
        let size = HashMap::from([("f64", 8), ("f32", 4), ("u32", 4), ("levels", 2)])[kind];
        let number = |i: usize| (0..size).map(|byte| bytes[at + byte * count + i]).collect::<Vec<u8>>();
        let numbers = (0..count).map(number);
        let values: Vec<f64> = match kind {
            "f64" => numbers.map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect(),
            "f32" => numbers.map(|b| f32::from_le_bytes(b.try_into().unwrap()).into()).collect(),
            "u32" => numbers.map(|b| u32::from_le_bytes(b.try_into().unwrap()).into()).collect(),
            _ => values(numbers.map(|b| u16::from_le_bytes(b.try_into().unwrap())).collect(), array),
        };
        at += size * count;
        arrays.insert(array["name"].as_str().unwrap().to_owned(), values);
    }
    assert_eq!(at, bytes.len());
    arrays
}

/// Returns the values of levels, stored as differences to the neighbour and to the frame before.
fn values(stored: Vec<u16>, array: &Value) -> Vec<f64> {
    let points = stored.len() / array["frames"].as_u64().unwrap() as usize;
    let (low, quantum) = (array["low"].as_f64().unwrap(), array["quantum"].as_f64().unwrap());
    let mut levels: Vec<i64> = Vec::new();
    for (i, &stored) in stored.iter().enumerate() {
        let signed = if stored % 2 == 0 { i64::from(stored / 2) } else { -i64::from(stored / 2) - 1 };
        let level = |back: usize, is_there: bool| if is_there { levels[i - back] } else { 0 };
        let (is_inside, is_later) = (i % points > 0, i >= points);
        let corner = level(points + 1, is_inside && is_later);
        levels.push((signed + level(1, is_inside) + level(points, is_later) - corner).rem_euclid(1 << 16));
    }
    let value = |level: i64| if level == 0 { f64::NAN } else { low + (level - 1) as f64 * quantum };
    levels.into_iter().map(value).collect()
}

/// Returns the number in the snapshot of each point of the page.
fn order(points: &[[f64; 2]], x: &[f64], y: &[f64]) -> Vec<usize> {
    let near = |[a, b]: &[f64; 2], i: usize| (a - x[i]).abs() + (b - y[i]).abs() < 1e-6;
    (0..x.len()).map(|i| points.iter().position(|point| near(point, i)).unwrap()).collect()
}

/// Makes a run and its report, and returns the page.
fn page(folder: &Path) -> String {
    succeeds(&rebond(folder, &RUN));
    succeeds(&rebond(folder, &["report", "run"]));
    fs::read_to_string(folder.join("run/report.html")).unwrap()
}

#[test]
fn a_report_is_one_page_without_a_network() {
    let folder = folder("report-page", SCENE);
    let page = page(&folder);
    assert!(page.len() < 700_000, "{} bytes", page.len());
    for section in
        ["answers", "scene", "numbers", "motion", "series", "contacts", "modes", "pictures", "again"]
    {
        assert!(page.contains(&format!("<h2 id=\"h-{section}\">")), "{section}");
    }
    assert!(page.contains("default-src 'none'"));
    for outside in ["http://", "https://", " src=", "@import", "<iframe", "<object", "import(", "fetch("] {
        assert!(!page.contains(outside), "{outside}");
    }
    let links = page.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap());
    assert!(links.clone().count() > 3);
    let beside: Vec<&str> = links.filter(|link| !link.starts_with('#')).collect();
    assert_eq!(beside, ["data:,", "contacts.csv", "history.csv", "summary.json"], "every table of the run");
    // A title cannot end a script, nor open an element.
    assert_eq!(page.matches("</script>").count(), 3);
    assert!(page.contains("<h1>a &lt;short&gt; fall &amp; &quot;more&quot; &lt;/script&gt;</h1>"));
    assert!(page.contains("<li>contact below</li>") && page.contains("name=\"viewport\""));
    // The frequencies are those of `rebond modes`, and each is beside its shape.
    let told = succeeds(&rebond(&folder, &["modes", "fall.toml", "--count", "6", "--quiet"]));
    assert!(told.is_empty());
    let table = fs::read_to_string(folder.join("modes/fall/modes.csv")).unwrap();
    let modes = between(&page, "<h2 id=\"h-modes\">", "</section>");
    let caption = between(modes, "<figcaption>", "</figcaption>");
    let shown: Vec<f64> = caption
        .split_once(": ")
        .unwrap()
        .1
        .split(',')
        .map(|words| words.trim().split('\u{a0}').next().unwrap().parse().unwrap())
        .collect();
    let exact = table.lines().skip(1).map(|line| line.split_once(',').unwrap().1.parse::<f64>().unwrap());
    assert!(
        shown.len() == 6 && shown.iter().zip(exact).all(|(a, b)| (a / b - 1.0).abs() < 1e-3),
        "{caption}"
    );
    // The scene has the keys that it sets, and folded those that are filled in.
    let (set, every) = between(&page, "<dl class=\"scene\">", "</details>").split_once("Every key").unwrap();
    assert!(set.contains("step 1e-4 s") && !set.contains("restitution") && !set.contains("<dt>Solver"));
    assert!(every.contains("restitution 0") && every.contains("<dt>Solver"));
    // Pictures take the colours of the page, also in dark mode.
    for ink in ["fill=\"#FFFFFF\"", "fill=\"#000000\"", "stroke=\"#000000\""] {
        assert!(modes.contains(ink) && page.contains(&format!(".picture [{ink}]{{")), "{ink}");
    }
    // Pictures have names of their own.
    let mut names: Vec<&str> =
        page.split("<clipPath id=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    let count = names.len();
    names.sort_unstable();
    names.dedup();
    assert!(count > 3 && names.len() == count);
    assert!(page.matches("<svg viewBox=").count() >= 3);
}

#[test]
fn the_numbers_of_a_report_are_those_of_the_run() {
    let folder = folder("report-numbers", SCENE);
    let page = page(&folder);
    let run = folder.join("run");
    let (meta, arrays) = (meta(&page), arrays(&page));

    let index = vtu::read_index(&run).unwrap();
    assert_eq!(arrays["frame_times"], index.iter().map(|(time, _)| *time).collect::<Vec<f64>>());
    let quantum = |name: &str| {
        let mut described = meta["arrays"].as_array().unwrap().iter();
        described.find(|array| array["name"] == name).unwrap()["quantum"].as_f64().unwrap()
    };
    assert!(quantum("deflection") < 1e-5 && quantum("von_mises") > 0.0);
    let (mut ends, mut touching) = (0, 0);
    for (frame, (_, path)) in index.iter().enumerate() {
        let surface = vtu::read(path).unwrap();
        let points = surface.points.len();
        // The page has the points in another order, rounded to seven digits.
        let order = order(&surface.points, &arrays["x"], &arrays["y"]);
        for (name, exact) in [("deflection", &surface.deflection), ("von_mises", &surface.von_mises)] {
            let shown = &arrays[name][frame * points..(frame + 1) * points];
            let far = shown.iter().zip(&order).map(|(a, &p)| (a - exact[p]).abs()).fold(0.0, f64::max);
            assert!(far <= 0.5001 * quantum(name), "{name}, frame {frame}: {far}");
        }
        assert_eq!(arrays["floor"][..points], surface.obstacles[0], "at rest, and constant");
        let end = arrays["touch_ends"][frame] as usize;
        let touched: Vec<f64> =
            (0..points).filter(|&p| surface.reaction[order[p]] != 0.0).map(|p| p as f64).collect();
        assert_eq!(arrays["touch"][ends..end], touched);
        touching += end - ends;
        ends = end;
    }
    assert!(touching > 0);
    // The clamped edge is the only one held.
    let held = &arrays["held"];
    assert!(held.len() == 2 * 2 * 3 && held.iter().all(|&point| arrays["x"][point as usize] == 0.0));
    assert_eq!(arrays["triangles"].len(), 3 * 2 * 4 * 2 * 9);

    let table = history::read(&run).unwrap();
    assert_eq!(arrays["row_times"], table.column("time").unwrap());
    let charts = meta["charts"].as_array().unwrap();
    let titles: Vec<&str> = charts.iter().map(|chart| chart["title"].as_str().unwrap()).collect();
    let energies = ["energy of the plate", "energy since the start"];
    let expected = [&["deflection", "velocity"], &energies[..], &["force on the plate, upward"]].concat();
    assert_eq!(titles, expected);
    let curve =
        |chart: usize, column: usize| &arrays[charts[chart]["columns"][column]["array"].as_str().unwrap()];
    for (shown, name) in [(curve(0, 0), "corner"), (curve(1, 0), "speed"), (curve(2, 0), "kinetic")] {
        let exact = table.column(name).unwrap();
        let far = shown.iter().zip(exact).filter(|(a, b)| (*a - *b).abs() > 1e-7 * b.abs());
        assert_eq!((shown.len(), far.count()), (exact.len(), 0), "{name}");
    }
    assert_eq!(charts[0]["rules"], serde_json::json!([-0.1]));
}

/// The scene on the page is a scene, with the same hash, and so the same run.
#[test]
fn the_scene_of_a_report_runs_again() {
    let folder = folder("report-again", SCENE);
    let page = page(&folder);
    let scene = between(&page, "<pre id=\"scene-text\">", "</pre>");
    let scene = scene.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&");
    fs::write(folder.join("again.toml"), scene).unwrap();
    succeeds(&rebond(&folder, &["run", "again.toml", "--quiet", "--out", "again"]));
    let history = |run: &str| fs::read(folder.join(run).join("history.csv")).unwrap();
    assert!(history("run") == history("again"));
}

#[test]
fn many_rows_and_snapshots_are_thinned_and_peaks_stay() {
    let folder = folder("report-many", SCENE);
    let more = ["--set", "output.every=1", "--set", "output.fields_every=20", "--set", "time.step=5e-6"];
    let small =
        ["--set", "mesh.cells=[2, 1]", "--set", "output.stresses=false", "--set", "output.subdivide=1"];
    succeeds(&rebond(&folder, &[&RUN[..], &more, &small, &["--set", "time.end=0.06"]].concat()));
    let said = succeeds(&rebond(&folder, &["report", "run"]));
    assert!(said.contains("300 of 601 snapshots"), "{said}");
    let page = fs::read_to_string(folder.join("run/report.html")).unwrap();
    assert!(page.contains("300 of the 601 snapshots of the run") && page.contains("of the 12 001 rows"));
    assert!(page.contains("The run gave no warnings.") && !page.contains("#warnings"));
    let (meta, arrays) = (meta(&page), arrays(&page));
    assert_eq!(arrays["frame_times"].len(), 300);
    let table = history::read(&folder.join("run")).unwrap();
    assert!(arrays["row_times"].len() < 9000);
    let force = meta["charts"][4]["columns"][0]["array"].as_str().unwrap();
    let peak = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let exact = peak(table.column("contact_force").unwrap());
    assert!(exact > 0.0 && (peak(&arrays[force]) / exact - 1.0).abs() < 1e-6);
}

#[test]
fn a_run_without_snapshots_and_obstacles_says_how_to_get_them() {
    let scene = SCENE.replace("fields_every = 20\nsubdivide = 3\n", "").replace("stresses = true\n", "");
    let scene = scene.replace("obstacle = [{ side = \"below\", height = -0.1 }]", "");
    let scene = scene.replace("\"newmark\"", "\"conserving\"");
    let bolts = [
        "[0.6, 0.0], kind = \"clamped\"",
        "[0.6, 0.4], kind = \"guided\"",
        "[1.2, 0.2], kind = \"clamped\", radius = 1e-3",
    ];
    let bolts = [1, 2, 3].map(|i| format!(", {{ name = \"bolt {i}\", at = {} }}", bolts[i - 1]));
    let clamped = CLAMPED.trim_end().trim_end_matches(']');
    let scene = scene.replace(clamped, &(clamped.to_owned() + &bolts.concat()));
    let folder = folder("report-bare", &scene);
    let page = page(&folder);
    // Many supports share one card, a line each; many warnings a box.
    let answers = between(&page, "<h2 id=\"h-answers\">", "</section>");
    let (cards, warnings) = answers.split_once("</dl>").unwrap();
    let supports = between(cards, "<dt>supports</dt>", "</div>");
    assert_eq!(supports.matches("<dd><details><summary>bolt").count(), 3, "{cards}");
    assert!(supports.contains("</summary>impulse"), "{supports}");
    let count = warnings.matches("<p class=\"warning\">").count();
    assert!(count > 2 && warnings.contains(&format!("<b>{count} warnings</b>")), "{warnings}");
    // A line above the answers leads to the box.
    let link = format!("<a href=\"#warnings\">{count} warnings</a>");
    assert!(between(&page, "<header>", "</header>").contains(&link) && warnings.contains("id=\"warnings\""));
    let command = between(&page, "<code>rebond run ", "</code>");
    assert!(command.contains("fall.toml") && !page.contains("<canvas"), "{command}");
    assert!(command.ends_with(" --set output.fields_every=2 --out run --overwrite"), "{command}");
    assert!(page.contains(">Contacts of nodes</h2>\n<p>The scene has neither obstacles nor balls."));
    // Energy that is kept has no chart of its rounding.
    let charts = &meta(&page)["charts"];
    assert!(
        charts[2]["title"] == "energy of the plate" && charts[3]["title"] == "force on the plate, upward"
    );
}

/// Stops are told with their names and stiffness, and supports with a radius are bolts.
#[test]
fn a_report_begins_with_what_the_plate_is() {
    let page = page(&folder("report-panel", PANEL));
    let told = [
        "clamped at 2 bolts and at a point; a compliant stop of 20\u{a0}kN/m, 50\u{a0}N\u{a0}s/m, at a point 500\u{a0}\u{b5}m below (rubber);",
        "; 2 times a compliant stop of 2\u{a0}MN/m³, 500\u{a0}\u{b5}m below; a ball of 10\u{a0}g; starts with a velocity of ",
    ];
    let sentence = between(&page, "<p class=\"plate\">", "</p>");
    assert!(told.iter().all(|words| sentence.contains(words)), "{sentence}");
    // The moving view has washers to size, shows the rubber through the plate, and says so.
    assert_eq!(meta(&page)["bolts"][1], serde_json::json!([0.55, 0.05, 0.02]));
    assert!(page.contains("white ones lie behind the plate"));
    // Pictures too long for the page as SVG are there as PNG of moderate size.
    let images = page.split("src=\"data:image/png;base64,").skip(1);
    let lengths: Vec<usize> = images.map(|rest| rest.split('"').next().unwrap().len()).collect();
    assert!(!lengths.is_empty() && lengths.iter().all(|length| *length <= 400_000), "{lengths:?}");
    assert!(page.contains("(plots/snapshots.svg)") && !page.contains("Left out for their size"));
    // Every stop has a picture of its forces, also where contacts are not told apart.
    for words in ["force of rubber", "force of obstacle_2", "force of obstacle_3", "of ball_1"] {
        assert!(page.contains(words), "{words}");
    }
}

/// A mesh from a file is told with its size, and loads by the kind of their law.
#[test]
fn a_report_tells_the_size_of_a_mesh_from_a_file() {
    let folder = folder(
        "report-mesh",
        "plate = { thickness = 0.01, youngs_modulus = 7e10, poissons_ratio = 0.33, density = 2700 }\n\
         mesh.file = \"plate.msh\"\n\
         initial.velocity = \"0.1*x\"\nload.pressure = { table = \"pulse.csv\", interpolation = \"linear\" }\n\
         time = { scheme = \"newmark\", mass = \"singular\", step = 1e-4, end = 1e-3 }\noutput.fields_every = 5\n",
    );
    for (data, name) in [("gmsh/square_41_text.msh", "plate.msh"), ("pulse.csv", "pulse.csv")] {
        let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(data);
        fs::copy(data, folder.join(name)).unwrap();
    }
    let page = page(&folder);
    let sentence = between(&page, "<p class=\"plate\">", "</p>");
    let told = ", 10\u{a0}mm thick, 1\u{a0}m × 1\u{a0}m; free edges; \
                under a pressure by a table; starts with a velocity by a formula.";
    assert!(sentence.ends_with(told), "{sentence}");
}

/// The force of a ball is drawn over its gap, where probes have its height and what it faces.
#[test]
fn forces_of_balls_are_drawn_over_the_gap() {
    let without_pads: Vec<&str> = PANEL.lines().filter(|line| !line.contains("x < 0.1")).collect();
    let page = page(&folder("report-ball", &without_pads.join("\n")));
    assert!(page.contains("force of ball_1") && page.contains("gap ("));
}

#[test]
fn other_folders_are_refused_in_one_line() {
    let folder = folder("report-bad", SCENE);
    let report = |run: &str| rebond(&folder, &["report", run]);
    assert_fails(&report("nowhere"), 4, &["nowhere: there is no such folder"]);
    assert_fails(&report("../report-bed"), 4, &["no such folder (did you mean report-bad?)"]);
    fs::create_dir(folder.join("empty")).unwrap();
    assert_fails(&report("empty"), 4, &["empty/summary.json", "holds no run"]);
    succeeds(&rebond(&folder, &RUN));
    let summary = folder.join("run/summary.json");
    let whole = fs::read(&summary).unwrap();
    for (broken, words) in [
        (&whole[..whole.len() / 2], "damaged: EOF"),
        (b"{}", "not the summary of a run"),
        (b"{\"program\":\"other\",\"scene\":{}}", "not the summary of a run"),
    ] {
        fs::write(&summary, broken).unwrap();
        assert_fails(&report("run"), 4, &["summary.json", words]);
    }
    fs::remove_file(&summary).unwrap();
    assert_fails(&report("run"), 4, &["summary.json", "the run is unfinished"]);
    fs::write(&summary, &whole).unwrap();

    let snapshot = folder.join("run/fields/step-000000020.vtu");
    let bytes = fs::read(&snapshot).unwrap();
    fs::write(&snapshot, &bytes[..bytes.len() / 2]).unwrap();
    assert_fails(&report("run"), 4, &["step-000000020.vtu", "cut short"]);
    fs::write(&snapshot, bytes).unwrap();
    let history = fs::read_to_string(folder.join("run/history.csv")).unwrap();
    fs::write(folder.join("run/history.csv"), history.lines().next().unwrap().to_owned() + "\n").unwrap();
    assert_fails(&report("run"), 4, &["history.csv", "no rows"]);
    assert!(!folder.join("run/report.html").exists());
}

/// Curves of both runs are there at the times of both; answers and scenes differ as their files do.
#[test]
fn two_runs_stand_side_by_side() {
    let folder = folder("report-two", SCENE);
    let run = |out: &str, more: &[&str]| {
        succeeds(&rebond(&folder, &[&["run", "fall.toml", "--quiet", "--out", out], more].concat()));
        let summary = fs::read_to_string(folder.join(out).join("summary.json")).unwrap();
        (history::read(&folder.join(out)).unwrap(), serde_json::from_str::<Value>(&summary).unwrap())
    };
    let (a, of_a) = run("thin", &[]);
    let more = ["--set", "plate.thickness=0.012", "--set", "time.end=0.04", "--set", "output.every=4"];
    let (b, of_b) = run("thick", &more);
    let said = succeeds(&rebond(&folder, &["report", "thin", "thick"]));
    assert!(said.starts_with("thin-thick.html ("), "{said}");
    let page = fs::read_to_string(folder.join("thin-thick.html")).unwrap();
    assert!(page.contains("10\u{a0}mm thick") && page.contains("12\u{a0}mm thick"));

    let rows = |table: &str| -> Vec<Vec<String>> {
        let body = between(between(&page, table, "</table>"), "<tbody>\n", "</tbody>");
        let cell = |cell: &str| cell.split_once('>').unwrap().1.split('<').next().unwrap().to_owned();
        let cells = |row: &str| row.replace("<code>", "").split("<t").skip(2).map(cell).collect();
        body.lines().map(cells).collect()
    };
    let scenes = rows("class=\"pair words\"");
    let keys: Vec<&str> = scenes.iter().map(|row| row[0].as_str()).collect();
    assert_eq!(keys, ["output.every", "plate.thickness", "time.end"]);
    assert_eq!(scenes[1][1..], ["0.01 m", "0.012 m"]);

    let largest = |summary: &Value| 1e3 * summary["largest_deflection"]["value"].as_f64().unwrap();
    let answers = rows("class=\"pair\"");
    let row = answers.iter().find(|row| row[0] == "largest deflection").unwrap();
    let number = |cell: &String| -> f64 {
        cell.replace('\u{2212}', "-").split(['\u{a0}', ' ']).next().unwrap().parse().unwrap()
    };
    let [a_mm, b_mm] = [largest(&of_a), largest(&of_b)];
    let exact = [a_mm, b_mm, b_mm - a_mm, 100.0 * (b_mm / a_mm - 1.0)];
    for ((cell, exact), digits) in row[1..].iter().zip(exact).zip([1e-3, 1e-3, 1e-3, 0.05]) {
        assert!((number(cell) / exact - 1.0).abs() < digits, "{row:?}: {exact}");
    }

    let (meta, arrays) = (meta(&page), arrays(&page));
    let times = &arrays["row_times"];
    let charts = meta["charts"].as_array().unwrap();
    let curve = |label: &str| {
        let mut columns = charts.iter().flat_map(|chart| chart["columns"].as_array().unwrap());
        let column = columns.find(|column| column["label"] == label).unwrap();
        &arrays[column["array"].as_str().unwrap()]
    };
    for (run, table) in [("A", &a), ("B", &b)] {
        for name in ["corner", "kinetic"] {
            let (shown, exact) = (curve(&format!("{name}, {run}")), table.column(name).unwrap());
            for (time, exact) in table.column("time").unwrap().iter().zip(exact) {
                let place = times.iter().position(|other| other == time).unwrap();
                assert!((shown[place] - exact).abs() <= 1e-7 * exact.abs(), "{name}, {run}, {time}");
            }
        }
    }
    let beyond = times.iter().zip(curve("corner, B")).filter(|(time, _)| **time > 0.0401);
    assert!(beyond.clone().count() > 100 && beyond.into_iter().all(|(_, value)| value.is_nan()));
    assert_fails(&rebond(&folder, &["report", "thin", "nowhere"]), 4, &["nowhere: there is no such folder"]);
}

/// A new run removes the page of the run before, and does not take it for a foreign file.
#[test]
fn a_run_removes_the_report_of_an_earlier_one() {
    let folder = folder("report-stale", SCENE);
    page(&folder);
    let other = ["--set", "time.end=0.01"];
    let refused = rebond(&folder, &[&RUN[..3], &["--out", "run"], &other].concat());
    assert!(text(&refused.stderr).contains("another scene"));
    succeeds(&rebond(&folder, &[&RUN[..], &other].concat()));
    assert!(!folder.join("run/report.html").exists());
}
