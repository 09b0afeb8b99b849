"""K, B and loads of a scene by scikit-fem, and W by SciPy, for the peers that need them.

    python benches/peers/system.py SCENE N --save FILE.npz

writes the matrices for a peer whose Python has no scikit-fem, and prints one JSON line.
"""

from typing import NamedTuple

import numpy as np
from scenes import scene
from scipy import sparse
from scipy.sparse.linalg import splu


class System(NamedTuple):
    """K u = f + Bᵀ r, v = B u + gap, normal first; ``prescribed`` has one row per step."""

    K: sparse.csc_matrix
    B: sparse.csr_matrix
    f: np.ndarray
    fixed: np.ndarray
    prescribed: np.ndarray
    gap: np.ndarray  # (n_c, d)
    mu: np.ndarray
    x: np.ndarray  # (n_c, d) [mm]
    area: np.ndarray


def assemble(bodies):
    """Block-diagonal K, with mesh, element and first degree of freedom of each body."""
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    parts, first, blocks = [], 0, []
    for grids, young, poisson in bodies:
        dim = len(grids)
        kind = skfem.MeshHex if dim == 3 else skfem.MeshQuad
        element = skfem.ElementHex1() if dim == 3 else skfem.ElementQuad1()
        mesh = kind.init_tensor(*grids)
        basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=2)
        form = linear_elasticity(*lame_parameters(young, poisson))
        blocks.append(form.assemble(basis))
        parts.append((mesh, element, first))
        first += dim * mesh.nvertices
    return sparse.block_diag(blocks, format="csc"), parts


def on(mesh, axis, value):
    """Nodes on a plane, ordered by their coordinates."""
    nodes = np.flatnonzero(mesh.p[axis] == value)
    return nodes[np.lexsort(mesh.p[:, nodes])]


def areas(mesh, element, axis, value):
    """Tributary areas of the nodes on a boundary plane."""
    import skfem

    facets = mesh.facets_satisfying(lambda x: np.isclose(x[axis], value), True)
    basis = skfem.FacetBasis(mesh, element, facets=facets, intorder=2)
    return skfem.LinearForm(lambda v, _: v).assemble(basis)


def build(name, n):
    """Assemble the system of a scene."""
    data = scene(name, n)
    K, parts = assemble(data.bodies)
    dim, size = len(data.bodies[0].grids), K.shape[0]
    upper, element, _ = parts[0]
    last = dim - 1
    nodes = on(upper, last, 0.0)
    if data.half_width is not None:
        nodes = nodes[np.abs(upper.p[0, nodes]) <= data.half_width + 1e-9]
    order = [last, *range(last)]
    columns = (dim * nodes[:, None] + order).ravel()
    rows = np.arange(len(columns))
    shape = (len(rows), size)
    B = sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=shape)
    fixed, values = [], [[] for _ in data.top]
    if len(parts) == 2:
        lower, _, first = parts[1]
        partner = on(lower, last, 0.0)
        partner = partner[np.isin(lower.p[0, partner], upper.p[0, nodes])]
        theirs = (first + dim * partner[:, None] + order).ravel()
        B = B - sparse.csr_matrix((np.ones(len(rows)), (rows, theirs)), shape=shape)
        held = on(lower, last, lower.p[last].min())
        fixed.append((first + dim * held[:, None] + np.arange(dim)).ravel())
        for v in values:
            v.append(np.zeros(dim * len(held)))
    gap, mu = np.zeros((len(nodes), dim)), np.full(len(nodes), data.mu)
    if data.radius is not None:
        gap[:, 0] = upper.p[0, nodes] ** 2 / (2 * data.radius)
    f = np.zeros(size)
    if data.top[0] is None:
        f[1::2] -= 50 * areas(upper, element, 1, 40.0)
        f[0::2] -= 100 * areas(upper, element, 0, 40.0)
        side = on(upper, 0, 0.0)
        fixed.append(2 * side)
        values[0].append(np.zeros(len(side)))
        mu[upper.p[0, nodes] == 0] = 0.0
    else:
        top = on(upper, last, upper.p[last].max())
        fixed.append((dim * top[:, None] + np.arange(dim)).ravel())
        for v, step in zip(values, data.top, strict=True):
            v.append(np.tile(step, len(top)))
    return System(
        K,
        B.tocsr(),
        f,
        np.concatenate(fixed),
        np.array([np.concatenate(v) for v in values]),
        gap,
        mu,
        upper.p[:, nodes].T,
        areas(upper, element, last, 0.0)[nodes],
    )


def save(system, path, **more):
    """Write a system and further scalars."""
    arrays = system._asdict() | more
    for name in ("K", "B"):
        matrix = arrays.pop(name)
        parts = ("data", "indices", "indptr", "shape")
        arrays |= {f"{name}_{part}": getattr(matrix, part) for part in parts}
    np.savez(path, **arrays)


def load(path):
    """Read a system written by `save`, and its scalars."""
    with np.load(path) as file:
        arrays = dict(file)
    for name, kind in (("K", sparse.csc_matrix), ("B", sparse.csr_matrix)):
        data, indices, indptr, shape = (
            arrays.pop(f"{name}_{part}")
            for part in ("data", "indices", "indptr", "shape")
        )
        arrays[name] = kind((data, indices, indptr), shape=tuple(shape))
    system = System(**{field: arrays.pop(field) for field in System._fields})
    return system, arrays


class Condensed:
    """W by one back-solve per contact unknown, with springs if K alone is singular."""

    def __init__(self, system, spring, clock):
        self.system, self.spring = system, spring
        K, B, size = system.K, system.B, system.K.shape[0]
        self.free = np.setdiff1d(np.arange(size), system.fixed)
        self.coupling = K[self.free][:, system.fixed]
        self.Bf = B[:, self.free].tocsr()
        nodes, d = system.gap.shape
        # Springs act on contact nodes along the normal only.
        self.normal = sparse.diags(np.tile([1.0] + [0.0] * (d - 1), nodes))
        held = K + spring * (B.T @ self.normal @ B) if spring else K
        self.factor = splu(
            held.tocsc()[self.free][:, self.free],
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        clock.lap("factor")
        m = B.shape[0]
        self.W = np.empty((m, m))
        # Narrow blocks fit the cache; SuperLU is several times slower on wide ones.
        for start in range(0, m, 8):
            block = self.Bf[start : start + 8].T.toarray(order="F")
            self.W[:, start : start + 8] = self.Bf @ self.factor.solve(block)
        clock.lap("compliance")

    def free_displacement(self, prescribed):
        """Displacement without contact forces."""
        u = np.zeros(self.system.K.shape[0])
        u[self.system.fixed] = prescribed
        u[self.free] = self.factor.solve(
            self.system.f[self.free] - self.coupling @ prescribed
        )
        return u

    def add(self, u, force):
        """Add to u, in place, the displacement due to contact and spring forces."""
        u[self.free] += self.factor.solve(self.Bf.T @ force)


def natural_map(r, v, mu, scale):
    """Return r - proj(r - scale v, product of cones), zero for a solution (r, v)."""
    d = len(r) // len(mu)
    tau = (r - scale * v).reshape(-1, d)
    n, t = np.maximum(tau[:, 0], 0), np.linalg.norm(tau[:, 1:], axis=1)
    shrink = np.minimum(1, mu * n / np.where(t > 0, t, 1))
    return r - np.column_stack([n, shrink[:, None] * tau[:, 1:]]).ravel()


def scale_of(W, nodes):
    """Step of the projection for each component, from the diagonal block of its node."""
    d = len(W) // nodes
    trace = np.einsum("ikik->i", W.reshape(nodes, d, nodes, d))
    return np.repeat(d / trace, d)


def main():
    """Write the matrices of one scene."""
    import json

    import report

    args = report.arguments(__doc__)
    clock = report.Clock()
    system = build(args.scene, args.n)
    clock.lap("assemble")
    save(system, args.save, assemble=clock.phases["assemble"])
    print(json.dumps({"dofs": system.K.shape[0], "seconds": clock.phases}))


if __name__ == "__main__":
    main()
