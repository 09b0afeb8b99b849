"""``bipot new``: write a commented scene to start from."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from bipot_rs._lib.messages import count_noun, meant, printable
from bipot_rs.cli import arguments as shared
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import tell

SUMMARY = "Write a commented scene to start from."
DETAILS = "An existing file is not overwritten."
_FOLDER = Path(__file__).parent.parent / "templates"
SCHEMA = "bipot-scene.schema.json"
_HINT = (
    f"#:schema ./{SCHEMA}\n"
    f"# An editor that knows TOML checks this file: bipot schema > {SCHEMA}\n\n"
)
# Placeholders in templates: the path of the scene, the path of its mesh, and the path of
# the mesh as seen from the scene.
_NAME, _MESH, _BESIDE = "@NAME@", "@MESH@", "@FILE@"


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "name",
        metavar="NAME",
        nargs="?",
        help="Name of the new file; .toml is added. Default: scene, or the name of the deck.",
    )
    source = parser.add_mutually_exclusive_group()
    template = source.add_argument(
        "--template",
        default="block",
        metavar="KIND",
        help=f"Kind of scene: {', '.join(templates())}. Default: block.",
    )

    def complete_templates(**_: object) -> list[str]:
        return templates()

    shared.complete_by(template, complete_templates)
    source.add_argument(
        "--from",
        dest="deck",
        type=Path,
        metavar="DECK",
        help="Write the scene of a deck of Abaqus or CalculiX (.inp) instead. What it does "
        "not take is listed in comments.",
    )


def run(arguments: argparse.Namespace, _: Interrupts) -> int:
    """Write the files and print the next commands."""
    if arguments.deck is None:
        path, *others = write(arguments.name or "scene", arguments.template)
    else:
        path, *others = write_deck(
            arguments.name or arguments.deck.stem, arguments.deck
        )
    written = " and ".join(map(str, [path, *others]))
    lines = path.read_text(encoding="utf-8").splitlines()
    if left := sum(line.startswith("# line ") for line in lines):
        remark = f"{count_noun(left, 'remark')} on lines of {arguments.deck}"
        tell(f"{remark}: see the head of {path}", sys.stdout)
    tell(f"{written}: bipot check {path}, bipot run {path}", sys.stdout)
    return SOLVED


def templates() -> list[str]:
    """Names of the templates."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def write(name: str, template: str) -> list[Path]:
    """Write a commented scene; returns its files, first ``name`` with ``.toml``.

    The mesh of a template is written next to the scene, under the same name.
    """
    if template not in templates():
        raise ValueError(
            f"--template is {template!r}, expected one of {', '.join(templates())}"
            + meant(template, templates())
        )
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    text = (_FOLDER / f"{template}.toml").read_text(encoding="utf-8")
    mesh = path.with_suffix(".inp")
    for word, file in ((_NAME, str(path)), (_MESH, str(mesh)), (_BESIDE, mesh.name)):
        text = text.replace(word, file)
    _new(path, _HINT + text)
    source = _FOLDER / f"{template}.inp"
    if not source.exists():
        return [path]
    try:
        _new(mesh, source.read_text(encoding="utf-8"))
    except OSError:
        # A scene without its mesh is useless.
        path.unlink()
        raise
    return [path, mesh]


def write_deck(name: str, deck: Path) -> list[Path]:
    """Write the scene of a deck; returns its files, as `write`.

    The mesh of the scene is the deck, or a file beside the scene that includes it and adds sets.
    """
    from bipot_rs.scene.deck import Deck

    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    made, mesh, files = Deck(deck), deck, [path]
    try:
        if made.sets:
            mesh = path.with_suffix(".sets.inp")
            source = os.path.relpath(deck, mesh.parent)
            _new(mesh, "\n".join([f"*INCLUDE, INPUT={source}", *made.sets, ""]))
            files.append(mesh)
        model = made.model(mesh, Path(os.path.relpath(mesh, path.parent)).as_posix())
        notes = "".join(f"# {printable(note)}\n" for note in made.notes)
        head = f"# From {printable(deck.name)}.{' Not as there:' if notes else ''}\n{notes}\n"
        _new(path, _HINT + head + model.to_toml())
    except (OSError, ValueError):
        for file in files[1:]:
            file.unlink(missing_ok=True)
        raise
    return files


def _new(path: Path, text: str) -> None:
    """Write a new file; never overwrite."""
    try:
        # Mode "x" leaves no time between a test for existence and the writing.
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise FileExistsError(
            f"{path} exists already and is not overwritten: choose another name"
        ) from None
    except OSError as error:
        raise OSError(f"cannot write {path}: {error.strerror or error}") from error
