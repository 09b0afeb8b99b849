"""`State`: a start of one's own for a load path."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Bools, Floats
from bipot_rs._lib.validation import floats, vectors
from bipot_rs.contact.law.status import Outcome, Status
from bipot_rs.contact.results.solution import Step

if TYPE_CHECKING:
    from bipot_rs.contact.results.result import Result

# What a load path may start from.
Start: TypeAlias = "Result | Step | State"

# Tension of this part of the largest reaction is taken for a wrong sign. Reactions of other
# programs may have less by their tolerance.
_TENSION = 1e-3


class State:
    """A state of the contacts from which a load path starts: ``(t⁰, u⁰)`` of [dSF91, 52-54].

    It is the ``start`` of `ContactProblem.solve`, `ContactProblem.follow`,
    `ContactProblem.reduced` and `ContactProblem.existence`, in place of a step that was solved
    before. The loads of the path stay totals, and so do its results: ``K u = f + Bᵀ r``.

    The law of the first step is that of the slip since this state, (8) and (22):
    ``slip = B_t u + gap_t - relative_displacement_t``. The normal parts of the state do not
    enter the law, because Signorini's condition holds for totals. The reactions do not enter
    it either: the constant that they leave in the bipotential vanishes in totals (section 4 of
    ``docs/theory.md``). The solver starts from them, and contacts with ``r_n > 0`` count as
    closed before. If a problem has several solutions, they decide which is found.

    Parameters
    ----------
    reaction
        ``t⁰``, contact forces on the body, ``(n_c, d)``, normal first; ``r_n >= 0`` presses.
    relative_displacement
        ``B u⁰ + gap``, ``(n_c, d)``, normal first: the opening ``u_n⁰ + h₀``, and the
        tangential position from which slip is measured.
    broken
        Contacts that have lost their cohesion, ``(n_c,)`` booleans. The default are those
        that are open: ``r_n = 0`` and an opening above zero.
    dilation
        Openings at which the surfaces meet, because dilatancy has lifted them, ``(n_c,)``;
        the default is zero.

    shortening
        Shortening of each bolt, ``(m,)``, which the path keeps until the bolt is tightened; for
        a model with bolts only.

    Raises
    ------
    TypeError, ValueError
        An array has the wrong shape or type, is not finite, reactions pull by more than 1e-3
        of the largest one, or a dilation is negative.

    Examples
    --------
    A point is pressed onto a wall. Without a start, the displacement 2 mm that friction does
    not allow is slip of the first step; from a state at 2 mm, the contact sticks there:

    >>> import numpy as np
    >>> import bipot_rs as bp
    >>> problem = bp.ContactProblem(1e3 * np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
    >>> load = [-10.0, 5.0]
    >>> problem.solve(load).slip[0].round(9)
    array([[0.002]])
    >>> at = bp.State(reaction=[[10.0, -3.0]], relative_displacement=[[0.0, 0.002]])
    >>> problem.solve(load, start=at).slip[0].round(9)
    array([[0.]])
    """

    __slots__ = (
        "broken",
        "dilation",
        "reaction",
        "relative_displacement",
        "shortening",
    )

    reaction: Floats
    relative_displacement: Floats
    broken: Bools | None
    dilation: Floats | None
    shortening: Floats | None

    def __init__(
        self,
        *,
        reaction: ArrayLike,
        relative_displacement: ArrayLike,
        broken: ArrayLike | None = None,
        dilation: ArrayLike | None = None,
        shortening: ArrayLike | None = None,
    ) -> None:
        self.reaction = vectors("reaction", reaction)
        self.relative_displacement = floats(
            "relative_displacement", relative_displacement, shape=self.reaction.shape
        )
        contacts = len(self.reaction)
        self.broken = None
        if broken is not None:
            self.broken = np.array(broken)
            if self.broken.shape != (contacts,) or self.broken.dtype != np.bool_:
                raise ValueError(
                    f"broken has shape {self.broken.shape} and type {self.broken.dtype}, "
                    f"expected ({contacts},) booleans"
                )
        self.dilation = (
            None
            if dilation is None
            else floats("dilation", dilation, shape=(contacts,))
        )
        if self.dilation is not None and (self.dilation < 0).any():
            k = int(np.argmin(self.dilation))
            raise ValueError(
                f"dilation of contact {k} is {self.dilation[k]:g}, expected zero or positive: "
                "slip only lifts surfaces"
            )
        self.shortening = (
            None if shortening is None else floats("shortening", shortening, ndim=1)
        )
        normal = self.reaction[:, 0]
        if (normal < -_TENSION * np.abs(self.reaction).max(initial=0.0)).any():
            k = int(np.argmin(normal))
            raise ValueError(
                f"reaction pulls at contact {k}: its normal part is {normal[k]:g}, expected "
                "r_n >= 0, which presses; reaction is the force on the body that the normal "
                "points to"
            )

    def __repr__(self) -> str:
        contacts, d = self.reaction.shape
        return f"State({contacts} x {d} components)"

    def step(self) -> Step:
        """The state as a step that is already solved, with no slip and no loads.

        Its status tells closed contacts (``STICK``) from open ones; whether a closed contact
        slid is not known.
        """
        closed = self.reaction[:, 0] > 0
        status = np.where(closed, Status.STICK, Status.OPEN).astype(np.int8)
        return Step(
            reaction=self.reaction,
            relative_displacement=self.relative_displacement,
            status=status,
            outcome=Outcome.CONVERGED,
            residual=0.0,
            tolerance=0.0,
            iterations=0,
            work=0.0,
            slip=np.zeros((len(status), self.reaction.shape[1] - 1)),
            broken=self.broken,
            dilation=self.dilation,
            shortening=self.shortening,
            from_state=True,
        )
