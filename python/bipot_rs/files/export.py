"""Result files: HDF5, which can be read again, and PVD with VTU for ParaView.

Every file is written under another name and renamed when it is complete: if the disk is
full or the process is killed, the earlier file is unchanged. A result file ends with a
checksum, since HDF5 does not notice changed bits.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import repeat
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.messages import mistyped
from bipot_rs._lib.optional import missing

FORMAT = "bipot-result"
VERSION = 1
# Numbers of a step that are stored as datasets, not as attributes.
_SCALAR_DATASETS = ("residual", "load")
# The last line of a file. HDF5 ignores what follows its own end.
_SEAL = b"\nbipot-seal "
_SEAL_BYTES = len(_SEAL) + 2 * 16 + 1
# Results up to this many bytes are built in memory and written at once: HDF5 writes even
# a small file in hundreds of parts, and calls Python for each.
_IN_MEMORY = 2**25
# Deflate compresses at most 1032 to 1: an array that claims more is damaged.
_TIGHTEST = 1100


def require() -> None:
    """Import the libraries for files before a long solve, so that it does not fail later."""
    library("h5py")
    import_module("bipot_rs.files.vtu")


def library(name: str, *, extra: str = "io", need: str = "files") -> Any:
    """Import an optional library; ``need`` says what it is for.

    Raises
    ------
    ModuleNotFoundError
        It is not installed; the message names the extra that installs it.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise missing(error, need, name, extra) from None


def write_result(
    path: str | os.PathLike[str],
    contacts: Mapping[str, NDArray[Any] | None],
    steps: Sequence[Mapping[str, Any]],
    *,
    complete: bool,
    attributes: Mapping[str, Any] | None = None,
) -> None:
    """Write contacts and load steps to an HDF5 file.

    Parameters
    ----------
    path
        File to write or to replace.
    contacts
        Arrays of ``/contacts``, such as ``x (n_c, d)`` and ``mu (n_c,)``; ``None`` is
        left out.
    steps
        One mapping for each load step. Arrays become datasets of ``/steps/0000``, numbers
        and strings its attributes, except ``residual`` and ``load``, which become scalar
        datasets; ``None`` is left out.
    complete
        Whether the whole load path was solved.
    attributes
        Further attributes of the file.

    Raises
    ------
    OSError
        The file cannot be written; an earlier one is unchanged.
    """
    h5py = library("h5py")

    digits = max(4, len(str(max(len(steps) - 1, 0))))

    def fill(file: Any) -> None:
        ours = {"format": FORMAT, "version": VERSION, "complete": bool(complete)}
        for name, value in {**(attributes or {}), **ours, "sealed": True}.items():
            _label(h5py, file, name, value)
        group = file.create_group("contacts")
        for name, array in contacts.items():
            if array is not None:
                _store(h5py, group, name, array)
        group = file.create_group("steps")
        for number, step in enumerate(steps):
            one = group.create_group(f"{number:0{digits}d}")
            for name, value in step.items():
                if value is None:
                    continue
                if np.ndim(value) > 0 or name in _SCALAR_DATASETS:
                    _store(h5py, one, name, value)
                else:
                    _label(h5py, one, name, value)

    arrays = [contacts.values(), *(step.values() for step in steps)]
    held = sum(getattr(value, "nbytes", 0) for some in arrays for value in some)
    # HDF5 writes through a file of Python: with a file of its own it could not close it
    # on a full disk, and would end the process.
    with aside(path) as draft, draft.open("w+b") as raw:
        if held <= _IN_MEMORY:
            with h5py.File(draft.name, "w", driver="core", backing_store=False) as file:
                fill(file)
                file.flush()
                raw.write(file.id.get_file_image())
        else:
            with h5py.File(raw, "w") as file:
                fill(file)
        size = raw.seek(0, os.SEEK_END)
        seal = _SEAL + _digest(raw, size) + b"\n"
        raw.seek(size)
        raw.write(seal)
        raw.flush()
        # Some file systems report a full disk only now.
        os.fsync(raw.fileno())


def read_result(
    path: str | os.PathLike[str],
) -> tuple[dict[str, NDArray[Any]], list[dict[str, Any]], dict[str, Any]]:
    """Read a file written by `write_result`.

    Returns
    -------
    contacts, steps, attributes
        As given to `write_result`; ``attributes`` also contains ``complete`` and
        ``version``.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is not a result, damaged, or of a later version of the format.
    """
    h5py = library("h5py")

    source = place(path)
    if source.exists() and not source.is_file():
        raise OSError(f"{path} is not a file")
    sealed = _sealed(source)
    try:
        with h5py.File(source, "r") as file:
            attributes = {name: _plain(value) for name, value in file.attrs.items()}
            if attributes.pop("format", None) != FORMAT:
                raise ValueError(f"its format is not {FORMAT!r}")
            if attributes.get("version") != VERSION:
                raise ValueError(
                    f"it has version {attributes.get('version')} of the format, "
                    f"expected {VERSION}"
                )
            if attributes.pop("sealed", False) and not sealed:
                raise ValueError("its end is missing")
            limit = _TIGHTEST * source.stat().st_size
            contacts = _arrays(file["contacts"], limit)
            steps = []
            # By number: as text, step 10000 would come before step 9999.
            for name in sorted(file["steps"], key=int):
                group = file["steps"][name]
                step = {k: _plain(data) for k, data in _arrays(group, limit).items()}
                step.update({key: _plain(value) for key, value in group.attrs.items()})
                steps.append(step)
    except OSError as error:
        raise OSError(f"{path} cannot be read: {_sentence(error)}") from None
    except (LookupError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise ValueError(
            f"{path} is not a result that can be read: {_sentence(error)}"
        ) from None
    return contacts, steps, attributes


def write_series(
    path: str | os.PathLike[str],
    points: ArrayLike,
    cells: Sequence[tuple[str, NDArray[np.integer[Any]]]] | None,
    steps: Iterable[Mapping[str, Any]],
    of_cells: Iterable[Mapping[str, NDArray[Any]]] | None = None,
) -> None:
    """Write a PVD index, and one binary VTU file in the same folder for each load step.

    Parameters
    ----------
    path
        ``DIR/NAME.pvd``; step k is written to ``DIR/NAME_000k.vtu``. Further files of an
        earlier, longer series with this name are removed.
    points
        ``(points, d)``.
    cells
        Pairs of a kind (``"line"``, ``"triangle"``, ``"quad"``, ``"tetra"``,
        ``"hexahedron"``) and corners in the order of VTK; without them each point is a
        vertex.
    steps
        One mapping for each step. Arrays ``(points,)`` and ``(points, k)`` become fields;
        two components are extended by a zero. Everything else is left out. The time of a
        step is its number.
    of_cells
        One mapping for each step, with arrays ``(cells,)`` or ``(cells, k)``, which become
        fields of the cells.
    """
    series = Series(path, points, cells)
    for step, in_cells in zip(steps, of_cells or repeat({}), strict=False):
        series.add(step, in_cells)
    series.end()


class Series:
    """A series for ParaView that is written step by step, as by `write_series`.

    Parameters
    ----------
    path, points, cells
        As in `write_series`.
    piece, pieces
        Number of this piece of the mesh, and of all pieces, if several processes write the
        series together into one folder: ``DIR/NAME_000k_000i.vtu`` is piece i of step k.
        Piece 0 also writes ``DIR/NAME_000k.pvtu``, which lists the pieces, and the index.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        points: ArrayLike,
        cells: Sequence[tuple[str, NDArray[np.integer[Any]]]] | None,
        *,
        piece: int = 0,
        pieces: int = 1,
    ) -> None:
        from bipot_rs.files.vtu import Grid

        self._index = place(path)
        places = _three(np.asarray(points, dtype=float))
        if cells is None:
            cells = [("vertex", np.arange(len(places))[:, None])]
        self._points = len(places)
        self._grid = Grid(places, cells)
        self._piece, self._pieces = piece, pieces
        self._names: list[str] = []

    def add(
        self,
        step: Mapping[str, Any],
        of_cells: Mapping[str, NDArray[Any]] | None = None,
    ) -> None:
        """Write the next step."""
        from bipot_rs.files.vtu import listing

        fields = {
            name: _three(np.asarray(value))
            for name, value in step.items()
            if np.ndim(value) in (1, 2)
            and len(value) == self._points
            and np.asarray(value).dtype.kind in "fiub"
        }
        index = self._index
        name = f"{index.stem}_{len(self._names):04d}"
        end = "" if self._pieces == 1 else f"_{self._piece:04d}"
        with aside(index.with_name(f"{name}{end}.vtu")) as draft:
            draft.write_bytes(self._grid.file(fields, of_cells))
        if self._pieces > 1 and self._piece == 0:
            pieces = [f"{name}_{k:04d}.vtu" for k in range(self._pieces)]
            with aside(index.with_name(f"{name}.pvtu")) as draft:
                draft.write_bytes(listing(pieces, fields, of_cells or {}))
        self._names.append(f"{name}.vtu" if self._pieces == 1 else f"{name}.pvtu")

    def end(self) -> None:
        """Write the index, and remove further files of an earlier, longer series."""
        from bipot_rs.files.vtu import collection

        if self._piece:
            return
        index = self._index
        with aside(index) as draft:
            draft.write_bytes(collection(self._names))
        if self._pieces > 1:
            # The folder is shared: another process may be writing into it.
            return
        written = set(self._names)
        for old in _beside(index):
            digits = old.name.removeprefix(f"{index.stem}_").removesuffix(".vtu")
            is_step = old.name == f"{index.stem}_{digits}.vtu" and len(digits) >= 4
            number = digits.isascii() and digits.isdigit()
            if is_step and number and old.name not in written:
                old.unlink()


def _beside(path: Path) -> list[Path]:
    """Contents of the folder of ``path``; [] without permission to read it."""
    try:
        return list(path.parent.iterdir())
    except PermissionError:
        return []


def place(path: Any, what: str = "path") -> Path:
    """Convert to a `Path`; a `TypeError` names the argument ``what``."""
    try:
        return Path(os.fsdecode(path))
    except TypeError:
        raise mistyped(what, path, "the name of a file") from None


@contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[None]:
    """Put the name of the file into system errors, instead of that of the draft.

    If two such contexts are nested, the outer name is used.
    """
    try:
        yield
    except OSError as error:
        cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
        raise type(cause)(f"cannot write {path}: {cause.strerror or cause}") from cause


def indexed(path: str | os.PathLike[str]) -> Path:
    """Path of the index of a series, which must end in ``.pvd`` for ParaView.

    Raises
    ------
    ValueError
        It does not end in ``.pvd``.
    """
    index = place(path)
    if index.suffix.lower() != ".pvd":
        raise ValueError(f"path is {os.fspath(path)!r}, expected DIR/NAME.pvd")
    return index


@contextmanager
def aside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Draft to write instead of ``path``: renamed on success, removed on failure."""
    target = place(path)
    # Libraries look at the suffix, and two processes may write the same path.
    draft = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        with writing(target):
            yield draft
            draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)


def _store(h5py: Any, group: Any, name: str, value: Any) -> None:
    """Make a dataset; numbers by the low-level interface, which is faster."""
    array = np.asarray(value, order="C")
    if array.dtype.kind == "U":
        # HDF5 has no characters of four bytes.
        group[name] = np.char.encode(array, "utf-8")
        return
    if array.dtype.kind not in "fiub":
        group[name] = value
        return
    made = h5py.h5d.create(group.id, name.encode(), *_form(h5py, array))
    if array.size:
        made.write(h5py.h5s.ALL, h5py.h5s.ALL, array)


def _label(h5py: Any, group: Any, name: str, value: Any) -> None:
    """Make an attribute by the low-level interface; strings of the type that h5py uses."""
    text = isinstance(value, str)
    kind = h5py.string_dtype() if text else None
    array = np.asarray(value, dtype=kind, order="C")
    if not text and array.dtype.kind not in "fiub":
        group.attrs[name] = value
        return
    h5py.h5a.create(group.id, name.encode(), *_form(h5py, array)).write(array)


def _form(h5py: Any, array: NDArray[Any]) -> tuple[Any, Any]:
    """Type and dataspace of an array of numbers."""
    h5s = h5py.h5s
    space = h5s.create_simple(array.shape) if array.ndim else h5s.create(h5s.SCALAR)
    return h5py.h5t.py_create(array.dtype, logical=True), space


def _three(array: NDArray[Any]) -> NDArray[Any]:
    """Extend vectors of two components by a zero: VTK needs three."""
    if array.ndim == 2 and array.shape[1] == 2:
        return np.column_stack([array, np.zeros(len(array), array.dtype)])
    return np.ascontiguousarray(array)


def _digest(file: BinaryIO, size: int) -> bytes:
    """Checksum of the first ``size`` bytes, in hexadecimal."""
    import hashlib

    file.seek(0)
    digest = hashlib.blake2b(digest_size=16)
    while size > 0 and (part := file.read(min(size, 2**20))):
        digest.update(part)
        size -= len(part)
    return digest.hexdigest().encode()


def _sealed(path: Path) -> bool:
    """Whether the file ends with a checksum; a `ValueError` if it does not match."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END) - _SEAL_BYTES
        if size < 0:
            return False
        file.seek(size)
        seal = file.read(_SEAL_BYTES)
        if not seal.startswith(_SEAL):
            return False
        if seal != _SEAL + _digest(file, size) + b"\n":
            raise ValueError(
                f"{path}: the checksum does not match: the file is damaged or was edited"
            )
    return True


def _arrays(group: Any, limit: int) -> dict[str, NDArray[Any]]:
    """Datasets of a group, none larger than ``limit`` bytes."""
    found = {}
    for name, data in group.items():
        if data.nbytes > limit:
            raise ValueError(
                f"{data.name} claims {data.nbytes} bytes, more than a file of "
                f"{limit // _TIGHTEST} bytes can hold"
            )
        array = data[()]
        text = isinstance(array, np.ndarray) and array.dtype.kind == "S"
        found[name] = np.char.decode(array, "utf-8") if text else array
    return found


def _sentence(error: Exception) -> str:
    """Message of an error on one line; HDF5 uses several."""
    message = error.args[0] if error.args else error
    return " ".join(str(message).split()) or type(error).__name__


def _plain(value: Any) -> Any:
    """Convert bytes and NumPy numbers to those of Python; leave arrays unchanged."""
    if isinstance(value, bytes):
        return value.decode()
    return value.item() if isinstance(value, np.generic) else value
