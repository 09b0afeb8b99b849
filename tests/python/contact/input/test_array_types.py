"""Unusual types of valid arguments give the same bits, or an error with a message.

Entries are small multiples of 1/8, which every type below represents exactly. So only
the type, the memory layout and the container differ.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp

Array = NDArray[np.float64]

K = np.array(
    [
        [4, 1, -0.5, 0, 0, 0],
        [1, 3, 0, -0.25, 0, 0],
        [-0.5, 0, 4, 1, -0.5, 0],
        [0, -0.25, 1, 3, 0, -0.25],
        [0, 0, -0.5, 0, 4, 1],
        [0, 0, 0, -0.25, 1, 3],
    ]
)
B = np.eye(6)
LOAD = np.array([-3.0, 0.25, -2.0, 1.5, 0.5, -0.5])
W = np.array([[2, 0.5, 0.25, 0], [0.5, 1, 0, 0], [0.25, 0, 2, 0.5], [0, 0, 0.5, 1]])
GIVEN: dict[str, Array] = {
    "K": K,
    "B": B,
    "gap": np.array([0.0, 0.125, 0.0]),
    "mu": np.array([0.5, 0.25, 0.375]),
    "area": np.array([1.0, 2.0, 0.5]),
    "points": np.arange(6.0).reshape(3, 2),
    "load": np.stack([LOAD, LOAD / 2]),
    "prescribed": np.array([[0.0], [0.125]]),
    "W": W,
    "q": np.array([[-1.0, 0.75], [-0.5, -2.0]]),
    "mu of W": np.array([0.5, 0.25]),
    "start": np.array([[0.5, 0.25], [0.25, 0.0]]),
    "R": np.tile(np.eye(2), (2, 1)),
    "e": np.array([-1.0, 0.125]),
    "r": np.array([[0.5, 0.25], [0.25, 0.0]]),
    "tau": np.array([[1.0, 0.25], [-1.0, 2.0], [0.5, 4.0]]),
    "mu of tau": np.array([0.5, 0.25, 0.375]),
    "base": np.array([[0.5, 0.25], [0.0, 0.0], [0.125, 0.0]]),
}
MATRICES = ("K", "B", "W")


def answers(given: dict[str, Any]) -> list[Array]:
    """All results, of every function that takes the argument."""
    problem = bp.ContactProblem(
        given["K"],
        given["B"],
        gap=given["gap"],
        mu=given["mu"],
        fixed=[5],
        area=given["area"],
        points=given["points"],
    )
    path = problem.solve(given["load"], given["prescribed"])
    W, q, mu = given["W"], given["q"], given["mu of W"]
    reduced = bp.ReducedProblem(W, q, mu)
    rigid = bp.ReducedProblem(W, q, mu, rigid=(given["R"], given["e"]))
    solutions = [reduced.solve(start=given["start"]), rigid.solve()]
    projected, status = bp.project(given["tau"], given["mu of tau"], given["base"])
    traction = path.traction
    assert traction is not None
    return [
        path.reaction,
        path.displacement,
        traction,
        *(s.reaction for s in solutions),
        *(s.relative_displacement for s in solutions),
        np.array([s.residual for s in solutions]),
        np.array([reduced.residual(given["r"])]),
        projected,
        status.astype(float),
        path.contacts["x"],
    ]


PLAIN = answers(GIVEN)


def equal(values: list[Array], expected: list[Array]) -> None:
    for value, other in zip(values, expected, strict=True):
        np.testing.assert_array_equal(value, other)


def strided(x: Array) -> Array:
    wide = np.full(tuple(3 * n for n in x.shape), np.nan)
    view = wide[tuple(slice(1, None, 3) for _ in x.shape)]
    view[...] = x
    return view


def backwards(x: Array) -> Array:
    flipped = x[tuple(slice(None, None, -1) for _ in x.shape)].copy()
    return flipped[tuple(slice(None, None, -1) for _ in x.shape)]


def read_only(x: Array) -> Array:
    copy = x.copy()
    copy.flags.writeable = False
    return copy


def broadcast(x: Array) -> Array:
    # Where rows are equal, an array whose first axis has no stride; otherwise a view.
    return np.broadcast_to(x[:1], x.shape) if (x == x[:1]).all() else x[...]


class Wrapped:
    """An array of another library."""

    def __init__(self, array: Array) -> None:
        self.array = array

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        # `copy=None` is known since NumPy 2 only.
        array_given = np.asarray(self.array, dtype=dtype)
        return array_given.copy() if copy else array_given


CLOTHES: dict[str, Callable[[Array], Any]] = {
    "float32": lambda x: x.astype(np.float32),
    "float16": lambda x: x.astype(np.float16),
    "longdouble": lambda x: x.astype(np.longdouble),
    "big-endian": lambda x: x.astype(">f8"),
    "little-endian": lambda x: x.astype("<f8"),
    "Fortran": np.asfortranarray,
    "read-only": read_only,
    "strided": strided,
    "backwards": backwards,
    "transposed twice": lambda x: np.ascontiguousarray(x.T).T,
    "broadcast": broadcast,
    "unaligned": lambda x: (
        np.frombuffer(b"x" + x.tobytes(), dtype=np.uint8)[1:]
        .view(np.float64)
        .reshape(x.shape)
    ),
    "lists": lambda x: x.tolist(),
    "tuples": lambda x: tuple(
        tuple(row) if isinstance(row, list) else row for row in x.tolist()
    ),
    "list of arrays": list,
    "memoryview": lambda x: memoryview(np.ascontiguousarray(x)),
    "another library's": Wrapped,
    "subclass": lambda x: x.view(type("Sub", (np.ndarray,), {})),
    "unmasked": lambda x: np.ma.masked_array(x),
    "signed zeros": lambda x: np.where(x == 0, -0.0, x),
}


@pytest.mark.parametrize("clothes", CLOTHES)
def test_dense(clothes: str) -> None:
    """All arguments at once; the arrays of the caller stay as they are."""
    worn = {name: CLOTHES[clothes](plain) for name, plain in GIVEN.items()}
    before = [np.array(array).tobytes() for array in worn.values()]
    equal(answers(worn), PLAIN)
    assert before == [np.array(array).tobytes() for array in worn.values()]


@pytest.mark.parametrize("kind", [np.int8, np.int32, np.int64, np.uint8, np.uint64])
@pytest.mark.parametrize("argument", GIVEN)
def test_integers(argument: str, kind: type) -> None:
    whole = np.abs(GIVEN[argument] * 8) if kind in (np.uint8, np.uint64) else None
    plain = GIVEN[argument] * 8 if whole is None else whole
    if argument == "K" and whole is not None:
        plain = np.diag(np.arange(1.0, 7.0))
    expected = answers(GIVEN | {argument: plain})
    equal(answers(GIVEN | {argument: plain.astype(kind)}), expected)


def unsorted(x: Any) -> Any:
    """CSR with the entries of each row in reverse order."""
    csr = sparse.csr_array(x)
    for begin, end in zip(csr.indptr[:-1], csr.indptr[1:], strict=True):
        csr.indices[begin:end] = csr.indices[begin:end][::-1].copy()
        csr.data[begin:end] = csr.data[begin:end][::-1].copy()
    csr.has_sorted_indices = False
    return csr


def doubled(x: Any) -> Any:
    """Each entry stored as two halves, whose sum is exact."""
    coo = sparse.coo_array(x)
    row, column = np.tile(coo.row, 2), np.tile(coo.col, 2)
    return sparse.coo_array((np.tile(coo.data / 2, 2), (row, column)), shape=x.shape)


def doubled_csr(x: Any) -> Any:
    """The same in CSR, with the repeated entries not summed."""
    csr = sparse.csr_array(x)
    counts = 2 * np.diff(csr.indptr)
    rows = np.split(np.arange(csr.nnz), csr.indptr[1:-1])
    order = np.concatenate([np.tile(row, 2) for row in rows])
    parts = csr.data[order] / 2, csr.indices[order], np.append(0, np.cumsum(counts))
    return sparse.csr_array(parts, shape=x.shape)


def explicit_zeros(x: Any) -> Any:
    """Every entry stored, zeros included."""
    rows, columns = np.indices(x.shape).reshape(2, -1)
    return sparse.coo_array((x.ravel(), (rows, columns)), shape=x.shape).tocsr()


def wide_indices(x: Any) -> Any:
    csr = sparse.csr_array(x)
    csr.indices, csr.indptr = csr.indices.astype(np.int64), csr.indptr.astype(np.int64)
    return csr


def read_only_sparse(x: Any) -> Any:
    csr = unsorted(x)
    for part in (csr.data, csr.indices, csr.indptr):
        part.flags.writeable = False
    return csr


def longer_than_needed(x: Any) -> Any:
    """Arrays with unused space after the last entry, as an assembly may leave them."""
    csr = sparse.csr_array(x)
    csr.data = np.append(csr.data, [np.nan, 1e300])
    csr.indices = np.append(csr.indices, [0, 0]).astype(csr.indices.dtype)
    return csr


FORMATS = ("csr", "csc", "coo", "lil", "dok", "bsr", "dia")
SPARSE: dict[str, Callable[[Array], Any]] = {
    **{
        f"{form} {kind.__name__}": (
            lambda x, form=form, kind=kind: kind(x).asformat(form)
        )
        for form in FORMATS
        for kind in (sparse.csr_array, sparse.csr_matrix)
    },
    "csr float32": lambda x: sparse.csr_array(x.astype(np.float32)),
    "coo float32": lambda x: sparse.coo_array(x.astype(np.float32)),
    "unsorted": unsorted,
    "unsorted columns": lambda x: unsorted(x.T).T,
    "doubled": doubled,
    "doubled rows": doubled_csr,
    "doubled blocks": lambda x: sparse.bsr_array(doubled_csr(x), blocksize=(2, 2)),
    "explicit zeros": explicit_zeros,
    "64-bit indices": wide_indices,
    "read-only": read_only_sparse,
    "room behind": longer_than_needed,
    "longdouble": lambda x: sparse.coo_array(x.astype(np.longdouble)),
    "blocks of two": lambda x: sparse.bsr_array(x, blocksize=(2, 2)),
    "np.matrix": lambda x: x.view(np.matrix),
}


def contents(matrix: Any) -> list[bytes]:
    """The contents of the caller's object, byte by byte."""
    if isinstance(matrix, np.ndarray):
        return [matrix.tobytes()]
    names = ("data", "indices", "indptr", "row", "col", "offsets", "rows")
    parts = [getattr(matrix, name) for name in names if hasattr(matrix, name)]
    if matrix.format == "dok":
        parts = [np.array(sorted(matrix.items()), dtype=object)]
    return [np.array(part).tobytes() for part in parts if part is not None]


@pytest.mark.parametrize("argument", MATRICES)
@pytest.mark.parametrize("clothes", SPARSE)
def test_sparse(argument: str, clothes: str) -> None:
    worn = SPARSE[clothes](GIVEN[argument])
    before = contents(worn)
    equal(answers(GIVEN | {argument: worn}), PLAIN)
    if not clothes.startswith("lil"):
        assert contents(worn) == before


@pytest.mark.parametrize("argument", ["mu", "mu of W", "mu of tau"])
def test_one_number_for_all(argument: str) -> None:
    size = len(GIVEN[argument])
    plain = answers(GIVEN | {argument: np.full(size, 0.25)})
    numbers = 0.25, np.float32(0.25), np.array(0.25), np.array(0.25, dtype=">f4")
    for worn in (*numbers, np.full(size, 0.25)[::-1]):
        equal(answers(GIVEN | {argument: worn}), plain)


@pytest.mark.parametrize(
    "fixed",
    [
        [5],
        (5,),
        np.array([5], np.int8),
        np.array([5], np.uint64),
        np.array([5], ">i4"),
        np.array([[5, 9]])[0, ::2],
        range(5, 6),
        memoryview(np.array([5])),
    ],
    ids=lambda x: type(x).__name__,
)
def test_indices(fixed: Any) -> None:
    problem = bp.ContactProblem(K, B, gap=GIVEN["gap"], mu=0.25, fixed=fixed)
    plain = bp.ContactProblem(K, B, gap=GIVEN["gap"], mu=0.25, fixed=[5])
    np.testing.assert_array_equal(
        problem.solve(LOAD).reaction, plain.solve(LOAD).reaction
    )


def test_number_types_of_settings() -> None:
    problem = bp.ReducedProblem(W, GIVEN["q"], 0.25)
    plain = problem.solve(tol=2.0**-30, max_iterations=100, max_seconds=60.0)
    worn = problem.solve(
        tol=np.float32(2.0**-30),  # type: ignore[arg-type]
        max_iterations=np.uint8(100),  # type: ignore[arg-type]
        max_seconds=np.array(60),  # type: ignore[arg-type]
    )
    np.testing.assert_array_equal(worn.reaction, plain.reaction)
    assert worn.tolerance == plain.tolerance
