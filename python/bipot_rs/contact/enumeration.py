"""All answers of a problem that may have several, and the search for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, SupportsIndex, overload

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact.solution import Solution

# Answers whose relative displacements differ by less, beside the largest one in
# sight, are one: they are solved to 1e-12, and may lose some digits to condition.
_SAME = 1e-7


class Answers(Sequence[Solution]):
    """The answers that were found, each a `Solution`.

    Attributes
    ----------
    complete
        Whether it is proved that there are no others. An empty sequence that is
        complete proves that the problem has no answer.
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
    def __getitem__(self, k: Any) -> Any:
        return self._solutions[k]

    def __iter__(self) -> Iterator[Solution]:
        return iter(self._solutions)

    def __repr__(self) -> str:
        known = "all there are" if self.complete else "there may be others"
        return f"Answers({len(self)} found, {known})"


def search(
    solve: Callable[[Floats | None], Solution],
    size: Floats,
    mu: Floats,
    dim: int,
    restarts: int,
    seed: int,
    moved: float,
) -> Answers:
    """Distinct answers from many starts; nothing proves that there are no others.

    Parameters
    ----------
    solve
        From reactions ``(n_c, d)``, or from nothing.
    size
        Sizes of reactions to start from, ``(n_c,)``.
    mu
        Friction coefficients, ``(n_c,)`` or ``(n_c, 2)``.
    dim, restarts, seed
        ``d``; how many starts; of the random ones among them.
    moved
        Largest displacement that reactions undo, where contacts stick.
    """
    found: list[Solution] = []
    rng = np.random.default_rng(seed)
    for start in _starts(rng, size, mu, dim, restarts):
        solution = solve(start)
        if solution.converged and not any(_same(solution, s, moved) for s in found):
            found.append(solution)
    return Answers(found, complete=False)


def _same(one: Solution, other: Solution, moved: float) -> bool:
    # By v: where W has not full rank, one v belongs to many reactions. Where all
    # contacts stick v is the rounding of what reactions have undone.
    apart = np.abs(one.relative_displacement - other.relative_displacement)
    sizes = (np.abs(s.relative_displacement).max(initial=0.0) for s in (one, other))
    return bool(apart.max(initial=0.0) <= _SAME * max(*sizes, moved))


def _starts(
    rng: np.random.Generator, size: Floats, mu: Floats, dim: int, restarts: int
) -> Iterator[Floats | None]:
    """Nothing, all pressed and sticking, all sliding one way, then random ones."""
    yield None
    limits = (size * mu.T).T.reshape(len(size), -1)
    directions = np.vstack([np.zeros(dim - 1), np.eye(dim - 1), -np.eye(dim - 1)])
    for direction in directions:
        yield np.column_stack([size, limits * direction])
    for _ in range(max(restarts - 1 - len(directions), 0)):
        pressed = size * (rng.random(len(size)) < 0.7) * 10 ** rng.uniform(-1, 1)
        side = rng.normal(size=(len(size), dim - 1))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        # Half of them inside the cone, half on its border.
        share = np.minimum(2 * rng.random(len(size)), 1.0)
        reach = (share * pressed * mu.T).T.reshape(len(size), -1)
        yield np.column_stack([pressed, reach * side])
