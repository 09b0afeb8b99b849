"""Result files: HDF5 that can be read again; safe replacement of any file.

Every file is written under another name and renamed when it is complete: if the disk is
full or the process is killed, the earlier file is unchanged. A result file ends with a
checksum, since HDF5 does not notice changed bits.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np

from bipot_rs._lib.optional import load_library
from bipot_rs._lib.types import AnyArray, Record
from bipot_rs.files.drafts import aside, place
from bipot_rs.files.fields import CONTACTS, FIELDS, STEPS, Quantity, labels
from bipot_rs.files.result_mesh import ResultMesh
from bipot_rs.files.vtkhdf import write_group

if TYPE_CHECKING:
    from h5py import Dataset, File, Group

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


def require() -> None:
    """Import the libraries for files before a long solve, so that it does not fail later."""
    load_library("h5py")
    load_library("meshio", extra="fem", need="files for ParaView")
    import_module("bipot_rs.files.series")


def write_result(
    path: str | os.PathLike[str],
    contacts: Mapping[str, AnyArray | None],
    steps: Sequence[Record],
    *,
    complete: bool,
    attributes: Mapping[str, object] | Callable[[], Mapping[str, object]] | None = None,
    fields: Callable[[int], Mapping[str, object]] | None = None,
    mesh: ResultMesh | None = None,
    of_cells: Iterable[Mapping[str, AnyArray]] = (),
    units: Mapping[str, str] | None = None,
) -> None:
    """Write contacts and load steps to an HDF5 file; an earlier one stays until it is complete.

    ``path``: file to write or to replace.
    ``contacts``: arrays of ``/contacts``, such as ``x (n_c, d)`` and ``mu (n_c,)``; ``None`` is
    left out.
    ``steps``: one mapping for each load step. Arrays become datasets of ``/steps/0000``,
    numbers and strings its attributes, except ``residual`` and ``load``, which become scalar
    datasets; ``None`` is left out.
    ``complete``: whether the whole load path was solved.
    ``attributes``: further attributes of the file, which may replace ``complete``; or a
    function that returns them, which is called when all else is written.
    ``fields``: function of the index of a step that returns its fields: ``load``, ``time``, and
    arrays with the names and shapes of step 0. ``/fields/NAME`` has a row for each step.
    ``mesh``: the mesh, for ``/mesh``.
    ``of_cells``: fields of the cells in each step, for ``/VTKHDF``; read once, after all else.
    ``units``: names of the units of ``"length"``, ``"force"`` and ``"stress"``. Each dataset
    that `files.fields` lists has the attributes ``dimension`` and ``frame`` if it has them, and
    ``units`` if these are known; outside of ``/steps`` also ``meaning``.
    Raises `OSError`: the file cannot be written; an earlier one is unchanged.
    """
    h5py = load_library("h5py")
    digits = max(4, len(str(max(len(steps) - 1, 0))))
    named = units or {}
    first = {} if fields is None or not steps else fields(0)

    def store(group: Group, name: str, value: object, about: Mapping[str, str]) -> None:
        _store(h5py, group, name, value, about)

    def describe(data: Dataset) -> None:
        name = data.name.rpartition("/")[2]
        for label, text in _about(FIELDS, name, named).items():
            _label(h5py, data, label, text)

    def fill(file: File) -> None:
        group = file.create_group("contacts")
        for name, array in contacts.items():
            if array is not None:
                store(group, name, array, _about(CONTACTS, name, named))
        group = file.create_group("steps")
        about = {name: _about(STEPS, name, named) for name in STEPS}
        for step_group in about.values():
            # The same text in every step would be a large part of a small file.
            step_group.pop("meaning")
        for number, step in enumerate(steps):
            step_group = group.create_group(f"{number:0{digits}d}")
            for name, value in step.items():
                if value is None:
                    continue
                if np.ndim(value) > 0 or name in _SCALAR_DATASETS:
                    store(step_group, name, value, about.get(name, {}))
                else:
                    _label(h5py, step_group, name, value)
        if mesh is not None:
            mesh.save(file.create_group("mesh"), store, named)
        if fields is not None and first:
            group = file.create_group("fields")
            kinds = {name: np.asarray(value) for name, value in first.items()}
            size = sum(array.nbytes for array in kinds.values())
            some = _IN_MEMORY // max(size, 1) + 1  # steps that are written at once
            for name, array in kinds.items():
                shape = (len(steps), *array.shape)
                describe(group.create_dataset(name, shape, array.dtype))
            for k in range(0, len(steps), some):
                ends = range(k, min(k + some, len(steps)))
                rows = [fields(row) if row else first for row in ends]
                for name in kinds:
                    group[name][k : k + some] = np.stack(
                        [np.asarray(row[name]) for row in rows]
                    )
            write_group(h5py, file, mesh, of_cells, describe)
        given = attributes() if callable(attributes) else attributes
        ours = {"format": FORMAT, "version": VERSION, "sealed": True}
        for name, value in {"complete": complete, **(given or {}), **ours}.items():
            _label(h5py, file, name, value)

    arrays = [contacts.values(), *(step.values() for step in steps)]
    arrays += [first.values()] * len(steps)
    held = sum(getattr(value, "nbytes", 0) for some in arrays for value in some)
    if mesh is not None:
        # Seven numbers of each cell, its stress.
        cells = sum(len(block.corners) for block in mesh.cells)
        held += mesh.nbytes + 56 * cells * len(steps)
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


class Saved(NamedTuple):
    """Contents of a result file, as given to `write_result`."""

    contacts: Record
    steps: list[Record]
    attributes: Record  # also ``complete`` and ``version``
    mesh: ResultMesh | None


def read_saved(path: str | os.PathLike[str]) -> Saved:
    """Read a file written by `write_result`.

    Raises `OSError`: it cannot be read. Raises `ValueError`: it is not a result, is damaged, or
    of a later version of the format.
    """
    with _open(path) as (file, attributes):
        return _read_steps(file, attributes, _Reader(place(path).stat().st_size))


def read_attributes(path: str | os.PathLike[str]) -> Record:
    """The attributes of such a file, without its arrays; raises as `read_saved`."""
    with _open(path) as (_, attributes):
        return attributes


@contextmanager
def _open(path: str | os.PathLike[str]) -> Iterator[tuple[File, Record]]:
    """The open file and its attributes; errors of the block name the file."""
    h5py, source = load_library("h5py"), place(path)
    if source.exists() and not source.is_file():
        raise OSError(f"{path} is not a file")
    sealed = _has_seal(source)
    try:
        with h5py.File(source, "r") as file:
            yield file, _read_attributes(file, sealed)
    except OSError as error:
        raise OSError(f"{path} cannot be read: {_sentence(error)}") from None
    except (LookupError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise ValueError(
            f"{path} is not a result that can be read: {_sentence(error)}"
        ) from None


def _read_attributes(file: File, sealed: bool) -> Record:
    """Attributes of an open file, if it is a complete result of this version."""
    attributes = {name: _convert_to_python(value) for name, value in file.attrs.items()}
    if attributes.pop("format", None) != FORMAT:
        raise ValueError(f"its format is not {FORMAT!r}")
    if attributes.get("version") != VERSION:
        raise ValueError(
            f"it has version {attributes.get('version')} of the format, "
            f"expected {VERSION}"
        )
    if attributes.pop("sealed", False) and not sealed:
        raise ValueError("its end is missing")
    return attributes


def _read_steps(file: File, attributes: Record, reader: _Reader) -> Saved:
    """Contents of an open file."""
    contacts = reader.read_arrays(file["contacts"])
    steps: list[Record] = []
    # By number: as text, step 10000 would come before step 9999.
    for name in sorted(file["steps"], key=int):
        group = file["steps"][name]
        step = {
            k: _convert_to_python(data) for k, data in reader.read_arrays(group).items()
        }
        step.update(
            {key: _convert_to_python(value) for key, value in group.attrs.items()}
        )
        steps.append(step)
    mesh = None
    if "mesh" in file:
        mesh = ResultMesh.load(file["mesh"], reader.read_arrays)
    return Saved(contacts, steps, attributes, mesh)


def _about(
    quantities: Mapping[str, Quantity], name: str, units: Mapping[str, str]
) -> dict[str, str]:
    """Attributes of the dataset of this name; none if the table does not list it."""
    return labels(quantities[name], units) if name in quantities else {}


def _store(
    h5py: ModuleType, group: Group, name: str, value: object, about: Mapping[str, str]
) -> None:
    """Make a dataset; numbers by the low-level interface, which is faster."""
    array = np.asarray(value, order="C")
    if array.dtype.kind == "U":
        # HDF5 has no characters of four bytes.
        group[name] = np.char.encode(array, "utf-8")
        return
    if array.dtype.kind not in "fiub":
        group[name] = value
        return
    made = h5py.h5d.create(
        group.id, name.encode(), *_form(h5py, array.dtype, array.shape)
    )
    if array.size:
        made.write(h5py.h5s.ALL, h5py.h5s.ALL, array)
    for label, text in about.items():
        _label(h5py, h5py.Dataset(made), label, text)


def _label(h5py: ModuleType, holder: Group | Dataset, name: str, value: object) -> None:
    """Make an attribute by the low-level interface; strings of the type that h5py uses."""
    text = isinstance(value, str)
    kind = h5py.string_dtype() if text else None
    array = np.asarray(value, dtype=kind, order="C")
    if not text and array.dtype.kind not in "fiub":
        holder.attrs[name] = value
        return
    form = _form(h5py, array.dtype, array.shape)
    h5py.h5a.create(holder.id, name.encode(), *form).write(array)


@lru_cache(64)
def _form(
    h5py: ModuleType, kind: np.dtype[np.generic], shape: tuple[int, ...]
) -> tuple[object, object]:
    """Type and dataspace of an array of numbers, or of strings, which alone are objects."""
    h5s = h5py.h5s
    space = h5s.create_simple(shape) if shape else h5s.create(h5s.SCALAR)
    return h5py.h5t.py_create(kind, logical=True), space


def _digest(file: BinaryIO, size: int) -> bytes:
    """Checksum of the first ``size`` bytes, in hexadecimal."""
    import hashlib

    file.seek(0)
    digest = hashlib.blake2b(digest_size=16)
    while size > 0 and (part := file.read(min(size, 2**20))):
        digest.update(part)
        size -= len(part)
    return digest.hexdigest().encode()


def _has_seal(path: Path) -> bool:
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


class _Reader:
    """Reads datasets of at most ``size`` bytes in total.

    `write_result` does not compress what is read, so that its datasets are smaller than the
    file. Compressed datasets, and many names of one dataset, can claim any size.
    """

    def __init__(self, size: int) -> None:
        self.size, self.left = size, size

    def read_arrays(self, group: Group) -> dict[str, AnyArray]:
        """The datasets of a group."""
        arrays = {}
        for name, data in group.items():
            if not hasattr(data, "nbytes"):
                continue  # a group within the group
            if data.dtype.kind == "O":
                raise ValueError(f"{data.name} has entries without a fixed size")
            self.left -= data.nbytes
            if self.left < 0:
                raise ValueError(
                    f"the datasets up to {data.name} claim {self.size - self.left} "
                    f"bytes, more than the file has: {self.size}"
                )
            array = data[()]
            text = isinstance(array, np.ndarray) and array.dtype.kind == "S"
            arrays[name] = np.char.decode(array, "utf-8") if text else array
        return arrays


def _sentence(error: Exception) -> str:
    """Message of an error on one line; HDF5 uses several."""
    message = error.args[0] if error.args else error
    return " ".join(str(message).split()) or type(error).__name__


def _convert_to_python(value: object) -> object:
    """Convert bytes and NumPy numbers to those of Python; leave arrays unchanged."""
    if isinstance(value, bytes):
        return value.decode()
    return value.item() if isinstance(value, np.generic) else value
