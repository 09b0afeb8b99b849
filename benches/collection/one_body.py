"""Load paths of one elastic body on a rigid obstacle, or held by contact alone."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.fem.assembly.assemble import assemble
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.contact.contact import Contact
from bipot_rs.obstacle.motion import Motion
from bipot_rs.obstacle.shapes import Cylinder
from collection.elastic import (
    block,
    free_on_floor,
    grid,
    held,
    loaded,
    moved,
    on_floor,
)
from collection.entry import entries
from collection.load_path import (
    LoadPath,
    Proof,
    cycles,
    legs,
    press_and_shear,
    release,
    turning,
)

# Parts of the friction limit that the load reaches step by step.
NEAR = 1 - 10.0 ** -np.arange(1, 7)
STEEL = {"young": 2.1e11, "poisson": 0.3}


def square(cells: int, height: int = 6) -> list[Floats]:
    """Grid of a unit square, finer towards the floor."""
    return [grid(-0.5, 0.5, cells), grid(0.0, 1.0, height, 1.4)]


def cube(cells: int, height: int = 4) -> list[Floats]:
    """Grid of a unit cube, finer towards the floor."""
    side = grid(-0.5, 0.5, cells)
    return [side, side, grid(0.0, 1.0, height, 1.4)]


def block_2d_3() -> LoadPath:
    """Pressed, sheared, lifted off, pressed at another place."""
    return moved(on_floor(square(2), 0.3), release(2, 0.02, 0.02))


def block_2d_9_cyclic() -> LoadPath:
    """Two cycles of shear."""
    return moved(on_floor(square(8), 0.3), cycles(2, 0.02, 0.012, 2))


def block_2d_33_release() -> LoadPath:
    """As block_2d_3, in twelve steps."""
    return moved(on_floor(square(32), 0.35), release(2, 0.02, 0.012, 2))


def block_2d_129_strong() -> LoadPath:
    """Strong friction, μ = 1, and ν = 0.49."""
    model = on_floor(square(128), 1.0, poisson=0.49)
    return moved(model, press_and_shear(2, 0.02, 0.03, 2))


def hertz_2d_65_cyclic() -> LoadPath:
    """A steel cylinder in SI units, fretted once."""
    # A steel cylinder of radius 50 mm; the floor carries the curvature.
    axes = [grid(-2e-3, 2e-3, 64), grid(0.0, 4e-3, 12, 1.2)]

    def gap(x: Floats) -> Floats:
        return x[:, 0] ** 2 / 0.1

    model = on_floor(axes, 0.3, clearance=gap, **STEEL)
    return moved(model, cycles(2, 1.2e-5, 4e-6, 1, 2))


def rough_2d_257() -> LoadPath:
    """Random heights and friction coefficients."""
    rng = np.random.default_rng(6)
    height, mu = 2e-3 * rng.random(257), rng.uniform(0.1, 0.7, 257)
    model = on_floor(square(256, 8), 0.3, clearance=height)
    return moved(model, press_and_shear(2, 0.02, 0.01, 2), mu=mu)


def roller_2d_41() -> LoadPath:
    """A rigid roller presses, rolls and is lifted."""
    body = block("block", [grid(-1.0, 1.0, 40), grid(-1.0, 0.0, 8, 1 / 1.3)])
    roller = Cylinder((-0.3, 1.0), 1.0)
    # Pressed in, rolled along the top in four steps, and lifted.
    along, down = [0, 0.15, 0.3, 0.45, 0.6, 0.6], [-0.03] * 5 + [0.01]
    motion = Motion(np.c_[along, down], rotation=-np.asarray(along), about=(-0.3, 1.0))
    contact = Contact("block", "top", 0.25, obstacle=roller, motion=motion)
    model = assemble([body], [contact], [held("block", "bottom", 2)])
    return moved(model, np.zeros((6, 2)))


def strip_2d_3001_global() -> LoadPath:
    """A long strip on a rough floor."""
    rng = np.random.default_rng(8)
    axes = [grid(0.0, 300.0, 3000), grid(0.0, 1.0, 4, 1.4)]
    height = 4e-3 * rng.random(3001)
    model = on_floor(axes, 0.3, clearance=height)
    motion = legs([[0.0, -0.01], [0.004, -0.01], [-0.002, -0.006]])
    return moved(model, motion, form="global")


def block_3d_4_turning() -> LoadPath:
    """Shear in a direction that turns once."""
    return moved(on_floor(cube(1), 0.3), turning(0.02, 0.015, 8))


def block_3d_9_release() -> LoadPath:
    """As block_2d_3, in space."""
    return moved(on_floor(cube(2), 0.3), release(3, 0.02, 0.015))


def block_3d_36_cyclic() -> LoadPath:
    """Two cycles of shear along a curve."""
    motion = cycles(3, 0.02, 0.01, 2)
    # Across the shear, so that no slip keeps its direction.
    motion[:, 1] = 0.3 * np.roll(motion[:, 0], 1)
    return moved(on_floor(cube(5), 0.3), motion)


def block_3d_121() -> LoadPath:
    """Pressed, then sheared."""
    motion = press_and_shear(3, 0.02, 0.012, 2)
    motion[:, 1] = motion[:, 0] / 3
    return moved(on_floor(cube(10), 0.3), motion)


def block_3d_256_turning() -> LoadPath:
    """As block_3d_4_turning."""
    return moved(on_floor(cube(15), 0.4), turning(0.02, 0.01, 4))


def hertz_3d_169() -> LoadPath:
    """A steel ball in SI units, sheared in two directions."""
    side = grid(-1e-3, 1e-3, 12)
    axes = [side, side, grid(0.0, 2e-3, 6, 1.3)]

    def gap(x: Floats) -> Floats:
        return (x[:, 0] ** 2 + x[:, 1] ** 2) / 0.04

    model = on_floor(axes, 0.2, clearance=gap, **STEEL)
    corners = [[0, 0, -2e-5], [4e-6, 1e-6, -2e-5], [-2e-6, 2e-6, -2e-5]]
    return moved(model, legs(corners))


def twist_3d_49() -> LoadPath:
    """Twisted about an axis near the middle, and back."""
    motion = np.tile([0.0, 0.0, -0.02], (5, 1))
    # Off the axis of symmetry, where slip would have no direction.
    motion[:, 0] = [0.0, 0.001, 0.002, 0.003, 0.002]
    angle = np.array([0.0, 0.01, 0.03, 0.05, -0.01])
    return moved(on_floor(cube(6), 0.3), motion, turn=angle)


def layer_3d_961_global() -> LoadPath:
    """A rough layer, lifted off and pressed again."""
    rng = np.random.default_rng(20)
    side = grid(0.0, 10.0, 30)
    axes = [side, side, grid(0.0, 1.0, 3, 1.4)]
    model = on_floor(axes, 0.35, clearance=3e-3 * rng.random(961))
    return moved(model, release(3, 0.01, 0.003), form="global")


def _weight(model: Assembly) -> Floats:
    """Nodal forces of a pressure on the top whose resultant is 1."""
    return model.pressure("block", "top", 1.0)


def _pull(model: Assembly, direction: Floats) -> Floats:
    """Nodal forces of a shear on the top, whose resultant is ``direction``."""
    return model.traction("block", "top", direction)


def floating_2d_17_cyclic() -> LoadPath:
    """A block that friction alone holds."""
    model = free_on_floor([grid(-0.5, 0.5, 16), grid(0.0, 0.4, 5, 1.3)], 0.4)
    shear = legs([[0.0], [0.3], [-0.3], [0.35]], 2)
    return loaded(model, _weight(model) + shear * _pull(model, np.array([1.0, 0.0])))


def near_sliding_2d_25() -> LoadPath:
    """The load reaches 1 − 1e-6 of the limit."""
    model = free_on_floor([grid(-0.5, 0.5, 24), grid(0.0, 0.3, 4, 1.3)], 0.4)
    pull = _pull(model, np.array([0.4, 0.0]))
    return loaded(model, _weight(model) + NEAR[:, None] * pull)


def floating_3d_16_cyclic() -> LoadPath:
    """Friction holds a block in space."""
    side = grid(-0.5, 0.5, 3)
    model = free_on_floor([side, side, grid(0.0, 0.4, 3, 1.3)], 0.4)
    corners = [[0.2, 0.1], [-0.25, 0.1], [0.1, -0.3], [0.3, 0.1]]
    shear = [_pull(model, np.append(corner, 0.0)) for corner in corners]
    return loaded(model, _weight(model) + np.array(shear))


def near_sliding_3d_25() -> LoadPath:
    """As in the plane."""
    side = grid(-0.5, 0.5, 4)
    model = free_on_floor([side, side, grid(0.0, 0.3, 3, 1.3)], 0.3)
    pull = _pull(model, 0.3 * np.array([0.8, 0.6, 0.0]))
    return loaded(model, _weight(model) + NEAR[:, None] * pull)


def none_2d_13_sliding() -> LoadPath:
    """The last load exceeds friction by a tenth."""
    model = free_on_floor([grid(-0.5, 0.5, 12), grid(0.0, 0.3, 4, 1.3)], 0.4)
    pull = _pull(model, np.array([0.4, 0.0]))
    load = _weight(model) + np.array([[0.5], [0.9], [1.1]]) * pull
    # Slides along x and rises by a little more than mu times as far.
    motion = np.tile([1.0, 0.42], len(model.nodes))
    return loaded(model, load, proof=Proof(motion=motion))


def none_3d_16_tipping() -> LoadPath:
    """The last load tips the block over."""
    side = grid(-0.5, 0.5, 3)
    model = free_on_floor([side, side, grid(0.0, 1.5, 5, 1.3)], 0.9)
    pull = _pull(model, np.array([1.0, 0.0, 0.0]))
    # The load tips the block about its edge at x = 1/2 from 1/3 of its weight on.
    load = _weight(model) + np.array([[0.1], [0.25], [0.36]]) * pull
    x, z = model.nodes[:, 0], model.nodes[:, 2]
    motion = np.c_[z, 0.0 * x, 0.5 - x + 0.01]
    return loaded(model, load, proof=Proof(motion=motion.ravel()))


ENTRIES = entries(
    {
        "one body": (
            block_2d_3,
            block_2d_129_strong,
            rough_2d_257,
            strip_2d_3001_global,
            block_3d_4_turning,
            block_3d_121,
            block_3d_256_turning,
            hertz_3d_169,
            twist_3d_49,
        ),
        "cyclic": (
            block_2d_9_cyclic,
            hertz_2d_65_cyclic,
            block_3d_36_cyclic,
        ),
        "release": (
            block_2d_33_release,
            roller_2d_41,
            block_3d_9_release,
            layer_3d_961_global,
        ),
        "held by contact": (
            floating_2d_17_cyclic,
            floating_3d_16_cyclic,
        ),
        "nearly sliding": (
            near_sliding_2d_25,
            near_sliding_3d_25,
        ),
        "no answer": (
            none_2d_13_sliding,
            none_3d_16_tipping,
        ),
    }
)
