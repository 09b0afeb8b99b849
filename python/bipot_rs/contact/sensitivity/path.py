"""The derivatives of a load path, for `Result`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from bipot_rs.contact.results.derivatives import (
    Cotangents,
    DataChange,
    Gradient,
    Tangent,
)
from bipot_rs.contact.sensitivity.model import PathModel

# Each load path has a `Differentiable`, but few are differentiated: the methods import the
# linearisation.
if TYPE_CHECKING:
    from bipot_rs.contact.results.result import Result
    from bipot_rs.contact.sensitivity.linear import LinearPath

T = TypeVar("T")


@dataclass
class Differentiable:
    """The problem of a load path, for the derivatives of its result."""

    model: PathModel
    # The steps of the last result that was differentiated, for further derivatives.
    linearised: LinearPath | None = None

    def jvp(self, result: Result, change: DataChange, /) -> Tangent:
        """`Result.jvp`."""
        from bipot_rs.contact.sensitivity.path_derivatives import find_tangent

        return self._derive(result, lambda path: find_tangent(path, result, change))

    def vjp(self, result: Result, cotangents: Cotangents, /) -> Gradient:
        """`Result.vjp`."""
        from bipot_rs.contact.sensitivity.path_derivatives import find_gradient

        return self._derive(
            result, lambda path: find_gradient(path, result, cotangents)
        )

    def _derive(self, result: Result, derive: Callable[[LinearPath], T]) -> T:
        """What ``derive`` makes of the linearised steps, which are kept.

        Where the solver of the iterative engine stalls, the direct engine replaces it.
        """
        from bipot_rs.contact.sensitivity.linear import LinearPath
        from bipot_rs.contact.sensitivity.response import Stalled

        path = self.linearised
        if path is None or path.steps is not result.steps:
            path = LinearPath(self.model, result.steps, result.contacts)
        try:
            derivative = derive(path)
        except Stalled:
            try:
                path = LinearPath(
                    self.model, result.steps, result.contacts, iterative=False
                )
            except MemoryError as error:
                raise MemoryError(
                    "the linear solver of the iterative engine does not converge for the "
                    f"derivatives, and {error}"
                ) from error
            derivative = derive(path)
        self.linearised = path if path.kept else None
        return derivative
