"""Heaps of rigid disks in the plane, and whether contact carries them."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from bipot_rs._lib.types import Floats


class Heap(NamedTuple):
    """Rigid motions of all contacts, an independent basis, the weights on it, and mu."""

    R: Floats
    e: Floats
    mu: float


def make_heap(seed: int) -> Heap | None:
    """5 to 18 disks on a floor; None if a disk turns without moving a contact under load."""
    rng = np.random.default_rng(seed)
    centres: list[Floats] = []
    radii: list[float] = []
    contacts: list[tuple[int, int, Floats]] = []  # disk, disk below or -1, normal
    x = 0.0
    for i in range(int(rng.integers(2, 5))):
        r = rng.uniform(0.7, 1.3)
        gap = 0.0 if rng.random() < 0.5 else rng.uniform(0, 0.6)
        x += r + radii[-1] + gap if radii else 0.0
        centres.append(np.array([x, r]))
        radii.append(r)
        contacts.append((i, -1, np.array([0.0, 1.0])))
    count = int(rng.integers(5, 19))
    for _ in range(200):
        if len(centres) == count:
            break
        a, b = rng.choice(len(centres), 2, replace=False)
        r = rng.uniform(0.7, 1.3)
        across = centres[b] - centres[a]
        d, ra, rb = np.linalg.norm(across), radii[a] + r, radii[b] + r
        if not abs(ra - rb) < d < ra + rb:
            continue
        along = (ra**2 - rb**2 + d**2) / (2 * d)
        up = np.array([-across[1], across[0]]) / d * np.sign(across[0])
        place = centres[a] + along * across / d + np.sqrt(ra**2 - along**2) * up
        others = [k for k in range(len(centres)) if k not in (a, b)]
        free = all(np.linalg.norm(place - centres[k]) > radii[k] + r for k in others)
        between = np.sort([centres[a][0], centres[b][0]])
        if free and place[1] > r and between[0] < place[0] < between[1]:
            normals = [(k, (place - centres[k]) / (radii[k] + r)) for k in (a, b)]
            contacts += [(len(centres), int(k), n) for k, n in normals]
            centres.append(place)
            radii.append(r)
    R = np.zeros((len(contacts), 2, len(centres), 3))
    for c, (above, below, n) in enumerate(contacts):
        for disk, sign in ((above, 1.0), (below, -1.0)):
            if disk < 0:
                continue
            t = np.array([-n[1], n[0]])
            arm = -sign * radii[disk] * n
            for k, axis in enumerate((n, t)):
                turn = arm[0] * axis[1] - arm[1] * axis[0]
                R[c, k, disk] = sign * np.array([*axis, turn])
    weights = np.zeros((len(centres), 3))
    weights[:, 1] = -np.pi * np.square(radii)
    flat = R.reshape(2 * len(contacts), -1)
    _, sizes, motions = np.linalg.svd(flat)
    rank = int(np.sum(sizes > 1e-10 * sizes[0]))
    if np.abs(motions[rank:] @ weights.ravel()).max(initial=0.0) > 1e-9:
        return None
    moved = motions[:rank]
    return Heap(flat @ moved.T, moved @ weights.ravel(), rng.uniform(0.3, 1.2))


def is_carried(heap: Heap) -> bool:
    """Whether forces along the edges of the cones balance the weights."""
    pair = np.array([[1.0, 1.0], [heap.mu, -heap.mu]])
    edges = heap.R.T @ np.kron(np.eye(len(heap.R) // 2), pair)
    found = linprog(np.ones(edges.shape[1]), A_eq=edges, b_eq=-heap.e, method="highs")
    return bool(found.status == 0)
