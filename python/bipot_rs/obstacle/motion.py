"""Rigid motions of obstacles along a load path, and where they take an obstacle."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats
from bipot_rs.obstacle.protocol import Obstacle, check_direction
from bipot_rs.obstacle.shapes import ask
from bipot_rs.obstacle.tuning import MOST_TURNS


@dataclass(frozen=True)
class Motion:
    """Finite translations and rotations, totals at the end of each load step.

    ``x -> about + R(rotation) (x - about) + translation``: the pole ``about`` moves with
    the translation, so that a roller always turns about its own axis. During a step,
    translation and rotation grow in proportion.

    Parameters
    ----------
    translation
        ``(steps, d)`` [m]; ``None`` for none.
    rotation
        Total angles ``(steps,)``, in **radians** unless ``degrees`` is true;
        counter-clockwise in 2D, right-handed about ``axis`` in 3D; ``None`` for none.
    about
        A point ``(d,)`` of the axis at the start; default the origin.
    axis
        Direction of the axis ``(3,)``, in 3D only.
    degrees
        Whether ``rotation`` is in degrees, as the ``angle`` of scene files and of
        `Model.obstacle` always is.

    Raises
    ------
    TypeError, ValueError
        Neither translation nor rotation is given, shapes do not fit, or the rotation is
        more than 100 turns in radians.

    Examples
    --------
    A quarter of a turn in radians and in degrees:

    >>> import numpy as np
    >>> one = Motion(rotation=[np.pi / 2])
    >>> other = Motion(rotation=[90.0], degrees=True)
    >>> corner = np.array([[1.0, 0.0]])
    >>> np.array_equal(one.forwards(corner, 1), other.forwards(corner, 1))
    True
    """

    translation: ArrayLike | None = None
    rotation: ArrayLike | None = None
    about: ArrayLike | None = None
    axis: ArrayLike | None = None
    degrees: bool = field(default=False, kw_only=True)
    _shift: Floats = field(init=False, repr=False, compare=False)
    _angle: Floats = field(init=False, repr=False, compare=False)
    _pole: Floats = field(init=False, repr=False, compare=False)
    _turn: Floats = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        shift = None
        if self.translation is not None:
            shift = floats("translation", self.translation, ndim=2)
        angle = None
        if self.rotation is not None:
            angle = self._radians(floats("rotation", self.rotation, ndim=1))
        pole = None if self.about is None else floats("about", self.about, ndim=1)
        turn = None if self.axis is None else check_direction("axis", self.axis, 3)
        if any(x is not None and not len(x) for x in (shift, angle)):
            raise ValueError("motion has no steps, expected at least one")
        if shift is None and angle is None:
            raise ValueError("motion has neither translation nor rotation")
        vectors_given = {"translation": shift, "about": pole}
        dims = {name: a.shape[-1] for name, a in vectors_given.items() if a is not None}
        d = 3 if turn is not None else next(iter(dims.values()), 2)
        for name, components in dims.items():
            if components != d or d not in (2, 3):
                raise ValueError(
                    f"{name} of the motion has {count_noun(components, 'component')}, expected "
                    + (str(d) if d in (2, 3) else "2 or 3")
                )
        if angle is not None and d == 3 and turn is None:
            raise ValueError("axis is missing: a rotation in 3D needs one")
        if shift is not None and angle is not None and len(shift) != len(angle):
            raise ValueError(
                f"rotation has {count_noun(len(angle), 'step')} but translation has "
                f"{len(shift)}: expected the same number"
            )
        steps = len(shift) if shift is not None else len(angle)  # type: ignore[arg-type]
        if angle is None:
            turn = None
        if turn is None:
            turn = np.zeros(3) if d == 3 else np.ones(1)
        start = np.zeros((1, d))
        shift = np.zeros((steps, d)) if shift is None else shift
        angle = np.zeros(steps) if angle is None else angle
        self._keep(
            shift=np.concatenate([start, shift]),
            angle=np.concatenate([[0.0], angle]),
            pole=np.zeros(d) if pole is None else pole,
            turn=turn,
        )

    def _radians(self, rotation: Floats) -> Floats:
        if not isinstance(self.degrees, bool):
            raise TypeError(f"degrees is {self.degrees!r}, expected True or False")
        if self.degrees:
            return np.deg2rad(rotation)
        turns = np.abs(rotation) / (2 * np.pi)
        if turns.max(initial=0.0) > MOST_TURNS:
            at = int(np.argmax(turns))
            raise ValueError(
                f"rotation at the end of load step {at + 1} is {rotation[at]:g}, {turns[at]:.0f} "
                f"turns: expected radians, at most {MOST_TURNS} turns; use degrees=True "
                "for degrees, or for more turns"
            )
        return rotation

    def _keep(self, **arrays: Floats) -> None:
        for name, array in arrays.items():
            array.flags.writeable = False
            object.__setattr__(self, f"_{name}", array)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return len(self._pole)

    @property
    def steps(self) -> int:
        """Load steps."""
        return len(self._angle) - 1

    @property
    def turns(self) -> bool:
        """Whether it rotates in any step."""
        return bool(self._angle.any())

    @property
    def shifts(self) -> Floats:
        """Translation at the start and at the end of each step, ``(1 + steps, d)`` [m]."""
        return self._shift

    def forwards(self, directions: Floats, state: int) -> Floats:
        """Rotate directions ``(n, d)`` of the obstacle from the start to ``state``.

        State 0 is the start, state k the end of load step k - 1.
        """
        angle = self._angle[state]
        # Without a rotation the result is bitwise the same.
        return directions if angle == 0 else directions @ self._matrix(angle).T

    def backwards(self, directions: Floats, state: int) -> Floats:
        """Rotate directions ``(n, d)`` back to the start, the inverse of `forwards`."""
        angle = self._angle[state]
        return directions if angle == 0 else directions @ self._matrix(angle)

    def back(self, points: Floats, state: int) -> Floats:
        """Move points ``(n, d)`` back by the motion: their position relative to the start."""
        moved, angle = points - self._shift[state], self._angle[state]
        if angle == 0:
            return np.asarray(moved, np.float64)
        return np.asarray(
            self._pole + (moved - self._pole) @ self._matrix(angle), np.float64
        )

    def drag(self, foot: Floats, state: int) -> Floats:
        """Displacement of the obstacle's surface under the nodes, ``(n, d)`` [m].

        From state - 1 to ``state``, at feet ``foot (2, n, d)`` at the beginning and the
        end: the velocity of the rigid motion ``t' + θ' e × (foot - about - t)``,
        integrated with feet and ``t`` that change linearly. Exact for translations and
        for rolling cylinders.
        """
        shift = self._shift[state] - self._shift[state - 1]
        turned = self._angle[state] - self._angle[state - 1]
        whole = np.broadcast_to(shift, foot.shape[1:])
        if turned == 0:
            return whole
        poles = self._pole + self._shift[[state - 1, state], None]
        arm = (foot - poles).mean(axis=0)
        return np.asarray(whole + turned * self._cross(arm), np.float64)

    def _cross(self, arm: Floats) -> Floats:
        """``e × arm``."""
        if self.dim == 2:
            return np.column_stack([-arm[:, 1], arm[:, 0]])
        return np.cross(self._turn, arm)

    def _matrix(self, angle: float) -> Floats:
        """Rotation by Rodrigues' formula, ``R = I + sin θ E + (1 - cos θ) E²``."""
        E = self._cross(np.eye(self.dim)).T
        # 1 - cos θ without the loss of digits at small angles.
        versine = 2 * np.sin(angle / 2) ** 2
        return np.asarray(np.eye(self.dim) + np.sin(angle) * E + versine * (E @ E))


class Approach(NamedTuple):
    """Distances, normals and drag of an obstacle in some states of its motion.

    Attributes
    ----------
    normal
        ``(states, n, d)``, towards the node.
    distance
        ``(states, n)`` [m], signed.
    drag
        ``(states, n, d)`` [m]: displacement since the first of these states of a material
        point that stays on the obstacle under the node.
    """

    normal: Floats
    distance: Floats
    drag: Floats

    def after(self) -> Approach:
        """The states after the first."""
        return Approach(*(field[1:] for field in self))


def approach(
    obstacle: Obstacle,
    motion: Motion | None,
    points: Floats,
    outward: Floats | None = None,
    since: int = 0,
) -> Approach:
    """Follow an obstacle along its motion past fixed ``points (n, d)``.

    ``outward (n, d)`` are outward directions of the body there, of any length; with them
    a point on an edge of a `Surface` gets the normal of `Surface.facing`. The states are
    those from ``since`` on: 0 is the start, k the end of load step k - 1.

    The tangential gap is ``-drag`` in the frame of the step: a body at rest moves by
    ``-s`` relative to an obstacle whose surface moves by ``s``. An obstacle translated by
    ``s`` is therefore equivalent, to rounding, to supports that move all bodies by ``-s``.
    """
    last = 0 if motion is None else motion.steps
    if motion is not None and motion.dim != points.shape[1]:
        raise ValueError(
            f"motion has {motion.dim} dimensions, but the points have {points.shape[1]}"
        )
    states = 1 + last - since
    distance = np.empty((states, len(points)))
    drag = np.zeros((states, *points.shape))
    normal = np.empty((states, *points.shape))
    feet = np.empty_like(points)
    for k, state in enumerate(range(since, last + 1)):
        before = feet
        seen, facing = points, outward
        if motion is not None:
            seen = motion.back(points, state)
            facing = None if outward is None else motion.backwards(outward, state)
        closest = ask(obstacle, seen, facing)
        distance[k], normal[k] = closest.distance, closest.normal
        if motion is not None:
            normal[k] = motion.forwards(closest.normal, state)
        feet = points - closest.distance[:, None] * normal[k]
        if k > 0 and motion is not None:
            drag[k] = drag[k - 1] + motion.drag(np.stack([before, feet]), state)
    return Approach(normal, distance, drag)
