"""Every error of every command has a message and, with --json, a line."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import bipot_rs as bp
from bipot_rs.cli.commands import check as checking
from bipot_rs.cli.entry import call
from bipot_rs.cli.exit_codes import FAULT
from support.faulty_scenes import FLOOR, Faulty, block, faulty, late, pair
from support.rollers import roller

Bipot = Callable[..., tuple[int, str, str]]

# Arguments of each command for a scene, and the commands with --json.
COMMANDS: dict[str, Callable[[Faulty, list[str]], list[str]]] = {
    "run": lambda scene, given: ["run", scene.name, *given],
    "check": lambda scene, given: ["check", scene.name, *given],
    "sweep": lambda scene, given: [
        *("sweep", scene.name, *given, "--jobs", "1"),
        *("--range", "solver.tol=1e-8:1e-8:1"),
    ],
    "info": lambda scene, _: ["info", scene.name],
    "scenes": lambda scene, _: ["scenes", scene.name],
    "plot": lambda scene, given: ["plot", scene.name, "--scene", scene.name, *given],
    "new": lambda scene, _: ["new", scene.name],
    "fclib": lambda scene, _: ["fclib", scene.name],
    "solve": lambda scene, _: [
        *("solve", "--stiffness", scene.name, "--contacts", scene.name),
    ],
}
JSON = ("run", "check", "sweep", "info", "fclib", "solve")
# They accept any text in the file, or take no settings.
MAY_PASS = ("info", "scenes", "new")
# Loads that contact cannot carry.
NOT_CARRIED = ("pulled_away", "pushed_along_ice")
# Mistakes that only solving shows, so that a check passes.
SOLVED_ONLY = ("out_of_iterations",)


def said(command: list[str], status: int, out: str, err: str) -> str:
    """Check the message of an exit with an error, and return it."""
    assert status in (0, 1, 2, 3), (command, status, out, err)
    assert "Traceback" not in out + err
    assert "internal error of bipot" not in out + err
    if "--json" not in command:
        if status == 0:
            return ""
        # A sweep prints the messages of failed rows below its table.
        first = [*err.splitlines(), *(["bipot: " + out] if "\nrow 1: " in out else [])]
        assert any(line.startswith("bipot: ") and len(line) > 20 for line in first), (
            command
        )
        return err
    lines = [json.loads(line) for line in out.splitlines()]
    assert lines, command
    if status:
        assert len(lines[-1]["message"]) > 10
        assert not lines[-1].get("ok", False)
        assert not lines[-1].get("success", False)
    return str(lines[-1].get("message", ""))


# Commands that read scenes get every fault, other commands each fourth, and a sweep each
# eighth, because each of its rows starts a process.
SHARE = {"run": 1, "check": 1, "sweep": 8}


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize(
    "every", [SHARE, pytest.param(1, marks=pytest.mark.slow, id="all")]
)
@pytest.mark.quick_variants("*-new", "*-scenes", "all-*")
def test_all_commands_over_faulty_scenes(
    name: str, every: dict[str, int] | int, bipot: Bipot, tmp_path: Path
) -> None:
    count = 0
    step = every if isinstance(every, int) else every.get(name, 4)
    for scene in list(faulty(tmp_path, roller()))[::step]:
        options_of_scene = [
            word for setting in scene.settings for word in ("--set", setting)
        ]
        if name == "sweep" and any("=" not in setting for setting in scene.settings):
            options_of_scene = []
        command = COMMANDS[name](scene, options_of_scene)
        statuses = set()
        for more in ([], ["--json"]) if name in JSON else ([],):
            status, out, err = bipot(*command, *more)
            said([*command, *more], status, out, err)
            statuses.add(status)
        assert len(statuses) == 1, command
        (status,) = statuses
        if name in ("run", "check"):
            is_read = (
                name == "run" or scene.name.removesuffix(".toml") not in SOLVED_ONLY
            )
            assert status == (scene.status if is_read else 0), (command, out, err)
        elif name not in MAY_PASS and name != "sweep":
            assert status == 2, command
        count += 1
    assert count > 70 / step - 1


@pytest.mark.parametrize(
    ("name", "model"),
    [(name, model) for name, model, status in late() if status == 1],
    ids=[name for name, _, status in late() if status == 1],
)
def test_check_of_floating_bodies(name: str, model: bp.Model, bipot: Bipot) -> None:
    """The message is that of a run, and the sizes are reported too."""
    model.to_toml("it.toml")
    status, out, err = bipot("check", "it.toml")
    report = json.loads(bipot("check", "it.toml", "--json")[1])
    ran = json.loads(bipot("run", "it.toml", "--json")[1].splitlines()[-1])
    assert report["dofs"] == ran["dofs"] > 0
    assert report["contacts"] == ran["contacts"] > 0
    assert (report["steps"], report["bodies"]) == (1, len(model.to_dict()["body"]))
    if name in SOLVED_ONLY:
        assert (status, report["ok"]) == (0, True)
        return
    assert (status, report["ok"]) == (1, False)
    assert f"{report['dofs']} degrees of freedom" in out
    assert report["message"] in err
    assert report["message"] not in report["remarks"]
    if name in NOT_CARRIED:
        # Of many motions, each names one.
        for words in (report["message"], ran["message"]):
            assert "load step 1 of 1: no solution exists: contact cannot carry" in words
        return
    assert report["message"] == ran["message"].partition(" (load steps")[0]
    assert "can move freely" in report["message"]


@pytest.mark.parametrize("pairing", ["match", "mortar", "nodes"])
def test_check_of_two_bodies_does_not_depend_on_the_mesh(
    pairing: str, bipot: Bipot
) -> None:
    """The order of elimination depends on the mesh; the message does not."""
    for cells in (2, 3, 4, 7) if pairing != "match" else (2,):
        pair(pairing, cells=cells).to_toml("it.toml")
        status, _, err = bipot("check", "it.toml")
        assert status == 1
        assert "bodies 'block' and 'base' can move freely" in err


@pytest.mark.parametrize("command", list(COMMANDS))
def test_wrong_arguments(command: str, bipot: Bipot) -> None:
    for arguments in ([command, "--bogus"], [command, "a", "b", "c", "--bogus"]):
        status, out, err = bipot(*arguments)
        assert (status, out) == (2, "")
        assert err.startswith("bipot: ")
        status, out, err = bipot(*arguments, "--json")
        assert (status, err == "") == (2, command != "fclib")
        (last,) = map(json.loads, out.splitlines())
        assert last["message"]
        assert last["success"] is False


@pytest.mark.parametrize(
    "arguments",
    [
        ("fclib", "it.hdf5", "--method", "magic"),
        ("fclib", "it.hdf5", "--tol", "-1"),
        ("solve", "--stiffness", "K.mtx", "--contacts", "c.csv", "--method", "magic"),
        ("sweep", "two_blocks"),
        ("sweep", "two_blocks", "--range", "a=1:2"),
        ("run", "two_blocks", "--tol", "much"),
    ],
)
def test_wrong_settings(arguments: tuple[str, ...], bipot: Bipot) -> None:
    status, out, err = bipot(*arguments, "--json")
    assert (status, err == "") == (2, arguments[0] != "fclib")
    assert json.loads(out.splitlines()[-1])["message"]


@pytest.mark.parametrize("command", ["run", "check", "info", "scenes", "schema"])
def test_an_internal_error_has_a_message(
    command: str, bipot: Bipot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its status is not 1, as Python's own would be: 1 means that no answer exists."""

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("division\nby zero")

    places = {
        "run": "bipot_rs.scene.reading.read",
        "check": "bipot_rs.cli.commands.check.check",
        "info": "bipot_rs.cli.commands.info.summarise",
        "scenes": "bipot_rs.scene.library.shipped",
        "schema": "bipot_rs.cli.commands.schema.schema",
    }
    monkeypatch.setattr(places[command], broken)
    name = [] if command in ("scenes", "schema") else ["two_blocks"]
    status, out, err = bipot(command, *name)
    assert (status, out) == (FAULT, "")
    assert err == (
        "bipot: internal error of bipot, ZeroDivisionError: division by zero; please "
        "report it with the traceback that BIPOT_TRACEBACK=1 prints\n"
    )
    if name:
        status, out, err = bipot(command, *name, "--json")
        assert (status, err) == (FAULT, "")
        assert "ZeroDivisionError" in json.loads(out)["message"]
    monkeypatch.setenv("BIPOT_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        call([command, *name])


def test_displacements_that_cannot_be_found(
    bipot: Bipot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Earlier steps are kept, and the exit status is "not converged"."""
    from bipot_rs.contact.path import direct

    m = block()
    m.support("block.top", x=m.times(0.01, "go"), y=-0.1)
    m.contact("block.bottom", plane=FLOOR, mu=0.3)
    m.path(go=[0.0, 1.0, 2.0])
    m.to_toml("it.toml")
    original = direct.DirectRecovery.recover

    def lost(self: Any, steps: Any) -> Any:
        if any(step.prescribed.max() > 0.015 for step in steps):
            raise bp.NotConvergedError("the compliance W has too few digits")
        return original(self, steps)

    monkeypatch.setattr(direct.DirectRecovery, "recover", lost)
    status, out, err = bipot("run", "it.toml", "--json")
    assert (status, err) == (3, "")
    last = json.loads(out.splitlines()[-1])
    assert last["message"] == (
        "load step 3: the compliance W has too few digits (load steps in out/it: 2)"
    )
    kept = bp.load("out/it/result.h5")
    assert (len(kept), kept.success) == (2, False)


def test_checking_keeps_its_figures() -> None:
    report = checking.check("two_blocks", ["mesh.n=2"])
    assert report["floating"] is None
    assert report["forecast"]["seconds"] >= 0
