"""Rigid motions of degrees of freedom, computed from their coordinates."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats, Ints

# Direction of a degree of freedom: 0, 1, 2 is a displacement along x, y, z, and 3, 4, 5 a
# rotation about x, y, z.
ABOUT = 3
UNKNOWN = -1


def directions(places: Floats, d: int) -> Ints:
    """Direction of each degree of freedom, ``(n,)``, or `UNKNOWN`.

    Degrees of freedom at one point are, in ascending order, the displacements of a node
    along the axes, then its rotations if there are as many as in a beam or a shell. If
    nodes of several bodies are at one point, consecutive numbers belong to one node. The
    condensation reads ``coordinates`` in the same way.

    Parameters
    ----------
    places
        ``(n, 3)``.
    d
        Dimension, 2 or 3.
    """
    x, y, z = (places + 0.0).T  # -0.0 is the same coordinate as 0.0
    n = len(places)
    order = np.lexsort((np.arange(n), z, y, x))
    new = np.ones(n, bool)
    new[1:] = (np.diff(places[order] + 0.0, axis=0) != 0).any(axis=1)
    first = np.flatnonzero(new)
    count = np.diff(np.append(first, n))
    found = np.full(n, UNKNOWN, np.int64)
    plain = first[count == d]
    found[order[plain[:, None] + np.arange(d)]] = np.arange(d)
    own = np.append(np.arange(d), [ABOUT + axis for axis in axes_of(d)])
    for at, of in zip(first[count != d], count[count != d], strict=True):
        for node in _nodes(order[at : at + of], d):
            found[node] = own[: len(node)]
    return found


def _nodes(dofs: Ints, d: int) -> list[Ints]:
    """Degrees of freedom of each node at one point, in the order of directions."""
    sizes = (d, 3 if d == 2 else 6)
    runs = np.split(dofs, np.flatnonzero(np.diff(dofs) != 1) + 1)
    if all(len(run) in sizes for run in runs):
        return runs
    if len(dofs) in sizes:
        return [dofs]
    if all(len(run) % d == 0 for run in runs):
        return [node for run in runs for node in run.reshape(-1, d)]
    if len(dofs) % d == 0:
        # All x first, then all y.
        return list(dofs.reshape(d, -1).T)
    return []


def motions(direction: Ints, places: Floats, d: int) -> tuple[Floats, Floats]:
    """Rigid motions of one body, and the largest motion of each degree of freedom.

    The columns, ``(n, 3)`` in the plane and ``(n, 6)`` in space, are translations by 1, and
    rotations about the centre that move a node by about 1 at most. Motions that a body
    does not have, such as the rotation of a straight line about itself, are zero or
    depend on other columns.
    """
    arm = places - places.mean(axis=0)
    reach = float(np.abs(arm[:, :d]).max(initial=0.0)) or 1.0
    Z = np.zeros((len(places), len(axes_of(d)) + d))
    for k, one, amount in amounts(direction, arm, d):
        Z[one, k] += amount
    Z[:, d:] /= reach
    return Z, np.where(direction < ABOUT, 1.0, 1.0 / reach)


def axes_of(d: int) -> range:
    """Axes of rotations."""
    return range(2, 3) if d == 2 else range(3)


def amounts(direction: Ints, arm: Floats, d: int) -> list[tuple[int, Ints, Floats]]:
    """Nonzero entries of rigid motions: number of the motion, rows, and values.

    Parameters
    ----------
    direction
        Direction of each row.
    arm
        Coordinates of each row relative to the centre of rotation, ``(rows, 3)``.
    """
    found = []
    for k in range(d):
        one = np.flatnonzero(direction == k)
        found.append((k, one, np.ones(len(one))))
    for k, axis in enumerate(axes_of(d), start=d):
        # e_axis × x has -x_b along a and x_a along b, (axis, a, b) in cyclic order.
        a, b = (axis + 1) % 3, (axis + 2) % 3
        for along, of, sign in ((a, b, -1.0), (b, a, 1.0)):
            one = np.flatnonzero(direction == along)
            found.append((k, one, sign * arm[one, of]))
        one = np.flatnonzero(direction == ABOUT + axis)
        found.append((k, one, np.ones(len(one))))
    return found
