#!/usr/bin/env python3
"""Measures what a sweep costs against one process per value, in turns.

    scripts/sweep_speed.py [--values 161] [--runs 1000 10000] [--rounds 1] [--jobs 2] [--before COMMIT]

Both make the runs of scenes/gallery/chaos.toml over its load, with the same periods and steps: one
`rebond sweep`, and for each value one `rebond run` that writes a row per period, on as many threads.
Each is made as the scene stands and with time.mass = "modal". The script prints seconds of the clock
and of the processor, and their ratios.

It also makes random sweeps of that scene with more and more runs, and prints what a step of a run costs
and the memory of the program.

Before there was the command, scripts/bifurcation.py made the diagram with one process per value. With
`--before 46a1d2c` the script and program of this commit are measured too, as that scene stands; they are
built in target/before, which takes minutes.
"""
import argparse
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCENE = ROOT / "scenes/gallery/chaos.toml"
FIRST, LAST = 90.0, 250.0
MASSES = ["singular", "modal"]
# Periods of each run, and steps of each period, as the scene says.
PERIODS, STEPS = 200, 200


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--values", type=int, default=161, help="number of values (161)")
    parser.add_argument("--runs", type=int, nargs="*", default=[1000, 10000], help="runs of random sweeps (1000 10000)")
    parser.add_argument("--rounds", type=int, default=1, help="rounds of all measurements, of which the least count (1)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="threads of either way (all processors)")
    parser.add_argument("--rebond", default=str(ROOT / "target/release/rebond"), help="path of the program")
    parser.add_argument("--before", metavar="COMMIT", help="measure the script of this commit too, such as 46a1d2c")
    parser.add_argument("--set", action="append", default=[], help="further setting of all runs")
    return parser.parse_args()


def measured(act):
    """Returns the seconds of the clock, and of the processor in child processes, that a call takes."""
    clock, before = time.perf_counter(), os.times()
    act()
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - clock, used


def settings(args, mass):
    return [f"--set={setting}" for setting in [f'time.mass="{mass}"', *args.set]]


def one_process_per_value(args, mass):
    steps = max(args.values - 1, 1)
    values = [FIRST + (LAST - FIRST) * i / steps for i in range(args.values)]

    def run(value):
        with tempfile.TemporaryDirectory() as folder:
            command = [args.rebond, "run", str(SCENE), "--quiet", "--overwrite", "--out", folder]
            # A row of history.csv per period of the drive.
            own = [f"--set=parameters.amplitude={value!r}", "--set=output.every=200"]
            subprocess.run([*command, *own, *settings(args, mass)], check=True, stderr=subprocess.DEVNULL)

    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(run, values))


def sweep(args, mass):
    with tempfile.TemporaryDirectory() as folder:
        command = [args.rebond, "sweep", str(SCENE), "--quiet", "--out", folder, "--jobs", str(args.jobs)]
        over = ["--over", f"amplitude={FIRST}..{LAST}:{args.values}"]
        subprocess.run([*command, *over, *settings(args, mass)], check=True)


def random_sweep(args, runs):
    """Makes a random sweep; returns its seconds of the clock, of the processor, and its memory (MB)."""
    with tempfile.TemporaryDirectory() as folder:
        command = [args.rebond, "sweep", str(SCENE), "--quiet", "--out", folder, "--jobs", str(args.jobs)]
        random = ["--random", f"amplitude=uniform({FIRST},{LAST})", "--runs", str(runs)]
        clock = time.perf_counter()
        process = subprocess.Popen([*command, *random, *settings(args, "singular")])
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            sys.exit(f"a random sweep ended with {process.returncode}")
        return time.perf_counter() - clock, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def built(commit):
    """Returns a clone of this repository at the commit, with the program built in it."""
    clone = ROOT / "target/before" / commit
    if not clone.exists():
        subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
    subprocess.run(["git", "checkout", "--quiet", commit], cwd=clone, check=True)
    own = {name: value for name, value in os.environ.items() if name != "CARGO_TARGET_DIR"}
    subprocess.run(["cargo", "build", "--release", "--locked", "--quiet"], cwd=clone, env=own, check=True)
    return clone


def script_before(clone, args):
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, clone / "scripts/bifurcation.py", clone / "scenes/gallery/chaos.toml"]
        over = ['load.pressure="{}*sin(2*pi*40*t)"', str(FIRST), str(LAST), str(args.values), "--set=output.every=200"]
        paths = ["--rebond", clone / "target/release/rebond", "--out", Path(folder) / "diagram"]
        subprocess.run([*command, *over, *paths], check=True, stdout=subprocess.DEVNULL)


def main():
    args = arguments()
    ways = {f"rebond sweep, {mass}": partial(sweep, args, mass) for mass in MASSES}
    others = {f"one process per value, {mass}": partial(one_process_per_value, args, mass) for mass in MASSES}
    if args.before:
        others[f"script of {args.before}, singular"] = partial(script_before, built(args.before), args)
    least = {}
    for _ in range(args.rounds):
        for name, way in {**ways, **others}.items():
            seconds = measured(way)
            least[name] = tuple(map(min, least.get(name, seconds), seconds))
    print(f"{args.values} values, {args.jobs} threads, least of {args.rounds}: seconds of the clock, of the processor; ratios")
    print(f"{'':32}{'clock':>8}{'proc.':>8}" + "".join(f"  / {way.removeprefix('rebond '):17}" for way in ways).rstrip())
    for name, seconds in least.items():
        ratios = "".join(
            f"  {seconds[0] / least[way][0]:8.1f} {seconds[1] / least[way][1]:8.1f}  " for way in ways if name in others
        )
        print(f"{name:32}{seconds[0]:8.2f}{seconds[1]:8.2f}{ratios}".rstrip())
    print("\nrandom sweeps: per step of a run, ns of the clock and of the processor; memory")
    for runs in args.runs:
        clock, used, memory = random_sweep(args, runs)
        steps = runs * PERIODS * STEPS
        print(f"{runs:10} runs  {1e9 * clock / steps:22.1f}{1e9 * used / steps:8.1f}{memory:10.0f} MB")


if __name__ == "__main__":
    main()
