"""Files with a byte-order mark are read like files without one."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.io import mmwrite

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs._lib.text_files import MARK, strip_mark
from bipot_rs.mesh.readers import read_cells
from support.matrix_and_tables import written

meshio = pytest.importorskip("meshio")


def mark(path: Path) -> None:
    path.write_bytes(MARK + path.read_bytes())


@pytest.mark.parametrize("template", ["mesh", "block"])
def test_scenes_and_their_meshes(template: str, bipot: Any) -> None:
    assert bipot("new", "mine", "--template", template)[0] == 0

    def check() -> Any:
        said = json.loads(bipot("check", "mine.toml", "--json")[1])
        # It counts what this process holds.
        del said["forecast"]["bytes_run"]
        return said

    before = check()
    told = bipot("info", "mine.toml")[1]
    for file in Path().iterdir():
        mark(file)
    assert check() == before
    assert bipot("info", "mine.toml")[1] == told
    text = Path("mine.toml").read_text(encoding="utf-8")
    assert text.startswith("\ufeff")
    assert bp.Model.from_toml(text) == bp.Model.from_toml("mine.toml")


@pytest.mark.parametrize("suffix", [".msh", ".vtu", ".inp", ".stl"])
def test_meshes(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    texts = {
        ".inp": "*NODE\n1, 0, 0\n2, 1, 0\n3, 0, 1\n*ELEMENT, TYPE=CPE3, ELSET=all\n"
        "1, 1, 2, 3\n** größer\n",
        ".stl": "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"
        "vertex 0 1 0\nendloop\nendfacet\nendsolid a\n",
    }
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    mesh = meshio.Mesh(points, [("triangle", np.array([[0, 1, 2], [1, 3, 2]]))])
    if suffix == ".msh":
        meshio.gmsh.write(path, mesh, fmt_version="2.2", binary=False)
    elif suffix == ".vtu":
        meshio.vtu.write(path, mesh, binary=False)
    else:
        path.write_text(texts[suffix], encoding="utf-8")

    def read() -> list[Any]:
        if suffix == ".stl":
            places, ((_, cells),) = read_cells(path)
            return [places.tolist(), cells.tolist()]
        mesh = fem.read_mesh(path)
        return [mesh.p.tolist(), mesh.t.tolist()]

    before = read()
    mark(path)
    assert read() == before
    # The mark contradicts the encoding of the file.
    if suffix == ".inp":
        path.write_bytes(path.read_bytes().replace("ö".encode(), b"\xf6"))
        assert read() == before
    # The message has the name that the caller gave.
    path.write_bytes(path.read_bytes()[: len(path.read_bytes()) // 2])
    with pytest.raises(ValueError, match=str(path)):
        read()


@pytest.mark.parametrize("form", ["market", "both"])
def test_files_of_another_program(form: str, tmp_path: Path, bipot: Any) -> None:
    command, _ = written(tmp_path, "block", form=form)
    assert bipot(*command)[0] == 0
    before = bp.load(Path("out/K/result.h5"))
    for file in tmp_path.iterdir():
        if file.is_file():
            mark(file)
    shutil.rmtree("out")
    status, _, err = bipot(*command)
    assert status == 0, err
    after = bp.load(Path("out/K/result.h5"))
    assert after.reaction.tobytes() == before.reaction.tobytes()


@pytest.mark.slow
def test_tables_of_sweeps(bipot: Any) -> None:
    sweep = ("sweep", "pressed_block", "--set", "mesh.n=2", "--jobs", "1")
    sweep += ("--set", "contact.0.mu=0.1,0.2")
    assert bipot(*sweep)[0] == 0
    mark(Path("out/pressed_block-sweep/sweep.csv"))
    status, _, err = bipot(*sweep, "--resume")
    assert status == 0
    assert "2 of 2 rows are already finished" in err


def test_temporary_copies_are_removed(tmp_path: Path) -> None:
    path = tmp_path / "K.mtx"
    mmwrite(path, sparse.identity(2, format="coo"))
    with strip_mark(path) as source:
        assert source == path
    content = path.read_bytes()
    mark(path)
    with strip_mark(path) as source:
        assert source != path
        assert source.name == path.name
        assert source.read_bytes() == content
    assert not source.parent.exists()
