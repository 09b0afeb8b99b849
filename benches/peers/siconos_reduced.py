"""Solve one reduced problem after another with Siconos, in its own process.

    /usr/bin/python3 benches/peers/siconos_reduced.py

Needs siconos and NumPy, not this package, so that it runs under the Python that Siconos
is installed for. Reads one JSON object per line, ``{"problem": FILE.npz, "solver": NAME,
"tol": NUMBER, "iterations": NUMBER, "answer": FILE.npy}``, and answers each with a line,
``{"seconds": NUMBER, "iterations": NUMBER}``. The problem file holds W, q, mu, normal first;
the answer is r. Seconds are those of the driver alone; short runs are repeated, and the
minimum counts.
"""

import json
import os
import sys
from time import perf_counter

import numpy as np
import siconos.numerics as sn


def lift(W, q, nodes):
    """Write a 2D problem in 3D: the second tangent has no load and no coupling."""
    at = (3 * np.arange(nodes)[:, None] + [0, 1]).ravel()
    # Its compliance is like the others, so that it does not slow down the solver.
    whole = np.diag(np.repeat(W.diagonal().reshape(nodes, 2).mean(1), 3))
    whole[np.ix_(at, at)] = W
    load = np.zeros(3 * nodes)
    load[at] = q
    return whole, load


def solve(W, q, mu, solver, tol, iterations, once=False):
    """Reactions ``(n_c, d)``, seconds of the driver, iterations."""
    nodes, d = q.shape
    q = q.ravel()
    driver, name = sn.fc3d_driver, f"SICONOS_FRICTION_3D_{solver}"
    lifted = d == 2 and solver != "NSGS"  # Newton exists in 3D only
    if lifted:
        W, q = lift(W, q, nodes)
    elif d == 2:
        driver, name = sn.fc2d_driver, "SICONOS_FRICTION_2D_NSGS"
    size = 3 if lifted else d
    seconds = []
    while not seconds or (not once and len(seconds) < 3 and sum(seconds) < 0.02):
        problem = sn.FrictionContactProblem(size, nodes, W, q, mu)
        options = sn.SolverOptions(getattr(sn, name))
        options.dparam[sn.SICONOS_DPARAM_TOL] = tol
        options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = iterations
        r, v = np.zeros(len(q)), np.zeros(len(q))
        start = perf_counter()
        driver(problem, r, v, options)
        seconds.append(perf_counter() - start)
    done = int(options.iparam[sn.SICONOS_IPARAM_ITER_DONE])
    return r.reshape(nodes, size)[:, :d], min(seconds), done


def main():
    """Answer requests until standard input ends."""
    # The library prints from C, so only answers go to the real standard output.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    sn.numerics_set_verbose(0)
    print(json.dumps({"siconos": "ready"}), file=answers, flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        with np.load(request["problem"]) as file:
            W, q, mu = (np.ascontiguousarray(file[k]) for k in ("W", "q", "mu"))
        r, seconds, done = solve(
            W, q, mu, request["solver"], request["tol"], request["iterations"]
        )
        np.save(request["answer"], r)
        line = json.dumps({"seconds": seconds, "iterations": done})
        print(line, file=answers, flush=True)


if __name__ == "__main__":
    main()
