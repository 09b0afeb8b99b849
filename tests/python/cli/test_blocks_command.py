"""The command ``bipot blocks``."""

import json
from pathlib import Path
from typing import Any

import pytest

from support.places import ROOT

SHELF = str(ROOT / "docs" / "tutorials" / "shelf-stable.json")


def write_stack(folder: Path, overhang: float) -> str:
    """A stone of width 2 and height 1 on another of width 1, beyond it by an overhang."""
    x = overhang
    outlines = {
        "foot": [[-1, -1], [0, -1], [0, 0], [-1, 0]],
        "head": [[x - 2, 0], [x, 0], [x, 1], [x - 2, 1]],
    }
    blocks = [{"name": name, "points": points} for name, points in outlines.items()]
    file = folder / "stack.json"
    file.write_text(json.dumps({"blocks": blocks}))
    return str(file)


def test_a_support_by_the_key_of_its_node(bipot: Any, tmp_path: Path) -> None:
    data = json.loads(Path(SHELF).read_text())
    for key, node in data["data"]["graph"]["data"]["node"].items():
        node["block"]["data"].setdefault("attributes", {})["name"] = f"part {key}"
    file = tmp_path / "named.json"
    file.write_text(json.dumps(data))
    for name in ("0", "part 0"):
        status, out, _ = bipot("blocks", str(file), "--mu", "0.9", "--support", name)
        assert (status, out.splitlines()[1][:9]) == (0, "balanced:")
    assert out.startswith("BlockProblem(9 blocks, 15 interfaces, 60 contacts)\n")
    status, _, errors = bipot("blocks", SHELF, "--mu", "0.2", "--support", "0")
    assert status == 1
    assert "block '2' moves" in errors


def test_a_stone_that_stands(bipot: Any, tmp_path: Path) -> None:
    """Its centre is a quarter from the edge; a push of that over half the height topples it."""
    file = write_stack(tmp_path, 0.75)
    arguments = ("blocks", file, "--mu", "0.6", "--support", "foot")
    status, out, errors = bipot(*arguments, "--push", "1,0", "--ranges", "--json")
    assert (status, errors) == (0, "")
    report = json.loads(out)
    assert report["verdict"] == "balanced"
    assert report["margin"] > 0
    assert (report["blocks"], report["interfaces"], report["contacts"]) == (2, 1, 2)
    # The weight acts 0.25 from the right edge of the foot, at half the height of 1.
    assert report["largest_push"] == pytest.approx(0.5, rel=1e-6)
    assert "block 'head' moves along x by" in report["mechanism"]
    (interval,) = report["ranges"]
    assert interval["between"] == ["foot", "head"]
    assert [interval["least"], interval["largest"]] == pytest.approx([2, 2], rel=1e-6)
    status, out, _ = bipot(*arguments, "--push", "1,0", "--ranges")
    assert status == 0
    assert "balanced: " in out
    assert "(1, 0) may be added 0.5 times" in out


def test_without_a_limit_the_json_has_null(bipot: Any, tmp_path: Path) -> None:
    """A stone between two walls, which may press it as much as they like."""
    blocks = [
        {
            "name": name,
            "points": [[x, 0], [x + 1, 0], [x + 1, 1], [x, 1]],
            "support": name != "stone",
        }
        for x, name in enumerate(("left", "stone", "right"))
    ]
    file = tmp_path / "walls.json"
    file.write_text(json.dumps({"blocks": blocks}))
    arguments = ("blocks", str(file), "--mu", "0.5")
    status, out, _ = bipot(*arguments, "--push", "0,1", "--ranges", "--json")
    assert status == 0

    def refuse(constant: str) -> None:
        raise ValueError(constant)

    report = json.loads(out, parse_constant=refuse)
    assert report["largest_push"] is None
    assert [interval["largest"] for interval in report["ranges"]] == [None, None]
    status, out, _ = bipot(*arguments, "--push", "0,1", "--ranges")
    assert "a push along (0, 1) of any size is carried" in out
    assert "inf" in out


def test_a_stone_that_falls(bipot: Any, tmp_path: Path) -> None:
    file = write_stack(tmp_path, 1.25)
    arguments = ("blocks", file, "--mu", "0.6", "--support", "foot")
    status, out, errors = bipot(*arguments, "--out", "falls.png")
    assert status == 1
    assert out.split("\n")[-2] == "falls.png"
    assert Path("falls.png").stat().st_size > 0
    assert "block 'head' moves" in errors
    assert "down by" in errors
    status, out, errors = bipot(*arguments, "--json")
    assert (status, errors) == (1, "")
    report = json.loads(out)
    assert report["verdict"] == "none"
    assert report["margin"] < 0
    assert report["motion"]["foot"] == [0, 0, 0]
    # It turns clockwise, about the edge on its right.
    assert report["motion"]["head"][2] < 0
    assert "nothing stops this motion: block 'head' moves" in report["message"]


def test_mistakes(bipot: Any) -> None:
    held = (SHELF, "--support", "0")
    for words, message in (
        ((SHELF, "--mu", "0.9"), "no block is a support"),
        ((SHELF, "--mu", "0.9", "--support", "11"), "there is no block '11'"),
        (held, "required: --mu"),
        ((*held, "--mu", "-1"), "mu"),
        ((*held, "--mu", "1", "--push", "1,0"), "shape (2,)"),
        ((*held, "--mu", "0.2", "--push", "1,0"), "shape (2,)"),
        ((*held, "--mu", "1", "--push", "1,a"), "'a' is not a number"),
        ((*held, "--mu", "1", "--out", "a.xyz"), "a suffix of"),
        (("none.json", "--mu", "1", "--support", "0"), "No such file"),
    ):
        status, _, errors = bipot("blocks", *words)
        assert status == 2
        assert message in errors
