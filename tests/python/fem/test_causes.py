"""Errors of a problem name what of its model caused them."""

import re

import numpy as np
import pytest

from bipot_rs import fem
from bipot_rs.contact.errors import NotIterativeError
from support.boxes import box, placed
from support.comparisons import refused
from support.slender import STEEL, floor, problem, strip, supports

pytestmark = pytest.mark.needs_extra


def test_a_support_oblique_to_a_contact_is_taken_and_named() -> None:
    """A plane that slopes under a corner which a support holds along z."""
    body = fem.Body("lower", box("hexahedron", 2), fem.Material(STEEL[0], STEEL[1]))
    slope = fem.Contact("lower", "bottom", 0.3, plane=((0, 0, 0), (0.0, 0.6, 0.8)))
    ends = [("top", (0, 1, 2)), ("bottom", (2,))]
    held = [fem.Support("lower", side, components) for side, components in ends]
    model = fem.assemble([body], [slope], held)
    assert model.problem(engine="iterative").stats["engine"] == "iterative"
    named = model.name_cause(oblique(2))
    x = ", ".join(f"{c:g}" for c in model.points[2])
    assert getattr(named, "reason", "") == (
        f"support 'lower.bottom' holds contact 2 of 'lower.bottom' at ({x}) along a direction "
        "that is neither its normal nor a tangent"
    )
    # PETSc refuses only what the iterative engine refuses too.
    for name in (named, model.name_cause(oblique(2), "petsc")):
        assert str(name).endswith(". Use engine='direct'")


def oblique(contact: int) -> NotIterativeError:
    error = NotIterativeError("")
    error.contact, error.oblique = contact, True
    return error


@pytest.mark.parametrize("plane", [True, False])
def test_an_inclined_plane_of_symmetry_is_named_before_a_support(plane: bool) -> None:
    """Mortar reaches over supported nodes, which do not hold the contact obliquely."""
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    bodies = []
    for name, low, cells in (("low", 0.0, 2), ("up", 0.5, 3)):
        side = np.linspace(0.0, 1.0, cells + 1)
        mesh = fem.box([side, side, [low, low + 0.5]], "hexahedron")
        bodies.append(fem.Body(name, placed(mesh, turn @ mesh.p), fem.Material(*STEEL)))
    contact = fem.Contact("up", "bottom", 0.3, against=("low", "top"), pairing="mortar")
    held = [fem.Support("low", "left", (0, 1, 2)), fem.Support("up", "top", (2,))]
    planes = [fem.Symmetry(body.name, "front") for body in bodies if plane]
    model = fem.assemble(bodies, [contact], held, symmetries=planes)
    at_corner = int(np.argmin(np.abs(model.points[:, :2]).sum(axis=1)))
    reason = getattr(model.name_cause(oblique(at_corner)), "reason", "")
    expected = "a plane of symmetry that is not" if plane else "support 'low.left'"
    assert reason.startswith(expected), reason


def test_an_undecided_motion_names_body_axis_and_slender_cell() -> None:
    """Without coordinates the digits of K must decide, and here they cannot."""
    body = strip((1000.0, 0.2), (160, 2))
    model = fem.assemble([body], [floor(body, 0.0)], supports("clamped", 2))
    with refused("it cannot be decided whether") as caught:
        problem(model, False)
    assert caught.value.kind == "few_digits"
    assert "Give `coordinates`" in str(caught.value)
    named = str(model.name_cause(caught.value))
    # Cells of 6.25 by 0.1, all equal.
    words = r"body 'strip': K has too few .* its soft motion along [xy] at \("
    assert re.match(words, named)
    words = r"most slender is at \([\d., ]+\), 6\d times as long as thick"
    assert re.search(words, named)
    assert "coordinates" not in named
