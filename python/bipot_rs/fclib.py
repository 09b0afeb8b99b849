"""Read and write FCLIB files, the HDF5 format of a collection of contact problems.

The local form is the reduced problem (5), the global form a `GlobalProblem`; components
are normal first. ``/fclib_local`` contains ``spacedim``, the matrix ``W`` and
``vectors/{q, mu}``; ``/fclib_global`` the matrices ``M``, ``H`` and ``vectors/{f, w, mu}``.
A matrix is ``m, n, nz, nzmax, p, i, x``: ``nz >= 0`` means triplets (rows ``i``, columns
``p``), -1 compressed columns, -2 compressed rows. ``/solution`` and ``/guesses`` contain
solutions and starts.

The optional ``V``, ``R`` and ``s`` of the local form (``u = W r + V λ + q`` with
``Vᵀ r + R λ + s = 0``) are the ``rigid`` of `ReducedProblem` if ``R`` is zero. Any other
``R``, and the constraints ``G``, ``b`` of the global form, are refused.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.messages import count_noun, make_type_error
from bipot_rs._lib.optional import load_library
from bipot_rs._lib.types import AnyArray, Floats, Integers, MatrixLike, SparseMatrix
from bipot_rs._lib.validation import floats
from bipot_rs.contact.global_problem import GlobalProblem
from bipot_rs.contact.path.moving_gaps import read_gap
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.reduced import ReducedProblem
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Solution
from bipot_rs.files.drafts import aside, place

__all__ = [
    "GlobalProblem",
    "Vectors",
    "read",
    "read_guesses",
    "read_info",
    "read_solution",
    "write",
    "write_path",
]

if TYPE_CHECKING:
    from h5py import Group

Path_ = str | os.PathLike[str]
Numbers = TypeVar("Numbers", bound=AnyArray)
_TRIPLETS, _COLUMNS, _ROWS = 0, -1, -2
_INFO = ("title", "description", "math_info")
# A compressed array has at most about a thousand times the size of its file. One that
# claims more is damaged; reading it would fill the memory with zeros.
_INFLATION = 2000
# Entries of V up to which it is dense, 8 MB: dense columns take less time than sparse ones.
_DENSE_MOTIONS = 1 << 20


class Vectors(NamedTuple):
    """A solution or a guess in a file.

    Attributes
    ----------
    u, r
        Relative displacement (in dynamics, velocity) and reaction, ``(n_c, d)``.
    v
        Velocity ``(n,)`` of the global form; ``None`` for the local form.
    multiplier
        λ, ``l`` in the file, ``(p,)``: the amplitudes of rigid motions; or ``None``.
    """

    u: Floats
    r: Floats
    v: Floats | None = None
    multiplier: Floats | None = None


def require() -> None:
    """Import the libraries for files early: an import may fail, or take long."""
    load_library("h5py")
    import scipy.sparse.csgraph  # noqa: F401


def read(path: Path_) -> ReducedProblem | GlobalProblem:
    """Read a problem: a `ReducedProblem` (local form) or a `GlobalProblem`.

    Matrices stay sparse, in the storage and order of the file.

    Raises
    ------
    OSError
        There is no such file, or no permission to read it.
    ValueError
        It is not HDF5, or not FCLIB; the message gives the full name of the group or
        dataset that is missing, wrong, or unknown.
    MemoryError
        The problem does not fit into memory.
    """
    with _open(path) as file:
        if file.form() == "local":
            q, mu, W, rigid = _read_local(file)
            return ReducedProblem(W, q, mu, rigid=rigid)
        M, H, f, w, mu = _read_global(file)
        return GlobalProblem(M, H, f, w, mu)


def read_solution(path: Path_) -> Vectors | None:
    """Read the ``/solution`` of a file, ``None`` if there is none; raises as `read`."""
    with _open(path) as file:
        return (
            _read_vectors(file, "/solution") if "solution" in file.names("/") else None
        )


def read_guesses(path: Path_) -> list[Vectors]:
    """Read the ``/guesses`` of a file, ``[]`` if there are none; raises as `read`."""
    with _open(path) as file:
        if "guesses" not in file.names("/"):
            return []
        count = file.number("/guesses/number_of_guesses")
        numbers = [
            str(k + 1) for k in range(max(min(count, len(file.names("/guesses"))), 0))
        ]
        if count != len(numbers):
            raise _Fault(
                f"/guesses/number_of_guesses is {count}, but there are {len(numbers)}"
            )
        file.expect("/guesses", ("number_of_guesses", *numbers))
        return [_read_vectors(file, f"/guesses/{k}") for k in numbers]


def read_info(path: Path_) -> dict[str, str]:
    """Read ``title``, ``description`` and ``math_info``, as far as they exist."""
    with _open(path) as file:
        group = f"/fclib_{file.form()}"
        if "info" not in file.names(group):
            return {}
        names = file.names(f"{group}/info")
        return {k: file.text(f"{group}/info/{k}") for k in _INFO if k in names}


def write(
    path: Path_,
    problem: ReducedProblem | GlobalProblem,
    solution: Solution | Vectors | None = None,
    *,
    guesses: Sequence[Solution | Vectors] = (),
    info: Mapping[str, str] | None = None,
) -> None:
    """Write a problem to a file, with a solution and guesses if given.

    Sparse matrices in COO, CSC or CSR keep their storage and entries. Other sparse
    matrices and dense ones are written as CSR, dense ones with all entries, zeros
    included. `read` returns bitwise the same numbers.

    Parameters
    ----------
    path
        File to write or to replace.
    solution
        Written to ``/solution``; a `Solution` that has not converged becomes the last of
        the guesses instead.
    guesses
        Starts, written to ``/guesses``.
    info
        ``title``, ``description``, ``math_info``. The defaults give the name of the file,
        this program and its version, and the residual η.

    Raises
    ------
    TypeError, ValueError
        An argument of the wrong type or shape, or with too many entries for the 32-bit
        integers of the format.
    OSError
        The file cannot be written; an earlier one is unchanged.
    """
    h5py = load_library("h5py")
    target = place(path)
    if not isinstance(problem, (ReducedProblem, GlobalProblem)):
        raise TypeError(
            f"problem is a {type(problem).__name__}, expected a ReducedProblem or a "
            "GlobalProblem: use ContactProblem.reduced, or write_path for a whole path"
        )
    if problem.mu.ndim == 2:
        raise ValueError(
            f"mu has shape {problem.mu.shape}, expected ({len(problem.mu)},): FCLIB has one "
            "friction coefficient for each contact, not two"
        )
    problem.law.require_coulomb("FCLIB")
    unknown = sorted(set(info or {}) - set(_INFO))
    if unknown:
        raise ValueError(f"info has {unknown[0]!r}, expected {', '.join(_INFO)}")
    stored = [
        _check_vectors(f"guesses[{k}]", problem, g) for k, g in enumerate(guesses)
    ]
    answer = None if solution is None else _check_vectors("solution", problem, solution)
    words = _describe(target.stem, problem, solution) | dict(info or {})
    if isinstance(solution, Solution) and not solution.converged and answer is not None:
        stored.append(answer)
        answer = None
    # Through a file of Python, as in `export.write_result`.
    with aside(target) as draft, draft.open("w+b") as raw, h5py.File(raw, "w") as file:
        if isinstance(problem, GlobalProblem):
            group = file.create_group("fclib_global")
            group["spacedim"] = _as_int32(problem.w.shape[1])
            _write_matrix(group.create_group("M"), problem.M)
            _write_matrix(group.create_group("H"), problem.H)
            named = {"f": problem.f, "w": problem.w, "mu": problem.mu}
        else:
            group = file.create_group("fclib_local")
            group["spacedim"] = _as_int32(problem.q.shape[1])
            _write_matrix(group.create_group("W"), problem.W)
            named = {"q": problem.q, "mu": problem.mu}
            if problem.rigid is not None:
                from scipy.sparse import csc_array

                modes, named["s"] = problem.rigid
                count = len(named["s"])
                _write_matrix(group.create_group("V"), modes)
                _write_matrix(group.create_group("R"), csc_array((count, count)))
        vectors = group.create_group("vectors")
        for name, array in named.items():
            vectors[name] = array.ravel()
        texts = group.create_group("info")
        for name, text in words.items():
            # The C library reads strings of fixed length that end with a zero byte.
            texts[name] = np.bytes_(text.encode() + b"\0")
        if answer is not None:
            _write_vectors(file.create_group("solution"), answer)
        if stored:
            group = file.create_group("guesses")
            group["number_of_guesses"] = _as_int32(len(stored))
            for k, guess in enumerate(stored):
                _write_vectors(group.create_group(str(k + 1)), guess)


def write_path(
    stem: Path_,
    problem: ContactProblem,
    result: Result,
    *,
    info: Mapping[str, str] | None = None,
) -> list[Path]:
    """Write each step of a load path as a local problem with its solution.

    ``q`` contains the slip of the earlier steps, (22): each file is a complete problem.

    ``stem``: ``DIR/NAME`` for ``DIR/NAME-0000.hdf5`` and so on.
    ``problem, result``: a problem, and what its `ContactProblem.solve` returned.
    ``info``: as in `write`, the same for all steps; ``title`` is followed by the step.
    Returns ``paths``: the files, in order.
    Raises `TypeError` or `ValueError`: as in `write`; or the loads of the result are unknown,
    since it was read from a file.
    Raises `MemoryError`: the dense ``W`` does not fit into memory.
    Raises `OSError`: a file cannot be written.
    """
    if not isinstance(problem, ContactProblem):
        raise make_type_error("problem", problem, "a ContactProblem")
    if not isinstance(result, Result):
        raise make_type_error("result", result, "a Result")
    before = result.start
    base, titles, paths = place(stem, "stem"), dict(info or {}), []
    for k, step in enumerate(result):
        if step.load is None:
            raise ValueError(
                "the loads of the result are unknown, since it was read from a file: pass "
                "the result that solve returned"
            )
        reduced = problem.reduced(
            step.load, step.prescribed, before, gap=read_gap(step)
        )
        u = np.column_stack([step.relative_displacement[:, 0], step.slip])
        path = base.with_name(f"{base.name}-{k:04d}.hdf5")
        title = f"{titles.get('title', base.name)}, step {k + 1} of {len(result)}"
        words = _describe(base.name, reduced, step) | titles | {"title": title}
        answer = Vectors(u, step.reaction, None, step.rigid_motion)
        write(path, reduced, answer, info=words)
        paths.append(path)
        before = step
    return paths


class _Fault(ValueError):
    """A mistake in the content of a file; the message does not name the file."""


class _File:
    """An open file; its methods take full names of groups and datasets."""

    def __init__(self, file: Group, size: int) -> None:
        self.file, self.size = file, size

    def form(self) -> str:
        """``local`` or ``global``."""
        here = self.names("/")
        forms = [form for form in ("local", "global") if f"fclib_{form}" in here]
        if len(forms) != 1:
            which = "both" if forms else "neither"
            raise _Fault(
                f"expected one of /fclib_local and /fclib_global, found {which}"
            )
        self.expect("/", (f"fclib_{forms[0]}",), ("solution", "guesses"))
        return forms[0]

    def names(self, group: str) -> list[str]:
        """Members of a group."""
        import h5py

        item = self.file.get(group)
        if item is None:
            raise _Fault(f"{group} is missing")
        if not isinstance(item, h5py.Group):
            raise _Fault(f"{group} is a dataset, expected a group")
        return list(item)

    def expect(
        self, group: str, needed: Collection[str], optional: Collection[str] = ()
    ) -> None:
        """Refuse a group with a missing or an unknown member."""
        here = self.names(group)
        below = group.rstrip("/")
        for name in needed:
            if name not in here:
                raise _Fault(f"{below}/{name} is missing")
        for name in here:
            if name not in needed and name not in optional:
                raise _Fault(f"{below}/{name} is unknown, not part of the format")

    def _data(self, name: str, kinds: str, expected: str) -> AnyArray:
        import h5py

        item = self.file.get(name)
        if item is None:
            raise _Fault(f"{name} is missing")
        if not isinstance(item, h5py.Dataset):
            raise _Fault(f"{name} is a group, expected a dataset")
        if item.dtype.kind not in kinds or item.size is None:
            raise _Fault(f"{name} holds {item.dtype}, expected {expected}")
        if item.nbytes > _INFLATION * self.size:
            raise _Fault(
                f"{name} has {count_noun(item.size, 'entry')}, more than its file can hold"
            )
        return np.asarray(item[()])

    def number(self, name: str) -> int:
        """One integer, a scalar or an array with one entry."""
        entries = self._data(name, "iu", "an integer")
        if entries.size != 1:
            raise _Fault(f"{name} has {entries.size} entries, expected one")
        return int(entries.ravel()[0])

    def integers(self, name: str) -> Integers:
        """A vector of integers."""
        integers: Integers = self._data(name, "iu", "integers")  # type: ignore[assignment]
        return self._vector(name, integers)

    def floats(self, name: str, length: int | None = None) -> Floats:
        """A vector of finite numbers."""
        vector = self._vector(name, self._data(name, "iuf", "real numbers"))
        if length is not None and len(vector) != length:
            raise _Fault(
                f"{name} has {count_noun(len(vector), 'entry')}, expected {length}"
            )
        with np.errstate(over="ignore"):
            numbers = vector.astype(np.float64)
        if not np.isfinite(numbers).all():
            at = int(np.argmin(np.isfinite(numbers)))
            raise _Fault(
                f"{name} is {numbers[at]} at position {at}, expected finite numbers"
            )
        return numbers

    def friction(self, name: str, length: int) -> Floats:
        """Friction coefficients."""
        mu = self.floats(name, length)
        if (mu < 0).any():
            at = int(np.argmax(mu < 0))
            raise _Fault(
                f"{name} is {mu[at]} at position {at}, expected zero or positive"
            )
        return mu

    def text(self, name: str) -> str:
        """A string of fixed or variable length."""
        texts = self._data(name, "SO", "text").ravel()
        if texts.size != 1 or not isinstance(texts[0], (bytes, str)):
            raise _Fault(f"{name} has {texts.size} entries, expected one text")
        raw = texts[0]
        text = raw if isinstance(raw, str) else raw.decode("utf-8", errors="replace")
        return text.rstrip("\0")

    def shape(self, name: str) -> tuple[int, int]:
        """Rows and columns of a matrix."""
        self.expect(
            name,
            ("m", "n", "nz", "nzmax", "p", "i", "x"),
            ("comment", "conditioning", "determinant", "rank"),
        )
        rows, columns = self.number(f"{name}/m"), self.number(f"{name}/n")
        for letter, value in (("m", rows), ("n", columns)):
            if value < 0:
                raise _Fault(f"{name}/{letter} is {value}, expected zero or more")
        return rows, columns

    def matrix(self, name: str) -> SparseMatrix:
        """A matrix in the storage of the file; the caller has checked its shape."""
        from scipy.sparse import coo_array, csc_array, csr_array

        rows, columns = shape = self.shape(name)
        storage, room = self.number(f"{name}/nz"), self.number(f"{name}/nzmax")
        if storage < _ROWS:
            raise _Fault(
                f"{name}/nz is {storage}, expected the number of triplets, or -1 for "
                "compressed columns, or -2 for compressed rows"
            )
        p, i = self.integers(f"{name}/p"), self.integers(f"{name}/i")
        x = self.floats(f"{name}/x")
        if storage >= _TRIPLETS:
            count = storage
            lengths = {"p": len(p)}
        else:
            pointers = 1 + (columns if storage == _COLUMNS else rows)
            if len(p) != pointers:
                raise _Fault(
                    f"{name}/p has {count_noun(len(p), 'entry')}, expected {pointers}"
                )
            if p[0] != 0 or (np.diff(p.astype(np.int64)) < 0).any():
                raise _Fault(f"{name}/p should ascend from 0")
            count = int(p[-1])
            lengths = {}
        if count > room:
            raise _Fault(f"{name}/nzmax is {room}, expected {count} or more")
        # Unused space at the end may be stored or not.
        for letter, length in (lengths | {"i": len(i), "x": len(x)}).items():
            if length not in (count, room):
                raise _Fault(
                    f"{name}/{letter} has {count_noun(length, 'entry')}, expected {count}"
                )
        i, x = i[:count], x[:count]
        if storage >= _TRIPLETS:
            p = p[:count]
            _check_indices(f"{name}/i", i, rows)
            _check_indices(f"{name}/p", p, columns)
            triplets: SparseMatrix = coo_array((x, (i, p)), shape=shape)
            return triplets
        _check_indices(f"{name}/i", i, rows if storage == _COLUMNS else columns)
        kind = csc_array if storage == _COLUMNS else csr_array
        compressed: SparseMatrix = kind((x, i, p), shape=shape)
        return compressed

    def _vector(self, name: str, stored: Numbers) -> Numbers:
        if stored.ndim != 1:
            raise _Fault(
                f"{name} has {count_noun(stored.ndim, 'dimension')}, expected 1"
            )
        return stored


def _check_indices(name: str, indices: Integers, limit: int) -> None:
    outside = (indices < 0) | (indices >= limit)
    if outside.any():
        at = int(np.argmax(outside))
        raise _Fault(
            f"{name} is {indices[at]} at position {at}, expected 0 to {limit - 1}"
        )


@contextmanager
def _open(path: Path_) -> Iterator[_File]:
    """Open a file; messages about its content begin with its path."""
    h5py = load_library("h5py")
    name = str(place(path))
    if not Path(name).is_file():
        # The message of h5py does not distinguish a folder from a missing file.
        kind = IsADirectoryError if Path(name).is_dir() else FileNotFoundError
        raise kind(f"{name} is not a file")
    try:
        file = h5py.File(name, "r")
    except PermissionError:
        raise
    except OSError as error:
        raise ValueError(f"{name} cannot be read as HDF5: {error}") from None
    with file:
        try:
            yield _File(file, Path(name).stat().st_size)
        except ValueError as fault:
            # A `_Fault`, or an error of the problem made from the file.
            raise ValueError(f"{name}: {fault}") from None
        except (OSError, RuntimeError, KeyError, TypeError, OverflowError) as error:
            # Errors of HDF5 for a damaged file.
            raise ValueError(f"{name} is damaged: {error}") from None


def _read_local(
    file: _File,
) -> tuple[Floats, Floats, SparseMatrix, tuple[MatrixLike, Floats] | None]:
    group = "/fclib_local"
    file.expect(group, ("spacedim", "W", "vectors"), ("V", "R", "info"))
    size, d = _read_sizes(file)
    here = file.names(group)
    constrained = "V" in here
    if constrained != ("R" in here):
        raise _Fault(f"{group}/{'R' if constrained else 'V'} is missing")
    file.expect(f"{group}/vectors", ("q", "mu", "s") if constrained else ("q", "mu"))
    q = file.floats(f"{group}/vectors/q", size).reshape(-1, d)
    mu = file.friction(f"{group}/vectors/mu", size // d)
    if not constrained:
        return q, mu, file.matrix(f"{group}/W"), None
    rows, count = file.shape(f"{group}/V")
    if rows != size:
        raise _Fault(f"{group}/V/m is {rows}, expected {size}")
    if file.shape(f"{group}/R") != (count, count):
        raise _Fault(
            f"{group}/R is {file.shape(f'{group}/R')}, expected {(count, count)}"
        )
    s = file.floats(f"{group}/vectors/s", count)
    if file.matrix(f"{group}/R").tocsr().data.any():
        raise _Fault(
            f"{group}/R is not zero: constraints with a compliance of their own are not "
            "supported, only rigid motions"
        )
    W, V = file.matrix(f"{group}/W"), file.matrix(f"{group}/V")
    motions = V if rows * count > _DENSE_MOTIONS else V.toarray()
    return q, mu, W, (motions, s) if count else None


def _read_global(
    file: _File,
) -> tuple[SparseMatrix, SparseMatrix, Floats, Floats, Floats]:
    group = "/fclib_global"
    file.expect(group, ("spacedim", "M", "H", "vectors"), ("G", "info"))
    size, d = _read_sizes(file)
    n = file.shape(f"{group}/M")[0]
    file.expect(f"{group}/vectors", ("f", "w", "mu"), ("b",))
    if "G" in file.names(group):
        if file.shape(f"{group}/G")[1]:
            raise _Fault(
                f"{group}/G is not empty: equality constraints are not supported"
            )
    elif "b" in file.names(f"{group}/vectors"):
        raise _Fault(f"{group}/G is missing, but there is {group}/vectors/b")
    f = file.floats(f"{group}/vectors/f", n)
    w = file.floats(f"{group}/vectors/w", size).reshape(-1, d)
    mu = file.friction(f"{group}/vectors/mu", size // d)
    return file.matrix(f"{group}/M"), file.matrix(f"{group}/H"), f, w, mu


def _read_sizes(file: _File) -> tuple[int, int]:
    """Number of components of all contacts and of one: ``d n_c`` and ``d``."""
    group = f"/fclib_{file.form()}"
    d = file.number(f"{group}/spacedim")
    if d not in (2, 3):
        raise _Fault(f"{group}/spacedim is {d}, expected 2 or 3")
    square = f"{group}/{'W' if group.endswith('local') else 'M'}"
    rows, columns = file.shape(square)
    if rows != columns:
        raise _Fault(f"{square}/n is {columns}, expected {rows} as {square}/m")
    size, name = rows, f"{square}/m"
    if group.endswith("global"):
        height, size = file.shape(f"{group}/H")
        name = f"{group}/H/n"
        if height != rows:
            raise _Fault(f"{group}/H/m is {height}, expected {rows} as {square}/m")
    if size % d:
        raise _Fault(f"{name} is {size}, expected a multiple of {group}/spacedim, {d}")
    return size, d


def _read_vectors(file: _File, group: str) -> Vectors:
    form = f"/fclib_{file.form()}"
    size, d = _read_sizes(file)
    file.expect(group, ("u", "r"), ("v", "l"))
    here = file.names(group)
    u = file.floats(f"{group}/u", size).reshape(-1, d)
    r = file.floats(f"{group}/r", size).reshape(-1, d)
    v = multiplier = None
    if "v" in here:
        if form.endswith("local"):
            raise _Fault(f"{group}/v is unknown: {form} has no v")
        v = file.floats(f"{group}/v", file.shape(f"{form}/M")[0])
    if "l" in here:
        constraint = f"{form}/{'V' if form.endswith('local') else 'G'}"
        if constraint[-1] not in file.names(form):
            raise _Fault(f"{constraint} is missing, but there is {group}/l")
        multiplier = file.floats(f"{group}/l", file.shape(constraint)[1])
    return Vectors(u, r, v, multiplier)


def _check_vectors(
    what: str, problem: ReducedProblem | GlobalProblem, solution: Solution | Vectors
) -> Vectors:
    """Arrays of a solution or guess, checked against its problem."""
    if not isinstance(solution, (Solution, Vectors)):
        raise make_type_error(what, solution, "a Solution or Vectors")
    if isinstance(problem, GlobalProblem):
        shape, n, count = problem.w.shape, len(problem.f), None
    else:
        shape, n = problem.q.shape, None
        count = None if problem.rigid is None else len(problem.rigid[1])
    if isinstance(solution, Solution):
        v = problem.velocity(solution) if isinstance(problem, GlobalProblem) else None
        # The problem in the file has no rigid motions that condensation finds in M.
        multiplier = None if count is None else solution.rigid_motion
        solution = Vectors(
            solution.relative_displacement, solution.reaction, v, multiplier
        )

    def vector(name: str, value: ArrayLike | None, length: int | None) -> Floats | None:
        if value is None:
            return None
        if length is None:
            raise ValueError(f"{name} of {what} should be None: the problem has none")
        return floats(f"{name} of {what}", value, shape=(length,))

    return Vectors(
        floats(f"u of {what}", solution.u, shape=shape),
        floats(f"r of {what}", solution.r, shape=shape),
        vector("v", solution.v, n),
        vector("multiplier", solution.multiplier, count),
    )


def _describe(
    title: str,
    problem: ReducedProblem | GlobalProblem,
    solution: Solution | Vectors | None,
) -> dict[str, str]:
    """Default texts of ``info``."""
    from importlib.metadata import version

    form = "M v = H r + f, u = H^T v + w" if isinstance(problem, GlobalProblem) else ""
    size = "sqrt|M_ii M_jj|" if form else "the largest entry"
    told = [f"asymmetry {problem.asymmetry:.1e} of {size}"]
    if isinstance(solution, Solution):
        amounts = None if isinstance(problem, GlobalProblem) else solution.rigid_motion
        eta = problem.residual(solution.reaction, amounts)
        told += [
            f"residual eta {eta:.1e}: natural map of node-scaled variables, relative",
            f"outcome {solution.outcome}",
        ]
    return {
        "title": title,
        "description": f"written by bipot_rs {version('bipot-rs')}: "
        + (form or "u = W r + q")
        + ", normal first",
        "math_info": "; ".join(told),
    }


def _as_int32(value: int) -> NDArray[np.int32]:
    if value > np.iinfo(np.int32).max:
        raise ValueError(
            f"a matrix of the problem has {value} rows or entries, too many for the 32-bit "
            "integers of FCLIB"
        )
    return np.array([value], np.int32)


def _write_matrix(group: Group, matrix: SparseMatrix | Floats) -> None:
    if isinstance(matrix, np.ndarray) or not hasattr(matrix, "tocsr"):
        full = np.asarray(matrix, np.float64)
        shape, storage, x = full.shape, _ROWS, full.ravel()
        p: Integers = shape[1] * np.arange(shape[0] + 1)
        i: Integers = np.tile(np.arange(shape[1]), shape[0])
    elif matrix.format == "coo":
        shape, storage, entries = matrix.shape, matrix.nnz, matrix.tocoo()
        p, i, x = entries.col, entries.row, entries.data
    else:
        by_columns = matrix.format == "csc"
        shape, storage = matrix.shape, _COLUMNS if by_columns else _ROWS
        stored = matrix.tocsc() if by_columns else matrix.tocsr()
        # SciPy may have allocated more than it uses.
        used = int(stored.indptr[-1])
        p, i, x = stored.indptr, stored.indices[:used], stored.data[:used]
    for name, value in {"m": shape[0], "n": shape[1], "nzmax": len(x)}.items():
        group[name] = _as_int32(value)
    group["nz"] = np.array([storage], np.int32)
    group["p"] = np.asarray(p, np.int32)
    group["i"] = np.asarray(i, np.int32)
    group["x"] = np.asarray(x, np.float64)


def _write_vectors(group: Group, vectors: Vectors) -> None:
    named = {"v": vectors.v, "l": vectors.multiplier, "u": vectors.u, "r": vectors.r}
    for name, array in named.items():
        if array is not None:
            group[name] = np.ravel(array)
