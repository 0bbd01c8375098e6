//! PETSc's handles and meshes, and hard scenes, on 1 to 4 ranks.

#[path = "../common/mod.rs"]
mod common;

mod handles;
mod hard;
mod mesh;

fn main() -> std::process::ExitCode {
    common::ranks::main(handles::CASES.iter().chain(mesh::CASES).chain(hard::CASES))
}
