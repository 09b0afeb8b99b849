"""Derivatives of the normals of rigid obstacles with respect to the point."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.obstacle.protocol import Obstacle, check_direction, length
from bipot_rs.obstacle.shapes import Cylinder, Plane, Sphere, Torus, Union


def curvature(obstacle: Obstacle, points: Floats) -> Floats:
    """``∂n_i/∂x_j`` of `Obstacle.closest`, ``(n, d, d)`` [1/m]; symmetric.

    It is the second derivative of the distance: its first derivative is n.

    Raises `ValueError`: the obstacle has no formula for it: `Distance`, `Surface`, or a class
    defined elsewhere.
    """
    if isinstance(obstacle, Union):
        each = [part.closest(points).distance for part in obstacle.obstacles]
        nearest = np.argmin(each, axis=0)
        curvatures = np.stack([curvature(part, points) for part in obstacle.obstacles])
        return np.asarray(curvatures[nearest, np.arange(len(points))])
    count, dim = points.shape
    unit = np.broadcast_to(np.eye(dim), (count, dim, dim))
    if isinstance(obstacle, Plane):
        return np.zeros((count, dim, dim))
    if isinstance(obstacle, Sphere):
        arm = points - np.asarray(obstacle.centre, np.float64)
        return _round(arm, unit, obstacle.inside)
    if isinstance(obstacle, Cylinder):
        arm, slope = points - np.asarray(obstacle.point, np.float64), unit
        if obstacle.axis is not None:
            axis = check_direction("axis of the cylinder", obstacle.axis, 3)
            slope = unit - np.outer(axis, axis)
            arm = np.einsum("nij,nj->ni", slope, arm)
        return _round(arm, slope, obstacle.inside)
    if isinstance(obstacle, Torus):
        axis = check_direction("axis of the torus", obstacle.axis, 3)
        across = unit - np.outer(axis, axis)
        arm = points - np.asarray(obstacle.centre, np.float64)
        radial = np.einsum("nij,nj->ni", across, arm)
        far = length(radial)[:, None]
        slope = unit - obstacle.major_radius * _turning(radial, across)
        return _round(
            arm - obstacle.major_radius * radial / far, slope, obstacle.inside
        )
    raise ValueError(
        f"the obstacle is a {type(obstacle).__name__}, for which the derivative of the "
        "normal has no formula: use a Plane, Sphere, Cylinder, Torus or a Union of these"
    )


def _turning(arm: Floats, slope: Floats) -> Floats:
    """Derivative of ``arm / |arm|``, from that of ``arm``, ``(n, d, d)``."""
    far = length(arm)
    unit = arm / far[:, None]
    along = np.einsum("nk,nkj->nj", unit, slope)
    turned = (slope - unit[:, :, None] * along[:, None]) / far[:, None, None]
    return np.asarray(turned, np.float64)


def _round(arm: Floats, slope: Floats, inside: bool) -> Floats:
    return (-1.0 if inside else 1.0) * _turning(arm, slope)
