//! The inf-sup constant, compared with an independent program, and cases in which it vanishes.

use crate::common::models::{CLAMPED, UNIT};
use crate::common::plates::{Alternating, Fvs, Hct, Matrices, Right, all_round, close};
use crate::common::scenes::{self, STILL, grid};
use rebond::dof_map::Support;
use rebond::linalg::{CellClass, ElementMatrix, Form, Native, SingularMassCell};
use rebond::study::infsup::{self, InfSup};
use std::rc::Rc;

fn rows(mass: &Form) -> &[SingularMassCell] {
    match mass {
        Form::SingularMassCells(averages) => averages.rows(),
        Form::Cells(_) | Form::Modal { .. } => panic!("not the singular mass of cells"),
    }
}

fn plate_constants(plate: &Matrices, bounded: &[usize]) -> InfSup {
    let (dofs, rows) = (plate.space.dofs(), rows(&plate.singular));
    infsup::constants(dofs, &plate.stiffness, false, rows, bounded).unwrap()
}

/// The constant is the smallest singular value of G on ker B at 10 x 4, compared with numpy's from
/// GetFEM's matrices.
#[test]
fn the_plate_of_the_paper() {
    let cases =
        [(Fvs, Right, 5.6393574385e-3), (Hct, Right, 2.6213284729e-3), (Hct, Alternating, 3.5665192684e-3)];
    for (element, diagonal, expected) in cases {
        let plate = Matrices::paper([10, 4], element, diagonal);
        let constants = plate_constants(&plate, &plate.deflections());
        close("raw", constants.raw.unwrap(), expected, 1e-8);
    }
}

/// Returns dofs, stiffness and mass of a bar on (0, 1), held at 1, with an obstacle at 0.
/// Displacements have the given degree, and the velocity is constant per cell.
fn bar(cells: usize, degree: usize) -> (usize, Form, Form) {
    let h = 1.0 / cells as f64;
    let dofs = degree * cells;
    let engine = Native::new(dofs);
    let (stiffness, moments): (Vec<f64>, Vec<f64>) = match degree {
        1 => (vec![1.0, -1.0, -1.0, 1.0], vec![0.5, 0.5]),
        _ => (
            [7.0, -8.0, 1.0, -8.0, 16.0, -8.0, 1.0, -8.0, 7.0].map(|k| k / 3.0).to_vec(),
            vec![1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0],
        ),
    };
    let matrix: Rc<[f64]> = stiffness.iter().map(|k| k / h).collect();
    let row: Rc<[f64]> = moments.iter().map(|b| b * h).collect();
    let dofs_of = |cell: usize| -> Rc<[Option<usize>]> {
        (0..=degree).map(|i| Some(degree * cell + i).filter(|&dof| dof < dofs)).collect()
    };
    let block = |cell| ElementMatrix {
        dofs: dofs_of(cell),
        matrix: matrix.clone(),
        bending: None,
        class: CellClass::Plate(0),
    };
    let average = |cell| SingularMassCell {
        dofs: dofs_of(cell),
        row: row.clone(),
        mass: h,
        class: CellClass::Plate(0),
    };
    let stiffness = engine.form((0..cells).map(block).collect());
    let mass = engine.averages((0..cells).map(average).collect());
    (dofs, stiffness, mass)
}

/// P1 displacements are determined by P0 velocities: ker B is trivial and no reaction can be
/// carried. P2 displacements leave one dof per cell to ker B, and the constant does not depend on
/// the mesh: 0.9717 in Euclidean norms.
#[test]
fn bars() {
    for cells in [1, 2, 10, 100, 1000] {
        let (dofs, stiffness, mass) = bar(cells, 1);
        let linear = infsup::constants(dofs, &stiffness, false, rows(&mass), &[0]).unwrap();
        assert_eq!(linear.raw, Some(0.0), "{cells} cells");
        assert_eq!(linear.energy, Some(0.0), "{cells} cells");

        let (dofs, stiffness, mass) = bar(cells, 2);
        let raw = infsup::constants(dofs, &stiffness, false, rows(&mass), &[0]).unwrap().raw.unwrap();
        assert!((0.970..0.972).contains(&raw), "{cells} cells: {raw}");
    }
}

/// The constant of a bar with one P2 cell is computed by hand: w = (1, -1/4) is in ker B, so the
/// constant in Euclidean norms is 1 / |w|; its energy is 4 times that of the straight line.
#[test]
fn one_quadratic_cell() {
    let (dofs, stiffness, mass) = bar(1, 2);
    let constants = infsup::constants(dofs, &stiffness, false, rows(&mass), &[0]).unwrap();
    close("raw", constants.raw.unwrap(), 4.0 / 17.0_f64.sqrt(), 1e-14);
    close("energy", constants.energy.unwrap(), 0.5, 1e-14);
}

/// The plate is clamped all around and has one free node: eight cells leave nothing to ker B.
#[test]
fn too_many_cells_for_the_free_dofs() {
    let plate = Matrices::square(2, Hct, &all_round(Support::Clamped));
    let constants = plate_constants(&plate, &plate.deflections());
    assert_eq!((constants.raw, constants.energy), (Some(0.0), Some(0.0)));
}

/// The constant decreases as h^2 on quadrilaterals, and is the same by dense (up to 1500 dofs) and
/// by sparse matrices.
#[test]
fn refinement() {
    for n in [10, 20, 30, 40, 80] {
        let plate = Matrices::paper([n, 2 * n / 5], Fvs, Right);
        let constants = plate_constants(&plate, &plate.deflections());
        let scaled = constants.raw.unwrap() * (n * n) as f64;
        assert!((0.56..0.66).contains(&scaled), "{n}: {scaled}");
        assert_eq!(constants.energy.is_some(), plate.space.dofs() <= infsup::DENSE_LIMIT);
        assert!(constants.energy.is_none_or(|beta| 0.0 < beta && beta < 1.0));
    }
}

/// An obstacle under a part of the plate has fewer reactions, none of which is harder to carry.
#[test]
fn fewer_reactions_are_easier_to_carry() {
    let plate = Matrices::paper([10, 4], Hct, Right);
    let all = plate_constants(&plate, &plate.deflections());
    let edge: Vec<usize> = plate
        .mesh
        .edge_nodes("right")
        .unwrap()
        .iter()
        .filter_map(|&node| plate.space.deflection(node))
        .collect();
    let some = plate_constants(&plate, &edge);
    assert!(some.raw > all.raw && some.energy > all.energy, "{some:?} against {all:?}");
}

/// A rib with mass shares the mean velocity of each cell that it lies in, and leaves as many
/// reactions to carry as one without mass, with a constant of the same size.
#[test]
fn a_rib_with_mass_keeps_the_constant() {
    for element in ["fvs", "hct"] {
        let constants = |ribs: &str, mass: f64| {
            let ribs = ribs.replace("RIB", &format!("bending = 1, mass = {mass}"));
            scenes::inspect(&format!("{UNIT}{}{CLAMPED}rib = [{ribs}]\n{STILL}", grid(element, 8, 8))).inf_sup
        };
        for ribs in [
            "{ line = [[0, 0.5], [1, 0.5]], RIB }",
            "{ line = [[0, 0.53], [1, 0.61]], RIB }",
            "{ line = [[0, 0.53], [1, 0.61]], RIB }, { line = [[1, 0.61], [0, 0.53]], RIB }",
        ] {
            let [bare, heavy] = [0.0, 0.1].map(|mass| constants(ribs, mass));
            println!("{element}, {ribs}: {bare:?}, {heavy:?}");
            for (bare, heavy) in [(bare.raw, heavy.raw), (bare.energy, heavy.energy)] {
                let ratio = heavy.unwrap() / bare.unwrap();
                assert!((0.4..2.0).contains(&ratio), "{element}, {ribs}: {ratio}");
            }
        }
    }
}
