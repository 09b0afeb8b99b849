"""The directive ``command-reference``: what `bipot --help` says, as a page.

Commands, arguments and options are read from the program itself.
"""

from __future__ import annotations

import argparse
import re

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from bipot_rs.cli import app


class CommandReference(SphinxDirective):
    """A section a command, with a table of what it takes."""

    def run(self) -> list[nodes.Node]:
        """Write it as Markdown, and have that parsed."""
        self.env.note_dependency(app.__file__)
        text = "\n\n".join(section(name) for name in names())
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def names() -> list[str]:
    """Commands in the order of the help, each followed by its other forms."""
    return [
        name
        for command in app.COMMANDS
        for name in (command, *(f for f in app.FORMS if f.split()[0] == command))
    ]


def section(name: str) -> str:
    """Heading, usage, help and options of one command."""
    parser = app.make_parser(name)
    actions = [a for a in parser._actions if "--help" not in a.option_strings]
    arguments = [a for a in actions if not a.option_strings]
    options = [a for a in actions if a.option_strings]
    usage = " ".join(["bipot", name, *parser.positionals()])
    parts = [
        f"## bipot {name}",
        f"```shell\n{usage}{' [OPTIONS]' if options else ''}\n```",
        as_code((parser.description or "").strip()),
    ]
    rows = [f"| `{label(a)}` | {told(a)} |" for a in arguments]
    rows += [f"| `{switches(a)}` | {told(a)} |" for a in options]
    if rows:
        parts.append("\n".join(["| | |", "|---|---|", *rows]))
    return "\n\n".join(parts)


def label(action: argparse.Action) -> str:
    """How the help names the value of an argument."""
    return str(action.metavar or action.dest.upper())


def switches(action: argparse.Action) -> str:
    """The spellings of an option, and what it takes."""
    spelled = ", ".join(action.option_strings)
    return spelled if action.nargs == 0 else f"{spelled} {label(action)}"


def told(action: argparse.Action) -> str:
    """The help of an argument."""
    return as_code(" ".join((action.help or "").split())).replace("|", "\\|")


def as_code(text: str) -> str:
    """Options that a help text names in passing: two hyphens would become a dash."""
    return re.sub(r"(?<![\w`-])--[a-z][\w-]*", r"`\g<0>`", text)


def setup(sphinx: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    sphinx.add_directive("command-reference", CommandReference)
    return {"parallel_read_safe": True}
