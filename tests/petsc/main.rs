//! PETSc's handles and meshes, hard scenes and ends of runs, on 1 to 4 ranks.

#[path = "../common/mod.rs"]
mod common;

mod handles;
mod hard;
mod mesh;
mod runs;

fn main() -> std::process::ExitCode {
    common::ranks::main(handles::cases().chain(mesh::CASES).chain(hard::CASES).chain(runs::CASES))
}
