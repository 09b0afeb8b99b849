"""Warnings after solving: large rotations and strains, large slip, coarse contact zones.

None of these is an error: each warning is a sentence that a person must judge.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bipot_rs._lib.messages import place
from bipot_rs._lib.types import Floats
from bipot_rs.contact.law.slip_check import (
    find_farthest,
    measure_displacement,
    measure_distances,
)
from bipot_rs.contact.results.solution import Step
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.stress_recovery import MeanStress
from bipot_rs.fem.checks.free_bodies import list_unsupported
from bipot_rs.fem.tuning import NODES_ACROSS, SMALL_ROTATION
from bipot_rs.obstacle.shapes import Plane

# Gaps below this fraction of the displacements are zero.
_ROUNDING = 1e-9


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


def _name_contacts(model: Assembly, group: int) -> str:
    contact = model.contacts[group]
    return f"{contact.body}.{contact.surface}"


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
            for name, values in _sizes(mean.gradient(displacement_of_body)):
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


def _sizes(gradient: Floats) -> Iterator[tuple[str, Floats]]:
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
            f"contacts of {_name_contacts(model, group)} slide by up to "
            f"{np.linalg.norm(moved):.3g} from where they were, at "
            f"{place(model.points[at[node]])} in load step {k + 1} of {len(steps)}, "
            f"{ratio:.2g} times their distance from each other: such slips are outside the "
            "small-displacement theory: do not use this result"
        )


def _coarse(model: Assembly, last: Step, count: int) -> Iterator[str]:
    for group in range(len(model.contacts)):
        at = np.flatnonzero(model.group == group)
        pressed = at[last.reaction[at, 0] > 0]
        # If the whole surface is in contact, its edges bound the zone.
        if not 0 < pressed.size < at.size:
            continue
        nodes = across(model.points[pressed], measure_distances(model.points[at]))
        if nodes < NODES_ACROSS:
            yield (
                f"at the end, load step {count} of {count}, the contact zone of "
                f"{_name_contacts(model, group)} is {nodes:.0f} node{'' if nodes < 1.5 else 's'} "
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
