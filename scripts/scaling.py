#!/usr/bin/env python3
"""Measures how steps on several ranks compare with those of one native process, and draws it.

The paper's plate, bent by 14600 Pa, is pushed down by 1e5 Pa onto an obstacle just under its tip
(singular mass, 1e-4 s). Each row is the difference between a run of 30 steps and one of 10, so that
it has steps alone: in most of them the free edge is in contact. With --free the obstacle is out of
reach. Of several rounds the one with the median time counts; set-up and step are also given relative
to the native engine on the same mesh. Messages and bytes are those of the rank that sends most. Open
MPI's monitoring counts them below MPI, with those of MUMPS and of collectives, but for persistent
messages, PETSc's exchanges, which PETSc's log counts.

strong: one mesh on more ranks. weak: as many cells per rank on more ranks.

Usage: scripts/scaling.py [--ranks 1,2,4] [--cells 160,64] [--element fvs] [--linear direct,multigrid]
                          [--kinds strong,weak] [--free] [--rounds 3] [--draw FILE.svg]
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COUNTS = (10, 30)
SCENE = """
plate = {{ length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }}
mesh = {{ element = "{element}", cells = [{cells[0]}, {cells[1]}] }}
support = [{{ edge = "left", kind = "clamped" }}]
obstacle = [{{ side = "below", height = {obstacle} }}]
initial = {{ static_pressure = -14600 }}
load = {{ pressure = -1e5 }}
time = {{ scheme = "newmark", mass = "singular", step = 1e-4, end = {end} }}
output = {{ every = 1000 }}
solver = {{ {solver} }}
"""
HEAD = f"{'':8}{'cells':>10}{'ranks':>7}{'dofs':>9}{'set-up s':>10}{'ratio':>7}{'ms/step':>9}{'ratio':>7}{'its':>6}"
HEAD += f"{'messages':>10}{'kB':>9}{'imbal.':>8}{'MiB':>7}{'contact':>9}"


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


def measure(folder, case, ranks, rounds):
    """Returns the figures of one step: those of the round with the median time."""
    of_rounds = sorted((measure_once(folder, case, ranks) for _ in range(rounds)), key=lambda row: row["step"])
    return of_rounds[rounds // 2]


def measure_once(folder, case, ranks):
    """Returns the figures of one step of one round."""
    short, long = (run(folder, case, ranks, steps) for steps in COUNTS)
    steps = COUNTS[1] - COUNTS[0]
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
        "contact": long["contact_steps"] - short["contact_steps"],
    }


def print_row(kind, case, ranks, row, native):
    """Prints the figures of one step, beside those of the native engine."""
    cells = "{}x{}".format(*case["cells"])
    iterations = "-" if row["iterations"] is None else f"{row['iterations']:.1f}"
    setup, step = (row[of] / native[of] for of in ("setup", "step"))
    print(
        f"{kind:8}{cells:>10}{ranks or 'native':>7}{row['dofs']:9d}{row['setup']:10.2f}{setup:7.2f}"
        f"{1e3 * row['step']:9.3f}{step:7.2f}{iterations:>6}{row['messages']:10.0f}{row['bytes'] / 1e3:9.1f}"
        f"{row['imbalance']:8.3f}{row['peak']:7.0f}{row['contact']:>6}/{COUNTS[1] - COUNTS[0]}",
        flush=True,
    )


def draw(results, file):
    """Draws the time of a step over the ranks: solid with one core per rank, dotted beyond."""
    from matplotlib import pyplot, rcParams, ticker

    rcParams["svg.hashsalt"] = "scaling"

    figure, axes = pyplot.subplots(1, 2, figsize=(7.2, 3.0), constrained_layout=True)
    cores = os.cpu_count()
    for axis, kind in zip(axes, ("strong", "weak")):
        for (linear, color), mark in zip((("direct", "#1f4e79"), ("multigrid", "#c55a11")), "os"):
            points = sorted((ranks, 1e3 * row["step"]) for (what, of, ranks), row in results.items() if (what, of) == (kind, linear))
            if not points:
                continue
            within = [point for point in points if point[0] <= cores]
            axis.plot(*zip(*points), ":", color=color, lw=1)
            axis.plot(*zip(*within), "-", marker=mark, color=color, label=linear, ms=4)
            axis.plot(*zip(*points), mark, mfc="white", color=color, ms=4, zorder=1)
            ideal = [points[0][1] / (ranks if kind == "strong" else 1) for ranks, _ in points]
            axis.plot([ranks for ranks, _ in points], ideal, "--", color="#888888", lw=0.8)
        axis.set(xscale="log", yscale="log", xlabel="ranks", ylabel="ms per step", title=f"{kind} scaling")
        ranks = sorted({ranks for _, _, ranks in results})
        axis.set_xticks(ranks, [str(count) for count in ranks])
        axis.yaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_major_formatter(ticker.StrMethodFormatter("{x:g}"))
        axis.minorticks_off()
        axis.legend(frameon=False, fontsize=8)
    figure.savefig(file, metadata={"Date": None})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ranks", default="1,2,4")
    parser.add_argument("--cells", default="160,64")
    parser.add_argument("--element", default="fvs", choices=["fvs", "hct"])
    parser.add_argument("--linear", default="direct,multigrid")
    parser.add_argument("--kinds", default="strong,weak")
    parser.add_argument("--free", action="store_true")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--draw", metavar="FILE.svg")
    options = parser.parse_args()
    if options.draw:
        import matplotlib  # a lack of it shows before the measurement

        matplotlib.use("svg")
    ranks = [int(count) for count in options.ranks.split(",")]
    cells = [int(count) for count in options.cells.split(",")]

    subprocess.check_call(["cargo", "build", "--release", "--locked", "--quiet"], cwd=ROOT)
    results, native = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for linear in options.linear.split(","):
            print(f"{linear}\n{HEAD}")
            for kind in options.kinds.split(","):
                for count in ranks:
                    # Multiples of 8 can be halved by multigrid.
                    growth = math.sqrt(count / ranks[0]) if kind == "weak" else 1
                    of_case = tuple(8 * round(growth * side / 8) for side in cells)
                    obstacle = -5 if options.free else -0.2085
                    case = {"cells": of_case, "element": options.element, "obstacle": obstacle}
                    if of_case not in native:
                        alone = case | {"solver": 'engine = "native"'}
                        native[of_case] = measure(Path(folder), alone, 0, options.rounds)
                        print_row(kind, case, 0, native[of_case], native[of_case])
                    case["solver"] = f'engine = "petsc", linear = "{linear}"'
                    results[kind, linear, count] = measure(Path(folder), case, count, options.rounds)
                    print_row(kind, case, count, results[kind, linear, count], native[of_case])
    if options.draw:
        draw(results, options.draw)


main()
