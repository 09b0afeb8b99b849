"""Elastic bodies of the collection, by the finite elements of this package."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs.fem.assembly.assemble import assemble
from bipot_rs.fem.assembly.assembly import Assembly, Support
from bipot_rs.fem.bodies.body import Body
from bipot_rs.fem.bodies.materials import Material
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.mesh.boxes import box
from collection.load_path import LoadPath

CELLS = {2: "quadrilateral", 3: "hexahedron"}


def grid(start: float, end: float, cells: int, ratio: float = 1.0) -> Floats:
    """Grid points of an axis; each cell is ``ratio`` times as long as the one before."""
    ends = np.cumsum(np.append(0.0, ratio ** np.arange(cells, dtype=np.float64)))
    return np.asarray(start + (end - start) * ends / ends[-1], np.float64)


def block(
    name: str, axes: Sequence[Floats], young: float = 1.0, poisson: float = 0.3
) -> Body:
    """A rectangle or a box."""
    return Body(name, box(axes, CELLS[len(axes)]), Material(young, poisson))


def floor(
    body: str, mu: float, d: int, clearance: ArrayLike | Callable[..., Any] = 0.0
) -> Contact:
    """Contact of the bottom of a body with the rigid plane at height zero."""
    up = np.eye(d)[-1]
    return Contact(body, "bottom", mu, plane=(0.0 * up, up), clearance=clearance)


def held(body: str, surface: str, d: int) -> Support:
    """All displacements of a surface are prescribed."""
    return Support(body, surface, list(range(d)))


def moved(
    model: Assembly,
    motion: Floats,
    *,
    turn: Floats | None = None,
    mu: ArrayLike | None = None,
    **more: Any,
) -> LoadPath:
    """Path that moves the first support as a rigid body; other supports stay at rest.

    Parameters
    ----------
    model
        Bodies.
    motion
        Displacements ``(steps, d)``.
    turn
        Angles about the vertical axis through the origin ``(steps,)`` [rad].
    mu
        Friction coefficients that replace those of the model.
    more
        Other attributes of `LoadPath`.
    """
    dofs = model.support_dofs[0]
    whole = np.zeros((len(motion), model.n))
    whole[:, dofs] = motion[:, :, None]
    if turn is not None:
        x, y = (model.nodes.ravel()[dofs[k]] for k in (0, 1))
        cos, sin = (np.cos(turn) - 1)[:, None], np.sin(turn)[:, None]
        whole[:, dofs[0]] += cos * x - sin * y
        whole[:, dofs[1]] += sin * x + cos * y
    return arrays(model, np.zeros((len(motion), model.n)), whole, mu, **more)


def loaded(
    model: Assembly, load: Floats, *, mu: ArrayLike | None = None, **more: Any
) -> LoadPath:
    """Path of nodal loads ``(steps, n)``; supports stay at rest."""
    return arrays(model, load, np.zeros((len(load), model.n)), mu, **more)


def arrays(
    model: Assembly,
    load: Floats,
    displacement: Floats,
    mu: ArrayLike | None,
    **more: Any,
) -> LoadPath:
    """Path of nodal loads and of displacements of the supports, ``(steps, n)`` each."""
    coefficients = model.mu if mu is None else np.asarray(mu, np.float64)
    # A node whose tangential displacement is prescribed has no friction.
    coefficients = np.where(model.mu == 0, 0.0, coefficients)
    gaps = model.gaps(len(load))
    path_arrays: Mapping[str, Any] = {"gaps": gaps, "frame": model.frame} | more
    return LoadPath(
        model.K,
        model.B,
        model.gap,
        coefficients,
        load,
        displacement[:, model.fixed],
        model.fixed,
        **path_arrays,
    )


def on_floor(
    axes: Sequence[Floats],
    mu: float,
    *,
    clearance: ArrayLike | Callable[..., Any] = 0.0,
    young: float = 1.0,
    poisson: float = 0.3,
) -> Assembly:
    """A block above the rigid plane, its top prescribed."""
    d = len(axes)
    body = block("block", axes, young, poisson)
    return assemble(
        [body], [floor("block", mu, d, clearance)], [held("block", "top", d)]
    )


def free_on_floor(axes: Sequence[Floats], mu: float, **material: float) -> Assembly:
    """A block that only the contact with the rigid plane holds."""
    body = block("block", axes, **material)
    return assemble([body], [floor("block", mu, len(axes))])


def pair(
    upper: Sequence[Floats],
    lower: Sequence[Floats],
    mu: float,
    young: tuple[float, float] = (1.0, 1.0),
    *,
    clearance: ArrayLike | Callable[..., Any] = 0.0,
    pairing: str = "match",
) -> Assembly:
    """Two blocks, the top of the upper prescribed and the bottom of the lower held."""
    d = len(upper)
    bodies = [block("upper", upper, young[0]), block("lower", lower, young[1])]
    contact = Contact(
        "upper",
        "bottom",
        mu,
        against=("lower", "top"),
        clearance=clearance,
        pairing=pairing,
    )
    supports = [held("upper", "top", d), held("lower", "bottom", d)]
    return assemble(bodies, [contact], supports)
