"""Meshes from files: written by gmsh, written by hand, and files without a valid mesh."""

import sys
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import skfem

from bipot_rs import fem
from bipot_rs.fem.bodies.elasticity import vtk_cells
from bipot_rs.files.series import write_grid
from bipot_rs.mesh import elements, kinds, serendipity
from support import places
from support.comparisons import near, refused

DATA = places.DATA / "meshes"
# The element of each file, for a box 2 x 1 (x 1) in two volumes.
BOXES = {
    "triangle.msh": skfem.MeshTri1,
    "quad.msh": skfem.MeshQuad1,
    "quad8.msh": serendipity.MeshQuadS2,
    "quad9.msh": skfem.MeshQuad2,
    "tetra.msh": skfem.MeshTet1,
    "tetra10.msh": skfem.MeshTet2,
    "hexahedron.msh": skfem.MeshHex1,
    "hexahedron20.msh": serendipity.MeshHexS2,
    "hexahedron27.msh": skfem.MeshHex2,
    "tetra.inp": skfem.MeshTet1,
    "tetra10.inp": skfem.MeshTet2,
    "hexahedron20.inp": serendipity.MeshHexS2,
    "triangle6.inp": skfem.MeshTri2,
}
STEEL = fem.Material(210e9, 0.3)


@pytest.mark.parametrize("name", BOXES)
def test_box(name: str) -> None:
    mesh = fem.read_mesh(DATA / name)
    assert type(mesh) is BOXES[name]
    body = fem.Body("it", mesh, STEEL)
    volume = body.volume()
    # The 16 digits of the file, over some hundred cells.
    assert volume.weights.sum() == pytest.approx(2.0, rel=1e-13)
    for x, word in ((0.5, "left"), (1.5, "right")):
        weights = volume.weights[body.volume_cells(word)]
        assert weights.sum() == pytest.approx(1.0, rel=1e-13)
        places = volume.places[0][body.volume_cells(word)]
        assert np.abs(places - x).max() <= 0.5 + 1e-15
    up = np.eye(body.dim)[-1]
    for at, word, sign in ((0.0, "base", -1.0), (1.0, "top", 1.0)):
        surface = body.surface(word)
        assert surface.weights.sum() == pytest.approx(2.0, rel=1e-13)
        near(surface.places[-1], at, 1e-14)
        near(np.moveaxis(np.asarray(surface.normals), 0, -1) - sign * up, 0, 1e-13)
    # Between the volumes there is no outward normal.
    with refused("surface 'middle' lies inside body 'it'"):
        body.surface("middle")
    inner = fem.surface(mesh, {0: (1.0, 1.0)}, inside=True)
    np.testing.assert_array_equal(mesh.boundaries["middle"], inner)
    np.testing.assert_array_equal(np.unique(body.cells), np.arange(len(body.points)))
    # The mapping is linear: nodes of second order are means of corners, in the right order.
    _, slopes, _ = kinds.reference(body.kind.scalar, body.kind.order)
    jacobian = elements.jacobian(body.points[body.cells], slopes)
    near(jacobian - jacobian[:1], 0, 1e-13)


def test_bodies_of_one_file() -> None:
    path = DATA / "two_bodies.msh"
    with refused(r"several kinds, 22 .*'lower' \(triangle\)"):
        fem.read_mesh(path)
    lower, upper = (meshes := fem.read_meshes(path)).values()
    assert list(meshes) == ["lower", "upper"]
    assert (type(lower), type(upper)) == (skfem.MeshTri1, skfem.MeshQuad1)
    assert set(lower.boundaries) == {"base", "lower top"}
    assert set(upper.boundaries) == {"load", "upper bottom"}
    with refused("no volume 'base'; it has 'lower', 'upper'"):
        fem.read_mesh(path, "base")
    with refused("'upper' has no surface 'base', expected one of load, upper"):
        fem.Body("upper", upper, STEEL).facets("base")


@pytest.mark.parametrize("bare", ["", "_bare"])
@pytest.mark.parametrize("form", ["22", "41", "41_binary"])
def test_groups_of_gmsh(form: str, bare: str) -> None:
    """Entities in several groups, reversed in some; one name for lines and for a face."""
    mesh = fem.read_mesh(DATA / f"groups{form}{bare}.msh")
    words = ["base", "side", "round", "left", "all", "base"]
    words = [f"physical {k}" for k in range(1, 7)] if bare else words
    body = fem.Body("it", mesh, STEEL)
    assert set(mesh.boundaries) == set(words[:3])
    assert set(mesh.subdomains) == set(words[3:])
    # The length or area of each group, and its centre.
    exact = [(2, (1, 0)), (1, (2, 0.5)), (3, (4 / 3, 5 / 6))]
    exact += [(1, (0.5, 0.5)), (2, (1, 0.5)), (1, (1.5, 0.5))]
    for k, (name, (size, middle)) in enumerate(zip(words, exact, strict=True)):
        points = body.surface(name) if k < 3 else body.volume()
        cells = slice(None) if k < 3 else body.volume_cells(name)
        weights = points.weights[cells]
        assert weights.sum() == pytest.approx(size, rel=1e-13)
        moment = np.einsum("dpq,pq->d", points.places[:, cells], weights)
        near(moment / size, middle, 1e-13)


@pytest.mark.parametrize("name", ["quad.msh", "tetra10.msh", "hexahedron20.msh"])
def test_groups_of_med(name: str, tmp_path: Path) -> None:
    """The same body from gmsh and from a MED file with overlapping groups."""
    meshlane = pytest.importorskip("meshlane")
    body = fem.Body("it", fem.read_mesh(DATA / name), STEEL)
    kind, cells = vtk_cells(body)
    whole, facets = np.arange(len(cells)), body.mesh.facets.T[body.facets("base")]
    corners = {2: "line", 3: "triangle", 4: "quad"}[facets.shape[1]]
    sets = {"left": [body.volume_cells("left"), []], "all": [whole, []]}
    sets["base"] = [[], np.arange(len(facets))]
    blocks = [(kind, cells), (corners, facets)]
    meshlane.Mesh(body.points, blocks, cell_sets=sets).write(tmp_path / "it.med")
    back = fem.Body("it", fem.read_mesh(tmp_path / "it.med"), STEEL)
    assert set(back.mesh.subdomains) == {"left", "all"}
    for volume, size in (("left", 1.0), ("all", 2.0)):
        own = back.volume().weights[back.volume_cells(volume)].sum()
        assert own == pytest.approx(size, rel=1e-13)
    assert back.surface("base").weights.sum() == pytest.approx(2.0, rel=1e-13)
    left = fem.read_mesh(tmp_path / "it.med", "left")
    assert left.p[0].max() == pytest.approx(1.0)


def vtu(path: Path, points: object, cells: object, **fields: object) -> Path:
    points = np.asarray(points, float)
    write_grid(path, points, cells, {}, fields, numbers={}, units={})
    return path


@pytest.mark.parametrize("name", BOXES)
def test_vtu(name: str, tmp_path: Path) -> None:
    """A mesh written by the package is read as the same mesh, with cell data as names."""
    body = fem.Body("it", fem.read_mesh(DATA / name), STEEL)
    kind, cells = vtk_cells(body)
    tag, right = np.full(len(cells), 3), body.volume_cells("right")
    tag[right] = 8
    points = np.zeros((len(body.points), 3))
    points[:, : body.dim] = body.points
    path = vtu(tmp_path / "it.vtu", points, [(kind, cells)], tag=tag)
    mesh = fem.read_mesh(path)
    assert type(mesh) is type(body.mesh)
    assert set(mesh.subdomains) == {"tag 3", "tag 8"}
    np.testing.assert_array_equal(mesh.subdomains["tag 8"], right)
    back = fem.Body("it", mesh, STEEL)
    ours, theirs = (b.points[b.cells].mean(axis=1) for b in (body, back))
    np.testing.assert_array_equal(theirs, ours)


INP = """*HEADING
two squares above each other, lines by hand
** a comment, with a comma
*Node, nset=ALL
1, 0., 0.
2, 1., 0.
3, 1., 1.
4, 0., 1.
5, 1., 2.
6, 0, 2.
99, 50., 50.
*ELEMENT, TYPE=CPE4, ELSET=Low
7, 1, 2, 3, 4
*ELEMENT, type=CPE4R,
 elset=High
8, 4, 3,
5, 6
*NSET, NSET=floor, GENERATE
1, 2, 1
*NSET, NSET=Corner
6
*ELSET, ELSET=both
LOW, high
*SURFACE, NAME=roof, TYPE=ELEMENT
high, S3
*SURFACE, NAME=SIDE
7, S2
8, S2
*SURFACE, NAME=around
Both
*SURFACE, NAME=between
7, S3
*SURFACE, NAME=mixed
7, S3
8, S3
*SURFACE, NAME=ground, TYPE=NODE
FLOOR
*STEP
"""


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def middles_of(mesh: Any) -> dict[str, list[list[float]]]:
    """Sorted middles of the facets of each surface."""
    middle = mesh.p[:, mesh.facets].mean(axis=1).T
    return {name: sorted(middle[f].tolist()) for name, f in mesh.boundaries.items()}


def test_inp_by_hand(tmp_path: Path) -> None:
    path = written(tmp_path / "squares.inp", INP)
    mesh = fem.read_mesh(path)
    assert type(mesh) is skfem.MeshQuad1
    assert mesh.p.shape == (2, 6)  # node 99 belongs to no cell
    cells = {
        name: mesh.p[1, mesh.t[:, c]].mean() for name, c in mesh.subdomains.items()
    }
    assert cells == {"Low": 0.5, "High": 1.5, "both": 1.0}
    every = sorted([[0.5, 0], [1, 0.5], [0, 0.5], [1, 1.5], [0, 1.5], [0.5, 2]])
    assert middles_of(mesh) == {
        "ALL": every,
        "around": every,
        "between": [[0.5, 1.0]],
        "floor": [[0.5, 0.0]],
        "ground": [[0.5, 0.0]],
        "mixed": [[0.5, 2.0]],
        "roof": [[0.5, 2.0]],
        "SIDE": [[1.0, 0.5], [1.0, 1.5]],
    }
    high = fem.read_mesh(path, "High")
    assert high.p.shape == (2, 4)
    outer = {"ALL", "around", "roof", "SIDE"}
    assert set(high.boundaries) == outer | {"between", "mixed"}


# Corners, and the centres of the faces S1, S2, … in the manuals of Abaqus and CalculiX.
SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
FACES = {
    "C3D4": (
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
        np.array([(1, 1, 0), (1, 0, 1), (1, 1, 1), (0, 1, 1)]) / 3,
    ),
    "C3D8": (
        [(x, y, z) for z in (0, 1) for x, y in SQUARE],
        np.array([(1, 1, 0), (1, 1, 2), (1, 0, 1), (2, 1, 1), (1, 2, 1), (0, 1, 1)])
        / 2,
    ),
}


@pytest.mark.parametrize("kind", FACES)
def test_faces_of_inp(kind: str, tmp_path: Path) -> None:
    corners, middles = FACES[kind]
    nodes = [f"{k}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(corners, 1)]
    lines = ["*NODE", *nodes, f"*ELEMENT, TYPE={kind}"]
    lines.append("1, " + ", ".join(map(str, range(1, len(corners) + 1))))
    for k in range(len(middles)):
        lines += [f"*SURFACE, NAME=F{k}", f"1, S{k + 1}"]
    mesh = fem.read_mesh(written(tmp_path / "one.inp", "\n".join(lines)))
    for k, middle in enumerate(middles):
        near(middles_of(mesh)[f"F{k}"], [middle], 1e-15)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("TYPE=CPE4", "TYPE=CGAX4", "line 12: has cells of type CGAX4, which twist"),
        ("TYPE=CPE4", "TYPE=DC2D4", "line 12: has cells of type DC2D4, expected C3D4"),
        ("7, 1, 2, 3, 4", "7, 1, 2, 3", "line 13: ends before a cell of type CPE4"),
        ("7, 1, 2, 3, 4", "7, 1, 2, 3, 44", "line 12: has cells with node 44"),
        ("8, 4, 3,", "7, 4, 3,", "defines cell 7 a second time"),
        ("3, 1., 1.", "3, 1., one", "line 7: is '1., one', expected numbers"),
        ("3, 1., 1.", "2, 1., 1.", "line 7: defines node 2 a second time"),
        ("LOW, high", "LOW, hi", "line 23: uses cells 'hi' that are not defined"),
        ("7, S2", "7, S5", "line 27: has face S5 of a quad, expected S1 to S4"),
        ("*STEP", "*INCLUDE, INPUT=x", "line 38: includes 'x', which does not exist"),
        ("*STEP", "*NGEN\n1, 3, 1", "line 38: has \\*NGEN, which creates or moves"),
        ("*STEP", "*SYSTEM\n1., 0., 0.", "line 38: has \\*SYSTEM, which creates or"),
        ("*STEP", "*NODE, INPUT=x", "line 38: reads another file"),
        ("*STEP", "*PART, NAME=a\n*PART, NAME=b", "line 39: has a second part"),
        ("CPE4", "S4", "has shells but no solids"),
        ("3, 1., 1.", "3, nan, 1.", "has a node of cell 0 whose coordinates are not"),
        ("5, 6\n", "3, 4\n", "cell"),
        ("1, 2, 1\n", "1, 2, 0\n", "line 19: generates 1, 2, 0, expected first, last"),
        ("1, 2, 1\n", "2, 1\n", "line 19: generates 2, 1, expected first, last"),
        ("1, 2, 1\n", "2\n", "line 19: generates 2, expected first, last, step"),
        ("3, 1., 1.", "3, 1_0., 1.", "line 7: is '1_0., 1.', expected numbers"),
        ("7, 1, 2, 3, 4", "7, 1, 2, 3, 0_4", "line 13: .*expected whole numbers"),
    ],
)
def test_inp_refuses(old: str, new: str, said: str, tmp_path: Path) -> None:
    assert old in INP
    with refused(said):
        fem.read_mesh(written(tmp_path / "squares.inp", INP.replace(old, new)))


ASSEMBLY = """*PART, NAME=Plate
*NODE
1, 0., 0.
2, 1., 0.
3, 1., 1.
4, 0., 1.
*ELEMENT, TYPE=CPE4, ELSET=Set-1
1, 1, 2, 3, 4
*NSET, NSET=SET-1
1, 2
*NSET, NSET=alike
3, 4
*SURFACE, NAME=face
Set-1, S1
*END PART
*ASSEMBLY, NAME=all
*INSTANCE, NAME=Plate-1, PART=Plate
*END INSTANCE
*NSET, NSET=Set-1, INSTANCE=Plate-1
2, 3
*NSET, NSET=alike, INSTANCE=Plate-1
4, 3
*ELSET, ELSET=cells, INSTANCE=Plate-1
1
*NSET, NSET=same, INSTANCE=Plate-1
Plate-1.set-1
*SURFACE, NAME=face
cells, S3
*SURFACE, NAME=other
Plate-1.Set-1, S4
*END ASSEMBLY
"""


def test_one_name_in_part_and_assembly(tmp_path: Path) -> None:
    mesh = fem.read_mesh(written(tmp_path / "plate.inp", ASSEMBLY))
    assert middles_of(mesh) == {
        "Set-1": [[1.0, 0.5]],
        "Plate-1.Set-1": [[0.5, 0.0]],
        "alike": [[0.5, 1.0]],
        "same": [[0.5, 0.0]],
        "face": [[0.5, 1.0]],
        "Plate-1.face": [[0.5, 0.0]],
        "other": [[0.0, 0.5]],
    }
    assert set(mesh.subdomains) == {"Set-1", "cells"}


def test_files_without_a_mesh(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none\.msh does not exist"):
        fem.read_mesh(tmp_path / "none.msh")
    with refused(r"suffix \.stl, expected one of \.msh, \.inp"):
        fem.read_mesh(written(tmp_path / "mesh.stl", "solid"))
    (tmp_path / "dir.msh").mkdir()
    with pytest.raises(OSError, match=r"dir\.msh"):
        fem.read_mesh(tmp_path / "dir.msh")
    for path in (tmp_path / f"empty.{suffix}" for suffix in ("msh", "inp", "vtu")):
        for text, message in (("", "is empty"), ("hello\n" * 3, path.name)):
            with refused(message):
                fem.read_mesh(written(path, text))


@pytest.mark.parametrize("name", ["tetra.msh", "quad.msh", "quad9.msh", "quad8.msh"])
def test_incomplete_files(name: str, tmp_path: Path) -> None:
    whole = (DATA / name).read_bytes()
    path = tmp_path / name
    for share in (0.3, 0.6, 0.9):
        path.write_bytes(whole[: int(share * len(whole))])
        with refused(rf"{name} is incomplete: it has no \$EndEl"):
            fem.read_mesh(path)
    # The end of the file is there, but a part before it is missing.
    end = whole.index(b"$EndElements")
    path.write_bytes(whole[: end - 200] + whole[end:])
    with refused(name):
        fem.read_mesh(path)
    groups = (DATA / "groups41.msh").read_text().replace('2 5 "all"', '2 "all"')
    with refused(r"it\.msh .*"):
        fem.read_mesh(written(tmp_path / "it.msh", groups))


def test_vtu_refuses(tmp_path: Path) -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    bent, lost, flat = square.copy(), square.copy(), square[:, [2, 0, 1]]
    bent[2, 2], lost[1] = 0.3, np.nan
    triangles, whole = [[0, 1, 2], [0, 2, 3]], [[0, 1, 2, 3]]
    path = tmp_path / "it.vtu"
    for points, kind, cells, message in (
        (square, "vertex", [[0], [1]], "no cells of a 2D or 3D body, 2 of kind vertex"),
        (bent, "triangle", triangles, "has 2D cells in no plane"),
        (flat, "quad", whole, r"the plane x = const.* or 3D cells$"),
        (square, "quad", [*whole, [1, 2, 3, 0]], "1 cell twice"),
        (lost, "quad", whole, "are not finite"),
    ):
        with refused(message):
            fem.read_mesh(vtu(path, points, [(kind, np.array(cells))]))
    wedge = np.vstack([square[:3], np.add(square[:3], (0, 0, 1))])
    meshio.Mesh(wedge, [("wedge", np.arange(6)[None])]).write(path)
    with refused("cells of kind wedge, expected one of triangle"):
        fem.read_mesh(path)
    vtu(path, square, [("quad", np.array(whole))])
    path.write_bytes(path.read_bytes()[:-20])
    with refused("incomplete"):
        fem.read_mesh(path)
    # For gmsh files, a likely cause is that volumes were not saved.
    path = tmp_path / "it.msh"
    meshio.Mesh(flat, [("quad", np.array(whole))]).write(path, file_format="gmsh22")
    volumes = r"give the volumes of a 3D body a physical group"
    with refused(f"the plane x = const.*{volumes}"):
        fem.read_mesh(path)
    with refused(f"no volume 'pad'.*{volumes}"):
        fem.read_mesh(path, "pad")


def test_cells_that_share_corners_but_not_the_middle(tmp_path: Path) -> None:
    x = [(0, 0), (1, 0), (0, 1), (1, 1), (0.5, 0), (0.5, 0.5), (0, 0.5), (1, 0.5)]
    points = np.pad([*x, (0.5, 1), (0.5, 0.5)], ((0, 0), (0, 1)))
    cells = np.array([[0, 1, 2, 4, 5, 6], [1, 3, 2, 7, 8, 9]])
    path = tmp_path / "it.vtu"
    with refused(r"between two corners, at \(0\.5, 0\.5\)"):
        fem.read_mesh(vtu(path, points, [("triangle6", cells)]))
    cells[1, 5] = 5
    assert fem.read_mesh(vtu(path, points, [("triangle6", cells)])).p.shape == (2, 9)


def test_surface_by_geometry() -> None:
    mesh = fem.box([np.linspace(0, 2, 5)] * 3, "hexahedron")
    for name, normal, within in (
        ("left", (-3, 0, 0), {0: (0, 0)}),
        ("top", (0, 0, 1), {2: (2, np.inf)}),
        ("front", (0, -1, 0.1), {1: (-np.inf, 0)}),
    ):
        facets = np.sort(mesh.boundaries[name])
        np.testing.assert_array_equal(fem.surface(mesh, normal=normal), facets)
        np.testing.assert_array_equal(fem.surface(mesh, within=within), facets)
    assert len(fem.surface(mesh, within={0: (0, 1)}, normal=(0, 0, 1))) == 8
    for within, message in (
        ({0: (3, 4)}, r"no boundary facet .*x from 0 to 2"),
        (None, "needs within or normal"),
        ({0: (1, 0)}, r"expected .* with low <= high"),
        ({3: (1, 2)}, "axis 3"),
    ):
        with refused(message):
            fem.surface(mesh, within=within)


@pytest.mark.parametrize(
    "name", ["tetra.inp", "triangle6.inp", "quad8.msh", "triangle.msh"]
)
def test_damaged_text_gives_a_message(name: str, tmp_path: Path) -> None:
    """Text cut, doubled or changed at random gives a mesh or a ValueError, nothing else."""
    random = np.random.default_rng(len(name))
    whole = (DATA / name).read_bytes()
    path = tmp_path / name
    messages = []
    for _ in range(25):
        text = bytearray(whole)
        at, size = random.integers(len(text)), random.integers(1, 40)
        match random.integers(3):
            case 0:
                del text[at : at + size]
            case 1:
                text[at:at] = text[at : at + size]
            case _:
                text[at] = ord(random.choice(list("0179.,*-x\n")))
        path.write_bytes(text)
        try:
            fem.read_mesh(path)
        except ValueError as error:
            messages.append(str(error))
    assert messages
    assert all(name in message for message in messages)


def test_cells_of_no_group_among_others() -> None:
    """Files of gmsh with Mesh.SaveAll in version 4.1, which meshio cannot read."""
    with refused("some cells have no physical group, save"):
        fem.read_mesh(DATA / "save_all.msh")


def test_tags_of_lines_are_surfaces(tmp_path: Path) -> None:
    points = [(0, 0, 3), (1, 0, 3), (2, 0, 3), (0, 1, 3), (1, 1, 3), (2, 1, 3)]
    cells = [
        ("quad", np.array([[0, 1, 4, 3], [1, 2, 5, 4]])),
        ("line", np.array([[0, 1], [1, 2], [4, 5], [1, 4]])),
    ]
    path = tmp_path / "it.vtu"
    tags = [np.array([1, 1]), np.array([5, 5, 6, 6])]
    meshio.Mesh(points, cells, cell_data={"tag": tags}).write(path)
    mesh = fem.read_mesh(path)
    assert mesh.p.shape == (2, 6)
    # The line between the two cells is not a surface of the body.
    wanted = {"tag 5": [[0.5, 0.0], [1.5, 0.0]], "tag 6": [[1.5, 1.0]]}
    assert middles_of(mesh) == wanted
    assert set(mesh.subdomains) == {"tag 1"}


def test_without_meshio(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'bipot-rs\[fem\]'"):
        fem.read_mesh(DATA / "quad.msh")
    assert fem.read_mesh(DATA / "tetra.inp").t.shape[1] == 200


def test_cells_with_a_missing_node(tmp_path: Path) -> None:
    """If its number is within the range of the others, meshio takes the last node instead."""
    lines = (DATA / "quad8.msh").read_text().splitlines()
    at = lines.index("$Nodes") + 3
    assert lines[at : at + 2] == ["1", "0 0 0"]
    lines[at] = "500"
    with refused(r"lost\.msh has a .* with a node that is not in"):
        fem.read_mesh(written(tmp_path / "lost.msh", "\n".join(lines)))
