#!/usr/bin/env python3
"""Measures how steps on several ranks compare with those of one native process on the same mesh.

The paper's plate, bent by 14600 Pa, is pushed down by 2e4 Pa (singular mass, 1e-4 s): free, with the
obstacle out of reach, or onto an obstacle just under its tip, on which its free edge comes to lie. A row is the difference between two runs of unlike length, so that it has steps alone. Engines take
turns in every round, and the median of each counts, since a machine's speed changes with time. Messages and
bytes are those of the rank that sends most. Open MPI's monitoring counts them below MPI, with those of MUMPS
and of collectives, but for persistent messages, PETSc's exchanges, which PETSc's log counts.

Usage: scripts/scaling.py [--cells 80x32,320x128] [--elements fvs,hct] [--pushes free,contact]
                          [--ranks 1,2] [--linear direct] [--rounds 3]
"""

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OBSTACLES = {"free": -5, "contact": -0.2085}  # its height, m
SCENE = """
plate = {{ length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }}
mesh = {{ element = "{element}", cells = [{cells[0]}, {cells[1]}] }}
support = [{{ edge = "left", kind = "clamped" }}]
obstacle = [{{ side = "below", height = {obstacle} }}]
initial = {{ static_pressure = -14600 }}
load = {{ pressure = -2e4 }}
time = {{ scheme = "newmark", mass = "singular", step = 1e-4, end = {end} }}
output = {{ every = 1000 }}
solver = {{ {solver} }}
"""
HEAD = f"{'':4}{'cells':>10}{'push':>9}{'ranks':>8}{'dofs':>9}{'set-up s':>10}{'ratio':>7}{'ms/step':>10}{'ratio':>7}"
HEAD += f"{'its':>6}{'messages':>10}{'kB':>9}{'imbal.':>8}{'MiB':>7}{'touch':>13}"


def run(folder, case, ranks, steps):
    """Runs a scene; returns its summary, with the largest counts of a rank and its peak memory. Without
    ranks the native engine runs it, which sends nothing."""
    scene = folder / "scene.toml"
    scene.write_text(SCENE.format(end=steps * 1e-4, **case))
    for old in folder.glob("count.*"):
        old.unlink()
    program = [ROOT / "target/release/rebond", "run", scene, "--json", "--overwrite", "--out", folder / "run"]
    launch = "mpirun --oversubscribe --mca mpi_yield_when_idle 1 --mca pml ob1,monitoring --mca btl ^tcp,ofi"
    launch += " --mca pml_monitoring_enable 1 --mca pml_monitoring_enable_output 3"
    command = [*launch.split(), "--mca", "pml_monitoring_filename", folder / "count", "-n", str(ranks)]
    command = [*command, *program, "--", "-log_view", f":{folder / 'log'}"] if ranks else program
    root = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"} if os.getuid() == 0 else {}
    with open(folder / "said", "w+") as said, open(folder / "errors", "w+") as errors:
        process = subprocess.Popen(command, stdout=said, stderr=errors, env={**os.environ, **root})
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = status
        said.seek(0)
        errors.seek(0)
        if status != 0:
            sys.exit(errors.read())
        summary = json.load(said)
    counts = [sent(file) for file in folder.glob("count.*")] or [(0, 0)]
    log = open(folder / "log") if ranks else []
    persistent = [float(line.split(":")[1].split()[0]) for line in log if line.startswith("MPI Msg")] or [0, 0]
    summary["messages"], summary["bytes"] = (max(of) + more for of, more in zip(zip(*counts), persistent))
    summary["peak"] = usage.ru_maxrss / 1024  # MiB, of the largest process
    return summary


def sent(file):
    """Returns how many messages and bytes a rank has sent to others, from the file of a rank."""
    messages = size = 0
    for line in file.read_text().splitlines():
        words = line.split()
        if words and words[0] == "E" and words[1] != words[2]:
            size, messages = size + int(words[3]), messages + int(words[5])
    return messages, size


def measure(folder, case, ranks):
    """Returns the figures of one step."""
    counts = (10, 30 + 2_000_000 // (case["cells"][0] * case["cells"][1]) // 4)
    short, long = (run(folder, case, ranks, steps) for steps in counts)
    steps = counts[1] - counts[0]
    per_step = lambda of: (of(long) - of(short)) / steps
    setup = [long["seconds"][of] for of in ("assembly", "equilibrium", "factor")]
    return {
        "dofs": long["dofs"],
        "setup": sum(setup),
        "step": per_step(lambda run: run["seconds"]["blocks"]["advance"]),
        "iterations": long["linear"]["iterations_mean"] if ranks else None,
        "messages": per_step(lambda run: run["messages"]),
        "bytes": per_step(lambda run: run["bytes"]),
        "imbalance": long["imbalance"] if ranks else 1,
        "peak": long["peak"],
        "contact": f"{long['contact_steps'] - short['contact_steps']}/{steps}",
    }


def print_row(case, ranks, row, native):
    """Prints the figures of one step, beside those of the native engine."""
    cells = "{}x{}".format(*case["cells"])
    iterations = "-" if row["iterations"] is None else f"{row['iterations']:.1f}"
    setup, step = (row[of] / native[of] for of in ("setup", "step"))
    print(
        f"{case['element']:4}{cells:>10}{case['push']:>9}{ranks or 'native':>8}{row['dofs']:9d}{row['setup']:10.2f}"
        f"{setup:7.2f}{1e3 * row['step']:10.3f}{step:7.2f}{iterations:>6}{row['messages']:10.0f}"
        f"{row['bytes'] / 1e3:9.1f}{row['imbalance']:8.3f}{row['peak']:7.0f}{row['contact']:>13}",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    listed = lambda text: text.split(",")
    parser.add_argument("--cells", type=listed, default=["80x32", "320x128"])
    parser.add_argument("--elements", type=listed, default=["fvs", "hct"])
    parser.add_argument("--pushes", type=listed, default=["free", "contact"])
    parser.add_argument("--ranks", type=listed, default=["1", "2"])
    parser.add_argument("--linear", type=listed, default=["direct"])
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()

    subprocess.check_call(["cargo", "build", "--release", "--locked", "--quiet"], cwd=ROOT)
    with tempfile.TemporaryDirectory() as folder:
        for linear, cells, element, push in itertools.product(
            options.linear, options.cells, options.elements, options.pushes
        ):
            sides = tuple(int(count) for count in cells.split("x"))
            case = {"cells": sides, "element": element, "push": push, "obstacle": OBSTACLES[push]}
            engines = {0: 'engine = "native"'}
            engines |= {int(count): f'engine = "petsc", linear = "{linear}"' for count in options.ranks}
            rounds = [
                {ranks: measure(Path(folder), case | {"solver": solver}, ranks) for ranks, solver in engines.items()}
                for _ in range(options.rounds)
            ]
            if (cells, element, push) == (options.cells[0], options.elements[0], options.pushes[0]):
                print(f"{linear}\n{HEAD}")
            medians = {ranks: median([of[ranks] for of in rounds]) for ranks in engines}
            for ranks, row in medians.items():
                print_row(case, ranks, row, medians[0])


def median(rows):
    """Returns the median of each figure, by itself, of the rounds of an engine."""
    return {of: sorted((row[of] for row in rows), key=lambda x: (x is None, x))[len(rows) // 2] for of in rows[0]}


main()
