#!/usr/bin/env python3
"""Times steps of one plate with GetFEM, with PETSc as its tutorials use it, and with rebond.

The paper's plate of quadrilaterals, bent by 14600 Pa, is pushed down by 1e5 Pa: once above an
obstacle out of its reach, and once onto an obstacle 10 um below its lowest point. Each program makes the
same 20 steps (Newmark, beta = 1/2, e = 0, consistent mass, 1e-4 s) from its own matrices, on one
core. The table has the seconds of a step, without set-up, the least of three runs, and the largest
difference of the final deflection at (0.6 m, 0.2 m) from rebond's native engine.

Usage: benches/peers/compare.py [CELLS...]     default: 10,4 40,16 80,32
It needs Debian's packages python3-getfem and python3-scipy, and what rebond needs to be built.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

# The numerical libraries start threads of their own, which one core does not have.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
import getfem_plate  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
STEP, STEPS, PRESSURE, RUNS = 1e-4, 20, -1e5, 3
FACTORED = "-ksp_type preonly -pc_type cholesky -pc_factor_mat_solver_type mumps -snes_rtol 1e-10"
REBOND = {
    "rebond, native": [],
    "rebond, PETSc": ["--engine", "petsc"],
    "rebond, PETSc, snes": ["--engine", "petsc", "--set", "solver.vi=snes"],
}
SCENE = """
plate = {{ length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }}
mesh = {{ element = "fvs", cells = [{cells[0]}, {cells[1]}] }}
support = [{{ edge = "left", kind = "clamped" }}]
obstacle = [{{ side = "below", height = {obstacle!r} }}]
initial = {{ static_pressure = -14600 }}
load = {{ pressure = {pressure} }}
time = {{ scheme = "newmark", mass = "consistent", step = {step}, end = {end} }}
output = {{ every = {steps}, probes = [{{ name = "middle", at = [0.6, 0.2] }}] }}
"""


def build_peer(folder):
    """Compiles the program of PETSc's tutorials."""
    flags = subprocess.check_output(["pkg-config", "--cflags", "--libs", "PETSc"], text=True).split()
    program = folder / "rsls"
    subprocess.check_call(["mpicc", "-O2", "-o", program, Path(__file__).with_name("rsls.c"), *flags])
    return program


def step_of_peer(program, data, plate, obstacle, options):
    """Runs the program of PETSc's tutorials; returns deflection and seconds a step."""
    command = [program, "-data", data, "-obstacle", repr(obstacle), "-step", str(STEP)]
    command += ["-steps", str(STEPS), "-dof", str(plate.middle), *options.split()]
    said = subprocess.run(command, capture_output=True, text=True)
    if said.returncode != 0:
        raise RuntimeError("SNES has not converged")
    return tuple(map(float, said.stdout.split()))


def step_of_rebond(folder, cells, obstacle, options):
    """Runs rebond; returns deflection and seconds a step."""
    scene = folder / "scene.toml"
    end = STEPS * STEP
    text = SCENE.format(cells=cells, obstacle=obstacle, pressure=PRESSURE, step=STEP, end=end, steps=STEPS)
    scene.write_text(text)
    run = folder / "run"
    command = [ROOT / "target/release/rebond", "run", scene, "--json", "--overwrite", "--out", run, *options]
    summary = json.loads(subprocess.check_output(command, stderr=subprocess.PIPE))
    header, *rows = (run / "history.csv").read_text().splitlines()
    column = header.split(",").index("middle")
    return float(rows[-1].split(",")[column]), summary["seconds"]["blocks"]["advance"] / STEPS


def compare(cells, folder, peer):
    """Prints the rows of one mesh."""
    plate = getfem_plate.Plate(cells)
    data = folder / "plate"
    getfem_plate.write_for_petsc(plate, PRESSURE, data)
    lowest = float(plate.start[plate.deflections].min())
    obstacles = {"free": lowest - 0.1, "contact": lowest - 1e-5}
    programs = {name: lambda o, options=options: step_of_rebond(folder, cells, o, options) for name, options in REBOND.items()}
    programs["GetFEM"] = lambda o: getfem_plate.run(plate, o, PRESSURE, STEP, STEPS)
    programs["PETSc RSLS"] = lambda o: step_of_peer(peer, data, plate, o, "")
    programs["PETSc RSLS, MUMPS"] = lambda o: step_of_peer(peer, data, plate, o, FACTORED)
    reference = {}
    for name, program in programs.items():
        row, worst = "", 0.0
        for width, (kind, obstacle) in zip((11, 12), obstacles.items()):
            try:
                deflection, seconds = min((program(obstacle) for _ in range(RUNS)), key=lambda run: run[1])
                deflection_of_reference, seconds_of_reference = reference.setdefault(kind, (deflection, seconds))
                worst = max(worst, abs(deflection - deflection_of_reference))
                row += f"{1e3 * seconds:{width}.4g}{seconds / seconds_of_reference:8.1f}"
            except RuntimeError:
                row += f"{'failed':>{width}}{'':8}"
        print(f"{cells[0]}x{cells[1]:<8}{name:22}{row}{worst:12.1e}", flush=True)


def main():
    meshes = [tuple(map(int, cells.split(","))) for cells in sys.argv[1:] or ["10,4", "40,16", "80,32"]]
    subprocess.check_call(["cargo", "build", "--release", "--locked", "--quiet"], cwd=ROOT)
    print(f"{'cells':11}{'program':22}{'free, ms':>11}{'ratio':>8}{'contact, ms':>12}{'ratio':>8}{'change, m':>12}")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        peer = build_peer(folder)
        for cells in meshes:
            compare(cells, folder, peer)


main()
