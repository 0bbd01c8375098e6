#!/usr/bin/env python3
"""Draws a bifurcation diagram: the stroboscopic section of a scene for each value of a parameter.

    scripts/bifurcation.py scenes/gallery/chaos.toml 'load.pressure="{}*sin(2*pi*40*t)"' 20 120 201

The section consists of the rows of history.csv, so output.every must be one period of the drive. `{}`
in the setting stands for the value; further settings that contain it are given with --set. The script
writes NAME.csv and NAME.svg.
"""
import argparse
import csv
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from math import ceil, floor, log10
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parent.parent


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("setting", help="setting of rebond run, with {} for the value")
    parser.add_argument("first", type=float)
    parser.add_argument("last", type=float)
    parser.add_argument("count", type=int, help="number of values")
    parser.add_argument("--set", action="append", default=[], help="further setting; {} stands for the value")
    parser.add_argument("--probe", help="probe whose deflection is shown (the first one)")
    parser.add_argument("--skip", type=float, default=0.5, help="fraction of each run that is omitted as transient (0.5)")
    parser.add_argument("--out", type=Path, default=Path("runs/bifurcation"), help="path of the output without extension")
    parser.add_argument("--rebond", default=str(ROOT / "target/release/rebond"), help="path of the program")
    args = parser.parse_args()
    if args.count < 1:
        parser.error("count: expected at least 1 value")
    if not shutil.which(args.rebond):
        parser.error(f"no program at {args.rebond}: build it with `cargo build --release`, or name it with --rebond")
    return args


def section(args, value):
    """Returns the deflections at the ends of the periods after the transient, in m."""
    settings = [f"--set={setting.replace('{}', repr(value))}" for setting in [args.setting, *args.set]]
    with tempfile.TemporaryDirectory() as folder:
        command = [args.rebond, "run", str(args.scene), "--quiet", "--out", folder, *settings]
        ended = subprocess.run(command, stderr=subprocess.PIPE, text=True)
        if ended.returncode:
            sys.exit(ended.stderr.strip())
        with open(Path(folder) / "history.csv") as history:
            reader = csv.DictReader(history)
            probes = reader.fieldnames[10:]
            if not probes or args.probe not in [None, *probes]:
                known = ", ".join(probes) or "none at all (output.probes)"
                sys.exit(f"{args.scene}: no probe {args.probe or 'to show'}; the scene has {known}")
            probe = args.probe or probes[0]
            rows = [float(row[probe]) for row in reader]
    settled = rows[int(args.skip * len(rows)):]
    if not settled:
        sys.exit(f"--skip {args.skip:g} leaves no row of {len(rows)}; expected less than 1")
    return settled


def ticks(low, high, wanted=5):
    """Returns round numbers from low to high."""
    rough = (high - low) / wanted or 1.0
    power = 10.0 ** floor(log10(rough))
    step = next(digit * power for digit in (1, 2, 5, 10) if digit * power >= rough)
    return [round(i * step, 12) for i in range(ceil(low / step), floor(high / step) + 1)]


def svg(points, name, width=560, height=320):
    """Returns a picture of the points (parameter, deflection in m) as SVG."""
    left, right, top, bottom = 56, width - 12, 12, height - 44
    xs, ws = [x for x, _ in points], [1e3 * w for _, w in points]
    (x0, x1), (w0, w1) = (min(xs), max(xs)), (min(ws), max(ws))
    pad = 0.04 * (w1 - w0) or 1.0
    w0, w1 = w0 - pad, w1 + pad
    across = lambda x: left + (right - left) * (x - x0) / (x1 - x0 or 1.0)
    up = lambda w: bottom - (bottom - top) * (w - w0) / (w1 - w0)
    places = sorted({(round(across(x), 1), round(up(w), 1)) for x, w in zip(xs, ws)})
    dots = "".join(f"M{x} {y}h.01" for x, y in places)
    text = lambda x, y, what, more='text-anchor="middle"': f'<text x="{x:.1f}" y="{y:.1f}" {more}>{escape(what)}</text>'
    labels = [text(across(x), bottom + 15, f"{x:g}") for x in ticks(x0, x1)]
    labels += [text(left - 5, up(w) + 4, f"{w:g}", 'text-anchor="end"') for w in ticks(w0, w1)]
    marks = "".join(f"M{across(x):.1f} {bottom}v-4" for x in ticks(x0, x1))
    marks += "".join(f"M{left} {up(w):.1f}h4" for w in ticks(w0, w1))
    middle = 0.5 * (top + bottom)
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11">',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        f'<path d="{dots}" stroke="#0072b2" stroke-width="1.2" stroke-linecap="round" fill="none"/>',
        f'<path d="M{left} {top}V{bottom}H{right}{marks}" stroke="#000" fill="none"/>', *labels,
        text(0.5 * (left + right), height - 8, name.replace("{}", "\u2026")),
        text(14, middle, "deflection once per period (mm)", f'text-anchor="middle" transform="rotate(-90 14 {middle})"'),
        "</svg>\n"])


def main():
    args = arguments()
    steps = max(args.count - 1, 1)
    values = [args.first + (args.last - args.first) * i / steps for i in range(args.count)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        sections = list(pool.map(lambda value: section(args, value), values))
    points = [(value, w) for value, ws in zip(values, sections) for w in ws]
    args.out.parent.mkdir(parents=True, exist_ok=True)
    with open(args.out.with_suffix(".csv"), "w", newline="") as file:
        csv.writer(file).writerows([("value", "deflection"), *points])
    args.out.with_suffix(".svg").write_text(svg(points, args.setting))
    print(f"{args.out}.csv, .svg: {len(values)} runs, {len(points)} points")


if __name__ == "__main__":
    main()
