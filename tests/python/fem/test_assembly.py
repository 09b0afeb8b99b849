"""Cells that must stay distinct, digits far from the origin, and partners of nodes."""

import numpy as np
import pytest

from bipot_rs import fem
from bipot_rs.fem.bodies import elasticity
from bipot_rs.fem.contact import meeting
from support.boxes import CELLS, box, placed


@pytest.mark.parametrize("cell", CELLS)
def test_far_from_the_origin_no_digits_are_lost(cell: str) -> None:
    """Jacobians here are made of differences; scikit-fem's are sums of coordinates."""
    mesh = box(cell, 4)
    far = placed(mesh, mesh.p + 1e6)  # exact, because coordinates are quarters
    K = [fem.stiffness(fem.Body("it", m, fem.Material(1.0, 0.3))) for m in (mesh, far)]
    np.testing.assert_array_equal(K[0].toarray(), K[1].toarray())


def test_hash_collisions_of_cells_are_detected() -> None:
    """Two triangles that collide by design: the hash is linear in its input."""
    odd, whole = 0x9E3779B97F4A7C15, 2**64
    weights = [pow(odd, k, whole) for k in range(1, 5)]

    def fold(x: float) -> int:
        bits = int(np.float64(x).view(np.uint64))
        return bits ^ (bits >> 32)

    def unfold(folded: int) -> float:
        # The upper half is unchanged, so hashing again gives the inverse.
        return float(np.uint64(folded ^ (folded >> 32)).view(np.float64))

    first = [1.0, 0.5, 0.25, 2.0]
    value = sum(fold(x) * w for x, w in zip(first, weights, strict=True))
    second = [3.0, 0.5, 0.25]
    rest = value - sum(fold(x) * w for x, w in zip(second, weights, strict=False))
    second.append(unfold(rest * pow(weights[3], -1, whole) % whole))
    assert np.isfinite(second[3])
    corners = np.zeros((6, 3, 2))
    corners[::2, 1:] = np.reshape(first, (2, 2))
    corners[1::2, 1:] = np.reshape(second, (2, 2))
    shapes, which = elasticity.distinct_cells(corners)
    np.testing.assert_array_equal(shapes[which], corners)


def test_partners_are_the_same_with_and_without_a_tree(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    random = np.random.default_rng(5)
    ours, theirs = random.normal(size=(40, 3)), random.normal(size=(70, 3))
    few = meeting.nearest_points(ours, theirs)
    monkeypatch.setattr(meeting, "ALL_PAIRS", 0)
    np.testing.assert_array_equal(few, meeting.nearest_points(ours, theirs))
