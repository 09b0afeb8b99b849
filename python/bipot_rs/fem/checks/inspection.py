"""Warnings before and after solving: what is doubtful about a model, and about its result.

None of these is an error: each warning is a sentence that a person must judge.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun, place
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.contact.path.moving_gaps import list_components
from bipot_rs.contact.results.contact_fields import (
    find_farthest,
    measure_displacement,
    measure_distances,
)
from bipot_rs.contact.results.solution import Step
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.stress_recovery import MeanStress
from bipot_rs.fem.checks.free_bodies import (
    describe_free_bodies,
    has_friction,
    list_unsupported,
)
from bipot_rs.fem.contact.contact import ContactSurface
from bipot_rs.fem.tuning import (
    LARGE_LOAD,
    LEAST_IN_PASCAL,
    LONGEST_IN_METRES,
    NODES_ACROSS,
    RANGE_IN_MEGAPASCAL,
    SHORTEST_IN_MILLIMETRES,
    SMALL_DISPLACEMENT,
    SMALL_ROTATION,
)
from bipot_rs.obstacle.shapes import Plane

# Rounding of meshing programs and files, relative to the size of the model; of gaps, relative
# to the displacements.
_ROUNDING = 1e-9


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
    if prescribed is not None:
        # The shortening of a bolt that is free is NaN.
        values = floats("prescribed", prescribed, finite=False)
        prescribed = floats("prescribed", np.where(np.isnan(values), 0.0, values))
    warnings = [
        *_find_penetration(model),
        *_find_wrong_normals(model),
        *_without_friction(model, prescribed),
        *describe_free_bodies(model),
        *_find_determined_sets(model),
        *_units(model),
    ]
    if load is not None or prescribed is not None:
        warnings += _far(model, load, prescribed)
    if load is not None:
        warnings += _find_overload(
            model, floats("load", load) - floats("strained", strained)
        )
    return warnings


def _size(model: Assembly) -> float:
    return float(np.ptp(model.nodes, axis=0).max())


def _name_surface(model: Assembly, group: int) -> str:
    contact = model.contacts[group]
    return f"surface {contact.surface!r} of body {contact.body!r}"


def _list_contacts(model: Assembly) -> Iterator[tuple[int, Ints]]:
    """Index of each contact, and the indices of its contact nodes."""
    for group in range(len(model.contacts)):
        yield group, np.flatnonzero(model.group == group).astype(np.int64)


def _find_penetration(model: Assembly) -> Iterator[str]:
    size, wanted = _size(model), model.find_interference()
    for group, at in _list_contacts(model):
        inside = at[(model.gap[at] < -_ROUNDING * size) & ~wanted[at]]
        if inside.size:
            deepest = inside[np.argmin(model.gap[inside])]
            depth = -float(model.gap[deepest])
            yield (
                f"{inside.size} of the {count_noun(at.size, 'node')} of "
                f"{_name_surface(model, group)} start inside what they may touch, the deepest by "
                f"{depth:g} at {place(model.points[deepest])}, {100 * depth / size:.2g} % "
                "of the size of the model: the first step pushes them out; this is right "
                "for an interference fit, otherwise move the body or add a clearance"
            )


def _find_wrong_normals(model: Assembly) -> Iterator[str]:
    # `fem.assemble` refuses two bodies that do not face each other.
    for group, at in _list_contacts(model):
        contact = model.contacts[group]
        here = at[model.contact_dofs[at, 0] >= 0]
        if contact.against is not None or not here.size:
            continue
        numbered = model.numbered[contact.body]
        node = numbered.nodes_at(model.contact_dofs[here, 0])
        out = ContactSurface(numbered.body, contact.surface).normals[node]
        if (np.einsum("cd,cd->c", out, model.frame[here, 0]) > 0).all():
            yield (
                f"surface {contact.surface!r} of body {contact.body!r} faces away from "
                f"what it may touch, at all of its {count_noun(here.size, 'node')}: check that "
                "the normal of the obstacle points to the body, and that this is the "
                "right surface"
            )


def _without_friction(model: Assembly, prescribed: ArrayLike | None) -> Iterator[str]:
    lost_ones = ~has_friction(model) & _slides(model, prescribed)
    for group, at in _list_contacts(model):
        if not np.any(np.asarray(model.contacts[group].mu) > 0):
            continue
        lost = int(np.sum(lost_ones[at]))
        if lost:
            yield (
                f"{lost} of the {count_noun(at.size, 'node')} of "
                f"{_name_surface(model, group)} have no friction, mu = 0: supports "
                "prescribe their tangential displacement; remove these components of the "
                "support if friction should act"
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
    driven = along.any(axis=1)
    if model.moving is not None:
        driven |= list_components(model.moving)[:, :, 1:].any(axis=(0, 2))
    return np.asarray(driven, np.bool_)


def _far(
    model: Assembly, load: ArrayLike | None, prescribed: ArrayLike | None
) -> Iterator[str]:
    size = _size(model)
    moved = 0.0
    if prescribed is not None:
        moved = float(np.abs(floats("prescribed", prescribed)).max(initial=0.0))
    loaded = load is not None and bool(np.any(floats("load", load) != 0))
    # Twice: rotations and Poisson's effect may exceed the prescribed displacements.
    reach = max(SMALL_DISPLACEMENT * size if loaded else 0.0, 2 * moved)
    for group, at in _list_contacts(model):
        gap = model.gap[at]
        if model.moving is not None:
            distance = list_components(model.moving)[:, at, 0]
            gap = np.minimum(gap, distance.min(axis=0))
        nearest = at[np.argmin(gap)]
        if gap.min() > max(reach, _ROUNDING * size):
            yield (
                f"{_name_surface(model, group)} may never touch: its nearest node, at "
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
    low, high = RANGE_IN_MEGAPASCAL
    for body in model.bodies:
        young = _stiffest(body.material)
        if young is None:
            continue
        if young >= LEAST_IN_PASCAL and size >= LONGEST_IN_METRES:
            guess, other = "Pa with lengths in m", "for lengths in mm use MPa"
        elif low <= young <= high and size <= SHORTEST_IN_MILLIMETRES:
            guess, other = "MPa with lengths in mm", "for lengths in m use Pa"
        else:
            continue
        yield (
            f"units may be mixed: Young's modulus {young:g} of body {body.name!r} looks "
            f"like {guess}, but the size of the model is {size:g}; {other}"
        )


def _find_overload(model: Assembly, load: Floats) -> Iterator[str]:
    """Loads that are large relative to the stiffness, as for a modulus in GPa, loads in MPa.

    Compares Young's modulus with the sum of |nodal force| of a load step over the largest
    section of the bounding box of the body. Forces in mutual balance count too.
    """
    every = np.atleast_2d(load)
    if model.references:
        # What a rigid set passes on to supports of its nodes does not load the body.
        every = every.copy()
        every[:, model.fixed] = 0.0
    for numbered in model.numbered.values():
        body, loads = numbered.body, every[:, numbered.span]
        young = _stiffest(body.material)
        forces = np.linalg.norm(loads.reshape(len(loads), -1, model.dim), axis=-1)
        sides = np.sort(np.ptp(body.points, axis=0))[1:]
        around = (
            2 * np.pi * float(body.points[:, 0].max()) if body.axisymmetric else 1.0
        )
        section = float(np.prod(sides)) * body.depth * around
        mean = float(forces.sum(axis=1).max(initial=0.0)) / section
        if young is not None and mean > LARGE_LOAD * young:
            yield (
                f"units may be mixed: the loads of body {body.name!r} over its largest "
                f"section are {mean:.3g}, {100 * mean / young:.2g} % of its Young's modulus "
                f"{young:g}, but the theory assumes small strains"
            )


def _find_determined_sets(model: Assembly) -> Iterator[str]:
    """Rigid sets with components that follow from prescribed displacements of their nodes."""
    if model.ties is None:
        return
    for point in model.references:
        dofs = np.concatenate([point.dofs, point.turns])
        rows = model.ties.within[dofs[np.isin(dofs, model.ties.dependent)]].tocoo()
        of_nodes = rows.col < model.nodes.size
        # Symmetries leave relations between the components of a set, or none at all.
        shared = np.unique(rows.row[~of_nodes & ~np.isin(rows.col, dofs)])
        idle = point.idle[:, ~np.isin(point.turns, point.fixed)]
        held = rows.shape[0] - len(shared) - int(np.linalg.matrix_rank(idle))
        nodes = np.unique(rows.col[of_nodes] // model.dim)
        many = (
            f"supports or symmetries on nodes of the rigid set {point.name!r} determine "
            f"{held} of the {len(dofs)} components of its motion: loads at its point act on "
            "these; exclude the nodes by within if the set should move"
        )
        if held:
            yield (
                many
                if len(nodes) != 1
                else (
                    f"a support holds the node at {place(model.nodes[nodes[0]])} in {held} of "
                    f"{model.dim} directions: what {point.name!r} loads along them acts on the "
                    "support alone; load another node, or remove these components of the support"
                )
            )


def _stiffest(material: object) -> float | None:
    """The largest Young's modulus of a material; None for several materials."""
    young = getattr(material, "young", None)
    return None if young is None else float(np.max(young))


def review(model: Assembly, steps: Sequence[Step]) -> list[str]:
    """Warnings after solving.

    Parameters
    ----------
    model
        From `fem.assemble`.
    steps
        The load steps of its path, from the first on, with displacements.

    Returns
    -------
    list of str
        One sentence for each warning: rotations or strains above 5 %, as means of a cell;
        contacts that have slid further than the distance between contact nodes; contact
        zones less than four nodes across at the end; bodies without a support and without
        a closed contact at the end.
    """
    if not len(steps):
        return []
    return [
        *_large(model, steps),
        *_slid(model, steps),
        *_coarse(model, steps[-1], len(steps)),
        *_gone(model, steps[-1]),
    ]


def _large(model: Assembly, steps: Sequence[Step]) -> Iterator[str]:
    """Rotations and strains of the load step with the largest displacement and the last."""
    most = int(np.argmax([np.abs(step.displacement).max() for step in steps]))
    worst: dict[str, tuple[float, str]] = {}
    for b, body in enumerate(model.bodies):
        mean, first = MeanStress(body), model.offset[b]
        for k in dict.fromkeys((most, len(steps) - 1)):
            displacement_of_body = steps[k].displacement[
                first : first + body.points.size
            ]
            for name, values in _measure_gradients(mean.gradient(displacement_of_body)):
                cell = int(np.argmax(values))
                value = float(values[cell])
                if value <= max(SMALL_ROTATION, worst.get(name, (0.0, ""))[0]):
                    continue
                figure = f"{100 * value:.2g} %"
                if name == "rotations":
                    figure = f"{np.rad2deg(value):.2g}°, {value:.2g} rad,"
                beyond = int((values > SMALL_ROTATION).sum())
                worst[name] = (
                    value,
                    (
                        f"{name} up to {figure} of body {body.name!r} at "
                        f"{place(body.points[body.cells[cell]].mean(axis=0))} in load step "
                        f"{k + 1} of {len(steps)}, above {SMALL_ROTATION:g} in {beyond} of its "
                        f"{len(values)} cells: the theory assumes small displacements, and "
                        "its error is of this order"
                    ),
                )
    yield from (sentence for _, sentence in worst.values())


def _measure_gradients(gradient: Floats) -> Iterator[tuple[str, Floats]]:
    """Angle of rotation and largest principal strain of gradients ``(k, a, cells)``."""
    turned = 0.5 * (gradient - gradient.swapaxes(0, 1))
    strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
    # The squares of the skew part of a rotation ω add up to 2 ‖ω‖².
    yield "rotations", np.sqrt(0.5 * np.einsum("kac,kac->c", turned, turned))
    principal = np.linalg.eigvalsh(np.moveaxis(strain, 2, 0))
    yield "strains", np.abs(principal).max(axis=1)


def _slid(model: Assembly, steps: Sequence[Step]) -> Iterator[str]:
    for group, contact in enumerate(model.contacts):
        flat = contact.against is None and (
            contact.obstacle is None or isinstance(contact.obstacle, Plane)
        )
        at = np.flatnonzero(model.group == group)
        if flat or not at.size:
            # On a rigid plane all positions are equivalent.
            continue
        k, node, ratio = find_farthest(steps, measure_distances(model.points[at]), at)
        if ratio <= 1:
            continue
        moved = measure_displacement(steps[k], at[node])
        yield (
            f"contacts of {contact.title} slide by up to "
            f"{np.linalg.norm(moved):.3g} from where they were, at "
            f"{place(model.points[at[node]])} in load step {k + 1} of {len(steps)}, "
            f"{ratio:.2g} times their distance from each other: such slips are outside the "
            "small-displacement theory: do not use this result"
        )


def _coarse(model: Assembly, last: Step, count: int) -> Iterator[str]:
    for group, contact in enumerate(model.contacts):
        at = np.flatnonzero(model.group == group)
        pressed = at[last.reaction[at, 0] > 0]
        # If the whole surface is in contact, its edges bound the zone.
        if not 0 < pressed.size < at.size:
            continue
        nodes = across(model.points[pressed], measure_distances(model.points[at]))
        if nodes < NODES_ACROSS:
            yield (
                f"at the end, load step {count} of {count}, the contact zone of "
                f"{contact.title} is {nodes:.0f} node{'' if nodes < 1.5 else 's'} "
                f"across, around {place(model.points[pressed].mean(axis=0))}: its "
                "pressure is inaccurate there; use smaller cells"
            )


def _gone(model: Assembly, last: Step) -> Iterator[str]:
    for name in list_unsupported(model):
        groups = [
            group
            for group, contact in enumerate(model.contacts)
            if name in (contact.body, (contact.against or ("",))[0])
        ]
        of_groups = np.isin(model.group, groups)
        moved = np.abs(last.displacement).max(initial=0.0)
        # At rest without a load, gaps are zero and contacts do not press.
        if (
            last.relative_displacement[of_groups, 0].min(initial=np.inf)
            > _ROUNDING * moved
        ):
            yield (
                f"body {name!r} has no support and no spring, and at the end no contact "
                "holds it: it was pushed away, or a support is missing"
            )


def across(points: Floats, apart: Floats) -> float:
    """Number of nodes across the narrowest width of a zone with nodes ``points (m, d)``.

    The extent over the median distance ``apart`` of nodes, in 3D along the narrower
    principal axis of the zone, and at most the diameter of a disc with as many nodes. A
    heuristic if cells differ in size.
    """
    d = points.shape[1]
    near = float(np.median(apart))
    if d == 2 or len(points) < 3:
        return float(len(points))
    arm = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(arm.T @ arm)
    # Ascending: the normal, then the narrow and the wide axis of the zone.
    extents = np.ptp(arm @ axes[:, 1:], axis=0)
    disc = 2 * np.sqrt(len(points) / np.pi)
    return float(min(extents.min() / near + 1, disc))
