"""A scene with a roller that moves."""

from typing import Any

import numpy as np

import bipot_rs as bp


def block(n: int = 3, dim: int = 2, cell: str = "", **body: Any) -> bp.Model:
    """A unit block held from below, its top at y or z = 0."""
    m = bp.Model("Block")
    m.material("soft", young=1000.0, poisson=0.3)
    side = np.linspace(-0.5, 0.5, n + 1)
    down = np.linspace(-1.0, 0.0, n + 1)
    axes = {"x": side, "y": down} if dim == 2 else {"x": side, "y": side, "z": down}
    kind = cell or ("quadrilateral" if dim == 2 else "hexahedron")
    m.body("block", **({"material": "soft", "cell": kind} | axes | body))
    m.support("block.bottom", **dict.fromkeys("xyz"[:dim], 0.0))
    return m


def roller(automatic: Any = None, mu: float = 0.3, **more: Any) -> bp.Model:
    """A disc that is pressed on the block, rolls a little and is lifted."""
    m = block(6)
    m.obstacle(
        "disc",
        cylinder={"point": [-0.1, 1.0], "radius": 1.0},
        move={"x": m.times(0.15, "way"), "y": m.times(-0.02, "press")},
        turn={"angle": m.times(-4.0, "way"), "about": [-0.1, 1.0]},
    )
    m.contact("block.top", against="disc", mu=mu, **more)
    m.path(automatic=automatic, press=[1.0, 1.0, 0.5], way=[0.0, 1.0, 0.5])
    return m
