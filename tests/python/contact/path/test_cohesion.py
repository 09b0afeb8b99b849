"""Cohesion that breaks where contacts open, and dilatancy, along load paths."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs.contact.law.contact_law import BESIDE_MU
from support.comparisons import FIELDS, solve_in_parts

Array = NDArray[np.float64]
STIFFNESS, MU, COHESION = 1e3, 0.3, 4.0
# η of the solutions; reactions are exact to some tens of it in problems of this condition.
TOL, CLOSE = 1e-13, 1e-11


def point(d: int = 2, **settings: Any) -> bp.ContactProblem:
    """A point on springs, on a wall."""
    settings = {"gap": [0.0], "mu": MU, "cohesion": COHESION} | settings
    return bp.ContactProblem(STIFFNESS * np.eye(d), np.eye(d), **settings)


def oracle(arrays: dict[str, Any], load: Array) -> tuple[Array, NDArray[np.bool_]]:
    """One step of `row`, by dense algebra and the bipotential as it stands."""
    K, B = arrays["K"], arrays["B"].toarray()
    W, free = B @ np.linalg.solve(K, B.T), B @ np.linalg.solve(K, load)
    gap = np.asarray(arrays["gap"])
    q = free.reshape(len(gap), -1).copy()
    q[:, 0] += gap
    broken = gap > 0
    while True:
        cohesion = np.where(broken, 0.0, arrays["cohesion"])
        problem = bp.ReducedProblem(W, q, arrays["mu"], cohesion=cohesion)
        solution = problem.solve(tol=TOL)
        assert solution.converged
        v = solution.relative_displacement
        opens = (solution.reaction[:, 0] == 0) & (v[:, 0] > 1e-9 * np.abs(v).max())
        if not (opens & ~broken).any():
            return solution.reaction, broken
        broken = broken | opens


def row(seed: int, contacts: int = 8, d: int = 2) -> tuple[dict[str, Any], Array]:
    """A row of contacts that a random body joins, and loads that peel it from one end."""
    rng = np.random.default_rng([seed, contacts, d])
    n = d * contacts
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    arrays = {
        "K": STIFFNESS * (root @ root.T + np.eye(n)),
        "B": sparse.eye_array(n, format="csr"),
        "gap": np.zeros(contacts),
        "mu": rng.uniform(0.2, 0.6, contacts),
        "cohesion": rng.uniform(1.0, 4.0, contacts),
    }
    load = rng.normal(size=(contacts, d))
    load[:, 0] = np.linspace(6.0, -20.0, contacts)
    return arrays, load.ravel()


def check_engine(result: bp.Result, engine: str) -> None:
    """The engine that was asked for solved every step: no other one took over."""
    expected = [engine == "iterative"] * len(result)
    assert ["krylov" in step.stats for step in result] == expected


@pytest.mark.parametrize("direction", [[1.0], [-1.0], [0.6, 0.8]])
@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_an_unloaded_glued_point_holds_shear_up_to_the_cohesion(
    direction: list[float], engine: str
) -> None:
    """It then slips, and keeps its cohesion: the shear stays ``c``."""
    t = np.array(direction)
    shear = np.array([0.5, 1.0 - 1e-9, 1.5, 2.0, 1.6]) * COHESION
    result = point(1 + len(t), engine=engine).solve(
        [[0.0, *(force * t)] for force in shear], tol=TOL
    )
    check_engine(result, engine)
    # The spring holds what is beyond the cohesion; going back, the point sticks.
    carried = [0.5, 1.0 - 1e-9, 1.0, 1.0, 0.6]
    assert np.allclose(
        result.reaction[:, 0, 1:],
        -np.outer(carried, t) * COHESION,
        rtol=0,
        atol=CLOSE * COHESION,
    )
    assert (result.reaction[:, 0, 0] == 0).all()
    moved = np.array([0.0, 0.0, 0.5, 1.0, 1.0]) * COHESION / STIFFNESS
    assert np.allclose(
        result.relative_displacement[:, 0, 1:], np.outer(moved, t), rtol=0, atol=1e-13
    )
    assert not result.broken.any()


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_a_bar_of_two_springs_is_pulled_off_at_the_cohesion(engine: str) -> None:
    """The node between the springs is glued; their far ends are prescribed.

    ``k u = k (d - u) + r_t`` with ``|r_t| <= c``. A pull along the normal, however small,
    breaks the glue.
    """
    k, n = STIFFNESS, 4
    K = np.zeros((n, n))  # the node: normal, tangent; the end: tangent; a spare one
    K[0, 0] = K[3, 3] = k
    K[1, 1], K[1, 2], K[2, 1], K[2, 2] = 2 * k, -k, -k, k
    B = np.eye(2, n)
    problem = bp.ContactProblem(
        K, B, gap=[0.0], mu=0.0, cohesion=COHESION, fixed=[2], engine=engine
    )
    ends = np.array([[0.999], [1.001], [3.0], [3.0], [3.0]]) * COHESION / k
    loads = np.zeros((5, n))
    loads[3:, 0] = [1e-6 * COHESION, 0.0]
    result = problem.solve(loads, ends, tol=TOL)
    check_engine(result, engine)
    u = result.displacement[:, 1] * k / COHESION
    expected = [0.0, 0.0005, 1.0, 1.5, 1.5]
    assert u == pytest.approx(expected, abs=1e-9)
    assert result.reaction[:, 0, 1] == pytest.approx(
        np.array([-0.999, -1.0, -1.0, 0.0, 0.0]) * COHESION, abs=1e-9 * COHESION
    )
    assert result.broken[:, 0].tolist() == [False, False, False, True, True]
    assert result[3].remarks == ("contact 0 broke",)
    assert not any(result[k].remarks for k in (0, 1, 2, 4))
    assert "load step 4: contact 0 broke" in result.remarks


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_a_row_peels_as_dense_algebra_says_in_any_numbering(seed: int, d: int) -> None:
    arrays, load = row(seed, d=d)
    expected, broken = oracle(arrays, load)
    assert 0 < broken.sum() < len(broken)
    size = np.abs(expected).max()
    for order in (slice(None), np.random.default_rng(seed).permutation(len(broken))):
        rows = np.arange(d * len(broken)).reshape(-1, d)[order].ravel()
        turned = {name: arrays[name][order] for name in ("gap", "mu", "cohesion")}
        problem = bp.ContactProblem(arrays["K"], arrays["B"][rows], **turned)
        result = problem.solve(load, tol=TOL)
        assert (result.broken[0] == broken[order]).all()
        assert np.abs(result.reaction[0] - expected[order]).max() <= CLOSE * size


def test_a_path_that_breaks_depends_on_its_steps() -> None:
    """A point is lifted and pressed again: in one step it never opens."""
    shear = [-10.0, 6.0]
    one_step = point().solve([shear])
    two_steps = point().solve([[1.0, 0.0], shear])
    assert one_step.reaction[-1, 0, 1] == pytest.approx(-6.0)
    assert two_steps.reaction[-1, 0, 1] == pytest.approx(-MU * 10.0)
    assert two_steps.broken[:, 0].all()
    assert not one_step.broken.any()


def test_a_contact_that_is_open_at_the_start_has_no_cohesion() -> None:
    pressed = point(gap=[1e-3]).solve([-10.0, 6.0])
    assert pressed.broken.all()
    assert not pressed[0].remarks
    # Below 1e-9 of the extent of the points, a gap is rounding.
    two = {
        "K": STIFFNESS * np.eye(4),
        "B": np.eye(4),
        "gap": [1e-13, 1e-5],
        "points": [[0.0, 0.0], [1.0, 0.0]],
    }
    result = bp.solve(load=[0.0, 1.0, 0.0, 1.0], mu=MU, cohesion=COHESION, **two)
    assert result.broken[0].tolist() == [False, True]


def paths(**more: Any) -> Iterator[tuple[bp.ContactProblem, Array]]:
    """Rows that are sheared, peeled and pressed again."""
    for seed in range(3):
        arrays, load = row(seed, d=2 + seed % 2)
        shares = np.array([0.3, 1.0, 0.6, -0.5, 0.8])
        shear = np.random.default_rng(seed).normal(size=(5, len(load)))
        loads = np.outer(shares, load) + shear
        dilatancy = 0.5 * arrays["mu"]
        yield bp.ContactProblem(**arrays, dilatancy=dilatancy, **more), loads


def test_a_continued_path_has_the_bits_of_the_whole(tmp_path: Path) -> None:
    for problem, loads in paths(engine="direct"):
        fields = (*FIELDS, "broken", "dilation")
        whole = solve_in_parts(problem, tmp_path, fields, load=loads)
        assert whole.broken.any()
        names = "reaction", "relative_displacement", "broken", "dilation"
        state = bp.State(**{name: getattr(whole[1], name) for name in names})
        rest = problem.solve(loads[2:], start=state, tol=TOL).reaction
        assert np.allclose(rest, problem.solve(loads, tol=TOL).reaction[2:], atol=1e-9)


def test_adaptive_steps_go_back_to_the_contacts_that_were_whole() -> None:
    """A step that slips too far may have broken contacts; it is halved."""
    compared = 0
    for problem, loads in paths(engine="direct"):
        for load in loads:
            whole = problem.solve(load)[-1]
            slips = np.linalg.norm(whole.slip, axis=1)[whole.status == bp.Status.SLIP]
            if not (slips.any() and whole.broken is not None and whole.broken.any()):
                continue
            path = problem.follow(load, slip=0.4 * slips.max(), smallest=1e-4)
            again = problem.solve(np.outer(path.s, load))
            assert len(path) > 1
            assert (again.broken == path.broken).all()
            assert (again.reaction == path.reaction).all()
            compared += 1
    assert compared > 1


def test_both_engines_agree() -> None:
    direct, iterative = (list(paths(engine=name)) for name in ("direct", "iterative"))
    for (ours, loads), (theirs, _) in zip(iterative, direct, strict=True):
        expected, result = theirs.solve(loads, tol=TOL), ours.solve(loads, tol=TOL)
        check_engine(result, "iterative")
        assert (result.broken == expected.broken).all()
        size = np.abs(expected.reaction).max()
        # Estimates of the blocks of W scale the certificate of the iterative engine.
        assert np.abs(result.reaction - expected.reaction).max() <= 1e-10 * size


@pytest.mark.parametrize("steps", [1, 2, 10])
@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.parametrize("cohesion", [0.0, COHESION])
def test_a_block_pushed_sideways_rises_by_the_path(
    steps: int, engine: str, cohesion: float
) -> None:
    """There: ``k u = F - c - mu (P + k beta u)``; back, the rise goes on."""
    beta, press, push = 0.2, 10.0, 20.0
    problem = point(dilatancy=beta, cohesion=cohesion, engine=engine)
    shares = np.arange(1, steps + 1) / steps
    there = np.outer(shares, [0.0, push])
    back = np.outer(1 - shares, [0.0, push]) - np.outer(shares, [0.0, push])
    result = problem.solve(np.concatenate([there, back]) - [press, 0.0], tol=TOL)
    check_engine(result, engine)
    u = (push - cohesion - MU * press) / (STIFFNESS * (1 + MU * beta))
    # k w = -F + c + mu (P + k beta (2 u - w))
    w = (-push + cohesion + MU * (press + 2 * STIFFNESS * beta * u)) / (
        STIFFNESS * (1 + MU * beta)
    )
    v = result.relative_displacement[:, 0]
    assert v[steps - 1, 1] == pytest.approx(u, rel=CLOSE)
    assert v[steps - 1, 0] == pytest.approx(beta * u, rel=CLOSE)
    assert v[-1, 1] == pytest.approx(w, rel=CLOSE)
    assert v[-1, 0] == pytest.approx(beta * (2 * u - w), rel=CLOSE)
    assert result[-1].dilation == pytest.approx(v[-1, :1], rel=CLOSE)
    # The bipotential of each step: the work of the shear that does not lift the block.
    force, slid = result.reaction[:, 0], np.abs(result.slip[:, 0, 0])
    lost = (cohesion + (MU - beta) * force[:, 0]) * slid
    assert result.dissipation == pytest.approx(lost, rel=1e-9, abs=1e-12)
    assert result.reaction[-1, 0, 0] == pytest.approx(
        press + STIFFNESS * v[-1, 0], rel=CLOSE
    )
    assert not result.broken.any()


def test_a_lifted_block_comes_down_to_its_asperities() -> None:
    """Dilation stays when the block is lifted, also sideways, and set down again."""
    beta = 0.2
    problem = point(dilatancy=beta, cohesion=0.0)
    result = problem.solve(
        [[-10.0, 20.0], [9.0, 20.0], [9.0, 2.0], [-10.0, 2.0]], tol=TOL
    )
    dilation = np.array([step.dilation for step in result])
    rise = result.relative_displacement[0, 0, 0]
    assert rise > 0
    assert (result.status[1:3] == bp.Status.OPEN).all()
    assert dilation[:3] == pytest.approx(rise, rel=CLOSE)
    slid = np.linalg.norm(result.slip[3, 0])
    assert result.relative_displacement[3, 0, 0] == pytest.approx(
        rise + beta * slid, rel=CLOSE
    )


@pytest.mark.parametrize("engine", ["direct", "iterative"])
def test_an_obstacle_that_leaves_breaks_the_contact(engine: str) -> None:
    """Also with frames of each step: the springs are the same in all directions."""
    c, s = np.cos(0.3), np.sin(0.3)
    turned = np.array([[c, s], [-s, c]])
    problem = point(dilatancy=0.1, frame=[np.eye(2)], engine=engine)
    loads = np.array([[-10.0, 8.0], [-10.0, 8.0], [-10.0, -12.0]])
    gaps = np.array([[0.0], [0.02], [0.0]])
    plain = problem.solve(loads, gap=gaps, tol=TOL)
    assert plain.broken[:, 0].tolist() == [False, True, True]
    assert plain.slip[0, 0] > 0
    assert plain.relative_displacement[2, 0, 0] > plain.relative_displacement[0, 0, 0]
    moving = bp.MovingGaps(gaps, np.tile(turned, (3, 1, 1, 1)), np.zeros((3, 1, 2)))
    result = problem.solve(loads @ turned, gap=moving, tol=TOL)
    assert (result.broken == plain.broken).all()
    for name in ("reaction", "relative_displacement", "slip"):
        expected = getattr(plain, name)
        apart = np.abs(getattr(result, name) - expected).max()
        assert apart <= CLOSE * np.abs(expected).max()


def test_tables_and_files_show_what_is_broken(tmp_path: Path) -> None:
    placed = {"area": [2.0], "points": [[0.0, 0.0]], "frame": [np.eye(2)]}
    result = point(**placed).solve([[-1.0, 2.15], [1.0, 0.0]])
    assert list(result.table()["broken"]) == [0, 1]
    # Of c + mu r_n, and of nothing.
    used = result.table()["friction_used"]
    assert used[0] == pytest.approx(2.15 / (COHESION + MU))
    assert np.isnan(used[1])
    assert list(result.table("contacts")["broken"]) == [False, True]
    result.save(tmp_path / "x.h5")
    read = bp.load_result(tmp_path / "x.h5")
    assert (read.broken == result.broken).all()
    assert read.contacts["cohesion"] == pytest.approx([COHESION])
    assert any("broke" in remark for remark in read.remarks)
    plain = point(cohesion=None).solve([-1.0, 0.0])
    plain.save(tmp_path / "plain.h5")
    import h5py

    with h5py.File(tmp_path / "plain.h5") as file:
        assert "broken" not in file["steps/0000"]
        assert "cohesion" not in file["contacts"]
    assert not plain.broken.any()


def test_the_reduced_problem_of_a_step_has_what_is_left() -> None:
    for problem, loads in paths(engine="direct"):
        result = problem.solve(loads, tol=TOL)
        for k in range(1, len(loads)):
            if (result.broken[k] != result.broken[k - 1]).any():
                continue
            reduced = problem.reduced(loads[k], start=result[k - 1])
            solution = reduced.solve(tol=TOL)
            size = np.abs(result.reaction).max()
            assert np.abs(solution.reaction - result.reaction[k]).max() <= CLOSE * size


def glued(length: float, stress: float) -> bp.Model:
    """A block that is glued to a plane, sheared and lifted at a side, in other units."""
    m = bp.Model(n=4)
    m.material("soft", young=100.0 * stress, poisson=0.3)
    for name, low in (("left", 0.0), ("right", 2.0)):
        ends = {"from": low * length, "to": (low + 1.0) * length, "cells": "n"}
        height = {"from": 0.0, "to": length, "cells": "n"}
        m.body(name, material="soft", cell="quadrilateral", x=ends, y=height)
        m.traction(f"{name}.top", x=m.times(0.5 * stress, "shear"), y=-2.0 * stress)
        if name == "right":
            m.traction(f"{name}.top", y=m.times(5.0 * stress, "lift"))
        m.spring(f"{name}.top", stiffness=20.0 * stress / length)
        m.contact(
            f"{name}.bottom",
            plane={"point": [0.0, 0.0], "normal": [0.0, 1.0]},
            mu=0.4,
            cohesion=3.0 * stress,
            dilatancy=0.1,
        )
    m.path(shear=[1.0, 1.0, 1.0], lift=[0.0, 1.0, 0.0])
    return m


def test_a_run_writes_what_is_broken(tmp_path: Path, bipot: Any) -> None:
    glued(1.0, 1.0).to_toml(tmp_path / "glued.toml")
    _, output, _ = bipot("run", "glued.toml", "--out", "out", "--json")
    rows = [json.loads(line) for line in output.splitlines()]
    expected = glued(1.0, 1.0).solve()
    counts = expected.broken.sum(axis=1).tolist()
    assert [row["broken"] for row in rows if "step" in row] == counts
    saved = bp.load_result(tmp_path / "out" / "result.h5")
    assert (saved.broken == expected.broken).all()
    assert (saved[-1].dilation == expected[-1].dilation).all()
    _, told, _ = bipot("info", "out/result.h5", "--json")
    assert json.loads(told)["last"]["broken"] == counts[-1]


class TestDerivatives:
    """Against central differences, along paths whose contacts break in earlier steps."""

    @staticmethod
    def cases() -> Iterator[tuple[dict[str, Any], Array, float]]:
        for seed in range(3):
            arrays, load = row(seed, d=2 + seed % 2)
            rng = np.random.default_rng(seed)
            loads = np.outer([0.5, 1.0, 0.9], load) + rng.normal(size=(3, len(load)))
            # Not at zero, where a larger gap is open at the start.
            pressed = {"gap": np.full(len(arrays["gap"]), -1e-4)}
            for beta in (0.0, 0.4):
                law = {"dilatancy": beta * arrays["mu"]}
                yield arrays | pressed | law, loads, beta

    @staticmethod
    def solve(
        arrays: dict[str, Any], loads: Array, engine: str, **change: Array
    ) -> bp.Result:
        moved = {name: arrays[name] + by for name, by in change.items()}
        problem = bp.ContactProblem(**(arrays | moved), engine=engine)
        return problem.solve(loads, tol=TOL)

    @pytest.mark.parametrize("name", ["mu", *BESIDE_MU, "gap"])
    @pytest.mark.parametrize("engine", ["direct", "iterative"])
    def test_tangents_and_gradients(self, name: str, engine: str) -> None:
        step, compared = 1e-6, 0
        for arrays, loads, beta in self.cases():
            if name == "dilatancy" and not beta:
                continue
            rng = np.random.default_rng(7)
            by = rng.uniform(0.5, 1.0, len(arrays["mu"]))
            by = by / STIFFNESS if name == "gap" else by
            result, up, down = (
                self.solve(arrays, loads, engine, **{name: amount * by})
                for amount in (0.0, step, -step)
            )
            same = (up.broken == down.broken) & (up.status == down.status)
            if not same.all():
                continue
            tangent = result.jvp(**{name: by})
            cotangent = rng.normal(size=result.reaction.shape)
            gradient = result.vjp(reaction=cotangent)
            for field in ("reaction", "relative_displacement", "slip"):
                difference = (getattr(up, field) - getattr(down, field)) / (2 * step)
                apart = np.abs(getattr(tangent, field) - difference).max()
                size = np.abs(difference).max()
                # h² of the third derivative, and the error of the solutions over h.
                error = 10 * TOL * np.abs(getattr(result, field)).max() / step
                assert apart <= 2e-6 * size + error
                compared += field == "reaction" and size > 1e3 * error
            along = float(np.sum(getattr(gradient, name) * by))
            expected = float(np.sum(cotangent * tangent.reaction))
            assert along == pytest.approx(expected, rel=1e-8)
        assert compared >= 2

    def test_a_border_is_refused_by_name(self) -> None:
        result = point().solve([0.0, 2.0])
        with pytest.raises(bp.NotDifferentiableError, match="contact 0 with cohesion"):
            result.jvp(cohesion=1.0)


def test_limits_of_a_step_that_breaks() -> None:
    """A limit that the first solution has used up ends the step as any limit does."""
    problem = point(dilatancy=0.1)
    loads = [[-1.0, 0.1], [1.0, 0.0]]
    needed = problem.solve(loads)[1].iterations
    # The solution after the break has one iteration, whatever the first has taken.
    result = problem.solve(loads, max_iterations=needed)
    assert result.broken[1, 0]
    assert result[1].iterations <= needed + 1
    for limit in range(1, needed):
        with pytest.raises(bp.NotConvergedError, match=r"step 2: .*max_iterations"):
            problem.solve(loads, max_iterations=limit)
    with pytest.raises(bp.NotConvergedError, match="max_seconds"):
        problem.solve(loads, max_seconds=1e-300)
