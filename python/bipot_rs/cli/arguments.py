"""The parser of a command, the arguments that several commands have, and their completion.

argcomplete calls the functions ``complete_...`` with the word typed so far, and leaves out what
does not begin like it.
"""

from __future__ import annotations

import argparse
import sys
from argparse import Namespace
from collections.abc import Callable, Iterable
from contextlib import suppress
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


def read_options(kind: type[T], found: argparse.Namespace, **others: object) -> T:
    """The record ``kind`` of the arguments of a command, with ``others`` besides."""
    names = {field.name for field in fields(kind)} - others.keys()  # type: ignore[arg-type]
    given = {name: value for name, value in vars(found).items() if name in names}
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
    setting = parser.add_argument(
        "--set",
        dest="settings",
        action="append",
        default=[],
        metavar=metavar,
        help=f"{purpose} May be given several times.",
    )
    complete_by(setting, complete_keys)


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


def complete_keys(prefix: str, parsed_args: Namespace, **_: object) -> list[str]:
    """Keys for ``--set`` of the scene that is named before it."""
    return list_keys(getattr(parsed_args, "scene", None), prefix)


def list_keys(scene: str | None, incomplete: str) -> list[str]:
    """Keys for ``--set`` that begin so, one level at a time.

    A key that has keys of its own ends in a dot, any other in ``=``.

    ``scene``: its bodies, materials and lists are known by their names and numbers; without a
    scene, or with one that cannot be read, only the keys that all scenes have.
    ``incomplete``: what is typed so far: ``"contact.0.m"``.
    """
    from bipot_rs.scene.schema.root import Scene
    from bipot_rs.scene.schema.suggestions import keys as keys_of_schema

    if "=" in incomplete:
        return []
    *above, _ = incomplete.split(".")
    here = _follow(_read_table(scene), above)
    names: list[str] = keys_of_schema(Scene, above)
    if isinstance(here, list):
        names = [
            str(entry.get("name", k)) if isinstance(entry, dict) else str(k)
            for k, entry in enumerate(here)
        ]
    elif isinstance(here, dict):
        names = list(dict.fromkeys([*here, *names]))
    keys = []
    for name in names:
        inner = here.get(name) if isinstance(here, dict) else None
        # A table, or tables by name or number, of which "0" may be one. A plain value in
        # place of a table has no keys.
        more = not _is_plain(inner) and any(
            keys_of_schema(Scene, [*above, name, *end]) for end in ((), ("0",))
        )
        key = ".".join([*above, name]) + ("." if more else "=")
        if key.startswith(incomplete):
            keys.append(key)
    if len(keys) == 1 and keys[0].endswith(".") and keys[0] != incomplete:
        # The shell would end a single completion by a space.
        return list_keys(scene, keys[0])
    return keys


def _is_plain(value: object) -> bool:
    """Whether a value of the scene has no keys: a number, a text, or a list of these."""
    if isinstance(value, list):
        return not any(isinstance(item, dict) for item in value)
    return value is not None and not isinstance(value, dict)


def _read_table(scene: str | None) -> object:
    if not isinstance(scene, str):
        return {}
    from bipot_rs.scene.library import text
    from bipot_rs.scene.reading import parse

    # A faulty scene has no keys to complete; the command itself reports the fault.
    with suppress(ValueError):
        return parse(scene, text(scene))
    return {}


def _follow(table: object, place: list[str]) -> object:
    """The value at a key path; None if there is none."""
    from bipot_rs.scene.reading import entries

    for part in place:
        if isinstance(table, dict):
            table = table.get(part)
        elif isinstance(table, list) and (chosen := entries(table, part)):
            table = table[chosen[0]]
        else:
            return None
    return table
