"""Compare the guaranteed bound of the error with the true error: tables of `docs/paper`.

    python benches/error_bound.py [--seeds 24] [--print]

The points are iterates of `gauss_seidel` and `nesterov` and random points near the solution,
for problems of `problems.SETS` and of the tests. The first table has the ratio of bound and
true error in the norm of W, by the size of the error; the second the largest μ up to which
there is a bound for every load.
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import bipot_rs as bp

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests" / "python"))

import problems  # noqa: E402
import tables  # noqa: E402

from support.random_problems import random_problem  # noqa: E402

Array = NDArray[np.float64]
PAGE = ROOT / "docs" / "paper" / "9-error-bound.md"
SEEDS = 24
# Problems with more unknowns are left out: the table is about many small ones.
MOST = 450
CLASSES = ((3e-2, np.inf), (1e-5, 3e-2), (1e-8, 1e-5), (1e-11, 1e-8))


def norm(W: Array, d: Array) -> float:
    return float(np.sqrt(max(d.ravel() @ W @ d.ravel(), 0.0)))


def iterates(problem: bp.ReducedProblem, seed: int) -> Iterator[Array]:
    """Iterates of two methods, and points near the solution."""
    for method in ("gauss_seidel", "nesterov"):
        for count in (1, 2, 4, 8, 16, 32, 64, 128):
            yield problem.solve(method, 1e-13, max_iterations=count).reaction
    answer = problem.solve(tol=1e-14).reaction
    rng = np.random.default_rng(seed)
    for digits in (1, 3, 6, 9):
        yield answer * (1 + 10.0**-digits * rng.normal(size=answer.shape))


def drawn(kind: str) -> Callable[[int], problems.Problem]:
    def problem(seed: int) -> problems.Problem:
        given = random_problem(kind, 2 + seed % 2, seed)
        return problems.Problem(f"{kind} {seed}", given.W, given.q, given.mu)

    return problem


def ratios(
    of_seed: Callable[[int], problems.Problem], seeds: int
) -> dict[str, list[float]]:
    """Ratios by class of error, and one entry per problem for each kind of bound."""
    found: dict[str, list[float]] = {str(c): [] for c in CLASSES}
    found |= {"global": [], "local": [], "not available": []}
    for seed in range(seeds):
        given = of_seed(seed)
        if given.q.size > MOST or given.rigid is not None:
            continue
        problem = bp.ReducedProblem(given.W, given.q, given.mu)
        answer = problem.solve(tol=1e-14)
        if not answer.converged:
            continue
        kind = answer.error.kind
        found[kind].append(1.0)
        if kind != "global":
            continue
        points = np.array(list(iterates(problem, seed)))
        whole = norm(given.W, answer.reaction)
        for point, bound in zip(points, problem.error_bounds(points), strict=True):
            true = norm(given.W, point - answer.reaction)
            assert bound.energy is not None
            assert answer.error.energy is not None
            assert true <= bound.energy + answer.error.energy
            if true <= 100 * answer.error.energy:
                continue  # the solution is not known well enough
            for least, most in CLASSES:
                if least <= true / whole < most:
                    found[str((least, most))].append(bound.energy / true)
    return found


def limit(W: Array, d: int, *, most: float = 10.0) -> tuple[float, float]:
    """Largest μ with a bound for every load: in closed form, and with searched weights."""
    n = np.arange(0, len(W), d)
    t = np.setdiff1d(np.arange(len(W)), n)
    scale = np.repeat(1 / np.sqrt(np.diag(W).reshape(-1, d).mean(axis=1)), d)
    scaled = W * np.outer(scale, scale)
    alpha = np.linalg.eigvalsh(scaled[np.ix_(t, t)])[-1]
    beta = np.linalg.eigvalsh(np.linalg.inv(scaled)[np.ix_(n, n)])[-1]
    low, high = 0.0, most
    q = np.tile([-1.0, *[0.1] * (d - 1)], (len(n), 1))
    zero = np.zeros_like(q)
    while high - low > 0.02 * high:
        middle = (low + high) / 2
        kind = bp.ReducedProblem(W, q, middle).error_bound(zero)
        low, high = (middle, high) if kind.unique else (low, middle)
    return 2 / float(np.sqrt(alpha * beta)), low


SETS: dict[str, Callable[[int], problems.Problem]] = {
    "tests: held": drawn("held"),
    "tests: graded": drawn("graded"),
    "tests: frictionless": drawn("frictionless"),
    "random": problems.random,
    "held": problems.held,
    "two bodies": problems.two_bodies,
}
SHARP_HEAD = tables.columns(
    "set | global, local, none | > 3e-2 | 3e-2 to 1e-5 | 1e-5 to 1e-8 | 1e-8 to 1e-11"
)
BODIES = (
    ("2D block, 20 contacts, ν = 0.3", 2, 20, 0.3),
    ("2D block, 60 contacts, ν = 0.3", 2, 60, 0.3),
    ("3D block, 36 contacts, ν = 0.3", 3, 6, 0.3),
    ("3D block, 36 contacts, ν = 0.4999", 3, 6, 0.4999),
)
LIMIT_HEAD = ("W", "L = 2 at", "proved up to")


def sharp(name: str, seeds: int) -> list[str]:
    """Row of one set: kinds of bounds, and ratios as median / 90 % (points)."""
    found = ratios(SETS[name], seeds)
    kinds = (len(found[kind]) for kind in ("global", "local", "not available"))
    cells = [
        f"{np.median(x):.1f} / {np.quantile(x, 0.9):.1f} ({len(x)})" if x else "–"
        for x in (found[str(c)] for c in CLASSES)
    ]
    return [name, ", ".join(map(str, kinds)), *cells]


def limit_of_body(label: str, d: int, n: int, nu: float) -> list[str]:
    """Row of the largest μ for a condensed block."""
    closed, sought = limit(problems.block(d, n, nu)["W"], d)
    return [label, f"{closed:.2f}", f"{sought:.2f}"]


def limit_at_random(d: int, seeds: int) -> list[str]:
    """Row of the median of the largest μ for random problems."""
    pairs = [limit(random_problem("held", d, seed).W, d) for seed in range(seeds)]
    closed, sought = np.median(pairs, axis=0)
    return [f"random, {d}D, median", f"{closed:.2f}", f"{sought:.2f}"]


def main() -> None:
    """Measure, and write both tables."""
    parser = tables.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    args = parser.parse_args()
    first = tables.table(SHARP_HEAD, [sharp(name, args.seeds) for name in SETS])
    print(first, flush=True)
    rows = [limit_of_body(*body) for body in BODIES]
    rows += [limit_at_random(d, args.seeds) for d in (2, 3)]
    second = tables.table(LIMIT_HEAD, rows)
    print(second)
    if not args.print and tables.whole(parser, args, "seeds"):
        tables.rewrite(PAGE, "bound over error", first)
        tables.rewrite(PAGE, "largest friction", second)


if __name__ == "__main__":
    main()
