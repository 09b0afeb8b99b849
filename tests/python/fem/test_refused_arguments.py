"""Arguments of finite elements and files that are refused, by their names."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bipot_rs import fem
from support.boxes import box


def refused(call: Callable[[], Any], *words: str) -> None:
    with pytest.raises((ValueError, TypeError)) as caught:
        call()
    message = str(caught.value)
    assert type(caught.value) in (ValueError, TypeError)
    for word in words:
        assert re.search(rf"\b{word}\b", message), f"{word!r} not in {message!r}"
    assert "\n" not in message
    assert len(message) < 300


NAN = math.nan
WIDE = (NAN, "wide", [0.1, 0.2], [[0.1] * 3], 1j)
HARD = (NAN, "hard", [1.0], [1.0, 2.0, 3.0], np.ones((2, 9, 9)), 1j)


BODY = fem.Body("block", box("quadrilateral", 2), fem.Material(1.0, 0.3))
PLANE = ([0.0, 0.0], [0.0, 1.0])


def contact(**changed: Any) -> Any:
    arguments = {"body": "block", "surface": "bottom", "mu": 0.3, "plane": PLANE}
    held = [fem.Support("block", "top", (0, 1))]
    return fem.assemble([BODY], [fem.Contact(**arguments | changed)], held)


def test_finite_elements() -> None:
    model = contact()
    for call, values, *words in (
        (lambda b: contact(mu=b), (NAN, -1.0, "rough", 1j, None, [0.3]), "mu"),
        (lambda b: fem.Material(b, 0.3), (NAN, 0.0, -1.0, "rough", 1j, None), "young"),
        (lambda b: fem.Material(1.0, b), (NAN, 0.5, -1.0, "soft", 1j), "poisson"),
        (
            lambda b: fem.Material(1.0, 0.3, thickness=b),
            (NAN, 0.0, "thick"),
            "thickness",
        ),
        (lambda b: contact(clearance=b), WIDE, "clearance"),
        (lambda b: contact(clearance=lambda _: b), WIDE, "clearance"),
        (
            lambda b: contact(plane=b),
            ([0.0, 0.0], ([0.0, 0.0], [NAN, 1.0]), ([0.0], [1.0]), (PLANE,)),
            "plane",
        ),
        (lambda b: contact(plane=b), [([0, 0], [0, 0])], "normal"),
        (lambda b: contact(plane=b), (NAN, 1, "xy"), "plane"),
        (lambda b: contact(surface=b), ["underneath"], "underneath", "bottom"),
        (lambda b: contact(surface=b), (None, 1.0, {}, ("bottom",)), "surface"),
        (lambda b: contact(body=b), (None, 1.0, [], np.zeros(2)), "body"),
        (
            lambda b: contact(plane=None, against=b),
            ("block", ("block",), (1, 2)),
            "against",
        ),
        (
            lambda b: fem.assemble([BODY], [], [fem.Support("block", "top", b)]),
            (None, NAN, 1, "01"),
            "components",
        ),
        (
            lambda b: fem.assemble(
                [BODY], [], repetitions=[fem.Periodic(("block", "left"), b)]
            ),
            (None, NAN, "block", ("block", None)),
            "onto",
        ),
        (
            lambda b: fem.assemble(
                [BODY], [], springs=[fem.Spring("block", b, stiffness=1.0)]
            ),
            (None, NAN, ("left",)),
            "surface",
        ),
        (lambda b: fem.box(b, "triangle"), (None, 1.0, "x"), "axes"),
        (lambda b: fem.box([[0, 1]] * 2, b), (None, [], {}), "cell"),
        (lambda b: contact(body=b), ["table"], "table", "block"),
        (lambda b: contact(plane=b), [None], "obstacle"),
        (lambda b: model.traction("block", "top", b), HARD, "force on body"),
        (lambda b: model.body_force("block", b), HARD, "force on body"),
        (lambda b: model.pressure("block", "top", b), [[1.0]], "pressure"),
        (
            model.prescribed,
            ([], [[0.0]], [[0.0, NAN]], [["a", "b"]], [[0.0] * 3]),
            "values",
        ),
        (
            fem.frames,
            ([1.0, 0.0], [[0.0, 0.0]], [[NAN, 1.0]], [[1.0] * 4], [["x", "y"]]),
            "normals?",
        ),
        (
            lambda b: fem.box(b, "quadrilateral"),
            ([[0.0, 1.0]], [[0.0], [1.0, 2.0]], [[0.0, NAN], [0.0, 1.0]]),
            "ax[ie]s",
        ),
        (lambda b: fem.box([[0, 1]] * 2, b), ["pentagon"], "cell", "pentagon"),
    ):
        for bad in values:
            refused(lambda call=call, bad=bad: call(bad), *words)


def test_arrays_sets_and_iterators_are_taken() -> None:
    known = contact()
    assert (contact(plane=np.array(PLANE)).gap == known.gap).all()
    every: Any = ({0, 1}, range(2), np.arange(2))
    for components in every:
        held = fem.Support("block", "top", components)
        model = fem.assemble(
            [BODY], [fem.Contact("block", "bottom", 0.3, PLANE)], [held]
        )
        assert (model.fixed == known.fixed).all()
    axes: Any = (np.array([0.0, 1.0]) for _ in range(2))
    assert fem.box(axes, "triangle").nelements == 2


def test_parts_of_a_model_may_be_iterators() -> None:
    parts: dict[str, Any] = {
        "contacts": [fem.Contact("block", "bottom", 0.3, PLANE)],
        "supports": [fem.Support("block", "top", (0, 1))],
        "symmetries": [fem.Symmetry("block", "left")],
        "springs": [fem.Spring("block", "right", stiffness=1.0)],
        "remotes": [fem.Remote("pin", "block", "right", (1.0, 0.5), (0,))],
    }
    known = fem.assemble([BODY], **parts)
    for name, part in parts.items():
        found = fem.assemble([BODY], **parts | {name: iter(part)})
        assert (found.fixed == known.fixed).all(), name
        assert (found.K != known.K).nnz == 0, name
