"""The paper's plate by GetFEM: matrices, and steps with its contact brick.

The unknown of a step is x = U^{n+1} - 2 U^n + U^{n-1}, as in rebond, with the step matrix
A = M / dt^2 + K / 2 and the right-hand side F - K U^n.
"""

import time

import getfem as gf
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

LENGTH, WIDTH, THICKNESS = 1.2, 0.4, 0.01  # m
YOUNGS_MODULUS, POISSONS_RATIO, DENSITY = 210e9, 0.3, 7770.0  # Pa, -, kg/m3
RIGIDITY = YOUNGS_MODULUS * THICKNESS**3 / (12 * (1 - POISSONS_RATIO**2))  # N m


gf.util("trace level", 0)


class Plate:
    """Matrices of the plate, clamped along x = 0, on reduced FVS quadrilaterals."""

    def __init__(self, cells):
        across, along = (np.linspace(0, size, count + 1) for size, count in zip((LENGTH, WIDTH), cells))
        mesh = gf.Mesh("cartesian", across, along)
        fields = gf.MeshFem(mesh, 1)
        fields.set_fem(gf.Fem("FEM_REDUCED_QUADC1_COMPOSITE"))
        # Squares of cubics have degree 6.
        rule = gf.MeshIm(mesh, gf.Integ("IM_QUADC1_COMPOSITE(IM_TRIANGLE(6))"))

        model = gf.Model("real")
        model.add_fem_variable("u", fields)
        model.add_initialized_data("D", [RIGIDITY])
        model.add_initialized_data("nu", [POISSONS_RATIO])
        model.add_Kirchhoff_Love_plate_brick(rule, "u", "D", "nu")
        model.assembly("build_matrix")
        stiffness = scipy_matrix(model.tangent_matrix())
        mass = scipy_matrix(gf.asm_mass_matrix(rule, fields)) * (DENSITY * THICKNESS)
        pressure = gf.asm_generic(rule, 1, "Test_u", -1, "u", 1, fields, np.zeros(fields.nbdof()))

        # The dofs of a node are its deflection and its two slopes, in this order.
        nodes = fields.basic_dof_nodes()
        free = np.flatnonzero(nodes[0] > 1e-9)
        first_of_node = np.arange(fields.nbdof()) % 3 == 0
        self.stiffness = stiffness[free][:, free].tocsc()
        self.mass = mass[free][:, free].tocsc()
        self.pressure = pressure[free]  # forces of 1 Pa
        # Numbers of the deflections, and of that of the middle, among the free dofs.
        self.deflections = np.flatnonzero(first_of_node[free])
        in_the_middle = np.hypot(nodes[0] - LENGTH / 2, nodes[1] - WIDTH / 2) < 1e-9
        self.middle = int(np.flatnonzero((first_of_node & in_the_middle)[free])[0])
        self.start = self.rest(-14600.0)

    def rest(self, pressure):
        """Returns the static displacement under a pressure, in Pa."""
        return splu(self.stiffness).solve(pressure * self.pressure)


def scipy_matrix(matrix):
    """Returns a matrix of GetFEM as one of scipy."""
    matrix.to_csc()
    columns, rows = matrix.csc_ind()
    values = matrix.csc_val()
    size = matrix.size()
    counts = np.diff(columns)
    return coo_matrix((values, (rows, np.repeat(np.arange(size[1]), counts))), shape=size).tocsc()


def run(plate, obstacle, pressure, step, steps):
    """Steps with the basic contact brick. Returns the deflection of the middle and the seconds a step."""
    dofs = plate.stiffness.shape[0]
    matrix = (plate.mass / step**2 + plate.stiffness / 2).tocsc()
    force = pressure * plate.pressure
    deflections = plate.deflections

    model = gf.Model("real")
    model.add_variable("x", dofs)
    a = gf.Spmat("empty", dofs, dofs)
    entries = matrix.tocoo()
    for row, column, value in zip(entries.row, entries.col, entries.data):
        a.add([int(row)], [int(column)], [float(value)])
    model.add_explicit_matrix("x", "x", a, True, True)
    rhs = model.add_explicit_rhs("x", np.zeros(dofs))
    # The brick demands B x <= gap: with B = -1 at the deflections, x >= -gap.
    selection = gf.Spmat("empty", len(deflections), dofs)
    for row, dof in enumerate(deflections):
        selection.add([row], [int(dof)], [-1.0])
    model.add_variable("reaction", len(deflections))
    model.add_initialized_data("r", [matrix.diagonal()[deflections].mean()])
    model.add_initialized_data("gap", np.zeros(len(deflections)))
    model.add_basic_contact_brick("x", "reaction", "r", selection, "gap", "", 1)

    u, last = plate.start.copy(), None
    began = time.perf_counter()
    for _ in range(steps):
        b = force - plate.stiffness @ u
        # At the start the velocity is 0: U^{-1} = U^1, and x = 2 (U^1 - U^0).
        increment = u - last if last is not None else None
        free_flight = u + increment if increment is not None else u
        scale = 1.0 if increment is not None else 2.0
        model.set_variable("gap", scale * (free_flight[deflections] - obstacle))
        model.set_private_rhs(rhs, b)
        model.set_variable("x", np.zeros(dofs))
        _, converged = model.solve("max_iter", 200, "max_res", 1e-9 * np.abs(b).max())
        if not converged:
            raise RuntimeError("GetFEM's solver has not converged")
        last, u = u, free_flight + model.variable("x") / scale
    return float(u[plate.middle]), (time.perf_counter() - began) / steps


def write_for_petsc(plate, pressure, file):
    """Writes stiffness, mass, load, start and numbers of the deflections in PETSc's binary format."""
    with open(file, "wb") as out:
        for matrix in (plate.stiffness.tocsr(), plate.mass.tocsr()):
            matrix.sort_indices()
            rows, columns = matrix.shape
            header = [1211216, rows, columns, matrix.nnz]  # class identifier of a matrix
            np.concatenate([header, np.diff(matrix.indptr), matrix.indices]).astype(">i4").tofile(out)
            matrix.data.astype(">f8").tofile(out)
        for vector in (pressure * plate.pressure, plate.start, plate.deflections):
            np.array([1211214, len(vector)], ">i4").tofile(out)  # class identifier of a vector
            vector.astype(">f8").tofile(out)
