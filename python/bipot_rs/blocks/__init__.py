"""Rigid blocks on each other: masonry, heaps, interlocking joints."""

from bipot_rs.blocks.block import Block
from bipot_rs.blocks.interfaces import Interface, find_interfaces, make_interface
from bipot_rs.blocks.problem import BlockProblem, assemble
from bipot_rs.blocks.readers import BlockFile, read

__all__ = [
    "Block",
    "BlockFile",
    "BlockProblem",
    "Interface",
    "assemble",
    "find_interfaces",
    "make_interface",
    "read",
]
