"""One model by Python, by TOML and by arrays gives the same bits."""

import csv
import doctest
import pickle
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import bipot_rs as bp
from bipot_rs import scene
from bipot_rs.scene import builder
from bipot_rs.scene.schema.root import Scene
from support import children
from support.body_models import blocks
from support.comparisons import near, refused


def test_units_of_a_model_are_those_of_its_result(tmp_path: Path) -> None:
    result = blocks().solve()
    assert result.units == {"length": "mm", "force": "N", "stress": "MPa"}
    result.save(tmp_path / "units.h5")
    assert bp.load(tmp_path / "units.h5").units == result.units


def test_automatic_steps_from_toml_and_python_are_equal(tmp_path: Path) -> None:
    m = blocks(automatic={"slip": 4e-4})
    m.to_toml(tmp_path / "blocks.toml")
    run = children.bipot("run", "blocks.toml", "--out", "here", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    result = m.solve()
    assert len(result) > 2
    read = bp.load(tmp_path / "here" / "result.h5")
    assert read.reaction.tobytes() == result.reaction.tobytes()
    assert read.s is not None
    assert result.s is not None
    assert read.s.tobytes() == result.s.tobytes()
    rest = m.solve(start=read[1])
    assert rest.reaction.tobytes() == result.reaction[2:].tobytes()


def test_forces_balance() -> None:
    """Supports, loads and contacts of each body, by their names."""
    m = blocks()
    result = m.solve(tol=1e-13)
    np.testing.assert_array_equal(result.parameter, [0.0, 1.0])
    through = result.contact_force("upper.bottom")
    held = {on: result.support_force(on) for on in ("upper.top", "lower.bottom")}
    pressed = np.array([[0.0, 0.0], [-5.0 * 2.0, 0.0]])
    weight = np.array([0.0, -0.1 * 4.0 * 2.0])
    # Sums of K u, of the size of K times u: ε times some of them.
    size = 210e3 * 0.02
    near(through + held["upper.top"] + pressed, 0, 1e-11 * size)
    near(-through + held["lower.bottom"] + weight, 0, 1e-11 * size)
    assert (through[:, 1] > 0).all()
    assert (np.abs(through[:, 0]) <= 0.3 * through[:, 1] * (1 + 1e-9)).all()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_moments_balance_the_loads(d: int, seed: int, bipot: Any) -> None:
    """A block that contact alone holds, anywhere in space: table, method, steps.csv."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(-100, 100, d)
    m = bp.Model()
    m.material("steel", young=210e3, poisson=0.3)
    cell = {2: "quadrilateral", 3: "hexahedron"}[d]
    axes = {
        axis: {"from": low, "to": low + 40.0, "cells": 4}
        for axis, low in zip("xyz", at, strict=False)
    }
    m.body("b", material="steel", cell=cell, **axes)
    up = np.eye(d)[-1].tolist()
    m.contact("b.bottom", plane={"point": at, "normal": up}, mu=0.5, name="foot")
    m.pressure("b.top", 10.0)
    sides = ("left", "front") if d == 3 else ("left",)
    for side in sides:
        m.traction(f"b.{side}", **dict(zip("xyz", rng.uniform(-1, 1, d), strict=False)))
    result = m.solve()
    x = result.case.model.nodes
    force = result.case.load[-1].reshape(-1, d)
    sizes = np.abs(x).max() * np.abs(force).sum()
    if d == 3:
        moment = -np.cross(x, force).sum(axis=0)
        centre = at + np.array([20.0, 20.0, 0.0])
        arms = x - centre
        torque = -np.cross(arms, force).sum(axis=0)[2]
        about = result.contact_moment("foot", about=centre)[-1]
        assert about[2] == pytest.approx(torque, abs=1e-9 * sizes)
    else:
        moment = -np.array([x[:, 0] @ force[:, 1] - x[:, 1] @ force[:, 0]])
        torque = None
    np.testing.assert_allclose(
        result.contact_moment("foot")[-1], moment, atol=1e-9 * sizes
    )
    m.to_toml("b.toml")
    assert bipot("run", "b.toml", "--out", "out")[0] == 0
    with Path("out/steps.csv").open() as file:
        (row,) = csv.DictReader(file)
    names = [f"moment_{axis}" for axis in ("xyz" if d == 3 else "z")]
    values = [float(row[f"{name} of foot"]) for name in names]
    np.testing.assert_allclose(values, moment, atol=1e-9 * sizes)
    if torque is not None:
        assert float(row["torque of foot"]) == pytest.approx(torque, abs=1e-9 * sizes)
    table = result.table()
    columns = table.columns if hasattr(table, "columns") else table.dtype.names
    assert ("torque of foot" in columns) == (d == 3)


def test_a_body_of_revolution_has_no_moments(bipot: Any) -> None:
    m = bp.Model.from_toml("pressed_block").with_(
        **{"mesh.n": 4, "body.block.plane": "axisymmetric"}
    )
    result = m.solve()
    assert not [name for name in columns_of(result) if "moment" in name]
    with refused("cancel around its axis"):
        result.contact_moment("block.bottom")
    m.to_toml("ring.toml")
    assert bipot("run", "ring.toml", "--out", "out", "--plot")[0] == 0
    assert "moment" not in Path("out/steps.csv").read_text()
    assert not [n for n in columns_of(bp.load("out/result.h5")) if "moment" in n]


def columns_of(result: Any) -> list[str]:
    table = result.table()
    return list(table.columns if hasattr(table, "columns") else table.dtype.names)


def test_names_of_contacts() -> None:
    m = blocks()
    (name,) = m.contacts
    assert name == "upper.bottom"
    result = m.solve()
    np.testing.assert_array_equal(
        result.contacts_of("upper.bottom"), np.arange(result.reaction.shape[1])
    )
    with refused(r"no contact on 'upper.top', expected one of"):
        result.contact_force("upper.top")
    with refused(r"expected one of lower\.bottom"):
        result.support_force("upper.bottom")


def test_several_contacts_of_one_surface() -> None:
    """Left and right halves on two planes: one name, and both tables."""
    m = bp.Model.from_toml("pressed_block").with_(**{"mesh.n": 4})
    table = m.to_dict()
    m = m.with_(**{"contact.0.within": {"x": [0.0, 15.0]}})
    more = table["contact"][0] | {"within": {"x": [16.0, 40.0]}, "mu": 0.5}
    m.contact(more.pop("on"), **more)
    case = m.assemble()
    assert sorted(set(case.model.group.tolist())) == [0, 1]
    np.testing.assert_array_equal(m.contacts["block.bottom"], np.arange(5))


def test_contacts_with_names(bipot: Any) -> None:
    """Two contacts of one surface: names in tables, files, options and keys."""
    m = bp.Model.from_toml("pressed_block").with_(**{"mesh.n": 4})
    first = {"contact.0.within": {"x": [0.0, 15.0]}, "contact.0.name": "left"}
    m = m.with_(**first)
    more = m.to_dict()["contact"][0] | {"within": {"x": [16.0, 40.0]}, "name": "right"}
    m.contact(more.pop("on"), **more)
    np.testing.assert_array_equal(m.contacts["right"], np.arange(2, 5))
    changed = m.with_(**{"contact.*.mu": 0.2, "contact.right.mu": 0.5})
    mus = [contact.mu for contact in changed.scene.contact]
    assert mus == [0.2, 0.5]
    result = changed.solve()
    both = result.contact_force("left") + result.contact_force("right")
    np.testing.assert_array_equal(both, result.contact_force("block.bottom"))
    assert list(result.contacts["surface_names"]) == ["left", "right"]
    m.to_toml("two.toml")
    keys = ("--set", "contact.*.mu=0.2", "--set", "contact.right.mu=0.5")
    assert bipot("run", "two.toml", *keys, "--out", "out")[0] == 0
    with Path("out/steps.csv").open() as file:
        (row, *_) = csv.DictReader(file)
    force = float(row["normal_force of right"])
    assert force == pytest.approx(result.contact_force("right")[0, 1], rel=1e-9)
    assert bipot("plot", "out", "--contact", "right")[0] == 0
    status, _, err = bipot("plot", "out", "--on", "rigth")
    assert status == 2
    assert "expected one of left, right, did you mean 'right'?" in err
    assert bipot("sweep", "two.toml", "--set", "contact.right.mu=0.1,0.5")[0] == 0


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["a", "a"], "contact.1.name: contact.0 has this name too"),
        (["a.b", "a"], "contact.0.name: should be letters, digits"),
        (["0", "a"], "contact.0.name: should be letters, digits"),
    ],
)
def test_wrong_names_of_contacts(names: list[str], said: str) -> None:
    m = bp.Model.from_toml("pressed_block")
    (table,) = m.to_dict()["contact"]
    m.contact(**table)
    m = m.with_(**{f"contact.{k}.name": name for k, name in enumerate(names)})
    with pytest.raises(scene.SceneError, match=re.escape(said)):
        _ = m.scene
    with pytest.raises(
        scene.SceneError, match=r"contact.1; none is 'b', expected one of "
    ):
        m.with_(**{"contact.b.mu": 0.1})


def test_a_result_keeps_its_names_through_a_pickle() -> None:
    result = blocks().solve()
    assert result.displacement.any()
    again = pickle.loads(pickle.dumps(result))
    for name in ("upper.top", "lower.bottom"):
        assert (
            again.support_force(name).tobytes() == result.support_force(name).tobytes()
        )


@pytest.mark.parametrize("name", scene.shipped())
def test_shipped_scenes_there_and_back(name: str) -> None:
    m = bp.Model.from_toml(name)
    again = bp.Model.from_toml(m.to_toml())
    assert again == m
    assert again.scene == scene.read(name)
    assert again.to_dict() == tomllib.loads(scene.text(name))


def test_changes_equal_those_of_the_command_line() -> None:
    m = bp.Model.from_toml("cattaneo_mindlin")
    changed = m.with_(**{"mesh.n": 24, "contact.0.mu": 0.5, "solver.tol": 1e-9})
    asked = ["mesh.n=24", "contact.0.mu=0.5", "solver.tol=1e-9"]
    assert changed.scene == scene.read("cattaneo_mindlin", asked)
    assert m == bp.Model.from_toml("cattaneo_mindlin")
    with refused("contact is a list of 1 entry"):
        m.with_(**{"contact.1.mu": 0.5})


def test_friction_of_a_solve_is_that_of_the_changed_model() -> None:
    m = bp.Model.from_toml("two_blocks").with_(**{"mesh.n": 4})
    solved, changed = m.solve(mu=0.5), m.with_(**{"contact.0.mu": 0.5}).solve()
    assert np.array_equal(solved.reaction, changed.reaction)
    assert (solved.contacts["mu"] == 0.5).all()
    with refused(r"contact\.0\.mu"):
        m.solve(mu=-1.0)


SIZES = st.floats(1e-3, 1e6)
NAMES = st.text(
    st.characters(exclude_categories=["Cs"], exclude_characters=".\n"), min_size=1
)


@given(
    st.lists(NAMES, min_size=1, max_size=3, unique=True),
    st.dictionaries(
        NAMES,
        st.tuples(SIZES, st.sampled_from([-0.9, -0.1, 0.0, 0.1, 1 / 3, 0.499])),
        min_size=1,
    ),
    st.lists(
        st.floats(-1e6, 1e6).filter(lambda v: v == 0 or abs(v) > 1e-50), min_size=1
    ),
    st.integers(1, 5),
)
@example(["|", "|one"], {"|many": (1.0, 0.1)}, [1.0], 2)
@settings(max_examples=40, deadline=None)
def test_random_models_there_and_back(
    bodies: list[str], materials: Any, factors: list[float], n: int
) -> None:
    m = bp.Model('A "model" of\tmany\\names', n=n)
    for name, (young, poisson) in materials.items():
        m.material(name, young=young, poisson=poisson)
    side = {"from": 0.0, "to": 1.0, "cells": "n"}
    for name in bodies:
        material = next(iter(materials))
        m.body(name, material=material, cell="triangle", x=side, y=[0.0, 0.1, 1.0])
        m.support(f"{name}.top", x=m.times(0.1, "moved"), within={"y": [0.0, 1.0]})
        m.contact(f"{name}.bottom", plane={"point": [0, 0], "normal": [0, 1]}, mu=0.1)
    m.path(moved=factors)
    again = bp.Model.from_toml(m.to_toml())
    assert again == m
    assert again.scene == m.scene


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("contact.\u00b2.mu", "contact is a list of 1 entry, expected contact.0"),
        ("contact.\u0663.mu", "contact is a list of 1 entry, expected contact.0"),
        (
            "contact." + "9" * 5000 + ".mu",
            "contact is a list of 1 entry, expected contact.0",
        ),
        ("contact.1.mu", "contact is a list of 1 entry, expected contact.0"),
        ("spring.0.normal", "spring has no entries"),
    ],
)
def test_wrong_indices_of_list_entries(key: str, said: str) -> None:
    m = bp.Model.from_toml("pressed_block")
    m._table["spring"] = []
    with pytest.raises(scene.SceneError) as caught:
        m.with_(**{key: 0.5})
    (mistake,) = caught.value.mistakes
    assert (mistake.key, mistake.message) == (key, said)


def test_lone_surrogates_are_refused(tmp_path: Path) -> None:
    """Half of a surrogate pair, as in strings from file names of other systems."""
    half = "caf\udce9"
    m = blocks()
    m._table["title"] = half
    with pytest.raises(UnicodeEncodeError):
        m.to_toml(tmp_path / "scene.toml")
    assert not list(tmp_path.iterdir())
    with pytest.raises(scene.SceneError, match="surrogates not allowed"):
        bp.Model.from_toml(f'title = "{half}"\n[mesh]\n')
    with pytest.raises(scene.SceneError, match="surrogates not allowed"):
        scene.read("pressed_block", [f"title={half}"])


def test_mistakes_give_the_messages_of_the_file(tmp_path: Path) -> None:
    m = blocks()
    m.material("wood", young=-1.0, poisson=0.7)
    m.support("upper.top", w=3)
    m.contact("upper.bottom", mu="much")
    m.traction("upper.top", y=m.times("x", "shear"))
    m.to_toml(tmp_path / "wrong.toml")
    with refused("has 5 mistakes") as of_model:
        m.solve()
    with pytest.raises(ValueError) as of_file:
        scene.read(str(tmp_path / "wrong.toml"))
    assert of_model.value.mistakes == of_file.value.mistakes
    assert any(m.key == "support.2.w" for m in of_model.value.mistakes)
    # Mistakes that involve several tables give the same messages.
    m = blocks()
    m.contact("upper.under", plane={"point": [0, 0, 0], "normal": [0, 0]}, mu=0.1)
    m.body("a.b", material="tin", cell="triangle", x=[0, 1], y=[1, 0])
    m.to_toml(tmp_path / "wrong.toml")
    with pytest.raises(ValueError) as of_model:
        m.assemble()
    with pytest.raises(ValueError) as of_file:
        scene.read(str(tmp_path / "wrong.toml"))
    assert of_model.value.mistakes == of_file.value.mistakes
    assert len(of_model.value.mistakes) == 6


def test_mistakes_reported_by_the_call_itself() -> None:
    m = blocks()
    with refused("body 'upper' is already defined"):
        m.body("upper", material="steel")
    with refused("three names, for length, force, stress"):
        bp.Model(units="mm")
    m.support("upper.top", x=object())
    with pytest.raises(TypeError, match="not TOML serializable"):
        m.to_toml()
    with refused("is neither a file nor one of"):
        bp.Model.from_toml("nowhere.toml")
    with refused("is not TOML"):
        bp.Model.from_toml("a = 1\nb = \n")


def test_interrupted_result_continues(tmp_path: Path) -> None:
    """After too few iterations, through a file, in several parts."""
    m = blocks(shear=[0.0, 0.5, 1.0])
    whole = m.solve()
    with pytest.raises(bp.NotConvergedError) as stopped:
        m.solve(max_iterations=1, method="uzawa")
    assert stopped.value.result.contact_force("upper.bottom").shape == (0, 2)

    class Stopped(Exception):
        pass

    def stop(k: int, step: Any) -> None:
        steps.append(step)
        if k == 0:
            raise Stopped

    steps: list[Any] = []
    with pytest.raises(Stopped):
        m.solve(on_step=stop)
    whole[0].displacement  # noqa: B018 - kept by the step, and so in the file
    part = bp.ModelResult(whole, whole.case)
    part.steps = part.steps[:1]
    part.save(tmp_path / "part.h5")
    rest = m.solve(start=bp.load(tmp_path / "part.h5"))
    assert rest.reaction.tobytes() == whole.reaction[1:].tobytes()
    assert rest.parameter.tolist() == [0.5, 1.0]
    assert len(m.solve(start=rest)) == 0
    # If it is interrupted again, the file counts the steps before its own.
    part = bp.ModelResult(rest, rest.case, 1)
    rest[0].displacement  # noqa: B018
    part.steps = part.steps[:1]
    part.save(tmp_path / "again.h5")
    last = m.solve(start=bp.load(tmp_path / "again.h5"))
    assert last.reaction.tobytes() == whole.reaction[2:].tobytes()
    with refused(r"start has 3 steps, but this path only 2"):
        blocks().solve(start=whole)
    with pytest.raises(TypeError, match="start is a Step, expected a Result"):
        m.solve(start=whole[0])


def test_a_start_from_another_path_is_refused() -> None:
    plain_blocks, other = blocks(), blocks(shear=[0.0, 0.5])
    whole = other.solve()
    with refused(r"its (load|prescribed) is not that of load step 2"):
        plain_blocks.solve(start=whole)


def test_the_schema_of_the_scene_is_json() -> None:
    told = Scene.model_json_schema(by_alias=True)
    assert {"body", "contact", "path"} <= told["properties"].keys()
    assert "automatic" in told["$defs"]["LoadPath"]["properties"]


def test_tol_of_the_mesh_is_refused() -> None:
    m = blocks()
    m.solver(tol="discretisation")
    with refused("expected a number; only `bipot run` computes"):
        m.solve()
    assert m.solve(tol=1e-8).success


def test_the_examples_of_the_docstrings() -> None:
    failed, tried = doctest.testmod(builder, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert tried >= 10
    assert failed == 0
