//! The programs of `examples/` run, and each asserts a number that comes from elsewhere.

use std::fs;
use std::path::Path;

/// Declares programs, and runs each in a test.
macro_rules! programs {
    ($($path:literal $name:ident,)*) => {
        $(
            #[path = $path]
            mod $name;
        )*

        const PROGRAMS: &[&str] = &[$(stringify!($name)),*];

        /// Tests with the names of the programs.
        mod runs {
            $(
                #[test]
                fn $name() {
                    super::$name::main().unwrap();
                }
            )*
        }
    };
}

programs! {
    "../../examples/drop_on_an_obstacle.rs" drop_on_an_obstacle,
    "../../examples/exact_against_conserving.rs" exact_against_conserving,
    "../../examples/free_vibration.rs" free_vibration,
    "../../examples/moving_support.rs" moving_support,
    "../../examples/one_step_by_hand.rs" one_step_by_hand,
    "../../examples/own_mesh.rs" own_mesh,
    "../../examples/stop_at_the_first_impact.rs" stop_at_the_first_impact,
}

/// All programs are run, except for the table of the paper, which `make test` calls itself.
#[test]
fn every_program_is_short_and_runs() {
    let mut names = Vec::new();
    for entry in fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("examples")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if name == "csma2013_table" {
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.lines().count() <= 60, "{name}");
        assert!(text.contains("assert!("), "{name}");
        names.push(name);
    }
    names.sort();
    assert_eq!(names, PROGRAMS);
}
