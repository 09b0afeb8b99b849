"""The iterative engine gives the answers of the direct one, or says that it cannot."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.contact.errors import NotIterativeError
from support.body_models import floating, on_a_ball, on_springs, order_two, warmed
from support.comparisons import refused
from support.models_and_arrays import arguments
from support.pressed_in_space import arrays, pressed
from support.rollers import roller
from support.two_blocks import two_blocks

pytestmark = pytest.mark.needs_extra

# Both engines reach η = 1e-12 in the smallest units of the scene. Errors of the reactions
# are larger by the condition of the contacts, and those of the steps of a path add up.
CLOSE = 1e-9


def graded(ratio: float) -> bp.Model:
    """Cells that become flat towards the contact, the last one by ``ratio``."""
    sizes = np.geomspace(1.0, 1.0 / ratio, 8)
    z = np.concatenate([[-1.0], -1.0 + np.cumsum(sizes) / sizes.sum()])
    z[-1] = 0.0
    return pressed(8, z=z)


def column(slenderness: float) -> bp.Model:
    side = np.linspace(-0.5, 0.5, 4)
    z = np.linspace(-slenderness, 0.0, 41)
    return pressed(8, x=side, y=side, z=z)


def strip() -> bp.Model:
    """A slender body: rows of K balance to the last digit long before the bending does."""
    m = bp.Model("Strip")
    m.material("steel", young=210e9, poisson=0.3)
    long, high = np.linspace(0, 1.0, 81), np.linspace(0, 2e-3, 3)
    m.body("strip", material="steel", cell="quadrilateral", x=long, y=high)
    m.support("strip.left", x=0.0, y=0.0)
    m.contact("strip.bottom", plane={"point": [0, -1e-4], "normal": [0, 1]}, mu=0.2)
    m.body_force("strip", y=m.times(-7.7e4, "weight"))
    m.path(weight=[0.2, 1.0])
    return m


def nearly_incompressible(poisson: float) -> bp.Model:
    return pressed(6).with_(**{"material.soft.poisson": poisson})


MODELS: dict[str, Callable[[], bp.Model]] = {
    "hexahedra": pressed,
    "tetrahedra": lambda: pressed(cell="tetrahedron"),
    "second order": order_two,
    "plane": lambda: pressed(10, dim=2),
    "triangles": lambda: pressed(10, dim=2, cell="triangle"),
    "no friction": lambda: pressed(mu=0.0),
    "friction by direction": lambda: pressed(mu=[0.5, 0.1], axis=[1.0, 0.0, 0.0]),
    "large friction": lambda: pressed(mu=3.0),
    "a ball that moves back": on_a_ball,
    "held by contact alone": floating,
    "springs": on_springs,
    "initial strain": warmed,
    "a roller": roller,
    "automatic steps": lambda: roller({"slip": 0.05}),
    "poisson 0.45": lambda: nearly_incompressible(0.45),
    "poisson 0.499": lambda: nearly_incompressible(0.499),
    "cells flat by 10": lambda: graded(10.0),
    "cells flat by 1000": lambda: graded(1000.0),
    "long cells": lambda: pressed(5, z=np.linspace(-20.0, 0.0, 5)),
    "almost no friction": lambda: pressed(5, mu=1e-8),
    "friction of 10000": lambda: pressed(5, mu=1e4),
    "a small gap": lambda: pressed(5, gap=1e-9),
    "a gap of rounding": lambda: pressed(5, gap=1e-16),
    "a soft block on a stiff one": lambda: two_blocks(1e-6, 5, 5),
    "a stiff block on a soft one": lambda: two_blocks(1e6, 5, 5),
    "a slender column": lambda: column(30.0),
    "a thin plate": lambda: pressed(
        8, x=np.linspace(-20.0, 20.0, 13), y=np.linspace(-20.0, 20.0, 13)
    ),
    "a slender strip": strip,
}
# What may be left to the direct engine.
HARDEST = ("a stiff block on a soft one", "a slender strip")


def solved(model: bp.Model, engine: str, tol: float = 1e-12) -> Any:
    model.solver(engine=engine, tol=tol)
    return model.solve()


@pytest.mark.parametrize("name", MODELS)
def test_both_engines_agree(name: str) -> None:
    direct = solved(MODELS[name](), "direct")
    iterative = solved(MODELS[name](), "iterative")
    # The amplification of the rounding of K by bending is about 1e6.
    close = 1e-8 if name == "a slender strip" else CLOSE
    for ours, theirs in zip(iterative, direct, strict=True):
        assert ours.converged
        assert "krylov" in ours.stats or name in HARDEST
        assert "krylov" not in theirs.stats
        for what in ("reaction", "displacement"):
            a, b = getattr(ours, what), getattr(theirs, what)
            assert np.abs(a - b).max() <= close * np.abs(b).max(), what
        # A status may differ where a contact is on the border of two.
        closed = np.linalg.norm(theirs.reaction, axis=1)
        clear = closed > 1e-6 * closed.max()
        slips = np.linalg.norm(theirs.slip, axis=1)
        clear &= (slips > 1e-6 * slips.max()) | (theirs.status == bp.Status.STICK)
        np.testing.assert_array_equal(ours.status[clear], theirs.status[clear])


@pytest.mark.parametrize("n", [6, pytest.param(12, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("located", "most"), [(True, 90), (False, 150)])
def test_work_does_not_grow_with_the_mesh(located: bool, most: int, n: int) -> None:
    """Krylov iterations of both steps; the trial programs took 60 to 80 at any size. Without
    coordinates the vectors that replace the rotations are rough.
    """
    arguments, prescribed = arrays(n)
    direct = bp.ContactProblem(**arguments, engine="direct")
    expected = direct.solve(prescribed=prescribed, tol=1e-12)
    if not located:
        del arguments["coordinates"]
    result = bp.ContactProblem(**arguments, engine="iterative").solve(
        prescribed=prescribed, tol=1e-12
    )
    r = expected.reaction
    assert np.abs(result.reaction - r).max() <= CLOSE * r.max()
    np.testing.assert_array_equal(result.status, expected.status)
    assert sum(step.stats["krylov"] for step in result) <= most
    assert sum(step.stats["newton"] for step in result) <= 20


@pytest.mark.parametrize(("n", "nodes"), [(4, 0), (4, 2), (6, 2), (8, 2), (9, 2)])
def test_without_coordinates_motions_are_not_known(n: int, nodes: int) -> None:
    """Whether contact holds a body, only its rigid motions tell. Two nodes are held: it turns
    about the line through them, and K resists this by its rounding, which differs with the
    size.
    """
    arguments, _ = arrays(n)
    del arguments["coordinates"]
    arguments["fixed"] = arguments["fixed"].reshape(-1, 3)[:nodes].ravel()
    with pytest.raises(NotIterativeError, match=r"coordinates.*engine='direct'"):
        bp.ContactProblem(**arguments, engine="iterative")


def test_many_cases_and_other_friction() -> None:
    arguments, prescribed = arrays()
    mus = (0.1, 0.6)
    cases = [{"prescribed": prescribed, "mu": mu} for mu in mus]
    problem = bp.ContactProblem(**arguments, engine="iterative")
    for mu, path_result in zip(mus, problem.solve_many(cases), strict=True):
        direct = bp.ContactProblem(**arguments | {"mu": mu}, engine="direct")
        r = direct.solve(prescribed=prescribed).reaction
        assert np.abs(path_result.reaction - r).max() <= CLOSE * r.max()


def test_a_body_that_can_turn_is_refused() -> None:
    """Two contact nodes: the body turns about the line through them."""
    arguments, _ = arrays()
    few = arguments | {
        "B": arguments["B"][:6],
        "gap": arguments["gap"][:2],
        "mu": 0.3,
        "fixed": None,
    }
    with pytest.raises(NotIterativeError, match="free to move"):
        bp.ContactProblem(**few, engine="iterative")
    with pytest.raises(bp.FloatingBodyError):
        bp.ContactProblem(**few)


def test_few_digits_of_a_floating_body_are_no_springs() -> None:
    """Rounded entries resist rigid motions as weak springs would."""
    arguments, _ = arrays()
    arguments["fixed"] = None
    bp.ContactProblem(**arguments, engine="iterative")
    rounded = arguments["K"].copy()
    rounded.data = np.array([float(f"{x:.6e}") for x in rounded.data])
    with pytest.raises(NotIterativeError, match="few digits"):
        bp.ContactProblem(**arguments | {"K": rounded}, engine="iterative")


def test_what_the_engine_refuses() -> None:
    """Each message names the reason and the way out."""
    arguments, prescribed = arrays()
    problem = bp.ContactProblem(**arguments, engine="iterative")
    with refused(r"'uzawa'.*engine='direct'"):
        problem.solve(prescribed=prescribed, method="uzawa")
    with refused(r"compliance W.*engine='direct'"):
        _ = problem.compliance
    step = problem.solve(prescribed=prescribed)[-1]
    assert step.unique == "unknown"
    assert "engine='direct'" in step.error.reason
    with refused("engine is 'iterativ', expected"):
        bp.ContactProblem(**arguments, engine="iterativ")
    wrong = arguments["K"].tolil()
    wrong[0, 1] += 1.0
    with refused("not symmetric"):
        bp.ContactProblem(**arguments | {"K": wrong.tocsr()}, engine="iterative")


def test_the_file_names_the_engine(tmp_path: Path, bipot: Any) -> None:
    asked = ("--set", "mesh.n=5", "--engine", "iterative", "--out", "out")
    assert bipot("run", "sheared_cube", *asked)[0] == 0
    with h5py.File(tmp_path / "out" / "result.h5") as file:
        assert file.attrs["engine"] == "iterative"
    assert bp.load(tmp_path / "out" / "result.h5")[-1].stats["krylov"] > 0


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
        problem = bp.ContactProblem(**arguments(model), engine=engine)
        return problem.solve(load.ravel(), tol=tol)[0].displacement

    right, ours = displacement("direct", 1e-12), displacement("iterative", 1e-3)
    # The residual is below 1e-3 long before the end has come to rest.
    assert np.abs(ours - right).max() <= 1e-3 * np.abs(right).max()
