"""A sphere of triangles, refined from an icosahedron, and a cube of triangles."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def icosphere(halvings: int) -> tuple[Floats, Ints]:
    """Corners ``(m, 3)`` on the unit sphere and triangles ``(k, 3)``, with outward normals."""
    g = (1 + 5**0.5) / 2
    x = np.array([[0, s, t * g] for s in (-1, 1) for t in (-1, 1)])
    x = np.concatenate([np.roll(x, k, axis=1) for k in range(3)])
    # The faces are the triples of corners at the smallest distance, 2.
    near = np.abs(np.linalg.norm(x[:, None] - x, axis=2) - 2) < 1e-9
    triangles = [
        (i, j, k)
        for i in range(12)
        for j in range(i)
        for k in range(j)
        if near[i, j] and near[j, k] and near[k, i]
    ]
    faces = np.array(triangles)
    inwards = np.linalg.det(x[faces]) < 0
    faces[inwards] = faces[inwards, ::-1]
    x /= np.linalg.norm(x[0])
    for _ in range(halvings):
        edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
        ends, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
        middle = x[ends].sum(axis=1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        ab, bc, ca = len(x) + number.reshape(-1, 3).T
        a, b, c = faces.T
        parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
        x = np.concatenate([x, middle])
    return x, faces.astype(np.int64)


def cube() -> tuple[Floats, Ints]:
    """Corners of ``[0, 1]³`` and two triangles for each face, with outward normals."""
    x = np.array([(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)], float)
    ends = [np.flatnonzero(x[:, k] == end) for k in range(3) for end in (0, 1)]
    faces = np.array([f for a, b, c, d in ends for f in ([a, b, d], [a, d, c])])
    inwards = np.linalg.det(x[faces] - 0.5) < 0
    faces[inwards] = faces[inwards, ::-1]
    return x, faces
