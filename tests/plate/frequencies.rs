//! Natural frequencies, compared with independent programs and published values.

use crate::common::models::UNIT;
use crate::common::plates::{Alternating, CLAMPED_LEFT, Fvs, Hct, Left, Matrices, Right, all_round, close};
use crate::common::scenes;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rebond::dof_map::{DofMap, Rigid, Support};
use rebond::linalg::{Engine, Form, Native};
use rebond::mesh::ElementKind;
use rebond::scheme::System;
use rebond::{modes, study};
use std::f64::consts::{PI, TAU};

/// The paper's plate at 10 x 4, compared with GetFEM's matrices and dense eigenvalues by LAPACK.
#[test]
fn the_plate_of_the_paper() {
    let cases = [
        (
            Fvs,
            Right,
            [5.953822665, 37.18442546, 37.19367328],
            [5.965529775, 37.71040334, 38.44440463],
            [15815.50, 9142.18],
        ),
        (
            Hct,
            Right,
            [5.970155981, 37.37776514, 37.55597155],
            [5.977992778, 37.73873587, 38.37821623],
            [34630.52, 60889.11],
        ),
        (
            Hct,
            Alternating,
            [5.968574581, 37.43858737, 37.66018174],
            [5.976401342, 38.00877663, 38.27170855],
            [28909.51, 76285.46],
        ),
    ];
    for (element, diagonal, consistent, singular, highest) in cases {
        let plate = Matrices::paper([10, 4], element, diagonal);
        let masses = [("consistent", &plate.consistent, consistent), ("singular", &plate.singular, singular)];
        for ((name, mass, expected), highest) in masses.into_iter().zip(highest) {
            let what = format!("{element:?} {diagonal:?} {name}");
            let values = modes::lowest(&plate.engine, [&plate.stiffness, mass], 3, false).unwrap();
            for (value, expected) in values.iter().zip(expected) {
                close(&what, *value, expected, 1e-9);
            }
            let value = modes::highest(&plate.engine, &plate.stiffness, mass).unwrap();
            // This value is known to a hundredth of a hertz.
            assert!((value - highest).abs() < 0.006, "{what}, highest: {value}, expected {highest}");
        }
    }
}

/// Conforming elements on nested meshes with the consistent mass: every refinement lowers every
/// frequency, towards that of the plate.
#[test]
fn nested_meshes_lower_the_first_frequency() {
    for (element, diagonal) in [(Fvs, Right), (Hct, Right), (Hct, Left)] {
        let mut before = f64::INFINITY;
        for cells in [[5, 2], [10, 4], [20, 8], [40, 16]] {
            let plate = Matrices::paper(cells, element, diagonal);
            let f = modes::lowest(&plate.engine, [&plate.stiffness, &plate.consistent], 1, false).unwrap()[0];
            assert!(f < before, "{element:?} {cells:?}: {f} after {before}");
            assert!(f > 5.945, "{element:?} {cells:?}: {f}");
            before = f;
        }
        assert!(before < 5.9486, "{element:?}: {before}");
    }
}

/// The numbers lambda = omega a^2 sqrt(rho h / D) of the unit square, nu = 0.3, are compared with
/// exact or converged values of the plate. Every mesh stays above them (to the known digits), and
/// the finest comes as near as the last column says.
#[test]
fn published_frequencies_of_the_square() {
    let squares = [2.0, 5.0, 5.0, 8.0, 10.0, 10.0].map(|n| n * PI * PI);
    type Case<'c> = (&'c str, &'c [(&'c str, Support)], [f64; 6], f64);
    let cases: [Case; 3] = [
        // The exact values are pi^2 (m^2 + n^2).
        ("SSSS", &all_round(Support::SimplySupported), squares, 2e-3),
        // The values are those of Leissa 1973 and later authors.
        ("CCCC", &all_round(Support::Clamped), [35.985, 73.394, 73.394, 108.22, 131.58, 132.20], 4e-3),
        // The values are converged, with Argyris triangles.
        ("CFFF", CLAMPED_LEFT, [3.4710, 8.5065, 21.285, 27.199, 30.955, 54.185], 2.3e-3),
    ];
    for (name, supports, expected, bound) in cases {
        for element in [Fvs, Hct] {
            let mut before = [f64::INFINITY; 6];
            for cells in [8, 16, 32] {
                let values = square_frequencies(cells, element, supports, 6);
                for ((value, before), expected) in values.iter().zip(&mut before).zip(expected) {
                    assert!(
                        *value > expected * (1.0 - 5e-5),
                        "{name} {element:?} {cells}: {value} under {expected}"
                    );
                    assert!(value < before, "{name} {element:?} {cells}: {value} after {before}");
                    *before = *value;
                }
            }
            for (value, expected) in before.iter().zip(expected) {
                close(name, *value, expected, bound);
            }
        }
    }
}

/// A plate without supports has three rigid motions at exactly 0, then the published values
/// (SDLS01), which are upper bounds up to 1 % high. The symmetry of the square makes the last two
/// equal on a mesh that has it.
#[test]
fn a_free_plate_has_three_rigid_motions() {
    for element in [Fvs, Hct] {
        let values = square_frequencies(32, element, &[], 8);
        assert_eq!(values[..3], [0.0; 3]);
        for (value, published) in values[3..].iter().zip([13.49, 19.79, 24.43, 35.02, 35.02]) {
            assert!(
                (0.99..1.0).contains(&(value / published)),
                "{element:?}: {value}, published {published}"
            );
        }
        if element == Fvs {
            close("the pair", values[6], values[7], 1e-11);
        }
    }
}

/// The singular mass of a free plate has the same rigid motions, and no more modes than cells.
#[test]
fn modes_end_where_the_mass_does() {
    let plate = Matrices::square(3, Fvs, &[]);
    let values = modes::lowest(&plate.engine, [&plate.stiffness, &plate.singular], 20, true).unwrap();
    assert_eq!(values.len(), 9);
    assert_eq!(values[..3], [0.0; 3]);
    let highest = modes::highest(&plate.engine, &plate.stiffness, &plate.singular).unwrap();
    close("highest", values[8], highest, 1e-8);
}

/// A rigid ball above a plate that is held all round, where rows of B depend on each other: the
/// advised step is a twentieth of the fastest period, which may be that of the ball on the plate.
#[test]
fn a_held_plate_below_a_ball_has_a_fastest_period() {
    let (mut dependent, mut faster) = (0, 0);
    for element in ["fvs", "hct"] {
        for kind in ["clamped", "simply_supported", "guided"] {
            for cells in [3, 4, 5, 8] {
                let text = |body: &str| {
                    format!(
                        "{UNIT}{}{}{body}\n\
                     foundation = [{{ stiffness = 1.0 }}]\n{}",
                        scenes::all_round(kind),
                        scenes::grid(element, cells, cells),
                        scenes::newmark("singular", 1e-3, 1e-3),
                    )
                };
                let ball = text("ball = [{ at = [0.5, 0.1], mass = 0.03, height = 0.01 }]");
                let (free, massless) = dense_highest(&scenes::model(&ball).system);
                let fixed = text("mass = [{ at = [0.5, 0.1], mass = 0.03 }]");
                let (fixed, _) = dense_highest(&scenes::model(&fixed).system);
                let expected = f64::max(free, fixed);
                let check = study::check(&scenes::scene(&ball)).unwrap();
                let what = format!("{element} {kind} {cells}");
                println!("{what}: {free} or {fixed} Hz, {massless} velocities without momentum");
                close(&what, check.frequencies.highest.unwrap(), expected, 1e-8);
                let inspection = study::inspect(&scenes::scene(&ball)).unwrap();
                assert_eq!(inspection.advised_step, check.advised_step);
                let advised = check.advised_step.unwrap() * 20.0 * expected;
                assert!((0.39..=1.0).contains(&advised), "{what}: {advised} of a twentieth of the period");
                dependent += usize::from(massless > 0);
                faster += usize::from(fixed > 1.5 * free);
            }
        }
    }
    assert!(dependent > 12 && faster > 0, "{dependent} and {faster}");
}

/// A few triangles on held edges: rounding gives a velocity without momentum the motion of one that
/// is far faster, or not, with the shift by which the frequency is sought.
#[test]
fn rounding_does_not_keep_the_fastest_motion_from_being_found() {
    let text = format!(
        "plate = {{ length = 0.798, width = 0.637, thickness = \"0.00821*(1 + 0.3*x/0.798 - 0.2*(y/0.637)^2)\", \
         youngs_modulus = 26625100000.0, poissons_ratio = 0.053, density = 1119.75, \
         youngs_modulus_across = 11116078185.964506, shear_modulus = 8283155612.151236, grain = 62.5 }}\n\
         support = [{{ edge = \"left\", kind = \"clamped\" }}, {{ edge = \"bottom\", kind = \"clamped\" }}, \
         {{ edge = \"top\", kind = \"clamped\", where = \"x < 0.69\" }}]\n\
         mesh = {{ element = \"hct\", cells = [4, 2], diagonal = \"right\" }}\n{}",
        scenes::newmark("singular", 1e-5, 1e-5),
    );
    let (highest, massless) = dense_highest(&scenes::model(&text).system);
    println!("{highest} Hz, {massless} velocities without momentum");
    let check = study::check(&scenes::scene(&text)).unwrap();
    close("highest", check.frequencies.highest.unwrap(), highest, 1e-6);
}

/// Returns the highest frequency with the singular mass, and the number of velocities without
/// momentum, from the dense eigenvalues of `$C^{-1/2} B (K + s M)^{-1} B^T C^{-1/2}$`.
fn dense_highest(system: &System<Native>) -> (f64, usize) {
    const SHIFT: f64 = 1e6;
    let Form::SingularMassCells(mass) = &system.mass else { panic!("the mass is not singular") };
    let dofs = system.engine.dofs();
    let mut roots = Mat::<f64>::zeros(dofs, mass.rows().len());
    for (j, cell) in mass.rows().iter().enumerate() {
        for (dof, b) in cell.dofs.iter().zip(&*cell.row).filter_map(|(dof, b)| Some(((*dof)?, b))) {
            roots[(dof, j)] += b / cell.mass.sqrt();
        }
    }
    let mut shifted = &roots * roots.transpose() * SHIFT;
    system.stiffness.for_each_lower(|row, column, entry| shifted[(row, column)] += entry);
    let answers = shifted.llt(Side::Lower).unwrap().solve(&roots);
    let values = (roots.transpose() * answers).self_adjoint_eigenvalues(Side::Lower).unwrap();
    let massless = values.iter().filter(|value| **value < 1e-13 / SHIFT).count();
    ((1.0 / values[massless] - SHIFT).sqrt() / TAU, massless)
}

/// Returns dimensionless frequencies of a unit square with the consistent mass.
fn square_frequencies(
    cells: usize,
    element: ElementKind,
    supports: &[(&str, Support)],
    count: usize,
) -> Vec<f64> {
    let plate = Matrices::square(cells, element, supports);
    let mut rigid = Rigid::new([0.5, 0.5].into(), 0.5_f64.sqrt());
    let places = DofMap::on_edges(&plate.mesh, supports.iter().copied()).unwrap();
    for (hold, at) in DofMap::holds(&plate.mesh, &places).iter().zip(&plate.mesh.nodes) {
        rigid.hold(*at, hold);
    }
    let mechanism = rigid.mechanism().is_some();
    let values = modes::lowest(&plate.engine, [&plate.stiffness, &plate.consistent], count, mechanism);
    values.unwrap().iter().map(|f| f * TAU).collect()
}
