"""Nodes of two surfaces that lie opposite each other."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Floats, Ints
from bipot_rs.fem.contact.contact import Contact, both
from bipot_rs.fem.tuning import ALL_PAIRS


def match_nodes(
    ours: Floats, theirs: Floats, frame: Floats, contact: Contact, size: float
) -> Ints:
    """Index of the node opposite to each of ours, along the normal."""
    match = nearest_points(ours, theirs)
    between = ours - theirs[match]
    along = np.einsum("cd,cd->c", frame[:, 0], between)
    aside = np.linalg.norm(between - along[:, None] * frame[:, 0], axis=1)
    # Coordinates of one point from two meshers differ in the last digits.
    bad = np.flatnonzero(aside > 1e-7 * size)
    if bad.size:
        raise ValueError(
            f"surfaces {both(contact)} do not match: no node lies opposite to the node at "
            f"{place(ours[bad[0]])}, the nearest is {aside[bad[0]]:g} aside; use "
            "pairing='mortar', or meshes with opposite nodes"
        )
    values, counts = np.unique(match, return_counts=True)
    if np.any(counts > 1):
        raise ValueError(
            f"surfaces {both(contact)} do not match: the node at "
            f"{place(theirs[values[counts > 1][0]])} lies opposite to several nodes; use "
            "pairing='mortar'"
        )
    return np.asarray(match, dtype=np.int64)


def nearest_points(ours: Floats, theirs: Floats) -> Ints:
    """Index in ``theirs`` of the point nearest to each of ``ours``."""
    if len(ours) * len(theirs) > ALL_PAIRS:
        from scipy.spatial import cKDTree

        _, match = cKDTree(theirs).query(ours)
        return np.asarray(match, dtype=np.int64)
    distance = np.zeros((len(ours), len(theirs)))
    for mine, other in zip(ours.T, theirs.T, strict=True):
        distance += np.subtract.outer(mine, other) ** 2
    return np.asarray(distance.argmin(axis=1), dtype=np.int64)
