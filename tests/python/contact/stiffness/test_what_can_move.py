"""What can move: the verdict on random small bodies beside the exact rank of K.

The entries of K are whole numbers times a power of two, so that they have no error, and the
rank follows from elimination in whole numbers. Let λ be the least eigenvalue of K that is not
zero, with the diagonal of K scaled to one. The program must find exactly the free motions if
λ is above `MARGIN`. Below it, a resistance may be the rounding that an assembled K has: there
the program may say that it cannot decide, take the resistance for rounding, or a mechanism
beside such a motion for an elastic one. It must not call more motions free than have an
eigenvalue below the margin, and never an exact K one with negative energy.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array

import bipot_rs as bp

Ints = NDArray[np.int64]
# A mechanism needs the next motion at 1000 times its rounding, 6 ε of |x|ᵀ|K||x|, which is up
# to some tens of the diagonal.
MARGIN = 1e-10


class Body(NamedTuple):
    """Entries of K, whole numbers; coordinates of nodes; degrees of freedom of a node."""

    K: NDArray[Any]
    at: NDArray[np.float64]
    size: int


def strip(
    random: np.random.Generator, cells: int, slender: int, hinge: int | None
) -> Body:
    """Bilinear squares in a row, 2^slender times as long as high, by 12 times their ratio.

    At a hinge a cell shares only its lower node with the one before.
    """
    ratio = 1 << slender
    lame, mu = (int(c) for c in random.integers(1, 4, 2))
    stiff = np.array([[1, -1], [-1, 1]], object)
    mass = np.array([[2, 1], [1, 2]], object)
    mixed = np.array([[-1, -1], [1, 1]], object)
    # Along x cells have length `ratio`, along y 1. All integrals are times 12 ratio.
    xx = np.kron(stiff, mass) * 2
    yy = np.kron(mass, stiff) * 2 * ratio**2
    xy = np.kron(mixed, mixed.T) * 3 * ratio
    cell = np.empty((4, 2, 4, 2), object)
    cell[:, 0, :, 0] = (lame + 2 * mu) * xx + mu * yy
    cell[:, 1, :, 1] = (lame + 2 * mu) * yy + mu * xx
    cell[:, 0, :, 1] = lame * xy + mu * xy.T
    cell[:, 1, :, 0] = cell[:, 0, :, 1].T
    nodes = [[0, 1, 2, 3]]
    at = [(0, 0), (0, 1), (ratio, 0), (ratio, 1)]
    for k in range(1, cells):
        left = nodes[-1][2:]
        if k == hinge:
            at.append((k * ratio, 1))
            left = [left[0], len(at) - 1]
        at += [((k + 1) * ratio, 0), ((k + 1) * ratio, 1)]
        nodes.append([*left, len(at) - 2, len(at) - 1])
    K = np.zeros((2 * len(at),) * 2, object)
    for nodes_of_body in nodes:
        dofs = [2 * i + c for i in nodes_of_body for c in range(2)]
        K[np.ix_(dofs, dofs)] += cell.reshape(8, 8)
    return Body(K, np.array(at, float), 2)


def truss(random: np.random.Generator, d: int, nodes: int, bars: int) -> Body:
    """Bars between random points of a grid, often a mechanism."""
    at = random.permutation(np.indices((4,) * d).reshape(d, -1).T)[:nodes]
    K = np.zeros((d * nodes,) * 2, object)
    ends = {tuple(sorted(random.choice(nodes, 2, replace=False))) for _ in range(bars)}
    ends |= {(i, i + 1) for i in range(nodes - 1)}
    for i, j in ends:
        along = [int(x) for x in at[j] - at[i]]
        dofs = [d * i + c for c in range(d)] + [d * j + c for c in range(d)]
        both = np.array([*along, *(-x for x in along)], object)
        K[np.ix_(dofs, dofs)] += int(random.integers(1, 5)) * np.outer(both, both)
    return Body(K, at.astype(float), d)


def frame(random: np.random.Generator, beams: int, length: int) -> Body:
    """Beams in a row along x, with a rotation at each node."""
    area, inertia = (int(c) for c in random.integers(1, 5, 2))
    K = np.zeros((3 * (beams + 1),) * 2, object)
    # By forces and by moments at the ends.
    sway = np.array([2, length, -2, length], object)
    bend = np.array([0, length, 0, -length], object)
    bending = 3 * np.outer(sway, sway) + np.outer(bend, bend)
    axial = area * length**2 * np.array([[1, -1], [-1, 1]], object)
    for k in range(beams):
        K[np.ix_([3 * k, 3 * k + 3], [3 * k, 3 * k + 3])] += axial
        dofs = [3 * k + 1, 3 * k + 2, 3 * k + 4, 3 * k + 5]
        K[np.ix_(dofs, dofs)] += inertia * bending
    at = np.zeros((beams + 1, 2))
    at[:, 0] = length * np.arange(beams + 1)
    return Body(K, at, 3)


def joined(bodies: list[Body]) -> Body:
    """Several bodies, each beside the one before."""
    n = [len(body.K) for body in bodies]
    K = np.zeros((sum(n),) * 2, object)
    at, first, beside = [], 0, 0.0
    for body in bodies:
        K[first : first + len(body.K), first : first + len(body.K)] = body.K
        at.append(body.at + beside)
        first, beside = first + len(body.K), beside + np.ptp(body.at) + 1
    return Body(K, np.concatenate(at), bodies[0].size)


KINDS: dict[str, Callable[[np.random.Generator], Body]] = {
    "strip": lambda r: strip(r, int(r.integers(1, 6)), 0, None),
    "hinge": lambda r: strip(r, int(r.integers(2, 6)), int(r.integers(0, 3)), 1),
    "slender": lambda r: strip(r, int(r.integers(2, 6)), int(r.integers(4, 11)), None),
    "slender hinge": lambda r: strip(r, 4, int(r.integers(3, 9)), 2),
    "plane truss": lambda r: truss(r, 2, int(r.integers(3, 7)), int(r.integers(2, 9))),
    "truss": lambda r: truss(r, 3, int(r.integers(3, 6)), int(r.integers(3, 12))),
    "frame": lambda r: frame(r, int(r.integers(1, 6)), 1 << int(r.integers(0, 4))),
    "two strips": lambda r: joined([strip(r, 2, 0, None), strip(r, 2, 1, 1)]),
    "strip and truss": lambda r: joined([strip(r, 2, 0, None), truss(r, 2, 4, 5)]),
}


def rank(rows: NDArray[Any]) -> int:
    """The rank of whole numbers, by Bareiss' elimination without fractions."""
    rows = rows.copy()
    rank_so_far, last = 0, 1
    for column in range(rows.shape[1]):
        left = [i for i in range(rank_so_far, len(rows)) if rows[i, column] != 0]
        if not left:
            continue
        rows[[rank_so_far, left[0]]] = rows[[left[0], rank_so_far]]
        pivot = rows[rank_so_far, column]
        below = rows[rank_so_far + 1 :]
        below[:] = (
            below * pivot - np.outer(below[:, column], rows[rank_so_far])
        ) // last
        rank_so_far, last = rank_so_far + 1, pivot
    return rank_so_far


class Question(NamedTuple):
    """Arguments of a body with supports, springs and contacts."""

    given: dict[str, Any]
    free: int
    """Motions without energy, and those of them that move no contact."""
    unseen: int
    least: float
    """Least eigenvalue that is not zero, and the number of those below the margin."""
    soft: int


def questions(
    kind: str, with_coordinates: bool, weak: bool, seed: int
) -> Iterator[Question]:
    random = np.random.default_rng([seed, with_coordinates, weak])
    for _ in range(12):
        body = KINDS[kind](random)
        n, d = len(body.K), body.at.shape[1]
        order = random.permutation(len(body.at))
        dofs = (body.size * order[:, None] + np.arange(body.size)).ravel()
        K, at = body.K[np.ix_(dofs, dofs)], body.at[order]
        power = 0
        if weak:
            # A spring that is 2^-power of the stiffness there.
            bits = int(np.abs(body.K).max()).bit_length()
            power = int(random.integers(10, 52 - bits))
            dof = int(random.integers(n))
            K = K * (1 << power)
            K[dof, dof] += body.K[dofs[dof], dofs[dof]] or 1
        nodes = random.choice(len(at), min(3, len(at) - 1), replace=False)
        fixed = np.flatnonzero(random.random(n) < random.choice([0.0, 0.1, 0.3]))
        if body.size > d:  # contacts do not move rotations
            fixed = fixed[fixed % body.size < d]
        rows = [body.size * i + c for i in nodes for c in (1, 0, *range(2, d))]
        B = csr_array(
            (np.ones(len(rows)), (np.arange(len(rows)), rows)), (len(rows), n)
        )
        kept = np.setdiff1d(np.arange(n), fixed)
        exact = K[np.ix_(kept, kept)]
        inside = np.flatnonzero(~np.isin(kept, rows))
        values = np.array(exact, float)
        scale = np.sqrt(np.where(np.diag(values) > 0, np.diag(values), 1.0))
        eigenvalues = np.sort(np.linalg.eigvalsh(values / np.outer(scale, scale)))
        free = len(kept) - rank(exact)
        least = eigenvalues[free] if free < len(kept) else np.inf
        given: dict[str, Any] = {"gap": np.zeros((len(nodes), d)), "fixed": fixed}
        if with_coordinates:
            given["coordinates"] = np.repeat(at, body.size, axis=0)
        assert (np.array(K, float) == K).all()
        given |= {"K": csr_array(np.array(K, float) / 2.0**power), "B": B}
        unseen = len(inside) - rank(exact[:, inside])
        soft = int((eigenvalues <= MARGIN).sum())
        yield Question(given, free, unseen, float(least), soft)


def answer(given: dict[str, Any]) -> int | str:
    """The number of free motions, or the kind of the refusal."""
    try:
        problem = bp.ContactProblem(**given, mu=0.3)
        return int(problem.stats["rigid_motions"])
    except (bp.FloatingBodyError, ValueError) as error:
        return str(getattr(error, "kind", error))


@pytest.mark.parametrize("weak", [False, True], ids=["", "weak spring"])
@pytest.mark.parametrize("with_coordinates", [True, False], ids=["places", "K"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_verdict_is_that_of_the_exact_rank(
    kind: str, with_coordinates: bool, weak: bool
) -> None:
    for k, question in enumerate(questions(kind, with_coordinates, weak, 7)):
        verdict = answer(question.given)
        about = f"{k}: {verdict}, {question[1:]}"
        exact = "floating_body" if question.unseen else question.free
        if question.least > MARGIN:
            assert verdict == exact, about
        elif isinstance(verdict, int):
            assert verdict <= question.soft, about
        else:
            assert verdict in ("few_digits", "floating_body"), about
