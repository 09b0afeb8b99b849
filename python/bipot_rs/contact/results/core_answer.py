"""Solutions and load steps from what the core answers."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, OpenRecord
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.results.solution import Computed, Solution, Step, make

S = TypeVar("S", bound=Step)
# A call of the class takes as long as all other fields.
_OUTCOMES = {outcome.value: outcome for outcome in Outcome}


def make_solution(core: _core.ReducedSolution, **about: object) -> Solution:
    """A `Solution`; ``about`` are its other fields."""
    # Without `__init__`: its defaults are those of the class.
    return make(Solution, _fields(core, computed=object.__new__(Computed), **about))


def make_step(core: _core.LoadStep) -> Step:
    """A step of a condensed problem, without its loads and its problem."""
    fields = {
        "computed": Computed(),
        "slip": core.slip,
        "opened": core.solution.opened,
        "working_set": core.working_set,
        "working_motion": core.working_motion,
    }
    return make(Step, _fields(core.solution, **fields))


def make_newton_step(core: _core.NewtonStep, displacement: Floats, kind: type[S]) -> S:
    """A step of Newton in the displacements, without its loads and its problem.

    ``kind`` is its class.
    """
    fields = _fields(core.solution)
    fields["stats"] |= {"newton": core.newton, "krylov": core.krylov}
    return kind(
        **fields,
        slip=core.slip,
        opened=core.solution.opened,
        computed=Computed(displacement, error_estimate=core.error_estimate),
    )


def find_opening(outcome: str, mu: Floats) -> Floats:
    """Ratio of opening to slip that the free motion contains: mu for a proof, else zero.

    A proof lies in the dual cone; a direction of divergence is a displacement.
    """
    return mu if outcome == Outcome.NO_EQUILIBRIUM else np.zeros_like(mu)


def _fields(core: _core.ReducedSolution, **about: object) -> OpenRecord:
    """Fields of a `Solution`; ``about`` are others."""
    sequence = None
    if core.minimising_sequence is not None:
        from bipot_rs.contact.results.error_bound import read_sequence

        sequence = read_sequence(core.minimising_sequence, core.reaction.shape)
    return {
        "reaction": core.reaction,
        "relative_displacement": core.relative_displacement,
        "status": core.status,
        "outcome": _OUTCOMES[core.outcome],
        "residual": core.residual,
        "tolerance": core.tolerance,
        "iterations": core.iterations,
        "work": core.work,
        "rigid_motion": core.rigid_motion,
        "free_motion": core.free_motion,
        "history": core.history,
        "bipotential_gap": core.bipotential_gap,
        "minimising_sequence": sequence,
        "seconds": core.seconds,
        "stats": {"bytes_beside_W": core.bytes_beside},
        "statuses_tried": core.statuses_tried,
        **about,
    }
