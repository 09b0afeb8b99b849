"""Pictures of deformed bodies, with their stress and the contact forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats, number
from bipot_rs.contact.law.frames import find_step_frames
from bipot_rs.files.fields import unit
from bipot_rs.mesh.kinds import OF_VTK
from bipot_rs.plots import mpl, style
from bipot_rs.plots.data import (
    describe_step_of,
    number_of,
    one_step,
    require_model,
    units_of,
)
from bipot_rs.plots.triangles import (
    deform_nodes,
    sharp_edges,
    skin,
)

if TYPE_CHECKING:
    from typing import Unpack

    from bipot_rs.contact.results.solution import Step
    from bipot_rs.fem.assembly.assembly import Assembly
    from bipot_rs.scene.case import Case

# Largest drawn displacement and longest arrow, relative to the size of the bodies.
_DEFORMED, _ARROW = 0.05, 0.12
# Most arrows, and their distance relative to the size of what is drawn.
_ARROWS, _APART = 25, 0.025
# Thickness of a rigid obstacle, and the margin that it may add to the picture, relative to
# the size of the bodies. Enlarged gaps can be larger than the bodies.
_THICK, _AROUND = 0.025, 0.15
_FORCE = "#d55e00"
# A gap above this part of the size of the bodies is visible in a picture.
_VISIBLE = 2e-3


def deformed(
    model: object,
    result: object = None,
    *,
    step: int = -1,
    scale: float | None = None,
    forces: bool = True,
    near: float | None = None,
    box: ArrayLike | None = None,
    limits: tuple[float, float] | None = None,
    largest_force: float | None = None,
    units: Mapping[str, str] | None = None,
    ax: mpl.Axes | None = None,
    at_rest: ArrayLike | None = None,
) -> mpl.Axes:
    """Deformed bodies, coloured by the von Mises stress, with contact forces.

    In 2D rigid obstacles are grey bands, as far as contacts face them, at a distance of
    the gap times ``scale``: a contact is closed where it touches the band. A gap between
    two bodies cannot be enlarged like this, because the bodies keep their places. If it is
    visible, a text above the picture says that such gaps are drawn once: with a larger
    ``scale`` bodies that touch then seem to overlap.

    Parameters
    ----------
    model
        The bodies: a `fem.Assembly`, a `Case`, a `Model` or a `ModelResult`.
    result
        A `Result` of these bodies or one of its steps; not needed if ``model`` is a
        `ModelResult`.
    step
        Step of a result.
    scale
        Factor of the displacements; default a round number that makes them visible. It is
        written above the picture. A thin line shows the undeformed bodies.
    forces
        Whether arrows show the forces at up to 26 contact nodes, on the bodies that have
        the contacts. The largest force is written above the picture.
    near
        Draw only the surroundings of the contacts, up to this multiple of their extent;
        default all.
    box
        Draw only this part, given by two opposite corners ``(2, d)``; not with ``near``.
    limits
        Least and largest stress of the colours, to compare load steps; default those of
        the step.
    largest_force
        The force of the longest arrow, to compare load steps; default the largest of the
        step.
    units, ax
        As in `tractions`.
    at_rest
        Stress of initial strains, ``(cells, 3, 3)``, as `Case.stress_at_rest`, which is
        added to that of the displacements. Needed only if ``model`` is a `fem.Assembly`.

    Returns
    -------
    matplotlib.axes.Axes
        For bodies in 3D, axes in 3D with the boundary of the bodies.

    Raises
    ------
    TypeError, ValueError
        A wrong argument; the message names it. A step without its displacements.
    """
    source, result = model, model if result is None else result
    model, case = _find_model(source, result)
    units = units_of(result, units)
    shown_step: Any = one_step(result, step)
    if not hasattr(shown_step, "displacement"):
        raise make_type_error("result", shown_step, "a Result or one of its steps")
    positive = {"scale": scale, "near": near, "largest_force": largest_force}
    for name, value in positive.items():
        if value is not None and not number(name, value) > 0:
            raise ValueError(f"{name} is {value}, expected a positive number")
    corners, limits = _box(box, near, model.dim), style.range_of(limits)
    from bipot_rs.fem.paraview import cell_fields

    u = shown_step.displacement
    if u.shape != (model.n,):
        raise ValueError(
            f"result has displacements of shape {u.shape}, the model ({model.n},)"
        )
    if at_rest is None and case is not None:
        at_rest = _find_initial_stress(case, result, shown_step, step)
    if at_rest is not None:
        cells = sum(len(corners) for _, corners in model.cells)
        at_rest = floats("at_rest", at_rest, shape=(cells, 3, 3))
    mises = cell_fields(model, u, at_rest)["von_mises"]
    places, scale = deform_nodes(model.nodes, u, scale, _DEFORMED)
    if near is not None:
        corners = _around_contacts(model, places, near)
    ax = style.axes_of(ax, size=(5.4, 3.8), space=model.dim == 3)
    draw = _plane if model.dim == 2 else _space
    image = draw(model, places, mises, ax)
    extend = "neither"
    if limits is not None:
        image.set_clim(*limits)
        extend = style.beyond(mises, *limits)
    if model.dim == 3:
        draw_edges(model, model.nodes, ax, lw=0.8, ls="--")
        # Contact with an obstacle is in sight, contact between bodies is hidden anyway.
        rigid = np.array([contact.against is None for contact in model.contacts], bool)
        side, _ = find_view(-model.frame[rigid[model.group], 0])
        cast("mpl.Axes3D", ax).view_init(*side)
    tails, longest = places[:0], 0.0
    if forces:
        extent = np.ptp(places if corners is None else corners, axis=0).max()
        reaction, frame = (
            np.asarray(shown_step.reaction),
            find_step_frames(shown_step, model.frame),
        )
        tails, longest = _forces(
            model, places, reaction, frame, extent, largest_force, ax
        )
    bands = _obstacles(model, shown_step, scale, ax) if model.dim == 2 else places[:0]
    if corners is None:
        drawn = np.concatenate([places, model.nodes, tails])
        corners = _around_bodies(drawn, bands) if model.dim == 2 else drawn
    _show(corners, ax)
    style.fit(ax)
    stress = unit("stress", units)
    most = float(mises.max(initial=0.0))
    style.colour_bar(image, ax, "von Mises stress", stress, extend=extend, most=most)
    words = [f"displacements × {scale:g}"] if scale != 1 else []
    if longest:
        words.append(f"forces up to {longest:.3g} {units.get('force', '')}".strip())
    lines = [", ".join([*words, *filter(None, [describe_step_of(result, step)])])]
    if _are_gaps_visible(model, scale):
        lines.insert(
            0, "gaps between bodies × 1: bodies that touch may seem to overlap"
        )
    style.note(ax, "\n".join(filter(None, lines)))
    style.name_axes(ax, model.numbered.axes, units.get("length"))
    return ax


def usual_scale(model: object, steps: Sequence[Step]) -> float:
    """The default factor of the displacements for the largest one of several steps."""
    model, _ = require_model(model)
    size, d = model.nodes.size, model.dim
    largest = max(
        (step.displacement for step in steps),
        key=lambda u: np.linalg.norm(u[:size].reshape(-1, d), axis=1).max(initial=0.0),
    )
    return deform_nodes(model.nodes, largest, None, _DEFORMED)[1]


def _box(box: ArrayLike | None, near: float | None, d: int) -> Floats | None:
    """The argument ``box``: its lower and its upper corner, ``(2, d)``."""
    if box is None:
        return None
    if near is not None:
        raise ValueError("near and box are given, expected one of them")
    limits = np.sort(floats("box", box, shape=(2, d)), axis=0)
    if (limits[0] == limits[1]).any():
        raise ValueError("box is flat, expected two opposite corners")
    return limits


def _are_gaps_visible(model: Assembly, scale: float) -> bool:
    """Whether gaps between bodies, which are not enlarged, would be visible if they were."""
    pairs = [contact.against is not None for contact in model.contacts]
    gap = np.abs(model.gap[np.array(pairs, bool)[model.group]])
    size = np.ptp(model.nodes, axis=0).max()
    return bool(abs(scale - 1) * gap.max(initial=0.0) > _VISIBLE * size)


def _find_model(given: object, result: object) -> tuple[Assembly, Case | None]:
    """The `fem.Assembly` of the argument ``model`` and, if there is one, its `Case`."""
    case_of_result = getattr(result, "case", None)
    if hasattr(type(given), "assemble") and case_of_result is not None:
        # The result has the assembled model already.
        if getattr(given, "scene", None) == case_of_result.scene:
            return case_of_result.model, case_of_result
    elif case_of_result is not None and case_of_result.model is given:
        return given, case_of_result
    return require_model(given)


def _find_initial_stress(
    case: Case, result: object, shown: Step, step: int
) -> Floats | None:
    """Stress of the initial strains of a case at a step."""
    if any(getattr(shown, name, None) is not None for name in ("s", "cycle")):
        return case.stress_at_rest(shown)
    number = number_of(result, step)
    if number is not None:
        return case.stress_at_rest(number[0])
    if case.stress_at_rest(0) is not None:
        raise ValueError(
            "result is a single step, but the model has initial strains, which depend "
            "on its number: pass the Result and step=, or at_rest="
        )
    return None


def cells_in_plane(
    cells: Sequence[tuple[str, Ints]],
    places: Floats,
    values: Floats,
    ax: mpl.Axes,
    **colours: Unpack[style.Colours],
) -> mpl.PolyCollection:
    """Draw cells in 2D with equal scales, each in the colour of its value."""
    # Corners come first: pictures have straight edges.
    corners = [c for kind, n in cells for c in places[n[:, : OF_VTK[kind].corners]]]
    return polygons_in_plane(corners, values, ax, **colours)


def polygons_in_plane(
    polygons: Sequence[Floats],
    values: Floats,
    ax: mpl.Axes,
    **colours: Unpack[style.Colours],
) -> mpl.PolyCollection:
    """Draw polygons in 2D with equal scales, each in the colour of its value."""
    image = mpl.PolyCollection(
        polygons, array=values, lw=0, antialiased=False, **colours
    )
    # As an image: separate polygons would make a large file.
    image.set_rasterized(True)
    ax.add_collection(image)
    ax.set_aspect("equal")
    return image


def _plane(
    model: Assembly, places: Floats, stress: Floats, ax: mpl.Axes
) -> mpl.PolyCollection:
    image = cells_in_plane(model.cells, places, stress, ax, cmap="viridis")
    for nodes, colour, width in (
        (model.nodes, style.QUIET, 0.6),
        (places, "black", 0.8),
    ):
        edges = [nodes[facet] for facets, _ in skin(model.cells) for facet in facets]
        ax.add_collection(mpl.LineCollection(edges, colors=colour, linewidths=width))
    return image


def _space(
    model: Assembly, places: Floats, stress: Floats, ax: mpl.Axes3D
) -> mpl.PolyCollection:
    # By depth the body would hide its own outline before, and the forces on it.
    ax.computed_zorder = False
    parts = skin(model.cells)
    polygons = [polygon for facets, _ in parts for polygon in places[facets]]
    return facets_in_space(polygons, np.concatenate([stress[c] for _, c in parts]), ax)


def draw_edges(
    model: Assembly, places: Floats, ax: mpl.Axes3D, **look: Unpack[style.LineStyle]
) -> None:
    """Draw the sharp edges of the bodies in 3D."""
    lines = places[sharp_edges(model.nodes, model.cells)]
    ax.add_collection3d(mpl.Line3DCollection(lines, color=style.QUIET, **look))


def find_view(outward: Floats) -> tuple[tuple[float, float], Floats]:
    """The side that sees most of surfaces with these normals.

    Elevation and azimuth [degrees], and the direction to the viewer.
    """
    views = [(up, around) for up in (28, -28) for around in (-60, 30, 120, -150)]
    up, around = np.radians(views).T
    towards = np.array(
        [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]
    )
    sight = np.maximum(outward @ towards, 0.0).sum(axis=0)
    # The usual side, unless another one sees clearly more.
    sight[0] *= 1.1
    best = int(np.argmax(sight))
    return views[best], towards[:, best]


def facets_in_space(
    polygons: list[Floats],
    values: Floats,
    ax: mpl.Axes3D,
    **colours: Unpack[style.FacetStyle],
) -> mpl.PolyCollection:
    """Draw polygons in 3D, each in the colour of its value."""
    edges: style.FacetStyle = {"lw": 0.2, "edgecolor": (0, 0, 0, 0.35)}
    image: mpl.PolyCollection = mpl.Poly3DCollection(
        polygons, **({"cmap": "viridis"} | edges | colours)
    )
    image.set_array(values)
    image.set_rasterized(True)
    ax.add_collection3d(image)
    return image


def box_in_space(places: Floats, ax: mpl.Axes3D) -> None:
    """Set the limits of axes in 3D, with equal scales."""
    low, high = places.min(axis=0), places.max(axis=0)
    # A flat box would not be visible.
    least = 0.15 * (high - low).max()
    middle, half = (low + high) / 2, np.maximum(high - low, least) / 2
    for k, name in enumerate("xyz"):
        getattr(ax, f"set_{name}lim")(middle[k] - half[k], middle[k] + half[k])
        axis = getattr(ax, f"{name}axis")
        # Fewer numbers on a short axis.
        count = max(1, round(4 * half[k] / half.max() + 0.4))
        # The first number of y would overlap the last one of x, its last one that of z.
        ends = ("lower", "upper") if ax.elev < 0 else ("both", None)
        prune = dict(zip("yz", ends, strict=True)).get(name)
        ticks = {"min_n_ticks": min(count, 2), "prune": prune}
        axis.set_major_locator(mpl.MaxNLocator(min(count, 4), **ticks))
        axis.set_major_formatter(
            mpl.FuncFormatter(lambda v, _: f"{v:g}".replace("-", "−"))
        )
    ax.set_box_aspect(half)


def _forces(
    model: Assembly,
    places: Floats,
    reaction: Floats,
    frame: Floats,
    extent: float,
    longest: float | None,
    ax: mpl.Axes,
) -> tuple[Floats, float]:
    """Draw forces; return the tails of the arrows, ``(arrows, d)``, and the largest force."""
    force = np.einsum("ck,ckd->cd", reaction, frame)
    size = np.linalg.norm(force, axis=1)
    largest = float(size.max(initial=0.0))
    if largest == 0:
        return places[:0], 0.0
    node = places[model.contact_dofs[:, 0] // model.dim]
    loaded = np.flatnonzero(size > 1e-6 * largest)
    # The largest force of each square: closer arrows would cover each other.
    loaded = loaded[np.argsort(-size[loaded], kind="stable")]
    squares = np.floor(node[loaded] / (_APART * extent)).astype(np.int64)
    loaded = np.sort(loaded[np.unique(squares, axis=0, return_index=True)[1]])
    # The largest force is always drawn.
    chosen = np.union1d(loaded[:: -(-len(loaded) // _ARROWS)], np.argmax(size))
    at = node[chosen]
    # Tips at the nodes: a pressing force comes from outside.
    arrows = force[chosen] * (_ARROW * extent / (longest or largest))
    if model.dim == 2:
        ax.quiver(
            *at.T,
            *arrows.T,
            color=_FORCE,
            pivot="tip",
            angles="xy",
            scale_units="xy",
            scale=1,
            width=4e-3,
            zorder=3,
            **style.RIM,
        )
    else:
        ax.quiver(*at.T, *arrows.T, color=_FORCE, pivot="tip", lw=1.0)
    return np.asarray(at - arrows), largest


def _obstacles(model: Assembly, shown: Step, scale: float, ax: mpl.Axes) -> Floats:
    """Draw rigid obstacles opposite to the contacts; return corners ``(k, 2)``."""
    from bipot_rs.fem.contact_surface import contact_surface

    model = model.in_step(shown)
    normal = model.frame[:, 0]
    # The gap of the undeformed body at this step: the obstacle may have moved, also by its
    # own unknowns.
    of_bodies = shown.displacement.copy()
    for reference in model.references:
        if reference.kind == "obstacle":
            of_bodies[reference.dofs] = 0.0
    gap = shown.relative_displacement[:, 0] - (model.B @ of_bodies)[:: model.dim]
    near = model.points - scale * gap[:, None] * normal
    far = near - _THICK * np.ptp(model.nodes, axis=0).max() * normal
    rigid = np.array([contact.against is None for contact in model.contacts], bool)
    bands = []
    for kind, facets in contact_surface(model):
        if kind == "vertex":
            continue
        # The third node of a quadratic line is the middle one.
        order = [0, 1] if kind == "line" else [0, 2, 1]
        line = facets[rigid[model.group[facets[:, 0]]]][:, order]
        bands += list(np.concatenate([near[line], far[line[:, ::-1]]], axis=1))
    if not bands:
        return model.nodes[:0]
    # Edges of their own colour hide the seams.
    ax.add_collection(
        mpl.PolyCollection(
            bands, facecolors=style.QUIET, edgecolors=style.QUIET, lw=0.3, zorder=0.5
        )
    )
    return np.concatenate(bands)


def _around_contacts(model: Assembly, places: Floats, near: float) -> Floats:
    """Corners ``(2, d)`` of the surroundings of the contacts; of a single one, by the bodies."""
    x = places[model.contact_dofs[:, 0] // model.dim]
    around = near * (np.ptp(x, axis=0).max() or np.ptp(places, axis=0).max())
    return np.stack([x.min(axis=0) - around, x.max(axis=0) + around])


def _around_bodies(drawn: Floats, bands: Floats) -> Floats:
    """Corners ``(2, 2)`` of what is drawn and of the near part of obstacles, with a margin."""
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    room = _AROUND * (high - low).max()
    shown = np.concatenate([drawn, np.clip(bands, low - room, high + room)])
    low, high = shown.min(axis=0), shown.max(axis=0)
    margin = 0.03 * (high - low).max()
    return np.stack([low - margin, high + margin])


def _show(places: Floats, ax: mpl.Axes) -> None:
    """Show the part that contains these places."""
    if places.shape[1] == 3:
        box_in_space(places, ax)
        return
    (left, low), (right, high) = places.min(axis=0), places.max(axis=0)
    ax.set_xlim(left, right)
    ax.set_ylim(low, high)
