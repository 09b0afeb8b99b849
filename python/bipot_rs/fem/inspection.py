"""Warnings before solving: penetration, orientation, unsupported bodies, units.

None of these is an error: each warning is a sentence that a person must judge.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import counted, place
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.contact.messages import rigid_motion_names as rigid_motions
from bipot_rs.contact.path.moving_gaps import gaps_by_component
from bipot_rs.fem.assembly import Assembly
from bipot_rs.fem.boundary import Spring, spring_stiffness
from bipot_rs.fem.contact import body_index, outward
from bipot_rs.obstacle.protocol import length

# Rounding of meshing programs and files, relative to the size of the model.
_ROUNDING = 1e-9
# Displacements above this fraction of the size of the model are not small.
_SMALL = 0.1
# A rigid motion is free if its constraints are below this, relative to the largest:
# meshing programs write coordinates with six digits or more.
_FREE = 1e-6
# Young's moduli in Pa are above the first number, those of metals in MPa in the range.
# Parts in m are shorter than the first length, parts in mm longer than the second.
_PASCAL, _MEGAPASCAL = 1e9, (1e4, 1e6)
_LONG, _SHORT = 10.0, 0.05
# Mean stresses above this fraction of Young's modulus cause strains that are not small.
_SOFT = 0.05


def inspect(
    model: Assembly,
    *,
    load: ArrayLike | None = None,
    prescribed: ArrayLike | None = None,
    strained: ArrayLike = 0.0,
) -> list[str]:
    """Warnings before solving.

    Parameters
    ----------
    model
        From `fem.assemble`.
    load, prescribed
        As in `ContactProblem.solve`. Without them, contacts that cannot close are not
        reported, and all prescribed displacements count as not zero.
    strained
        The part of ``load`` that represents initial strains.

    Returns
    -------
    list of str
        One sentence for each warning: nodes that penetrate at the start; surfaces that
        face away from their obstacle; contacts too far away to close; contacts without
        friction because supports prescribe the tangential displacement; bodies that
        neither supports nor contacts hold, with the free motion; rigid sets whose motion
        supports on their nodes determine; a Young's modulus, size or loads that seem to use
        different units.
    """
    found = [
        *_penetrating(model),
        *_facing_away(model),
        *_without_friction(model, prescribed),
        *unheld(model),
        *_determined(model),
        *_units(model),
    ]
    if load is not None or prescribed is not None:
        found += _far(model, load, prescribed)
    if load is not None:
        found += _overloaded(model, floats("load", load) - floats("strained", strained))
    return found


def _size(model: Assembly) -> float:
    return float(np.ptp(model.nodes, axis=0).max())


def _named(model: Assembly, group: int) -> str:
    contact = model.contacts[group]
    return f"surface {contact.surface!r} of body {contact.body!r}"


def _groups(model: Assembly) -> Iterator[tuple[int, Ints]]:
    """Index of each contact, and the indices of its contact nodes."""
    for group in range(len(model.contacts)):
        yield group, np.flatnonzero(model.group == group).astype(np.int64)


def _penetrating(model: Assembly) -> Iterator[str]:
    size = _size(model)
    for group, at in _groups(model):
        inside = at[model.gap[at] < -_ROUNDING * size]
        if inside.size:
            deepest = inside[np.argmin(model.gap[inside])]
            depth = -float(model.gap[deepest])
            yield (
                f"{inside.size} of the {counted(at.size, 'node')} of "
                f"{_named(model, group)} start inside what they may touch, the deepest by "
                f"{depth:g} at {place(model.points[deepest])}, {100 * depth / size:.2g} % "
                "of the size of the model: the first step pushes them out; this is right "
                "for an interference fit, otherwise move the body or add a clearance"
            )


def _facing_away(model: Assembly) -> Iterator[str]:
    # `fem.assemble` refuses two bodies that do not face each other.
    for group, at in _groups(model):
        contact = model.contacts[group]
        here = at[model.contact_dofs[at, 0] >= 0]
        if contact.against is not None or not here.size:
            continue
        index = [body.name for body in model.bodies].index(contact.body)
        node = (model.contact_dofs[here, 0] - model.offset[index]) // model.dim
        out = outward(model.bodies[index], contact.surface)[node]
        if (np.einsum("cd,cd->c", out, model.frame[here, 0]) > 0).all():
            yield (
                f"surface {contact.surface!r} of body {contact.body!r} faces away from "
                f"what it may touch, at all of its {counted(here.size, 'node')}: check that "
                "the normal of the obstacle points to the body, and that this is the "
                "right surface"
            )


def _without_friction(model: Assembly, prescribed: ArrayLike | None) -> Iterator[str]:
    lost_ones = ~_rubs(model) & _slides(model, prescribed)
    for group, at in _groups(model):
        if not np.any(np.asarray(model.contacts[group].mu) > 0):
            continue
        lost = int(np.sum(lost_ones[at]))
        if lost:
            yield (
                f"{lost} of the {counted(at.size, 'node')} of {_named(model, group)} have "
                "no friction, mu = 0: supports prescribe their tangential displacement; "
                "remove these components of the support if friction should act"
            )


def _slides(model: Assembly, prescribed: ArrayLike | None) -> Bools:
    """Which contact nodes move along their obstacles by prescribed displacements.

    Where these are zero, as on a plane of symmetry, the lack of friction has no effect.
    """
    if prescribed is None:
        return np.ones(len(model.gap), dtype=np.bool_)
    values = np.atleast_2d(floats("prescribed", prescribed))
    moved = np.zeros(model.n)
    moved[model.fixed] = np.abs(values).max(axis=0, initial=0.0)
    along = (abs(model.B) @ moved).reshape(-1, model.dim)[:, 1:]
    found = along.any(axis=1)
    if model.moving is not None:
        found |= gaps_by_component(model.moving)[:, :, 1:].any(axis=(0, 2))
    return np.asarray(found, np.bool_)


def _rubs(model: Assembly) -> Bools:
    """Which contact nodes have friction."""
    largest = model.mu if model.mu.ndim == 1 else model.mu.max(axis=1)
    return largest > 0


def _far(
    model: Assembly, load: ArrayLike | None, prescribed: ArrayLike | None
) -> Iterator[str]:
    size = _size(model)
    moved = 0.0
    if prescribed is not None:
        moved = float(np.abs(floats("prescribed", prescribed)).max(initial=0.0))
    loaded = load is not None and bool(np.any(floats("load", load) != 0))
    # Twice: rotations and Poisson's effect may exceed the prescribed displacements.
    reach = max(_SMALL * size if loaded else 0.0, 2 * moved)
    for group, at in _groups(model):
        gap = model.gap[at]
        if model.moving is not None:
            distance = gaps_by_component(model.moving)[:, at, 0]
            gap = np.minimum(gap, distance.min(axis=0))
        nearest = at[np.argmin(gap)]
        if gap.min() > max(reach, _ROUNDING * size):
            yield (
                f"{_named(model, group)} may never touch: its nearest node, at "
                f"{place(model.points[nearest])}, stays {gap.min():g} away, "
                + (
                    f"{100 * gap.min() / size:.2g} % of the size of the model"
                    if loaded
                    else f"and supports move by {moved:g} at most"
                )
            )


def _units(model: Assembly) -> Iterator[str]:
    """Young's modulus in Pa with lengths in mm, or in MPa with lengths in m.

    A heuristic: solids have moduli from 1e6 Pa to 1e12 Pa, and parts have sizes from
    0.05 mm to 10 m. For a bridge, or a grain of sand in mm, the warning is false.
    """
    size = _size(model)
    low, high = _MEGAPASCAL
    for body in model.bodies:
        young = _stiffest(body.material)
        if young is None:
            continue
        if young >= _PASCAL and size >= _LONG:
            guess, other = "Pa with lengths in m", "for lengths in mm use MPa"
        elif low <= young <= high and size <= _SHORT:
            guess, other = "MPa with lengths in mm", "for lengths in m use Pa"
        else:
            continue
        yield (
            f"units may be mixed: Young's modulus {young:g} of body {body.name!r} looks "
            f"like {guess}, but the size of the model is {size:g}; {other}"
        )


def _overloaded(model: Assembly, load: Floats) -> Iterator[str]:
    """Loads that are large relative to the stiffness, as for a modulus in GPa, loads in MPa.

    Compares Young's modulus with the sum of |nodal force| of a load step over the largest
    section of the bounding box of the body. Forces in mutual balance count too.
    """
    every = np.atleast_2d(load)
    if model.references:
        # What a rigid set passes on to supports of its nodes does not load the body.
        every = every.copy()
        every[:, model.fixed] = 0.0
    for body, first in zip(model.bodies, model.offset, strict=True):
        young = _stiffest(body.material)
        own = every[:, first : first + body.points.size]
        forces = np.linalg.norm(own.reshape(len(own), -1, model.dim), axis=-1)
        sides = np.sort(np.ptp(body.points, axis=0))[1:]
        section = float(np.prod(sides)) * body.depth
        mean = float(forces.sum(axis=1).max(initial=0.0)) / section
        if young is not None and mean > _SOFT * young:
            yield (
                f"units may be mixed: the loads of body {body.name!r} over its largest "
                f"section are {mean:.3g}, {100 * mean / young:.2g} % of its Young's modulus "
                f"{young:g}, but the theory assumes small strains"
            )


def _determined(model: Assembly) -> Iterator[str]:
    """Rigid sets with components that follow from prescribed displacements of their nodes."""
    if model.ties is None:
        return
    for one in model.references:
        dofs = np.concatenate([one.dofs, one.turns])
        rows = model.ties.within[dofs[np.isin(dofs, model.ties.dependent)]]
        held = int(
            np.unique(rows.tocoo().row[rows.tocoo().col < model.nodes.size]).size
        )
        if held:
            yield (
                f"supports on nodes of the rigid set {one.name!r} determine {held} of the "
                f"{len(dofs)} components of its motion: loads at its point act on these "
                "supports; exclude the nodes by within if the set should move"
            )


def _stiffest(material: Any) -> float | None:
    """The largest Young's modulus of a material; None for several materials."""
    young = getattr(material, "young", None)
    return None if young is None else float(np.max(young))


def unheld(model: Assembly, *, rough: bool = False) -> Iterator[str]:
    """Warnings for bodies with rigid motions that no support or contact stops.

    Bodies in contact with each other are considered together. A contact is assumed to
    stop motion along its normal and, with friction or if ``rough``, along its tangents. A
    motion that is free under this assumption is free for any load.
    """
    modes, owner = _modes(model)
    modes, owner = _with_references(model, modes, owner)
    bare = set(_bare(model))
    supports = _supporting(model, modes)
    # Bodies without contact to a rigid obstacle.
    alone = set(range(len(model.bodies))) - {
        body_index(model.bodies, contact.body)
        for contact in model.contacts
        if contact.against is None
    }
    rows = (model.B @ modes).reshape(-1, model.dim, modes.shape[1])
    rubs = np.ones(len(model.gap), np.bool_) if rough else _rubs(model)
    felt = [rows[:, 0], rows[rubs, 1:].reshape(-1, modes.shape[1])]
    constraints = np.concatenate([*supports, *felt])
    count = len(model.bodies)
    for joined in _meeting(model):
        members = [b for b in joined if b < count]
        columns = np.flatnonzero(np.isin(owner, joined))
        own = constraints[:, columns]
        # The triangle of QR has the same singular values as the many rows.
        triangle = np.linalg.qr(np.vstack([own, np.zeros((len(columns),) * 2)]), "r")
        _, values, V = np.linalg.svd(triangle)
        free = V[values <= _FREE * values.max()].T
        if joined != members:
            of_bodies = owner[columns] < count
            for k in _alone(free, of_bodies):
                one = model.references[int(owner[columns[k]]) - count]
                yield (
                    f"{one.kind} {one.name!r} can move freely, and no contact holds it: "
                    "prescribe its motion, or add a contact or friction that stops it"
                )
            free, columns = _part(free, of_bodies), columns[of_bodies]
        if not free.shape[1]:
            continue
        several = len(members) > 1
        names = " and ".join(repr(model.bodies[b].name) for b in members)
        whole = f"{'bodies' if several else 'body'} {names}"
        if bare.issuperset(members) and alone.issuperset(members):
            have = "have" if several else "has"
            yield f"{whole} can move freely and {have} no support and no spring: add one"
        else:
            words = _said(model, members, modes[:, columns], free)
            yield (
                f"{whole} can move freely by {'; '.join(words)}: add a support, friction "
                "or a contact that stops it"
            )


def unsupported(model: Assembly) -> list[str]:
    """Names of the bodies without support or spring, which only contact can hold."""
    return [model.bodies[b].name for b in _bare(model)]


def _supporting(model: Assembly, modes: Floats) -> list[Floats]:
    """Displacements of supports and forces of springs by rigid motions, as rows."""
    found = [modes[_prescribed(model)]]
    if model.inclined is not None:
        found.append(np.asarray(model.inclined.normals.T @ modes[: model.nodes.size]))
    if model.ties is not None:
        own = model.ties.dependent
        found.append(modes[own] - model.ties.within[own] @ modes)
    return [*found, *(_sprung(model, spring, modes) for spring in model.springs)]


def _prescribed(model: Assembly) -> Ints:
    """Degrees of freedom that supports prescribe, without those that follow others."""
    if model.ties is None:
        return model.fixed
    return np.setdiff1d(model.fixed, model.ties.dependent)


def _bare(model: Assembly) -> list[int]:
    held = np.zeros(model.n, np.bool_)
    held[_prescribed(model)] = True
    if model.inclined is not None:
        held[model.inclined.normals.tocoo().row] = True
    for remote in model.remotes:
        if remote.components or remote.rotations:
            held[model.offset[body_index(model.bodies, remote.body)]] = True
    sprung = {body_index(model.bodies, spring.body) for spring in model.springs}
    return [
        b
        for b, body in enumerate(model.bodies)
        if b not in sprung
        and not held[model.offset[b] : model.offset[b] + body.points.size].any()
    ]


def _sprung(model: Assembly, spring: Spring, modes: Floats) -> Floats:
    """Forces of a spring by rigid motions, scaled to size 1."""
    b = body_index(model.bodies, spring.body)
    body = model.bodies[b]
    first = model.offset[b]
    stiffness = spring_stiffness(body, spring)
    largest = float(np.abs(stiffness.data).max(initial=0.0))
    own = modes[first : first + body.points.size]
    forces = np.asarray(stiffness @ own, np.float64)
    return forces / largest if largest else 0.0 * forces


def _modes(model: Assembly) -> tuple[Floats, Ints]:
    """Rigid motions of all bodies ``(n, m)``, of equal size, and the body of each."""
    d, found, owner = model.dim, [], []
    for b, body in enumerate(model.bodies):
        arm = body.points - body.points.mean(axis=0)
        arm /= np.abs(arm).max()
        fields = [np.tile(unit, (len(arm), 1)) for unit in np.eye(d)]
        if d == 2:
            fields.append(np.column_stack([-arm[:, 1], arm[:, 0]]))
        else:
            fields += [np.cross(unit, arm) for unit in np.eye(3)]
        for one in fields:
            column = np.zeros(model.n)
            column[model.offset[b] : model.offset[b] + one.size] = one.ravel()
            found.append(column)
            owner.append(b)
    return np.column_stack(found), np.array(owner, dtype=np.int64)


def _with_references(
    model: Assembly, modes: Floats, owner: Ints
) -> tuple[Floats, Ints]:
    """The motions with those of reference points, whose owners follow the bodies."""
    count = len(model.bodies)
    found, owners = [modes], [owner]
    for k, one in enumerate(model.references):
        dofs = np.concatenate([one.dofs, one.turns])
        columns = np.zeros((model.n, len(dofs)))
        columns[dofs, np.arange(len(dofs))] = 1.0
        found.append(columns)
        owners.append(np.full(len(dofs), count + k, np.int64))
    return np.concatenate(found, axis=1), np.concatenate(owners)


def _part(free: Floats, of_bodies: Bools) -> Floats:
    """The motions of the bodies alone, orthonormal."""
    U, size, _ = np.linalg.svd(free[of_bodies], full_matrices=False)
    return np.asarray(U[:, size > _FREE], np.float64)


def _alone(free: Floats, of_bodies: Bools) -> list[int]:
    """For each free motion of a reference point alone, its largest component."""
    if not free.shape[1]:
        return []
    _, size, V = np.linalg.svd(free[of_bodies], full_matrices=True)
    still = np.concatenate([size, np.zeros(len(V) - len(size))]) <= _FREE
    return [int(k) for k in np.argmax(np.abs(free @ V[still].T), axis=0)]


def _pairs(model: Assembly) -> Iterator[set[int]]:
    """Bodies and reference points that contacts and ties connect, two by two."""
    index = {body.name: b for b, body in enumerate(model.bodies)}
    count = len(model.bodies)
    point = {one.name: count + k for k, one in enumerate(model.references)}
    for contact in model.contacts:
        if contact.against is not None:
            yield {index[contact.body], index[contact.against[0]]}
        elif contact.floating is not None:
            yield {index[contact.body], point[contact.floating.name]}
    for remote in model.remotes:
        if not remote.distributed:
            yield {index[remote.body], point[remote.name]}
    for pairs in model.images:
        ends = [pairs.on[0], pairs.onto[0]]
        yield set((np.searchsorted(model.offset, ends, side="right") - 1).tolist())


def _meeting(model: Assembly) -> list[list[int]]:
    """Groups of bodies and reference points connected by contacts and ties."""
    sets = [{b} for b in range(len(model.bodies) + len(model.references))]
    for pair in _pairs(model):
        joined = set().union(*(one for one in sets if one & pair))
        sets = [one for one in sets if not one & pair] + [joined]
    return sorted(sorted(one) for one in sets)


def _said(
    model: Assembly, members: list[int], modes: Floats, free: Floats
) -> list[str]:
    """Describe a space of motions: translations along the axes first, then the rest.

    Motions of each body alone come first, then motions of all together.
    """
    d, words = model.dim, []
    per_body = modes.shape[1] // len(members)
    rest = free
    movers = [(list(range(len(members))), "")]
    if len(members) > 1:
        alone = enumerate(model.bodies[b].name for b in members)
        movers = [*(([at], f" of body {name!r}") for at, name in alone), *movers]
    for (moving, name), k in product(movers, range(d)):
        shift = np.zeros(modes.shape[1])
        shift[[at * per_body + k for at in moving]] = 1 / np.sqrt(len(moving))
        within = rest @ (rest.T @ shift)
        if length(shift - within) <= _FREE:
            words.append(f"translation along {'xyz'[k]}{name}")
            left = rest - np.outer(shift, shift @ rest)
            U, size, _ = np.linalg.svd(left, full_matrices=False)
            rest = U[:, size > 0.5]
    for amounts in rest.T:
        parts = []
        for at, b in enumerate(members):
            own = np.zeros(len(amounts))
            own[at * per_body : (at + 1) * per_body] = amounts[
                at * per_body : (at + 1) * per_body
            ]
            first = model.offset[b]
            field = (modes @ own)[first : first + model.bodies[b].points.size]
            field = field.reshape(-1, d)
            if length(field).max() <= _FREE:
                continue
            words_of = rigid_motions.describe(
                field / length(field).max(),
                np.zeros(len(field)),
                points=model.bodies[b].points,
                frame=np.tile(np.eye(d), (len(field), 1, 1)),
            )
            whose = f" of body {model.bodies[b].name!r}" if len(members) > 1 else ""
            parts.append(words_of + whose)
        words.append(" with ".join(parts))
    return words
