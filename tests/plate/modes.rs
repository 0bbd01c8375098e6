//! Many lowest modes: all of them, orthonormal, with small residuals.

use crate::common::plates::{Fvs, Hct, Matrices, Right, all_round, close};
use rebond::Error;
use rebond::dof_map::Support;
use rebond::modes::{ModalBasis, ModeRange, lowest_basis};
use rebond::scene::Scene;
use rebond::scheme::System;
use rebond::simulation::Model;
use rebond::study;
use std::f64::consts::PI;

/// Asserts that the modes are orthonormal, have small residuals and have been counted.
#[track_caller]
fn check(basis: &ModalBasis) {
    let count = basis.squares.len();
    assert_eq!([basis.shapes.ncols(), basis.momenta.ncols(), basis.residuals.len()], [count; 3]);
    let gram = basis.shapes.transpose() * &basis.momenta;
    for i in 0..count {
        for j in 0..count {
            let error = (gram[(i, j)] - f64::from(u8::from(i == j))).abs();
            assert!(error <= 1e-14, "shapes {i} and {j}: {error:e}");
        }
    }
    assert!(basis.residuals.iter().all(|residual| *residual <= 1e-9), "{:?}", basis.residuals);
    assert!(basis.squares.is_sorted());
    assert!(basis.is_complete);
}

fn modes_of(plate: &Matrices, range: ModeRange, mechanism: bool) -> ModalBasis {
    let basis = lowest_basis(&plate.engine, [&plate.stiffness, &plate.consistent], range, mechanism).unwrap();
    check(&basis);
    basis
}

/// The values are those of an independent program with dense matrices.
#[test]
fn fifty_modes_of_the_papers_plate() {
    for (element, first, last) in [(Fvs, 5.953822665, 3004.990616), (Hct, 5.970155981, 3449.144262)] {
        let plate = Matrices::paper([10, 4], element, Right);
        let frequencies = modes_of(&plate, ModeRange::Count(50), false).frequencies();
        close("first", frequencies[0], first, 1e-9);
        close("last", frequencies[49], last, 1e-9);
    }
}

#[test]
fn all_modes_up_to_a_frequency() {
    let plate = Matrices::paper([20, 8], Fvs, Right);
    let by_count = modes_of(&plate, ModeRange::Count(40), false);
    let frequencies = by_count.frequencies();
    let limit = 0.5 * (frequencies[38] + frequencies[39]);
    let by_limit = modes_of(&plate, ModeRange::UpTo(limit), false);
    assert_eq!(by_limit.squares.len(), 39);
    for (square, other) in by_limit.squares.iter().zip(&by_count.squares) {
        close("squares", *square, *other, 1e-12);
    }
    let none =
        lowest_basis(&plate.engine, [&plate.stiffness, &plate.consistent], ModeRange::UpTo(1.0), false);
    assert!(none.unwrap().squares.is_empty());
}

/// The pairs (m, n), (n, m) of a simply supported square have one frequency. The number of modes
/// cuts through such a pair.
#[test]
fn double_modes_of_a_square() {
    let plate = Matrices::square(16, Fvs, &all_round(Support::SimplySupported));
    let basis = modes_of(&plate, ModeRange::Count(60), false);
    let mut exact: Vec<f64> =
        (1..20).flat_map(|m| (1..20).map(move |n| PI * PI * f64::from(m * m + n * n))).collect();
    exact.sort_by(f64::total_cmp);
    for (square, exact) in basis.squares.iter().zip(exact).take(22) {
        assert!((-1e-9..0.03).contains(&(square.sqrt() / exact - 1.0)), "{}, exact {exact}", square.sqrt());
    }
    for pair in [(1, 2), (4, 5), (6, 7)] {
        close("pair", basis.squares[pair.0], basis.squares[pair.1], 1e-12);
    }
}

/// A free plate has exactly three rigid motions: translation and two tilts.
#[test]
fn a_free_plate() {
    let mut plate = Matrices::square(10, Fvs, &[]);
    for range in [ModeRange::Count(60), ModeRange::Count(3), ModeRange::Count(0)] {
        let basis = modes_of(&plate, range, true);
        assert!(basis.squares.iter().enumerate().all(|(i, square)| (*square == 0.0) == (i < 3)));
    }
    let pair = modes_of(&plate, ModeRange::UpTo(40.0 / (2.0 * PI)), true).squares;
    assert_eq!(pair.len(), 8);
    close("pair", pair[6], pair[7], 1e-12);
    // Finer meshes have more rounding.
    plate = Matrices::square(40, Hct, &[]);
    let basis = modes_of(&plate, ModeRange::Count(30), true);
    assert_eq!(basis.squares[..3], [0.0; 3]);
    assert!(basis.squares[3] > 13.0 * 13.0);
}

/// All modes can be had, and not one more.
#[test]
fn modes_end_where_the_mass_does() {
    let plate = Matrices::square(3, Fvs, &[]);
    let modes =
        |mass, count| lowest_basis(&plate.engine, [&plate.stiffness, mass], ModeRange::Count(count), true);
    let dofs = plate.space.dofs();
    for (mass, existing) in [(&plate.consistent, dofs), (&plate.singular, 9)] {
        let basis = modes(mass, existing).unwrap();
        check(&basis);
        assert_eq!(basis.squares[..3], [0.0; 3]);
        assert!(basis.squares[3] > 0.0);
        let error = modes(mass, existing + 1).unwrap_err();
        assert!(matches!(&error, Error::Singular(words) if words.contains("only")), "{error}");
    }
}

/// A sheet on an even bed of stiffness k per area has the modes of the free sheet, with k over the
/// mass per area added to each squared angular frequency. The first three, of rigid motions, are
/// equal. The next have `$\omega_j^2 = D \lambda_j^2 / (\rho h L^4)$` with the published lambda of
/// a free square (SDLS01: 13.49, 19.79, 24.43). Where the bed decides alone, all are equal.
#[test]
fn a_soft_sheet_on_a_stiff_bed_has_the_modes_of_the_free_sheet_above_those_of_the_bed() {
    for thickness in [1e-2_f64, 1e-4, 1e-6] {
        let text = format!(
            "plate = {{ length = 1, width = 1, thickness = {thickness}, youngs_modulus = 1e7, poissons_ratio = 0.3, density = 1000 }}\n\
             mesh = {{ element = \"fvs\", cells = [16, 16] }}\nfoundation = [{{ stiffness = 1e9 }}]\n\
             time = {{ scheme = \"newmark\", mass = \"consistent\", step = 1e-5, end = 1e-5 }}\n"
        );
        let scene = Scene::from_str(&text, "bed.toml", &[]).unwrap();
        let model = Model::new(&scene).unwrap();
        let System { engine, stiffness, mass, .. } = &model.system;
        let basis = lowest_basis(engine, [stiffness, mass], ModeRange::Count(6), false).unwrap();
        assert!(basis.is_complete && basis.solves < 600, "{thickness}: {} solves", basis.solves);
        // Where the bed decides, the modes of the sheet are a cluster, right to 1e-8 as a whole.
        let resolution = if thickness < 1e-3 { 1e-8 } else { 1e-10 };
        let areal = 1000.0 * thickness;
        let bed = 1e9 / areal;
        let rigidity = 1e7 * thickness.powi(3) / (12.0 * (1.0 - 0.3 * 0.3));
        for (number, square) in basis.squares.iter().enumerate() {
            let free = [0.0, 0.0, 0.0, 13.49_f64, 19.79, 24.43][number].powi(2) * rigidity / areal;
            let difference = (square - bed - free).abs();
            assert!(difference <= 0.03 * free + resolution * bed, "{thickness}, mode {number}: {square}");
        }
        let lowest = study::check(&scene).unwrap().frequencies.lowest;
        assert_eq!(lowest.len(), 6, "{thickness}");
    }
}

/// Whatever lies below the modes of a sheet on a stiff bed, these are found: the rigid motion of a
/// ball, the motions of a heavy mass or of a rib. `check` has its frequencies wherever the scene
/// runs.
#[test]
fn what_is_heavy_on_a_stiff_bed_hides_no_modes_of_the_sheet() {
    let bed = (1e9_f64 / (1000.0 * 5e-3)).sqrt() / std::f64::consts::TAU;
    let ball = |more: &str| format!("ball = [{{ at = [0.5, 0.5], mass = 0.1, height = 1e-4{more} }}]\n");
    let things = [
        (ball(""), 1),
        (ball(", stiffness = 1e5"), 1),
        ("mass = [{ at = [0.5, 0.5], mass = 0.1 }]\n".to_owned(), 1),
        ("rib = [{ line = [[0.25, 0.5], [0.75, 0.5]], bending = 1.0, mass = 1.0 }]\n".to_owned(), 6),
    ];
    for ((thing, below), mass) in
        things.iter().flat_map(|thing| ["consistent", "singular"].map(|mass| (thing, mass)))
    {
        let text = format!(
            "plate = {{ length = 1, width = 1, thickness = 5e-3, youngs_modulus = 5e6, poissons_ratio = 0.45, density = 1000 }}\n\
             mesh = {{ element = \"fvs\", cells = [20, 20] }}\nfoundation = [{{ stiffness = 1e9 }}]\n{thing}\
             time = {{ scheme = \"newmark\", mass = \"{mass}\", step = 1e-6, end = 1e-6 }}\n"
        );
        let scene = Scene::from_str(&text, "bed.toml", &[]).unwrap();
        let lowest = study::check(&scene).unwrap().frequencies.lowest;
        assert_eq!(lowest.len(), 6, "{thing} {mass}");
        let (lower, cluster) = lowest.split_at(*below);
        assert!(lower.iter().all(|frequency| *frequency < 0.9 * bed), "{thing} {mass}: {lowest:?}");
        let is_near = |frequency: &f64| (0.9999..1.01).contains(&(frequency / bed));
        assert!(cluster.iter().all(is_near), "{thing} {mass}: {lowest:?}");
    }
}
