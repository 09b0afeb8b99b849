"""Forces of a whole contact surface: what a load cell under it would show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bipot_rs.friction import dissipation

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Resultant:
    """Forces on one contact surface in one load step.

    Attributes
    ----------
    normal
        ``Fn = Σ r_n`` [N], the force that presses where the surface is flat.
    tangential
        ``Ft = ‖Σ r_t‖`` [N], the sum as vectors in space.
    limit
        The most that the tangential force can be in its own direction under these
        normal ones, ``Σ μ r_n`` [N].
    """

    normal: float
    tangential: float
    limit: float

    @property
    def used(self) -> float | None:
        """``Ft/(μ Fn)``, from 0 to 1; ``None`` where friction can hold nothing."""
        return self.tangential / self.limit if self.limit > 0 else None


def resultants(
    reaction: Floats, frame: Floats, mu: Floats, group: NDArray[np.int64], count: int
) -> list[Resultant]:
    """Forces on each contact surface.

    Parameters
    ----------
    reaction : (n_c, d)
        Nodal contact forces, normal first [N].
    frame : (n_c, d, d)
        Rows n, t1[, t2].
    mu : (n_c,) or (n_c, 2)
        Friction coefficients.
    group : (n_c,)
        Number of the surface of each contact.
    count
        Surfaces.
    """
    found = []
    for k in range(count):
        own = group == k
        force, axes, coefficient = reaction[own], frame[own], mu[own]
        total = np.einsum("ik,ikd->d", force[:, 1:], axes[:, 1:])
        size = float(np.linalg.norm(total))
        if coefficient.ndim == 2:
            # Of an ellipse, the most along the line of the total.
            line = total / size if size > 0 else axes[0, 1]
            coefficient = dissipation(coefficient, axes[:, 1:] @ line)
        found.append(
            Resultant(float(force[:, 0].sum()), size, float(force[:, 0] @ coefficient))
        )
    return found
