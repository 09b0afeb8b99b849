"""The directive ``command-reference``: what `bipot --help` says, as a page.

Commands, arguments and options are read from the program itself.
"""

from __future__ import annotations

import inspect
import re
from typing import Any

import typer
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from bipot_rs.cli.app import app


class CommandReference(SphinxDirective):
    """A section a command, with a table of what it takes."""

    def run(self) -> list[nodes.Node]:
        """Write it as Markdown, and have that parsed."""
        group = typer.main.get_command(app)
        self.env.note_dependency(inspect.getfile(type(app)))
        text = "\n\n".join(section(command) for command in subcommands(group))
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def subcommands(group: Any, before: str = "bipot") -> list[tuple[str, Any]]:
    """Full name and command, in the order of the help; those of a group after it."""
    found = []
    for name, command in group.commands.items():
        if command.hidden:
            continue
        whole = f"{before} {name}"
        found.append((whole, command))
        if hasattr(command, "commands"):
            found += subcommands(command, whole)
    return found


def section(named: tuple[str, Any]) -> str:
    """Heading, usage, help and options of one command."""
    name, command = named
    options = [p for p in command.params if p.param_type_name == "option"]
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    usage = " ".join([name, *(usage_of(a) for a in arguments)])
    parts = [f"## {name}", f"```shell\n{usage}{' [OPTIONS]' if options else ''}\n```"]
    parts.append(as_code(inspect.cleandoc(command.help or "")))
    rows = [(f"`{label(a)}`", told(a)) for a in arguments]
    rows += [(f"`{switches(o)}`", told(o)) for o in options]
    if rows:
        body = [f"| {left} | {right} |" for left, right in rows]
        parts.append("\n".join(["| | |", "|---|---|", *body]))
    return "\n\n".join(parts)


def label(argument: Any) -> str:
    """How the help names an argument."""
    return argument.metavar or argument.name.upper()


def usage_of(argument: Any) -> str:
    """An argument in the line of usage."""
    name = label(argument)
    return name if argument.required else f"[{name}]"


def switches(option: Any) -> str:
    """The spellings of an option, and what it takes."""
    names = ", ".join([*option.opts, *option.secondary_opts])
    if option.is_flag:
        return names
    return f"{names} {option.metavar or option.name.upper()}"


def told(parameter: Any) -> str:
    """The help of a parameter, with its default where that is worth saying."""
    text = " ".join((getattr(parameter, "help", None) or "").split())
    default = parameter.default
    plain = isinstance(default, int | float | str) and not isinstance(default, bool)
    if plain and default != "":
        text += f" Default `{default}`."
    if getattr(parameter, "multiple", False) or parameter.nargs == -1:
        text += " May be given several times."
    return as_code(text).replace("|", "\\|").strip()


def as_code(text: str) -> str:
    """Options that a help text names in passing: two hyphens would become a dash."""
    return re.sub(r"(?<![\w`-])--[a-z][\w-]*", r"`\g<0>`", text)


def setup(sphinx: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    sphinx.add_directive("command-reference", CommandReference)
    return {"parallel_read_safe": True}
