//! Meshes of Abaqus and of Nastran: the same plate in each format, sets and cards of all kinds, and
//! flaws that are named with their lines.

use crate::common::scenes::Drawing;
use rebond::Error;
use rebond::mesh::{Cell, Import, Mesh};

fn read(text: &str, name: &str) -> rebond::Result<Mesh> {
    Mesh::from_bytes(text.as_bytes(), name, Import::default())
}

#[track_caller]
fn assert_refused(text: &str, name: &str, words: &[&str]) {
    match read(text, name) {
        Err(Error::Mesh(message)) => {
            assert!(message.starts_with(&format!("{name}:")) && !message.contains('\n'), "{message}");
            words.iter().for_each(|word| assert!(message.contains(word), "no {word:?} in: {message}"));
        }
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("accepted, but should say {words:?}"),
    }
}

/// Nodes, cells and named edges do not depend on the format.
#[test]
fn every_format_gives_the_same_mesh() {
    for triangles in [false, true] {
        let drawing = Drawing::grid([4, 2], [1.0, 0.5], triangles, |x, y| [x + 0.125 * y, y]);
        let load = |ending: &str| {
            Mesh::load(drawing.write(&format!("formats-{triangles}.{ending}")), Import::default()).unwrap()
        };
        let [gmsh, abaqus, nastran] = ["msh", "inp", "bdf"].map(load);
        for (mesh, group) in [(&abaqus, "plate"), (&nastran, "pid_1")] {
            assert_eq!((&mesh.nodes, &mesh.cells), (&gmsh.nodes, &gmsh.cells));
            assert_eq!(mesh.groups[group], gmsh.groups["plate"]);
            assert!(mesh.points.is_empty(), "{:?}", mesh.points);
            for (number, (name, _)) in drawing.lines.iter().enumerate() {
                let called =
                    if group == "plate" { (*name).to_owned() } else { format!("spc_{}", number + 1) };
                let sorted = |mesh: &Mesh, name: &str| {
                    let mut edges = mesh.edges[name].clone();
                    edges.sort_unstable();
                    edges
                };
                assert_eq!(sorted(mesh, &called), sorted(&gmsh, name), "{name}");
            }
        }
        assert_eq!(abaqus.notes, ["ignored: 1 *DENSITY, 1 *ELASTIC, 1 *MATERIAL"]);
        assert_eq!(nastran.notes, ["ignored: 1 MAT1"]);
    }
}

/// Square of a quadrangle and two triangles, as Abaqus/CAE writes a part and its instance.
const PART: &str = include_str!("../data/cards/square.inp");

#[test]
fn sets_of_abaqus_name_edges_groups_and_points() {
    let mesh = read(PART, "plate.inp").unwrap();
    assert_eq!(mesh.nodes.len(), 6);
    assert_eq!(mesh.nodes[2].x, 2.0);
    let triangles = [Cell::Triangle([1, 2, 5]), Cell::Triangle([1, 5, 4])];
    assert_eq!(mesh.cells[0], Cell::Quadrilateral([0, 1, 4, 3]));
    assert_eq!(mesh.cells[1..], triangles);
    let groups: Vec<(&str, &[usize])> = mesh.groups.iter().map(|(name, cells)| (&**name, &**cells)).collect();
    assert_eq!(groups, [("left half", &[0][..]), ("right half", &[1, 2]), ("whole", &[0, 1, 2])]);
    assert_eq!(mesh.edges["beam"], [[0, 1], [1, 2]]);
    assert_eq!(mesh.edges["clamp"], [[3, 0]]);
    // All nodes lie on the boundary, and are all of it.
    assert_eq!((mesh.edges["all"].len(), mesh.edges.len()), (6, 3));
    let more = read(&PART.replace("*Nset, nset=inside\n5", "*Nset, nset=inside\n5, 1"), "plate.inp").unwrap();
    assert_eq!(more.points["inside"], [0, 4]);
    assert_eq!(mesh.points, [("inside".into(), vec![4]), ("tip".into(), vec![5])].into());
    assert_eq!(
        mesh.notes,
        ["ignored: 1 *ELEMENT of type MASS, 1 *END STEP, 1 *NODE, 1 *NSET, 1 *STATIC, 1 *STEP"]
    );
}

/// The same square with fields of 8 and 16 characters, free ones, tabulators, and elements that
/// come before their nodes.
const BULK: &str = include_str!("../data/cards/square.bdf");

#[test]
fn fields_of_nastran_have_every_width() {
    let mesh = read(BULK, "plate.bdf").unwrap();
    let abaqus = read(PART, "plate.inp").unwrap();
    assert_eq!((&mesh.nodes, &mesh.cells), (&abaqus.nodes, &abaqus.cells));
    assert_eq!(mesh.groups, [("pid_7".into(), vec![0]), ("pid_8".into(), vec![1, 2])].into());
    assert_eq!(mesh.edges, [("pid_5".into(), vec![[0, 1]]), ("spc_3".into(), vec![[3, 0]])].into());
    assert_eq!(mesh.notes, ["ignored: 1 PSHELL"]);
    assert_eq!(read(BULK.split_once("BULK\n").unwrap().1, "plate.DAT").unwrap(), mesh);
}

/// Each replacement of a text must be refused, with the line and these words.
#[test]
fn a_flaw_is_named_with_its_line() {
    let abaqus: &[(&str, &str, &[&str])] = &[
        ("2, 1., 0., 0.", "2, one, 0.", &[":6:", "coordinate", "\"one\""]),
        ("2, 1., 0., 0.", "2, 1e999, 0.", &[":6:", "coordinate"]),
        ("2, 1., 0., 0.", "1, 1., 0., 0.", &[":6:", "a node 1 above already"]),
        ("2, 1., 0., 0.", "2", &[":6:", "node 2 has no coordinates"]),
        ("2, 1., 0., 0.", "x, 1., 0., 0.", &[":6:", "number of a node", "\"x\""]),
        ("type=S4R", "type=S8R", &[":11:", "S8R", "first-order"]),
        ("type=S4R", "type=C3D8", &[":11:", "C3D8", "flat"]),
        ("type=S4R", "elcode=S4R", &[":11:", "TYPE="]),
        ("2, 2, 3, 6", "2, 2, 3", &[":16:", "element 2 has 2 nodes; expected 3"]),
        ("2, 2, 3, 6", "2, 2, 3, 17", &[":16:", "node 17 of this element"]),
        ("3, 2, 6, 5", "2, 2, 6, 5", &[":17:", "an element 2 above already"]),
        ("1, 4, 3", "4, 1, 3", &[":24:", "range"]),
        ("right half\n2", "right half\n2, up", &[":26:", "name of a set above", "\"up\""]),
        ("inside\n5", "inside\n55", &[":30:", "node 55", "\"inside\""]),
        ("*Nset, nset=clamp", "*Nset, name=clamp", &[":23:", "NSET="]),
        ("*End Part", "*End Part\n*Part", &[":34:", "a second *PART"]),
        (" 0., 0., 0.\n*End", " 0., 1., 0.\n*End", &[":36:", "*INSTANCE moves"]),
        ("*Heading", "*Include, input=a.inp", &[":1:", "*INCLUDE", "put its lines"]),
        ("*Heading", "*\u{fffd}!", &[":1:", "a card such as *NODE"]),
        ("*Heading", "plate", &[":1:", "a card such as *NODE"]),
        ("7, 1, 2", "7, 1, 5", &["node 1 at (0, 0)", "element set \"beam\"", "not an edge of a cell"]),
    ];
    for (from, to, words) in abaqus {
        assert!(PART.contains(from), "{from}");
        assert_refused(&PART.replacen(from, to, 1), "plate.inp", words);
    }
    let nastran: &[(&str, &str, &[&str])] = &[
        ("CTRIA3,2,8,2,3,6", "CTRIA6,2,8,2,3,6", &[":6:", "CTRIA6", "first-order"]),
        ("CTRIA3,2,8,2,3,6", "CHEXA,2,8,2,3,6", &[":6:", "CHEXA", "flat"]),
        ("CTRIA3,2,8,2,3,6", "CTRIA3,2,8,2,3", &[":6:", "number of a node"]),
        ("CTRIA3,2,8,2,3,6", "CTRIA3,2,8,2,3,16", &[":6:", "node 16"]),
        ("CTRIA3,2,8,2,3,6", "CTRIA3 2 8 2 3 6", &[":6:", "a card such as GRID"]),
        ("GRID,2,,1.+0", "GRID,2,,1.+0.5", &[":10:", "coordinate", "1.+0.5"]),
        ("GRID,2,,1.+0", "GRID,2,4,1.+0", &[":10:", "coordinate system 4"]),
        ("GRID,2,,1.+0", "GRID,1,,1.+0", &[":10:", "a node 1 above already"]),
        ("THRU    4", "THRU    3", &[":17:", "4 THRU 3"]),
        ("THRU    4", "THRU     ", &[":17:", "after THRU"]),
        ("SPC,3,1", "SPC,3,11", &[":18:", "node 11", "spc_3"]),
        ("PSHELL ", "INCLUDE 'more.bdf'\nPSHELL ", &[":19:", "INCLUDE", "put its lines"]),
    ];
    for (from, to, words) in nastran {
        assert!(BULK.contains(from), "{from}");
        assert_refused(&BULK.replacen(from, to, 1), "plate.nas", words);
    }
    assert_refused("", "plate.inp", &["no triangle", "TYPE=S3"]);
    assert_refused("", "plate.bdf", &["no triangle", "CQUAD4"]);
}

/// A mesh that is turned in space has the same shape, and its note says where x and y are.
#[test]
fn a_mesh_lies_in_any_plane() {
    let drawing = Drawing::grid([4, 2], [1.0, 0.5], true, |x, y| [x, y]);
    let flat = read(&drawing.abaqus(), "flat.inp").unwrap();
    let turned = |place: &dyn Fn(f64, f64) -> [f64; 3]| {
        let mut text = drawing.abaqus();
        for (node, &[x, y]) in drawing.nodes.iter().enumerate() {
            let [a, b, c] = place(x, y);
            text = text.replacen(
                &format!("\n{}, {x:?}, {y:?}, 0.", node + 1),
                &format!("\n{}, {a:?}, {b:?}, {c:?}", node + 1),
                1,
            );
        }
        read(&text, "turned.inp")
    };
    let level = turned(&|x, y| [x, y, 0.3]).unwrap();
    assert_eq!(level, flat);
    for (place, note) in [
        (
            (|x, y| [3.0, x, y]) as fn(f64, f64) -> [f64; 3],
            "the mesh lies in the plane x = 3: its y is x here, its z is y, and its x points up",
        ),
        (
            |x, y| [x, -0.1, y],
            "the mesh lies in the plane y = -0.1: its x is x here, its z is y, and its y points down",
        ),
    ] {
        let mesh = turned(&place).unwrap();
        assert_eq!((&mesh.nodes, &mesh.cells, &mesh.edges), (&flat.nodes, &flat.cells, &flat.edges));
        assert_eq!(mesh.notes[0], note);
    }
    // Across z after a turn by 3-4-5 about y; and a vertical plane. The digits are six or all.
    let rounded = |x: f64| (x * 1e6).round() / 1e6;
    for (place, words) in [
        ((|x, y| [0.8 * x, y, 2.0 - 0.6 * x]) as fn(f64, f64) -> [f64; 3], ["(0.8, 0, -0.6)", "(0, 1, 0)"]),
        (|x, y| [0.6 * x, 0.8 * x, y], ["(0.6, 0.8, 0)", "(0, 0, 1)"]),
        (|x, y| [x, y, 1e-4 * x], ["(1, 0, 0.0001)", "(0, 1, 0)"]),
    ] {
        for digits in [|x| x, rounded] {
            let mesh = turned(&|x, y| place(x, y).map(digits)).unwrap();
            words.iter().for_each(|word| assert!(mesh.notes[0].contains(word), "{}", mesh.notes[0]));
            assert_eq!(mesh.cells, flat.cells);
            let shift = mesh.nodes[0] - flat.nodes[0];
            for (node, expected) in mesh.nodes.iter().zip(&flat.nodes) {
                assert!((node - expected - shift).norm() < 2e-6, "{node}, {expected}");
            }
        }
    }
    let shell = turned(&|x, y| [x, y, 0.01 * x * y]).unwrap_err().to_string();
    let words = ["turned.inp:", "of the size of the mesh off the plane", "flat", "1e-5"];
    words.iter().for_each(|word| assert!(shell.contains(word), "{shell}"));
}
