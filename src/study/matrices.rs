//! Export of the matrices of a scene for other programs.

use crate::dof_map::PER_NODE;
use crate::error::{Error, Result};
use crate::input;
use crate::linalg::{Form, Native};
use crate::output::{matrix_market, write_atomic};
use crate::scene::Scene;
use crate::simulation::{self, Matrices};
use std::fmt::Write;
use std::path::Path;

/// Names of the files that [`write_matrices`] writes.
pub const MATRICES: [&str; 10] =
    ["K.mtx", "M_r.mtx", "M.mtx", "B.mtx", "C.mtx", "G.mtx", "F.mtx", "nodes.csv", "cells.csv", "scene.toml"];

/// Returns whether a folder holds the matrices of a scene: its `scene.toml` is the resolved scene.
pub fn matrices_are_of(scene: &Scene, folder: &Path) -> bool {
    input::read_plain(&folder.join("scene.toml")).is_ok_and(|bytes| bytes == scene.resolved().as_bytes())
}

/// Writes the matrices of a scene, its mesh and the resolved scene into a folder.
///
/// The files are `K.mtx M_r.mtx M.mtx B.mtx C.mtx G.mtx F.mtx`, `nodes.csv`, `cells.csv` and
/// `scene.toml`; the folder is created if necessary. The dofs are those before supports, three per
/// node: rows 3 n + 1 to 3 n + 3 of K are w, w_x, w_y of node n, which counts from 0 as in
/// `nodes.csv`; the gaps of balls and the tips of compliant stops come last. G has one row per free
/// deflection or tip that an obstacle bounds (per free deflection if there is no obstacle), B one
/// row per cell, mass and ball. F is the load of `initial.static_pressure` or, where that is 0, the
/// constant part of `[load]`. All quantities are in SI units.
///
/// # Errors
/// Returns [`Error::Mesh`] for a mesh that cannot carry the elements, and [`Error::Io`] for a file
/// that cannot be written.
pub fn write_matrices(scene: &Scene, folder: &Path) -> Result<()> {
    let mesh = simulation::mesh(scene)?;
    let Matrices { stiffness, consistent, singular, load, bounded } =
        simulation::matrices(scene, &mesh, false)?;
    let dofs = load.len();
    let engine = Native::new(dofs);
    std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
    write_atomic(&folder.join("scene.toml"), scene.resolved().as_bytes())?;
    let write = |name: &str, size, entries| matrix_market::write(&folder.join(name), size, entries);

    write("K.mtx", [dofs; 2], symmetric(&engine.form(stiffness)))?;
    write("M_r.mtx", [dofs; 2], symmetric(&engine.form(consistent)))?;
    let (mut b, mut c) = (Vec::new(), Vec::new());
    for (number, row) in singular.iter().enumerate() {
        b.extend(
            row.dofs.iter().zip(row.row.iter()).filter_map(|(dof, value)| Some((number, (*dof)?, *value))),
        );
        c.push((number, number, row.mass));
    }
    write("M.mtx", [dofs; 2], symmetric(&engine.averages(singular)))?;
    write("B.mtx", [c.len(), dofs], b)?;
    write("C.mtx", [c.len(); 2], c)?;

    // Rows of G are the deflections that the supports leave free.
    let space = simulation::space(scene, &mesh)?;
    let free =
        |dof: &usize| *dof >= PER_NODE * mesh.nodes.len() || space.deflection(dof / PER_NODE).is_some();
    let deflections = || (0..mesh.nodes.len()).map(|node| PER_NODE * node);
    let rows: Vec<usize> = if bounded.is_empty() { deflections().collect() } else { bounded };
    let g: Vec<_> = rows.into_iter().filter(free).enumerate().map(|(row, dof)| (row, dof, 1.0)).collect();
    write("G.mtx", [g.len(), dofs], g)?;
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

/// Returns all entries of a form, both triangles.
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
