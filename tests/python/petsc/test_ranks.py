"""The agreement of ranks, with threads in place of processes of MPI."""

import threading
import time
from collections import Counter
from collections.abc import Callable
from itertools import chain
from types import SimpleNamespace
from typing import Any

import pytest

from bipot_rs.cli.exit_codes import BAD_INPUT, NOT_CONVERGED
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.petsc.run import ranks
from bipot_rs.petsc.run.ranks import OtherRankError, World

COUNT = 3


class Killed(BaseException):
    """What a rank raises here instead of ending its process."""


class Shared:
    """What the ranks of a communicator have in common."""

    def __init__(self) -> None:
        self.barrier = threading.Barrier(COUNT)
        self.values: list[Any] = [None] * COUNT
        self.arrived: Counter[int] = Counter()
        self.lock = threading.Lock()


class Communicator:
    """The part of mpi4py's that is used, for one thread."""

    def __init__(self, shared: Shared, rank: int) -> None:
        self.shared, self.rank, self.size = shared, rank, COUNT
        self.turns = 0

    def Ibarrier(self) -> Any:
        with self.shared.lock:
            self.turns += 1
            self.shared.arrived[self.turns] += 1
        turn = self.turns
        return SimpleNamespace(Test=lambda: self.shared.arrived[turn] == COUNT)

    def allgather(self, value: Any) -> list[Any]:
        self.shared.values[self.rank] = value
        self.shared.barrier.wait(20)
        values = list(self.shared.values)
        self.shared.barrier.wait(20)
        return values

    def bcast(self, value: Any, root: int) -> Any:
        return self.allgather(value)[root]

    def Abort(self, status: int) -> None:
        raise Killed(status)


class Mpi:
    """The module of mpi4py, for one thread."""

    COMM_TYPE_SHARED = 0

    def __init__(self, both: tuple[Shared, Shared], rank: int) -> None:
        world, last = (Communicator(shared, rank) for shared in both)
        self.COMM_WORLD = self
        world.Dup = lambda: last  # type: ignore[attr-defined]
        world.Split_type = lambda _: world  # type: ignore[attr-defined]
        self.Dup = lambda: world


def played(part: Callable[[World], Any]) -> list[Any]:
    """What each rank returns or raises, and the messages of ranks that end the others."""
    both = Shared(), Shared()
    ends: list[Any] = [None] * COUNT
    heard: list[Any] = []

    def said(error: BaseException) -> tuple[int, str]:
        return (130 if isinstance(error, KeyboardInterrupt) else 2), str(error)

    def play(rank: int) -> None:
        tell = lambda *words: heard.append(words)  # noqa: E731
        world = World(Mpi(both, rank), Interrupts(), said, tell)
        try:
            ends[rank] = part(world)
        except BaseException as error:  # noqa: BLE001 - what the test asks about
            ends[rank] = error

    threads = [threading.Thread(target=play, args=(rank,)) for rank in range(COUNT)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    return [*ends, heard]


def test_all_go_on_if_none_fails() -> None:
    def part(world: World) -> str:
        with world.together():
            pass
        with world.together(held=True):
            pass
        return world.broadcast(f"from {world.number}")

    assert played(part) == ["from 0"] * COUNT + [[]]


def test_an_error_of_one_rank_is_raised_by_all() -> None:
    def part(world: World) -> None:
        with world.together():
            if world.number == 1:
                raise OSError("no such file")

    *ends, heard = played(part)
    for end in ends:
        assert isinstance(end, OtherRankError)
        assert end.status == BAD_INPUT
        assert str(end) == "rank 1 of 3: no such file"
    assert heard == []


def test_an_error_in_an_outer_part_meets_the_others_in_an_inner_one() -> None:
    """As between the outer phase and the agreement after a load step."""
    kept = []

    def part(world: World) -> None:
        with world.together():
            if world.number == 0:
                raise OSError("before the inner part")
            with world.together():
                kept.append(world.number)

    *ends, heard = played(part)
    assert {str(end) for end in ends} == {"rank 0 of 3: before the inner part"}
    assert heard == []
    assert sorted(kept) == [1, 2]


def test_all_go_on_after_an_error_in_an_inner_part() -> None:
    def part(world: World) -> str:
        with pytest.raises(OtherRankError), world.together(), world.together():  # noqa: PT012
            if world.number == 0:
                raise OSError("first")
        with pytest.raises(OtherRankError), world.together():  # noqa: PT012
            if world.number == 0:
                raise OSError("outer")
            with world.together(), world.together():
                pass
        with pytest.raises(OtherRankError), world.together():  # noqa: PT012
            if world.number == 1:
                raise OSError("again")
        with world.together():
            pass
        return "done"

    assert played(part) == ["done"] * COUNT + [[]]


def same_error(world: World, _: list[int]) -> None:
    with world.together():
        raise MemoryError("too large")


def signal_between(world: World, done: list[int]) -> None:
    with world.together():
        if world.number == 2:
            world._signals._handle(15, None)
    done.append(world.number)


def signal_while_files_are_written(world: World, done: list[int]) -> None:
    signals = world._signals
    signals.hold()
    with world.together():
        if world.number == 2:
            signals._handle(15, None)
    with world.together():
        signals.release()
    done.append(world.number)


def signal_in_a_step(world: World, done: list[int]) -> None:
    """It stops all after the step."""
    with world.together(held=True):
        if world.number == 1:
            world._signals._handle(2, None)
        done.append(world.number)


@pytest.mark.parametrize(
    ("part", "error", "finished"),
    [
        (same_error, MemoryError, []),
        (signal_between, KeyboardInterrupt, []),
        (signal_while_files_are_written, KeyboardInterrupt, []),
        (signal_in_a_step, KeyboardInterrupt, list(range(COUNT))),
    ],
)
def test_all_ranks_raise_the_same_error(
    part: Any, error: type[Exception], finished: list[int]
) -> None:
    done: list[int] = []
    *ends, _ = played(lambda world: part(world, done))
    assert [type(end) for end in ends] == [error] * COUNT
    assert sorted(done) == finished


def test_ranks_with_other_files_are_refused() -> None:
    def part(world: World) -> None:
        world.check_same(
            "a" if world.number < 2 else "b", "reads another scene than rank 0"
        )

    *ends, _ = played(part)
    assert {str(end) for end in ends} == {"rank 2 of 3 reads another scene than rank 0"}


def test_a_rank_that_fails_while_others_wait_ends_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The others do not come to the agreement: they wait for the rank elsewhere."""
    monkeypatch.setattr(ranks, "PATIENCE", 0.2)
    released = threading.Event()
    began = time.monotonic()

    def part(world: World) -> None:
        if world.number != 1:
            released.wait(10)
            return
        try:
            with world.together():
                raise ValueError("one alone")
        finally:
            released.set()

    *ends, heard = played(part)
    assert time.monotonic() - began < 5
    assert isinstance(ends[1], Killed)
    assert ends[1].args == (2,)
    assert heard == [(2, "rank 1 of 3: one alone")]


def test_a_rank_that_leaves_early_with_an_error_ends_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ranks, "PATIENCE", 0.2)
    gone = threading.Event()

    def part(world: World) -> None:
        if world.number == 0:
            try:
                world.leave((NOT_CONVERGED, "stalled"))
            finally:
                gone.set()
        gone.wait(10)

    *ends, heard = played(part)
    assert isinstance(ends[0], Killed)
    assert heard == [(NOT_CONVERGED, "rank 0 of 3: stalled")]


def test_all_leave_together() -> None:
    *ends, heard = played(lambda world: world.leave((NOT_CONVERGED, "stalled")))
    assert ends == [None] * COUNT
    assert heard == []


def test_number_of_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    for given, expected in (
        ({}, (0, 1)),
        ({"OMPI_COMM_WORLD_RANK": "2", "OMPI_COMM_WORLD_SIZE": "4"}, (2, 4)),
        ({"PMI_RANK": "1", "PMI_SIZE": "2"}, (1, 2)),
        ({"SLURM_PROCID": "0"}, (0, 1)),
        ({"SLURM_PROCID": "3", "SLURM_STEP_NUM_TASKS": "8"}, (3, 8)),
    ):
        for name in chain(*ranks._LAUNCHERS):
            monkeypatch.delenv(name, raising=False)
        for name, value in given.items():
            monkeypatch.setenv(name, value)
        assert ranks.read_launcher() == expected
