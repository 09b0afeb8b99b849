"""`Block`: a rigid body with plane faces, its volume and its centre of mass."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun, place
from bipot_rs._lib.types import Bools, Floats, Ints
from bipot_rs._lib.validation import integers, number, show_value, vectors

# A volume, an area or a distance below this share of that of the bounding box is rounding:
# coordinates in files of single precision have seven digits.
_NOTHING = 1e-7


class Block:
    """A rigid block: a polygon in the plane, or a closed mesh of plane faces in space.

    Parameters
    ----------
    name
        Its name in messages.
    points
        Corners, ``(n, 2)`` or ``(n, 3)`` [m]. In the plane they are the outline, in either
        direction.
    faces
        In space: the corners of each face, counter-clockwise as seen from outside; a
        sequence of sequences, or ``(k, 3)`` triangles. Faces need not be convex.
    density
        Weight or mass per volume, per area in the plane.
    support
        Whether the block is held.

    Attributes
    ----------
    volume, centre
        Volume, in the plane area, and centre of mass ``(d,)``.
    normals, middles
        Outward normal of each face with its area (length) as length, and mean of its
        corners, ``(k, d)``.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong; the mesh is open or inverted. The message names the block and
        the edge.

    Examples
    --------
    >>> import bipot_rs as bp
    >>> block = bp.blocks.Block(
    ...     "lintel", [[0, 0], [3, 0], [3, 0.5], [0, 0.5]], density=24
    ... )
    >>> block.volume, block.centre
    (1.5, array([1.5 , 0.25]))
    """

    def __init__(
        self,
        name: str,
        points: ArrayLike,
        faces: Sequence[ArrayLike] | Ints | None = None,
        *,
        density: float = 1.0,
        support: bool = False,
    ) -> None:
        if not isinstance(name, str):
            raise TypeError(f"name is {show_value(name)}, expected a text")
        corners = vectors(f"points of block {name!r}", points, rows="n")
        self.name = name
        self.density = number(f"density of block {name!r}", density)
        if not 0 <= self.density < np.inf:
            raise ValueError(
                f"density of block {name!r} is {self.density:g}, expected zero or a positive number"
            )
        if not isinstance(support, bool | np.bool_):
            raise TypeError(
                f"support of block {name!r} is {show_value(support)}, expected a bool"
            )
        self.support = bool(support)
        # All that follows is relative to a point of the block: far from the origin,
        # products of coordinates lose their digits.
        origin = corners.mean(axis=0) if len(corners) else np.zeros(corners.shape[1])
        if corners.shape[1] == 2:
            if faces is not None:
                raise ValueError(f"block {name!r} lies in the plane, and has no faces")
            corners = self._order_outline(corners)
            outline = np.arange(len(corners))
            self.faces = tuple(np.column_stack([outline, np.roll(outline, -1)]))
            simplices = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            self.middles: Floats = simplices.mean(axis=1)
            along = simplices[:, 1] - simplices[:, 0]
            self.normals: Floats = np.column_stack([along[:, 1], -along[:, 0]])
        else:
            corners, self.faces = self._join_corners(corners, faces)
            self._check_closed(corners)
            simplices, starts = _fans(corners, self.faces)
            self.middles = simplices[starts, 0]
            a, b = (simplices[:, k] - simplices[:, 0] for k in (1, 2))
            self.normals = np.add.reduceat(np.cross(a, b) / 2, starts)
        self.points: Floats = corners
        simplices = simplices - origin
        d = corners.shape[1]
        # The divergence theorem: signed simplices from the origin.
        parts = np.linalg.det(simplices) / (2.0 if d == 2 else 6.0)
        self.volume = float(parts.sum())
        if self.volume <= _NOTHING * float(np.prod(np.ptp(corners, axis=0))):
            raise ValueError(
                f"block {name!r} has the volume {self.volume:.6g}: "
                + (
                    "it is inverted, reverse the corners of its faces"
                    if self.volume < 0
                    else "expected a body that is not flat"
                )
            )
        moment = (parts[:, None] * simplices.sum(axis=1)).sum(axis=0) / (d + 1)
        self.centre: Floats = origin + moment / self.volume

    def __repr__(self) -> str:
        held = ", support" if self.support else ""
        return f"Block({self.name!r}, {count_noun(len(self.faces), 'face')}{held})"

    @property
    def size(self) -> float:
        """Diagonal of the bounding box."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    def _order_outline(self, outline: Floats) -> Floats:
        """The outline counter-clockwise; refuses one that crosses itself."""
        if len(outline) < 3:
            raise ValueError(
                f"block {self.name!r} has {count_noun(len(outline), 'corner')}, expected at "
                "least 3"
            )
        x = outline - outline.mean(axis=0)
        following = np.roll(x, -1, axis=0)
        crossing = _find_crossing(x, following)
        if crossing is not None:
            first, second = (place(outline[i]) for i in crossing)
            raise ValueError(
                f"block {self.name!r} crosses itself: its edge from {first} meets that from "
                f"{second}"
            )
        return outline[::-1] if _cross(x, following).sum() < 0 else outline

    def _join_corners(
        self, points: Floats, faces: Sequence[ArrayLike] | Ints | None
    ) -> tuple[Floats, tuple[Ints, ...]]:
        """Corners that occur once, and faces on them: files of triangles repeat corners."""
        if faces is None or len(faces) < 4:
            raise ValueError(
                f"block {self.name!r} lies in space, and has "
                f"{count_noun(0 if faces is None else len(faces), 'face')}, expected at "
                "least 4"
            )
        corners, number_of = np.unique(points + 0.0, axis=0, return_inverse=True)
        number_of = number_of.ravel()
        joined = []
        for k, face in enumerate(faces):
            nodes = integers(f"face {k} of block {self.name!r}", face).astype(np.int64)
            if len(nodes) < 3 or nodes.min() < 0 or nodes.max() >= len(points):
                raise ValueError(
                    f"face {k} of block {self.name!r} is {nodes.tolist()}, expected at least 3 "
                    f"numbers of corners below {len(points)}"
                )
            nodes = number_of[nodes]
            nodes = nodes[nodes != np.roll(nodes, -1)]
            if len(nodes) >= 3:
                joined.append(nodes)
        if not joined:
            raise ValueError(
                f"all faces of block {self.name!r} are points or edges, expected a body that is "
                "not flat"
            )
        return corners, tuple(joined)

    def _check_closed(self, corners: Floats) -> None:
        """Refuse a mesh with an edge that faces do not pass once in each direction."""
        start = np.concatenate(self.faces)
        end = np.concatenate([np.roll(face, -1) for face in self.faces])
        edges, count = np.unique(
            np.column_stack([start, end]), axis=0, return_counts=True
        )
        passes = {
            (int(i), int(j)): int(c) for (i, j), c in zip(edges, count, strict=True)
        }
        for (i, j), once in passes.items():
            back = passes.get((j, i), 0)
            if once != back:
                edge = f"the edge from {place(corners[i])} to {place(corners[j])}"
                raise ValueError(
                    f"block {self.name!r} is open: {edge} belongs to one face only"
                    if once + back == 1
                    else f"block {self.name!r} has an inverted face: {count_noun(once, 'face')} "
                    f"run along {edge} and {back} back"
                )


def _fans(corners: Floats, faces: Sequence[Ints]) -> tuple[Floats, Ints]:
    """Triangles ``(t, 3, 3)`` from the middle of each face, which may be warped.

    Also the first triangle of each face.
    """
    start = np.concatenate(faces)
    end = np.concatenate([np.roll(face, -1) for face in faces])
    counts = np.array([len(face) for face in faces])
    first = np.cumsum(counts) - counts
    middle = np.add.reduceat(corners[start], first) / counts[:, None]
    fans = np.stack(
        [np.repeat(middle, counts, axis=0), corners[start], corners[end]], 1
    )
    return fans, first


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _find_crossing(start: Floats, end: Floats) -> tuple[int, int] | None:
    """Two edges of an outline that cross, or None."""

    def side(point: Floats) -> Floats:
        return _cross((end - start)[:, None], point[None] - start[:, None])

    between = side(start) * side(end) < 0
    both = np.argwhere(between & between.T)
    return None if not len(both) else (int(both[0][0]), int(both[0][1]))


def split_convex(outline: Floats) -> list[Ints]:
    """Corners of convex parts of a counter-clockwise polygon ``(n, 2)``.

    The polygon itself if it is convex, else its ears.

    Raises `ValueError`: the polygon crosses itself.
    """
    before, after = np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0)
    turns = _cross(outline - before, after - outline)
    flat = _NOTHING * float(np.linalg.norm(np.ptp(outline, axis=0))) ** 2
    if (turns >= -flat).all():
        return [np.arange(len(outline))]
    left, ears = list(range(len(outline))), []
    while len(left) > 3:
        for k, b in enumerate(left):
            a, c = left[k - 1], left[(k + 1) % len(left)]
            ear = outline[[a, b, c]]
            area = float(_cross(ear[1] - ear[0], ear[2] - ear[1]))
            others = outline[[i for i in left if i not in (a, b, c)]]
            if abs(area) <= flat or (area > 0 and not _inside(ear, others, flat).any()):
                break
        else:
            raise ValueError("the outline crosses itself")
        if area > flat:
            ears.append(np.array([a, b, c]))
        del left[k]
    last = outline[left]
    if float(_cross(last[1] - last[0], last[2] - last[1])) > flat:
        ears.append(np.array(left))
    return ears


def _inside(ear: Floats, points: Floats, flat: float) -> Bools:
    """Whether points other than the corners lie in a triangle or on its border."""
    edges = np.roll(ear, -1, axis=0) - ear
    heights = _cross(edges, points[:, None] - ear)
    repeated = (points[:, None] == ear).all(axis=2).any(axis=1)
    return np.asarray((heights >= -flat).all(axis=1) & ~repeated)
