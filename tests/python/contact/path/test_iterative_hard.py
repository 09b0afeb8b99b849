"""Hard scenes with the iterative engine: it is right, or the direct one takes the step."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support.rollers import block

pytestmark = pytest.mark.needs_extra

# As in `test_iterative`.
CLOSE = 1e-9


def pressed_block(gap: float = 0.0, mu: float = 0.3, **body: Any) -> bp.Model:
    """A block pressed onto a plane and sheared, with its own places of nodes."""
    m = block(8, 3, **body)
    m = m.with_(support=[])
    m.obstacle("table", plane={"point": [0.0, 0.0, gap], "normal": [0.0, 0.0, -1.0]})
    m.contact("block.top", against="table", mu=mu)
    moves = {"x": m.times(0.012, "shear"), "z": m.times(0.02, "press")}
    m.support("block.bottom", **{"x": 0.0, "y": 0.0, "z": 0.0} | moves)
    m.path(press=[0.6, 1.0], shear=[0.0, 1.0])
    return m


def graded(ratio: float) -> bp.Model:
    """Cells that become flat towards the contact, the last one by ``ratio``."""
    sizes = np.geomspace(1.0, 1.0 / ratio, 8)
    z = np.concatenate([[-1.0], -1.0 + np.cumsum(sizes) / sizes.sum()])
    z[-1] = 0.0
    return pressed_block(z=z)


def two_blocks(contrast: float, fine: int = 8) -> bp.Model:
    """A block on a softer or stiffer one, with a matching surface."""
    m = bp.Model("Two blocks")
    m.material("lower", young=1000.0, poisson=0.3)
    m.material("upper", young=1000.0 * contrast, poisson=0.3)
    side = np.linspace(0.0, 1.0, fine + 1)
    m.body("low", material="lower", cell="hexahedron", x=side, y=side, z=side - 1.0)
    m.body("high", material="upper", cell="hexahedron", x=side, y=side, z=side)
    m.support("low.bottom", x=0.0, y=0.0, z=0.0)
    m.support("high.top", x=m.times(0.01, "shear"), y=0.0, z=m.times(-0.02, "press"))
    m.contact("high.bottom", against="low.top", mu=0.3)
    m.path(press=[0.6, 1.0], shear=[0.0, 1.0])
    return m


def column(slenderness: float) -> bp.Model:
    side = np.linspace(-0.5, 0.5, 4)
    z = np.linspace(-slenderness, 0.0, 41)
    return pressed_block(x=side, y=side, z=z)


HARD: dict[str, Callable[[], bp.Model]] = {
    "cells flat by 10": lambda: graded(10.0),
    "cells flat by 100": lambda: graded(100.0),
    "cells flat by 1000": lambda: graded(1000.0),
    "long cells": lambda: pressed_block(z=np.linspace(-20.0, 0.0, 5)),
    "almost no friction": lambda: pressed_block(mu=1e-8),
    "friction of 10000": lambda: pressed_block(mu=1e4),
    "a small gap": lambda: pressed_block(gap=1e-9),
    "a gap of rounding": lambda: pressed_block(gap=1e-16),
    "a soft block on a stiff one": lambda: two_blocks(1e-6),
    "a stiff block on a soft one": lambda: two_blocks(1e6),
    "a slender column": lambda: column(30.0),
    "a thin plate": lambda: pressed_block(
        x=np.linspace(-20.0, 20.0, 13), y=np.linspace(-20.0, 20.0, 13)
    ),
}


def solved(model: bp.Model, engine: str, tol: float = 1e-12) -> Any:
    model.solver(engine=engine, tol=tol)
    return model.solve()


@pytest.mark.parametrize("name", HARD)
def test_hard_scenes_are_right(name: str) -> None:
    direct, ours = solved(HARD[name](), "direct"), solved(HARD[name](), "iterative")
    assert ours.success
    for what in ("reaction", "displacement"):
        for a, b in zip(getattr(ours, what), getattr(direct, what), strict=True):
            assert np.abs(a - b).max() <= CLOSE * np.abs(b).max(), what
    # Only the stiff block on the soft one is left to the direct engine.
    if name != "a stiff block on a soft one":
        assert all("krylov" in step.stats for step in ours)


def test_a_soft_end_settles_although_large_reactions_hide_it() -> None:
    """A strip clamped between a plane and 1e6 times the force that bends its free end."""
    m = bp.Model("Strip")
    m.material("steel", young=210e9, poisson=0.3)
    long, high = np.linspace(0.0, 1.0, 321), np.linspace(0.0, 0.05, 13)
    m.body("strip", material="steel", cell="quadrilateral", x=long, y=high)
    m.support("strip.left", x=0.0, y=0.0)
    plane = {"point": [0.0, 0.0], "normal": [0.0, 1.0]}
    m.contact("strip.bottom", plane=plane, mu=0.2, within={"x": [0.0, 0.1]})
    model = m.assemble().model
    x, y = model.nodes.T
    load = np.zeros((len(x), 2))
    pressed_part, end = (y > 0.049) & (x < 0.1), x > 0.999
    load[pressed_part, 1] = -1e8 / pressed_part.sum()
    load[end, 1] = 1e2 / end.sum()

    def displacement(engine: str, tol: float) -> Any:
        problem = bp.ContactProblem(
            model.K,
            model.B,
            gap=model.gap,
            mu=model.mu,
            fixed=model.fixed,
            coordinates=np.repeat(model.nodes, 2, axis=0),
            engine=engine,
        )
        return problem.solve(load.ravel(), tol=tol)[0].displacement

    right, ours = displacement("direct", 1e-12), displacement("iterative", 1e-3)
    # The residual is below 1e-3 long before the end has come to rest.
    assert np.abs(ours - right).max() <= 1e-3 * np.abs(right).max()


@pytest.mark.parametrize("tol", [1e-4, 1e-7])
def test_the_estimated_error_is_not_below_the_error(tol: float) -> None:
    right = solved(pressed_block(), "direct")[-1]
    step = solved(pressed_block(), "iterative", tol)[-1]
    r, v = step.reaction, step.relative_displacement
    errors = [
        np.linalg.norm(r - right.reaction) / np.linalg.norm(right.reaction),
        np.linalg.norm(v - right.relative_displacement)
        / np.linalg.norm(right.relative_displacement),
    ]
    assert step.error_estimate is not None
    for error, estimate in zip(errors, step.error_estimate, strict=True):
        # One V-cycle removes some two thirds of an error, and the estimate is multiplied by
        # what the linear solver lacked: within a small factor of the error.
        assert error <= 3 * estimate + 1e-12
        assert estimate <= 10 * error + 1e-12
