"""An inclined crack in rock under compression: closed, and sliding with friction.

`python examples/inclined_crack.py` prints errors and their orders. The crack of length 2 b
makes the angle ψ with the direction of the compression σ, in an infinite body in plane
strain. It stays closed, with the pressure p = σ sin² ψ on it; the shear stress σ sin ψ cos ψ
exceeds the friction μ p by the stress drop T, and its faces slide by

    4 (1 - ν²) / E · T √(b² - x²),    T = σ sin ψ (cos ψ - μ sin ψ).

The displacement around it is that of Westergaard's stress function in mode II,
``Z = T (z / √(z² - b²) - 1)``. It is prescribed at the outer boundary, so that the size of the
mesh makes no error.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import skfem

import bipot_rs as bp
from bipot_rs import fem

YOUNG, NU = 25e9, 0.25  # Pa
SIGMA = 100e6  # Pa, a compression along x
PSI, MU = math.radians(20), math.tan(math.radians(30))
HALF, FAR = 1.0, 3.0  # m, half the length of the crack, half the side of the mesh
PRESSURE = SIGMA * math.sin(PSI) ** 2
DROP = SIGMA * math.sin(PSI) * (math.cos(PSI) - MU * math.sin(PSI))
TURN = np.array([[math.cos(PSI), -math.sin(PSI)], [math.sin(PSI), math.cos(PSI)]])


def exact_slip(x):
    """Slip at the distance x from the middle of the crack [m]."""
    return 4 * (1 - NU**2) / YOUNG * DROP * np.sqrt(HALF**2 - x**2)


def exact_displacement(points):
    """Displacement (n, 2) at points (n, 2) outside the crack [m]."""
    lame, shear = YOUNG * NU / (1 + NU) / (1 - 2 * NU), YOUNG / (2 * (1 + NU))
    z = (points @ TURN) @ [1, 1j]  # x along the crack, y across it
    root = np.sqrt(z - HALF) * np.sqrt(z + HALF)
    stress, integral = DROP * (z / root - 1), DROP * (root - z)
    along = 2 * (1 - NU) * integral.imag + z.imag * stress.real
    across = -(1 - 2 * NU) * integral.real - z.imag * stress.imag
    sliding = np.stack([along, across], axis=1) / (2 * shear)
    # The rock without a crack: plane strain under -SIGMA along x.
    uniform = SIGMA / (4 * shear * (lame + shear)) * np.array([-lame - 2 * shear, lame])
    return points * uniform + sliding @ TURN.T


def grid(cells, graded):
    """Places along the crack and across it, with ``cells`` on each half of the crack.

    Those of equal length, or ever shorter ones towards the tips, where stresses are infinite.
    """
    if not graded:
        x = np.linspace(-FAR, FAR, 2 * round(cells * FAR / HALF) + 1)
        return x, x
    from_tip = (np.arange(cells + 1) / cells) ** 3
    ahead = HALF + np.append(-HALF * from_tip, (FAR - HALF) * from_tip)
    across = FAR * (np.arange(1.5 * cells + 1) / (1.5 * cells)) ** 3
    return np.unique(np.append(-ahead, ahead)), np.unique(np.append(-across, across))


def cracked_mesh(cells, graded):
    """Quadrilaterals, turned by ψ; the faces of the crack are ``above`` and ``below``."""
    mesh = fem.box(grid(cells, graded), "quadrilateral")
    x, y = mesh.p
    doubled = np.flatnonzero((np.abs(x) < HALF * (1 - 1e-9)) & (y == 0))
    number = np.arange(len(x))
    number[doubled] = len(x) + np.arange(len(doubled))
    upper = y[mesh.t].mean(axis=0) > 0
    t = np.where(upper, number[mesh.t], mesh.t)
    mesh = skfem.MeshQuad(np.hstack([mesh.p, mesh.p[:, doubled]]), t)
    crack = {0: (-HALF, HALF), 1: (0.0, 0.0)}
    faces = {
        "above": fem.surface(mesh, crack, normal=(0, -1)),
        "below": fem.surface(mesh, crack, normal=(0, 1)),
    }
    faces["outer"] = np.setdiff1d(
        mesh.boundary_facets(), np.concatenate([*faces.values()])
    )
    return skfem.MeshQuad(TURN @ mesh.p, t, faces)


class Crack(NamedTuple):
    """Places along the crack, slips [m] and tractions [Pa] there, and all else."""

    x: np.ndarray
    area: np.ndarray
    slip: np.ndarray
    traction: np.ndarray
    model: Any
    result: Any


def solve(cells, graded=False):
    """The crack with ``cells`` on each half of it."""
    rock = fem.Body("rock", cracked_mesh(cells, graded), fem.Material(YOUNG, NU))
    crack = fem.Contact("rock", "above", MU, against=("rock", "below"))
    model = fem.assemble([rock], [crack], [fem.Support("rock", "outer", [0, 1])])
    far = exact_displacement(model.nodes).ravel()[model.fixed]
    result = model.problem().solve(None, far)
    along = (model.points @ TURN)[:, 0]
    # The tangent t1 points to one side or the other along the crack.
    sign = np.sign(model.frame[:, 1] @ TURN[:, 0])
    slip, traction = sign * result.slip[0, :, 0], result.traction[0].copy()
    traction[:, 1] *= sign
    order = np.argsort(along)
    arrays = (a[order] for a in (along, model.area, slip, traction))
    return Crack(*arrays, model, result)


def errors(crack):
    """Relative errors in L² of the slip, the pressure and the shear, and of the largest slip."""

    def relative(computed, exact):
        squares = crack.area @ np.stack([(computed - exact) ** 2, exact**2], axis=1)
        return math.sqrt(squares[0] / squares[1])

    exact = exact_slip(crack.x)
    whole = np.ones_like(exact)
    return (
        relative(crack.slip, exact),
        relative(crack.traction[:, 0], PRESSURE * whole),
        relative(crack.traction[:, 1], -MU * PRESSURE * whole),
        abs(crack.slip.max() / exact.max() - 1),
    )


def main():
    """Print the errors of two families of meshes."""
    largest = 1e3 * exact_slip(0.0)
    print(f"pressure {PRESSURE / 1e6:.4f} MPa, largest slip {largest:.5f} mm")
    print(
        "cells          largest slip [mm]  error of the slip  order  of the tractions"
    )
    for graded in (False, True):
        last = None
        for cells in (10, 20, 40):
            crack = solve(cells, graded)
            slip, *tractions, _ = errors(crack)
            order = "" if last is None else f"{math.log2(last / slip):.2f}"
            name = f"{cells} {'graded' if graded else 'equal'}"
            bound = "< 1e-9" if max(tractions) < 1e-9 else f"{max(tractions):.0e}"
            computed = 1e3 * crack.slip.max()
            print(f"{name:14} {computed:.5f}  {slip:16.1e}  {order:>13}  {bound}")
            assert (crack.result.status == bp.Status.SLIP).all()
            last = slip


if __name__ == "__main__":
    main()
