//! Part that the solvers between bounds, SNES and TAO, have in common.

#![allow(unsafe_code)]

/// Defines a solver between bounds with one closure for its function and one for the derivative of
/// that function, in the order: name, type of PETSc, type of the first closure, method that sets
/// the second one, and functions of PETSc.
macro_rules! bounded_solver {
    (
        $(#[$doc:meta])* $name:ident, $raw:ident, $function:ty, $set_derivative:ident,
        $create:ident, $destroy:ident, $set_prefix:ident, $set_type:ident, $set_matrix:ident, $set_bounds:ident,
        $set_from_options:ident, $iterations:ident
    ) => {
        $crate::petsc::handle::handle! {
            $(#[$doc])*
            ///
            /// The closures may borrow for `'a`. An error or a panic in one of them ends the solve
            /// with that error. With several ranks, every rank must return the error, and a panic
            /// ends the program. Creating and dropping the solver is collective.
            $name<'a>, $raw, $destroy, prefix: String, failure: Failure, function: CallbackSlot<$function>,
            derivative: CallbackSlot<dyn FnMut(&Vector, &mut Matrix) -> Result<()> + 'a>
        }

        impl<'a> $name<'a> {
            /// Creates a solver that reads the options of its own, of its linear solver and of that
            /// one's preconditioner, all with a prefix. Collective.
            ///
            /// # Errors
            /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
            pub fn new(context: &Rc<Context>, prefix: &str) -> Result<Self> {
                let mut solver = Self::owning(get!($create(context.raw()))?, context);
                solver.prefix = prefix.into();
                call!($set_prefix(solver.raw, Prefix::new(prefix)?.pointer()))?;
                context.note_prefix(prefix);
                Ok(solver)
            }

            /// Sets the method, which options override if [`Self::set_from_options`] comes later.
            /// Collective.
            ///
            /// # Errors
            /// Returns [`crate::Error::Petsc`] where there is no such method.
            pub fn set_type(&mut self, name: &str) -> Result<()> {
                call!($set_type(self.raw, c_string(name)?.as_ptr()))
            }

            /// Sets the matrix of derivatives, which the closure updates for a new x. Collective.
            ///
            /// `matrix` holds its value for the first step. A constant one needs a closure that
            /// does nothing, except with `vinewtonssls`, which scales the matrix in place.
            ///
            /// # Errors
            /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
            pub fn $set_derivative(
                &mut self,
                matrix: &Matrix,
                update: impl FnMut(&Vector, &mut Matrix) -> Result<()> + 'a,
            ) -> Result<()> {
                let (raw, matrix) = (self.raw, matrix.raw);
                self.derivative.set(&self.context, &self.failure, Box::new(update), |state| {
                    call!($set_matrix(raw, matrix, matrix, Some(call_derivative), state))
                })
            }

            /// Sets the bounds; an absent one is minus or plus [`crate::petsc::INFINITY`].
            /// Collective.
            ///
            /// # Errors
            /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
            pub fn set_bounds(&mut self, lower: &Vector, upper: &Vector) -> Result<()> {
                call!($set_bounds(self.raw, lower.raw, upper.raw))
            }

            /// Solves between bounds from the start in `x`, which then holds the last iterate, and
            /// returns why the solve ended and the number of its iterations. Collective.
            ///
            /// # Errors
            /// Returns the errors of [`Self::solve`].
            pub fn solve_between(
                &mut self,
                lower: &Vector,
                upper: &Vector,
                x: &mut Vector,
            ) -> Result<(Reason, usize)> {
                self.set_bounds(lower, upper)?;
                self.solve(x)?;
                Ok((self.reason()?, self.iterations()?))
            }

            /// Reads the options. Collective.
            ///
            /// # Errors
            /// Returns [`crate::Error::Petsc`] where an option has an impossible value.
            pub fn set_from_options(&mut self) -> Result<()> {
                call!($set_from_options(self.raw))
            }

            /// Returns the number of iterations of the last solve.
            ///
            /// # Errors
            /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
            pub fn iterations(&self) -> Result<usize> {
                Ok(get!($iterations(self.raw))? as usize)
            }
        }

        unsafe extern "C" fn call_derivative(
            _: sys::$raw,
            x: sys::Vec,
            _: sys::Mat,
            matrix: sys::Mat,
            state: *mut c_void,
        ) -> sys::PetscErrorCode {
            // SAFETY: `state` is the callback that the solver registered, and lives as long as the
            // solver. Only this function borrows it, never twice: a closure cannot reach its own
            // solver.
            let callback =
                unsafe { &mut *state.cast::<Callback<dyn FnMut(&Vector, &mut Matrix) -> Result<()>>>() };
            let Callback { context, failure, run } = callback;
            guard(failure, || run(&Vector::sharing(x, context)?, &mut Matrix::sharing(matrix, context)?))
        }
    };
}
pub(super) use bounded_solver;
