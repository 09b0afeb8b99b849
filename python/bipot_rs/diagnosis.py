"""Why a solve did not converge, in one sentence: found out when asked for.

What was tried, where it is worst, the likely cause and what to do. Causes are told
from the problem, not guessed from the iteration: none is named that a number does not
show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bipot_rs.check import Array
from bipot_rs.result import Outcome, Solution

# Above so many components of W its rank and its softest motion are not looked for:
# its eigenvalues take seconds there.
_DENSE = 1500
# An eigenvalue below this part of the largest one, times the order, is zero: ε, and a
# digit for what W was made from.
_ROUNDING = 1e-15
# A motion softer by this than all others leaves a residual of 1e-10 no digits for them.
_SOFT = 1e8
# Below this residual the statuses are likely those of an answer, and what they say of
# the number of answers is worth telling.
NEAR = 1e-3
# η and balance are both met to this where a solve can be said to have come far.
_FAR = 1e-6


@dataclass(frozen=True)
class Tried:
    """A solve and its problem, ``v = W r + R a + q`` of one step.

    What costs anything is made when it is asked for: the dense ``W``, ``R`` (of no
    columns where there is none), the condition of the stiffness, and whether other
    answers are known to be near a point.
    """

    method: str
    max_seconds: float | None
    mu: Array
    W: Callable[[], Array]
    modes: Callable[[], Array]
    several: Callable[[Solution], bool]
    condition: Callable[[], float] = lambda: 0.0
    points: Array | None = None


def diagnose(tried: Tried, solution: Solution, v: Array) -> str:
    """What became of a solve that is no answer; ``v (n_c, d)`` is that of the step."""
    # Where numbers near the ends of doubles are the fault, words are wanted too.
    with np.errstate(all="ignore"):
        return _sentence(tried, solution, v)


def _sentence(tried: Tried, solution: Solution, v: Array) -> str:
    if solution.outcome is Outcome.NO_EQUILIBRIUM:
        return _contradiction(tried, solution, v)
    W = tried.W() if 0 < v.size <= _DENSE else None
    if W is not None and not np.isfinite(W).all():
        W = None  # written to since
    scale = _scale(W, v, solution.reaction)
    parts = [f"not converged: {_ending(tried, solution)}"]
    if len(v):
        parts.append(_worst(tried, solution.reaction, v, scale))
    causes = list(_causes(tried, solution, W))
    named = ", and ".join(cause for cause, _ in causes)
    if not causes and solution.outcome is not Outcome.STALLED:
        named = "the limit alone" if _still_falling(solution) else ""
    if named:
        parts.append(f"likely cause: {named}")
    parts.append("try " + " or ".join(dict.fromkeys(_cures(tried, solution, causes))))
    return "; ".join(parts)


def _contradiction(tried: Tried, solution: Solution, v: Array) -> str:
    """Which contacts have no answer, where no motion of bodies is to blame."""
    if not len(v):
        return ""
    deep = int(np.argmin(v[:, 0]))
    pressed = np.flatnonzero(solution.reaction[:, 0] > 0)
    if len(pressed) > 1:
        most = pressed[np.argsort(-solution.reaction[pressed, 0], kind="stable")[:2]]
        names = " and ".join(str(i) for i in sorted(most.tolist()))
        return f": contacts {names} push against each other the most"
    if v[deep, 0] < 0:
        return f": {_name(tried, deep)} penetrates by {-v[deep, 0]:.3g}"
    return ""


def _ending(tried: Tried, solution: Solution) -> str:
    falling = "still" if _still_falling(solution) else "no longer"
    judged = (
        f"residual {solution.residual:.1e}, {falling} falling, held to "
        f"{solution.tolerance:.1e}"
    )
    count = solution.iterations
    spent = f"{count} iteration{'' if count == 1 else 's'} of {tried.method!r}"
    if solution.outcome is Outcome.ITERATION_LIMIT:
        return f"{spent} reached max_iterations ({judged})"
    if solution.outcome is Outcome.TIME_LIMIT:
        return f"{spent} reached max_seconds = {tried.max_seconds:.3g} ({judged})"
    if solution.residual <= solution.tolerance:
        return (
            f"{spent} met the residual, which says nothing here: a contact penetrates, "
            f"reactions dwarf the loads, or rounding hides what is left ({judged})"
        )
    return f"{spent} came to a stand ({judged})"


def _scale(W: Array | None, v: Array, r: Array) -> Array:
    """Displacement per force of each contact, that makes r and v comparable."""
    if W is not None:
        d = v.shape[1]
        trace = W.diagonal().reshape(-1, d).mean(axis=1)
        if (trace > 0).any():
            return np.asarray(np.where(trace > 0, trace, trace.max()), np.float64)
    force = float(np.abs(r).max(initial=0.0))
    return np.full(len(v), np.abs(v).max(initial=0.0) / force if force > 0 else 1.0)


def misses(r: Array, v: Array, mu: Array, scale: Array) -> Array:
    """By how much each contact misses each part of the law (6), (8), ``(4, n_c)``.

    As displacements beside ``√scale``: penetration or pull, force on an open contact,
    friction above its limit, slip that friction does not oppose at its limit.
    """
    root = np.sqrt(scale)
    r, v = r * root[:, None], v / root[:, None]
    push, shear = r[:, 0], np.linalg.norm(r[:, 1:], axis=1)
    slip = np.linalg.norm(v[:, 1:], axis=1)
    unit = v[:, 1:] / np.where(slip > 0, slip, 1.0)[:, None]
    off = np.linalg.norm(r[:, 1:] + (mu * push)[:, None] * unit, axis=1)
    whole = slip + off + shear
    return np.stack(
        [
            np.maximum(-v[:, 0], 0) + np.maximum(-push, 0),
            np.maximum(np.minimum(push, v[:, 0]), 0),
            np.maximum(shear - mu * push, 0),
            # Where a contact hardly slips the direction of that says little.
            slip * np.divide(off, whole, out=np.zeros_like(off), where=whole > 0),
        ]
    )


def _worst(tried: Tried, r: Array, v: Array, scale: Array) -> str:
    missed = misses(r, v, tried.mu, scale)
    kind, i = np.unravel_index(int(np.argmax(missed)), missed.shape)
    slip = float(np.linalg.norm(v[i, 1:]))
    said = (
        f"which penetrates by {-v[i, 0]:.2g}" if v[i, 0] < 0 else "which pulls",
        f"which is pressed by {r[i, 0]:.2g} while open by {v[i, 0]:.2g}",
        "whose friction is above its limit",
        f"which slides by {slip:.2g}, not against friction at its limit",
    )
    return f"worst at {_name(tried, int(i))}, {said[int(kind)]}"


def _name(tried: Tried, i: int) -> str:
    if tried.points is None:
        return f"contact {i}"
    place = ", ".join(f"{x:.4g}" for x in tried.points[i])
    return f"contact {i} at ({place})"


def _causes(
    tried: Tried, solution: Solution, W: Array | None
) -> Iterator[tuple[str, str]]:
    """What is found wrong with the problem, and what to do about it."""
    if W is not None:
        yield from _of_compliance(tried, W)
    condition = tried.condition()
    if condition > _SOFT:
        yield (
            f"a body is nearly free, the condition of its stiffness is {condition:.0e}",
            "a support for it",
        )
    if W is not None and solution.reaction.any() and tried.several(solution):
        yield "several answers near by", "smaller load steps, or another start"


def _of_compliance(tried: Tried, W: Array) -> Iterator[tuple[str, str]]:
    d = len(W) // len(tried.mu)
    wedged = _wedged(W, tried.mu, d)
    if len(wedged):
        i = int(wedged[0])
        more = f" and {len(wedged) - 1} more" if len(wedged) > 1 else ""
        cause = f"friction that can jam {_name(tried, i)}{more}"
        yield f"{cause}, mu ‖W_nt‖ ≥ W_nn with mu = {tried.mu[i]:.3g}", "a smaller mu"
    trace = W.diagonal().reshape(-1, d).mean(axis=1)
    root = np.sqrt(np.repeat(np.where(trace > 0, trace, 1.0), d))
    scaled = W / root / root[:, None]
    if not np.isfinite(scaled).all():
        return
    values = np.linalg.eigvalsh((scaled + scaled.T) / 2)[::-1]
    rank = int((values > _ROUNDING * len(values) * max(values[0], 0.0)).sum())
    # What W leaves open, the rigid motions may determine.
    modes = tried.modes() / root[:, None]
    modes /= np.maximum(np.linalg.norm(modes, axis=0), 1e-300)
    known = rank
    if modes.size:
        whole = np.hstack([scaled / max(values[0], 1e-300), modes])
        known = int(np.linalg.matrix_rank(whole, tol=_ROUNDING * len(values)))
    if known < len(values):
        ways = f"in {known} independent ways only" if known > 1 else "in one way only"
        cause = (
            f"redundant contacts, their {len(values)} reaction components act {ways}"
        )
        yield cause, "fewer contacts"
    if rank > 1:
        softer = values[: rank - 1] / values[1:rank]
        first = int(np.argmax(softer))
        if softer[first] > _SOFT and first < min(6, len(values) // 2):
            which = "one motion is" if first == 0 else f"{first + 1} motions are"
            cause = f"a body is nearly free, {which} softer by {softer[first]:.0e}"
            yield f"{cause} than all others", "a support for it"


def _wedged(W: Array, mu: Array, d: int) -> NDArray[np.intp]:
    """Contacts that alone can jam or have several answers: ``μ ‖W_nt‖ ≥ W_nn``."""
    blocks = W.reshape(len(mu), d, len(mu), d)[
        np.arange(len(mu)), :, np.arange(len(mu))
    ]
    coupling = mu * np.linalg.norm(blocks[:, 0, 1:], axis=1)
    return np.flatnonzero((coupling >= blocks[:, 0, 0]) & (coupling > 0))


def _still_falling(solution: Solution) -> bool:
    """Whether the last fifth of the iterations took a tenth off the residual."""
    residuals = solution.history[:, 1] if len(solution.history) else np.empty(0)
    if len(residuals) < 10:
        return len(residuals) > 0
    cut = len(residuals) - max(len(residuals) // 5, 3)
    return bool(residuals[cut:].min() < 0.9 * residuals[:cut].min())


def _cures(
    tried: Tried, solution: Solution, causes: list[tuple[str, str]]
) -> Iterator[str]:
    for _, cure in causes:
        if cure:
            yield cure
    limit = {
        Outcome.ITERATION_LIMIT: "a larger max_iterations",
        Outcome.TIME_LIMIT: "a larger max_seconds",
    }.get(solution.outcome)
    if limit is not None:
        yield limit
    if tried.method != "auto":
        yield "method='auto'"
    elif limit is None and not causes:
        yield "method='nesterov'"
    if solution.tolerance < solution.residual <= _FAR:
        wish = 10.0 ** np.ceil(np.log10(solution.residual))
        yield f"tol={wish:.0e}, which this point meets"
