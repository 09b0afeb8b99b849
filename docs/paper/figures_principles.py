"""Figures of chapters 3, 6 and 7, from the program itself: `python figures_principles.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

import bipot_rs as bp
from bipot_rs.theory.functionals import Functionals, measure_bifunctional, of_problem
from bipot_rs.theory.law import explicit_path
from bipot_rs.theory.points import PlasticPoints
from bipot_rs.theory.structure import Contacts, Structure
from bipot_rs.theory.structure_state import (
    StepNotConvergedError,
    StructureState,
    StructureStep,
)

mpl.use("agg")
mpl.rcParams["svg.hashsalt"] = "bipot"  # the same file from the same numbers
from matplotlib import pyplot as plt  # noqa: E402

HERE = Path(__file__).parent
STYLE = {"color": "black", "linewidth": 1.2}


def save(figure: Any, name: str) -> None:
    """Write a figure beside this script, without a date."""
    figure.tight_layout()
    figure.savefig(HERE / name, metadata={"Date": None})
    plt.close(figure)


def one_contact() -> tuple[bp.ContactProblem, Any, Any]:
    """One contact on coupled springs that slides, its K and its load."""
    K = np.array([[1.0, 0.3], [0.3, 1.0]])
    problem = bp.ContactProblem(K, np.eye(2), gap=[0.0], mu=0.5)
    return problem, K, np.array([-1.0, 1.2])


def truss(*, contacts: bool = True) -> tuple[Structure, Any]:
    """Five bars that yield, two feet with friction, two tops on springs; and the load."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.1, 1.0], [1.1, 1.0]])
    C = np.zeros((5, 4, 2))
    for row, (a, b) in zip(C, [(0, 2), (1, 3), (2, 3), (0, 3), (1, 2)], strict=True):
        way = (points[b] - points[a]) / np.linalg.norm(points[b] - points[a])
        row[b], row[a] = way, -way
    C = C.reshape(5, 8)
    k, limit = np.array([1.0, 1.2, 0.8, 1.5, 0.9]), np.array([0.3, 0.3, 0.3, 0.2, 0.3])
    # Hardening of 0.3 k: an elastic bar beside a perfectly plastic one.
    springs = np.diag([0.0] * 4 + [0.2] * 4)
    elastic = C.T * (0.3 / 1.3 * k) @ C + springs
    strain = np.zeros((10, 8))
    strain[1::2] = C
    bars = PlasticPoints(
        strain,
        np.ones(5),
        np.outer(k / 1.3, [1.0, 1.0]),
        cohesion=limit / 1.3,
        apex=1.0,
    )
    B = np.zeros((4, 8))
    B[0, 1] = B[2, 3] = B[1, 0] = B[3, 2] = 1.0
    feet = Contacts(B, np.zeros(2), [0.4, 0.5]) if contacts else None
    load = np.array([0, 0, 0, 0, 1.5, -1.2, 1.3, -0.9])
    return Structure([elastic], [bars], feet), load


def pass_of_truss(passes: int) -> StructureStep:
    """The iterate after so many passes of (37), (38)."""
    structure, load = truss()
    try:
        return structure.solve(
            load, method="displacements", tol=1e-14, max_iterations=passes
        )[0]
    except StepNotConvergedError as error:
        return error.last


def balanced_bifunctional(u: Any, r: Any) -> float:
    """B at ``u`` and at the stresses in equilibrium with the reactions ``r``."""
    structure, load = truss()
    free, _ = truss(contacts=False)
    (step,) = free.solve(load + structure.matrix.T @ r.ravel(), tol=1e-12)
    (group,) = structure.points
    flow = group.respond(group.strains(u), group.rest).flow
    end = StructureState(
        displacement=u,
        reaction=r,
        stress=step.stress,
        plastic_strain=(group.to_strain_tensors(flow),),
        gap=structure.gap,
    )
    return measure_bifunctional(structure, structure.at_rest(), end, load)


def follow_truss(count: int = 24) -> Any:
    """B of each pass, of the new u with the reactions before, and with its own."""
    before, rows = np.zeros((2, 2)), []
    for passes in range(1, count + 1):
        step = pass_of_truss(passes)
        u, after = step.displacement, step.reaction
        rows.append([balanced_bifunctional(u, r) for r in (before, after)])
        before = after
    return np.array(rows)


def principles() -> None:
    """Chapter 3: B around a solution, and along the displacement method."""
    problem, K, load = one_contact()
    step = problem.solve(load, tol=1e-14)[0]
    f = Functionals(of_problem(problem, K), load)
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.6))
    slips = np.linspace(-0.5, 2.0, 121)
    presses = np.linspace(0.3, 2.2, 111)
    slip, press = step.relative_displacement[0, 1], step.reaction[0, 0]
    values = np.array(
        [[f.bifunctional([0.0, s], [[p, -0.5 * p]]) for s in slips] for p in presses]
    )
    lines = left.contour(
        slips,
        presses,
        values,
        levels=[0.01, 0.03, 0.1, 0.3, 0.6, 1, 2, 3],
        cmap="viridis",
    )
    left.clabel(lines, fontsize=7)
    left.plot(slip, press, "k*", markersize=11)
    left.axhline(press, **STYLE, linestyle=":")
    left.axvline(slip, **STYLE, linestyle=":")
    left.set_xlabel("slip $u_t$")
    left.set_ylabel("pressure $r_n$, with $r_t = -\\mu r_n$")
    left.set_title("$B(u, r)$ about a solution, where $B = 0$", fontsize=10)
    history = follow_truss()
    passes = np.arange(1, len(history) + 1)
    floor = 1e-16
    right.semilogy(
        passes, np.maximum(history[:, 0], floor), "o-", ms=4, label="new u, old r (37)"
    )
    right.semilogy(
        passes, np.maximum(history[:, 1], floor), "s--", ms=4, label="new u, new r (38)"
    )
    right.set_xlabel("pass")
    right.set_ylabel("$B$, brought back into the cone")
    right.set_title("displacements alone, plastic bars", fontsize=10)
    right.legend(fontsize=8, frameon=False)
    save(figure, "3-principles.svg")


def existence() -> None:
    """Chapter 6: b falls without bound; the least B where there is no solution."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.6))
    slip = np.linspace(-3, 3, 301)
    # t0 = (1, 0.5), μ = 0.6, nothing pressing at the end of the step.
    left.plot(slip, 0.5 * slip, label="$b$ at $t = 0$", **STYLE)
    left.plot(slip, 0.5 * slip + 0.6 * np.abs(slip), "--", label="$b$ at $t_n = t_n^0$")
    left.set_xlabel("slip $\\Delta u_t$, at $\\Delta u_n = 0$")
    left.set_ylabel("$b(-\\Delta u, \\Delta t)$")
    left.set_title("(54) with $t^0 = (1, 0.5)$, $\\mu = 0.6$", fontsize=10)
    left.legend(fontsize=8, frameon=False)
    mu, pulls = 0.5, np.linspace(0, 1.5, 61)
    K = np.diag([1.0, 0.0])
    problem = bp.ContactProblem(K, np.eye(2), gap=[0.0], mu=mu)
    least, solved = [], []
    for pull in pulls:
        load = [-1.0, pull]
        f = Functionals(of_problem(problem, K), load)
        # All reactions in balance have r_t = -F; the least is at the edge or at the spring.
        press = max(pull / mu, 1.0)
        least.append(f.bifunctional([0.0, 0.0], [[press, -pull]]))
        existence_verdict = problem.existence(load, exhaust=True)
        solved.append(existence_verdict.verdict == "guaranteed")
    edge = pulls[np.array(solved)].max()
    right.axvspan(0, edge, color="0.9")
    right.plot(pulls, least, **STYLE)
    right.text(0.03, 0.8 * max(least), "a solution\nexists", fontsize=9)
    right.text(0.75, 0.8 * max(least), "none", fontsize=9)
    right.set_xlabel("pull $F$ on a slider pressed by a spring, $\\mu = 0.5$")
    right.set_ylabel("least $B$")
    right.set_title("both principles hold there, and $B > 0$", fontsize=10)
    save(figure, "6-contact-principles.svg")


def drift() -> None:
    """Chapter 7: the explicit scheme leaves the cone."""
    problem = bp.ContactProblem(np.diag([2.0, 1.0, 1.0]), np.eye(3), gap=[0.0], mu=0.4)

    W = problem.compliance

    def leave_cone(steps: int) -> Any:
        free = [problem.reduced(load).q[0] for load in path(steps)]
        return explicit_path(W, np.vstack([np.zeros(3), free]), 0.4)

    def path(steps: int) -> Any:
        angle = np.linspace(0, np.pi, steps + 1)[1:]
        round_ = 2 * np.column_stack([np.cos(angle), np.sin(angle)])
        way = np.vstack([[[0.4, 0.0]], [[2.0, 0.0]], round_])
        return np.column_stack([np.full(len(way), -1.0), way])

    figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.6))
    turn = np.linspace(0, 2 * np.pi, 200)
    left.plot(0.4 * np.cos(turn), 0.4 * np.sin(turn), label="$\\mu r_n$", **STYLE)
    for steps, mark in ((15, "."), (60, ",")):
        t = leave_cone(steps)[1:]
        left.plot(t[:, 1], t[:, 2], marker=mark, ms=5, label=f"explicit, {steps} steps")
    t = problem.solve(path(15)).reaction[1:, 0]
    left.plot(t[:, 1], t[:, 2], "kx", ms=6, label="implicit, 15 steps")
    left.set_aspect("equal")
    left.set_xlabel("$r_{t1}$")
    left.set_ylabel("$r_{t2}$")
    left.set_xlim(-1.0, 1.1)
    left.legend(fontsize=7, frameon=False, loc="upper left")
    counts = np.array([8, 15, 30, 60, 120, 250, 500, 1000])
    explicit, implicit = [], []
    for steps in counts.tolist():
        r = leave_cone(steps)
        explicit.append(np.linalg.norm(r[-1] - bp.project(r, 0.4)[0][-1]))
        r = problem.solve(path(steps), tol=1e-14).reaction[:, 0]
        kept, _ = bp.project(r, 0.4)
        implicit.append(max(np.abs(kept - r).max(), 1e-17))
    right.loglog(counts, explicit, "o-", label="explicit")
    right.loglog(counts, 3 * explicit[-1] * counts[-1] / counts, **STYLE, linestyle=":")
    right.text(60, 8 * explicit[3], "order 1", fontsize=8)
    right.loglog(counts, implicit, "kx-", label="implicit")
    right.set_xlabel("steps of half a turn")
    right.set_ylabel("distance from the cone")
    right.legend(fontsize=8, frameon=False, loc="center right")
    save(figure, "7-inequalities.svg")


if __name__ == "__main__":
    principles()
    existence()
    drift()
