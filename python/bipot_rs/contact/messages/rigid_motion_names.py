"""Descriptions of rigid motions in words, for messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.matrices import rigid_motions
from bipot_rs._lib.messages import body_of
from bipot_rs._lib.types import Floats
from bipot_rs.contact import tuning
from bipot_rs.contact.law.contact_law import dissipation

# Coordinates below this, relative to the size of the body, are rounding errors of zero.
_ZERO = 1e-9
# Parts of a motion below this, relative to the whole, are left out. If the loads exceed
# the friction limit by little, a rotation of a proof by ω changes its work by ω²: its
# direction is known to the root of rounding.
_WORTH = 1e-4


def move_contacts(modes: Floats, amounts: Floats, d: int) -> Floats:
    """Displacement of each contact ``(n_c, d)``, scaled so that the largest is 1.

    ``modes (k, d n_c)`` are the rigid motions, normal first, and ``amounts (k,)`` their
    amplitudes.
    """
    field = (amounts @ modes).reshape(-1, d)
    largest = np.linalg.norm(field, axis=1).max(initial=0.0)
    return field / largest if largest > 0 else field


def name_free_motions(
    fields: Floats,
    bodies: Sequence[int],
    dofs: Sequence[int],
    frame: Floats | None,
    names: Mapping[str, int] | None = None,
) -> tuple[str, ...]:
    """Name rigid motions, body by body.

    ``fields``: displacement of each contact, ``(k, n_c, d)``, normal first.
    ``bodies, dofs``: number of the body of each motion, and its most moved degree of freedom.
    ``frame``: bases ``(n_c, d, d)`` of the contacts. Without them the axes are those of the
    contacts.
    ``names``: names of bodies, each with its first degree of freedom.
    """
    axes = ("n", "t1", "t2")
    if frame is not None:
        axes = ("x", "y", "z")
        fields = np.einsum("kid,ide->kie", fields, frame)
    words: list[str] = []
    for body in dict.fromkeys(bodies):
        columns = [k for k, b in enumerate(bodies) if b == body]
        dof = dofs[columns[0]]
        whose = body_of(dof, names) if names else f"degree of freedom {dof}"
        words += name_motions(fields[columns], axes, whose)
    return tuple(words)


def describe_motion(
    direction: Floats,
    mu: Floats,
    *,
    points: Floats | None = None,
    frame: Floats | None = None,
    bodies: Sequence[tuple[str, ...]] | None = None,
) -> str:
    """Describe the motion of the contacts.

    ``direction``: displacement of each contact, ``(n_c, d)``, normal first, the largest of
    length 1.
    ``mu``: friction coefficients, ``(n_c,)`` or ``(n_c, 2)``. The opening ``mu |v_t|`` of the
    dual cone is subtracted first, if the rest is a rigid motion: the contacts slide.
    ``points, frame``: coordinates ``(n_c, d)`` and bases ``(n_c, d, d)`` of the contacts.
    Without them the contacts that move most are listed.
    ``bodies``: names of the bodies at each contact; contacts with equal names move together.
    """
    length = np.linalg.norm(direction, axis=1)
    # A direction of divergence, unlike a proof, need not lie in the dual cone.
    slack = direction[:, 0] - dissipation(mu, direction[:, 1:])
    if slack.min(initial=0.0) < -_WORTH:
        mu = np.zeros_like(mu)
    moved = np.flatnonzero(length > _WORTH * length.max(initial=0.0))
    sets: dict[tuple[str, ...], list[int]] = {}
    for i in moved.tolist():
        sets.setdefault(bodies[i] if bodies else (), []).append(i)
    descriptions = []
    for names, members in sets.items():
        at = np.array(members)
        fields = [_remove_opening(direction[at], mu[at]), direction[at]]
        words = None
        if points is not None and frame is not None:
            words = _describe_rigid(fields, points[at], frame[at])
        words = words or _describe_most_moved(fields[0], at, len(direction))
        descriptions.append(f"{' against '.join(names)}, {words}" if names else words)
    return "; ".join(descriptions)


def _remove_opening(v: Floats, mu: Floats) -> Floats:
    """The motion ``v`` for a given ``v + mu |v_t| n`` of (9)."""
    slid = v.copy()
    slid[:, 0] -= dissipation(mu, v[:, 1:])
    return slid


def _describe_rigid(
    fields: Sequence[Floats], points: Floats, frame: Floats
) -> str | None:
    """Describe the first field that is a rigid motion, if there is one."""
    for field in fields:
        size = np.linalg.norm(field)
        there = np.einsum("id,ide->ie", field, frame)
        shift, turn, centre, misfit = _fit_motion(there, points)
        if size > _WORTH and misfit <= _WORTH * size:
            return _name_motion(
                shift, turn, centre, float(np.ptp(points, axis=0).max())
            )
    return None


def _fit_motion(field: Floats, points: Floats) -> tuple[Floats, Floats, Floats, float]:
    """Fit ``v(x) = t + ω × (x - c)`` by least squares; return t, ω, c and the misfit.

    In the plane ω has one component, in space three.
    """
    count, d = points.shape
    centre = np.asarray(points.mean(axis=0), np.float64)
    arm = points - centre
    reach = float(np.abs(arm).max(initial=0.0)) or 1.0
    A = rigid_motions(arm, reach).reshape(count * d, -1)
    x = np.asarray(np.linalg.lstsq(A, field.ravel(), rcond=None)[0], np.float64)
    misfit = float(np.linalg.norm(A @ x - field.ravel()))
    return x[:d], x[d:] / reach, centre, misfit


def _name_motion(shift: Floats, turn: Floats, centre: Floats, reach: float) -> str:
    """Describe ``v(x) = t + ω × (x - c)``; ``reach`` is the extent of the contacts."""
    d, rate = len(centre), float(np.linalg.norm(turn))
    axes = ", ".join("xyz"[:d])
    moved = float(np.linalg.norm(shift))
    translation = f"translation along {_format_numbers(shift, True)} in ({axes})"
    if rate * reach <= _WORTH * moved:
        return translation
    turning = _describe_rotation(shift, turn, centre, reach)
    if rate * reach * tuning.NEARLY_TRANSLATION <= moved:
        return f"{translation} (nearly: {turning})"
    return turning


def _describe_rotation(
    shift: Floats, turn: Floats, centre: Floats, reach: float
) -> str:
    """Describe a rotation by its axis."""
    rate = float(np.linalg.norm(turn))
    if len(centre) == 2:
        place = centre + np.array([-shift[1], shift[0]]) / turn[0]
        return f"rotation about the point {_format_numbers(place, size=reach)}"
    place = centre + np.cross(turn, shift) / rate**2
    through, along = _format_numbers(place, size=reach), _format_numbers(turn, True)
    axis = f"an axis through {through} along {along}"
    advance = float(shift @ turn) / rate**2
    if abs(advance) <= _WORTH * max(reach, float(np.linalg.norm(place - centre))):
        return f"rotation about {axis}"
    return f"screw motion about {axis}, advancing by {advance:.4g} a radian"


def _format_numbers(values: Floats, unit: bool = False, *, size: float = 0.0) -> str:
    """``(0.8, 0.6)``, with length 1 if ``unit``, and rounding errors replaced by zero.

    For coordinates, ``size`` is the size of the body: all may be rounding errors of zero.
    """
    values = values / np.linalg.norm(values) if unit else values
    least = max(_WORTH * np.abs(values).max(initial=0.0), _ZERO * size)
    shown = [f"{0.0 if abs(x) <= least else x:.4g}" for x in values]
    return f"({', '.join(shown)})"


def _describe_most_moved(field: Floats, contacts: NDArray[np.intp], count: int) -> str:
    """Describe the contacts that move most."""
    axes = ", ".join(("n", "t1", "t2")[: field.shape[1]])
    length = np.linalg.norm(field, axis=1)
    same = np.abs(field - field[0]).max(initial=0.0) <= _WORTH
    if same:
        who = "every contact" if len(contacts) == count else _list_contacts(contacts)
        return f"{who} along {_format_numbers(field[0], True)} in ({axes})"
    # Largest first; equal ones in the order of their numbers.
    order = np.argsort(-np.round(length / length.max(), 4), kind="stable")[:3]
    most = [f"contact {contacts[i]} by {_format_numbers(field[i])}" for i in order]
    return f"{', '.join(most)} in ({axes}) most of all"


def _list_contacts(contacts: NDArray[np.intp]) -> str:
    shown = ", ".join(str(i) for i in contacts[:8])
    more = f" and {len(contacts) - 8} more" if len(contacts) > 8 else ""
    return f"contact{'s' if len(contacts) > 1 else ''} {shown}{more}"


def name_motions(fields: Floats, axes: tuple[str, ...], whose: str) -> list[str]:
    """Describe the space of motions that ``fields (k, n_c, d)`` span.

    Translations are named, those along an axis first; all other motions are rotations.
    """
    touched = np.abs(fields).max(axis=(0, 2)) > 0
    count, d = int(touched.sum()), fields.shape[2]
    span, _ = np.linalg.qr(fields[:, touched].reshape(len(fields), -1).T)
    uniform = np.tile(np.eye(d), (count, 1)) / np.sqrt(max(count, 1))
    # This is 1e-8 by rounding for a free translation, and large for a rotation.
    left = uniform - span @ (span.T @ uniform)
    _, off, directions = np.linalg.svd(left, full_matrices=False)
    free, words = directions[off <= 1e-6], []
    for axis, unit in zip(axes, np.eye(d), strict=False):
        if np.linalg.norm(unit - (free @ unit) @ free) <= 1e-6:
            words.append(f"translation along {axis}, {whose}")
            across = free - np.outer(free @ unit, unit)
            _, size, others = np.linalg.svd(across, full_matrices=False)
            free = others[size > 0.5]
    shown = ", ".join(axes[:d])
    words += [
        f"translation along {_format_numbers(v, True)} in ({shown}), {whose}"
        for v in free
    ]
    return words + [f"rotation, {whose}"] * (len(fields) - len(words))
