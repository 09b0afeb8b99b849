"""The commands new, check, info, plot and schema, and shell arguments."""

import csv
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import bipot_rs as bp
from bipot_rs.cli import app
from bipot_rs.cli.commands import check as checking
from bipot_rs.cli.commands.new import templates
from bipot_rs.cli.commands.schema import schema
from bipot_rs.cli.run import cost_forecast
from bipot_rs.cli.run.runner import ENGINES
from bipot_rs.plots.by_name import KINDS
from bipot_rs.scene import assemble, bodies, read
from bipot_rs.scene.library import shipped, text
from bipot_rs.scene.schema.root import Solver

SMALL = ("--set", "mesh.n=4")


@pytest.mark.parametrize("name", templates())
@pytest.mark.slow_variants("block")
def test_a_new_scene_runs_as_it_is(name: str, bipot: Any) -> None:
    # A mesh lies next to the scene, and is found from any folder.
    Path("there").mkdir()
    status, out, _ = bipot("new", "there/mine", "--template", name)
    files = "there/mine.toml" + " and there/mine.inp" * (name == "mesh")
    assert status == 0
    assert out == f"{files}: bipot check there/mine.toml, bipot run there/mine.toml\n"
    written = Path("there/mine.toml").read_text()
    # The comments explain the scene, and name the command that runs this file.
    assert written.count("#") > 15
    assert "bipot run there/mine.toml" in written
    assert written.startswith("#:schema ./bipot-scene.schema.json\n")
    status, out, _ = bipot("check", "there/mine.toml", "--json")
    assert status == 0
    assert json.loads(out)["remarks"] == []
    assert bipot("run", "there/mine.toml")[0] == 0
    # First all contacts stick, later some slip.
    with Path("out/mine/steps.csv").open(newline="") as file:
        first, *_, last = csv.DictReader(file)
    assert int(first["stick"]) > 0
    assert int(last["slip"]) > 0
    force, *_ = (float(last[key]) for key in last if key.startswith("friction"))
    # Dragged until all contacts slip, or nearly all.
    assert 0.9 < force <= 1 + 1e-12


@pytest.mark.parametrize(
    ("file", "words"),
    [("mine.toml", ()), ("mine.inp", ("--template", "mesh"))],
)
def test_new_overwrites_nothing(file: str, words: tuple[str, ...], bipot: Any) -> None:
    Path(file).write_text("mine")
    status, out, err = bipot("new", "mine", *words)
    assert (status, out) == (2, "")
    assert f"{file} exists already and is not overwritten" in err
    assert [path.name for path in Path().iterdir()] == [file]
    assert Path(file).read_text() == "mine"


def test_check_forecasts_a_run(bipot: Any) -> None:
    status, out, err = bipot("check", "sheared_cube", *SMALL, "--json")
    assert (status, err) == (0, "")
    report = json.loads(out)
    assert (report["dofs"], report["contacts"], report["steps"]) == (375, 25, 2)
    scene = read("sheared_cube", ["mesh.n=4"])
    stats = assemble(scene, bodies(scene)).model.problem().stats
    for name in ("n_contact_dofs", "nnz_factor", "flops", "bytes_factor", "bytes_peak"):
        assert report["forecast"][name] == stats[name]
    # Nothing was solved, nothing was written.
    assert list(Path().iterdir()) == []
    out = bipot("check", "sheared_cube", *SMALL)[1]
    assert "375 degrees of freedom, 75 prescribed, 25 contacts, 2 load steps" in out
    # Second-order cells also have nodes between the corners.
    for element, nodes in (("Q1", 5**3), ("Q2", 9**3)):
        more = ("--set", f"mesh.element={element}")
        out = bipot("check", "sheared_cube", *SMALL, *more)[1]
        assert f"cube ({nodes} nodes, 64 cells)" in out


def test_check_ends_before_the_factorisation(monkeypatch: pytest.MonkeyPatch) -> None:
    """The forecast of the factorisation ends the work."""
    ended = []
    original = cost_forecast._Counted

    class Counted(original):  # type: ignore[misc, valid-type]
        def __init__(self) -> None:
            ended.append(1)

    monkeypatch.setattr(cost_forecast, "_Counted", Counted)
    assert checking.check("sheared_cube", ["mesh.n=4"])["dofs"] == 375
    assert ended == [1]


def test_check_remarks() -> None:
    for settings, remark in (
        (
            ["contact.0.plane.point=[0,0,5]"],
            "25 of the 25 nodes of surface 'bottom' of body 'cube' start inside",
        ),
        (["contact.0.plane.point=[0,0,-500]"], "stays 500 away"),
        (
            [f"body.cube.{axis}.cells=4" for axis in "xyz"],
            "mesh.n: has no effect, since no formula uses it",
        ),
        (
            ["support.0.z=0.0", "path.amplitude.shear=[0.0, 0.0]"],
            "nothing moves: there is no load, all prescribed displacements",
        ),
    ):
        told = checking.check("sheared_cube", ["mesh.n=4", *settings])["remarks"]
        assert any(remark in line for line in told), told


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenes_have_no_remarks(name: str) -> None:
    assert checking.check(name, ["mesh.n=4"])["remarks"] == []


def test_scenes_have_titles_on_a_terminal(
    bipot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = bipot("scenes")[1].splitlines()
    assert names == shipped()
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    lines = bipot("scenes")[1].splitlines()
    assert [line.split()[0] for line in lines] == names
    assert "sheared_cube      Cube pressed onto a rigid plane, then sheared" in lines


def test_info(bipot: Any, repository: Path) -> None:
    assert bipot("run", "sheared_cube", *SMALL, "--json")[0] == 0
    for name in ("out/sheared_cube", "out/sheared_cube/result.h5"):
        assert "a result of sheared_cube, complete" in bipot("info", name)[1]
    report = json.loads(bipot("info", "out/sheared_cube", "--json")[1])
    assert (report["kind"], report["contacts"], report["steps"]) == ("result", 25, 2)
    assert sum(report["last"].values()) == 25
    assert 0 < report["residual"] <= report["tol"] == 1e-12
    for name in ("out/sheared_cube", *shipped()):
        status, out, _ = bipot("info", name)
        assert status == 0
        assert len(out.splitlines()) <= 10
    bar = repository / "examples" / "scenes" / "heated_bar.toml"
    out = bipot("info", str(bar))[1]
    assert "loads     2 symmetries, 1 strain" in out
    assert "bar.right against wall, mu 0.0" in out


def test_info_of_unreadable_paths(bipot: Any) -> None:
    Path("empty").mkdir()
    for name in ("text.h5", "K.dat"):
        Path(name).write_text("text")
    data = "K.dat is a file .dat, expected a result (.h5), a file for ParaView"
    for name, message in (
        ("gone.h5", "there is no gone.h5"),
        ("empty", "empty is a folder without result.h5"),
        ("gone.msh", "gone.msh does not exist"),
        ("K.dat", data),
        ("text.h5", "text.h5"),
        ("nothing", "neither a file nor one of"),
    ):
        status, out, err = bipot("info", name)
        assert (status, out) == (2, "")
        assert message in err
        report = json.loads(bipot("info", name, "--json")[1])
        assert report["ok"] is False
        assert message in report["message"]


def test_info_of_arrays_without_displacements(bipot: Any) -> None:
    """Python saves displacements unless told not to."""
    result = bp.solve(np.eye(2), np.eye(2), [[-1.0, 0.0]], gap=[0.0], mu=0.3)
    for more, told in (({"displacements": False}, None), ({}, 2)):
        result.save("plain.h5", **more)
        out = bipot("info", "plain.h5")[1]
        assert "  steps  1 load step\n" in out
        assert "  contacts  1 contact in the plane, at the end 0 open" in out
        report = json.loads(bipot("info", "plain.h5", "--json")[1])
        assert report["displacements"] == told
    assert np.array_equal(bp.load("plain.h5").displacement, result.displacement)


def test_info_of_meshes(bipot: Any, repository: Path) -> None:
    assert bipot("new", "pad", "--template", "mesh")[0] == 0
    out = bipot("info", "pad.inp")[1]
    for line in (
        "pad.inp: a mesh in 2 dimensions",
        "cells     quad (160 cells)",
        "189, [-10, 10] × [0, 10]",
        "volumes   pad (160 cells)",
        "surfaces  foot (20 facets), top (20 facets)",
        'use it    mesh = "pad.inp" in a scene',
    ):
        assert line in out
    shipped_one = repository / "docs" / "tutorials" / "pad_on_block.msh"
    report = json.loads(bipot("info", str(shipped_one), "--json")[1])
    assert (report["kind"], report["dim"], report["mistake"]) == ("mesh", 2, "")
    assert {"pad", "block"} <= set(report["volumes"])
    out = bipot("info", str(shipped_one))[1]
    use = r'mesh = \{ file = "pad_on_block.msh", group = "(pad|block)" \}'
    assert re.search(use, out)
    # An inverted cell is reported together with everything else.
    text = Path("pad.inp").read_text().replace("1, 1, 2, 23, 22", "1, 2, 1, 23, 22")
    Path("bad.inp").write_text(text)
    status, out, _ = bipot("info", "bad.inp")
    assert status == 0
    assert re.search("mistake   it has .* cell", out)
    Path("tool.stl").write_text(
        "solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"
        "vertex 0 2 0\nendloop\nendfacet\nendsolid t\n"
    )
    report = json.loads(bipot("info", "tool.stl", "--json")[1])
    assert (report["kind"], report["cells"]) == ("surface", {"triangle": 1})


def test_unknown_names_where_none_exist(bipot: Any) -> None:
    """The message says how to define one."""
    assert bipot("new", "mine", "--template", "block")[0] == 0
    text = Path("mine.toml").read_text()
    missing = "path.parameter: there is no amplitude 'drag': define it as path."
    for changed, told in (
        (
            re.sub(r"(?s)\[path.amplitude\].*", "", text),
            missing + "amplitude.drag = [1.0]",
        ),
        (
            text.replace("[material.steel]", "[material.stel]"),
            "there is no material 'steel', expected one of stel, did you mean 'stel'?",
        ),
    ):
        Path("mine.toml").write_text(changed)
        assert told in bipot("check", "mine.toml")[2]


@pytest.mark.slow
def test_plot_draws_each_kind(bipot: Any) -> None:
    """All kinds for a run in three dimensions, all different; no maps in the plane."""
    assert bipot("run", "sheared_cube", *SMALL, "--plot")[0] == 0
    folder = "out/sheared_cube"
    by_run = Path(f"{folder}/tractions.png").read_bytes()
    told = re.sub(r"[│\s]+", " ", bipot("plot", "--help")[1])
    drawn = {}
    for kind in KINDS:
        assert re.search(rf"\b{kind}\b", told), kind
        if kind == "wear":
            continue  # in scene/test_wear_scenes.py
        Path(f"{folder}/{kind}.png").unlink(missing_ok=True)
        # The default is what a run draws; title and units come from the file.
        asked = () if kind == "tractions" else ("--kind", kind)
        status, out, _ = bipot("plot", folder, *asked)
        assert (status, out) == (0, f"{folder}/{kind}.png\n")
        drawn[kind] = Path(f"{folder}/{kind}.png").read_bytes()
    assert len(set(drawn.values())) == len(drawn)
    assert drawn["tractions"] == by_run
    steps = {}
    for kind in ("slip", "pressure_3d"):
        for k in (1, 2):
            asked = ("--kind", kind, "--step", str(k), "--out", "step.png")
            assert bipot("plot", folder, *asked)[0] == 0
            steps[kind, k] = Path("step.png").read_bytes()
        assert steps[kind, 2] == drawn[kind]
    assert len(set(steps.values())) == 4
    # The unit of the scene, which is text in this format.
    svg = ("--kind", "shear_map", "--out", "m.svg")
    assert bipot("plot", f"{folder}/result.h5", *svg)[0] == 0
    assert "shear traction [MPa]" in Path("m.svg").read_text()
    assert bipot("run", "pressed_block", *SMALL)[0] == 0
    assert bipot("plot", "out/pressed_block", "--kind", "slip")[0] == 0
    for words, message in (
        ((folder, "--step", "0"), "--step is 0, expected one from 1 to 2"),
        ((folder, "--step", "3"), "--step is 3, expected one from 1 to 2"),
        (
            (folder, "--kind", "resultants", "--step", "1"),
            "--step cannot be used with",
        ),
        ((folder, "--kind", "traction"), "did you mean 'tractions'?"),
        (("nowhere",), "there is no nowhere"),
        ((folder, "--out", "a.doc"), "cannot draw a.doc"),
        ((folder, "--out", "no/a.png"), "cannot write no/a.png"),
        (
            ("out/pressed_block", "--kind", "gap_map"),
            "the contacts have two dimensions",
        ),
    ):
        status, out, err = bipot("plot", *words)
        assert (status, out) == (2, "")
        assert message in err


def test_schema_takes_what_bipot_takes(bipot: Any, repository: Path) -> None:
    status, out, _ = bipot("schema")
    assert status == 0
    whole = json.loads(out)
    assert whole["$schema"].endswith("2020-12/schema")
    Draft202012Validator.check_schema(whole)
    validator = Draft202012Validator(whole)
    scenes = {name: text(name) for name in shipped()}
    for file in (repository / "examples" / "scenes").glob("*.toml"):
        scenes[file.stem] = file.read_text()
    for name in templates():
        assert bipot("new", name, "--template", name)[0] == 0
        scenes[name] = Path(f"{name}.toml").read_text()
    for name, source in scenes.items():
        assert validator.is_valid(tomllib.loads(source)), name


def test_schema_refuses_what_bipot_refuses() -> None:
    validator = Draft202012Validator(schema())
    assert validator.is_valid(tomllib.loads(text("sheared_cube")))
    changes: list[Callable[[Any], Any]] = [
        lambda t: t.pop("material"),
        lambda t: t["mesh"].update(m=3),
        lambda t: t["mesh"].update(n=0),
        lambda t: t["body"]["cube"].update(cell="hex"),
        lambda t: t["body"]["cube"]["x"].update(growth={}),
        lambda t: t["support"][0].update(x=[1.0]),
        lambda t: t["contact"][0].update(mu=-0.1),
        lambda t: t["contact"][0].update(friction=0.1),
        lambda t: t["path"]["amplitude"].update(shear=[]),
        lambda t: t["material"]["steel"].update(poisson=0.5),
    ]
    for number, change in enumerate(changes):
        table = tomllib.loads(text("sheared_cube"))
        change(table)
        assert not validator.is_valid(table), number


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("bipot sw", {"sweep"}),
        ("bipot run sh", {"sheared_cube"}),
        ("bipot run --pl", {"--plot"}),
        ("bipot solve --engine ", {"auto", "direct", "iterative"}),
        ("bipot fclib --method uz", {"uzawa", "uzawa_two_projection"}),
        ("bipot plot out/a --kind status_s", {"status_shares"}),
        ("bipot new --template mo", {"mortar"}),
        ("bipot sweep --join a --o", {"--out"}),
    ],
)
@pytest.mark.quick_variants("bipot run sh*", "bipot fclib*")
def test_shells_complete(line: str, found: set[str], tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")
    asked = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "COMP_LINE": line}
    done = subprocess.run(
        # argcomplete writes to stream 8, and remarks to stream 9.
        ["bash", "-c", '"$0" -m bipot_rs 8>&1 9>&2', sys.executable],
        env=os.environ | asked | {"COMP_POINT": str(len(line))},
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
    )
    assert set(done.stdout.split()) == found


def test_every_command_has_help(bipot: Any) -> None:
    _, out, _ = bipot("--help")
    assert bipot()[1] == out
    for name in app.COMMANDS:
        assert re.search(rf"^  {name} ", out, re.MULTILINE)
        status, told, err = bipot(name, "--help")
        assert (status, err) == (0, "")
        assert told.startswith(f"usage: bipot {name} ")
    assert "DIR..." in bipot("sweep", "--join", "--help")[1]
    assert "--x COLUMN" in bipot("plot", "--x", "mu", "--help")[1]
    assert bipot("--version")[1] == f"bipot-rs {bp.__version__}\n"
    assert get_args(Solver.model_fields["engine"].annotation) == ENGINES


def test_options_may_stand_between_arguments(bipot: Any) -> None:
    status, out, _ = bipot("fclib", "a.hdf5", "--json", "b.hdf5", "--tol=1e-8")
    assert status == 2
    files = [json.loads(line)["file"] for line in out.splitlines()]
    assert files == ["a.hdf5", "b.hdf5"]
