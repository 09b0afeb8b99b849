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
@settings(max_examples=100, deadline=None)
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


NO_FORMULA = """2**3|7//2|2 a|a.real|abs(a)|a[0]|'2'|True|lambda: 1|[1]|1j|a if a else 1|a=1|2*| |
a\0|\ud800|__import__('os').getcwd()"""


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
            (
                text.removeprefix("\n"),
                "expected numbers, names, + - * / and parentheses",
            )
            for text in ["", *NO_FORMULA.split("|")]
        ),
    ],
)
def test_anything_else_is_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError) as caught:
        evaluate(text, VALUES)
    assert str(caught.value).startswith(why)


def block(**numbers: Any) -> bp.Model:
    """A pressed block whose numbers are formulas, of which one is "10", or these values."""

    def of(formula: Any) -> Any:
        return numbers.get(formula, formula)

    m = bp.Model(n=4)
    m.parameter(mu=0.3, F=5.0, half=of("F/2"), N=8)
    m.material("steel", young=of("F*42e3"), poisson=of("mu"))
    side = {"from": of("F - F"), "to": of("8*F"), "cells": of("N/2")}
    y = [0, of("2*F"), of("40")]
    m.body("block", material="steel", cell="quadrilateral", x=side, y=y)
    m.support("block.left", x=of("0*F"), within={"y": [0, of("8*F")]})
    m.traction("block.top", y=m.times(of("-10*F"), "press"))
    m.pressure("block.right", of("half - half + 10"))
    plane = {"point": [0, 0], "normal": [0, of("1")]}
    m.contact("block.bottom", plane=plane, mu=of("mu"), clearance=of("F - 5"))
    m.path(steps=of("N/4"), press=[of("mu/0.6"), 1.0])
    return m


NUMBERS = {"F/2": 2.5, "F*42e3": 210e3, "mu": 0.3, "F - F": 0.0, "8*F": 40.0, "N/2": 4}
NUMBERS |= {"2*F": 10.0, "40": 40.0, "0*F": 0.0, "-10*F": -50.0, "1": 1, "N/4": 2}
NUMBERS |= {"half - half + 10": 10.0, "F - 5": 0.0, "mu/0.6": 0.5}


def test_formulas_stand_for_their_numbers() -> None:
    formulas, m = block(), block(**NUMBERS)
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
                "should be a valid number, got '2*G': there is no parameter 'G', expected one "
                "of mu, F, half, N, n"
            ),
        ),
        ("path.steps", "N/3", "should be a valid integer, got 2.66"),
        ("contact.0.mu", "-mu", "should be greater than or equal to 0"),
        ("parameter.half", "later/2", "should be a valid number, got"),
        ("parameter.half", "half/2", "should be a valid number, got 'half/2': 'half'"),
        ("parameter.G", 1.0, "there is no parameter 'G', expected one of"),
        ("parameter.lambda", 1.0, "should have another"),
    ],
)
def test_mistakes_in_formulas_name_the_key(key: str, value: Any, said: str) -> None:
    m = bp.Model.from_toml("pressed_block")
    if key == "parameter.lambda":
        m.parameter(**{"lambda": value, **VALUES})
    with pytest.raises(SceneError) as caught:
        (m if key == "parameter.lambda" else block().with_(**{key: value})).scene  # noqa: B018
    (mistake,) = caught.value.mistakes
    assert str(mistake).startswith(f"{key}: {said}")


@pytest.mark.slow
def test_parameters_on_the_command_line(bipot: Any) -> None:
    block().to_toml("block.toml")
    asked = read("block.toml", ["parameter.mu=0.1", "contact.0.mu=2*mu"])
    assert asked.contact[0].mu == 0.2
    swept = ("--range", "parameter.mu=0.1:0.3:3", "--jobs", "1")
    assert bipot("sweep", "block.toml", *swept)[0] == 0
    with Path("out/block-sweep/sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["parameter.mu"]) for row in rows] == [0.1, 0.2, 0.3]
    for row in rows:
        m = block().with_(**{"parameter.mu": float(row["parameter.mu"])})
        force = m.solve().contact_force("block.bottom")[-1, 1]
        found = float(row["normal_force of block.bottom"])
        assert found == pytest.approx(force, 1e-9)
