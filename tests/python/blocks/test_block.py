"""Volume, centre of mass and checks of blocks."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

from bipot_rs.blocks import Block
from bipot_rs.blocks.block import split_convex
from support.masonry import box

# Rounding of sums of some hundred terms.
ROUNDING = 1e-13


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("origin", [0.0, 1e4])
def test_volume_and_centre_of_a_convex_body(seed: int, origin: float) -> None:
    """Against tetrahedra of Delaunay, which share nothing with the faces."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(30, 3)) + origin
    hull = ConvexHull(points)
    outwards = hull.equations[:, :3]
    faces = []
    for triangle, n in zip(hull.simplices, outwards, strict=True):
        a, b, c = points[triangle]
        faces.append(triangle if np.cross(b - a, c - a) @ n > 0 else triangle[::-1])
    block = Block("stone", points, faces)
    cells = points[Delaunay(points).simplices]
    volumes = np.abs(np.linalg.det(cells[:, 1:] - cells[:, :1])) / 6
    centre = volumes @ cells.mean(axis=1) / volumes.sum()
    # Coordinates have the rounding of the origin.
    tolerance = 1e3 * ROUNDING * max(origin, 1.0)
    assert block.volume == pytest.approx(volumes.sum(), rel=tolerance)
    assert np.abs(block.centre - centre).max() < tolerance


def test_a_polygon_in_either_direction() -> None:
    """An L: its parts are rectangles."""
    outline = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 3], [0, 3]]
    for points in (outline, outline[::-1]):
        block = Block("L", points)
        assert block.volume == pytest.approx(4.0, rel=ROUNDING)
        expected = (2 * np.array([1, 0.5]) + 2 * np.array([0.5, 2])) / 4
        assert np.abs(block.centre - expected).max() < ROUNDING


WHOLE = box("lintel", (0, 0, 0), (1, 1, 1))
REFUSED: list[tuple[object, object, str]] = [
    (WHOLE.points, WHOLE.faces[:-1], r"'bad' is open: the edge from \(.*\) to \("),
    (WHOLE.points, [WHOLE.faces[0][::-1], *WHOLE.faces[1:]], "inverted face: 2 faces run"),
    (WHOLE.points, [face[::-1] for face in WHOLE.faces], "the volume -1: it is inverted"),
    ([[0, 0], [1, 1], [1, 0], [0, 1]], None, "crosses itself"),
    ([[0, 0], [1, 1]], None, "2 corners, expected at least 3"),
    ([[0, 0], [1, 1], [2, 2]], None, "has the volume 0"),
    ([[0, 0], [1, 0], [1, 1]], [[0, 1, 2]], "has no faces"),
    ([[0, 0, 0], [1, 0, 0], [1, 1, 0]], None, "has 0 faces"),
    (np.eye(3), [[0, 1, 2]] * 3 + [[0, 1, 3]], "numbers of corners below 3"),
    (np.zeros((3, 3)), [[0, 1, 2]] * 4, "all faces of block 'bad' are points"),
]  # fmt: skip


@pytest.mark.parametrize(("points", "faces", "message"), REFUSED)
def test_refused_points(points: object, faces: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Block("bad", points, faces)  # type: ignore[arg-type]


def test_repeated_corners_are_joined() -> None:
    """As in STL: each triangle with corners of its own."""
    whole = box("a", (0, 0, 0), (1, 2, 3))
    halves = [part for f in whole.faces for part in ([*f[[0, 1, 2]]], [*f[[0, 2, 3]]])]
    points = np.concatenate([whole.points[half] for half in halves])
    block = Block("a", points, np.arange(len(points)).reshape(-1, 3))
    assert len(block.points) == 8
    assert block.volume == pytest.approx(6.0, rel=ROUNDING)


@pytest.mark.parametrize("seed", range(5))
def test_ears_have_the_area_of_a_polygon(seed: int) -> None:
    """Star-shaped outlines, most not convex, with corners in the middle of edges."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 17))
    star = rng.uniform(0.3, 1, (17, 1)) * np.column_stack(
        [np.cos(angle), np.sin(angle)]
    )
    outline = np.stack([star, (star + np.roll(star, -1, 0)) / 2], 1).reshape(-1, 2)
    parts = split_convex(outline)

    def area(x: np.ndarray) -> float:
        y = np.roll(x, -1, axis=0)
        return float((x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]).sum() / 2)

    areas = [area(outline[part]) for part in parts]
    assert min(areas) > 0
    # Ears of less than 1e-7 of the square of the size are left out.
    assert sum(areas) == pytest.approx(area(outline), abs=1e-5)


def test_a_face_that_crosses_itself_has_no_ears() -> None:
    with pytest.raises(ValueError, match="crosses itself"):
        split_convex(np.array([[0, 0], [2, 0], [0, 1], [2, 1.0], [1, -1]]))
