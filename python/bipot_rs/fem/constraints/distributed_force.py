"""A force and a moment on a part of a body that may deform: equivalent distributed loads."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs.fem.bodies.body import Body, Quadrature
from bipot_rs.fem.bodies.elasticity import nodal_forces
from bipot_rs.fem.constraints.references import (
    Remote,
    read_resultant,
    rotations,
    set_of,
)

# Part of a moment that the extent of the set cannot carry, relative to the moment.
_LOST = 1e-6


def distributed_force(
    body: Body, remote: Remote, force: ArrayLike | None, moment: ArrayLike | None
) -> Floats:
    """Nodal forces ``(dim * nodes,)`` with a given resultant at the reference point.

    The density ``a + b × (x - c)`` per area of a surface or per volume, with the centre c of
    the part, has the resultant force ``a A`` and about c the moment ``J b``; among all
    densities with this resultant it is the smallest in the mean square.

    ``body, remote``: the remote, with ``distributed``, and its body.
    ``force, moment``: at the reference point, ``(d,)`` [N], and ``(3,)`` or in the plane a
    number [N m].
    Raises `ValueError`: a wrong shape, a moment without an arm, or a part without facets or
    cells.
    """
    d = body.dim
    what = f"of the remote {remote.name!r}"
    push, turn = read_resultant(what, force, moment, d)
    points = _part(body, remote)
    weights = body.depth * points.weights.ravel()
    places = points.places.reshape(d, -1).T
    centre = weights @ places / weights.sum()
    lever = set_of(body, remote)[1] - centre
    # The moment about the centre includes that of the force at the point.
    about = turn + rotations(lever[None])[0].T @ push
    density = np.tile(push / weights.sum(), (len(places), 1))
    if about.any():
        fields = rotations(places - centre)
        J = np.einsum("i,ikr,iks->rs", weights, fields, fields)
        b = np.linalg.lstsq(J, about, rcond=_LOST**2)[0]
        if np.abs(J @ b - about).max() > _LOST * np.abs(about).max():
            raise ValueError(
                f"moment {what} has a component about the line on which the whole part "
                "lies, where it has no arm: choose a wider part, or leave it out"
            )
        density = density + fields @ b
    return nodal_forces(body, points, density.T.reshape(points.places.shape))


def _part(body: Body, remote: Remote) -> Quadrature:
    """Quadrature on the facets or cells of the part, those with all nodes selected."""
    if remote.part is not None and remote.part in (body.mesh.boundaries or {}):
        points = body.surface(remote.part)
    else:
        points = body.volume()
        if remote.part is not None:
            points = points.some(body.volume_cells(remote.part))
    nodes = body.members(remote.part, remote.within)
    chosen = np.flatnonzero(np.isin(points.corners, nodes).all(axis=1))
    if not chosen.size:
        raise ValueError(
            f"the remote {remote.name!r} has no facet or cell with all nodes within its "
            "ranges: widen within"
        )
    return points.some(chosen)
