"""What a command tells while it works: lines on its streams, a bar on a terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any, TextIO


def settled(load: float, largest: float) -> float:
    """The load, or zero where a sine has come back to that but for its rounding."""
    return 0.0 if abs(load) < 1e-13 * largest else load


def line(**values: Any) -> None:
    """One object of --json."""
    tell(json.dumps(values), sys.stdout)


def complain(message: str) -> None:
    """Say on standard error what went wrong; help that was asked for has no message."""
    if message:
        tell(f"bipot: {message}", sys.stderr)


def tell(text: str, stream: TextIO) -> None:
    """Write a line, and flush: who reads through a pipe wants progress, not the end."""
    stream.write(text + "\n")
    stream.flush()


class Progress:
    """Bars over phases and load steps on a terminal, lines elsewhere; on standard error.

    Parameters
    ----------
    phases, steps
        How many of each there will be; of steps it may not be known.
    noun
        What a step is called.
    quiet
        No lines where there is no terminal: --json.
    """

    def __init__(
        self, phases: int, steps: int | None, *, quiet: bool, noun: str = "load steps"
    ) -> None:
        self.phases, self.steps, self.noun = phases, steps, noun
        self.bar: Any = None
        # The largest load so far.
        self.largest = 0.0
        self.lines = not quiet and not sys.stderr.isatty()

    def __enter__(self) -> Progress:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import (
                BarColumn,
                MofNCompleteColumn,
                SpinnerColumn,
                Task,
                TextColumn,
                TimeElapsedColumn,
                TimeRemainingColumn,
            )
            from rich.progress import Progress as Bar
            from rich.text import Text

            class Remaining(TimeRemainingColumn):
                """Of steps, which are alike; of phases the ones before tell nothing."""

                def render(self, task: Task) -> Text:
                    return super().render(task) if task.id else Text("")

            self.bar = Bar(
                SpinnerColumn(),
                TextColumn("{task.description:<10}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                Remaining(),
                TextColumn("{task.fields[told]}"),
                # NO_COLOR and TERM=dumb are rich's to honour.
                console=Console(stderr=True, highlight=False),
                transient=True,
            )
            self.bar.start()
            many = self.phases > 1
            self.bar.add_task("", total=self.phases, visible=many, told="")
            self.bar.add_task(self.noun, total=self.steps, visible=not many, told="")
        return self

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()

    def phase(self, name: str) -> None:
        """Name the phase that begins."""
        if self.bar is not None and self.bar.tasks[0].description != name:
            before = self.bar.tasks[0].description
            self.bar.update(0, description=name, advance=1 if before else 0, told="")
            if name == "solve":
                # Its clock is that of the steps, and so is the time they will take.
                self.bar.reset(1, completed=self.bar.tasks[1].completed, visible=True)

    def foretell(self, time: str) -> None:
        """Say how long the phase that runs may take, beside its bar and its clock."""
        if self.bar is not None:
            self.bar.update(0, told=f"{time} foretold")

    def skip(self, steps: int) -> None:
        """Begin after load steps that are done already."""
        if self.bar is not None:
            self.bar.advance(1, steps)

    def step(self, row: Mapping[str, Any]) -> None:
        """Report a solved load step."""
        status = f"open {row['open']}, slip {row['slip']}, stick {row['stick']}"
        of = "" if self.steps is None else f" of {self.steps}"
        load = ""
        if "load" in row:
            self.largest = max(self.largest, abs(row["load"]))
            load = f"load {settled(row['load'], self.largest):.6g}, "
        self.advance(
            status,
            f"load step {row['step'] + 1}{of}: {load}{status}, "
            f"residual {row['residual']:.1e}",
        )

    def advance(self, told: str, alone: str) -> None:
        """One more is done: what is told of it beside the bar, and on a line alone."""
        if self.bar is not None:
            self.bar.update(1, advance=1, told=told)
        if self.lines:
            tell(alone, sys.stderr)

    def block(self, text: str) -> None:
        """Some lines above the bar; none for --json, whose reader is a program."""
        if self.bar is not None:
            self.bar.console.print(text, highlight=False, soft_wrap=True, markup=False)
        elif self.lines:
            tell(text, sys.stderr)
