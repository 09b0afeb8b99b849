"""Sliding distance of contacts relative to the distance between them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np

from bipot_rs._lib.types import Floats, Integers
from bipot_rs.contact import tuning


def measure_distances(points: Floats) -> Floats:
    """Distance of each point to its nearest neighbour, ``(m,)``.

    >>> measure_distances(np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]]))
    array([1., 1., 2.])
    """
    if len(points) < 2:
        return np.full(len(points), np.inf)
    if len(points) <= tuning.ALL_PAIRS:
        square = np.zeros((len(points), len(points)))
        for x in points.T:
            square += (x[:, None] - x) ** 2
        np.fill_diagonal(square, np.inf)
        nearest = np.sqrt(square.min(axis=1))
    else:
        from scipy.spatial import cKDTree

        pairs, _ = cKDTree(points).query(points, k=2)
        nearest = np.asarray(pairs[:, 1], np.float64)
    # Two contacts of one node are not a distance in the mesh.
    return np.where(nearest > 0, nearest, np.inf)


class MovedStep(Protocol):
    """What is read of a `Step`."""

    @property
    def reaction(self) -> Floats:
        """Reactions, ``(n_c, d)``."""

    @property
    def relative_displacement(self) -> Floats:
        """Relative displacements, ``(n_c, d)``."""

    @property
    def frame(self) -> Floats | None:
        """Frames of the step, ``(n_c, d, d)``; None for those of B."""

    @property
    def drag(self) -> Floats | None:
        """Motion of an obstacle whose geometry moves with it, ``(n_c, d)``."""


def measure_displacement(step: MovedStep, at: Integers | np.integer) -> Floats:
    """How far contacts are from where their geometry was taken, ``(m, d - 1)``.

    The geometry of a step with frames of its own is that of the moved obstacle: its motion
    does not count.
    """
    moved: Floats = step.relative_displacement[at, 1:]
    if step.frame is None or step.drag is None:
        return moved
    carried = np.einsum("...kd,...d->...k", step.frame[at, 1:], step.drag[at])
    return np.asarray(moved + carried, np.float64)


def find_farthest(
    steps: Iterable[MovedStep], apart: Floats, at: Integers
) -> tuple[int, int, float]:
    """Largest `measure_displacement` distance of a closed contact, relative to ``apart (m,)``.

    ``steps`` are the steps of a `Result`, and ``at (m,)`` are the contacts to check.
    Returns the number of the step, the index into ``at``, and the ratio.
    """
    farthest = 0, 0, 0.0
    for k, step in enumerate(steps):
        along = np.linalg.norm(measure_displacement(step, at), axis=1)
        ratio = np.where(step.reaction[at, 0] > 0, along / apart, 0.0)
        node = int(np.argmax(ratio))
        if ratio[node] > farthest[2]:
            farthest = k, node, float(ratio[node])
    return farthest
