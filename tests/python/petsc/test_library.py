"""A PETSc that is missing or broken: the message says what to do."""

import builtins
import importlib
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bipot_rs.petsc import library
from bipot_rs.petsc.linear import options


def fail_imports(monkeypatch: pytest.MonkeyPatch, errors: dict[str, Exception]) -> None:
    before = importlib.import_module

    def fail(name: str, package: str | None = None) -> Any:
        if name in errors:
            raise errors[name]
        return before(name, package)

    monkeypatch.setattr(library.importlib, "import_module", fail)


@pytest.mark.parametrize("name", ["mpi4py", "petsc4py"])
def test_not_installed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    error = ModuleNotFoundError(f"No module named {name!r}", name=name)
    module = "mpi4py.MPI" if name == "mpi4py" else "petsc4py"
    fail_imports(monkeypatch, {module: error})
    if name == "petsc4py":
        monkeypatch.setitem(sys.modules, "mpi4py.MPI", builtins)
    monkeypatch.setattr(library, "list_folders", list)
    monkeypatch.delenv("PETSC_DIR", raising=False)
    with pytest.raises(ModuleNotFoundError) as raised:
        library.load()
    message = str(raised.value)
    assert f"needs {name}, which is not installed" in message
    for way in ("apt-get install python3-petsc4py", "conda-forge", "bipot-rs[petsc]"):
        assert way in message


def test_wrong_petsc_dir(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "mpi4py.MPI", builtins)
    missing = ModuleNotFoundError("No module named 'petsc4py'", name="petsc4py")
    fail_imports(monkeypatch, {"petsc4py": missing})
    monkeypatch.setenv("PETSC_DIR", str(tmp_path))
    monkeypatch.setattr(library, "list_folders", lambda: ["/opt/good"])
    with pytest.raises(ImportError) as raised:
        library.load()
    message = str(raised.value)
    assert str(tmp_path) in message
    assert "PETSC_DIR=/opt/good" in message


def test_another_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = ImportError("numpy.core.multiarray failed to import")
    fail_imports(monkeypatch, {"mpi4py.MPI": broken})
    with pytest.raises(ImportError, match="pip install 'numpy<2'"):
        library.load()


def test_folders_with_real_numbers_come_first(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("petsc3.18/a-complex", "petsc3.18/a-real", "petsc3.20/b-real"):
        library.packages_of(str(tmp_path / name)).mkdir(parents=True)
    (tmp_path / "petsc3.21" / "empty").mkdir(parents=True)
    monkeypatch.setattr(library, "_DEBIAN", tmp_path)
    folders = [str(Path(f).relative_to(tmp_path)) for f in library.list_folders()]
    assert folders == ["petsc3.20/b-real", "petsc3.18/a-real", "petsc3.18/a-complex"]


def test_an_option_that_the_user_sets_later_is_of_the_user() -> None:
    """Our defaults stay in the database of PETSc between problems."""
    values: dict[str, str] = {}

    class Options:
        def __init__(self, prefix: str) -> None:
            assert prefix == options.PREFIX

        def hasName(self, name: str) -> bool:
            return name in values

        def setValue(self, name: str, value: object) -> None:
            values[name] = str(value)

        def getString(self, name: str, default: str) -> str:
            return values.get(name, default)

    database: Any = SimpleNamespace(Options=Options)
    for _ in range(2):
        assert options.set_defaults(database)["pc_type"] == "gamg"
        assert not options.is_of_the_user(database, "pc_type")
        assert options.smoother_is_ours(database)
    values |= {"pc_type": "hypre", "mg_levels_pc_type": "sor"}
    assert options.set_defaults(database)["pc_type"] == "hypre"
    assert options.is_of_the_user(database, "pc_type")
    assert not options.smoother_is_ours(database)
    assert not options.is_of_the_user(database, "ksp_type")
