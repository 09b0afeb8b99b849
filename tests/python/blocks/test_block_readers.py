"""Blocks from files."""

import json
from pathlib import Path

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.blocks import Block, read
from support.masonry import box, find_balance
from support.places import DATA as ALL_DATA
from support.places import ROOT

DATA = ALL_DATA / "blocks"
SHELF = ROOT / "docs" / "tutorials" / "shelf-stable.json"


def test_an_assembly_of_compas() -> None:
    blocks, interfaces, _ = read(SHELF, density=2.0)
    assert len(blocks) == 9
    assert interfaces is None
    assert {block.name for block in blocks} == set(map(str, range(9)))
    assert {block.density for block in blocks} == {2.0}
    problem = bp.blocks.assemble(blocks, 0.9, supports=["0"])
    # As many as for tolerances from 1e-6 to 3e-2.
    assert len(problem.interfaces) == 15
    assert find_balance(problem)[0]


def test_interfaces_of_a_file() -> None:
    """An interlocking joint: those stored, and those found, which join what is coplanar."""
    blocks, stored, _ = read(DATA / "concave-short.json")
    found = bp.blocks.find_interfaces(blocks)
    assert (len(stored), len(found)) == (7, 6)

    def pressed(interfaces: list[bp.blocks.Interface]) -> np.ndarray:
        return sum(one.area * one.normal for one in interfaces)  # type: ignore[return-value]

    # Normals point from the first block, which is the other one in the file. Coordinates
    # have single precision.
    assert np.abs(pressed(stored) + pressed(found)).max() < 1e-6
    for interfaces in (stored, found):
        problem = bp.blocks.assemble(
            blocks, 0.84, supports=["0"], interfaces=interfaces
        )
        assert find_balance(problem)[0]


def test_names_and_supports_of_compas(tmp_path: Path) -> None:
    data = json.loads((DATA / "concave-short.json").read_text())
    nodes = data["data"]["graph"]["data"]["node"]
    nodes["0"]["is_support"] = True
    for key, node in nodes.items():
        node["block"]["data"]["attributes"]["name"] = f"part {key}"
    file = tmp_path / "named.json"
    file.write_text(json.dumps(data))
    blocks, _, keys = read(file)
    told = {(block.name, block.support) for block in blocks}
    assert told == {("part 0", True), ("part 1", False)}
    # A support may be named by the key of its node, as in the scripts of COMPAS.
    assert keys == {"0": "part 0", "1": "part 1"}


def test_points_in_json(tmp_path: Path) -> None:
    file = tmp_path / "blocks.json"
    low, high = [[0, 0], [1, 0], [0, -1]], [[0, 0], [1, 0], [0, 1]]
    given = [{"name": "ground", "points": low, "support": True}]
    given += [{"name": "a", "points": high, "density": 3}]
    file.write_text(json.dumps({"blocks": given}))
    ground, stone = read(file, density=2.0).blocks
    assert (ground.support, ground.density) == (True, 2.0)
    assert (stone.support, stone.density, stone.volume) == (False, 3.0, 0.5)


def faces_of(block: Block) -> str:
    return "".join(f"f {' '.join(f'{k + 1}//1' for k in f)}\n" for f in block.faces)


def corners_of(block: Block) -> str:
    return "".join("v {} {} {}\n".format(*x) for x in block.points.tolist())


def test_objects_of_an_obj_file(tmp_path: Path) -> None:
    """Numbers of corners count over all objects, or backwards."""
    low, high = box("foot", (0, 0, 0), (1, 1, 1)), box("head", (0, 0, 1), (1, 1, 2))
    backwards = "".join(
        f"f {' '.join(str(k - 8) for k in face)}\n" for face in high.faces
    )
    file = tmp_path / "two.obj"
    file.write_text(
        f"# two\no foot\n{corners_of(low)}{faces_of(low)}o head\n{corners_of(high)}{backwards}"
    )
    blocks = read(file).blocks
    assert [block.name for block in blocks] == ["foot", "head"]
    assert [block.centre[2] for block in blocks] == [0.5, 1.5]
    file.write_text(corners_of(low) + faces_of(low).replace("f 1//1", "f 99//1"))
    with pytest.raises(
        ValueError, match="a face of block '0' has a corner that is not"
    ):
        read(file)


def test_surfaces_of_an_stl_file(tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    lines = ["solid s"]
    for block in (box("", (0, 0, 0), (1, 1, 1)), box("", (0, 0, 1.00001), (1, 1, 2))):
        for face in block.faces:
            for part in (face[[0, 1, 2]], face[[0, 2, 3]]):
                lines += ["facet normal 0 0 0", "outer loop"]
                lines += ["vertex {} {} {}".format(*block.points[k]) for k in part]
                lines += ["endloop", "endfacet"]
    file = tmp_path / "two.stl"
    file.write_text("\n".join([*lines, "endsolid s", ""]))
    blocks = read(file).blocks
    assert [block.name for block in blocks] == ["0", "1"]
    assert sum(block.volume for block in blocks) == pytest.approx(2 - 1e-5, rel=1e-7)
    (shared,) = bp.blocks.find_interfaces(blocks)
    assert len(shared.points) == 4


BROKEN: list[tuple[str, str, str]] = [
    ("a.json", "{", "a.json is not JSON: Expecting"),
    ("a.json", "{}", "nor a list 'blocks': 'data' is missing"),
    ("a.json", "[]", "nor a list 'blocks': list indices"),
    ("a.json", '{"blocks": []}', "has no blocks"),
    ("a.json", '{"blocks": [{"nam": 1}]}', "unexpected keyword argument 'nam'"),
    ("a.json",
     '{"data": {"graph": {"data": {"node": [], "edge": {}}}}}', "'blocks': 'list' object"),
    ("a.obj", "v 0 0 0\n", "has no blocks"),
    ("a.obj", "o a\nv 0 0 b\n", r"a.obj cannot be read at line 2, 'v 0 0 b'"),
    ("a.obj", "v 0 0\n", r"a.obj cannot be read at line 1, 'v 0 0'"),
    ("a.obj", "v 0 0 0\nf 1 a\n", r"a.obj cannot be read at line 2, 'f 1 a'"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "message"), BROKEN)
def test_files_without_blocks(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=message):
        read(tmp_path / name)


def test_a_file_that_is_no_text_is_named(tmp_path: Path) -> None:
    file = tmp_path / "binary.json"
    file.write_bytes(b"\xff\xfe{")
    with pytest.raises(ValueError, match=r"binary\.json is not JSON"):
        read(file)


def test_two_objects_of_one_name_are_refused(tmp_path: Path) -> None:
    faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    file = tmp_path / "twins.obj"
    file.write_text(f"o stone\n{faces}o stone\n{faces}", encoding="utf-8")
    with pytest.raises(
        ValueError, match=r"line 10, 'o stone': another object has this"
    ):
        read(file)
    file.write_text(f"o stone\ng stone\n{faces}", encoding="utf-8")
    assert [block.name for block in read(file).blocks] == ["stone"]
