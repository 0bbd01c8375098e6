#!/usr/bin/env python3
"""Proves that the tests detect faults.

The script plants faults in a copy of the sources, one at a time, and requires that the tests of each fail.

    scripts/planted_faults.py                     # all faults, about a minute each
    scripts/planted_faults.py restitution bound   # the faults whose names contain one of these words
    scripts/planted_faults.py --texts             # only that every fault still fits the sources

A fault replaces a piece of source text that must occur exactly once. When the sources change, the script
therefore fails instead of giving a wrong answer.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

# Each fault has a name, a file, a text, a faulty text, a test program, and part of the names of its
# tests.
FAULTS = [
    ("1 % in the stiffness", "src/plate.rs", "(stiffness + stiffness.transpose()) / 2.0",
     "(stiffness + stiffness.transpose()) / 1.98", "plate", "statics::"),
    ("1 % in the slopes of the basis", "src/element/mod.rs", "ordinate[3 * i + 1] = vector.x / 3.0;",
     "ordinate[3 * i + 1] = vector.x / 3.03;", "plate", "elements::"),
    ("1 % in the consistent mass", "src/plate.rs", "(mass + mass.transpose()) / 2.0",
     "(mass + mass.transpose()) / 1.98", "plate", "frequencies::"),
    ("1 % in the rows of B", "src/assembly/local.rs", "coupling: (moments * first.density).as_slice().into(),",
     "coupling: (moments * (1.01 * first.density)).as_slice().into(),", "schemes", "exact::"),
    ("restitution ignored", "src/scheme/newmark.rs", "let e = self.parameters.restitution;\n        (1.0 + e) *",
     "let e = 0.0;\n        (1.0 + e) *", "schemes", "bouncing_ball::"),
    ("time step 1 % long in the mass", "src/scheme/newmark.rs", "m * (1.0 / (dt * dt))",
     "m * (1.01 / (dt * dt))", "schemes", "energy::"),
    ("half the velocity at the start", "src/scheme/newmark/start.rs", "axpy(2.0 / dt, &momentum, b)",
     "axpy(1.0 / dt, &momentum, b)", "scene", "damped_heave"),
    ("bound shifted by a millionth", "src/obstacle.rs", "self.lower[i] = map(dof, others.lower[i]);",
     "self.lower[i] = map(dof, others.lower[i]) + 1e-6;", "hard", "gap_zero"),
    ("reactions of the wrong sign", "src/vi/condensed.rs", "reaction[i] = forces[first + k];",
     "reaction[i] = -forces[first + k];", "solvers", "vi::"),
    ("contact that never opens", "src/vi/active_set.rs",
     "BoundStatus::Lower if reaction[i] < -rounding && lower[i] < upper[i] => BoundStatus::Free,", "", "solvers", "vi::"),
    ("a check that sees no penetration", "src/vi/kkt.rs",
     "let outside = larger(0.0, larger(-below, -above));", "let outside = 0.0;", "solvers", "vi::"),
    ("time not relaxed with gamma", "src/scheme/conserving.rs", "self.span = gamma * rule.dt;", "self.span = rule.dt;",
     "schemes", "moving::"),
    ("energy kept to 1e-6 only", "src/scheme/conserving.rs", "const KEPT: f64 = 4.0 * f64::EPSILON;",
     "const KEPT: f64 = 1e-6;", "schemes", "conserving::energy"),
    ("midpoint velocities 1 % off", "src/scheme/midpoint.rs", "waxpby(4.0 / self.dt, &self.half_dp, -2.0,",
     "waxpby(4.04 / self.dt, &self.half_dp, -2.0,", "schemes", "energy::"),
    ("reactions of exact mirrored", "src/scheme/exact/modes.rs", "rows.row_mut(i).copy_from(-w.row(k));",
     "rows.row_mut(i).copy_from(w.row(k));", "schemes", "exact::"),
    ("an absolute tolerance", "src/vi/active_set.rs",
     "BoundStatus::Lower if reaction[i] < -rounding", "BoundStatus::Lower if reaction[i] < -1e-3",
     "hard", "powers_of_four"),
]


def main():
    words = sys.argv[1:]
    if words == ["--texts"]:
        for name, path, text, *_ in FAULTS:
            check_text(name, path, (ROOT / path).read_text(), text)
        print(f"{len(FAULTS)} faults fit the sources")
        return 0
    chosen = [fault for fault in FAULTS if not words or any(word in fault[0] for word in words)]
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "rebond"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns("target", ".git", "runs"))
        unseen = [fault[0] for fault in chosen if not is_seen(copy, *fault)]
    print(f"{len(chosen) - len(unseen)} of {len(chosen)} faults seen")
    return 1 if unseen else 0


def check_text(name, path, source, text):
    """Ends the script unless the text occurs exactly once in the source."""
    if source.count(text) != 1:
        sys.exit(f"{name}: {path} has {source.count(text)} times {text!r}; expected once")


def is_seen(copy, name, path, text, fault, suite, test):
    """Returns whether the tests fail with the fault."""
    source = (copy / path).read_text()
    check_text(name, path, source, text)
    (copy / path).write_text(source.replace(text, fault))
    environment = os.environ | {"CARGO_TARGET_DIR": str(ROOT / "target" / "planted_faults"), "CARGO_INCREMENTAL": "1"}
    call = ["cargo", "test", "--release", "--locked", "--quiet", "--no-default-features", "--test", suite]
    built = subprocess.run([*call, "--no-run"], cwd=copy, env=environment, capture_output=True, text=True)
    if built.returncode != 0:
        sys.exit(f"{name}: it does not build\n{built.stderr}")
    ran = subprocess.run([*call, test], cwd=copy, env=environment, capture_output=True, text=True)
    (copy / path).write_text(source)
    red = ran.returncode != 0
    print(f"{'seen' if red else 'NOT SEEN':9} {name} ({suite} {test})", flush=True)
    return red


if __name__ == "__main__":
    sys.exit(main())
