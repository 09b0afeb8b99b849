"""The pictures of a result, from `bipot_rs.plots`.

Pictures are drawn from results, so that `plots` stands above this folder. This module is the
only one that reaches up to it; the contract of import-linter names it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from bipot_rs.contact.results.solution import Step


def draw_picture(
    result: Sequence[Step], kind: str | None, options: Mapping[str, object]
) -> Axes:
    """Draw a picture by `plots.plot`, and return its axes."""
    from bipot_rs import plots

    return plots.plot(result, kind, **options)


def write_animation(
    result: Sequence[Step],
    path: str | os.PathLike[str],
    kind: str | None,
    options: Mapping[str, Any],
) -> Path:
    """Write a GIF by `plots.animate`."""
    from bipot_rs import plots

    written: Path = plots.animate(result, path, kind, **options)
    return written
