//! Registry of the contact solvers: what each is called, on which engines it runs, and how it
//! starts.
//!
//! Scenes, studies and commands ask this registry. A new contact solver is a file of its own, which
//! implements [`Solver`](super::Solver), and a variant of [`ContactSolver`] here.

#[cfg(feature = "petsc")]
use super::{Condensed, SolverFactory, scaled::Family, snes::SNES, tao::TAO};
#[cfg(feature = "petsc")]
use crate::distributed::Distributed;
#[cfg(feature = "petsc")]
use crate::error::Result;
#[cfg(feature = "petsc")]
use crate::petsc::Context;
use serde::{Deserialize, Serialize};

/// Contact solver; a build without it refuses it later, not the scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactSolver {
    /// Active-set method on the Schur complement of the contact dofs.
    Condensed,
    /// Complementarity solver of PETSc (SNES).
    Snes,
    /// Bound-constrained minimiser of PETSc (TAO).
    Tao,
}

impl ContactSolver {
    /// All contact solvers.
    pub const ALL: [ContactSolver; 3] = [ContactSolver::Condensed, ContactSolver::Snes, ContactSolver::Tao];

    /// Returns the name in a scene.
    pub const fn name(self) -> &'static str {
        match self {
            ContactSolver::Condensed => "condensed",
            ContactSolver::Snes => "snes",
            ContactSolver::Tao => "tao",
        }
    }

    /// Returns whether every engine has the solver; otherwise only PETSc has it.
    pub const fn runs_on_any_engine(self) -> bool {
        self.method_option().is_none()
    }

    /// Returns the option of PETSc that names the solver's method; `None` where it has one method
    /// only.
    pub const fn method_option(self) -> Option<&'static str> {
        match self {
            ContactSolver::Condensed => None,
            ContactSolver::Snes => Some("snes_type"),
            ContactSolver::Tao => Some("tao_type"),
        }
    }

    /// Returns PETSc's methods; `None` for a solver that is our own.
    #[cfg(feature = "petsc")]
    fn family(self) -> Option<Family> {
        match self {
            ContactSolver::Condensed => None,
            ContactSolver::Snes => Some(SNES),
            ContactSolver::Tao => Some(TAO),
        }
    }

    /// Refuses options of PETSc that cannot solve a step, before anything is built.
    ///
    /// # Errors
    /// Returns [`crate::Error::Usage`] naming the option, or [`crate::Error::Petsc`].
    #[cfg(feature = "petsc")]
    pub fn check_options(self, context: &Context) -> Result<()> {
        self.family().map_or(Ok(()), |family| family.check_options(context))
    }

    /// Returns a factory of the solver on PETSc, which tries answers again whose KKT residual
    /// exceeds the tolerance.
    #[cfg(feature = "petsc")]
    pub fn factory(self, tolerance: f64) -> Box<SolverFactory<Distributed>> {
        match self.family() {
            None => {
                Box::new(|engine, matrix, bounded| Ok(Box::new(Condensed::new(engine, matrix, bounded)?)))
            }
            Some(family) => {
                Box::new(move |engine, matrix, bounded| family.solver(engine, matrix, bounded, tolerance))
            }
        }
    }
}
