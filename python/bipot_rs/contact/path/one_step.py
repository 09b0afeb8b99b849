"""The reduced problem of one load step: W, the free part and the rigid motions."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import bipot_rs._core as _core
from bipot_rs._lib.types import CsrMatrix, Floats
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.law.frames import find_rotation
from bipot_rs.contact.path.bond import Bond
from bipot_rs.contact.path.load_path import NO_FRAME, find_start
from bipot_rs.contact.path.load_steps import Loading, Loads
from bipot_rs.contact.path.moving_gaps import (
    MovingGaps,
    carry_step,
    list_components,
)
from bipot_rs.contact.results.solution import Step

if TYPE_CHECKING:
    from bipot_rs.contact.results.state import Start


class StepArguments(NamedTuple):
    """``W``, ``q``, ``rigid`` and the law of a `ReducedProblem`."""

    W: Floats | CsrMatrix
    q: Floats
    rigid: tuple[Floats, Floats] | None
    law: ContactLaw


def reduce_step(
    core: _core.Condensed,
    loading: Loading,
    loads: Loads,
    start: Start | None,
    gap: ArrayLike | MovingGaps | None,
) -> StepArguments:
    """Reduce one step to its reactions; see `ContactProblem.reduced`."""
    contacts, d = loading.contacts.shape
    before = find_start(start, (contacts, d))
    if gap is not None or (before is not None and before.frame is not None):
        core, before = _place(core, loading, before, gap)
    q, modes, force = core.free_part(*loads)
    if before is not None:
        q[:, 1:] -= before.relative_displacement[:, 1:]
    bond = Bond.begin(loading.contacts, before)
    if bond.dilation is not None:
        q[:, 0] -= bond.dilation
    rigid = (np.ascontiguousarray(modes.T), force) if len(force) else None
    blocks = core.sparse_compliance()
    if blocks is None:
        return StepArguments(core.compliance(), q, rigid, bond.weakened)
    from scipy.sparse import bsr_array

    first, columns, values = blocks
    entries = values.reshape(-1, d, d), columns, first
    W = bsr_array(entries, shape=(d * contacts, d * contacts)).tocsr()
    return StepArguments(W, q, rigid, bond.weakened)


def _place(
    core: _core.Condensed,
    loading: Loading,
    before: Step | None,
    gap: ArrayLike | MovingGaps | None,
) -> tuple[_core.Condensed, Step | None]:
    """The condensed bodies and the state before a step, in the frames of the step."""
    contacts = loading.contacts
    base = contacts.frame
    has_frame = before is not None and before.frame is not None
    placed = None if gap is None else loading.read_gap(gap)
    if base is None:
        if has_frame:
            raise ValueError(NO_FRAME)
        # `Loading` refuses moving gaps without these frames.
        return core if placed is None else core.with_gap(
            list_components(placed)
        ), before
    frame = placed.frame if isinstance(placed, MovingGaps) else base
    if frame is not base:
        core = core.rotated(find_rotation(frame, base))
    if before is not None and (has_frame or frame is not base):
        before = carry_step(before, frame, base, contacts.gap_by_component[:, 0])
    if placed is not None:
        core = core.with_gap(list_components(placed))
    return core, before
