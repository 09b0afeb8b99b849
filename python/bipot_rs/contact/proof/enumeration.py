"""Search for all solutions of a problem that may have several."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import SupportsIndex, overload

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact.results.solution import Solution

# Solutions whose relative displacements differ by less, relative to the largest, are the
# same: they are solved to 1e-12 and may lose some digits to conditioning.
_SAME = 1e-7


class Answers(Sequence[Solution]):
    """Solutions of one problem: a sequence of `Solution`.

    Attributes
    ----------
    complete
        Whether it is proved that there are no others. If the sequence is complete and
        empty, the problem has no solution.
    """

    def __init__(self, solutions: Sequence[Solution], *, complete: bool) -> None:
        self._solutions = tuple(solutions)
        self.complete = complete

    def __len__(self) -> int:
        return len(self._solutions)

    @overload
    def __getitem__(self, k: SupportsIndex) -> Solution: ...
    @overload
    def __getitem__(self, k: slice) -> tuple[Solution, ...]: ...
    def __getitem__(self, k: SupportsIndex | slice) -> Solution | tuple[Solution, ...]:
        return self._solutions[k]

    def __repr__(self) -> str:
        extent = "all there are" if self.complete else "there may be others"
        return f"Answers({len(self)} found, {extent})"


def search_answers(
    solve: Callable[[Floats | None], Solution],
    size: Floats,
    mu: Floats,
    dim: int,
    restarts: int,
    seed: int,
    moved: float,
) -> Answers:
    """Solve from many starts and collect the distinct solutions.

    There may be others.

    ``solve``: function of the reactions ``(n_c, d)`` to start from, or of None.
    ``size``: magnitudes of reactions to start from, ``(n_c,)``.
    ``mu``: friction coefficients, ``(n_c,)`` or ``(n_c, 2)``.
    ``dim, restarts, seed``: dimension, number of starts, and seed of the random starts.
    ``moved``: largest displacement that reactions cancel, if contacts stick.
    """
    solutions: list[Solution] = []
    rng = np.random.default_rng(seed)
    for start in _draw_starts(rng, size, mu, dim, restarts):
        solution = solve(start)
        if solution.converged and not any(
            _are_same(solution, s, moved) for s in solutions
        ):
            solutions.append(solution)
    return Answers(solutions, complete=False)


def _are_same(first: Solution, other: Solution, moved: float) -> bool:
    # Compare v: if W is singular, many reactions have the same v. If all contacts stick,
    # v is the rounding error of the cancelled displacements.
    apart = np.abs(first.relative_displacement - other.relative_displacement)
    sizes = (np.abs(s.relative_displacement).max(initial=0.0) for s in (first, other))
    return bool(apart.max(initial=0.0) <= _SAME * max(*sizes, moved))


def _draw_starts(
    rng: np.random.Generator, size: Floats, mu: Floats, dim: int, restarts: int
) -> Iterator[Floats | None]:
    """None, all contacts sticking, all slipping in one direction, then random starts."""
    yield None
    limits = (size * mu.T).T.reshape(len(size), -1)
    directions = np.vstack([np.zeros(dim - 1), np.eye(dim - 1), -np.eye(dim - 1)])
    for direction in directions:
        yield np.column_stack([size, limits * direction])
    for _ in range(max(restarts - 1 - len(directions), 0)):
        pressed = size * (rng.random(len(size)) < 0.7) * 10 ** rng.uniform(-1, 1)
        side = rng.normal(size=(len(size), dim - 1))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        # Half of the starts are inside the cone, half on its boundary.
        share = np.minimum(2 * rng.random(len(size)), 1.0)
        reach = (share * pressed * mu.T).T.reshape(len(size), -1)
        yield np.column_stack([pressed, reach * side])
