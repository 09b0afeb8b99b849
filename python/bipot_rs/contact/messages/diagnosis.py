"""Diagnosis of a solve that did not converge, in one sentence.

It names the method, the contact with the largest violation of the law, the likely cause
and what to do. A cause is named only if a number computed from the problem shows it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats
from bipot_rs.contact import tuning
from bipot_rs.contact.law.contact_law import (
    ContactLaw,
    dissipation,
    find_largest,
    find_limit,
    find_resisting,
)
from bipot_rs.contact.law.status import Outcome
from bipot_rs.contact.results.solution import Solution

# An eigenvalue below this part of the largest one, times the order, is zero: ε, and one
# digit for the error of W.
_ROUNDING = 1e-15
# In single precision a zero eigenvalue of W becomes up to -1e-7 of the largest one. Lower
# values are not rounding errors.
_NEGATIVE = 1e-6
# Coupling below this part of the diagonal is rounding error of the elimination.
_UNCOUPLED = 1e-12
# A point whose rounding is a larger share of η has not converged.
_LEAST_DIGITS = 1e-6
# Numbers below have fewer digits, and squares of numbers above overflow.
_SMALL, _LARGE = 1e-300, 1e300


@dataclass(frozen=True)
class FailedSolve:
    """A solve and its problem, ``v = W r + R a + q`` of one step.

    Functions compute what is expensive: the dense ``W``, ``R`` (with no columns if there
    are no rigid motions), the loads on these, the condition number of the stiffness, and
    whether there are several solutions near a point.
    """

    settings: _core.Settings
    law: ContactLaw
    W: Callable[[], Floats | None]
    modes: Callable[[], Floats]
    loads: Callable[[], Floats]
    several: Callable[[Solution], bool]
    condition: Callable[[], float] = lambda: 0.0
    points: Floats | None = None

    @property
    def mu(self) -> Floats:
        """Friction coefficients."""
        return self.law.mu


def diagnose(tried: FailedSolve, solution: Solution, v: Floats) -> str:
    """Explain why a solve failed; ``v (n_c, d)`` is the one of the step."""
    # Numbers near the ends of doubles, which overflow here, must be explained too.
    with np.errstate(all="ignore"):
        return _write_sentence(tried, solution, v)


@dataclass(frozen=True)
class Finding:
    """A fault of a problem: the ``cause``, and the ``cure``.

    ``alone``: only this cure helps. ``certain``: it is a cause also if a limit ended the
    solve early. ``soft``: a body is nearly free.
    """

    cause: str
    cure: str
    alone: bool = False
    certain: bool = False
    soft: bool = False


def _write_sentence(tried: FailedSolve, solution: Solution, v: Floats) -> str:
    if solution.outcome is Outcome.NO_EQUILIBRIUM:
        return _describe_contradiction(tried, solution, v)
    W = tried.W() if 0 < v.size <= tuning.DENSE_DIAGNOSIS else None
    if W is not None and not np.isfinite(W).all():
        W = None  # the caller has changed it
    scale = _find_scale(W, v, solution.reaction)
    parts = [f"not converged: {_describe_end(tried, solution)}"]
    worst = _describe_worst(tried, solution, v, scale)
    if worst:
        parts.append(worst)
    findings = list(_find_faults(tried, solution, v, W))
    causes = findings
    if _is_cut_short(solution):
        # The limit is the cause of this end. Other faults would have acted later.
        causes = [finding for finding in findings if finding.certain]
        if not causes:
            others = ", and ".join(finding.cause for finding in findings)
            # If W was not checked, there may be other causes.
            only = " only" if not findings and W is not None else ""
            parts.append(f"likely cause: the limit{only}")
            parts += [f"also found: {others}"] if findings else []
    if causes:
        named = ", and ".join(finding.cause for finding in causes)
        parts.append(f"likely cause: {named}")
    cures = list(dict.fromkeys(_list_cures(tried, solution, causes, v, scale)))
    return "; ".join([*parts, "try " + " or ".join(cures)])


def _is_cut_short(solution: Solution) -> bool:
    """Whether a limit ended a solve that was still improving."""
    if solution.outcome is Outcome.STALLED or solution.residual <= solution.tolerance:
        return False
    gain = _measure_last_gain(solution)
    return gain is None or gain < tuning.STILL_FALLS


def _describe_contradiction(tried: FailedSolve, solution: Solution, v: Floats) -> str:
    """Name the contacts that contradict each other, or the one that penetrates."""
    if not len(v):
        return ""
    deep = int(np.argmin(v[:, 0]))
    pressed = np.flatnonzero(solution.reaction[:, 0] > 0)
    if len(pressed) > 1:
        most = pressed[np.argsort(-solution.reaction[pressed, 0], kind="stable")[:2]]
        names = " and ".join(str(i) for i in sorted(most.tolist()))
        return f": contacts {names} push against each other the most"
    if v[deep, 0] < 0:
        return f": {_name_contact(tried, deep)} penetrates by {-v[deep, 0]:.3g}"
    return ""


def _describe_end(tried: FailedSolve, solution: Solution) -> str:
    stalled = solution.outcome is Outcome.STALLED
    trend = "" if stalled else _describe_trend(solution)
    judged = f"residual {solution.residual:.1e}{trend}, limit {solution.tolerance:.1e}"
    count = solution.iterations
    spent = f"{count} iteration{'' if count == 1 else 's'} of {tried.settings.method!r}"
    ends = {
        Outcome.ITERATION_LIMIT: "reached max_iterations",
        Outcome.TIME_LIMIT: f"reached max_seconds = {tried.settings.max_seconds or 0.0:.3g}",
    }
    end = ends.get(solution.outcome)
    if solution.residual <= solution.tolerance:
        met = f"{end} and met the residual" if end else "met the residual"
        return (
            f"{spent} {met}, which is not enough here: a contact penetrates, reactions are "
            f"much larger than the loads, or rounding hides an error ({judged})"
        )
    if end is not None:
        return f"{spent} {end} ({judged})"
    if count == 0:
        if tried.settings.method == "newton":
            return (
                "'newton' found no step from its start: its matrix is singular there, "
                f"or no part of the step reduces the residual ({judged})"
            )
        return f"{tried.settings.method!r} made no iteration ({judged})"
    if solution.history[:, 1].min(initial=np.inf) <= solution.tolerance:
        return (
            f"{spent} met the residual at a point that a fresh evaluation did not "
            f"confirm as a solution ({judged})"
        )
    return f"{spent} stalled ({judged})"


def _find_scale(W: Floats | None, v: Floats, r: Floats) -> Floats:
    """Displacement per force of each contact, to compare r with v."""
    if W is not None:
        d = v.shape[1]
        trace = W.diagonal().reshape(-1, d).mean(axis=1)
        if (trace > 0).any():
            return np.asarray(np.where(trace > 0, trace, trace.max()), np.float64)
    force = float(np.abs(r).max(initial=0.0))
    return np.full(len(v), np.abs(v).max(initial=0.0) / force if force > 0 else 1.0)


def measure_violations(r: Floats, v: Floats, law: ContactLaw, scale: Floats) -> Floats:
    """Violation of each part of the law (6), (8c), (8e) at each contact, ``(4, n_c)``.

    The rows are penetration or pull, force on an open contact, friction above its limit,
    and slip that friction does not oppose at its limit, as displacements over ``√scale``.
    """
    root = np.sqrt(scale)
    r, v = r * root[:, None], v / root[:, None]
    push, shear = r[:, 0], np.linalg.norm(r[:, 1:], axis=1)
    slip = np.linalg.norm(v[:, 1:], axis=1)
    against = push[:, None] * find_resisting(law.mu, v[:, 1:])
    limit, opening = find_limit(law.mu, r[:, 1:]) * push, v[:, 0]
    if law.cohesion is not None:
        sticky = law.cohesion * root
        limit = limit + sticky
        unit = v[:, 1:] / np.where(slip > 0, slip, 1.0)[:, None]
        against = against + sticky[:, None] * unit
    if law.dilatancy is not None:
        opening = opening - law.dilatancy * slip
    off = np.linalg.norm(r[:, 1:] + against, axis=1)
    whole = slip + off + shear
    return np.stack(
        [
            np.maximum(-opening, 0) + np.maximum(-push, 0),
            np.maximum(np.minimum(push, opening), 0),
            np.maximum(shear - limit, 0),
            # The direction of a small slip has little weight.
            slip * np.divide(off, whole, out=np.zeros_like(off), where=whole > 0),
        ]
    )


def _describe_worst(
    tried: FailedSolve, solution: Solution, v: Floats, scale: Floats
) -> str:
    r = solution.reaction
    missed = measure_violations(r, v, tried.law, scale)
    if not missed.size or not np.isfinite(missed).all():
        return ""
    kind, i = np.unravel_index(int(np.argmax(missed)), missed.shape)
    if missed[kind, i] == 0:
        # η contains the balance of forces.
        if tried.loads().size and solution.residual > solution.tolerance:
            return "each contact satisfies the law, but forces are not in balance"
        return ""
    slip = float(np.linalg.norm(v[i, 1:]))
    pulls = max(-r[i, 0], 0) * scale[i] > max(-v[i, 0], 0)
    less = 0.0 if tried.law.dilatancy is None else tried.law.dilatancy[i] * slip
    deep = (
        f"which opens by {v[i, 0]:.2g}, less than its dilatancy times its slip, {less:.2g}"
        if v[i, 0] >= 0
        else f"which penetrates by {-v[i, 0]:.2g}"
    )
    kinds = (
        "which pulls" if pulls else deep,
        f"which has a normal force {r[i, 0]:.2g} and is open by {v[i, 0]:.2g}",
        "whose friction is above its limit",
        f"which slips by {slip:.2g}, but friction does not oppose this at its limit",
    )
    return f"largest violation at {_name_contact(tried, int(i))}, {kinds[int(kind)]}"


def _name_contact(tried: FailedSolve, i: int) -> str:
    if tried.points is None:
        return f"contact {i}"
    place = ", ".join(f"{x:.4g}" for x in tried.points[i])
    return f"contact {i} at ({place})"


def _find_faults(
    tried: FailedSolve, solution: Solution, v: Floats, W: Floats | None
) -> Iterator[Finding]:
    """Faults of the problem. A certain one is returned alone."""
    soft = False
    sliding = _check_sliding(tried, solution.reaction)
    if sliding is not None:
        yield sliding
    if W is not None:
        scaled, root = _scale_compliance(W, len(tried.mu))
        # Rigid motions in the scaled variables of W.
        modes = tried.modes() / root[:, None]
        modes /= np.maximum(np.linalg.norm(modes, axis=0), _SMALL)
        for sure in (
            _check_range(W, v),
            _check_definite(tried, W, scaled, modes),
            _check_rounding_of_slip(tried, W, solution.reaction, v),
            _check_rounding_of_motions(tried, W, solution, v),
        ):
            if sure is not None:
                yield sure
                return
        for finding in _check_compliance(tried, solution, W, scaled, modes):
            soft |= finding.soft
            yield finding
    condition = tried.condition()
    if condition > tuning.SOFT_MOTION and not soft:
        yield Finding(
            f"a body is nearly free, with a stiffness of condition number {condition:.0e}",
            "adding a support",
        )
    if W is not None and solution.reaction.any() and tried.several(solution):
        yield Finding(
            "several solutions nearby", "smaller load steps, or another start"
        )


def _scale_compliance(W: Floats, contacts: int) -> tuple[Floats, Floats]:
    """``W`` scaled to a mean diagonal of 1 for each contact, and the root of the scale."""
    d = len(W) // contacts
    trace = np.abs(W.diagonal().reshape(-1, d).mean(axis=1))
    largest = float(trace.max(initial=0.0)) or 1.0
    root = np.sqrt(np.repeat(np.where(trace > 0, trace, largest), d))
    scaled = W / root / root[:, None]
    return np.asarray((scaled + scaled.T) / 2, np.float64), root


def _check_range(W: Floats, v: Floats) -> Finding | None:
    """Numbers near the ends of doubles, which have lost digits."""
    softest = float(np.abs(W).max(initial=0.0))
    if softest == 0:
        return None
    cure = "other units, in which W, displacements and forces are of order one"
    for what, size in (
        ("the largest entry of W is", softest),
        ("reactions (displacements over W) are", float(np.abs(v).max()) / softest),
    ):
        if size > _LARGE or (what.endswith("is") and size < _SMALL):
            side = "above 1e+300" if size > _LARGE else "below 1e-300"
            return Finding(f"{what} {side}, near the end of doubles", cure, alone=True)
    return None


def _check_definite(
    tried: FailedSolve, W: Floats, scaled: Floats, modes: Floats
) -> Finding | None:
    """A ``W`` with ``rᵀ W r < 0`` for reactions in balance; elastic bodies have none."""
    if not np.isfinite(scaled).all():
        return None
    balanced = scaled
    if modes.size:
        # Only on Rᵀ r = 0: W along R does not matter.
        span, sizes, _ = np.linalg.svd(modes, full_matrices=False)
        span = span[:, sizes > _UNCOUPLED * sizes.max(initial=0.0)]
        out = np.eye(len(scaled)) - span @ span.T
        balanced = out @ scaled @ out
    values = np.linalg.eigvalsh(balanced)
    largest = float(np.abs(scaled.diagonal()).max(initial=0.0))
    if -values[0] <= _NEGATIVE * max(values[-1], largest):
        return None
    cure = "W = B K⁻¹ Bᵀ of a positive definite K"
    if values[-1] <= -_NEGATIVE * values[0]:
        cure = "-W, which is positive semidefinite"
    fault = "W is not positive semidefinite"
    k = int(np.argmin(scaled.diagonal()))
    if scaled[k, k] < -_NEGATIVE * largest:
        d = len(W) // len(tried.mu)
        names = ("nn", "tt") if d == 2 else ("nn", "t1t1", "t2t2")
        # The normal one, if several are negative.
        first = k // d * d
        k = first if scaled[first, first] < -_NEGATIVE * largest else k
        where = _name_contact(tried, k // d)
        return Finding(
            f"{fault}: W_{names[k % d]} = {W[k, k]:.3g} at {where}", cure, True, True
        )
    return Finding(
        f"{fault}: scaled to a mean diagonal of 1, its smallest eigenvalue is "
        f"{values[0]:.2g} and its largest {values[-1]:.2g}",
        cure,
        True,
        True,
    )


def _check_rounding_of_slip(
    tried: FailedSolve, W: Floats, r: Floats, v: Floats
) -> Finding | None:
    """A violation of the law that is only ``μ`` times the rounding error of ``v_t``."""
    # The rounding error of rigid motions is not known here.
    most = find_largest(tried.mu)
    if (
        most.max(initial=0.0) < tuning.HUGE_FRICTION
        or not r.any()
        or tried.modes().size
    ):
        return None
    moved = (np.abs(W) @ np.abs(r).ravel()).reshape(v.shape)
    # A sum of len(W) rounded terms, and q = v - W r with its own rounding error.
    bound = 4 * np.finfo(float).eps * (len(W) * moved + np.abs(v))
    exact = np.where(np.abs(v) <= bound, 0.0, v)
    scale = _find_scale(W, v, r)
    size = np.sqrt(scale).max() * np.abs(r).max()
    left = measure_violations(r, exact, tried.law, scale).max()
    hidden = np.linalg.norm(v[:, 1:] - exact[:, 1:], axis=1)
    if (
        left > tuning.SMALL_VIOLATION * size
        or not (most * hidden / np.sqrt(scale) > tuning.SMALL_VIOLATION * size).any()
    ):
        return None
    i = int(np.argmax(most * hidden / np.sqrt(scale)))
    return Finding(
        f"rounding: the reactions satisfy the law, except for mu = {most[i]:.0e} times the "
        f"rounding error {hidden[i]:.0e} of the slip of {_name_contact(tried, i)}",
        "a smaller mu, which gives the same solution while contacts stick",
        True,
        True,
    )


def _check_rounding_of_motions(
    tried: FailedSolve, W: Floats, solution: Solution, v: Floats
) -> Finding | None:
    """Rigid motions so large that their rounding hides the deformation ``W r``."""
    modes, a, r = tried.modes(), solution.rigid_motion, solution.reaction
    if not modes.size or a is None:
        return None
    free = v.ravel() - W @ r.ravel() - modes @ a
    pressed = np.repeat(r.any(axis=1), r.shape[1])
    forces: Floats = r.ravel()
    if not pressed.any():
        # From a start without reactions: the smallest that balance the loads.
        forces, pressed = (
            np.asarray(np.linalg.lstsq(modes.T, -tried.loads())[0], np.float64),
            ~pressed,
        )
    root = np.sqrt(_find_scale(W, v, r).repeat(r.shape[1]))[pressed]
    shapes = modes[pressed] / root[:, None]
    shapes /= np.maximum(np.linalg.norm(shapes, axis=0), _SMALL)
    span, sizes, _ = np.linalg.svd(shapes, full_matrices=False)
    span = span[:, sizes > _UNCOUPLED * sizes.max(initial=0.0)]
    deformed = np.abs(W[pressed]) @ np.abs(forces) / root
    moved = span @ (span.T @ (free[pressed] / root))
    share = float(np.linalg.norm(deformed)) / max(float(np.linalg.norm(moved)), _SMALL)
    if not 0 < share * _LEAST_DIGITS < 4 * np.finfo(float).eps:
        return None
    return Finding(
        f"rounding: pressed contacts deform the bodies by {share:.0e} of the rigid motion "
        "that closes them only, so that doubles keep too few digits of the deformation",
        "q or gaps from which this rigid motion is subtracted",
        True,
        True,
    )


def _check_sliding(tried: FailedSolve, r: Floats) -> Finding | None:
    """Loads that work more on a sliding of a body than friction can at these pressures.

    A sliding is a rigid motion that moves no pressed contact along its normal, and that closes
    no open one.
    """
    few = 0 < r.size <= tuning.DENSE_DIAGNOSIS
    modes = tried.modes() if few and np.isfinite(r).all() else np.empty(0)
    push = np.maximum(r[:, 0], 0.0)
    if not modes.size or not push.any():
        return None
    size = np.linalg.norm(modes)
    by_contact, loads = modes.reshape(*r.shape, -1) / size, tried.loads() / size
    _, sizes, rows = np.linalg.svd(by_contact[push > 0, 0])
    slides = rows[np.count_nonzero(sizes > _UNCOUPLED) :]
    # The sliding on which the loads work most, by their work on each.
    work = slides @ loads
    velocity = by_contact @ (work @ slides)
    opening, moved = velocity[:, 0], velocity[:, 1:]
    if opening[push == 0].min(initial=0.0) < -_UNCOUPLED * np.abs(velocity).max():
        return None
    held = float(push @ dissipation(tried.mu, moved))
    if tried.law.cohesion is not None:
        held += float(tried.law.cohesion @ np.linalg.norm(moved, axis=1))
    asked = float(work @ work)
    # Far from balance in other motions these are not the pressures of the loads.
    left = np.einsum("cdk,cd->k", by_contact, r) + loads
    left -= left @ slides.T @ slides
    if asked <= (1 + tuning.SMALL_VIOLATION) * held or left @ left > asked:
        return None
    return Finding(
        "friction alone stops a body that can slide, and at these normal forces its limit is "
        f"{held / asked:.2g} of what the loads ask for",
        "a support that stops the body, or smaller loads along this motion",
    )


def _check_compliance(
    tried: FailedSolve, solution: Solution, W: Floats, scaled: Floats, modes: Floats
) -> Iterator[Finding]:
    d = len(W) // len(tried.mu)
    wedged = _check_wedging(W, tried.mu, d)
    if len(wedged):
        i = int(wedged[0])
        more = f" and {len(wedged) - 1} more" if len(wedged) > 1 else ""
        cause = f"friction that can jam {_name_contact(tried, i)}{more}"
        yield Finding(
            f"{cause}, mu ‖W_nt‖ ≥ W_nn with mu = {find_largest(tried.mu)[i]:.3g}",
            "a smaller mu",
        )
    if not np.isfinite(scaled).all():
        return
    # A contact without compliance and rigid motion does not count as redundant.
    acts = np.abs(scaled).max(axis=1) > 0
    if modes.size:
        acts |= np.abs(modes).max(axis=1) > 0
    scaled, modes = scaled[np.ix_(acts, acts)], modes[acts]
    if not scaled.size:
        return
    values = np.linalg.eigvalsh(scaled)[::-1]
    most = max(float(values[0]), _SMALL)
    # Negative eigenvalues are rounding errors of zero, and show their size.
    zero = max(_ROUNDING * len(values), -2 * float(values[-1]) / most)
    rank = int((values > zero * most).sum())
    # Rigid motions may determine reactions that W does not.
    independent = rank
    if modes.size:
        whole = np.hstack([scaled / most, modes])
        independent = int(np.linalg.matrix_rank(whole, tol=zero))
    if independent < len(values):
        ways = (
            f"in {independent} independent ways only"
            if independent != 1
            else "in one way only"
        )
        # "auto" can solve such problems; only if it stalls are fewer contacts needed.
        stood = tried.settings.method == "auto" and solution.outcome is Outcome.STALLED
        yield Finding(
            f"redundant contacts, their {len(values)} reaction components act {ways}",
            "fewer contacts" if stood else "",
        )
    if rank > 1:
        softer = values[: rank - 1] / values[1:rank]
        first = int(np.argmax(softer))
        if softer[first] > tuning.SOFT_MOTION and first < min(6, len(values) // 2):
            which = "one motion is" if first == 0 else f"{first + 1} motions are"
            cause = f"a body is nearly free, {which} softer by {softer[first]:.0e}"
            yield Finding(f"{cause} than all others", "adding a support", soft=True)


def _check_wedging(W: Floats, mu: Floats, d: int) -> NDArray[np.intp]:
    """Contacts that can jam or have several solutions: ``‖D W_nt‖ ≥ W_nn``."""
    blocks = W.reshape(len(mu), d, len(mu), d)[
        np.arange(len(mu)), :, np.arange(len(mu))
    ]
    coupling = blocks[:, 0, 1:].copy()
    none = np.linalg.norm(coupling, axis=1)
    coupling[none <= _UNCOUPLED * np.abs(blocks).max(axis=(1, 2))] = 0.0
    pushed = dissipation(mu, coupling)
    return np.flatnonzero((pushed >= blocks[:, 0, 0]) & (pushed > 0))


def _measure_last_gain(solution: Solution) -> float | None:
    """Factor of the residual over the last fifth of the iterations.

    It is ``None`` for too few iterations, and at least 1 if the residual did not fall.
    """
    residuals = solution.history[:, 1]
    if len(residuals) < tuning.HISTORY_ROWS:
        return None
    cut = len(residuals) - max(len(residuals) // 5, 3)
    before = float(residuals[:cut].min())
    return float(residuals[cut:].min()) / before if before > 0 else 1.0


def _describe_trend(solution: Solution) -> str:
    gain = _measure_last_gain(solution)
    if gain is None:
        return ""
    if gain < tuning.STILL_FALLS:
        return ", still falling"
    return ", hardly falling" if gain < 1 else ", no longer falling"


def _list_cures(
    tried: FailedSolve,
    solution: Solution,
    causes: list[Finding],
    v: Floats,
    scale: Floats,
) -> Iterator[str]:
    yield from (finding.cure for finding in causes if finding.cure)
    if not any(finding.alone for finding in causes):
        limit = {
            Outcome.ITERATION_LIMIT: "a larger max_iterations",
            Outcome.TIME_LIMIT: "a larger max_seconds",
        }.get(solution.outcome)
        gain = _measure_last_gain(solution)
        # More iterations do not help a method that has stalled. "auto" tries others.
        if limit is not None and (
            tried.settings.method == "auto" or gain is None or gain < 1
        ):
            yield limit
        if tried.settings.method != "auto":
            yield "method='auto'"
        elif limit is None and not causes:
            yield "smaller load steps, or another start"
    # η is relative to the reactions, and small if they are much larger than needed.
    missed = measure_violations(solution.reaction, v, tried.law, scale).max(initial=0.0)
    moved = (np.linalg.norm(v, axis=1) / np.sqrt(scale)).max(initial=0.0)
    if (
        solution.tolerance < solution.residual <= tuning.SMALL_VIOLATION
        and missed <= tuning.SMALL_VIOLATION * moved
    ):
        wish = 10.0 ** np.ceil(np.log10(solution.residual))
        yield f"tol={wish:.0e}, which this point meets"
