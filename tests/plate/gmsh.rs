//! Meshes from Gmsh and from meshio agree with Gmsh's own report in every format, and every defect
//! is named with its place.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use rebond::Error;
use rebond::mesh::{Cell, Import, Mesh};
use serde_json::Value;

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/gmsh").join(name)
}

fn load(name: &str) -> Mesh {
    Mesh::load(path(name), Import::default()).unwrap()
}

fn expected(name: &str) -> Value {
    serde_json::from_slice::<Value>(&std::fs::read(path("expected.json")).unwrap()).unwrap()[name].take()
}

/// Returns each name with the number of its members and their measure.
fn measured<M>(
    names: &BTreeMap<String, Vec<M>>,
    measure: impl Fn(&M) -> f64,
) -> BTreeMap<String, (usize, f64)> {
    let sum = |members: &Vec<M>| (members.len(), members.iter().map(&measure).sum());
    names.iter().map(|(name, members)| (name.clone(), sum(members))).collect()
}

#[track_caller]
fn assert_measures(found: BTreeMap<String, (usize, f64)>, expected: &Value) {
    let expected = expected.as_object().unwrap();
    assert_eq!(found.keys().collect::<BTreeSet<_>>(), expected.keys().collect::<BTreeSet<_>>());
    for (name, (count, measure)) in found {
        assert_eq!(expected[&name][0], count, "{name}");
        let exact = expected[&name][1].as_f64().unwrap();
        assert!((measure - exact).abs() <= 1e-14 * exact, "{name}: {measure}, not {exact}");
    }
}

/// Asserts that counts, measures and places agree with those of Gmsh, and that boundary edges have
/// the plate on their left.
#[track_caller]
fn assert_is(mesh: &Mesh, expected: &Value) {
    let triangles = mesh.cells.iter().filter(|cell| matches!(cell, Cell::Triangle(_))).count();
    assert_eq!(expected["nodes"], mesh.nodes.len());
    assert_eq!(expected["triangles"], triangles);
    assert_eq!(expected["quadrilaterals"], mesh.cells.len() - triangles);
    let area: f64 = (0..mesh.cells.len()).map(|cell| mesh.area(cell)).sum();
    assert!((area - expected["area"].as_f64().unwrap()).abs() <= 1e-14);
    assert_measures(measured(&mesh.groups, |&cell| mesh.area(cell)), &expected["groups"]);
    let length = |&[a, b]: &[usize; 2]| (mesh.nodes[b] - mesh.nodes[a]).norm();
    assert_measures(measured(&mesh.edges, length), &expected["edges"]);
    let points: serde_json::Map<String, Value> = (mesh.points.iter())
        .map(|(name, nodes)| {
            (name.clone(), nodes.iter().map(|&node| [mesh.nodes[node].x, mesh.nodes[node].y]).collect())
        })
        .collect();
    assert_eq!(Value::Object(points), expected["points"]);
    let sides: BTreeSet<[usize; 2]> = mesh.cells.iter().flat_map(Cell::edges).collect();
    assert!(mesh.edges.values().flatten().all(|edge| sides.contains(edge)));
}

const FORMATS: [&str; 4] = ["22_text", "22_binary", "41_text", "41_binary"];

#[test]
fn every_format_gives_the_mesh_that_gmsh_made() {
    for name in ["hole", "square", "quads"] {
        let expected = expected(name);
        for format in FORMATS {
            assert_is(&load(&format!("{name}_{format}.msh")), &expected);
        }
    }
}

#[test]
fn the_order_of_bytes_changes_nothing() {
    for version in ["22", "41"] {
        let [little, big] =
            ["binary", "big_endian"].map(|order| load(&format!("square_{version}_{order}.msh")));
        assert_eq!(little, big);
    }
}

#[test]
fn parameters_of_nodes_and_partitions_are_passed_over() {
    let expected = expected("square");
    for variant in ["22_parametric", "22_parametric_binary", "41_parametric", "41_parametric_binary"] {
        assert_is(&load(&format!("square_{variant}.msh")), &expected);
    }
    for format in FORMATS {
        assert_is(&load(&format!("square_{format}_partitioned.msh")), &expected);
    }
}

#[test]
fn meshio_writes_the_same_mesh() {
    let expected = expected("hole");
    for format in FORMATS {
        assert_is(&load(&format!("meshio_{format}.msh")), &expected);
    }
}

#[test]
fn cells_that_run_clockwise_are_turned_over() {
    // The loop of the right half of square.geo is clockwise.
    let text = std::fs::read_to_string(path("square_41_text.msh")).unwrap();
    let mesh = load("square_41_text.msh");
    let rubber = &mesh.groups["rubber"];
    assert!(rubber.iter().all(|&cell| mesh.area(cell) > 0.0));
    let first = text.lines().skip_while(|line| !line.starts_with("2 2 2 41")).nth(1).unwrap();
    let nodes: Vec<usize> = first.split_whitespace().skip(1).map(|word| word.parse().unwrap()).collect();
    let [a, b, c] = [0, 1, 2].map(|i| nodes[i] - 1);
    assert_eq!(mesh.cells[rubber[0]], Cell::Triangle([a, c, b]));
}

#[test]
fn names_survive_refinement() {
    let mesh = load("square_41_binary.msh");
    let fine = mesh.refine();
    fine.check().unwrap();
    assert_eq!(fine.points, mesh.points);
    let area = |mesh: &Mesh| measured(&mesh.groups, |&cell| mesh.area(cell));
    for ((name, (few, coarse)), (_, (many, fine))) in area(&mesh).into_iter().zip(area(&fine)) {
        assert_eq!(many, 4 * few, "{name}");
        assert!((fine - coarse).abs() <= 1e-14, "{name}");
    }
    for (name, edges) in &mesh.edges {
        assert_eq!(fine.edges[name].len(), 2 * edges.len(), "{name}");
    }
}

/// Unit square of two triangles in format 2.2 on lines 1 to 25, with gaps in the numbers, an
/// orphan, carriage returns and comments.
const SQUARE: &str = "$Comments\r\nby hand: $Nodes\r\n$EndComments\r\n$MeshFormat\r\n2.2 0 8\r\n$EndMeshFormat\r\n\
    $PhysicalNames\r\n2\r\n1 1 \"the \u{e9}dge\"\r\n2 2 \"plate\"\r\n$EndPhysicalNames\r\n\
    $Nodes\r\n5\r\n10 0 0 3\r\n20 1 0 3\r\n7 .5 .5 9\r\n30 1 1 3\r\n40 0 1 3\r\n$EndNodes\r\n\
    $Elements\r\n3\r\n1 1 2 1 1 20 10\r\n2 2 2 2 1 10 20 30\r\n3 2 2 2 1 10 30 40\r\n$EndElements\r\n$Extra\r\n1\r\n$EndExtra";

#[test]
fn sparse_numbers_orphans_and_foreign_sections_are_welcome() {
    let mesh = Mesh::from_bytes(SQUARE.as_bytes(), "square.msh", Import::default()).unwrap();
    assert_eq!(mesh.nodes.len(), 4);
    assert_eq!(mesh.cells, [Cell::Triangle([0, 1, 2]), Cell::Triangle([0, 2, 3])]);
    assert_eq!(mesh.edges, [("the \u{e9}dge".to_string(), vec![[0, 1]])].into());
    assert_eq!(mesh.groups, [("plate".to_string(), vec![0, 1])].into());
}

/// A cell that stands twice in one group may have taken the place of another: it is counted. In two
/// groups it is no surprise.
#[test]
fn cells_that_stand_twice_are_counted() {
    let read = |text: &str| Mesh::from_bytes(text.as_bytes(), "square.msh", Import::default()).unwrap();
    let again = |group: &str| {
        let text = SQUARE.replace("Elements\r\n3\r\n", "Elements\r\n4\r\n");
        text.replace("$EndElements", &format!("4 2 2 {group} 1 20 30 10\r\n$EndElements"))
    };
    let mesh = read(SQUARE);
    assert_eq!((mesh.cells.len(), mesh.notes.len()), (2, 0));
    let twice = read(&again("2"));
    assert_eq!(twice.notes, ["the mesh file has 1 of its cells twice; each counts once"]);
    assert_eq!((twice.cells, &twice.groups), (mesh.cells.clone(), &mesh.groups));
    let in_two = read(&again("7"));
    assert_eq!((in_two.cells, in_two.notes.len(), in_two.groups.len()), (mesh.cells, 0, 2));
}

/// Versions from 2.0 on have the sections of 2.2, the first also names without a dimension; and a
/// name that no element uses is no hindrance. The curve then has its number for a name.
#[test]
fn older_versions_and_names_of_nothing_are_welcome() {
    let read = |text: &str| Mesh::from_bytes(text.as_bytes(), "square.msh", Import::default()).unwrap();
    let mesh = read(SQUARE);
    for version in ["2 0", "2.0 0", "2.1 0"] {
        assert_eq!(read(&SQUARE.replace("2.2 0", version)), mesh);
    }
    let bare =
        SQUARE.replace("2.2 0", "2 0").replace("1 1 \"the", "1 \"the").replace("2 2 \"plate", "2 \"plate");
    assert_eq!(read(&bare), mesh);
    let empty = read(&SQUARE.replace("1 1 2 1 1 20 10", "1 1 2 0 1 20 10"));
    let curve = ("1".to_string(), vec![[0, 1]]);
    assert_eq!((empty.cells, empty.edges), (mesh.cells, [curve].into()));
}

#[track_caller]
fn assert_refused(bytes: &[u8], words: &[&str]) {
    match Mesh::from_bytes(bytes, "plate.msh", Import::default()) {
        Err(Error::Mesh(text)) => {
            assert!(text.starts_with("plate.msh:") && !text.contains('\n'), "{text}");
            words.iter().for_each(|word| assert!(text.contains(word), "no {word:?} in: {text}"));
        }
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("accepted, but should say {words:?}"),
    }
}

/// Each replacement of a text in [`SQUARE`] must be refused, with the line and these words.
#[test]
fn a_flaw_is_named_with_its_line() {
    let cases: &[(&str, &str, &[&str])] = &[
        ("2.2 0", "1 0", &[":5:", "version 1 ", "4.1"]),
        ("2.2 0", "4 0", &[":5:", "version 4 ", "4.1"]),
        ("2.2 0", "2.2 7", &[":5:", "0 for a text file", "7"]),
        ("$MeshFormat", "$NOD", &[":4:", "$MeshFormat", "$NOD"]),
        ("$EndMeshFormat", "$Nodes", &[":6:", "$EndMeshFormat", "$Nodes"]),
        ("1 1 \"the", "1 1 the", &[":9:", "double quotes", "the \u{e9}dge"]),
        ("2 2 \"plate", "1 1 \"plate", &[":10:", "physical curve 1", "already"]),
        ("$Nodes\r\n5", "$Nodes\r\n5000000000", &[":13:", "5000000000 nodes", "bytes are left"]),
        ("$Nodes\r\n5", "$Nodes\r\n-5", &[":13:", "number of nodes", "\"-5\""]),
        ("$Nodes\r\n5", "$Nodes\r\n6", &[":19:", "number of a node", "$EndNodes"]),
        ("$Nodes\r\n5", "$Nodes\r\n4", &[":18:", "$EndNodes", "40"]),
        ("20 1 0 3", "20 1 zero 3", &[":15:", "coordinate", "\"zero\""]),
        ("20 1 0 3", "20 1 0,5 3", &[":15:", "coordinate", "\"0,5\"; a decimal point is written ."]),
        ("20 1 0 3", "20 1 nan 3", &[":15:", "coordinate", "NaN"]),
        ("20 1 0 3", "-20 1 0 3", &[":15:", "number of a node", "-20"]),
        ("20 1 0 3", "10 1 0 3", &[":15:", "node 10", "already"]),
        ("30 1 1 3", "30 1 1 3.001", &[":18:", "node 40 lies 1.0e-3", "off the plane", "flat", "1e-5"]),
        ("2 2 2 2 1 10 20 30", "2 4 2 2 1 10 20 30 40", &[":23:", "4-node tetrahedron", "flat"]),
        ("2 2 2 2 1 10 20 30", "2 9 2 2 1 10 20 30 7 7 7", &[":23:", "6-node triangle", "ElementOrder"]),
        ("2 2 2 2 1 10 20 30", "2 21 2 2 1 10 20 30", &[":23:", "10-node triangle", "ElementOrder"]),
        ("2 2 2 2 1 10 20 30", "2 36 2 2 1 10 20 30", &[":23:", "16-node quadrangle", "ElementOrder"]),
        ("2 2 2 2 1 10 20 30", "2 77 2 2 1 10 20 30", &[":23:", "type 77"]),
        ("2 2 2 2 1 10 20 30", "2 2 2 2 1 10 21 30", &[":23:", "node 21 "]),
        ("2 2 2 2 1 10 20 30", "2 2 2 2 1 10 20", &[":24:", "node 3 "]),
        (
            "1 1 2 1 1 20 10",
            "1 1 2 1 1 20 40",
            &["node 20 at (1, 0)", "node 40 at (0, 1)", "\"the \u{e9}dge\""],
        ),
        ("1 1 2 1 1 20 10", "1 1 2 1 1 20 7", &["node 7 at (0.5, 0.5)", "not an edge of a cell"]),
        (
            "1 1 2 1 1 20 10",
            "1 15 2 1 1 7",
            &["node 7 at (0.5, 0.5)", "physical point \"1\"", "not a node of a cell"],
        ),
        ("3 2 2 2 1 10 30 40", "3 2 2 2 1 20 10 40", &["overlap"]),
        ("40 0 1 3", "40 .5 .5 3", &["degenerate"]),
        ("$EndElements", "$EndElement", &[":25:", "$EndElements"]),
        ("$Extra", "$Nodes\r\n0\r\n$EndNodes\r\n$Extra", &[":26:", "$Nodes above already"]),
        ("$EndExtra", "", &["$EndExtra", "ends"]),
        ("$Extra", "Extra", &[":26:", "a section", "Extra"]),
    ];
    for (from, to, words) in cases {
        assert!(SQUARE.contains(from), "{from}");
        assert_refused(SQUARE.replacen(from, to, 1).as_bytes(), words);
    }
    assert_refused(b"", &["empty"]);
    assert_refused(b"\xff\xfe$MeshFormat", &[":1:", "a section"]);
    let no_surface = SQUARE
        .replace("2 2 2 2 1 10 20 30", "2 1 2 2 1 10 20")
        .replace("3 2 2 2 1 10 30 40", "3 1 2 1 1 20 30");
    assert_refused(no_surface.as_bytes(), &["no triangle and no quadrangle", "Mesh.SaveAll"]);
}

#[test]
fn cells_that_do_not_share_their_nodes_are_refused() {
    // The mesh gets a second node at (1, 1), and a node halfway up the diagonal.
    let twin = SQUARE.replace("7 .5 .5 9", "7 1 1 3").replace("10 30 40", "10 7 40");
    assert_refused(twin.as_bytes(), &["nodes 7 and 30 are both at (1, 1)"]);
    let hanging = SQUARE
        .replace("7 .5 .5 9", "7 .5 .5 3")
        .replace("$Elements\r\n3", "$Elements\r\n4")
        .replace("3 2 2 2 1 10 30 40", "3 2 2 2 1 10 7 40\r\n4 2 2 2 1 7 30 40");
    assert_refused(hanging.as_bytes(), &["node 7 at (0.5, 0.5) hangs", "(1, 1), (0, 0) of cell 2"]);
}

#[test]
fn second_order_files_are_refused() {
    assert_refused(
        &std::fs::read(path("second_order.msh")).unwrap(),
        &["3-node line", "Mesh.ElementOrder = 1"],
    );
}

#[test]
fn binary_flaws_are_named_with_their_offset() {
    let sound = std::fs::read(path("square_41_binary.msh")).unwrap();
    let estimate_factor_error = |at: usize, byte: u8| {
        let mut bytes = sound.clone();
        bytes[at] = byte;
        bytes
    };
    let find = |text: &str| {
        sound.windows(text.len()).position(|window| window == text.as_bytes()).unwrap() + text.len()
    };
    let one = find("$MeshFormat\n4.1 1 8\n");
    assert_refused(&estimate_factor_error(one, 2), &[&format!("byte {one}:"), "order of bytes", "2"]);
    assert_refused(&estimate_factor_error(one - 2, b'4'), &["8 bytes", "4"]);
    let nodes = find("$Nodes\n");
    assert_refused(
        &estimate_factor_error(nodes + 15, 1),
        &[&format!("byte {}:", nodes + 16), "nodes are announced"],
    );
    assert_refused(&estimate_factor_error(nodes + 8, 7), &["7 nodes are announced, but the blocks have 66"]);
    let end = find("$Elements\n") + 40;
    assert_refused(&sound[..end], &["bytes are left"]);
    assert_refused(&sound[..nodes + 20], &["16 blocks are announced, but only 12 bytes are left"]);
    assert_refused(&sound[..nodes + 4], &["the file ends where the number of blocks should stand"]);
}

#[test]
fn a_file_that_is_not_there_is_an_error_of_reading() {
    let error = Mesh::load(path("nowhere.msh"), Import::default()).unwrap_err();
    assert!(matches!(error, Error::Io { .. }) && error.to_string().contains("nowhere.msh"), "{error}");
}
