"""The bodies of a model by name, with their degrees of freedom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bipot_rs._lib.types import Ints
from bipot_rs.fem.bodies.body import Body


@dataclass(frozen=True)
class NumberedBody:
    """A body with the degrees of freedom ``first + dim * node + component``."""

    body: Body  # the body
    index: int  # its index in the model
    first: int  # its first degree of freedom

    @property
    def span(self) -> slice:
        """All its degrees of freedom."""
        return slice(self.first, self.first + self.body.points.size)

    @cached_property
    def dofs(self) -> Ints:
        """Degrees of freedom of each node, ``(nodes, d)``."""
        n, d = self.body.points.size, self.body.dim
        return self.first + np.arange(n).reshape(-1, d)

    def nodes_at(self, first: Ints) -> Ints:
        """Nodes with these first degrees of freedom ``(m,)``."""
        return (first - self.first) // self.body.dim


class NumberedBodies(dict[str, NumberedBody]):
    """The bodies of a model by their names, in their order."""

    def __missing__(self, name: str) -> NumberedBody:
        raise ValueError(f"there is no body {name!r}, expected one of {list(self)}")

    def __repr__(self) -> str:
        return repr(self.first_dofs)

    @property
    def first_dofs(self) -> dict[str, int]:
        """First degree of freedom of each body, by name."""
        return {name: numbered.first for name, numbered in self.items()}

    @property
    def dim(self) -> int:
        """2 or 3."""
        return next(iter(self.values())).body.dim

    @property
    def axisymmetric(self) -> bool:
        """Whether the bodies are bodies of revolution."""
        return next(iter(self.values())).body.axisymmetric

    @property
    def axes(self) -> str:
        """Names of the coordinates, a letter each."""
        return "rz" if self.axisymmetric else "xyz"[: self.dim]

    @property
    def n(self) -> int:
        """Number of degrees of freedom of all bodies."""
        return sum(numbered.body.points.size for numbered in self.values())


def number_bodies(bodies: Sequence[Body]) -> NumberedBodies:
    """Number the degrees of freedom, body after body.

    Raises `ValueError`: there is no body, names repeat, or kinds of bodies differ.
    """
    if not bodies:
        raise ValueError("bodies is empty, expected at least one")
    if len({body.dim for body in bodies}) > 1:
        raise ValueError("bodies mix two and three dimensions")
    if len({body.axisymmetric for body in bodies}) > 1:
        other = next(body.name for body in bodies if not body.axisymmetric)
        raise ValueError(
            f"body {other!r} is plane and others are axisymmetric: expected all the same"
        )
    names = [body.name for body in bodies]
    if len(set(names)) < len(names):
        raise ValueError(f"names of bodies repeat: {names}")
    numbered, first = NumberedBodies(), 0
    for index, body in enumerate(bodies):
        numbered[body.name] = NumberedBody(body, index, first)
        first += body.points.size
    return numbered
