"""The block of `scale.py` in files, and the iterative engine on one, for `beside_petsc.py`.

    python benches/iterative_file.py FILE MODE --save ANSWER --tol TOL

MODE is ``newton``, the load path, or ``linear``, one load with all contacts out of reach.
Prints one JSON line, and saves reactions ``(steps, n_c, 3)`` or displacements ``(n,)``.
"""

import argparse
import json
import tempfile
import time
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

import numpy as np
import scale
from peers import report
from scipy import sparse

import bipot_rs as bp
from bipot_rs import scene


def assembled(cells):
    """The block of `scale.py`, and the load of the linear problem."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "block.toml"
        text = scale.SCENE.format(*cells, 2.5e-4 * cells[2], -5e-4 * cells[2])
        file.write_text(text, encoding="utf-8")
        block = scene.read(str(file))
        case = scene.assemble(block, scene.bodies(block))
    load = np.zeros(case.model.n)
    # On one node, in the middle of the contact surface: smooth and rough parts.
    load[case.model.contact_dofs[len(case.model.gap) // 2, 0] + 2] = 1.0
    return case, load


def write_slabs(path, case, load, ranks):
    """K and the loads of the free nodes, in slabs of rows; (n, t1, t2) at every node."""
    model = case.model
    columns = model.B.indices.reshape(-1, 3)
    order = columns[0] - columns[0].min()
    firsts = columns.min(axis=1)
    selects = (model.B.data == 1).all() and (columns - firsts[:, None] == order).all()
    held = np.isin(np.arange(model.n), model.fixed).reshape(-1, 3)
    if not selects or (held.any(axis=1) != held.all(axis=1)).any():
        raise ValueError("contact frames along the axes and whole nodes are expected")
    nodes = np.flatnonzero(~held[:, 0])
    dofs = (3 * nodes[:, None] + order).ravel()
    rows = model.K[dofs]
    K, coupling = rows[:, dofs].sorted_indices(), rows[:, model.fixed]
    forces = np.array([-(coupling @ step_values) for step_values in case.prescribed])
    contacts = np.searchsorted(nodes, firsts // 3)
    arrays = {"n": len(dofs)}
    ends = len(nodes) * np.arange(ranks + 1) // ranks
    for rank, (a, b) in enumerate(pairwise(ends)):
        mine = (a <= contacts) & (contacts < b)
        dofs_of_slab, slab = slice(3 * a, 3 * b), K[3 * a : 3 * b]
        part = {"data": slab.data, "indices": slab.indices, "indptr": slab.indptr}
        part |= {
            "nodes": model.nodes[nodes[a:b]][:, order],
            "load": load[dofs][dofs_of_slab],
        }
        part |= {
            "forces": forces[:, dofs_of_slab],
            "contacts": 3 * (contacts[mine] - a),
        }
        part |= {"gap": model.gap[mine], "mu": model.mu[mine]}
        arrays |= {f"{name}.{rank}": values for name, values in part.items()}
    np.savez(path, **arrays)
    return dofs


def write(path, case, load):
    """The arguments of `ContactProblem`, with the loads of both modes."""
    model = case.model
    arrays = {"gap": model.gap, "mu": model.mu, "fixed": model.fixed, "load": load}
    arrays |= {"nodes": model.nodes, "prescribed": case.prescribed}
    for name in ("K", "B"):
        matrix = getattr(model, name)
        for part in ("data", "indices", "indptr", "shape"):
            arrays[f"{name}_{part}"] = getattr(matrix, part)
    np.savez(path, **arrays)


def matrix(arrays, name):
    """A sparse matrix, taken out of the arrays."""
    parts = (arrays.pop(f"{name}_{part}") for part in ("data", "indices", "indptr"))
    return sparse.csr_array(tuple(parts), shape=tuple(arrays.pop(f"{name}_shape")))


def main():
    """Solve, and print the JSON line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("mode", choices=("linear", "newton"))
    parser.add_argument("--save", required=True)
    parser.add_argument("--tol", type=float, required=True)
    args = parser.parse_args()
    with np.load(args.file) as file:
        arrays = dict(file)
    K, B = matrix(arrays, "K"), matrix(arrays, "B")
    linear = args.mode == "linear"
    # Imports that come with the first problem are not timed, as they are not for PETSc.
    bp.ContactProblem(np.eye(3), np.eye(3), gap=[0.0], mu=0.3).solve([-1.0, 0.0, 0.0])
    start = time.perf_counter()
    problem = bp.ContactProblem(
        K,
        B,
        # Out of reach: the displacements of the load are some 1e-5.
        gap=arrays["gap"] + 1.0 if linear else arrays["gap"],
        mu=arrays["mu"],
        fixed=arrays["fixed"],
        coordinates=np.repeat(arrays["nodes"], 3, axis=0),
        engine="iterative",
    )
    made = time.perf_counter()
    loads = {"load": arrays["load"]} if linear else {"prescribed": arrays["prescribed"]}
    result = problem.solve(**loads, tol=args.tol)
    end = time.perf_counter()
    if problem.stats["engine_reason"] != "it was asked for":
        raise SystemExit(problem.stats["engine_reason"])
    answer, residual = result.reaction, max(step.residual for step in result)
    if linear:
        answer, load = result.displacement[0], arrays["load"]
        left = np.delete(K @ answer - load, arrays["fixed"])
        residual = np.linalg.norm(left) / np.linalg.norm(load)
    np.savez(args.save, answer=answer)
    seconds = {"set-up": made - start, "solve": end - made, "total": end - start}
    line = {"seconds": seconds, "peak_mb": report.peak_mb(), "residual": residual}
    counts = {name: problem.stats[name] for name in ("newton", "krylov")}
    print(json.dumps(line | counts | {"version": version("bipot-rs")}))


if __name__ == "__main__":
    main()
