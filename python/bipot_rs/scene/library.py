"""Find and read scene files: those that come with the package, and any other.

Only the standard library is imported, so that `bipot scenes` starts quickly.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bipot_rs._lib.messages import nearest

_SHIPPED = Path(__file__).with_name("examples")


class SceneError(ValueError):
    """Mistakes in a scene; ``problems`` lists them, each with its key path."""

    def __init__(self, name: str, problems: Sequence[str]) -> None:
        super().__init__(name, list(problems))
        self.problems = list(problems)
        self.name = name

    def __str__(self) -> str:
        head = f"scene {self.name!r}"
        if len(self.problems) == 1:
            return f"{head}: {self.problems[0]}"
        lines = "".join(f"\n  {problem}" for problem in self.problems)
        return f"{head} has {len(self.problems)} mistakes:{lines}"


def shipped() -> list[str]:
    """Names of the scenes that come with the package."""
    return sorted(path.stem for path in _SHIPPED.glob("*.toml"))


def folder_of(name: str) -> Path:
    """Folder that relative file names of a scene refer to: that of the scene file."""
    return Path() if name in shipped() else Path(name).parent


def _nothing(path: Path) -> str:
    """Message about a name that is not a scene, with the most similar one."""
    # Tried first: `nearest` would not always find the name with .toml added.
    with_suffix = f"{path}.toml"
    hint = f"; did you mean {with_suffix!r}?" if Path(with_suffix).is_file() else ""
    if path.is_dir():
        known = ", ".join(shipped())
        return f"is a folder, expected a TOML file or one of {known}{hint}"
    beside = path.parent.glob("*.toml") if path.parent.is_dir() else ()
    files = [str(other) for other in beside]
    stem = path.name.removesuffix(".toml")
    found = nearest(str(path), files) or nearest(stem, shipped())
    if found and not hint:
        hint = f"; did you mean {found!r}?"
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
            raise SceneError(name, [_nothing(path)])
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(name, [f"cannot be read: {error}"]) from error
