"""Messages about the tables of a scene are our own, and name the key path."""

import copy
import datetime
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import ValidationError

from bipot_rs import scene
from bipot_rs.scene.library import text
from bipot_rs.scene.schema.messages import MESSAGES
from bipot_rs.scene.schema.root import Scene

# A scene with every kind of table; the shipped scenes have the rest.
WHOLE = """
title = "it"
[mesh]
n = 2
element = "Q1"
[material.soft]
young = [1.0, 1.0, 1.0]
poisson = [0.1, 0.1, 0.1]
shear = [1.0, 1.0, 1.0]
axes = [[1.0, 0.0], [0.0, 1.0]]
[body.a]
material = { part = "soft" }
mesh = { file = "a.msh", group = ["part"], order = 1 }
surface.side = { within = { x = [0.0, 1.0] }, normal = [1.0, 0.0], angle = 3.0 }
[body.b]
material = "soft"
cell = "quadrilateral"
x = { from = 0.0, to = 1.0, cell = "1/n", uniform = [0.0, 0.5], growth = [[1, 1.2]] }
y = [0.0, 1.0]
[obstacle.disc]
sphere = { centre = [0.0, 0.0], radius = 1.0 }
inside = true
move = { x = { value = 1.0, amplitude = "press" } }
turn = { angle = 3.0, about = [0.0, 0.0] }
[obstacle.ring]
torus = { centre = [0, 0, 0], axis = [0, 0, 1], major_radius = 2, minor_radius = 1 }
[[symmetry]]
on = "b.left"
[[spring]]
on = "b.top"
stiffness = [1.0, 2.0]
[[strain]]
on = "a"
tensor = [[1.0, 0.0], [0.0, 1.0]]
[[contact]]
on = "b.bottom"
against = "disc"
mu = [0.1, 0.2]
pairing = "mortar"
clearance = { height = 0.0, radius = 1.0, centre = [0.0, 0.0] }
[path]
steps = 2
automatic = { first = 0.5, slip = 1.0 }
amplitude.press = [0.5, 1.0]
amplitude.turn = { wave = "sine", period = 3.0 }
[wear]
coefficient = 1.0
cycles = 3
[solver]
method = "auto"
engine = "auto"
tol = 1e-9
max_iterations = 3
"""
WRONG: list[Any] = [
    *(True, -1, 0, 3, 10**12, 2.5, -2.5, 500.0, float("nan"), float("inf")),
    *("", "x", "n/2", [], [1], [1, 2, 3, 4, 5], ["x"], [[]], [[1.0, "x"]], [{}]),
    *({}, {"x": 1}, {"value": "x"}, datetime.date(2026, 1, 1)),
]


def changed(table: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The table with each of its values replaced by each wrong one, and with a key more."""

    def places(at: Any) -> Iterator[tuple[Any, Any]]:
        for key in list(at) if isinstance(at, dict) else range(len(at)):
            yield at, key
            if isinstance(at[key], dict | list):
                yield from places(at[key])

    whole = copy.deepcopy(table)
    for at, key in places(whole):
        before = at[key]
        for value in WRONG:
            at[key] = copy.deepcopy(value)
            yield whole
        at[key] = before
        if isinstance(before, dict):
            before["no_such_key"] = 1
            yield whole
            del before["no_such_key"]


def messages(table: dict[str, Any]) -> list[str]:
    try:
        scene.check("it", table)
    except scene.SceneError as error:
        return [str(mistake) for mistake in error.mistakes]
    return []


@pytest.mark.parametrize("name", ["whole", "pressed_block", "two_blocks"])
@pytest.mark.quick_variants("pressed_block")
def test_no_message_is_one_of_pydantic(name: str) -> None:
    kinds = set()
    for table in changed(tomllib.loads(WHOLE if name == "whole" else text(name))):
        try:
            Scene.model_validate(table)
        except ValidationError as error:
            raw = error.errors()
        else:
            continue
        kinds |= {error_of_model["type"] for error_of_model in raw}
        told = " ".join(messages(table))
        for error_of_model in raw:
            assert error_of_model["type"] in MESSAGES
            if error_of_model["type"] != "value_error":
                assert error_of_model["msg"] not in told
        for word in ("Input", "validation", "items", "dictionary", "instance", "tag"):
            assert word not in told
    if name == "whole":
        # All kinds appear but those that strict tables cannot raise.
        assert set(MESSAGES) - kinds <= {"int_from_float", "model_attributes_type"}


def test_key_and_kind_of_each_mistake() -> None:
    def kinds(table: dict[str, Any]) -> list[tuple[str, Any]]:
        with pytest.raises(scene.SceneError) as raised:
            scene.check("it", table)
        return [(m.key, m.kind) for m in raised.value.mistakes]

    table, kind = tomllib.loads(text("pressed_block")), scene.MistakeKind
    metal = table["material"]["metal"]
    metal["poissn"] = metal.pop("poisson")
    table["contact"][0]["plane"]["point"] = [0.0]
    table["mesh"]["n"] = 2.5
    assert kinds(table) == [
        ("mesh.n", kind.INTEGER),
        ("material.metal.poisson", kind.MISSING_KEY),
        ("material.metal.poissn", kind.UNKNOWN_KEY),
        ("contact.0.plane.point", kind.RANGE),
    ]
    table = tomllib.loads(text("pressed_block"))
    table["contact"][0]["on"] = "block.under"
    assert ("contact.0.on", kind.NAME) in kinds(table)
