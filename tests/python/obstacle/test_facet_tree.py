"""The nearest facet equals that of comparing all, with few comparisons."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from bipot_rs import obstacle as ob
from bipot_rs.obstacle import facet_tree, triangulated
from support.spheres import icosphere

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Work(NamedTuple):
    """Sizes of the batches of nodes and of facets that points are compared with."""

    nodes: list[int]
    facets: list[int]


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Work:
    done = Work([], [])

    def count(module: Any, name: str, sizes: list[int]) -> None:
        function = getattr(module, name)

        def counted(x: Array, *others: Any) -> Any:
            sizes.append(len(x))
            return function(x, *others)

        monkeypatch.setattr(module, name, counted)

    count(facet_tree, "_bounds", done.nodes)
    count(triangulated, "_closest_on", done.facets)
    return done


def random_surface(rng: np.random.Generator) -> tuple[Array, Ints]:
    """Separate random facets, a crumpled or a flattened sphere, or a strip of needles."""
    kind = rng.integers(4)
    if kind == 0:
        d, count = int(rng.integers(2, 4)), int(rng.integers(1, 200))
        size = 10 ** rng.uniform(-4, 0, (count, 1, 1))
        x = rng.normal(size=(count, 1, d)) + size * rng.normal(size=(count, d, d))
        facets, x = np.arange(count * d).reshape(count, d), x.reshape(-1, d)
    else:
        x, facets = icosphere(int(rng.integers(1, 4)))
        if kind == 1:
            x = x * rng.uniform(0.7, 1.3, (len(x), 1))
        elif kind == 2:
            x = x * 10 ** rng.uniform(-4, 1, 3)
        else:
            x = x * [1, 1e-3, 1] + [0, 0, 1e2 * rng.random()]
    return x * 10 ** rng.uniform(-3, 3) + rng.choice([0.0, 50.0]), facets


def points_about(rng: np.random.Generator, x: Array) -> Array:
    """Near the middle, on corners, near the surface, and far away."""
    middle, size = x.mean(axis=0), np.ptp(x, axis=0).max()
    shift = size * rng.normal(size=(4, 10, x.shape[1]))
    on = x[rng.integers(0, len(x), 10)]
    close = middle + 10.0 ** rng.integers(-12, 0) * shift[0]
    far = [middle + shift[2], middle + 1e4 * shift[3]]
    return np.concatenate([close, on, on + 1e-3 * shift[1], *far])


def nearest_of_all(points: Array, x: Array, facets: Ints) -> Array:
    repeated = np.repeat(points, len(facets), axis=0)
    foot, _ = triangulated._closest_on(
        repeated, np.tile(x[facets], (len(points), 1, 1))
    )
    away = np.linalg.norm(repeated - foot, axis=1)
    return np.asarray(away.reshape(len(points), -1).min(axis=1))


def compare(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(count):
        x, facets = random_surface(rng)
        try:
            surface = ob.Surface(x, facets)
        except ValueError:  # # a facet without area, by chance
            continue
        points = points_about(rng, x)
        distance = np.abs(surface.closest(points).distance)
        expected = nearest_of_all(points, x, facets)
        # The same arithmetic for the same facet, or for one equally near to rounding.
        size = np.abs(x).max() + np.abs(points).max(axis=1)
        assert (np.abs(distance - expected) <= 1e-15 * size).all()


@pytest.mark.parametrize("at_once", [5, facet_tree.AT_ONCE])
@pytest.mark.slow_variants("5")
def test_the_nearest_of_all(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(facet_tree, "AT_ONCE", at_once)
    compare(1, 8 if at_once == 5 else 25)


@pytest.mark.slow
def test_the_nearest_of_all_for_many_surfaces() -> None:
    compare(2, 2000)


@pytest.mark.parametrize(
    ("off", "nodes", "facets"),
    [(0.3, 1500, 6), (1e-2, 20_000, 6), (1e-3, 70_000, 6), (0.0, 1.2 * 81920, 50)],
)
@pytest.mark.slow
def test_near_the_centre_of_a_sphere(
    off: float, nodes: float, facets: int, work: Work
) -> None:
    """All facets are equally far except for `off`, so only a part of them is compared.

    At the centre every facet is compared, in batches, and few remain at the end.
    """
    x, triangles = icosphere(6)
    sphere = ob.Surface(x, triangles)
    points = np.random.default_rng(0).normal(size=(20, 3))
    points *= off / np.linalg.norm(points, axis=1)[:, None]
    work.nodes.clear()
    work.facets.clear()
    closest = sphere.closest(points)
    # A facet is inscribed: its corners lie within its longest edge over √3 of a point.
    sides = x[triangles] - np.roll(x[triangles], 1, axis=1)
    sagitta = 1.01 * np.linalg.norm(sides, axis=2).max() ** 2 / 6
    assert (np.abs(closest.distance + 1 - off) <= sagitta).all()
    # The distance of a patch of width w is known to w²/8. This gives enough patches to
    # separate distances that differ by `off`, then those in the direction of the point.
    assert sum(work.nodes) <= 20 * nodes
    assert sum(work.facets) <= 20 * facets
    assert max(work.nodes) <= facet_tree.AT_ONCE
