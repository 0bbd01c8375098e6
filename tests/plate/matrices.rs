//! The assembled matrices, compared with GetFEM's, and as files.

use crate::common::models::plate;
use crate::common::plates::{Fvs, Hct, Matrices, Right};
use rebond::linalg::Form;
use rebond::mesh::{ElementKind, Mesh};
use rebond::scene::Scene;
use rebond::study;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

type Dense = Vec<Vec<f64>>;

/// Reads a Matrix Market file, real general, by column and row from 0.
fn read(path: &Path) -> Dense {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('%'));
    let numbers = |line: &str| -> Vec<usize> {
        line.split_whitespace().take(3).map(|n| n.parse().unwrap_or(0)).collect()
    };
    let [rows, columns, entries] = numbers(lines.next().unwrap())[..] else { panic!("no size") };
    let mut matrix = vec![vec![0.0; columns]; rows];
    let mut count = 0;
    for line in lines {
        let [row, column, _] = numbers(line)[..] else { panic!("no entry: {line}") };
        matrix[row - 1][column - 1] += line.split_whitespace().nth(2).unwrap().parse::<f64>().unwrap();
        count += 1;
    }
    assert_eq!(count, entries, "{}", path.display());
    matrix
}

fn reference(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// Returns the rows of a text file of numbers.
fn table(name: &str) -> Dense {
    let numbers = |line: &str| line.split_whitespace().map(|n| n.parse().unwrap()).collect();
    fs::read_to_string(reference(name)).unwrap().lines().map(numbers).collect()
}

fn paper(element: ElementKind) -> Matrices {
    Matrices::new(Mesh::rectangle(1.2, 0.4, [10, 4], element, Right).unwrap(), plate(), &[])
}

fn dense(form: &Form, dofs: usize) -> Dense {
    let mut matrix = vec![vec![0.0; dofs]; dofs];
    form.for_each_lower(|i, j, entry| {
        matrix[i][j] += entry;
        if i != j {
            matrix[j][i] += entry;
        }
    });
    matrix
}

fn rows_of_b(plate: &Matrices) -> Dense {
    let Form::SingularMassCells(averages) = &plate.singular else { panic!("not a singular mass") };
    let row = |average: &rebond::linalg::SingularMassCell| {
        let mut row = vec![0.0; plate.space.dofs()];
        average.dofs.iter().zip(average.row.iter()).for_each(|(dof, value)| row[dof.unwrap()] += value);
        row
    };
    averages.rows().iter().map(row).collect()
}

/// Returns the number of each reference item in our numbering, matched by keys.
fn numbering<K: Ord>(ours: impl Iterator<Item = K>, reference: impl Iterator<Item = K>) -> Vec<usize> {
    let places: BTreeMap<K, usize> = ours.enumerate().map(|(number, key)| (key, number)).collect();
    reference.map(|key| places[&key]).collect()
}

const ELEMENTS: [(ElementKind, &str); 2] = [(Fvs, "fvs"), (Hct, "hct")];

#[test]
fn the_plate_of_the_paper() {
    for (element, name) in ELEMENTS {
        let plate = paper(element);
        let file = |what: &str| format!("plate_{name}_10x4_{what}");
        let micrometres = |x: f64, y: f64| [x, y].map(|x| (x * 1e6).round() as i64);
        let positions = table(&file("nodes.txt"));
        let nodes = numbering(
            plate.mesh.nodes.iter().map(|p| micrometres(p.x, p.y)),
            positions.iter().map(|p| micrometres(p[0], p[1])),
        );
        let dofs: Vec<usize> = nodes.iter().flat_map(|node| (0..3).map(move |i| 3 * node + i)).collect();
        let sorted = |mut nodes: Vec<usize>| {
            nodes.sort_unstable();
            nodes
        };
        let cells = numbering(
            plate.mesh.cells.iter().map(|cell| sorted(cell.nodes().to_vec())),
            table(&file("cells.txt"))
                .iter()
                .map(|cell| sorted(cell.iter().map(|&n| nodes[n as usize]).collect())),
        );

        for (what, form) in [("K.mtx", &plate.stiffness), ("Mr.mtx", &plate.consistent)] {
            let (ours, theirs) = (dense(form, plate.space.dofs()), read(&reference(&file(what))));
            let mut worst = 0.0_f64;
            for (i, &p) in dofs.iter().enumerate() {
                for (j, &q) in dofs.iter().enumerate() {
                    let scale = (theirs[i][i] * theirs[j][j]).sqrt();
                    worst = worst.max((ours[p][q] - theirs[i][j]).abs() / scale);
                }
            }
            println!("{name} {what}: {worst:.1e}");
            assert!(worst < 1e-12, "{name} {what}: {worst:e}");
        }
        let (ours, theirs) = (rows_of_b(&plate), read(&reference(&file("B.mtx"))));
        assert_eq!(theirs.len(), cells.len());
        let mut worst = 0.0_f64;
        for (row, &cell) in theirs.iter().zip(&cells) {
            let scale = row.iter().fold(0.0_f64, |m, b| m.max(b.abs()));
            for (value, &dof) in row.iter().zip(&dofs) {
                worst = worst.max((ours[cell][dof] - value).abs() / scale);
            }
        }
        println!("{name} B: {worst:.1e}");
        assert!(worst < 1e-12, "{name} B: {worst:e}");
    }
}

/// M = B^T C^-1 B is symmetric and positive semi-definite, and its rank is the number of cells.
#[test]
fn the_singular_mass_has_the_rank_of_the_cells() {
    for (element, cells) in [(Fvs, 40), (Hct, 80)] {
        let plate = Matrices::paper([10, 4], element, Right);
        let matrix = dense(&plate.singular, 150);
        let matrix = faer::Mat::from_fn(150, 150, |i, j| {
            assert_eq!(matrix[i][j], matrix[j][i]);
            matrix[i][j]
        });
        let values = matrix.self_adjoint_eigenvalues(faer::Side::Lower).unwrap();
        let largest = values[149];
        assert!(values.iter().all(|value| *value > -1e-15 * largest));
        let rank = values.iter().filter(|value| **value > 1e-12 * largest).count();
        assert_eq!(rank, cells, "{element:?}");
    }
}

/// The files contain the matrices to the bit, and agree with one another.
#[test]
fn files_for_other_programs() {
    let scene =
        Scene::load(Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/csma2013/fig3.toml"), &[]).unwrap();
    let folder = std::env::temp_dir().join(format!("rebond-matrices-{}", std::process::id()));
    study::write_matrices(&scene, &folder).unwrap();

    let plate = paper(Hct);
    let get = |name: &str| read(&folder.join(name));
    let b = get("B.mtx");
    assert_eq!(get("K.mtx"), dense(&plate.stiffness, 165));
    assert_eq!(get("M_r.mtx"), dense(&plate.consistent, 165));
    assert_eq!(b, rows_of_b(&plate));
    let (m, c) = (get("M.mtx"), get("C.mtx"));
    for i in 0..165 {
        for j in 0..165 {
            let expected: f64 = (0..80).map(|cell| b[cell][i] * b[cell][j] / c[cell][cell]).sum();
            assert!((m[i][j] - expected).abs() <= 1e-14 * m[i][i].max(m[j][j]), "M, {i} {j}");
        }
    }
    let (g, f) = (get("G.mtx"), get("F.mtx"));
    assert_eq!((g.len(), g[0].len()), (50, 165));
    assert!(g.iter().flatten().sum::<f64>() == 50.0 && g[0][3] == 1.0);
    let total: f64 = (0..55).map(|node| f[3 * node][0]).sum();
    assert!((total / (14600.0 * 0.48) - 1.0).abs() < 1e-13, "total load {total}");
    let weight: f64 = (0..80).map(|cell| c[cell][cell]).sum();
    assert!((weight / (7770.0 * 0.0048) - 1.0).abs() < 1e-13, "total mass {weight}");

    let lines = |name: &str| fs::read_to_string(folder.join(name)).unwrap().lines().count();
    assert_eq!((lines("nodes.csv"), lines("cells.csv")), (56, 81));
    let cells = fs::read_to_string(folder.join("cells.csv")).unwrap();
    assert!(cells.starts_with("cell,a,b,c,d\n0,0,1,12,\n"), "{cells}");
    fs::remove_dir_all(&folder).unwrap();
}
