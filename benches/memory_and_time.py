"""Memory and time of operations whose cost could grow with a product of two sizes.

    python benches/memory_and_time.py            # the table of the README

Each is compared with a similar operation whose cost does not. Both run in their own
process, whose peak memory is measured. Seconds are processor time of all threads, so that
other load does not count.
"""

import json
import subprocess
import sys
from time import process_time

import numpy as np
import tables
from peers.report import peak_mb

import bipot_rs as bp
from bipot_rs.obstacle import Surface

HEAD = ("operation", "size", "s", "MB", "compared with", "s", "MB")


def sheet(n, up):
    """Unit square of n × n quadrilaterals."""
    axis = np.linspace(0.0, 1.0, n + 1)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    corner = np.arange(n * (n + 1)).reshape(n, n + 1)[:, :-1].ravel()
    facets = np.column_stack([corner, corner + n + 1, corner + n + 2, corner + 1])
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    return points, facets if up else facets[:, ::-1]


def mortar(upper, lower):
    """Mortar pairs of two sheets."""
    sheets = *sheet(upper, up=False), *sheet(lower, up=True)
    return lambda: bp.pairs(*sheets)


def sphere(bands, off):
    """Closest points on a sphere of radius 1 of points at distance ``off`` from its centre."""
    theta = np.linspace(0, np.pi, bands + 1)[1:-1, None]
    phi = np.arange(bands) * 2 * np.pi / bands
    rings = np.stack(
        np.broadcast_arrays(
            np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
        ),
        axis=-1,
    )
    x = np.concatenate([rings.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    node = np.arange((bands - 1) * bands).reshape(bands - 1, bands)
    following = np.roll(node, -1, axis=1)
    a, b, c, d = node[:-1], node[1:], following[1:], following[:-1]
    top, bottom = np.full(bands, len(x) - 2), np.full(bands, len(x) - 1)
    triangles = ((a, b, c), (a, c, d), (top, node[0], following[0]))
    triangles = (*triangles, (bottom, following[-1], node[-1]))
    facets = [np.stack(one, axis=-1).reshape(-1, 3) for one in triangles]
    surface = Surface(x, np.concatenate(facets))
    points = np.random.default_rng(0).normal(size=(200, 3))
    points *= off / np.linalg.norm(points, axis=1)[:, None]
    return lambda: surface.closest(points)


def line(contacts, mu):
    """Uniqueness of contacts along a line on an elastic body, all coupled."""
    along = np.arange(contacts)
    W = np.zeros((contacts, 2, contacts, 2))
    kernel = 0.5 * np.exp(-np.abs(along[:, None] - along) / 3)
    np.fill_diagonal(kernel, 1.0)
    W[:, 0, :, 0] = W[:, 1, :, 1] = kernel
    del kernel
    q = np.tile([-1.0, 0.3], (contacts, 1))
    problem = bp.ReducedProblem(W.reshape(2 * contacts, -1), q, mu)
    solution = problem.solve()
    return lambda: solution.unique


def statuses(kind, contacts, mu):
    """All solutions of a random plane problem."""
    rng = np.random.default_rng(0)
    n = 2 * contacts
    if kind == "definite":
        factor = rng.normal(size=(n, n))
        W = factor @ factor.T / contacts + 0.02 * np.eye(n)
    elif kind == "indefinite":
        W = rng.normal(size=(n, n))
        W = W + W.T
    else:
        W = 1e-3 + 0.999 * np.eye(n)
    problem = bp.ReducedProblem(W, rng.normal(size=(contacts, 2)) - [0.5, 0.0], mu)
    return problem.answers


# For each row: operation, size, function, arguments; then what it is compared with.
ROWS = (
    *(
        (
            ("one mortar facet on a sheet", f"{n * n:,} facets", mortar, (1, n)),
            ("roles swapped", mortar, (n, 1)),
        )
        for n in (100, 220)
    ),
    *(
        (
            (
                f"200 points at {off:g} R from the centre",
                "199,080 facets",
                sphere,
                args,
            ),
            ("at 0.5 R", sphere, (316, 0.5)),
        )
        for off, args in ((1e-3, (316, 1e-3)), (1e-9, (316, 1e-9)))
    ),
    (
        ("`unique`, friction 0.5", "5,001 contacts", line, (5001, 0.5)),
        ("without friction", line, (5001, 0.0)),
    ),
    *(
        (
            (
                f"`answers`, {kind} W, friction {mu:g}",
                "12 contacts",
                statuses,
                (kind, 12, mu),
            ),
            ("10 contacts", statuses, (kind, 10, mu)),
        )
        for kind in ("definite", "indefinite", "weakly coupled")
        for mu in (0.4, 5.0)
    ),
)


def measured(make, arguments):
    """Seconds and megabytes of one operation, in a process of its own."""
    call = json.dumps([make.__name__, *arguments])
    run = subprocess.run(
        [sys.executable, __file__, "--one", call],
        capture_output=True,
        text=True,
        check=True,
    )
    seconds, peak = json.loads(run.stdout)
    return [f"{seconds:.2g}", f"{peak:.0f}"]


def one(call):
    """Measure one operation in this process."""
    name, *arguments = json.loads(call)
    work = globals()[name](*arguments)
    start = process_time()
    work()
    seconds = process_time() - start
    print(json.dumps([seconds, peak_mb()]))


def rows():
    """Row of each operation."""
    for (name, size, make, arguments), (other_name, other, others) in ROWS:
        found = measured(make, arguments)
        yield (name, size, *found, other_name, *measured(other, others))


def main():
    """Measure, and rewrite the table."""
    parser = tables.parser(__doc__)
    parser.add_argument(
        "--one", help="measure one function, a JSON list of its name and arguments"
    )
    args = parser.parse_args()
    if args.one:
        one(args.one)
        return
    tables.publish("memory and time", tables.table(HEAD, rows()), write=not args.print)


if __name__ == "__main__":
    main()
