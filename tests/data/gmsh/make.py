#!/usr/bin/env python3
"""Makes the meshes of this folder from its .geo files, and expected.json from Gmsh's own answers.

    pip install gmsh==4.15.2 meshio==5.3.5 && python make.py
"""
import json, os, struct, tempfile
import gmsh, meshio

FORMATS = {"22_text": (2.2, 0), "22_binary": (2.2, 1), "41_text": (4.1, 0), "41_binary": (4.1, 1)}


def mesh(geo, **options):
    gmsh.clear()
    gmsh.option.restoreDefaults()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.open(geo)
    for name, value in options.items():
        gmsh.option.setNumber("Mesh." + name, value)
    gmsh.model.mesh.generate(2)


def write(name, version, binary, **options):
    for option, value in {"MshFileVersion": version, "Binary": binary, **options}.items():
        gmsh.option.setNumber("Mesh." + option, value)
    gmsh.write(name)


def measure(dimension, elements):
    """Returns the number of lines or cells, and their length or area, by Gmsh."""
    volume = gmsh.model.mesh.getElementQualities(elements, "volume")
    if dimension == 1:  # Gmsh does not provide the "volume" of a line
        volume = []
        for element in elements:
            a, b = (gmsh.model.mesh.getNode(n)[0] for n in gmsh.model.mesh.getElement(element)[1])
            volume.append(sum((x - y) ** 2 for x, y in zip(a, b)) ** 0.5)
    return [len(elements), float(sum(volume))]


def expected():
    def elements(dimension, tag):
        return [e for block in gmsh.model.mesh.getElements(dimension, tag)[1] for e in block]

    def group(dimension, tag):
        entities = gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)
        return [e for entity in entities for e in elements(dimension, entity)]

    result = {"triangles": len(gmsh.model.mesh.getElementsByType(2)[0]),
              "quadrilaterals": len(gmsh.model.mesh.getElementsByType(3)[0]),
              "area": measure(2, elements(2, -1))[1], "edges": {}, "groups": {}, "points": {}}
    if not gmsh.model.getPhysicalGroups():
        result["edges"] = {str(tag): measure(1, elements(1, tag)) for _, tag in gmsh.model.getEntities(1)}
    cells = gmsh.model.mesh.getElements(2)[2]
    result["nodes"] = len({int(n) for block in cells for n in block})
    for dimension, tag in gmsh.model.getPhysicalGroups():
        name = gmsh.model.getPhysicalName(dimension, tag) or str(tag)
        if dimension == 0:
            nodes = gmsh.model.mesh.getNodesForPhysicalGroup(0, tag)[1].reshape(-1, 3)
            result["points"][name] = [[float(x), float(y)] for x, y, _ in nodes]
        else:
            result["edges" if dimension == 1 else "groups"][name] = measure(dimension, group(dimension, tag))
    return result


def swapped(data):
    """Returns a binary file with the other order of bytes."""
    at, out = 0, bytearray()

    def copy(end):
        nonlocal at
        stop = data.index(end, at) + len(end)
        out.extend(data[at:stop])
        at = stop

    def swap(kinds):
        nonlocal at
        values = struct.unpack_from("<" + kinds, data, at)
        out.extend(struct.pack(">" + kinds, *values))
        at += struct.calcsize("<" + kinds)
        return values

    copy(b" 8\n"), swap("i")
    version = data[len("$MeshFormat\n"):][:3]
    if version == b"2.2":
        copy(b"$Nodes\n")
        start = at
        copy(b"\n")
        for _ in range(int(data[start:at])):
            swap("i3d")
        copy(b"$Elements\n")
        start = at
        copy(b"\n")
        left = int(data[start:at])
        while left:
            kind, count, tags = swap("3i")
            for _ in range(count):
                swap("i" * (1 + tags + {1: 2, 2: 3, 3: 4, 15: 1}[kind]))
            left -= count
    else:
        copy(b"$Entities\n")
        for dimension, count in enumerate(swap("4Q")):
            for _ in range(count):
                swap("i3d" if dimension == 0 else "i6d")
                for _ in range(1 if dimension == 0 else 2):
                    swap("i" * swap("Q")[0])
        copy(b"$Nodes\n")
        for _ in range(swap("4Q")[0]):
            _, _, parametric, count = swap("3iQ")
            assert not parametric
            swap("Q" * count), swap("3d" * count)
        copy(b"$Elements\n")
        for _ in range(swap("4Q")[0]):
            _, _, kind, count = swap("3iQ")
            swap("Q" * count * (1 + {1: 2, 2: 3, 3: 4, 15: 1}[kind]))
    return bytes(out) + data[at:]


os.chdir(os.path.dirname(os.path.abspath(__file__)))
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
answers = {}
for name in ["hole", "square", "quads"]:
    mesh(name + ".geo")
    answers[name] = expected()
    for form, (version, binary) in FORMATS.items():
        write(f"{name}_{form}.msh", version, binary)
    if name == "square":
        write("square_22_parametric.msh", 2.2, 0, SaveParametric=1)
        write("square_22_parametric_binary.msh", 2.2, 1, SaveParametric=1)
        write("square_41_parametric.msh", 4.1, 0, SaveParametric=1)
        write("square_41_parametric_binary.msh", 4.1, 1, SaveParametric=1)
        for form in ["22", "41"]:
            gmsh.option.setNumber("Mesh.SaveParametric", 0)
            with open(f"square_{form}_binary.msh", "rb") as file:
                data = swapped(file.read())
            with open(f"square_{form}_big_endian.msh", "wb") as file:
                file.write(data)

mesh("square.geo")
gmsh.model.mesh.partition(2)
for form, (version, binary) in FORMATS.items():
    write(f"square_{form}_partitioned.msh", version, binary)
mesh("square.geo", ElementOrder=2)
write("second_order.msh", 4.1, 0)

# Gmsh itself reads the swapped files.
for form in ["22", "41"]:
    gmsh.clear()
    gmsh.open(f"square_{form}_big_endian.msh")
    cells = [len(gmsh.model.mesh.getElementsByType(kind)[0]) for kind in (2, 3)]
    times = 2 if form == "22" else 1  # format 2.2 repeats a cell for each of its groups
    assert cells == [times * answers["square"][kind] for kind in ("triangles", "quadrilaterals")], cells

# The same mesh is written by another program, which supports only one group per cell.
for form, (version, binary) in FORMATS.items():
    meshio.write(f"meshio_{form}.msh", meshio.read("hole_41_binary.msh"), file_format="gmsh" if version == 4.1 else "gmsh22", binary=bool(binary))

with open("expected.json", "w") as file:
    json.dump(answers, file, indent=1)
    file.write("\n")
gmsh.finalize()
