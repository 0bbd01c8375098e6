//! Static deflections, compared with independent programs, published values and symmetry, and the
//! digits that fine meshes keep.

use crate::common::models::unit_plate;
use crate::common::plates::{Alternating, CLAMPED_LEFT, Fvs, Hct, Left, Matrices, Right, all_round, close};
use rebond::dof_map::Support;
use rebond::linalg::{Engine, LinearCombination, MOST_SPOILT, estimate_factor_error};
use rebond::mesh::Mesh;

const PRESSURE: f64 = 14600.0;

fn elastic_energy(plate: &Matrices, u: &[f64]) -> f64 {
    0.5 * plate.engine.multiply(&plate.stiffness, u, &mut vec![0.0; u.len()]).unwrap()
}

/// The paper's plate under its initial pressure at 10 x 4: w(L, 0), w(L, l) where it differs, and
/// E_0, compared with GetFEM's matrices and iterative refinement.
#[test]
fn the_plate_of_the_paper() {
    let cases = [
        (Fvs, Right, 0.2076308761, 0.2076308761, 289.36622567),
        (Hct, Right, 0.2065318015, 0.2066910261, 287.64971601),
        (Hct, Left, 0.2066910261, 0.2065318015, 287.64971601),
        (Hct, Alternating, 0.2067496513, 0.2067496513, 287.80842820),
    ];
    for (element, diagonal, near, far, energy) in cases {
        let plate = Matrices::paper([10, 4], element, diagonal);
        let u = plate.statics(PRESSURE);
        close("w(L, 0)", plate.at(&u, 1.2, 0.0), near, 1e-9);
        close("w(L, l)", plate.at(&u, 1.2, 0.4), far, 1e-9);
        close("E_0", elastic_energy(&plate, &u), energy, 1e-9);
    }
}

/// Fine meshes keep twelve digits, compared with an independent solution with long-double
/// refinement.
#[test]
fn fine_meshes_keep_their_digits() {
    for (cells, expected) in [([20, 8], 0.207974277259), ([80, 32], 0.208197225632)] {
        let plate = Matrices::paper(cells, Fvs, Right);
        let u = plate.statics(PRESSURE);
        close("w(L, 0)", plate.at(&u, 1.2, 0.0), expected, 1e-11);
    }
}

/// The mesh with "\" diagonals is the mirror image of the one with "/".
#[test]
fn mirror_images() {
    let [right, left] = [Right, Left].map(|diagonal| Matrices::paper([80, 32], Hct, diagonal));
    let (u, v) = (right.statics(PRESSURE), left.statics(PRESSURE));
    let scale = right.at(&u, 1.2, 0.0);
    let mut worst = 0.0_f64;
    for (dof, node) in right.space.deflections() {
        let (column, row) = (node % 81, node / 81);
        let image = left.space.deflection(column + 81 * (32 - row)).unwrap();
        worst = worst.max((u[dof] - v[image]).abs());
        worst = worst.max((u[dof + 1] - v[image + 1]).abs() * 1.2);
        worst = worst.max((u[dof + 2] + v[image + 2]).abs() * 1.2);
    }
    assert!(worst <= 1e-12 * scale, "{:e}", worst / scale);
}

/// Returns U^T K U by the assembled matrix, whose entries are summed first, as in any sparse
/// matrix.
fn assembled_energy(plate: &Matrices, u: &[f64]) -> f64 {
    let mut entries = std::collections::BTreeMap::<(usize, usize), f64>::new();
    plate.stiffness.for_each_lower(|i, j, entry| *entries.entry((i, j)).or_default() += entry);
    let mut product = vec![0.0; u.len()];
    for ((i, j), entry) in entries {
        product[i] += entry * u[j];
        if i != j {
            product[j] += entry * u[i];
        }
    }
    0.5 * product.iter().zip(u).map(|(f, u)| f * u).sum::<f64>()
}

/// By Clapeyron's theorem, twice the elastic energy is the work of the load, F . U, a sum of
/// positive terms that loses no digits. The cell-by-cell operator preserves this; the assembled
/// matrix loses it as h^-4.
#[test]
fn cell_by_cell_energies_keep_the_digits_that_assembled_ones_lose() {
    for (cells, assembled_loses) in [([20, 8], 1e-11), ([80, 32], 1e-8), ([160, 64], 1e-7)] {
        let plate = Matrices::paper(cells, Hct, Right);
        let u = plate.statics(PRESSURE);
        let load = rebond::assembly::uniform_load(&plate.cells, u.len(), PRESSURE);
        let work = 0.5 * plate.engine.dot(&load, &u).unwrap();
        let [kept, lost] =
            [elastic_energy(&plate, &u), assembled_energy(&plate, &u)].map(|e| (e / work - 1.0).abs());
        assert!(kept < 1e-13, "{cells:?}: cell by cell {kept:e}");
        assert!(lost > assembled_loses, "{cells:?}: assembled {lost:e}");
    }
}

/// In a strip of 3000 square cells rounding changes the assembled stiffness of the softest modes by
/// a percent and more. Conjugate gradients on the cell-by-cell operator still find the equilibrium
/// w = q L^4 / 8 D of the tip, with twelve digits of its energy.
#[test]
fn a_spoilt_factor_still_finds_the_equilibrium() {
    let cells = 3000;
    let length = f64::from(cells);
    for element in [Fvs, Hct] {
        let mesh = Mesh::rectangle(length, 1.0, [cells as usize, 1], element, Right).unwrap();
        let plate = Matrices::new(mesh, unit_plate(0.0), CLAMPED_LEFT);
        let matrix = LinearCombination::from(&plate.stiffness);
        let mut factor = plate.engine.rough_factor(&matrix).unwrap().unwrap();
        let error = estimate_factor_error(&plate.engine, &matrix, factor.as_mut()).unwrap();
        assert!(error > MOST_SPOILT, "{element:?}: {error:e}");
        let u = plate.statics(1.0);
        let load = rebond::assembly::uniform_load(&plate.cells, u.len(), 1.0);
        let work = 0.5 * plate.engine.dot(&load, &u).unwrap();
        close("energy", elastic_energy(&plate, &u), work, 1e-12);
        close("tip", plate.at(&u, length, 0.0), length.powi(4) / 8.0, 1e-6);
    }
}

/// A rigid motion of a plate far from the origin has no energy, up to the rounding of the motion
/// itself.
#[test]
fn rigid_motions_are_free() {
    for element in [Fvs, Hct] {
        let mut mesh = Mesh::rectangle(1.2, 0.4, [40, 16], element, Right).unwrap();
        mesh.nodes.iter_mut().for_each(|p| *p += rebond::mesh::Point::new(64.0, -32.0).coords);
        let plate = Matrices::new(mesh, unit_plate(0.3), &[]);
        let rigid: Vec<f64> =
            plate.mesh.nodes.iter().flat_map(|p| [1.0 + 0.5 * p.x - 0.25 * p.y, 0.5, -0.25]).collect();
        assert!(elastic_energy(&plate, &rigid) < 1e-20);
    }
}

/// The value w D / (q a^4), nu = 0.3, on the unit square approaches published values from below.
/// Each refinement brings it at least 2.5 times nearer (as h^2, except for the corner singularities
/// of the cantilever), and at 64 x 64 it is as near as the last column says.
#[test]
fn published_deflections_of_the_square() {
    type Case<'c> = (&'c str, &'c [(&'c str, Support)], [f64; 2], f64, f64);
    let simply = all_round(Support::SimplySupported);
    let clamped = all_round(Support::Clamped);
    let cases: [Case; 5] = [
        ("SSSS centre", &simply, [0.5, 0.5], 0.00406235, 2.1e-4),
        ("CCCC centre", &clamped, [0.5, 0.5], 0.00126532, 7e-4),
        ("CFFF centre", CLAMPED_LEFT, [0.5, 0.5], 0.045844, 2.3e-4),
        ("CFFF corner", CLAMPED_LEFT, [1.0, 0.0], 0.127232, 2e-4),
        ("CFFF mid-tip", CLAMPED_LEFT, [1.0, 0.5], 0.129071, 1.6e-4),
    ];
    for (name, supports, [x, y], expected, bound) in cases {
        for element in [Fvs, Hct] {
            let mut before = f64::INFINITY;
            for cells in [8, 16, 32, 64] {
                let plate = Matrices::square(cells, element, supports);
                let error = 1.0 - plate.at(&plate.statics(1.0), x, y) / expected;
                assert!(
                    error > 0.0 && error < before / 2.5,
                    "{name} {element:?} {cells}: {error:e} after {before:e}"
                );
                before = error;
            }
            assert!(before < bound, "{name} {element:?}: {before:e}");
        }
    }
}

/// The mean deflection under a uniform pressure is proportional to the energy: Galerkin's value is
/// below that of the plate and grows on nested meshes.
#[test]
fn nested_meshes_grow_softer() {
    for element in [Fvs, Hct] {
        let mut before = 0.0;
        for cells in [4, 8, 16, 32, 64] {
            let plate = Matrices::square(cells, element, CLAMPED_LEFT);
            let energy = elastic_energy(&plate, &plate.statics(1.0));
            assert!(energy > before, "{element:?} {cells}: {energy} after {before}");
            before = energy;
        }
    }
}

/// With nu = 0 a cantilever under a uniform pressure is a beam with w = q L^4 / (8 D) at the tip.
/// Rectangles contain its cubics and are exact; triangles converge from below, as h^2.
#[test]
fn a_strip_without_poisson_is_a_beam() {
    let tip = |element, cells| {
        let mesh = Mesh::rectangle(1.0, 0.25, cells, element, Right).unwrap();
        let plate = Matrices::new(mesh, unit_plate(0.0), CLAMPED_LEFT);
        plate.at(&plate.statics(1.0), 1.0, 0.125)
    };
    close("fvs", tip(Fvs, [8, 2]), 0.125, 1e-14);
    let [coarse, fine] = [[8, 2], [16, 4]].map(|cells| 0.125 - tip(Hct, cells));
    assert!(fine > 0.0 && (3.8..4.5).contains(&(coarse / fine)), "{coarse:e}, then {fine:e}");
}

/// The deflection of the paper's plate, in units of q a^4 / D, at the corner and the middle of the
/// tip, from below.
#[test]
fn the_tip_of_a_plate_three_times_as_long_as_wide() {
    for element in [Fvs, Hct] {
        let mesh = Mesh::rectangle(1.0, 1.0 / 3.0, [96, 32], element, Right).unwrap();
        let plate = Matrices::new(mesh, unit_plate(0.3), CLAMPED_LEFT);
        let u = plate.statics(1.0);
        for (y, expected) in [(0.0, 0.132269), (1.0 / 6.0, 0.132347)] {
            let w = plate.at(&u, 1.0, y);
            assert!(w < expected, "{element:?}: {w}");
            close("tip", w, expected, 3e-4);
        }
    }
}
