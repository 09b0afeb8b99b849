"""Positions along lines of contacts equal distances along the line."""

from dataclasses import replace

import numpy as np
import pytest

from bipot_rs import fem
from bipot_rs.plots.arc_length import places
from bipot_rs.plots.data import DrawnContacts
from bipot_rs.plots.surface import plane_of

RANDOM = np.random.default_rng(5)


def arc(
    start: float, end: float, count: int, radius: float = 3.0
) -> tuple[np.ndarray, np.ndarray]:
    """Points of a circle in random order, and their angles."""
    angle = RANDOM.permutation(np.linspace(start, end, count))
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), angle


@pytest.mark.parametrize(("start", "end"), [(0.2, 2.4), (3.3, 6.0), (0.5, 5.9)])
def test_an_arc_goes_from_its_end_of_least_x(start: float, end: float) -> None:
    x, angle = arc(start, end, 30)
    line = places(x, None)
    exact = np.linspace(*sorted((start, end), key=np.cos), 30)
    np.testing.assert_allclose(angle[line.order], exact, rtol=1e-12)
    # Sums of 29 equal chords of order one.
    chord = 6 * np.sin(np.abs(end - start) / 29 / 2)
    np.testing.assert_allclose(line.s, chord * np.arange(30), rtol=0, atol=1e-13)
    assert line.name == "arc length from the end of least x"
    # If x is equal at both ends, from that of least y.
    x, _ = arc(-1.0, 1.0, 15)
    line = places(x, "arc")
    assert (np.diff(x[line.order, 1]) > 0).all()
    assert line.name == "arc length from the end of least y"


@pytest.mark.parametrize("mirrored", [False, True])
def test_arc_length_of_a_ring_is_counter_clockwise(mirrored: bool) -> None:
    count = 31
    x, angle = arc(0.0, 2 * np.pi * (1 - 1 / count), count)
    if mirrored:
        x, angle = x * [1, -1], -angle % (2 * np.pi)
    line = places(x, None)
    assert line.order[0] == line.order[-1]
    exact = 2 * np.pi / count * np.arange(count)
    np.testing.assert_allclose(angle[line.order[:-1]], exact, atol=1e-12)
    chord = 6 * np.sin(np.pi / count)
    np.testing.assert_allclose(line.s, chord * np.arange(count + 1), rtol=1e-12)
    # Tangents of the circle; the first and the last are equal.
    tangent = np.stack([-x[line.order, 1], x[line.order, 0]], axis=1) / 3
    np.testing.assert_allclose(line.towards, tangent, atol=1e-12)
    assert line.name == "arc length from largest x, counter-clockwise"
    # Without two of its contacts the ring is open.
    there = np.argsort(angle)[1:-1]
    line = places(x[there], None)
    assert line.name.startswith("arc length from the end of least")
    assert len(line.order) == count - 2


def test_a_graded_ring_is_closed() -> None:
    """Spacings that grow by 1.3 and shrink again, as in a mesh refined at one place."""
    step = 1.3 ** np.concatenate([np.arange(8), np.arange(8)[::-1]])
    angle = RANDOM.permutation(2 * np.pi * np.cumsum(step) / step.sum())
    x = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    line = places(x, None)
    assert "counter-clockwise" in line.name
    around = angle[line.order]
    assert np.sum(np.diff(around) < 0) == 1  # # where the angle starts again


def test_two_sides_of_a_corner_are_one_chain() -> None:
    s = np.arange(0.0, 6.5, 0.5)
    low = np.minimum(s, 3.0)
    x = np.stack([low, s - low], axis=1)
    order = RANDOM.permutation(len(x))
    line = places(x[order], None)
    np.testing.assert_allclose(line.s, s, atol=1e-14)
    np.testing.assert_array_equal(order[line.order], np.arange(len(x)))


@pytest.mark.parametrize(
    ("direction", "name"),
    [
        ([1.0, 0.0], "x"),
        ([-1.0, 0.0], "x"),
        ([0.0, -2.0], "y"),
        ([3.0, 4.0], "along (0.6, 0.8)"),
        ([3.0, -4.0], "along (-0.6, 0.8)"),
    ],
)
def test_straight_lines_have_their_coordinate(
    direction: list[float], name: str
) -> None:
    t = RANDOM.permutation(np.arange(9.0))
    x = np.array([0.25, 2.0]) + t[:, None] * np.array(direction)
    line = places(x, None)
    assert line.name == name
    size = np.linalg.norm(direction)
    np.testing.assert_allclose(np.diff(line.s), size, rtol=1e-12)
    if name in "xy":
        np.testing.assert_array_equal(line.s, np.sort(x[:, "xy".index(name)]))


def test_rotation_and_scaling_keep_the_line() -> None:
    x, _ = arc(0.3, 2.0, 20)
    line = places(x, "arc")
    turn = np.linalg.qr(RANDOM.standard_normal((3, 3)))[0]
    in_space = 1e6 * np.column_stack([x, np.zeros(len(x))]) @ turn.T
    other = places(in_space, "arc")
    steps = 1e6 * np.diff(line.s)
    np.testing.assert_allclose(np.diff(other.s), steps, rtol=1e-9)
    order = list(other.order)
    assert order in (list(line.order), list(line.order[::-1]))


def test_arc_length_of_a_ring_in_3d() -> None:
    x, angle = arc(0.0, 2 * np.pi * 0.95, 20)
    # In the plane of y and z; counter-clockwise, seen from +x, goes from y to z.
    line = places(np.column_stack([np.full(20, 7.0), x]), "arc")
    np.testing.assert_allclose(np.diff(angle[line.order[:-1]]), np.pi / 10, rtol=1e-9)
    assert line.name == ("arc length from largest y, counter-clockwise seen from +x")


def test_surface_is_refused_as_a_line() -> None:
    u, v = np.meshgrid(np.arange(6.0), np.arange(6.0))
    x = np.stack([u.ravel(), v.ravel(), 0 * u.ravel()], axis=1)
    assert not places(x, "x").once
    assert places(x[:6], "x").once
    for points, along, said in (
        (x, "arc", "do not lie on one line: select"),
        (x, "w", "along is 'w', expected x, y, z, arc"),
        (x[:, :2], "z", "along is 'z', expected x, y, arc"),
    ):
        with pytest.raises(ValueError, match=said):
            places(points, along)
    # One contact is a line.
    for along in (None, "arc"):
        assert places(np.array([[2.0, 3.0]]), along).s == [2.0]


def test_a_roller_does_not_scale_the_plane_under_it() -> None:
    """Its inclined normals do not change positions along the plane."""
    u, v = np.meshgrid(np.linspace(1, 4, 5), np.linspace(-1, 1, 4))
    x = np.stack([u.ravel(), v.ravel(), np.full(u.size, 0.5)], axis=1)
    away = (x - [0.0, 0.0, 10.0]) * [1, 0, 1]  # from a cylinder along y above the plane
    n = len(x)
    seen = DrawnContacts(
        x=x,
        frame=fem.frames(away),
        area=None,
        mu=None,
        reaction=np.zeros((n, 3)),
        status=np.zeros(n, np.int8),
        gap=np.zeros(n),
        slip=np.zeros((n, 2)),
        units={},
    )
    uv, names = plane_of(seen)
    assert names == ["x", "y"]
    np.testing.assert_array_equal(uv, x[:, :2])
    turn = np.linalg.qr(RANDOM.standard_normal((3, 3)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    uv, names = plane_of(replace(seen, x=x @ turn.T, frame=seen.frame @ turn.T))
    assert names == ["along mean t1", "along mean t2"]
    exact = x[:, :2] - x[:, :2].mean(axis=0)
    np.testing.assert_allclose(uv - uv.mean(axis=0), exact, atol=1e-12)
