//! Choice of the linear solver on PETSc, and the coarse meshes of multigrid.

use super::meshing;
#[cfg(feature = "petsc")]
use crate::communicator::Communicator;
#[cfg(feature = "petsc")]
use crate::error::{Error, Result};
use crate::linalg::LinearMethod;
use crate::memory;
use crate::mesh::{Diagonal, Mesh};
#[cfg(feature = "petsc")]
use crate::petsc::Context;
use crate::scene::{ContactSolver, EngineName, Grid, LinearSolver, Scene};
use serde::Serialize;

/// Number of rectangles per rank down to which a grid is coarsened. The coarsest mesh is factored,
/// and each rank should have cells of it.
const COARSEST: usize = 20;

/// Method by which PETSc solves the linear systems of a scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LinearChoice {
    /// Method, unless PETSc's option `-pc_type` chooses another one.
    pub method: LinearMethod,
    /// Reason, as a part of a sentence.
    pub reason: String,
}

/// Returns the linear solver of a scene on one rank; `None` on the native engine, which factors.
pub(crate) fn linear_choice(scene: &Scene, mesh: &Mesh) -> Option<LinearChoice> {
    let before = meshing::kinds(mesh).map(|count| count >> (2 * scene.mesh.refine));
    let halvings = if scene.file.is_some() { 0 } else { halvings(&scene.mesh, 1) };
    let is_petsc = scene.solver.engine == EngineName::Petsc;
    is_petsc.then(|| choose(scene, before, scene.mesh.refine + halvings, 1))
}

/// Chooses the linear solver of a mesh of `cells` triangles and quadrilaterals before refinement,
/// which has passed some coarser `levels`.
fn choose(scene: &Scene, cells: [u64; 2], levels: u32, ranks: usize) -> LinearChoice {
    let direct = |reason: String| LinearChoice { method: LinearMethod::Direct, reason };
    let multigrid = |reason: String| LinearChoice { method: LinearMethod::Multigrid, reason };
    let named = || format!("solver.linear = \"{}\"", scene.solver.linear);
    match scene.solver.linear {
        LinearSolver::Direct => direct(named()),
        LinearSolver::Multigrid => multigrid(named()),
        LinearSolver::Auto if levels == 0 => direct("the mesh has no coarser ones".into()),
        LinearSolver::Auto if scene.solver.vi != ContactSolver::Condensed => {
            direct(format!("solver.vi = \"{}\" needs factors", scene.solver.vi))
        }
        LinearSolver::Auto => match meshing::memory_with_factors(scene, cells, ranks) {
            Some([needed, free]) => {
                let [least, room] = [needed, free].map(memory::size);
                if needed > free / 2 {
                    multigrid(format!("factors need {least} at least, more than half of the {room} left"))
                } else {
                    direct(format!("factors need {least} at least, less than half of the {room} left"))
                }
            }
            None => direct("the memory left is not known".into()),
        },
    }
}

/// Returns whether geometric multigrid solves the linear systems of a mesh of `cells` triangles and
/// quadrilaterals before refinement, which has passed some coarser `levels`. Collective.
///
/// PETSc's option `-pc_type` goes before the scene.
///
/// # Errors
/// Returns [`Error::Usage`] for multigrid on a mesh without coarser ones.
#[cfg(feature = "petsc")]
pub(super) fn uses_multigrid(scene: &Scene, context: &Context, cells: [u64; 2], levels: u32) -> Result<bool> {
    let comm = context.comm();
    let multigrid = match context.option("pc_type")? {
        Some(kind) => kind == "mg",
        None => {
            let chosen = choose(scene, cells, levels, comm.size()).method == LinearMethod::Multigrid;
            // The memory of the machines may differ.
            comm.all_reduce_any(chosen)
        }
    };
    if multigrid && levels == 0 {
        return Err(Error::Usage(
            "solver.linear = \"multigrid\" needs coarser meshes, which this one does not have; expected mesh.refine above 0, or \
             a rectangle with even numbers in mesh.cells, one diagonal, and no obstacle or support between its nodes"
                .into(),
        ));
    }
    Ok(multigrid)
}

/// Returns how often a grid can be coarsened, so that refinement gives it back.
pub(super) fn halvings(grid: &Grid, ranks: usize) -> u32 {
    if grid.diagonal == Some(Diagonal::Alternating) {
        return 0;
    }
    let [mut nx, mut ny] = grid.cells;
    let mut halvings = 0;
    while nx % 2 == 0 && ny % 2 == 0 && nx / 2 * (ny / 2) >= COARSEST * ranks {
        (nx, ny, halvings) = (nx / 2, ny / 2, halvings + 1);
    }
    halvings
}
