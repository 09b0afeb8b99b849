"""Whether a picture is readable: no text over other text, no legend over a curve."""

from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.legend import Legend
from matplotlib.text import Text

# Boxes of letters have some margin: they may overlap by this many pixels at 100 dpi.
_TOUCH = 1.5


def overlaps(figure: Any) -> list[str]:
    """Names of the parts of a figure that overlap, or lie outside its edge."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    drawn = _drawn(figure)
    # Asking 3D axes for their ticks moves the ticks.
    canvas.draw()
    texts = [(t.get_text(), _corners(t, renderer)) for t in drawn]
    overlapping = [
        f"{first_text!r} over {other!r}"
        for (first_text, a), (other, b) in combinations(texts, 2)
        if _cover(a, b)
    ]
    rim = figure.bbox.max + _TOUCH
    overlapping += [
        f"{name!r} beyond the rim"
        for name, box in texts
        if (box < -_TOUCH).any() or (box > rim).any()
    ]
    for ax in figure.findobj(Axes):
        for legend in ax.findobj(Legend):
            box = legend.get_window_extent(renderer)
            for line in ax.get_lines():
                path = line.get_path().interpolated(20).vertices
                path = line.get_transform().transform(path)
                inside = ax.bbox.padded(1).contains
                seen = [p for p in path if np.isfinite(p).all() and inside(*p)]
                if any(box.contains(*point) for point in seen):
                    overlapping.append(f"legend over {line.get_label()!r}")
    return overlapping


def _corners(text: Any, renderer: Any) -> Any:
    """Corners of the text, ``(4, 2)``, with its rotation."""
    angle = text.get_rotation()
    middle = text.get_window_extent(renderer)
    text.set_rotation(0.0)
    flat = text.get_window_extent(renderer)
    text.set_rotation(angle)
    half = np.array([flat.width, flat.height]) / 2
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    center = [(middle.x0 + middle.x1) / 2, (middle.y0 + middle.y1) / 2]
    return center + (signs * half) @ np.array([[c, s], [-s, c]])


def _cover(a: Any, b: Any) -> bool:
    """Whether no line parallel to a side separates the two."""
    for box in (a, b):
        for side in (box[1] - box[0], box[3] - box[0]):
            across = side / (np.linalg.norm(side) or 1.0)
            first_shadow, other = a @ across, b @ across
            if (
                min(first_shadow.max(), other.max())
                - max(first_shadow.min(), other.min())
                <= _TOUCH
            ):
                return False
    return True


def _drawn(figure: Any) -> list[Any]:
    """Texts that are drawn: an axis also keeps ticks outside its limits."""
    kept, shown = set(), set()
    for ax in figure.findobj(Axes):
        for axis in [ax.xaxis, ax.yaxis, *([ax.zaxis] if ax.name == "3d" else [])]:
            for tick in [*axis.majorTicks, *axis.minorTicks]:
                kept |= {id(tick.label1), id(tick.label2)}
            for tick in axis._update_ticks():
                shown |= {id(tick.label1), id(tick.label2)}
    return [
        text
        for text in figure.findobj(Text)
        if text.get_text().strip()
        and text.get_visible()
        and (id(text) not in kept or id(text) in shown)
    ]
