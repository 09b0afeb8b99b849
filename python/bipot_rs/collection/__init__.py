"""Forty load paths of frictional contact in FCLIB files, with reference answers.

`generate` writes the collection, `check` verifies the answers of a folder without any solver,
and `PATHS` describes the paths by name::

    python -m bipot_rs.collection DIR
    python -m bipot_rs.collection --check DIR
"""

from typing import TYPE_CHECKING

from bipot_rs._lib.lazy import lazily

if TYPE_CHECKING:
    from bipot_rs.collection.catalogue import PATHS
    from bipot_rs.collection.checks import Checked, check
    from bipot_rs.collection.entry import Entry
    from bipot_rs.collection.load_path import LoadPath
    from bipot_rs.collection.manifest import Row
    from bipot_rs.collection.write import generate

__all__ = ["PATHS", "Checked", "Entry", "LoadPath", "Row", "check", "generate"]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "bipot_rs.collection.catalogue": ("PATHS",),
        "bipot_rs.collection.checks": ("Checked", "check"),
        "bipot_rs.collection.entry": ("Entry",),
        "bipot_rs.collection.load_path": ("LoadPath",),
        "bipot_rs.collection.manifest": ("Row",),
        "bipot_rs.collection.write": ("generate",),
    },
)
