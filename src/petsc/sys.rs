//! What bindgen made of PETSc's headers; nothing here is for use outside this folder.

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

/// PETSc's truth value: a number, or from release 3.24 on C's own bool.
pub fn truth(value: bool) -> PetscBool {
    value.into()
}

/// Proves at compile time that two types are one.
const fn same<T>(_: std::marker::PhantomData<(T, T)>) {}

const _: () = {
    use std::marker::PhantomData;
    same::<i32>(PhantomData::<(PetscInt, PetscInt)>);
    same::<f64>(PhantomData::<(PetscScalar, PetscScalar)>);
    same::<f64>(PhantomData::<(PetscReal, PetscReal)>);
};
