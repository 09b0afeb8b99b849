"""Meshes of serendipity elements, which scikit-fem has no classes for."""

from __future__ import annotations

from dataclasses import dataclass

import skfem


@dataclass(repr=False)
class MeshQuadS2(skfem.MeshQuad2):  # type: ignore[misc]
    """Quadrilaterals of 8 nodes."""

    elem: type = skfem.ElementQuadS2


@dataclass(repr=False)
class MeshHexS2(skfem.MeshHex2):  # type: ignore[misc]
    """Hexahedra of 20 nodes."""

    elem: type = skfem.ElementHexS2
