"""Images of values on a plane: values are interpolated first and coloured after.

Shading by the colours of the corners, as of Gouraud, mixes colours that are not on the
colour bar.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.types import Floats, Ints

if TYPE_CHECKING:
    from typing import Unpack

    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

    from bipot_rs.plots.style import Colours

# Pixels along the longer side.
_PIXELS = 600
# A pixel this much outside a triangle, in pixels, is on its edge: no seams by rounding.
_EDGE = 1e-6


@dataclass(frozen=True)
class Raster:
    """Pixels that cover a rectangle exactly."""

    low: Floats  # (2,): lower left corner
    width: Floats  # (2,): width and height of a pixel
    count: NDArray[np.int64]  # (2,): number of pixels in the two directions

    @classmethod
    def around(cls, uv: Floats) -> Raster:
        """Pixels of the rectangle around points ``(n, 2)``, about as high as wide."""
        low, high = uv.min(axis=0), uv.max(axis=0)
        step = (high - low).max() / _PIXELS or 1.0
        count = np.maximum(np.rint((high - low) / step).astype(np.int64), 1)
        width = np.where(high > low, (high - low) / count, step)
        return cls(low, width, count)

    @property
    def places(self) -> Floats:
        """Centres of the pixels, ``(rows, columns, 2)``, from the lower left."""
        u, v = (
            self.low[k] + (np.arange(self.count[k]) + 0.5) * self.width[k]
            for k in (0, 1)
        )
        return np.stack(np.meshgrid(u, v), axis=-1)

    def interpolate(self, uv: Floats, triangles: Ints, values: Floats) -> Floats:
        """Linear interpolation of nodal values, ``(rows, columns)``; NaN outside.

        ``uv, values``: ``(n, 2)`` and ``(n,)``.
        ``triangles``: ``(t, 3)``. Where triangles overlap, the last one is seen.
        """
        image = np.full(self.count[::-1], np.nan)
        # Coordinates in which the centres of pixels are whole numbers.
        at = ((uv - self.low) / self.width - 0.5)[triangles]
        which, row, first, last = self._spans(at)
        count = np.maximum(last - first + 1, 0)
        which, row = np.repeat(which, count), np.repeat(row, count)
        starts = np.cumsum(count) - count
        column = np.arange(len(row)) - np.repeat(starts - first, count)
        a, b, c = at[which].swapaxes(0, 1)
        (bu, bv), (cu, cv) = (b - a).T, (c - a).T
        pu, pv = column - a[:, 0], row - a[:, 1]
        twice = bu * cv - bv * cu
        corner = values[triangles]
        p, q, r = corner[which].T
        value = p + ((pu * cv - pv * cu) * (q - p) + (bu * pv - bv * pu) * (r - p)) / (
            np.where(twice == 0, 1.0, twice)
        )
        # In slivers rounding could leave the range of the corners.
        low, high = corner.min(axis=1), corner.max(axis=1)
        image[row, column] = np.clip(value, low[which], high[which])
        return image

    def _spans(self, at: Floats) -> tuple[Ints, Ints, Ints, Ints]:
        """Triangle, row, first and last column of each row of pixels in each triangle."""
        v = at[..., 1]
        bottom = np.maximum(np.ceil(v.min(axis=1) - _EDGE), 0).astype(np.int64)
        top = np.floor(v.max(axis=1) + _EDGE).astype(np.int64)
        top = np.minimum(top, self.count[1] - 1)
        rows = np.maximum(top - bottom + 1, 0)
        which = np.repeat(np.arange(len(at)), rows)
        row = np.arange(len(which)) - np.repeat(np.cumsum(rows) - rows - bottom, rows)
        left, right = np.full(len(which), np.inf), np.full(len(which), -np.inf)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            (u0, v0), (u1, v1) = at[which, i].T, at[which, j].T
            # A row within _EDGE of a corner meets the edge at that corner.
            y = np.clip(row, np.minimum(v0, v1), np.maximum(v0, v1))
            meets = np.abs(y - row) <= _EDGE
            rise = v1 - v0
            part = np.where(rise == 0, 0.0, (y - v0) / np.where(rise == 0, 1.0, rise))
            u = u0 + part * (u1 - u0)
            flat = rise == 0
            low = np.where(flat, np.minimum(u0, u1), u)
            high = np.where(flat, np.maximum(u0, u1), u)
            left = np.where(meets, np.minimum(left, low), left)
            right = np.where(meets, np.maximum(right, high), right)
        none = left > right
        first = np.maximum(np.ceil(np.where(none, 1, left) - _EDGE), 0)
        final = np.floor(np.where(none, 0, right) + _EDGE)
        final = np.minimum(final, self.count[0] - 1)
        return which, row, first.astype(np.int64), final.astype(np.int64)

    def show(self, image: Floats, ax: Axes, **colours: Unpack[Colours]) -> AxesImage:
        """Draw an image ``(rows, columns)`` into axes; NaN is left blank."""
        (left, low), (right, high) = self.low, self.low + self.count * self.width
        return ax.imshow(
            image,
            origin="lower",
            extent=(left, right, low, high),
            interpolation="nearest",
            **colours,
        )
