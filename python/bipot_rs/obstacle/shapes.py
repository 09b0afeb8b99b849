"""Rigid obstacles, at rest or moving along the load path.

Whatever has ``dim`` and ``closest(points)`` is an obstacle (`Obstacle`); the shapes here
are those with a formula, and `Surface` is one of facets. What one of another's making
answers is checked (`ask`).

Displacements are small: a contact keeps the frame of one place of the obstacle for the
whole path, that of its nearest approach to the node. Of a step the gap is the distance
``g`` of the moved obstacle from the node's place without load, and with ``u`` the node is
taken to be at the distance ``g + n·u``, which leaves out terms of the order of
``|u|²/R`` over an obstacle of radius R, and ``|u|`` times the angle by which an obstacle
that turns or passes by still turns the normal while it touches.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import callback, floats, number, shown
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.protocol import Closest, Obstacle, directed, length, taken
from bipot_rs.obstacle.triangulated import Surface

__all__ = [
    "Approach",
    "Closest",
    "Cylinder",
    "Distance",
    "Motion",
    "Obstacle",
    "Plane",
    "Sphere",
    "Surface",
    "Union",
    "approach",
    "ask",
    "onwards",
]

# Nearer to an axis or a centre than this share of the radius, a normal has lost half of
# its digits.
_CENTRE = 1e-8
# What a distance may miss of |∇d| = 1 and of d(foot) = 0, relative to the size of the
# points.
_UNIT = 1e-6
# Of the extent of the points: balances truncation, step⁴, and rounding, ε/step.
_STEP = 1e-3
# Steps are made smaller by the one until the length is right to the other.
_FINER, _FINE = 1 / 8, 1e-9


@dataclass(frozen=True)
class Plane:
    """A half-space; ``normal (d,)`` points to the bodies, ``point (d,)`` lies on it."""

    point: ArrayLike
    normal: ArrayLike

    def __post_init__(self) -> None:
        direction = directed("normal of the plane", self.normal)
        floats("point of the plane", self.point, shape=direction.shape)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(np.asarray(self.normal))

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`."""
        x = taken(points, self.dim)
        n = directed("normal of the plane", self.normal)
        distance = (x - np.asarray(self.point, np.float64)) @ n
        return Closest(distance, np.tile(n, (len(x), 1)), x - distance[:, None] * n)


@dataclass(frozen=True)
class Sphere:
    """A ball, a disc in the plane; with ``inside`` a cavity that bodies are in.

    Parameters
    ----------
    centre
        ``(d,)`` [m].
    radius
        Positive [m].
    inside
        Whether bodies are within: normals then point to the centre.
    """

    centre: ArrayLike
    radius: float
    inside: bool = False

    def __post_init__(self) -> None:
        centre = floats("centre of the sphere", self.centre, ndim=1)
        if len(centre) not in (2, 3):
            raise ValueError(
                f"centre of the sphere has shape {centre.shape}, expected (2,) or (3,)"
            )
        _radius("sphere", self.radius)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(np.asarray(self.centre))

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; `ValueError` for a point at the centre."""
        x = taken(points, self.dim)
        arm = x - np.asarray(self.centre, np.float64)
        return _round(x, arm, self.radius, self.inside, "centre of the sphere")


@dataclass(frozen=True)
class Cylinder:
    """An endless round bar, a disc in the plane; with ``inside`` a bore.

    Parameters
    ----------
    point
        On the axis, ``(d,)`` [m]; in the plane the centre.
    radius
        Positive [m].
    axis
        Direction of the axis, ``(3,)``; in the plane none.
    inside
        Whether bodies are within: normals then point to the axis.
    """

    point: ArrayLike
    radius: float
    axis: ArrayLike | None = None
    inside: bool = False

    def __post_init__(self) -> None:
        point = floats("point of the cylinder", self.point, ndim=1)
        if len(point) not in (2, 3):
            raise ValueError(
                f"point of the cylinder has shape {point.shape}, expected (2,) or (3,)"
            )
        if (self.axis is None) != (len(point) == 2):
            raise ValueError(
                "axis of the cylinder is missing"
                if self.axis is None
                else "axis of the cylinder was given, in the plane there is none"
            )
        if self.axis is not None:
            directed("axis of the cylinder", self.axis, 3)
        _radius("cylinder", self.radius)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(np.asarray(self.point))

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; `ValueError` for a point on the axis."""
        x = taken(points, self.dim)
        arm = x - np.asarray(self.point, np.float64)
        if self.axis is not None:
            along = directed("axis of the cylinder", self.axis, 3)
            # Twice: far along the axis, one pass leaves its rounding.
            for _ in range(2):
                arm = arm - (arm @ along)[:, None] * along
        return _round(x, arm, self.radius, self.inside, "axis of the cylinder")


@dataclass(frozen=True)
class Distance:
    """An obstacle by its signed distance, negative inside.

    Parameters
    ----------
    function
        Distances ``(n,)`` of places ``(n, d)`` [m].
    gradient
        Its gradients ``(n, d)`` at places ``(n, d)``; default central differences of
        fourth order.
    step
        Of these differences [m]; default a thousandth of the extent of the points asked
        about, or of their distances. It must be well below the least radius of curvature
        of the obstacle: the default is made smaller until the gradient has length 1.

    What is no distance is refused: the gradient has length 1 to 1e-6, and at the foot
    ``x - d ∇d`` the function is zero to 1e-6 of the extent of the points.
    """

    function: Callable[[Floats], ArrayLike]
    gradient: Callable[[Floats], ArrayLike] | None = None
    step: float | None = None

    def __post_init__(self) -> None:
        callback("function of the distance", self.function)
        callback("gradient of the distance", self.gradient)
        if self.function is None:
            raise TypeError(
                "function of the distance is None, expected something to call"
            )
        if self.step is not None and not number("step of the distance", self.step) > 0:
            raise ValueError(
                f"step of the distance is {self.step}, expected a positive number"
            )

    @property
    def dim(self) -> None:
        """Known by the function alone."""
        return

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; `ValueError` where the function is no distance."""
        x = taken(points, None)
        distance = self._at(x)
        extent = float(np.ptp(x, axis=0).max(initial=0.0)) if len(x) else 0.0
        extent = max(extent, float(np.abs(distance).max(initial=0.0)))
        far = float(np.abs(x).max(initial=0.0))
        rounding = 1e3 * float(np.spacing(far))
        if self.gradient is not None:
            slope = floats("gradient of the distance", self.gradient(x), shape=x.shape)
        elif self.step is not None:
            slope = self._slope(x, float(self.step))
        else:
            # Of one place on the surface nothing tells a size but its coordinates.
            known = extent if extent > 1e3 * rounding else far or 1.0
            slope = self._finest(x, _STEP * known, rounding)
        size = length(slope)
        off = np.abs(size - 1)
        if not (off <= _UNIT).all():
            at = int(np.argmax(off))
            raise ValueError(
                f"the gradient of the distance has length {size[at]:g} at {place(x[at])}, "
                f"expected 1 to {_UNIT:g}: a signed distance, smooth there, and not any "
                "function that vanishes on the surface"
            )
        normal = slope / size[:, None]
        foot = x - distance[:, None] * normal
        missed = np.abs(self._at(foot))
        if not (missed <= _UNIT * extent + rounding).all():
            at = int(np.argmax(missed))
            raise ValueError(
                f"the distance at {place(x[at])} is {distance[at]:g}, but so far along its "
                f"gradient, at {place(foot[at])}, it is {missed[at]:g} and not zero: "
                "expected a signed distance"
            )
        return Closest(distance, normal, foot)

    def _at(self, x: Floats) -> Floats:
        return floats("distance", self.function(x), shape=(len(x),))

    def _finest(self, x: Floats, step: float, least: float) -> Floats:
        """Differences by a step, by smaller ones where these are no gradient of length 1."""
        slope = self._slope(x, step)
        off = np.abs(length(slope) - 1)
        again = np.flatnonzero(off > _FINE)
        while again.size and step * _FINER >= least:
            step *= _FINER
            finer = self._slope(x[again], step)
            missed = np.abs(length(finer) - 1)
            better = missed < off[again]
            slope[again[better]], off[again[better]] = finer[better], missed[better]
            # What is off by little and gains nothing has come to its rounding.
            again = again[(off[again] > _FINE) & (better | (off[again] > _UNIT))]
        return slope

    def _slope(self, x: Floats, step: float) -> Floats:
        # On a grid on which places and steps add up exactly: what is rounded away would
        # be divided by the step.
        largest = float(np.abs(x).max(initial=0.0)) + 2 * step
        grid = 4 * np.spacing(largest)
        step = max(1.0, np.rint(step / grid)) * grid
        x = np.rint(x / grid) * grid
        slope = np.empty_like(x)
        for k, unit in enumerate(np.eye(x.shape[1])):
            ahead = [self._at(x + j * step * unit) for j in (-2, -1, 1, 2)]
            slope[:, k] = (ahead[0] - ahead[3] + 8 * (ahead[2] - ahead[1])) / (
                12 * step
            )
        return slope


@dataclass(frozen=True)
class Union:
    """Several obstacles as one: the nearest counts, node by node.

    Where a node may touch two at once, in the corner of a box, give each of them a
    contact of its own on the same surface: the node then has two.
    """

    obstacles: Sequence[Obstacle]

    def __post_init__(self) -> None:
        if not len(self.obstacles):
            raise ValueError("obstacles is empty, expected at least one")
        dims = {one.dim for one in self.obstacles} - {None}
        if len(dims) > 1:
            raise ValueError("obstacles mix two and three dimensions")

    @property
    def dim(self) -> int | None:
        """2 or 3, or ``None`` where none of them tells."""
        return next((one.dim for one in self.obstacles if one.dim is not None), None)

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; of two at one distance, the first."""
        return self._nearest([ask(one, points) for one in self.obstacles])

    def facing(self, points: Floats, outward: Floats) -> Closest:
        """As `Surface.facing`."""
        return self._nearest([ask(one, points, outward) for one in self.obstacles])

    def _nearest(self, all_: Sequence[Closest]) -> Closest:
        nearest = np.argmin([found.distance for found in all_], axis=0)
        at = np.arange(len(nearest))
        distance, normal, foot = (
            np.stack(each)[nearest, at] for each in zip(*all_, strict=True)
        )
        return Closest(distance, normal, foot)


# Those of this package, which answer as they should.
_OWN = (Plane, Sphere, Cylinder, Distance, Surface, Union)
# What another obstacle may miss of |n| = 1, and of lying where it says, of the size of
# the points.
_TOLD = 1e-6
# What the distance of a foot may be, of that which it is the foot of: some obstacles know
# distances to first order, as those over a profile of heights; of a wrong sign it is twice.
_NEARLY = 0.1


def ask(obstacle: Obstacle, points: Floats, outward: Floats | None = None) -> Closest:
    """The closest points of an obstacle, checked where it is not one of this package.

    With ``outward (n, d)``, directions out of the body there, `Surface.facing`.

    Raises
    ------
    TypeError, ValueError
        It answers with other shapes or with what is no number; normals that have not
        length 1; feet that are not ``point - distance * normal``, or not on the obstacle;
        a distance that is not negative on the other side of the surface.
    """
    if isinstance(obstacle, Surface | Union) and outward is not None:
        return obstacle.facing(points, outward)
    if isinstance(obstacle, _OWN):
        return obstacle.closest(points)
    what = f"obstacle {type(obstacle).__name__}"
    found = _answer(what, obstacle, points)
    if not len(points):
        return found
    extent = max(
        float(np.ptp(points, axis=0).max()), float(np.abs(found.distance).max())
    )
    rounding = 1e3 * float(np.spacing(np.abs(points).max()))
    slack = max(_TOLD * extent, rounding)
    off = np.abs(length(found.normal) - 1)
    between = length(points - found.distance[:, None] * found.normal - found.foot)
    for miss, most, words in (
        (off, _TOLD, "normal has not length 1, it misses it by"),
        (between, slack, "foot is not point - distance * normal, it is off by"),
    ):
        if (miss > most).any():
            at = int(np.argmax(miss))
            raise ValueError(
                f"{what}: at {place(points[at])} its {words} {miss[at]:.3g}"
            )
    again = np.abs(_answer(what, obstacle, found.foot).distance)
    far = again > np.maximum(slack, _NEARLY * np.abs(found.distance))
    if far.any():
        at = int(np.argmax(far))
        raise ValueError(
            f"{what}: at {place(points[at])} its foot is {place(found.foot[at])}, which has "
            f"the distance {again[at]:.3g}, expected a point of its surface: is the "
            "distance negative inside, and the normal outward there too?"
        )
    # Beyond a rim the other side is outside too: where it is so everywhere, there is none.
    step = 4 * slack
    behind = _answer(what, obstacle, found.foot - step * found.normal).distance
    if (behind > step / 2).all():
        raise ValueError(
            f"{what}: behind its surface, at {place(found.foot[0] - step * found.normal[0])}, "
            f"its distance is {behind[0]:.3g}, expected a negative one: it is signed"
        )
    return found


def _answer(what: str, obstacle: Obstacle, points: Floats) -> Closest:
    """What an obstacle says, of the right shapes and of numbers."""
    found = obstacle.closest(points)
    try:
        parts = (found.distance, found.normal, found.foot)
    except AttributeError:
        raise TypeError(
            f"{what} answers with {shown(found)}, expected a Closest of distance, normal "
            "and foot"
        ) from None
    shapes = ((len(points),), points.shape, points.shape)
    checked = []
    for name, value, shape in zip(Closest._fields, parts, shapes, strict=True):
        array = floats(f"{name} of the {what}", value, shape=shape, finite=False)
        bad = ~np.isfinite(array.reshape(len(points), -1)).all(axis=1)
        if bad.any():
            at = int(np.argmax(bad))
            raise ValueError(
                f"{name} of the {what} is {array[at].tolist()} at {place(points[at])}, "
                "expected finite numbers"
            )
        checked.append(array)
    return Closest(*checked)


class Approach(NamedTuple):
    """An obstacle as nodes see it, at the start and at the end of each load step.

    Attributes
    ----------
    normal
        ``(n, d)``, of the state in which the obstacle is nearest to the node.
    distance
        ``(1 + steps, n)`` [m], signed.
    drag
        ``(1 + steps, n, d)`` [m]: how far what rests on the obstacle under the node has
        been carried since the start.
    """

    normal: Floats
    distance: Floats
    drag: Floats


def approach(
    obstacle: Obstacle,
    motion: Motion | None,
    points: Floats,
    outward: Floats | None = None,
) -> Approach:
    """Follow an obstacle past ``points (n, d)``, which stay where they are.

    ``outward (n, d)`` are directions out of the body there, of any length; with them a
    place on an edge of a surface has the normal of `Surface.facing`.

    A tangential gap is ``-drag`` in the frame of the contact: relative to an obstacle that
    has carried its surface by ``s``, a body at rest has moved by ``-s``. So an obstacle
    that is translated by ``s`` does to the bodies, to rounding, what supports do that
    displace all of them by ``-s``.
    """
    states = 1 if motion is None else 1 + motion.steps
    if motion is not None and motion.dim != points.shape[1]:
        raise ValueError(
            f"motion is one in {motion.dim} dimensions, the points have {points.shape[1]}"
        )
    distance = np.empty((states, len(points)))
    drag = np.zeros((states, *points.shape))
    normal = feet = np.empty_like(points)
    for k in range(states):
        before = feet
        distance[k], towards, feet = _seen(obstacle, motion, points, k, outward)
        if k == 0 or motion is None:
            normal = towards
            continue
        drag[k] = drag[k - 1] + motion.drag(np.stack([before, feet]), k)
        nearest = distance[k] < distance[:k].min(axis=0)
        normal = np.where(nearest[:, None], towards, normal)
    return Approach(normal, distance, drag)


def onwards(
    obstacle: Obstacle, motion: Motion, points: Floats
) -> tuple[Floats, Floats]:
    """Distances at the last of two states of a motion, and the drag since the first.

    Returns
    -------
    distance, drag
        ``(n,)`` and ``(n, d)`` [m]: what `approach` would add to the drag of the first.
    """
    _, _, before = _seen(obstacle, motion, points, 1)
    distance, _, feet = _seen(obstacle, motion, points, 2)
    return distance, motion.drag(np.stack([before, feet]), 2)


def _seen(
    obstacle: Obstacle,
    motion: Motion | None,
    points: Floats,
    state: int,
    outward: Floats | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Distances, normals and feet of points, of the obstacle as it stands in a state."""
    seen = points if motion is None else motion.back(points, state)
    if outward is not None and motion is not None:
        outward = motion.backwards(outward, state)
    found = ask(obstacle, seen, outward)
    towards = found.normal if motion is None else motion.forwards(found.normal, state)
    return found.distance, towards, points - found.distance[:, None] * towards


def _radius(what: str, radius: float) -> None:
    if not 0 < number(f"radius of the {what}", radius) < np.inf:
        raise ValueError(
            f"radius of the {what} is {radius}, expected a positive number"
        )


def _round(x: Floats, arm: Floats, radius: float, inside: bool, centre: str) -> Closest:
    """Closest points of what lies at one distance from a centre or an axis."""
    far = length(arm)
    lost = far <= _CENTRE * radius
    if lost.any():
        at = x[np.argmax(lost)]
        raise ValueError(
            f"the point {place(at)} is at the {centre}: no normal is defined there"
        )
    sign = -1.0 if inside else 1.0
    normal = sign * arm / far[:, None]
    distance = sign * (far - radius)
    return Closest(distance, normal, x - distance[:, None] * normal)
