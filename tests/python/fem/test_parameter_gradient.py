"""Derivatives with respect to parameters, against differences of what `assemble` makes.

With any λ, u, r and G, `ParameterGradient` is the derivative of

    L = Σ_k  λ_kᵀ (f_k - K u_k + Bᵀ r_k) + G_k · (B u_k + g_k),

which is computed here from the assembled K, B, gaps and loads.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from bipot_rs import fem, obstacle
from bipot_rs.mesh import elements
from support.boxes import CELLS, box, placed
from support.comparisons import refused

STEPS = 2
# Fourth-order differences: their error, h⁴ and ε/h, is below 1e-10 of the largest term.
# The derivative may be smaller than its terms by a factor of 1000.
CLOSE = 1e-7


class Product:
    """λ, u, r and G at random, and L for any model of the same size."""

    def __init__(self, model: fem.Assembly, loads: Sequence[fem.Load] = ()) -> None:
        rng = np.random.default_rng(7)
        shape = (STEPS, len(model.group), model.dim)
        self.adjoint, self.u = rng.normal(size=(2, STEPS, model.n))
        self.reaction, self.gap = rng.normal(size=(2, *shape))
        self.loads = loads

    def __call__(
        self, model: fem.Assembly, loads: Sequence[fem.Load] | None = None
    ) -> float:
        loads = self.loads if loads is None else loads
        total = 0.0
        gaps = np.zeros((STEPS, len(model.group), model.dim))
        gaps[:, :, 0] = model.gap
        gaps = gaps if model.moving is None else model.moving
        names = [body.name for body in model.bodies]
        for k in range(STEPS):
            f = np.zeros(model.n)
            for load in loads:
                b = names.index(load.body)
                load_forces = load.of_steps(STEPS)[k] * load.forces(model.bodies[b])
                f[model.offset[b] :][: load_forces.size] += load_forces
            B, r, G = model.B, self.reaction[k].ravel(), self.gap[k].ravel()
            total += self.adjoint[k] @ (f - model.K @ self.u[k] + B.T @ r)
            total += G @ (B @ self.u[k] + gaps[k].ravel())
        return float(total)

    def gradient(self, model: fem.Assembly) -> fem.ParameterGradient:
        return fem.ParameterGradient(
            model,
            adjoint=self.adjoint,
            displacement=self.u,
            gap=self.gap,
            reaction=self.reaction,
            loads=self.loads,
        )


def slope(function: Callable[[float], float], step: float) -> float:
    """Central difference of fourth order at zero."""
    a, b, c, d = (function(k * step) for k in (-2, -1, 1, 2))
    return (a - d + 8 * (c - b)) / (12 * step)


def bent(cell: str, order: str = "first") -> Any:
    """A mesh whose cells are curved and all differ."""
    mesh = box(cell, 2)
    if order != "first":
        mesh = elements.second_order(mesh, serendipity=order == "serendipity")
    random = np.random.default_rng(1)
    return placed(mesh, mesh.p + 0.03 * random.uniform(-1, 1, mesh.p.shape))


def loads_of(mesh: Any) -> list[fem.Load]:
    dim, top = mesh.p.shape[0], "top"
    strain = np.diag([0.3, -0.2, 0.5])
    strain[0, 1] = strain[1, 0] = 0.1
    return [
        fem.Load("one", top, traction=[0.3, -0.7, 0.2][:dim], factors=[1.0, 0.4]),
        fem.Load("one", top, pressure=0.9, factors=[0.2, 0.7]),
        fem.Load("one", force=[0.5, -0.3, 0.8][:dim], factors=[0.6, -1.0]),
        fem.Load("one", strain=strain, factors=[0.5, 2.0]),
    ]


def ball(dim: int) -> obstacle.Sphere:
    return obstacle.Sphere([0.45, 0.55, -2.1][3 - dim :], 2.0)


def model_of(
    mesh: Any,
    material: Any = None,
    springs: Sequence[fem.Spring] | None = None,
    **contact: Any,
) -> fem.Assembly:
    dim = mesh.p.shape[0]
    if springs is None:
        springs = [fem.Spring("one", "top", stiffness=[0.3, 0.7, 0.4][:dim])]
        springs += [fem.Spring("one", "top", normal=0.8, tangential=0.3)]
    contact = contact or {"obstacle": ball(dim)}
    lumps = elements.KINDS[type(mesh)].facet.lumps
    contacts = [fem.Contact("one", "bottom", 0.3, **contact)] if lumps else []
    body = fem.Body("one", mesh, material or fem.Material(1.3, 0.27, thickness=0.6))
    return fem.assemble([body], contacts, springs=springs)


def agree(
    derivative: Any, at: Callable[[float], fem.Assembly], product: Any, step: float
) -> None:
    """The derivative is the slope of the product over models that differ by h."""
    wanted = slope(lambda h: product(at(h)), step)
    # L is linear in some parameters: large steps leave rounding errors alone.
    within = CLOSE if step < 0.01 else 1e-9
    assert np.squeeze(derivative) == pytest.approx(wanted, rel=within)


@pytest.mark.parametrize(
    ("cell", "order"),
    [
        *product(CELLS, ["first", "second"]),
        ("quadrilateral", "serendipity"),
        ("hexahedron", "serendipity"),
    ],
)
def test_node_coordinates_in_random_directions(cell: str, order: str) -> None:
    """K, B, the gap to a ball, springs and loads of all kinds, on curved cells."""
    mesh = bent(cell, order)
    model = model_of(mesh)
    product = Product(model, loads_of(mesh))
    way = np.random.default_rng(3).normal(size=mesh.p.shape)
    derivative = np.sum(product.gradient(model).nodes * way.T)
    agree(derivative, lambda h: model_of(placed(mesh, mesh.p + h * way)), product, 1e-4)


@pytest.mark.parametrize("plane_stress", [False, True])
@pytest.mark.parametrize("cell", ["quadrilateral", "tetrahedron"])
def test_moduli_and_thickness(cell: str, plane_stress: bool) -> None:
    mesh = bent(cell)
    material = fem.Material(1.3, 0.27, plane_stress=plane_stress, thickness=0.6)
    model = model_of(mesh, material)
    product = Product(model, loads_of(mesh))
    gradient = product.gradient(model)
    for name in ("young", "poisson", "thickness")[: 3 if CELLS[cell] == 2 else 2]:

        def at(h: float, name: str = name) -> fem.Assembly:
            value = getattr(material, name) + h
            return model_of(mesh, replace(material, **{name: value}))

        agree(getattr(gradient, name)["one"], at, product, 1e-3)


def test_materials_of_volumes() -> None:
    mesh = bent("triangle")
    left = mesh.p[0, mesh.t].mean(axis=0) < 0.5
    parts = {"left": np.flatnonzero(left), "right": np.flatnonzero(~left)}
    mesh = mesh.with_subdomains(parts)

    def at(h: float) -> fem.Assembly:
        laws = {"left": fem.Material(1.0, 0.2), "right": fem.Material(3.0, 0.4 + h)}
        return fem.assemble([fem.Body("one", mesh, laws)], [])

    product = Product(at(0.0), [fem.Load("one", strain={"right": np.eye(3)})])
    by_poisson = product.gradient(at(0.0)).poisson["one"]
    assert by_poisson.shape == (2,)
    agree(by_poisson[1], at, product, 1e-4)


def test_springs_and_initial_strain() -> None:
    mesh = bent("tetrahedron")
    model, loads = model_of(mesh), loads_of(mesh)
    product = Product(model, loads)
    gradient = product.gradient(model)
    for i, name, way in (
        (0, "stiffness", np.eye(3)[1]),
        (1, "normal", np.ones(1)),
        (1, "tangential", np.ones(1)),
    ):

        def at(h: float, i: int = i, name: str = name, way: Any = way) -> fem.Assembly:
            springs = list(model.springs)
            value = np.squeeze(getattr(springs[i], name) + h * way)
            springs[i] = replace(springs[i], **{name: value.tolist()})
            return model_of(mesh, springs=springs)

        agree(np.sum(gradient.springs[i][name] * way), at, product, 0.1)
    way = np.array([[0.2, 0.4, 0.1], [0.4, -0.5, 0.3], [0.1, 0.3, 0.7]])

    def strained(h: float) -> float:
        added = replace(loads[3], strain=np.asarray(loads[3].strain) + h * way)
        return product(model, [*loads[:3], added])

    derivative = np.sum(gradient.initial_strain[3] * way)
    assert derivative == pytest.approx(slope(strained, 0.1), rel=1e-9)
    assert gradient.initial_strain[:3] == [None] * 3


def shifted(shape: Any, by: Any) -> Any:
    if isinstance(shape, obstacle.Union):
        return obstacle.Union([shifted(part, by) for part in shape.obstacles])
    name = "point" if hasattr(shape, "point") else "centre"
    return replace(shape, **{name: np.asarray(getattr(shape, name)) + by})


SHAPES = {
    "plane": obstacle.Plane([0, 0, -0.1], [0.1, 0.2, 1.0]),
    "sphere": ball(3),
    "bowl": obstacle.Sphere([0.4, 0.5, 3.0], 3.3, inside=True),
    "cylinder": obstacle.Cylinder([0.4, 0.5, -1.5], 1.3, axis=[1.0, 0.3, 0.1]),
    "torus": obstacle.Torus([0.4, 0.5, -1.5], [0.1, 1.0, 0.2], 1.0, 0.3),
    "two balls": obstacle.Union(
        [obstacle.Sphere([0.0, 0.4, -1.1], 1.0), obstacle.Sphere([1.1, 0.6, -1.4], 1.3)]
    ),
}


@pytest.mark.parametrize("motion", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_obstacles_and_the_nodes_above_them(name: str, motion: bool) -> None:
    """The frames of curved obstacles turn with the nodes, and with them B."""
    mesh, shape, still = bent("hexahedron"), SHAPES[name], np.zeros(3)
    moved = obstacle.Motion([[0.05, 0.02, 0.03], [0.1, -0.03, 0.01]])
    rng = np.random.default_rng(5)
    by, way = rng.normal(size=3), rng.normal(size=mesh.p.shape)

    def at(h: float, way: Any = 0.0, by: Any = still) -> fem.Assembly:
        moving, there = placed(mesh, mesh.p + h * way), shifted(shape, h * by)
        path = moved if motion else None
        return model_of(moving, springs=[], obstacle=there, motion=path)

    product = Product(at(0.0))
    gradient = product.gradient(at(0.0))
    if motion and name != "plane":
        # The normals of these change with each step.
        for field in ("obstacles", "nodes"):
            with refused("contacts have frames of each step"):
                getattr(gradient, field)
        return
    agree(gradient.obstacles[0] @ by, lambda h: at(h, by=by), product, 1e-4)
    agree(np.sum(gradient.nodes * way.T), lambda h: at(h, way), product, 1e-4)


@pytest.mark.parametrize(
    ("cell", "axis"),
    [
        ("triangle", None),
        ("quadrilateral", None),
        ("hexahedron", None),
        ("hexahedron", [1.0, 0.4, 0.3]),
    ],
)
def test_two_bodies_whose_nodes_match(cell: str, axis: Any) -> None:
    upper, dim = box(cell, 2), CELLS[cell]
    lower = placed(upper, upper.p - np.eye(dim)[-1][:, None])
    contact = fem.Contact("one", "bottom", 0.3, against=("other", "top"), axis=axis)
    # The nodes opposite move with their partners, so that they still match.
    way = 0.3 * np.random.default_rng(6).normal(size=(2, *upper.p.shape))
    low, high = upper.p[-1] < 1e-9, lower.p[-1] > -1e-9
    way[1][:, high] = way[0][:, low]

    def at(h: float) -> fem.Assembly:
        one, other = (
            placed(mesh, mesh.p + h * by)
            for mesh, by in zip((upper, lower), way, strict=True)
        )
        bodies = [
            fem.Body("one", one, fem.Material(1.0, 0.3)),
            fem.Body("other", other, fem.Material(2.0, 0.2)),
        ]
        return fem.assemble(bodies, [contact])

    product = Product(at(0.0))
    nodes = product.gradient(at(0.0)).nodes
    agree(np.sum(nodes * np.concatenate([way[0].T, way[1].T])), at, product, 1e-4)


def test_clearance() -> None:
    mesh = bent("hexahedron")
    count = len(model_of(mesh).group)

    def at(h: float) -> fem.Assembly:
        extra = 0.1 + h * np.arange(count)
        return model_of(mesh, springs=[], obstacle=ball(3), clearance=extra)

    product = Product(at(0.0))
    (by_clearance,) = product.gradient(at(0.0)).clearance
    agree(by_clearance @ np.arange(count), at, product, 0.1)


def test_what_is_no_derivative_is_refused() -> None:
    mesh = bent("hexahedron")
    flat = {"plane": ([0, 0, -0.1], [0, 0, 1])}
    turning = obstacle.Motion(rotation=[0.1, 0.2], axis=[0, 1, 0])
    distance = obstacle.Distance(lambda x: x[:, 2] + 0.1)
    varying = [fem.Load("one", force=lambda x: x)]
    oak = fem.Orthotropic((12.0, 1.0, 1.0), (0.3, 0.3, 0.3), (0.7, 0.7, 0.1))
    loads: list[fem.Load]
    for field, contact, loads, message in (
        ("nodes", flat | {"pairing": "mortar"}, [], "pairing 'mortar'"),
        ("nodes", flat | {"clearance": lambda x: 0 * x[:, 0]}, [], "is a function"),
        ("nodes", flat, varying, "varies with the position"),
        ("thickness", flat, [], "no thickness"),
        (
            "obstacles",
            flat | {"motion": turning},
            [],
            "an obstacle turns, or is curved",
        ),
        ("obstacles", {"obstacle": distance}, [], "is a Distance"),
        ("young", {"material": oak}, [], "orthotropic"),
    ):
        model = model_of(mesh, springs=[], **contact)
        with refused(message):
            getattr(Product(model, loads).gradient(model), field)
    with refused("exactly one of traction"):
        fem.Load("one")
    with refused("needs a surface"):
        fem.Load("one", pressure=1.0)


def test_a_plane_under_mortar_moves_the_gap() -> None:
    mesh = bent("hexahedron")

    def at(h: float) -> fem.Assembly:
        plane = ([0, 0, -0.1 + h], [0.1, 0.2, 1.0])
        return model_of(mesh, springs=[], plane=plane, pairing="mortar")

    product = Product(at(0.0))
    (by_plane,) = product.gradient(at(0.0)).obstacles
    agree(by_plane[2], at, product, 0.01)
