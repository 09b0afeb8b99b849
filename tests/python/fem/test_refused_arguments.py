"""Arguments of finite elements and files that are refused, by their names."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.files import export


def refused(call: Callable[[], Any], *words: str) -> None:
    with pytest.raises((ValueError, TypeError)) as caught:
        call()
    message = str(caught.value)
    assert type(caught.value) in (ValueError, TypeError)
    for word in words:
        assert re.search(rf"\b{word}\b", message), f"{word!r} not in {message!r}"
    assert "\n" not in message
    assert len(message) < 300


def _bodies() -> tuple[fem.Body, fem.Assembly]:
    mesh = fem.box([[0.0, 1.0, 2.0], [0.0, 1.0]], "quadrilateral")
    body = fem.Body("block", mesh, fem.Material(1.0, 0.3))
    contact = fem.Contact("block", "bottom", 0.3, plane=([0.0, 0.0], [0.0, 1.0]))
    support = fem.Support("block", "top", (0, 1))
    return body, fem.assemble([body], [contact], [support])


def test_finite_elements() -> None:
    body, model = _bodies()
    plane = ([0.0, 0.0], [0.0, 1.0])

    def contact(**changed: Any) -> Any:
        contact_arguments = {
            "body": "block",
            "surface": "bottom",
            "mu": 0.3,
            "plane": plane,
        }
        return fem.assemble([body], [fem.Contact(**contact_arguments | changed)])

    contact()
    for bad in (math.nan, -1.0, "rough", 1j, None, [0.3]):
        refused(lambda b=bad: contact(mu=b), "mu")
        refused(lambda b=bad: fem.Material(b, 0.3), "young")
    for bad in (math.nan, 0.5, -1.0, "soft", 1j):
        refused(lambda b=bad: fem.Material(1.0, b), "poisson")
    for bad in (math.nan, 0.0, "thick"):
        refused(lambda b=bad: fem.Material(1.0, 0.3, thickness=b), "thickness")
    for bad in (math.nan, "wide", [0.1, 0.2], [[0.1] * 3], 1j):
        refused(lambda b=bad: contact(clearance=b), "clearance")
        refused(lambda b=bad: contact(clearance=lambda _x: b), "clearance")
    for bad in ([0.0, 0.0], ([0.0, 0.0], [math.nan, 1.0]), ([0.0], [1.0]), (plane,)):
        refused(lambda b=bad: contact(plane=b), "plane")
    refused(lambda: contact(plane=([0, 0], [0, 0])), "normal")
    refused(lambda: contact(surface="underneath"), "underneath", "bottom")
    refused(lambda: contact(body="table"), "table", "block")
    refused(lambda: contact(plane=None), "obstacle")
    for bad in (math.nan, "hard", [1.0], [1.0, 2.0, 3.0], np.ones((2, 9, 9)), 1j):
        refused(lambda b=bad: model.traction("block", "top", b), "force on body")
        refused(lambda b=bad: model.body_force("block", b), "force on body")
    refused(lambda: model.pressure("block", "top", [1.0]), "pressure")  # type: ignore[arg-type]
    for values in ([], [[0.0]], [[0.0, math.nan]], [["a", "b"]], [[0.0] * 3]):
        refused(lambda v=values: model.prescribed(v), "values")
    for bad in ([1.0, 0.0], [[0.0, 0.0]], [[math.nan, 1.0]], [[1.0] * 4], [["x", "y"]]):
        refused(lambda b=bad: fem.frames(b), "normals?")
    for axes in ([[0.0, 1.0]], [[0.0], [1.0, 2.0]], [[0.0, math.nan], [0.0, 1.0]]):
        refused(lambda a=axes: fem.box(a, "quadrilateral"), "ax[ie]s")
    refused(lambda: fem.box([[0.0, 1.0]] * 2, "pentagon"), "cell", "pentagon")


def test_files(tmp_path: Any) -> None:
    refused(lambda: export.write_result(3, {}, [], complete=True), "path")  # type: ignore[arg-type]
    not_ours = tmp_path / "text.h5"
    not_ours.write_text("no result")
    with pytest.raises(OSError, match=r"text\.h5|signature"):
        bp.load_result(not_ours)
