"""Progress of a command: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

import json
import sys
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING, Any, TextIO

from bipot_rs._lib.messages import duration

if TYPE_CHECKING:
    from bipot_rs._lib.types import OpenRecord, Record


# Seconds without a line after which one says what is going on.
SILENCE = 10.0


def drop_rounding(load: float, largest: float) -> float:
    """The load, or zero if it is zero up to rounding, as at the end of a sine."""
    return 0.0 if abs(load) < 1e-13 * largest else load


def line(**values: object) -> None:
    """Print one object of --json."""
    tell(json.dumps(values), sys.stdout)


def complain(message: str) -> None:
    """Print a message on standard error; an empty one is not printed."""
    if message:
        tell(f"bipot: {message}", sys.stderr)


def print_summary(summary: OpenRecord, *, as_json: bool) -> None:
    """Print the entry ``lines``, or all others as one object of --json."""
    lines = summary.pop("lines")
    if as_json:
        line(**summary)
    else:
        tell("\n".join(lines), sys.stdout)


class OutputLost(Exception):
    """A standard stream cannot be written: its reader has gone, or a disk is full."""


def tell(text: str, stream: TextIO) -> None:
    """Write a line and flush, so that a reader behind a pipe sees it at once."""
    try:
        stream.write(text + "\n")
        stream.flush()
    except OSError as error:
        raise OutputLost from error


def describe_remaining(taken: float, forecast: float) -> str:
    """Share and remaining time of a phase with a forecast, both in seconds.

    The forecast has one digit at most, and so has what is said here.

    >>> (
    ...     describe_remaining(10.0, 40.0),
    ...     describe_remaining(39.5, 40.0),
    ...     describe_remaining(41.0, 40.0),
    ... )
    ('25 %, about 30 s left', '99 %, less than 1 s left', 'longer than expected')
    """
    if taken >= forecast:
        return "longer than expected"
    return f"{100 * taken / forecast:.0f} %, {duration(forecast - taken)} left"


class Progress:
    """Bars of phases and load steps on a terminal, lines elsewhere; on standard error.

    ``phases, steps``: number of each; None for an unknown number of steps.
    ``noun``: name of the steps.
    ``quiet``: print no lines, as for --json; a terminal still has bars.
    """

    def __init__(
        self, phases: int, steps: int | None, *, quiet: bool, noun: str = "load steps"
    ) -> None:
        self.phases, self.steps, self.noun = phases, steps, noun
        self.bar: Any = None
        # The time forecast for the current phase, and when it was given.
        self.forecast_from: tuple[float, float] | None = None
        # The largest load so far.
        self.largest = 0.0
        # The last cycle of wear so far.
        self.done = 0
        self.lines = not quiet and not sys.stderr.isatty()
        # The phase and when it began, together: the thread of `_break_silence` reads them.
        self.current = "", 0.0
        # When the last line was printed, and what ends the lines about a phase.
        self.told, self.ended = 0.0, Event()

    def __enter__(self) -> Progress:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import (
                BarColumn,
                MofNCompleteColumn,
                ProgressColumn,
                SpinnerColumn,
                Task,
                TextColumn,
                TimeElapsedColumn,
                TimeRemainingColumn,
            )
            from rich.progress import Progress as Bar
            from rich.text import Text

            class Remaining(TimeRemainingColumn):
                """Remaining time of the steps only: the times of phases differ too much."""

                def render(self, task: Task) -> Text:
                    return super().render(task) if task.id else Text("")

            class Said(ProgressColumn):
                """Text of a bar; of a phase with a forecast its share and what is left."""

                def render(column, task: Task) -> Text:
                    return Text(str(task.fields["text"] or self._forecast_end(task.id)))

            self.bar = Bar(
                SpinnerColumn(),
                TextColumn("{task.description:<10}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                Remaining(),
                Said(),
                # rich handles NO_COLOR and TERM=dumb.
                console=Console(stderr=True, highlight=False),
                transient=True,
            )
            self.bar.start()
            many = self.phases > 1
            self.bar.add_task("", total=self.phases, visible=many, text="")
            self.bar.add_task(self.noun, total=self.steps, visible=not many, text="")
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        if self.bar is not None:
            self.bar.stop()

    def phase(self, name: str) -> None:
        """Show the phase that begins; without a terminal a line every ten seconds."""
        before, _ = self.current
        if self.lines and name != before:
            self.forecast_from = None
            self.current = name, monotonic()
            if not before:
                Thread(target=self._break_silence, daemon=True).start()
        if self.bar is not None and self.bar.tasks[0].description != name:
            begun = self.bar.tasks[0].description
            self.forecast_from = None
            self.bar.update(0, description=name, advance=1 if begun else 0, text="")
            if name == "solve":
                # The clock of the steps starts with this phase.
                self.bar.reset(1, completed=self.bar.tasks[1].completed, visible=True)

    def _break_silence(self) -> None:
        """Print lines while nothing else is printed, until the end."""
        while not self.ended.wait(SILENCE / 10):
            now, (phase, began) = monotonic(), self.current
            if now - max(self.told, began) < SILENCE:
                continue
            self.told = now
            left = self._forecast_end(0)
            spent = f"{phase}: {duration(now - began)} so far"
            try:
                tell(f"{spent}{', ' if left else ''}{left}", sys.stderr)
            except OutputLost:
                return  # the next line of the main thread says so

    def forecast(self, seconds: float) -> None:
        """Show how much of the current phase is done, by a forecast of its time [s]."""
        # Less would flicker.
        if seconds >= 1:
            self.forecast_from = seconds, monotonic()

    def _forecast_end(self, task: int) -> str:
        if task or self.forecast_from is None:
            return ""
        seconds, since = self.forecast_from
        return describe_remaining(monotonic() - since, seconds)

    def skip(self, steps: int) -> None:
        """Count load steps that an earlier run has solved."""
        if self.bar is not None:
            self.bar.advance(1, steps)

    def step(self, row: Record) -> None:
        """Report a solved load step."""
        status = f"open {row['open']}, slip {row['slip']}, stick {row['stick']}"
        if "broken" in row:
            status += f", broken {row['broken']}"
        of = "" if self.steps is None else f" of {self.steps}"
        load = ""
        if "load" in row:
            self.largest = max(self.largest, abs(row["load"]))
            load = f"load {drop_rounding(row['load'], self.largest):.6g}, "
        number, kind = row["step"] + 1, "load step"
        if "cycle" in row:
            number, kind = row["cycle"], "cycle"
            load = f"depth {row['largest_depth']:.3g}, "
        text = f"{kind} {number}{of}: {load}{status}, residual {row['residual']:.1e}"
        # Cycles may be jumped over.
        self.advance(status, text, by=number - self.done if kind == "cycle" else 1)
        self.done = number

    def advance(self, short: str, line: str, *, by: int = 1) -> None:
        """Count one step; ``short`` appears next to the bar, ``line`` without a bar."""
        if self.bar is not None:
            self.bar.update(1, advance=by, text=short)
        if self.lines:
            self.told = monotonic()
            tell(line, sys.stderr)

    def block(self, text: str) -> None:
        """Print lines above the bar; none if quiet."""
        if self.bar is not None:
            self.bar.console.print(text, highlight=False, soft_wrap=True, markup=False)
        elif self.lines:
            self.told = monotonic()
            tell(text, sys.stderr)
