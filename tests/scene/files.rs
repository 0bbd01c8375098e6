//! Meshes from files: nodes that nearly coincide, parts that are not connected, units, and places
//! given by the names of points.

use crate::common::Random;
use crate::common::models::CLAMPED;
use crate::common::scenes::{Drawing, STILL, close, inspect, read, refusal, run, scene};
use rebond::Error;
use rebond::simulation::{self, Model};
use rebond::study;

const MATERIAL: &str =
    "plate = { thickness = 0.003, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }\n";

/// Returns a plate of 0.6 m x 0.4 m in two halves with nodes of their own, the second displaced by
/// a gap and by a shift along the joint.
fn halves(triangles: bool, gap: f64, shift: f64, rows: usize) -> Drawing {
    let mut all = Drawing::grid([3, 4], [0.3, 0.4], triangles, |x, y| [x, y]);
    let right = Drawing::grid([3, rows], [0.3, 0.4], triangles, |x, y| [0.3 + gap + x, y + shift]);
    let first = all.nodes.len();
    all.nodes.extend(right.nodes);
    all.cells.extend(right.cells.iter().map(|cell| cell.iter().map(|node| node + first).collect()));
    let lines = |name: &str, drawing: &Drawing, first: usize| {
        let (_, sides) = drawing.lines.iter().find(|(line, _)| *line == name).unwrap();
        sides.iter().map(|side| side.map(|node| node + first)).collect::<Vec<_>>()
    };
    let right = Drawing::grid([3, rows], [0.3, 0.4], triangles, |x, y| [x, y]);
    all.lines = vec![("left", lines("left", &all, 0)), ("right", lines("right", &right, first))];
    all
}

fn text(file: &str, keys: &str, more: &str) -> String {
    format!("{MATERIAL}mesh = {{ file = \"{file}\"{keys} }}\n{STILL}{more}")
}

#[track_caller]
fn assert_refused(error: &Error, words: &[&str]) {
    let message = error.to_string();
    assert!(matches!(error, Error::Mesh(_) | Error::Scene(_) | Error::Singular(_)), "{message}");
    assert!(
        words.iter().all(|word| message.contains(word)) && !message.contains('\n'),
        "{words:?}: {message}"
    );
}

#[test]
fn nodes_that_nearly_coincide_are_refused_or_merged() {
    for triangles in [false, true] {
        let whole = Drawing::grid([6, 4], [0.6, 0.4], triangles, |x, y| [x, y])
            .write(&format!("whole_{triangles}.msh"));
        let expected = inspect(&text(&whole, "", CLAMPED)).singular.lowest;
        for (number, gap) in [0.0, 1e-12, 1e-9, -1e-9, 3e-6].into_iter().enumerate() {
            let file = halves(triangles, gap, 0.0, 4).write(&format!("halves_{triangles}_{number}.msh"));
            let twins = match gap {
                0.0 => "and 4 more pairs are at the same place",
                _ if gap.abs() < 1e-11 => "are both at",
                _ => "m apart",
            };
            assert_refused(&refusal(&text(&file, "", CLAMPED)), &[twins, "4 more pairs", "mesh.merge = "]);
            let merged = inspect(&text(&file, ", merge = 1e-5", CLAMPED)).singular.lowest;
            for (merged, expected) in merged.iter().zip(&expected) {
                close("frequency", *merged, *expected, 1e-4);
            }
        }
    }
}

#[test]
fn nodes_beside_an_edge_that_is_not_theirs_are_refused() {
    for (number, gap) in [0.0, 1e-9, -1e-9].into_iter().enumerate() {
        let file = halves(false, gap, 0.0, 8).write(&format!("hanging_{number}.msh"));
        // Every second node has a twin; when these are merged, the others hang.
        assert_refused(&refusal(&text(&file, "", CLAMPED)), &["4 more pairs"]);
        assert_refused(
            &refusal(&text(&file, ", merge = 1e-6", CLAMPED)),
            &["hangs", "but is not one of its nodes"],
        );
        let file = halves(false, gap, 0.03, 4).write(&format!("shifted_{number}.msh"));
        assert_refused(&refusal(&text(&file, "", CLAMPED)), &["hangs"]);
    }
    // The halves overlap.
    let file = halves(false, -0.15, 0.02, 4).write("overlapping.msh");
    assert_refused(&refusal(&text(&file, ", parts = 2", CLAMPED)), &["but is not one of its nodes"]);
}

/// Halves along a slit of no width move as each of them alone; an inner slit is a hole without area
/// whose rim has both of its sides; and cells that overlap stay an error.
#[test]
fn slits_are_allowed_where_the_scene_says_so() {
    let clamped = |edge: &str| format!("{{ edge = \"{edge}\", kind = \"clamped\" }}");
    let both = format!("support = [{}, {}]\n", clamped("left"), clamped("right"));
    let alone = Drawing::grid([3, 4], [0.3, 0.4], false, |x, y| [x, y]).write("half.msh");
    let expected = inspect(&text(&alone, "", CLAMPED)).singular.lowest;
    for rows in [4, 8] {
        let file = halves(false, 0.0, 0.0, rows).write(&format!("slit_{rows}.msh"));
        assert_refused(&refusal(&text(&file, "", &both)), &["mesh.slits = true"]);
        let slit = inspect(&text(&file, ", slits = true, parts = 2", &both)).singular.lowest;
        close("the coarser half", slit[if rows == 4 { 0 } else { 1 }], expected[0], 1e-9);
    }
    let file = halves(false, 0.0, 0.0, 4).write("slit_merged.msh");
    let closed = study::check(&scene(&text(&file, ", slits = true, merge = 1e-6", &both))).unwrap().notes;
    assert!(closed[0].contains("mesh.merge joined 5 nodes to others, also across slits"), "{closed:?}");
    let overlapping = halves(false, -0.15, 0.02, 4).write("overlapping_slit.msh");
    assert_refused(&refusal(&text(&overlapping, ", slits = true, parts = 2", &both)), &["but is not one of"]);

    // The middle of the line x = 0.3 is slit from y = 0.1 to y = 0.3, where one node has a twin.
    let mut drawing = Drawing::grid([6, 4], [0.6, 0.4], false, |x, y| [x, y]);
    drawing.lines.clear();
    let whole = drawing.write("unslit.msh");
    let middle = 2 * 7 + 3;
    let twin = drawing.nodes.len();
    drawing.nodes.push(drawing.nodes[middle]);
    for cell in [9, 15] {
        drawing.cells[cell].iter_mut().filter(|node| **node == middle).for_each(|node| *node = twin);
    }
    let file = drawing.write("inner_slit.msh");
    let held = format!("support = [{}]\n", clamped("boundary"));
    let lowest = |file: &str| inspect(&text(file, ", slits = true", &held)).consistent.lowest[0];
    let (slit, unslit) = (lowest(&file), lowest(&whole));
    assert!(slit < 0.99 * unslit && slit > 0.5 * unslit, "{slit} Hz, {unslit} Hz without the slit");
    let slit = scene(&text(&file, ", slits = true, refine = 1", &held));
    let mesh = simulation::mesh(&slit).unwrap();
    assert_eq!((mesh.edges["hole_1"].len(), mesh.edges["boundary"].len()), (8, 40));
    assert!(slit.resolved().contains("slits") && read(&slit.resolved()).unwrap() == slit);
}

#[test]
fn merging_takes_no_cell_apart() {
    let file = halves(false, 1e-9, 0.0, 4).write("merged_too_far.msh");
    assert_refused(
        &refusal(&text(&file, ", merge = 0.11", CLAMPED)),
        &["mesh.merge = 0.11", "two nodes of one cell"],
    );
}

#[test]
fn parts_that_nothing_connects_are_named() {
    let file = halves(false, 0.01, 0.0, 4).write("apart.msh");
    let refused = refusal(&text(&file, "", CLAMPED));
    let words =
        ["in 2 parts that nothing connects", "12 cells from (0, 0) to (0.3, 0.4)", "12 cells from (0.31, 0)"];
    assert_refused(&refused, &[&words[..], &["mesh.merge", "mesh.parts = 2"]].concat());
    // One part is held and the other is not, although the supports would hold a connected plate.
    assert_refused(&refusal(&text(&file, ", parts = 2", CLAMPED)), &["not held by itself: nothing holds it"]);
    let both =
        "support = [{ edge = \"left\", kind = \"clamped\" }, { edge = \"right\", kind = \"clamped\" }]\n";
    let lowest = inspect(&text(&file, ", parts = 2", both)).singular.lowest;
    close("two equal cantilevers", lowest[1], lowest[0], 1e-9);
    let spring = format!("{CLAMPED}foundation = [{{ stiffness = 1e4, where = \"x > 0.5\" }}]\n");
    Model::new(&scene(&text(&file, ", parts = 2", &spring))).map(drop).unwrap();
    assert_refused(&refusal(&text(&file, ", parts = 3", CLAMPED)), &["2 parts"]);
    let whole = Drawing::grid([2, 2], [0.6, 0.4], false, |x, y| [x, y]).write("one_part.msh");
    assert_refused(&refusal(&text(&whole, ", parts = 2", CLAMPED)), &["mesh.parts", "one part"]);
}

#[test]
fn millimetres_are_asked_for_and_scaled() {
    let metres = Drawing::grid([3, 2], [0.6, 0.4], false, |x, y| [x, y]).write("metres.msh");
    let millimetres = Drawing::grid([3, 2], [600.0, 400.0], false, |x, y| [x, y]).write("millimetres.msh");
    let expected = inspect(&text(&metres, "", CLAMPED));
    assert!(
        !expected.warnings.iter().any(|warning| warning.contains("millimetres")),
        "{:?}",
        expected.warnings
    );
    let asked = inspect(&text(&millimetres, "", CLAMPED)).warnings.join("\n");
    assert!(
        asked.contains("spans 600 m and is 0.003 m thick: is the mesh in millimetres? mesh.scale = 1e-3"),
        "{asked}"
    );
    let told = inspect(&text(&millimetres, ", scale = 1", CLAMPED)).warnings.join("\n");
    assert!(!told.contains("millimetres"), "{told}");
    let scaled = inspect(&text(&millimetres, ", scale = 1e-3", CLAMPED));
    for (scaled, expected) in scaled.singular.lowest.iter().zip(&expected.singular.lowest) {
        close("frequency", *scaled, *expected, 1e-9);
    }
    let thick =
        study::check(&scene(&text(&metres, "", CLAMPED).replace("0.003", "3"))).unwrap().warnings.join("\n");
    assert!(thick.contains("is plate.thickness in millimetres?"), "{thick}");
    // The ratio alone is a plate's.
    let both = text(&millimetres, "", CLAMPED).replace("0.003", "3");
    let both = study::check(&scene(&both)).unwrap().warnings.join("\n");
    assert!(both.contains("spans 600 m and is 3 m thick: are lengths in millimetres?"), "{both}");
}

#[test]
fn keys_of_the_file_are_read_printed_and_refused_elsewhere() {
    let file = halves(false, 1e-9, 0.0, 4).write("keys.msh");
    let keyed = scene(&text(&file, ", scale = 0.5, merge = 1e-7", CLAMPED));
    let resolved = keyed.resolved();
    assert!(resolved.contains("scale  = 0.5") && resolved.contains("merge  = 1e-7"), "{resolved}");
    assert_eq!(read(&resolved).unwrap(), keyed);
    for key in ["scale = 2", "merge = 1e-6", "parts = 2"] {
        let grid = format!("mesh = {{ element = \"fvs\", cells = [2, 2], {key} }}\n");
        let plate = MATERIAL.replace("{ ", "{ length = 1, width = 1, ");
        assert_refused(&refusal(&format!("{plate}{grid}{STILL}")), &["has no use without mesh.file"]);
    }
    assert_refused(&refusal(&text(&file, ", scale = 0", "")), &["mesh.scale: 0 is not positive"]);
    assert_refused(&refusal(&text(&file, ", merge = -1", "")), &["mesh.merge: -1 is not positive"]);
}

/// A point at (0.75, 0.5) of a plate is given by its name or by its place.
#[test]
fn points_have_names_wherever_places_are_taken() {
    let tables = |place: &str| {
        format!(
            "support = [{{ edge = \"left\", kind = \"clamped\" }}]\n\
             load = {{ gravity = 9.81, force = [{{ {place}, value = 20 }}] }}\n\
             spring = [{{ {place}, stiffness = 5e3 }}]\nmass = [{{ {place}, mass = 0.2 }}]\n\
             ball = [{{ {place}, mass = 0.1, height = 0.02 }}]\n\
             obstacle = [{{ side = \"below\", height = -1e-4, {place} }}]\n\
             output.probes = [{{ name = \"peak\", {place} }}]\n"
        )
    };
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/gmsh/square_22_text.msh");
    let time = STILL.replace("end = 1e-3", "end = 1e-2");
    let of = |place: &str| text(file, "", &tables(place)).replace(STILL, &time);
    let (named, placed) = (of("point = \"peak\""), of("at = [0.75, 0.5]"));
    assert_eq!(format!("{:?}", run(&named)), format!("{:?}", run(&placed)));
    let resolved = scene(&named).resolved();
    // There are six places, and the name of the probe.
    assert_eq!(resolved.matches("= \"peak\"").count(), 7, "{resolved}");
    assert_eq!(read(&resolved).unwrap(), scene(&named));
    // The place is scaled with the mesh.
    let scaled = scene(&named.replace("msh\"", "msh\", scale = 2"));
    assert_eq!(scaled.attachments.springs[0].at, [1.5, 1.0]);
}

#[test]
fn points_that_are_not_there_are_named() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/gmsh/square_22_text.msh");
    let refused = |more: &str| refusal(&text(file, "", more));
    assert_refused(
        &refused("spring = [{ point = \"pike\", stiffness = 1 }]\n"),
        &["spring.0.point", "\"pike\"", "it has: peak"],
    );
    let both = "mass = [{ point = \"peak\", at = [0, 0], mass = 1 }]\n";
    assert_refused(&refused(both), &["mass.0.at", "contradicts mass.0.point"]);
    let obstacle = "obstacle = [{ side = \"below\", height = -1, point = \"pike\" }]\n";
    assert_refused(&refused(obstacle), &["obstacle.0.point", "it has: peak"]);
    let plate = MATERIAL.replace("{ ", "{ length = 1, width = 1, ");
    let grid =
        "mesh = { element = \"fvs\", cells = [2, 2] }\nspring = [{ point = \"tip\", stiffness = 1 }]\n";
    assert_refused(
        &refusal(&format!("{plate}{grid}{STILL}")),
        &["spring.0.point", "no use without mesh.file"],
    );
}

/// Asserts that with any nodes doubled and displaced the frequency is that of the whole plate, or
/// the mesh is refused.
fn random_doubles(tries: u64) {
    let mut accepted = 0;
    for seed in 0..tries {
        let mut random = Random::new(seed);
        let triangles = random.below(2) == 0;
        let cells = [2 + random.below(3), 2 + random.below(2)];
        let mut drawing = Drawing::grid(cells, [0.6, 0.4], triangles, |x, y| [x, y]);
        let whole = drawing.write(&format!("random_{tries}_whole.msh"));
        let expected = first_frequency(&text(&whole, "", CLAMPED)).unwrap();
        let nodes = drawing.nodes.len();
        for _ in 0..1 + random.below(4) {
            // Some cells get a node of their own, at a distance.
            let node = random.below(nodes);
            let distance = 10f64.powf(-14.0 + 12.0 * random.unit());
            let angle = std::f64::consts::TAU * random.unit();
            let [x, y] = drawing.nodes[node];
            drawing.nodes.push([x + distance * angle.cos(), y + distance * angle.sin()]);
            let twin = drawing.nodes.len() - 1;
            for cell in &mut drawing.cells {
                if random.below(2) == 0 {
                    cell.iter_mut().filter(|of| **of == node).for_each(|of| *of = twin);
                }
            }
        }
        let file = drawing.write(&format!("random_{tries}.msh"));
        let merge = if random.below(2) == 0 { "" } else { ", merge = 1e-4" };
        if let Ok(frequency) = first_frequency(&text(&file, merge, CLAMPED)) {
            // Gaps wider than a ten-thousandth of a cell are intended; they make a plate softer.
            let slit = drawing.nodes[nodes..].iter().any(|[x, y]| {
                drawing.nodes[..nodes]
                    .iter()
                    .any(|[a, b]| (5e-6..).contains(&(x - a).hypot(y - b)) && (x - a).hypot(y - b) < 0.02)
            });
            assert!(
                slit || (frequency / expected - 1.0).abs() < 1e-3,
                "seed {seed}: {frequency} Hz for {expected}"
            );
            accepted += 1;
        }
    }
    assert!(accepted > 0);
}

fn first_frequency(text: &str) -> rebond::Result<f64> {
    let scene = read(text)?;
    let mesh = simulation::mesh(&scene)?;
    let model = Model::new(&scene)?;
    if simulation::mechanism(&scene, &mesh)?.is_some() {
        return Err(Error::Singular("a mechanism".into()));
    }
    Ok(rebond::modes::lowest(&model.system.engine, [&model.system.stiffness, &model.system.mass], 1, false)?
        [0])
}

#[test]
fn random_doubled_nodes() {
    random_doubles(150);
}

#[test]
#[ignore = "ten thousand tries: make test-long"]
fn ten_thousand_random_doubled_nodes() {
    random_doubles(10_000);
}

/// A plate that strikes a floor moves to the bit as one whose mesh is Gmsh's.
#[test]
fn histories_do_not_depend_on_the_format() {
    let drawing = Drawing::grid([6, 4], [0.75, 0.5], true, |x, y| [x, y]);
    let rows = |ending: &str, edge: &str| {
        let file = drawing.write(&format!("history.{ending}"));
        let more = "obstacle = [{ side = \"below\", height = -1e-5 }]\nload.gravity = 9.81\n\
                    output.probes = [{ name = \"tip\", at = [0.75, 0.5] }]\n";
        let support = format!("support = [{{ edge = \"{edge}\", kind = \"clamped\" }}]\n{more}");
        format!("{:?}", run(&text(&file, "", &support)))
    };
    let gmsh = rows("msh", "left");
    assert_eq!(rows("inp", "left"), gmsh);
    assert_eq!(rows("bdf", "spc_1"), gmsh);
}

#[test]
fn files_of_other_kinds_are_named_with_a_remedy() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    for (name, bytes, words) in [
        ("pointer.msh", "version https://git-lfs.github.com/spec/v1\n", ["Git LFS", "git lfs pull"]),
        ("packed.zip", "PK\x03\x04", ["compressed", "`unzip`"]),
        ("bracket.step", "ISO-10303-21;\nHEADER;\n", ["STEP", ".msh"]),
        ("bracket.stl", "solid bracket\n", ["STL", ".msh"]),
        ("bracket.igs", "  S      1\n", ["IGES", "bracket.igs -o "]),
        ("bracket.geo_unrolled.geo", "// by hand\n", ["script of Gmsh", "bracket.geo_unrolled.msh`"]),
        ("bracket.vtu", "<?xml version=\"1.0\"?>\n", ["XML", "meshio convert"]),
        ("bracket.unv", "    -1\n", ["I-DEAS", "gmsh -save"]),
        ("bracket.k", "$# made by hand\n*KEYWORD\n", ["LS-DYNA", ".inp, .bdf or .msh"]),
        ("dyna.msh", "*KEYWORD\n*NODE\n", ["LS-DYNA", ".inp, .bdf or .msh"]),
        ("pointer.inp", "version https://git-lfs.github.com/spec/v1\n", ["Git LFS", "pointer.inp"]),
        ("abaqus.msh", "*Heading\n** a job\n", ["Abaqus", ".inp"]),
        ("nastran.msh", "SOL 101\nCEND\n", ["Nastran", ".bdf"]),
        ("bracket.geo", "Point(1) = {0, 0, 0};\n", ["script of Gmsh", "gmsh -2"]),
    ] {
        let file = folder.join(name);
        std::fs::write(&file, bytes).unwrap();
        assert_refused(&refusal(&text(&file.to_string_lossy(), "", CLAMPED)), &words);
    }
    let lost = refusal(&text(&folder.join("bracker.step").to_string_lossy(), "", CLAMPED)).to_string();
    assert!(lost.contains("no such file") && lost.contains("did you mean bracket.step?"), "{lost}");
    // An ending alone makes no name alike.
    let lost = refusal(&text(&folder.join("qux.step").to_string_lossy(), "", CLAMPED)).to_string();
    assert!(lost.contains("no such file") && !lost.contains("did you mean"), "{lost}");
}

/// A mesh without names has an outline and holes that supports can hold: the annulus of a square.
#[test]
fn outlines_and_holes_need_no_names() {
    let [nx, ny] = [9, 6];
    let mut drawing = Drawing::grid([nx, ny], [0.9, 0.6], false, |x, y| [x, y]);
    let hole = |k: usize, [left, front]: [usize; 2]| (left..left + 2).contains(&(k % nx)) && k / nx == front;
    drawing.cells = (drawing.cells.into_iter().enumerate())
        .filter(|(k, _)| !hole(*k, [6, 3]) && !hole(*k, [2, 2]))
        .map(|(_, cell)| cell)
        .collect();
    let sides = drawing.write("named.msh");
    drawing.lines.clear();
    let unnamed = drawing.write("unnamed.msh");
    let lowest = |file: &str, support: &str| inspect(&text(file, "", support)).consistent.lowest;
    let edges =
        ["left", "right", "bottom", "top"].map(|edge| format!("{{ edge = \"{edge}\", kind = \"clamped\" }}"));
    let all_round = lowest(&sides, &format!("support = [{}]\n", edges.join(", ")));
    let outline = lowest(&unnamed, "support = [{ edge = \"boundary\", kind = \"clamped\" }]\n");
    outline.iter().zip(&all_round).for_each(|(found, exact)| close("frequency", *found, *exact, 1e-12));
    // The first hole is the left one, by symmetry of the two nearest sides.
    let held = |hole: &str| {
        let scene =
            scene(&text(&unnamed, "", &format!("support = [{{ edge = \"{hole}\", kind = \"clamped\" }}]\n")));
        let mesh = simulation::mesh(&scene).unwrap();
        let sides = &mesh.edges[hole];
        let mean = sides.iter().map(|side| mesh.nodes[side[0]].x).sum::<f64>() / sides.len() as f64;
        (sides.len(), mean)
    };
    let [(first, left), (second, right)] = [held("hole_1"), held("hole_2")];
    assert!((first, second) == (6, 6) && (left - 0.3).abs() < 1e-12 && (right - 0.7).abs() < 1e-12);
    let wrong = refusal(&text(&unnamed, "", "support = [{ edge = \"rim\", kind = \"clamped\" }]\n"));
    assert_refused(&wrong, &["no edge named \"rim\"", "boundary, hole_1, hole_2"]);
    // Names of the file stay, and rims stand beside them where their names are free.
    let names = |lines: Vec<(&'static str, Vec<[usize; 2]>)>, file: &str| {
        let file = Drawing { lines, ..drawing.clone() }.write(file);
        study::check(&scene(&text(&file, "", ""))).unwrap().names["edges"].join(", ")
    };
    let side = || vec![[0, 1]];
    assert_eq!(names(vec![("left", side())], "rims_left.msh"), "boundary, hole_1, hole_2, left");
    let taken = names(vec![("boundary", side()), ("hole_2", side())], "rims_taken.msh");
    assert_eq!(taken, "boundary, hole_2");
}

/// A curve of the drawing in no physical group has its number for a name, unless a group has it.
#[test]
fn curves_in_no_group_are_called_by_their_numbers() {
    let drawing = Drawing::grid([3, 2], [0.6, 0.4], false, |x, y| [x, y]);
    let file = drawing.write("curves.msh");
    let lines = std::fs::read_to_string(&file).unwrap();
    let line = |line: &str| match line.split(' ').collect::<Vec<_>>()[..] {
        [number, "1", "2", "1", _, a, b] => format!("{number} 1 2 0 11 {a} {b}"),
        [number, "1", "2", "2", _, a, b] => format!("{number} 1 2 0 3 {a} {b}"),
        _ => line.to_owned(),
    };
    let numbered = lines.lines().map(line).collect::<Vec<_>>().join("\n").replace("\"bottom\"", "\"3\"");
    std::fs::write(&file, numbered).unwrap();
    let held = |edge: &str| format!("support = [{{ edge = {edge}, kind = \"clamped\" }}]\n");
    let mesh = simulation::mesh(&scene(&text(&file, "", &held("\"11\"")))).unwrap();
    assert_eq!([mesh.edges["11"].len(), mesh.edges["3"].len()], [2, 3]);
    assert!(!mesh.edges.contains_key("left"));
    assert_refused(&refusal(&text(&file, "", &held("11"))), &["found the integer 11", "in quotes, \"11\""]);
}
