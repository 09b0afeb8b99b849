"""A steel pin that pulls a lug of aluminium: NAFEMS contact benchmark 4, in plane strain.

A half is modelled, y ≥ 0. Pin and hole have the radius 50 mm, without clearance. The lug has
a round end of radius 100 mm, is 200 mm high and clamped 200 mm from the centre. In SSNP156 of
code_aster, 10 kN per mm of thickness act on the half pin, at its centre.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
import skfem
from numpy.typing import NDArray

from bipot_rs import fem

Array = NDArray[np.float64]
RADIUS, END, LENGTH, FORCE = 50.0, 100.0, 200.0, 1e4
# The load acts on the nodes of this circle, instead of one node.
CENTRE = 2.0


class Loaded(NamedTuple):
    """Results; contacts are sorted from the front, in the direction of the force."""

    front: float  # u_x of the hole in front [mm]
    traction: Array  # pressure and friction [MPa]
    force: float  # on the hole, along x [N/mm]


def _polar(
    inside: Array, outside: Array, angle: Array, layers: Array
) -> skfem.MeshQuad:
    """Quadrilaterals between two curves; layers are fractions of the way from 0 to 1."""
    radius = inside + np.outer(layers, outside - inside)
    points = np.stack([(radius * f(angle)).ravel() for f in (np.cos, np.sin)])
    row, column = np.divmod(
        np.arange((len(layers) - 1) * (len(angle) - 1)), len(angle) - 1
    )
    first, up = row * len(angle) + column, len(angle)
    return skfem.MeshQuad(
        points, np.stack([first, first + up, first + up + 1, first + 1])
    )


@cache
def loaded(n: int, mu: float) -> Loaded:
    """Solve on 18 n cells around the half pin and 8 n layers in each body."""
    corner = np.pi - np.arctan2(END, LENGTH)
    angle = np.concatenate(
        [
            np.linspace(0, np.pi / 2, 9 * n, endpoint=False),
            np.linspace(np.pi / 2, corner, 6 * n, endpoint=False),
            np.linspace(corner, np.pi, 3 * n + 1),
        ]
    )
    back = angle > np.pi / 2
    # Round in front, then the upper side, then the clamped side.
    edge = np.full(len(angle), END)
    edge[back] = np.minimum(
        END / np.maximum(np.sin(angle[back]), 1e-9), LENGTH / -np.cos(angle[back])
    )
    even = np.linspace(0, 1, 8 * n + 1)
    graded = np.expm1(1.5 * even) / np.expm1(1.5)
    circle = np.full(len(angle), RADIUS)
    lug = _polar(circle, edge, angle, graded).with_boundaries(
        {
            "hole": lambda x: np.hypot(*x) < 1.0001 * RADIUS,
            "clamp": lambda x: x[0] < -LENGTH * (1 - 1e-9),
            "axis": lambda x: x[1] < 1e-9 * RADIUS,
        }
    )
    # Middles of the outer facets lie inside the circle, by less than a tenth of a layer.
    pin = _polar(np.full(len(angle), CENTRE), circle, angle, even).with_boundaries(
        {
            "outside": lambda x: np.hypot(*x) > RADIUS * (1 - 0.01 / n),
            "axis": lambda x: x[1] < 1e-9 * RADIUS,
        }
    )
    model = fem.assemble(
        [
            fem.Body("pin", pin, fem.Material(210e3, 0.3)),
            fem.Body("lug", lug, fem.Material(70e3, 0.3)),
        ],
        [fem.Contact("lug", "hole", mu=mu, against=("pin", "outside"))],
        [
            fem.Support("lug", "clamp", (0, 1)),
            fem.Support("pin", "axis", (1,)),
            fem.Support("lug", "axis", (1,)),
        ],
    )
    load = np.zeros(model.K.shape[0])
    share = np.ones(len(angle))
    share[[0, -1]] = 0.5
    # The nodes of the first body come first, its innermost circle before the others.
    load[: 2 * len(angle) : 2] = FORCE * share / share.sum()
    step = model.problem().solve(load, tol=1e-12)[0]
    order = np.argsort(np.arctan2(*model.points.T[::-1]))
    force = model.B.T @ step.reaction.ravel()
    first = len(pin.p.T)
    return Loaded(
        float(step.displacement[model.contact_dofs[order[0], 0]]),
        step.traction[order],
        float(force[2 * first :: 2].sum()),
    )
