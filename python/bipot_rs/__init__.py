"""Contact with Coulomb friction by the de Saxcé bipotential.

Hand in the stiffness and the contact operator of any finite-element code, get
tractions, slip, status and displacements that are exact for that
discretisation, with a residual that proves it::

    problem = bipot_rs.ContactProblem(K, B, gap=gap, mu=0.3, fixed=fixed)
    result = problem.solve(load)

`ContactProblem`, `solve`, `ReducedProblem` and `project` are the ways in;
`Result` and `Solution` what comes out; `fclib` reads and writes the problems of that
collection. Only NumPy is imported here, SciPy and
the rest by the functions that need them. `plots` draws results; it is loaded when it is
first used.
"""

from typing import TYPE_CHECKING, Any

import bipot_rs.early  # noqa: F401
from bipot_rs import fclib
from bipot_rs.answers import Answers
from bipot_rs.error_bound import ErrorBound
from bipot_rs.errors import (
    BipotError,
    FloatingBodyError,
    NoEquilibriumError,
    NotConvergedError,
)
from bipot_rs.existence import Existence
from bipot_rs.problem import ContactProblem, project, solve
from bipot_rs.reduced import ReducedProblem
from bipot_rs.result import Outcome, Result, Solution, Status, Step, load

if TYPE_CHECKING:
    from bipot_rs import plots

__all__ = [
    "Answers",
    "BipotError",
    "ContactProblem",
    "ErrorBound",
    "Existence",
    "FloatingBodyError",
    "NoEquilibriumError",
    "NotConvergedError",
    "Outcome",
    "ReducedProblem",
    "Result",
    "Solution",
    "Status",
    "Step",
    "fclib",
    "load",
    "plots",
    "project",
    "solve",
]


def __getattr__(name: str) -> Any:
    """Modules that most programs do without, loaded when they are first used."""
    if name == "plots":
        from importlib import import_module

        return import_module("bipot_rs.plots")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
