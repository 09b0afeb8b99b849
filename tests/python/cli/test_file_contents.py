"""Files of runs, of solves and of Python have the same names with the same meaning."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.fem import paraview
from bipot_rs.files.fields import FIELDS, LOCAL, OF_CELLS, OF_CONTACTS, OF_NODES
from support.matrix_and_tables import written
from support.places import DATA
from support.runs import bipot

SCENE = ("two_blocks", "--set", "mesh.n=4")
# Without wear.
NAMES = list(OF_CONTACTS.keys() - {"wear_depth", "broken"})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of a run of two blocks whose meshes match."""
    here = tmp_path_factory.mktemp("run")
    bipot("run", *SCENE, "--out", "here", cwd=here)
    return here / "here"


def tree(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """All datasets of a group and of the groups in it, by path."""
    datasets: dict[str, h5py.Dataset] = {}
    group.visititems(
        lambda path, one: datasets.update(
            {path: one} if isinstance(one, h5py.Dataset) else {}
        )
    )
    return datasets


def units_of(path: Path) -> dict[str, str]:
    """Units of the fields of a VTU file."""
    text = meshio.read(path).field_data["units"].astype(np.uint8).tobytes().decode()
    return dict(json.loads(text))


def times(path: Path) -> list[float]:
    """Times of a PVD index."""
    sets = ET.parse(path).getroot().iter("DataSet")
    return [float(item.attrib["timestep"]) for item in sets]


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of a solve of arrays in the plane."""
    here = tmp_path_factory.mktemp("solve")
    command, _ = written(here, "block")
    bipot(*command, "--out", "here", cwd=here)
    return here / "here"


# The scene of the run.
MODEL = bp.Model.from_toml(SCENE[0]).with_(**{"mesh.n": 4})


def same(grid: meshio.Mesh, file: h5py.File, k: int) -> None:
    """The fields of a VTU file are bitwise those of step k of a result file."""
    assert set(grid.point_data) == set(file["fields"]) - {"load", "time"}
    for name, field in grid.point_data.items():
        row = file["fields"][name][k].reshape(len(field), -1)
        # VTK has three components, the last is zero in the plane.
        columns = field.reshape(len(field), -1)
        np.testing.assert_array_equal(columns[:, : row.shape[1]], row, err_msg=name)
        assert not columns[:, row.shape[1] :].any(), name


def test_names_and_values_of_all_writers(
    folder: Path, solved: Path, tmp_path: Path
) -> None:
    bp.load(folder / "result.h5").write(tmp_path / "loaded.pvd")
    case = MODEL.assemble()
    paraview.write(tmp_path / "model.pvd", case.model, case.solve())
    for path in (
        folder / "contact_0001.vtu",
        tmp_path / "loaded_0001.vtu",
        tmp_path / "model_contact_0001.vtu",
        solved / "contact_0000.vtu",
    ):
        assert sorted(meshio.read(path).point_data) == sorted(NAMES), path
    for path in (folder / "result.h5", solved / "result.h5"):
        with h5py.File(path) as file:
            assert sorted(file["fields"]) == sorted([*NAMES, "load", "time"])
    bodies = meshio.read(folder / "result_0001.vtu")
    assert sorted(bodies.point_data) == sorted(OF_NODES)
    assert set(bodies.cell_data) == {"stress", "von_mises"} < set(OF_CELLS)
    # After a solve the cells are not known, but the nodes are the bodies' too.
    nodes = meshio.read(solved / "result_0000.vtu")
    assert list(nodes.point_data) == ["displacement"]
    with h5py.File(folder / "result.h5") as file:
        for k in range(2):
            same(meshio.read(folder / f"contact_{k:04d}.vtu"), file, k)
            same(meshio.read(tmp_path / f"loaded_{k:04d}.vtu"), file, k)


def test_fields_follow_from_the_promised_datasets(folder: Path) -> None:
    """Global components by a rotation of one contact after the other."""
    with h5py.File(folder / "result.h5") as file:
        known = {name: data[()] for name, data in file["contacts"].items()}
        for k, step in enumerate(file["steps"].values()):
            fields = {name: data[k] for name, data in file["fields"].items()}
            r, v, slip = (
                step[n][()] for n in ("reaction", "relative_displacement", "slip")
            )
            for name, exact in (
                ("reaction_local", r),
                ("relative_displacement_local", v),
                ("slip_local", slip),
                ("gap", v[:, 0]),
                ("status", step["status"][()]),
                ("normal", known["normal"]),
            ):
                np.testing.assert_array_equal(fields[name], exact)
            # Sums of three products: some units of rounding.
            close = {"rtol": 1e-14, "atol": 1e-14 * np.abs(r).max()}
            of_slip = {"atol": 1e-14 * np.abs(slip).max()}
            traction = fields["traction"] * known["area"][:, None]
            for c, axes in enumerate(known["frame"]):
                for force in (fields["force"][c], traction[c]):
                    np.testing.assert_allclose(force, axes.T @ r[c], **close)
                along = axes[1:] @ fields["slip"][c]
                np.testing.assert_allclose(along, slip[c], **of_slip)
            pressed = fields["pressure"] * known["area"]
            np.testing.assert_allclose(pressed, r[:, 0], rtol=1e-14)


def test_mesh_of_a_result(folder: Path) -> None:
    """The mesh of result.pvd, moved by the degrees of freedom of each node."""
    saved = bp.load(folder / "result.h5")
    bodies = meshio.read(folder / "result_0001.vtu")
    with h5py.File(folder / "result.h5") as file:
        mesh = file["mesh"]
        nodes, dofs = mesh["nodes"][()], mesh["dofs"][()]
        u = file["steps/0001/displacement"][()]
        np.testing.assert_array_equal(nodes, bodies.points)
        np.testing.assert_array_equal(u[dofs], bodies.point_data["displacement"])
        blocks = list(mesh["cells"].values())
        assert [block.attrs["body"] for block in blocks] == ["upper", "lower"]
        assert {block.attrs["kind"] for block in blocks} == {bodies.cells[0].type}
        corners = np.concatenate([block[()] for block in blocks])
        np.testing.assert_array_equal(corners, bodies.cells[0].data)
        on = mesh["contact_nodes"][()]
        np.testing.assert_array_equal(nodes[on], file["contacts/x"][()])
        np.testing.assert_array_equal(
            file["fields/displacement"][1], bodies.point_data["displacement"][on]
        )
        surface = meshio.read(folder / "contact_0001.vtu")
        (facets,) = mesh["contact_facets"].values()
        np.testing.assert_array_equal(facets[()], surface.cells[0].data)
    assert saved.mesh is not None
    np.testing.assert_array_equal(saved.mesh.of_nodes(saved.displacement[1]), u[dofs])
    assert saved.mesh.cells[1].body == "lower"


def test_units_and_axes_of_a_run(folder: Path) -> None:
    units = {"length": "mm", "force": "N", "stress": "MPa"}
    with h5py.File(folder / "result.h5") as file:
        for name, data in file["fields"].items():
            quantity = FIELDS[name]
            assert data.attrs["meaning"] == quantity.meaning
            assert data.attrs.get("units") == units.get(quantity.dimension)
            assert data.attrs.get("frame", "") == quantity.axes
        for name, unit in (
            ("steps/0000/reaction", "N"),
            ("steps/0000/slip", "mm"),
            ("steps/0000/bipotential_gap", "N·mm"),
            ("contacts/area", "mm²"),
            ("mesh/nodes", "mm"),
        ):
            assert file[name].attrs["units"] == unit
        for name in ("reaction", "slip"):
            assert file["steps/0000"][name].attrs["frame"] == LOCAL
    for name in ("contact_0000.vtu", "result_0000.vtu"):
        told = units_of(folder / name)
        assert told["displacement"] == "mm"
        assert told.get("force", "N") == "N"
        assert told.get("stress", "MPa") == told.get("pressure", "MPa") == "MPa"
        assert not {"status", "normal", "contact_status"} & set(told)


def test_unknown_units_are_dimensions(solved: Path) -> None:
    told = units_of(solved / "contact_0000.vtu")
    assert (told["force"], told["slip"]) == ("force", "length")
    with h5py.File(solved / "result.h5") as file:
        force = file["fields/force"].attrs
        assert force["dimension"] == "force"
        assert "units" not in force
        # The nodes of the table, with their degrees of freedom.
        mesh = file["mesh"]
        nodes = mesh["nodes"][()][mesh["contact_nodes"][()]]
        np.testing.assert_array_equal(nodes, file["contacts/x"][()])
        u = file["steps/0000/displacement"][()][mesh["dofs"][()]]
    moved = meshio.read(solved / "result_0000.vtu").point_data["displacement"]
    np.testing.assert_array_equal(moved[:, : u.shape[1]], u)


def test_without_frames_there_are_no_global_components(tmp_path: Path) -> None:
    """B may be given without normals: then only n and t of each contact are known."""
    result = bp.solve(
        np.eye(2), np.eye(2), [-1.0, 0.1], gap=[0.0], mu=0.3, points=[[0.0, 0.0]]
    )
    assert result.contacts.get("frame") is None
    result.write(tmp_path / "a.pvd")
    names = set(meshio.read(tmp_path / "a_0000.vtu").point_data)
    local = {name for name in OF_CONTACTS if name.endswith("_local")}
    assert names == local | {"gap", "status"}


@pytest.mark.slow
def test_time_is_the_load_if_it_grows(folder: Path, tmp_path: Path) -> None:
    for name in ("result.pvd", "contact.pvd"):
        assert times(folder / name) == [0.0, 1.0]
    bipot("run", "cyclic_cube", "--set", "mesh.n=2", "--out", "here", cwd=tmp_path)
    here = tmp_path / "here"
    # The load returns; ParaView would merge steps of equal times.
    with h5py.File(here / "result.h5") as file:
        load, time = file["fields/load"][()], file["fields/time"][()]
        assert np.ptp(load) == pytest.approx(2.0)
        np.testing.assert_array_equal(time, np.arange(1, len(load) + 1))
    for name in ("result.pvd", "contact.pvd"):
        assert times(here / name) == list(time)
    about = meshio.read(here / "result_0003.vtu").field_data
    assert (about["load"], about["time"]) == (load[3], 4.0)
    # The file keeps the load, whoever writes it again.
    loaded = bp.load(here / "result.h5")
    loaded.save(here / "again.h5")
    with h5py.File(here / "again.h5") as file:
        np.testing.assert_array_equal(file["fields/load"][()], load)
        assert file["steps/0003/load"][()] == load[3]


def test_time_of_adaptive_steps_and_of_cycles(tmp_path: Path) -> None:
    problem = bp.ContactProblem(
        1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3, area=[1.0], points=[[0, 0]]
    )
    load = lambda s: np.array([-10.0, 5.0 * s])  # noqa: E731
    path = problem.follow(load, stops=[0.25, 1.0], first=0.25)
    assert path[-1].s == 1.0
    path.write(tmp_path / "path.pvd")
    assert times(tmp_path / "path.pvd") == [step.s for step in path]
    pushed = [[-10.0, 5.0], [-10.0, -5.0]]
    wear = problem.wear(pushed, coefficient=1e-6, cycles=3, jump=False)
    wear.ends.write(tmp_path / "wear.pvd")
    assert times(tmp_path / "wear.pvd") == [1.0, 2.0, 3.0]
    worn = meshio.read(tmp_path / "wear_0002.vtu").point_data["wear_depth"]
    np.testing.assert_array_equal(worn, wear.ends[2].wear)


def test_a_model_in_python_saves_what_the_command_does(
    folder: Path, tmp_path: Path
) -> None:
    result = MODEL.solve()
    result.write(tmp_path / "a.pvd")
    result.save(tmp_path / "a.h5")
    assert times(tmp_path / "a.pvd") == [0.0, 1.0]
    with h5py.File(tmp_path / "a.h5") as saved, h5py.File(folder / "result.h5") as two:
        same(meshio.read(tmp_path / "a_0001.vtu"), saved, 1)
        for name in ("fields", "mesh"):
            assert list(tree(saved[name])) == list(tree(two[name]))
            for path, data in tree(saved[name]).items():
                np.testing.assert_array_equal(data[()], two[name][path][()])
                assert dict(data.attrs) == dict(two[name][path].attrs)
    # Arrays alone have contacts, and no nodes.
    plain = MODEL.assemble().solve()
    plain.save(tmp_path / "plain.h5")
    assert plain.mesh is bp.load(tmp_path / "plain.h5").mesh is None
    with h5py.File(tmp_path / "plain.h5") as file:
        assert "mesh" not in file
        assert set(NAMES) - set(file["fields"]) == {"displacement"}


@pytest.mark.parametrize("name", ["scene.h5", "arrays.h5"])
def test_files_of_an_earlier_version_load(name: str, tmp_path: Path) -> None:
    """These files have neither fields nor a mesh nor attributes of datasets."""
    with h5py.File(DATA / "results" / name) as file:
        assert set(file) == {"contacts", "steps"}
        assert not file["steps/0001/reaction"].attrs
        reaction = [step["reaction"][()] for step in file["steps"].values()]
    loaded = bp.load(DATA / "results" / name)
    np.testing.assert_array_equal(loaded.reaction, reaction)
    assert loaded.success
    assert loaded.mesh is None
    if name == "arrays.h5":
        # Two springs of 1000 N/m, a point that sticks and then slips with μ = 0.3, solved
        # to a residual of 1e-10.
        exact = [[[10.0, -2.0]], [[10.0, -3.0]]]
        np.testing.assert_allclose(loaded.reaction, exact, rtol=1e-9)
        np.testing.assert_allclose(loaded.slip[1], [[0.002]], rtol=1e-9)
        assert loaded.units == {"length": "m", "force": "N", "stress": "Pa"}
    # Written again, the file has what can be known.
    loaded.save(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["fields/reaction_local"][()], reaction)
        assert file["fields/reaction_local"].attrs["units"] == "N"
    again = bp.load(tmp_path / "a.h5")
    for field in [
        "reaction",
        "slip",
        "status",
        "displacement",
        "relative_displacement",
    ]:
        np.testing.assert_array_equal(getattr(again, field), getattr(loaded, field))


def test_a_damaged_mesh_is_refused(folder: Path, tmp_path: Path) -> None:
    for path, change, words in (
        ("mesh/dofs", lambda a: a + 1, "the mesh does not fit"),
        ("mesh/contact_nodes", lambda a: a[1:], "the mesh does not fit"),
        ("mesh/contact_facets/0", lambda a: a + 25, "the mesh does not fit"),
        ("mesh/cells/1", lambda a: a + 1000, "cells has indices"),
        ("mesh/nodes", lambda a: a[:-1], "dofs has shape"),
        ("mesh/dofs", None, "dofs"),
        ("mesh/cells/0", lambda a: a, "kind"),
    ):
        (tmp_path / "a.h5").write_bytes((folder / "result.h5").read_bytes())
        with h5py.File(tmp_path / "a.h5", "r+") as file:
            del file.attrs["sealed"]
            array, attributes = file[path][()], dict(file[path].attrs)
            del file[path]
            if change is not None:
                file[path] = change(array)
                # The last case has no attributes.
                file[path].attrs.update({} if words == "kind" else attributes)
        with pytest.raises(ValueError, match=f"a.h5 is not a result.*{words}"):
            bp.load(tmp_path / "a.h5")


def test_a_result_without_contacts(tmp_path: Path) -> None:
    none = np.empty((0, 2))
    result = bp.solve(
        np.eye(2), none, [[1.0, 0.0]], gap=np.empty(0), mu=0.3, dim=2, points=none
    )
    result.write(tmp_path / "a.pvd")
    result.save(tmp_path / "a.h5")
    # meshio refuses files without points.
    report = json.loads(bipot("info", "a.pvd", "--json", cwd=tmp_path).stdout)
    assert (report["steps"], report["points"], report["fields"]) == (1, 0, {})
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["fields/reaction_local"].shape == (1, 0, 2)
    assert len(bp.load(tmp_path / "a.h5")) == 1


def told(name: str, cwd: Path) -> tuple[list[str], dict[str, Any]]:
    """Lines and report of `bipot info`."""
    out = bipot("info", name, cwd=cwd).stdout.splitlines()
    return out, json.loads(bipot("info", name, "--json", cwd=cwd).stdout)


def test_info_of_files_for_paraview(folder: Path) -> None:
    out, report = told("contact.pvd", folder)
    about = "contact.pvd: a series of 2 steps for ParaView, time 0 to 1"
    assert out[0].startswith(about)
    assert (report["kind"], report["steps"]) == ("series", 2)
    assert report["times"] == [0.0, 1.0]
    assert (report["points"], report["cells"]) == (25, {"quad": 16})
    assert set(report["fields"]) == set(NAMES)
    grid = meshio.read(folder / "contact_0001.vtu")
    force = np.linalg.norm(grid.point_data["force"], axis=1)
    field = report["fields"]["force"]
    assert (field["low"], field["high"]) == (force.min(), force.max())
    assert (field["units"], field["components"], field["of"]) == ("N", 3, "points")
    span = f"length of vector at points, {force.min():.4g} to {force.max():.4g} N"
    assert any(line.split("force", 1)[-1].strip() == span for line in out)
    out, report = told("result_0000.vtu", folder)
    assert out[0] == "result_0000.vtu: one step for ParaView"
    assert (report["kind"], report["load"], report["time"]) == ("step", 0.0, 1.0)
    assert report["cells"] == {"hexahedron": 64}
    stress = report["fields"]["stress"]
    assert (stress["components"], stress["of"]) == (6, "cells")


def test_info_of_broken_files_for_paraview(folder: Path, tmp_path: Path) -> None:
    alone = "names 2 files that do not exist, the first is contact_0000.vtu"
    half = (folder / "contact_0000.vtu").read_bytes()[:900]
    for name, text, message in (
        ("alone.pvd", (folder / "contact.pvd").read_bytes(), alone),
        ("gone.pvd", None, "there is no file gone.pvd"),
        ("text.pvd", b"text", "text.pvd is not XML"),
        (
            "other.pvd",
            b"<VTKFile type='UnstructuredGrid'/>",
            "is not a file of VTK of type Collection",
        ),
        ("bomb.pvd", b'<!DOCTYPE a [<!ENTITY b "c">]><a/>', "has a document type"),
        (
            "none.pvtu",
            b"<VTKFile type='PUnstructuredGrid'/>",
            "none.pvtu has no pieces",
        ),
        ("half.vtu", half, "half.vtu cannot be read as a VTU file"),
    ):
        if text is not None:
            (tmp_path / name).write_bytes(text)
        run = bipot("info", name, cwd=tmp_path, status=2)
        assert message in run.stderr, run.stderr


def test_info_of_parts(tmp_path: Path) -> None:
    """The parts of two ranks are counted together."""
    case = MODEL.assemble()
    result = case.solve()
    counts = [int(body.mesh.nelements) for body in case.model.bodies]
    for k in range(3):
        # Part 2 has no cells, as of a rank that owns no first node of a cell.
        cells_of_part = [np.arange(k if k < 2 else count, count, 2) for count in counts]
        part = paraview.Part(k, 3, cells_of_part)
        series = paraview.BodySeries(tmp_path / "it.pvd", case.model, part)
        for step in result:
            series.add(step)
        series.end()
    paraview.write(tmp_path / "whole.pvd", case.model, result)
    _, whole = told("whole.pvd", tmp_path)
    for name in ("it_0001.pvtu", "it.pvd"):
        _, report = told(name, tmp_path)
        assert report["cells"] == whole["cells"] == {"hexahedron": sum(counts)}
        highest = [
            {name: field["high"] for name, field in it["fields"].items()}
            for it in (report, whole)
        ]
        # Means of stresses of some cells differ in rounding.
        assert highest[0] == pytest.approx(highest[1], rel=1e-12)


def test_info_of_a_mesh_with_fields(tmp_path: Path) -> None:
    """A mesh of another program keeps its summary as a mesh."""
    body = fem.box([np.linspace(0, 1, 3)] * 2, "quadrilateral")
    points = np.column_stack([body.p.T, np.zeros(body.p.shape[1])])
    fields = {"heat": np.arange(float(len(points)))}
    meshio.write_points_cells(tmp_path / "it.vtu", points, [("quad", body.t.T)], fields)
    out, _ = told("it.vtu", tmp_path)
    assert out[0].startswith("it.vtu: a mesh in 2 dimensions")
    assert "  heat  number at points, 0 to 8" in "\n".join(out)
