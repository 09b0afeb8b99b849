"""What the derivatives of a load path need of its problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import CsrMatrix, Floats, Ints, MatrixLike
from bipot_rs._lib.validation import csr, floats, loads, shaped
from bipot_rs._lib.validation import gap as gap_of_step
from bipot_rs._lib.validation import gaps as gaps_of_steps
from bipot_rs.contact.results.derivatives import DataChange
from bipot_rs.contact.results.latches import Latches


class Held(Protocol):
    """Relations of inclined supports, rigid sets, cyclic symmetries and bolts.

    K and B contain them, as their solution.
    """

    def stiffness(self, K: CsrMatrix) -> MatrixLike:
        """K with these relations."""

    def unknowns(self, u: Floats) -> Floats:
        """The solution of (1), from the displacements of all degrees of freedom."""

    def load(self, force: Floats) -> Floats:
        """Forces on the unknowns: those on dependent displacements are passed on."""

    def displacement(self, y: Floats) -> Floats:
        """Displacements of all degrees of freedom, from the unknowns, the solution of (1)."""

    def prescribed(self, values: Floats) -> None:
        """Raise for displacements that these relations do not allow."""


@dataclass(frozen=True)
class PathModel:
    """The contact operator and the shapes of the data of a load path."""

    contact: CsrMatrix  # sparse (d n_c, n): B
    fixed: Ints  # numbers of the prescribed degrees of freedom
    gap_shape: tuple[int, ...]  # shape of `gap` of the problem
    # Whether the gaps of each step were given by component; None if there are none.
    gaps_by_component: bool | None = None
    held: Held | None = None
    latches: Latches | None = None  # bolts

    @property
    def n(self) -> int:
        """Number of degrees of freedom."""
        return int(self.contact.shape[1])

    def forces(self, values: Floats) -> Floats:
        """Forces ``(steps, n)`` on the unknowns."""
        if self.held is None:
            return values
        return np.stack([self.held.load(row) for row in values])


@dataclass(frozen=True)
class PathChange:
    """Changes of the data of each step, None for those that do not change."""

    load: Floats | None  # (steps, n)
    prescribed: Floats | None  # (steps, fixed)
    gap: Floats | None  # (steps, n_c, d)
    friction: Floats  # (n_c, d - 1)
    rest: Floats | None  # (n_c, 2): of cohesion and dilatancy
    stiffness: CsrMatrix | None  # sparse (n, n)


def check_changes(
    model: PathModel,
    steps: int,
    mu: Floats,
    shape: tuple[int, int],
    change: DataChange,
) -> PathChange:
    """Check the arguments of `Result.jvp`."""
    load, prescribed, gap = change.load, change.prescribed, change.gap
    forces = motions = None
    fixed = len(model.fixed)
    if load is not None:
        pairs = loads(load, None, model.n, fixed)
        forces = model.forces(_repeat_rows("load", [f for f, _ in pairs], steps))
    if prescribed is not None:
        pairs = loads(None, prescribed, model.n, fixed)
        motions = _repeat_rows("prescribed", [u for _, u in pairs], steps)
        if model.held is not None:
            for row in motions:
                model.held.prescribed(row)
    return PathChange(
        forces,
        motions,
        None if gap is None else _check_gap(model, gap, steps, shape),
        spread_change("mu", change.mu, mu, shape[1]),
        check_rest(change.cohesion, change.dilatancy, mu),
        _check_matrix(change.K, model.n),
    )


def spread_change(what: str, change: ArrayLike | None, mu: Floats, d: int) -> Floats:
    """A change of the friction coefficients along each tangent, ``(n_c, d - 1)``."""
    if change is None:
        return np.zeros((len(mu), d - 1))
    change_of_mu = shaped(what, change, (), mu.shape)
    return spread_friction(np.broadcast_to(change_of_mu, mu.shape), d)


def check_rest(
    cohesion: ArrayLike | None, dilatancy: ArrayLike | None, mu: Floats
) -> Floats | None:
    """Changes of cohesion and dilatancy, ``(n_c, 2)``; None for zero."""
    given = {"cohesion": cohesion, "dilatancy": dilatancy}
    if all(value is None for value in given.values()):
        return None
    rest = np.zeros((len(mu), 2))
    for k, (what, value) in enumerate(given.items()):
        if value is not None and mu.ndim == 2:
            raise ValueError(
                f"{what} has a change, but mu has two coefficients of each contact, with "
                "which there is none"
            )
        rest[:, k] = spread_change(what, value, mu if mu.ndim == 1 else mu[:, 0], 2)[
            :, 0
        ]
    return rest


def spread_friction(mu: Floats, d: int) -> Floats:
    """Coefficients along each tangent, ``(n_c, d - 1)``."""
    if mu.ndim == 2:
        return mu
    return np.repeat(mu[:, None], d - 1, axis=1)


def _check_gap(
    model: PathModel, gap: ArrayLike, steps: int, shape: tuple[int, int]
) -> Floats:
    if model.gaps_by_component is None and np.ndim(gap) < 3:
        as_object = np.asarray(gap, dtype=object)
        if as_object.shape in ((shape[0],), shape):
            return np.repeat(gap_of_step(gap, *shape)[None], steps, axis=0)
    return _repeat_rows("gap", list(gaps_of_steps(gap, *shape)), steps)


def _repeat_rows(what: str, rows: Sequence[Floats], steps: int) -> Floats:
    """One row for each step; a single row is used for all."""
    if len(rows) not in (1, steps):
        raise ValueError(
            f"{what} has {len(rows)} steps, expected one or {steps} as the path"
        )
    return np.stack([rows[min(k, len(rows) - 1)] for k in range(steps)])


def _check_matrix(stiffness: MatrixLike | None, n: int) -> CsrMatrix | None:
    if stiffness is None:
        return None
    sparse: CsrMatrix = csr("K", stiffness).matrix
    change: CsrMatrix = sparse
    if change.shape != (n, n):
        raise ValueError(f"K has shape {change.shape}, expected {(n, n)}")
    apart = abs(sparse - sparse.T)
    size = abs(sparse).max() if sparse.nnz else 0.0
    if apart.nnz and apart.max() > 1e-10 * size:
        raise ValueError("K is not symmetric, expected a symmetric change of K")
    return change


def check_cotangent(
    what: str, values: ArrayLike | None, shape: tuple[int, ...]
) -> Floats | None:
    """A cotangent of a quantity of this shape; a single step may be left out of it."""
    if values is None:
        return None
    array = floats(what, values)
    of_step = shape[0] == 1 and array.shape == shape[1:]
    return floats(what, array[None] if of_step else array, shape=shape)


def reshape_gap_gradient(model: PathModel, by_component: Floats) -> Floats:
    """Gradients ``(steps, n_c, d)`` in the shape of the gap of the path or problem."""
    if model.gaps_by_component is not None:
        return by_component if model.gaps_by_component else by_component[:, :, 0]
    whole = by_component.sum(axis=0)
    by_contact: Floats = whole if len(model.gap_shape) == 2 else whole[:, 0]
    return by_contact
