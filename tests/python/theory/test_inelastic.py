"""Plastic bars with contacts: B of (23) along the passes of (37) and (38).

A bar with the stiffness k, linear kinematic hardening h and the limit N_y is an elastic bar
k h/(k + h) beside a perfectly plastic one, k²/(k + h) with the limit k N_y/(k + h): points
without friction and with cohesion.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs.theory.functionals import measure_bifunctional
from bipot_rs.theory.points import PlasticPoints
from bipot_rs.theory.structure import Contacts, Structure
from bipot_rs.theory.structure_state import (
    StepNotConvergedError,
    StructureState,
    StructureStep,
)

Array = NDArray[np.float64]
POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.1, 1.0], [1.1, 1.0]])
SEEDS = range(6)
BARS = [(0, 2), (1, 3), (2, 3), (0, 3), (1, 2)]


class Truss(NamedTuple):
    """Two feet on the ground, two tops on springs to a wall, five bars that yield."""

    whole: Structure
    without_contacts: Structure
    stress: Array  # at the start, of plastic elongations
    load: Array


@cache
def given(seed: int) -> Truss:
    rng = np.random.default_rng([3, seed])
    C = np.zeros((5, 4, 2))
    for row, (a, b) in zip(C, BARS, strict=True):
        way = POINTS[b] - POINTS[a]
        row[b], row[a] = way / np.linalg.norm(way), -way / np.linalg.norm(way)
    C, k, limit = C.reshape(5, 8), rng.uniform(0.5, 2.0, 5), rng.uniform(0.2, 0.6, 5)
    h, share = 0.3 * k, 1 / 1.3
    # At the start, without elongation, bars may be anywhere below their limits.
    most = 0.9 * limit / (1.3 * k)
    stress = np.zeros((5, 2))
    stress[:, 1] = -k * np.clip(rng.normal(size=5) * 0.2, -most, most)
    gap = np.abs(rng.normal(size=(2, 2))) * 0.05
    load = np.zeros(8)
    load[4:] = rng.normal(size=4) - np.array([0.0, 1.2, 0.0, 1.2])
    contacts = Contacts(np.eye(8)[[1, 0, 3, 2]], gap, rng.uniform(0.2, 0.5, 2))
    # Both components of the tops are on springs.
    K = C.T * (share * h) @ C + np.diag([0.0] * 4 + [0.2] * 4)
    # Of a point the normal component is idle.
    strain = np.zeros((10, 8))
    strain[1::2] = C
    points = PlasticPoints(
        strain,
        np.ones(5),
        np.outer(share * k, [1.0, 1.0]),
        cohesion=share * limit,
        apex=1.0,
    )
    whole, alone = (Structure([K], [points], c) for c in (contacts, None))
    return Truss(whole, alone, stress, load)


def bifunctional(g: Truss, u: Array, r: Array) -> float:
    """B at ``u`` and at the stresses in equilibrium with the reactions ``r``."""
    structure, free = g.whole, g.without_contacts
    push, rest = structure.matrix.T @ r.ravel(), free.at_rest([g.stress])
    (step,) = free.solve(g.load + push, start=rest, tol=1e-12)
    (group,) = structure.points
    begin = group.from_tensors(g.stress)
    end = StructureState(
        displacement=u,
        reaction=r,
        stress=step.stress,
        plastic_strain=(
            group.to_strain_tensors(group.respond(group.strains(u), begin).flow),
        ),
        gap=structure.gap,
    )
    # The start has no tangential history: that of the gap counts as slip.
    start = structure.at_rest([g.stress])
    return measure_bifunctional(structure, start, end, g.load)


@cache
def solved(
    seed: int, method: str = "displacements", passes: int = 200
) -> StructureStep:
    """The step after so many passes."""
    g = given(seed)
    try:
        (step,) = g.whole.solve(
            g.load,
            start=g.whole.at_rest([g.stress]),
            method=method,
            tol=1e-12,
            max_iterations=passes if method == "displacements" else None,
        )
    except StepNotConvergedError as error:
        return error.last
    return step


@cache
def follow(seed: int) -> Array:
    """B of the first passes: of the new u with the reactions before, and with its own."""
    g, count = given(seed), min(len(solved(seed).history), 5)
    iterates = [solved(seed, passes=k + 1) for k in range(count)]
    reactions = [np.zeros((2, 2)), *(step.reaction for step in iterates)]
    return np.array(
        [
            [bifunctional(g, step.displacement, r) for r in reactions[k : k + 2]]
            for k, step in enumerate(iterates)
        ]
    )


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.quick_variants("3")
def test_plastic_truss_with_friction(seed: int) -> None:
    g, solution, newton = given(seed), solved(seed), solved(seed, "newton")
    assert solution.converged
    # Solved to gaps of 1e-12 of the work; the condition of the truss is some hundred.
    assert solution.displacement == pytest.approx(newton.displacement, abs=1e-9)
    assert solution.reaction == pytest.approx(newton.reaction, abs=1e-9)
    # (37): every step in u decreases B, to the rounding of energies of order one.
    B = follow(seed)
    assert (B >= -1e-13).all()
    assert (B[1:, 0] <= B[:-1, 1] + 1e-13).all()
    # (38) may increase it, but two passes together decrease it.
    assert (B[2:, 1] <= B[:-2, 1] + 1e-13).all()
    # Of first order in the reactions.
    assert bifunctional(g, solution.displacement, solution.reaction) <= 1e-11
    assert B[0, 1] > 1e-6 or len(B) <= 2


def test_updating_the_stresses_may_raise_the_bifunctional() -> None:
    # The part of (31)-(34) that (38) leaves out: it does not always decrease B.
    assert any((np.diff(follow(seed), axis=1) > 1e-6).any() for seed in SEEDS)


def test_38a_as_printed_gives_a_strain() -> None:
    # ∂_σ β at (ε, σ) is the ε of (22), in the elastic domain by differences; the stress is
    # ∂_ε β. In the notation of points σ = -r.
    point = PlasticPoints(np.eye(2), [1.0], [[4.0, 4.0]], cohesion=9.0, apex=3.0)
    x, none, start = np.array([[0.2, 1.5]]), np.zeros((1, 2)), point.rest
    r = point.respond(x, start).stress
    step = 1e-6 * np.array([[0.0, 1.0]])
    ends = [point.bipotential(x, none, r - way * step, start)[0] for way in (1, -1)]
    assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(1.5, rel=1e-8)
    ends = [point.bipotential(x + way * step, none, r, start)[0] for way in (1, -1)]
    assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(4 * 1.5, rel=1e-8)


ONE = np.eye(2), [1.0], [[1.0, 1.0]]
MISTAKES: list[tuple[Callable[[], Any], str]] = [
    (lambda: PlasticPoints(np.ones((3, 8)), [1, 1], np.eye(2)), "strain has 3 rows, expected 2"),
    (lambda: PlasticPoints(np.eye(2), [1.0], [[0.0, 1.0]]), "stiffness and weights must be pos"),
    (lambda: PlasticPoints(*ONE, mu=0.2, dilatancy=0.5), r"dilatancy of point 0 is 0\.5, expected"),
    (lambda: PlasticPoints(*ONE, cohesion=-1.0), "cohesion is -1, expected zero or positive"),
    (lambda: Structure([np.eye(2)], [None]), "soil is a NoneType"),  # type: ignore[list-item]
    (Structure, "a structure has no body and no soil"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), MISTAKES)
def test_mistakes_are_named(call: Callable[[], Any], words: str) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        call()
