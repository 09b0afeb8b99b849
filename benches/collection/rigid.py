"""Sets of rigid bodies: disks, balls and the stones of an arch.

Each body has a translation and a rotation about its centre. Joints may have a compliance
of their own, the same along all components: W has it on its diagonal. As degrees of
freedom it is a spring for each component of each contact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from bipot_rs._lib.matrices import diagonal_matrix
from bipot_rs._lib.types import Floats, Ints
from collection.load_path import LoadPath, Proof


class RigidSet(NamedTuple):
    """Contacts between rigid bodies.

    Attributes
    ----------
    centre
        ``(bodies, d)``.
    first, second
        Bodies of each contact, ``(n_c,)``; -1 for the ground.
    point, normal
        ``(n_c, d)``; normals point from the first body to the second.
    """

    centre: Floats
    first: Ints
    second: Ints
    point: Floats
    normal: Floats

    @property
    def d(self) -> int:
        """Dimension."""
        return int(self.centre.shape[1])

    @property
    def motions(self) -> int:
        """Degrees of freedom of a body: translations, then rotations."""
        return {2: 3, 3: 6}[self.d]

    def axes(self) -> Floats:
        """Rows n, t1[, t2] of each contact, ``(n_c, d, d)``."""
        n = self.normal
        if self.d == 2:
            return np.stack([n, np.c_[-n[:, 1], n[:, 0]]], axis=1)
        across = np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)])
        across /= np.linalg.norm(across, axis=1)[:, None]
        return np.stack([n, across, np.cross(n, across)], axis=1)

    def matrix(self) -> sparse.csr_array:
        """B of (2), ``(d n_c, motions bodies)``."""
        d, count, frames = self.d, self.motions, self.axes()
        rows, columns, values = [], [], []
        for body, sign in ((self.first, -1.0), (self.second, 1.0)):
            at = np.flatnonzero(body >= 0)
            arm = self.point[at] - self.centre[body[at]]
            for k in range(d):
                axis = frames[at, k]
                turn = (
                    (arm[:, :1] * axis[:, 1:] - arm[:, 1:] * axis[:, :1])
                    if d == 2
                    else np.cross(arm, axis)
                )
                values.append((sign * np.c_[axis, turn]).ravel())
                rows.append(np.repeat(d * at + k, count))
                columns.append((count * body[at][:, None] + np.arange(count)).ravel())
        shape = d * len(self.first), count * len(self.centre)
        where = np.concatenate(rows), np.concatenate(columns)
        return sparse.csr_array((np.concatenate(values), where), shape=shape)


def lattice(
    side: tuple[int, ...], *, walls: bool = False, seed: int | None = None
) -> RigidSet:
    """Balls of radius 1 above each other and beside each other on the ground.

    Parameters
    ----------
    side
        Number of balls along each axis; the last axis points up.
    walls
        Whether the ground also surrounds the balls along the first axis.
    seed
        Of a random tilt of all normals by some degrees, as between uneven stones.
    """
    d = len(side)
    index = np.stack(np.unravel_index(np.arange(np.prod(side)), side), axis=1)
    number = np.arange(len(index)).reshape(side)
    centre = np.asarray(2.0 * index + 1.0, np.float64)
    parts = []
    for axis in range(d):
        low = number.take(range(side[axis] - 1), axis).ravel()
        high = number.take(range(1, side[axis]), axis).ravel()
        parts.append((low, high, centre[low] + np.eye(d)[axis], axis, 1.0))
    ground = [(d - 1, 0, 1.0)] + ([(0, 0, 1.0), (0, -1, -1.0)] if walls else [])
    for axis, end, sign in ground:
        near = number.take(end, axis).ravel()
        point = centre[near] - sign * np.eye(d)[axis]
        parts.append((np.full(len(near), -1), near, point, axis, sign))
    normal = np.concatenate(
        [np.tile(s * np.eye(d)[a], (len(f), 1)) for f, *_, a, s in parts]
    )
    if seed is not None:
        rng = np.random.default_rng(seed)
        normal += 0.08 * rng.standard_normal(normal.shape)
        normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    first, second, point = (
        np.concatenate([part[k] for part in parts]) for k in range(3)
    )
    return RigidSet(centre, first, second, point, normal)


def arch(stones: int, inner: float, outer: float) -> RigidSet:
    """Half a ring of stones with radial joints, each with two contacts, on two abutments."""
    angle = np.pi * np.arange(stones + 1) / stones
    middle = (angle[:-1] + angle[1:]) / 2
    centre = (inner + outer) / 2 * np.c_[-np.cos(middle), np.sin(middle)]
    joint = np.repeat(np.arange(stones + 1), 2)
    radius = np.tile([inner, outer], stones + 1)
    point = radius[:, None] * np.c_[-np.cos(angle), np.sin(angle)][joint]
    # From the stone before the joint to the stone after it, along the ring.
    normal = np.c_[np.sin(angle), np.cos(angle)][joint]
    first, second = joint - 1, joint.copy()
    last = joint == stones
    # The second abutment is the ground, so the order of the pair changes.
    first[last], second[last] = -1, stones - 1
    normal[last] *= -1
    return RigidSet(centre, first, second, point, normal)


def path(
    of: RigidSet,
    load: Floats,
    mu: Floats | float,
    *,
    spring: Floats | float = 0.0,
    joint: float = 0.0,
    gap: Floats | None = None,
    gaps: Floats | None = None,
    redundant: bool = False,
    proof: Proof | None = None,
) -> LoadPath:
    """Path of loads ``(steps, motions bodies)`` on rigid bodies.

    Parameters
    ----------
    of
        Bodies and contacts.
    load
        Forces and moments of each step.
    mu
        Friction coefficients.
    spring
        Stiffness of springs between each body and the ground; zero: contact alone holds
        the bodies.
    joint
        Compliance of each contact.
    gap, gaps, redundant, proof
        As in `LoadPath`.
    """
    B, contacts = of.matrix(), len(of.first)
    springs = np.broadcast_to(np.asarray(spring, np.float64), B.shape[1:])
    parts, diagonal = [B], [springs]
    if joint:
        parts.append(diagonal_matrix(np.ones(B.shape[0])))
        diagonal.append(np.full(B.shape[0], 1 / joint))
        load = np.hstack([load, np.zeros((len(load), B.shape[0]))])
    K = diagonal_matrix(np.concatenate(diagonal))
    return LoadPath(
        K,
        sparse.csr_array(sparse.hstack(parts)),
        np.zeros(contacts) if gap is None else gap,
        np.broadcast_to(np.asarray(mu, np.float64), (contacts,)).copy(),
        load,
        np.zeros((len(load), 0)),
        np.zeros(0, np.int64),
        gaps=gaps,
        redundant=redundant,
        proof=proof,
    )
