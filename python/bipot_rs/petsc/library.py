"""Find petsc4py and mpi4py, or say what to install or to set."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

INSTALL = (
    "on Debian or Ubuntu run apt-get install python3-petsc4py python3-mpi4py "
    "openmpi-bin, and use a virtual environment of /usr/bin/python3 with "
    "--system-site-packages; with conda run conda install -c conda-forge petsc4py mpi4py; "
    "where PETSc is installed already, pip install 'bipot-rs[petsc]'"
)

# Where Debian puts the folders that PETSC_DIR may name, two levels below.
_DEBIAN = Path("/usr/lib/petscdir")


class Library(NamedTuple):
    """The modules ``petsc4py.PETSc`` and ``mpi4py.MPI``."""

    PETSc: ModuleType
    MPI: ModuleType


def load() -> Library:
    """Import petsc4py and mpi4py.

    If petsc4py is not on the path, but in a folder of ``PETSC_DIR`` or of Debian, the folder
    is added to the path.

    Raises `ModuleNotFoundError`: one of them is not installed; the message says how to install
    it.
    Raises `ImportError`: one of them cannot be imported; the message says why, and what to
    change.
    """
    try:
        MPI = importlib.import_module("mpi4py.MPI")
        PETSc = _import_petsc()
    except ModuleNotFoundError as error:
        name = str(error.name).partition(".")[0]
        if name not in ("petsc4py", "mpi4py"):
            raise
        raise ModuleNotFoundError(
            f"engine='petsc' needs {name}, which is not installed: {INSTALL}", name=name
        ) from None
    except (ImportError, OSError, AttributeError) as error:
        raise ImportError(
            f"petsc4py or mpi4py cannot be imported: {error}. {list_causes()}"
        ) from error
    if PETSc.ScalarType().dtype.kind == "c":
        raise ImportError(
            "petsc4py belongs to a PETSc with complex numbers: set PETSC_DIR to one with "
            f"real numbers{_name_first(list_folders())}"
        )
    return Library(PETSc, MPI)


def _import_petsc() -> ModuleType:
    try:
        importlib.import_module("petsc4py")
    except ModuleNotFoundError as error:
        if error.name != "petsc4py":
            raise
        named = os.environ.get("PETSC_DIR")
        # A folder that the user named comes first; one of Debian needs no name.
        for folder in [named] if named else list_folders():
            path = packages_of(folder)
            if (path / "petsc4py").is_dir():
                sys.path.append(str(path))
                os.environ["PETSC_DIR"] = folder
                break
        else:
            if named and list_folders():
                raise ImportError(
                    f"PETSC_DIR is {named}, which holds no petsc4py"
                ) from None
            raise
    return importlib.import_module("petsc4py.PETSc")


def packages_of(folder: str) -> Path:
    """The folder of petsc4py in a folder of PETSc."""
    return Path(folder) / "lib" / "python3" / "dist-packages"


def list_folders() -> list[str]:
    """Folders that PETSC_DIR may name, those with real numbers first, then by version."""
    folders = sorted(map(str, _DEBIAN.glob("*/*")), reverse=True)
    usable = [folder for folder in folders if packages_of(folder).is_dir()]
    return sorted(usable, key=lambda folder: "complex" in folder)


def list_causes() -> str:
    """The two usual causes of a failed import, each with what to change."""
    folder = os.environ.get("PETSC_DIR")
    was = "is not set" if folder is None else f"is {folder}"
    return (
        "Either it was compiled for another version of NumPy: run pip install 'numpy<2' for a "
        "petsc4py that was compiled with NumPy 1, as Debian's before 13. Or it does not find "
        f"PETSc: PETSC_DIR {was}{_name_first(list_folders())}"
    )


def _name_first(folders: Sequence[str]) -> str:
    if not folders:
        return ""
    return f": PETSC_DIR={folders[0]} has a petsc4py"
