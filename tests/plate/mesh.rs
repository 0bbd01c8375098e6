//! Meshes: numbering, names, patterns, refinement, location of points, and detection of every
//! defect.

use std::collections::BTreeSet;

use rebond::Error;
use rebond::mesh::{Cell, Diagonal, ElementKind, Mesh, Point};

fn triangles(cells: [usize; 2], diagonal: Diagonal) -> Mesh {
    Mesh::rectangle(1.2, 0.4, cells, ElementKind::Hct, diagonal).unwrap()
}

fn quadrilaterals(cells: [usize; 2]) -> Mesh {
    Mesh::rectangle(1.2, 0.4, cells, ElementKind::Fvs, Diagonal::Right).unwrap()
}

/// Returns the cells as cycles that start at their smallest node, in any order.
fn cycles(cells: impl IntoIterator<Item = Vec<usize>>) -> BTreeSet<Vec<usize>> {
    let rotate = |mut nodes: Vec<usize>| {
        let first = (0..nodes.len()).min_by_key(|&i| nodes[i]).unwrap();
        nodes.rotate_left(first);
        nodes
    };
    cells.into_iter().map(rotate).collect()
}

fn rows<T: std::str::FromStr>(text: &str) -> Vec<Vec<T>> {
    text.lines()
        .map(|line| line.split_whitespace().map(|word| word.parse().ok().unwrap()).collect())
        .collect()
}

#[test]
fn rectangles_are_numbered_like_the_reference_meshes() {
    let references = [
        (
            quadrilaterals([10, 4]),
            include_str!("../data/plate_fvs_10x4_cells.txt"),
            include_str!("../data/plate_fvs_10x4_nodes.txt"),
        ),
        (
            triangles([10, 4], Diagonal::Right),
            include_str!("../data/plate_hct_10x4_cells.txt"),
            include_str!("../data/plate_hct_10x4_nodes.txt"),
        ),
    ];
    for (mesh, cells, nodes) in references {
        mesh.check().unwrap();
        let found: Vec<_> = mesh.cells.iter().map(|cell| cell.nodes().to_vec()).collect();
        assert_eq!(found, rows::<usize>(cells));
        let expected = rows::<f64>(nodes);
        assert_eq!(mesh.nodes.len(), expected.len());
        for (node, expected) in mesh.nodes.iter().zip(expected) {
            assert!((node.x - expected[0]).abs() <= 4e-16 && (node.y - expected[1]).abs() <= 1e-16);
        }
    }
}

#[test]
fn the_edges_of_a_rectangle_have_names_and_run_counter_clockwise() {
    let mesh = quadrilaterals([3, 2]);
    let edges: Vec<_> = mesh.edges.iter().map(|(name, edges)| (name.as_str(), edges.as_slice())).collect();
    assert_eq!(
        edges,
        [
            ("bottom", &[[0, 1], [1, 2], [2, 3]][..]),
            ("left", &[[8, 4], [4, 0]]),
            ("right", &[[3, 7], [7, 11]]),
            ("top", &[[11, 10], [10, 9], [9, 8]]),
        ]
    );
    assert_eq!(mesh.edge_nodes("left").unwrap(), [0, 4, 8]);
    assert_eq!(mesh.edge_nodes("top").unwrap(), [8, 9, 10, 11]);
    let error = mesh.edge_nodes("middle").unwrap_err().to_string();
    assert!(error.contains("\"middle\"") && error.contains("bottom, left, right, top"), "{error}");
}

#[test]
fn the_last_coordinates_are_the_sides_to_the_bit() {
    for cells in 1..200 {
        let mesh = Mesh::rectangle(0.1, 0.7, [cells, cells], ElementKind::Fvs, Diagonal::Right).unwrap();
        assert_eq!(mesh.nodes.last(), Some(&Point::new(0.1, 0.7)));
    }
}

#[test]
fn left_diagonals_are_the_mirror_image_of_right_ones() {
    let (nx, ny) = (3, 2);
    let mirror = |node: usize| node % (nx + 1) + (nx + 1) * (ny - node / (nx + 1));
    let right = triangles([nx, ny], Diagonal::Right);
    let left = triangles([nx, ny], Diagonal::Left);
    left.check().unwrap();
    let mirrored =
        right.cells.iter().map(|cell| cell.nodes().iter().rev().map(|&node| mirror(node)).collect());
    assert_eq!(cycles(mirrored), cycles(left.cells.iter().map(|cell| cell.nodes().to_vec())));
    // With either diagonal the lower triangle comes first.
    assert_eq!(right.cells[..2], [[0, 1, 5], [0, 5, 4]].map(Cell::Triangle));
    assert_eq!(left.cells[..2], [[4, 0, 1], [4, 1, 5]].map(Cell::Triangle));
}

#[test]
fn alternating_diagonals_make_a_checkerboard_that_starts_with_a_right_one() {
    let cells = [4, 3];
    let mesh = triangles(cells, Diagonal::Alternating);
    mesh.check().unwrap();
    let (right, left) = (triangles(cells, Diagonal::Right), triangles(cells, Diagonal::Left));
    for (number, cell) in mesh.cells.iter().enumerate() {
        let (i, j) = (number / 2 % 4, number / 2 / 4);
        assert_eq!(cell, if (i + j) % 2 == 0 { &right.cells[number] } else { &left.cells[number] });
    }
}

#[test]
fn areas_sum_to_the_rectangle_and_are_negative_when_clockwise() {
    for mesh in [triangles([7, 3], Diagonal::Alternating), quadrilaterals([7, 3])] {
        let total: f64 = (0..mesh.cells.len()).map(|cell| mesh.area(cell)).sum();
        assert!((total - 0.48).abs() <= 1e-15, "{total}");
    }
    let mut mesh = quadrilaterals([1, 1]);
    mesh.cells[0] = Cell::Quadrilateral([0, 2, 3, 1]);
    assert!((mesh.area(0) + 0.48).abs() <= 1e-16);
}

#[test]
fn refined_quadrilaterals_are_those_of_the_finer_rectangle() {
    let refined = quadrilaterals([5, 3]).refine();
    let finer = quadrilaterals([10, 6]);
    refined.check().unwrap();
    assert_eq!((refined.nodes.len(), refined.cells.len()), (finer.nodes.len(), finer.cells.len()));
    let twin = |node: usize| {
        finer
            .nodes
            .iter()
            .position(|other| (other - refined.nodes[node]).amax() <= 1e-15)
            .expect("a node of the finer mesh")
    };
    let renumbered = refined.cells.iter().map(|cell| cell.nodes().iter().map(|&node| twin(node)).collect());
    assert_eq!(cycles(renumbered), cycles(finer.cells.iter().map(|cell| cell.nodes().to_vec())));
    for (name, edges) in &refined.edges {
        let renumbered: Vec<_> = edges.iter().map(|edge| edge.map(twin)).collect();
        assert_eq!(renumbered, finer.edges[name], "{name}");
    }
}

#[test]
fn refinement_cuts_a_cell_into_four_that_follow_each_other() {
    // The mesh has a triangle next to a quadrilateral, both irregular.
    let coarse = mixed();
    let fine = coarse.refine();
    fine.check().unwrap();
    assert_eq!(fine.nodes[..coarse.nodes.len()], coarse.nodes);
    assert_eq!(fine.nodes.len(), 5 + 6 + 1);
    assert_eq!(fine.edge_nodes("free").unwrap().len(), 5);
    for (number, cell) in coarse.cells.iter().enumerate() {
        let children = 4 * number..4 * number + 4;
        let total: f64 = children.clone().map(|child| fine.area(child)).sum();
        assert!((total - coarse.area(number)).abs() <= 1e-15);
        for (corner, child) in cell.nodes().iter().zip(children) {
            assert_eq!(fine.cells[child].nodes()[0], *corner);
        }
    }
}

/// Returns a quadrilateral with a triangle on its right.
fn mixed() -> Mesh {
    Mesh {
        nodes: [[0.0, 0.0], [1.0, -0.125], [1.25, 1.0], [0.0, 0.75], [2.0, 0.5]].map(Point::from).to_vec(),
        cells: vec![Cell::Quadrilateral([0, 1, 2, 3]), Cell::Triangle([1, 4, 2])],
        edges: [("free".to_string(), vec![[1, 4], [4, 2]])].into(),
        ..Mesh::default()
    }
}

#[test]
fn a_point_is_located_in_the_first_cell_that_contains_it() {
    let mesh = triangles([10, 4], Diagonal::Right);
    for cell in 0..mesh.cells.len() {
        let vertices = mesh.vertices(cell);
        let inside = (vertices[0].coords + vertices[1].coords + vertices[2].coords) / 3.0;
        assert_eq!(mesh.locate(inside.into()), Some(cell));
        for vertex in vertices {
            let first = mesh
                .cells
                .iter()
                .position(|cell| cell.nodes().iter().any(|&node| mesh.nodes[node] == vertex));
            assert_eq!(mesh.locate(vertex), first);
        }
    }
    assert_eq!(mesh.locate(Point::new(0.06, 0.05)), Some(0), "on a diagonal");
    assert_eq!(mesh.locate(Point::new(1.2, 0.4)), Some(78));
    assert_eq!(mesh.locate(Point::new(1.2 + 1e-12, 0.4)), Some(78), "rounding outside is inside");
    assert_eq!(mesh.locate(Point::new(1.2 + 1e-9, 0.4)), None);
    assert_eq!(mesh.locate(Point::new(-0.1, 0.2)), None);
    assert_eq!(mesh.locate(Point::new(f64::NAN, 0.2)), None);
    assert_eq!(mesh.locate(Point::new(f64::INFINITY, 0.2)), None);
    assert_eq!(mixed().locate(Point::new(1.5, 0.5)), Some(1));
}

fn assert_refused(result: rebond::Result<impl Sized>, words: &[&str]) {
    match result {
        Err(Error::Mesh(text)) => {
            words.iter().for_each(|word| assert!(text.contains(word), "no {word} in: {text}"))
        }
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("accepted, but should say {words:?}"),
    }
}

#[test]
fn a_flawed_mesh_is_refused_and_the_culprit_named() {
    let mut sound = mixed();
    sound.edges.insert("backwards, inside".into(), vec![[4, 1], [1, 2]]);
    sound.check().unwrap();
    let refused = |spoil: fn(&mut Mesh), words: &[&str]| {
        let mut mesh = mixed();
        spoil(&mut mesh);
        assert_refused(mesh.check(), words);
    };
    refused(|mesh| mesh.cells.clear(), &["no cell"]);
    refused(
        |mesh| mesh.cells[1] = Cell::Triangle([1, 2, 4]),
        &["cell 1 ", "inverted", "(1, -0.125), (1.25, 1), (2, 0.5)"],
    );
    refused(|mesh| mesh.nodes[4] = Point::new(1.125, 0.4375), &["cell 1 ", "degenerate", "(1.125, 0.4375)"]);
    refused(|mesh| mesh.nodes[3] = Point::new(1.0, 0.5), &["cell 0 ", "not strictly convex", "(1, 0.5)"]);
    refused(|mesh| mesh.nodes[3].y = f64::NAN, &["cell 0 ", "not a finite number", "(0, NaN)"]);
    refused(|mesh| mesh.cells[1] = Cell::Triangle([1, 5, 2]), &["cell 1,", "[1, 5, 2]", "node 5", "5 nodes"]);
    refused(|mesh| mesh.cells[1] = Cell::Triangle([1, 4, 4]), &["cell 1 ", "node 4 twice", "(2, 0.5)"]);
    refused(|mesh| mesh.nodes.push(Point::new(7.0, 8.0)), &["node 5", "(7, 8)"]);
    refused(|mesh| mesh.cells.push(Cell::Triangle([1, 4, 3])), &["cells 1 and 2 overlap", "nodes 1 and 4"]);
    refused(|mesh| mesh.edges.get_mut("free").unwrap().push([0, 4]), &["nodes 0 and 4", "\"free\""]);
    refused(|mesh| mesh.groups = [("tip".to_string(), vec![1, 2])].into(), &["\"tip\"", "cell 2", "2 cells"]);
    refused(|mesh| mesh.points = [("tip".to_string(), vec![5])].into(), &["\"tip\"", "node 5", "5 nodes"]);
    refused(
        |mesh| {
            mesh.nodes.push(mesh.nodes[1]);
            mesh.cells[1] = Cell::Triangle([5, 4, 2]);
            mesh.edges.clear();
        },
        &["nodes 1 and 5 are both at (1, -0.125)"],
    );
    refused(
        |mesh| {
            mesh.nodes.push(Point::new(1.125, 0.4375));
            mesh.cells[1] = Cell::Triangle([5, 4, 2]);
            mesh.edges.clear();
        },
        &["node 5 at (1.125, 0.4375) hangs", "(1, -0.125), (1.25, 1) of cell 0"],
    );
    refused(|mesh| mesh.nodes.push(Point::new(0.1 + 0.2, 1.0 / 3.0)), &["node 5 at (0.3, 0.333333)"]);
}

#[test]
fn an_edge_of_three_cells_is_refused() {
    let mut mesh = mixed();
    mesh.nodes.push(Point::new(3.0, 1.0));
    mesh.cells.push(Cell::Triangle([1, 5, 2]));
    assert_refused(mesh.check(), &["cells 1 and 2 overlap", "nodes 2 and 1", "(1.25, 1), (1, -0.125)"]);
}

#[test]
fn a_rectangle_that_makes_no_sense_is_refused() {
    let rectangle =
        |length, width, cells| Mesh::rectangle(length, width, cells, ElementKind::Hct, Diagonal::Right);
    for side in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_refused(rectangle(side, 1.0, [1, 1]), &["length", "positive"]);
        assert_refused(rectangle(1.0, side, [1, 1]), &["width", "positive"]);
    }
    assert_refused(rectangle(1.0, 1.0, [0, 1]), &["0 by 1"]);
    assert_refused(rectangle(1.0, 1.0, [1, 0]), &["1 by 0"]);
    for cells in [[usize::MAX, 1], [1, usize::MAX], [1 << 33, 1 << 33], [30_000, 30_000]] {
        assert_refused(rectangle(1.0, 1.0, cells), &["more than this program can hold"]);
    }
}
