"""The command `bipot`: its commands, and the words of a command line.

Exit status: 0 solved, 1 no answer exists, 2 bad input, 3 not converged, 70 internal
error, 130 interrupted, 143 interrupted by SIGTERM. Every error ends in one message and,
with --json, in one line. A command imports large libraries when it needs them.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from bipot_rs._lib.messages import nearest
from bipot_rs.cli.arguments import Parser, PrintText
from bipot_rs.cli.commands import (
    blocks,
    check,
    fclib,
    info,
    new,
    plot,
    run,
    scenes,
    schema,
    solve,
    sweep,
)
from bipot_rs.cli.exit_codes import BAD_INPUT, Ended
from bipot_rs.cli.interrupts import Interrupts


class Command(Protocol):
    """A module of `cli.commands`, or a class there for another form of the command."""

    SUMMARY: str
    DETAILS: str

    def add_arguments(self, parser: Parser, /) -> None:
        """Add the arguments of the command to its parser."""

    def run(self, arguments: argparse.Namespace, interrupts: Interrupts, /) -> int:
        """Carry it out with the arguments found; returns the exit status."""


# In the order of the help.
COMMANDS: dict[str, Command] = {
    "run": run,
    "fclib": fclib,
    "solve": solve,
    "blocks": blocks,
    "scenes": scenes,
    "new": new,
    "check": check,
    "info": info,
    "plot": plot,
    "sweep": sweep,
    "schema": schema,
}
# Forms of a command with arguments of their own.
FORMS: dict[str, Command] = {"sweep --join": sweep.Join, "plot --x --y": plot.OfSweep}


def choose_form(words: Sequence[str]) -> str:
    """The name of the command in `COMMANDS` or `FORMS`; the first word names it."""
    name, *others = words
    if name == "sweep" and "--join" in others:
        return "sweep --join"
    if name == "plot":
        options = {word.partition("=")[0] for word in others}
        if options & {"--x", "--y"} or any(
            plot.is_sweep(Path(word)) for word in others
        ):
            return "plot --x --y"
    return name


def make_parser(name: str) -> Parser:
    """The parser of one command or form."""
    command = (COMMANDS | FORMS)[name]
    text = f"{command.SUMMARY}\n\n{command.DETAILS}"
    parser = Parser(prog=f"bipot {name}", description=text.strip())
    command.add_arguments(parser)
    # Without the list of all options, which follows below it.
    parser.usage = " ".join(["%(prog)s", *parser.positionals(), "[OPTIONS]"])
    return parser


def make_whole_parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of all commands, for completion of a line with these words."""
    parser = argparse.ArgumentParser(prog="bipot", add_help=False)
    subparsers = parser.add_subparsers(parser_class=Parser)
    for name in COMMANDS:
        form = choose_form(words) if words[:1] == [name] else name
        command = (COMMANDS | FORMS)[form]
        command.add_arguments(subparsers.add_parser(name, help=command.SUMMARY))
    return parser


def describe() -> Parser:
    """The parser of the program, for its help and options without a command."""
    wide = max(map(len, COMMANDS))
    lines = [
        f"  {name:<{wide}}  {command.SUMMARY}" for name, command in COMMANDS.items()
    ]
    parser = Parser(
        prog="bipot",
        usage="bipot COMMAND [ARGUMENTS]",
        description="Solve contact problems with Coulomb friction: scenes, matrices, FCLIB "
        "files.",
        epilog="\n".join(
            [
                "commands:",
                *lines,
                "",
                "bipot COMMAND --help lists the arguments of a command.",
            ]
        ),
    )
    parser.add_argument(
        "--version",
        action=PrintText,
        text=_version,
        help="Print the version. In Python, bp.show_versions() also prints libraries.",
    )
    return parser


def carry_out(words: Sequence[str], interrupts: Interrupts) -> int:
    """Read the words of a command line and carry out the command."""
    if "_ARGCOMPLETE" in os.environ:
        import argcomplete

        # Prints what the shell asks for, and ends the process.
        line = os.environ.get("COMP_LINE", "")
        argcomplete.autocomplete(make_whole_parser(line.split()[1:]))
    if not words or words[0].startswith("-"):
        describe().read(list(words) or ["--help"])
        raise Ended(BAD_INPUT, "the first word is no command; bipot --help lists them")
    if words[0] not in COMMANDS:
        raise Ended(BAD_INPUT, _say_unknown(words[0]))
    name = choose_form(words)
    options = make_parser(name).read(list(words[1:]))
    return (COMMANDS | FORMS)[name].run(options, interrupts)


def _version() -> str:
    import bipot_rs._core as _core

    return f"bipot-rs {_core.version}"


def _say_unknown(word: str) -> str:
    """The message for a word that is no command; it may be a scene."""
    from bipot_rs.scene.library import shipped

    scene = f"{word}.toml" if Path(f"{word}.toml").is_file() else word
    if scene in shipped() or scene.endswith(".toml"):
        advice = f"to solve a scene: bipot run {scene}"
    elif similar := nearest(word, COMMANDS):
        advice = f"did you mean {similar!r}?"
    else:
        advice = "bipot --help lists the commands"
    return f"there is no command {word!r}; {advice}"
