"""Derivatives of a sphere on an elastic half-space, by Hertz, Cattaneo and Mindlin.

Square cells with even pressure on a half-space whose kernel of tangential tractions is `RATIO`
times that of pressures, without coupling, as Cattaneo and Mindlin assume. Contact, and slip, end
at a cell: both radii are within half a cell of the true ones. The derivatives are those of the
cells, and tend to those of the circles.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp

Array = NDArray[np.float64]

MODULUS = 2.0  # E* = E / (1 - ν²)
RADIUS = 10.0
DEPTH = 0.1
RATIO = 1.3
MU = 0.4
SHIFT = 0.02

CONTACT = np.sqrt(RADIUS * DEPTH)
FORCE = 4 / 3 * MODULUS * CONTACT**3 / RADIUS
# The radius of the stick zone: δ_x = μ κ (a² - c²) / R.
STICK = np.sqrt(CONTACT**2 - RADIUS * SHIFT / (MU * RATIO))


def of_cells(x: Array, side: float) -> Array:
    """Displacement of each centre by even pressure of force 1 on each square, [J85, 3.3]."""
    dx, dy = (x[:, None, k] - x[None, :, k] for k in range(2))
    integral = np.zeros_like(dx)
    for i, j in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        u, v = dx + i * side / 2, dy + j * side / 2
        far = np.hypot(u, v)
        integral += i * j * (u * np.log(v + far) + v * np.log(u + far))
    return integral / (np.pi * MODULUS * side**2)


def pressed(cells: int) -> bp.Solution:
    """The sphere, pressed and shifted along x; ``cells`` to the radius of contact."""
    side = CONTACT / cells
    line = side * (np.arange(-cells - 1, cells + 1) + 0.5)
    x = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    x = x[np.hypot(*x.T) < 1.1 * CONTACT]
    W = np.kron(of_cells(x, side), np.diag([1.0, RATIO, RATIO]))
    q = np.zeros((len(x), 3))
    q[:, 0] = (x**2).sum(axis=1) / (2 * RADIUS) - DEPTH
    q[:, 1] = SHIFT
    return bp.ReducedProblem(W, q, MU).solve(tol=1e-12)


def off(cells: int) -> Array:
    """Errors of ``dP/dδ``, ``dQ/dδ_x`` and ``dQ/dμ``, relative to their largest term."""
    pressed_body = pressed(cells)
    # The force itself, so that the derivatives have something to agree with: of the second
    # order in the cells, 1 % is the square of a tenth.
    reaction = pressed_body.reaction
    assert reaction[:, 0].sum() == pytest.approx(FORCE, rel=0.01)
    tangential = MU * FORCE * (1 - (STICK / CONTACT) ** 3)
    assert -reaction[:, 1].sum() == pytest.approx(tangential, rel=0.01)
    deeper, further = (np.zeros((len(pressed_body.reaction), 3)) for _ in range(2))
    deeper[:, 0], further[:, 1] = -1.0, 1.0
    ours = [
        pressed_body.jvp(q=deeper).reaction[:, 0].sum(),
        -pressed_body.jvp(q=further).reaction[:, 1].sum(),
        -pressed_body.jvp(mu=1.0).reaction[:, 1].sum(),
    ]
    # Q = μ P (1 - c³/a³), and c grows with μ.
    slides = FORCE * (1 - (STICK / CONTACT) ** 3)
    grown = RADIUS * SHIFT / (2 * STICK * MU**2 * RATIO)
    sticks = MU * FORCE * 3 * STICK**2 / CONTACT**3 * grown
    size = np.array([2 * MODULUS * CONTACT, 2 * MODULUS * STICK / RATIO, slides])
    exact = np.array([*size[:2], slides - sticks])
    return np.abs(ours - exact) / size


def test_derivatives_of_hertz_cattaneo_and_mindlin() -> None:
    """``dP/dδ = 2 E* a``, ``dQ/dδ_x = 2 E* c / κ``, and that by μ."""
    # Half a cell of the radius c = 0.78 a.
    assert (off(10) <= 0.5 / 10 / (STICK / CONTACT)).all()
