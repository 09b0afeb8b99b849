"""Forces of a whole contact surface: what a load cell under it would show.

On a flat surface the sums of the components are forces themselves. On a curved one they
are not: normals differ, forces that press from two sides add up in ``Σ r_n`` and cancel in
the sum of vectors. There the vector in global components is what balances loads, ``Σ r_n``
and ``Σ ‖r_t‖`` tell how much is pressed and held, whatever its direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.contact.elliptic_friction import dissipation, largest, limit

# Normals of one plane, from places that files write with seven digits.
_FLAT = 1e-6


@dataclass(frozen=True)
class Resultant:
    """Forces on one contact surface in one load step.

    Attributes
    ----------
    normal
        ``Fn = Σ r_n`` [N], the force that presses where the surface is flat.
    tangential
        Where the surface is flat ``Ft = ‖Σ r_t‖`` [N], the sum as vectors in space; where
        it is curved ``Σ ‖r_t‖`` [N], the sum of the sizes.
    limit
        The most that ``tangential`` can be under these normal forces, ``Σ μ r_n`` [N]; of
        two coefficients the ellipse's reach, where it is flat along the tangential force,
        where it is curved along that of each contact.
    force : (d,)
        The sum of all contact forces in global components [N], on the body that has the
        contacts: what its loads and supports balance.
    curved
        Whether normals differ.
    """

    normal: float
    tangential: float
    limit: float
    force: Floats
    curved: bool

    @property
    def used(self) -> float | None:
        """``tangential / limit``, from 0 to 1; ``None`` where friction can hold nothing.

        Of a curved surface it is 1 where every contact that presses slips, in whatever
        direction; of a flat one where all slip one way.
        """
        return self.tangential / self.limit if self.limit > 0 else None


def is_curved(normal: Floats) -> bool:
    """Whether unit normals ``(n_c, d)`` differ by more than those of one plane do."""
    return bool(len(normal) and np.abs(normal - normal[0]).max() > _FLAT)


def resultants(
    reaction: Floats, frame: Floats, mu: Floats, group: Ints, count: int
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
        whole = np.einsum("ik,ikd->d", force, axes)
        press = force[:, 0]
        curved = is_curved(axes[:, 0])
        if curved:
            sizes, reach = held(force, coefficient)
            size, most = float(sizes.sum()), float(reach.sum())
        else:
            total = np.einsum("ik,ikd->d", force[:, 1:], axes[:, 1:])
            size = float(np.linalg.norm(total))
            if coefficient.ndim == 2:
                # Of an ellipse, the most along the line of the total.
                line = total / size if size > 0 else axes[0, 1]
                coefficient = dissipation(coefficient, axes[:, 1:] @ line)
            most = float(press @ coefficient)
        found.append(Resultant(float(press.sum()), size, most, whole, curved))
    return found


def held(reaction: Floats, mu: Floats) -> tuple[Floats, Floats]:
    """``‖r_t‖`` of each contact and the most that it could be, ``(..., n_c)`` [N].

    Parameters
    ----------
    reaction : (..., n_c, d)
        Normal first.
    mu : (n_c,) or (n_c, 2)
        Where two, the reach is that of the ellipse along ``r_t``; of a contact without
        tangential force along its longer axis.
    """
    r_t = reaction[..., 1:]
    size = np.linalg.norm(r_t, axis=-1)
    reach = mu
    if mu.ndim == 2:
        each = np.broadcast_to(mu, r_t.shape).reshape(-1, 2)
        along = limit(each, r_t.reshape(-1, 2)).reshape(size.shape)
        reach = np.where(size > 0, along, largest(mu))
    return size, reach * reaction[..., 0]
