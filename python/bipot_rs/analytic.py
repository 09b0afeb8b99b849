"""Closed forms to compare numerical contact solutions with.

Every formula holds in any consistent system of units; the units in the docstrings (N, m, Pa)
only show the dimensions. In two dimensions, forces are per unit thickness. Pressures and
normal reactions are positive in compression; `mu` is Coulomb's coefficient.

Source: K. L. Johnson, *Contact Mechanics*, Cambridge University Press, 1985,
doi:10.1017/CBO9781139171731, cited as [J85]. The discrete cases are derived here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats, integer, number


def _numbers(**values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(number(name, value)):
            raise ValueError(f"{name} must be finite, found {value!r}")


def _positive(**values: float) -> None:
    for name, value in values.items():
        positive_number = number(name, value)
        if not (math.isfinite(positive_number) and positive_number > 0):
            raise ValueError(f"{name} must be positive and finite, found {value!r}")


def _friction(mu: float) -> None:
    coefficient = number("mu", mu)
    if not (math.isfinite(coefficient) and coefficient >= 0):
        raise ValueError(f"mu must be finite and not negative, found {mu!r}")


def _poisson(name: str, nu: float) -> None:
    if not -1 < number(name, nu) <= 0.5:
        raise ValueError(f"{name} must lie in (-1, 0.5], found {nu!r}")


def _stick_ratio(force: float, tangential: float, mu: float) -> float:
    """1 - |Q|/(mu P), whose powers occur in the formulas of partial slip."""
    _positive(force=force, mu=mu)
    _numbers(tangential=tangential)
    if not abs(tangential) <= mu * force:
        raise ValueError(
            f"tangential must lie between -mu * force and mu * force = {mu * force!r}, "
            f"found {tangential!r}: a larger force slides the whole contact"
        )
    return 1 - abs(tangential) / (mu * force)


def _ellipse(x: Floats, half_width: float) -> Floats:
    """sqrt(1 - x²/a²) inside the contact, 0 outside and for a = 0."""
    if half_width == 0:
        return np.zeros_like(x)
    return np.asarray(np.sqrt(np.maximum(1 - (x / half_width) ** 2, 0.0)))


def contact_modulus(
    e1: float, nu1: float, e2: float = math.inf, nu2: float = 0.0
) -> float:
    """Contact modulus E* of two bodies in plane strain or in three dimensions, [J85, ch. 4].

    Parameters
    ----------
    e1, nu1
        Young's modulus, E₁ > 0 [Pa], and Poisson's ratio, -1 < ν₁ ≤ 1/2, of one body.
    e2, nu2
        The same for the other body; the default, an infinite modulus, makes it rigid.

    Returns
    -------
    float
        E* = [(1 - ν₁²)/E₁ + (1 - ν₂²)/E₂]⁻¹ [Pa].

    Raises
    ------
    ValueError
        When a modulus is not positive or a ratio out of range.
    """
    _positive(e1=e1)
    _poisson("nu1", nu1)
    _poisson("nu2", nu2)
    if not number("e2", e2) > 0:
        raise ValueError(f"e2 must be positive, found {e2!r}")
    return 1 / ((1 - nu1**2) / e1 + (1 - nu2**2) / e2)


def hertz_line(force: float, radius: float, e_star: float) -> tuple[float, float]:
    """Frictionless contact of a cylinder along a line, [J85, ch. 4].

    The approach of the bodies is not returned: in two dimensions it depends on their size
    (logarithmically).

    Parameters
    ----------
    force, radius
        Normal force per length, P > 0 [N/m]; relative radius of curvature, R [m].
    e_star
        Contact modulus, E* [Pa].

    Returns
    -------
    a, p0
        Half-width [m], peak pressure [Pa].
    """
    _positive(force=force, radius=radius, e_star=e_star)
    a = math.sqrt(4 * force * radius / (math.pi * e_star))
    return a, 2 * force / (math.pi * a)


def hertz_sphere(
    force: float, radius: float, e_star: float
) -> tuple[float, float, float]:
    """Frictionless contact of a sphere on an elastic half-space, [J85, (4.22)-(4.24)].

    Parameters
    ----------
    force, radius
        Normal force, P > 0 [N]; relative radius of curvature, R [m].
    e_star
        Contact modulus, E* = [(1 - ν₁²)/E₁ + (1 - ν₂²)/E₂]⁻¹ [Pa].

    Returns
    -------
    a, delta, p0
        Contact radius [m], approach [m], peak pressure [Pa].
    """
    _positive(force=force, radius=radius, e_star=e_star)
    a = (3 * force * radius / (4 * e_star)) ** (1 / 3)
    return a, a**2 / radius, 3 * force / (2 * math.pi * a**2)


def hertz_pressure(distance: ArrayLike, a: float, p0: float) -> Floats:
    """Pressure `p0 sqrt(1 - x²/a²)` of `hertz_line` and `hertz_sphere`, 0 outside.

    Parameters
    ----------
    distance
        Distance from the axis of the contact, any shape [m].
    a, p0
        Half-width or radius, > 0 [m]; peak pressure [Pa].

    Returns
    -------
    numpy.ndarray
        Pressure, of the shape of `distance` [Pa].
    """
    _positive(a=a)
    _numbers(p0=p0)
    return p0 * _ellipse(floats("distance", distance), a)


def partial_slip_traction(
    distance: ArrayLike, a: float, c: float, p0: float, mu: float
) -> Floats:
    """Tangential traction under a Hertz pressure that sticks for `distance <= c`, [J85, ch. 7].

    `μ p0 [sqrt(1 - x²/a²) - (c/a) sqrt(1 - x²/c²)]`, each term 0 outside its range. It is
    a magnitude: the traction on the loaded body is opposite to the tangential force.

    Parameters
    ----------
    distance
        Distance from the axis of the contact, any shape [m].
    a, c
        Half-width or radius of the contact and of its stick zone, 0 ≤ c ≤ a [m].
    p0, mu
        Peak pressure [Pa]; friction coefficient.

    Returns
    -------
    numpy.ndarray
        Traction, of the shape of `distance` [Pa].
    """
    _positive(a=a)
    _friction(mu)
    _numbers(p0=p0)
    if not 0 <= number("c", c) <= a:
        raise ValueError(f"c must lie between 0 and a = {a!r}, found {c!r}")
    x = floats("distance", distance)
    return mu * p0 * (_ellipse(x, a) - c / a * _ellipse(x, c))


def cattaneo_mindlin_line(
    force: float, tangential: float, radius: float, e_star: float, mu: float
) -> tuple[float, float, float]:
    """Line contact under a normal force, then a tangential force, [J85, ch. 7].

    Holds for bodies whose normal and tangential responses are uncoupled: equal
    materials, or both incompressible.

    Parameters
    ----------
    force, tangential
        Normal force P > 0 and tangential force Q, ``|Q| ≤ μP``, per length [N/m].
    radius, e_star, mu
        Relative radius [m], contact modulus [Pa], friction coefficient > 0.

    Returns
    -------
    a, c, p0
        Half-widths of the contact and of its stick zone [m], peak pressure [Pa]:
        `c = a sqrt(1 - |Q|/(μP))`.

    Raises
    ------
    ValueError
        When ``|Q| > μP``: there is no equilibrium.
    """
    ratio = _stick_ratio(force, tangential, mu)
    a, p0 = hertz_line(force, radius, e_star)
    return a, a * math.sqrt(ratio), p0


class MindlinSphere(NamedTuple):
    """Result of `mindlin_sphere`."""

    a: float
    """Contact radius [m]."""
    c: float
    """Radius of the stick zone [m]."""
    p0: float
    """Peak pressure [Pa]."""
    shift: float
    """Relative tangential displacement of distant points, along the force [m]."""


def mindlin_sphere(
    force: float,
    tangential: float,
    radius: float,
    e_star: float,
    mu: float,
    shear_compliance: float,
) -> MindlinSphere:
    """Sphere under a normal force, then a tangential force, [J85, ch. 7].

    For ν > 0 the theory neglects slip perpendicular to the force, so that its resultants
    have an error of a few percent. For ν = 0 it is exact.

    Parameters
    ----------
    force, tangential
        Normal force P > 0 and tangential force Q, ``|Q| ≤ μP`` [N].
    radius, e_star, mu
        Relative radius [m], contact modulus [Pa], friction coefficient > 0.
    shear_compliance
        Λ = (2 - ν₁)/G₁ + (2 - ν₂)/G₂ [1/Pa], G the shear modulus.

    Returns
    -------
    MindlinSphere
        `c = a (1 - |Q|/(μP))^(1/3)` and
        `shift = 3 μ P Λ/(16 a) [1 - (1 - |Q|/(μP))^(2/3)]`, with the sign of Q.

    Raises
    ------
    ValueError
        When ``|Q| > μP``: there is no equilibrium.
    """
    _positive(shear_compliance=shear_compliance)
    ratio = _stick_ratio(force, tangential, mu)
    a, _, p0 = hertz_sphere(force, radius, e_star)
    shift = 3 * mu * force * shear_compliance / (16 * a) * (1 - ratio ** (2 / 3))
    return MindlinSphere(a, a * ratio ** (1 / 3), p0, math.copysign(shift, tangential))


def sheared_patch(
    height: ArrayLike, pressure: float, shear: float, young: float
) -> tuple[Floats, Floats]:
    """Block with ν = 0 under uniform pressure and shear that sticks to a rigid plane.

    With `σ_yy = -p`, `σ_xy = τ` on all loaded faces the stress is uniform, and finite
    elements that represent linear displacements are exact. The nodal reactions are `p` and
    `-τ` times the tributary length. The block sticks if and only if ``|τ| ≤ μp``; otherwise
    there is no equilibrium.

    Parameters
    ----------
    height
        Height over the plane, any shape [m].
    pressure, shear
        p [Pa]; τ [Pa], positive if the shear load on the top acts in +x.
    young
        Young's modulus, E > 0 [Pa]; the shear modulus is E/2.

    Returns
    -------
    u_x, u_y
        `2 τ y/E`, `-p y/E`, each of the shape of `height` [m].
    """
    _positive(young=young)
    _numbers(pressure=pressure, shear=shear)
    y = floats("height", height)
    return np.asarray(2 * shear * y / young), np.asarray(-pressure * y / young)


def oedometer(height: ArrayLike, pressure: float, young: float, nu: float) -> Floats:
    """Vertical displacement of a block under pressure between smooth rigid side walls.

    Uniaxial strain: `u = -p y/M`, `M = E (1 - ν)/((1 + ν)(1 - 2ν))`. Reactions are
    `p` times the tributary area; tangential reactions are zero for every friction.

    Parameters
    ----------
    height
        Height over the plane, any shape [m].
    pressure, young, nu
        p [Pa]; E > 0 [Pa]; Poisson's ratio, at most 1/2, for which the result is 0.

    Returns
    -------
    numpy.ndarray
        Displacement, of the shape of `height`, negative downwards [m].
    """
    _positive(young=young)
    _poisson("nu", nu)
    _numbers(pressure=pressure)
    y = floats("height", height)
    return np.asarray(-pressure * y * (1 + nu) * (1 - 2 * nu) / (young * (1 - nu)))


def bar_end_displacement(loads: ArrayLike, stiffness: float, limit: float) -> Floats:
    """End displacement of a bar on a frictional foundation over a load history.

    A bar of stiffness EA lies on a foundation with the friction limit q per length. P acts
    at its end; the bar is so long that it never slips as a whole (``|P| < qL``). In first
    loading it slips over the length ``|P|/q``, and `u = P|P|/(2 EA q)`. After a reversal
    at P₀ the limit is doubled: `u = u₀ ∓ (P₀ - P)²/(4 EA q)`. A load that returns to the
    reversal before the last one closes a loop: both reversals are removed, and the earlier
    branch continues.

    Parameters
    ----------
    loads
        End loads, starting from the unloaded state, (steps,) [N]. The load is monotone
        between two entries.
    stiffness, limit
        EA > 0 [N]; q > 0 [N/m], friction coefficient times normal load per length.

    Returns
    -------
    numpy.ndarray
        End displacement after each entry, (steps,) [m].
    """
    _positive(stiffness=stiffness, limit=limit)
    path = floats("loads", loads, ndim=1)
    scale = 1 / (2 * stiffness * limit)
    turns: list[tuple[float, float]] = []  # (load, displacement) of reversals kept
    load = shift = 0.0
    out = np.empty_like(path)
    for k, target in enumerate(path):
        origin = turns[-1][0] if turns else 0.0
        # The product of the differences themselves may underflow.
        if np.sign(target - load) * np.sign(load - origin) < 0:
            turns.append((load, shift))
        # A branch that reaches the reversal before its own closes a loop.
        while len(turns) > 1 and abs(target - turns[-1][0]) >= abs(
            turns[-2][0] - turns[-1][0]
        ):
            del turns[-2:]
        # At the mirror image of the first reversal, first loading continues.
        if len(turns) == 1 and abs(target - turns[0][0]) >= 2 * abs(turns[0][0]):
            turns.clear()
        if turns:
            since = target - turns[-1][0]
            shift = turns[-1][1] + scale * since * abs(since) / 2
        else:
            shift = scale * target * abs(target)
        load = target
        out[k] = shift
    return out


def bar_cycle_dissipation(
    peak: float, stiffness: float, limit: float, element: float = 0.0
) -> float:
    """Energy dissipated by friction in a full cycle ±P₀ of `bar_end_displacement`.

    Parameters
    ----------
    peak
        P₀ > 0 [N].
    stiffness, limit
        EA > 0 [N]; q > 0 [N/m].
    element
        0 for the continuous bar; the element length h [m] for a chain of equal linear
        elements with nodal limits qh, qh/2 at the end, when P₀/(qh) is an integer.

    Returns
    -------
    float
        `2 P₀³/(3 EA q) + P₀ q h²/(3 EA)` [J]: exact in both cases, the same in every cycle.
    """
    _positive(peak=peak, stiffness=stiffness, limit=limit)
    _numbers(element=element)
    if not element >= 0:
        raise ValueError(f"element must not be negative, found {element!r}")
    return 2 * peak**3 / (3 * stiffness * limit) + peak * limit * element**2 / (
        3 * stiffness
    )


class Branch(NamedTuple):
    """One solution of `one_contact_branches`; vectors are (normal, tangential)."""

    status: str
    """`"open"`, `"slip"` or `"stick"`."""
    displacement: tuple[float, float]
    """(u_n, u_t) [m]."""
    reaction: tuple[float, float]
    """(r_n, r_t) [N]."""


def one_contact_branches(
    stiffness: ArrayLike, load: ArrayLike, mu: float
) -> list[Branch]:
    """All solutions of one contact in two dimensions, with zero gap and no history.

    `K u = f + r` with `u_n ≥ 0`. For `μ < k_t/|k_c|` there is exactly one solution for
    every load; for larger μ there are one to three. The function tries all statuses of (6)
    and (8) of `docs/theory.md`.

    Parameters
    ----------
    stiffness
        Symmetric positive definite `[[k_n, k_c], [k_c, k_t]]`, (2, 2) [N/m].
    load
        (f_n, f_t), (2,) [N].
    mu
        Friction coefficient.

    Returns
    -------
    list of Branch
        The solutions that exist, in the order open, stick, slip towards +t, slip towards
        -t. At a limit between two statuses both are listed.

    Raises
    ------
    ValueError
        When the stiffness is not symmetric positive definite.
    """
    _friction(mu)
    k = floats("stiffness", stiffness, shape=(2, 2))
    f_n, f_t = (float(x) for x in floats("load", load, shape=(2,)))
    k_n, k_c, k_t = float(k[0, 0]), float(k[0, 1]), float(k[1, 1])
    det = k_n * k_t - k_c * k_c
    if k[1, 0] != k_c or not (k_n > 0 and det > 0):
        raise ValueError(
            "stiffness must be a symmetric positive definite 2 by 2 matrix"
        )
    branches = []
    if k_t * f_n - k_c * f_t >= 0:
        u = ((k_t * f_n - k_c * f_t) / det, (k_n * f_t - k_c * f_n) / det)
        branches.append(Branch("open", u, (0.0, 0.0)))
    if f_n <= 0 and abs(f_t) <= -mu * f_n:
        branches.append(Branch("stick", (0.0, 0.0), (-f_n, -f_t)))
    for s in (1.0, -1.0):
        tangent = k_t + s * mu * k_c
        if tangent == 0:
            continue
        u_t = (f_t + s * mu * f_n) / tangent
        r_n = k_c * u_t - f_n
        # u_t = 0 is the limit of sticking, which is listed as stick.
        if s * u_t > 0 and r_n >= 0:
            branches.append(Branch("slip", (0.0, u_t), (r_n, -s * mu * r_n)))
    return branches


def rotating_load(
    stiffness: float, force: float, limit: float, steps: int | None = None
) -> tuple[float, float]:
    """Steady slip of one contact under a rotating tangential force.

    A contact has the normal force N and the tangential stiffness k in both directions. A
    force of constant magnitude F > μN rotates in `steps` equal implicit steps of the angle
    D per revolution. The displacement approaches a circle with
    `k |u| = sqrt(F² - μ²N² cos²(D/2)) - μN sin(D/2)`. The step error is of first order in D.

    Parameters
    ----------
    stiffness, force
        k > 0 [N/m]; F [N].
    limit
        μN, 0 < μN < F [N].
    steps
        Steps per revolution, at least 3; `None` gives the limit of infinitely many.

    Returns
    -------
    radius, dissipation
        ``|u|`` [m]; energy dissipated in a revolution of M steps, `2 M |u| sin(D/2) μN` [J].
    """
    _positive(stiffness=stiffness, force=force, limit=limit)
    if limit >= force:
        raise ValueError(f"limit must be less than force = {force!r}, found {limit!r}")
    if steps is None:
        radius = math.sqrt(force**2 - limit**2) / stiffness
        return radius, 2 * math.pi * radius * limit
    steps = integer("steps", steps, least=3)
    half = math.pi / steps
    root = math.sqrt(force**2 - (limit * math.cos(half)) ** 2)
    radius = (root - limit * math.sin(half)) / stiffness
    return radius, 2 * steps * radius * math.sin(half) * limit


def flat_punch_pressure(
    x: ArrayLike, force: float, half_width: float, mu: float = 0.0, beta: float = 0.0
) -> Floats:
    """Pressure under a flat rigid punch that does not tilt, [J85, ch. 2].

    Without friction `p = P/(π sqrt(a² - x²))`. For sliding towards -x with the traction μp
    everywhere, `p = P cos(πg)/(π sqrt(a² - x²)) ((a + x)/(a - x))^g`, `tan(πg) = μβ`: the
    pressure is higher at the trailing edge, x = +a, and its resultant acts at `x = 2ga`.

    Parameters
    ----------
    x
        Position, ``|x| < a``, any shape [m].
    force, half_width
        P > 0 per length [N/m]; a > 0 [m].
    mu, beta
        Friction coefficient; Dundurs' β, `(1 - 2ν)/(2(1 - ν))` for an elastic
        half-plane under a rigid punch.

    Returns
    -------
    numpy.ndarray
        Pressure, of the shape of `x` [Pa].

    Raises
    ------
    ValueError
        When a position is at an edge, where the pressure is infinite, or outside.
    """
    _positive(force=force, half_width=half_width)
    _friction(mu)
    _numbers(beta=beta)
    s = floats("x", x) / half_width
    if not np.all(np.abs(s) < 1):
        raise ValueError(f"x must lie inside the punch, |x| < {half_width!r}")
    g = math.atan(mu * beta) / math.pi
    mean = force * math.cos(math.pi * g) / (math.pi * half_width)
    return np.asarray(mean / np.sqrt(1 - s**2) * ((1 + s) / (1 - s)) ** g)
