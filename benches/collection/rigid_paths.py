"""Load paths of rigid bodies, and of few contacts with several answers."""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from collection.entry import entries
from collection.load_path import LoadPath, Proof
from collection.rigid import RigidSet, arch, lattice, path

_TO_AND_FRO = np.array([0.0, 0.6, -0.4, 0.8])


def _shaken(of: RigidSet, seed: int, spring: float, mu: float) -> LoadPath:
    """Weights, and loads from the side that change their sign; springs hold the bodies."""
    rng = np.random.default_rng(seed)
    bodies, d = of.centre.shape
    load = np.zeros((len(_TO_AND_FRO), bodies, of.motions))
    load[:, :, d - 1] = -(1.0 + rng.random(bodies))
    side = rng.standard_normal((bodies, d - 1)) + 0.5
    load[:, :, : d - 1] = _TO_AND_FRO[:, None, None] * side
    stiffness = spring * np.repeat(rng.uniform(0.5, 1.5, bodies), of.motions)
    return path(of, load.reshape(len(load), -1), mu, spring=stiffness, joint=1.0)


def disks_2d_28() -> LoadPath:
    """Disks on springs, with compliant joints, shaken."""
    return _shaken(lattice((4, 4), seed=30), 30, 0.1, 0.4)


def disks_2d_496() -> LoadPath:
    """As disks_2d_28, between two walls."""
    return _shaken(lattice((15, 16), walls=True, seed=31), 31, 0.2, 0.35)


def disks_2d_3003() -> LoadPath:
    """As disks_2d_28, with 3,003 contacts."""
    return _shaken(lattice((39, 39), seed=32), 32, 0.2, 0.4)


def balls_3d_325() -> LoadPath:
    """Balls on springs, with compliant joints, shaken."""
    return _shaken(lattice((5, 5, 5), seed=33), 33, 0.2, 0.4)


def balls_3d_2025() -> LoadPath:
    """As balls_3d_325."""
    return _shaken(lattice((9, 9, 9), seed=34), 34, 0.2, 0.4)


def _arch_load(of: RigidSet, points: Floats) -> Floats:
    """Weight 1 of each stone, and a load on the stone at a quarter of the span."""
    load = np.zeros((len(points), len(of.centre), 3))
    load[:, :, 1] = -1.0
    load[:, len(of.centre) // 4, 1] -= points
    return load.reshape(len(points), -1)


def arch_2d_16() -> LoadPath:
    """Seven stones that contact alone holds; joints open."""
    stones = arch(7, 1.0, 1.35)
    points = np.array([0.0, 0.4, 0.8, 0.2, 0.9])
    return path(stones, _arch_load(stones, points), 0.6, joint=1e-3)


def slab_2d_5_redundant() -> LoadPath:
    """A slab on supports that settle."""
    x = np.linspace(-1.0, 1.0, 5)
    slab = RigidSet(
        np.array([[0.0, 0.2]]),
        np.full(5, -1),
        np.zeros(5, np.int64),
        np.c_[x, 0.0 * x],
        np.tile([0.0, 1.0], (5, 1)),
    )
    load = np.array([[0.1, -1.0, 0.0], [0.3, -1.0, 0.1], [-0.2, -1.0, -0.1]])
    # The supports settle: the middle one first, then the one at the left end.
    settled = np.array([[0, 0, 0, 0, 0], [0, 0, 0.01, 0, 0], [0.02, 0, 0.01, 0, 0]])
    return path(slab, load, 0.4, gaps=settled.astype(np.float64), redundant=True)


def none_2d_6_clamped() -> LoadPath:
    """Walls around a rigid plate overlap at the end."""
    x = np.array([-1.0, 0.0, 1.0])
    points = np.r_[np.c_[x, 0 * x - 0.2], np.c_[x, 0 * x + 0.2]]
    up = np.repeat([1.0, -1.0], 3)
    plate = RigidSet(
        np.zeros((1, 2)),
        np.full(6, -1),
        np.zeros(6, np.int64),
        points,
        np.c_[0 * up, up],
    )
    load = np.tile([0.1, -1.0, 0.05], (3, 1))
    # The upper wall comes down: it leaves a gap, a smaller one, and then overlaps.
    gaps = np.zeros((3, 6))
    gaps[:, 3:] = np.array([[0.02], [0.01], [-0.01]])
    forces = np.ones(6)
    proof = Proof(forces=forces)
    return path(plate, load, 0.3, gaps=gaps, redundant=True, proof=proof)


def _several(groups: int) -> LoadPath:
    """Groups of three contacts, each with up to three answers, weakly coupled."""
    # A group: a random stiffness in which pressing and shearing are strongly coupled.
    rng = np.random.default_rng(12)
    root = rng.standard_normal((6, 6))
    block = root @ root.T / 6 + 0.1 * np.eye(6)
    load = rng.standard_normal((3, 6))
    load[:, ::2] -= 0.5
    size = 6 * groups
    K = np.kron(np.eye(groups), block)
    if groups > 1:
        coupling = rng.standard_normal((size, size))
        K += 1e-3 * (coupling + coupling.T)
    contacts = 3 * groups
    return LoadPath(
        K,
        np.eye(size),
        np.zeros(contacts),
        np.full(contacts, 2.0),
        np.tile(load, (1, groups)) * np.repeat(1 + 0.01 * np.arange(groups), 6),
        np.zeros((3, 0)),
        np.zeros(0, np.int64),
        several=True,
    )


def several_2d_3() -> LoadPath:
    """Strong friction and coupling."""
    return _several(1)


def several_2d_9() -> LoadPath:
    """Three groups as several_2d_3, weakly coupled."""
    return _several(3)


ENTRIES = entries(
    {
        "rigid sets": (
            disks_2d_28,
            disks_2d_496,
            disks_2d_3003,
            balls_3d_325,
            balls_3d_2025,
            arch_2d_16,
            slab_2d_5_redundant,
        ),
        "no answer": (none_2d_6_clamped,),
        "several answers": (
            several_2d_3,
            several_2d_9,
        ),
    }
)
