"""Solutions and their derivatives as functions of NumPy arrays, for any framework.

A framework calls these three functions of one problem: the solution, the product with its
derivative (`Result.jvp`) and that with the transpose (`Result.vjp`). A product needs the
result at the same arguments, so that the last results are kept.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact.errors import NotConvergedError
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.results.derivatives import Tangent
from bipot_rs.contact.results.result import Result

# Arguments of a solution, in the order of `solve` of the frameworks.
ARGUMENTS = ("load", "prescribed", "gap", "mu")
# Results that are kept: those of one path and of some that are solved in turn with it.
_KEPT = 16
# Said of a derivative of a derivative.
TWICE = (
    "second derivatives of a contact solution are not available: differentiate it once"
)


A = TypeVar("A")


class Solved(NamedTuple, Generic[A]):
    """Results of all load steps, as arrays of the framework.

    Attributes
    ----------
    reaction, relative_displacement : (steps, n_c, d)
        Nodal contact forces [N] and relative displacements [m], normal first.
    displacement : (steps, n)
        Displacement of all degrees of freedom [m].
    slip : (steps, n_c, d - 1)
        Slip of each load step [m].
    """

    reaction: A
    displacement: A
    relative_displacement: A
    slip: A


@dataclass(frozen=True, eq=False)
class Host:
    """The functions of one problem.

    ``problem``: the problem.
    ``shapes``: shapes of the arguments that are given, by name; the others are those of the
    problem.
    """

    problem: ContactProblem
    shapes: Mapping[str, tuple[int, ...]]
    _results: OrderedDict[bytes, Result] = field(default_factory=OrderedDict)

    @property
    def steps(self) -> int:
        """Load steps, by the rows of the arguments."""
        rows = {
            name: shape[0]
            for name, shape in self.shapes.items()
            if name != "mu" and len(shape) > 1
        }
        longest = max(rows.values(), default=1)
        for name, count in rows.items():
            if count not in (1, longest):
                raise ValueError(
                    f"{name} has {count} rows, but another argument has {longest}: "
                    "expected one for each load step"
                )
        return longest

    @property
    def result_shapes(self) -> Solved[tuple[int, ...]]:
        """Shapes of the results."""
        n, (n_c, d) = self.problem.loading.n, self.problem.contacts.shape
        steps = self.steps
        every = (steps, n_c, d)
        return Solved(every, (steps, n), every, (steps, n_c, d - 1))

    def solve(self, arguments: Sequence[Floats]) -> Solved[Floats]:
        """Results for arguments with any number of leading batch dimensions."""
        return self._stack(*self._solve_cases(arguments))

    def jvp(
        self, arguments: Sequence[Floats], tangents: Sequence[Floats]
    ) -> Solved[Floats]:
        """Derivatives of the results along ``tangents``, shaped as the arguments."""
        results, batch = self._solve_cases(arguments)
        cases = self._split_cases(tangents, list(self.shapes.values()))
        along = [
            result.jvp(
                **{name: self._spread_value(name, row) for name, row in case.items()}
            )
            for result, case in zip(results, cases, strict=True)
        ]
        return self._stack(along, batch)

    def vjp(
        self, arguments: Sequence[Floats], cotangents: Sequence[Floats]
    ) -> tuple[Floats, ...]:
        """Gradients with respect to the arguments, from those of the four results."""
        results, batch = self._solve_cases(arguments)
        by_case = [
            np.reshape(array, (len(results), *shape))
            for array, shape in zip(cotangents, self.result_shapes, strict=True)
        ]
        gradients: dict[str, list[Floats]] = {name: [] for name in self.shapes}
        for k, result in enumerate(results):
            fields = zip(Solved._fields, by_case, strict=True)
            gradient = result.vjp(**{name: array[k] for name, array in fields})
            for name, rows in gradients.items():
                rows.append(self._gather(name, getattr(gradient, name)))
        return tuple(
            np.reshape(gradients[name], batch + shape)
            for name, shape in self.shapes.items()
        )

    def _stack(
        self, results: Sequence[Result | Tangent], batch: tuple[int, ...]
    ) -> Solved[Floats]:
        """The four results of all cases, with the batch dimensions first."""
        fields = zip(Solved._fields, self.result_shapes, strict=True)
        return Solved(
            *(
                np.reshape([getattr(result, name) for result in results], batch + shape)
                for name, shape in fields
            )
        )

    def _split_cases(
        self, arrays: Sequence[Floats], shapes: Sequence[tuple[int, ...]]
    ) -> list[dict[str, Floats]]:
        """The arguments of each case, from arrays with batch dimensions."""
        flat = [
            np.reshape(np.asarray(batch, np.float64), (-1, *shape))
            for batch, shape in zip(arrays, shapes, strict=True)
        ]
        return [
            dict(zip(self.shapes, case, strict=True))
            for case in zip(*flat, strict=True)
        ]

    def _solve_cases(
        self, arguments: Sequence[Floats]
    ) -> tuple[list[Result], tuple[int, ...]]:
        """A result for each case, solved together, and the batch dimensions."""
        shapes = list(self.shapes.values())
        first = arguments[0]
        batch = np.shape(first)[: np.ndim(first) - len(shapes[0])]
        cases = self._split_cases(arguments, shapes)
        keys = [b"".join(a.tobytes() for a in case.values()) for case in cases]
        solved = {key: self._results[key] for key in keys if key in self._results}
        new = {k: c for k, c in zip(keys, cases, strict=True) if k not in solved}
        results = self.problem.solve_many(list(new.values())) if new else []
        for key, result in zip(new, results, strict=True):
            if not result.success:
                raise NotConvergedError(result.message)
            if np.shape(result.reaction) != self.result_shapes.reaction:
                raise ValueError(
                    f"the path has {len(result)} load steps, but the arguments have "
                    f"{self.steps} rows: give load, prescribed or gap a row for each step"
                )
            solved[key] = result
            self._results[key] = result
        while len(self._results) > _KEPT:
            self._results.popitem(last=False)
        return [solved[key] for key in keys], batch

    def _spread_value(self, name: str, value: Floats) -> Floats:
        """A direction for each step and contact, from one shaped as the argument."""
        n_c, d = self.problem.contacts.shape
        if name == "mu":
            whole = value.shape if value.ndim == 2 else (n_c,)
            return np.broadcast_to(value, whole).copy()
        if name != "gap":
            return np.broadcast_to(value, (self.steps, value.shape[-1])).copy()
        if value.ndim == 3:
            return np.broadcast_to(value, (self.steps, n_c, d)).copy()
        along = np.zeros((self.steps, n_c, d))
        along[:, :, 0] = value
        return along

    def _gather(self, name: str, value: Floats) -> Floats:
        """The transpose of `_spread_value`."""
        shape = self.shapes[name]
        value = np.asarray(value, np.float64)
        if name == "gap" and value.ndim == 3 and len(shape) < 3:
            value = value[:, :, 0]
        # Sums over the dimensions in which the argument was repeated.
        while value.ndim > len(shape):
            value = value.sum(axis=0)
        for axis, (have, want) in enumerate(zip(value.shape, shape, strict=True)):
            if want == 1 and have != 1:
                value = value.sum(axis=axis, keepdims=True)
        return value
