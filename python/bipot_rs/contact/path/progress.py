"""A progress bar over the load steps, by tqdm or Rich."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module

from bipot_rs._lib.optional import load_library
from bipot_rs._lib.validation import logical
from bipot_rs.contact.results.solution import Step

OnStep = Callable[[int, Step], object] | None


@contextmanager
def show_progress(wanted: bool, total: float, on_step: OnStep) -> Iterator[OnStep]:
    """``on_step`` with a bar, of tqdm if it is installed, up to ``total`` steps or ``s``."""
    logical("progress", wanted)
    if not wanted:
        yield on_step
        return
    try:
        bar = import_module("tqdm.auto").tqdm(total=total, unit="step")
        advance = bar.update
    except ModuleNotFoundError:
        load_library("rich", extra="cli", need="progress bars")
        bar = import_module("rich.progress").Progress()
        task = bar.add_task("load steps", total=total)

        def advance(more: float) -> None:
            bar.advance(task, more)

    done = 0.0

    def count(k: int, step: Step) -> None:
        nonlocal done
        before, done = done, k + 1 if step.s is None else step.s
        advance(done - before)
        if on_step is not None:
            on_step(k, step)

    with bar:
        yield count
