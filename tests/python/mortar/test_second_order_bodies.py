"""Second-order bodies by mortar: planes, parts, clearances, rotated and in other units.

The tests look for a wrong solution that is reported as converged.
"""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bipot_rs import fem
from support.comparisons import close, near, refused

pytestmark = pytest.mark.needs_extra

E, NU, P = 1000.0, 0.3, 2.0
# Some thousand second-order unknowns: their condition, 1e4, times rounding.
PATCH = 1e-11

Floats = NDArray[np.float64]
KINDS: dict[str, tuple[str, bool | None]] = {
    "T3": ("tetrahedron", None),
    "T6": ("tetrahedron", False),
    "Q4": ("hexahedron", None),
    "Q8": ("hexahedron", True),
    "Q9": ("hexahedron", False),
}


def made(
    kind: str, axes: list[Any], turn: Floats, unit: float, name: str = "it"
) -> fem.Body:
    """A box numbered at random, rotated, in other units of length; second order by kind.

    Forces keep their unit, so stresses scale with ``1/unit²``.
    """
    cell, few = KINDS[kind]
    mesh = fem.box(axes, cell)
    random = np.random.default_rng(len(axes[0]))
    order = random.permutation(mesh.p.shape[1])
    p = np.empty_like(mesh.p)
    p[:, order] = mesh.p
    cells = order[mesh.t][:, random.permutation(mesh.t.shape[1])]
    mesh = type(mesh)(p, cells)
    if few is not None:
        mesh = fem.second_order(mesh, serendipity=few)
    ends: dict[str, Any] = {"left": (0, 0.0), "front": (1, 0.0)}
    ends |= {"bottom": (2, min(axes[2])), "top": (2, max(axes[2]))}
    named = {
        word: fem.surface(mesh, within={k: (at, at)}) for word, (k, at) in ends.items()
    }
    placed = type(mesh)(unit * (turn @ mesh.p), mesh.t, named)
    return fem.Body(name, placed, fem.Material(E / unit**2, NU))


def cube(kind: str, name: str, low: float, grid: list[float]) -> fem.Body:
    """A unit cube above ``low`` with unequal divisions."""
    axes = [grid, grid, low + np.array([0.0, 0.4, 1.0])]
    return made(kind, axes, np.eye(3), 1.0, name)


def solved(body: fem.Body, *contacts: fem.Contact) -> tuple[Any, Any]:
    """Pressed from above; the sides x = 0 and y = 0 are symmetry planes."""
    sides = [fem.Symmetry("high", s) for s in ("left", "front")]
    model = fem.assemble([body], contacts, symmetries=sides)
    load = model.pressure("high", "top", P)
    return model, model.problem().solve(load, model.prescribed([]), tol=1e-15)


def on_floor(pairing: str = "mortar", **more: Any) -> fem.Contact:
    floor = ([0, 0, 0], [0, 0, 1.0])
    return fem.Contact("high", "bottom", 0.0, plane=floor, pairing=pairing, **more)


def is_uniform(model: fem.Assembly, result: Any) -> None:
    x = model.nodes
    exact = P / E * np.column_stack([NU * x[:, 0], NU * x[:, 1], -x[:, 2]])
    close(result.displacement[0].reshape(-1, 3), exact, PATCH)
    np.testing.assert_allclose(result.traction[0][:, 0], P, rtol=10 * PATCH)


@pytest.mark.parametrize("kind", ["T6", "Q8", "Q9"])
def test_patch_on_a_plane(kind: str) -> None:
    body = cube(kind, "high", 0.0, [0.0, 0.45, 1.0])
    is_uniform(*solved(body, on_floor()))
    # At nodes, these faces have areas that are not positive; faces of 9 nodes do not.
    if kind == "Q9":
        is_uniform(*solved(body, on_floor("match")))
    else:
        with refused('use pairing="mortar"'):
            solved(body, on_floor("match"))


@pytest.mark.parametrize("kind", ["T6", "Q8"])
def test_two_parts_of_a_surface_are_the_whole(kind: str) -> None:
    """Facets on both sides of x = 0.45, which share the nodes on the line."""
    body = cube(kind, "high", 0.0, [0.0, 0.45, 1.0])
    halves = [on_floor(within={0: part}) for part in ((0.0, 0.45), (0.45, 1.0))]
    model, result = solved(body, *halves)
    areas = [model.area[model.group == k].sum() for k in (0, 1)]
    np.testing.assert_allclose(areas, [0.45, 0.55], rtol=1e-13)
    np.testing.assert_allclose(result.reaction[0][:, 0].sum(), P, rtol=10 * PATCH)
    # The shared nodes get forces from both parts; their pressures add up to that of the whole.
    fields = model.fields(result.displacement[0], result.reaction[0], result.status[0])
    at = body.nodes("bottom")
    whole, other = solved(body, on_floor())
    pushed = [
        m.B.T @ r.reaction[0].ravel() for m, r in ((model, result), (whole, other))
    ]
    near(*pushed, 10 * PATCH * P)
    assert (fields["contact_status"][at[fields["contact_pressure"][at] > 0]] == 1).all()


@pytest.mark.parametrize("unit", [1e-6, 1e6])
@pytest.mark.parametrize(
    ("high", "low"),
    [
        ("T6", "Q8"),
        ("Q8", "T6"),
        ("T3", "Q9"),
        ("Q4", "Q8"),
        ("Q9", "T3"),
        ("Q8", "Q9"),
    ],
)
def test_patch_turned_and_in_other_units(high: str, low: str, unit: float) -> None:
    """Two non-matching bodies on symmetry planes whose normals are not along axes."""
    turn = Rotation.random(random_state=len(high + low) + int(unit > 1)).as_matrix()
    grids, up = ([0, 0.45, 1.0], [0, 0.3, 0.7, 1.0]), np.array([0, 0.4, 1.0])
    bodies = [
        made(high, [grids[0], grids[0], up], turn, unit, "high"),
        made(low, [grids[1], grids[1], up - 1], turn, unit, "low"),
    ]
    on: Any = {"against": ("low", "top"), "pairing": "mortar"}
    planes = [fem.Symmetry(b.name, s) for b in bodies for s in ("left", "front")]
    planes.append(fem.Symmetry("low", "bottom"))
    contacts = [fem.Contact("high", "bottom", 0.5, **on)]
    model = fem.assemble(bodies, contacts, symmetries=planes)
    assert model.area.sum() == pytest.approx(unit**2, rel=1e-13)
    assert (model.area > 0).all()
    load = model.pressure("high", "top", P / unit**2)
    result = model.problem().solve(load, model.prescribed([]), tol=1e-14)
    x = model.nodes @ turn / unit
    exact = P / E * np.column_stack([NU * x[:, 0], NU * x[:, 1], -1 - x[:, 2]])
    # Some hundred unknowns: a condition of 1e3 times rounding.
    close(result.displacement[0].reshape(-1, 3) @ turn / unit, exact, 1e-12)
    assert result.traction is not None
    near(unit**2 * result.traction[0, :, 0], P, 1e-11 * P)
