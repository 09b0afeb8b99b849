"""meshio, which reads meshes and writes files for ParaView: only this module names it."""

from __future__ import annotations

from typing import Any

from bipot_rs._lib.optional import load_library


def load_meshio(need: str) -> Any:
    """The module; ``need``, in the plural, is what needs it, for the error without it."""
    return load_library("meshio", extra="fem", need=need)
