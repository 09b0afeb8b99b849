"""Pressures and tractions on parts of facets, against exact integrals."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from support.boxes import CELLS, placed
from support.comparisons import refused

STEEL = fem.Material(210e3, 0.3)
SOLID = list(CELLS)[2:]


def distorted(cell: str, order: int, seed: int) -> fem.Body:
    """A box of 3 by 2 (by 1) whose inner nodes, also inside faces, are moved."""
    rng = np.random.default_rng(seed)
    sides = (3.0, 2.0, 1.0)[: CELLS[cell]]
    mesh = fem.box([np.linspace(0, side, 5) for side in sides], cell)
    x = mesh.p.copy()
    for axis, side in enumerate(sides):
        inner = (x[axis] > 1e-9) & (x[axis] < side - 1e-9)
        x[axis, inner] += rng.uniform(-0.08, 0.08, inner.sum()) * side
    mesh = placed(mesh, x)
    return fem.Body("b", mesh if order == 1 else fem.second_order(mesh), STEEL)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("seed", range(3))
def test_resultants_of_a_part_are_exact(cell: str, order: int, seed: int) -> None:
    """Force, moments and, of second order, the work on x²: by rectangles, to rounding."""
    body = distorted(cell, order, seed)
    rng = np.random.default_rng(100 + seed)
    d = body.dim
    ranges = {0: tuple(np.sort(rng.uniform(0, 3, 2)))}
    if d == 3:
        ranges[1] = tuple(np.sort(rng.uniform(0, 2, 2)))
    load = fem.Load("b", "top", pressure=2.0, within=ranges)
    (a, b), (c, e) = ranges[0], ranges.get(1, (0.0, 1.0))
    area = (b - a) * (e - c)
    # Sums of a thousand terms of size one.
    near = {"rtol": 1e-12, "atol": 1e-12}
    force = load.forces(body).reshape(-1, d)
    up = -force[:, -1]
    x = body.points
    np.testing.assert_allclose(load.area(body), area, **near)
    np.testing.assert_allclose(force[:, :-1], 0.0, **near)
    np.testing.assert_allclose(up.sum(), 2 * area, **near)
    np.testing.assert_allclose(up @ x[:, 0], area * (a + b), **near)
    if order == 2 and cell in ("triangle", "tetrahedron"):
        work = 2 * (b**3 - a**3) / 3 * (e - c)
        np.testing.assert_allclose(up @ x[:, 0] ** 2, work, **near)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_convergence_on_a_curved_surface(cell: str, order: int) -> None:
    """∫ n dA over the part of a cylinder with 0.5 < y < 1.3, 0.15 < z < 0.6."""
    ranges = {1: (0.5, 1.3)} | ({2: (0.15, 0.6)} if cell in SOLID else {})
    high = 0.45 if 2 in ranges else 1.0
    ends = np.array([np.sqrt(4 - y * y) for y in ranges[1]])
    exact = -np.array([1.3 - 0.5, ends[0] - ends[1]]) * high
    load = fem.Load("b", "right", pressure=1.0, within=ranges)
    errors = []
    for n in (8, 16, 32, 64):
        # A quarter of a ring of radii 1 and 2, in space of height 1.
        axes = [np.linspace(1, 2, 2), np.linspace(0, np.pi / 2, n + 1)]
        mesh = fem.box(axes + [np.linspace(0, 1, 4)] * (cell in SOLID), cell)
        mesh = mesh if order == 1 else fem.second_order(mesh)
        r, angle, *rest = mesh.p
        bent = np.stack([r * np.cos(angle), r * np.sin(angle), *rest])
        body = fem.Body("b", placed(mesh, bent), STEEL)
        force = load.forces(body).reshape(-1, body.dim).sum(0)
        errors.append(np.abs(force[:2] - exact).max())
    orders = -np.diff(np.log2(errors))
    # An end cuts another share of its facet on each mesh: only the mean order is smooth.
    assert orders.mean() > 1.9


def test_scenes_name_the_part_and_its_area(bipot: Any) -> None:
    m = bp.Model("block", n=4)
    m.material("steel", young=210e3, poisson=0.3)
    side = {"from": 0.0, "to": 40.0, "cells": "n"}
    m.body("b", material="steel", cell="hexahedron", x=side, y=side, z=side)
    m.support("b.left", x=0)
    m.support("b.front", y=0)
    m.contact("b.bottom", plane={"point": [0, 0, 0], "normal": [0, 0, 1]}, mu=0.3)
    m.pressure("b.top", 3.0, within={"x": [3.0, 17.0], "y": [0, 25]})
    m.traction("b.top", z=-1.0, within={"x": [20.0, 99.0]})
    force = m.solve().contact_force("b.bottom")[-1]
    assert force[2] == pytest.approx(3.0 * 14 * 25 + 20 * 40, rel=1e-9)
    m.to_toml("b.toml")
    status, out, _ = bipot("check", "b.toml")
    assert status == 0
    assert "loads     traction on b.top (800), pressure on b.top (350)" in out
    moved = m.with_(**{"pressure.0.within.x": [50.0, 60.0]})
    with refused("surface 'top' of body 'b' has no part within"):
        moved.assemble()
    empty = m.with_(**{"pressure.0.within": {}, "traction.0.within.x": [3, 1]})
    with pytest.raises(ValueError) as caught:
        _ = empty.scene
    assert "pressure.0.within: is empty" in str(caught.value)
    assert "traction.0.within.x: should ascend" in str(caught.value)
