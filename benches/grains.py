"""Seeded sets of rigid disks and spheres with more contact forces than motions.

`SETS` maps the name of a set to a function of the seed; the tables use seeds 0 to 49.
``walls`` are 900 and 1,600 disks in columns, under their weight, with random loads from the
side. ``heaps`` are as many disks in staggered rows, each on two others, without side walls:
with little friction they flow apart. ``packings`` are balls that have settled in a box, in
2D and 3D, with about 2,000 contacts.

An `Assembly` is rigid bodies with masses, and contacts without compliance. The problem that
is solved is one time step, in the form of the FCLIB files, ``W = B M⁻¹ Bᵀ`` with
``q = B M⁻¹ f``: reactions and displacements stand for impulses and velocities. The same
assembly without masses, ``W = 0`` with ``rigid=(B, f)``, is in equilibrium if a solution
exists.

Packings are stored in the folder of `problems`, because they take long to settle.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import problems
from numpy.typing import NDArray
from scipy import optimize, sparse, spatial

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# Distance, as a share of the radii, up to which balls count as touching: the lattice of a
# wall is exact to rounding; settled balls are soft and overlap by about this share.
ROUNDING = 1e-9
SETTLED = 1e-3


@dataclass(frozen=True)
class Assembly:
    """Rigid balls and their contacts.

    Attributes
    ----------
    name
        Set, seed and random choices.
    d
        Dimension, and components of a contact.
    B
        Maps motions of the bodies ``(3 n)`` or ``(6 n)`` to relative displacements at the
        contacts ``(d n_c)``, normal first.
    mass, load
        Masses and moments of inertia; forces and moments. One for each motion.
    mu
        Friction coefficient.
    """

    name: str
    d: int
    B: sparse.csr_array
    mass: Array
    load: Array
    mu: float

    def step(self) -> tuple[sparse.csr_array, Array]:
        """``W`` and ``q (n_c, d)`` of one time step."""
        W = sparse.csr_array(self.B @ sparse.diags_array(1 / self.mass) @ self.B.T)
        return W, (self.B @ (self.load / self.mass)).reshape(-1, self.d)


def wall(
    name: str, side: int, rng: np.random.Generator, *, staggered: bool, mu: float
) -> Assembly:
    """Square wall of ``side**2`` disks of radius 1 on a floor, with loads from the side.

    Rows lie straight above each other, or staggered by half a disk.
    """
    row, column = np.divmod(np.arange(side**2), side)
    x = np.c_[2.0 * column, 2.0 * row]
    if staggered:
        x = np.c_[2.0 * column + row % 2, np.sqrt(3.0) * row]
    x += 1.0
    radius = np.ones(side**2)
    mass = 1 + rng.random(side**2)
    load = np.zeros((side**2, 3))
    load[:, 0], load[:, 1] = rng.standard_normal(side**2), -10 * mass
    B = _displacements(x, radius, *_contacts(x, radius, ROUNDING, np.inf))
    inertia = np.outer(mass, (1.0, 1.0, 0.5)).ravel()
    return Assembly(name, 2, B, inertia, load.ravel(), mu)


def packing(
    name: str, d: int, count: int, rng: np.random.Generator, *, mu: float
) -> Assembly:
    """Balls of radius 0.8 to 1.2 in a box, with a tenth of their weight from the side."""
    radius = rng.uniform(0.8, 1.2, count)
    width = {2: 1.4, 3: 1.8}[d] * count ** (1 / d)
    x = _settled(radius, width, d, rng)
    B = _displacements(x, radius, *_contacts(x, radius, SETTLED, width))
    mass = radius**d
    moments = {2: [0.5], 3: [0.4] * 3}[d] * (mass * radius**2)[:, None]
    load = np.zeros((count, d + len(moments[0])))
    load[:, : d - 1] = 0.1 * rng.standard_normal((count, d - 1)) * mass[:, None]
    load[:, d - 1] = -mass
    inertia = np.c_[np.tile(mass[:, None], d), moments]
    return Assembly(name, d, B, inertia.ravel(), load.ravel(), mu)


def _settled(radius: Array, width: float, d: int, rng: np.random.Generator) -> Array:
    """Centres ``(n, d)`` of soft balls under their weight in an open box, at rest."""
    count = len(radius)
    per_side = int(width // 2.4)
    at = np.arange(count)
    start = np.empty((count, d))
    for axis in range(d - 1):
        at, start[:, axis] = np.divmod(at, per_side)
    start[:, -1] = at
    start = 1.2 + 2.4 * start + rng.uniform(-0.15, 0.15, (count, d))
    weight = 2e-3 * radius**d

    def energy(flat: Array) -> tuple[float, Array]:
        x = flat.reshape(count, d)
        i, j = spatial.cKDTree(x).query_pairs(2.4, output_type="ndarray").T
        apart = x[j] - x[i]
        distance = np.linalg.norm(apart, axis=1)
        overlap = np.maximum(radius[i] + radius[j] - distance, 0)
        push = (overlap / np.maximum(distance, 1e-12))[:, None] * apart
        slope = np.zeros_like(x)
        np.add.at(slope, i, push)
        np.add.at(slope, j, -push)
        below = np.maximum(radius[:, None] - x, 0)
        beyond = np.maximum(x[:, :-1] + radius[:, None] - width, 0)
        slope -= below
        slope[:, :-1] += beyond
        slope[:, -1] += weight
        work = (overlap**2).sum() + (below**2).sum() + (beyond**2).sum()
        return work / 2 + weight @ x[:, -1], slope.ravel()

    options = {"maxiter": 600, "maxcor": 20, "ftol": 1e-14, "gtol": 1e-7}
    equilibrium = optimize.minimize(
        energy, start.ravel(), jac=True, method="L-BFGS-B", options=options
    )
    return equilibrium.x.reshape(count, d)


def _contacts(
    x: Array, radius: Array, touch: float, width: float
) -> tuple[Ints, Ints, Array]:
    """First body (-1 for floor and sides), second body, normal from first to second.

    The floor is at zero; with an infinite `width` there are no sides.
    """
    pairs = spatial.cKDTree(x).query_pairs(2.5 * radius.max(), output_type="ndarray")
    i, j = pairs[np.lexsort(pairs.T[::-1])].T
    apart = x[j] - x[i]
    distance = np.linalg.norm(apart, axis=1)
    near = distance <= (radius[i] + radius[j]) * (1 + touch)
    first, second = [i[near]], [j[near]]
    normal = [(apart / distance[:, None])[near]]
    d = x.shape[1]
    gaps = [(d - 1, 1.0, x[:, -1] - radius)]
    if np.isfinite(width):
        for axis in range(d - 1):
            gaps.append((axis, 1.0, x[:, axis] - radius))
            gaps.append((axis, -1.0, width - x[:, axis] - radius))
    for axis, sign, gap in gaps:
        bodies = np.flatnonzero(gap <= touch)
        first.append(np.full(len(bodies), -1))
        second.append(bodies)
        normal.append(np.tile(sign * np.eye(d)[axis], (len(bodies), 1)))
    return np.concatenate(first), np.concatenate(second), np.concatenate(normal)


def _displacements(
    x: Array, radius: Array, first: Ints, second: Ints, normal: Array
) -> sparse.csr_array:
    """Matrix `Assembly.B`."""
    d = x.shape[1]
    if d == 2:
        axes = [normal, np.c_[-normal[:, 1], normal[:, 0]]]
    else:
        across = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
        across /= np.linalg.norm(across, axis=1)[:, None]
        axes = [normal, across, np.cross(normal, across)]
    motions = {2: 3, 3: 6}[d]
    rows, columns, values = [], [], []
    for k, axis in enumerate(axes):
        for body, sign in ((first, -1.0), (second, 1.0)):
            at = np.flatnonzero(body >= 0)
            arm = -sign * radius[body[at]][:, None] * normal[at]
            if d == 2:
                turn = (arm[:, :1] * axis[at, 1:]) - (arm[:, 1:] * axis[at, :1])
            else:
                turn = np.cross(arm, axis[at])
            moved = sign * np.c_[axis[at], turn]
            rows.append(np.repeat(d * at + k, motions))
            columns.append((motions * body[at][:, None] + np.arange(motions)).ravel())
            values.append(moved.ravel())
    entries = np.concatenate(values)
    places = np.concatenate(rows), np.concatenate(columns)
    return sparse.csr_array((entries, places), shape=(d * len(first), motions * len(x)))


def walls(seed: int) -> Assembly:
    """900 disks for even seeds, 1,600 for odd ones."""
    return _rows("walls", seed, staggered=False)


def heaps(seed: int) -> Assembly:
    """900 disks for even seeds, 1,600 for odd ones."""
    return _rows("heaps", seed, staggered=True)


def _rows(set_: str, seed: int, *, staggered: bool) -> Assembly:
    rng = np.random.default_rng(seed)
    side = 30 + 10 * (seed % 2)
    mu = float(rng.choice([0.3, 0.4, 0.6]))
    name = f"{set_} {seed}: {side**2} disks, mu {mu}"
    return wall(name, side, rng, staggered=staggered, mu=mu)


def packings(seed: int) -> Assembly:
    """Spheres for even seeds, disks for odd ones."""
    path = problems.folder() / f"packing_{seed}.npz"
    rng = np.random.default_rng(seed)
    d = 3 - seed % 2
    count = {2: 900, 3: 690}[d]
    mu = float(rng.choice([0.2, 0.4, 0.6]))
    name = f"packings {seed}: {count} bodies, {d}D, mu {mu}"
    if not path.exists():
        made = packing(name, d, count, rng, mu=mu)
        path.parent.mkdir(parents=True, exist_ok=True)
        # Replaced in one step, because another process may read it.
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            B = made.B.tocoo()
            parts = {"rows": B.row, "columns": B.col, "values": B.data}
            np.savez(file, shape=B.shape, mass=made.mass, load=made.load, **parts)
        Path(file.name).replace(path)
    with np.load(path) as kept:
        places = kept["rows"], kept["columns"]
        shape = tuple(kept["shape"])
        B = sparse.csr_array((kept["values"], places), shape=shape)
        return Assembly(name, d, B, kept["mass"], kept["load"], mu)


SETS: dict[str, Callable[[int], Assembly]] = {
    "walls": walls,
    "heaps": heaps,
    "packings": packings,
}
