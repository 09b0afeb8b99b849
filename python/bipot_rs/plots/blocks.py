"""Pictures of rigid blocks: resultants, thrust line, hinges, mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats, number
from bipot_rs.blocks.problem import BlockProblem, InterfaceForce
from bipot_rs.plots import mpl, style
from bipot_rs.plots.body import box_in_space

# Relative displacements below this share of the largest are no opening.
_OPEN = 1e-3
# Lengths, in units of the largest extent: the largest resultant; the largest displacement.
_ARROW, _MOVED = 0.12, 0.08


def blocks(
    problem: BlockProblem,
    reaction: ArrayLike | None = None,
    motion: ArrayLike | None = None,
    *,
    scale: float | None = None,
    names: bool = False,
    units: Mapping[str, str] | None = None,
    ax: Any = None,
) -> Any:
    """Blocks in the plane or in space, with what holds or moves them.

    With reactions: the resultant of each interface, as a line through its centre of
    pressure with a length in proportion to the force, and the thrust line, which joins the
    centres of pressure on both sides of each block that two interfaces carry. With a
    motion: the displaced outlines of the blocks, and hinges, which are contacts that stay
    closed in an interface that opens.

    Parameters
    ----------
    problem
        What `bipot_rs.blocks.assemble` returns.
    reaction
        ``(n_c, d)``: ``reaction`` of an equilibrium or of a solution.
    motion
        ``(k,)``: ``motion`` of an equilibrium without balance, of a limit multiplier, or
        ``rigid_motion`` of a solution.
    scale
        Factor of the displacements. Default: the largest becomes 8 % of the extent.
    names
        Whether to write the names of the blocks.
    units, ax
        As in `tractions`.
    """
    if not isinstance(problem, BlockProblem):
        raise make_type_error("problem", problem, "what blocks.assemble returns")
    space = problem.points.shape[1] == 3
    corners = np.concatenate(
        [block.points for block in problem.blocks if not block.support]
    )
    corners = np.concatenate([corners, problem.points])
    extent = float(np.ptp(corners, axis=0).max())
    ax = style.axes_of(ax, space=space)
    # In space, of supports only what is near: the figure would cut the rest.
    far = 0.15 * extent if space else np.inf
    near = corners.min(axis=0) - far, corners.max(axis=0) + far
    for support, colour in ((True, style.QUIET), (False, style.COLOURS[0])):
        chosen = [
            np.clip(block.points[face], *near)
            for block in problem.blocks
            if block.support == support
            for face in _list_outlines(block.faces, space=space)
        ]
        _fill(ax, chosen, colour, 0.25 if space else 1.0)
        if space:
            corners = np.concatenate([corners, *chosen])
    if motion is not None:
        outlines, hinges = _move(problem, floats("motion", motion), scale, extent)
        corners = np.concatenate([corners, *outlines])
        _draw_lines(ax, outlines, style.LIMIT, 1.2, "moved")
        if len(hinges):
            ax.plot(*hinges.T, "o", mfc="white", mec="black", ms=5, label="hinges")
    if reaction is not None:
        loaded = problem.resultants(floats("reaction", reaction))
        size = max(
            (float(np.linalg.norm(acting.force)) for acting in loaded), default=1.0
        )
        half = _ARROW / 2 * extent / size
        lines = [
            np.array(
                [acting.point - half * acting.force, acting.point + half * acting.force]
            )
            for acting in loaded
        ]
        unit = (units or {}).get("force")
        largest = f"resultants, largest {size:.3g}{f' {unit}' if unit else ''}"
        _draw_lines(ax, lines, style.PRESSURE, 1.6, largest)
        _draw_lines(ax, _find_thrust(problem, loaded), style.SHEAR, 1.0, "thrust line")
    if names:
        for block in problem.blocks:
            inside = (block.centre >= corners.min(axis=0)) & (
                block.centre <= corners.max(axis=0)
            )
            if inside.all():
                ax.text(
                    *block.centre, block.name, ha="center", va="center", size="small"
                )
    _frame(ax, corners, extent, (units or {}).get("length"))
    return ax


def _list_outlines(faces: Sequence[Any], *, space: bool) -> list[Any]:
    """Faces to fill: those of a mesh, or the outline of a polygon."""
    return list(faces) if space else [np.array([face[0] for face in faces])]


def _fill(ax: Any, polygons: Sequence[Floats], colour: str, alpha: float) -> None:
    if ax.name == "3d":
        ax.add_collection3d(
            mpl.Poly3DCollection(polygons, fc=colour, ec="black", lw=0.3, alpha=alpha)
        )
        return
    ax.add_collection(mpl.PolyCollection(polygons, fc=colour, ec="black", lw=0.6))


def _draw_lines(
    ax: Any, lines: Sequence[Floats], colour: str, width: float, name: str
) -> None:
    for k, line in enumerate(lines):
        label = name if k == 0 else "_"
        ax.plot(*line.T, color=colour, lw=width, label=label, solid_capstyle="round")


def _move(
    problem: BlockProblem, motion: Floats, scale: float | None, extent: float
) -> tuple[list[Floats], Floats]:
    """Displaced outlines of the blocks that move, and the hinges ``(h, d)``."""
    rows = problem.moves(motion)
    fields = [
        problem.move(k, block.points, row)
        for k, (block, row) in enumerate(zip(problem.blocks, rows, strict=True))
    ]
    largest = max(float(np.abs(field).max()) for field in fields)
    factor = (
        _MOVED * extent / (largest or 1.0) if scale is None else number("scale", scale)
    )
    outlines = []
    for block, field in zip(problem.blocks, fields, strict=True):
        if np.abs(field).max() > _OPEN * largest:
            places = block.points + factor * field
            faces = _list_outlines(block.faces, space=places.shape[1] == 3)
            outlines += [places[[*face, face[0]]] for face in faces]
    opening = np.asarray(problem.rigid[0] @ motion).reshape(problem.q.shape)[:, 0]
    opens = opening > _OPEN * float(np.abs(opening).max(initial=0.0))
    partly = np.bincount(problem.interface, opens) > 0
    return outlines, problem.points[partly[problem.interface] & ~opens]


def _find_thrust(
    problem: BlockProblem, loaded: Sequence[InterfaceForce]
) -> list[Floats]:
    """Lines between the centres of pressure of blocks that two interfaces carry."""
    centres: dict[int, list[Floats]] = {}
    for acting in loaded:
        interface = problem.interfaces[acting.interface]
        for k in (interface.first, interface.second):
            centres.setdefault(k, []).append(acting.point)
    return [
        np.array(both)
        for k, both in sorted(centres.items())
        if len(both) == 2 and not problem.blocks[k].support
    ]


def _frame(
    ax: mpl.Axes | Any, corners: Floats, extent: float, unit: str | None
) -> None:
    """Limits around the free blocks: supports may be much larger."""
    if ax.name == "3d":
        box_in_space(corners, ax)
    else:
        low, high = corners.min(axis=0), corners.max(axis=0)
        ax.set_aspect("equal")
        ax.set_xlim(low[0] - 0.06 * extent, high[0] + 0.06 * extent)
        ax.set_ylim(low[1] - 0.06 * extent, high[1] + 0.06 * extent)
        style.fit(ax)
        style.bare(ax)
    style.name_axes(ax, "xyz"[: corners.shape[1]], unit)
    if ax.get_legend_handles_labels()[0]:
        style.legend_above(ax)
