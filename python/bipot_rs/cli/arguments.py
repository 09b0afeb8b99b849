"""The parser of a command, the arguments that several commands have, and their completion.

argcomplete calls the functions ``complete_...`` with the word typed so far, and leaves out what
does not begin like it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from bipot_rs._lib.messages import meant
from bipot_rs.cli.exit_codes import BAD_INPUT, SOLVED, Ended
from bipot_rs.cli.progress import tell

if TYPE_CHECKING:
    from bipot_rs._lib.types import T


class Parser(argparse.ArgumentParser):
    """A parser that raises `Ended` for a wrong argument."""

    def __init__(self, **options: Any) -> None:
        super().__init__(
            add_help=False,
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            **options,
        )
        self.add_argument(
            "--help",
            action=PrintText,
            text=self.format_help,
            help="Print this help.",
        )

    def read(self, words: list[str]) -> argparse.Namespace:
        """Read the words of a command; options may stand anywhere."""
        options, unknown = self.parse_known_intermixed_args(words)
        if unknown:
            self.error(self._say_unknown(unknown[0], words))
        return options

    def positionals(self) -> list[str]:
        """The arguments that are no options, as in a line of usage."""
        usage = []
        for action in self._get_positional_actions():
            name = f"{action.metavar}{'...' if action.nargs == '+' else ''}"
            usage.append(name if action.required else f"[{name}]")
        return usage

    def error(self, message: str) -> NoReturn:
        """Raise `Ended` with the message of argparse."""
        raise Ended(BAD_INPUT, f"{message}; {self.prog} --help lists the arguments")

    def _say_unknown(self, word: str, words: list[str]) -> str:
        if word.startswith("-"):
            option = word.partition("=")[0]
            accepted = self._option_string_actions
            return f"there is no option {option}{meant(option, accepted)}"
        if "--set" in words:
            return f"unexpected argument {word}: --set takes KEY=VALUE in one piece, without spaces"
        return f"unexpected argument {word}"


class PrintText(argparse.Action):
    """An option that prints a text and ends the process, such as ``--help``."""

    def __init__(self, *, text: Callable[[], str], **options: Any) -> None:
        super().__init__(nargs=0, **options)
        self.text = text

    def __call__(self, *_: object) -> NoReturn:
        """Print the text and end the process."""
        tell(self.text().rstrip(), sys.stdout)
        raise SystemExit(SOLVED)


def read_options(kind: type[T], arguments: argparse.Namespace, **others: object) -> T:
    """The record ``kind`` of the arguments of a command, with ``others`` besides."""
    names = {field.name for field in fields(kind)} - others.keys()  # type: ignore[arg-type]
    given = {name: value for name, value in vars(arguments).items() if name in names}
    return kind(**given, **others)


def complete_by(argument: argparse.Action, names: Completer) -> None:
    """Let the shell complete an argument with the names that begin like it."""
    # argcomplete reads this attribute.
    argument.completer = names  # type: ignore[attr-defined]


def add_scene(parser: Parser) -> None:
    """Add the argument SCENE."""
    scene = parser.add_argument(
        "scene", metavar="SCENE", help="Name of a shipped scene, or a TOML file."
    )
    complete_by(scene, complete_scenes)


def add_settings(
    parser: Parser,
    *,
    metavar: str = "KEY=VALUE",
    purpose: str = "Change a key, as in --set mesh.n=24.",
) -> None:
    """Add ``--set``."""
    parser.add_argument(
        "--set",
        dest="settings",
        action="append",
        default=[],
        metavar=metavar,
        help=f"{purpose} May be given several times.",
    )


def add_method(parser: Parser, *, of_scene: bool) -> None:
    """Add ``--method``: of a scene, without a default."""
    method = parser.add_argument(
        "--method",
        default=None if of_scene else "auto",
        metavar="METHOD",
        help="Contact solver"
        + (", instead of the scene's." if of_scene else ". Default: auto."),
    )
    complete_by(method, complete_methods)


def add_out(parser: Parser, purpose: str) -> None:
    """Add ``--out``."""
    parser.add_argument("--out", type=Path, metavar="PATH", help=purpose)


def add_flag(parser: Parser, name: str, purpose: str) -> None:
    """Add an option without a value."""
    parser.add_argument(name, action="store_true", help=purpose)


def add_json(parser: Parser) -> None:
    """Add ``--json``."""
    add_flag(parser, "--json", "Print JSON, one object per line.")


def add_tol(parser: Parser) -> None:
    """Add ``--tol`` with its default."""
    parser.add_argument(
        "--tol",
        type=read_number,
        default=1e-10,
        metavar="T",
        help="Residual to reach. Default: 1e-10.",
    )


def read_number(text: str) -> float:
    """A number as an argument."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None


def read_vector(text: str) -> tuple[float, ...]:
    """Numbers with commas between them as an argument."""
    return tuple(read_number(part) for part in text.split(","))


def read_count(text: str) -> int:
    """A positive integer as an argument."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive integer")
    return int(text)


Completer = Callable[..., Iterable[str]]


def complete_scenes(prefix: str, **_: object) -> Iterable[str]:
    """Names of shipped scenes, and TOML files."""
    from argcomplete.completers import FilesCompleter

    from bipot_rs.scene.library import shipped

    return [*shipped(), *FilesCompleter(["toml"])(prefix)]


def complete_methods(**_: object) -> Iterable[str]:
    """Names of the contact solvers."""
    import bipot_rs._core as _core

    return list(_core.METHODS)


def complete_kinds(**_: object) -> Iterable[str]:
    """Kinds of pictures."""
    from bipot_rs.plots.by_name import KINDS

    return list(KINDS)
