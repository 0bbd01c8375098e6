#!/usr/bin/env python3
"""Proves that the tests detect faults.

The script plants faults in a copy of the sources, each behind a switch, builds the copy once, and requires that
the tests of each fault fail where its switch is on, and pass where no switch is.

    scripts/planted_faults.py                     # all faults
    scripts/planted_faults.py restitution bound   # the faults whose names contain one of these words
    scripts/planted_faults.py --texts             # only that every fault still fits the sources

A fault replaces a piece of source text that must occur exactly once. When the sources change, the script
therefore fails instead of giving a wrong answer.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Folder of the copy's build, apart from that of the sources, whose program it would replace.
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "planted_faults"
COPY = TARGET / "source"

# Variable of the environment that names the fault whose switch is on.
VARIABLE = "REBOND_PLANTED_FAULT"

# Function of the copy that reads the switch.
SWITCH = """
pub(crate) fn is_planted(fault: &str) -> bool {
    static PLANTED: std::sync::OnceLock<Option<String>> = std::sync::OnceLock::new();
    PLANTED.get_or_init(|| std::env::var("%s").ok()).as_deref() == Some(fault)
}
""" % VARIABLE

# Each fault has a name, a file, a text, its replacement, a test program, and part of the names of its
# tests. In the replacement {planted} is the switch, and {if} begins an expression of the faulty and of the
# sound value.
FAULTS = [
    ("1 % in the stiffness", "src/plate.rs", "(stiffness + stiffness.transpose()) / 2.0",
     "(stiffness + stiffness.transpose()) / {if} { 1.98 } else { 2.0 }", "plate", "matrices::the_plate_of_the_paper"),
    ("2 % in the root of the stiffness", "src/plate.rs", "let strain = bending.cholesky()?",
     "let strain = {if} { 1.01 } else { 1.0 } * bending.cholesky()?", "plate", "a_strip_without_poisson_is_a_beam"),
    ("1 % in the slopes of the basis", "src/element/mod.rs", "ordinate[3 * i + 1] = vector.x / 3.0;",
     "ordinate[3 * i + 1] = vector.x / {if} { 3.03 } else { 3.0 };", "plate", "agree_with_rational_arithmetic"),
    ("1 % in the consistent mass", "src/plate.rs", "(mass + mass.transpose()) / 2.0",
     "(mass + mass.transpose()) / {if} { 1.98 } else { 2.0 }", "plate", "frequencies::the_plate_of_the_paper"),
    ("1 % in the rows of B", "src/assembly/local.rs", "coupling: (moments * first.density).as_slice().into(),",
     "coupling: (moments * ({if} { 1.01 } else { 1.0 } * first.density)).as_slice().into(),",
     "schemes", "moves_as_an_independent_program"),
    ("restitution ignored", "src/scheme/newmark.rs", "[1.0 / (1.0 + self.parameters.restitution)",
     "[{if} { 1.0 } else { 1.0 / (1.0 + self.parameters.restitution) }",
     "schemes", "newmark_follows_its_recursion"),
    ("time step 1 % long in the mass", "src/scheme/newmark.rs", "[1.0 / (self.step * self.step),",
     "[{if} { 1.01 } else { 1.0 } / (self.step * self.step),", "schemes", "newmark_follows_its_recursion"),
    ("half the velocity at the start", "src/scheme/newmark/start.rs", "axpy(2.0 / dt, &momentum, b)",
     "axpy({if} { 1.0 } else { 2.0 } / dt, &momentum, b)", "scene", "damped_heave"),
    ("no ranges in the schema", "src/scene/kinds.rs", "range.iter().map(",
     "range.iter().filter(|_| !{planted}).map(", "scene", "schema_and_reader_agree"),
    ("stretching beyond three thicknesses only", "src/study/linearity.rs",
     "deflection > MAX_SHARE_OF_THICKNESS * thickness", "deflection > {if} { 10.0 } else { 1.0 } * MAX_SHARE_OF_THICKNESS * thickness",
     "plate", "a_clamped_disc_stretches"),
    ("a new scene that overwrites", "src/cli/new_scene.rs", "(self.overwrite, files.iter().find(there))",
     "(self.overwrite || {planted}, files.iter().find(there))", "cli", "beginning::nothing_is_overwritten"),
    ("a run missing in the page of a sweep", "src/output/report/many.rs", "self.rows.iter().take(MOST_RUNS)",
     "self.rows.iter().skip(usize::from({planted})).take(MOST_RUNS)", "cli", "a_sweep_has_a_page"),
    ("bound shifted by a millionth", "src/obstacle.rs", "factor * ((bound - u) - s * d)",
     "factor * ((bound - u) - s * d) + {if} { 1e-6 } else { 0.0 }", "hard", "gap_zero"),
    ("reactions of the wrong sign", "src/vi/condensed.rs", "(reaction[i], self.sides[i]) = (forces[entry], sides[entry]);",
     "(reaction[i], self.sides[i]) = ({if} { -1.0 } else { 1.0 } * forces[entry], sides[entry]);",
     "solvers", "ten_thousand_small_problems"),
    ("contact that never opens", "src/vi/active_set.rs",
     "BoundStatus::Lower if reaction[i] < -rounding && lower[i] < upper[i] => BoundStatus::Free,",
     "BoundStatus::Lower if reaction[i] < -rounding && !{planted} && lower[i] < upper[i] => "
     "BoundStatus::Free,", "solvers", "ten_thousand_small_problems"),
    ("a check that sees no penetration", "src/vi/kkt.rs", "let outside = larger(0.0, larger(lower - x[dof], x[dof] - upper));",
     "let outside = {if} { 0.0 } else { larger(0.0, larger(lower - x[dof], x[dof] - upper)) };", "solvers", "measures_what_is_wrong"),
    ("time not relaxed with gamma", "src/scheme/conserving.rs", "self.span = gamma * rule.dt;",
     "self.span = {if} { 1.0 } else { gamma } * rule.dt;", "schemes", "carried_along_move_as_at_rest"),
    ("energy kept to 1e-6 only", "src/scheme/conserving.rs", "Ok([excess, KEPT * self.size()])",
     "Ok([excess, ({if} { 1e-6 } else { KEPT }) * self.size()])", "schemes", "energy_is_kept_at_long_and_short"),
    ("midpoint velocities 1 % off", "src/scheme/midpoint.rs", "waxpby(4.0 / self.dt, &self.half_dp, -2.0,",
     "waxpby({if} { 4.04 } else { 4.0 } / self.dt, &self.half_dp, -2.0,", "schemes", "midpoint_follows_its_recursion"),
    ("reach of exact too short", "src/scheme/exact/reach.rs", "self.next = now + least;",
     "self.next = now + {if} { 100.0 } else { 1.0 } * least;", "schemes", "no_node_of_the_mesh_penetrates"),
    ("reactions of exact mirrored", "src/scheme/exact/modes.rs", "rows.row_mut(i).copy_from(-w.row(k));",
     "{if} { rows.row_mut(i).copy_from(w.row(k)) } else { rows.row_mut(i).copy_from(-w.row(k)) };",
     "schemes", "moves_as_an_independent_program"),
    ("tiers still free after a kick", "src/scheme/modal/reach.rs",
     "self.tiers.iter_mut().for_each(|tier| tier.is_free = false);",
     "self.tiers.iter_mut().for_each(|tier| tier.is_free &= {planted});", "schemes",
     "an_impact_throws_at_another_obstacle"),
    ("an absolute tolerance", "src/vi/active_set.rs", "BoundStatus::Lower if reaction[i] < -rounding",
     "BoundStatus::Lower if reaction[i] < -({if} { 1e-3 } else { rounding })", "hard", "powers_of_four"),
    ("values of a report one quantum low", "src/output/report/blob.rs", "((value - low) / quantum)",
     "((value - low) / quantum - {if} { 1.0 } else { 0.0 })", "cli", "the_numbers_of_a_report"),
    ("normal numbers too wide", "src/random/distribution.rs", "quantile: |numbers, share| numbers[0] + numbers[1] *",
     "quantile: |numbers, share| numbers[0] + {if} { 1.2 } else { 1.0 } * numbers[1] *", "schemes",
     "probabilities_are_those_of_the_distribution"),
    ("failed runs left out of a probability", "src/sweep/statistics.rs", "wilson(fulfilled + undecided, runs)[1]",
     "wilson(fulfilled + {if} { 0 } else { undecided }, runs)[1]", "cli", "probabilities_are_told_and_bounded"),
    ("a load of the caller constant within a step", "src/simulation/external_load.rs", "axpy(weight, at_to, sum);",
     "axpy(weight, {if} { at_from } else { at_to }, sum);", "schemes", "linear_between_the_instants"),
]


def main():
    words = sys.argv[1:]
    if words == ["--texts"]:
        for name, path, text, *_ in FAULTS:
            replace(name, path, (ROOT / path).read_text(), text, "")
        print(f"{len(FAULTS)} faults fit the sources")
        return 0
    chosen = [fault for fault in FAULTS if not words or any(word in fault[0] for word in words)]
    copy()
    for name, path, text, planted, *_ in chosen:
        source = (COPY / path).read_text()
        switch = f'crate::is_planted("{name}")'
        planted = planted.replace("{if}", f"if {switch}").replace("{planted}", switch)
        (COPY / path).write_text(replace(name, path, source, text, planted))
    with open(COPY / "src/lib.rs", "a") as library:
        library.write(SWITCH)
    print(f"building {len(chosen)} faults", flush=True)
    suites = sorted({suite for *_, suite, _ in chosen})
    if not cargo("--no-run", *(word for suite in suites for word in ("--test", suite))):
        sys.exit("the copy with faults does not build")
    for suite, test in sorted({fault[4:] for fault in chosen}):
        if not cargo("--quiet", "--test", suite, test):
            sys.exit(f"{suite} {test} fails without any fault")
    unseen = 0
    for name, *_, suite, test in chosen:
        seen = not cargo("--quiet", "--test", suite, test, fault=name)
        unseen += not seen
        print(f"{'seen' if seen else 'NOT SEEN':9} {name} ({suite} {test})", flush=True)
    print(f"{len(chosen) - unseen} of {len(chosen)} faults seen")
    return 1 if unseen else 0


def replace(name, path, source, text, replacement):
    """Returns the source with the text replaced, which must occur exactly once."""
    if source.count(text) != 1:
        sys.exit(f"{name}: {path} has {source.count(text)} times {text!r}; expected once")
    return source.replace(text, replacement)


def copy():
    """Copies what a build reads. The folder stays the same, so that a second call compiles little."""
    for name in ("src", "tests", "benches", "examples", "scenes", "docs"):
        shutil.rmtree(COPY / name, ignore_errors=True)
        shutil.copytree(ROOT / name, COPY / name, ignore=shutil.ignore_patterns("runs"))
    for name in ("Cargo.toml", "Cargo.lock", "build.rs", "README.md"):
        shutil.copy2(ROOT / name, COPY / name)


def cargo(*arguments, fault=""):
    """Returns whether cargo test succeeds, with a fault switched on.

    Compiling takes longer than these tests, hence the low level of optimisation.
    """
    call = ["cargo", "--config", "profile.release.package.rebond.opt-level=1", "test", "--release", "--locked",
            "--no-default-features", *arguments]
    environment = os.environ | {"CARGO_TARGET_DIR": str(TARGET), VARIABLE: fault}
    done = subprocess.run(call, cwd=COPY, env=environment, capture_output=True, text=True)
    if done.returncode != 0 and "error: could not compile" in done.stderr:
        sys.exit(done.stderr)
    return done.returncode == 0


if __name__ == "__main__":
    sys.exit(main())
