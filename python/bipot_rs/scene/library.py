"""Find and read scene files: those that come with the package, and any other.

Only the standard library is imported, so that `bipot scenes` starts quickly.
"""

from __future__ import annotations

from pathlib import Path

from bipot_rs._lib.messages import nearest
from bipot_rs.scene.mistakes import Mistake, MistakeKind, SceneError

_SHIPPED = Path(__file__).with_name("examples")


def shipped() -> list[str]:
    """Names of the scenes that come with the package."""
    return sorted(path.stem for path in _SHIPPED.glob("*.toml"))


def folder_of(name: str) -> Path:
    """Folder that relative file names of a scene refer to: that of the scene file."""
    return Path() if name in shipped() else Path(name).parent


def _describe_unknown(path: Path) -> str:
    """Message about a name that is not a scene, with the most similar one."""
    # Tried first: `nearest` would not always find the name with .toml added.
    with_suffix = f"{path}.toml"
    hint = f"; did you mean {with_suffix!r}?" if Path(with_suffix).is_file() else ""
    if path.is_dir():
        names = ", ".join(shipped())
        return f"is a folder, expected a TOML file or one of {names}{hint}"
    beside = path.parent.glob("*.toml") if path.parent.is_dir() else ()
    files = [str(other) for other in beside]
    stem = path.name.removesuffix(".toml")
    similar = nearest(str(path), files) or nearest(stem, shipped())
    if similar and not hint:
        hint = f"; did you mean {similar!r}?"
    return f"is neither a file nor one of {', '.join(shipped())}{hint}"


def text(name: str) -> str:
    """TOML text of a shipped scene, or of a file.

    Raises
    ------
    SceneError
        There is no such scene or file, or it cannot be read.
    """
    path = _SHIPPED / f"{name}.toml" if name in shipped() else Path(name)
    try:
        if not path.is_file():
            raise SceneError(
                name, [Mistake("", _describe_unknown(path), MistakeKind.FILE)]
            )
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        mistake = Mistake("", f"cannot be read: {error}", MistakeKind.FILE)
        raise SceneError(name, [mistake]) from error
