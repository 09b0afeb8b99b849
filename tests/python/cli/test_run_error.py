"""`bipot run --error` and `--tol discretisation`: output and files."""

import csv
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest

from bipot_rs.files import export
from bipot_rs.plots.run_figure import error_map
from support.runs import FILES, LAST_LINE, bipot, lines

P1 = "--set=mesh.element=P1"
SMALL = ("run", "sheared_cube", "--set=mesh.n=2", P1)


@pytest.mark.slow
def test_error_in_table_files_and_picture(tmp_path: Path) -> None:
    run = bipot(*SMALL, "--error", "--plot", "--out=here", cwd=tmp_path)
    out = tmp_path / "here"
    pictures = {"tractions.png", "error.png"}
    series = {f"{s}_000{k}.vtu" for s in ("result", "contact") for k in (0, 1)}
    assert {p.name for p in out.iterdir()} == FILES | series | pictures
    assert (out / "error.png").read_bytes().startswith(b"\x89PNG")
    assert "indicator (Coulomb" in run.stdout
    # With friction the error is an estimate, and must not be called a bound.
    assert "guaranteed" not in run.stdout
    with (out / "steps.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["error_kind"] for row in rows] == ["indicator"] * 2
    with h5py.File(out / "result.h5") as file:
        for k, row in enumerate(rows):
            step = file[f"steps/000{k}"]
            cells, contacts = step["error_cells"][()], step["error_contacts"][()]
            total = step.attrs["error_total"]
            assert total == pytest.approx(cells.sum() + contacts.sum(), rel=1e-12)
            assert step.attrs["error_relative"] == float(row["error"])
            fields = meshio.read(out / f"result_000{k}.vtu").cell_data
            np.testing.assert_array_equal(fields["error"][0], cells)
            # Six equal tetrahedra per cube.
            density = fields["error_density"][0]
            np.testing.assert_allclose(density * 1e6 / 48, cells, rtol=1e-12)


@pytest.mark.slow
def test_json_and_resume(tmp_path: Path) -> None:
    path = ("run", "cyclic_cube", "--set=mesh.n=2", "--set=path.steps=3", P1)
    path += ("--set=contact.0.mu=0.0", "--error", "--out=a")
    *steps, last = lines(bipot(*path, "--json", cwd=tmp_path).stdout)
    assert last.keys() == LAST_LINE
    assert all(step["error_kind"] == "guaranteed bound" for step in steps)
    assert all(0 < step["error"] < 1 for step in steps)
    # Keep the first step, as after an interrupt; the others are solved again.
    whole = tmp_path / "a" / "result.h5"
    contacts, records, attributes, _ = export.read_saved(whole)
    for name in ("complete", "version"):
        del attributes[name]
    export.write_result(
        whole, contacts, records[:1], complete=False, attributes=attributes
    )
    bipot(*path, "--resume", cwd=tmp_path)
    with h5py.File(whole) as file:
        again = [file[f"steps/000{k}"].attrs["error_relative"] for k in range(3)]
    assert again == [step["error"] for step in steps]


def test_no_error_where_none_can_be_estimated(tmp_path: Path) -> None:
    """Other cells: before solving. A single supported node: after solving."""
    other = ("run", "sheared_cube", "--set=mesh.n=2", "--error")
    run = bipot(*other, cwd=tmp_path, status=2)
    told = 'expected triangles or tetrahedra of first order: mesh.element = "P1"'
    assert told in run.stderr
    held = ("run", "raous_plate", "--set=mesh.n=2", P1, "--error", "--json")
    *steps, last = lines(bipot(*held, cwd=tmp_path).stdout)
    assert all(step["error"] is None for step in steps)
    assert "no discretisation error: no tractions balance" in last["message"]
    assert last["success"] is True


def test_tolerance_of_the_mesh(tmp_path: Path) -> None:
    more = ("--tol=discretisation", "--method=nesterov", "--json")
    *steps, last = lines(bipot(*SMALL, *more, cwd=tmp_path).stdout)
    assert "the discretisation error is" in last["message"]
    assert all(1e-8 < step["residual"] <= 1e-2 for step in steps)
    assert "error" not in steps[0]


def test_map_of_errors_refuses_zero_errors(tmp_path: Path) -> None:
    nodes = np.array([[0.0, 0], [1, 0], [0, 1]])
    cells = [("triangle", np.array([[0, 1, 2]]))]
    with pytest.raises(ValueError, match="there is no error to draw"):
        error_map(tmp_path / "a.png", nodes, cells, np.zeros(1))
    with pytest.raises(ValueError, match=r"energies has shape \(2,\)"):
        error_map(tmp_path / "a.png", nodes, cells, np.ones(2))
