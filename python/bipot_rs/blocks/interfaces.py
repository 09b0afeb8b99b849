"""Where blocks touch: plane interfaces, each with the corners that carry its forces.

Each point of a plane interface has the same friction cone. A force at a point between
corners is a sum of forces at the corners in this cone, with the same resultant and moment.
So the corners of the convex hull of an interface, which all belong to it, carry exactly the
forces and moments that the whole interface can carry, friction torque included; and they
separate or slide apart only if the whole interface does. This holds for interfaces of any
shape, also for non-convex ones or those of several parts in one plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats
from bipot_rs.blocks.block import Block, split_convex
from bipot_rs.contact.law.frames import frames
from bipot_rs.mortar.polygons import clip, find_overlapping_boxes

# Normals of faces that touch are opposite to 25 degrees: the distance of the faces, which is
# compared with the tolerance, decides among these.
_OPPOSITE = 0.9
# Convex blocks that share a ball of this radius, relative to the smaller one, overlap.
_OVERLAP = 1e-2
# A corner nearer than this to the line through its neighbours, relative to the size of the
# blocks, is rounding of the intersection.
_STRAIGHT = 1e-9


@dataclass(frozen=True, eq=False)
class Interface:
    """A plane interface of two blocks.

    Attributes
    ----------
    first, second
        Numbers of the blocks.
    points
        Corners of its convex hull, ``(c, d)``, in order; in the plane both ends.
    normal
        Unit normal from the first block to the second, ``(d,)``.
    area
        Area, in the plane length.
    """

    first: int
    second: int
    points: Floats
    normal: Floats
    area: float


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Convex parts ``(p, v, d)`` of all faces, the last corner repeated, by block."""

    block: Ints
    corners: Floats
    normal: Floats
    centre: Floats


def find_interfaces(
    blocks: Sequence[Block], *, tolerance: float = 1e-4
) -> list[Interface]:
    """Find the interfaces of blocks: faces that lie on each other with opposite normals.

    Blocks that touch only along an edge or at a corner have no interface. Parts in one
    plane between the same two blocks are one interface.

    Parameters
    ----------
    blocks
        The blocks, all in the plane or all in space.
    tolerance
        Largest distance of faces that touch, and least width of an interface, relative to
        the smaller block.
    """
    if not tolerance > 0:
        raise ValueError(f"tolerance is {tolerance:g}, expected a positive number")
    pieces = _split_faces(blocks)
    size = np.array([block.size for block in blocks])
    reach = tolerance * size[pieces.block][:, None]
    low, high = pieces.corners.min(axis=1) - reach, pieces.corners.max(axis=1) + reach
    boxes, group = np.stack([low, high], axis=1), np.zeros(len(low), np.int64)
    overlaps: dict[tuple[int, int], list[tuple[Floats, Floats, float]]] = {}
    # Pieces are in the order of the blocks, so that the first of a pair has the lower number.
    for j, i in find_overlapping_boxes(group, boxes):
        facing = np.sum(pieces.normal[i] * pieces.normal[j], axis=1) < -_OPPOSITE
        chosen = facing & (pieces.block[i] < pieces.block[j])
        i, j = i[chosen], j[chosen]
        near = tolerance * np.minimum(size[pieces.block[i]], size[pieces.block[j]])
        for k, points, normal, area in _intersect(pieces, i, j, near):
            pair = int(pieces.block[i[k]]), int(pieces.block[j[k]])
            overlaps.setdefault(pair, []).append((points, normal, area))
    return [
        interface
        for (i, j), parts in sorted(overlaps.items(), key=lambda item: item[0])
        for interface in _merge(i, j, parts, min(size[i], size[j]), tolerance)
    ]


def refuse_overlap(blocks: Sequence[Block]) -> None:
    """Raise ValueError if two convex blocks overlap by more than inexact corners do.

    Blocks that are not convex are not compared.
    """
    planes = []
    for block in blocks:
        length = np.linalg.norm(block.normals, axis=1)
        normals = block.normals[length > 0] / length[length > 0, None]
        reach = np.sum(normals * block.middles[length > 0], axis=1)
        planes.append((normals, reach))

    def rise(j: int, i: int) -> Floats:
        """Heights of the corners of block j above the faces of block i."""
        return np.asarray(blocks[j].points @ planes[i][0].T - planes[i][1], np.float64)

    size = np.array([block.size for block in blocks])
    numbers = range(len(blocks))
    convex = np.array([rise(k, k).max() <= _OVERLAP * size[k] for k in numbers])
    boxes = np.array([[b.points.min(axis=0), b.points.max(axis=0)] for b in blocks])
    for pairs in find_overlapping_boxes(np.zeros(len(boxes), np.int64), boxes):
        for i, j in np.transpose(pairs)[convex[pairs[0]] & convex[pairs[1]]].tolist():
            least = _OVERLAP * min(size[i], size[j])
            if (
                max(rise(i, j).min(axis=0).max(), rise(j, i).min(axis=0).max())
                >= -least
            ):
                continue
            from scipy.optimize import linprog

            # The largest ball in both: edges may separate blocks that no face separates.
            normals, reach = (
                np.vstack([planes[i][0], planes[j][0]]),
                np.concatenate([planes[i][1], planes[j][1]]),
            )
            rows = np.column_stack([normals, np.ones(len(normals))])
            cost = np.append(np.zeros(normals.shape[1]), -1.0)
            ball = linprog(cost, rows, reach, bounds=(None, None)).x
            if ball is not None and ball[-1] > least:
                raise ValueError(
                    f"blocks {blocks[j].name!r} and {blocks[i].name!r} overlap near "
                    f"{ball[:-1].round(6).tolist()}: move one of them"
                )


def make_interface(
    blocks: Sequence[Block], first: int, second: int, points: ArrayLike
) -> Interface:
    """The interface with the corners ``points (c, 3)``, as a file gives them.

    The normal is that of the nearest parallel face of the first block.
    """
    corners = floats("points of the interface", points, ndim=2)
    names = (
        f"the interface of blocks {blocks[first].name!r} and {blocks[second].name!r}"
    )
    if corners.shape[0] < 3 or corners.shape[1] != 3:
        raise ValueError(f"{names} has shape {corners.shape}, expected (c, 3), c >= 3")
    middle = corners.mean(axis=0)
    arm = corners - middle
    normal = np.cross(arm, np.roll(arm, -1, axis=0)).sum(axis=0) / 2
    area = float(np.linalg.norm(normal))
    size = min(blocks[first].size, blocks[second].size)
    if area <= _STRAIGHT * size**2:
        raise ValueError(f"{names} has no area")
    normal = normal / area
    block = blocks[first]
    along = block.normals @ normal
    parallel = np.abs(along) > _OPPOSITE * np.linalg.norm(block.normals, axis=1)
    if not parallel.any():
        raise ValueError(f"{names} is parallel to no face of {block.name!r}")
    # Of a block that is not convex, faces in one plane may look in both directions.
    tangents = frames(normal[None])[0, 1:]
    around = [
        parallel[k] and _surrounds((block.points[face] - middle) @ tangents.T)
        for k, face in enumerate(block.faces)
    ]
    distance = np.abs((block.middles - middle) @ normal)
    distance[~(np.array(around) if any(around) else parallel)] = np.inf
    normal = normal * np.sign(along[int(np.argmin(distance))])
    return Interface(first, second, _hull(corners, tangents, size), normal, area)


def _surrounds(outline: Floats) -> bool:
    """Whether a polygon in the plane surrounds the origin, by its winding number."""
    following = np.roll(outline, -1, axis=0)
    cross = outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]
    angle = np.arctan2(cross + 0.0, np.sum(outline * following, axis=1))
    return bool(abs(angle.sum()) > np.pi)


def _split_faces(blocks: Sequence[Block]) -> _Pieces:
    owner, corners, normals, centres = [], [], [], []
    for number, block in enumerate(blocks):
        length = np.linalg.norm(block.normals, axis=1)
        real = np.flatnonzero(length > 0)
        bases = frames(block.normals[real])
        for k, frame in zip(real.tolist(), bases, strict=True):
            x, middle = block.points[block.faces[k]], block.middles[k]
            parts = [x]
            if x.shape[1] == 3:
                # The tangents may be left-handed with the normal.
                turn = 1 if np.linalg.det(frame) > 0 else -1
                flat = (x - middle) @ frame[1:].T
                try:
                    split = split_convex(flat[::turn])
                except ValueError as error:
                    raise ValueError(
                        f"face {k} of block {block.name!r}: {error}"
                    ) from None
                parts = [x[::turn][part][::turn] for part in split]
            owner += [number] * len(parts)
            corners += parts
            normals += [block.normals[k] / length[k]] * len(parts)
            centres += [middle] * len(parts)
    width = max(map(len, corners))
    padded = [
        np.concatenate([c, np.repeat(c[-1:], width - len(c), 0)]) for c in corners
    ]
    return _Pieces(*map(np.array, (owner, padded, normals, centres)))


def _intersect(
    pieces: _Pieces, i: Ints, j: Ints, near: Floats
) -> list[tuple[int, Floats, Floats, float]]:
    """Number, corners, normal and area of each pair of pieces that lie on each other."""
    normal = pieces.normal[i] - pieces.normal[j]
    if not len(normal):
        return []
    frame = frames(normal)
    origin = pieces.centre[i]
    # The second tangent such that the first face is counter-clockwise.
    frame[:, -1] *= np.sign(np.linalg.det(frame))[:, None]
    flat = [
        np.einsum("pvd,pkd->pvk", pieces.corners[side] - origin[:, None], frame[:, 1:])
        for side in (i, j)
    ]
    if frame.shape[1] == 2:
        ends = [np.sort(x, axis=1) for x in flat]
        both = np.stack(
            [
                np.maximum(ends[0][:, 0], ends[1][:, 0]),
                np.minimum(ends[0][:, 1], ends[1][:, 1]),
            ],
            axis=1,
        )
        area = both[:, 1, 0] - both[:, 0, 0]
        width = area
    else:
        both = clip(flat[0], flat[1][:, ::-1])
        following = np.roll(both, -1, axis=1)
        x, y = both[..., 0] - both[:, :1, 0], both[..., 1] - both[:, :1, 1]
        u, v = following[..., 0] - both[:, :1, 0], following[..., 1] - both[:, :1, 1]
        area = np.sum(x * v - y * u, axis=1) / 2
        span = np.linalg.norm(np.ptp(both, axis=1), axis=1)
        width = np.divide(area, span, where=span > 0, out=np.zeros_like(span))
    # Height of both planes over the corners.
    heights = []
    for side in (i, j):
        n = np.einsum("pkd,pd->pk", frame, pieces.normal[side])
        offset = np.sum((pieces.centre[side] - origin) * pieces.normal[side], axis=1)
        over = offset[:, None] - np.einsum("pvk,pk->pv", both, n[:, 1:])
        heights.append(over / n[:, :1])
    apart = np.abs(heights[0] - heights[1]).max(axis=1)
    level = (heights[0] + heights[1]) / 2
    points = (
        origin[:, None]
        + np.einsum("pvk,pkd->pvd", both, frame[:, 1:])
        + level[..., None] * frame[:, None, 0]
    )
    touching = np.flatnonzero((width > near) & (apart <= near))
    return [(int(k), points[k], frame[k, 0], float(area[k])) for k in touching]


def _merge(
    first: int,
    second: int,
    parts: Sequence[tuple[Floats, Floats, float]],
    size: float,
    tolerance: float,
) -> list[Interface]:
    """One interface for all parts in one plane."""
    planes: list[list[tuple[Floats, Floats, float]]] = []
    for points, normal, area in parts:
        for plane in planes:
            there, direction, _ = plane[0]
            apart = np.abs((points - there[0]) @ direction).max()
            turned = np.linalg.norm(normal - direction)
            if turned <= tolerance and apart <= tolerance * size:
                plane.append((points, normal, area))
                break
        else:
            planes.append([(points, normal, area)])
    interfaces = []
    for plane in planes:
        total = sum(area * normal for _, normal, area in plane)
        normal = np.asarray(total / np.linalg.norm(total))
        tangents = frames(normal[None])[0, 1:]
        every = np.concatenate([points for points, _, _ in plane])
        corners = _hull(every, tangents, size)
        area = float(sum(area for _, _, area in plane))
        interfaces.append(Interface(first, second, corners, normal, area))
    return interfaces


def _hull(points: Floats, tangents: Floats, size: float) -> Floats:
    """Corners of the convex hull of points in a plane, in order."""
    flat = (points - points[0]) @ tangents.T
    if flat.shape[1] == 1:
        return points[[int(flat.argmin()), int(flat.argmax())]]
    order = np.lexsort((flat[:, 1], flat[:, 0])).tolist()
    return points[_find_chain(flat, order, size) + _find_chain(flat, order[::-1], size)]


def _find_chain(flat: Floats, order: Sequence[int], size: float) -> list[int]:
    """Half of a convex hull without its last corner, by the chain of Andrew."""
    chain: list[int] = []
    for k in order:
        while len(chain) > 1:
            step, edge = flat[chain[-1]] - flat[chain[-2]], flat[k] - flat[chain[-2]]
            turn = step[0] * edge[1] - step[1] * edge[0]
            if turn > _STRAIGHT * size * float(np.linalg.norm(edge)):
                break
            chain.pop()
        chain.append(k)
    return chain[:-1]
