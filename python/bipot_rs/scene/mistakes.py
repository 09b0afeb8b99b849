"""Mistakes in a scene: what is wrong, and the key path where.

Only the standard library is imported, so that `bipot scenes` starts quickly.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum


class MistakeKind(Enum):
    """What is wrong."""

    FILE = "the file cannot be read, or is not TOML"
    SETTING = "a value of --set has no place"
    UNKNOWN_KEY = "a key that its table does not have"
    MISSING_KEY = "a key that its table needs"
    TYPE = "a value of a wrong type"
    INTEGER = "a value that is not an integer"
    RANGE = "a value or a number of entries out of range"
    NAME = "a name that is not defined"
    CONTRADICTION = "keys that contradict each other"
    MESH = "found on the meshes"


@dataclass(frozen=True)
class Mistake:
    """One mistake.

    Attributes
    ----------
    key
        Key path, such as ``"contact.0.mu"``; "" if no key is at fault.
    message
        What is wrong, and what to do.
    kind
        For programs; people read the message.
    """

    key: str
    message: str
    kind: MistakeKind = MistakeKind.CONTRADICTION

    def __str__(self) -> str:
        key = f"--set {self.key}" if self.kind is MistakeKind.SETTING else self.key
        return f"{key}: {self.message}" if key else self.message


class SceneError(ValueError):
    """Mistakes in a scene.

    Attributes
    ----------
    name
        Title or file of the scene.
    mistakes : list of Mistake
        All that were found.
    """

    def __init__(self, name: str, mistakes: Iterable[Mistake]) -> None:
        mistakes_found = list(mistakes)
        super().__init__(name, mistakes_found)
        self.mistakes = mistakes_found
        self.name = name

    def __str__(self) -> str:
        head = f"scene {self.name!r}"
        if len(self.mistakes) == 1:
            return f"{head}: {self.mistakes[0]}"
        lines = "".join(f"\n  {mistake}" for mistake in self.mistakes)
        return f"{head} has {len(self.mistakes)} mistakes:{lines}"
