"""Scenes: TOML files and tables that define a contact problem and its load path."""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from bipot_rs.scene.build import LoadHistory, bodies
    from bipot_rs.scene.case import Case, assemble
    from bipot_rs.scene.library import shipped, text
    from bipot_rs.scene.mistakes import Mistake, MistakeKind, SceneError
    from bipot_rs.scene.reading import check, parse, put, read

__all__ = [
    "Case",
    "LoadHistory",
    "Mistake",
    "MistakeKind",
    "SceneError",
    "assemble",
    "bodies",
    "check",
    "parse",
    "put",
    "read",
    "shipped",
    "text",
]

__getattr__, __dir__ = lazily(__name__)
