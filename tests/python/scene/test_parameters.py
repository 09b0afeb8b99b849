"""``[parameter]``, and formulas in place of numbers."""

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bipot_rs as bp
from bipot_rs.scene import SceneError, read
from bipot_rs.scene.schema.formula import evaluate
from support.comparisons import refused

VALUES = {"a": 0.7, "F": -3.0, "\u03bc_2": 2.5e-3}
LEAVES = st.one_of(
    st.floats(0, 1e6).map(lambda v: (repr(v), v)), st.sampled_from([*VALUES.items()])
)


def join(parts: tuple[tuple[str, float], str, tuple[str, float]]) -> tuple[str, float]:
    (left, a), sign, (right, b) = parts
    if sign == "-u":
        return f"-({left})", -a
    of = {"+": a + b, "-": a - b, "*": a * b, "/": a / b if b else a * b}
    return f"({left}) {sign if b or sign != '/' else '*'} ({right})", of[sign]


@given(
    st.recursive(
        LEAVES,
        lambda inner: st.tuples(
            inner, st.sampled_from(["+", "-", "*", "/", "-u"]), inner
        ).map(join),
        max_leaves=12,
    )
)
@settings(max_examples=300, deadline=None)
def test_formulas_are_arithmetic(made: tuple[str, float]) -> None:
    """Bitwise the operations on floats that were drawn."""
    text, value = made
    if math.isfinite(value):
        assert evaluate(text, VALUES) == value


@pytest.mark.parametrize(
    ("text", "value"),
    [("10", 10.0), ("2 - 3 - 4*2/8 + -1", -3.0), ("\u00b5_2", 2.5e-3)],
)
def test_precedence_and_letters(text: str, value: float) -> None:
    assert evaluate(text, VALUES) == value


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("G*2", "there is no parameter 'G', expected one of a, F"),
        ("n", "it needs mesh.n"),
        ("1/(a - a)", "it divides by zero"),
        ("1e308*1e308", "its value is not finite"),
        ("1" * 900, "expected numbers, names"),
        ("(" * 900, "expected numbers, names"),
        *(
            (text, "expected numbers, names, + - * / and parentheses")
            for text in (
                *(
                    "",
                    " ",
                    "2**3",
                    "7//2",
                    "2 a",
                    "a.real",
                    "abs(a)",
                    "a[0]",
                    "'2'",
                    "True",
                ),
                *(
                    "lambda: 1",
                    "[1]",
                    "1j",
                    "a if a else 1",
                    "a=1",
                    "a\0",
                    "\ud800",
                    "2*",
                ),
                "__import__('os').getcwd()",
            )
        ),
    ],
)
def test_anything_else_is_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError) as caught:
        evaluate(text, VALUES)
    assert str(caught.value).startswith(why)


def block() -> bp.Model:
    """A pressed block whose numbers are formulas, of which one is "10"."""
    m = bp.Model(n=4)
    m.parameter(mu=0.3, F=5.0, half="F/2", N=8)
    m.material("steel", young="F*42e3", poisson="mu")
    side = {"from": "F - F", "to": "8*F", "cells": "N/2"}
    m.body("block", material="steel", cell="quadrilateral", x=side, y=[0, "2*F", "40"])
    m.support("block.left", x="0*F", within={"y": [0, "8*F"]})
    m.traction("block.top", y=m.times("-10*F", "press"))
    m.pressure("block.right", "half - half + 10")
    plane = {"point": [0, 0], "normal": [0, "1"]}
    m.contact("block.bottom", plane=plane, mu="mu", clearance="F - 5")
    m.path(steps="N/4", press=["mu/0.6", 1.0])
    return m


def test_formulas_stand_for_their_numbers() -> None:
    m = bp.Model(n=4)
    m.parameter(mu=0.3, F=5.0, half=2.5, N=8)
    m.material("steel", young=210e3, poisson=0.3)
    side = {"from": 0.0, "to": 40.0, "cells": 4}
    m.body("block", material="steel", cell="quadrilateral", x=side, y=[0, 10.0, 40.0])
    m.support("block.left", x=0.0, within={"y": [0, 40.0]})
    m.traction("block.top", y=m.times(-50.0, "press"))
    m.pressure("block.right", 10.0)
    plane = {"point": [0, 0], "normal": [0, 1]}
    m.contact("block.bottom", plane=plane, mu=0.3, clearance=0.0)
    m.path(steps=2, press=[0.5, 1.0])
    formulas = block()
    assert formulas.scene.model_dump() == m.scene.model_dump()
    np.testing.assert_array_equal(formulas.solve().reaction, m.solve().reaction)
    assert bp.Model.from_toml(formulas.to_toml()) == formulas
    assert [r for r in formulas.check() if "no effect" in r] == [
        "mesh.n: has no effect, since no formula uses it"
    ]
    whole = formulas.with_(**{"body.block.order": "N/4"})
    assert whole.scene.body["block"].order == 2
    with refused(r"body\.block\.order.*less than or equal to 2"):
        formulas.with_(**{"body.block.order": "N"}).scene  # noqa: B018
    twice = formulas.with_(**{"parameter.F": 10.0, "contact.0.clearance": 0})
    assert twice.scene.traction[0].y.value == -100.0
    assert twice.scene.parameter["half"] == 5.0


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        (
            "traction.0.y.value",
            "2*G",
            (
                "traction.0.y.value: should be a valid number, got '2*G': there is no "
                "parameter 'G', expected one of mu, F, half, N, n"
            ),
        ),
        ("path.steps", "N/3", "path.steps: should be a valid integer, got 2.66"),
        ("contact.0.mu", "-mu", "contact.0.mu: should be greater than or equal to 0"),
        ("parameter.half", "later/2", "parameter.half: should be a valid number, got"),
        (
            "parameter.half",
            "half/2",
            "parameter.half: should be a valid number, got 'half/2': 'half' has no value",
        ),
        ("parameter.G", 1.0, "parameter.G: there is no parameter 'G', expected one of"),
        (
            "parameter",
            {"lambda": 1.0, **VALUES},
            "parameter.lambda: should have another",
        ),
    ],
)
def test_mistakes_in_formulas_name_the_key(key: str, value: Any, said: str) -> None:
    def scene_of() -> object:
        if key != "parameter":
            return block().with_(**{key: value}).scene
        m = bp.Model.from_toml("pressed_block")
        m.parameter(**value)
        return m.scene

    with pytest.raises(SceneError) as caught:
        scene_of()
    (mistake,) = caught.value.mistakes
    assert str(mistake).startswith(said)


def test_parameters_on_the_command_line(bipot: Any) -> None:
    block().to_toml("block.toml")
    asked = read("block.toml", ["parameter.mu=0.1", "contact.0.mu=2*mu"])
    assert asked.contact[0].mu == 0.2
    assert bipot("sweep", "block.toml", "--range", "parameter.mu=0.1:0.3:3")[0] == 0
    with Path("out/block-sweep/sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        m = block().with_(**{"parameter.mu": float(row["parameter.mu"])})
        force = m.solve().contact_force("block.bottom")[-1]
        assert float(row["normal_force of block.bottom"]) == pytest.approx(
            force[1], 1e-9
        )
    assert [float(row["parameter.mu"]) for row in rows] == [0.1, 0.2, 0.3]
