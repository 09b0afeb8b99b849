"""FCLIB files are read as they are, and written as given."""

import errno
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fclib
from support import pressed
from support.bodies import block
from support.collection import FILES, datasets, dense, path
from support.conditions import violation

Array = NDArray[np.float64]


def as_dense(matrix: Any) -> Array:
    return np.asarray(matrix.toarray() if sparse.issparse(matrix) else matrix)


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_read_as_it_is(name: str) -> None:
    facts, problem = FILES[name], fclib.read(path(name))
    group = f"fclib_{facts.form}"
    with h5py.File(path(name)) as file:
        vectors = {k: v[:] for k, v in file[group]["vectors"].items()}
        letters = "W" if facts.form == "local" else "MH"
        matrices = {k: dense(file[group], k) for k in letters}
    if isinstance(problem, fclib.GlobalProblem):
        assert facts.form == "global"
        assert as_dense(problem.M).shape == (facts.n, facts.n)
        assert problem.w.shape == (facts.contacts, facts.d)
    else:
        assert facts.form == "local"
        assert problem.q.shape == (facts.contacts, facts.d)
        assert problem.rigid is None
    for letter, matrix in matrices.items():
        ours = getattr(problem, letter)
        assert sparse.issparse(ours)
        np.testing.assert_array_equal(as_dense(ours), matrix)
    for letter, vector in vectors.items():
        np.testing.assert_array_equal(getattr(problem, letter).ravel(), vector)


@pytest.mark.parametrize("name", [n for n, k in FILES.items() if k.form == "local"])
def test_local_problems_are_solved(name: str) -> None:
    problem = fclib.read(path(name))
    assert isinstance(problem, bp.ReducedProblem)
    solution = problem.solve(tol=1e-12)
    assert solution.converged
    W, r = as_dense(problem.W), solution.reaction
    v = W @ r.ravel() + problem.q.ravel()
    size = np.abs(W) @ np.abs(r.ravel()) + np.abs(problem.q.ravel())
    # Sums of at most 27 terms, in another order.
    difference = np.abs(v - solution.relative_displacement.ravel())
    assert difference.max() <= 27 * np.finfo(float).eps * size.max()
    # η = 1e-12 relative to the whole problem; scales of contacts differ by at most 1e2.
    assert violation(r, v.reshape(r.shape), problem.mu, problem.q) <= 1e-9


@pytest.mark.parametrize("name", FILES)
def test_writing_a_file_twice_gives_the_same_bytes(name: str, tmp_path: Path) -> None:
    """Every number of problem and solutions, in the storage and order of the file."""
    problem, copy = fclib.read(path(name)), tmp_path / "copy.hdf5"
    solution, guesses = fclib.read_solution(path(name)), fclib.read_guesses(path(name))
    info = fclib.read_info(path(name))
    fclib.write(copy, problem, solution, guesses=guesses, info=info)
    before, after = datasets(path(name)), datasets(copy)
    assert before.keys() == after.keys()
    for key, array in before.items():
        if key.endswith("/nzmax"):
            continue  # # unused space is not written
        assert after[key].dtype == array.dtype
        assert after[key].tobytes() == array.tobytes(), key
    assert fclib.read_info(copy) == info


def test_solutions_guesses_and_info() -> None:
    answer = fclib.read_solution(path("box_stacks_i0122_82"))
    assert answer is not None
    assert answer.u.shape == answer.r.shape == (82, 3)
    assert answer.v is not None
    assert answer.v.shape == (450,)
    (guess,) = fclib.read_guesses(path("box_stacks_i0122_82"))
    assert guess.r.shape == (82, 3)
    assert fclib.read_info(path("box_stacks_i0122_82"))["title"] == "Box_stacks"
    assert fclib.read_solution(path("nespheres_10")) is None
    assert fclib.read_guesses(path("nespheres_10")) == []


NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)


@st.composite
def matrices(draw: st.DrawFn, rows: int, columns: int) -> Any:
    """Triplets with repeats, or compressed with unsorted and repeated indices."""
    count = draw(st.integers(0, 2 * rows * columns))
    i = draw(hnp.arrays(np.int32, count, elements=st.integers(0, rows - 1)))
    p = draw(hnp.arrays(np.int32, count, elements=st.integers(0, columns - 1)))
    x = draw(hnp.arrays(np.float64, count, elements=NUMBERS))
    kind = draw(st.sampled_from(["coo", "csc", "csr"]))
    if kind == "coo":
        return sparse.coo_array((x, (i, p)), shape=(rows, columns))
    major = columns if kind == "csc" else rows
    cuts = draw(hnp.arrays(np.int32, major - 1, elements=st.integers(0, count)))
    pointers = np.concatenate([[0], np.sort(cuts), [count]]).astype(np.int32)
    build = sparse.csc_array if kind == "csc" else sparse.csr_array
    return build((x, i if kind == "csc" else p, pointers), shape=(rows, columns))


def parts(matrix: Any) -> tuple[bytes, ...]:
    """Kind, indices and bits of a matrix."""
    kind = matrix.format
    places = (
        (matrix.row, matrix.col) if kind == "coo" else (matrix.indptr, matrix.indices)
    )
    return (
        kind.encode(),
        *(np.asarray(place, np.int64).tobytes() for place in places),
        matrix.data.tobytes(),
    )


@settings(max_examples=60)
@given(data=st.data())
def test_matrices_come_back_bit_for_bit(data: st.DataObject) -> None:
    rows, columns = data.draw(st.integers(1, 5)), data.draw(st.integers(1, 5))
    matrix = data.draw(matrices(rows, columns))
    before = parts(matrix)
    with h5py.File("a", "w", driver="core", backing_store=False) as file:
        fclib._write_matrix(file.create_group("W"), matrix)
        matrix_read = fclib._File(file, 10**6).matrix("/W")
    assert parts(matrix_read) == before == parts(matrix)
    assert matrix_read.shape == matrix.shape


def test_a_dense_matrix_is_written_whole(tmp_path: Path) -> None:
    problem = pressed.square()
    assert isinstance(problem.W, np.ndarray)
    fclib.write(tmp_path / "a.hdf5", problem)
    read_back = fclib.read(tmp_path / "a.hdf5")
    assert isinstance(read_back, bp.ReducedProblem)
    assert read_back.W.format == "csr"
    assert read_back.W.nnz == problem.W.size
    assert read_back.W.toarray().tobytes() == problem.W.tobytes()


@pytest.mark.parametrize("make", [pressed.square, pressed.cube, pressed.free])
def test_problems_are_written_with_solutions(
    make: Callable[[], bp.ReducedProblem], tmp_path: Path
) -> None:
    problem, target = make(), tmp_path / "a.hdf5"
    solution = problem.solve(tol=1e-12)
    fclib.write(target, problem, solution)
    read_back, stored = fclib.read(target), fclib.read_solution(target)
    assert isinstance(read_back, bp.ReducedProblem)
    assert stored is not None
    assert stored.r.tobytes() == solution.reaction.tobytes()
    assert stored.u.tobytes() == solution.relative_displacement.tobytes()
    # The same numbers in the same order.
    eta = read_back.residual(stored.r, stored.multiplier)
    assert eta == problem.residual(solution.reaction, solution.rigid_motion) <= 1e-12
    if problem.rigid is None:
        assert stored.multiplier is None
    else:
        assert read_back.rigid is not None
        assert stored.multiplier is not None
        for ours, theirs in zip(problem.rigid, read_back.rigid, strict=True):
            assert np.array_equal(ours, theirs)
        # The format's two equations, Vᵀ r + R λ + s = 0 and u = W r + V λ + q.
        V, s = read_back.rigid
        force = V.T @ stored.r.ravel() + s
        # Residual of 1e-12 in an orthonormal basis; R has few columns of order one.
        assert np.abs(force).max() <= 1e-11 * np.abs(s).max()
        u = read_back.W @ stored.r.ravel() + V @ stored.multiplier + read_back.q.ravel()
        # Rounding of sums of the size of the free motion.
        size = np.abs(V @ stored.multiplier).max() + np.abs(read_back.q).max()
        assert np.abs(u - stored.u.ravel()).max() <= 1e-12 * size
    info = fclib.read_info(target)
    assert info["title"] == "a"
    assert "bipot_rs" in info["description"]
    assert f"residual eta {eta:.1e}" in info["math_info"]


def test_strings_end_with_a_zero_byte(tmp_path: Path) -> None:
    """Fixed length with a zero at the end, as in the files of the collection."""
    fclib.write(tmp_path / "a.hdf5", pressed.square(), info={"title": "it"})
    with h5py.File(tmp_path / "a.hdf5") as file:
        kind = file["fclib_local/info/title"].id.get_type()
        assert not kind.is_variable_str()
        assert kind.get_size() == len("it") + 1
        assert file["fclib_local/spacedim"].dtype == np.int32
        assert file["fclib_local/spacedim"].shape == (1,)


def test_unconverged_solution_is_written_as_guess(tmp_path: Path) -> None:
    problem = pressed.cube()
    solution = problem.solve("uzawa", tol=1e-12, max_iterations=2)
    assert not solution.converged
    fclib.write(tmp_path / "a.hdf5", problem, solution)
    assert fclib.read_solution(tmp_path / "a.hdf5") is None
    (guess,) = fclib.read_guesses(tmp_path / "a.hdf5")
    assert guess.r.tobytes() == solution.reaction.tobytes()
    assert "iteration_limit" in fclib.read_info(tmp_path / "a.hdf5")["math_info"]


def test_global_solution_contains_the_velocity(tmp_path: Path) -> None:
    problem = fclib.read(path("rods_2_3c"))
    assert isinstance(problem, fclib.GlobalProblem)
    solution = problem.solve()
    fclib.write(tmp_path / "a.hdf5", problem, solution)
    stored = fclib.read_solution(tmp_path / "a.hdf5")
    assert stored is not None
    assert stored.v is not None
    assert stored.v.tobytes() == problem.velocity(solution).tobytes()


def test_each_step_is_written_as_a_complete_problem(tmp_path: Path) -> None:
    body = block((2.0, 1.0), (6, 3), 100.0, 0.3)
    fixed = np.concatenate([body.dofs(1, 1.0, component) for component in (0, 1)])
    problem = bp.ContactProblem(body.K, body.B, gap=body.gap, mu=0.3, fixed=fixed)
    half = fixed.size // 2
    moved = [np.repeat(m, half) for m in ([0, -5e-3], [6e-3, -5e-3], [2e-3, -4e-3])]
    result = problem.solve(prescribed=np.array(moved), tol=1e-12)
    written = fclib.write_path(tmp_path / "way", problem, result)
    assert [p.name for p in written] == [f"way-000{k}.hdf5" for k in range(3)]
    slip = np.zeros((len(body.gap), 1))
    for step, file in zip(result, written, strict=True):
        read_back, stored = fclib.read(file), fclib.read_solution(file)
        assert stored is not None
        # v of the file is that of the step: its tangential part is the slip of the step.
        np.testing.assert_array_equal(stored.u[:, 1:], step.slip)
        slip += step.slip
        # Increments of the path add up to its total, to a few roundings.
        total = step.relative_displacement[:, 1:]
        assert np.abs(slip - total).max() <= 1e-15 * np.abs(result.slip).max()
        answer = read_back.solve(tol=1e-12)
        # The path is checked with K and the file with W; they differ by ε times cond(S).
        size = np.abs(step.reaction).max()
        assert np.abs(answer.reaction - step.reaction).max() <= 1e-9 * size
        assert read_back.residual(stored.r) <= 1e-11
    assert fclib.read_info(written[1])["title"] == "way, step 2 of 3"
    # From the second step on the files are the same.
    again = problem.solve(prescribed=np.array(moved[1:]), start=result[0], tol=1e-12)
    for k, file in enumerate(fclib.write_path(tmp_path / "on", problem, again)):
        other, before = fclib.read(file), fclib.read(written[k + 1])
        assert isinstance(other, bp.ReducedProblem)
        assert isinstance(before, bp.ReducedProblem)
        assert other.q.tobytes() == before.q.tobytes()
    result.save(tmp_path / "a.h5")
    with pytest.raises(ValueError, match="loads of the result are unknown"):
        fclib.write_path(tmp_path / "no", problem, bp.load(tmp_path / "a.h5"))


def test_a_failed_write_leaves_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, target = pressed.square(), tmp_path / "a.hdf5"
    fclib.write(target, problem)
    before = target.read_bytes()

    def full(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(fclib, "_write_vectors", full)
    with pytest.raises(OSError, match="no space left"):
        fclib.write(target, problem, problem.solve())
    assert target.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.hdf5"]


Change = Callable[[h5py.File], None]


def without(name: str) -> Change:
    return lambda file: file.__delitem__(name)


def put(name: str, value: Any) -> Change:
    def change(file: h5py.File) -> None:
        if name in file:
            del file[name]
        file[name] = value

    return change


def edit(name: str, change: Callable[[NDArray[Any]], Any]) -> Change:
    return lambda file: put(name, change(file[name][()]))(file)


def spoil(at: int, value: float) -> Callable[[NDArray[Any]], NDArray[Any]]:
    def change(array: NDArray[Any]) -> NDArray[Any]:
        array[at] = value
        return array

    return change


def shorter(array: NDArray[Any]) -> NDArray[Any]:
    return array[:-1]


def altered(source: str, change: Change, folder: Path) -> Path:
    """A changed copy of a file."""
    target = folder / "altered.hdf5"
    shutil.copyfile(path(source), target)
    with h5py.File(target, "r+") as file:
        change(file)
    return target


def said_of(source: str, change: Change, folder: Path) -> str:
    """The message of `read` for an altered file."""
    target = altered(source, change, folder)
    with pytest.raises(ValueError, match=r"altered\.hdf5") as caught:
        fclib.read(target)
    return str(caught.value)


ALL = [
    (source, name)
    for source in ("nespheres_10", "rods_2_3c")
    for name in datasets(path(source))
    if "/info/" not in name
]


@pytest.mark.parametrize(("source", "name"), ALL)
def test_missing_or_wrong_data_are_named(
    source: str, name: str, tmp_path: Path
) -> None:
    assert f"{name} is missing" in said_of(source, without(name), tmp_path)
    assert f"{name} holds" in said_of(source, put(name, b"text"), tmp_path)
    group = said_of(
        source, lambda f: (without(name)(f), f.create_group(name))[0], tmp_path
    )
    assert f"{name} is a group" in group
    if len(datasets(path(source))[name]) > 1:
        # If two lengths contradict each other, the message names both, or the wrong one.
        short = said_of(source, edit(name, shorter), tmp_path)
        assert f"{name} has" in short or f"{name.rpartition('/')[0]}/" in short
        huge = said_of(
            source,
            lambda f: (without(name)(f), f.create_dataset(name, (2**36,), "i4"))[0],
            tmp_path,
        )
        assert f"{name} has {2**36} entries, more than" in huge or "holds" in huge


LOCAL, GLOBAL = "/fclib_local", "/fclib_global"


@pytest.mark.parametrize(
    ("source", "change", "said"),
    [
        ("nespheres_10", without(LOCAL), "expected one of /fclib_local and /fclib_"),
        ("nespheres_10", put(GLOBAL, 1), "found both"),
        ("nespheres_10", put("/more", 1), "/more is unknown, not part of"),
        *(
            ("nespheres_10", lambda file, change=change: change(file[LOCAL]), said)
            for change, said in (
                (put("X", 1), "/fclib_local/X is unknown"),
                (put("W/y", 1), "/fclib_local/W/y is unknown"),
                (put("vectors/b", [1.0]), "/vectors/b is unknown"),
                (put("spacedim", [4]), "/spacedim is 4, expected 2"),
                (put("spacedim", [2]), "/W/m is 27, expected a mult"),
                (put("W/n", [28]), "/W/n is 28, expected 27"),
                (put("W/m", [-1]), "/W/m is -1, expected zero"),
                (put("W/nz", [-3]), "/W/nz is -3, expected"),
                (put("W/nzmax", [1]), "/W/nzmax is 1, expected 121"),
                (edit("W/i", spoil(3, 27)), "/W/i is 27 at position 3"),
                (edit("W/i", spoil(3, -1)), "/W/i is -1 at position 3"),
                (edit("W/p", spoil(0, 1)), "/W/p should ascend"),
                (edit("W/p", spoil(3, 999)), "/W/p should ascend"),
                (edit("W/x", spoil(7, np.nan)), "/W/x is nan at positi"),
                (edit("W/x", shorter), "/W/x has 120 entries, expec"),
                (edit("W/p", shorter), "/W/p has 27 entries, expec"),
                (edit("vectors/q", spoil(7, np.inf)), "/q is inf at position 7"),
                (edit("vectors/mu", spoil(2, -0.1)), "/mu is -0.1 at position 2"),
                (edit("vectors/mu", shorter), "/mu has 8 entries, expected 9"),
                (edit("vectors/q", lambda q: q.reshape(-1, 3)), "/q has 2 dimensions"),
            )
        ),
        *(
            ("fe_cube_h8_9c", lambda file, change=change: change(file[GLOBAL]), said)
            for change, said in (
                (edit("M/i", spoil(5, 162)), "/M/i is 162 at"),
                (edit("M/p", spoil(5, -1)), "/M/p is -1 at"),
                (put("H/nz", [406]), "/H/nzmax is 405, exp"),
                (put("H/m", [161]), "/H/m is 161, expected 162"),
                (put("H/n", [26]), "/H/n is 26, expected a multi"),
                (put("vectors/b", [1.0]), "/fclib_global/G is miss"),
                (edit("vectors/f", shorter), "/vectors/f has 161"),
            )
        ),
    ],
)
def test_wrong_content_is_named(
    source: str, change: Change, said: str, tmp_path: Path
) -> None:
    assert said in said_of(source, change, tmp_path)


def matrix_of(name: str, rows: int, columns: int, x: list[float]) -> Change:
    """Write a matrix whose entries are all in its first row."""

    def change(file: h5py.File) -> None:
        matrix = sparse.coo_array(
            (x, (np.zeros(len(x), int), np.arange(len(x)))), shape=(rows, columns)
        )
        fclib._write_matrix(file.create_group(name), matrix)

    return change


def several(*changes: Change) -> Change:
    def change(file: h5py.File) -> None:
        for one in changes:
            one(file)

    return change


def test_constraints_are_refused_or_rigid_motions(tmp_path: Path) -> None:
    V, s = (
        matrix_of("/fclib_local/V", 27, 1, [1.0]),
        put("/fclib_local/vectors/s", [2.0]),
    )
    R = "/fclib_local/R"
    message = said_of("nespheres_10", several(V, s), tmp_path)
    assert "/fclib_local/R is missing" in message
    message = said_of("nespheres_10", several(V, matrix_of(R, 1, 1, [])), tmp_path)
    assert "/fclib_local/vectors/s is missing" in message
    message = said_of(
        "nespheres_10", several(V, s, matrix_of(R, 1, 1, [1.0])), tmp_path
    )
    assert "/fclib_local/R is not zero" in message
    message = said_of("nespheres_10", several(V, s, matrix_of(R, 2, 2, [])), tmp_path)
    assert "/fclib_local/R is (2, 2), expected (1, 1)" in message
    G = matrix_of("/fclib_global/G", 54, 1, [1.0])
    b = put("/fclib_global/vectors/b", [0.0])
    message = said_of("rods_2_3c", several(G, b), tmp_path)
    assert "/fclib_global/G is not empty" in message
    # An empty entry counts as absent.
    target = tmp_path / "a.hdf5"
    shutil.copyfile(path("rods_2_3c"), target)
    with h5py.File(target, "r+") as file:
        matrix_of("/fclib_global/G", 54, 0, [])(file)
        file["/fclib_global/vectors/b"] = np.empty(0)
    assert isinstance(fclib.read(target), fclib.GlobalProblem)
    shutil.copyfile(path("nespheres_10"), target)
    with h5py.File(target, "r+") as file:
        several(V, s, matrix_of(R, 1, 1, []))(file)
    read_back = fclib.read(target)
    assert isinstance(read_back, bp.ReducedProblem)
    assert read_back.rigid is not None
    assert read_back.rigid[0][0, 0] == 1.0
    np.testing.assert_array_equal(read_back.rigid[1], [2.0])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (without("/solution/r"), "/solution/r is missing"),
        (edit("/solution/u", shorter), "/solution/u has 245 entries, expected 246"),
        (edit("/solution/v", spoil(0, np.nan)), "/solution/v is nan at position 0"),
        (put("/solution/l", [1.0]), "/fclib_global/G is missing"),
        (put("/solution/z", [1.0]), "/solution/z is unknown, not part of"),
    ],
)
def test_a_wrong_solution_is_named(change: Change, said: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=said):
        fclib.read_solution(altered("box_stacks_i0122_82", change, tmp_path))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (without("/guesses/number_of_guesses"), "number_of_guesses is missing"),
        (put("/guesses/number_of_guesses", [2]), "/guesses/2 is missing"),
        (put("/guesses/number_of_guesses", [0]), "/guesses/1 is unknown"),
        (put("/guesses/number_of_guesses", [-1]), "number_of_guesses is -1"),
        (put("/guesses/number_of_guesses", [2**30]), "number_of_guesses is 1073741824"),
        (edit("/guesses/1/u", shorter), "/guesses/1/u has 245 entries"),
    ],
)
def test_wrong_guesses_are_named(change: Change, said: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=said):
        fclib.read_guesses(altered("box_stacks_i0122_82", change, tmp_path))


def test_out_of_range_numbers_are_refused(tmp_path: Path) -> None:
    """Valid numbers that are refused as a problem: the message still has the path."""
    large = edit(LOCAL + "/W/x", lambda x: 1e300 * x)
    small = edit(LOCAL + "/vectors/q", lambda q: 1e-300 * q)
    message = said_of("nespheres_10", several(large, small), tmp_path)
    assert "W and q cannot be scaled" in message


def test_paths_that_are_not_files(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="none"):
        fclib.read(tmp_path / "none.hdf5")
    with pytest.raises(IsADirectoryError):
        fclib.read(tmp_path)
    (tmp_path / "a").write_text("text")
    with pytest.raises(ValueError, match="cannot be read as HDF5"):
        fclib.read(tmp_path / "a")
    whole = path("nespheres_10").read_bytes()
    (tmp_path / "b").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="b cannot be read as HDF5"):
        fclib.read(tmp_path / "b")


def test_unused_space_is_not_read(tmp_path: Path) -> None:
    """Arrays have nzmax entries; only nz of them, or those up to the last pointer, count."""
    target = tmp_path / "a.hdf5"
    for source, name in (
        ("nespheres_10", LOCAL + "/W"),
        ("fe_cube_h8_9c", GLOBAL + "/M"),
    ):
        shutil.copyfile(path(source), target)
        with h5py.File(target, "r+") as file:
            room = int(file[name]["nzmax"][0]) + 5
            put(name + "/nzmax", [room])(file)
            for letter in ("i", "p", "x") if "global" in name else ("i", "x"):
                whole = np.concatenate([file[name][letter][:], np.full(5, 10**6)])
                put(f"{name}/{letter}", whole)(file)
        ours, theirs = fclib.read(target), fclib.read(path(source))
        letter = name[-1]
        assert parts(getattr(ours, letter)) == parts(getattr(theirs, letter))


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ({"problem": None}, TypeError, "problem is a NoneType"),
        ({"solution": 3}, TypeError, "solution is a int, expected a Solution"),
        ({"guesses": [3]}, TypeError, r"guesses\[0\] is a int"),
        ({"info": {"name": "x"}}, ValueError, "info has 'name', expected title"),
        (
            {"solution": fclib.Vectors(np.zeros((1, 2)), np.zeros((1, 2)))},
            ValueError,
            "u of solution has shape",
        ),
        (
            {"solution": fclib.Vectors(np.zeros((7, 2)), np.full((7, 2), np.nan))},
            ValueError,
            "r of solution is nan",
        ),
        (
            {"solution": fclib.Vectors(np.zeros((7, 2)), np.zeros((7, 2)), np.ones(2))},
            ValueError,
            "v of solution should be None: the problem has none",
        ),
    ],
)
def test_wrong_arguments(
    arguments: dict[str, Any], error: type[Exception], said: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=said):
        fclib.write(
            **({"path": tmp_path / "a.hdf5", "problem": pressed.square()} | arguments)
        )
    assert list(tmp_path.iterdir()) == []


def test_messages_name_the_file(tmp_path: Path) -> None:
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.2]], 0.3)
    words = "path is a int, expected the name of a file"
    with pytest.raises(TypeError, match=words):
        fclib.write(3, problem)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=words):
        fclib.read(3)  # type: ignore[arg-type]
    missing = tmp_path / "none" / "a.hdf5"
    with pytest.raises(FileNotFoundError) as refused:
        fclib.write(missing, problem)
    reason = os.strerror(errno.ENOENT)
    assert str(refused.value) == f"cannot write {missing}: {reason}"


def test_without_h5py_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # With None in its place, Python does not find the module.
    monkeypatch.setitem(sys.modules, "h5py", None)
    problem = bp.ReducedProblem(np.eye(2), [[-1.0, 0.2]], 0.3)
    for call in (
        lambda: fclib.read(tmp_path / "a.hdf5"),
        lambda: fclib.write(tmp_path / "a.hdf5", problem),
        lambda: bp.load(tmp_path / "a.h5"),
    ):
        with pytest.raises(
            ModuleNotFoundError, match=r"h5py.*pip install 'bipot-rs\[io\]'"
        ):
            call()
