"""Arguments of `bipot run` that are read without Typer: as Typer reads them."""

from pathlib import Path
from typing import Any

import pytest
import typer

from bipot_rs.cli import run_arguments
from bipot_rs.cli.app import app
from bipot_rs.cli.exit_codes import Ended


def command() -> Any:
    return typer.main.get_command(app).commands["run"]


def by_typer(words: list[str]) -> dict[str, Any]:
    """The parameters that Typer finds, without those that have their default."""
    context = command().make_context("run", list(words[1:]))
    defaults = command().make_context("run", ["SCENE"]).params
    given = {k: v for k, v in context.params.items() if v != defaults.get(k)}
    return {k: str(v) if isinstance(v, Path) else v for k, v in given.items()}


def test_names_are_those_of_the_command() -> None:
    known = {
        option: (parameter.name, bool(parameter.is_flag), bool(parameter.multiple))
        for parameter in command().params
        if parameter.param_type_name == "option"
        for option in parameter.opts
    }
    # Typer reads the engine: several processes must agree on it before any import.
    for name in ("--help", "--engine"):
        known.pop(name, None)
    flags = {
        option: (name, True, False) for option, name in run_arguments.FLAGS.items()
    }
    values = {
        option: (name, False, name == "settings")
        for option, name in run_arguments.VALUES.items()
    }
    assert known == flags | values


@pytest.mark.parametrize(
    "words",
    [
        ["a"],
        ["a.toml", "--json"],
        ["--json", "--plot", "a"],
        ["a", "--set", "mesh.n=4", "--set=contact.0.mu=0.3", "--out", "x y"],
        ["--set", "a=b=c", "a", "--tol=1e-9", "--method", "newton"],
        ["a", "--fclib", "--error", "--resume", "--out=x"],
    ],
)
def test_usual_arguments_are_read_as_by_typer(words: list[str]) -> None:
    assert run_arguments.plain(["run", *words]) == by_typer(["run", *words])


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["run"],
        ["check", "a"],
        ["run", "a", "b"],
        ["run", "a", "--help"],
        ["run", "a", "--tol"],
        ["run", "a", "--tol", "-1"],
        ["run", "a", "--tol=1", "--tol=2"],
        ["run", "a", "--out", ""],
        ["run", "a", "--out="],
        ["run", "a", "--json=1"],
        ["run", "a", "--json", "--json"],
        ["run", "a", "--jsn"],
        ["run", "a", "--engine", "direct"],
        ["run", "--", "a"],
        ["run", ""],
        ["run", "-"],
        ["--version", "run", "a"],
    ],
)
def test_all_others_are_left_to_typer(words: list[str]) -> None:
    assert run_arguments.plain(words) is None


def test_completions_are_left_to_typer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_BIPOT_COMPLETE", "complete_bash")
    assert run_arguments.plain(["run", "a"]) is None


def test_tol_that_is_no_number_is_refused() -> None:
    with pytest.raises(Ended, match=r"Invalid value for '--tol': 'x' is neither"):
        run_arguments.run(scene="pressed_block", tol="x")
