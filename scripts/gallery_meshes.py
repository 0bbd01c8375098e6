#!/usr/bin/env python3
"""Makes the meshes of scenes/gallery and scenes/hard in Gmsh's format 4.1, without Gmsh.

    python3 scripts/gallery_meshes.py
"""
from math import atan2, cos, hypot, pi, sin
from pathlib import Path

FOLDER = Path(__file__).parent.parent / "scenes"
LINE, TRIANGLE, QUADRANGLE = 1, 2, 3  # Gmsh's numbers of element types


def write(name, nodes, curves, surfaces, points=()):
    """Writes a mesh.

    Nodes are pairs (x, y). Curves, surfaces and points are triples of the physical name, Gmsh's element
    type, and the elements as tuples of node numbers from 0.
    """
    physical = [(0, point[0]) for point in points] + [(1, curve[0]) for curve in curves]
    physical += list(dict.fromkeys((2, surface[0]) for surface in surfaces))
    tag = {key: number for number, key in enumerate(physical, 1)}
    xs, ys = zip(*nodes)
    box = f"{min(xs)} {min(ys)} 0 {max(xs)} {max(ys)} 0"
    out = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(physical))]
    out += [f'{dimension} {tag[dimension, of]} "{of}"' for dimension, of in physical]
    out += ["$EndPhysicalNames", "$Entities", f"{len(points)} {len(curves)} {len(surfaces)} 0"]
    for number, (of, _, elements) in enumerate(points, 1):
        x, y = nodes[elements[0][0]]
        out.append(f"{number} {x} {y} 0 1 {tag[0, of]}")
    for dimension, entities in ((1, curves), (2, surfaces)):
        out += [f"{number} {box} 1 {tag[dimension, of]} 0" for number, (of, _, _) in enumerate(entities, 1)]
    out += ["$EndEntities", "$Nodes", f"1 {len(nodes)} 1 {len(nodes)}", f"2 1 0 {len(nodes)}"]
    out += [str(number) for number in range(1, len(nodes) + 1)]
    out += [f"{x:.16g} {y:.16g} 0" for x, y in nodes]
    blocks = [(dimension, number, kind, elements)
              for dimension, entities in ((0, points), (1, curves), (2, surfaces))
              for number, (_, kind, elements) in enumerate(entities, 1)]
    total = sum(len(elements) for *_, elements in blocks)
    out += ["$EndNodes", "$Elements", f"{len(blocks)} {total} 1 {total}"]
    number = 0
    for dimension, entity, kind, elements in blocks:
        out.append(f"{dimension} {entity} {kind} {len(elements)}")
        for element in elements:
            number += 1
            out.append(" ".join(str(n) for n in (number, *(node + 1 for node in element))))
    out.append("$EndElements")
    (FOLDER / name).write_text("\n".join(out) + "\n")


def disc(radius, rings):
    """Writes a disc of triangles with 6 k nodes on ring k."""
    first = [0] + [1 + 3 * k * (k - 1) for k in range(1, rings + 2)]

    def node(ring, place):
        return first[ring] + place % (6 * ring) if ring else 0

    nodes = [(0.0, 0.0)]
    for ring in range(1, rings + 1):
        r, count = radius * ring / rings, 6 * ring
        nodes += [(r * cos(2 * pi * i / count), r * sin(2 * pi * i / count)) for i in range(count)]
    triangles = []
    for ring in range(1, rings + 1):
        for sector in range(6):
            for i in range(ring):
                outer, inner = sector * ring + i, sector * (ring - 1) + i
                triangles.append((node(ring, outer), node(ring, outer + 1), node(ring - 1, inner)))
                if i < ring - 1:
                    triangles.append((node(ring - 1, inner), node(ring, outer + 1), node(ring - 1, inner + 1)))
    rim = [(node(rings, i), node(rings, i + 1)) for i in range(6 * rings)]
    write("gallery/disc.msh", nodes, [("rim", LINE, rim)], [("disc", TRIANGLE, triangles)])


def cover(length, width, hole, cells, rings):
    """Writes a centred rectangle with a round hole: quadrangles, and triangles along the outer edge."""
    nx, ny = cells
    outer = [(length * (i / nx - 0.5), -width / 2) for i in range(nx)]
    outer += [(length / 2, width * (j / ny - 0.5)) for j in range(ny)]
    outer += [(-x, -y) for x, y in outer]
    count = len(outer)
    nodes = []
    for ring in range(rings + 1):
        for x, y in outer:
            angle, share = atan2(y, x), ring / rings
            r = hole + share * (0.8 + 0.2 * share) * (hypot(x, y) - hole)
            nodes.append((r * cos(angle), r * sin(angle)) if ring < rings else (x, y))
    inner, middle, edge = [], [], []
    for i in range(count):
        j = (i + 1) % count
        for ring in range(rings):
            a, b, c, d = ring * count + i, (ring + 1) * count + i, (ring + 1) * count + j, ring * count + j
            if ring == rings - 1:
                edge += [(a, b, c), (a, c, d)]
            else:
                (inner if ring == 0 else middle).append((a, b, c, d))
    loop = lambda ring: [(ring * count + i, ring * count + (i + 1) % count) for i in range(count)]
    corner = lambda place: [(rings * count + place,)]
    corners = [("front left", 15, corner(0)), ("front right", 15, corner(nx)),
               ("back right", 15, corner(nx + ny)), ("back left", 15, corner(2 * nx + ny))]
    write("gallery/cover.msh", nodes, [("hole", LINE, loop(0)), ("outer", LINE, loop(rings))],
          [("collar", QUADRANGLE, inner), ("sheet", QUADRANGLE, middle), ("sheet", TRIANGLE, edge)], corners)


def jitter(number):
    """Returns a pseudo-random number between -1 and 1."""
    return 2 * (number * 0.6180339887498949 % 1) - 1


def plate(cells, place=lambda i, j: (i, j)):
    """Returns nodes, quadrangles and left edge of a plate of 1.2 m x 0.4 m.

    The nodes are at place(i, j), in units of cells.
    """
    nx, ny = cells
    at = lambda i, j: j * (nx + 1) + i
    nodes = [(1.2 * x / nx, 0.4 * y / ny) for x, y in (place(i, j) for j in range(ny + 1) for i in range(nx + 1))]
    quadrangles = [(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)) for j in range(ny) for i in range(nx)]
    return nodes, quadrangles, [(at(0, j), at(0, j + 1)) for j in range(ny)]


def cut(quadrangles):
    return [half for a, b, c, d in quadrangles for half in ((c, a, b), (a, c, d))]


def hard(name, nodes, quadrangles, triangles, left):
    """Writes a plate for scenes/hard."""
    cells = [("plate", kind, of) for kind, of in ((QUADRANGLE, quadrangles), (TRIANGLE, triangles)) if of]
    write(f"hard/{name}.msh", nodes, [("left", LINE, left)], cells)


def needles():
    """Writes triangles that are fifteen to forty-five times longer than wide."""
    nodes, quadrangles, left = plate((3, 30), lambda i, j: (i + 0.5 * (j % 2) * (0 < i < 3), j))
    hard("needles", nodes, [], cut(quadrangles), left)


def caps(flatness):
    """Writes triangles with an angle of nearly 180 degrees, one on either side of each diagonal."""
    nodes, quadrangles, left = plate((6, 2))
    triangles = []
    for p, q, r in cut(quadrangles):
        (px, py), (qx, qy), (rx, ry) = nodes[p], nodes[q], nodes[r]
        near = len(nodes)
        nodes.append(tuple((1 - flatness) * (p + q) / 2 + flatness * r for p, q, r in ((px, qx, rx), (py, qy, ry))))
        triangles += [(p, q, near), (q, r, near), (r, p, near)]
    hard("caps", nodes, [], triangles, left)


def dented(depth):
    """Writes quadrangles with an angle of nearly 180 degrees.

    The corner is the fraction `depth` of a diagonal away from the other diagonal.
    """
    dent = 0.5 - depth
    nodes, quadrangles, left = plate((6, 4), lambda i, j: (i - dent, j - dent) if i % 2 and j % 2 else (i, j))
    hard("dented", nodes, quadrangles, [], left)


def graded(name, ratio, is_cut):
    """Writes cells with jittered corners, whole or cut in two, whose size grows by a ratio."""
    nx, ny = cells = 12, 6

    def grown(k, n, number):
        k += 0.2 * jitter(number) if 0 < k < n else 0
        return n * (ratio**k - 1) / (ratio**n - 1)

    nodes, quadrangles, left = plate(cells, lambda i, j: (grown(i, nx, 7 * i + 13 * j), grown(j, ny, 7 * i + 13 * j + 5)))
    hard(name, nodes, [] if is_cut else quadrangles, cut(quadrangles) if is_cut else [], left)


def turned(angle):
    """Writes rotated quadrangles and triangles, away from the origin, with nodes in random order."""
    nodes, quadrangles, left = plate((6, 2))
    order = sorted(range(len(nodes)), key=jitter)
    number = {old: new for new, old in enumerate(order)}
    nodes = [(3 + cos(angle) * x - sin(angle) * y, sin(angle) * x + cos(angle) * y - 2) for x, y in (nodes[old] for old in order)]
    renumber = lambda elements: [tuple(number[node] for node in element) for element in elements]
    hard("turned", nodes, renumber(quadrangles[::2]), renumber(cut(quadrangles[1::2])), renumber(left))


disc(radius=0.2, rings=6)
cover(length=0.6, width=0.4, hole=0.06, cells=(12, 8), rings=4)
needles()
caps(flatness=0.03)
dented(depth=1e-3)
graded("graded", ratio=1.5, is_cut=False)
graded("graded-cut", ratio=1.4, is_cut=True)
turned(angle=0.5)
