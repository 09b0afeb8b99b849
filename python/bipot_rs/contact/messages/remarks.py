"""Warnings about a problem of arrays: what looks wrong but need not be an error.

`fem.inspection` checks more, for scenes. For arrays the gaps are checked, and K if the
coordinates of the degrees of freedom are known. K times a displacement that is linear in
the coordinates gives the forces that hold this strain. They act on the surface of the
bodies: for a dilation they point outwards, and for a shear their work gives the modulus.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.messages import count_noun, place
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs._lib.validation import Csr
from bipot_rs.contact import tuning
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.stiffness import dof_order

# Rounding of coordinates in mesh files, relative to the size of the problem.
_ROUNDING = 1e-9
# Young's modulus over shear modulus; 2 to 3 for solids.
_YOUNG = 2.5
NEVER_CLOSED = (
    "no contact closes in any load step: check that the load presses the bodies together "
    "and that the normals point from the obstacle to the body"
)


@dataclass(frozen=True)
class Strength:
    """Stiffness of each body."""

    body: Ints  # (n,): number of the body of each degree of freedom
    # (bodies,): force for a strain of 1 on its largest section; NaN if K does not determine it.
    force: Floats


@dataclass(frozen=True)
class ProblemRemarks:
    """Warnings about a problem."""

    at_start: tuple[str, ...]  # those about its arrays, before any load
    # Stiffness of the bodies, for warnings about loads; None if it is not known.
    strength: Strength | None = None

    def add_path(self, steps: Sequence[Step], points: Floats | None) -> tuple[str, ...]:
        """The warnings at the start, and those about the load steps of a path."""
        return (*self.at_start, *_list_of_path(steps, points, self.strength))


def examine_arrays(
    contact: Csr,
    gap: Floats,
    points: Floats | None = None,
    stiffness: Csr | InspectedBodies | None = None,
    places: Floats | None = None,
    *,
    interference: Bools | None = None,
    stacklevel: int = 2,
) -> ProblemRemarks:
    """Look for what seems wrong in the arrays of a problem.

    ``contact``: B.
    ``gap (n_c, d)``: gaps by component.
    ``points, places``: coordinates of the contacts ``(n_c, d)`` and of the degrees of freedom
    ``(n, d)``.
    ``interference (n_c,)``: contacts that are meant to penetrate.
    ``stiffness``: K, if it has the rigid motions of its bodies, or what was found in it.
    ``stacklevel``: as for `warnings.warn`, which is called if K has its degrees of freedom in
    another order than ``places`` or the contacts.
    """
    texts: list[str] = []
    outward, strength, d = None, None, gap.shape[1]
    order = None if places is None else dof_order.find_order(places, d)
    if isinstance(stiffness, InspectedBodies):
        outward, strength = stiffness.measure()
    elif stiffness is not None:
        misplaced = dof_order.describe_disorder(
            stiffness.parts, contact.parts, places, order, d
        )
        if misplaced is not None:
            warnings.warn(misplaced, stacklevel=stacklevel + 1)
            texts.append(misplaced)
        elif places is not None and order is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                outward, strength = measure_bodies(stiffness, places, order)
    depth = gap[:, 0] if interference is None else np.where(interference, 0, gap[:, 0])
    texts += _find_penetration(depth, points, places)
    if outward is not None and places is not None and order is not None and len(gap):
        texts += _find_wrong_normals(contact, gap, outward, places, order)
    return ProblemRemarks(tuple(texts), strength)


def _find_penetration(
    gap: Floats, points: Floats | None, places: Floats | None
) -> Iterator[str]:
    places_of_nodes = points if places is None else places
    size = (
        0.0
        if places_of_nodes is None or not len(places_of_nodes)
        else float(np.ptp(places_of_nodes, axis=0).max())
    )
    if size == 0:
        size = float(np.abs(gap).max(initial=0.0))
        places_of_nodes = None
    inside = np.flatnonzero(gap < -_ROUNDING * size)
    if not inside.size:
        return
    deepest = int(inside[np.argmin(gap[inside])])
    depth = -float(gap[deepest])
    share = (
        ""
        if places_of_nodes is None
        else f", {100 * depth / size:.2g} % of the size of the model"
    )
    where = "" if points is None else f" at {place(points[deepest])}"
    yield (
        f"{inside.size} of the {count_noun(len(gap), 'contact')} penetrate at the start, most "
        f"of all contact {deepest}{where}, by {depth:g}{share}: the first step pushes them "
        "out; this is right for an interference fit, else check the sign of gap, which is "
        "positive when open"
    )


def measure_bodies(
    stiffness: Csr, places: Floats, order: str
) -> tuple[Floats, Strength]:
    """Surfaces and stiffness of the bodies, from the coordinates, their order and K.

    Returns ``outward (n,)``: forces that point outwards at the surface of the bodies, and are
    zero inside and in rows of supports within K.
    Returns ``strength``: stiffness of each body.
    """
    x, side = scale_places(places)
    return InspectedBodies(
        _core.bodies(stiffness.parts, x, order == "node"), side
    ).measure()


def scale_places(places: Floats) -> tuple[Floats, float]:
    """Coordinates about their mean, of size one, and this size."""
    x = places - places.mean(axis=0)
    side = float(np.abs(x).max(initial=0.0)) or 1.0
    x /= side
    return x, side


@dataclass(frozen=True)
class InspectedBodies:
    """What `_core.bodies` found, with places that `scale_places` divided by ``side``."""

    found: tuple[Floats, Ints, Floats, Floats, Floats, Ints, Ints]
    side: float

    def measure(self) -> tuple[Floats, Strength]:
        """As `measure_bodies`."""
        outward, body, work, low, high, every, free = self.found
        d = low.shape[1]
        modulus = _YOUNG * work / (d * (d - 1))
        thin = (high - low).min(axis=1)
        stiff = (2 * free > every) & (thin > 0) & (modulus > 0)
        force = np.full(len(work), np.nan)
        force[stiff] = modulus[stiff] / thin[stiff] * self.side
        return outward, Strength(body, force)


def _find_wrong_normals(
    contact: Csr, gap: Floats, outward: Floats, places: Floats, order: str
) -> Iterator[str]:
    """Warn of normals that point out of the body with the contact."""
    from scipy.sparse import csr_array

    n, d = len(outward), gap.shape[1]
    node = dof_order.node_of(order, n, d)
    of_node = csr_array((np.ones(n), (np.arange(n), node)), shape=(n, n // d))
    normal = contact.matrix[::d]
    # For a pair of bodies both sides count: minus the normal points into the obstacle.
    along = -(normal @ outward)
    length = np.sqrt(outward**2 @ of_node)
    whole = (normal.multiply(normal)).tocsr() @ of_node
    whole.data = np.sqrt(whole.data)
    size = whole @ length
    away = (size > 0) & (along < tuning.WRONG_NORMAL * size)
    if not away[size > 0].all():
        away &= gap[:, 0] <= tuning.CLOSE_GAP * float(
            np.ptp(places, axis=0).max(initial=0.0)
        )
    wrong = np.flatnonzero(away)
    if wrong.size:
        contacts = len(along)
        yield (
            f"the normals of {wrong.size} of the {count_noun(contacts, 'contact')} point out of "
            f"the body, first at contact {wrong[0]}: a normal must point from the obstacle to "
            "the body, and B must give the displacement of the body minus that of the obstacle"
        )


def _list_of_path(
    steps: Sequence[Step], points: Floats | None, strength: Strength | None
) -> Iterator[str]:
    """Warnings about the load steps of a path."""
    if not steps:
        return
    if len(steps[0].status) and not any(step.status.any() for step in steps):
        yield NEVER_CLOSED
    if strength is not None:
        yield from _find_overload(steps, strength)
    elif points is not None:
        yield from _find_long_slip(steps, points)


def _find_overload(steps: Sequence[Step], strength: Strength) -> Iterator[str]:
    share = np.zeros(len(strength.force))
    for step in steps:
        if step.load is not None:
            force = np.bincount(strength.body, np.abs(step.load), len(share))
            share = np.fmax(share, force / strength.force)
    most = int(np.argmax(share)) if len(share) else 0
    if len(share) and share[most] > tuning.LARGE_STRAIN:
        dof = int(np.argmax(strength.body == most))
        yield (
            "check the units: the loads on the body of degree of freedom "
            f"{dof} would strain its largest section by {100 * share[most]:.2g} %, but the "
            "theory needs small strains"
        )


def _find_long_slip(steps: Sequence[Step], x: Floats) -> Iterator[str]:
    size = float(np.ptp(x, axis=0).max()) if len(x) else 0.0
    moved = max(float(np.abs(step.slip).max(initial=0.0)) for step in steps)
    if size > 0 and moved > tuning.LONG_SLIP * size:
        yield (
            f"contacts slip by up to {moved:.3g} in a load step, {moved / size:.2g} times the "
            "extent of all contacts. Such slips are outside the small-displacement theory: do "
            "not use this result, or check the units"
        )
