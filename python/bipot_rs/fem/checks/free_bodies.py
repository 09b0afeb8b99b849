"""Bodies that can move freely, and load steps whose loads no contact forces can balance.

The latter is checked with rigid bodies and all contacts closed. Reactions within friction that
balance the loads on the motions that supports leave free are necessary for a solution, and
depend on neither elasticity nor gaps.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy import sparse

import bipot_rs._core as _core
from bipot_rs._lib.matrices import length, rigid_motions
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs.contact.errors import FloatingBodyError
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.law.frames import turn_operator
from bipot_rs.contact.messages import rigid_motion_names
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.proof.equilibrium import describe_friction
from bipot_rs.contact.reduced import ReducedProblem
from bipot_rs.contact.results.solution import describe_not_carried
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.boundary import Spring, spring_stiffness

# A rigid motion is free if its constraints are below this, relative to the largest:
# meshing programs write coordinates with six digits or more.
_FREE = 1e-6


def describe_free_bodies(model: Assembly, *, rough: bool = False) -> Iterator[str]:
    """Warnings for bodies with rigid motions that no support or contact stops.

    Bodies in contact with each other are considered together. A contact is assumed to
    stop motion along its normal and, with friction or if ``rough``, along its tangents. A
    motion that is free under this assumption is free for any load.
    """
    modes, owner = list_motions(model)
    bare = set(_list_bare(model))
    supports = list_supports(model, modes)
    # Bodies without contact to a rigid obstacle.
    alone = set(range(len(model.bodies))) - {
        model.numbered[contact.body].index
        for contact in model.contacts
        if contact.against is None
    }
    rows = (model.B @ modes).reshape(-1, model.dim, modes.shape[1])
    rubs = np.ones(len(model.gap), np.bool_) if rough else has_friction(model)
    felt = [rows[:, 0], rows[rubs, 1:].reshape(-1, modes.shape[1])]
    constraints = np.concatenate([*supports, *felt])
    count = len(model.bodies)
    for joined in _group_bodies(model):
        members = [b for b in joined if b < count]
        columns = np.flatnonzero(np.isin(owner, joined))
        free = find_free(constraints[:, columns])
        if joined != members:
            of_bodies = owner[columns] < count
            for k in _list_free_points(free, of_bodies):
                point = model.references[int(owner[columns[k]]) - count]
                yield (
                    f"{point.kind} {point.name!r} can move freely, and no contact holds it: "
                    "prescribe its motion, or add a contact or friction that stops it"
                )
            free, columns = _keep_bodies(free, of_bodies), columns[of_bodies]
        if not free.shape[1]:
            continue
        several = len(members) > 1
        names = " and ".join(repr(model.bodies[b].name) for b in members)
        whole = f"{'bodies' if several else 'body'} {names}"
        if bare.issuperset(members) and alone.issuperset(members):
            have = "have" if several else "has"
            yield f"{whole} can move freely and {have} no support and no spring: add one"
        else:
            words = describe_motions(model, members, modes[:, columns], free)
            yield (
                f"{whole} can move freely by {'; '.join(words)}: add a support, friction "
                "or a contact that stops it"
            )


def find_free(constraints: Floats) -> Floats:
    """Amounts of the motions that no row of the constraints stops, ``(m, free)``."""
    # The triangle of QR tells what the many rows tell; there may be none.
    rows = [constraints, np.zeros((1, constraints.shape[1]))]
    triangle = np.asarray(np.linalg.qr(np.concatenate(rows), "r"), np.float64)
    return np.asarray(_core.free_motions(triangle, _FREE).T, np.float64)


def list_unsupported(model: Assembly) -> list[str]:
    """Names of the bodies without support or spring, which only contact can hold."""
    return [model.bodies[b].name for b in _list_bare(model)]


def list_supports(model: Assembly, modes: Floats) -> list[Floats]:
    """Displacements of supports and forces of springs by rigid motions, as rows."""
    rows = [modes[_list_prescribed(model)]]
    if model.ties is not None:
        dependent = model.ties.dependent
        rows.append(modes[dependent] - model.ties.within[dependent] @ modes)
    return [
        *rows,
        *(_measure_springs(model, spring, modes) for spring in model.springs),
    ]


def _list_prescribed(model: Assembly) -> Ints:
    """Degrees of freedom that supports prescribe, without those that follow others."""
    if model.ties is None:
        return model.fixed
    return np.setdiff1d(model.fixed, model.ties.dependent)


def _list_bare(model: Assembly) -> list[int]:
    held = np.zeros(model.n, np.bool_)
    held[_list_prescribed(model)] = True
    if model.inclined is not None:
        held[model.inclined.normals.tocoo().row] = True
    for remote in model.remotes:
        if remote.components or remote.rotations:
            held[model.numbered[remote.body].first] = True
    sprung = {spring.body for spring in model.springs}
    return [
        numbered.index
        for numbered in model.numbered.values()
        if numbered.body.name not in sprung and not held[numbered.span].any()
    ]


def _measure_springs(model: Assembly, spring: Spring, modes: Floats) -> Floats:
    """Forces of a spring by rigid motions, scaled to size 1."""
    numbered = model.numbered[spring.body]
    stiffness = spring_stiffness(numbered.body, spring)
    largest = float(np.abs(stiffness.data).max(initial=0.0))
    forces = np.asarray(stiffness @ modes[numbered.span], np.float64)
    return forces / largest if largest else 0.0 * forces


def list_motions(model: Assembly) -> tuple[Floats, Ints]:
    """Motions of bodies and reference points ``(n, m)``, and the owner of each.

    Rigid motions of all bodies, of equal size, then the components of the reference points,
    whose numbers follow those of the bodies.
    """
    motions_all, owner = [], []
    for b, body in enumerate(model.bodies):
        arm = body.points - body.points.mean(axis=0)
        motions = rigid_motions(arm, float(np.abs(arm).max()))
        if body.axisymmetric:
            motions = motions[:, :, 1:2]  # along the axis
        motions = motions.reshape(body.points.size, -1)
        if body.points.size < model.n:
            columns = np.zeros((model.n, motions.shape[1]))
            columns[model.offset[b] :][: body.points.size] = motions
            motions = columns
        motions_all.append(motions)
        owner += [b] * motions.shape[1]
    for k, point in enumerate(model.references):
        dofs = np.concatenate([point.dofs, point.turns])
        columns = np.zeros((model.n, len(dofs)))
        columns[dofs, np.arange(len(dofs))] = 1.0
        motions_all.append(columns)
        owner += [len(model.bodies) + k] * len(dofs)
    # One body alone may have most of the memory: it is not copied.
    modes = (
        motions_all[0] if len(motions_all) == 1 else np.concatenate(motions_all, axis=1)
    )
    return modes, np.array(owner, dtype=np.int64)


def _keep_bodies(free: Floats, of_bodies: Bools) -> Floats:
    """The motions of the bodies alone, orthonormal."""
    U, size, _ = np.linalg.svd(free[of_bodies], full_matrices=False)
    return np.asarray(U[:, size > _FREE], np.float64)


def _list_free_points(free: Floats, of_bodies: Bools) -> list[int]:
    """For each free motion of a reference point alone, its largest component."""
    if not free.shape[1]:
        return []
    _, size, V = np.linalg.svd(free[of_bodies], full_matrices=True)
    still = np.concatenate([size, np.zeros(len(V) - len(size))]) <= _FREE
    return [int(k) for k in np.argmax(np.abs(free @ V[still].T), axis=0)]


def _list_pairs(model: Assembly) -> Iterator[set[int]]:
    """Bodies and reference points that contacts and ties connect, two by two."""
    index = {body.name: b for b, body in enumerate(model.bodies)}
    count = len(model.bodies)
    point = {reference.name: count + k for k, reference in enumerate(model.references)}
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


def _group_bodies(model: Assembly) -> list[list[int]]:
    """Groups of bodies and reference points connected by contacts and ties."""
    sets = [{b} for b in range(len(model.bodies) + len(model.references))]
    for pair in _list_pairs(model):
        joined = set().union(*(group for group in sets if group & pair))
        sets = [group for group in sets if not group & pair] + [joined]
    return sorted(sorted(group) for group in sets)


def describe_motions(
    model: Assembly, members: list[int], modes: Floats, free: Floats
) -> list[str]:
    """Describe a space of motions: translations along the axes first, then other ones.

    Motions of each body alone come first, then motions of all together. Rotations come last:
    beside translations they are about the middle of a body.
    """
    d, words = model.dim, []
    per_body = modes.shape[1] // len(members)
    rest = free
    movers = [(list(range(len(members))), "")]
    if len(members) > 1:
        alone = enumerate(model.bodies[b].name for b in members)
        movers = [*(([at], f" of body {name!r}") for at, name in alone), *movers]
    axes = ["the axis"] if model.numbered.axisymmetric else model.numbered.axes
    for (moving, name), (k, axis) in product(movers, enumerate(axes)):
        shift = np.zeros(modes.shape[1])
        shift[[at * per_body + k for at in moving]] = 1 / np.sqrt(len(moving))
        within = rest @ (rest.T @ shift)
        if length(shift - within) <= _FREE:
            words.append(f"translation along {axis}{name}")
            left = rest - np.outer(shift, shift @ rest)
            U, size, _ = np.linalg.svd(left, full_matrices=False)
            rest = U[:, size > 0.5]
    turning = np.arange(len(rest)) % per_body >= d
    if turning.any():
        rest = rest @ np.linalg.svd(rest[turning])[2][::-1].T
    for amounts in rest.T:
        parts = []
        for at, b in enumerate(members):
            amounts_of_body = np.zeros(len(amounts))
            amounts_of_body[at * per_body : (at + 1) * per_body] = amounts[
                at * per_body : (at + 1) * per_body
            ]
            numbered = model.numbered[model.bodies[b].name]
            field = (modes @ amounts_of_body)[numbered.span].reshape(-1, d)
            if length(field).max() <= _FREE:
                continue
            words_of = rigid_motion_names.describe_motion(
                field / length(field).max(),
                np.zeros(len(field)),
                points=numbered.body.points,
                frame=np.tile(np.eye(d), (len(field), 1, 1)),
            )
            whose = f" of body {numbered.body.name!r}" if len(members) > 1 else ""
            parts.append(words_of + whose)
        words.append(" with ".join(parts))
    return words


def has_friction(model: Assembly) -> Bools:
    """Which contact nodes have friction or cohesion."""
    largest = model.mu if model.mu.ndim == 1 else model.mu.max(axis=1)
    return (largest > 0) | (model.cohesion > 0)


# Rounding of the resultant of nodal forces, relative to the sum of their sizes.
_ROUNDING = 1e-12


def describe_unbalanced(
    model: Assembly, load: Floats, gaps: Floats | MovingGaps | None = None
) -> str | None:
    """Describe the first load step that contact cannot carry; None if there is none.

    ``model``: from `fem.assemble`, without bodies that nothing holds.
    ``load``: total nodal forces at the end of each load step, ``(steps, n)``.
    ``gaps``: as `Assembly.gaps`: frames of each step, if obstacles turn.
    """
    if model.cohesion.any():
        return None  # cohesion may carry any load
    modes, owner = list_motions(model)
    free = find_free(np.concatenate(list_supports(model, modes)))
    motions = modes @ free
    resultants = load @ motions
    resultants[np.abs(resultants) <= _ROUNDING * (np.abs(load) @ np.abs(motions))] = 0.0
    before: Floats | None = None
    for k, resultant in enumerate(resultants):
        size = float(np.abs(resultant).max(initial=0.0))
        if not size:
            continue
        B = model.B
        if isinstance(gaps, MovingGaps):
            B = turn_operator(gaps.frame[k], model.frame, B)
        # Loads that grow in proportion can all be carried, or none of them.
        elif before is not None and np.allclose(resultant / size, before, 0, 1e-9):
            continue
        before = resultant / size
        amounts = _find_unresisted(model, np.asarray(B @ motions), before)
        if amounts is None:
            continue
        count = len(model.bodies)
        of_bodies = owner < count
        moved = (free @ amounts)[of_bodies, None]
        words = describe_motions(
            model,
            list(range(count)),
            modes[:, of_bodies],
            moved / np.linalg.norm(moved),
        )
        whose = f"body {model.bodies[0].name!r}, " if count == 1 else ""
        law, d = ContactLaw(model.mu), model.dim
        friction = describe_friction(np.asarray(B @ motions), before, law, d)
        reason = describe_not_carried(f"{whose}{'; '.join(words)}, {friction}")
        return f"load step {k + 1} of {len(resultants)}: {reason}"
    return None


def _find_unresisted(model: Assembly, R: Floats, e: Floats) -> Floats | None:
    """Amounts of a motion on which the loads work, and which no reaction resists."""
    identity = sparse.csr_array(sparse.eye_array(R.shape[0]))
    gap = np.zeros((len(model.gap), model.dim))
    try:
        problem = ReducedProblem(identity, gap, model.mu, rigid=(R, e))
    except FloatingBodyError:
        return None
    return problem.equilibrium().motion
