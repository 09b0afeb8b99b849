"""The FCLIB files of the tests, and their known properties."""

from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from support.places import TESTS

DATA = TESTS.parent / "data" / "fclib"


class Known(NamedTuple):
    """Form, dimension, contacts, degrees of freedom of M, rank of W."""

    form: str
    d: int
    contacts: int
    n: int | None
    rank: int


# As published with the collection; the ranks come from another program.
FILES = {
    "box_stacks_i0122_82": Known("global", 3, 82, 450, 175),
    "d2_fcp00031": Known("local", 2, 11, None, 22),
    "d2_granular_g69": Known("global", 2, 69, 900, 136),
    "d2_slider0": Known("local", 2, 2, None, 3),
    "fe_cube_h8_9c": Known("global", 3, 9, 162, 27),
    "fe_cube_h8_9c__local": Known("local", 3, 9, None, 27),
    "nespheres_10": Known("local", 3, 9, None, 27),
    "rods_2_3c": Known("global", 3, 3, 54, 9),
    "rods_2_3c__local": Known("local", 3, 3, None, 9),
}
GLOBAL = [name for name, known in FILES.items() if known.form == "global"]


def path(name: str) -> Path:
    return DATA / f"{name}.hdf5"


def dense(file: h5py.File, name: str) -> NDArray[np.float64]:
    """A matrix of a file, read entry by entry, without a sparse library."""
    m, n, nz = (int(file[name][k][0]) for k in ("m", "n", "nz"))
    p, i, x = (file[name][k][:] for k in ("p", "i", "x"))
    whole = np.zeros((m, n))
    if nz >= 0:
        for row, column, value in zip(i[:nz], p[:nz], x[:nz], strict=True):
            whole[row, column] += value
        return whole
    for major in range(len(p) - 1):
        for at in range(p[major], p[major + 1]):
            row, column = (i[at], major) if nz == -1 else (major, i[at])
            whole[row, column] += x[at]
    return whole


def datasets(path: Path) -> dict[str, NDArray[np.generic]]:
    """All datasets of a file, by full name."""
    arrays = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            arrays["/" + name] = np.asarray(item[()])

    with h5py.File(path) as file:
        file.visititems(visit)
    return arrays
