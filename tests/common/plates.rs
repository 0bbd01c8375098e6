//! Plates for tests, as forms on the native engine.

use super::models::{plate, unit_plate};
use rebond::assembly::{self, CellArrays, Probe};
use rebond::dof_map::{DofMap, Support};
use rebond::linalg::{Form, Native};
use rebond::mesh::{Diagonal, ElementKind, Mesh, Point};
use rebond::obstacle::Bounds;
use rebond::plate::Plate;
use rebond::scheme;

pub use Diagonal::{Alternating, Left, Right};
pub use ElementKind::{Fvs, Hct};

pub const CLAMPED_LEFT: &[(&str, Support)] = &[("left", Support::Clamped)];

pub fn all_round(support: Support) -> [(&'static str, Support); 4] {
    ["left", "right", "bottom", "top"].map(|edge| (edge, support))
}

pub struct Matrices {
    pub mesh: Mesh,
    pub space: DofMap,
    pub cells: Vec<CellArrays>,
    pub engine: Native,
    pub stiffness: Form,
    pub consistent: Form,
    pub singular: Form,
}

impl Matrices {
    pub fn new(mesh: Mesh, plate: Plate, supports: &[(&str, Support)]) -> Matrices {
        let space = DofMap::new(&mesh, supports.iter().copied()).unwrap();
        let cells = assembly::cells(&mesh, &space, &plate).unwrap();
        let engine = Native::new(space.dofs());
        let stiffness = engine.form(assembly::stiffness(&cells));
        let consistent = engine.form(assembly::consistent_mass(&cells));
        let singular = engine.averages(assembly::singular_mass(&cells));
        Matrices { mesh, space, cells, engine, stiffness, consistent, singular }
    }

    /// Returns the paper's plate, clamped on the left edge.
    pub fn paper(cells: [usize; 2], element: ElementKind, diagonal: Diagonal) -> Matrices {
        let mesh = Mesh::rectangle(1.2, 0.4, cells, element, diagonal).unwrap();
        Matrices::new(mesh, plate(), CLAMPED_LEFT)
    }

    /// Returns a unit square with D = 1 and a mass of 1.
    pub fn square(cells: usize, element: ElementKind, supports: &[(&str, Support)]) -> Matrices {
        let mesh = Mesh::rectangle(1.0, 1.0, [cells; 2], element, Right).unwrap();
        Matrices::new(mesh, unit_plate(0.3), supports)
    }

    /// Returns the equilibrium under a uniform pressure.
    pub fn statics(&self, pressure: f64) -> Vec<f64> {
        let load = assembly::uniform_load(&self.cells, self.space.dofs(), pressure);
        let (u, _, _) =
            scheme::equilibrium(&self.engine, &self.stiffness, &load, &Bounds::default()).unwrap();
        u
    }

    /// Returns the deflection at a point.
    pub fn at(&self, u: &[f64], x: f64, y: f64) -> f64 {
        Probe::new(&self.mesh, &self.space, Point::new(x, y)).unwrap().deflection(u)
    }

    /// Returns all free deflection dofs.
    pub fn deflections(&self) -> Vec<usize> {
        self.space.deflections().map(|(dof, _)| dof).collect()
    }
}

/// Asserts that a value is within a relative tolerance of the expected one.
#[track_caller]
pub fn close(what: &str, value: f64, expected: f64, tolerance: f64) {
    let error = (value / expected - 1.0).abs();
    assert!(error <= tolerance, "{what}: {value:.15e}, expected {expected:.15e}: relative error {error:.1e}");
}
