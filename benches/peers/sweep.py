"""Projected Gauss–Seidel sweeps as a careful NumPy user writes them.

Each contact in turn is solved by projections with ρ = 1/λ_max(W_ii) on plain numbers, which
are faster than arrays of three; v is updated by one product with a block column of W, stored
by rows. It shares no code with the package.
"""

from math import hypot, sqrt
from time import perf_counter

import numpy as np


def sweep(W, q, mu, tol, seconds):
    """Reactions ``(n_c, d)`` of ``v = W r + q``, to a residual of `tol`.

    Stops if ‖r − proj(r − ρ ṽ)‖, divided by the larger of ‖r‖ and its value at r = 0, meets
    `tol` in node-scaled variables, or after `seconds`.
    """
    nodes, d = q.shape
    columns = np.ascontiguousarray(W.T).reshape(nodes, d, nodes * d)
    blocks = W.reshape(nodes, d, nodes, d)[range(nodes), :, range(nodes)]
    rho = (1 / np.linalg.norm(blocks, 2, axis=(1, 2))).tolist()
    own, friction = blocks.tolist(), mu.tolist()
    step = d / np.trace(blocks, axis1=1, axis2=2)[:, None]
    r, v = np.zeros((nodes, d)), q.copy()
    flat = v.reshape(-1)
    at_zero = np.linalg.norm(natural_map(r, v, mu, step))
    start, count = perf_counter(), 0
    while perf_counter() - start < seconds:
        count += 1
        for i in range(nodes):
            before = r[i]
            after = contact(before.tolist(), v[i].tolist(), own[i], friction[i], rho[i])
            change = after - before
            if change.any():
                r[i] = after
                flat += change @ columns[i]
        if count % 20 == 0:  # because rounding errors add up in v
            np.add(W @ r.ravel(), q.ravel(), out=flat)
        residual = np.linalg.norm(natural_map(r, v, mu, step))
        if residual <= tol * max(np.linalg.norm(r / np.sqrt(step)), at_zero):
            break
    return r


def contact(r, v, W, mu, rho):
    """Up to three projections at one contact, with the others fixed.

    More projections, which approach the exact solution of the contact, are slower in
    total.
    """
    d = len(r)
    q = [v[k] - sum(W[k][j] * r[j] for j in range(d)) for k in range(d)]
    for _ in range(3):
        v = [q[k] + sum(W[k][j] * r[j] for j in range(d)) for k in range(d)]
        n = r[0] - rho * (v[0] + mu * hypot(*v[1:]))
        t = [r[k] - rho * v[k] for k in range(1, d)]
        length = hypot(*t)
        if mu * length <= -n:
            new = [0.0] * d
        elif length <= mu * n:
            new = [n, *t]
        else:
            normal = (n + mu * length) / (1 + mu * mu)
            scale = mu * normal / length if length else 0.0
            new = [normal, *(scale * x for x in t)]
        moved = sqrt(sum((x - y) ** 2 for x, y in zip(new, r, strict=True)))
        r = new
        if moved <= 1e-6 * hypot(*r):
            break
    return np.array(r)


def natural_map(r, v, mu, step):
    """``r − proj(r − ρ ṽ)`` of all contacts, divided by √ρ."""
    slip = np.linalg.norm(v[:, 1:], axis=1)
    tau = r - step * v
    tau[:, 0] -= step[:, 0] * mu * slip
    return (r - project(tau, mu)) / np.sqrt(step)


def project(tau, mu):
    """Projection of each row of ``tau (n_c, d)`` onto Coulomb's cone, closed form (12)."""
    n, t = tau[:, 0], np.linalg.norm(tau[:, 1:], axis=1)
    normal = (n + mu * t) / (1 + mu**2)
    scale = np.divide(mu * normal, t, out=np.zeros_like(t), where=t > 0)
    slips = np.column_stack([normal, scale[:, None] * tau[:, 1:]])
    projected = np.where((t <= mu * n)[:, None], tau, slips)
    projected[mu * t <= -n] = 0.0
    return projected
