"""Time saved by work that a scene does not need, compared with doing that work.

    python benches/skipped_work.py            # the table of the README
    python benches/skipped_work.py --small    # without the cube of 148,000 unknowns

Cubes whose top is prescribed and pressed down and whose base holds the candidates. The two
sides run in turn, the minimum of each counts, and their results are compared:

- a face of candidates over a round obstacle, of which about 2 % close, compared with
  condensing onto those alone, which nobody knows beforehand;
- a stiffness with the same pattern and other values by `update`, compared with a problem
  of a pattern that this process has not met before;
- eight friction coefficients by `solve_many`, compared with one after the other;
- sixteen load steps, displacement asked for at the end only, compared with at each step.
"""

from copy import copy

import numpy as np
import tables
from scipy import sparse
from timing import fastest
from unit_body import unit_body

import bipot_rs as bp

HEAD = tables.columns(
    "case | unknowns | contacts | bipot_rs, s | compared with, s | ratio | difference"
)
DIM, MU = 3, 0.3
# Share of the face that closes.
SHARE = 0.02


class Cube:
    """Arrays of a cube of side 1 with Young's modulus 1."""

    def __init__(self, cells):
        mesh, self.K, base, top = unit_body(DIM, cells)
        self.places = mesh.p[:, base].T
        self.fixed = (DIM * top[:, None] + np.arange(DIM)).ravel()
        self.dofs = (DIM * base[:, None] + np.roll(np.arange(DIM), 1)).ravel()
        # Pressed down, and dragged along x, by the top.
        self.drag = np.tile([0.003, 0.0, -0.01], len(top))

    def gap(self, share):
        """Gap to a round obstacle on which about this share of the face closes."""
        across = self.places[:, :2] - 0.5
        # Hertz: a² = R δ; the compliance of the cube takes part of the depth δ.
        radius = 1.1 * share / np.pi / 0.01
        return (across**2).sum(axis=1) / (2 * radius)

    @property
    def unknowns(self):
        """Number of free degrees of freedom."""
        return self.K.shape[0] - len(self.fixed)

    def problem(self, gap, kept=None):
        """Problem with contacts on the whole base or on the nodes ``kept``, ascending."""
        rows = self.dofs.reshape(-1, DIM)
        rows, gap = (rows, gap) if kept is None else (rows[kept], gap[kept])
        m = rows.size
        shape = (m, self.K.shape[0])
        B = sparse.csr_array((np.ones(m), (np.arange(m), rows.ravel())), shape)
        return bp.ContactProblem(self.K, B, gap=gap, mu=MU, fixed=self.fixed)

    def shuffled(self, seed):
        """Same cube with its nodes in another order, so that its pattern is new."""
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


def difference(found, expected):
    """Largest difference, relative to the largest entry."""
    return np.abs(found - expected).max() / np.abs(expected).max()


def row(case, cube, contacts, rounds, skip, do_all, compare=difference):
    """Row of one case: ``skip`` and ``do_all`` run in turn, and their results are compared."""
    fast, slow = [], []
    for _ in range(rounds):
        seconds, found = fastest(1, skip)
        fast.append(seconds)
        seconds, expected = fastest(1, do_all)
        slow.append(seconds)
    return (
        case,
        f"{cube.unknowns:,}",
        contacts,
        tables.figures(min(fast)),
        tables.figures(min(slow)),
        f"{min(fast) / min(slow):.2f}",
        f"{compare(found, expected):.0e}",
    )


def face(cells, rounds):
    """Time a face of candidates of which few close."""
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
        lambda all_of_them, alone: difference(all_of_them[closed], alone),
    )


def pattern(cells, rounds):
    """Time new values in a known pattern."""
    cube = Cube(cells)
    gap = np.zeros(len(cube.places))
    # A process remembers patterns, so a new one must differ. Both sides number their nodes
    # at random.
    cube, *others = [cube.shuffled(seed) for seed in range(rounds + 1)]
    kept, unknown = cube.problem(gap), iter(others)
    stiffer = iter([(1.0 + 0.1 * (k + 1)) * cube.K for k in range(rounds)])

    def updated():
        kept.update(next(stiffer))
        return kept.compliance

    def new_problem():
        return next(unknown).problem(gap).compliance

    return row(
        "other numbers, the same pattern",
        cube,
        f"{len(gap):,}",
        rounds,
        updated,
        new_problem,
        # The moduli differ, and W is inverse to them.
        lambda W, other: difference(W * (1.0 + 0.1 * rounds), other),
    )


def coefficients(cells, rounds):
    """Time eight paths with one factorisation."""
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
    """Time a path whose displacement is asked for once."""
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
    args = parser.parse_args()
    rows = [face(25, 3)]
    rows += [] if args.small else [face(36, 2)]
    rows += [pattern(25, 3), coefficients(25, 3), steps(25, 3)]
    tables.publish("skipped work", tables.table(HEAD, rows), write=not args.print)


if __name__ == "__main__":
    main()
