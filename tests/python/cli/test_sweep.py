"""One scene under many settings: the combinations, the table, failures, interrupts."""

import csv
import json
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bipot_rs.cli.study.folder import write as write_table
from bipot_rs.cli.study.plan import list_rows, space_values, values
from bipot_rs.cli.study.workers import Workers
from support.pushed_study import interrupt_sweep

Bipot = Callable[..., tuple[int, str, str]]
SWEEP = ("sweep", "sheared_cube", "--set", "mesh.n=3")


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "sweep.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_values_of_settings_and_ranges() -> None:
    for setting, key, found in (
        ("mesh.n=4,8", "mesh.n", ["4", "8"]),
        ("a.b=[0,0,1],[0,1,0]", "a.b", ["[0,0,1]", "[0,1,0]"]),
        ("a=\"x,y\",'z,'", "a", ['"x,y"', "'z,'"]),
        ("a={ x = 1, y = 2 }", "a", ["{ x = 1, y = 2 }"]),
    ):
        assert values(setting) == (key, found)
    for setting, found in (
        ("n=4:16:4", ["4", "8", "12", "16"]),
        ("n=4:5:3", ["4.0", "4.5", "5.0"]),
        ("mu=0.1:0.5:5", ["0.1", "0.2", "0.3", "0.4", "0.5"]),
        ("mu=0.5:0.1:2", ["0.5", "0.1"]),
        ("mu=1e-3:1e-3:1", ["0.001"]),
        ("n=-2:2:5", ["-2", "-1", "0", "1", "2"]),
    ):
        assert space_values(setting)[1] == found
    for setting, why in (
        ("4:9:4", "KEY is missing"),
        ("n=4:9", "has 2 parts instead of three"),
        ("n=4:9:0.5", "FROM and TO must be numbers, COUNT an integer"),
        ("n=4:9:0", "COUNT is 0, not between 1 and 100000"),
        ("=1:2:3", "KEY is missing"),
        ("mu=nan:1:3", "a value is beyond 1e300"),
        ("mu=1:2:1", "COUNT is 1, but FROM 1.0 and TO 2.0 differ"),
    ):
        with pytest.raises(ValueError, match=f"--range {setting}: {why}"):
            space_values(setting)


def test_a_damaged_table_is_named(bipot: Bipot) -> None:
    path = Path("here/sweep.csv")
    path.parent.mkdir()
    # The table of a sweep of two rows, without its numbers.
    done = {
        k: {"contact.0.mu": mu, "outcome": "solved", "message": "", "digest": str(k)}
        for k, mu in enumerate(("0.2", "0.3"))
    }
    write_table(path, ["contact.0.mu"], done)
    table = path.read_text()
    resume = (*SWEEP, "--set", "contact.0.mu=0.2,0.3", "--out", "here", "--resume")
    plot = ("plot", "here", "--x", "contact.0.mu", "--y", "steps")
    for damaged, why in (
        ("".join(table.splitlines(True)[:-1]) + "1,0.3", "row 2 does not have"),
        (table.replace("row,", "raw,"), "not the table of a sweep"),
        (table[:-4] + '"open', "is damaged"),
        ("", "not the table of a sweep"),
    ):
        path.write_text(damaged)
        for words in (resume, plot):
            status, out, err = bipot(*words)
            assert (status, out) == (2, "")
            assert "here/sweep.csv" in err
            assert why in err


def test_combinations() -> None:
    rows = [(row["a"], row["b"]) for row in list_rows(["a=1,2"], ["b=0:1:3"])]
    assert rows == [(a, b) for a in ("1", "2") for b in ("0.0", "0.5", "1.0")]
    many = "1000000 combinations, expected at most 100000"
    for settings, message in (
        ((["a=1", "a=2"], []), "a is given 2 times"),
        (([], []), "nothing varies"),
        ((["a=1,,2"], []), "expected KEY=V1,V2"),
        ((["a"], []), "expected KEY=V1,V2"),
        (([], ["a=0:1:1000", "b=0:1:1000"]), many),
    ):
        with pytest.raises(ValueError, match=message):
            list_rows(*settings)


def test_rows_are_those_of_single_runs(bipot: Bipot) -> None:
    words = ("--set", "contact.0.mu=0.2,0.9,-1", "--jobs", "2", "--json")
    status, out, _ = bipot(*SWEEP, *words)
    assert status == 2
    *told, last = map(json.loads, out.splitlines())
    assert (last["rows"], last["solved"]) == (3, 2)
    assert sorted(row["row"] for row in told) == [0, 1, 2]
    rows = table(Path("out/sheared_cube-sweep"))
    assert [row["outcome"] for row in rows] == ["solved", "solved", "bad input"]
    message = rows[2]["message"]
    assert "contact.0.mu: should be greater than or equal to 0" in message
    for row in rows[:2]:
        mu = f"contact.0.mu={row['contact.0.mu']}"
        out = bipot("run", "sheared_cube", *SWEEP[2:], "--set", mu, "--json")[1]
        step = json.loads(out.splitlines()[1])
        for name in ("open", "slip", "stick"):
            assert int(row[name]) == step[name]
        with Path("out/sheared_cube/steps.csv").open(newline="") as file:
            *_, same = csv.DictReader(file)
        # Bitwise the same with one thread and with several.
        for name in ("tangential_force", "normal_force", "friction_used"):
            key = f"{name} of cube.bottom"
            assert row[key] == same[key]


def test_a_scheduler_needs_dask(bipot: Bipot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    status, _, err = bipot(*SWEEP, "--scheduler", "tcp://localhost:8786")
    assert status == 2
    assert "not installed: run pip install 'bipot-rs[cluster]'" in err
    assert list(Path().iterdir()) == []


@pytest.mark.slow
def test_ctrl_c_keeps_finished_rows_and_resume_continues(
    tmp_path: Path, bipot: Bipot
) -> None:
    command = [*SWEEP, "--range", "contact.0.mu=0.1:0.6:6", "--jobs", "1"]
    command += ["--out", "here"]
    python = [sys.executable, "-m", "bipot_rs"]
    told = interrupt_sweep([*python, *command, "--json"], tmp_path)
    done = table(tmp_path / "here")
    assert 1 <= len(told) <= len(done) < 6
    names = sorted(path.name for path in (tmp_path / "here").iterdir())
    assert names == ["sweep.csv", "sweep.json"]
    # A finished row is not solved again: its seconds are unchanged.
    status, _, err = bipot(*command, "--resume")
    assert status == 0, err
    assert f"{len(done)} of 6 rows" in err
    whole = table(tmp_path / "here")
    assert [row["row"] for row in whole] == [str(k) for k in range(6)]
    assert whole[: len(done)] == done
    assert {row["outcome"] for row in whole} == {"solved"}
    # No row remains; and rows of another scene do not count.
    status, _, err = bipot(*command, "--resume", "--tol", "1e-9")
    assert status == 0
    assert "are already finished" not in err
    assert table(tmp_path / "here")[0]["digest"] != whole[0]["digest"]


def work(k: int) -> Any:
    """One of four kinds of work in a separate process."""
    if k == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if k == 2:
        raise RuntimeError("no")
    if k == 4:
        os._exit(7)
    return os.getpid(), os.environ["BIPOT_NUM_THREADS"]


@pytest.mark.slow
def test_a_killed_worker_is_reported_and_replaced() -> None:
    with Workers(work, 1) as workers:
        results = dict(workers.map([(k,) for k in range(6)]))
    assert sorted(results) == list(range(6))
    assert (
        results[1]
        == "its process was killed by SIGKILL, probably because memory ran out"
    )
    assert results[2] == "RuntimeError: no"
    assert results[4] == "its process ended with status 7"
    # A process that is not killed serves the next argument.
    assert results[3][0] != results[0][0]
    assert results[5][0] != results[3][0]
    assert {results[k][1] for k in (0, 3, 5)} == {"1"}
    assert "BIPOT_NUM_THREADS" not in os.environ or os.environ["BIPOT_NUM_THREADS"]


def sleep() -> None:
    """Work whose result is not awaited."""
    time.sleep(60)


def test_leaving_ends_the_workers() -> None:
    started = time.monotonic()
    with Workers(sleep, 2) as workers:
        iterator = workers.map([(), ()])
        # Start, and leave before a result arrives.
        connection = workers._idle({})
        connection.send(())
        processes = list(workers.processes.values())
        del iterator
    assert all(not process.is_alive() for process in processes)
    assert time.monotonic() - started < 30
