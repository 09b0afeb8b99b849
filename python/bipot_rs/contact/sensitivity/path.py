"""The derivatives of a load path, for `Result`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from numpy.typing import ArrayLike

from bipot_rs.contact.derivatives import Gradient, Tangent
from bipot_rs.contact.sensitivity.model import PathModel

# Each load path has a `Differentiable`, but few are differentiated: the methods import the
# linearisation.
if TYPE_CHECKING:
    from bipot_rs.contact.sensitivity.linear_path import LinearPath

T = TypeVar("T")


@dataclass(frozen=True)
class Differentiable:
    """The problem of a load path, for the derivatives of its result."""

    model: PathModel

    def jvp(
        self,
        result: Any,
        load: ArrayLike | None,
        prescribed: ArrayLike | None,
        gap: ArrayLike | None,
        mu: ArrayLike | None,
        K: Any,
        /,
    ) -> Tangent:
        """`Result.jvp`."""
        from bipot_rs.contact.sensitivity import tangent

        return self._derived(
            result,
            lambda path: tangent.jvp(path, result, load, prescribed, gap, mu, K),
        )

    def vjp(
        self,
        result: Any,
        reaction: ArrayLike | None,
        displacement: ArrayLike | None,
        relative_displacement: ArrayLike | None,
        slip: ArrayLike | None,
        /,
    ) -> Gradient:
        """`Result.vjp`."""
        from bipot_rs.contact.sensitivity import gradient

        given = reaction, displacement, relative_displacement, slip
        return self._derived(result, lambda path: gradient.vjp(path, result, *given))

    def _derived(self, result: Any, derive: Callable[[LinearPath], T]) -> T:
        """What ``derive`` makes of the linearised steps, which the result keeps.

        Where the solver of the iterative engine stalls, the direct engine replaces it.
        """
        from bipot_rs.contact.sensitivity.displacements import Stalled
        from bipot_rs.contact.sensitivity.linear_path import LinearPath

        path = result._linearised
        if path is None:
            path = LinearPath(self.model, result.steps, result.contacts)
        try:
            found = derive(path)
        except Stalled:
            path = self._direct(result)
            found = derive(path)
        result._linearised = path if path.kept else None
        return found

    def _direct(self, result: Any) -> LinearPath:
        from bipot_rs.contact.sensitivity.linear_path import LinearPath

        try:
            return LinearPath(
                self.model, result.steps, result.contacts, iterative=False
            )
        except MemoryError as error:
            raise MemoryError(
                "the linear solver of the iterative engine does not converge for the "
                f"derivatives, and {error}"
            ) from error
