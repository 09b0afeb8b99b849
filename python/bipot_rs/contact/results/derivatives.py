"""Derivatives of solutions, as `Result` and `Solution` return them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, NoReturn, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Bools, CsrMatrix, Floats, MatrixLike

# A result, and a solution, that is differentiated.
R = TypeVar("R", contravariant=True)
S = TypeVar("S", contravariant=True)
# A load of a model, and the derivatives by its parameters.
L = TypeVar("L", contravariant=True)
G = TypeVar("G", covariant=True)


@dataclass(eq=False, repr=False)
class Tangent:
    """Directional derivatives of the results of a load path, stacked as in `Result`.

    Attributes
    ----------
    reaction, relative_displacement : (steps, n_c, d)
    slip : (steps, n_c, d - 1)
    one_sided : (steps, n_c)
        Contacts on a border between two statuses. The derivatives then hold on the side of
        the direction alone.
    """

    reaction: Floats
    relative_displacement: Floats
    slip: Floats
    one_sided: Bools
    _recover: Callable[[], Floats]

    @cached_property
    def displacement(self) -> Floats:
        """Derivatives of the displacements, ``(steps, n)``, computed on first use.

        Raises
        ------
        ValueError
            The problem was made with ``loads=`` and has no factor.
        """
        return self._recover()

    def __getstate__(self) -> dict[str, object]:
        # The problem stays behind: what it computes on first use is computed before.
        with suppress(ValueError):
            _ = self.displacement
        return self.__dict__ | {"_recover": _Unavailable().load}


class Adjoint(Protocol):
    """What the parts of a `Gradient` are computed from on first use."""

    def load(self) -> Floats:
        """Adjoint displacements, ``(steps, n)``."""

    def prescribed(self, load: Floats) -> Floats:
        """Derivatives by prescribed displacements, from the adjoint displacements."""

    def stiffness(self, load: Floats) -> CsrMatrix:
        """Derivatives by the entries of K, from the adjoint displacements."""


class _Unavailable:
    """The adjoint of a gradient, and the displacements of a tangent, that came without them."""

    def load(self) -> NoReturn:
        raise ValueError(
            "these derivatives came from another process, and the problem was made with "
            "loads= and has no factor of K"
        )

    def prescribed(self, _load: Floats) -> NoReturn:
        self.load()

    def stiffness(self, _load: Floats) -> NoReturn:
        self.load()


class _Model(Protocol[L, G]):
    """A `fem.Assembly`."""

    def gradient(self, gradient: Gradient, loads: Sequence[L], /) -> G:
        """Derivatives by the parameters of the model."""


class Gradient:
    """Derivatives of one number that depends on the results of a load path.

    Attributes
    ----------
    gap
        As ``gap`` of the problem, or ``(steps, n_c)`` or ``(steps, n_c, d)`` if the path
        had gaps of each step.
    gap_by_component : (steps, n_c, d)
        The same for each step and component.
    mu
        As ``mu`` of the problem, ``(n_c,)`` or ``(n_c, 2)``. Where it is zero, the
        derivative holds for friction that begins, with equal coefficients; it is zero
        where the contact does not slip.
    cohesion, dilatancy : (n_c,)
        Broken contacts stay broken, and others stay whole.
    one_sided : (steps, n_c)
        Contacts on a border between two statuses, where only one-sided derivatives exist.
        The gradient is then an element of the generalised gradient: the one with every
        contact on the side of its reported `Status`.
    result
        The `Result` that was differentiated.
    """

    def __init__(
        self,
        result: Any,
        gap: Floats,
        gap_by_component: Floats,
        mu: Floats,
        one_sided: Bools,
        adjoint: Adjoint,
        rest: Floats | None = None,
    ) -> None:
        self.result = result
        if rest is None:
            rest = np.zeros((gap_by_component.shape[1], 2))
        self.cohesion, self.dilatancy = rest.T.copy()
        self.gap = gap
        self.gap_by_component = gap_by_component
        self.mu = mu
        self.one_sided = one_sided
        self._adjoint = adjoint

    @cached_property
    def load(self) -> Floats:
        """Derivatives by the loads, ``(steps, n)``, computed on first use.

        These are the adjoint displacements, one solve with the factor of K a step. They are
        zero at prescribed degrees of freedom.

        Raises
        ------
        ValueError
            The problem was made with ``loads=`` and has no factor.
        """
        return self._adjoint.load()

    @cached_property
    def prescribed(self) -> Floats:
        """Derivatives by the prescribed displacements, ``(steps, len(fixed))``."""
        return self._adjoint.prescribed(self.load)

    @cached_property
    def K(self) -> CsrMatrix:
        """Derivatives by the entries of K, sparse ``(n, n)``, symmetric, on its pattern.

        The change of the number with a symmetric change ``dK`` is the sum of all products
        of entries, ``(gradient.K * dK).sum()``. Entries between prescribed degrees of
        freedom, on which nothing depends, are not stored.
        """
        return self._adjoint.stiffness(self.load)

    def __getstate__(self) -> dict[str, object]:
        # The problem stays behind: what it computes on first use is computed before.
        with suppress(ValueError):
            _ = self.prescribed, self.K
        return self.__dict__ | {"_adjoint": _Unavailable()}

    def fem(self, model: _Model[L, G], loads: Sequence[L] = ()) -> G:
        """Derivatives by the parameters of the model that the problem was made of.

        Parameters
        ----------
        model
            The `fem.Assembly` of the problem.
        loads
            The loads of the path as `fem.Load`, whose nodal forces change with the
            parameters; all others are held constant.

        Returns
        -------
        fem.ParameterGradient
        """
        return model.gradient(self, loads)


@dataclass(eq=False, repr=False)
class ReducedTangent:
    """Directional derivatives of the solution of a `ReducedProblem`.

    Attributes
    ----------
    reaction, relative_displacement : (n_c, d)
    one_sided : (n_c,)
        As in `Tangent`.
    """

    reaction: Floats
    relative_displacement: Floats
    one_sided: Bools


class ReducedGradient:
    """Derivatives of one number that depends on the solution of a `ReducedProblem`.

    Attributes
    ----------
    q : (n_c, d)
    mu : (n_c,) or (n_c, 2)
    cohesion, dilatancy : (n_c,)
        Zero with two coefficients.
    one_sided : (n_c,)
        As in `Gradient`.
    """

    def __init__(
        self,
        q: Floats,
        mu: Floats,
        rest: Floats,
        one_sided: Bools,
        reaction: Floats,
        W: Floats | CsrMatrix,
    ) -> None:
        self.q, self.mu, self.one_sided = q, mu, one_sided
        self.cohesion, self.dilatancy = rest.T.copy()
        self._reaction, self._given = reaction, W

    @cached_property
    def W(self) -> Floats | CsrMatrix:
        """Derivatives by the entries of W, on the pattern of a sparse W, else dense.

        W is not assumed to be symmetric: its entries are independent data.
        """
        adjoint, r = self.q.ravel(), self._reaction.ravel()
        if not hasattr(self._given, "tocsr"):
            return np.outer(adjoint, r)
        from scipy.sparse import csr_array

        pattern = csr_array(self._given)
        rows = np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
        values = adjoint[rows] * r[pattern.indices]
        by_entry: CsrMatrix = csr_array(
            (values, pattern.indices, pattern.indptr), shape=pattern.shape
        )
        return by_entry


class DataChange(NamedTuple):
    """The arguments of `Result.jvp`."""

    load: ArrayLike | None
    prescribed: ArrayLike | None
    gap: ArrayLike | None
    mu: ArrayLike | None
    K: Any
    cohesion: ArrayLike | None = None
    dilatancy: ArrayLike | None = None


class Cotangents(NamedTuple):
    """The arguments of `Result.vjp`."""

    reaction: ArrayLike | None
    displacement: ArrayLike | None
    relative_displacement: ArrayLike | None
    slip: ArrayLike | None


class PathDerivatives(Protocol[R]):
    """The problem of a load path, for the derivatives of its result."""

    def jvp(self, result: R, change: DataChange, /) -> Tangent:
        """`Result.jvp`."""

    def vjp(self, result: R, cotangents: Cotangents, /) -> Gradient:
        """`Result.vjp`."""


class SolutionDerivatives(Protocol[S]):
    """A reduced problem, for the derivatives of its solution."""

    def jvp(
        self,
        solution: S,
        W: MatrixLike | None,
        q: ArrayLike | None,
        mu: ArrayLike | None,
        cohesion: ArrayLike | None,
        dilatancy: ArrayLike | None,
        /,
    ) -> ReducedTangent:
        """`Solution.jvp`."""

    def vjp(
        self,
        solution: S,
        reaction: ArrayLike | None,
        relative_displacement: ArrayLike | None,
        /,
    ) -> ReducedGradient:
        """`Solution.vjp`."""


# The reason why a result that was read from a file has no derivatives.
LOST = (
    "the problem of this result is not available: it was read from a file or came from "
    "another process; solve again to differentiate"
)
