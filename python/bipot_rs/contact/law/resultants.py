"""Resultant forces of a contact surface.

On a flat surface the sums of the components are forces. On a curved surface they are not,
because the normals differ: opposite normal forces add up in ``Σ r_n`` but cancel in the
sum of vectors. There only the vector in global components balances the loads; ``Σ r_n``
and ``Σ ‖r_t‖`` measure pressing and friction in all directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.contact.law.contact_law import dissipation, find_largest, find_limit

# Difference of normals of one plane, if a file gives coordinates with seven digits.
_FLAT = 1e-6


@dataclass(frozen=True)
class Resultant:
    """Forces on one contact surface in one load step."""

    normal: float  # `Fn = Σ r_n` [N]: on a flat surface, the normal force
    # On a flat surface `Ft = ‖Σ r_t‖` [N], with vectors added in space; on a curved surface `Σ
    # ‖r_t‖` [N].
    tangential: float
    # Upper limit of `tangential` for these normal forces, `Σ (c + μ r_n)` [N]. With two
    # coefficients it is that of the friction ellipse, along the tangential force of a flat
    # surface, or along the tangential force of each contact of a curved surface.
    limit: float
    # (d,): sum of all contact forces on the body with the contacts, in global components [N].
    # The loads and supports of the body balance it.
    force: Floats
    curved: bool  # whether normals differ
    # (3,), in 2D (1,): moment of these forces about the origin [N m]; None without places.
    moment: Floats | None = None
    # On a flat surface in 3D: moment about its normal through its centre [N m].
    torque: float | None = None

    @property
    def used(self) -> float | None:
        """``tangential / limit``, from 0 to 1; ``None`` if ``limit`` is 0.

        It is 1 if every closed contact slips; on a flat surface, all in one direction.
        """
        return self.tangential / self.limit if self.limit > 0 else None


def is_curved(normal: Floats) -> bool:
    """Whether unit normals ``(n_c, d)`` differ by more than rounding."""
    return bool(len(normal) and np.abs(normal - normal[0]).max() > _FLAT)


def list_resultants(
    reaction: Floats,
    frame: Floats,
    mu: Floats,
    group: Ints,
    count: int,
    cohesion: Floats | None = None,
    x: Floats | None = None,
    area: Floats | None = None,
) -> list[Resultant]:
    """Resultant forces on each contact surface.

    ``reaction (n_c, d)``: nodal contact forces, normal first [N].
    ``frame (n_c, d, d)``: rows n, t1[, t2].
    ``mu (n_c,) or (n_c, 2)``: friction coefficients.
    ``group (n_c,)``: number of the surface of each contact.
    ``count``: number of surfaces.
    ``cohesion (n_c,)``: cohesion that is left, which adds to the limit; the default is zero.
    ``x (n_c, d), area (n_c,)``: places, for moments, and the weights of their mean, the centre of
    a flat surface; without areas all weigh the same.
    """
    resultants = []
    for k in range(count):
        members = group == k
        force, axes, coefficient = reaction[members], frame[members], mu[members]
        whole = np.einsum("ik,ikd->d", force, axes)
        press = force[:, 0]
        curved = is_curved(axes[:, 0])
        if curved:
            sizes, reach = find_limit_force(force, coefficient)
            size, most = float(sizes.sum()), float(reach.sum())
        else:
            total = np.einsum("ik,ikd->d", force[:, 1:], axes[:, 1:])
            size = float(np.linalg.norm(total))
            if coefficient.ndim == 2:
                # The limit of the ellipse along the total tangential force.
                line = total / size if size > 0 else axes[0, 1]
                coefficient = dissipation(coefficient, axes[:, 1:] @ line)
            most = float(press @ coefficient)
        if cohesion is not None:
            most += float(cohesion[members].sum())
        moment, torque = None, None
        if x is not None:
            places, forces = x[members], np.einsum("ik,ikd->id", force, axes)
            moment = find_moment(places, forces)
            if not curved and len(whole) == 3 and len(places):
                share = None if area is None else area[members]
                arms = places - np.average(places, axis=0, weights=share)
                torque = float(find_moment(arms, forces) @ axes[0, 0])
        sums = float(press.sum()), size, most, whole
        resultants.append(Resultant(*sums, curved, moment, torque))
    return resultants


def find_moment(arms: Floats, forces: Floats) -> Floats:
    """``Σ arm × force``, ``(3,)``, in 2D ``(1,)``."""
    if arms.shape[1] == 3:
        return np.asarray(np.cross(arms, forces).sum(axis=0))
    return np.asarray([arms[:, 0] @ forces[:, 1] - arms[:, 1] @ forces[:, 0]])


def find_limit_force(reaction: Floats, mu: Floats) -> tuple[Floats, Floats]:
    """``‖r_t‖`` of each contact and its friction limit, ``(..., n_c)`` [N].

    ``reaction (..., n_c, d)``: normal first.
    ``mu (n_c,) or (n_c, 2)``: with two coefficients the limit is that of the ellipse along
    ``r_t``, or along the longer axis if ``r_t`` is zero.
    """
    r_t = reaction[..., 1:]
    size = np.linalg.norm(r_t, axis=-1)
    reach = mu
    if mu.ndim == 2:
        each = np.broadcast_to(mu, r_t.shape).reshape(-1, 2)
        along = find_limit(each, r_t.reshape(-1, 2)).reshape(size.shape)
        reach = np.where(size > 0, along, find_largest(mu))
    return size, reach * reaction[..., 0]
