"""The table of names in files: units, dimensions and times."""

import re

import numpy as np
import pytest

from bipot_rs.files import fields
from bipot_rs.files.fields import FIELDS, Quantity
from bipot_rs.files.result_mesh import Cells, ResultMesh
from support.places import ROOT

UNITS = {"length": "mm", "force": "kN", "stress": "GPa"}


def test_unit() -> None:
    without_stress = UNITS | {"stress": ""}
    for dimension, units, name in (
        ("force", UNITS, "kN"),
        ("stress", UNITS, "GPa"),
        ("stress", without_stress, "kN/mm²"),
        ("stress", {"length": "mm"}, None),
        ("area", UNITS, "mm²"),
        ("area", {"force": "N"}, None),
        ("energy", {"length": "m", "force": "kN"}, "kJ"),
        ("energy", UNITS, "kN·mm"),
        ("energy", {"force": "N"}, None),
        ("energy density", UNITS, "GPa"),
        ("length", {"length": ""}, None),
        ("", UNITS, None),
    ):
        assert fields.unit(dimension, units) == name, (dimension, units)


def test_unit_or_dimension_of_each_field() -> None:
    names = ["force", "status", "pressure", "a name of somebody else"]
    told = {"force": "kN", "pressure": "GPa"}
    assert fields.name_units(names, UNITS) == told
    # Without units the file still says what kind of number it holds.
    assert fields.name_units(names, {}) == {"force": "force", "pressure": "stress"}
    plain = {"meaning": "it", "dimension": "force", "frame": "local"}
    quantity = Quantity("it", "force", fields.LOCAL)
    assert fields.labels(quantity, {}) == plain
    assert fields.labels(quantity, UNITS) == plain | {"units": "kN"}
    assert fields.labels(Quantity("a number"), UNITS) == {"meaning": "a number"}
    for name, quantity in FIELDS.items():
        assert name.endswith("_local") == (quantity.axes == fields.LOCAL), name


@pytest.mark.parametrize(
    "table", [fields.OF_CONTACTS, fields.OF_NODES, fields.OF_CELLS, fields.OF_STEPS]
)
def test_the_page_of_names_lists_the_table(table: dict[str, Quantity]) -> None:
    page = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")
    rows = [
        f"| `{name}` | {quantity.meaning} | {quantity.dimension or '–'} | {quantity.axes or '–'} |"
        for name, quantity in table.items()
    ]
    # As one block: the page has no rows besides these.
    assert "|---|---|---|---|\n" + "\n".join(rows) + "\n\n" in page


@pytest.mark.parametrize("table", ["contacts", "steps", "mesh"])
def test_the_page_of_files_has_each_dataset(table: str) -> None:
    """In the first cell of a row of docs/files.md: `steps/0000/gap`, or a name after it."""
    page = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")
    named = re.findall(rf"^\| (`{table}/.*?) \|", page, re.MULTILINE)
    listed = set(re.findall(r"(\w+)`", " ".join(named)))
    assert set(getattr(fields, table.upper())) - listed == set()


def test_times_of_a_series() -> None:
    for loads, times, chosen in (
        ([0.0, 0.5, 1.0], [1.0, 2.0, 3.0], [0.0, 0.5, 1.0]),
        # A load that returns would show two steps as one.
        ([0.0, 1.0, 0.0], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
        ([1.0, 1.0], [10.0, 20.0], [10.0, 20.0]),
        ([np.nan, 1.0], [1.0, 2.0], [1.0, 2.0]),
        ([None, None], [None, None], [0.0, 1.0]),
        ([3.0], [1.0], [3.0]),
        ([], [], []),
    ):
        assert fields.choose_times(loads, times) == chosen


def test_a_wrong_mesh_is_refused() -> None:
    right = {"nodes": np.zeros((3, 2)), "dofs": np.arange(6).reshape(3, 2)}
    for change, message in (
        ({"nodes": np.zeros(3)}, "nodes are wrong"),
        ({"nodes": np.full((3, 2), np.nan)}, "nodes are wrong"),
        ({"dofs": np.zeros((2, 2), int)}, r"dofs has shape \(2, 2\), expected \(3, 2"),
        ({"dofs": np.zeros((3, 2))}, "dofs has type float64, expected whole numbers"),
        ({"dofs": np.full((3, 2), -2)}, "indices -2 to -2, expected them from -1"),
        ({"cells": [Cells("line", np.array([[0, 3]]))]}, "0 to 3, expected .* 0 to 2"),
        ({"contact_nodes": np.array([-1])}, "contact_nodes has indices -1"),
        ({"contact_facets": [Cells("line", np.array([[-1, 0]]))]}, "contact_facets"),
    ):
        with pytest.raises(ValueError, match=message):
            ResultMesh(**(right | change))  # type: ignore[arg-type]


def test_displacements_of_nodes_without_some_degrees_of_freedom() -> None:
    mesh = ResultMesh(
        np.zeros((3, 2)), np.array([[4, -1], [0, 1], [-1, -1]]), (), np.array([1, 0])
    )
    u = np.arange(10.0, 15.0)
    np.testing.assert_array_equal(mesh.of_nodes(u), [[14, 0], [10, 11], [0, 0]])
    np.testing.assert_array_equal(mesh.of_contacts(u), [[10, 11], [14, 0]])
