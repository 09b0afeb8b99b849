"""Draws 12-implicit-body.png: a strip footing on soil, and a hollow sphere.

    python docs/paper/figures_soil.py

The test support `hollow_sphere.py` has the closed form of the sphere and its mesh.
"""

import math
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from bipot_rs import fem
from bipot_rs.fem.bodies.elasticity import nodal_forces
from bipot_rs.mesh.boxes import box
from bipot_rs.mesh.elements import second_order
from bipot_rs.theory.soil_body import Soil
from bipot_rs.theory.soils import DruckerPrager, tensor
from bipot_rs.theory.structure import Structure

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "tests" / "python"))
from support.hollow_sphere import HollowSphere  # noqa: E402

ALPHA, APEX = 0.3, 1 / 0.3
BLUE, RED, GREEN = "#0072B2", "#D55E00", "#009E73"
SETTLEMENTS = np.linspace(0.005, 0.15, 30)


def footing(beta, n=6):
    """A smooth strip footing of width 2, half of it, pressed in; steps and forces."""
    ticks = np.linspace(0, 1, n + 1)
    x = np.concatenate([1 - ticks[::-1] ** 2, 1 + 3 * ticks[1:] ** 2])
    y = -2.5 * np.linspace(1, 0, 3 * n // 2 + 1) ** 1.7
    mesh = second_order(box([x, y], "quadrilateral"), serendipity=True)
    body = fem.Body("ground", mesh, fem.Material(1e3, 0.3))
    top, base = body.nodes("top"), body.nodes("bottom")
    foot = top[body.points[top, 0] <= 1 + 1e-9]
    sides = np.concatenate([2 * body.nodes("left"), 2 * body.nodes("right")])
    fixed = np.unique(np.concatenate([sides, 2 * base, 2 * base + 1, 2 * foot + 1]))
    down = np.isin(fixed, 2 * foot + 1)
    moved = np.zeros((len(SETTLEMENTS), len(fixed)))
    moved[:, down] = -SETTLEMENTS[:, None]
    ground = Soil.of_body(body, law=DruckerPrager(ALPHA, beta, APEX))
    steps = Structure([], [ground], None, fixed).solve(None, moved)
    force = [-step.support[down].sum() for step in steps]
    return ground, steps, np.array(force)


def prandtl():
    """Bearing capacity of weightless ground with associated flow."""
    sine = ALPHA * math.sqrt((1 - ALPHA**2 / 6) / 2) / (1 - ALPHA**2 / 6)
    phi = math.asin(sine)
    rise = math.tan(math.pi / 4 + phi / 2) ** 2
    return APEX * (math.exp(math.pi * math.tan(phi)) * rise - 1)


def draw_footing(left, middle):
    """Force over settlement for three dilatancies, and where the ground flows."""
    for beta, colour, name in (
        (0.3, BLUE, "β = α"),
        (0.1, RED, "β = α/3"),
        (0.0, GREEN, "β = 0"),
    ):
        ground, steps, force = footing(beta)
        left.plot([0, *SETTLEMENTS], [0, *force], color=colour, label=name, lw=1.6)
        if beta == 0.1:
            shown = ground, steps[-1]
    left.axhline(prandtl(), color="black", lw=0.9, ls="--", label="Prandtl, β = α")
    left.set_xlabel("settlement / half width")
    left.set_ylabel("force / (half width × α a)")
    left.legend(frameon=False, fontsize="small")
    ground, step = shown
    p = tensor(step.plastic_strain[0])
    e = p - np.trace(p, axis1=2, axis2=3)[..., None, None] / 3 * np.eye(3)
    size = np.linalg.norm(e, axis=(2, 3)).mean(axis=1)
    cells = ground.body.cells[:, :4]
    x = (ground.body.points + step.displacement.reshape(-1, 2)).T
    halves = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    drawn = middle.tripcolor(
        Triangulation(*x, halves),
        np.log10(np.maximum(np.tile(size, 2), 1e-4)),
        cmap="cividis",
        vmin=-3,
        vmax=-0.5,
    )
    edges = x[:, cells[:, [0, 1, 2, 3, 0]]]
    middle.plot(edges[0].T, edges[1].T, color="white", lw=0.3)
    middle.set_aspect("equal")
    middle.set_xlabel("x / half width")
    bar = middle.figure.colorbar(drawn, ax=middle, shrink=0.7)
    bar.set_ticks([-3, -2, -1], labels=["0.001", "0.01", "0.1"])
    bar.set_label("plastic shear ‖e‖, β = α/3")


def draw_sphere(axes, n=3):
    """Stresses of a hollow sphere in the cells, and in closed form."""
    sphere = HollowSphere()
    p = 0.85 * sphere.limit
    body = sphere.body(n)
    x = body.points
    planes = [3 * np.flatnonzero(np.abs(x[:, k]) < 1e-9) + k for k in range(3)]
    soil = DruckerPrager(sphere.alpha, sphere.beta, sphere.apex)
    wall = Soil.of_body(body, law=soil)
    structure = Structure([], [wall], None, np.concatenate(planes))
    inside = body.surface("inner")
    force = nodal_forces(body, inside, -p * np.asarray(inside.normals))
    (step,) = structure.solve(force)
    places = wall.quadrature.places
    r = np.linalg.norm(places, axis=0)
    stress = tensor(step.stress[0])
    radial = np.einsum("acq,cqab,bcq->cq", places, stress, places) / r**2
    hoop = (np.trace(stress, axis1=2, axis2=3) - radial) / 2
    exact = np.linspace(sphere.inner, sphere.outer, 200)
    for points, curve, colour, name in zip(
        (radial, hoop), sphere.stress(p, exact), (BLUE, RED), "rθ", strict=True
    ):
        # Means of cells.
        axes.plot(r.mean(axis=1), points.mean(axis=1), "o", color=colour, ms=4)
        axes.plot(exact, curve, color=colour, label=f"σ_{name}, closed form")
    axes.axvline(sphere.radius(p), color="black", lw=0.8, ls=":")
    axes.set_xlabel("radius / inner radius")
    axes.set_ylabel("stress / a")
    axes.legend(frameon=False, fontsize="small")


def main():
    """Draw the picture."""
    figure = Figure(figsize=(13.0, 3.9), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.0, 1.25, 1.0])
    draw_footing(left, middle)
    draw_sphere(right)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(HERE / "12-implicit-body.png", dpi=80, metadata={"Software": None})


if __name__ == "__main__":
    main()
