//! Products cell by cell: the order of the dofs in the engine's own vectors changes nothing but
//! rounding.

use crate::common::models::plate;
use crate::common::plates::{Alternating, CLAMPED_LEFT, Fvs, Hct, Matrices, Right, all_round};
use rebond::assembly;
use rebond::dof_map::Support;
use rebond::linalg::{Engine, Form, LinearCombination, Native};
use rebond::mesh::Mesh;

/// Largest difference of two products, relative to the magnitude of their terms.
const TOLERANCE: f64 = 1e-14;

/// Forms over the same cells, and a mass of every third cell alone.
struct Forms {
    engine: Native,
    stiffness: Form,
    consistent: Form,
    singular: Form,
    some: Form,
}

impl Forms {
    fn new(engine: Native, plate: &Matrices) -> Forms {
        let masses = assembly::consistent_mass(&plate.cells);
        let some = masses.iter().step_by(3).cloned().collect();
        // A product with a few cells has a small work space, which grows with those of all.
        let few = engine.form(masses[..5].to_vec());
        let ones = vec![1.0; engine.dofs()];
        engine.multiply(&few, &ones, &mut vec![0.0; engine.dofs()]).unwrap();
        Forms {
            stiffness: engine.form(assembly::stiffness(&plate.cells)),
            consistent: engine.form(masses),
            singular: engine.averages(assembly::singular_mass(&plate.cells)),
            some: engine.form(some),
            engine,
        }
    }

    fn sum(&self) -> LinearCombination<'_> {
        &self.stiffness * 0.5 + &self.consistent * 3e7 + &self.some * 1e8 + &self.singular * 2e7
    }

    /// Returns all products with a vector, each with its name.
    fn products(&self, x: &[f64]) -> Vec<(&'static str, Vec<f64>)> {
        let zeros = || vec![f64::NAN; x.len()];
        let mut products = Vec::new();
        for (name, form) in [("K", &self.stiffness), ("M", &self.consistent), ("M_r", &self.singular)] {
            let mut y = zeros();
            let value = self.engine.multiply(form, x, &mut y).unwrap();
            products.extend([(name, y), ("x^T A x", vec![value])]);
        }
        let sum = self.sum();
        let (mut y, mut m) = (zeros(), zeros());
        self.engine.multiply_with_magnitude(&sum, x, [&mut y, &mut m]).unwrap();
        let mut parts = [zeros(), zeros()];
        let [all, part] = &mut parts;
        assert!(self.engine.multiply_with_part(&sum, &self.stiffness, x, [all, part]).unwrap());
        let mut velocities = vec![f64::NAN; self.engine.velocities(&self.singular)];
        let mut momentum = zeros();
        self.engine.project(&self.singular, x, &mut velocities).unwrap();
        self.engine.project_transpose(&self.singular, &velocities, &mut momentum).unwrap();
        let [all, part] = parts;
        products.extend([("sum", y), ("magnitude", m), ("sum with K", all), ("part K", part)]);
        products.extend([("V", velocities), ("B^T V", momentum)]);
        products
    }
}

/// The lines of a fine mesh enter and leave a small work space; a coarse mesh, and vectors in the
/// order of the dofs, have all of it there. What one product leaves there does not reach the next,
/// even if it was not a number.
#[test]
fn products_do_not_depend_on_the_order_of_the_dofs() {
    let clamped = all_round(Support::Clamped);
    let supported = all_round(Support::SimplySupported);
    let cases = [
        ([10, 4], Fvs, Right, CLAMPED_LEFT),
        ([64, 13], Fvs, Right, &supported),
        ([61, 14], Hct, Right, &clamped),
        ([23, 40], Hct, Alternating, &supported),
        ([95, 8], Hct, Right, &[]),
        ([8, 90], Fvs, Right, CLAMPED_LEFT),
    ];
    for (cells, element, diagonal, supports) in cases {
        let mesh = Mesh::rectangle(1.2, 0.4, cells, element, diagonal).unwrap();
        let matrices = Matrices::new(mesh, plate(), supports);
        let dofs = matrices.space.dofs();
        let laid_out = Forms::new(Native::with_layout(matrices.space.layout(&matrices.mesh)), &matrices);
        let plain = Forms::new(Native::new(dofs), &matrices);
        laid_out.products(&vec![f64::NAN; dofs]);
        let x: Vec<f64> = (0..dofs).map(|dof| (1.0 + 12.9898 * dof as f64).sin()).collect();
        for ((name, own), (_, other)) in laid_out.products(&x).iter().zip(plain.products(&x)) {
            let largest = other.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
            for (own, other) in own.iter().zip(&other) {
                let error = (own - other).abs() / largest;
                assert!(error <= TOLERANCE, "{cells:?} {element:?} {name}: {error:.1e}");
            }
        }
    }
}
