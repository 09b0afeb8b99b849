"""Surfaces whose distance is large compared with their facets: no overlap is lost."""

import numpy as np
import pytest

import bipot_rs as bp
from support.comparisons import refused


@pytest.mark.parametrize("method", ["mortar", "nodes"])
@pytest.mark.parametrize("cells", [10, 200])
def test_a_pad_over_a_round_surface(method: str, cells: int) -> None:
    """Facets to the side are nearer than opposite ones, more so in a finer mesh."""
    x = np.linspace(-0.5, 0.5, cells + 1)
    round_ = 1.1 * x
    pad = np.c_[x, 0 * x]
    ground = np.c_[round_, -2 + np.sqrt(1 - round_**2)]
    lines = np.c_[np.arange(cells), np.arange(1, cells + 1)]
    pairs = bp.pairs(pad, lines, ground, lines[:, ::-1], method=method)
    assert len(pairs.gap) == cells + 1
    # The sagitta of a facet is h²/8 over the radius, measured along the vertical.
    exact = 2 - np.sqrt(1 - x**2)
    assert np.abs(pairs.gap - exact)[1:-1].max() < (1.1 / cells) ** 2


def test_layers_under_a_part_of_a_facet() -> None:
    pad = [[0, 0], [2, 0.0]]
    sheets = [[0, -0.1], [1, -0.1], [0, -0.5], [1, -0.5]]
    both = (pad, [[0, 1]], sheets, [[1, 0], [3, 2]])
    with refused("lies in several layers opposite to facet 0"):
        bp.pairs(*both)
    near = bp.pairs(*both, distance=0.2)
    np.testing.assert_allclose(near.gap, 0.1, rtol=1e-14)


@pytest.mark.parametrize("parts", [1, 4])
def test_distance_is_along_the_normal(parts: int) -> None:
    """It is not the distance of facet centres, which depend on the mesh of the master."""
    x = np.linspace(0, 10, parts + 1)
    lines = [[i + 1, i] for i in range(parts)]
    pad = [[1, 0.61], [1.2, 0.61]]
    pairs = bp.pairs(pad, [[0, 1]], np.c_[x, 0.5 * x], lines, distance=0.2)
    np.testing.assert_allclose(pairs.gap, [0.11, 0.01], rtol=1e-12)
