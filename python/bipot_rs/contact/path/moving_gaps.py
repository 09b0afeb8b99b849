"""Gaps of obstacles that turn or curve along the load path: each step has its own frames.

In step k a contact has the frame Q_k, the normal gap g_k of the undeformed node, and the
displacement s_k of the surface of the obstacle under it since the start of the path. With
w = u - s, the displacement of the node relative to that surface, its law (39) is about

    v_n = g_k + n_k · u_k,    slip_k = T_k (w_k - w_{k-1})

The tangential part of `Step.relative_displacement` is T_k w_k. Its normal part differs from
n_k · w_k by g_k + n_k · s_k, so that a step determines the whole vector w_k.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib import validation
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Floats
from bipot_rs.contact.law.frames import find_rotation
from bipot_rs.contact.results.solution import Step


@dataclass(frozen=True, eq=False)
class MovingGaps:
    """Gaps, frames and displacements of moving obstacles, of each load step or of one.

    It is a ``gap`` of `ContactProblem.solve` or the ``gaps`` of a `ContactProblem` whose
    ``frame`` is known: the rows of B are in that frame, and each step is solved in its own.
    ``moving[k]`` is that of one step, ``moving[a:b]`` that of several.

    Attributes
    ----------
    gap
        Distance of the undeformed node from the obstacle along the normal, ``(steps,
        n_c)`` or ``(n_c,)`` [length].
    frame
        Rows n, t1[, t2] in global components, ``(steps, n_c, d, d)`` or ``(n_c, d, d)``,
        orthonormal to 1e-6.
    drag
        Displacement of the surface of the obstacle under the node since the start of the
        path, in global components, ``(steps, n_c, d)`` or ``(n_c, d)`` [length].

    Raises
    ------
    TypeError, ValueError
        Shapes do not fit together, a number is not finite, or a frame is not orthonormal.

    Examples
    --------
    A node that two springs hold is 1 mm inside a plane, whose normal turns by 30° about the
    node. Without friction the force turns with it:

    >>> import numpy as np
    >>> import bipot_rs as bp
    >>> c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    >>> moving = bp.MovingGaps(
    ...     gap=[[-1e-3], [-1e-3]],
    ...     frame=[[np.eye(2)], [[[c, s], [-s, c]]]],
    ...     drag=np.zeros((2, 1, 2)),
    ... )
    >>> problem = bp.ContactProblem(
    ...     1e6 * np.eye(2),
    ...     np.eye(2),
    ...     gap=[0.0],
    ...     mu=0.0,
    ...     frame=[np.eye(2)],
    ...     gaps=moving,
    ... )
    >>> problem.solve().resultant.round(6)
    array([[1000.      ,    0.      ],
           [ 866.025404,  500.      ]])
    """

    gap: Floats
    frame: Floats
    drag: Floats

    __repr__ = short_repr

    def __init__(self, gap: ArrayLike, frame: ArrayLike, drag: ArrayLike) -> None:
        normal = validation.floats("gap of the moving gaps", gap)
        if normal.ndim not in (1, 2):
            raise ValueError(
                f"gap of the moving gaps has shape {normal.shape}, expected (n_c,) or "
                "(steps, n_c)"
            )
        moved = validation.floats("drag of the moving gaps", drag)
        d = moved.shape[-1] if moved.ndim else 0
        if d not in (2, 3) or moved.shape != (*normal.shape, d):
            raise ValueError(
                f"drag of the moving gaps has shape {moved.shape}, expected "
                f"{(*normal.shape, 'd')} with d = 2 or 3".replace("'", "")
            )
        bases = validation.floats(
            "frame of the moving gaps", frame, shape=(*normal.shape, d, d)
        )
        validation.frames(bases.reshape(-1, d, d), normal.size, d)
        for name, value in (("gap", normal), ("frame", bases), ("drag", moved)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        if self.gap.ndim == 1:
            raise TypeError(
                "these are the moving gaps of one step, which has no length"
            )
        return len(self.gap)

    @overload
    def __getitem__(self, step: int) -> MovingGaps: ...
    @overload
    def __getitem__(self, step: slice) -> MovingGaps: ...
    def __getitem__(self, step: int | slice) -> MovingGaps:
        len(self)  # raises for one step
        return MovingGaps(self.gap[step], self.frame[step], self.drag[step])

    def __iter__(self) -> Iterator[MovingGaps]:
        return (self[k] for k in range(len(self)))

    @property
    def by_component(self) -> Floats:
        """Gaps by component, ``(..., n_c, d)``: along the tangents minus ``drag``."""
        gaps = -np.einsum("...ij,...j->...i", self.frame, self.drag)
        gaps[..., 0] = self.gap
        return np.asarray(gaps, np.float64)

    def check_shape(self, contacts: int, d: int) -> None:
        """Refuse another number of contacts or another dimension."""
        count, components = self.drag.shape[-2:]
        if (count, components) != (contacts, d):
            raise ValueError(
                f"gap has moving gaps of {count} contacts in {components} dimensions, "
                f"expected {contacts} contacts in {d}"
            )

    def opened(self, depth: Floats) -> MovingGaps:
        """The same with normal gaps larger by ``depth (n_c,)``."""
        return MovingGaps(self.gap + depth, self.frame, self.drag)


def drop_equal_frames(moving: MovingGaps, frame: Floats) -> MovingGaps | Floats:
    """Gaps by component if no frame differs from that of B, ``(n_c, d, d)``."""
    if not (moving.frame == frame).all():
        return moving
    gaps = -np.einsum("cij,...cj->...ci", frame, moving.drag)
    gaps[..., 0] = moving.gap
    return np.asarray(gaps, np.float64)


def list_components(gap: Floats | MovingGaps) -> Floats:
    """Gaps ``(..., n_c, d)`` of either form."""
    return gap.by_component if isinstance(gap, MovingGaps) else gap


def join_steps(steps: Sequence[MovingGaps]) -> MovingGaps:
    """Moving gaps of several steps, from those of each."""
    names = ("gap", "frame", "drag")
    return MovingGaps(*(np.stack([getattr(k, name) for k in steps]) for name in names))


def read_gap(step: Step) -> Floats | MovingGaps | None:
    """Gaps of a step as an argument, with its frames if it has frames of its own."""
    if step.frame is None or step.drag is None or step.gap is None:
        return step.gap
    return MovingGaps(step.gap[:, 0], step.frame, step.drag)


def rotate(rows: Floats, values: Floats) -> Floats:
    """``Q x`` of values ``(n_c, d)``, with Q by rows as in `find_rotation`."""
    blocks = rows.reshape(len(values), -1, values.shape[1])
    return np.asarray(np.einsum("ckl,cl->ck", blocks, values), np.float64)


def carry_step(step: Step, frame: Floats, base: Floats, start: Floats) -> Step:
    """A step with its vectors in ``frame (n_c, d, d)``: the state before the next step.

    The tangential relative displacement is T w with w of this step and T of ``frame``, so
    that the next step adds its slip to it.

    ``base, start``: frame of B, and gaps ``(n_c,)`` at the start of the path, for a step
    without a frame of its own.
    """
    frame_of_step = base if step.frame is None else step.frame
    # g + n · s of the step; for an obstacle without frames of its own, s moves a plane.
    apart = start
    if step.drag is not None and step.gap is not None:
        apart = step.gap[:, 0] + np.einsum("ci,ci->c", frame_of_step[:, 0], step.drag)
    w = step.relative_displacement.copy()
    w[:, 0] -= apart
    turn = find_rotation(frame, frame_of_step)
    before = rotate(turn, w)
    before[:, 0] = step.relative_displacement[:, 0]
    return replace(
        step,
        reaction=rotate(turn, step.reaction),
        relative_displacement=before,
        # The inverse of W is that of the frames before.
        stats={k: v for k, v in step.stats.items() if k != "bytes_beside_W"},
    )
