"""Scenes: TOML files and tables that define a contact problem and its load path."""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from bipot_rs.scene.build import LoadHistory as LoadHistory
    from bipot_rs.scene.build import bodies as bodies
    from bipot_rs.scene.case import Case as Case
    from bipot_rs.scene.case import assemble as assemble
    from bipot_rs.scene.library import shipped as shipped
    from bipot_rs.scene.library import text as text
    from bipot_rs.scene.mistakes import Mistake as Mistake
    from bipot_rs.scene.mistakes import MistakeKind as MistakeKind
    from bipot_rs.scene.mistakes import SceneError as SceneError
    from bipot_rs.scene.reading import check as check
    from bipot_rs.scene.reading import parse as parse
    from bipot_rs.scene.reading import put as put
    from bipot_rs.scene.reading import read as read

__getattr__, __dir__ = lazily(__name__)
__all__ = __dir__()
