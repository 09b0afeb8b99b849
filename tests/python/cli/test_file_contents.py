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


def two_blocks() -> bp.Model:
    """The scene of the run."""
    return bp.Model.from_toml(SCENE[0]).with_(**{"mesh.n": 4})


def tree(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """All datasets of a group and of the groups in it, by path."""
    datasets: dict[str, h5py.Dataset] = {}
    group.visititems(
        lambda path, one: datasets.update(
            {path: one} if isinstance(one, h5py.Dataset) else {}
        )
    )
    return datasets


def units_of(grid: meshio.Mesh) -> dict[str, str]:
    """Units of the fields of a VTU file."""
    text = grid.field_data["units"].astype(np.uint8).tobytes().decode()
    return dict(json.loads(text))


def times(path: Path) -> list[float]:
    """Times of a PVD index."""
    sets = ET.parse(path).getroot().iter("DataSet")
    return [float(item.attrib["timestep"]) for item in sets]


def same(grid: meshio.Mesh, file: h5py.File, k: int) -> None:
    """The fields of a VTU file are bitwise those of step k of a result file."""
    assert set(grid.point_data) == set(file["fields"]) - {"load", "time"}
    for name, field in grid.point_data.items():
        row = file["fields"][name][k]
        width = row.shape[1] if row.ndim == 2 else 1
        # VTK has three components, the last is zero in the plane.
        np.testing.assert_array_equal(field.reshape(len(row), -1)[:, :width].squeeze(),
                                      row.squeeze(), err_msg=name)  # fmt: skip
        assert not field.reshape(len(row), -1)[:, width:].any(), name


def test_names_of_all_writers(folder: Path, tmp_path: Path) -> None:
    bp.load(folder / "result.h5").write(tmp_path / "loaded.pvd")
    case = two_blocks().assemble()
    paraview.write(tmp_path / "model.pvd", case.model, case.solve())
    command, _ = written(tmp_path, "block")
    bipot(*command, "--out", "solved", cwd=tmp_path)
    files = {
        "run": folder / "contact_0001.vtu",
        "Result.write": tmp_path / "loaded_0001.vtu",
        "paraview.write": tmp_path / "model_contact_0001.vtu",
        "solve": tmp_path / "solved" / "contact_0000.vtu",
    }
    for who, path in files.items():
        assert sorted(meshio.read(path).point_data) == sorted(NAMES), who
    for path in (folder / "result.h5", tmp_path / "solved" / "result.h5"):
        with h5py.File(path) as file:
            assert sorted(file["fields"]) == sorted([*NAMES, "load", "time"])
    bodies = meshio.read(folder / "result_0001.vtu")
    assert sorted(bodies.point_data) == sorted(OF_NODES)
    assert set(bodies.cell_data) == {"stress", "von_mises"} < set(OF_CELLS)
    # After a solve the cells are not known, but the nodes are the bodies' too.
    nodes = meshio.read(tmp_path / "solved" / "result_0000.vtu")
    assert list(nodes.point_data) == ["displacement"]


def test_values_of_all_writers_agree(folder: Path, tmp_path: Path) -> None:
    bp.load(folder / "result.h5").write(tmp_path / "loaded.pvd")
    with h5py.File(folder / "result.h5") as file:
        for k in range(2):
            same(meshio.read(folder / f"contact_{k:04d}.vtu"), file, k)
            same(meshio.read(tmp_path / f"loaded_{k:04d}.vtu"), file, k)


def test_fields_follow_from_the_promised_datasets(folder: Path) -> None:
    """Global components by a rotation of one contact after the other."""
    with h5py.File(folder / "result.h5") as file:
        contact_arrays = {name: data[()] for name, data in file["contacts"].items()}
        for k, step in enumerate(file["steps"].values()):
            fields_of_step = {name: data[k] for name, data in file["fields"].items()}
            r, v, slip = (
                step[n][()] for n in ("reaction", "relative_displacement", "slip")
            )
            np.testing.assert_array_equal(fields_of_step["reaction_local"], r)
            np.testing.assert_array_equal(
                fields_of_step["relative_displacement_local"], v
            )
            np.testing.assert_array_equal(fields_of_step["slip_local"], slip)
            np.testing.assert_array_equal(fields_of_step["gap"], v[:, 0])
            np.testing.assert_array_equal(fields_of_step["status"], step["status"][()])
            np.testing.assert_array_equal(
                fields_of_step["normal"], contact_arrays["normal"]
            )
            for c, axes in enumerate(contact_arrays["frame"]):
                size = np.abs(r).max()
                # Sums of three products: some units of rounding.
                close = {"rtol": 1e-14, "atol": 1e-14 * size}
                np.testing.assert_allclose(
                    fields_of_step["force"][c], axes.T @ r[c], **close
                )
                np.testing.assert_allclose(
                    fields_of_step["traction"][c] * contact_arrays["area"][c],
                    axes.T @ r[c],
                    **close,
                )
                np.testing.assert_allclose(axes[1:] @ fields_of_step["slip"][c], slip[c],
                                           atol=1e-14 * np.abs(slip).max())  # fmt: skip
            pressed = fields_of_step["pressure"] * contact_arrays["area"]
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
        step = file["steps/0000"]
        for name, unit in (
            ("reaction", "N"),
            ("slip", "mm"),
            ("bipotential_gap", "N·mm"),
        ):
            assert step[name].attrs["units"] == unit
        assert step["reaction"].attrs["frame"] == step["slip"].attrs["frame"] == LOCAL
        assert file["contacts/area"].attrs["units"] == "mm²"
        assert file["mesh/nodes"].attrs["units"] == "mm"
    for name in ("contact_0000.vtu", "result_0000.vtu"):
        told = units_of(meshio.read(folder / name))
        assert told["displacement"] == "mm"
        assert told.get("force", "N") == "N"
        assert told.get("stress", "MPa") == told.get("pressure", "MPa") == "MPa"
        assert not {"status", "normal", "contact_status"} & set(told)


def test_unknown_units_are_dimensions(tmp_path: Path) -> None:
    command, _ = written(tmp_path, "block")
    bipot(*command, "--out", "here", cwd=tmp_path)
    told = units_of(meshio.read(tmp_path / "here" / "contact_0000.vtu"))
    assert (told["force"], told["slip"]) == ("force", "length")
    with h5py.File(tmp_path / "here" / "result.h5") as file:
        force = file["fields/force"].attrs
        assert force["dimension"] == "force"
        assert "units" not in force
        # The nodes of the table, with their degrees of freedom.
        mesh, points = file["mesh"], file["contacts/x"][()]
        np.testing.assert_array_equal(
            mesh["nodes"][()][mesh["contact_nodes"][()]], points
        )
        u = file["steps/0000/displacement"][()][mesh["dofs"][()]]
        nodes = meshio.read(tmp_path / "here" / "result_0000.vtu")
        np.testing.assert_array_equal(
            nodes.point_data["displacement"][:, : u.shape[1]], u
        )


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
        np.diag([1000.0, 1000.0]),
        np.eye(2),
        gap=[0.0],
        mu=0.3,
        area=[1.0],
        points=[[0, 0]],
    )
    path = problem.follow(
        lambda s: np.array([-10.0, 5.0 * s]), stops=[0.25, 1.0], first=0.25
    )
    assert [step.s for step in path][-1] == 1.0
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
    result = two_blocks().solve()
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
    plain = two_blocks().assemble().solve()
    assert plain.mesh is None
    plain.save(tmp_path / "plain.h5")
    assert bp.load(tmp_path / "plain.h5").mesh is None
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
    # Written again, the file has what can be known.
    loaded.save(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["fields/reaction_local"][()], reaction)
        assert file["fields/reaction_local"].attrs["units"] == "N"
    again = bp.load(tmp_path / "a.h5")
    for field in (
        "reaction",
        "slip",
        "status",
        "displacement",
        "relative_displacement",
    ):
        np.testing.assert_array_equal(getattr(again, field), getattr(loaded, field))


def test_the_earlier_file_of_arrays_has_the_values_by_hand() -> None:
    """Two springs of 1000 N/m, a point that sticks and then slips with μ = 0.3."""
    loaded = bp.load(DATA / "results" / "arrays.h5")
    exact = [[[10.0, -2.0]], [[10.0, -3.0]]]
    # Numbers of a file, solved to a residual of 1e-10.
    np.testing.assert_allclose(loaded.reaction, exact, rtol=1e-9)
    np.testing.assert_allclose(loaded.slip[1], [[0.002]], rtol=1e-9)
    assert loaded.units == {"length": "m", "force": "N", "stress": "Pa"}


@pytest.mark.parametrize(
    ("path", "change", "words"),
    [
        ("mesh/dofs", lambda a: a + 1, "the mesh does not fit"),
        ("mesh/contact_nodes", lambda a: a[1:], "the mesh does not fit"),
        ("mesh/contact_facets/0", lambda a: a + 25, "the mesh does not fit"),
        ("mesh/cells/1", lambda a: a + 1000, "cells has indices"),
        ("mesh/nodes", lambda a: a[:-1], "dofs has shape"),
        ("mesh/dofs", lambda _: None, "dofs"),
        ("mesh/cells/0", lambda a: a, "kind"),
    ],
)
def test_a_damaged_mesh_is_refused(
    path: str, change: Any, words: str, folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "a.h5").write_bytes((folder / "result.h5").read_bytes())
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        del file.attrs["sealed"]
        array = change(file[path][()])
        attributes = dict(file[path].attrs)
        del file[path]
        if array is not None:
            file[path] = array
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


def test_info_of_files_for_paraview(folder: Path) -> None:
    def told(name: str) -> tuple[list[str], dict[str, Any]]:
        out = bipot("info", name, cwd=folder).stdout.splitlines()
        report = json.loads(bipot("info", name, "--json", cwd=folder).stdout)
        return out, report

    out, report = told("contact.pvd")
    assert out[0].startswith(
        "contact.pvd: a series of 2 steps for ParaView, time 0 to 1"
    )
    assert (report["kind"], report["steps"], report["times"]) == (
        "series",
        2,
        [0.0, 1.0],
    )
    assert (report["points"], report["cells"]) == (25, {"quad": 16})
    assert set(report["fields"]) == set(NAMES)
    grid = meshio.read(folder / "contact_0001.vtu")
    force = np.linalg.norm(grid.point_data["force"], axis=1)
    about = report["fields"]["force"]
    assert (about["low"], about["high"]) == (force.min(), force.max())
    assert (about["units"], about["components"], about["of"]) == ("N", 3, "points")
    span = f"length of vector at points, {force.min():.4g} to {force.max():.4g} N"
    assert any(line.split("force", 1)[-1].strip() == span for line in out)
    out, report = told("result_0000.vtu")
    assert out[0] == "result_0000.vtu: one step for ParaView"
    assert (report["kind"], report["load"], report["time"]) == ("step", 0.0, 1.0)
    assert report["cells"] == {"hexahedron": 64}
    assert report["fields"]["stress"]["components"] == 6
    assert report["fields"]["stress"]["of"] == "cells"


def test_info_of_broken_files_for_paraview(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "alone.pvd").write_bytes((folder / "contact.pvd").read_bytes())
    (tmp_path / "text.pvd").write_text("text")
    (tmp_path / "other.pvd").write_text("<VTKFile type='UnstructuredGrid'/>")
    (tmp_path / "bomb.pvd").write_text('<!DOCTYPE a [<!ENTITY b "c">]><a/>')
    (tmp_path / "none.pvtu").write_text("<VTKFile type='PUnstructuredGrid'/>")
    (tmp_path / "half.vtu").write_bytes(
        (folder / "contact_0000.vtu").read_bytes()[:900]
    )
    for name, message in (
        ("alone.pvd", "names 2 files that do not exist, the first is contact_0000.vtu"),
        ("gone.pvd", "there is no file gone.pvd"),
        ("text.pvd", "text.pvd is not XML"),
        ("other.pvd", "is not a file of VTK of type Collection"),
        ("bomb.pvd", "has a document type"),
        ("none.pvtu", "none.pvtu has no pieces"),
        ("half.vtu", "half.vtu cannot be read as a VTU file"),
    ):
        run = bipot("info", name, cwd=tmp_path, status=2)
        assert message in run.stderr, run.stderr


def test_info_of_parts(tmp_path: Path) -> None:
    """The parts of two ranks are counted together."""
    case = two_blocks().assemble()
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
    reports = [
        json.loads(bipot("info", name, "--json", cwd=tmp_path).stdout)
        for name in ("it_0001.pvtu", "it.pvd", "whole.pvd")
    ]
    for report in reports:
        assert report["cells"] == {"hexahedron": sum(counts)}
        assert report["fields"].keys() == reports[2]["fields"].keys()
        for name, field in report["fields"].items():
            # Means of stresses of some cells differ in rounding.
            expected = reports[2]["fields"][name]["high"]
            assert field["high"] == pytest.approx(expected, rel=1e-12)


def test_info_of_a_mesh_with_fields(tmp_path: Path) -> None:
    """A mesh of another program keeps its summary as a mesh."""
    body = fem.box([np.linspace(0, 1, 3)] * 2, "quadrilateral")
    points = np.column_stack([body.p.T, np.zeros(body.p.shape[1])])
    heat = np.arange(float(len(points)))
    meshio.write_points_cells(
        tmp_path / "it.vtu", points, [("quad", body.t.T)], {"heat": heat}
    )
    out = bipot("info", "it.vtu", cwd=tmp_path).stdout
    assert "it.vtu: a mesh in 2 dimensions" in out
    assert "  heat  number at points, 0 to 8" in out
