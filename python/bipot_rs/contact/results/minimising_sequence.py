"""The fields of a minimising sequence of the bifunctional, [dSF91, 31-34]."""

from __future__ import annotations

from dataclasses import dataclass

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MinimisingSequence:
    """The pairs ``(u_i, σ_i)`` of a minimising sequence and the bifunctional ``B`` along it.

    ``u_i`` is in equilibrium with reactions ``τ_i``, ``K u_i = f + Bᵀ τ_i``, and ``σ_i`` is
    the stress in equilibrium with reactions ``r_i`` in their cones, that of the displacement
    ``w_i`` with ``K w_i = f + Bᵀ r_i``. With ``v_i = W τ_i + q`` the bifunctional
    [dSF91, 23], less its lower bound, is::

        B(u_i, σ_j) = ½ (τ_i - r_j)ᵀ W (τ_i - r_j) + Σ (r_j·v_i + mu r_jn |v_it|)  >= 0.

    With two coefficients ``|D v_it|`` replaces ``mu |v_it|``, (10e). ``σ_0`` is the start
    value, ``u_i`` minimises ``B(·, σ_i)`` [dSF91, 33], and ``σ_(i+1)`` minimises ``B(u_i, ·)``
    [dSF91, 31]. So ``B`` does not increase [dSF91, 32, 34]. It falls to zero at a solution,
    or to a positive limit without one. Each minimum is computed to a hundredth of η times
    the error of the fields before, because ``B`` is of second order in the error, and more
    accurately where ``B`` would increase. ``v_i`` may penetrate by as much, which counts as
    zero in ``B``. Both properties hold to the rounding of ``B``: 16 ε of the product of
    ``|W||r| + |q|`` and ``r``, in norms, with the larger of both reactions, times 1 + mu.

    Attributes
    ----------
    bifunctional
        ``B(u_0, σ_0), B(u_0, σ_1), B(u_1, σ_1), ...`` in units of work: ``B(u_i, σ_i)`` has
        the index ``2 i``, and ``B(u_i, σ_(i+1))`` the index ``2 i + 1``. Empty if the start
        value is the solution.
    reaction
        ``r_i``, ``(m, n_c, d)``.
    balanced_reaction
        ``τ_i``, ``(k, n_c, d)``. ``m`` is ``k`` or ``k + 1``: the solver stops as soon as a
        point satisfies (13), which may be in the middle of a step. That point is the
        `Solution`, and the step is not part of the sequence.
    relative_displacement
        ``v_i``, ``(k, n_c, d)``; its tangential part is the slip since the start of the
        load step.

    Examples
    --------
    >>> import bipot_rs as bp
    >>> problem = bp.ReducedProblem([[1.0, 0.4], [0.4, 1.0]], [[-1.0, 0.9]], 0.3)
    >>> sequence = problem.solve("minimising_sequence").minimising_sequence
    >>> [float(f"{b:.3g}") for b in sequence.bifunctional[:4]]
    [0.5, 0.0445, 0.00396, 0.000352]
    >>> len(sequence.reaction), len(sequence)
    (10, 9)
    """

    bifunctional: Floats
    reaction: Floats
    balanced_reaction: Floats
    relative_displacement: Floats

    def __len__(self) -> int:
        """Number of complete pairs ``(u_i, σ_i)``."""
        return len(self.balanced_reaction)

    def __repr__(self) -> str:
        lengths = f"{len(self)} pairs"
        if len(self):
            ends = self.bifunctional[[0, -1]]
            lengths += f", B from {ends[0]:.1e} to {ends[1]:.1e}"
        return f"{type(self).__name__}({lengths})"


def read_sequence(
    core: _core.SequenceFields, shape: tuple[int, ...]
) -> MinimisingSequence:
    """The sequence of contacts of a shape ``(n_c, d)`` from what the core returns."""
    return MinimisingSequence(
        bifunctional=core.bifunctional,
        reaction=core.reaction.reshape(-1, *shape),
        balanced_reaction=core.balanced_reaction.reshape(-1, *shape),
        relative_displacement=core.relative_displacement.reshape(-1, *shape),
    )
