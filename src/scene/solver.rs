//! Table `[solver]`: linear algebra, contact solver and tolerances.

use super::entry::table;
use super::kinds::{within, word};
use super::{ContactSolver, EngineName, LinearSolver};

table! {
    /// Solver of the steps and its tolerances.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Solver {
        /// Linear algebra: `"native"` (one process) or `"petsc"`; the default depends on the number
        /// of processes.
        engine: EngineName = word().or_else(|doc| Ok(doc.engine));
        /// With `"petsc"`, how linear systems are solved: `"direct"` by factors; `"multigrid"` by
        /// conjugate gradients with geometric multigrid, on a mesh that is refined or that can be
        /// coarsened, see [PETSc](petsc.md#multigrid); `"auto"`: by factors, unless the least
        /// memory that they need is more than half of what is left. `rebond check` tells the
        /// choice.
        linear: LinearSolver = word().or(LinearSolver::Auto);
        /// Contact solver; with `"petsc"` also `"snes"` and `"tao"`.
        vi: ContactSolver = word().or(ContactSolver::Condensed);
        /// Relative KKT residual that every step must meet; between 0 and 1.
        tolerance: f64 =
            within("a relative KKT residual", "", &[("exclusiveMinimum", 0.0), ("exclusiveMaximum", 1.0)])
                .says("relative KKT residual of each step").or(1e-10);
        /// Ratio of the energy to the initial energy at which a run is stopped; greater than 1.
        /// Where loads, obstacles or supports change with time, it also bounds the kinetic and the
        /// elastic energy, since their work hides a growth in the total. This bound is the same
        /// multiple of the plate's kinetic energy at a tenth of its speed of sound, sqrt(E / rho),
        /// or of the initial energy if that is larger.
        energy_guard: f64 = within("a ratio of energies", "", &[("exclusiveMinimum", 1.0)])
            .says("energy over its start that stops a run").or(100.0);
    }
}
