"""The content of a mesh file: points, cells in blocks, and sets of cells, nodes and faces."""

from __future__ import annotations

from dataclasses import dataclass, field

from bipot_rs._lib.types import Floats, Ints


@dataclass
class Content:
    """The content of a file.

    Attributes
    ----------
    points : (places, 3)
    blocks : list of (kind, (cells, nodes))
        Kind of cells in VTK's names.
    sets : name to one array of cells for each block
    free : as ``sets``; the set means all boundary facets of these cells
    node_sets : name to indices of points
    faces : name to corners of each face
    """

    points: Floats
    blocks: list[tuple[str, Ints]]
    sets: dict[str, list[Ints]] = field(default_factory=dict)
    free: dict[str, list[Ints]] = field(default_factory=dict)
    node_sets: dict[str, Ints] = field(default_factory=dict)
    faces: dict[str, list[tuple[int, ...]]] = field(default_factory=dict)
