"""The shipped scenes as numbers, for peers that have NumPy but not this package.

Grids, materials and load steps are written here a second time on purpose: a peer that read
the scene files would repeat their faults.
"""

from typing import NamedTuple

import numpy as np


class Body(NamedTuple):
    """Tensor-product grid of one material."""

    grids: list  # coordinates of the grid lines [mm], one array for each axis
    young: float  # [MPa]
    poisson: float


class Scene(NamedTuple):
    """Upper body first; contact on the plane where the last coordinate is 0."""

    bodies: list
    mu: float
    half_width: float | None  # contact candidates: |x| up to this [mm]; all if None
    radius: float | None  # clearance x² / (2 radius) [mm]; none if None
    top: list  # prescribed displacement of the top in each load step [mm]


def graded(start, end, cell, ratio):
    """Points from ``start`` to ``end`` whose cells grow by ``ratio``."""
    points = [start]
    while (end - points[-1]) * cell > 0:
        points.append(points[-1] + cell)
        cell *= ratio
    points[-1] = end
    if len(points) > 2 and abs(end - points[-2]) < 0.5 * abs(points[-2] - points[-3]):
        del points[-2]
    return points


def scene(name, n):
    """Numbers of a scene at one size."""
    steel = (210000.0, 0.3)
    if name == "pressed_block":
        g = np.linspace(0, 40, n + 1)
        return Scene([Body([g, g], 130000.0, 0.2)], 1.0, None, None, [None])
    if name in ("sheared_cube", "cyclic_cube"):
        g = np.linspace(0, 100, n + 1)
        shear = np.sin(2 * np.pi * np.arange(41) / 20)
        shear = shear if name == "cyclic_cube" else [0.0, 1.0]
        top = [(0.025 * s, 0.0, -0.05) for s in shear]
        return Scene([Body([g, g, g], *steel)], 0.3, None, None, top)
    if name == "two_blocks":
        g, h = np.linspace(0, 100, n + 1), np.linspace(0, 50, n // 2 + 1)
        top = [(0.05 * s, 0.0, -0.1) for s in (0.0, 1.0)]
        bodies = [Body([g, g, h], *steel), Body([g, g, h - 50], 21000.0, 0.3)]
        return Scene(bodies, 0.3, None, None, top)
    if name == "cattaneo_mindlin":
        h, ratio = 0.5 / n, 1.5 if n < 10 else 1.3 if n < 20 else 1.15
        out = graded(1.5, 20.0, h * ratio, ratio)[1:]
        inner = np.linspace(-1.5, 1.5, 6 * n + 1)
        x = np.array([*(-p for p in out[::-1]), *inner, *out])
        y = np.array(graded(0.0, 20.0, h, ratio))
        top = [(0.004 * s, -0.02) for s in (0.0, 1.0)]
        bodies = [Body([x, y], *steel), Body([x, np.sort(-y)], *steel)]
        return Scene(bodies, 0.3, 1.5, 100.0, top)
    raise SystemExit(f"no scene is called {name}: see the names in peers/scenes.py")


def tributary(points):
    """Length that belongs to each point of a grid line, [mm]."""
    half = np.diff(points) / 2
    return np.append(half, 0.0) + np.append(0.0, half)
