"""Solve a whole shipped scene with NumPy, SciPy and scikit-fem alone.

    python benches/peers/with_scipy.py SCENE N [--save FILE.npz] [--tol TOL]

The script that a careful user writes without this package: scikit-fem's general form,
SuperLU with a symmetric ordering, one back-solve per contact component for W, and a
semismooth Newton method with a line search. It shares no code with the package. Prints
one JSON line; ``TOL`` is the natural map relative to max |R|.
"""

import numpy as np
import report
from scipy import sparse
from system import Condensed, build, natural_map, scale_of


def solve_step(W, A, q, mu, r, v, scale, tol):
    """Alart–Curnier Newton on A v = W r + q (A None: the identity) from (r, v).

    ``scale`` (one number per component) is the step of the projection; the
    residual is relative to max |R|. Returns r, v, residual, iterations.
    """
    m, d = len(q), len(q) // len(mu)

    def defect(r, v):
        return W @ r + q - (v if A is None else A @ v)

    def merit(r, v):
        return np.linalg.norm(
            np.append(natural_map(r, v, mu, scale), scale * defect(r, v))
        )

    for iteration in range(100):
        F, rest = natural_map(r, v, mu, scale), defect(r, v)
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
    return r, v, np.abs(natural_map(r, v, mu, scale)).max() / np.abs(r).max(), iteration


def main():
    """Run one scene."""
    args = report.arguments(__doc__)
    clock = report.Clock()
    system = build(args.scene, args.n)
    clock.lap("assemble")
    nodes, d = system.gap.shape
    # For a body that only contact holds, springs on the contact nodes make K regular;
    # A v = W r + q removes them again.
    spring = 0.0
    if args.scene == "pressed_block":
        spring = 1e-2 * system.K.diagonal().max()
    body = Condensed(system, spring, clock)
    W, B, normal = body.W, system.B, body.normal
    A = np.eye(len(W)) - spring * W @ normal.toarray() if spring else None
    scale = scale_of(W, nodes)
    r, offset = np.zeros(len(W)), system.gap.ravel()
    reactions, displacements, residuals, iterations = [], [], [], 0
    for prescribed in system.prescribed:
        u = body.free_displacement(prescribed)
        q = B @ u + (A @ offset if spring else offset)
        if spring:
            # With open contacts the body without springs is free, so start with stick.
            r = np.linalg.lstsq(W, -q, rcond=None)[0]
        v = np.zeros_like(q) if spring else W @ r + q
        r, v, residual, count = solve_step(W, A, q, system.mu, r, v, scale, args.tol)
        body.add(u, r + spring * (normal @ (v - offset)))
        offset = system.gap.copy()
        offset[:, 1:] -= (B @ u).reshape(-1, d)[:, 1:]
        offset = offset.ravel()
        reactions.append(r.reshape(-1, d).copy())
        displacements.append(v.reshape(-1, d).copy())
        residuals.append(residual)
        iterations += count
        clock.step()
    report.write(
        args,
        clock,
        "SciPy",
        system.x,
        system.area,
        reactions,
        displacements,
        dofs=system.K.shape[0],
        residual=max(residuals),
        iterations=iterations,
        settings="SuperLU, back-solves for W, semismooth Newton",
    )


if __name__ == "__main__":
    main()
