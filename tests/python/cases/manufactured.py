"""M1–M8: a manufactured solution with stick, slip and open parts.

The body is the unit square or cube over a rigid plane at its bottom. Its displacement u is
any smooth field; its stress gives the forces in the body and on its surface. The reactions r
and the relative displacements v of the contact are given too: a traction ``p = σ n - r`` acts
on the bottom besides, and the initial gap and offset are ``g = v - u``. So r and v only have to
satisfy (6) and (8) at each point, and u is smooth whatever they are.

With the coordinate s, which is x in the plane, the contact sticks for s < 1/3, slips for
1/3 < s < 2/3 and is open beyond. r_n ends linearly at 2/3, and the reserve ``μ r_n - |r_t|``
at 1/3; v_n and v_t begin quadratically there.

Orders expected for elements of order k: k for the gradient of u. k + 1/2 for u, since by the
argument of Aubin and Nitsche the order grows by the regularity of a problem whose conditions
change at the ends of the zones, where gradients of its solution are like the inverse root of
the distance. min(k, 3/2) for tractions, whose kinks no function on a mesh follows better than
h^(3/2). 1 for the ends of the zones: a status belongs to a node.
"""

import math
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.mesh.elements import facet_nodes, inverse, jacobian
from bipot_rs.mesh.kinds import reference
from cases.verification import Refinement

Array = NDArray[np.float64]
MU, LAME, SHEAR = 0.3, 15 / 26, 5 / 13  # E = 1, ν = 0.3
ROCK = fem.Material(1.0, 0.3)
STICKS, TOUCHES = 1 / 3, 2 / 3
BENT = 0.8  # of the ends of the zones in space

# u_i = a_i sin(k_i · x + φ_i)
SIZE = np.array([0.10, 0.08, 0.09])
WAVE = np.array([[1.9, 1.3, 0.8], [1.1, -1.4, 1.7], [-0.9, 1.6, 1.2]])
PHASE = np.array([0.4, 1.1, 0.7])


class Field(NamedTuple):
    """The exact displacement in d dimensions, at places ``(d, ...)``."""

    d: int

    def _angles(self, x: Array) -> Array:
        wave, phase = WAVE[: self.d, : self.d], PHASE[: self.d]
        return np.tensordot(wave, x, 1) + phase.reshape(-1, *[1] * (x.ndim - 1))

    def displacement(self, x: Array) -> Array:
        return np.einsum("i,i...->i...", SIZE[: self.d], np.sin(self._angles(x)))

    def gradient(self, x: Array) -> Array:
        """``∂_a u_i``, ``(i, a, ...)``."""
        slope = SIZE[: self.d, None] * WAVE[: self.d, : self.d]
        return np.einsum("ia,i...->ia...", slope, np.cos(self._angles(x)))

    def stress(self, x: Array) -> Array:
        """In plane strain for d = 2."""
        slope = self.gradient(x)
        trace = np.einsum("ii...->...", slope)
        unit = np.eye(self.d).reshape(self.d, self.d, *[1] * (x.ndim - 1))
        return LAME * trace * unit + SHEAR * (slope + slope.swapaxes(0, 1))

    def force(self, x: Array) -> Array:
        """``-div σ = -(λ + G) grad div u - G Δu``."""
        u, wave = self.displacement(x), WAVE[: self.d, : self.d]
        divergence = np.einsum("ki,kk,k...->i...", wave, wave, u)
        return (LAME + SHEAR) * divergence + SHEAR * np.einsum(
            "ia,ia,i...->i...", wave, wave, u
        )


def along(x: Array) -> Array:
    """The coordinate s of the zones."""
    return x[0] if len(x) == 2 else x[0] + BENT * (x[1] - 0.5) ** 2


def slip_direction(x: Array) -> Array:
    """Unit vectors in the plane of the contact; in space they turn from place to place."""
    if len(x) == 2:
        return np.ones((1, *x.shape[1:]))
    angle = 0.5 + x[1]
    return np.stack([np.cos(angle), np.sin(angle)])


def reaction(x: Array) -> Array:
    """Force per area on the body, the last component is the normal one."""
    s = along(x)
    normal = 0.2 * (1 + 0.5 * x[0]) * np.maximum(TOUCHES - s, 0)
    share = 1 - 1.5 * np.maximum(STICKS - s, 0)
    return np.concatenate([-MU * share * normal * slip_direction(x), normal[None]])


def relative(x: Array) -> Array:
    """The relative displacement v."""
    s = along(x)
    slip = 0.3 * np.maximum(s - STICKS, 0) ** 2 * slip_direction(x)
    return np.concatenate([slip, 0.3 * np.maximum(s - TOUCHES, 0)[None] ** 2])


class Errors(NamedTuple):
    """Relative errors of one mesh."""

    h: float
    displacement: float
    gradient: float
    traction: float
    ends: float


def surface_forces(body: fem.Body) -> Array:
    """∫ φ_i r over the bottom, ``(nodes, d)``, with many points for the kinks of r."""
    corners = facet_nodes(body.mesh, body.facets("bottom"))
    x, w = np.polynomial.legendre.leggauss(40 if body.dim == 2 else 16)
    places, weights = (x[None] + 1) / 2, w / 2
    if body.dim == 3:
        places = np.stack([a.ravel() for a in np.meshgrid(places[0], places[0])])
        weights = np.outer(weights, weights).ravel()
    if body.kind.facet.shape == "triangle":
        # The unit square collapses onto the triangle: its side at y = 1 has no length.
        weights = 2 * weights * (1 - places[1])
        places = np.stack([places[0] * (1 - places[1]), places[1]])
    element = body.kind.facet.element()
    count = corners.shape[1]
    phi = np.stack([element.lbasis(places, i)[0] for i in range(count)])
    area = body.surface("bottom").weights.sum(axis=1)
    density = reaction(np.einsum("pcd,cq->dpq", body.points[corners], phi))
    parts = np.einsum("dpq,p,q,cq->pcd", density, area, weights, phi, optimize=True)
    forces = np.zeros_like(body.points)
    np.add.at(forces, corners, parts)
    return forces


def norms(body: fem.Body, exact: Field, u: Array) -> tuple[float, float]:
    """Errors of u ``(nodes, d)`` and of its gradient in L², by a rule of order 6."""
    phi, slopes, weights = reference(body.kind.scalar, 6)
    x = body.points[body.cells]
    inner, determinant = inverse(jacobian(x, slopes))
    volume = np.abs(determinant).T * weights
    places = np.einsum("pcd,cq->dpq", x, phi)
    there, steep = exact.displacement(places), exact.gradient(places)
    nodal = u[body.cells]
    off = np.einsum("pci,cq->ipq", nodal, phi) - there
    gradient = np.einsum("pci,qbc,qbap->iapq", nodal, slopes, inner, optimize=True)
    off_gradient = gradient - steep

    def ratio(error: Array, size: Array) -> float:
        squares = [np.sum(volume * field**2) for field in (error, size)]
        return math.sqrt(squares[0] / squares[1])

    return ratio(off, there), ratio(off_gradient, steep)


CELLS = {
    (2, "P"): "triangle",
    (2, "Q"): "quadrilateral",
    (3, "P"): "tetrahedron",
    (3, "Q"): "hexahedron",
}


class Solved(NamedTuple):
    """The discrete problem and its answer."""

    model: fem.Assembly
    result: Any
    exact: Field


def solve(d: int, element: str, n: int) -> Solved:
    """``element`` is P1, P2, Q1 or Q2, n the number of cells along a side."""
    mesh = fem.box([np.linspace(0, 1, n + 1)] * d, CELLS[d, element[0]])
    if element[1] == "2":
        mesh = fem.second_order(mesh)
    body, exact = fem.Body("body", mesh, ROCK), Field(d)
    # Faces of six nodes have no positive areas of their own.
    pairing = "match" if body.kind.facet.lumps else "mortar"
    plane = np.zeros(d), np.eye(d)[-1]
    contact = fem.Contact("body", "bottom", MU, plane=plane, pairing=pairing)
    top = fem.Support("body", "top", range(d))
    model = fem.assemble([body], [contact], [top])
    load = model.body_force("body", exact.force) - surface_forces(body).ravel()
    for name, (axis, end) in fem.FACES[d].items():
        if name != "top":
            sign = 2.0 * end - 1
            load += model.traction(
                "body", name, lambda x, a=axis, s=sign: s * exact.stress(x)[a]
            )
    places = body.points.T
    u = exact.displacement(places)
    # B takes the values at the nodes as it takes displacements, also where it weighs them.
    gap = (model.B @ (relative(places) - u).T.ravel()).reshape(-1, d)
    problem = bp.ContactProblem(
        model.K, model.B, gap=gap, mu=MU, fixed=model.fixed, area=model.area
    )
    result = problem.solve(load, u.T.ravel()[model.fixed])
    return Solved(model, result, exact)


@cache
def errors(d: int, element: str, n: int) -> Errors:
    model, result, exact = solve(d, element, n)
    (body,) = model.bodies
    u = result.displacement[0].reshape(-1, d)
    displacement, gradient = norms(body, exact, u)
    wanted = np.einsum("ckd,dc->ck", model.frame, reaction(model.points.T))
    off = np.sum((result.traction[0] - wanted) ** 2, axis=1)
    size = np.sum(wanted**2, axis=1)
    traction = math.sqrt(np.sum(model.area * off) / np.sum(model.area * size))
    return Errors(1 / n, displacement, gradient, traction, misplaced(model, result))


def misplaced(model: fem.Assembly, result: Any) -> float:
    """Share of the contact whose nearest contact node has another status than the exact one.

    The ends of the zones are h/4 or so from the nearest border between two nodes, if all
    statuses are right.
    """
    d = model.dim
    fine = (np.arange(20_000 if d == 2 else 300) + 0.5) / (20_000 if d == 2 else 300)
    places = np.stack([a.ravel() for a in np.meshgrid(*[fine] * (d - 1))])
    _, node = cKDTree(model.points[:, :-1]).query(places.T)
    s = along(np.concatenate([places, np.zeros((1, places.shape[1]))]))
    exact = np.where(s < STICKS, bp.Status.STICK, bp.Status.SLIP)
    exact = np.where(s > TOUCHES, bp.Status.OPEN, exact)
    return float(np.mean(result.status[0][node] != exact))


# Cells along a side; the last one takes too long for a quick test.
SIZES = {
    (2, "P1"): (8, 16, 32, 64),
    (2, "Q1"): (8, 16, 32, 64),
    (2, "P2"): (4, 8, 16, 32),
    (2, "Q2"): (4, 8, 16, 32),
    (3, "P1"): (5, 10, 20),
    (3, "Q1"): (4, 8, 16),
    (3, "P2"): (2, 4, 8),
    (3, "Q2"): (2, 4, 8),
}


def refinements(d: int, element: str, fine: bool = False) -> list[Refinement]:
    """Errors of u, of its gradient, of tractions, and of the ends of the zones."""
    counts = SIZES[d, element]
    meshes = [errors(d, element, n) for n in (counts if fine else counts[:-1])]
    k = int(element[1])
    expected = {"displacement": k + 0.5, "gradient": k, "traction": min(k, 1.5)}
    return [
        Refinement(
            what,
            f"{element}, d = {d}",
            [mesh.h for mesh in meshes],
            [],
            [],
            [getattr(mesh, what) for mesh in meshes],
            # The ends lie anywhere in a cell, and coarse meshes have two cells in a zone.
            order=order - 0.2,
            within=0.3,
        )
        for what, order in [*expected.items(), ("ends", 1)]
    ]


def rows(fine: bool) -> list[list[str]]:
    """A line for each mesh, with the errors and the orders."""
    lines = []
    for name, case in CASES.items():
        tables = case(fine)
        for i, h in enumerate(tables[0].sizes):
            first = [name.upper(), tables[0].source] if i == 0 else ["", ""]
            cells = [*first, f"1/{round(1 / h)}"]
            for table in tables:
                order = f"{table.orders[i - 1]:.1f}" if i else ""
                cells += [f"{table.error[i]:.1e}", order]
            lines.append(cells)
    return lines


CASES = {
    f"m{i}": partial(refinements, d, element) for i, (d, element) in enumerate(SIZES, 1)
}
