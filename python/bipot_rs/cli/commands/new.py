"""``bipot new``: a scene to begin with, that runs as it is."""

from __future__ import annotations

from pathlib import Path

from bipot_rs._lib.messages import meant

_FOLDER = Path(__file__).parent.parent / "templates"
SCHEMA = "bipot-scene.schema.json"
_HINT = (
    f"#:schema ./{SCHEMA}\n"
    f"# An editor that knows TOML checks this file: bipot schema > {SCHEMA}\n\n"
)
# What a template says where the command to run it has its file, and where it has the
# mesh beside it: as seen from here, and from the scene.
_NAME, _MESH, _BESIDE = "@NAME@", "@MESH@", "@FILE@"


def templates() -> list[str]:
    """Names of what there is to begin with."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def write(name: str, template: str) -> list[Path]:
    """Write a commented scene; returns its files, first ``name`` with ``.toml``.

    A template with a mesh has it written beside the scene, under the name of the scene.

    Raises
    ------
    ValueError
        There is no such template.
    OSError
        There is a file of this name already, scene or mesh, or none can be written there.
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
        # One without the other is of no use.
        path.unlink()
        raise
    return [path, mesh]


def _new(path: Path, text: str) -> None:
    """Write a file that is not there yet."""
    try:
        # Not looked for first: whatever comes in between would be overwritten.
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise FileExistsError(
            f"{path} is there already and stays as it is: give another name"
        ) from None
    except OSError as error:
        raise OSError(f"cannot write {path}: {error.strerror or error}") from error
