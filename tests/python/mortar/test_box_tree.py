"""Trees of boxes: each pair is found exactly once, with few comparisons."""

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs.mortar import box_tree

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sizes of the batches of box pairs that are compared."""
    sizes: list[int] = []
    plain = box_tree._overlap

    def counting(low: Array, *others: Array) -> Array:
        sizes.append(len(low))
        return plain(low, *others)

    monkeypatch.setattr(box_tree, "_overlap", counting)
    return sizes


def random_boxes(rng: np.random.Generator) -> tuple[Array, Array, Ints]:
    """Boxes of one or many sizes, with needles, points and duplicates."""
    count, d = int(rng.integers(1, 400)), int(rng.integers(1, 4))
    middle = rng.normal(size=(count, d)) * 10 ** rng.uniform(-3, 3)
    wide = 10 ** rng.uniform(-4, 0.5, (count, rng.choice([1, d])))
    wide = np.broadcast_to(wide * np.abs(middle).max(), middle.shape) / 4
    wide = wide * rng.choice([1.0, 1.0, 0.0], (count, 1))
    again = rng.integers(0, count, count)
    again = np.where(rng.random(count) < 0.2, again, np.arange(count))
    group = rng.integers(0, rng.choice([1, 5, 100]), count)
    return (middle - wide)[again], (middle + wide)[again], group


def pairs(boxes: tuple[Array, Array, Ints]) -> set[tuple[int, int]]:
    pairs_found = [
        np.column_stack(both) for both in box_tree.BoxTree(*boxes).overlapping(*boxes)
    ]
    listed = [
        tuple(pair) for pair in np.concatenate([np.zeros((0, 2), int), *pairs_found])
    ]
    assert len(set(listed)) == len(listed)
    return set(listed)


def all_pairs(boxes: tuple[Array, Array, Ints]) -> set[tuple[int, int]]:
    low, high, group = boxes
    over = ((high[:, None] > low) & (high > low[:, None])).all(axis=2)
    over &= group[:, None] == group
    return {(int(i), int(j)) for i, j in np.argwhere(over)}


@pytest.mark.parametrize("at_once", [7, box_tree.AT_ONCE])
@pytest.mark.slow_variants("7")
def test_pairs_are_those_of_comparing_all(
    at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(box_tree, "AT_ONCE", at_once)
    rng = np.random.default_rng(5)
    met = 0
    for _ in range(60):
        boxes = random_boxes(rng)
        expected = all_pairs(boxes)
        assert pairs(boxes) == expected
        met += len(expected)
    assert met > 10_000


@pytest.mark.slow
def test_pairs_are_those_of_comparing_all_for_many_boxes() -> None:
    rng = np.random.default_rng(6)
    for _ in range(3000):
        boxes = random_boxes(rng)
        assert pairs(boxes) == all_pairs(boxes)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.slow_variants("3")
def test_boxes_compared_grow_as_their_number(d: int, compared: list[int]) -> None:
    """Boxes that fill space: eight times as many, with a bounded number of comparisons each."""
    rng = np.random.default_rng(d)
    per_box = []
    for count in (4_096, 32_768):
        wide = count ** (-1 / d)
        low = rng.random((count, d))
        boxes = low, low + wide, np.zeros(count, np.int64)
        compared.clear()
        comparisons = sum(
            len(first_boxes)
            for first_boxes, _ in box_tree.BoxTree(*boxes).overlapping(*boxes)
        )
        # A box meets itself, and others by chance.
        assert comparisons < 4.0**d * count
        assert max(compared) <= box_tree.AT_ONCE
        per_box.append(sum(compared) / count)
    # One more level of eight children each, for the few nodes that meet a box.
    assert per_box[1] < 1.6 * per_box[0]
    assert per_box[1] < 100 * 2**d
