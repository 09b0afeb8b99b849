"""Rigid obstacles, at rest or moving along the load path.

An obstacle is any object with ``dim`` and ``closest(points)`` (`Obstacle`). The shapes
here have a formula; `Surface` consists of facets. The answers of classes defined
elsewhere are checked (`ask`).

Displacements are small: the gap and the normal n of a load step are those of the moved
obstacle at the undeformed node. The distance is ``g``; a displacement u makes it
``g + n·u``. This neglects ``|u_t|²/(2R)`` of the gap and ``|u_t|/R`` of the normal for an
obstacle of radius R. It is exact for planes, however they turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.matrices import length
from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import callback, floats, number, show_value
from bipot_rs.contact.law.frames import frames
from bipot_rs.obstacle.protocol import (
    Closest,
    Obstacle,
    check_direction,
    check_points,
)
from bipot_rs.obstacle.triangulated import Surface
from bipot_rs.obstacle.tuning import (
    DIFFERENCE_STEP,
    FINE_GRADIENT,
    FOOT_OFF,
    STEP_REDUCTION,
)

# A normal at a distance from the axis or centre below this fraction of the radius has
# lost half of its digits.
_CENTRE = 1e-8
# Tolerance of |∇d| = 1, and of d(foot) = 0 relative to the extent of the points.
_UNIT = 1e-6


@dataclass(frozen=True)
class Plane:
    """A plane through ``point (d,)`` whose ``normal (d,)`` points towards the bodies."""

    point: ArrayLike
    normal: ArrayLike

    def __post_init__(self) -> None:
        direction = check_direction("normal of the plane", self.normal)
        floats("point of the plane", self.point, shape=direction.shape)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(np.asarray(self.normal))

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`."""
        x = check_points(points, self.dim)
        n = check_direction("normal of the plane", self.normal)
        distance = (x - np.asarray(self.point, np.float64)) @ n
        return Closest(distance, np.tile(n, (len(x), 1)), x - distance[:, None] * n)


@dataclass(frozen=True)
class Sphere:
    """A ball, in 2D a disc; with ``inside=True`` a cavity that contains the bodies.

    Parameters
    ----------
    centre
        ``(d,)`` [m].
    radius
        Positive [m].
    inside
        Whether the bodies are inside: normals then point to the centre.
    """

    centre: ArrayLike
    radius: float
    inside: bool = False

    def __post_init__(self) -> None:
        _place("centre of the sphere", self.centre)
        _positive("radius of the sphere", self.radius)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(np.asarray(self.centre))

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; `ValueError` for a point at the centre."""
        x = check_points(points, self.dim)
        arm = x - np.asarray(self.centre, np.float64)
        return _round(x, arm, self.radius, self.inside, "centre of the sphere")


@dataclass(frozen=True)
class Cylinder:
    """An infinite circular cylinder, in 2D a disc; with ``inside=True`` a bore.

    Parameters
    ----------
    point
        A point on the axis, ``(d,)`` [m]; in 2D the centre.
    radius
        Positive [m].
    axis
        Direction of the axis, ``(3,)``; None in 2D.
    inside
        Whether the bodies are inside: normals then point to the axis.
    """

    point: ArrayLike
    radius: float
    axis: ArrayLike | None = None
    inside: bool = False

    def __post_init__(self) -> None:
        point = _place("point of the cylinder", self.point)
        if (self.axis is None) != (len(point) == 2):
            raise ValueError(
                "axis of the cylinder is missing"
                if self.axis is None
                else "axis of the cylinder was given, but a 2D cylinder has none"
            )
        if self.axis is not None:
            check_direction("axis of the cylinder", self.axis, 3)
        _positive("radius of the cylinder", self.radius)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(np.asarray(self.point))

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; `ValueError` for a point on the axis."""
        x = check_points(points, self.dim)
        arm = x - np.asarray(self.point, np.float64)
        if self.axis is not None:
            arm = _across(arm, check_direction("axis of the cylinder", self.axis, 3))
        return _round(x, arm, self.radius, self.inside, "axis of the cylinder")


@dataclass(frozen=True)
class Torus:
    """A ring with a circular cross-section; with ``inside=True`` the bodies are in it.

    Parameters
    ----------
    centre
        ``(3,)`` [m].
    axis
        Direction of the axis of rotation, ``(3,)``, of any length.
    major_radius
        Radius of the circle of the tube's centres, > 0 [m].
    minor_radius
        Radius of the tube, > 0 and below ``major_radius`` [m].
    inside
        Whether the bodies are inside the tube: normals then point to its centre.

    Notes
    -----
    The closest point is exact: the closest point ``m`` of the circle of centres, then
    the closest point to x of the sphere of radius ``minor_radius`` about ``m``. A point
    on the axis is equally far from a whole circle of the torus; one of its points is
    taken.
    """

    centre: ArrayLike
    axis: ArrayLike
    major_radius: float
    minor_radius: float
    inside: bool = False

    def __post_init__(self) -> None:
        floats("centre of the torus", self.centre, shape=(3,))
        check_direction("axis of the torus", self.axis, 3)
        _positive("major_radius of the torus", self.major_radius)
        _positive("minor_radius of the torus", self.minor_radius)
        if not self.minor_radius < self.major_radius:
            raise ValueError(
                f"minor_radius of the torus is {self.minor_radius}, expected a number "
                f"below major_radius, {self.major_radius}"
            )

    @property
    def dim(self) -> int:
        """3."""
        return 3

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; `ValueError` for a point at the centre of the tube."""
        x = check_points(points, 3)
        axis = check_direction("axis of the torus", self.axis, 3)
        arm = x - np.asarray(self.centre, np.float64)
        radial = _across(arm, axis)
        far = length(radial)
        # On the axis: any direction across it.
        radial[far == 0], far[far == 0] = frames(axis[None])[0, 1], 1.0
        arm = arm - self.major_radius * radial / far[:, None]
        return _round(x, arm, self.minor_radius, self.inside, "centre of the tube")


@dataclass(frozen=True)
class Distance:
    """An obstacle defined by its signed distance function, negative inside.

    Parameters
    ----------
    function
        Distances ``(n,)`` at points ``(n, d)`` [m].
    gradient
        Gradients ``(n, d)`` at points ``(n, d)``; default central differences of
        fourth order.
    step
        Step of these differences [m]; default 1/1000 of the extent of the points or of
        their distances. It must be well below the smallest radius of curvature of the
        obstacle; the default is reduced until the gradient has length 1.

    Notes
    -----
    A function that is not a distance is refused: the gradient must have length 1 to
    1e-6, and at the foot ``x - d ∇d`` the function must be zero to 1e-6 of the extent of
    the points.
    """

    function: Callable[[Floats], ArrayLike]
    gradient: Callable[[Floats], ArrayLike] | None = None
    step: float | None = None

    def __post_init__(self) -> None:
        callback("function of the distance", self.function)
        callback("gradient of the distance", self.gradient)
        if self.function is None:
            raise TypeError("function of the distance is None, expected a function")
        if self.step is not None and not number("step of the distance", self.step) > 0:
            raise ValueError(
                f"step of the distance is {self.step}, expected a positive number"
            )

    @property
    def dim(self) -> None:
        """None: the function decides."""
        return

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; `ValueError` where the function is not a distance."""
        x = check_points(points, None)
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
            # For a single point on the surface, only its coordinates give a size.
            reference_length = extent if extent > 1e3 * rounding else far or 1.0
            slope = self._finest(x, DIFFERENCE_STEP * reference_length, rounding)
        size = length(slope)
        off = np.abs(size - 1)
        if not (off <= _UNIT).all():
            at = int(np.argmax(off))
            raise ValueError(
                f"the gradient of the distance has length {size[at]:g} at {place(x[at])}, "
                f"expected 1 to {_UNIT:g}: the function must be a signed distance that is "
                "smooth there; being zero on the surface is not enough"
            )
        normal = slope / size[:, None]
        foot = x - distance[:, None] * normal
        missed = np.abs(self._at(foot))
        if not (missed <= _UNIT * extent + rounding).all():
            at = int(np.argmax(missed))
            raise ValueError(
                f"the distance at {place(x[at])} is {distance[at]:g}, but at the foot "
                f"x - d ∇d, {place(foot[at])}, it is {missed[at]:g}, expected zero: the "
                "function must be a signed distance"
            )
        return Closest(distance, normal, foot)

    def _at(self, x: Floats) -> Floats:
        return floats("distance", self.function(x), shape=(len(x),))

    def _finest(self, x: Floats, step: float, least: float) -> Floats:
        """Gradients by differences; the step is reduced where their length is not 1."""
        slope = self._slope(x, step)
        off = np.abs(length(slope) - 1)
        again = np.flatnonzero(off > FINE_GRADIENT)
        while again.size and step * STEP_REDUCTION >= least:
            step *= STEP_REDUCTION
            finer = self._slope(x[again], step)
            missed = np.abs(length(finer) - 1)
            better = missed < off[again]
            slope[again[better]], off[again[better]] = finer[better], missed[better]
            # A small error that a smaller step does not reduce is rounding.
            again = again[
                (off[again] > FINE_GRADIENT) & (better | (off[again] > _UNIT))
            ]
        return slope

    def _slope(self, x: Floats, step: float) -> Floats:
        # Points and steps on a grid where their sums are exact: a rounding error would
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
    """Several obstacles as one: each node meets the nearest.

    If a node can touch two obstacles at once, as in the corner of a box, define one
    contact for each obstacle on the same surface instead: the node then has two contacts.
    """

    obstacles: Sequence[Obstacle]

    def __post_init__(self) -> None:
        if not len(self.obstacles):
            raise ValueError("obstacles is empty, expected at least one")
        dims = {part.dim for part in self.obstacles} - {None}
        if len(dims) > 1:
            raise ValueError("obstacles mix two and three dimensions")

    @property
    def dim(self) -> int | None:
        """2 or 3; ``None`` if every obstacle has ``dim`` None."""
        return next((part.dim for part in self.obstacles if part.dim is not None), None)

    def closest(self, points: Floats, /) -> Closest:
        """As `Obstacle`; at equal distances, the first obstacle."""
        return self._nearest([ask(part, points) for part in self.obstacles])

    def facing(self, points: Floats, outward: Floats) -> Closest:
        """As `Surface.facing`."""
        return self._nearest([ask(part, points, outward) for part in self.obstacles])

    def _nearest(self, all_: Sequence[Closest]) -> Closest:
        nearest = np.argmin([closest.distance for closest in all_], axis=0)
        at = np.arange(len(nearest))
        distance, normal, foot = (
            np.stack(each)[nearest, at] for each in zip(*all_, strict=True)
        )
        return Closest(distance, normal, foot)


# The classes of this package: their answers need no check.
_OWN = (Plane, Sphere, Cylinder, Torus, Distance, Surface, Union)
# Tolerance for other classes: of |n| = 1, and of the foot relative to the extent of the
# points.
_TOLERANCE = 1e-6


def ask(obstacle: Obstacle, points: Floats, outward: Floats | None = None) -> Closest:
    """Closest points of an obstacle; the answers of other classes are checked.

    With ``outward (n, d)``, outward directions of the body at the points, a `Surface`
    answers by `Surface.facing`.

    Raises
    ------
    TypeError, ValueError
        The answer has a wrong shape or is not finite; a normal does not have length 1;
        a foot is not ``point - distance * normal`` or does not lie on the obstacle; the
        distance is not negative behind the surface.
    """
    if isinstance(obstacle, Surface | Union) and outward is not None:
        return obstacle.facing(points, outward)
    if isinstance(obstacle, _OWN):
        return obstacle.closest(points)
    what = f"obstacle {type(obstacle).__name__}"
    closest = _answer(what, obstacle, points)
    if not len(points):
        return closest
    extent = max(
        float(np.ptp(points, axis=0).max()), float(np.abs(closest.distance).max())
    )
    rounding = 1e3 * float(np.spacing(np.abs(points).max()))
    slack = max(_TOLERANCE * extent, rounding)
    off = np.abs(length(closest.normal) - 1)
    between = length(points - closest.distance[:, None] * closest.normal - closest.foot)
    for miss, most, words in (
        (off, _TOLERANCE, "normal does not have length 1, the error is"),
        (between, slack, "foot is not point - distance * normal, the error is"),
    ):
        if (miss > most).any():
            at = int(np.argmax(miss))
            raise ValueError(
                f"{what}: at {place(points[at])} its {words} {miss[at]:.3g}"
            )
    again = np.abs(_answer(what, obstacle, closest.foot).distance)
    far = again > np.maximum(slack, FOOT_OFF * np.abs(closest.distance))
    if far.any():
        at = int(np.argmax(far))
        raise ValueError(
            f"{what}: the foot of {place(points[at])} is {place(closest.foot[at])}, whose "
            f"distance is {again[at]:.3g}, expected 0: check that inside the obstacle the "
            "distance is negative and the normal points outwards"
        )
    # Beyond a rim the point behind is outside too. If it is outside behind all points,
    # the distance has no sign.
    step = 4 * slack
    behind = _answer(what, obstacle, closest.foot - step * closest.normal).distance
    if (behind > step / 2).all():
        raise ValueError(
            f"{what}: behind its surface, at {place(closest.foot[0] - step * closest.normal[0])}, "
            f"its distance is {behind[0]:.3g}, expected a negative number: the distance "
            "must be signed"
        )
    return closest


def _answer(what: str, obstacle: Obstacle, points: Floats) -> Closest:
    """The answer of an obstacle, with checked shapes and finite numbers."""
    closest = obstacle.closest(points)
    try:
        parts = (closest.distance, closest.normal, closest.foot)
    except AttributeError:
        raise TypeError(
            f"{what} returns {show_value(closest)}, expected a Closest with distance, normal "
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


def _place(what: str, value: ArrayLike) -> Floats:
    coordinates = floats(what, value, ndim=1)
    if len(coordinates) not in (2, 3):
        raise ValueError(f"{what} has shape {coordinates.shape}, expected (2,) or (3,)")
    return coordinates


def _positive(what: str, value: float) -> None:
    if not 0 < number(what, value) < np.inf:
        raise ValueError(f"{what} is {value}, expected a positive number")


def _across(arm: Floats, axis: Floats) -> Floats:
    """Vectors ``(n, 3)`` without their component along a unit axis."""
    # Twice: far along the axis, one pass leaves its rounding.
    for _ in range(2):
        arm = arm - (arm @ axis)[:, None] * axis
    return arm


def _round(x: Floats, arm: Floats, radius: float, inside: bool, centre: str) -> Closest:
    """Closest points of a surface at one distance from a point, line or circle."""
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
