//! Bindings that bindgen generates from PETSc's headers, for use in this folder only.

#![allow(unsafe_code)]
#![allow(
    missing_docs,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    dead_code,
    unused_imports,
    unnecessary_transmutes,
    unsafe_op_in_unsafe_fn,
    clippy::all
)]

include!(concat!(env!("OUT_DIR"), "/petsc.rs"));

/// Converts to PETSc's truth value: an enumeration, or C's bool since release 3.24.
pub fn truth(value: bool) -> PetscBool {
    value.into()
}

/// Proves at compile time that two types are the same.
const fn same<T>(_: std::marker::PhantomData<(T, T)>) {}

const _: () = {
    use std::marker::PhantomData;
    same::<i32>(PhantomData::<(PetscInt, PetscInt)>);
    same::<f64>(PhantomData::<(PetscScalar, PetscScalar)>);
    same::<f64>(PhantomData::<(PetscReal, PetscReal)>);
};
