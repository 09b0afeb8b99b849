"""The content of a mesh file: points, cells in blocks, and sets of cells, nodes and faces."""

from __future__ import annotations

from dataclasses import dataclass, field

from bipot_rs._lib.types import Floats, Ints


@dataclass
class Content:
    """The content of a file."""

    points: Floats  # (places, 3)
    blocks: list[tuple[str, Ints]]  # kind of cells in VTK's names
    # Name to one array of cells for each block
    sets: dict[str, list[Ints]] = field(default_factory=dict)
    # As `sets`; the set means all boundary facets of these cells
    free: dict[str, list[Ints]] = field(default_factory=dict)
    # Name to indices of points
    node_sets: dict[str, Ints] = field(default_factory=dict)
    # Name to corners of each face
    faces: dict[str, list[tuple[int, ...]]] = field(default_factory=dict)
