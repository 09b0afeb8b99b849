"""The whole job of a shipped scene in NumPy, SciPy and scikit-fem alone.

What a careful user writes without this package: scikit-fem's general form,
SuperLU with a symmetric ordering, one back-solve a contact component for W, and a
semismooth Newton method with a line search. It shares no code with the package.

    python benches/peer_scipy.py SCENE N [--save FILE.npz]

prints one JSON object.
"""

import json
import resource
import sys
from time import perf_counter

import numpy as np
import skfem
from scipy import sparse
from scipy.sparse.linalg import splu
from skfem.models.elasticity import lame_parameters, linear_elasticity


def graded(start, end, cell, ratio):
    """Points from ``start`` to ``end``, cells growing by ``ratio``."""
    points = [start]
    while (end - points[-1]) * cell > 0:
        points.append(points[-1] + cell)
        cell *= ratio
    points[-1] = end
    if len(points) > 2 and abs(end - points[-2]) < 0.5 * abs(points[-2] - points[-3]):
        del points[-2]
    return points


def scene(name, n):
    """Bodies (grids, E, nu), friction, clearance, candidates, and the load steps."""
    steel = (210000.0, 0.3)
    if name == "pressed_block":
        g = np.linspace(0, 40, n + 1)
        return [([g, g], 130000.0, 0.2)], 1.0, None, [{}]
    if name in ("sheared_cube", "cyclic_cube"):
        g = np.linspace(0, 100, n + 1)
        shear = np.sin(2 * np.pi * np.arange(41) / 20)
        shear = shear if name == "cyclic_cube" else [0.0, 1.0]
        steps = [{"top": (0.025 * s, 0.0, -0.05)} for s in shear]
        return [([g, g, g], *steel)], 0.3, None, steps
    if name == "two_blocks":
        g, h = np.linspace(0, 100, n + 1), np.linspace(0, 50, n // 2 + 1)
        steps = [{"top": (0.05 * s, 0.0, -0.1)} for s in (0.0, 1.0)]
        return [([g, g, h], *steel), ([g, g, h - 50], 21000.0, 0.3)], 0.3, None, steps
    h, ratio = 0.5 / n, 1.5 if n < 10 else 1.3 if n < 20 else 1.15
    out = graded(1.5, 20.0, h * ratio, ratio)[1:]
    x = np.array([-p for p in out[::-1]] + [*np.linspace(-1.5, 1.5, 6 * n + 1)] + out)
    y = np.array(graded(0.0, 20.0, h, ratio))
    steps = [{"top": (0.004 * s, -0.02)} for s in (0.0, 1.0)]
    return [([x, y], *steel), ([x, np.sort(-y)], *steel)], 0.3, 1.5, steps


def assemble(bodies):
    """Block-diagonal K, with mesh, basis and first degree of freedom of each body."""
    parts, first, blocks = [], 0, []
    for grids, young, poisson in bodies:
        dim = len(grids)
        kind = skfem.MeshHex if dim == 3 else skfem.MeshQuad
        element = skfem.ElementHex1() if dim == 3 else skfem.ElementQuad1()
        mesh = kind.init_tensor(*grids)
        basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=2)
        blocks.append(
            linear_elasticity(*lame_parameters(young, poisson)).assemble(basis)
        )
        parts.append((mesh, element, first))
        first += dim * mesh.nvertices
    return sparse.block_diag(blocks, format="csc"), parts


def on(mesh, axis, value):
    """Nodes on a plane, in the order of their coordinates."""
    nodes = np.flatnonzero(mesh.p[axis] == value)
    return nodes[np.lexsort(mesh.p[:, nodes])]


def areas(mesh, element, axis, value):
    """Tributary areas of a plane of the boundary."""
    facets = mesh.facets_satisfying(lambda x: np.isclose(x[axis], value), True)
    basis = skfem.FacetBasis(mesh, element, facets=facets, intorder=2)
    return skfem.LinearForm(lambda v, _: v).assemble(basis)


def solve_step(W, A, q, mu, r, v, scale, tol):
    """Alart–Curnier Newton on A v = W r + q (A None: the identity) from (r, v).

    ``scale`` (one number a component) is the step of the projection; the
    residual is relative to max |R|. Returns r, v, residual, iterations.
    """
    m, d = len(q), len(q) // len(mu)

    def natural_map(r, v):
        tau = (r - scale * v).reshape(-1, d)
        n, t = np.maximum(tau[:, 0], 0), np.linalg.norm(tau[:, 1:], axis=1)
        shrink = np.minimum(1, mu * n / np.where(t > 0, t, 1))
        projected = np.column_stack([n, shrink[:, None] * tau[:, 1:]])
        return r - projected.ravel()

    def defect(r, v):
        return W @ r + q - (v if A is None else A @ v)

    def merit(r, v):
        return np.linalg.norm(np.append(natural_map(r, v), scale * defect(r, v)))

    for iteration in range(100):
        F, rest = natural_map(r, v), defect(r, v)
        if iteration and np.abs(F).max() <= tol * np.abs(r).max():
            break
        x = (r - scale * v).reshape(-1, d)
        t = np.linalg.norm(x[:, 1:], axis=1)
        bound, length = mu * np.maximum(x[:, 0], 0), np.where(t > 0, t, 1)
        pressed = x[:, 0] > 0
        slip = pressed & ((t > bound) | (mu == 0))
        # P = derivative of the projection; dF = (I - P) dr + P scale dv.
        P = np.zeros((len(mu), d, d))
        P[pressed, 0, 0] = 1
        P[pressed & ~slip, 1:, 1:] = np.eye(d - 1)
        along = x[:, 1:] / length[:, None]
        across = np.eye(d - 1) - along[:, :, None] * along[:, None, :]
        P[slip, 1:, 1:] = ((bound / length)[:, None, None] * across)[slip]
        P[slip, 1:, 0] = (mu[:, None] * along)[slip]
        P = sparse.block_diag(P, format="csr")
        by_r = np.eye(m) - P.toarray()
        by_v = P @ sparse.diags_array(scale)
        if A is None:
            dr = np.linalg.solve(by_r + by_v @ W, -F - by_v @ rest)
            dv = W @ dr + rest
        else:
            J = np.block([[by_r, by_v.toarray()], [-W, A]])
            dr, dv = np.split(np.linalg.solve(J, np.append(-F, rest)), 2)
        before, step = merit(r, v), 1.0
        while step > 1e-4 and merit(r + step * dr, v + step * dv) > before:
            step /= 2
        r, v = r + step * dr, v + step * dv
    return r, v, np.abs(natural_map(r, v)).max() / np.abs(r).max(), iteration


def main():
    """Run one scene."""
    name, n = sys.argv[1], int(sys.argv[2])
    clock = [perf_counter()]
    bodies, friction, candidates, steps = scene(name, n)
    K, parts = assemble(bodies)
    dim, size = len(bodies[0][0]), K.shape[0]
    upper, element, _ = parts[0]
    last = dim - 1
    nodes = on(upper, last, 0.0)
    if candidates is not None:
        nodes = nodes[np.abs(upper.p[0, nodes]) <= candidates + 1e-9]
    area = areas(upper, element, last, 0.0)[nodes]
    order = [last, *range(last)]
    columns = (dim * nodes[:, None] + order).ravel()
    rows = np.arange(len(columns))
    B = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(rows), size))
    fixed, values = [np.zeros(0, int)], [[] for _ in steps]
    if len(parts) == 2:
        lower, _, first = parts[1]
        partner = on(lower, last, 0.0)
        partner = partner[np.isin(lower.p[0, partner], upper.p[0, nodes])]
        theirs = (first + dim * partner[:, None] + order).ravel()
        B = B - sparse.csr_array((np.ones(len(rows)), (rows, theirs)), shape=B.shape)
        held = on(lower, last, lower.p[last].min())
        fixed.append((first + dim * held[:, None] + np.arange(dim)).ravel())
        for v in values:
            v.append(np.zeros(dim * len(held)))
    gap = np.zeros((len(nodes), dim))
    mu = np.full(len(nodes), friction)
    f = np.zeros(size)
    if name == "cattaneo_mindlin":
        gap[:, 0] = upper.p[0, nodes] ** 2 / 200
    if name == "pressed_block":
        f[1::2] -= 50 * areas(upper, element, 1, 40.0)
        f[0::2] -= 100 * areas(upper, element, 0, 40.0)
        side = on(upper, 0, 0.0)
        fixed.append(2 * side)
        values[0].append(np.zeros(len(side)))
        mu[upper.p[0, nodes] == 0] = 0.0
    else:
        top = on(upper, last, upper.p[last].max())
        fixed.append((dim * top[:, None] + np.arange(dim)).ravel())
        for v, step in zip(values, steps, strict=True):
            v.append(np.tile(step["top"], len(top)))
    fixed = np.concatenate(fixed)
    free = np.setdiff1d(np.arange(size), fixed)
    clock.append(perf_counter())

    # Bodies held by contact alone: springs on the contact nodes make K regular, and
    # A v = W r + q takes them out again.
    spring = 0.0
    if name == "pressed_block":
        spring = 1e-2 * K.diagonal().max()
    normal = sparse.diags_array(np.tile([1.0] + [0.0] * last, len(nodes)))
    factor = splu(
        (K + spring * (B.T @ normal @ B)).tocsc()[free][:, free],
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    clock.append(perf_counter())
    Bf = B[:, free]
    W = np.empty((len(rows), len(rows)))
    # Narrow blocks stay in the cache: SuperLU is several times slower on wide ones.
    for start in range(0, len(rows), 8):
        block = Bf[start : start + 8].T.toarray(order="F")
        W[:, start : start + 8] = Bf @ factor.solve(block)
    clock.append(perf_counter())

    A = np.eye(len(rows)) - spring * W @ normal.toarray() if spring else None
    blocks = W.reshape(len(nodes), dim, len(nodes), dim)
    trace = np.einsum("ikik->i", blocks)
    scale = np.repeat(dim / trace, dim)
    r, u, offset = np.zeros(len(rows)), np.zeros(size), gap.ravel()
    reactions, residuals, iterations = [], [], 0
    for value in values:
        u[fixed] = np.concatenate(value)
        u[free] = factor.solve(f[free] - K[free][:, fixed] @ u[fixed])
        q = B @ u + (A @ offset if spring else offset)
        if spring:
            # From open contact the springless body is free: start from sticking.
            r = np.linalg.lstsq(W, -q, rcond=None)[0]
        v = np.zeros_like(q) if spring else W @ r + q
        r, v, residual, count = solve_step(W, A, q, mu, r, v, scale, 1e-12)
        taken_out = spring * (normal @ (v - offset))
        u[free] += factor.solve(Bf.T @ (r + taken_out))
        offset = gap.copy()
        offset[:, 1:] -= (B @ u).reshape(-1, dim)[:, 1:]
        offset = offset.ravel()
        reactions.append(r.reshape(-1, dim).copy())
        residuals.append(residual)
        iterations += count
    clock.append(perf_counter())
    seconds = np.diff(clock)
    if "--save" in sys.argv:
        np.savez(
            sys.argv[sys.argv.index("--save") + 1],
            x=upper.p[:, nodes].T,
            area=area,
            R=np.array(reactions),
        )
    print(
        json.dumps(
            {
                "dofs": size,
                "contacts": len(nodes),
                "seconds": {
                    "assemble": seconds[0],
                    "factor": seconds[1],
                    "compliance": seconds[2],
                    "solve": seconds[3],
                    "total": clock[-1] - clock[0],
                },
                "residual": max(residuals),
                "iterations": iterations,
                "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            }
        )
    )


if __name__ == "__main__":
    main()
