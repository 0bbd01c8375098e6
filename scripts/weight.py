#!/usr/bin/env python3
"""Lines of code per capability of src/, and their total.

A line of code is neither blank nor a comment, and stands outside inline tests. Every file belongs to the
capability with the longest path that begins the file's own.

Usage: scripts/weight.py            prints the table
       scripts/weight.py --write    writes the table into CONTRIBUTING.md
       scripts/weight.py --check    compares CONTRIBUTING.md with the sources, and the total with its limit
       scripts/weight.py --files    prints the lines of every file, largest first
"""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / "CONTRIBUTING.md"
BEGIN, END = "<!-- weight: begin -->\n", "<!-- weight: end -->\n"

# Largest total, in lines of code.
LIMIT = 64_300

# Difference up to which a row of the page counts as true: lines, and share of the row.
TOLERANCE = (30, 0.05)

# Capabilities in the order of a run, with the paths that belong to each, relative to src/.
CAPABILITIES = {
    "Ground: errors, geometry, archives, hashes": [
        "archive.rs", "communicator.rs", "error.rs", "geometry.rs", "hash.rs", "input.rs", "lib.rs", "main.rs", "memory.rs",
        "partition.rs", "quantity.rs",
    ],
    "Formulas of scenes": ["field"],
    "Elements": ["element"],
    "Adaptive quadrature": ["element/adaptive.rs"],
    "Meshes": ["mesh"],
    "Meshes from files": [
        "mesh/abaqus.rs", "mesh/cards.rs", "mesh/contents.rs", "mesh/cursor.rs", "mesh/file.rs", "mesh/gmsh.rs", "mesh/nastran.rs",
        "mesh/plane.rs",
    ],
    "Plates, degrees of freedom, matrices": ["assembly", "dof_map.rs", "plate.rs", "stress.rs", "motion.rs", "energy.rs"],
    "Obstacles": ["obstacle"],
    "Laws of contact": ["contact_law"],
    "Kernels: products of cells, loops over vectors": ["kernels"],
    "Linear algebra": ["linalg"],
    "Contact solvers and their check": ["vi"],
    "Natural modes": ["modes"],
    "The plate in its plane: tension, buckling, stretching": [
        "assembly/prestress.rs", "membrane", "modes/buckling.rs", "scene/in_plane.rs", "scheme/modal/stretching.rs",
        "simulation/effects/buckling.rs", "simulation/effects/registry/prestress.rs", "simulation/effects/stretching.rs",
    ],
    "Schemes: what all share": ["scheme"],
    "Newmark-e-beta": ["scheme/newmark"],
    "Midpoint": ["scheme/midpoint"],
    "Conserving": ["scheme/conserving", "scheme/feedback.rs"],
    "Massless part of the displacement": ["scheme/massless"],
    "Exact": ["scheme/exact"],
    "Schemes in modes (modal mass)": ["scheme/modal"],
    "PETSc": ["petsc"],
    "Several ranks": ["distributed"],
    "Runs in lock step": ["lock_step"],
    "Scene file": ["scene"],
    "Simulation: set-up, loop, readings": ["simulation"],
    "Effects": ["simulation/effects"],
    "Run folder": ["output"],
    "Pictures": ["output/plot"],
    "Report in the browser": ["output/report"],
    "Studies, checks and comparisons": ["study"],
    "Accuracy against time": ["study/accuracy"],
    "Random numbers": ["random"],
    "Sweeps": ["sweep"],
    "Periodic motions": ["continuation", "scheme/modal/return_map.rs"],
    "Friction of obstacles": [
        "vi/coulomb.rs",
        "scheme/coulomb",
        "simulation/effects/friction.rs",
        "simulation/frictional_probes.rs",
    ],
    "Commands": ["cli"],
}


def lines_of_code(text):
    """Returns the number of lines of code of a source file."""
    count, end, pending = 0, None, False
    for line in text.splitlines():
        bare = line.strip()
        if end is not None:
            if line.rstrip() == end:
                end = None
            continue
        if bare == "#[cfg(test)]":
            pending = True
            continue
        if pending:
            pending = False
            if bare.endswith("{"):
                end = line[: len(line) - len(line.lstrip())] + "}"
            continue
        count += bool(bare) and not bare.startswith("//")
    return count


def files():
    """Returns the lines of code of each file, by its path below src/."""
    source = ROOT / "src"
    return {str(path.relative_to(source)): lines_of_code(path.read_text()) for path in sorted(source.rglob("*.rs"))}


def capability(path):
    """Returns the capability that a file belongs to."""
    def length(prefix):
        whole = path == prefix or path.startswith(prefix + "/") or path.startswith(prefix + ".rs")
        return len(prefix) if whole else -1

    best = max((length(prefix), name) for name, prefixes in CAPABILITIES.items() for prefix in prefixes)
    if best[0] < 0:
        sys.exit(f"src/{path} belongs to no capability: add a row to CAPABILITIES in scripts/weight.py")
    return best[1]


def rows(counts):
    """Returns the lines of code of each capability."""
    sums = dict.fromkeys(CAPABILITIES, 0)
    for path, lines in counts.items():
        sums[capability(path)] += lines
    return sums


def table(sums):
    lines = ["| capability | lines of code |\n", "|---|---:|\n"]
    lines += [f"| {name} | {count} |\n" for name, count in sums.items()]
    return "".join(lines + [f"| all of `src/` (limit {LIMIT}) | {sum(sums.values())} |\n"])


def split(page):
    """Returns the page before, within and after the marks of the table."""
    before, _, rest = page.partition(BEGIN)
    within, _, after = rest.partition(END)
    return before, within, after


def check(sums):
    """Returns what is wrong with the page or the total."""
    wrong = []
    total = sum(sums.values())
    if total > LIMIT:
        wrong.append(f"src/ has {total} lines of code; expected at most {LIMIT}")
    within = split(PAGE.read_text())[1]
    told = {name: int(count) for name, count in re.findall(r"^\| (.+?) \| (\d+) \|$", within, re.MULTILINE)}
    for name, count in sums.items():
        if name not in told:
            wrong.append(f"CONTRIBUTING.md has no row of {name!r}")
        elif abs(told[name] - count) > max(TOLERANCE[0], TOLERANCE[1] * count):
            wrong.append(f"CONTRIBUTING.md: {name!r} has {count} lines of code, not {told[name]}")
    return wrong


def main():
    counts = files()
    sums = rows(counts)
    match sys.argv[1:]:
        case []:
            print(table(sums), end="")
        case ["--files"]:
            for path, lines in sorted(counts.items(), key=lambda item: -item[1]):
                print(f"{lines:6} {path}")
        case ["--write"]:
            before, _, after = split(PAGE.read_text())
            PAGE.write_text(before + BEGIN + table(sums) + END + after)
        case ["--check"]:
            wrong = check(sums)
            if wrong:
                sys.exit("\n".join(wrong) + "\nscripts/weight.py --write makes the table anew")
        case _:
            sys.exit(__doc__.strip())


if __name__ == "__main__":
    main()
