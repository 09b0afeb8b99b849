"""The arguments of ``bipot run``, read without Typer where nothing is to be explained.

The import of Typer takes a tenth of the time of a small run. `plain` reads the usual
arguments; for all others, among them every mistake, it returns None, and Typer reads them
and explains. A test compares the names with those of the command in `app`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bipot_rs.cli.commands.names import ENOUGH
from bipot_rs.cli.exit_codes import BAD_INPUT, Ended

if TYPE_CHECKING:
    from bipot_rs.cli.interrupts import Interrupts

# Options and the parameters of `run`.
FLAGS = {
    "--json": "json",
    "--plot": "plot",
    "--fclib": "export",
    "--error": "error",
    "--resume": "resume",
}
VALUES = {"--set": "settings", "--out": "out", "--method": "method", "--tol": "tol"}
# With this variable the shell asks for completions.
_COMPLETION = "_BIPOT_COMPLETE"


def plain(arguments: Sequence[str]) -> dict[str, Any] | None:
    """Parameters of `run` from the words of a command line; None if Typer must read it."""
    if list(arguments[:1]) != ["run"] or _COMPLETION in os.environ:
        return None
    found: dict[str, Any] = {}
    words = iter(arguments[1:])
    value: Any
    for word in words:
        option, equals, value = word.partition("=")
        if option in VALUES:
            value = value if equals else next(words, "")
            # An empty value, or one that looks like an option.
            if not value or value.startswith("-"):
                return None
            name = VALUES[option]
            if name == "settings":
                found.setdefault(name, []).append(value)
                continue
        elif word in FLAGS:
            name, value = FLAGS[word], True
        elif word and not word.startswith("-"):
            name, value = "scene", word
        else:
            return None
        if name in found:
            return None
        found[name] = value
    return found if "scene" in found else None


def run(
    *,
    scene: str,
    settings: Sequence[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    method: str | None = None,
    engine: str | None = None,
    tol: str | None = None,
    json: bool = False,
    plot: bool = False,
    export: bool = False,
    error: bool = False,
    resume: bool = False,
    interrupts: Interrupts | None = None,
) -> int:
    """Run the scene; returns the exit status. The arguments are those of the command."""
    from bipot_rs.cli.commands.run import Job, Request

    request = Request(
        scene=scene,
        settings=settings or [],
        folder=Path("out") / Path(scene).stem if out is None else Path(out),
        method=method,
        engine=engine,
        tol=_tol(tol),
        plot=plot,
        fclib=export,
        resume=resume,
        error=error,
    )
    return Job(request, as_json=json, interrupts=interrupts).run()


def _tol(given: str | None) -> float | str | None:
    if given is None or given == ENOUGH:
        return given
    try:
        return float(given)
    except ValueError:
        raise Ended(
            BAD_INPUT,
            f"Invalid value for '--tol': {given!r} is neither a number nor {ENOUGH}",
        ) from None
