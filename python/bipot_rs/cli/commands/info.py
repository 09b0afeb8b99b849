"""``bipot info``: summarise a result, a scene or a mesh in some ten lines."""

from __future__ import annotations

import argparse
from pathlib import Path

from bipot_rs.cli import arguments as shared
from bipot_rs.cli.exit_codes import SOLVED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import print_summary

SUMMARY = "Summarise a result, a scene or a mesh in some ten lines."
DETAILS = ""


def add_arguments(parser: shared.Parser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "file",
        metavar="FILE",
        help="The folder of a run or its result.h5; a file for ParaView (.pvd, .vtu); a "
        "scene; or a mesh (.msh, .inp, .med, .vtu, .stl).",
    )
    shared.add_json(parser)


def run(arguments: argparse.Namespace, _: Interrupts) -> int:
    """Print the summary."""
    print_summary(summarise(arguments.file), as_json=arguments.json)
    return SOLVED


def summarise(name: str) -> dict[str, object]:
    """Summarise a result, a file for ParaView, a scene or a mesh.

    ``name``: a file, the folder of a run, or a shipped scene.
    Returns ``kind``, figures by name, and ``lines`` for a terminal.
    """
    from bipot_rs.cli import info
    from bipot_rs.cli.run.output_folder import RESULT

    path = Path(name)
    if path.is_dir():
        if not (path / RESULT).exists():
            raise ValueError(f"{path} is a folder without {RESULT}")
        path = path / RESULT
    suffix = path.suffix.lower()
    if suffix in info.SERIES_SUFFIXES:
        return info.summarise_fields(path)
    if suffix in info.MESH_SUFFIXES:
        return info.summarise_mesh(path)
    if suffix in (".h5", ".vtkhdf"):
        return info.summarise_result(path)
    if path.is_file() and suffix not in ("", ".toml"):
        raise ValueError(
            f"{name} is a file {path.suffix}, expected a result (.h5), a file for ParaView "
            f"({', '.join(info.SERIES_SUFFIXES)}), a mesh ({', '.join(info.MESH_SUFFIXES)}) or a "
            "scene (.toml)"
        )
    return info.summarise_scene(name)
