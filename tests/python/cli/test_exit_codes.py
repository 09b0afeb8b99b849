"""Every error of every command has a message and, with --json, a line."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import bipot_rs as bp
from bipot_rs.cli.entry import call
from bipot_rs.cli.exit_codes import FAULT
from support.faulty_scenes import FLOOR, Faulty, block, faulty, late, pair
from support.methods import METHODS
from support.rollers import roller
from support.runs import LAST_LINE

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
    step = every if isinstance(every, int) else every.get(name, 4)
    scenes = list(faulty(tmp_path, roller()))[::step]
    assert len(scenes) > 70 / step - 1
    for scene in scenes:
        options = [word for setting in scene.settings for word in ("--set", setting)]
        if name == "sweep" and any("=" not in setting for setting in scene.settings):
            options = []
        command = COMMANDS[name](scene, options)
        statuses = set()
        for more in ([], ["--json"]) if name in JSON else ([],):
            status, out, err = bipot(*command, *more)
            said([*command, *more], status, out, err)
            statuses.add(status)
        (status,) = statuses
        if name in ("run", "check"):
            solved_only = scene.name.removesuffix(".toml") in SOLVED_ONLY
            passes = name == "check" and solved_only
            assert status == (0 if passes else scene.status), (command, out, err)
        elif name not in MAY_PASS and name != "sweep":
            assert status == 2, command


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
def test_unknown_options(command: str, bipot: Bipot) -> None:
    for arguments in ([command, "--bogus"], [command, "a", "b", "c", "--bogus"]):
        status, out, err = bipot(*arguments, "--json")
        assert (status, err == "") == (2, command != "fclib")
        (last,) = map(json.loads, out.splitlines())
        assert last["message"]
        assert last["success"] is False


SMALL = ("sheared_cube", "--set", "mesh.n=2")
# A setting of `sheared_cube`, and what is said about it.
SETTINGS = [
    ('material.steel.young="7E"', "material.steel.young: should be a valid number,"),
    ('support.0.z="x"', "support.0.z: should be a valid number"),
    ('support.0.z={ value = "x" }', "support.0.z.value: should be a valid number"),
    (
        'pressure=[{ on = "cube.top", value = { amplitude = "a" } }]',
        "pressure.0.value: should be a valid number; write amplitude as a key",
    ),
    ('path.amplitude.press=[1.0, "x"]', "path.amplitude.press.1: should be a valid"),
    ("n=6", "n: unknown key, did you mean mesh.n?"),
    ("mesh.N=6", "did you mean mesh.n?"),
    ("mu=0.1", "did you mean contact.0.mu?"),
    ("material.steel.youngs=1", "did you mean material.steel.young?"),
    ("material.steel.E=1", "unknown key, expected one of young, poisson"),
    ("material.steal.young=1", "there is no material 'steal', expected one of steel,"),
    ("contact.mu=0.1", "contact is a list of 1 entry, expected contact.0"),
]
# Words of a command, and its message, or all parts of it.
WRONG: list[tuple[tuple[str, ...], str | tuple[str, ...]]] = [
    (("--verson",), "there is no option --verson, did you mean '--version'?"),
    (("--", "run"), "there is no option --;"),
    (("walk",), "walk"),
    (("run",), "required: SCENE; bipot run --help lists the"),
    (("sheared_cube",), "to solve a scene: bipot run sheared_cube"),
    (("mine.toml",), "to solve a scene: bipot run mine.toml"),
    (("mine",), "to solve a scene: bipot run mine.toml"),
    (("torque",), "bipot --help lists the commands"),
    (("chek", "sheared_cube"), "did you mean 'check'"),
    (("run", "shered_cube"), "did you mean 'sheared_cube'?"),
    (("run", "SHEARED-CUBE"), "did you mean 'sheared_cube'?"),
    (("run", "sheared_cube.toml"), "did you mean 'sheared_cube'?"),
    (("run", "mein.toml"), "did you mean 'mine.toml'?"),
    (("run", "mine"), "did you mean 'mine.toml'?"),
    (("run", "."), "is a folder, expected a TOML file"),
    (("run", *SMALL, "--set", "mesh.n", "6"), "--set takes KEY=VALUE in one piece"),
    (("run", *SMALL, "--out", "mine.toml"), "mine.toml is a file, expected a folder"),
    (("scenes", "two_block"), "did you mean 'two_blocks'?"),
    *((("run", "sheared_cube", "--set", setting), said) for setting, said in SETTINGS),
    (("run", "a", "b"), "unexpected argument b"),
    (("run", "a", "--tol", "x"), "'x' is not a number, nor discretisation"),
    (("run", "a", "--engine", "x"), "argument --engine: invalid choice: 'x'"),
    (("run", "a", "--jsn"), "there is no option --jsn, did you mean '--json'?"),
    (("run", "two_blocks", "--set", "mesh.n=9"), "not a whole number of cells"),
    (("run", *SMALL, "--method", "newtom"), "did you mean 'newton'?"),
    (("run", *SMALL, "--tol", "2"), "tol is 2, expected a positive number below 1"),
    (
        ("run", "sheared_cube", "--out", "mine.toml/below"),
        ("cannot write to the folder", "choose another with --out DIR"),
    ),
    (
        ("solve", "--stiffness", "K.mtx", "--contacts", "c.csv"),
        ": No such file or directory",
    ),
    (("fclib",), "FILE"),
    (("fclib", "--nonsense", "a"), "--nonsense"),
    (("fclib", "--tol"), "argument --tol: expected one argument; bipot fclib --help"),
    (("fclib", "a", "--tol", "x"), "argument --tol: 'x' is not a number"),
    (("fclib", "a", "--tol", "0"), "tol is 0"),
    (("fclib", "a", "--max-seconds", "-1"), "max_seconds is -1"),
    (("fclib", "a", "--method", "best"), METHODS),
    (("sweep", "a", "--jobs", "0"), "argument --jobs: '0' is not a positive integer"),
    (("sweep", "two_blocks"), "nothing varies"),
    (("sweep", *SMALL, "--range", "a=1:2"), "has 2 parts instead of three"),
    (("sweep", *SMALL, "--set", "mesh.m=1,2"), "mesh.m: unknown key"),
    (("sweep", *SMALL, "--set", "contact.0.mu"), "expected KEY=V1,V2"),
    (("sweep", *SMALL, "--method", "newtom"), "did you mean 'newton'?"),
    (("sweep", *SMALL, "--resume"), "cannot resume: there is no"),
    (
        ("sweep", "sheared_cube", "--range", "mesh.n=4:9:4"),
        (
            "--range mesh.n=4:9:4: mesh.n takes integers, but this is 4 values, ",
            "4, 5.66667, 7.33333, 9: the third number is the number of values",
        ),
    ),
    (("sweep", "a", "two_blocks"), "unexpected argument two_blocks"),
    (
        ("sweep", *SMALL, "--scheduler", "tcp://localhost:8786", "--jobs", "2"),
        "--jobs cannot be used with --scheduler",
    ),
    (("sweep", "--join", "a", "--jobs", "2"), "there is no option --jobs"),
    (("plot", "a", "--where", "b"), "no option --where, did you mean '--on'?"),
    (("new", "--template", "tow_bodies"), "did you mean 'two_bodies'?"),
    (("new", "nowhere/mine"), "cannot write nowhere/mine.toml: No such file"),
]


@pytest.mark.parametrize(("words", "message"), WRONG)
def test_wrong_words_have_a_message(
    words: tuple[str, ...],
    message: str | tuple[str, ...],
    bipot: Bipot,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Before meshing: nothing is printed as a result, and no file is written."""

    def never(*_: object) -> None:
        raise AssertionError("the mesh is made")

    monkeypatch.setattr("bipot_rs.scene.build.bodies", never)
    Path("mine.toml").touch()
    parts = (message,) if isinstance(message, str) else message
    status, out, err = bipot(*words)
    assert (status, out) == (2, "")
    assert err.startswith("bipot: ")
    assert all(part in err for part in parts)
    if words[0] in JSON:
        status, out, err = bipot(*words, "--json")
        assert (status, err == "") == (2, words[0] != "fclib")
        last = json.loads(out.splitlines()[-1])
        assert all(part in last["message"] for part in parts)
        assert last["success"] is False
        assert words[0] != "run" or last.keys() == LAST_LINE
    files = [path for path in Path().rglob("*") if path.is_file()]
    assert files == [Path("mine.toml")]


@pytest.mark.parametrize(
    ("place", "command"),
    [
        ("scene.reading.read", ("run", "two_blocks")),
        ("cli.commands.check.check", ("check", "two_blocks")),
        ("cli.commands.info.summarise", ("info", "two_blocks")),
        ("scene.library.shipped", ("scenes",)),
        ("cli.commands.schema.schema", ("schema",)),
    ],
)
def test_an_internal_error_has_a_message(
    place: str, command: tuple[str, ...], bipot: Bipot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its status is not 1, as Python's own would be: 1 means that no answer exists."""

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr(f"bipot_rs.{place}", broken)
    status, out, err = bipot(*command)
    assert (status, out) == (FAULT, "")
    assert err == (
        "bipot: internal error of bipot, ZeroDivisionError: division by zero; please "
        "report it with the traceback that BIPOT_TRACEBACK=1 prints\n"
    )
    if command[0] in JSON:
        status, out, err = bipot(*command, "--json")
        assert (status, err) == (FAULT, "")
        assert "ZeroDivisionError" in json.loads(out)["message"]
    monkeypatch.setenv("BIPOT_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        call(list(command))


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
