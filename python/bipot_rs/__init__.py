"""Contact with Coulomb friction, by the bipotential of de Saxcé.

Give the stiffness and the contact operator of any finite-element code. The results are
tractions, slip, status and displacements, exact for this discretisation up to a residual
that is reported with them::

    problem = bipot_rs.ContactProblem(K, B, gap=gap, mu=0.3, fixed=fixed)
    result = problem.solve(load)

Start with `ContactProblem`, `solve`, `ReducedProblem` or `project`; they return a `Result`
or a `Solution`. `pairs` makes B for surfaces with meshes that do not match, `fclib` reads
and writes problems of the FCLIB collection, and `plots` draws results. A `Model` describes
bodies by names. Each name is imported when it is first used: arrays need only NumPy and
SciPy, and other parts need the extras of the package.
"""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from bipot_rs import analytic as analytic
    from bipot_rs import blocks as blocks
    from bipot_rs import discretisation as discretisation
    from bipot_rs import fclib, plots
    from bipot_rs import fem as fem
    from bipot_rs import obstacle as obstacle
    from bipot_rs import petsc as petsc
    from bipot_rs import scene as scene
    from bipot_rs import theory as theory
    from bipot_rs._lib.machine import __version__ as __version__
    from bipot_rs._lib.machine import show_versions, versions
    from bipot_rs.contact.errors import (
        BipotError,
        FloatingBodyError,
        NoEquilibriumError,
        NotConvergedError,
        NotDifferentiableError,
    )
    from bipot_rs.contact.law.contact_law import project
    from bipot_rs.contact.law.status import Outcome, Status
    from bipot_rs.contact.one_call import solve
    from bipot_rs.contact.path.moving_gaps import MovingGaps
    from bipot_rs.contact.problem import ContactProblem
    from bipot_rs.contact.proof.equilibrium import Equilibrium, LimitMultiplier
    from bipot_rs.contact.proof.existence import Answers, Existence
    from bipot_rs.contact.proof.reaction_range import ReactionRange
    from bipot_rs.contact.reduced import ReducedProblem
    from bipot_rs.contact.results.error_bound import ErrorBound
    from bipot_rs.contact.results.result import Result
    from bipot_rs.contact.results.saved_result import load, load_result
    from bipot_rs.contact.results.solution import Solution, Step
    from bipot_rs.contact.results.state import State
    from bipot_rs.contact.wear.record import Wear
    from bipot_rs.fem import paraview as paraview
    from bipot_rs.fem.checks import inspection as inspection
    from bipot_rs.fem.checks import inspection as review  # noqa: F401
    from bipot_rs.frameworks import jax as jax
    from bipot_rs.frameworks import torch as torch
    from bipot_rs.mortar.pairs import Pairs, nodal_areas, pairs, rigid_pairs
    from bipot_rs.scene import builder as model  # noqa: F401
    from bipot_rs.scene.builder import Model as Model
    from bipot_rs.scene.builder import ModelResult as ModelResult

# Without `Model` and the modules that need scikit-fem or pydantic, because a star import
# would import them.
__all__ = [
    "Answers",
    "BipotError",
    "ContactProblem",
    "Equilibrium",
    "ErrorBound",
    "Existence",
    "FloatingBodyError",
    "LimitMultiplier",
    "MovingGaps",
    "NoEquilibriumError",
    "NotConvergedError",
    "NotDifferentiableError",
    "Outcome",
    "Pairs",
    "ReactionRange",
    "ReducedProblem",
    "Result",
    "Solution",
    "State",
    "Status",
    "Step",
    "Wear",
    "fclib",
    "load",
    "load_result",
    "nodal_areas",
    "pairs",
    "plots",
    "project",
    "rigid_pairs",
    "show_versions",
    "solve",
    "versions",
]

__getattr__, __dir__ = lazily(__name__)
