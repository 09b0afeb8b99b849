"""Contact with Coulomb friction by the de Saxcé bipotential.

Hand in the stiffness and the contact operator of any finite-element code, get
tractions, slip, status and displacements that are exact for that
discretisation, with a residual that proves it::

    problem = bipot_rs.ContactProblem(K, B, gap=gap, mu=0.3, fixed=fixed)
    result = problem.solve(load)

`ContactProblem`, `solve`, `ReducedProblem` and `project` are the ways in;
`Result` and `Solution` what comes out; `pairs` makes B for surfaces whose meshes do not
match; `fclib` reads and writes the problems of that collection; `plots` draws results.
Bodies described by name are a `Model`. Only NumPy is imported here, SciPy and the rest by
the functions that need them; `plots` and `Model` are loaded when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import bipot_rs.early  # noqa: F401
from bipot_rs import _core, fclib
from bipot_rs._lib.optional import missing
from bipot_rs._lib.versions import show_versions, versions
from bipot_rs.contact.enumeration import Answers
from bipot_rs.contact.error_bound import ErrorBound
from bipot_rs.contact.errors import (
    BipotError,
    FloatingBodyError,
    NoEquilibriumError,
    NotConvergedError,
)
from bipot_rs.contact.existence import Existence
from bipot_rs.contact.one_call import solve
from bipot_rs.contact.problem import ContactProblem
from bipot_rs.contact.projection import project
from bipot_rs.contact.reduced import ReducedProblem
from bipot_rs.contact.result import Outcome, Result, Solution, Status, Step, load

if TYPE_CHECKING:
    from bipot_rs import plots
    from bipot_rs.mortar.pairs import Pairs, pairs, rigid_pairs
    from bipot_rs.scene.builder import Model as Model
    from bipot_rs.scene.builder import ModelResult as ModelResult

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
    "Pairs",
    "ReducedProblem",
    "Result",
    "Solution",
    "Status",
    "Step",
    "fclib",
    "load",
    "pairs",
    "plots",
    "project",
    "rigid_pairs",
    "show_versions",
    "solve",
    "versions",
]

__version__ = _core.version

# Loaded by who asks for it. What needs scikit-fem and pydantic is not in __all__, for a
# star would ask for it.
_LAZY = {
    "Model": "bipot_rs.scene.builder",
    "ModelResult": "bipot_rs.scene.builder",
    "Pairs": "bipot_rs.mortar.pairs",
    "pairs": "bipot_rs.mortar.pairs",
    "rigid_pairs": "bipot_rs.mortar.pairs",
}
# Modules that are attributes without being loaded before.
_MODULES = {
    **{name: f"bipot_rs.{name}" for name in ("analytic", "discretisation", "fem")},
    **{name: f"bipot_rs.{name}" for name in ("obstacle", "plots", "scene", "theory")},
    "inspection": "bipot_rs.fem.inspection",
    "model": "bipot_rs.scene.builder",
    "paraview": "bipot_rs.fem.paraview",
    "review": "bipot_rs.fem.review",
}


def __getattr__(name: str) -> Any:
    module = _MODULES.get(name) or _LAZY.get(name)
    if module is None:
        raise AttributeError(f"module 'bipot_rs' has no attribute {name!r}")
    try:
        found = import_module(module)
    except ModuleNotFoundError as error:
        library = error.name or ""
        raise missing(
            error, f"bipot_rs.{name} and what uses it", library, "cli"
        ) from None
    return found if name in _MODULES else getattr(found, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_LAZY, *_MODULES})
