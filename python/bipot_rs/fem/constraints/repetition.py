"""Cyclic symmetry and periodicity: two cuts of a structure that repeats itself.

A sector of a structure of N equal sectors under loads that repeat too: the displacement on
one cut is that on the other, rotated by 360°/N, ``u(Q x) = Q u(x)``. Where a structure repeats
by translation, ``u(x + t) = u(x)``. The two cuts have the same nodes up to this motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs._lib.validation import floats, integer
from bipot_rs.contact.law.frames import frames
from bipot_rs.fem.bodies.body import NumberedBodies
from bipot_rs.fem.constraints.ties import Relations
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.fem.contact.meeting import Meeting, nearest_points
from bipot_rs.obstacle.motion import Approach
from bipot_rs.obstacle.protocol import check_direction

# Tolerance of coordinates from two meshers, relative to the size of the body.
_SAME = 1e-7
# Tolerance of gaps and normals at a contact and its image, relative to the size of the body
# and to 1: files give coordinates with seven digits.
_AGREE = 1e-5
# Entries of a rotation below this are rounding of zero.
_GONE = 1e-15


@dataclass(frozen=True)
class Cyclic:
    """Two cuts of one of ``sectors`` equal sectors about an axis.

    Parameters
    ----------
    on, onto
        ``(body, surface)`` of the two cuts, in any order.
    sectors
        Number of sectors of the whole structure, at least 2.
    about
        A point of the axis ``(d,)`` [m]; default the origin.
    axis
        Direction of the axis ``(3,)``, in space only.
    """

    on: tuple[str, str]
    onto: tuple[str, str]
    sectors: int
    about: ArrayLike | None = None
    axis: ArrayLike | None = None


@dataclass(frozen=True)
class Periodic:
    """Two cuts of a structure that repeats itself by a translation.

    Parameters
    ----------
    on, onto
        ``(body, surface)`` of the two cuts. The translation from ``on`` to ``onto`` is that
        between the centres of their boxes.
    """

    on: tuple[str, str]
    onto: tuple[str, str]


Repetition = Cyclic | Periodic


@dataclass(frozen=True)
class Images:
    """The nodes of two cuts."""

    # on, onto (m,): first degree of freedom of each node of the first cut, and of its image.
    on: Ints
    onto: Ints
    turn: Floats  # (d, d): Q, the identity for a translation
    what: str  # names of the cuts, for messages
    size: float  # largest extent of the body [m]

    def relations(self) -> Relations:
        """``u(Q x) - Q u(x) = 0``."""
        d = len(self.turn)
        rows = self.onto[:, None] + np.arange(d)
        dofs = np.empty((len(self.on), d, 1 + d), np.int64)
        dofs[:, :, 0] = rows
        dofs[:, :, 1:] = (self.on[:, None] + np.arange(d))[:, None, :]
        values = np.empty(dofs.shape)
        values[:, :, 0], values[:, :, 1:] = 1.0, -self.turn
        return Relations(dofs.reshape(-1, 1 + d), values.reshape(-1, 1 + d))


def find_images(bodies: NumberedBodies, repetition: Repetition) -> Images:
    """Find the image of each node.

    Raises `ValueError`: names that do not exist, a wrong axis or number, cuts whose nodes do
    not match.
    """
    (on_body, here), (other, there) = repetition.on, repetition.onto
    near, far = bodies[on_body], bodies[other]
    first, second = near.body.nodes(here), far.body.nodes(there)
    what = f"{on_body}.{here} and {other}.{there}"
    if isinstance(repetition, Periodic) and repetition.on == repetition.onto:
        raise ValueError(
            f"surfaces {what} of a periodicity are the same: name its two cuts"
        )
    if len(first) != len(second):
        raise ValueError(
            f"surfaces {what} repeat each other, but have {len(first)} and {len(second)} "
            "nodes: mesh both in the same way"
        )
    x, y = near.body.points[first], far.body.points[second]
    size = float(np.ptp(near.body.points, axis=0).max())
    tried = []
    for turn, moved in _motions(repetition, x, y, bodies.dim, what):
        match = nearest_points(moved, y)
        off = np.linalg.norm(moved - y[match], axis=1)
        tried.append((float(off.max()), turn, match, int(np.argmax(off))))
    off_by, turn, match, worst = min(tried, key=lambda attempt: attempt[0])
    if off_by <= _SAME * size and len(np.unique(match)) < len(match):
        _, first_of, counts = np.unique(match, return_index=True, return_counts=True)
        raise ValueError(
            f"surfaces {what} cannot be cuts of one another: several nodes of "
            f"{on_body}.{here} are at {place(x[first_of[counts > 1][0]])}, as where the "
            "section of a bolt or a crack meets a cut: choose cuts that meet neither"
        )
    if off_by > _SAME * size:
        raise ValueError(
            f"surfaces {what} do not repeat each other: the image of the node at "
            f"{place(x[worst])} is {off_by:g} from the nearest node: check the axis and "
            "the number of sectors, and mesh both cuts in the same way"
        )
    on, onto = near.dofs[first, 0], far.dofs[second[match], 0]
    return Images(on, onto, turn, what, size)


def _motions(
    repetition: Repetition, x: Floats, y: Floats, dim: int, what: str
) -> list[tuple[Floats, Floats]]:
    """Rotations that may take one cut to the other, with the moved nodes."""
    if isinstance(repetition, Periodic):
        low, high = x.min(axis=0), x.max(axis=0)
        shift = (y.min(axis=0) - low + y.max(axis=0) - high) / 2
        return [(np.eye(dim), x + shift)]
    count = integer(f"sectors of {what}", repetition.sectors, least=2)
    about = np.zeros(dim)
    if repetition.about is not None:
        about = floats(f"about of {what}", repetition.about, shape=(dim,))
    if (repetition.axis is None) == (dim == 3):
        raise ValueError(
            f"axis of {what} is {'missing' if dim == 3 else 'given'}: a cyclic symmetry "
            "needs an axis in space, and none in the plane"
        )
    axis = None
    if dim == 3:
        axis = check_direction(f"axis of {what}", repetition.axis, 3)
    motions = []
    for angle in (2 * np.pi / count, -2 * np.pi / count):
        turn = _rotation(angle, axis)
        motions.append((turn, about + (x - about) @ turn.T))
    return motions


def _rotation(angle: float, axis: Floats | None) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    if axis is None:
        turn = np.array([[c, -s], [s, c]])
    else:
        n = np.asarray(axis) / np.linalg.norm(axis)
        across = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
        turn = c * np.eye(3) + s * across + (1 - c) * np.outer(n, n)
    turn[np.abs(turn) <= _GONE] = 0.0
    return np.asarray(turn, np.float64)


def refuse_floating(contacts: Sequence[Contact], pairs: Images) -> None:
    """Refuse obstacles that are free to translate where the repetition allows no motion.

    Forces of equal sectors on a common obstacle cancel across the axis, while that of one
    sector would move it.
    """
    moved = np.linalg.norm(pairs.turn - np.eye(len(pairs.turn)), axis=0)
    for contact in contacts:
        floating = contact.floating
        across = (
            [] if floating is None else [k for k in floating.components if moved[k]]
        )
        if floating is not None and across:
            raise ValueError(
                f"the floating obstacle {floating.name!r} may translate along "
                f"{' and '.join('xyz'[k] for k in across)}, but with the sectors of "
                f"{pairs.what} only along their axis: leave out these components"
            )


def merge_images(
    meetings: Sequence[Meeting],
    contacts: Sequence[Contact],
    pairs: Images,
    cuts: Sequence[Images],
    nodes: Floats,
) -> list[Meeting]:
    """Contacts of nodes, with those on the second cut joined to their images.

    A node on a cut has half of its contact area on either side. Both halves move alike: they
    are one contact with the whole area, at the node of the first cut. Two contacts whose
    opposite nodes are not images by another of the ``cuts`` do not move alike, and both
    stay, as do mortar contacts. ``nodes`` are the positions of all nodes.

    Raises `ValueError`: the obstacle does not repeat itself: gaps, normals or motions differ.
    """
    alike = _opposite(pairs, cuts)
    return [
        meeting
        if meeting.rows is not None
        else _merge_meeting(meeting, contact, pairs, alike, nodes)
        for meeting, contact in zip(meetings, contacts, strict=True)
    ]


def _opposite(pairs: Images, cuts: Sequence[Images]) -> set[tuple[int, int]]:
    """First degrees of freedom of opposite nodes that repeat like those of ``pairs``."""
    opposite = {(-1, -1)}
    for cut in cuts:
        ends = cut.on.tolist(), cut.onto.tolist()
        if np.abs(cut.turn - pairs.turn).max() <= _AGREE:
            opposite.update(zip(*ends, strict=True))
        if np.abs(cut.turn.T - pairs.turn).max() <= _AGREE:
            opposite.update(zip(*reversed(ends), strict=True))
    return opposite


def _merge_meeting(
    meeting: Meeting,
    contact: Contact,
    pairs: Images,
    alike: set[tuple[int, int]],
    nodes: Floats,
) -> Meeting:
    at = {dof: i for i, dof in enumerate(meeting.dofs[:, 0].tolist())}
    partner = meeting.dofs[:, 1].tolist()
    joined: dict[int, int] = {}
    for dof, image in zip(pairs.on.tolist(), pairs.onto.tolist(), strict=True):
        if dof == image or dof not in at or image not in at:
            continue
        first, second = at[dof], at[image]
        # Half a turn maps a single surface to itself, and each pair of nodes twice.
        if second not in joined and (partner[first], partner[second]) in alike:
            joined[first] = second
    if not joined:
        return meeting
    keep, drop = np.array(list(joined.items())).T
    area, gap, frame = meeting.area.copy(), meeting.gap.copy(), meeting.frame.copy()
    ours, theirs = area[keep, None], area[drop, None]
    normal = ours * frame[keep, 0] + theirs * frame[drop, 0] @ pairs.turn
    length = np.linalg.norm(normal, axis=1)
    whole = ours[:, 0] + theirs[:, 0]
    bent = length < (1 - _SAME) * whole
    if contact.against is None:
        _agree(meeting, contact, pairs, (keep, drop), whole - length)
        bent[:] = False
    else:
        _same_clearance(meeting, contact, pairs, (keep, drop), nodes)
    if bent.any():
        # Normals of a bent surface on a cut are those of the facets on one side.
        at = keep[bent]
        opposite = nodes[meeting.dofs[at, 1] // nodes.shape[1]]
        between = meeting.points[at] - opposite
        gap[at] -= np.einsum("cd,cd->c", frame[at, 0], between)
        frame[at] = frames(normal[bent], contact.axis)
        gap[at] += np.einsum("cd,cd->c", frame[at, 0], between)
    area[keep] = whole
    rest = np.ones(len(area), np.bool_)
    rest[drop] = False
    return _some(replace(meeting, area=area, gap=gap, frame=frame), rest)


def _some(meeting: Meeting, rest: Bools) -> Meeting:
    return replace(
        meeting,
        points=meeting.points[rest],
        frame=meeting.frame[rest],
        gap=meeting.gap[rest],
        area=meeting.area[rest],
        dofs=meeting.dofs[rest],
        moved=None
        if meeting.moved is None
        else Approach(*(values[:, rest] for values in meeting.moved)),
    )


def _same_clearance(
    meeting: Meeting,
    contact: Contact,
    pairs: Images,
    joined: tuple[Ints, Ints],
    nodes: Floats,
) -> None:
    """Refuse a clearance of two bodies that is not the same on both cuts."""
    between = meeting.points - nodes[meeting.dofs[:, 1] // nodes.shape[1]]
    clearance = meeting.gap - np.einsum("cd,cd->c", meeting.frame[:, 0], between)
    keep, drop = joined
    off = np.abs(clearance[keep] - clearance[drop])
    worst = int(np.argmax(off))
    if off[worst] > _AGREE * pairs.size:
        raise ValueError(
            f"the clearance of the contact on {contact.surface!r} does not repeat itself "
            f"with the surfaces {pairs.what}: it is {clearance[keep[worst]]:g} at "
            f"{place(meeting.points[keep[worst]])} and {clearance[drop[worst]]:g} at its image: "
            "give both the same"
        )


def _agree(
    meeting: Meeting,
    contact: Contact,
    pairs: Images,
    joined: tuple[Ints, Ints],
    turned: Floats,
) -> None:
    """Refuse an obstacle that is not the same on both cuts."""
    keep, drop = joined
    off = np.abs(meeting.gap[keep] - meeting.gap[drop]) / pairs.size
    off = np.maximum(off, turned / meeting.area[keep])
    if meeting.moved is not None:
        normal, distance, drag = (field[:, keep] for field in meeting.moved)
        image = [field[:, drop] for field in meeting.moved]
        for apart, size in (
            (np.linalg.norm(image[0] @ pairs.turn - normal, axis=2), 1.0),
            (np.abs(image[1] - distance), pairs.size),
            (
                np.linalg.norm(image[2] @ pairs.turn - drag, axis=2),
                np.abs(drag).max() or 1.0,
            ),
        ):
            off = np.maximum(off, apart.max(axis=0) / size)
    worst = int(np.argmax(off))
    if off[worst] > _AGREE:
        raise ValueError(
            f"the obstacle of the contact on {contact.surface!r} does not repeat itself "
            f"with the surfaces {pairs.what}: gaps, normals or motions differ at "
            f"{place(meeting.points[keep[worst]])} and its image: use an obstacle with the "
            "same symmetry"
        )
