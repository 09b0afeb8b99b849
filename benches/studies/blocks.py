"""Blocks of bilinear cells on a plane as cases, and the closed form of a column."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from bipot_rs import analytic, fem
from bipot_rs.fem.bodies.body import Box
from studies.exact import SLIP, STICK, Array, Case
from studies.measure import Answer

MU = 0.3
CELLS = {2: "quadrilateral", 3: "hexahedron"}


def body(
    axes: Sequence[ArrayLike], nu: float, young: float = 1.0, name: str = "block"
) -> fem.Body:
    """Box with the given grid lines."""
    return fem.Body(name, fem.box(axes, CELLS[len(axes)]), fem.Material(young, nu))


def on_plane(
    dim: int,
    name: str = "block",
    mu: float = MU,
    height: float = 0.0,
    within: Box | None = None,
) -> fem.Contact:
    """Contact of the lower face of a body with a horizontal plane."""
    up = np.eye(dim)[-1]
    return fem.Contact(name, "bottom", mu, plane=(height * up, up), within=within)


def case(
    model: fem.Assembly, load: Array | None = None, prescribed: Array | None = None
) -> Case:
    """Case of a model under one load."""
    gap = np.zeros((len(model.gap), model.dim))
    gap[:, 0] = model.gap
    return Case(
        model.K,
        model.B,
        np.zeros(model.n) if load is None else load,
        gap,
        model.mu,
        model.fixed,
        np.zeros(len(model.fixed)) if prescribed is None else prescribed,
    )


def pressed(
    axes: Sequence[ArrayLike],
    nu: float,
    *,
    mu: float = MU,
    moved: Sequence[float] = (0.004, -0.01),
    young: float = 1.0,
) -> Case:
    """Block whose top is pressed and moved aside: its contacts stick, slip and open."""
    dim = len(axes)
    model = fem.assemble(
        [body(axes, nu, young)],
        [on_plane(dim, mu=mu)],
        [fem.Support("block", "top", range(dim))],
    )
    return case(model, prescribed=model.prescribed([moved]))


def twins(make: Callable[[float], Case]) -> tuple[Case, tuple[Case, float]]:
    """Case with Young's modulus 1, and its twin with modulus 3.

    By homogeneity both have the same solution. Their K are rounded differently, so the
    difference of the computed solutions is the effect of the rounding of K.
    """
    return make(1.0), (make(3.0), 3.0)


def column(
    youngs: Sequence[float], nu: float, lines: Sequence[Array], *, bonded: bool = False
) -> tuple[Case, Answer]:
    """Stack of unit squares between smooth walls on a plane, pressed from above.

    `lines` are the grid lines of each square across and up, from 0 to 1. The contacts
    do not move and transmit the pressure: ``u = -p y / M`` in each square.
    """
    across, up = lines
    names = [f"square {k}" for k in range(len(youngs))]
    bodies = [
        body([across, k + up], nu, young, name)
        for k, (young, name) in enumerate(zip(youngs, names, strict=True))
    ]
    contacts = [on_plane(2, names[0])]
    if not bonded:
        contacts += [
            fem.Contact(upper, "bottom", MU, against=(lower, "top"))
            for lower, upper in itertools.pairwise(names)
        ]
    walls = [
        fem.Support(name, side, (0,)) for name in names for side in ("left", "right")
    ]
    model = fem.assemble(bodies, contacts, walls)
    load = model.traction(names[-1], "top", [0.0, -1.0])

    u, below = np.zeros((len(model.nodes), 2)), 0.0
    for k, young in enumerate(youngs):
        first, last = model.offset[k] // 2, (*model.offset, model.n)[k + 1] // 2
        displacement_of_block = analytic.oedometer(
            model.nodes[first:last, 1] - k, 1.0, young, nu
        )
        u[first:last, 1] = below + displacement_of_block
        below += float(displacement_of_block.min())
    r = np.zeros((len(model.area), 2))
    r[:, 0] = model.area
    whole = case(model, load)
    answer = Answer(r, np.zeros_like(r), u.ravel())
    return merged(model, whole, answer) if bonded else (whole, answer)


def merged(model: fem.Assembly, whole: Case, answer: Answer) -> tuple[Case, Answer]:
    """Same case with coincident nodes merged."""
    _, first, node = np.unique(
        model.nodes, axis=0, return_index=True, return_inverse=True
    )
    dofs = (2 * node.reshape(-1, 1) + np.arange(2)).ravel()
    ones = (np.ones(len(dofs)), (np.arange(len(dofs)), dofs))
    join = sparse.csr_array(ones, (len(dofs), 2 * len(first)))
    fixed = np.unique(dofs[whole.fixed])
    merged_case = Case(
        sparse.csr_array(join.T @ whole.K @ join),
        sparse.csr_array(whole.B @ join),
        join.T @ whole.load,
        whole.gap,
        whole.mu,
        fixed,
        np.zeros(len(fixed)),
    )
    kept = (2 * first[:, None] + np.arange(2)).ravel()
    return merged_case, answer._replace(u=answer.u[kept])


def at_rest(case: Case) -> Array:
    """Statuses of contacts that are pressed without a tangential force.

    They stick; those without friction, at the walls, have status slip.
    """
    return np.where(case.mu > 0, STICK, SLIP).astype(np.int8)


def sheared(
    axes: Sequence[ArrayLike], pressure: float, shear: float
) -> tuple[Case, Answer]:
    """Block with ν = 0 in uniform stress that sticks; only contact holds it.

    ``σ_nn = -pressure`` on top, ``σ_nt = shear`` on top and on the faces across x.
    """
    dim = len(axes)
    model = fem.assemble([body(axes, 0.0)], [on_plane(dim)], [])
    x, up = np.eye(dim)[[0, -1]]
    load = model.traction("block", "top", shear * x - pressure * up)
    load += model.traction("block", "right", shear * up)
    load -= model.traction("block", "left", shear * up)
    u = np.zeros((len(model.nodes), dim))
    u[:, 0], u[:, -1] = analytic.sheared_patch(model.nodes[:, -1], pressure, shear, 1.0)
    r = np.zeros((len(model.area), dim))
    r[:, 0], r[:, 1] = pressure * model.area, -shear * model.area
    return case(model, load), Answer(r, np.zeros_like(r), u.ravel())
