"""The group /VTKHDF of result files, by VTK itself and by h5py, against the VTU files."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.cli.run.output_files import Output, Reached
from bipot_rs.files import vtkhdf
from support.bars import bar_problem, pulled
from support.places import ROOT
from support.runs import bipot

# Plane, space, two bodies, second order of two kinds, several steps.
RUNS = {
    "plane": ["pressed_block", "mesh.n=6"],
    "tetrahedra": ["pressed_block", "mesh.n=4", "mesh.element=P2"],
    "two bodies": ["two_blocks", "mesh.n=4"],
    "second order": ["two_blocks", "mesh.n=2", "mesh.element=Q2"],
    "cycle": ["cyclic_cube", "mesh.n=3"],
}


@pytest.fixture(scope="module", params=RUNS)
def folder(request: pytest.FixtureRequest, tmp_path_factory: Any) -> Path:
    """The files of a run."""
    name, *settings = RUNS[request.param]
    here: Path = tmp_path_factory.mktemp("run")
    options = [word for setting in settings for word in ("--set", setting)]
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "two bodies":
            # As of a large mesh: each component is packed apart.
            patch.setattr(vtkhdf, "_MANY", 8)
        bipot("run", name, *options, "--out", "here", cwd=here)
    return here / "here"


@pytest.mark.needs_extra
def test_vtk_reads_the_steps_of_the_vtu_files(folder: Path) -> None:
    hdf, xml = map(pytest.importorskip, ("vtkmodules.vtkIOHDF", "vtkmodules.vtkIOXML"))
    from vtkmodules.util.numpy_support import vtk_to_numpy as numpy_of

    reader = hdf.vtkHDFReader()
    assert reader.CanReadFile(str(folder / "result.vtkhdf"))
    reader.SetFileName(str(folder / "result.vtkhdf"))
    reader.UpdateInformation()
    files = sorted(folder.glob("result_*.vtu"))
    assert reader.GetNumberOfSteps() == len(files)
    with h5py.File(folder / "result.h5") as file:
        own = file["mesh/contact_nodes"][()]
        fields = {name: data[()] for name, data in file["fields"].items()}
    for k, path in enumerate(files):
        of_step = xml.vtkXMLUnstructuredGridReader()
        of_step.SetFileName(str(path))
        of_step.Update()
        reader.SetStep(k)
        reader.Update()
        read, expected = reader.GetOutputDataObject(0), of_step.GetOutput()
        for array in (
            lambda grid: grid.GetPoints().GetData(),
            lambda grid: grid.GetCells().GetConnectivityArray(),
            lambda grid: grid.GetCells().GetOffsetsArray(),
            lambda grid: grid.GetCellTypes(),
            lambda grid: grid.GetPointData().GetArray("displacement"),
            lambda grid: grid.GetCellData().GetArray("stress"),
            lambda grid: grid.GetCellData().GetArray("von_mises"),
            lambda grid: grid.GetFieldData().GetArray("load"),
        ):
            ours, theirs = numpy_of(array(read)), numpy_of(array(expected))
            # The fields of the cells are in single precision.
            np.testing.assert_array_equal(ours, theirs.astype(ours.dtype))
        for name in ("pressure", "traction", "slip", "status"):
            values = numpy_of(read.GetPointData().GetArray(name))
            at_nodes = np.full(values.shape, -1 if name == "status" else 0.0)
            spans = (own, *map(slice, fields[name].shape[2:]))
            at_nodes[spans] = fields[name][k]
            np.testing.assert_array_equal(values, at_nodes)


def test_what_the_file_holds_already_is_not_copied(folder: Path) -> None:
    """Storage of the group: fields of cells, their kinds, and packed fields of contacts."""
    with h5py.File(folder / "result.h5") as file:
        group, steps = file["VTKHDF"], len(file["steps"])
        points, cells = group["NumberOfPoints"][0], group["NumberOfCells"][0]
        for name in ("Points", "Connectivity", "PointData/displacement"):
            assert group[name].id.get_storage_size() == 0, name
            assert group[name].is_virtual
        stress = group["CellData/stress"]
        assert stress.shape == (steps * cells, 6)
        assert stress.dtype == np.float32
        assert stress.id.get_storage_size() < stress.nbytes
        last = meshio.read(folder / f"result_{steps - 1:04d}.vtu").cell_data["stress"]
        # The same numbers in single precision: nothing is lost by packing.
        expected = np.concatenate(last).astype(np.float32)
        np.testing.assert_array_equal(stress[-cells:], expected)
        pressure = np.zeros(points)
        pressure[file["mesh/contact_nodes"][()]] = file["fields/pressure"][-1]
        np.testing.assert_array_equal(group["PointData/pressure"][-points:], pressure)
        assert group["PointData/status"].shape == (steps * points,)
        assert group["FieldData/load"] == file["fields/load"]
        times = group["Steps/Values"][()]
        assert all(a < b for a, b in pairwise(times))
        np.testing.assert_array_equal(
            group["Steps/PointDataOffsets/displacement"][()], points * np.arange(steps)
        )


def test_contacts_are_points_without_a_mesh(tmp_path: Path) -> None:
    problem, load = bar_problem()
    result = problem.solve(pulled(load, np.linspace(0, 30, 5)))
    result.save(tmp_path / "none.h5")
    with h5py.File(tmp_path / "none.h5") as file:
        assert "VTKHDF" not in file
    result.contacts["x"] = np.arange(2.0 * result.shape[0]).reshape(-1, 2)
    result.save(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        group, n = file["VTKHDF"], result.shape[0]
        np.testing.assert_array_equal(group["Points"][:, :2], result.contacts["x"])
        assert not group["Points"][:, 2].any()
        assert group["Types"][()].tolist() == [1] * n
        of = {name: data[()] for name, data in group["PointData"].items()}
        reaction = of["reaction_local"].reshape(len(result), n, 3)[..., :2]
        np.testing.assert_array_equal(reaction, result.reaction)
        np.testing.assert_array_equal(of["status"], result.status.ravel())
    assert len(bp.load_result(tmp_path / "a.h5")) == len(result)


@pytest.mark.parametrize(
    "scene", [ROOT / "examples/scenes/heated_bar.toml", "two_blocks"]
)
def test_the_stress_where_ranks_write_parts_is_that_of_the_bodies(
    scene: Any, tmp_path: Path
) -> None:
    """Rank 0 has the fields of all cells, though each rank writes its own for result.pvd."""
    model = bp.Model.from_toml(scene)
    if scene == "two_blocks":
        model = model.with_(**{"mesh.n": 2})
    case = model.assemble()
    reached: list[Reached] = [({"load": 1.0}, step) for step in case.solve()]
    out = Output(tmp_path, tmp_path, case.scene, case, reached, [])
    for part, whole in zip(out.stresses(case), out.bodies(case), strict=True):
        assert part.keys() == whole.keys() == {"stress", "von_mises"}
        for name in part:
            np.testing.assert_array_equal(part[name], whole[name])
