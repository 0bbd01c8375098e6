//! Macro for safe handles: each owns a PETSc object and a reference to the context.

/// Defines a handle that owns one reference to a PETSc object; further fields start at their
/// defaults.
macro_rules! handle {
    ($(#[$doc:meta])* $name:ident $(<$life:lifetime>)?, $raw:ident, $destroy:ident $(, $field:ident: $type:ty)*) => {
        $(#[$doc])*
        pub struct $name $(<$life>)? {
            pub(super) raw: $crate::petsc::sys::$raw,
            pub(super) context: std::rc::Rc<$crate::petsc::Context>,
            $(pub(super) $field: $type,)*
        }

        impl $(<$life>)? $name $(<$life>)? {
            /// Wraps a reference that PETSc handed over.
            pub(super) fn owning(
                raw: $crate::petsc::sys::$raw,
                context: &std::rc::Rc<$crate::petsc::Context>,
            ) -> Self {
                Self { raw, context: context.clone(), $($field: Default::default(),)* }
            }

            /// Wraps an object that PETSc only lent, and adds a reference to it.
            #[allow(dead_code)] // PETSc lends some kinds of object, not all.
            pub(super) fn sharing(
                raw: $crate::petsc::sys::$raw,
                context: &std::rc::Rc<$crate::petsc::Context>,
            ) -> $crate::Result<Self> {
                $crate::petsc::error::call!(PetscObjectReference(raw.cast()))?;
                Ok(Self::owning(raw, context))
            }

            /// Returns the context that the handle keeps alive.
            pub fn context(&self) -> &std::rc::Rc<$crate::petsc::Context> {
                &self.context
            }
        }

        impl $(<$life>)? std::fmt::Debug for $name $(<$life>)? {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.debug_struct(stringify!($name)).field("raw", &self.raw).finish_non_exhaustive()
            }
        }

        impl $(<$life>)? Drop for $name $(<$life>)? {
            fn drop(&mut self) {
                // A drop cannot return an error code, and the object is gone in any case.
                let _ = $crate::petsc::error::call!($destroy(&mut self.raw));
            }
        }
    };
}
pub(super) use handle;
