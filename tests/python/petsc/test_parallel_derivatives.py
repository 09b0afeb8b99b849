"""Derivatives of the load paths of a distributed stiffness: those of the direct engine."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support import mpi, two_blocks
from support.body_models import floating, on_springs
from support.pressed_in_space import arrays, pressed

pytestmark = pytest.mark.xdist_group("ranks")
# Linear systems are solved to 1e-11, which the condition of the contacts multiplies.
CLOSE = 1e-8


def directions(known: dict[str, Any], result: bp.Result, seed: int) -> dict[str, Any]:
    """Changes of all data, and cotangents of all quantities."""
    draw = np.random.default_rng(seed).standard_normal
    steps, contacts, d = result.reaction.shape
    K = known["K"].tocsr()
    n = K.shape[0]
    # A symmetric change of the size of K on its pattern.
    scale = 1 + 0.1 * draw(n)
    change = 0.5 * (K.multiply(scale[:, None]) + K.multiply(scale[None, :])).tocsr()
    force = np.abs(result.reaction).max() or 1.0
    length = np.abs(result.relative_displacement).max() or 1.0
    given = {
        "along_load": force * draw((steps, n)),
        "along_gap": length * draw(contacts),
        "along_mu": 0.1 * draw(np.shape(known["mu"])),
        "dK": change,
        "by_reaction": draw((steps, contacts, d)) / force,
        "by_relative_displacement": draw((steps, contacts, d)) / length,
        "by_slip": draw((steps, contacts, d - 1)) / length,
        "by_displacement": draw((steps, n)) / length,
    }
    if "cohesion" in known:
        given["along_cohesion"] = 0.1 * force * draw(contacts)
        given["along_dilatancy"] = 0.1 * draw(contacts)
    if fixed := len(known.get("fixed", ())):
        given["along_prescribed"] = length * draw((steps, fixed))
    return given


def compare(found: dict[str, Any], result: bp.Result, given: dict[str, Any]) -> None:
    along, by = (
        {k.removeprefix(part): v for k, v in given.items() if k.startswith(part)}
        for part in ("along_", "by_")
    )
    tangent = result.jvp(K=given["dK"], **along)
    for name in ("reaction", "relative_displacement", "slip", "displacement"):
        assert mpi.changed(found[name], getattr(tangent, name)) <= CLOSE, name
    np.testing.assert_array_equal(found["one_sided"], tangent.one_sided)
    gradient = result.vjp(**by)
    for name in along:
        assert mpi.changed(found[f"by_{name}"], getattr(gradient, name)) <= CLOSE, name
    of_reaction = result.vjp(reaction=by["reaction"])
    assert mpi.changed(found["by_load_of_reaction"], of_reaction.load) <= CLOSE
    # Entries between prescribed degrees of freedom, which have no effect, may be missing.
    own = gradient.K.tocoo()
    assert mpi.changed(found["by_K"][own.row, own.col], own.data) <= CLOSE
    # A tangent and a gradient are two ways to one number.
    forward = sum((by[name] * found[name]).sum() for name in by)
    backward = sum((found[f"by_{name}"] * along[name]).sum() for name in along)
    backward += (found["by_K"] * given["dK"].toarray()).sum()
    assert abs(forward - backward) <= CLOSE * abs(forward)


def in_space(law: float = 0.0) -> tuple[dict[str, Any], dict[str, Any]]:
    known, prescribed = arrays(5)
    if law:
        contacts = len(known["gap"])
        known["cohesion"] = np.full(contacts, law)
        known["dilatancy"] = np.full(contacts, 10 * law)
    return known, {"prescribed": prescribed}


def joined() -> tuple[dict[str, Any], dict[str, Any]]:
    known, prescribed = two_blocks.arrays(10.0, 3, 4)
    return known, {"prescribed": prescribed}


@pytest.mark.parametrize(
    ("case", "ranks"),
    [
        pytest.param(in_space, 2, id="slip in space"),
        pytest.param(lambda: mpi.of_model(pressed(8, dim=2)), 3, id="plane"),
        pytest.param(
            lambda: mpi.of_model(pressed(4, mu=[0.3, 0.15], axis=[1.0, 0.0, 0.0])),
            2,
            id="two coefficients",
        ),
        pytest.param(lambda: in_space(0.01), 2, id="cohesion and dilatancy"),
        pytest.param(lambda: mpi.of_model(floating()), 2, id="held by contact"),
        pytest.param(lambda: mpi.of_model(on_springs()), 2, id="held by springs"),
        pytest.param(joined, 2, id="joined by mortar"),
    ],
)
@pytest.mark.quick_variants("plane", "cohesion*", "held by contact", "joined*")
def test_derivatives_are_those_of_the_direct_engine(case: Any, ranks: int) -> None:
    known, path = case()
    result = mpi.solve_directly(known, **path)
    given = directions(known, result, seed=ranks)
    asked = known | path | given | {"d": result.reaction.shape[2]}
    compare(mpi.run(ranks, "derivatives", **asked), result, given)


@pytest.mark.slow
def test_contacts_that_just_touch() -> None:
    """A block that is moved by its clearance: all contacts are on a border."""
    known, path = mpi.of_model(pressed(4, dim=2))
    pressing = path["prescribed"][:1]
    clearance = np.abs(pressing).max()
    known["gap"] = np.full(len(known["gap"]), clearance)
    result = mpi.solve_directly(known, prescribed=pressing)
    assert result.jvp().one_sided.all()
    # The relative displacement is rounding: there is nothing that the changes could be
    # relative to.
    given = directions(known, result, seed=0)
    along = clearance * np.random.default_rng(0).normal(size=pressing.shape)
    given = {
        name: value if name == "dK" else np.zeros_like(value)
        for name, value in given.items()
    } | {"along_prescribed": along}
    found = mpi.run(2, "derivatives", **known, prescribed=pressing, **given, d=2)
    tangent = result.jvp(prescribed=along, K=given["dK"])
    assert found["one_sided"].all()
    assert tangent.reaction.any()
    assert mpi.changed(found["reaction"], tangent.reaction) <= CLOSE
