"""P1–P8: published problems."""

import csv
import json
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs import analytic, fem, scene
from cases import pressed_ring, ring_large
from cases.loaded_pin import loaded
from cases.plane import SIZES, line
from cases.space import SIZES as SIZES_SPACE
from cases.space import sphere
from cases.verification import Row, exact, exactly, near, same
from support.bodies import block, uniform_shear
from support.conditions import violation
from support.places import REFERENCE

Array = NDArray[np.float64]
DATA = REFERENCE
PLATE = "SSNV128 of code_aster"
NAFEMS = "NAFEMS, Konter 2006"
PAD = "SSNV503 of code_aster"
RING = "SSNP501 of code_aster, until 2017"
PIN = "SSNP156 of code_aster"
LARGE = "independent program, large displacements"
SERIES = "Michell's series"
BAR = "bar on a frictional foundation"


@cache
def plate(n: int, steps: int = 5) -> tuple[fem.Assembly, Array, Any]:
    """The scene `raous_plate`: model, last load, result; contacts sorted by position."""
    read = scene.read("raous_plate", [f"mesh.n={n}", f"path.steps={steps}"])
    case = scene.assemble(read, scene.bodies(read))
    result = case.model.problem().solve(case.load, case.prescribed, tol=1e-12)
    return case.model, case.load[-1], result


def along(model: fem.Assembly, values: Array) -> Array:
    """Values at the contacts from x = 0 on."""
    return values[np.argsort(model.points[:, 0])]


def points_of_the_plate() -> tuple[list[str], Array, Array, Array]:
    """Names, positions, published u_x and that of an independent program on 32² cells."""
    with (DATA / "ssnv128_published.csv").open() as file:
        rows = list(csv.reader(file))[1:]
    numbers = np.array([[float(row[k]) for k in (1, 2, 4)] for row in rows])
    return [row[0] for row in rows], *numbers.T


def shift(n: int, at: Array) -> Array:
    """u_x at nodes of the contact line."""
    model, _, result = plate(n)
    x = model.points[:, 0]
    nearest = [int(np.argmin(np.abs(x - place))) for place in at]
    np.testing.assert_allclose(x[nearest], at, atol=1e-12)
    return np.asarray(result.displacement[-1][model.contact_dofs[nearest, 0]])


def contact_line() -> tuple[Array, list[str]]:
    """(u_x, u_y, r_n, r_t) and statuses of an independent program on 16² cells."""
    with (DATA / "ssnv128_contact_line_16.csv").open() as file:
        rows = list(csv.reader(file))[1:]
    return np.array([[float(x) for x in row[1:5]] for row in rows]), [
        r[-1] for r in rows
    ]


def p1() -> list[Row]:
    """Plate of Raous, Chabrand and Lebon."""
    names, at, published, independent = points_of_the_plate()
    rows = [
        # The tolerance that code_aster states; E seems to be read from a curve.
        near(f"u_x at {name}, 64² cells [m]", PLATE, want, got, 0.05)
        for name, want, got in zip(names, published, shift(64, at), strict=True)
    ]
    source = "independent program"
    line_16, statuses = contact_line()
    model, load, result = plate(16)
    u, r = result.displacement[-1], along(model, result.reaction[-1])
    u_x = u[along(model, model.contact_dofs[:, 0])]
    balance = (model.K @ u - load - model.B.T @ result.reaction[-1].ravel())[1::2]
    got = [bp.Status(int(s)).name.lower() for s in along(model, result.status[-1])]
    others = [
        exact(f"r in {word}", "5 steps", r, along(m, other.reaction[-1]), 1e-9)
        for steps, word in ((1, "1 step"), (20, "20 steps"))
        for m, _, other in [plate(16, steps)]
    ]
    on_32, on_64, on_128 = (shift(n, at) for n in (32, 64, 128))
    corner, runs = balance.sum(), [" ".join(counted(x)) for x in (statuses, got)]
    at_corner = "sum of r_n and force at the corner [N/m]"
    return [
        *rows,
        # Five digits are printed.
        near("u_x at A–E, 32² cells [m]", source, independent, on_32, 1.8e-5),
        # Ends of zones move by parts of a cell, so that the error has no clean order.
        near("u_x at A–E, 64² cells [m]", "128² cells", on_128, on_64, 2e-4),
        near("contact line, 16² cells, u_x [m]", source, line_16[:, 0], u_x, 1e-6),
        near("contact line, 16² cells, r [N/m]", source, line_16[:, 2:], r, 1e-6),
        same("statuses on the contact line", source, *runs),
        near("sum of r_n [N/m]", source, 1.89514798e6, r[:, 0].sum(), 1e-8),
        near("force at the held corner [N/m]", source, 1.04852021e5, corner, 1e-8),
        exact(at_corner, "statics", 2e6, r[:, 0].sum() + corner, 1e-10),
        *others,
    ]


def counted(names: list[str]) -> list[str]:
    """Runs of equal names, as "2 open", "10 slip"."""
    runs: list[tuple[str, int]] = []
    for name in names:
        last, count = runs.pop() if runs and runs[-1][0] == name else (name, 0)
        runs.append((last, count + 1))
    return [f"{count} {name}" for name, count in runs]


def p2() -> list[Row]:
    """Steel cylinder on an aluminium block, half-planes of both; N and mm."""
    profile, width = line(SIZES[-1], (210e3, 70e3), 50.0, 35e3)
    _, peak = profile.on_axis(0)
    return [
        near("half-width [mm]", NAFEMS, 6.21, width, 2e-3),
        near("peak pressure [MPa]", NAFEMS, 3585.37, peak, 2e-3),
    ]


def pad(pull: float) -> tuple[Array, Array, float]:
    """Reactions, slips and mean u_t of the two sprung nodes; N and mm."""
    body = block((40.0, 20.0), (8, 4), 2.1e5, 0.0)
    ends = np.flatnonzero(np.isin(body.points[:, 0], [0.0, 40.0]))
    normal, aside = (
        body.basis.nodal_dofs[k][body.nodes_where(1, 0.0)][ends] for k in (1, 0)
    )
    springs = np.zeros(body.K.shape[0])
    springs[normal], springs[aside] = 0.005, 2.0
    K = sparse.csr_array(body.K + sparse.diags_array(springs))
    pressure = 12000 / 40
    path = [uniform_shear(body, pressure, [s]) for s in (0.0, pull / 40)]
    result: Any = bp.solve(
        K, body.B, np.array(path), gap=body.gap + 2.0, mu=0.3, tol=1e-13
    )
    mean = float(result.displacement[-1][aside].mean())
    return result.reaction[-1], result.slip[-1], mean


def p3() -> list[Row]:
    """Sliding pad, within 1 % of the limit."""
    stick, still, _ = pad(3564.0)
    slip, _, moved = pad(3636.0)
    # The weak springs carry 2 · 0.005 · 2 N of the 12000, so that friction is 0.006 N
    # less than in the source.
    limit, included = 0.3 * (12000 - 0.02), "the same, weak springs included"
    held, still, force = stick[:, 1].sum(), still[:, 0], slip[:, 1].sum()
    return [
        exact("sum of r_t under 3564 N [N]", PAD, -3564.0, held, 1e-10),
        exact(
            "slip under 3564 N [mm]", PAD, np.zeros_like(still), still, 1e-10, size=9
        ),
        near("sum of r_t under 3636 N [N]", PAD, -3600.0, force, 1e-5),
        exact(included, "statics", -limit, force, 1e-10),
        near("slip under 3636 N [mm]", PAD, 9.0, moved, 1e-3),
        exact(included, "statics", (3636 - limit) / 4, moved, 1e-9),
    ]


def p4() -> list[Row]:
    """Sphere on a rigid plane, ANSYS VM63."""
    profile, _, force, radius = sphere(SIZES_SPACE[-1])
    source = "Hertz with the data of ANSYS VM63"
    _, peak = profile.on_axis(0)
    return [
        near("force for 0.12742 mm [N]", source, 60 * np.pi, force, 2e-3),
        near("contact radius [mm]", source, 1.009635, radius, 5e-3),
        near("peak pressure [MPa]", source, 88.2904, peak, 2e-3),
    ]


P5 = (
    "fc3d_example1",
    "fc2d_slider_crank_singular",
    "fc2d_11_contacts",
    "fc3d_confeti_4_contacts",
)


def p5() -> list[Row]:
    """Problems of Siconos."""
    rows = []
    for name in P5:
        data = json.loads((DATA / f"{name}.json").read_text())
        shape = data["nc"], data["dim"]
        q = np.array(data["q"]).reshape(shape)
        problem = bp.ReducedProblem(np.array(data["W"]), q, np.array(data["mu"]))
        solution = problem.solve(tol=1e-12)
        v = np.array(data["u_checked"]).reshape(shape)
        got, size = solution.relative_displacement, float(np.abs(q).max())
        what, source = f"v of `{name}`", "Siconos; independent Gauss–Seidel"
        rows.append(exact(what, source, v, got, 1e-9, size=size))
    return rows


# Layers of cells of the ring; 40 cells around a quarter for 6 layers, as in SSNP501.
LAYERS = (12, 24, 48)
# Of the test file of SSNP501 until 2017, with St. Venant–Kirchhoff's material; since 2021 it
# has logarithmic strains and other numbers. u_x of the side [cm] in its second and fourth
# quarter, and the sum of forces on the outer circle [N/cm], with the node of the cut.
RING_SIDE = [0.73382600713111, 1.2855270869707]
RING_SUM = [8.78259567222, 16.8013028173, 24.4956524317, 32.8559610285]


@cache
def ring(layers: int, mu: float) -> pressed_ring.Pressed:
    return pressed_ring.pressed(layers, layers * 40 // 6, mu)


def p6() -> list[Row]:
    """Elastic ring between rigid plates, Saleeb, Chen and Chang; N and cm.

    The first two rows test the independent program for large displacements, the others
    compare this one with it.
    """
    large = ring_large.pressed(6, 40)
    # Levels so small that only the squares of displacements differ.
    small = np.array([0.01, 0.02])
    linear = pressed_ring.pressed(6, 40, 0.0, small).reaction[:, :, 0].sum(axis=1)
    nonlinear = np.array([figure.force for figure in ring_large.pressed(6, 40, small)])
    differences = linear / nonlinear - 1
    coarse, middle, fine = (ring(n, 0.4) for n in LAYERS)
    forces = [figure.reaction[:2, :, 0].sum(axis=1) for figure in (middle, fine)]
    series = [pressed_ring.side_by_series(fine.angle, r) for r in fine.reaction]
    errors = [
        np.linalg.norm(f.side[1] - pressed_ring.side_by_series(f.angle, f.reaction[1]))
        for f in (coarse, middle, fine)
    ]
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    # code_aster prints eleven digits or more.
    pairs = {
        "u_x of the side, large displacements [cm]": (
            RING_SIDE,
            [figure.side for figure in large[1::2]],
        ),
        "forces on the outer circle, large displacements [N/cm]": (
            RING_SUM,
            [figure.outside for figure in large],
        ),
    }
    order = np.log2(differences[1] / differences[0])
    far, source = (4 * forces[1] - forces[0]) / 3, "extrapolated from 24 and 48 layers"
    sums = fine.reaction[:, :, 0].sum(axis=1)
    return [
        *exactly(RING, 1e-9, pairs),
        # Their difference is that of the theories, 0.25 %.
        near("force for 0.01 cm [N/cm]", LARGE, nonlinear[0], linear[0], 3e-3),
        near("order of this difference in the approach", LARGE, 1.0, order, 0.02),
        # Second order; the end of the contact moves by parts of a cell.
        near("force, μ = 0.4, 48 layers [N/cm]", source, far, forces[1], 5e-4),
        # 2.5e-4 at this mesh, a quarter of that of half as many layers.
        near("u_x of the side, 48 layers [cm]", SERIES, series, fine.side, 4e-4),
        near("order of the error of u_x", SERIES, [2.0, 2.0], orders, 0.02),
        exact("sum of r_n [N/cm]", "force on the cut", fine.cut, sums, 1e-10),
    ]


@cache
def sheet(n: int, **changes: Any) -> tuple[bp.Model, Any]:
    """The scene `drawn_sheet` with n cells through the thickness."""
    model = bp.Model.from_toml("drawn_sheet").with_(**{"mesh.n": n, **changes})
    return model, model.solve(tol=1e-12)


def drawing_force(n: int, **changes: Any) -> Array:
    """Force of each step [N/mm]."""
    force = sheet(n, **changes)[1].support_force("sheet.right")
    return np.asarray(force[:, 0])


def beside_a_bar(thickness: float) -> tuple[Array, Array]:
    """Drawn lengths of a bar and of the sheet without lateral strain, times its thickness.

    For ν = 0 the pressure is uniform, and a thin sheet is a bar of stiffness E t on a
    foundation that resists with the friction of both faces.
    """
    draw = 0.01 / thickness
    force = drawing_force(
        2,
        **{
            "material.aluminium.poisson": 0.0,
            "body.sheet.y.to": thickness,
            "body.sheet.x.cells": f"{round(30 / thickness)}*n",
            "obstacle.holder.plane.point": (0.0, thickness),
            "support.0.x.value": draw,
        },
    )
    # From step 8 on all of it slips; the bar of the formula is endless.
    loads, drawn = force[1:8], draw * np.linspace(0, 1, 11)[1:8]
    stiffness, limit = 70500 * thickness, 2 * 0.1342 * 100 / 20
    bar = (
        analytic.bar_end_displacement(loads, stiffness, limit) + 10 * loads / stiffness
    )
    return bar * thickness, drawn * thickness


def p7() -> list[Row]:
    """Edge of a sheet under a blank holder; N and mm."""
    _, result = sheet(4)
    law = max(
        violation(
            step.reaction,
            np.column_stack([step.relative_displacement[:, 0], step.slip]),
            0.1342,
            # The path: slips of a step are differences of such displacements.
            np.array([0.01]),
        )
        for step in result.steps
    )
    faces = [result.contact_force(f"sheet.{side}") for side in ("bottom", "top")]
    (bar, drawn), thick = beside_a_bar(0.25), beside_a_bar(0.5)
    thin_and_thick = [np.linalg.norm(np.subtract(*p)) for p in ((bar, drawn), thick)]
    forces = [drawing_force(n)[1:9] for n in (2, 4, 8)]  # a part sticks
    changes = [float(a[0] - b[0]) for a, b in pairwise(forces)]
    force, friction = drawing_force(4), -sum(faces)[:, 0]
    pressed, full = np.abs([f[:, 1] for f in faces]), np.full((2, 11), 100.0)
    far, source = 2 * forces[2] - forces[1], "extrapolated from 4 and 8 cells"
    orders = [
        np.log2(thin_and_thick[1] / thin_and_thick[0]),
        np.log2(changes[0] / changes[1]),
    ]
    singular = "edges of the tools are singular"
    return [
        exact("force when all slips [N/mm]", "statics", 26.84, force[-1], 1e-10),
        exact("friction on the sheet [N/mm]", "drawing force", force, friction, 1e-9),
        exact("r_n of die and holder [N/mm]", "statics", full, pressed, 1e-9),
        exact("violation of (6) and (8)", "inequalities", 0.0, law, 1e-9, size=1.0),
        # The sheet is a bar up to its thickness over the length of the tools.
        near("drawn length, ν = 0, 0.25 mm thick [mm]", BAR, bar, drawn, 2e-3),
        near("order of this difference in the thickness", BAR, 1.0, orders[0], 0.1),
        # First order: half of the change from 4 to 8 cells, 2.3e-4, is left.
        near("force, 8 cells [N/mm]", source, far, forces[2], 4e-4),
        # Of the first step, in which the end of the slip zone moves least.
        near("order of its error in h", singular, 1.0, orders[1], 0.2),
    ]


def p8() -> list[Row]:
    """Pin that pulls a lug, NAFEMS contact benchmark 4; N and mm."""
    coarse, fine = loaded(4, 0.1), loaded(8, 0.1)
    pressure = fine.traction[0, 0]
    return [
        # The source has large displacements; here they are 0.7 % of the end of the lug.
        near("u_x of the hole in front [mm]", PIN, 0.736165779271, fine.front, 5e-3),
        # The source extrapolates stresses from its cells.
        near("pressure in front [MPa]", PIN, 160.40113477117, pressure, 0.05),
        near("u_x, 144 cells around", "72 cells", coarse.front, fine.front, 1e-3),
        exact("force on the hole [N/mm]", "statics", 1e4, fine.force, 1e-10),
    ]


CASES = {f.__name__: f for f in (p1, p2, p3, p4, p5, p6, p7, p8)}
