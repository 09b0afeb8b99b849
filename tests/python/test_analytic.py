"""The closed forms satisfy their defining equations, and agree with published tables."""

import csv
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs import analytic
from support.places import REFERENCE

DATA = REFERENCE
# The tables print 12 significant digits.
PRINTED = 1e-11


def table(name: str) -> NDArray[np.float64]:
    return np.loadtxt(DATA / name, delimiter=",", skiprows=1)


def over_contact(
    traction: Callable[[NDArray[np.float64]], NDArray[np.float64]], a: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Midpoints in θ, x = a sin θ, with weights dx: spectral for square-root edges."""
    theta = (np.arange(2000) + 0.5) * math.pi / 2000 - math.pi / 2
    x = a * np.sin(theta)
    return x, traction(x) * a * np.cos(theta) * math.pi / 2000


def test_hertz_line_carries_its_load() -> None:
    force, radius, e_star = 35e3, 50.0, analytic.contact_modulus(210e3, 0.3, 70e3, 0.3)
    a, p0 = analytic.hertz_line(force, radius, e_star)
    _, p = over_contact(lambda x: analytic.hertz_pressure(x, a, p0), a)
    # The quadrature integrates 1 - sin² exactly: rounding only.
    assert p.sum() == pytest.approx(force, rel=1e-12)
    # NAFEMS advanced contact benchmark 1 prints 6.21 mm and 3585.37 MPa.
    assert a == pytest.approx(6.21, abs=0.005)
    assert p0 == pytest.approx(3585.37, rel=1e-5)


def test_hertz_sphere_carries_its_load() -> None:
    e_star = analytic.contact_modulus(1000.0, 0.3)
    force = 60 * math.pi
    a, delta, p0 = analytic.hertz_sphere(force, 8.0, e_star)
    ring = lambda r: analytic.hertz_pressure(r, a, p0) * np.abs(r) * math.pi  # noqa: E731
    _, p = over_contact(ring, a)
    # |r| has a kink at the axis, where the midpoint rule is of second order: 1e-6.
    assert p.sum() == pytest.approx(force, rel=1e-5)
    # ANSYS VM63 data: a = 1.009635, p0 = 88.2904, delta = 0.127420, to the digits printed.
    assert (a, p0, delta) == pytest.approx((1.009635, 88.2904, 0.127420), rel=5e-6)
    # Boussinesq: the displacement at the centre of a Hertz pressure is π p0 a/(2 E*).
    assert delta == pytest.approx(math.pi * p0 * a / (2 * e_star), rel=1e-14)
    exact = 4 / 3 * e_star * math.sqrt(8.0) * delta**1.5
    assert force == pytest.approx(exact, rel=1e-14)


def test_radii_grow_with_roots_of_the_force_and_units_are_kept() -> None:
    # a ~ P^(1/2) along a line, P^(1/3) under a sphere.
    for hertz, force in ((analytic.hertz_line, 4.0), (analytic.hertz_sphere, 8.0)):
        a, larger = (hertz(p, 1.0, 1.0)[0] for p in (1.0, force))
        assert larger == pytest.approx(2 * a, rel=1e-15)
    # Length by 2^10, force by 2^-7: powers of two, yet roots round, hence 1e-15 and not bits.
    s, c = 2.0**10, 2.0**-7
    a, delta, p0 = analytic.hertz_sphere(3.0, 2.0, 5.0)
    other = analytic.hertz_sphere(3 * c, 2 * s, 5 * c / s**2)
    assert other == pytest.approx((a * s, delta * s, p0 * c / s**2), rel=1e-15)
    a, p0 = analytic.hertz_line(3.0, 2.0, 5.0)
    line = analytic.hertz_line(3 * c / s, 2 * s, 5 * c / s**2)
    assert line == pytest.approx((a * s, p0 * c / s**2), rel=1e-15)


def test_cattaneo_mindlin_table() -> None:
    rows = table("cattaneo_2d.csv")
    mu, force = 0.3, 7.0
    for column, ratio in ((2, 0.3), (3, 0.6), (4, 0.9)):
        drag = ratio * mu * force
        a, c, p0 = analytic.cattaneo_mindlin_line(force, drag, 2.0, 11.0, mu)
        x = rows[:, 0] * a
        p = analytic.hertz_pressure(x, a, p0) / p0
        np.testing.assert_allclose(p, rows[:, 1], atol=PRINTED)
        q = analytic.partial_slip_traction(x, a, c, p0, mu) / (mu * p0)
        # The square root at the edge of the stick zone magnifies the 1e-16 of x/c.
        np.testing.assert_allclose(q, rows[:, column], atol=1e-8)


def test_mindlin_table() -> None:
    mu, force, compliance = 0.4, 5.0, 0.7
    for ratio, c_sphere, shift, c_line in table("mindlin_monotone.csv"):
        tangential = ratio * mu * force
        got = analytic.mindlin_sphere(force, tangential, 2.0, 11.0, mu, compliance)
        unit = 3 * mu * force * compliance / (16 * got.a)
        assert got.c / got.a == pytest.approx(c_sphere, abs=PRINTED)
        assert got.shift / unit == pytest.approx(shift, abs=PRINTED)
        a, c, _ = analytic.cattaneo_mindlin_line(force, tangential, 2.0, 11.0, mu)
        assert c / a == pytest.approx(c_line, abs=PRINTED)


def test_patch_and_oedometer_satisfy_hooke() -> None:
    # A1 of the reference set: w = 3, H = 1, E = 10, p = 2, τ = 0.6.
    u = analytic.sheared_patch(1.0, 2.0, 0.6, 10.0)
    assert [float(x) for x in u] == pytest.approx([0.12, -0.2], rel=1e-15)

    def top(nu: float) -> float:
        return float(analytic.oedometer(1.0, 1.0, 1.0, nu))

    # A2: tops at E = p = H = 1, digits as printed; 1 - 2ν loses ε/(1 - 2ν).
    assert top(0.3) == pytest.approx(-0.742857142857, rel=1e-12)
    assert top(0.4999) == pytest.approx(-5.99840032e-4, rel=1e-8)
    assert top(0.4999999) == pytest.approx(-5.9999984e-7, rel=1e-7)
    assert top(0.5) == 0.0
    # Uniaxial strain: σ_yy = (λ + 2G) ε_yy.
    lame, shear = 0.3 / (1.3 * 0.4), 1 / 2.6
    assert (lame + 2 * shear) * top(0.3) == pytest.approx(-1.0, rel=1e-15)


def test_bar_table() -> None:
    rows = table("bar_cyclic.csv")
    got = analytic.bar_end_displacement(rows[:, 0], 1000.0, 50.0)
    np.testing.assert_allclose(got, rows[:, 2], atol=1e-16)


def test_bar_forgets_closed_loops() -> None:
    # 10, 5, 8, 5: the inner loop closes at 5. Then 12 continues the first loading, -12 reaches
    # its mirror image, and -13 goes beyond it.
    loads = np.array([10.0, 5.0, 8.0, 5.0, 12.0, -12.0, -13.0])
    u = analytic.bar_end_displacement(loads, 1000.0, 50.0)
    assert u[3] == pytest.approx(u[1], rel=1e-14)
    for k in (0, 4, 5, 6):
        assert u[k] == pytest.approx(loads[k] * abs(loads[k]) / 1e5, rel=1e-14)
    # Small steps along the same path give the same: the law has no rate and no step.
    fine = np.interp(np.arange(1, 281) / 40, np.arange(8), [0, *loads])
    again = analytic.bar_end_displacement(fine, 1000.0, 50.0)[39::40]
    np.testing.assert_allclose(again, u, rtol=1e-12)


def test_one_contact_branches_table() -> None:
    listed: dict[tuple[float, float], list[tuple[str, list[float]]]] = {}
    with (DATA / "one_contact_branches.csv").open() as file:
        for row in csv.DictReader(file):
            values = [float(row[name]) for name in ("u_n", "u_t", "r_n", "r_t")]
            key = float(row["mu"]), float(row["f_t"])
            listed.setdefault(key, []).append((row["status"].rstrip("+-"), values))
    assert len(listed) > 40
    K = [[2.0, 0.5], [0.5, 1.0]]
    for (mu, f_t), rows in listed.items():
        branches = analytic.one_contact_branches(K, [-1.0, f_t], mu)
        own = sorted((b.status, [*b.displacement, *b.reaction]) for b in branches)
        for (status, got), (known, want) in zip(own, sorted(rows), strict=True):
            assert status == known, (mu, f_t)
            assert got == pytest.approx(want, rel=PRINTED, abs=PRINTED)


def test_one_contact_branches_satisfy_the_law() -> None:
    rng = np.random.default_rng(7)
    for _ in range(500):
        root = rng.normal(size=(2, 2))
        k = root @ root.T + 0.1 * np.eye(2)
        k[1, 0] = k[0, 1]
        load, mu = rng.normal(size=2) * 3, float(rng.exponential())
        branches = analytic.one_contact_branches(k, load, mu)
        assert len(branches) in {1, 3}  # odd, except at limits, which have measure zero
        for branch in branches:
            u, r = np.array(branch.displacement), np.array(branch.reaction)
            # Two unknowns by Cramer's rule: the condition of k times ε.
            size = np.linalg.norm(load) + np.linalg.norm(r)
            rounding = np.linalg.cond(k) * 1e-14 * size
            assert np.linalg.norm(k @ u - load - r) <= rounding
            assert min(u[0], r[0]) == 0
            assert abs(r[1]) <= mu * r[0] * (1 + 1e-15)
            assert r[1] * u[1] == pytest.approx(-mu * r[0] * abs(u[1]), rel=1e-14)


def test_rotating_load_table() -> None:
    with (DATA / "rotating_load.csv").open() as file:
        rows = list(csv.reader(file))[1:]
    for name, radius, lost in rows:
        steps = None if name == "inf" else int(name)
        got = analytic.rotating_load(2.0, 0.8, 0.5, steps)
        assert got == pytest.approx((float(radius), float(lost)), rel=PRINTED)


@pytest.mark.parametrize(
    ("form", "arguments", "name"),
    [
        ("contact_modulus", (1.0, 0.6), "nu"),
        ("cattaneo_mindlin_line", (1.0, 0.4, 1.0, 1.0, 0.3), "tangential"),
        ("mindlin_sphere", (1.0, -0.4, 1.0, 1.0, 0.3, 1.0), "tangential"),
        ("partial_slip_traction", (0.0, 1.0, 2.0, 1.0, 0.3), "c must"),
        ("oedometer", (1.0, 1.0, 1.0, 0.51), "nu"),
        ("one_contact_branches", ([[1.0, 2], [2, 1]], [0.0, 0], 0.1), "stiff"),
        ("rotating_load", (1.0, 1.0, 2.0), "limit"),
        ("rotating_load", (1.0, 2.0, 1.0, 2), "steps"),
        ("flat_punch_pressure", ([0.0, 1.0], 1.0, 1.0), "x must"),
    ],
)
def test_bad_arguments_are_named(form: str, arguments: Any, name: str) -> None:
    with pytest.raises(ValueError, match=name):
        getattr(analytic, form)(*arguments)


_PRESSED = {"force": 1.0, "radius": 2.0, "e_star": 3.0}
_AT = {"distance": [0.0, 0.5], "a": 1.0, "p0": 2.0}
_DRAGGED = _PRESSED | {"tangential": 0.1, "mu": 0.3}
_LAYER = {"height": [0.0, 1.0], "pressure": 1.0, "young": 2.0}
# Valid arguments of every function of `analytic`, by name.
CLOSED_FORMS: dict[str, dict[str, Any]] = {
    "contact_modulus": {"e1": 2.0, "nu1": 0.3, "e2": 3.0, "nu2": 0.2},
    "hertz_line": _PRESSED,
    "hertz_sphere": _PRESSED,
    "hertz_pressure": _AT,
    "partial_slip_traction": _AT | {"c": 0.4, "mu": 0.3},
    "cattaneo_mindlin_line": _DRAGGED,
    "mindlin_sphere": _DRAGGED | {"shear_compliance": 1.0},
    "sheared_patch": _LAYER | {"shear": 0.1},
    "oedometer": _LAYER | {"nu": 0.3},
    "bar_end_displacement": {"loads": [1.0, -1.0], "stiffness": 2.0, "limit": 3.0},
    "bar_cycle_dissipation": {"peak": 1.0, "stiffness": 2.0, "limit": 3.0}
    | {"element": 0.1},
    "one_contact_branches": {"stiffness": np.eye(2), "load": [-1.0, 0.2], "mu": 0.3},
    "rotating_load": {"stiffness": 1.0, "force": 2.0, "limit": 1.0, "steps": 8},
    "flat_punch_pressure": {"x": [0.0, 0.5], "force": 1.0, "half_width": 1.0}
    | {"mu": 0.3, "beta": 0.2},
}


def test_wrong_arguments_are_named() -> None:
    for name, arguments in CLOSED_FORMS.items():
        function = getattr(analytic, name)
        function(**arguments)
        for argument in arguments:
            for bad in (math.nan, -math.inf, "much", 1j, [[[1.0], [2, 3]]], {}, True):
                with pytest.raises((ValueError, TypeError), match=rf"\b{argument}\b"):
                    function(**arguments | {argument: bad})
