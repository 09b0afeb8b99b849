"""Resultant forces of contacts, supports and reference points, step by step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import instead
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.contact.law.frames import find_step_frames
from bipot_rs.contact.law.resultants import find_moment
from bipot_rs.contact.results.solution import Step
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.constraints.references import reference_named
from bipot_rs.fem.constraints.ties import SAME, Ties


def contacts_by_surface(model: Assembly) -> dict[str, Ints]:
    """Numbers of the contacts by title: a name, or a surface ``"body.surface"``."""
    titles = dict.fromkeys(contact.title for contact in model.contacts)
    return {title: contacts_on(model, title) for title in titles}


def contacts_on(model: Assembly, on: str) -> Ints:
    """Numbers of the contacts on one surface, or of the contact of this name, ascending.

    Raises `ValueError`: no contact is on it; the message lists the titles of the contacts.
    """
    chosen = [on in (c.title, f"{c.body}.{c.surface}") for c in model.contacts]
    if not any(chosen):
        titles = list(dict.fromkeys(contact.title for contact in model.contacts))
        raise ValueError(f"there is no contact on {on!r}{instead(on, titles)}")
    return np.flatnonzero(np.array(chosen)[model.group])


def contact_force(model: Assembly, steps: Sequence[Step], on: str) -> Floats:
    """Force of the contacts on a surface on its body, ``(steps, d)`` [N].

    In global components. Errors as `contacts_on`.
    """
    contacts = contacts_on(model, on)
    forces = np.zeros((len(steps), model.dim))
    for force, step in zip(forces, steps, strict=True):
        frame = find_step_frames(step, model.frame)[contacts]
        force[:] = np.einsum("ck,ckd->d", step.reaction[contacts], frame)
    return forces


def contact_moment(
    model: Assembly, steps: Sequence[Step], on: str, about: ArrayLike | None = None
) -> Floats:
    """Moment of the contact forces on a surface on its body, ``(steps, 3)`` [N m].

    In 2D ``(steps, 1)``. ``about`` is a point ``(d,)``, by default the origin. Errors as
    `contacts_on`.
    """
    if model.numbered.axisymmetric:
        raise ValueError("the moments of a body of revolution cancel around its axis")
    contacts = contacts_on(model, on)
    centre = 0.0 if about is None else floats("about", about, shape=(model.dim,))
    arms, moments = model.points[contacts] - centre, []
    for step in steps:
        frame = find_step_frames(step, model.frame)[contacts]
        forces = np.einsum("ck,ckd->cd", step.reaction[contacts], frame)
        moments.append(find_moment(arms, forces))
    return np.stack(moments)


def support_force(model: Assembly, steps: Sequence[Step], on: str) -> Floats:
    """Force of the supports on a surface on their body, ``(steps, d)`` [N].

    ``K u - f - Bᵀ r`` at the prescribed degrees of freedom, in global components. One that
    several supports prescribe counts once in each surface.

    Raises `ValueError`: no support is on it; the message lists the surfaces with supports.
    """
    names = [
        s.body if s.surface is None else f"{s.body}.{s.surface}" for s in model.supports
    ]
    prescribed = [
        dofs.ravel()
        for dofs, surface_name in zip(model.support_dofs, names, strict=True)
        if surface_name == on
    ]
    if not prescribed:
        raise ValueError(
            f"there is no support on {on!r}" + instead(on, dict.fromkeys(names))
        )
    dofs = np.unique(np.concatenate(prescribed))
    forces = np.zeros((len(steps), model.dim))
    for force, step in zip(forces, steps, strict=True):
        out = _find_unbalanced(model, step, dofs)
        if step.load is not None:
            out -= step.load[dofs]
        np.add.at(force, dofs % model.dim, out)
    return forces


def reference_force(
    model: Assembly, steps: Sequence[Step], name: str
) -> tuple[Floats, Floats]:
    """Total force ``(steps, d)`` [N] and moment at a reference point [N m].

    ``K u - Bᵀ r`` at its degrees of freedom: the loads, and the reactions of its prescribed
    components, which balance the contact forces of an obstacle and the stress at a rigid
    set. A component that a support on nodes of the set determines is zero here: its reaction
    is in `support_force`. One across a plane of symmetry on which nodes of the set are is
    zero too. So is one that another set with common nodes determines: its load
    is part of the force of that set. The moment has the shape of the rotation of
    `Assembly.reference_motion`, whose errors these are too.
    """
    point = reference_named(model.references, name)
    dofs = np.concatenate([point.dofs, point.turns])
    force = np.stack([_find_unbalanced(model, step, dofs) for step in steps])
    d = model.dim
    if model.ties is not None:
        force = _carry(force, dofs, model.ties, d)
    return force[:, :d], force[:, d:] * (point.arm or 1.0)


def _carry(force: Floats, dofs: Ints, ties: Ties, d: int) -> Floats:
    """The smallest force, and then the smallest moment, with the work of ``force``.

    ``force (steps, m)`` acts at the independent ones of the degrees of freedom ``dofs`` of a
    point, ``d`` translations first. Inclined planes relate these, and take any force in the
    range of their relations.
    """
    at = np.isin(dofs, ties.dependent)
    relations = (np.eye(len(dofs)) - ties.within[dofs][:, dofs].toarray())[at]
    force = np.where(at, 0.0, force)
    across, turning = relations[:, :d], relations[:, d:]
    inverse = np.linalg.pinv(across, rcond=SAME)
    force = force - force[:, :d] @ inverse @ relations
    # What takes moments without forces.
    left = (np.eye(len(relations)) - across @ inverse) @ turning
    force[:, d:] -= force[:, d:] @ np.linalg.pinv(left, rcond=SAME) @ left
    return force


def _find_unbalanced(model: Assembly, step: Step, dofs: Ints) -> Floats:
    """``K u - Bᵀ r`` at some degrees of freedom."""
    forces = model.K[dofs] @ step.displacement
    forces -= model.in_step(step).B[:, dofs].T @ step.reaction.ravel()
    return np.asarray(forces, np.float64)
