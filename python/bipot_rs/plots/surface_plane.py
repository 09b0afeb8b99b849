"""The plane of a flat contact surface, and coordinates on it."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.plots.data import DrawnContacts

# Tolerance for nodes on one plane, relative to its width.
_PLANE = 1e-6


def is_plane(seen: DrawnContacts) -> bool:
    """Whether contacts in 3D lie on one plane."""
    off = seen.x - seen.x.mean(axis=0)
    widths = np.ptp(off @ np.linalg.svd(off, full_matrices=False)[2].T, axis=0)
    return bool(widths[-1] <= _PLANE * widths[0]) if len(widths) == 3 else True


def is_line(uv: Floats) -> bool:
    """Whether points on a plane lie on one line, or are fewer than three."""
    if len(uv) < 3:
        return True
    wide, narrow = np.linalg.svd(uv - uv.mean(axis=0), compute_uv=False)
    return bool(narrow <= _PLANE * wide)


def plane_of(seen: DrawnContacts) -> tuple[Floats, list[str]]:
    """Coordinates ``(n_c, 2)`` on the plane of the contacts, and their labels."""
    x = seen.x
    if x.shape[1] != 3:
        raise ValueError("the contacts have two dimensions: use tractions instead")
    if not is_plane(seen):
        surfaces = [name for name, _ in seen.surfaces if name]
        listed = f" ({', '.join(surfaces)})" if len(surfaces) > 1 else ""
        raise ValueError(
            f"the contacts lie on more than one plane: choose one surface{listed}, or a "
            "picture in 3D"
        )
    axes, names = tangents(seen)
    return x @ axes.T, names


def tangents(seen: DrawnContacts) -> tuple[Floats, list[str]]:
    """Axes ``(2, 3)`` on the plane of the contacts, and their labels.

    The tangents of the contacts if these are equal. Otherwise, as for a roller on a plane,
    tangents may point out of the plane, and their mean is used.
    """
    off = seen.x - seen.x.mean(axis=0)
    # Three more rows, so that the SVD has three directions even for two contacts.
    rows = np.concatenate([off, np.zeros((3, 3))])
    normal = np.linalg.svd(rows, full_matrices=False)[2][-1]
    names = ["along t1", "along t2"]
    if seen.frame is None:
        # The two coordinates in which the plane has the largest projection.
        axes = np.delete(np.eye(3), np.argmax(np.abs(normal)), axis=0)
    elif np.abs(seen.frame - seen.frame[0]).max() <= _PLANE:
        axes = seen.frame[0, 1:]
    else:
        axes = _mean_tangents(seen.frame, normal)
        names = ["along mean t1", "along mean t2"]
    at = np.argmax(axes, axis=1)
    if np.allclose(axes, np.eye(3)[at], rtol=0, atol=_PLANE):
        return np.eye(3)[at], ["xyz"[k] for k in at]
    return axes, names


def _mean_tangents(frame: Floats, normal: Floats) -> Floats:
    """The mean t1 projected onto a plane, and the direction at right angles near t2."""
    first, second = frame[:, 1:].mean(axis=0)
    first = first - (first @ normal) * normal
    if np.linalg.norm(first) < 0.1:
        # Around an axis the tangents cancel: use the axis of coordinates nearest the plane.
        axis = np.eye(3)[np.argmin(np.abs(normal))]
        first = axis - (axis @ normal) * normal
    first = first / np.linalg.norm(first)
    across = np.cross(normal, first)
    if np.linalg.norm(second) < 0.1:
        second = np.sign(across[np.argmax(np.abs(across))]) * across
    return np.stack([first, across if across @ second >= 0 else -across])
