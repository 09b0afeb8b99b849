"""meshio, which reads meshes and writes files for ParaView: only this module names it."""

from __future__ import annotations

from types import ModuleType

from bipot_rs._lib.optional import load_library


def load_meshio(need: str) -> ModuleType:
    """The module; ``need``, in the plural, is what needs it, for the error without it."""
    return load_library("meshio", extra="fem", need=need)
