"""Random structures with all numbers of the law, judged by a certificate in NumPy alone.

Units change by 1e-6 and 1e6, and degrees of freedom and contacts are numbered anew. What is called
converged satisfies equilibrium, the law of points and contacts, breaking and dilation.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs.theory.limit_load import LimitLoadError
from bipot_rs.theory.points import PlasticPoints
from bipot_rs.theory.structure import Contacts, Structure
from bipot_rs.theory.structure_state import StepNotConvergedError, StructureStep

Array = NDArray[np.float64]
UNITS = ((1.0, 1.0), (1e-6, 1.0), (1e6, 1e-6), (1.0, 1e6))


@dataclass
class Case:
    """K, contacts, points, supports and a path."""

    K: Array
    B: Array
    fixed: Any
    contacts: dict[str, Array]
    strain: Array
    points: dict[str, Array]
    load: Array
    prescribed: Array
    gaps: Array


def draw_case(seed: int, force: float = 1.0, length: float = 1.0) -> Case:
    """A case; in other units its numbering differs too."""
    rng = np.random.default_rng([99, seed])
    d, count, m = rng.integers(2, 4), rng.integers(1, 6), rng.integers(1, 5)
    size, n = rng.choice([2, 3, 4, 6]), rng.integers(3, 14)
    root = rng.normal(size=(n, n)) * 10 ** rng.uniform(-1, 1, n)
    K = root @ root.T / n + 10 ** rng.uniform(-3, 0) * np.eye(n)
    B = rng.normal(size=(count, d, n))
    mu = rng.choice([0.0, rng.uniform(0, 0.8), rng.uniform(0.8, 2.0)], count)
    contacts = {
        "mu": mu,
        "dilatancy": mu * rng.choice([0.0, 1.0, rng.random()], count),
        "cohesion": rng.uniform(0.0, 2.0, count) * (rng.random(count) < 0.5),
        "gap": rng.choice([0.0, 0.0, 0.2], count) * rng.random(count),
    }
    slope = rng.uniform(0.0, 0.8, m) * (rng.random(m) < 0.8)
    points = {
        "mu": slope,
        "dilatancy": slope * rng.choice([0.0, 1.0, rng.random()], m),
        "cohesion": rng.uniform(0.1, 1.0, m) * (rng.random(m) < 0.6),
        "apex": rng.uniform(0.2, 2.0, m),
        "weights": rng.uniform(0.2, 2.0, m),
        "stiffness": rng.uniform(0.3, 3.0, (m, 2)),
    }
    strain = rng.normal(size=(size * m, n)) * (rng.random() < 0.7)
    steps = rng.integers(1, 5)
    fixed = np.sort(rng.choice(n, rng.integers(0, 3), replace=False))
    load = np.cumsum(rng.normal(size=(steps, n)), axis=0) * rng.choice([0.5, 2.0])
    prescribed = np.cumsum(rng.normal(size=(steps, len(fixed))), axis=0) * 0.3
    moved = 0.05 * np.cumsum(rng.normal(size=(steps, count)), axis=0)
    gaps = contacts["gap"] + moved * (rng.random() < 0.3)
    if (force, length) != (1.0, 1.0):
        order, back = rng.permutation(n), rng.permutation(count)
        K, B, strain = K[np.ix_(order, order)], B[back][..., order], strain[:, order]
        contacts = {name: value[back] for name, value in contacts.items()}
        load, gaps = load[:, order], gaps[:, back]
        places = np.argsort(order)[fixed]
        fixed, prescribed = np.sort(places), prescribed[:, np.argsort(places)]
    contacts["cohesion"] = contacts["cohesion"] * force
    contacts["gap"] = contacts["gap"] * length
    for name in ("cohesion", "apex", "stiffness"):
        points[name] = points[name] * force / length**2
    points["weights"] = points["weights"] * length**3
    return Case(
        K * force / length,
        B.reshape(-1, n),
        fixed,
        contacts,
        strain / length,
        points,
        load * force,
        prescribed * length,
        gaps * length,
    )


def solve(case: Case) -> tuple[str, tuple[StructureStep, ...]]:
    """How a path ends, and its steps."""
    points = dict(case.points)
    weights, stiffness = points.pop("weights"), points.pop("stiffness")
    soil = PlasticPoints(case.strain, weights, stiffness, **points)
    structure = Structure(
        [case.K], [soil], Contacts(case.B, **case.contacts), case.fixed
    )
    try:
        steps = structure.solve(case.load, case.prescribed, gap=case.gaps, tol=1e-10)
    except LimitLoadError as error:
        return "above the limit", error.steps
    except StepNotConvergedError as error:
        return "not converged", error.steps
    return "solved", steps


def measure_law(law: dict[str, Array], r: Array, v: Array, cohesion: Array) -> Array:
    """Of each row: outside of the criterion, of dilatancy, and the gap, each not negative."""
    slip, drag = np.linalg.norm(v[:, 1:], axis=1), np.linalg.norm(r[:, 1:], axis=1)
    limit = cohesion + law["mu"] * r[:, 0]
    opening = v[:, 0] - law["dilatancy"] * slip
    gap = r[:, 0] * opening + limit * slip + np.sum(r[:, 1:] * v[:, 1:], axis=1)
    outside = np.maximum(np.maximum(drag - limit, -r[:, 0]), 0.0)
    return np.array([outside, np.maximum(-opening, 0.0), np.abs(gap)])


def judge(case: Case, steps: tuple[StructureStep, ...]) -> float:
    """The largest relative violation of all that a solution satisfies."""
    n, (count, d) = len(case.K), steps[0].reaction.shape
    m, cohesion = len(case.points["mu"]), case.contacts["cohesion"]
    M = np.repeat(case.points["stiffness"], [1, case.strain.shape[0] // m - 1], axis=1)
    weights = case.points["weights"][:, None]
    u, sigma, plastic = np.zeros(n), np.zeros(M.shape), np.zeros(M.shape)
    broken, dilation = case.contacts["gap"] > 0, np.zeros(count)
    free, worst = np.setdiff1d(np.arange(n), case.fixed), [0.0]
    path = zip(steps, case.load, case.prescribed, case.gaps, strict=False)
    for step, load, prescribed, gap in path:
        du, r, stress = step.displacement - u, step.reaction, step.stress[0]
        u, flow = step.displacement, step.plastic_strain[0] - plastic
        inner = case.K @ u + case.strain.T @ (weights * stress).ravel()
        size = np.linalg.norm(np.abs(case.K) @ np.abs(u)) + np.linalg.norm(load)
        size += np.linalg.norm(np.abs(case.B).T @ np.abs(r).ravel())
        rest = inner - load - case.B.T @ r.ravel()
        worst.append(float(np.linalg.norm(rest[free])) / size)
        most = np.abs(prescribed).max(initial=0.0)
        if most > 0:
            worst.append(np.abs(u[case.fixed] - prescribed).max() / most)
        # Points: elasticity, and the law of r = (a, 0) - σ.
        elastic = M * ((case.strain @ du).reshape(m, -1) - flow)
        scale = np.linalg.norm(stress) + case.points["apex"].max()
        strains = np.linalg.norm(du) * np.abs(case.strain).max() + scale / M.min()
        worst.append(np.abs(stress - sigma - elastic).max() / (M.max() * strains))
        r_p = -stress.copy()
        r_p[:, 0] += case.points["apex"]
        parts = measure_law(case.points, r_p, flow, case.points["cohesion"])
        worst += (parts.max(axis=1) / [scale, strains, scale * strains]).tolist()
        # Contacts: the law, and what broke.
        v = (case.B @ u).reshape(count, d)
        v[:, 0] += gap - dilation
        v[:, 1:] = (case.B @ du).reshape(count, d)[:, 1:]
        # Where contacts hold all at rest, displacements are rounding of those without them.
        free_u = np.abs(u) + np.abs(np.linalg.solve(case.K, load))
        reach = np.linalg.norm(np.abs(case.B) @ free_u) + np.abs(gap).max()
        now = broken if step.broken is None else step.broken
        left = np.where(now, 0.0, cohesion)
        scale = np.linalg.norm(r) + np.linalg.norm(load) + cohesion.sum()
        parts = measure_law(case.contacts, r, v, left)
        worst += (parts.max(axis=1) / [scale, reach, scale * reach]).tolist()
        lift = case.contacts["dilatancy"] * np.linalg.norm(v[:, 1:], axis=1)
        opens = v[:, 0] - lift > 1e-7 * reach
        if step.broken is not None:
            assert (now | ~broken).all()
            assert not (opens & ~now & (cohesion > 0)).any()
        if step.dilation is not None:
            grown = step.dilation - dilation
            worst.append(np.abs(grown - np.where(opens, 0.0, lift)).max() / reach)
            dilation = step.dilation
        broken, sigma, plastic = now, stress, step.plastic_strain[0]
    return float(max(worst))


@pytest.mark.quick_variants("0")
@pytest.mark.parametrize("part", range(60))
def test_nothing_is_called_converged_wrongly(part: int) -> None:
    solved = 0
    for seed in range(5 * part, 5 * part + 5):
        ends = set()
        for units in UNITS:
            case = draw_case(seed, *units)
            end, steps = solve(case)
            ends.add((end, len(steps)))
            solved += len(steps)
            if steps:
                # Gaps of 1e-10 of energies: their roots in the fields, but for what is clipped.
                assert judge(case, steps) < 1e-7, (seed, units)
        assert len(ends) == 1, (seed, ends)
    assert solved > 20


@pytest.mark.slow_variants("uzawa")
@pytest.mark.parametrize("method", ["newton", "displacements", "uzawa"])
def test_reactions_that_grow_do_not_hide_a_penetration(method: str) -> None:
    """Two obstacles that overlap: their reactions grow without bound, and so would a work."""
    B = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, 1.0]])
    contacts = Contacts(B, [-0.1, -0.1], [0.3, 0.3], dilatancy=[0.0, 0.2])
    with pytest.raises(StepNotConvergedError) as caught:
        Structure([np.eye(2)], (), contacts).solve([0.5, 0.2], method=method)
    assert caught.value.last.gap_contact > 0.9
