"""Reads the snapshots of a run with VTK's own reader and checks them. Usage: vtk.py REBOND [MPIRUN ...]

Nothing here is computed as in rebond: points and cells are counted, energies and probes come from
history.csv, and between two nodes both elements have by definition a cubic deflection and a linear
slope across the edge.
"""

import csv
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as xml

from vtkmodules.vtkIOXML import vtkXMLPUnstructuredGridReader, vtkXMLUnstructuredGridReader

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
CELLS, PARTS = (10, 4), 5
LENGTH, WIDTH, HEIGHT = 1.2, 0.4, -0.1
SURFACE_DENSITY = 7770.0 * 0.01
STEP, END, EVERY = 1e-4, 0.06, 20
# Settings of a run that starts at rest under 14600 Pa and falls on the obstacle before its end.
SHORT = [
    f"time.step={STEP}",
    f"time.end={END}",
    "output.every=1",
    f"output.fields_every={EVERY}",
    f"output.subdivide={PARTS}",
    "output.precision=64",
]
failures = 0


def expect(is_so, what):
    global failures
    if not is_so:
        failures += 1
        print(f"FAILED: {what}")


def near(a, b, tolerance, what):
    expect(abs(a - b) <= tolerance, f"{what}: {a!r} is not {b!r} to {tolerance:.1e}")


def simulate(command, scene, folder, more=()):
    changes = [part for change in [*SHORT, *more] for part in ("--set", change)]
    subprocess.run([*command, "run", scene, "--quiet", "--out", folder, *changes], check=True)


def index(folder):
    """Returns times and files of fields.pvd."""
    root = xml.parse(os.path.join(folder, "fields.pvd")).getroot()
    entries = root.find("Collection").findall("DataSet")
    return [(float(e.get("timestep")), os.path.join(folder, e.get("file"))) for e in entries]


def read(path):
    reader = vtkXMLPUnstructuredGridReader() if path.endswith(".pvtu") else vtkXMLUnstructuredGridReader()
    errors = []
    reader.AddObserver("ErrorEvent", lambda *_: errors.append(path))
    reader.SetFileName(path)
    reader.Update()
    expect(not errors, f"{path}: VTK complains")
    return reader.GetOutput()


def array(data, name):
    values = data.GetArray(name)
    if values is None:
        expect(False, f"no array {name}")
        return []
    rows = [values.GetTuple(i) for i in range(values.GetNumberOfTuples())]
    expect(all(math.isfinite(v) for row in rows for v in row), f"{name} is finite")
    return [row[0] if len(row) == 1 else row for row in rows]


def at(grid):
    """Returns the number of the point at each position."""
    points = (grid.GetPoint(i) for i in range(grid.GetNumberOfPoints()))
    return {(round(x, 9), round(y, 9)): i for i, (x, y, _) in enumerate(points)}


def area(grid, cell):
    points = grid.GetCell(cell).GetPoints()
    corners = [points.GetPoint(i) for i in range(points.GetNumberOfPoints())]
    return 0.5 * sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(corners, corners[1:] + corners[:1]))


def check_edges(grid, w, slope):
    """Checks that along the edges from left to right the deflection is cubic and the slope across linear."""
    place = at(grid)
    h = LENGTH / CELLS[0]
    for j in range(CELLS[1] + 1):
        y = WIDTH * j / CELLS[1]
        for i in range(CELLS[0]):
            a, b = (place[round(h * k, 9), round(y, 9)] for k in (i, i + 1))
            for part in range(1, PARTS):
                s = part / PARTS
                point = place[round(h * (i + s), 9), round(y, 9)]
                cubic = w[a] * (1 + 2 * s) * (1 - s) ** 2 + w[b] * s * s * (3 - 2 * s)
                cubic += h * (slope[a][0] * s * (1 - s) ** 2 - slope[b][0] * s * s * (1 - s))
                near(w[point], cubic, 1e-13, "deflection on an edge")
                near(slope[point][1], (1 - s) * slope[a][1] + s * slope[b][1], 1e-12, "slope across an edge")


def check_native(rebond, scene, triangles, static):
    with tempfile.TemporaryDirectory() as folder:
        simulate([rebond], scene, folder)
        with open(os.path.join(folder, "history.csv")) as file:
            history = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
        snapshots = index(folder)
        expect(len(snapshots) == round(END / STEP / EVERY) + 1, f"{scene}: {len(snapshots)} snapshots")
        touched = 0
        for number, (instant, path) in enumerate(snapshots):
            grid = read(path)
            n = number * EVERY
            row = history[n]
            near(instant, row["time"], 0.0, "time in the index")
            near(grid.GetFieldData().GetArray("TimeValue").GetValue(0), instant, 0.0, "time in the file")
            points = (CELLS[0] * PARTS + 1) * (CELLS[1] * PARTS + 1)
            small = CELLS[0] * CELLS[1] * PARTS**2
            expect(grid.GetNumberOfPoints() == points, f"{grid.GetNumberOfPoints()} points, not {points}: shared")
            expect(grid.GetNumberOfCells() == small * (2 if triangles else 1), "number of cells")
            areas = [area(grid, i) for i in range(grid.GetNumberOfCells())]
            near(sum(areas), LENGTH * WIDTH, 1e-12, "area")

            names = ("deflection", "slope", "velocity", "displacement", "gap", "reaction")
            w, slope, velocity, displacement, gap, reaction = (array(grid.GetPointData(), name) for name in names)
            corner = at(grid)[LENGTH, 0.0]
            near(w[corner], row["corner"], 1e-15, "deflection of the corner")
            if n == 0:
                near(w[corner], static, 1e-9, "static deflection of the corner")
            if 0 < n < len(history) - 1:
                rate = (history[n + 1]["corner"] - history[n - 1]["corner"]) / (2 * STEP)
                near(velocity[corner], rate, 1e-9, "velocity of the corner")
            expect(all(d == (0.0, 0.0, value) for d, value in zip(displacement, w)), "displacement is (0, 0, w)")
            expect(all(g == value - HEIGHT for g, value in zip(gap, w)), "gap is w less the obstacle's height")
            expect(all(z == HEIGHT for z in array(grid.GetPointData(), "floor")), "the obstacle is the floor")
            near(sum(reaction), row["contact_force"], 1e-9 * max(1.0, row["contact_force"]), "sum of reactions")
            expect(sum(r != 0.0 for r in reaction) == row["contact_nodes"], "nodes in contact")
            touched += row["contact_nodes"] > 0
            check_edges(grid, w, slope)
            mean = array(grid.GetCellData(), "mean_velocity")
            kinetic = 0.5 * SURFACE_DENSITY * sum(area * v * v for area, v in zip(areas, mean))
            near(kinetic, row["kinetic"], 1e-9 * history[0]["energy"], "kinetic energy of the cells' velocities")
        expect(touched > 0, f"{scene}: no snapshot in contact")


def check_parallel(rebond, mpirun, scene):
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        simulate([rebond], scene, one, ["time.end=0.01"])
        simulate([*mpirun, rebond], scene, two, ["time.end=0.01"])
        pairs = list(zip(index(one), index(two)))
        expect(len(pairs) == 6, "six snapshots")
        for (t, path), (parallel_t, parallel_path) in pairs:
            near(t, parallel_t, 0.0, "time")
            expect(parallel_path.endswith(".pvtu"), "several ranks write .pvtu")
            grid, parallel = read(path), read(parallel_path)
            expect(grid.GetNumberOfCells() == parallel.GetNumberOfCells(), "as many cells on two ranks")
            expect(set(array(parallel.GetCellData(), "rank")) == {0.0, 1.0}, "both ranks have cells")
            place = at(grid)
            for name in ("deflection", "velocity", "gap"):
                alone, together = array(grid.GetPointData(), name), array(parallel.GetPointData(), name)
                scale = max(map(abs, alone)) + 1e-6
                for i, value in enumerate(together):
                    x, y, _ = parallel.GetPoint(i)
                    near(value, alone[place[round(x, 9), round(y, 9)]], 1e-8 * scale, f"{name} on two ranks")


def check_killed(rebond, scene):
    """Checks that a killed run leaves a sound index, all of whose files are complete."""
    with tempfile.TemporaryDirectory() as folder:
        command = [rebond, "run", scene, "--quiet", "--out", folder, "--set", "time.end=1000"]
        run = subprocess.Popen([*command, "--set", "output.fields_every=10"])
        # The output determines the instant, not a clock, since the machine may be busy.
        has_begun = lambda: os.path.exists(os.path.join(folder, "fields.pvd"))
        while run.poll() is None and not (has_begun() and len(index(folder)) >= 20):
            time.sleep(0.01)
        run.send_signal(signal.SIGKILL)
        run.wait()
        snapshots = index(folder)
        expect(len(snapshots) > 0, "snapshots before the end")
        for _, path in snapshots[-3:]:
            expect(read(path).GetNumberOfPoints() > 0, f"{path} is whole")


def main(rebond, mpirun):
    scenes = os.path.join(ROOT, "scenes", "csma2013")
    triangles, quadrilaterals = (os.path.join(scenes, name) for name in ("fig1.toml", "fig2.toml"))
    # Static deflections of extended computations, see tests/plate/statics.rs.
    check_native(rebond, triangles, True, 0.2065318015)
    check_native(rebond, quadrilaterals, False, 0.2076308761)
    check_killed(rebond, quadrilaterals)
    if mpirun:
        check_parallel(rebond, mpirun, quadrilaterals)
    print(f"VTK reads the fields{' of two ranks' if mpirun else ''}: {failures} failures")
    return failures > 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
