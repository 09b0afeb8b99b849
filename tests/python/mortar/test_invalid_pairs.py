"""Surfaces that cannot be paired: the message names the argument and the place."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support.comparisons import refused
from support.sheets import line, sheet

ONE, OTHER = sheet(4, 2, up=False), sheet(3, 2, up=True)
LINE = line(np.array([0.0, 1.0]), up=True)


def changed(**parts: Any) -> dict[str, Any]:
    return {
        "points_slave": ONE[0],
        "facets_slave": ONE[1],
        "points_master": OTHER[0],
        "facets_master": OTHER[1],
    } | parts


def with_facet(facets: Any, at: int, nodes: Any) -> Any:
    facets = facets.copy()
    facets[at] = nodes
    return facets


DOFS = np.arange(27).reshape(9, 3)
QUADRATIC = sheet(8, 2, up=False)
FOLDED = sheet(4, 1, up=False)
FOLDED[0][2] = [0.1, 0.3, 0.0]


@pytest.mark.parametrize("method", ["mortar", "nodes"])
@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"facets_slave": ONE[1][:, ::-1]}, "do not face each other: .* is 1.00"),
        ({"points_master": OTHER[0] + [5, 0, 0]}, r"do not overlap: .* 4\.\d+ apart"),
        (
            {"points_master": OTHER[0] - [0, 0, 0.5], "distance": 0.25},
            "are farther apart than distance 0.25: .* 0.5 along the normal",
        ),
        ({"distance": 0.0}, "distance is 0, expected a number > 0"),
        ({"method": "tied"}, "method is 'tied', expected one of"),
        (
            {"facets_slave": with_facet(ONE[1], 1, [0, 1, 4, 99])},
            "facets_slave has node 99 in facet 1, expected 0 to 8",
        ),
        (
            {"facets_slave": with_facet(ONE[1], 1, [0, 1, 4, 4])},
            "facets_slave has a node twice in facet 1: .* as a triangle",
        ),
        ({"facets_slave": ONE[1][:, [0, 2, 1, 3]]}, "a folded facet, 0, .* in order"),
        (
            {"points_slave": FOLDED[0], "facets_slave": FOLDED[1]},
            r"facets_slave has a folded facet, 0, .* convex",
        ),
        (
            {"facets_master": with_facet(OTHER[1], 0, OTHER[1][0][::-1])},
            "facets_master has facets 0 and . with normals on opposite sides",
        ),
        ({"points_master": OTHER[0] * [0, 1, 1]}, "a degenerate facet, 0, of size 0"),
        ({"points_master": OTHER[0][:, :2]}, "has 3 nodes for each|points_master"),
        ({"facets_slave": ONE[1][:, :2]}, "facets_slave has 2 nodes for each facet,"),
        ({"facets_slave": ONE[1][:0]}, r"facets_slave has shape \(0, 4\)"),
        ({"points_slave": ONE[0] * np.nan}, "points_slave is nan at"),
        ({"clearance": lambda _: np.zeros(3)}, r"at the places has shape \(3,\)"),
        ({"clearance": np.zeros(3)}, r"clearance has shape \(3,\), expected a number,"),
        (
            {"dofs_slave": DOFS, "dofs_master": DOFS + 3, "n": 30},
            r"dofs_master gives node 0 the degree .* gives node 1 at another position, 0.*away",
        ),
        ({"n": 100}, "given in part, expected dofs_slave, dofs_master of all nodes"),
        (
            {"dofs_slave": DOFS, "dofs_master": DOFS, "n": 20},
            "dofs_slave has entry 26, expected 0 to 19",
        ),
        (
            {"points_master": ONE[0], "facets_master": ONE[1]},
            "facet 0, which is facet 0 of facets_slave",
        ),
        (
            dict(zip(("points_master", "facets_master"), LINE, strict=True)),
            "points_master has 2 coordinates, but points_slave has 3",
        ),
    ],
)
def test_invalid_pairs(parts: dict[str, Any], message: str, method: str) -> None:
    with refused(message):
        bp.pairs(**{"method": method, **changed(**parts)})


def test_types() -> None:
    with pytest.raises(TypeError, match="facets_slave has entries of type float64"):
        bp.pairs(ONE[0], ONE[1] * 1.0, *OTHER)
    with pytest.raises(TypeError, match=r"gap is 0\.0, expected a function"):
        bp.rigid_pairs(*ONE, 0.0)  # type: ignore[arg-type]
    with refused(r"normal has shape \(2,\), expected \(3,\)"):
        bp.rigid_pairs(*ONE, lambda x: x[:, 2], normal=[0, 1])
    with pytest.raises(TypeError, match="dofs has entries of type float64"):
        bp.rigid_pairs(*ONE, lambda x: x[:, 2], dofs=np.zeros((9, 3)), n=27)


def test_second_order_facets() -> None:
    with refused("kind quadrilateral of eight nodes, whose corners"):
        bp.pairs(*QUADRATIC, *OTHER, method="nodes")
    x, facets = QUADRATIC
    with refused(r"from the middle of its edge .* corners first"):
        bp.pairs(x, facets[:, [0, 1, 2, 3, 6, 7, 4, 5]], *OTHER)


def test_layers_of_a_master() -> None:
    """Two sheets above each other: the slave would be covered twice."""
    x, facets = OTHER
    twice = np.concatenate([facets, facets + len(x)])
    both = (np.concatenate([x, x - [0, 0, 0.1]]), twice)
    with refused(
        r"several layers opposite to facet 0 of .* with its facets .* pass a dist"
    ):
        bp.pairs(*ONE, *both)
    near = bp.pairs(*ONE, *both, distance=0.05)
    assert abs(near.B[:, : 3 * 18] - bp.pairs(*ONE, *OTHER).B).max() < 1e-14
    # Nodes meet the nearest layer.
    assert abs(bp.pairs(*ONE, *both, method="nodes").gap).max() < 1e-15


def storeys(turns: float, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """A ramp of triangles around a pole, whose storeys share only the node at the pole."""
    angle = np.linspace(0, 2 * np.pi * turns, parts + 1)
    rim = np.c_[np.cos(angle), np.sin(angle), -0.05 * angle]
    facets = [[0, k, k + 1] for k in range(1, parts + 1)]
    return np.concatenate([[[0, 0, 0.0]], rim]), np.array(facets)


@pytest.mark.parametrize("turns", [1.1, 1.9])
def test_layers_that_share_a_node(turns: float) -> None:
    """Partly covered twice, but in total by less than the whole facet."""
    corners = [[2.0, 2, 0.1], [-2, 2, 0.1], [-2, -2, 0.1], [2, -2, 0.1]]
    pad = (np.array(corners), np.array([[3, 2, 1, 0]]))
    with refused("lies in several layers opposite to facet 0"):
        bp.pairs(*pad, *storeys(turns, 12))
    once = bp.pairs(*pad, *storeys(1.0, 12))
    # Seen from above, a polygon with 12 corners.
    assert once.area.sum() == pytest.approx(6 * np.sin(np.pi / 6), rel=1e-12)


def test_two_sides_of_a_slit() -> None:
    """One body meets itself along a slit that ends at node 2: shared node numbers are valid."""
    points = np.array([[0.0, 0], [1, 0], [2, 0], [1, 0], [0, 0], [1, 1], [1, -1]])
    upper, lower = [[1, 2], [0, 1]], [[2, 3], [3, 4]]
    dofs = np.arange(14).reshape(7, 2)
    kept = bp.pairs(
        points, upper, points, lower, dofs_slave=dofs, dofs_master=dofs, n=14
    )
    apart = bp.pairs(points, upper, points, lower)
    whole = apart.B[:, :14] + apart.B[:, 14:]
    assert abs(kept.B - whole).max() <= 1e-15


def test_opposite_facets_at_a_node() -> None:
    """A thin fin: the mean normal at its edge is zero."""
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    facets = np.array([[0, 1, 3, 2], [2, 3, 1, 0]])
    with refused(r"facets has no normal at node 0: .* opposite normals"):
        bp.rigid_pairs(x, facets, lambda p: p[:, 2])
