//! The compliance of the massless rest and the figures of the modal mass, compared with all modes
//! of dense matrices.

use crate::common::models::{PAPER_FALL, PAPER_PLATE, PAPER_START};
use crate::modal::modal_scene;
use faer::{Mat, Side};
use nalgebra::{DMatrix, SymmetricEigen};
use rebond::linalg::Form;
use rebond::scheme::ContactCompliance;
use rebond::simulation::Model;
use rebond::study;

/// All natural modes of a model with the modal mass.
struct AllModes {
    squares: Vec<f64>,
    shapes: Mat<f64>,
    /// Products of the consistent mass and the shapes.
    momenta: Mat<f64>,
}

fn dense(form: &Form, dofs: usize) -> Mat<f64> {
    let mut matrix = Mat::zeros(dofs, dofs);
    form.for_each_lower(|i, j, entry| {
        matrix[(i, j)] += entry;
        if i != j {
            matrix[(j, i)] += entry;
        }
    });
    matrix
}

impl AllModes {
    /// Solves the dense eigenvalue problem, with no part of the program's own modes.
    fn of(model: &Model) -> AllModes {
        let dofs = model.start.displacement.len();
        let (stiffness, mass) = (dense(&model.system.stiffness, dofs), dense(&model.system.mass, dofs));
        let root = mass.llt(Side::Lower).unwrap();
        let mut half = stiffness;
        root.L().solve_lower_triangular_in_place(half.as_mut());
        let mut reduced = half.transpose().to_owned();
        root.L().solve_lower_triangular_in_place(reduced.as_mut());
        // The dense eigenvalues of faer lose ten digits on such matrices.
        let matrix = DMatrix::from_fn(dofs, dofs, |i, j| 0.5 * (reduced[(i, j)] + reduced[(j, i)]));
        let eigen = SymmetricEigen::new(matrix);
        let mut order: Vec<usize> = (0..dofs).collect();
        order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
        let mut shapes = Mat::from_fn(dofs, dofs, |i, k| eigen.eigenvectors[(i, order[k])]);
        root.L().transpose().solve_upper_triangular_in_place(shapes.as_mut());
        let squares = order.iter().map(|&k| eigen.eigenvalues[k]).collect();
        let momenta = mass * &shapes;
        AllModes { squares, shapes, momenta }
    }

    /// Returns the compliance of all modes but the first ones at some dofs.
    fn compliance(&self, dofs: &[usize], kept: usize) -> Mat<f64> {
        let term = |i: usize, j: usize, k: usize| {
            self.shapes[(dofs[i], k)] * self.shapes[(dofs[j], k)] / self.squares[k]
        };
        // The smallest terms first.
        let sum = |i, j| (kept..self.squares.len()).rev().map(|k| term(i, j, k)).sum();
        Mat::from_fn(dofs.len(), dofs.len(), sum)
    }
}

/// Returns the deflection dofs of the free end.
fn tip(model: &Model) -> Vec<usize> {
    model.sites.iter().filter(|site| site.at[0] > 1.199).map(|site| site.dof).collect()
}

fn assert_compliance(model: &Model, modes: &AllModes, kept: usize, name: &str) {
    let tip = tip(model);
    assert_eq!(tip.len(), 5);
    let known = modes.compliance(&tip, kept);
    let computed = ContactCompliance::new(&model.system, &tip).unwrap();
    let error = (&computed.compliance - &known).norm_max() / known.norm_max();
    // The squares of the dense modes are accurate to the rounding of the largest.
    let rounding = 1e-15 * modes.squares[modes.squares.len() - 1] / modes.squares[kept];
    assert!(error < 1e-12 + rounding, "{name}, {kept} modes: {error:e}");
}

#[test]
fn the_compliance_is_the_sum_over_all_other_modes() {
    for element in ["fvs", "hct"] {
        let model = |modes| Model::new(&modal_scene(PAPER_FALL, element, [10, 4], modes, 1e-3)).unwrap();
        let all = AllModes::of(&model(20));
        for kept in [20, 50, 75] {
            assert_compliance(&model(kept), &all, kept, element);
        }
    }
}

/// The three rigid motions are modes without stiffness.
/// The displacement per reaction of a node has the same bits whichever other nodes are solved for.
#[test]
fn the_compliance_of_a_node_does_not_depend_on_other_nodes() {
    for (element, cells, modes) in [("fvs", [20, 8], 60), ("hct", [9, 4], 20)] {
        let model = Model::new(&modal_scene(PAPER_FALL, element, cells, modes, 1e-5)).unwrap();
        let dofs: Vec<usize> = model.sites.iter().map(|site| site.dof).collect();
        let all = ContactCompliance::new(&model.system, &dofs).unwrap().compliance;
        let reversed: Vec<usize> = dofs.iter().rev().copied().collect();
        let other = ContactCompliance::new(&model.system, &reversed).unwrap().compliance;
        let last = dofs.len() - 1;
        for i in 0..dofs.len() {
            for j in 0..dofs.len() {
                assert_eq!(
                    all[(i, j)].to_bits(),
                    other[(last - i, last - j)].to_bits(),
                    "{element}: {i}, {j}"
                );
            }
        }
        for i in (0..dofs.len()).step_by(7) {
            let single = ContactCompliance::new(&model.system, &[dofs[i]]).unwrap().compliance;
            assert_eq!(single[(0, 0)].to_bits(), all[(i, i)].to_bits(), "{element}: {i}");
        }
    }
}

#[test]
fn the_compliance_of_a_free_plate_is_that_of_its_other_modes() {
    let free = format!("{PAPER_PLATE}\nobstacle = [{{ side = \"below\", height = -0.1 }}]");
    for element in ["fvs", "hct"] {
        let model = |modes| Model::new(&modal_scene(&free, element, [10, 4], modes, 1e-3)).unwrap();
        let all = AllModes::of(&model(20));
        for kept in [4, 20, 60] {
            assert_compliance(&model(kept), &all, kept, element);
        }
    }
}

/// A compliant stop adds its own flexibility 1/k to the compliance of its node, whatever its
/// stiffness. Along the free edge, the two end nodes have half a cell each.
#[test]
fn a_compliant_stop_adds_its_flexibility() {
    let compliance = |stiffness: &str| {
        let line = "side = \"below\", height = -0.1, line = [[1.2, 0], [1.2, 0.4]]";
        let tables = format!("{PAPER_START}obstacle = [{{ {line}{stiffness} }}]");
        let model = Model::new(&modal_scene(&tables, "fvs", [10, 4], 40, 1e-3)).unwrap();
        let mut sites = model.sites[..5].to_vec();
        sites.sort_by(|a, b| a.at[1].total_cmp(&b.at[1]));
        let dofs: Vec<usize> = sites.iter().map(|site| site.dof).collect();
        ContactCompliance::new(&model.system, &dofs).unwrap().compliance
    };
    let rigid = compliance("");
    for stiffness in [1e3, 1e8, 1e12] {
        let stops = compliance(&format!(", stiffness = {stiffness:e}"));
        for i in 0..5 {
            for j in 0..5 {
                let length = if i == 0 || i == 4 { 0.05 } else { 0.1 };
                let own = if i == j { 1.0 / (stiffness * length) } else { 0.0 };
                let (found, expected) = (stops[(i, j)], rigid[(i, j)] + own);
                let error = (found - expected).abs() / (rigid[(2, 2)] + own);
                assert!(error <= 1e-10, "{stiffness:e}, {i}, {j}: {found:e}, {expected:e}");
            }
        }
    }
}

/// The figures were published with the method: highest mode and fastest motion in kHz, smallest
/// eigenvalue of R in m/N, to two digits.
#[test]
fn an_inspection_has_the_figures_of_an_independent_program() {
    let known = [
        ("fvs", 20, [0.98, 2.1, 2.2e-8]),
        ("fvs", 50, [3.0, 4.8, 6.1e-9]),
        ("hct", 20, [1.0, 1.9, 1.7e-8]),
        ("hct", 50, [3.4, 7.2, 3.0e-9]),
    ];
    for (element, kept, expected) in known {
        let scene = modal_scene(PAPER_FALL, element, [10, 4], kept, 1e-3);
        let inspection = study::inspect(&scene).unwrap();
        let figures = inspection.modal.as_ref().unwrap();
        assert_eq!((figures.modes, figures.touching), (kept, 5), "{element}");
        let contact = figures.contact.as_ref().unwrap();
        let found = [1e-3 * figures.highest, 1e-3 * contact.fastest, contact.compliance[0]];
        for (found, expected) in found.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 0.05, "{element}, {kept}: {found} for {expected}");
        }
        assert_eq!(inspection.singular.highest, Some(figures.highest));
        let [modal, consistent] = [&inspection.singular, &inspection.consistent].map(|of| of.lowest[0]);
        assert!((modal / consistent - 1.0).abs() < 1e-12, "{modal} and {consistent} Hz");

        // All modes give the energy of the start, and its part beyond those kept.
        let model = Model::new(&scene).unwrap();
        let all = AllModes::of(&model);
        let tip = tip(&model);
        let beyond = all.compliance(&tip, kept).self_adjoint_eigen(Side::Lower).unwrap();
        let [least, most] = [0, 4].map(|k| beyond.S().column_vector()[k]);
        assert!((contact.compliance[0] / least - 1.0).abs() < 1e-9, "{element}, {kept}");
        assert!((contact.condition / (most / least) - 1.0).abs() < 1e-9, "{element}, {kept}");
        let energies = |k: usize| {
            let start = model.start.displacement.iter().zip(all.momenta.col_as_slice(k));
            all.squares[k] * start.map(|(u, p)| u * p).sum::<f64>().powi(2)
        };
        let whole: f64 = (0..all.squares.len()).rev().map(energies).sum();
        let rest: f64 = (kept..all.squares.len()).rev().map(energies).sum();
        let share = figures.rest_of_start.unwrap();
        assert!(
            (share / (rest / whole) - 1.0).abs() < 1e-6,
            "{element}, {kept}: {share} for {}",
            rest / whole
        );

        let report = inspection.to_string();
        for row in ["frequencies, modal mass", "the fastest motion has", "compliance of the rest"] {
            assert!(report.contains(row), "{report}");
        }
        assert!(!report.contains("inf-sup") && !report.contains("singular"), "{report}");
        let json = serde_json::to_value(&inspection).unwrap();
        assert_eq!(json["modal"]["contact"]["fastest"], contact.fastest);
    }
}

/// A check has the same rows; scenes with other masses have none of them.
#[test]
fn a_check_has_the_figures_of_the_modal_mass_alone() {
    let scene = modal_scene(PAPER_FALL, "fvs", [10, 4], 20, 1e-3);
    let check = study::check(&scene).unwrap();
    let figures = check.modal.as_ref().unwrap();
    assert_eq!(check.frequencies.highest, Some(figures.highest));
    assert!(check.to_string().contains("the fastest motion has"), "{check}");
    let text = scene.resolved().replace("\"modal\"", "\"singular\"").replace("modes ", "# modes ");
    let singular = rebond::scene::Scene::from_str(&text, "plate", &[]).unwrap();
    let check = study::check(&singular).unwrap();
    assert!(check.modal.is_none() && check.to_string().contains("  highest"), "{check}");
}

/// Two modes leave nothing of the compliance at a point, one mode leaves the other's.
#[test]
fn too_many_modes_are_counted() {
    let one = ContactCompliance {
        compliance: Mat::from_fn(1, 1, |_, _| 1e-20),
        shapes: Mat::from_fn(1, 2, |_, _| 1.0),
        squares: vec![1.0, 4.0],
    };
    assert!(!one.is_definite());
    assert_eq!(one.most_modes(), 1);
    let soft = ContactCompliance { compliance: Mat::from_fn(1, 1, |_, _| 0.5), ..one };
    assert!(soft.is_definite());
    assert_eq!(soft.most_modes(), 2);
    // w^2 = 1 + 2 and 4 + 2 with the coupling 2.
    let square = 4.5 + (1.5_f64.powi(2) + 4.0).sqrt();
    let fastest = soft.fastest().unwrap() * std::f64::consts::TAU;
    assert!((fastest.powi(2) - square).abs() < 1e-13 * square);
    assert_eq!(soft.extremes().unwrap(), [0.5, 0.5]);
}
