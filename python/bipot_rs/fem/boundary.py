"""What surfaces of a body are named by, held by and mirrored at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats, number
from bipot_rs.fem.body import Body, Box
from bipot_rs.fem.elasticity import surface_stiffness
from bipot_rs.fem.materials import Material
from bipot_rs.mesh.elements import facet_nodes, kind_of

# Nodes of one plane as files write them, with seven digits.
_FLAT = 1e-6
# Normals do not ask what a body is made of.
_ANY = Material(1.0, 0.0)


@dataclass(frozen=True)
class Spring:
    """An elastic foundation: a traction against the displacement of a surface.

    Parameters
    ----------
    body, surface
        Names.
    stiffness
        Per area: a number for all directions, or one a component ``(d,)``, zero or
        positive [N/m³].
    normal, tangential
        Instead of it, along the outward normal of the surface and at right angles to
        it [N/m³].
    """

    body: str
    surface: str
    stiffness: float | Sequence[float] | None = None
    normal: float | None = None
    tangential: float | None = None

    def __post_init__(self) -> None:
        own = self.normal is not None or self.tangential is not None
        if own == (self.stiffness is not None):
            raise ValueError(
                f"spring on {self.surface!r} of body {self.body!r} needs stiffness, or "
                "normal and tangential"
            )
        for name in ("stiffness", "normal", "tangential"):
            value = getattr(self, name)
            if value is None:
                continue
            what = f"{name} of the spring on {self.surface!r}"
            found = floats(what, value)
            if found.ndim > (name == "stiffness") or (found < 0).any():
                raise ValueError(f"{what} is {value}, expected zero or positive")


@dataclass(frozen=True)
class Symmetry:
    """A plane surface at which the body goes on mirrored: it moves within that plane."""

    body: str
    surface: str


def spring_stiffness(body: Body, spring: Spring) -> Any:
    """``∫ φ_i k φ_j`` of a spring, CSR as `elasticity.stiffness`, symmetric to the bit."""
    points = body.surface(spring.surface)
    unit = np.eye(body.dim)[:, :, None, None]
    if spring.stiffness is not None:
        what = f"stiffness of the spring on {spring.surface!r}"
        own = floats(what, spring.stiffness)
        if own.shape not in ((), (body.dim,)):
            raise ValueError(
                f"{what} has shape {own.shape}, expected a number or ({body.dim},)"
            )
        density = unit * np.broadcast_to(own, (body.dim,))[:, None, None, None]
    else:
        n = np.asarray(points.normals)
        across = n[:, None] * n
        tangential, normal = spring.tangential or 0.0, spring.normal or 0.0
        density = tangential * unit + (normal - tangential) * across
    whole = np.broadcast_to(density, (*density.shape[:2], *points.weights.shape))
    return surface_stiffness(body, spring.surface, whole)


def plane_of(body: Body, symmetry: Symmetry) -> tuple[int | None, Floats]:
    """The axis that a plane of symmetry is normal to, if one, and its unit normal.

    Raises
    ------
    ValueError
        The surface is not plane.
    """
    places = body.points[body.nodes(symmetry.surface)]
    centre = places.mean(axis=0)
    # The plane is normal to the direction in which places differ least.
    _, _, directions = np.linalg.svd(places - centre, full_matrices=False)
    size = np.ptp(body.points, axis=0).max()
    spread = np.ptp(places, axis=0)
    axis = int(np.argmin(spread))
    if spread[axis] <= _FLAT * size:
        return axis, np.eye(body.dim)[axis]
    n = directions[-1]
    off = np.ptp((places - centre) @ n)
    if off > _FLAT * size:
        raise ValueError(
            f"symmetry on {symmetry.surface!r} of body {symmetry.body!r}: the surface is "
            f"not plane, its nodes lie up to {off:g} apart along "
            f"({', '.join(f'{x:.3g}' for x in n)}), expected a plane"
        )
    return None, np.asarray(n, np.float64)


def surface(
    mesh: Any,
    within: Box | None = None,
    normal: ArrayLike | None = None,
    angle: float = 30.0,
) -> Ints:
    """Facets of the border of a mesh by place and by direction, ascending.

    Parameters
    ----------
    mesh
        Of scikit-fem.
    within
        Closed ranges of coordinates by axis, ``{2: (0.0, 0.0)}``, that hold all nodes of
        a facet; ``inf`` leaves an end open.
    normal
        Direction of the outward normal ``(d,)``, of any length.
    angle
        Largest angle between it and the normal at the middle of a facet, in (0, 180)
        [degrees].

    Raises
    ------
    ValueError
        None is left: the message says what the border has.
    """
    dim = kind_of(mesh).dim
    if within is None and normal is None:
        raise ValueError("surface needs within or normal")
    facets = np.asarray(mesh.boundary_facets(), dtype=np.int64)
    low, high = mesh.p.min(axis=1), mesh.p.max(axis=1)
    x = mesh.p[:, facet_nodes(mesh, facets)]
    keep = np.ones(len(facets), dtype=np.bool_)
    for axis, bounds in (within or {}).items():
        if axis not in range(dim):
            raise ValueError(f"within has the axis {axis}, expected 0 to {dim - 1}")
        least, most = floats(f"within[{axis}]", bounds, shape=(2,), finite=False)
        if not least <= most:
            raise ValueError(
                f"within[{axis}] is {bounds}, expected a range that ascends"
            )
        # As in `Body.nodes`: a bound on a grid line does not lose it to rounding.
        slack = 1e-9 * (high[axis] - low[axis])
        keep &= ((x[axis] >= least - slack) & (x[axis] <= most + slack)).all(axis=1)
    if normal is not None:
        direction = floats("normal", normal, shape=(dim,))
        length = np.linalg.norm(direction)
        if length == 0:
            raise ValueError("normal is zero, expected a direction")
        if not 0 < number("angle", angle) < 180:
            raise ValueError(f"angle is {angle}, expected it between 0 and 180")
        body = Body("it", mesh.with_boundaries({"it": facets}), _ANY)
        points = body.surface("it")
        mean = np.einsum("dpq,pq->dp", np.asarray(points.normals), points.weights)
        cosine = direction @ mean / (length * np.linalg.norm(mean, axis=0))
        # Facets of just that angle belong, whatever the rounding.
        keep &= cosine >= np.cos(np.deg2rad(angle)) - 1e-9
    if not keep.any():
        ranges = ", ".join(
            f"{'xyz'[k]} from {low[k]:g} to {high[k]:g}" for k in range(dim)
        )
        raise ValueError(
            f"no facet of the border lies there: the mesh has {ranges}, and "
            f"{len(facets)} facets on its border"
        )
    return facets[keep]


def with_surfaces(mesh: Any, surfaces: Mapping[str, Ints]) -> Any:
    """The mesh with these surfaces named besides those it names."""
    return mesh.with_boundaries({**(mesh.boundaries or {}), **surfaces})
