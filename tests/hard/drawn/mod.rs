//! Random scenes, judged without a reference solution: by the same scene seen in a mirror, turned,
//! upside down, in other units, from a moving frame or written otherwise, by laws (energy,
//! equilibrium, linearity), by another scheme and engine, and by an interruption.

mod comparison;
mod oracles;
mod scene;
mod toml;
mod view;

use comparison::{folder, moves_alike, run};
use oracles::{
    doubles, has_no_absolute_velocity, keeps_its_energy, schemes_meet, stays_at_rest,
    survives_an_interruption,
};
use scene::draw;
use view::{PLAIN, VIEWS};

/// Judges the scenes of some seeds. Returns how many run.
fn judge(test: &str, seeds: std::ops::Range<u64>) -> usize {
    let mut runs = 0;
    for seed in seeds {
        let folder = folder(&format!("{test}-{seed}"));
        let drawn = draw(seed);
        let plain_toml = drawn.toml(&PLAIN, "");
        let plain = run(&folder, "plain", &plain_toml);
        let mut others: Vec<_> = VIEWS.map(|(name, view)| (name, view, drawn.toml(&view, ""))).into();
        if cfg!(feature = "petsc") && drawn.scheme != "exact" && seed % 3 == 1 {
            others.push(("petsc", PLAIN, plain_toml.replace("\"native\"", "\"petsc\"")));
        }
        for (name, view, toml) in others {
            let seen = run(&folder, &name.replace(' ', "-"), &toml);
            match (&plain, &seen) {
                (Ok(plain), Ok(seen)) => moves_alike(&drawn, &folder, [plain, seen], &view, name),
                (plain, seen) => assert_eq!(
                    plain.is_err(),
                    seen.is_err(),
                    "{}: {name}: {plain:?}, {seen:?}",
                    folder.display()
                ),
            }
        }
        let Ok(plain) = plain else { continue };
        runs += 1;
        if matches!(drawn.scheme, "conserving" | "exact") {
            keeps_its_energy(&drawn, &plain, &folder);
        }
        if seed % 3 == 0 {
            survives_an_interruption(&drawn, &folder);
        }
        stays_at_rest(&drawn, &folder);
        doubles(&drawn, &folder);
        has_no_absolute_velocity(&drawn, &folder);
        if seed % 4 == 1 {
            schemes_meet(&drawn, &folder);
        }
    }
    runs
}

#[test]
fn drawn_scenes_move_alike_however_they_are_seen() {
    let runs = judge("few", 0..32);
    assert!(runs >= 24, "{runs} run");
}

#[test]
#[ignore = "minutes"]
fn many_drawn_scenes_move_alike_however_they_are_seen() {
    judge("many", 1000..2000);
}
