"""Scenes: TOML files and tables that define a contact problem and its load path."""

from typing import TYPE_CHECKING

from bipot_rs._lib.lazy import lazily

if TYPE_CHECKING:
    from bipot_rs.scene.build import bodies
    from bipot_rs.scene.case import Case, Load
    from bipot_rs.scene.library import SceneError, shipped, text
    from bipot_rs.scene.reading import assemble, checked, parsed, put, read

__all__ = [
    "Case",
    "Load",
    "SceneError",
    "assemble",
    "bodies",
    "checked",
    "parsed",
    "put",
    "read",
    "shipped",
    "text",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "bipot_rs.scene.build": ("bodies",),
        "bipot_rs.scene.case": ("Case", "Load"),
        "bipot_rs.scene.library": ("SceneError", "shipped", "text"),
        "bipot_rs.scene.reading": ("assemble", "checked", "parsed", "put", "read"),
    },
)
