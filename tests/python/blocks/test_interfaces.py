"""Where blocks touch."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bipot_rs.blocks import Block, find_interfaces, make_interface
from support.masonry import box, rotate

TURN = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()


def test_two_boxes_share_a_rectangle() -> None:
    blocks = rotate(
        [box("a", (0, 0, 0), (3, 2, 1)), box("b", (1, -1, 1), (5, 1, 2))], TURN
    )
    (shared,) = find_interfaces(blocks)
    assert (shared.first, shared.second) == (0, 1)
    assert shared.area == pytest.approx(2.0, rel=1e-12)
    assert np.abs(shared.normal - TURN[:, 2]).max() < 1e-12
    expected = np.array([[1, 0, 1], [3, 0, 1], [3, 1, 1], [1, 1, 1]]) @ TURN.T
    distance = np.linalg.norm(shared.points[:, None] - expected, axis=2)
    assert distance.min(axis=0).max() < 1e-12
    assert len(shared.points) == 4


def test_triangles_of_a_face_are_one_interface() -> None:
    """Two boxes whose common face has other diagonals, and one is larger."""
    low, high = box("a", (0, 0, 0), (1, 1, 1)), box("b", (0, 0, 1), (2, 1, 2))
    low, high = (
        Block(
            b.name,
            b.points,
            [
                part
                for f in b.faces
                for part in (f[[k, k + 1, k + 2]], f[[k + 2, k - 1, k]])
            ],
        )
        for b, k in ((low, 0), (high, 1))
    )
    (shared,) = find_interfaces([low, high])
    assert shared.area == pytest.approx(1.0, rel=1e-12)
    assert len(shared.points) == 4


def test_an_edge_or_a_corner_is_no_interface() -> None:
    a = box("a", (0, 0, 0), (1, 1, 1))
    at_edge, at_corner = (
        box("b", (1, 0, 1), (2, 1, 2)),
        box("c", (-1, -1, -1), (0, 0, 0)),
    )
    assert find_interfaces([a, at_edge, at_corner]) == []


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e5])
def test_the_tolerance_is_relative_to_the_blocks(scale: float) -> None:
    for gap, count in ((5e-5, 1), (5e-4, 0)):
        blocks = [
            box("a", (0, 0, 0), (scale, scale, scale)),
            box("b", (0, 0, (1 + gap) * scale), (scale, scale, 2 * scale)),
        ]
        assert len(find_interfaces(blocks)) == count


def test_a_face_that_is_not_convex() -> None:
    """A ring in the shape of a U below a plate: two feet and a bar, one plane."""
    outline = np.array(
        [[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3.0]]
    )
    low, high = (np.column_stack([outline, 0 * outline[:, 0] + z]) for z in (0.0, 1.0))
    n = len(outline)
    ring = [[k, (k + 1) % n, (k + 1) % n + n, k + n] for k in range(n)]
    faces = [list(range(n))[::-1], list(range(n, 2 * n)), *ring]
    shape = Block("U", np.concatenate([low, high]), faces)
    plate = box("plate", (-1, -1, 1), (4, 4, 2))
    (shared,) = find_interfaces([shape, plate])
    assert shared.area == pytest.approx(7.0, rel=1e-12)
    # The corners that carry all that the U can carry.
    assert sorted(map(tuple, shared.points[:, :2])) == [(0, 0), (0, 3), (3, 0), (3, 3)]


def test_an_interface_from_a_file() -> None:
    blocks = [box("a", (0, 0, 0), (1, 1, 1)), box("b", (0, 0, 1), (1, 1, 2))]
    corners = [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0.5, 1, 1], [0, 1, 1]]
    for points in (corners, corners[::-1]):
        shared = make_interface(blocks, 0, 1, points)
        assert np.abs(shared.normal - [0, 0, 1]).max() < 1e-15
        # The corner in the middle of an edge is none of the hull.
        assert len(shared.points) == 4
    with pytest.raises(ValueError, match="'a' and 'b' has no area"):
        make_interface(blocks, 0, 1, [[0, 0, 1], [1, 0, 1], [0.5, 0, 1]])
    with pytest.raises(ValueError, match="parallel to no face of 'a'"):
        make_interface(blocks, 0, 1, [[0, 0, 1], [1, 0, 2], [0, 1, 2]])
