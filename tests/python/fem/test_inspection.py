"""Warnings about a model before solving, and models without a warning."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bipot_rs import fem
from bipot_rs import obstacle as ob
from bipot_rs.fem.checks.free_bodies import list_unsupported
from bipot_rs.fem.checks.inspection import inspect

FLOOR = ([0, 0, 0], [0, 0, 1.0])


def cube(
    name: str = "a", low: float = 0.0, young: float = 1.0, size: float = 1.0
) -> fem.Body:
    g = size * np.linspace(0, 1, 4)
    mesh = fem.box([g, g, size * low + g], "hexahedron")
    return fem.Body(name, mesh, fem.Material(young, 0.3))


TOP = fem.Support("a", "top", (0, 1, 2))
PAIR = fem.Contact("a", "bottom", 0.1, against=("b", "top"))
UNDER = fem.Contact("b", "bottom", 0.0, plane=([0, 0, -1], [0, 0, 1.0]))


def on(plane: Any = FLOOR, mu: float = 0.3, surface: str = "bottom") -> fem.Contact:
    return fem.Contact("a", surface, mu, plane=plane)


def test_penetration() -> None:
    tilted = ([0, 0, 0.05], [0.05, 0, 1.0])
    (warning,) = inspect(fem.assemble([cube()], [on(tilted)]))
    deepest = 0.05 / np.hypot(0.05, 1)
    assert warning == (
        "12 of the 16 nodes of surface 'bottom' of body 'a' start inside what they may "
        f"touch, the deepest by {deepest:g} at (0, 0, 0), 5 % of the size of the model: "
        "the first step pushes them out; this is right for an interference fit, otherwise "
        "move the body or add a clearance"
    )
    # A negative clearance asks for it; a positive one does not.
    clearance: Any
    for clearance, count in (
        (-0.01, 0),
        (lambda x: -0.1 * x[:, 2] - 0.1, 0),
        (0.01, 1),
    ):
        model = fem.assemble([cube()], [replace(on(tilted), clearance=clearance)])
        assert len(inspect(model)) == count
        # The arrays of the model are examined too, and give the same answer.
        at_start = model.problem().remarks.at_start
        assert sum("penetrate" in remark for remark in at_start) == count
    # The same in other units; rounding gives no warning.
    big = fem.assemble([cube(size=1e4)], [on(([0, 0, 500], [0.05, 0, 1.0]))])
    assert inspect(big)[0].startswith("12 of the 16 nodes")
    assert inspect(fem.assemble([cube()], [on(([0, 0, 1e-12], [0, 0, 1.0]))])) == []


def test_facing_away() -> None:
    floor = ([0, 0, -0.1], [0, 0, 1.0])
    model = fem.assemble([cube()], [on(floor, surface="top")])
    (warning,) = inspect(model)
    assert warning == (
        "surface 'top' of body 'a' faces away from what it may touch, at all of its 16 "
        "nodes: check that the normal of the obstacle points to the body, and that this is "
        "the right surface"
    )
    # With a reversed normal, the body is also inside the floor.
    turned = fem.assemble([cube()], [on(([0, 0, -0.1], [0, 0, -1.0]))])
    inside, away = inspect(turned)
    assert inside.startswith("16 of the 16 nodes of surface 'bottom'")
    assert away.startswith("surface 'bottom' of body 'a' faces away")


def test_never_closing() -> None:
    model = fem.assemble([cube()], [on(([0, 0, -0.2], [0, 0, 1.0]))], [TOP])
    moved = np.tile(-0.05, len(model.fixed))
    assert inspect(model) == []
    (warning,) = inspect(model, prescribed=moved)
    assert warning == (
        "surface 'bottom' of body 'a' may never touch: its nearest node, at (0, 0, 0), "
        "stays 0.2 away, and supports move by 0.05 at most"
    )
    assert inspect(model, prescribed=4 * moved) == []
    (warning,) = inspect(model, load=np.full(model.n, 1e-4))
    assert warning.endswith("stays 0.2 away, 20 % of the size of the model")
    # An obstacle that rises closes it.
    plane, motion = (
        ob.Plane([0, 0, -0.2], [0, 0, 1]),
        ob.Motion([[0, 0, 0.1], [0, 0, 0.21]]),
    )
    rising = fem.Contact("a", "bottom", 0.3, obstacle=plane, motion=motion)
    model = fem.assemble([cube()], [rising], [TOP])
    assert inspect(model, prescribed=np.zeros((2, len(model.fixed)))) == []


def test_contacts_without_friction_by_supports() -> None:
    side = fem.Support("a", "left", (0, 1))
    model = fem.assemble([cube()], [on()], [side])
    (warning,) = inspect(model)
    assert warning == (
        "4 of the 16 nodes of surface 'bottom' of body 'a' have no friction, mu = 0: "
        "supports prescribe their tangential displacement; remove these components of the "
        "support if friction should act"
    )
    assert inspect(fem.assemble([cube()], [on(mu=0.0)], [side])) == []


def test_loads_too_large_for_the_stiffness() -> None:
    """A modulus in GPa with loads in MPa; the largest load of all steps counts."""
    top = fem.Support("a", "bottom", (0, 1, 2))
    for size in (1.0, 1e3):
        body = cube(young=210.0, size=size)
        model = fem.assemble([body], [], [top])
        pull = model.traction("a", "top", np.array([0.0, 0.0, 1.0]))
        loads = np.multiply.outer([0.0, -12.6, 1.0], pull)
        (warning,) = inspect(model, load=loads)
        assert warning == (
            "units may be mixed: the loads of body 'a' over its largest section are 12.6, "
            "6 % of its Young's modulus 210, but the theory assumes small strains"
        )
        assert inspect(model, load=0.8 * loads) == []
        # Loads one after the other count as one; strains are not loads.
        travelling = 0.8 * 12.6 * np.stack([pull, np.roll(pull, 1), np.roll(pull, 2)])
        assert inspect(model, load=travelling) == []
        assert inspect(model, load=loads, strained=0.3 * loads) == []
    # In the plane the load acts on length and thickness.
    thick = fem.Material(210.0, 0.3, thickness=5.0)
    g = np.linspace(0, 1, 4)
    plate = fem.Body("a", fem.box([g, 3 * g], "quadrilateral"), thick)
    model = fem.assemble([plate], [], [fem.Support("a", "bottom", (0, 1))])
    side = model.traction("a", "right", np.array([12.6, 0.0]))
    (warning,) = inspect(model, load=side)
    assert "over its largest section are 12.6," in warning


@pytest.mark.parametrize(
    ("contacts", "supports", "words"),
    [
        ([], [], "body 'a' can move freely and has no support and no spring: add one"),
        # With a support that leaves motions free, the warning names these motions.
        (
            [],
            [fem.Support("a", "left", (0,))],
            (
                "body 'a' can move freely by translation along y; translation along z; "
                "rotation about"
            ),
        ),
        # On a frictionless floor it can slide, and turn about the vertical.
        (
            [on(mu=0.0)],
            [],
            (
                "body 'a' can move freely by translation along x; translation along y; "
                "rotation about an axis through (0.5, 0.5, 0.5) along (0, 0, 1): add a "
                "support, friction or a contact that stops it"
            ),
        ),
        (
            [on(mu=0.0)],
            [fem.Support("a", "left", (0, 2))],
            "body 'a' can move freely by translation along y: add",
        ),
    ],
)
def test_unsupported_bodies(contacts: Any, supports: Any, words: str) -> None:
    (warning,) = inspect(fem.assemble([cube()], contacts, supports))
    assert warning.startswith(words)


def test_two_unsupported_bodies_in_contact() -> None:
    slick = replace(PAIR, mu=0.0)

    def told(contacts: list[fem.Contact], *components: int) -> str:
        held = [fem.Support("b", "left", components)] if components else []
        model = fem.assemble([cube(), cube("b", -1.0)], contacts, held)
        (warning,) = inspect(model)
        return warning

    moving = "bodies 'a' and 'b' can move freely"
    assert told([PAIR, UNDER], 0).startswith(f"{moving} by translation along y:")
    assert told([PAIR]) == f"{moving} and have no support and no spring: add one"
    # A floor holds them along its normal.
    assert "by translation along x of body 'a'" in told([slick, UNDER])
    # Without friction between them, the upper body can slide separately.
    warning = told([slick, UNDER], 0, 1, 2)
    assert "'a' and 'b'" in warning
    assert "of body 'a'" in warning
    assert "of body 'b'" not in warning


@pytest.mark.parametrize("spring", [False, True])
@pytest.mark.parametrize("held", [False, True])
def test_what_contact_alone_can_hold(held: bool, spring: bool) -> None:
    supports = [fem.Support("a", "top", (2,))] * held
    springs = [fem.Spring("b", "left", stiffness=3.0)] * spring
    blocks = [cube(), cube("b", -1.0)]
    model = fem.assemble(blocks, [PAIR], supports, springs=springs)
    assert list_unsupported(model) == ["a"] * (not held) + ["b"] * (not spring)


@pytest.mark.parametrize(
    ("young", "size", "says"),
    [
        (
            2.1e11,
            100.0,
            "looks like Pa with lengths in m, but the size of the model is 100",
        ),
        (
            2.1e5,
            0.04,
            "looks like MPa with lengths in mm, but the size of the model is 0.04",
        ),
        (2.1e11, 0.1, None),
        (2.1e5, 100.0, None),
        (1.0, 1.0, None),
    ],
)
def test_units(young: float, size: float, says: str | None) -> None:
    warnings = inspect(fem.assemble([cube(young=young, size=size)], [on()]))
    assert len(warnings) == (says is not None)
    for warning in warnings:
        assert f"modulus {young:g} of body 'a' {says}; for lengths in" in warning
