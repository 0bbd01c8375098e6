#!/usr/bin/env python3
"""Draws the picture of the README: the paper's plate over four impacts by two methods, at one step.

Both runs are of scenes/csma2013/fig4.toml, with the settings of SETTINGS and of their row in METHODS. The
upper curves are the deflection of the middle of the free edge, the lower ones the energy.

Usage: scripts/impact_picture.py [--program FILE] > docs/impact.svg
"""

import argparse
import csv
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "scenes/csma2013/fig4.toml"
SETTINGS = ["time.step=1e-4", "output.every=5"]
# Name, settings, colour, and the place of the name beside the energy: s and ratio.
METHODS = [
    ("Newmark, consistent mass", ["time.mass=consistent"], "#D55E00", (0.23, 0.74)),
    ("conserving", ["time.scheme=conserving"], "#0072B2", (0.072, 1.03)),
]

WIDTH, LEFT, RIGHT = 640, 62, 580  # px: the picture, and the range of its curves
END = 0.5  # s
OBSTACLE = -0.1  # m
TIP = (30, 210, 0.22, -0.12)  # px and m: upper and lower end of the deflection
ENERGY = (262, 372, 1.1, 0.5)  # px and ratio: upper and lower end of the energy


def history(program, settings):
    """Returns times, deflections and energies over the first energy of a run."""
    with tempfile.TemporaryDirectory() as folder:
        changes = [word for setting in SETTINGS + settings for word in ("--set", setting)]
        command = [program, "run", SCENE, "--quiet", "--out", f"{folder}/run", *changes]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(done.stderr)
        with open(f"{folder}/run/history.csv", encoding="utf-8") as file:
            rows = [[float(row[name]) for name in ("time", "middle", "energy")] for row in csv.DictReader(file)]
    return [(time, tip, energy / rows[0][2]) for time, tip, energy in rows]


def across(time):
    return LEFT + (RIGHT - LEFT) * time / END


def down(value, panel):
    top, bottom, high, low = panel
    return top + (bottom - top) * (high - value) / (high - low)


def thinned(points, tolerance=0.12):
    """Returns the points without those that lie within a tolerance, in px, of the line between others."""
    (x, y), (end_x, end_y) = points[0], points[-1]
    length = ((end_x - x) ** 2 + (end_y - y) ** 2) ** 0.5
    apart = [abs((end_x - x) * (b - y) - (end_y - y) * (a - x)) / length for a, b in points]
    farthest = max(range(len(points)), key=apart.__getitem__)
    if apart[farthest] <= tolerance:
        return [points[0], points[-1]]
    return thinned(points[: farthest + 1])[:-1] + thinned(points[farthest:])


def curve(points, colour):
    words = " ".join(f"{x:.1f},{y:.1f}" for x, y in thinned(points))
    return f'<polyline fill="none" stroke="{colour}" stroke-width="1.6" stroke-linejoin="round" points="{words}"/>'


def text(x, y, words, anchor="start", colour="#222", weight="normal"):
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}" font-weight="{weight}">{words}</text>'


def frame(panel, title, ticks, label):
    """Returns the title, the horizontal lines and their labels of a panel."""
    lines = [text(LEFT, panel[0] - 10, title, weight="bold")]
    for tick in ticks:
        y = down(tick, panel)
        lines.append(f'<path d="M{LEFT} {y:.1f}H{RIGHT}" stroke="#D8D8D8"/>')
        lines.append(text(LEFT - 8, y + 4.5, label(tick), "end"))
    return lines


def picture(runs):
    height = ENERGY[1] + 42
    floor = down(OBSTACLE, TIP)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="DejaVu Sans, Verdana, sans-serif" font-size="13">',
        f'<rect width="{WIDTH}" height="{height}" rx="8" fill="#FFF"/>',
        *frame(TIP, "Deflection of the tip, mm", (0.2, 0.1, 0, -0.1), lambda tick: f"{1000 * tick:.0f}".replace("-", "\u2212")),
        f'<rect x="{LEFT}" y="{floor:.1f}" width="{RIGHT - LEFT}" height="{TIP[1] - floor + 6:.1f}" fill="#BDBDBD"/>',
        text(RIGHT - 8, floor + 13.5, "obstacle", "end"),
        *frame(ENERGY, "Energy, % of the initial energy", (1, 0.8, 0.6), lambda tick: f"{100 * tick:.0f}"),
        text((LEFT + RIGHT) / 2, height - 8, "time, s", "middle"),
    ]
    for tick in range(6):
        lines.append(text(across(tick / 10), ENERGY[1] + 16, f"{tick / 10:g}", "middle"))
    for column, panel in ((1, TIP), (2, ENERGY)):
        for (_, _, colour, _), rows in zip(METHODS, runs):
            lines.append(curve([(across(row[0]), down(row[column], panel)) for row in rows], colour))
    for (name, _, colour, (time, level)), rows in zip(METHODS, runs):
        last = rows[-1][2]
        lines.append(text(across(time), down(level, ENERGY), name, colour=colour, weight="bold"))
        lines.append(text(RIGHT + 6, down(last, ENERGY) + 4.5, f"{100 * last:.0f} %", colour=colour, weight="bold"))
    return "\n".join([*lines, "</svg>"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default=ROOT / "target/release/rebond")
    program = parser.parse_args().program
    print(picture([history(program, settings) for _, settings, *_ in METHODS]))


main()
