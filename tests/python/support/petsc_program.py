"""Tasks that ranks of mpirun do together, one after another; `mpi.Ranks` starts them.

mpirun -n RANKS python -m mpi4py petsc_program.py FOLDER PARENT

It takes ``0001-given.npz``, ``0002-given.npz``, … of the folder as they appear, and writes
``0001-answer.npz``, …, until there is a file ``end``, or the process PARENT has ended.
"""

import contextlib
import itertools
import json
import os
import pickle
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy import sparse

from bipot_rs.petsc.library import load

PETSc, MPI = load()

from bipot_rs.petsc import ContactProblem  # noqa: E402
from bipot_rs.petsc.linear.options import _OURS  # noqa: E402

comm = MPI.COMM_WORLD
Given = dict[str, Any]


def matrix(given: Given, name: str) -> Any:
    arrays = tuple(given[f"{name}_{part}"] for part in ("data", "indices", "indptr"))
    return sparse.csr_array(arrays, shape=tuple(given[f"{name}_shape"]))


def rows_of(n: int, d: int) -> tuple[int, int]:
    """Rows of this rank: whole nodes, about the same number everywhere."""
    nodes = n // d
    return tuple(d * (nodes * k // comm.size) for k in (comm.rank, comm.rank + 1))


def distributed(given: Given, kind: Any = None) -> Any:
    """K in parts; each rank takes its rows only."""
    K = matrix(given, "K")
    d = int(given.get("d", 3))
    first, last = rows_of(K.shape[0], d)
    rows_of_rank = K[first:last]
    size = last - first, K.shape[0]
    made = (PETSc.Mat if kind is None else kind)()
    csr = (
        rows_of_rank.indptr.astype(PETSc.IntType),
        rows_of_rank.indices.astype(PETSc.IntType),
        rows_of_rank.data,
    )
    return made.createAIJ((size, size), bsize=d, csr=csr, comm=comm)


def vector(K: Any, values: Any) -> Any:
    made = K.createVecLeft()
    first, last = K.getOwnershipRange()
    made.array[:] = values[first:last]
    return made


def problem(given: Given, **other: Any) -> Any:
    K = other.pop("K") if "K" in other else distributed(given)
    B = other.pop("B") if "B" in other else matrix(given, "B")
    first, last = rows_of(matrix(given, "K").shape[0], int(given.get("d", 3)))
    arguments = {"gap": given["gap"], "mu": given["mu"], "fixed": given.get("fixed")}
    for name in ("cohesion", "dilatancy"):
        if name in given:
            arguments[name] = given[name]
    if "gather" in given:
        arguments["gather"] = int(given["gather"])
    if "coordinates" in given:
        arguments["coordinates"] = given["coordinates"][first:last]
    made = ContactProblem(K, B, **arguments | other)
    made.K = K
    return made


def whole(vec: Any) -> Any:
    return np.concatenate(comm.allgather(vec.array_r.copy()))


def answer(made: Any, result: Any) -> Given:
    """Arrays of a result; they must be the same on every rank, to the bit."""
    arrays = {
        name: getattr(result, name)
        for name in (
            "reaction",
            "relative_displacement",
            "slip",
            "status",
            "residual",
            "broken",
        )
    }
    for name, array in arrays.items():
        assert len(set(comm.allgather(array.tobytes()))) == 1, name
    arrays["displacement"] = np.array([whole(u) for u in result.displacement])
    arrays["iterations"] = result.iterations
    arrays["errors"] = np.array([step.error_estimate for step in result])
    stats = {k: v for k, v in made.stats.items() if isinstance(v, (int, float, str))}
    return arrays | {"stats": json.dumps(stats)}


def loads(given: Given, K: Any) -> Any:
    if "load" not in given:
        return None
    return [vector(K, load_of_step) for load_of_step in np.atleast_2d(given["load"])]


def solve(given: Given) -> Given:
    """A load path."""
    made = problem(given)
    tol = float(given.get("tol", 1e-12))
    result = made.solve(loads(given, made.K), given.get("prescribed"), tol=tol)
    return answer(made, result)


def unfactored(given: Given) -> Given:
    """A load path where the first rank fails to factor."""
    from bipot_rs.petsc.linear.preconditioner import OneRankFactor

    with patch.object(OneRankFactor, "_factor_rows", lambda *_: "no factor today"):
        return solve(given)


def refused_derivatives(given: Given) -> Given:
    """What a result says that has no derivatives."""
    made = problem(given)
    result = made.solve(loads(given, made.K))
    return {"message": _failure(lambda: result.jvp(load=loads(given, made.K)))}


def derivatives(given: Given) -> Given:
    """A tangent and a gradient of a load path."""
    made = problem(given)
    result = made.solve(loads(given, made.K), given.get("prescribed"), tol=1e-12)
    change = distributed({"d": given.get("d", 3)} | _renamed(given, "dK"))
    along = {
        name: given[f"along_{name}"]
        for name in ("prescribed", "gap", "mu", "cohesion", "dilatancy")
        if f"along_{name}" in given
    }
    force = [vector(made.K, vector_of_step) for vector_of_step in given["along_load"]]
    tangent = result.jvp(load=force, K=change, **along)
    cotangents = {
        name: given[f"by_{name}"]
        for name in ("reaction", "relative_displacement", "slip")
    }
    by = [vector(made.K, vector_of_step) for vector_of_step in given["by_displacement"]]
    gradient = result.vjp(displacement=by, **cotangents)
    pointer, column, values = gradient.K.getValuesCSR()
    n = made.K.getSize()[0]
    rows_of_rank = sparse.csr_array(
        (values, column, pointer), shape=(len(pointer) - 1, n)
    )
    stacked = sparse.vstack(comm.allgather(rows_of_rank)).toarray()
    arrays = {
        "reaction": tangent.reaction,
        "relative_displacement": tangent.relative_displacement,
        "slip": tangent.slip,
        "one_sided": tangent.one_sided,
        "by_gap": gradient.gap,
        "by_mu": gradient.mu,
        "by_cohesion": gradient.cohesion,
        "by_dilatancy": gradient.dilatancy,
        "by_prescribed": gradient.prescribed,
    }
    for name, array in arrays.items():
        assert len(set(comm.allgather(array.tobytes()))) == 1, name
    arrays["displacement"] = np.array([whole(u) for u in tangent.displacement])
    arrays["by_load"] = np.array([whole(f) for f in gradient.load])
    # A gradient has few parts without cotangents of the displacements: another way.
    alone = result.vjp(reaction=given["by_reaction"])
    arrays["by_load_of_reaction"] = np.array([whole(f) for f in alone.load])
    return arrays | {"by_K": stacked}


def _renamed(given: Given, name: str) -> Given:
    parts = ("data", "indices", "indptr", "shape")
    return {f"K_{part}": given[f"{name}_{part}"] for part in parts}


def _failure(work: Any) -> str:
    """Kind and message of an error, which all ranks must raise alike."""
    text = "nothing was raised"
    try:
        work()
    except Exception as error:  # noqa: BLE001 - the test looks at it
        text = f"{type(error).__name__}: {error}"
    everywhere = set(comm.allgather(text))
    assert len(everywhere) == 1, everywhere
    return text


def _wrong(given: Given, K: Any) -> dict[str, Any]:
    """Wrong calls by name; ``last`` is wrong on the last rank only."""
    n = K.getSize()[0]
    first, last = K.getOwnershipRange()
    alone = comm.rank == comm.size - 1
    gap, mu = given["gap"].copy(), given["mu"].copy()
    at = given["coordinates"][first:last].copy()
    far = at.copy()
    mixed = at.copy()
    if alone:
        far[-1] = np.inf
        mixed[-1] += 1.0
    other = gap + (1.0 if alone else 0.0)
    lopsided = K.copy()
    if alone:
        lopsided.setValue(last - 1, last - 2, 3.0 * float(given["K_data"].max()))
    lopsided.assemble()
    broken = K.copy()
    if alone:
        broken.setValue(last - 1, last - 1, np.nan)
    broken.assemble()
    return {
        "gap": {"gap": gap[1:]},
        "gap differs": {"gap": other},
        "mu": {"mu": -mu},
        "fixed": {"fixed": [n]},
        "area": {"area": 0 * gap},
        "gather": {"gather": -1},
        "gather differs": {"gather": 0 if alone else 1},
        "coordinates": {"coordinates": at[1:]},
        "coordinates, last": {"coordinates": far},
        "coordinates of a node": {"coordinates": mixed},
        "coordinates, some": {"coordinates": None if alone else at},
        "K is no Mat": {"K": np.eye(3)},
        "K asymmetric": {"K": lopsided},
        "K not finite": {"K": broken},
        # One contact and one support cannot stop all rotations.
        "supports": {
            "fixed": given["fixed"][:1],
            "gap": gap[:1],
            "mu": mu[:1],
            "B": matrix(given, "B")[:3],
        },
    }


def errors(given: Given) -> Given:
    """Messages of wrong calls."""
    K = distributed(given)
    texts = {
        name: _failure(lambda known=known: problem(given, **({"K": K} | known)))
        for name, known in _wrong(given, K).items()
    }
    made = problem(given)
    short = PETSc.Vec().createMPI((3, None), comm=comm)
    endless = made.K.createVecLeft()
    endless.set(np.inf)
    n_fixed = len(given["fixed"])
    for name, work in {
        "load": lambda: made.solve(short),
        "load, an array": lambda: made.solve([np.zeros(3)]),
        "load, infinite": lambda: made.solve(endless),
        "prescribed": lambda: made.solve(prescribed=np.zeros(n_fixed + 1)),
        "prescribed differs": lambda: made.solve(
            prescribed=np.full(n_fixed, float(comm.rank))
        ),
        "tol": lambda: made.solve(tol=-1.0),
        "max_iterations": lambda: made.solve(
            prescribed=given["prescribed"], tol=1e-12, max_iterations=1
        ),
        "on_step": lambda: made.solve(on_step=3),
        "start": lambda: made.solve(start=3),
    }.items():
        texts[name] = _failure(work)
    return {"said": json.dumps(texts)}


def path(given: Given) -> Given:
    """A path in one part and in two, and its file and pickle."""
    made = problem(given)
    whole_path = made.solve(prescribed=given["prescribed"], tol=1e-12)
    first = made.solve(prescribed=given["prescribed"][:1], tol=1e-12)
    seen: list[int] = []
    rest = made.solve(
        prescribed=given["prescribed"][1:],
        tol=1e-12,
        start=first,
        on_step=lambda k, _step: seen.append(k),
    )
    again = pickle.loads(pickle.dumps(whole_path))
    assert np.array_equal(again.reaction, whole_path.reaction)
    assert _failure(lambda: again[0].displacement).startswith("ValueError")
    assert seen == [0]
    return {
        "whole": whole_path.reaction,
        "parts": np.concatenate([first.reaction, rest.reaction]),
        "slip": whole_path.slip,
        "slip_parts": np.concatenate([first.slip, rest.slip]),
    }


def with_matrix(given: Given) -> Given:
    """B as a matrix of PETSc."""
    K = distributed(given)
    B = matrix(given, "B")
    first, last = (B.shape[0] * k // comm.size for k in (comm.rank, comm.rank + 1))
    rows_of_rank = B[first:last]
    csr = (
        rows_of_rank.indptr.astype(PETSc.IntType),
        rows_of_rank.indices.astype(PETSc.IntType),
        rows_of_rank.data,
    )
    size = (last - first, B.shape[0]), K.getSizes()[1]
    held = PETSc.Mat().createAIJ(size, csr=csr, comm=comm)
    low, high = K.getOwnershipRange()
    made = ContactProblem(
        K,
        held,
        gap=given["gap"],
        mu=given["mu"],
        fixed=given["fixed"],
        coordinates=given["coordinates"][low:high],
    )
    return answer(made, made.solve(prescribed=given["prescribed"], tol=1e-12))


class Counted(PETSc.Mat):
    """A K that counts the rows that each call hands out on this rank."""

    handed_out: tuple[int, ...] = ()

    def _count(self, rows: int) -> None:
        self.handed_out += (rows,)

    def getValuesCSR(self) -> Any:
        arrays = super().getValuesCSR()
        self._count(len(arrays[0]) - 1)
        return arrays

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise AssertionError("K must not be gathered")

    createSubMatrices = createRedundantMatrix = getRow = getValues = _refuse
    createSubMatrix = convert = getDenseArray = _refuse


class CountedComm(MPI.Intracomm):
    """Counts the bytes of messages that this rank receives from Python code."""

    received = 0

    def allgather(self, sendobj: Any) -> Any:
        values = super().allgather(sendobj)
        CountedComm.received += sum(len(pickle.dumps(value)) for value in values)
        return values

    def bcast(self, obj: Any = None, root: int = 0) -> Any:
        value = super().bcast(obj, root)
        CountedComm.received += len(pickle.dumps(value))
        return value

    def Allgatherv(self, send: Any, receive: Any) -> None:
        super().Allgatherv(send, receive)
        CountedComm.received += receive[0].nbytes


class PetscComm(PETSc.Comm):
    """A communicator that gives a counted one."""

    def tompi4py(self) -> Any:
        return CountedComm(super().tompi4py())


def rows(given: Given) -> Given:
    """What a rank holds of K, and what it receives."""
    import tracemalloc

    K = distributed(given, Counted)
    comm_of = PetscComm(K.comm)
    Counted.comm = property(lambda _self: comm_of)
    tracemalloc.start()
    made = problem(given, K=K)
    received_making = CountedComm.received
    made.solve(prescribed=given["prescribed"], tol=1e-10)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    stats = made.stats
    rows_of_rank = K.getLocalSize()[0]
    numbers = {
        "own": rows_of_rank,
        "handed_out": max(K.handed_out),
        "received_making": received_making,
        "received": CountedComm.received - received_making,
        "gathers": stats["gathers"],
        "bytes_gather": stats["bytes_gather"],
        "newton": stats["newton"],
        "peak": peak,
    }
    return {"ranks": json.dumps(comm.allgather(numbers))}


def command(given: Given) -> Given:
    """`bipot`: its exit status, and what the ranks print, in the order of their numbers."""
    from bipot_rs.cli.entry import call

    words = [str(word) for word in given["words"]]
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder, name) for name in ("stdout", "stderr")]
        with (
            files[0].open("w") as out,
            files[1].open("w") as err,
            warnings.catch_warnings(action="default"),
            contextlib.chdir(str(given["cwd"])),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            status = call(words)
        told = comm.allgather((status, *(file.read_text() for file in files)))
    statuses, output, errors = zip(*told, strict=True)
    return {
        "status": next(filter(None, statuses), 0),
        "output": "".join(output),
        "errors": "".join(errors),
    }


def _wait_for(file: Path, parent: int) -> None:
    """Wait without MPI, whose ranks keep their cores busy; look less often with time."""
    began = time.monotonic()
    while not file.exists():
        if file.with_name("end").exists():
            sys.exit()
        try:
            os.kill(parent, 0)
        except ProcessLookupError:
            sys.exit()
        time.sleep(min(0.002 + 0.05 * (time.monotonic() - began), 0.1))


def _do(given: Given) -> Given:
    """Do a task with its options of PETSc."""
    options = PETSc.Options()
    options.insertString(str(given.pop("options")))
    task = globals()[str(given.pop("task"))]
    try:
        return dict(task(given))
    except BaseException:
        # Other ranks wait in a message, and PETSc would wait for them at exit.
        traceback.print_exc()
        sys.stderr.flush()
        comm.Abort(1)
        raise
    finally:
        for name in options.getAll():
            options.delValue(name)
        _OURS.clear()


def main() -> None:
    folder, parent = Path(sys.argv[1]), int(sys.argv[2])
    warnings.simplefilter("error")
    for k in itertools.count(1):
        source = folder / f"{k:04d}-given.npz"
        _wait_for(source, parent)
        with np.load(source) as file:
            given = dict(file)
        arrays = _do(given)
        if comm.rank == 0:
            np.savez(folder / "answer.npz", **arrays)
            (folder / "answer.npz").rename(folder / f"{k:04d}-answer.npz")


if __name__ == "__main__":
    main()
