"""``bipot new``: write a commented scene to start from."""

from __future__ import annotations

from pathlib import Path

from bipot_rs._lib.messages import meant

_FOLDER = Path(__file__).parent.parent / "templates"
SCHEMA = "bipot-scene.schema.json"
_HINT = (
    f"#:schema ./{SCHEMA}\n"
    f"# An editor that knows TOML checks this file: bipot schema > {SCHEMA}\n\n"
)
# Placeholders in templates: the path of the scene, the path of its mesh, and the path of
# the mesh as seen from the scene.
_NAME, _MESH, _BESIDE = "@NAME@", "@MESH@", "@FILE@"


def templates() -> list[str]:
    """Names of the templates."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def write(name: str, template: str) -> list[Path]:
    """Write a commented scene; returns its files, first ``name`` with ``.toml``.

    The mesh of a template is written next to the scene, under the same name.

    Raises
    ------
    ValueError
        There is no such template.
    OSError
        A file exists already, or cannot be written.
    """
    if template not in templates():
        raise ValueError(
            f"--template is {template!r}, expected one of {', '.join(templates())}"
            + meant(template, templates())
        )
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    text = (_FOLDER / f"{template}.toml").read_text(encoding="utf-8")
    mesh = path.with_suffix(".inp")
    for word, file in ((_NAME, str(path)), (_MESH, str(mesh)), (_BESIDE, mesh.name)):
        text = text.replace(word, file)
    _new(path, _HINT + text)
    source = _FOLDER / f"{template}.inp"
    if not source.exists():
        return [path]
    try:
        _new(mesh, source.read_text(encoding="utf-8"))
    except OSError:
        # A scene without its mesh is useless.
        path.unlink()
        raise
    return [path, mesh]


def _new(path: Path, text: str) -> None:
    """Write a new file; never overwrite."""
    try:
        # Mode "x" leaves no time between a test for existence and the writing.
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise FileExistsError(
            f"{path} exists already and is not overwritten: choose another name"
        ) from None
    except OSError as error:
        raise OSError(f"cannot write {path}: {error.strerror or error}") from error
