"""`PATHS`: all load paths of the collection by name."""

from __future__ import annotations

from collection import one_body, rigid_paths, two_bodies
from collection.entry import Entry

PATHS: dict[str, Entry] = one_body.ENTRIES | two_bodies.ENTRIES | rigid_paths.ENTRIES
