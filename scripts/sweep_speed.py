#!/usr/bin/env python3
"""Measures what a sweep costs against one process per value, in turns.

    scripts/sweep_speed.py [--values 161] [--rounds 1] [--jobs 2]

Both make the runs of scenes/gallery/chaos.toml over its load, with the same periods and steps: one
`rebond sweep`, and for each value one `rebond run` that writes a row per period, on as many threads.
Each is made as the scene stands and with time.mass = "modal". The script prints seconds of the clock
and of the processor, and their ratios.
"""
import argparse
import os
import subprocess
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCENE = ROOT / "scenes/gallery/chaos.toml"
FIRST, LAST = 90.0, 250.0
MASSES = ["singular", "modal"]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--values", type=int, default=161, help="number of values (161)")
    parser.add_argument("--rounds", type=int, default=1, help="rounds of all measurements, of which the least count (1)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="threads of either way (all processors)")
    parser.add_argument("--rebond", default=str(ROOT / "target/release/rebond"), help="path of the program")
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


def main():
    args = arguments()
    ways = {"one process per value": one_process_per_value, "rebond sweep": sweep}
    least = {}
    for _ in range(args.rounds):
        for mass in MASSES:
            for name, way in ways.items():
                seconds = measured(lambda: way(args, mass))
                known = least.get((name, mass), seconds)
                least[name, mass] = tuple(map(min, known, seconds))
    print(f"{args.values} values, {args.jobs} threads: seconds of the clock, of the processor")
    for (name, mass), (clock, used) in least.items():
        print(f"{name}, {mass}: {clock:.2f} {used:.2f}")
    base = least["one process per value", "singular"]
    for mass in MASSES:
        own, found = least["one process per value", mass], least["rebond sweep", mass]
        against = [f"{a / b:.1f}" for a, b in zip(own, found)]
        scene = [f"{a / b:.1f}" for a, b in zip(base, found)]
        print(f"sweep, {mass}: {' '.join(against)} times faster than processes with this mass,"
              f" {' '.join(scene)} times than processes as the scene stands")


if __name__ == "__main__":
    main()
