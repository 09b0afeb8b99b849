"""Load steps whose loads no contact forces can balance: bodies that slide or lift off.

The bodies count as rigid and all contacts as closed. Reactions within friction that balance
the loads on the motions that supports leave free are necessary for a solution, and depend on
neither elasticity nor gaps.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from bipot_rs._lib.types import Floats
from bipot_rs.contact.errors import FloatingBodyError
from bipot_rs.contact.law.frames import turn_operator
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.reduced import ReducedProblem
from bipot_rs.contact.results.solution import describe_not_carried
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.checks.free_bodies import (
    describe_motions,
    find_free,
    list_motions,
    list_supports,
)

# Rounding of the resultant of nodal forces, relative to the sum of their sizes.
_ROUNDING = 1e-12


def describe_unbalanced(
    model: Assembly, load: Floats, gaps: Floats | MovingGaps | None = None
) -> str | None:
    """Describe the first load step that contact cannot carry; None if there is none.

    ``model``: from `fem.assemble`, without bodies that nothing holds.
    ``load``: total nodal forces at the end of each load step, ``(steps, n)``.
    ``gaps``: as `Assembly.gaps`: frames of each step, if obstacles turn.
    """
    if model.cohesion.any():
        return None  # cohesion may carry any load
    modes, owner = list_motions(model)
    free = find_free(np.concatenate(list_supports(model, modes)))
    motions = modes @ free
    resultants = load @ motions
    resultants[np.abs(resultants) <= _ROUNDING * (np.abs(load) @ np.abs(motions))] = 0.0
    before: Floats | None = None
    for k, resultant in enumerate(resultants):
        size = float(np.abs(resultant).max(initial=0.0))
        if not size:
            continue
        B = model.B
        if isinstance(gaps, MovingGaps):
            B = turn_operator(gaps.frame[k], model.frame, B)
        # Loads that grow in proportion can all be carried, or none of them.
        elif before is not None and np.allclose(resultant / size, before, 0, 1e-9):
            continue
        before = resultant / size
        amounts = _find_unresisted(model, np.asarray(B @ motions), before)
        if amounts is None:
            continue
        count = len(model.bodies)
        of_bodies = owner < count
        moved = (free @ amounts)[of_bodies, None]
        words = describe_motions(
            model,
            list(range(count)),
            modes[:, of_bodies],
            moved / np.linalg.norm(moved),
        )
        whose = f"body {model.bodies[0].name!r}, " if count == 1 else ""
        reason = describe_not_carried(whose + "; ".join(words))
        return f"load step {k + 1} of {len(resultants)}: {reason}"
    return None


def _find_unresisted(model: Assembly, R: Floats, e: Floats) -> Floats | None:
    """Amounts of a motion on which the loads work, and which no reaction resists."""
    identity = sparse.csr_array(sparse.eye_array(R.shape[0]))
    gap = np.zeros((len(model.gap), model.dim))
    try:
        problem = ReducedProblem(identity, gap, model.mu, rigid=(R, e))
    except FloatingBodyError:
        return None
    return problem.equilibrium().motion
