"""Load paths of two and more elastic bodies."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.fem.assembly.assemble import assemble
from bipot_rs.fem.contact.contact import Contact
from collection.elastic import block, floor, grid, loaded, moved, pair
from collection.entry import entries
from collection.load_path import (
    LoadPath,
    cycles,
    legs,
    press_and_shear,
    release,
)


def _above(cells: int, layers: int = 5) -> list[Floats]:
    return [grid(-0.5, 0.5, cells), grid(0.0, 0.8, layers, 1.3)]


def _below(cells: int, layers: int = 5) -> list[Floats]:
    return [grid(-0.5, 0.5, cells), grid(-0.8, 0.0, layers, 1 / 1.3)]


def _in_space(plane: list[Floats]) -> list[Floats]:
    return [plane[0], *plane]


def pair_2d_33_contrast() -> LoadPath:
    """Moduli 10,000 to 1, one cycle of shear."""
    model = pair(_above(32), _below(32), 0.3, (1e4, 1.0))
    return moved(model, cycles(2, 0.02, 0.01, 1))


def pair_2d_21_mortar() -> LoadPath:
    """Meshes that do not match."""
    model = pair(_above(20), _below(13), 0.3, (1.0, 3.0), pairing="mortar")
    return moved(model, press_and_shear(2, 0.02, 0.025, 2))


def pair_2d_1001_global() -> LoadPath:
    """Two long strips with rough surfaces."""
    rng = np.random.default_rng(24)
    upper = [grid(0.0, 100.0, 1000), grid(0.0, 1.0, 4, 1.3)]
    lower = [grid(0.0, 100.0, 1000), grid(-1.0, 0.0, 4, 1 / 1.3)]
    height = 3e-3 * rng.random(1001)
    model = pair(upper, lower, 0.3, (2.0, 1.0), clearance=height)
    return moved(model, press_and_shear(2, 0.01, 0.004, 2), form="global")


def pair_3d_81() -> LoadPath:
    """Moduli 10 to 1, pressed and sheared."""
    upper, lower = _in_space(_above(8, 4)), _in_space(_below(8, 4))
    motion = press_and_shear(3, 0.02, 0.012, 2)
    motion[:, 1] = motion[:, 0] / 4
    return moved(pair(upper, lower, 0.3, (10.0, 1.0)), motion)


def pair_3d_49_mortar() -> LoadPath:
    """Meshes that do not match, one cycle."""
    upper, lower = _in_space(_above(6, 3)), _in_space(_below(4, 3))
    motion = cycles(3, 0.02, 0.025, 1)
    motion[:, 1] = 0.2 * np.roll(motion[:, 0], 1)
    return moved(pair(upper, lower, 0.3, (1.0, 2.0), pairing="mortar"), motion)


def pair_3d_100_release() -> LoadPath:
    """Curved surfaces, lifted off, pressed again."""
    upper, lower = _in_space(_above(9, 3)), _in_space(_below(9, 3))

    def gap(x: Floats) -> Floats:
        return 0.02 * (x[:, 0] ** 2 + 2 * x[:, 1] ** 2)

    model = pair(upper, lower, 0.4, clearance=gap)
    return moved(model, release(3, 0.02, 0.008))


def _stack(d: int, cells: int, mu: float) -> LoadPath:
    """Two blocks on each other on the floor, held by friction alone."""
    side = [grid(-0.5, 0.5, cells)] * (d - 1)
    bodies = [
        block("lower", [*side, grid(0.0, 0.4, 3, 1.2)]),
        block("upper", [*side, grid(0.4, 0.8, 3, 1.2)], 5.0),
    ]
    between = Contact("upper", "bottom", mu, against=("lower", "top"))
    model = assemble(bodies, [between, floor("lower", mu + 0.1, d)])
    ways = legs([[0.0, 0.0], [0.25, 0.1], [-0.2, 0.15], [0.3, -0.1]])
    push = model.pressure("upper", "top", 1.0)
    unit = np.eye(d)
    shear = np.array([model.traction("upper", "top", unit[k]) for k in range(d - 1)])
    return loaded(model, push + ways[:, : d - 1] @ shear)


def stack_2d_22() -> LoadPath:
    """Two blocks on each other, without supports."""
    return _stack(2, 10, 0.4)


def stack_3d_32() -> LoadPath:
    """Two blocks on each other in space."""
    return _stack(3, 3, 0.4)


ENTRIES = entries(
    {
        "two bodies": (
            pair_2d_33_contrast,
            pair_2d_21_mortar,
            pair_2d_1001_global,
            pair_3d_81,
            pair_3d_49_mortar,
        ),
        "release": (pair_3d_100_release,),
        "held by contact": (
            stack_2d_22,
            stack_3d_32,
        ),
    }
)
