//! PETSc's handles and meshes, on 1 to 4 ranks.

#[path = "../common/mod.rs"]
mod common;

mod handles;
mod mesh;

fn main() -> std::process::ExitCode {
    common::ranks::main(handles::CASES.iter().chain(mesh::CASES))
}
