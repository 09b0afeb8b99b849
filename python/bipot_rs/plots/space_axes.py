"""Axes in 3D whose content fills them: those of matplotlib are a square with much margin."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d import Axes3D, proj3d  # type: ignore[import-untyped]

from bipot_rs._lib.types import Floats

# Points from an axis to its numbers and to its name.
_NUMBERS, _NAME = 7.0, 20.0


class SpaceAxes(Axes3D):  # type: ignore[misc]
    """Axes in 3D of any shape, whose box fills them."""

    def apply_aspect(self, position: Bbox | None = None) -> None:
        """Show the box as large as the axes allow, with equal scales, in their middle."""
        place = self.get_position(original=True) if position is None else position
        self._set_position(place, "active")
        # matplotlib does so only when it draws, after the layout.
        self.M = self.get_proj()
        self.invM = np.linalg.inv(self.M)
        low, high = project_box(self)
        size = self.bbox.size
        half = 0.52 * ((high - low) / size).max() * size
        ends = np.stack([(low + high) / 2 - half, (low + high) / 2 + half])
        self.viewLim.intervalx, self.viewLim.intervaly = ends.T
        # matplotlib gives distances as parts of the lengths of the other two axes.
        points = 72 * size / self.get_figure().dpi
        lengths = np.ptp([self.get_xlim(), self.get_ylim(), self.get_zlim()], axis=1)
        scale = (
            np.linalg.norm(high - low) / np.linalg.norm(2 * half) * np.hypot(*points)
        )
        for k, axis in enumerate((self.xaxis, self.yaxis, self.zaxis)):
            across = np.delete(lengths, k).max() / np.linalg.norm(lengths) * scale
            each = points.mean() / across
            axis.labelpad = _NAME * each - 21
            axis.set_tick_params(pad=_NUMBERS * each - 8)
            # The pad has made the numbers those of axes in 2D.
            axis.get_major_ticks()

    def get_tightbbox(self, renderer: Any = None, **options: Any) -> Bbox:
        """As matplotlib, with the whole texts of the axes, of which it leaves out parts."""
        names = (
            super().get_tightbbox(renderer, **options),
            *(
                axis.get_tightbbox(renderer)
                for axis in (self.xaxis, self.yaxis, self.zaxis)
                if axis.label.get_text()
            ),
        )
        return Bbox.union(names)


def project_box(ax: Axes3D) -> tuple[Floats, Floats]:
    """Lower and upper corner of the box of axes in 3D, as it is seen, ``(2,)``."""
    corners = np.array(list(product(ax.get_xlim(), ax.get_ylim(), ax.get_zlim())))
    seen = np.stack(proj3d.proj_transform(*corners.T, ax.get_proj())[:2])
    return seen.min(axis=1), seen.max(axis=1)
