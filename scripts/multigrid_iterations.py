#!/usr/bin/env python3
"""Counts the iterations of geometric multigrid from mesh to mesh.

The paper's plate makes 5 steps of Newmark's scheme on one rank. free: it flies without an obstacle,
from the velocity x^2. contact: its free edge is thrown down from rest at the speed x^2, onto an
obstacle 1e-7 m below it along this edge, and pressed down by 1e5 Pa, so that all steps are in contact.

For each case and mesh the table has the iterations of all solves, those of the start and on coarse
meshes too, over the number of steps and, in brackets, those of the longest solve, for a reduction of
the error by 1e-14. The last column is the largest entry over the least.

Usage: scripts/multigrid_iterations.py [--cells 20x8,40x16,...] [--steps 1e-3,1e-4,1e-5]
                                       [--elements fvs,hct] [--motions free,contact] [--program FILE]
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COUNT = 5
SCENE = """
plate = {{ length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }}
mesh = {{ element = "{element}", cells = [{cells}] }}
support = [{{ edge = "left", kind = "clamped" }}]
time = {{ scheme = "newmark", mass = "{mass}", step = {step}, end = {end} }}
output = {{ every = 1000 }}
solver = {{ engine = "petsc", linear = "multigrid" }}
"""
MOTION = {
    "free": """initial = { velocity = "x^2" }""",
    "contact": """initial = { velocity = "-x^2" }
load = { pressure = -1e5 }
obstacle = [{ side = "below", height = -1e-7, where = "x > 1.1999" }]""",
}


def iterations(program, folder, motion, **case):
    """Returns the iterations of a step, and those of the largest solve."""
    scene, log = folder / "scene.toml", folder / "log"
    scene.write_text(SCENE.format(end=COUNT * float(case["step"]), **case) + MOTION[motion])
    command = [program, "run", scene, "--json", "--overwrite", "--out", folder / "run", "--", "-log_view", f":{log}"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stderr)
    summary = json.loads(done.stdout)
    steps = summary["steps"]
    if motion == "contact" and summary["contact_steps"] < steps:
        sys.exit(f"{case}: {summary['contact_steps']} of {steps} steps in contact")
    counts = {words[0]: int(words[1]) for words in map(str.split, log.read_text().splitlines()) if len(words) > 1 and words[1].isdigit()}
    # A solve applies the preconditioner once more than it iterates.
    of_steps = counts["PCApply"] - counts["KSPSolve"]
    return of_steps / steps, summary["linear"]["iterations_max"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", default="20x8,40x16,80x32,160x64,320x128,640x256")
    parser.add_argument("--steps", default="1e-3,1e-4,1e-5")
    parser.add_argument("--elements", default="fvs,hct")
    parser.add_argument("--motions", default=",".join(MOTION))
    parser.add_argument("--program", default=ROOT / "target/release/rebond")
    options = parser.parse_args()
    meshes = options.cells.split(",")
    print(f"{'':8}{'':8}{'':11}{'dt, s':>6}" + "".join(f"{mesh:>12}" for mesh in meshes) + f"{'ratio':>7}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for motion in options.motions.split(","):
            for element in options.elements.split(","):
                for mass in ("singular", "consistent"):
                    for step in options.steps.split(","):
                        print(f"{motion:8}{element:8}{mass:11}{step:>6}", end="", flush=True)
                        means = []
                        for mesh in meshes:
                            case = {"element": element, "mass": mass, "step": step, "cells": mesh.replace("x", ", ")}
                            mean, most = iterations(options.program, Path(folder), motion, **case)
                            means.append(mean)
                            print(f"{mean:7.1f} ({most:2})", end="", flush=True)
                        print(f"{max(means) / min(means):7.2f}", flush=True)


main()
