//! The matrices of a scene as files, for other programs to check or to use.

use crate::assembly;
use crate::error::{Error, Result};
use crate::linalg::{Form, Native};
use crate::output::{matrix_market, write_atomic};
use crate::scene::{Load, Scene};
use crate::simulation;
use crate::space::{PER_NODE, Space};
use std::fmt::Write;
use std::path::Path;

/// Writes `K.mtx M_r.mtx M.mtx B.mtx C.mtx G.mtx F.mtx`, `nodes.csv` and `cells.csv` into a folder, which is made if need be.
///
/// All dofs before supports, three a node: rows 3 n + 1 to 3 n + 3 of K are w, w_x, w_y of node n, which counts from 0 as in
/// `nodes.csv`. G has a row for each free deflection that an obstacle bounds (each free one where there is no obstacle),
/// B one a cell. F is the load of `initial.static_pressure` or, where that is 0, of `[load]`. SI units.
///
/// # Errors
/// [`Error::Mesh`] for a mesh that cannot carry the elements, [`Error::Io`] for a file that cannot be written.
pub fn write_matrices(scene: &Scene, folder: &Path) -> Result<()> {
    let mesh = simulation::mesh(scene)?;
    let supported = simulation::space(scene, &mesh)?;
    let space = Space::unsupported(&mesh);
    let cells = assembly::cells(&mesh, &space, &scene.plate.plate)?;
    let dofs = space.dofs();
    let engine = Native::new(dofs);
    std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
    let write = |name: &str, size, entries| matrix_market::write(&folder.join(name), size, entries);

    write("K.mtx", [dofs; 2], symmetric(&engine.form(assembly::stiffness(&cells))))?;
    write("M_r.mtx", [dofs; 2], symmetric(&engine.form(assembly::consistent_mass(&cells))))?;
    write("M.mtx", [dofs; 2], symmetric(&engine.averages(assembly::singular_mass(&cells))))?;

    let (mut b, mut c) = (Vec::new(), Vec::new());
    for (number, row) in assembly::singular_mass(&cells).iter().enumerate() {
        b.extend(
            row.dofs.iter().zip(row.row.iter()).filter_map(|(dof, value)| Some((number, (*dof)?, *value))),
        );
        c.push((number, number, row.mass));
    }
    write("B.mtx", [cells.len(), dofs], b)?;
    write("C.mtx", [cells.len(); 2], c)?;

    let bounded = simulation::bounds(scene, supported.deflections().map(|(dof, _)| dof)).dofs;
    let reach = |dof: &usize| bounded.is_empty() || bounded.binary_search(dof).is_ok();
    let nodes = supported.deflections().filter(|(dof, _)| reach(dof)).map(|(_, node)| node);
    let g: Vec<_> = nodes.enumerate().map(|(row, node)| (row, PER_NODE * node, 1.0)).collect();
    write("G.mtx", [g.len(), dofs], g)?;

    let pressure = match (scene.initial.static_pressure, scene.load) {
        (0.0, Some(Load { pressure })) => pressure,
        (pressure, _) => pressure,
    };
    let load = assembly::uniform_load(&cells, dofs, pressure);
    write("F.mtx", [dofs, 1], load.into_iter().enumerate().map(|(dof, f)| (dof, 0, f)).collect())?;

    let mut text = "node,x,y\n".to_owned();
    for (number, node) in mesh.nodes.iter().enumerate() {
        let _ = writeln!(text, "{number},{:.16e},{:.16e}", node.x, node.y);
    }
    write_atomic(&folder.join("nodes.csv"), text.as_bytes())?;
    let mut text = "cell,a,b,c,d\n".to_owned();
    for (number, cell) in mesh.cells.iter().enumerate() {
        let [a, b, c, d] =
            std::array::from_fn(|i| cell.nodes().get(i).map_or(String::new(), usize::to_string));
        let _ = writeln!(text, "{number},{a},{b},{c},{d}");
    }
    write_atomic(&folder.join("cells.csv"), text.as_bytes())
}

/// All entries of a form, both triangles.
fn symmetric(form: &Form) -> Vec<(usize, usize, f64)> {
    let mut entries = Vec::new();
    form.for_each_lower(|row, column, entry| {
        entries.push((row, column, entry));
        if row != column {
            entries.push((column, row, entry));
        }
    });
    entries
}
