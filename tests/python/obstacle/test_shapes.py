"""Rigid obstacles: closest points, signs, normals, and rigid motions."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bipot_rs import obstacle as ob
from support.comparisons import near, refused
from support.spheres import cube, icosphere

# Rounding of some ten operations on numbers of size 1.
EXACT = 1e-14


def around(dim: int, count: int = 300, seed: int = 0) -> np.ndarray:
    """Points at distances 0.6 to 1.5 from the origin."""
    random = np.random.default_rng(seed)
    x = random.normal(size=(count, dim))
    far = random.uniform(0.6, 1.5, count)
    return x * (far / np.linalg.norm(x, axis=1))[:, None]


def square() -> ob.Surface:
    """The boundary of the unit square, with outward normals."""
    corners = [[0, 0], [1, 0], [1, 1], [0, 1]]
    return ob.Surface(corners, [[0, 1], [1, 2], [2, 3], [3, 0]])


CUBE = ob.Surface(*cube())


def box_distance(x: np.ndarray) -> np.ndarray:
    """Signed distance of the unit square or cube, in closed form."""
    off = np.abs(x - 0.5) - 0.5
    outside = np.linalg.norm(np.maximum(off, 0), axis=1)
    return outside + np.minimum(off.max(axis=1), 0)


UP = [0, 0, 1]


def torus(
    major: float = 1.0, minor: float = 0.5, centre: Any = (0, 0, 0), axis: Any = UP
) -> ob.Torus:
    return ob.Torus(centre, axis, major, minor)


SHAPES: dict[str, tuple[Any, int]] = {
    "plane": (ob.Plane([0.1, 0.2, 0.3], [1, 2, -2]), 3),
    "line": (ob.Plane([0.1, 0.2], [3, 4]), 2),
    "sphere": (ob.Sphere([0.1, 0, 0], 1.0), 3),
    "cavity": (ob.Sphere([0.1, 0, 0], 1.0, inside=True), 3),
    "disc": (ob.Cylinder([0.1, 0.2], 0.7), 2),
    "bar": (ob.Cylinder([0, 0, 0.1], 0.5, axis=[1, 1, 0]), 3),
    "bore": (ob.Cylinder([0, 0, 0.1], 0.5, axis=[1, 1, 0], inside=True), 3),
    "torus": (ob.Torus([0.1, 0, 0], [1, 2, -2], 1.0, 0.4), 3),
    "tube": (ob.Torus([0.1, 0, 0], [1, 2, -2], 1.0, 0.4, inside=True), 3),
    "square": (square(), 2),
    "cube": (CUBE, 3),
    "ball of triangles": (ob.Surface(*icosphere(2)), 3),
    "formula": (ob.Distance(lambda x: np.linalg.norm(x, axis=1) - 1), 3),
    "two": (ob.Union([ob.Plane([0, 0, -1], [0, 0, 1]), ob.Sphere([0, 0, 0], 0.5)]), 3),
}


@pytest.mark.parametrize("name", SHAPES)
def test_properties_of_every_obstacle(name: str) -> None:
    shape, dim = SHAPES[name]
    x = around(dim)
    distance, normal, foot = shape.closest(x)
    assert distance.min() < 0 < distance.max()
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=EXACT)
    near(foot, x - distance[:, None] * normal, 2 * EXACT)
    # The closest point is on the obstacle, and no point is nearer: |d(x) - d(y)| ≤ |x - y|.
    assert np.abs(shape.closest(foot).distance).max() <= 1e-9
    y = around(dim, seed=1)
    apart = np.linalg.norm(x - y, axis=1)
    assert (np.abs(distance - shape.closest(y).distance) <= apart + EXACT).all()
    # Along the outward normal the distance grows as fast as the path.
    ahead = x + 1e-6 * normal
    grown = shape.closest(ahead).distance - distance
    np.testing.assert_allclose(grown, 1e-6, rtol=1e-6)


def test_torus_by_hand() -> None:
    """Above, inside and next to the tube, and at the centre of the ring."""
    x = np.array([[0, 2.0, 1.5], [2.25, 0, 0], [0, -3, 0], [0, 0, 0], [0, 0, 1.5]])
    closest = torus(2.0, axis=[0, 0, -5]).closest(x)
    np.testing.assert_allclose(closest.distance, [1, -0.25, 0.5, 1.5, 2], rtol=EXACT)
    normals = [[0, 0, 1], [1, 0, 0], [0, -1, 0]]
    np.testing.assert_allclose(closest.normal[:3], normals, atol=EXACT)
    # On the axis all directions across it are equivalent: inwards, and upwards at an angle.
    np.testing.assert_allclose(closest.normal[3:, 2], [0, 0.6], atol=EXACT)
    np.testing.assert_allclose(closest.foot[:, 2], [0.5, 0, 0, 0, 0.3], atol=EXACT)


@pytest.mark.parametrize("inside", [False, True])
def test_torus_by_its_equation(inside: bool) -> None:
    """Closest points satisfy ``(|y|² + R² - r²)² = 4 R² (y_1² + y_2²)`` in the torus axes.

    The vector from the circle of centres to x is normal to that circle, as for the closest
    point of any smooth curve.
    """
    R, r, centre = 0.8, 0.3, np.array([3.0, -1.0, 2.0])
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    shape = ob.Torus(centre, turn[:, 2], R, r, inside)
    x = around(3)
    distance, normal, foot = shape.closest(centre + x @ turn.T)
    y, n = (foot - centre) @ turn, normal @ turn
    left = ((y**2).sum(axis=1) + R**2 - r**2) ** 2
    right = 4 * R**2 * (y[:, :2] ** 2).sum(axis=1)
    # Coordinates are of size 4, and the equation has degree 4.
    near(left, right, 100 * EXACT)
    # In polar coordinates of the half-plane of x, where the tube is a disc.
    rho, height = np.hypot(x[:, 0], x[:, 1]), x[:, 2]
    outside = np.hypot(rho - R, height) - r
    sign = -1 if inside else 1
    near(distance, sign * outside, 10 * EXACT)
    around_axis = np.column_stack([-x[:, 1], x[:, 0], 0 * height])
    assert np.abs(np.einsum("nd,nd->n", n, around_axis)).max() <= 100 * EXACT


@pytest.mark.parametrize(("shape", "dim"), [(square(), 2), (CUBE, 3)])
def test_corners_and_edges_to_rounding(shape: ob.Surface, dim: int) -> None:
    """Closed form of a box: faces, edges and corners, from inside and outside."""
    random = np.random.default_rng(2)
    x = random.uniform(-1, 2, (2000, dim))
    closest = shape.closest(x)
    near(closest.distance, box_distance(x), EXACT)
    assert (closest.distance < 0).sum() > 20
    # On the corner itself the normal points along the diagonal.
    at = shape.closest(np.ones((1, dim)))
    np.testing.assert_allclose(at.normal, 1 / np.sqrt(dim), rtol=EXACT)
    assert abs(at.distance[0]) <= EXACT


def test_the_sign_by_the_solid_angle() -> None:
    """A crumpled surface with facets of all shapes, seen at 4π from inside, else at 0."""
    random = np.random.default_rng(3)
    x, faces = icosphere(1)
    x = x * random.uniform(0.7, 1.3, (len(x), 1))
    points = around(3, 60)
    closest = ob.Surface(x, faces).closest(points)
    a, b, c = (x[faces][:, i] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    triple = np.einsum("pfd,pfd->pf", a, np.cross(b, c))
    dots = [np.einsum("pfd,pfd->pf", v, w) for v, w in ((a, b), (b, c), (c, a))]
    below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    angle = 2 * np.arctan2(triple, below).sum(axis=1)
    assert np.array_equal(closest.distance < 0, angle > 2 * np.pi)


def test_a_sphere_of_triangles_converges() -> None:
    """Distances to second order in the size of the triangles, normals to first."""
    x = around(3)
    exact = ob.Sphere([0, 0, 0], 1.0).closest(x)
    errors, angles = [], []
    for halvings in range(1, 5):
        closest = ob.Surface(*icosphere(halvings)).closest(x)
        errors.append(np.abs(closest.distance - exact.distance).max())
        angles.append(np.abs(closest.normal - exact.normal).max())
        # Inscribed: every facet lies inside the sphere.
        assert (closest.distance >= exact.distance - EXACT).all()
    order = np.log2(np.divide(errors[:-1], errors[1:]))
    # The first meshes are coarse, and the maximum is taken over some points only.
    assert (order > 1.85).all()
    assert order[-1] == pytest.approx(2, abs=0.1)
    assert np.log2(angles[0] / angles[-1]) / 3 == pytest.approx(1, abs=0.25)


def test_beyond_a_border_is_outside() -> None:
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    sheet = ob.Surface(corners, [[0, 1, 2], [0, 2, 3]])
    assert not sheet.closed
    assert CUBE.closed
    # Below it, exactly below its edge, outside the edge and a little lower, above it.
    x = [[0.4, 0.5, -0.1], [1.0, 0.5, -0.1], [1.5, 0.5, -0.1], [0.4, 0.5, 0.2]]
    closest, beside = sheet.closest(np.array(x)), np.hypot(0.5, 0.1)
    wanted = [-0.1, -0.1, beside, 0.2]
    np.testing.assert_allclose(closest.distance, wanted, rtol=EXACT)
    np.testing.assert_allclose(closest.normal[[0, 1, 3]], [[0, 0, 1]] * 3, atol=EXACT)
    line = ob.Surface([[1, 0], [0, 0]], [[0, 1]])
    closest = line.closest(np.array([[0.5, 0.1], [0.5, -0.1], [1.5, -0.1]]))
    np.testing.assert_allclose(closest.distance, [0.1, -0.1, beside], rtol=EXACT)


def test_a_flipped_box_is_a_cavity() -> None:
    die = ob.Surface(*cube(), flipped=True).closest(np.array([[0.5, 0.5, 0.9]]))
    assert die.distance[0] == pytest.approx(0.1, rel=1e-13)
    np.testing.assert_allclose(die.normal, [[0, 0, -1]], atol=EXACT)


def test_files_without_a_surface(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    (tmp_path / "bad.vtk").write_text("nothing of the kind")
    meshio.Mesh(np.zeros((1, 3)), [("vertex", [[0]])]).write(tmp_path / "dot.vtk")
    with pytest.raises(FileNotFoundError, match=r"there is no file .*none\.stl"):
        ob.Surface.from_file(tmp_path / "none.stl")
    for name, message in (
        ("bad", r"bad\.vtk cannot be read as a surface: "),
        ("dot", r"has vertex, expected triangles"),
    ):
        with refused(message):
            ob.Surface.from_file(tmp_path / f"{name}.vtk")
    x = np.array([[0.0, 0, 0], [1, 0, 0], [2, 1, 0]])
    file = tmp_path / "line.vtk"
    meshio.Mesh(x, [("line", [[0, 1], [1, 2]])]).write(file)
    read = ob.Surface.from_file(file)
    assert repr(read) == "Surface(2 segments, with a border)"


def test_a_distance_by_its_formula() -> None:
    """Compared with the sphere: by finite differences, and with a given gradient."""
    x = around(3)
    exact = ob.Sphere([0, 0, 0], 1.0).closest(x)

    def away(x: Any) -> Any:
        return np.linalg.norm(x, axis=1) - 1

    # Fourth order: (3e-3)⁴ with a curvature of 1/0.6, and rounding.
    near(ob.Distance(away).closest(x).normal, exact.normal, 1e-9)
    gradient = ob.Distance(away, lambda x: x / (1 + away(x))[:, None])
    near(gradient.closest(x).foot, exact.foot, EXACT)


@pytest.mark.parametrize("far", [0.0, 1e6, -3e7])
@pytest.mark.parametrize("count", [1, 50])
def test_a_distance_far_from_the_origin(count: int, far: float) -> None:
    """Also at a single point of the surface, where only the obstacle has a size."""
    centre = np.full(3, far)
    x = np.random.default_rng(1).normal(size=(count, 3))
    x = centre + x / np.linalg.norm(x, axis=1)[:, None]
    closest = ob.Distance(lambda x: np.linalg.norm(x - centre, axis=1) - 1).closest(x)
    exact = ob.Sphere(centre, 1.0).closest(x)
    # The digits of coordinates, over a step of about a thousandth, with curvature 1.
    places = np.finfo(float).eps * abs(far)
    near(closest.normal, exact.normal, 1e-9 + 4 * places)
    near(closest.distance, exact.distance, 4 * places + EXACT)


def test_steps_of_a_distance_find_a_small_obstacle() -> None:
    """A pin of 1e-4 of the extent of the points, smaller than the first step."""
    x = np.array([[0.0, 1.0], [1e-4, 0.0], [-8e-5, 6e-5], [1.0, 1.0]])
    pin = ob.Distance(lambda x: np.linalg.norm(x, axis=1) - 1e-4)
    exact = ob.Cylinder([0, 0], 1e-4).closest(x)
    closest = pin.closest(x)
    # Accepted if the length of the gradient is 1 to 1e-6: on a circle, the error of its
    # direction is below the root of that.
    near(closest.normal, exact.normal, 1e-3)
    assert np.abs(closest.distance - exact.distance).max() <= EXACT


def test_union_takes_the_nearest() -> None:
    floor, ball = ob.Plane([0, 0, 0], [0, 0, 1]), ob.Sphere([0, 0, 1], 0.5)
    x = np.array([[0, 0, 2.0], [3, 0, 0.2], [0, 0, 0.1]])
    closest = ob.Union([floor, ball]).closest(x)
    np.testing.assert_allclose(closest.distance, [0.5, 0.2, 0.1], rtol=EXACT)
    np.testing.assert_allclose(closest.normal, [[0, 0, 1]] * 3, atol=EXACT)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ob.Plane([0, 0], [0, 0]), "normal of the plane is zero"),
        (lambda: ob.Plane([0, 0], [0, 0, 1]), r"point of the plane has shape \(2,\)"),
        (lambda: ob.Plane([0, 0], [0, 1]).closest(np.eye(3)), r"expected \(n, 2\)"),
        (lambda: ob.Sphere([0, 0, 0], 0), "radius of the sphere is 0, expected"),
        (
            lambda: ob.Sphere([0, 1, 0], 1.0).closest(np.array([[0, 1.0, 0]])),
            r"the point \(0, 1, 0\) is at the centre of the sphere: no normal",
        ),
        (lambda: ob.Cylinder([0, 0, 0], 1.0), "axis of the cylinder is missing"),
        (lambda: ob.Cylinder([0, 0], 1.0, UP), "axis .* was given, but a 2D cylinder"),
        (
            lambda: ob.Cylinder([0, 0, 0], 1.0, UP).closest(np.eye(3)),
            r"the point \(0, 0, 1\) is at the axis of the cylinder: no normal",
        ),
        (lambda: torus(centre=[0, 0]), r"centre of the torus has shape \(2,\)"),
        (lambda: torus(axis=[0, 0, 0]), "axis of the torus is zero"),
        (lambda: torus(-2.0), "major_radius of the torus is -2.0, expected a positive"),
        (lambda: torus(2.0, 2.0), "minor_radius of the torus is 2.0, expected a"),
        (
            lambda: torus().closest(np.eye(3)),
            r"\(1, 0, 0\) is at the centre of the tube",
        ),
        (lambda: ob.Union([]), "obstacles is empty"),
        (
            lambda: ob.Union([ob.Sphere([0, 0], 1), ob.Sphere([0, 0, 0], 1)]),
            "mix two and three",
        ),
        (
            lambda: ob.Distance(lambda x: (x**2).sum(axis=1) - 1).closest(around(3)),
            "the gradient of the distance has length .*, expected 1 to 1e-06",
        ),
        (
            lambda: ob.Distance(
                lambda x: np.linalg.norm(x, axis=1) - 1,
                lambda x: np.eye(3)[[0] * len(x)],
            ).closest(around(3)),
            r"but at the foot x - d ∇d, .* expected zero",
        ),
        (
            lambda: ob.Surface([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]),
            r"the facet of the surface at \(1, 0, 0\) has no area",
        ),
        (
            lambda: ob.Surface(np.eye(4)[:, :3], [[0, 1, 2], [0, 1, 3]]),
            r"2 triangles .* the edge at \(0.5, 0.5, 0\) have normals on different sides",
        ),
        (
            lambda: ob.Surface([[0, 0], [1, 0], [2, 0]], [[0, 1], [2, 1]]),
            r"segments .* meet at \(1, 0\) have normals on different sides",
        ),
        (lambda: ob.Surface(np.eye(3), [[0, 1, 3]]), "facets .* has index 3, expected"),
        (
            lambda: ob.Surface(np.eye(3), np.zeros((0, 3), int)),
            "expected .* with k > 0",
        ),
        (lambda: ob.Motion(), "neither translation nor rotation"),
        (lambda: ob.Motion(rotation=[1.0], about=[0, 0, 0]), "axis is missing"),
        (
            lambda: ob.Motion([[0, 0]], rotation=[1.0, 2.0]),
            "rotation has 2 steps but translation has 1",
        ),
        (lambda: ob.Motion([[0, 0]], about=[0, 0, 0]), "about .* has 3 components"),
        (lambda: ob.Motion(rotation=[0.0, -720.0]), r"is -720, 115 turns: .* degrees"),
    ],
)
def test_invalid_obstacles(make: Any, message: str) -> None:
    with refused(message):
        make()


@pytest.mark.parametrize("dim", [2, 3])
def test_motion_and_its_inverse(dim: int) -> None:
    """`back` inverts the motion, which is rigid and moves the pole by its translation."""
    random = np.random.default_rng(5)
    axis = None if dim == 2 else [1.0, 2.0, -1.0]
    about = random.normal(size=dim)
    shift = random.normal(size=(3, dim))
    motion = ob.Motion(shift, [0.3, -2.0, 4.0], about, axis)
    assert (motion.dim, motion.steps) == (dim, 3)
    x = random.normal(size=(20, dim))
    for k in (1, 2, 3):
        seen = motion.back(x, k)
        np.testing.assert_allclose(
            motion.forwards(seen - about, k) + about + shift[k - 1], x, atol=4 * EXACT
        )
        lengths = [np.linalg.norm(np.diff(y, axis=0), axis=1) for y in (x, seen)]
        np.testing.assert_allclose(*lengths, rtol=10 * EXACT)
    # A right angle, by the right-hand rule.
    turn = ob.Motion(rotation=[np.pi / 2], axis=None if dim == 2 else [0, 0, 1])
    np.testing.assert_allclose(
        turn.forwards(np.eye(dim)[:1], 1), np.eye(dim)[1:2], atol=EXACT
    )
    assert np.array_equal(motion.back(x, 0), x)


def test_a_roller_in_place_drags_by_its_circumference() -> None:
    roller = ob.Cylinder([0, 1], 1.0)
    turn = ob.Motion(rotation=[0.5, 2.0, 9.0], about=[0, 1])
    x = np.array([[0.0, -0.1], [0.0, 0.0]])
    met = ob.approach(roller, turn, x)
    np.testing.assert_allclose(met.distance, [[0.1, 0.0]] * 4, atol=EXACT)
    # Counter-clockwise, the lowest point moves right by ω r, for any number of steps.
    expected = np.array([0.0, 0.5, 2.0, 9.0])
    np.testing.assert_allclose(met.drag[:, 1, 0], expected, rtol=EXACT)
    near(met.drag[:, 1, 1], 0, 9 * EXACT)


@pytest.mark.parametrize("steps", [1, 7])
def test_a_roller_that_rolls_drags_nothing(steps: int) -> None:
    way = np.linspace(0, 3, steps + 1)[1:]
    shift = np.outer(way, [1, 0, 0])
    rolling = ob.Motion(shift, way / 2, about=[0, 0, 2], axis=[0, 1, 0])
    roller = ob.Cylinder([0, 0, 2], 2.0, axis=[0, 1, 0])
    met = ob.approach(roller, rolling, np.array([[3.0, 0.4, 0.0]]))
    # It ends above the node, and normal and distance are those of that position.
    assert met.distance[-1, 0] == pytest.approx(0, abs=EXACT)
    np.testing.assert_allclose(met.normal[-1], [[0, 0, -1]], atol=EXACT)
    feet = np.array([[[3.0, 0.4, 0]], [[3.0, 0.4, 0]]])
    feet[0, 0, 0] -= way[-1] - (way[-2] if steps > 1 else 0)
    near(rolling.drag(feet, steps), 0, 4 * EXACT)


def test_the_normal_of_each_step_is_that_of_its_position() -> None:
    """A ball approaches from one side, passes over a node, and leaves."""
    ball, way = ob.Sphere([-5, 0, 1], 1.0), np.outer([0, 3, 5, 9], [1, 0, 0])
    met = ob.approach(ball, ob.Motion(way[1:]), np.array([[0.0, 0, -0.1]]))
    away = [5, 0, -1.1] - way
    normal = away / np.linalg.norm(away, axis=1, keepdims=True)
    np.testing.assert_allclose(met.normal[:, 0], normal, atol=EXACT)
    np.testing.assert_allclose(met.drag[:, 0], way)
    assert np.argmin(met.distance[:, 0]) == 2


class Told:
    """A user-defined obstacle: the unit disc or ball, with one wrong answer."""

    dim = None

    def __init__(self, wrong: Any = lambda right, _: right) -> None:
        self._wrong = wrong

    def closest(self, points: np.ndarray) -> Any:
        far = np.linalg.norm(points, axis=1)
        normal = points / far[:, None]
        return self._wrong(ob.Closest(far - 1, normal, normal), points)


def test_obstacle_defined_elsewhere() -> None:
    for dim in (2, 3):
        x = around(dim)
        here, there = ob.ask(Told(), x), ob.Sphere(np.zeros(dim), 1.0).closest(x)
        for own_field, other in zip(here, there, strict=True):
            near(own_field, other, EXACT)


def test_a_profile_that_knows_distances_to_first_order() -> None:
    """Heights over a line, and the distance to first order: z - h along the normal."""

    def closest(points: np.ndarray) -> ob.Closest:
        slope = 0.02 * np.cos(2 * points[:, 0])
        normal = np.column_stack([-slope, np.ones(len(points))])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        above = points[:, 1] - 0.01 * np.sin(2 * points[:, 0])
        distance = above * normal[:, 1]
        return ob.Closest(distance, normal, points - distance[:, None] * normal)

    x = np.random.default_rng(0).uniform([-1, -0.1], [1, 0.3], (200, 2))
    waves: Any = SimpleNamespace(dim=2, closest=closest)
    np.testing.assert_array_equal(ob.ask(waves, x).foot, closest(x).foot)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda *_: None, "obstacle Told returns None, expected a Closest"),
        (
            lambda f, _: f._replace(distance=f.distance[:, None]),
            r"distance of the obstacle Told has shape \(300, 1\), expected \(300,\)",
        ),
        (lambda f, _: f._replace(normal=f.normal[0]), r"Told has shape \(3,\), exp"),
        (
            lambda f, x: f._replace(distance=np.where(x[:, 0] > 0, f.distance, np.nan)),
            r"distance of the obstacle Told is nan at \(-",
        ),
        (lambda f, _: f._replace(normal=2 * f.normal), "length 1, the error is 1"),
        (lambda f, _: f._replace(normal=-f.normal), r"not point - distance \* normal"),
        (
            lambda f, x: ob.Closest(
                abs(f.distance), f.normal, x - abs(f.distance)[:, None] * f.normal
            ),
            r"the foot of \(.*\) is \(.*\), whose distance is .* expected 0",
        ),
        (
            lambda f, _: f._replace(
                distance=abs(f.distance),
                normal=np.sign(f.distance)[:, None] * f.normal,
            ),
            "behind its surface, at .* expected a negative number",
        ),
    ],
)
def test_obstacle_with_wrong_answers(wrong: Any, message: str) -> None:
    floor = ob.Plane([0, 0, -9], [0, 0, 1])
    for shape in (Told(wrong), ob.Union([floor, Told(wrong)])):
        with pytest.raises((TypeError, ValueError), match=message):
            ob.approach(shape, None, around(3))


def knife(dim: int) -> ob.Surface:
    """A two-sided sheet without thickness, ``z ≤ 0`` of the plane ``x = 0``."""
    if dim == 2:
        return ob.Surface([[0, 0], [0, -2]], [[0, 1], [1, 0]])
    x = np.array([(0, y, z) for y in range(3) for z in (0, -1, -2)], float)
    facets = np.array(
        [t for i in (0, 1, 3, 4) for t in ([i, i + 1, i + 3], [i + 3, i + 1, i + 4])]
    )
    return ob.Surface(x, np.concatenate([facets, facets[:, ::-1]]))


@pytest.mark.parametrize("dim", [2, 3])
def test_a_sheet_of_two_sides_has_no_inside(dim: int) -> None:
    """At the edge the normal points away from it; on the sheet, to the side of a facet."""
    low, high = [-1, 0.2, -1.8][3 - dim :], [1, 1.8, -0.2][3 - dim :]
    low[0], high[0] = -1, 1
    x = np.random.default_rng(4).uniform(low, high, (300, dim))
    sheet, across, up = knife(dim), np.eye(dim)[0], np.eye(dim)[-1]
    closest = sheet.closest(x)
    near(closest.distance, np.abs(x[:, 0]), EXACT)
    np.testing.assert_allclose(closest.normal[:, 0], np.sign(x[:, 0]), rtol=EXACT)
    # The nearest point is a node, an edge or a facet.
    end = np.array([0, 1.0, 0] if dim == 3 else [0, 0.0])
    for place in (end - up, end):
        closest = sheet.closest(place + np.outer([0.5, -0.5, 1e-6, -1e-6], across))
        np.testing.assert_allclose(closest.distance, [0.5, 0.5, 1e-6, 1e-6], rtol=1e-9)
    on = sheet.closest((end - up)[None])
    assert abs(on.distance[0]) <= EXACT
    np.testing.assert_allclose(np.abs(on.normal[0]), across, atol=EXACT)
    rim = sheet.closest(np.array([end, end + 0.3 * up]))
    np.testing.assert_allclose(rim.distance, [0, 0.3], atol=EXACT)
    np.testing.assert_allclose(rim.normal, [up] * 2, atol=EXACT)
    if dim == 3:
        side = sheet.closest(np.array([[0, 0, -0.5], [0, 0, 0.0]]))
        wanted = [[0, -1, 0], [0, -np.sqrt(0.5), np.sqrt(0.5)]]
        np.testing.assert_allclose(side.normal, wanted, atol=EXACT)


def stl(folder: Path, x: np.ndarray, faces: Any, binary: bool = True) -> Path:
    """A file, in which each triangle has its own corners."""
    meshio = pytest.importorskip("meshio")
    mesh = meshio.Mesh(x, [("triangle", faces)])
    with np.errstate(invalid="ignore"):  # the normals of triangles without area
        mesh.write(folder / "it.stl", binary=binary)
    return folder / "it.stl"


@pytest.mark.parametrize("binary", [True, False])
def test_stl(tmp_path: Path, binary: bool) -> None:
    read = ob.Surface.from_file(stl(tmp_path, *icosphere(2), binary))
    # The reader merges the corners.
    assert read.closed
    assert repr(read) == "Surface(320 triangles)"
    points = around(3)
    there, here = read.closest(points), ob.Surface(*icosphere(2)).closest(points)
    # Binary STL has numbers of 32 bits.
    near(there.distance, here.distance, 2e-7)


def test_duplicate_triangles_in_a_file(tmp_path: Path) -> None:
    x, faces = icosphere(1)
    again = faces[np.random.default_rng(0).integers(0, len(faces), 20)]
    needle = [[0, 3, 0], [5, 5, 8]]  # coincident corners
    every = np.concatenate([faces, np.roll(again, 1, axis=1), needle])
    read = ob.Surface.from_file(stl(tmp_path, x, every, binary=False))
    assert read.closed
    assert repr(read) == f"Surface({len(faces)} triangles)"
    with refused("have normals on different sides"):
        ob.Surface(x, np.concatenate([faces, faces[:1]]))


def test_a_file_too_far_from_the_origin_for_its_digits(tmp_path: Path) -> None:
    """One wide at 1e8: single precision has steps of 8 there."""
    x, faces = icosphere(1)
    with refused(r"no triangle with distinct corners: .* 1e\+08 from"):
        ob.Surface.from_file(stl(tmp_path, x / 2 + [1e8, 0, 0], faces))


def test_corners_of_stl_that_differ_in_their_last_digit(tmp_path: Path) -> None:
    """A cavity in a block: a slit would make points inside the wall count as outside."""
    x, faces = icosphere(2)
    corners = x[faces].reshape(-1, 3).astype(np.float32)
    # One unit in the last place, up or down.
    way = np.random.default_rng(0).choice([-9, 9], corners.shape).astype("f4")
    triangles = np.arange(len(corners)).reshape(-1, 3)
    file = stl(tmp_path, np.nextafter(corners, way), triangles)
    read = ob.Surface.from_file(file, flipped=True)
    assert read.closed
    # Points in the wall, near the edges of the cavity's facets.
    middle = (x[faces] + x[np.roll(faces, 1, axis=1)]).reshape(-1, 3) / 2
    wall = 1.01 * middle / np.linalg.norm(middle, axis=1)[:, None]
    assert (read.closest(wall).distance < 0).all()
