"""Gaps and frames of each load step, if obstacles move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact.law.frames import frames, turn_frames
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.fem.contact.meeting import Meeting


def gaps_of_steps(
    found: Sequence[Meeting], contacts: Sequence[Contact], frame: Floats, turned: bool
) -> MovingGaps | None:
    """Gaps, frames and drag of each step for all contacts; None if no obstacle moves.

    Parameters
    ----------
    frame
        Frames at the start, ``(n_c, d, d)``.
    turned
        Whether their tangents were turned to those of inclined supports.
    """
    steps = sorted({len(one.moved.drag) for one in found if one.moved is not None})
    if not steps:
        return None
    if len(steps) > 1:
        raise ValueError(
            f"the motions of obstacles have {' and '.join(map(str, steps))} steps: give "
            "all the same number of steps"
        )
    parts, first = [], 0
    for one, contact in zip(found, contacts, strict=True):
        own = frame[first : first + len(one.gap)]
        first += len(one.gap)
        moved = one.moved
        if moved is None:
            shape = steps[0], *own.shape
            gap, bases = (
                np.broadcast_to(one.gap, shape[:2]),
                np.broadcast_to(own, shape),
            )
            parts.append((gap, bases, np.zeros(shape[:3])))
        else:
            bases = frames_of_steps(contact, own, moved.normal, turned)
            parts.append((moved.distance, bases, moved.drag))
    return MovingGaps(
        *(np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    )


def frames_of_steps(
    contact: Contact, frame: Floats, normals: Floats, turned: bool
) -> Floats:
    """Frames ``(steps, n_c, d, d)`` with given normals, one after the other from ``frame``.

    Tangents turn as little as normals do, unless ``axis`` determines them.
    """
    found = np.empty((*normals.shape[:2], *frame.shape[1:]))
    for k, normal in enumerate(normals):
        before = frame if k == 0 else found[k - 1]
        found[k] = turn_frames(before, normal)
        if contact.axis is not None and (np.ndim(contact.mu) == 1 or not turned):
            other = (found[k] != before).any(axis=(1, 2))
            found[k, other] = frames(normal[other], contact.axis)
    return found
