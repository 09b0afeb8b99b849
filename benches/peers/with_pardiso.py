"""Schur complement of MKL PARDISO, numeric phase alone.

    python benches/peers/with_pardiso.py FILE REPEAT

Needs NumPy and the MKL runtime (``libmkl_rt`` of the package ``mkl``). `cholmod.c` describes
FILE. Prints one JSON line and writes S to FILE.s, in the order of the contact unknowns. All
combinations of ordering and two-level factorisation are tried; the fastest numeric phase
counts. MKL_NUM_THREADS sets the threads.
"""

import ctypes
import json
import sys
from itertools import product
from pathlib import Path
from time import perf_counter

import numpy as np

POSITIVE_DEFINITE = 2
# Nested dissection by METIS, and its parallel form.
ORDERINGS = {2: "METIS", 3: "parallel METIS"}


def library():
    """Load the MKL runtime of the prefix of this Python, or of the system."""
    libraries = sorted((Path(sys.prefix) / "lib").glob("libmkl_rt.so*"))
    for path in [*map(str, libraries), "libmkl_rt.so", "libmkl_rt.so.2"]:
        try:
            return ctypes.CDLL(path)
        except OSError:
            continue
    raise SystemExit("MKL is not installed")


def read(path):
    """Sizes n, m, d, and the lower triangle by columns, which is the upper one by rows."""
    with Path(path).open("rb") as file:
        n, m, d, nnz = np.fromfile(file, np.int64, 4)
        pointers = np.fromfile(file, np.int64, n + 1)
        indices = np.fromfile(file, np.int64, nnz)
        values = np.fromfile(file, np.float64, nnz)
    return (n, m, d), pointers, indices, values


class Pardiso:
    """One matrix; keeps the arguments of the library alive."""

    def __init__(self, mkl, path, ordering, two_level):
        (self.n, self.m, _), pointers, indices, self.a = read(path)
        self.call = mkl.pardiso
        self.pt = np.zeros(64, np.int64)
        self.iparm = np.zeros(64, np.int32)
        self.iparm[0] = 1
        self.iparm[1] = ordering
        self.iparm[17] = -1  # count the nonzeros of the factor
        self.iparm[18] = -1  # and the operations, in millions
        self.iparm[23] = two_level
        self.iparm[34] = 1  # indices from 0
        self.iparm[35] = 1  # the Schur complement
        self.perm = np.zeros(self.n, np.int32)
        self.perm[self.n - self.m :] = 1
        self.ia, self.ja = pointers.astype(np.int32), indices.astype(np.int32)
        self.schur = np.zeros((self.m, self.m))

    def phase(self, number):
        """Run a phase and return its seconds."""
        error, unit, zero = ctypes.c_int(0), ctypes.c_int(1), ctypes.c_int(0)
        # One factor, of number one; kind of the matrix, phase, order.
        integers = (1, 1, POSITIVE_DEFINITE, number, self.n)
        first = [ctypes.byref(ctypes.c_int(x)) for x in integers]
        arrays = (self.pt, self.a, self.ia, self.ja, self.perm, self.iparm, self.schur)
        pt, a, ia, ja, perm, iparm, schur = (
            x.ctypes.data_as(ctypes.c_void_p) for x in arrays
        )
        none = np.zeros(self.n)
        b = none.ctypes.data_as(ctypes.c_void_p)
        by = ctypes.byref
        rest = [a, ia, ja, perm, by(unit), iparm, by(zero), b, schur, by(error)]
        start = perf_counter()
        self.call(pt, *first, *rest)
        seconds = perf_counter() - start
        if error.value:
            raise SystemExit(f"PARDISO: error {error.value} in phase {number}")
        return seconds


def main():
    """Factorise, and print the JSON line."""
    path, repeat = sys.argv[1], int(sys.argv[2])
    mkl, best = library(), None
    for ordering, two_level in product(ORDERINGS, (0, 1)):
        solver = Pardiso(mkl, path, ordering, two_level)
        analyse = solver.phase(11)
        # Repeat only what is near the best.
        numeric = solver.phase(22)
        if best is None or numeric < 1.3 * best["numeric"]:
            numeric = min([numeric] + [solver.phase(22) for _ in range(repeat - 1)])
        if best is None or numeric < best["numeric"]:
            best = {
                "numeric": numeric,
                "analyse": analyse,
                "nnz": int(solver.iparm[17]),
                "flops": 1e6 * float(solver.iparm[18]),
                "ordering": ORDERINGS[ordering] + (", two-level" if two_level else ""),
            }
            solver.schur.tofile(path + ".s")
        solver.phase(-1)
    print(json.dumps(best))


if __name__ == "__main__":
    main()
