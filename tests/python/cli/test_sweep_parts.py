"""A study in parts, as a job array solves it, and joined to the files of one sweep."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import Any

import pytest

from bipot_rs.cli.study.plan import StudyPart, deal, part
from support.comparisons import content
from support.pushed_study import PUSHED, table

Bipot = Callable[..., tuple[int, str, str]]
STUDY = (
    *("sweep", "push.toml", "--set", "contact.0.mu=0.1,0.3,0.5", "--set", "mesh.n=4,6"),
)


def files(folder: Path) -> dict[str, Any]:
    """Everything in a folder but parts, and times."""
    contents: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if path.is_dir() or name.parts[0].startswith("part-"):
            continue
        whole = content(path) if path.suffix == ".h5" else path.read_bytes()
        contents[str(name)] = table(folder) if path.name == "sweep.csv" else whole
    return contents


@pytest.fixture(scope="module")
def array(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one sweep, and the same in three parts by three processes at a time."""
    cwd = tmp_path_factory.mktemp("array")
    (cwd / "push.toml").write_text(PUSHED)
    command = [sys.executable, "-m", "bipot_rs", *STUDY, "--jobs", "1", "--results"]
    more = [["--out", "whole"]]
    more += [["--out", "parts", "--part", f"{task}/3"] for task in (1, 2, 3)]
    to = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    tasks = [subprocess.Popen([*command, *words], cwd=cwd, **to) for words in more]
    for task in tasks:
        output, errors = task.communicate(timeout=120)
        # Some rows have no answer.
        assert task.returncode in (0, 1), (output, errors)
    return cwd


@pytest.fixture
def parts(array: Path, tmp_path: Path) -> Path:
    """A copy of the parts that a test may change."""
    shutil.copytree(array / "parts", tmp_path / "parts")
    (tmp_path / "push.toml").write_text(PUSHED)
    return tmp_path / "parts"


@pytest.mark.slow
def test_joined_parts_are_the_files_of_one_sweep(
    array: Path, parts: Path, bipot: Bipot
) -> None:
    numbers = [
        [int(row["row"]) for row in table(parts / f"part-{k}-of-3")] for k in (1, 2, 3)
    ]
    assert sorted(chain(*numbers)) == list(range(6))
    # Rows alternate between coarse and fine meshes: each part has one of both.
    assert [sorted(k % 2 for k in rows) for rows in numbers] == [[0, 1]] * 3
    status, output, errors = bipot("sweep", "--join", "parts")
    assert (status, errors) == (1, "")
    assert "2 of 6 rows solved; the table is parts/sweep.csv" in output
    whole, joined = files(array / "whole"), files(parts)
    results = [f"rows/{k:04d}/result.h5" for k in range(6)]
    assert sorted(joined) == [*results, "sweep.csv", "sweep.json"]
    assert joined == whole
    # Into another folder, from the folders of the parts in any order.
    names = [f"parts/part-{k}-of-3" for k in (3, 1, 2)]
    assert bipot("sweep", "--join", *names, "--out", "there")[0] == 1
    assert files(Path("there")) == whole
    # More parts than rows.
    study = ("sweep", "sheared_cube", "--set", "mesh.n=2", "--out", "few")
    for k in (1, 2):
        assert bipot(*study, "--part", f"{k}/2")[0] == 0
    status, output, _ = bipot("sweep", "--join", "few")
    assert status == 0
    assert "1 of 1 row solved" in output


@pytest.mark.parametrize(("meshes", "others"), [(4, 4), (3, 5), (5, 8), (1, 7)])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 8, 40])
def test_no_part_gets_all_large_rows(meshes: int, others: int, count: int) -> None:
    costs = [(10.0**k, 1) for _ in range(others) for k in range(meshes)]
    dealt = deal(costs, count)
    assert sorted(chain(*dealt)) == list(range(len(costs)))
    assert all(rows == sorted(rows) for rows in dealt)
    for mesh in range(meshes):
        share = [sum(k % meshes == mesh for k in rows) for rows in dealt]
        assert max(share) - min(share) <= 2
        assert max(share) <= -(-others // count) + 1
    assert max(map(len, dealt)) - min(map(len, dealt)) <= 1


def test_wrong_parts() -> None:
    for text, why in (
        ("3", "expected I/N, as in 2/4"),
        ("a/b", "expected I/N"),
        ("-1/4", "expected I/N"),
        ("0/4", "I is 0, not between 1 and 4"),
        ("5/4", "I is 5, not between 1 and 4"),
        ("1/0", "N is 0, not between 1 and"),
    ):
        with pytest.raises(ValueError, match=f"--part {text}: {why}"):
            part(text)
    assert part(" 2/ 4") == StudyPart(2, 4)


@pytest.mark.slow
def test_missing_rows_are_marked_and_resumed(
    array: Path, parts: Path, bipot: Bipot
) -> None:
    """One part was killed after its first row, and one never began."""
    lines = (parts / "part-1-of-3" / "sweep.csv").read_text().splitlines(True)
    (parts / "part-1-of-3" / "sweep.csv").write_text("".join(lines[:2]))
    lacking = [int(lines[2].split(",")[0])]
    lacking += [int(r["row"]) for r in table(parts / "part-3-of-3")]
    shutil.rmtree(parts / "part-3-of-3")
    status, output, _ = bipot("sweep", "--join", "parts")
    assert status == 3
    assert "3 rows missing: row " in output
    assert f"row {lacking[0] + 1} (parts/part-1-of-3 does not have it yet)" in output
    numbers = ", ".join(str(k + 1) for k in sorted(lacking[1:]))
    assert f"row {numbers} (part 3/3 was not joined)" in output
    rows = table(parts)
    assert [int(row["row"]) for row in rows] == list(range(6))
    missing = [int(row["row"]) for row in rows if row["outcome"] == "missing"]
    assert missing == sorted(lacking)
    # The joined table is continued like any other ...
    more = (*STUDY, "--jobs", "1", "--results", "--resume")
    shutil.copytree(parts, "copy")
    assert "3 of 6 rows are already finished" in bipot(*more, "--out", "copy")[2]
    assert table("copy") == table(array / "whole")
    # ... and so are the parts; one that never began starts.
    errors = bipot(*more, "--out", "parts", "--part", "1/3")[2]
    assert "1 of 2 rows are already finished" in errors
    errors = bipot(*more, "--out", "parts", "--part", "3/3")[2]
    assert "there is no parts/part-3-of-3/sweep.csv to resume" in errors
    assert bipot("sweep", "--join", "parts")[0] == 1
    assert table(parts) == table(array / "whole")


ROWS, RECORD = "part-1-of-3/sweep.csv", "part-2-of-3/sweep.json"
OTHER = "parts/part-2-of-3 belongs to another study than parts/part-1-of-3: "


def record(**changes: Any) -> Callable[[str], str]:
    return lambda text: json.dumps(json.loads(text) | changes)


def with_row_of_another_part(text: str) -> str:
    first = text.splitlines(True)[1]
    (number, *_) = {str(k) for k in range(6)} - set(re.findall(r"(?m)^\d", text))
    return text + number + first[1:]


# A file, its change, and the message.
SPOILT: list[tuple[str, Callable[[str], str], str]] = [
    (
        RECORD,
        record(study="0", settings=["contact.0.mu=0.1,0.3,0.6", "mesh.n=4,6"]),
        rf"{OTHER}settings \['contact.0.mu=0.1,0.3,0.6', 'mesh.n=4,6'\] instead of ",
    ),
    (
        RECORD,
        record(study="0"),
        f"{OTHER}the scene file, one of its meshes or the version of bipot_rs was another",
    ),
    (
        RECORD,
        record(part="2/4"),
        "parts/part-2-of-3 is part 2/4, but parts/part-1-of-3 is part 1/3",
    ),
    (
        RECORD,
        record(part="1/3"),
        "part 1/3 is both in parts/part-1-of-3 and in parts/part-2-of-3: name one",
    ),
    (ROWS, lambda t: t + t.splitlines(True)[1], rf"{ROWS}: row \d is there twice"),
    (ROWS, with_row_of_another_part, rf"{ROWS}: row \d is not in part 1/3"),
    (
        ROWS,
        lambda t: re.sub(r"(?m)^(\d),0\.", r"\1,1.", t, count=1),
        rf"{ROWS}: row \d has other settings than in",
    ),
    ("part-1-of-3/sweep.json", lambda t: t[:-20], "part-1-of-3/sweep.json is damaged"),
]


@pytest.mark.slow
def test_what_does_not_belong_together_is_refused(parts: Path, bipot: Bipot) -> None:
    for name, change, why in SPOILT:
        right = (parts / name).read_text()
        (parts / name).write_text(change(right))
        status, output, errors = bipot("sweep", "--join", "parts", "--out", "there")
        assert (status, output) == (2, "")
        assert re.search(why, errors), errors
        assert not Path("there").exists()
        (parts / name).write_text(right)


@pytest.mark.slow
def test_wrong_arguments_of_join(array: Path, parts: Path, bipot: Bipot) -> None:
    Path("empty").mkdir()
    shutil.copytree(array / "whole", "whole")
    shutil.copytree(parts / "part-2-of-3", "copy")
    for arguments, why in (
        (("nothing",), "there is no folder nothing"),
        (("empty",), "empty is not the folder of a sweep: it has no sweep.json"),
        (("whole",), "whole is the folder of a whole sweep, expected one of a part"),
        (("parts", "parts/part-1-of-3"), "parts/part-1-of-3 is named twice"),
        (("parts", "--resume"), "there is no option --resume"),
        (("parts", "--out", "parts/part-1-of-3"), "is the folder of a part"),
        (("parts/part-1-of-3", "copy"), "--out DIR is missing: the parts are in"),
    ):
        status, output, errors = bipot("sweep", "--join", *arguments)
        assert (status, output) == (2, "")
        assert why in errors
        status, output, _ = bipot("sweep", "--join", *arguments, "--json")
        assert status == 2
        last = json.loads(output)
        assert not last["ok"]
        assert why in last["message"]
