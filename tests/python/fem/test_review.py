"""Warnings about a solution, for displacements that are known exactly."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs import obstacle as ob
from bipot_rs.fem.checks.inspection import review


def cube(dim: int, name: str = "a", low: float = 0.0, size: float = 1.0) -> fem.Body:
    g = size * np.linspace(0, 1, 5)
    axes = [g] * (dim - 1) + [size * low + g]
    cell = "quadrilateral" if dim == 2 else "hexahedron"
    return fem.Body(name, fem.box(axes, cell), fem.Material(1.0, 0.3))


def built(dim: int, size: float = 1.0, **contact: Any) -> fem.Assembly:
    up = np.eye(dim)[dim - 1]
    bodies = [cube(dim, size=size)]
    if "against" in contact:
        bodies.append(cube(dim, "b", -1.0, size))
    contact = contact or {"plane": (0 * up, up)}
    return fem.assemble(bodies, [fem.Contact("a", "bottom", 0.3, **contact)])


def step(model: fem.Assembly, u: Any = None, v: Any = None, pressed: Any = True) -> Any:
    """A load step with these displacements, relative displacements and pressed contacts."""
    shape = len(model.gap), model.dim
    moved = np.zeros((len(model.nodes), model.dim)) if u is None else u
    reaction = np.zeros(shape)
    reaction[:, 0] = np.broadcast_to(pressed, shape[0])
    return SimpleNamespace(
        displacement=np.asarray(moved).ravel(),
        reaction=reaction,
        relative_displacement=np.zeros(shape) if v is None else v,
        frame=None,
        drag=None,
    )


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("size", [1.0, 1e-6])
def test_warning_of_a_rotation_gives_its_angle(dim: int, size: float) -> None:
    """A field W x with skew W rotates by the length of its axial vector, without strain."""
    model = built(dim, size)
    axial = np.array([0.3, -0.4, 1.2]) / 1.3 if dim == 3 else np.array([0, 0, 1.0])
    x = np.zeros((len(model.nodes), 3))
    x[:, :dim] = model.nodes
    unit = np.cross(axial, x)[:, :dim]
    # The worst load step is named.
    (warning,) = review(model, [step(model, a * unit) for a in (0.01, 0.06, 0.03)])
    # 0.06 rad are 3.44 degrees.
    assert warning.startswith("rotations up to 3.4°, 0.06 rad, of body 'a' at (")
    share = f"in {4**dim} of its {4**dim} cells"
    assert f"in load step 2 of 3, above 0.05 {share}" in warning
    assert review(model, [step(model, 0.04 * unit)]) == []


@pytest.mark.parametrize("dim", [2, 3])
def test_warning_of_a_strain_gives_its_size(dim: int) -> None:
    """Uniform strain with principal values 0.02 and -0.07 in rotated axes."""
    model = built(dim)
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.eye(dim)
    turn[:2, :2] = [[c, -s], [s, c]]
    strain = turn @ np.diag([0.02, -0.07, 0.0][:dim]) @ turn.T
    (warning,) = review(model, [step(model, model.nodes @ strain)])
    assert warning.startswith("strains up to 7 % of body 'a' at (")
    assert review(model, [step(model, 0.7 * model.nodes @ strain)]) == []


def test_sliding_is_relative_to_the_distance_of_contacts() -> None:
    """For pairs and round obstacles only: a rigid plane is the same everywhere."""
    v = np.zeros((5, 2))
    v[3, 1] = -0.6  # # nodes are 0.25 apart
    pair = built(2, against=("b", "top"))
    (warning,) = review(pair, [step(pair, v=v), step(pair)])
    assert warning.startswith("contacts of a.bottom slide by up to 0.6 from where they")
    assert "in load step 1 of 2, 2.4 times their distance" in warning
    # An open contact may slide any distance.
    assert review(pair, [step(pair, v=v, pressed=[1, 1, 1, 0, 1]), step(pair)]) == []
    assert review(pair, [step(pair, v=0.4 * v)]) == []
    round_one = built(2, obstacle=ob.Sphere([0.5, -3.0], 3.0))
    assert len(review(round_one, [step(round_one, v=v)])) == 1
    for flat in (built(2), built(2, obstacle=ob.Plane([0, 0], [0, 1]))):
        assert review(flat, [step(flat, v=v)]) == []


def test_warning_of_a_narrow_contact_zone() -> None:
    model = built(2)
    for pressed, nodes in (([0, 1, 1, 1, 0], "3 nodes"), ([0, 0, 1, 0, 0], "1 node")):
        (warning,) = review(model, [step(model, pressed=pressed)])
        assert f"the contact zone of a.bottom is {nodes} across" in warning
    # In the last load step; if all or none of a surface touches, the mesh limits nothing.
    narrow = step(model, pressed=[0, 0, 1, 0, 0])
    assert review(model, [narrow, step(model)]) == []
    assert review(model, [narrow, step(model, pressed=0)]) == []
    assert review(model, []) == []


def test_result_reports_sliding_distance() -> None:
    """The summary reports a block dragged over its support by 0.4, with nodes 0.1 apart."""
    load = [[-1.0, 0.4 + 0.3, -1.0, 0.4 + 0.3]]
    x = np.array([[0.0, 0.0], [0.1, 0.0]])
    # Friction carries 0.3 of the pull, and the springs of stiffness one carry the rest.
    near, wide, nowhere = (
        str(
            bp.solve(np.eye(4), np.eye(4), load, gap=np.zeros(2), mu=0.3, points=points)
        )
        for points in (x, 10 * x, None)
    )
    assert "contacts slid by up to 4 times their distance" in near
    assert "slid" not in wide + nowhere


def sheared(go: list[float], across: float, down: Any, at: float, mu: float) -> Any:
    side = {"from": 0.0, "to": 1.0, "cells": 4}
    m = bp.Model("Pressed and sheared")
    m.material("soft", young=1.0, poisson=0.3)
    m.body("block", material="soft", cell="quadrilateral", x=side, y=side)
    m.support("block.top", x=m.times(across, "go"), y=down)
    m.contact("block.bottom", plane={"point": [0, at], "normal": [0, 1]}, mu=mu)
    m.path(go=go)
    return m


def test_a_continued_path_counts_load_steps_from_its_start() -> None:
    still: Any = (0.01, -0.01, 0.0, 0.3)
    two = sheared([0.1, 0.2], *still).solve()
    with pytest.raises(bp.NotConvergedError) as failed:
        sheared([0.1, 0.2, 0.9], *still).solve(
            start=two, method="uzawa", max_iterations=1
        )
    assert str(failed.value).startswith("load step 3: not converged")
    assert failed.value.result.message == str(failed.value)


def test_warning_of_a_body_pushed_away() -> None:
    """The lower body has no support; the upper one has one."""
    pair = fem.Contact("a", "bottom", 0.3, against=("b", "top"))
    bodies = [cube(2), cube(2, "b", -1.0)]
    top = fem.Support("a", "top", (0, 1))
    model = fem.assemble(bodies, [pair], [top])
    apart = np.zeros((len(model.gap), 2))
    apart[:, 0] = 0.01
    away = step(model, v=apart, pressed=0)
    assert review(model, [step(model)]) == []
    # Without load it does not move.
    assert review(model, [step(model), step(model, pressed=0)]) == []
    (warning,) = review(model, [step(model), away])
    assert warning == (
        "body 'b' has no support and no spring, and at the end no contact holds it: it "
        "was pushed away, or a support is missing"
    )
    ground = fem.Support("b", "bottom", (0, 1))
    assert review(fem.assemble(bodies, [pair], [top, ground]), [away]) == []
