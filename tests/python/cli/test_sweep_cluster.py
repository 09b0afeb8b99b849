"""Rows on the workers of a dask scheduler: the same table, and rows that kill a worker."""

import json
import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from bipot_rs.cli.run.cost_forecast import assembly, size
from bipot_rs.cli.study.row import peak
from bipot_rs.cli.study.workers import Cluster
from bipot_rs.scene import read
from support.comparisons import content
from support.dask_workers import row, solved_then_killed, two_workers
from support.pushed_study import PUSHED, interrupt_sweep, table

distributed = pytest.importorskip("distributed", exc_type=ImportError)
# The clusters are shared by the tests of one process.
pytestmark = pytest.mark.xdist_group("cluster")

Bipot = Callable[..., tuple[int, str, str]]
STUDY = ("sweep", "push.toml", "--set", "contact.0.mu=0.1,0.3,0.5")
CUBE = ("sweep", "sheared_cube", "--set")
MEMORY = 2e9


@pytest.fixture(scope="module")
def strict(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Workers that declare their memory; dask does not repeat a task that killed one."""
    with two_workers(tmp_path_factory.mktemp("strict"), memory=MEMORY) as address:
        yield address


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Workers as dask starts them: no resources, and three repetitions."""
    with two_workers(tmp_path_factory.mktemp("plain"), failures=3) as address:
        yield address


@pytest.mark.slow
def test_rows_are_those_of_this_machine(
    strict: str, tmp_path: Path, bipot: Bipot
) -> None:
    (tmp_path / "push.toml").write_text(PUSHED)
    assert bipot(*STUDY, "--out", "here", "--jobs", "1")[0] == 1
    status, _, errors = bipot(*STUDY, "--out", "there", "--scheduler", strict)
    assert status == 1
    assert "memory" not in errors
    assert table("there") == table("here")
    names = sorted(str(p.relative_to("here")) for p in Path("here").rglob("result.h5"))
    assert names == [f"rows/{k:04d}/result.h5" for k in (0, 1)]
    for name in names:
        own, other = content(Path("here") / name), content(Path("there") / name)
        # The workers know the scene by its whole path.
        assert other.pop("@scene") == str(tmp_path / own.pop("@scene"))
        assert own == other


@pytest.mark.slow
def test_workers_without_memory(plain: str, tmp_path: Path, bipot: Bipot) -> None:
    file = tmp_path / "scheduler.json"
    file.write_text(json.dumps({"address": plain}))
    more = ("--set", "contact.0.mu=0.3", "--scheduler", str(file), "--json")
    status, output, _ = bipot(*CUBE, "mesh.n=2,3", *more)
    assert status == 0
    *rows, last = map(json.loads, output.splitlines())
    assert sorted(row["row"] for row in rows) == [0, 1]
    assert last["solved"] == 2
    errors = bipot(*CUBE, "mesh.n=2", "--scheduler", plain)[2]
    assert 'start workers with --resources "memory=BYTES"' in errors


@pytest.mark.parametrize("which", ["strict", "plain"])
@pytest.mark.slow
def test_a_killed_row_loses_itself_alone(
    which: str, request: pytest.FixtureRequest
) -> None:
    asked = [(number, (3, 4)) for number in (*range(12), 99)]
    with Cluster(request.getfixturevalue(which), lambda _: None) as cluster:
        results = dict(cluster.map(row, asked))
    died = "its worker died, probably because memory ran out"
    assert results.pop(3) == results.pop(4) == died
    assert results.pop(12) == "RuntimeError: no"
    numbers = {k: answer[0] for k, answer in results.items()}
    assert numbers == {k: k for k in (0, 1, 2, *range(5, 12))}


@pytest.mark.slow
def test_a_result_lost_with_its_worker_is_computed_again(
    strict: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The worker dies between the end of the row and the transfer of its result."""
    original = Cluster._take_finished

    def late(self: Cluster) -> list[Any]:
        # All rows end in this time, and the worker dies in the next.
        time.sleep(0.5)
        result = original(self)
        time.sleep(1.0)
        return result

    monkeypatch.setattr(Cluster, "_take_finished", late)
    asked = [(number, tmp_path) for number in range(4)]
    with Cluster(strict, lambda _: None) as cluster:
        # Less than the row takes the second time.
        monkeypatch.setattr("bipot_rs.cli.study.workers._CONNECT", 1.0)
        result = dict(cluster.map(solved_then_killed, asked))
        monkeypatch.undo()
    assert result == {number: number for number in range(4)}


@pytest.mark.slow
def test_a_row_larger_than_any_worker_is_not_waited_for(strict: str) -> None:
    with Cluster(strict, lambda _: None) as cluster:
        assert cluster.declares_memory()
        needs = [MEMORY, 2 * MEMORY, 0.75 * MEMORY, 0.0]
        results = dict(cluster.map(row, [(k,) for k in range(4)], needs))
    told = "it needs 4 GB of memory, but no worker declares more than 2 GB"
    assert results[1] == told
    assert [results[k][0] for k in (0, 2, 3)] == [0, 2, 3]


@pytest.mark.slow
def test_the_forecast_of_a_row_chooses_its_worker(tmp_path: Path, bipot: Bipot) -> None:
    forecast = [peak("sheared_cube", {"mesh.n": n}) for n in ("2", "6")]
    stiffness = assembly(read("sheared_cube", ["mesh.n=6"]))
    # Its assembly alone would fit: the forecast counts the condensation as well.
    assert max(forecast[0], stiffness) < 2e6 < forecast[1]
    with two_workers(tmp_path, memory=2e6) as address:
        more = ("--out", "here", "--scheduler", address)
        assert bipot(*CUBE, "mesh.n=2,6", *more)[0] == 3
    rows = table("here")
    assert [row["outcome"] for row in rows] == ["solved", "lost"]
    need = f"it needs {size(forecast[1])} of memory"
    assert rows[1]["message"] == f"{need}, but no worker declares more than 2 MB"


@pytest.mark.slow
def test_ctrl_c_keeps_finished_rows_and_cancels_the_others(
    strict: str, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "bipot_rs", *CUBE, "mesh.n=8", "--json"]
    command += ["--scheduler", strict, "--out", "here"]
    command += ["--range", "contact.0.mu=0.1:0.6:60"]
    told = interrupt_sweep(command, tmp_path)
    assert 1 <= len(told) <= len(table(tmp_path / "here")) < 60
    with distributed.Client(strict, set_as_default=False) as client:
        # Rows that were handed over but had not begun are gone.
        assert sum(map(len, client.processing().values())) <= 2


@pytest.mark.slow
def test_a_scheduler_that_goes(tmp_path: Path) -> None:
    with two_workers(tmp_path) as address:
        cluster = Cluster(address, lambda _: None)
        answers = cluster.map(row, [(k,) for k in range(1000)])
        next(answers)
    with pytest.raises(OSError, match="the scheduler has gone; finished rows are in"):
        for _ in answers:
            pass
    cluster.__exit__()


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("nonsense", "expected an address as tcp://HOST:8786, or a scheduler file"),
        ("tcp://localhost:", "expected an address as tcp://HOST:8786"),
        # Port 9 discards what it gets, and is closed on most machines.
        ("127.0.0.1:9", "no dask scheduler answers within 0.5 s"),
        ("some.json", "is not a scheduler file of dask"),
    ],
)
@pytest.mark.slow_variants("nonsense-*")
def test_wrong_addresses(
    address: str, why: str, bipot: Bipot, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("some.json").write_text("{}")
    monkeypatch.setattr("bipot_rs.cli.study.workers._CONNECT", 0.5)
    status, output, errors = bipot(*CUBE, "mesh.n=2,3", "--scheduler", address)
    assert (status, output) == (2, "")
    assert re.search(f"--scheduler {re.escape(address)}:? {re.escape(why)}", errors)
    # Nothing is written before the scheduler answers.
    assert [path.name for path in Path().iterdir()] == ["some.json"]
