"""Tables of a result: their numbers, and their form with pandas and without."""

import csv
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp

pytestmark = pytest.mark.needs_extra

NAMES = np.array(["open", "slip", "stick"])


@pytest.fixture(autouse=True)
def without_pandas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)


def points(**more: Any) -> bp.Result:
    """Three points on springs: one sticks, one slips, one opens."""
    load = [[-10.0, 1.0, -10.0, 4.0, 5.0, 0.0], [-20.0, 1.0, -10.0, 8.0, 5.0, 0.0]]
    K, B = 1e3 * np.eye(6), np.eye(6)
    return bp.solve(K, B, load, gap=np.zeros(3), mu=0.3, **more)


def test_a_row_for_each_step() -> None:
    result = points()
    table = result.table()
    assert table.dtype.names == (
        "step", "load", "open", "slip", "stick", "residual", "iterations", "seconds",
    )  # fmt: skip
    np.testing.assert_array_equal(table["step"], [0, 1])
    np.testing.assert_array_equal(table["load"], [1, 2])
    for name, count in (("open", 1), ("slip", 1), ("stick", 1)):
        np.testing.assert_array_equal(table[name], [count, count])
    np.testing.assert_array_equal(table["residual"], result.residual)
    np.testing.assert_array_equal(table["iterations"], result.iterations)


def test_forces_need_frames() -> None:
    frame = np.tile(np.array([[0.0, 1.0], [1.0, 0.0]]), (3, 1, 1))
    table = points(frame=frame).table()
    # By hand: 10 + 10 and 20 + 10 press; 1 sticks and 0.3 · 10 slips, of 0.3 Σ r_n.
    np.testing.assert_allclose(table["normal_force"], [20, 30], rtol=1e-9)
    np.testing.assert_allclose(table["tangential_force"], [4, 4], rtol=1e-9)
    np.testing.assert_allclose(table["friction_used"], [4 / 6, 4 / 9], rtol=1e-9)


def test_a_row_for_each_contact() -> None:
    x = np.array([[0.0, 0], [1, 0], [2, 0]])
    result = points(points=x, area=[0.5, 1.0, 0.5])
    table = result.table("contacts")
    assert len(table) == 6
    np.testing.assert_array_equal(table["step"], [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(table["contact"], [0, 1, 2] * 2)
    np.testing.assert_array_equal(table["status"], NAMES[result.status.ravel()])
    np.testing.assert_array_equal(table["x"], [0, 1, 2] * 2)
    assert not {"z", "surface", "wear"} & set(table.dtype.names)
    for k, part in enumerate(("n", "t1")):
        for name in ("reaction", "traction", "relative_displacement"):
            values = getattr(result, name)[..., k].ravel()
            np.testing.assert_array_equal(table[f"{name}_{part}"], values)
    np.testing.assert_array_equal(table["slip_t1"], result.slip.ravel())
    plain = points().table("contacts")
    assert not {"x", "area", "traction_n"} & set(plain.dtype.names)


def test_two_coefficients_and_no_steps() -> None:
    mu = np.array([[0.2, 0.4]])
    solved = bp.solve(np.eye(3), np.eye(3), [-1.0, 0, 0], gap=[0], mu=mu)
    table = solved.table("contacts")
    assert (table["mu_t1"], table["mu_t2"]) == (0.2, 0.4)
    empty = bp.Result([], contacts={}, shape=(1, 2), success=False, message="stopped")
    assert len(empty.table()) == len(empty.table("contacts")) == 0
    with pytest.raises(ValueError, match="rows is 'nodes', expected 'steps' or"):
        empty.table("nodes")


def test_the_table_is_that_of_the_command_line(bipot: Any) -> None:
    assert bipot("run", "two_blocks", "--set", "mesh.n=2", "--json")[0] == 0
    result = bp.load("out/two_blocks/result.h5")
    table = result.table()
    with Path("out/two_blocks/steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == table.dtype.names
    for name in table.dtype.names:
        # Resultants are summed in the same order.
        np.testing.assert_allclose(
            table[name], [float(row[name]) for row in rows], rtol=1e-12, atol=1e-12
        )
    surfaces = result.table("contacts")["surface"]
    assert set(surfaces) == set(result.contacts["surface_names"])


def test_loads_of_a_file_are_kept(tmp_path: Path) -> None:
    """Saved, loaded, saved and loaded again."""
    m = bp.Model("Block")
    m.material("soft", young=10.0, poisson=0.3)
    side = {"from": 0.0, "to": 1.0, "cells": 2}
    m.body("block", material="soft", cell="quadrilateral", x=side, y=side)
    m.contact("block.bottom", plane={"point": [0, 0], "normal": [0, 1]}, mu=0.3)
    m.support("block.top", x=0.0, y=m.times(-0.01, "down"))
    m.path(steps=2, down=[0.25, 1.0])
    solved = m.solve()
    expected = solved.table()["load"]
    np.testing.assert_array_equal(expected, solved.parameter)
    for name in ("a.h5", "b.h5"):
        solved.save(tmp_path / name)
        solved = bp.load(tmp_path / name)
        np.testing.assert_array_equal(solved.table()["load"], expected)


def test_a_data_frame_is_made_of_the_same_columns(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With a recording module: pandas is no dependency of the tests."""
    module: Any = ModuleType("pandas")
    module.DataFrame = dict
    plain = points().table("contacts")
    monkeypatch.setitem(sys.modules, "pandas", module)
    columns = points().table("contacts")
    assert tuple(columns) == plain.dtype.names
    for name, values in columns.items():
        np.testing.assert_array_equal(values, plain[name])
