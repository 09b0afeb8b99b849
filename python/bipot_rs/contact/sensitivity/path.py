"""The derivatives of a load path, for `Result`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from bipot_rs.contact.derivatives import Gradient, Tangent
from bipot_rs.contact.sensitivity import gradient, tangent
from bipot_rs.contact.sensitivity.linear_path import LinearPath
from bipot_rs.contact.sensitivity.model import PathModel


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
        path = LinearPath(self.model, result.steps, result.contacts)
        return tangent.jvp(path, result, load, prescribed, gap, mu, K)

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
        path = LinearPath(self.model, result.steps, result.contacts)
        return gradient.vjp(
            path, result, reaction, displacement, relative_displacement, slip
        )
