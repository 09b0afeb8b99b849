"""Scenes with obstacles under a force, remote points, cyclic symmetry and held nodes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

import bipot_rs as bp
from bipot_rs import scene
from support.children import bipot
from support.comparisons import bits, close, near, refused

# Residuals of 1e-12, times the condition of small elastic bodies, 1e3.
SOLVED = 1e-9


def coarse(name: str) -> bp.Model:
    if name == "gripped":
        return gripped()
    return bp.Model.from_toml(name).with_(
        **{"mesh.n": 4 if name == "twisted_pad" else 20}
    )


def whole_pad() -> bp.Model:
    """All four sectors of the scene `twisted_pad`."""
    m = coarse("twisted_pad")
    table = m.to_dict()
    side = {"from": -20.0, "to": 20.0, "cells": "2*n"}
    table["body"]["pad"] |= {"x": side, "y": side}
    del table["cyclic"]
    for on, key, sign in (("left", "y", -1), ("front", "x", 1)):
        twist = bp.Model.times(0.05 * sign, "twist")
        table["traction"].append({"on": f"pad.{on}", key: twist})
    made = bp.Model()
    made._table = table
    return made


def block() -> bp.Model:
    m = bp.Model("Block", n=4)
    m.material("soft", young=1000.0, poisson=0.3)
    side = {"from": 0.0, "to": 1.0, "cells": "n"}
    m.body("it", material="soft", cell="quadrilateral", x=side, y=side)
    m.contact("it.bottom", mu=0.3, plane={"point": [0.0, 0.0], "normal": [0.0, 1.0]})
    return m


def test_a_sector_is_a_quarter_of_the_pad() -> None:
    part, whole = (m.solve(tol=1e-13) for m in (coarse("twisted_pad"), whole_pad()))
    _, at = cKDTree(whole.case.model.nodes).query(part.case.model.nodes)
    u = whole.displacement.reshape(len(whole), -1, 3)[:, at]
    close(part.displacement.reshape(len(part), -1, 3), u, SOLVED)
    force, full = part.contact_force("pad.bottom"), whole.contact_force("pad.bottom")
    np.testing.assert_allclose(4 * force[:, 2], full[:, 2], rtol=SOLVED)
    near(full[:, :2], 0, SOLVED * full.max())


def test_a_pushed_punch() -> None:
    m = coarse("pushed_punch")
    assert m.check() == []
    result = m.solve()
    force, moment = result.reference_force("punch")
    # The obstacle is pushed by 250, and balances the contacts in both directions.
    np.testing.assert_allclose(force[:, 1], -250, rtol=SOLVED)
    near(result.contact_force("block.top"), force, SOLVED * 250)
    assert moment.shape == (4, 0)
    motion, _ = result.reference_motion("punch")
    # The displacement along x is prescribed, and not part of this motion.
    np.testing.assert_array_equal(motion[:, 0], 0)
    assert (motion[:, 1] < 0).all()


@pytest.mark.parametrize("engine", ["direct", "iterative"])
@pytest.mark.parametrize("name", ["pushed_punch", "twisted_pad"])
@pytest.mark.slow_variants("pushed_punch-iterative")
def test_resumed_and_automatic_paths(name: str, engine: str, tmp_path: Path) -> None:
    m = coarse(name)
    m.solver(engine=engine, tol=1e-11)
    result, case = m.solve(), m.assemble()
    load, gap = (x if x is None else x[:2] for x in (case.load, case.gaps))
    part = case.problem().solve(load, case.prescribed[:2], tol=1e-11, gap=gap)
    part.save(tmp_path / "part.h5", displacements=True)
    rest = m.solve(start=bp.load(tmp_path / "part.h5"))
    assert bits(rest, result[2:])
    np.testing.assert_array_equal(rest.displacement, result.displacement[2:])
    automatic = m.with_(**{"path.automatic": True}).solve()
    if np.array_equal(automatic.s, np.arange(1.0, 5.0)):
        assert bits(automatic, result)
    else:
        assert automatic.s[-1] == 4


def gripped() -> bp.Model:
    """A block whose top follows a point that a moment turns."""
    m = block()
    m.remote("grip", on="it.top", move={"x": 0.01, "y": -0.01}, moment={"z": 0.1})
    return m


@pytest.mark.parametrize("name", ["pushed_punch", "twisted_pad", "gripped"])
@pytest.mark.slow_variants("pushed_punch")
def test_run_writes_the_files_of_the_model(name: str, tmp_path: Path) -> None:
    m = coarse(name)
    m.to_toml(tmp_path / "it.toml")
    assert bp.Model.from_toml(tmp_path / "it.toml") == m
    run = bipot("run", "it.toml", "--out", "one", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    result, solved = bp.load(tmp_path / "one" / "result.h5"), m.solve()
    assert bits(result, solved)
    nodes, u = solved.case.model.nodes, result.displacement[-1]
    assert result.mesh is not None
    np.testing.assert_array_equal(result.mesh.nodes, nodes)
    of_nodes = u[: nodes.size].reshape(nodes.shape)
    np.testing.assert_array_equal(result.mesh.of_nodes(u), of_nodes)
    solved.save(tmp_path / "saved.h5")
    assert bits(bp.load(tmp_path / "saved.h5"), solved)


@pytest.mark.parametrize("second", ["it.bottom", "it.left"])
def test_the_force_of_an_obstacle_acts_once(second: str) -> None:
    """Also if several contacts touch the obstacle, even the same one twice."""
    m = block()
    m.obstacle("wheel", sphere={"centre": [0.3, -2.0], "radius": 2.0}, force={"y": 3.0})
    m.support("it.top", x=0, y=0)
    for on in ("it.bottom", second):
        m.contact(on, against="wheel", mu=0.4)
    force, _ = m.solve().reference_force("wheel")
    np.testing.assert_allclose(force[:, 1], 3.0, rtol=SOLVED)


def test_remote_force_motion_and_distribution() -> None:
    m = block()
    at: Any = {"on": "it.top", "point": [0.4, 2.0]}
    pull, down = {"x": m.times(0.3, "pull")}, {"y": m.times(-0.01, "press")}
    m.remote("grip", **at, move=down, force=pull, moment={"z": 0.0})
    m.path(press=[1.0, 1.0], pull=[0.0, 1.0])
    assert m.check() == []
    result = m.solve()
    force, moment = result.reference_force("grip")
    near(force, -result.contact_force("it.bottom"), SOLVED * force.max())
    near(force[:, 0], [0, 0.3], SOLVED)
    near(moment, 0, SOLVED)
    motion, turn = result.reference_motion("grip")
    np.testing.assert_allclose(motion[:, 1], -0.01, rtol=1e-14)
    assert turn.shape == (2, 1)
    # The same by prescribing all that was found.
    m = block()
    moved = {"x": float(motion[0, 0]), "y": -0.01}
    m.remote("grip", **at, move=moved, turn={"z": float(np.rad2deg(turn[0, 0]))})
    near(m.solve().displacement[0], result.displacement[0], SOLVED * 0.01)
    # A distributed force is statically the same, and the surface deforms.
    m, plain = block(), block()
    m.remote("push", on="it.top", distributed=True, force={"y": -2.0}, point=[0.5, 1.0])
    plain.traction("it.top", y=-2.0)
    spread = m.solve()
    near(spread.displacement, plain.solve().displacement, 1e-14)
    with refused("there is no reference point 'push': the model"):
        spread.reference_motion("push")


def test_a_held_point_inside() -> None:
    m = block()
    m.support("it", at=[0.45, 0.55], x=0.02)
    m.pressure("it.top", 1.0)
    result = m.solve()
    case = result.case
    assert len(case.model.fixed) == 1
    held = case.model.nodes[case.model.fixed[0] // 2]
    np.testing.assert_array_equal(held, [0.5, 0.5])
    # Friction along the floor balances the force that holds the point.
    total = result.support_force("it") + result.contact_force("it.bottom")
    near(total, [[0, 1]], SOLVED)


def test_a_periodic_layer() -> None:
    """A half-space layer held by its neighbours: the constrained modulus."""
    m = block()
    m.periodic("it.left", "it.right")
    m.pressure("it.top", 2.0)
    u = m.solve().displacement[0].reshape(-1, 2)
    modulus = 1000 * 0.7 / (1.3 * 0.4)
    top = m.assemble().model.nodes[:, 1] == 1
    np.testing.assert_allclose(u[top, 1], -2 / modulus, rtol=SOLVED)


def remote(**table: Any) -> dict[str, Any]:
    return {"remote.a": {"on": "it.top"} | table}


def cyclic(onto: str, sectors: int) -> dict[str, Any]:
    return {"cyclic": [{"on": "it.left", "onto": onto, "sectors": sectors}]}


LID = {"plane": {"point": [0.0, 1.0], "normal": [0.0, -1.0]}, "force": {"y": 1.0}}
WRONG: list[tuple[dict[str, Any], str]] = [
    (remote(on="it.tpo", force={"x": 1.0}), "remote.a.on: there is no surface"),
    (remote(), "remote.a: needs move, turn, force or moment"),
    (remote(move={"x": 1.0}, force={"x": 1.0}), "remote.a.force.x: remove it or"),
    (remote(turn={"x": 1.0}), "remote.a.turn.x: remove it, in two dimensions the only"),
    (remote(distributed=True, move={"x": 1.0}), "remote.a.move: remove it, or"),
    (remote(force={"z": 1.0}), "remote.a.force.z: remove it, the scene has two"),
    (cyclic("it.left", 4), "cyclic.0.onto: should be"),
    (cyclic("it.bottom", 1), "cyclic.0.sectors: should"),
    (cyclic("it.bottom", 3), "surfaces it.left and it.bottom do not repeat each other"),
    (
        {"periodic": [{"on": "it.left", "onto": "it.rigth"}]},
        "periodic.0.onto: there is no surface",
    ),
    ({"support": [{"on": "it", "x": 0.0}]}, "support.0.on: is the whole body 'it';"),
    (
        {"support": [{"on": "it", "x": 0.0, "at": [0, 0, 0.0]}]},
        "support.0.at: should have 2 comp",
    ),
    ({"obstacle.o": LID | {"move": {"y": 1.0}}}, "obstacle.o.force.y: remove it or"),
    ({"obstacle.o": LID, "solver.engine": "petsc"}, "solver.engine: should not be"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG)
def test_mistakes(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(scene.SceneError) as error:
        block().with_(**changes).assemble()
    assert any(str(m).startswith(message) for m in error.value.mistakes), error.value
