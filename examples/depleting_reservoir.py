"""A vertical fault through a reservoir whose pressure falls.

`python examples/depleting_reservoir.py` prints errors and their orders. The layer between -b
and a right of the fault, and between -a and b left of it, loses pore pressure, Δp < 0
(J. D. Jansen and B. Meulenbroek, Netherlands Journal of Geosciences 101, 2022). -α Δp I is an
initial stress there, so α Δp / (3 K) I an initial strain. In an infinite body its displacement
is ``u = grad Φ`` with ``ΔΦ = e`` in the layer, 0 elsewhere, ``e = α Δp / (λ + 2 G)``: the
derivative of the sum of the potentials ``e ln r / (2 π)`` of its points. On a fault that does not
slip the shear traction is, with ``C = (1 - 2 ν) α Δp / (2 π (1 - ν))``,

    C / 2 · ln[(z - a)² (z + a)² / ((z - b)² (z + b)²)].

A fault without friction slips until it vanishes: dislocations of constant density m between a
and b, and -m between -b and -a, have this shear times ``m G / (2 π (1 - ν) C)``. So the slip is
linear there and constant between -a and a: ``(1 - 2 ν) α |Δp| (b - a) / G``.

The exact displacement of the infinite body is prescribed at the outer boundary.
"""

import math
from typing import Any, NamedTuple

import numpy as np

import bipot_rs as bp
from bipot_rs import fem

YOUNG, NU = 14.95e9, 0.15  # Pa
ALPHA, FALL = 0.9, -25e6  # Biot's coefficient, change of the pore pressure [Pa]
A, B, FAR = 75.0, 150.0, 300.0  # m
INITIAL, COHESION = 30e6, 5e6  # Pa; horizontal compression before the depletion
LAME, SHEAR = YOUNG * NU / (1 + NU) / (1 - 2 * NU), YOUNG / (2 * (1 + NU))
SHRINK = ALPHA * FALL / (LAME + 2 * SHEAR)  # e
SCALE = (1 - 2 * NU) * ALPHA * FALL / (2 * math.pi * (1 - NU))  # C
LAYERS = {"left": (-A, B), "right": (-B, A)}
SLIP = (1 - 2 * NU) * ALPHA * -FALL * (B - A) / SHEAR


def exact_shear(z):
    """Shear on the rock right of a fault that does not slip, upwards [Pa]."""
    return SCALE * np.log(np.abs((z**2 - A**2) / (z**2 - B**2)))


def exact_pressure(z):
    """Pressure on the fault: each layer that ends there takes G |e| [Pa]."""
    ends = sum((z > low) & (z < high) for low, high in LAYERS.values())
    return INITIAL + SHEAR * SHRINK * ends


def exact_slip(z):
    """Slip of a fault without friction: the right side against the left one, upwards [m]."""
    return -SLIP * np.clip((B - np.abs(z)) / (B - A), 0, 1)


def compression(points):
    """Displacement (n, 2) at points (n, 2) of the initial compression along x [m]."""
    return points * INITIAL / (4 * SHEAR * (LAME + SHEAR)) * [-LAME - 2 * SHEAR, LAME]


def depletion(points):
    """Displacement (n, 2) of both layers without slip [m]."""
    (x, z), u = points.T, np.zeros_like(points)
    for side, ends in LAYERS.items():
        right = 1 if side == "right" else -1
        for sign, end in zip((-1, 1), ends, strict=True):
            w = end - z
            distance = np.hypot(x, w)
            log = np.log(np.where(distance > 0, distance, 1.0))
            # ∫ ln r over the vertical end of the layer, and along its boundary.
            across = w * log + np.abs(x) * np.arctan2(w, np.abs(x))
            angle = np.pi / 2 + np.arctan2(right * x, np.abs(w))
            along = right * x * log + np.abs(w) * angle
            u += sign * np.stack([right * across, -along], axis=1)
    return SHRINK / (2 * np.pi) * u


def dislocations(points):
    """Displacement (n, 2) of the slip without friction, off the fault [m].

    By Westergaard's function in mode II, whose real axis points along the fault.
    """
    x, z = points.T
    s = z - 1j * x
    ends = ((1, -B), (-1, -A), (-1, A), (1, B))
    scale = -SLIP / (B - A) * SHEAR / (2 * np.pi * (1 - NU))
    stress = scale * sum(sign * np.log(s - end) for sign, end in ends)
    integral = scale * sum(sign * (s - end) * np.log(s - end) for sign, end in ends)
    along = 2 * (1 - NU) * integral.imag - x * stress.real
    across = -(1 - 2 * NU) * integral.real + x * stress.imag
    return np.stack([-across, along], axis=1) / (2 * SHEAR)


class Fault(NamedTuple):
    """Heights, slips [m] and tractions [Pa] along the fault, and all else."""

    z: np.ndarray
    slip: np.ndarray
    traction: np.ndarray
    model: Any
    result: Any


def solve(cells, mu, cohesion, far):
    """Rock with ``cells`` on each 75 m; ``far`` is the exact displacement of the depletion."""
    half = np.linspace(0, FAR, round(FAR / A) * cells + 1)
    height = np.unique(np.append(-half, half))
    rock = fem.Material(YOUNG, NU)
    bodies = [
        fem.Body(name, fem.box([sign * half, height], "quadrilateral"), rock)
        for name, sign in (("left", -1), ("right", 1))
    ]
    # Both sides of the ends are held: a traction there means nothing.
    inner = {1: (height[1], height[-2])}
    opposite = ("left", "right")
    fault = fem.Contact(
        "right", "left", mu, against=opposite, within=inner, cohesion=cohesion
    )
    sides = [("left", "left"), ("right", "right")]
    sides += [(body, side) for body in LAYERS for side in ("bottom", "top")]
    model = fem.assemble(
        bodies, [fault], [fem.Support(*side, [0, 1]) for side in sides]
    )
    load = np.zeros(model.n)
    for name, (low, high) in LAYERS.items():

        def fall(places, low=low, high=high):
            return FALL * ((places[1] > low) & (places[1] < high))

        expansion = ALPHA / (3 * LAME + 2 * SHEAR)
        load += model.initial_strain(name, fem.thermal(expansion, fall))
    outer = model.nodes[model.fixed[::2] // 2]
    before = compression(outer).ravel()
    prescribed = np.stack([before, before + far(outer).ravel()])
    result = model.problem().solve(np.stack([0 * load, load]), prescribed)
    z, up = model.points[:, 1], model.frame[:, 1, 1]
    slip = up * result.relative_displacement[-1, :, 1]
    traction = result.traction[-1] * np.stack([1 + 0 * up, up], axis=1)
    order = np.argsort(z)
    return Fault(z[order], slip[order], traction[order], model, result)


def error(z, values, exact):
    """Relative error in L² of values at heights z, linear between them."""
    points, weights = np.polynomial.legendre.leggauss(12)
    middle, half = (z[1:] + z[:-1]) / 2, np.diff(z) / 2
    places = middle[:, None] + half[:, None] * points
    wanted = exact(places)
    off = np.interp(places, z, values) - wanted
    squares = [half @ (field**2 @ weights) for field in (off, wanted)]
    return math.sqrt(squares[0] / squares[1])


def smooth(points):
    """Displacement (n, 2) of the depletion with a fault without friction [m]."""
    return depletion(points) + dislocations(points)


def main():
    """Print the errors on three meshes, without friction and held."""
    shear = exact_shear(0.0) / 1e6
    print(f"largest slip {SLIP:.6f} m; held, shear in the middle {shear:.5f} MPa")
    print("      without friction                       held")
    print("cells  largest slip [m]  errors: slip pressure  middle [MPa]  error: shear")
    for cells in (4, 8, 16):
        sliding, held = solve(cells, 0, 0, smooth), solve(cells, 1, COHESION, depletion)
        assert (held.result.status[-1] == bp.Status.STICK).all()
        slip = error(sliding.z, sliding.slip, exact_slip)
        pressure = error(sliding.z, sliding.traction[:, 0], exact_pressure)
        largest, middle = np.abs(sliding.slip).max(), held.traction[held.z == 0, 1][0]
        log = error(held.z, held.traction[:, 1], exact_shear)
        print(
            f"{cells:5}  {largest:16.6f}  {slip:12.1e} {pressure:8.1e}"
            f"  {middle / 1e6:12.5f}  {log:12.1e}"
        )


if __name__ == "__main__":
    main()
