//! A mesh of one's own and its modes, without a scene: a clamped disc drawn in Gmsh.
//!
//! The mesh file names its edge "rim". The lowest natural frequency of a clamped disc of radius a
//! is `$\omega = 10.2158 \sqrt{D / \rho h} / a^2$` (A. W. Leissa, Vibration of plates, NASA SP-160,
//! 1969). The mesh is a polygon, which is compared with the disc of the same area.

use rebond::dof_map::{DofMap, Support};
use rebond::linalg::Native;
use rebond::mesh::{Import, Mesh};
use rebond::plate::Plate;
use rebond::{assembly, modes};

const MESH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/gallery/disc.msh");

pub(crate) fn main() -> rebond::Result<()> {
    // Thickness in m, Young's modulus in Pa, Poisson's ratio, density in kg/m3.
    let plate = Plate::isotropic(2e-3, 210e9, 0.3, 7800.0);
    let mut mesh = Mesh::load(MESH, Import::default())?;
    let area: f64 = (0..mesh.cells.len()).map(|cell| mesh.area(cell)).sum();
    let leissa = 10.2158 * (plate.rigidity() / plate.surface_density()).sqrt() / (2.0 * area);

    let mut error = f64::INFINITY;
    for _ in 0..3 {
        // The deflection and two slopes at each node, except those that the rim holds.
        let dofs = DofMap::new(&mesh, [("rim", Support::Clamped)])?;
        let cells = assembly::cells(&mesh, &dofs, &plate)?;
        let engine = Native::with_layout(dofs.layout(&mesh));
        let stiffness = engine.form(assembly::stiffness(&cells));
        let mass = engine.form(assembly::consistent_mass(&cells));
        let computed = modes::lowest(&engine, [&stiffness, &mass], 4, false)?;

        error = computed[0] / leissa - 1.0;
        println!("{:6} triangles: {computed:9.3?} Hz, error of the first {error:8.1e}", cells.len());
        mesh = mesh.refine();
    }
    assert!(error.abs() < 2e-3);
    Ok(())
}
