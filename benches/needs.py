"""What is left undone where a scene does not need it: each beside doing it all the same.

    python benches/needs.py            # the table of the README
    python benches/needs.py --small    # without the cube of 148,000

Cubes, their top held and pressed down, their base the candidates. The two sides run in
turn, the smaller of each counts, and the answers of both are compared:

- a face of candidates over a round obstacle, of which some 2 % close, beside condensing
  onto those alone, which nobody knows beforehand;
- a stiffness of the same pattern and other numbers by `update`, beside a problem of a
  pattern that was not met before;
- eight friction coefficients by `solve_many`, beside one after the other;
- sixteen load steps, a displacement asked for at the end alone, beside one at each.
"""

from copy import copy
from time import perf_counter

import numpy as np
import tables
from scipy import sparse

import bipot_rs as bp
from bipot_rs.fem import Body, Material, box, stiffness

HEAD = ("need", "unknowns", "contacts", "ours, s", "beside, s", "ours / it", "differs")
DIM, MU = 3, 0.3
# Of the face that closes.
SHARE = 0.02


class Cube:
    """Arrays of a cube of side 1, Young's modulus 1."""

    def __init__(self, cells):
        axis = np.linspace(0.0, 1.0, cells + 1)
        mesh = box([axis] * DIM, "hexahedron")
        self.K = sparse.csr_array(stiffness(Body("cube", mesh, Material(1.0, 0.3))))
        base, top = (np.flatnonzero(mesh.p[-1] == end) for end in (0.0, 1.0))
        self.places = mesh.p[:, base].T
        self.fixed = (DIM * top[:, None] + np.arange(DIM)).ravel()
        self.dofs = (DIM * base[:, None] + np.roll(np.arange(DIM), 1)).ravel()
        # Pressed down, and dragged along x, by the top.
        self.drag = np.tile([0.003, 0.0, -0.01], len(top))

    def gap(self, share):
        """Of a round obstacle that so much of the face closes on, roughly."""
        across = self.places[:, :2] - 0.5
        # Hertz: a² = R δ; of the depth, the cube's own compliance takes a part.
        radius = 1.1 * share / np.pi / 0.01
        return (across**2).sum(axis=1) / (2 * radius)

    @property
    def unknowns(self):
        """Degrees of freedom that nothing prescribes."""
        return self.K.shape[0] - len(self.fixed)

    def problem(self, gap, kept=None):
        """Contacts of the whole base or of those kept, ascending."""
        rows = self.dofs.reshape(-1, DIM)
        rows, gap = (rows, gap) if kept is None else (rows[kept], gap[kept])
        m = rows.size
        shape = (m, self.K.shape[0])
        B = sparse.csr_array((np.ones(m), (np.arange(m), rows.ravel())), shape)
        return bp.ContactProblem(self.K, B, gap=gap, mu=MU, fixed=self.fixed)

    def shuffled(self, seed):
        """The same with its nodes in another order, a pattern never met before."""
        count = self.K.shape[0] // DIM
        order = np.random.default_rng(seed).permutation(count)
        place = np.argsort(order)
        dofs = (DIM * order[:, None] + np.arange(DIM)).ravel()
        other = copy(self)
        other.K = sparse.csr_array(self.K[dofs][:, dofs])
        for name in ("fixed", "dofs"):
            old = getattr(self, name)
            setattr(other, name, DIM * place[old // DIM] + old % DIM)
        return other


def timed(work):
    """Seconds, and what came out."""
    start = perf_counter()
    found = work()
    return perf_counter() - start, found


def apart(found, expected):
    """Largest difference, of the largest."""
    return np.abs(found - expected).max() / np.abs(expected).max()


def row(need, cube, contacts, rounds, ours, other, differs=apart):
    """In turn: `ours` and `other` work, `differs` compares what they return."""
    mine, its = [], []
    for _ in range(rounds):
        seconds, found = timed(ours)
        mine.append(seconds)
        seconds, expected = timed(other)
        its.append(seconds)
    return (
        *(need, f"{cube.unknowns:,}", contacts),
        *(tables.figures(min(mine)), tables.figures(min(its))),
        *(f"{min(mine) / min(its):.2f}", f"{differs(found, expected):.0e}"),
    )


def face(cells, rounds):
    """A face of candidates, of which few close."""
    cube = Cube(cells)
    gap = cube.gap(SHARE)

    def reactions(kept=None):
        return cube.problem(gap, kept).solve(prescribed=cube.drag).reaction[-1]

    closed = np.flatnonzero(reactions()[:, 0] > 0)
    return row(
        "few of many candidates close",
        cube,
        f"{len(closed)} of {len(gap):,}",
        rounds,
        reactions,
        lambda: reactions(closed),
        lambda all_of_them, alone: apart(all_of_them[closed], alone),
    )


def pattern(cells, rounds):
    """The same pattern with other numbers."""
    cube = Cube(cells)
    gap = np.zeros(len(cube.places))
    # Patterns are remembered within a process: one that is anew must be another. Nodes of
    # both sides are in no order.
    cube, *others = [cube.shuffled(seed) for seed in range(rounds + 1)]
    kept, unknown = cube.problem(gap), iter(others)
    stiffer = iter([(1.0 + 0.1 * (k + 1)) * cube.K for k in range(rounds)])

    def updated():
        kept.update(next(stiffer))
        return kept.compliance

    def anew():
        return next(unknown).problem(gap).compliance

    return row(
        "other numbers, the same pattern",
        cube,
        f"{len(gap):,}",
        rounds,
        updated,
        anew,
        # The moduli differ, and W as their inverses.
        lambda W, other: apart(W * (1.0 + 0.1 * rounds), other),
    )


def coefficients(cells, rounds):
    """Eight paths on one factorisation."""
    cube = Cube(cells)
    problem = cube.problem(np.zeros(len(cube.places)))
    several = np.linspace(0.1, 0.8, 8)
    loads = np.array([[1.0], [2.0]]) * cube.drag

    def together():
        cases = [{"prescribed": loads, "mu": mu} for mu in several]
        return np.array([found.reaction for found in problem.solve_many(cases)])

    def in_turn():
        return np.array(
            [
                problem.solve_many([{"prescribed": loads, "mu": mu}])[0].reaction
                for mu in several
            ]
        )

    return row(
        "eight friction coefficients",
        cube,
        f"{len(cube.places):,}",
        rounds,
        together,
        in_turn,
    )


def steps(cells, rounds):
    """A path whose displacement is asked for once."""
    cube = Cube(cells)
    problem = cube.problem(np.zeros(len(cube.places)))
    path = np.linspace(0.1, 1.0, 16)[:, None] * cube.drag

    def at_the_end():
        return problem.solve(prescribed=path)[-1].displacement

    def each():
        seen = []
        problem.solve(prescribed=path, on_step=lambda _, s: seen.append(s.displacement))
        return seen[-1]

    return row(
        "sixteen load steps",
        cube,
        f"{len(cube.places):,}",
        rounds,
        at_the_end,
        each,
    )


def main():
    """Measure, and rewrite the table."""
    parser = tables.parser(__doc__)
    parser.add_argument("--small", action="store_true", help="without 148,000 unknowns")
    asked = parser.parse_args()
    rows = [face(25, 3)]
    rows += [] if asked.small else [face(36, 2)]
    rows += [pattern(25, 3), coefficients(25, 3), steps(25, 3)]
    tables.publish("needs", tables.table(HEAD, rows), write=not asked.print)


if __name__ == "__main__":
    main()
