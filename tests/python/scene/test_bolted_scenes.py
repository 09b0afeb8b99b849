"""Bolts of scenes: columns, continued paths, mistakes."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.scene.mistakes import SceneError
from support.comparisons import near, refused
from support.runs import bipot


def hook(engine: str = "auto", steps: int = 5, **bolt: Any) -> bp.Model:
    """A bar whose top hangs on a rigid plane; tightened, then sheared until it slips."""
    m = bp.Model("hook", units=("mm", "N", "MPa"))
    m.material("steel", young=2.1e5, poisson=0.3)
    x, z = {"from": 0, "to": 4, "cells": 2}, {"from": 0, "to": 20, "cells": 4}
    table = {"section": "bar.middle", "force": 400.0, "step": [1, 2]} | bolt
    inner = {"middle": {"z": [10, 10]}, "part": {"z": [10, 10], "x": [0, 2]}}
    name = str(table["section"]).removeprefix("bar.")
    surface = {name: {"within": inner[name]}} if name in inner else {}
    m.body("bar", material="steel", cell="hexahedron", x=x, y=x, z=z, surface=surface)
    m.support("bar.bottom", x=0, y=0, z=0)
    m.contact("bar.top", plane={"point": [0, 0, 20], "normal": [0, 0, 1]}, mu=0.3)
    m.traction("bar.top", x=m.times(8.0, "shear"))
    m.bolt(**table)
    m.path(shear=[0, 0, 0.5, 1.0, -1.0][:steps], parameter="shear")
    m.solver(engine=engine)
    return m


FIELDS = ("reaction", "slip", "status", "displacement", "shortening", "bolt_force")


@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.slow_variants("iterative")
def test_a_path_continues_with_the_same_bits(engine: str, tmp_path: Path) -> None:
    model = hook(engine)
    whole, case = model.solve(), model.assemble()
    for k in (1, 2, 3):
        part = case.problem().solve(case.load[:k], case.prescribed[:k], tol=1e-12)  # type: ignore[index]
        part.save(tmp_path / "part.h5")
        for start in (part, bp.load_result(tmp_path / "part.h5")):
            rest = model.solve(start=start)
            for name in FIELDS:
                ours, theirs = (
                    np.array([getattr(step, name) for step in steps]).tobytes()
                    for steps in (rest, whole[k:])
                )
                assert ours == theirs, name


def test_a_state_holds_the_shortening() -> None:
    model = hook()
    whole, case = model.solve(), model.assemble()
    problem, last = case.problem(), whole[1]
    at: dict[str, Any] = {
        "reaction": last.reaction,
        "relative_displacement": last.relative_displacement,
    }
    rest: Any = (case.load[2:], case.prescribed[2:])  # type: ignore[index]
    start = bp.State(**at, shortening=last.shortening)
    for ours, theirs in zip(problem.solve(*rest, start=start), whole[2:], strict=True):
        # Two solves of the same step to 1e-10.
        near(ours.reaction, theirs.reaction, 1e-6)
        np.testing.assert_allclose(ours.bolt_force, theirs.bolt_force, rtol=1e-8)
    with refused("start has no shortenings of bolts"):
        problem.solve(*rest, start=bp.State(**at))
    with refused("start has 2 shortenings of bolts"):
        problem.solve(*rest, start=bp.State(**at, shortening=[0.0, 0.0]))
    with refused("the model has bolts"):
        problem.reduced()


def test_columns_and_files(tmp_path: Path) -> None:
    hook(name="m10").to_toml(tmp_path / "hook.toml")
    bipot("run", "hook.toml", cwd=tmp_path)
    with (tmp_path / "out/hook/steps.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    forces = [float(row["bolt_force of m10"]) for row in rows]
    # The force grows over both steps, and friction on the top hardly changes it.
    assert forces[:2] == [200.0, 400.0]
    assert 390 < forces[2] < 410
    shortenings = [float(row["shortening of m10"]) for row in rows]
    assert shortenings[1:] == [shortenings[1]] * 4
    found = bp.load_result(tmp_path / "out/hook/result.h5")
    assert [step.tightened[0] for step in found] == [True] * 2 + [False] * 3
    np.testing.assert_array_equal([step.bolt_force[0] for step in found], forces)
    table = hook(name="m10").solve().table()
    np.testing.assert_array_equal(table["bolt_force of m10"], forces)


def test_half_a_force_and_automatic_steps() -> None:
    whole, half = hook().solve(), hook(force=800.0, half=True).solve()
    for ours, theirs in zip(half, whole, strict=True):
        np.testing.assert_allclose(ours.bolt_force, 2 * theirs.bolt_force, rtol=1e-12)
        np.testing.assert_allclose(ours.shortening, theirs.shortening, rtol=1e-12)
    model = hook().with_(**{"path.automatic": {"largest": 0.5}})
    steps = {step.s: step for step in model.solve()}
    assert steps[0.5].bolt_force[0] == 100.0
    # The tightening is linear: divided steps reach the same.
    np.testing.assert_allclose(steps[2.0].shortening, whole[1].shortening, rtol=1e-9)


def cut(section: str, point: list[int], normal: list[int]) -> dict[str, Any]:
    return {"section": section, "plane": {"point": point, "normal": normal}}


@pytest.mark.parametrize(
    ("bolt", "message"),
    [
        ({"section": "bar.midle"}, "bolt.0.section: there is no surface"),
        ({"section": "bra.middle"}, "bolt.0.section: there is no body 'bra'"),
        ({"section": "bar.top"}, "is on the boundary of the body at"),
        ({"section": "bar.part"}, "does not go through the shank at"),
        ({"step": [2, 6]}, r"bolt\.0\.step: is \[2, 6\], expected the first and the l"),
        ({"step": [3, 2]}, r"bolt\.0\.step: is \[3, 2\], expected the first and the l"),
        ({"step": None}, "bolt.0.step: is missing"),
        ({"force": None}, "bolt.0.force: is missing"),
        ({"force": {"value": 1.0, "amplitude": "no"}}, "bolt.0.force.amplitude"),
        (cut("bar", [0, 0, 30], [0, 0, 1]), "does not meet body 'bar', which extends"),
        (
            cut("bar", [0, 0, 8], [0, 0, 0]),
            "bolt.0.plane.normal: should not be zero",
        ),
        (
            cut("brr", [0, 0, 8], [0, 0, 1]),
            "bolt.0.section: there is no body 'brr'",
        ),
    ],
)
def test_mistakes(bolt: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        hook(**bolt).assemble()


def test_mistakes_of_several_tables() -> None:
    model = hook()
    model.bolt("bar.middle", force=1.0, step=[1, 1])
    with pytest.raises(SceneError, match=r"should be another name than 'bar\.middle'"):
        model.assemble()
    model = hook()
    model.support("bar", z=0, within={"z": [10, 10]})
    with pytest.raises(SceneError, match="a support holds its nodes along the axis"):
        model.assemble()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_rows_of_parts_are_those_of_the_whole(count: int) -> None:
    """Processes assemble the rows of their nodes; reference nodes are the last ones."""
    model = hook()
    plane = {"point": [0, 0, 5], "normal": [0, 0, 1]}
    model.bolt("bar", name="low", plane=plane, force=1.0, step=[3, 3])
    model.remote("held", on="bar.top", move={"x": 0.0})
    it = model.assemble().model
    K, owner = it.stiffness(), np.random.default_rng(2).integers(count, size=it.n // 3)
    for rank in range(count):
        nodes = np.flatnonzero(owner == rank)
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        off = abs(it.stiffness_rows(nodes) - K[dofs])
        # A rigid set sums the rows of nine nodes, each with up to 81 entries.
        assert off.max() <= 729 * np.finfo(float).eps * abs(K).max()


@pytest.mark.parametrize("order", [1, 2])
def test_a_bolt_of_revolution(order: int) -> None:
    """The force is that of the full turn; the shortening is F L / (E A) with A = pi R^2."""
    m = bp.Model("bolt", units=("mm", "N", "MPa"))
    m.material("steel", young=2e5, poisson=0.3)
    x, y = {"from": 0, "to": 2, "cells": 2}, {"from": 0, "to": 10, "cells": 5}
    kind: Any = {"cell": "quadrilateral", "plane": "axisymmetric", "order": order}
    mid = {"mid": {"within": {"y": [4, 4]}}}
    m.body("bar", material="steel", x=x, y=y, surface=mid, **kind)
    m.support("bar.bottom", y=0)
    pairing, top = (
        "mortar" if order == 2 else "match",
        {"point": [0, 10], "normal": [0, 1]},
    )
    m.contact("bar.top", plane=top, mu=0.0, pairing=pairing)
    m.bolt("bar.mid", force=1000.0, step=[1, 1])
    m.path(steps=2)
    result = m.solve()
    # Residuals of 1e-12, times the condition of the bar, 1e2.
    shortening = 1000 * 10 / (2e5 * np.pi * 4)
    np.testing.assert_allclose(result[0].shortening, shortening, rtol=1e-10)
    np.testing.assert_allclose(result[1].bolt_force, 1000.0, rtol=1e-10)
    m.bolt("bar", plane={"point": [0, 4], "normal": [1, 1]}, force=1.0, step=[1, 1])
    with pytest.raises(SceneError, match="is shortened along y, which is z"):
        m.assemble()
