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
    result = blocks().solve(tol=1e-13)
    np.testing.assert_array_equal(result.parameter, [0.0, 1.0])
    through = result.contact_force("upper.bottom")
    pressed = np.array([[0.0, 0.0], [-5.0 * 2.0, 0.0]])
    weight = np.array([0.0, -0.1 * 4.0 * 2.0])
    # Sums of K u, of the size of K times u: ε times some of them.
    size = 1e-11 * 210e3 * 0.02
    near(through + result.support_force("upper.top") + pressed, 0, size)
    near(-through + result.support_force("lower.bottom") + weight, 0, size)
    assert (through[:, 1] > 0).all()
    assert (np.abs(through[:, 0]) <= 0.3 * through[:, 1] * (1 + 1e-9)).all()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(2))
def test_moments_balance_the_loads(d: int, seed: int, bipot: Any) -> None:
    """A block that contact alone holds, anywhere in space: table, method, steps.csv."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(-100, 100, d)
    m = bp.Model()
    m.material("steel", young=210e3, poisson=0.3)
    axes = {
        axis: {"from": low, "to": low + 40.0, "cells": 4}
        for axis, low in zip("xyz", at, strict=False)
    }
    cell = {2: "quadrilateral", 3: "hexahedron"}[d]
    m.body("b", material="steel", cell=cell, **axes)
    plane = {"point": at, "normal": np.eye(d)[-1].tolist()}
    m.contact("b.bottom", plane=plane, mu=0.5, name="foot")
    m.pressure("b.top", 10.0)
    for side in ("left", "front")[: d - 1]:
        m.traction(f"b.{side}", **dict(zip("xyz", rng.uniform(-1, 1, d), strict=False)))
    result = m.solve()
    x, force = result.case.model.nodes, result.case.load[-1].reshape(-1, d)
    within = 1e-9 * np.abs(x).max() * np.abs(force).sum()
    names = [f"moment_{axis} of foot" for axis in ("xyz" if d == 3 else "z")]
    if d == 3:
        wanted = -np.cross(x, force).sum(axis=0)
        centre = at + np.array([20.0, 20.0, 0.0])
        torque = -np.cross(x - centre, force).sum(axis=0)[2]
        about = result.contact_moment("foot", about=centre)[-1]
        assert about[2] == pytest.approx(torque, abs=within)
        names, values = [*names, "torque of foot"], [*wanted, torque]
    else:
        wanted = -np.array([x[:, 0] @ force[:, 1] - x[:, 1] @ force[:, 0]])
        values = wanted.tolist()
    near(result.contact_moment("foot")[-1], wanted, within)
    m.to_toml("b.toml")
    assert bipot("run", "b.toml", "--out", "out")[0] == 0
    (row,) = rows_of("out")
    near([float(row[name]) for name in names], values, within)
    assert ("torque of foot" in columns_of(result)) == (d == 3)


def rows_of(folder: str) -> list[dict[str, str]]:
    with (Path(folder) / "steps.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_body_of_revolution_has_no_moments(bipot: Any) -> None:
    changes = {"mesh.n": 4, "body.block.plane": "axisymmetric"}
    m = bp.Model.from_toml("pressed_block").with_(**changes)
    result = m.solve()
    with refused("cancel around its axis"):
        result.contact_moment("block.bottom")
    m.to_toml("ring.toml")
    assert bipot("run", "ring.toml", "--out", "out")[0] == 0
    columns = columns_of(result) + columns_of(bp.load("out/result.h5"))
    assert not [name for name in columns + list(rows_of("out")[0]) if "moment" in name]


def columns_of(result: Any) -> list[str]:
    table = result.table()
    return list(table.columns if hasattr(table, "columns") else table.dtype.names)


def test_names_of_contacts() -> None:
    m = blocks()
    (name,) = m.contacts
    assert name == "upper.bottom"
    result = m.solve()
    every = np.arange(result.reaction.shape[1])
    np.testing.assert_array_equal(result.contacts_of("upper.bottom"), every)
    with refused(r"no contact on 'upper.top', expected one of"):
        result.contact_force("upper.top")
    with refused(r"expected one of lower\.bottom"):
        result.support_force("upper.bottom")
    # A result keeps its names, and so its forces, through a pickle.
    assert result.displacement.any()
    again = pickle.loads(pickle.dumps(result))
    for name in ("upper.top", "lower.bottom"):
        ours, theirs = (r.support_force(name).tobytes() for r in (result, again))
        assert ours == theirs


def test_contacts_with_names(bipot: Any) -> None:
    """Two contacts of one surface: names in tables, files, options and keys."""
    m = bp.Model.from_toml("pressed_block").with_(**{"mesh.n": 4})
    m = m.with_(**{"contact.0.within": {"x": [0.0, 15.0]}})
    more = m.to_dict()["contact"][0] | {"within": {"x": [16.0, 40.0]}}
    m.contact(more.pop("on"), **more)
    # Without names, the surface is both.
    np.testing.assert_array_equal(m.contacts["block.bottom"], np.arange(5))
    m = m.with_(**{"contact.0.name": "left", "contact.1.name": "right"})
    np.testing.assert_array_equal(m.contacts["right"], np.arange(2, 5))
    changed = m.with_(**{"contact.*.mu": 0.2, "contact.right.mu": 0.5})
    assert [contact.mu for contact in changed.scene.contact] == [0.2, 0.5]
    result = changed.solve()
    both = result.contact_force("left") + result.contact_force("right")
    np.testing.assert_array_equal(both, result.contact_force("block.bottom"))
    assert list(result.contacts["surface_names"]) == ["left", "right"]
    m.to_toml("two.toml")
    keys = ("--set", "contact.*.mu=0.2", "--set", "contact.right.mu=0.5")
    assert bipot("run", "two.toml", *keys, "--out", "out")[0] == 0
    force = float(rows_of("out")[0]["normal_force of right"])
    assert force == pytest.approx(result.contact_force("right")[0, 1], rel=1e-9)
    assert bipot("plot", "out", "--contact", "right")[0] == 0
    status, _, err = bipot("plot", "out", "--on", "rigth")
    assert status == 2
    assert "expected one of left, right, did you mean 'right'?" in err


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
    with refused(re.escape(said)):
        _ = m.scene
    with refused(r"contact.1; none is 'b', expected one of "):
        m.with_(**{"contact.b.mu": 0.1})


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
@settings(max_examples=25, deadline=None)
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


@pytest.mark.parametrize("index", ["\u00b2", "\u0663", "9" * 5000, "1", ""])
def test_wrong_indices_of_list_entries(index: str) -> None:
    m = bp.Model.from_toml("pressed_block").with_(spring=[])
    key, said = (
        f"contact.{index}.mu",
        "contact is a list of 1 entry, expected contact.0",
    )
    if not index:
        key, said = "spring.0.normal", "spring has no entries"
    with pytest.raises(scene.SceneError) as caught:
        m.with_(**{key: 0.5})
    (mistake,) = caught.value.mistakes
    assert (mistake.key, mistake.message) == (key, said)


def test_lone_surrogates_are_refused(tmp_path: Path) -> None:
    """Half of a surrogate pair, as in strings from file names of other systems."""
    half, m = "caf\udce9", blocks()
    m._table["title"] = half
    with pytest.raises(UnicodeEncodeError):
        m.to_toml(tmp_path / "scene.toml")
    assert not list(tmp_path.iterdir())
    with refused("surrogates not allowed"):
        bp.Model.from_toml(f'title = "{half}"\n[mesh]\n')
    with refused("surrogates not allowed"):
        scene.read("pressed_block", [f"title={half}"])


def test_mistakes_give_the_messages_of_the_file(tmp_path: Path) -> None:
    one, other = blocks(), blocks()
    one.material("wood", young=-1.0, poisson=0.7)
    one.support("upper.top", w=3)
    one.contact("upper.bottom", mu="much")
    one.traction("upper.top", y=one.times("x", "shear"))
    # Mistakes that involve several tables give the same messages.
    plane = {"point": [0, 0, 0], "normal": [0, 0]}
    other.contact("upper.under", plane=plane, mu=0.1)
    other.body("a.b", material="tin", cell="triangle", x=[0, 1], y=[1, 0])
    for m, count in ((one, 5), (other, 6)):
        m.to_toml(tmp_path / "wrong.toml")
        with refused(f"has {count} mistakes") as of_model:
            m.solve()
        with pytest.raises(ValueError) as of_file:
            scene.read(str(tmp_path / "wrong.toml"))
        assert of_model.value.mistakes == of_file.value.mistakes
        assert len(of_model.value.mistakes) == count


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

    def stop(*_: Any) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        m.solve(on_step=stop)

    def through_a_file(result: Any, first: int) -> Any:
        """The first step of a result, which knows how many were before."""
        result[0].displacement  # noqa: B018 - kept by the step, and so in the file
        part = bp.ModelResult(result, result.case, first)
        part.steps = part.steps[:1]
        part.save(tmp_path / "part.h5")
        return bp.load(tmp_path / "part.h5")

    rest = m.solve(start=through_a_file(whole, 0))
    assert rest.reaction.tobytes() == whole.reaction[1:].tobytes()
    assert rest.parameter.tolist() == [0.5, 1.0]
    assert len(m.solve(start=rest)) == 0
    # If it is interrupted again, the file counts the steps before its own.
    last = m.solve(start=through_a_file(rest, 1))
    assert last.reaction.tobytes() == whole.reaction[2:].tobytes()
    with refused(r"start has 3 steps, but this path only 2"):
        blocks().solve(start=whole)
    with pytest.raises(TypeError, match="start is a Step, expected a Result"):
        m.solve(start=whole[0])
    other = blocks(shear=[0.0, 0.5]).solve()
    with refused(r"its (load|prescribed) is not that of load step 2"):
        blocks().solve(start=other)


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
