"""FCLIB files are read as they are, and written as given."""

import errno
import os
import shutil
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


def reduced(file: Path) -> bp.ReducedProblem:
    """The problem of a file of the local form."""
    problem = fclib.read(file)
    assert isinstance(problem, bp.ReducedProblem)
    return problem


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_read_as_it_is(name: str) -> None:
    facts, problem = FILES[name], fclib.read(path(name))
    with h5py.File(path(name)) as file:
        group = file[f"fclib_{facts.form}"]
        vectors = {k: v[:] for k, v in group["vectors"].items()}
        letters = "W" if facts.form == "local" else "MH"
        matrices = {k: dense(group, k) for k in letters}
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
    problem = reduced(path(name))
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
    stacks, spheres = path("box_stacks_i0122_82"), path("nespheres_10")
    answer, (guess,) = fclib.read_solution(stacks), fclib.read_guesses(stacks)
    assert answer is not None
    assert answer.v is not None
    assert answer.u.shape == answer.r.shape == guess.r.shape == (82, 3)
    assert answer.v.shape == (450,)
    assert fclib.read_info(stacks)["title"] == "Box_stacks"
    assert fclib.read_solution(spheres) is None
    assert fclib.read_guesses(spheres) == []


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
    names = ("row", "col") if kind == "coo" else ("indptr", "indices")
    places = [np.asarray(getattr(matrix, name), np.int64).tobytes() for name in names]
    return kind.encode(), *places, matrix.data.tobytes()


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


@pytest.mark.parametrize("make", [pressed.square, pressed.cube, pressed.free])
def test_problems_are_written_with_solutions(
    make: Callable[[], bp.ReducedProblem], tmp_path: Path
) -> None:
    problem, target = make(), tmp_path / "a.hdf5"
    solution = problem.solve(tol=1e-12)
    fclib.write(target, problem, solution)
    read_back, stored = reduced(target), fclib.read_solution(target)
    # A dense matrix is written whole.
    assert read_back.W.format == "csr"
    assert read_back.W.nnz == problem.W.size
    assert read_back.W.toarray().tobytes() == problem.W.tobytes()
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
    # Fixed length with a zero at the end, as in the files of the collection.
    with h5py.File(target) as file:
        kind = file["fclib_local/info/title"].id.get_type()
        assert not kind.is_variable_str()
        assert kind.get_size() == len("a") + 1
        assert file["fclib_local/spacedim"].dtype == np.int32
        assert file["fclib_local/spacedim"].shape == (1,)


def test_other_solutions(tmp_path: Path) -> None:
    target = tmp_path / "a.hdf5"
    problem = pressed.cube()
    solution = problem.solve("uzawa", tol=1e-12, max_iterations=2)
    assert not solution.converged
    fclib.write(target, problem, solution)
    # What has not converged is a guess.
    assert fclib.read_solution(target) is None
    (guess,) = fclib.read_guesses(target)
    assert guess.r.tobytes() == solution.reaction.tobytes()
    assert "iteration_limit" in fclib.read_info(target)["math_info"]
    # A solution of the global form contains the velocity.
    whole = fclib.read(path("rods_2_3c"))
    assert isinstance(whole, fclib.GlobalProblem)
    solution = whole.solve()
    fclib.write(target, whole, solution)
    stored = fclib.read_solution(target)
    assert stored is not None
    assert stored.v is not None
    assert stored.v.tobytes() == whole.velocity(solution).tobytes()


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
        read_back, stored = reduced(file), fclib.read_solution(file)
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
    more = fclib.write_path(tmp_path / "on", problem, again)
    for file, before in zip(more, written[1:], strict=True):
        assert reduced(file).q.tobytes() == reduced(before).q.tobytes()
    result.save(tmp_path / "a.h5")
    with pytest.raises(ValueError, match="loads of the result are unknown"):
        fclib.write_path(tmp_path / "no", problem, bp.load(tmp_path / "a.h5"))


SOLUTION, GUESSES = fclib.read_solution, fclib.read_guesses
NUMBER = "/guesses/number_of_guesses"
Change = Callable[[h5py.File], Any]


def without(name: str) -> Change:
    return lambda file: file.__delitem__(name)


def several(*changes: Change) -> Change:
    def change(file: h5py.File) -> None:
        for one in changes:
            one(file)

    return change


def put(name: str, value: Any) -> Change:
    def change(file: h5py.File) -> None:
        if name in file:
            del file[name]
        file[name] = value

    return change


def edit(name: str, change: Callable[[NDArray[Any]], Any]) -> Change:
    return lambda file: put(name, change(file[name][()]))(file)


def spoil(name: str, at: int, value: float) -> Change:
    def change(array: NDArray[Any]) -> NDArray[Any]:
        array[at] = value
        return array

    return edit(name, change)


def shorter(name: str) -> Change:
    return edit(name, lambda array: array[:-1])


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
    def said(change: Change) -> str:
        return said_of(source, change, tmp_path)

    assert f"{name} is missing" in said(without(name))
    assert f"{name} holds" in said(put(name, b"text"))
    group = several(without(name), lambda file: file.create_group(name))
    assert f"{name} is a group" in said(group)
    if len(datasets(path(source))[name]) > 1:
        # If two lengths contradict each other, the message names both, or the wrong one.
        short = said(shorter(name))
        assert f"{name} has" in short or f"{name.rpartition('/')[0]}/" in short
        large = lambda file: file.create_dataset(name, (2**36,), "i4")  # noqa: E731
        huge = said(several(without(name), large))
        assert f"{name} has {2**36} entries, more than" in huge or "holds" in huge


LOCAL, GLOBAL = "/fclib_local", "/fclib_global"


# Of a file, and of its group: changes, and the messages.
WRONG: dict[tuple[str, str], list[tuple[Change, str]]] = {
    ("nespheres_10", ""): [
        (without(LOCAL), "expected one of /fclib_local and /fclib_"),
        (put(GLOBAL, 1), "found both"),
        (put("/more", 1), "/more is unknown, not part of"),
    ],
    ("nespheres_10", LOCAL): [
        (put("X", 1), "/fclib_local/X is unknown"),
        (put("W/y", 1), "/fclib_local/W/y is unknown"),
        (put("vectors/b", [1.0]), "/vectors/b is unknown"),
        (put("spacedim", [4]), "/spacedim is 4, expected 2"),
        (put("spacedim", [2]), "/W/m is 27, expected a mult"),
        (put("W/n", [28]), "/W/n is 28, expected 27"),
        (put("W/m", [-1]), "/W/m is -1, expected zero"),
        (put("W/nz", [-3]), "/W/nz is -3, expected"),
        (put("W/nzmax", [1]), "/W/nzmax is 1, expected 121"),
        (spoil("W/i", 3, 27), "/W/i is 27 at position 3"),
        (spoil("W/i", 3, -1), "/W/i is -1 at position 3"),
        (spoil("W/p", 0, 1), "/W/p should ascend"),
        (spoil("W/p", 3, 999), "/W/p should ascend"),
        (spoil("W/x", 7, np.nan), "/W/x is nan at positi"),
        (shorter("W/x"), "/W/x has 120 entries, expec"),
        (shorter("W/p"), "/W/p has 27 entries, expec"),
        (spoil("vectors/q", 7, np.inf), "/q is inf at position 7"),
        (spoil("vectors/mu", 2, -0.1), "/mu is -0.1 at position 2"),
        (shorter("vectors/mu"), "/mu has 8 entries, expected 9"),
        (edit("vectors/q", lambda q: q.reshape(-1, 3)), "/q has 2 dimensions"),
        # Valid numbers that are refused as a problem: the message still has the path.
        (
            several(
                edit("W/x", lambda x: 1e300 * x),
                edit("vectors/q", lambda q: 1e-300 * q),
            ),
            "W and q cannot be scaled",
        ),
    ],
    ("fe_cube_h8_9c", GLOBAL): [
        (spoil("M/i", 5, 162), "/M/i is 162 at"),
        (spoil("M/p", 5, -1), "/M/p is -1 at"),
        (put("H/nz", [406]), "/H/nzmax is 405, exp"),
        (put("H/m", [161]), "/H/m is 161, expected 162"),
        (put("H/n", [26]), "/H/n is 26, expected a multi"),
        (put("vectors/b", [1.0]), "/fclib_global/G is miss"),
        (shorter("vectors/f"), "/vectors/f has 161"),
    ],
}


@pytest.mark.parametrize(("source", "group"), WRONG)
def test_wrong_content_is_named(source: str, group: str, tmp_path: Path) -> None:
    for change, said in WRONG[source, group]:
        within = lambda file, change=change: change(file[group or "/"])  # noqa: E731
        assert said in said_of(source, within, tmp_path)


def matrix_of(name: str, rows: int, columns: int, x: list[float]) -> Change:
    """Write a matrix whose entries are all in its first row."""
    places = (np.zeros(len(x), int), np.arange(len(x)))
    matrix = sparse.coo_array((x, places), shape=(rows, columns))
    return lambda file: fclib._write_matrix(file.create_group(name), matrix)


def test_many_rigid_motions_stay_sparse(tmp_path: Path) -> None:
    """Of 1,100 separate bodies with a contact each, the dense V has a million zeros."""
    n = 1100
    V = sparse.csc_array(sparse.kron(sparse.eye_array(n), [[1.0], [0.0]]))
    problem = bp.ReducedProblem(
        sparse.eye_array(2 * n).tocsr(), np.zeros((n, 2)), 0.3, rigid=(V, -np.ones(n))
    )
    bp.fclib.write(tmp_path / "many.h5", problem)
    read = reduced(tmp_path / "many.h5")
    assert read.rigid is not None
    assert read.rigid[0].count_nonzero() == n
    np.testing.assert_allclose(read.solve().reaction, np.tile([1.0, 0.0], (n, 1)))


def test_constraints_are_refused_or_rigid_motions(tmp_path: Path) -> None:
    V = matrix_of("/fclib_local/V", 27, 1, [1.0])
    s = put("/fclib_local/vectors/s", [2.0])

    def R(*shape_and_entries: Any) -> Change:
        return matrix_of("/fclib_local/R", *shape_and_entries)

    G = matrix_of("/fclib_global/G", 54, 1, [1.0])
    for source, changes, told in (
        ("nespheres_10", (V, s), "/fclib_local/R is missing"),
        ("nespheres_10", (V, R(1, 1, [])), "/fclib_local/vectors/s is missing"),
        ("nespheres_10", (V, s, R(1, 1, [1.0])), "/fclib_local/R is not zero"),
        (
            "nespheres_10",
            (V, s, R(2, 2, [])),
            "/fclib_local/R is (2, 2), expected (1, 1)",
        ),
        (
            "rods_2_3c",
            (G, put("/fclib_global/vectors/b", [0.0])),
            "/fclib_global/G is not empty",
        ),
    ):
        assert told in said_of(source, several(*changes), tmp_path)
    # An empty entry counts as absent.
    empty = matrix_of("/fclib_global/G", 54, 0, [])
    nothing = put("/fclib_global/vectors/b", np.empty(0))
    target = altered("rods_2_3c", several(empty, nothing), tmp_path)
    assert isinstance(fclib.read(target), fclib.GlobalProblem)
    rigid = reduced(altered("nespheres_10", several(V, s, R(1, 1, [])), tmp_path)).rigid
    assert rigid is not None
    assert rigid[0][0, 0] == 1.0
    np.testing.assert_array_equal(rigid[1], [2.0])


@pytest.mark.parametrize(
    ("read", "change", "said"),
    [
        (SOLUTION, without("/solution/r"), "/solution/r is missing"),
        (SOLUTION, shorter("/solution/u"), "/solution/u has 245 entries, expected 246"),
        (SOLUTION, spoil("/solution/v", 0, np.nan), "/solution/v is nan at position 0"),
        (SOLUTION, put("/solution/l", [1.0]), "/fclib_global/G is missing"),
        (SOLUTION, put("/solution/z", [1.0]), "/solution/z is unknown, not part of"),
        (GUESSES, without(NUMBER), "number_of_guesses is missing"),
        (GUESSES, put(NUMBER, [2]), "/guesses/2 is missing"),
        (GUESSES, put(NUMBER, [0]), "/guesses/1 is unknown"),
        (GUESSES, put(NUMBER, [-1]), "number_of_guesses is -1"),
        (GUESSES, put(NUMBER, [2**30]), "number_of_guesses is 1073741824"),
        (GUESSES, shorter("/guesses/1/u"), "/guesses/1/u has 245 entries"),
    ],
)
def test_wrong_solutions_and_guesses_are_named(
    read: Callable[[Path], Any], change: Change, said: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=said):
        read(altered("box_stacks_i0122_82", change, tmp_path))


def test_paths_that_are_not_files(tmp_path: Path) -> None:
    half = path("nespheres_10").read_bytes()
    (tmp_path / "b").write_bytes(half[: len(half) // 2])
    (tmp_path / "a").write_text("text")
    wrong: list[tuple[Any, type[Exception], str]] = [
        (tmp_path / "none.hdf5", FileNotFoundError, "none"),
        (tmp_path, IsADirectoryError, "."),
        (tmp_path / "a", ValueError, "cannot be read as HDF5"),
        (tmp_path / "b", ValueError, "b cannot be read as HDF5"),
        (3, TypeError, "path is a int, expected the name of a file"),
    ]
    for place, error, said in wrong:
        with pytest.raises(error, match=said):
            fclib.read(place)
    with pytest.raises(TypeError, match="path is a int, expected the name of a file"):
        fclib.write(3, pressed.square())  # type: ignore[arg-type]
    missing = tmp_path / "none" / "a.hdf5"
    with pytest.raises(FileNotFoundError) as refused:
        fclib.write(missing, pressed.square())
    reason = os.strerror(errno.ENOENT)
    assert str(refused.value) == f"cannot write {missing}: {reason}"


@pytest.mark.parametrize(
    ("source", "name", "arrays"),
    [("nespheres_10", LOCAL + "/W", "ix"), ("fe_cube_h8_9c", GLOBAL + "/M", "ipx")],
)
def test_unused_space_is_not_read(
    source: str, name: str, arrays: str, tmp_path: Path
) -> None:
    """Arrays have nzmax entries; only nz of them, or those up to the last pointer, count."""
    longer = [
        edit(f"{name}/{letter}", lambda array: np.append(array, np.full(5, 10**6)))
        for letter in arrays
    ]
    room = edit(f"{name}/nzmax", lambda count: count + 5)
    target = altered(source, several(room, *longer), tmp_path)
    ours, theirs = fclib.read(target), fclib.read(path(source))
    assert parts(getattr(ours, name[-1])) == parts(getattr(theirs, name[-1]))


def vectors(*shapes: tuple[int, ...]) -> fclib.Vectors:
    return fclib.Vectors(*map(np.zeros, shapes))


NAN = fclib.Vectors(np.zeros((7, 2)), np.full((7, 2), np.nan))


@pytest.mark.parametrize(
    ("name", "given", "error", "said"),
    [
        ("problem", None, TypeError, "problem is a NoneType"),
        ("solution", 3, TypeError, "solution is a int, expected a Solution"),
        ("guesses", [3], TypeError, r"guesses\[0\] is a int"),
        ("info", {"name": "x"}, ValueError, "info has 'name', expected title"),
        ("solution", vectors((1, 2), (1, 2)), ValueError, "u of solution has shape"),
        ("solution", NAN, ValueError, "r of solution is nan"),
        (
            "solution",
            vectors((7, 2), (7, 2), (2,)),
            ValueError,
            "v of solution should be None: the problem has none",
        ),
    ],
)
def test_wrong_arguments(
    name: str, given: Any, error: type[Exception], said: str, tmp_path: Path
) -> None:
    known: dict[str, Any] = {"problem": pressed.square(), name: given}
    with pytest.raises(error, match=said):
        fclib.write(tmp_path / "a.hdf5", **known)
    assert list(tmp_path.iterdir()) == []
