"""The contact law on arrays: `ContactLaw`, its friction with one or two coefficients, `project`.

With ``D = diag(mu_1, mu_2)``, friction lies within the ellipse ``‖D⁻¹ r_t‖ ≤ r_n``, and
a sliding contact has ``r_t = -r_n D² v_t / ‖D v_t‖``. Coulomb's law (8) has ``D = μ I``.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bipot_rs._core as _core
from bipot_rs._lib.records import short_repr
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import RATIO, by_contact, floats, friction, vectors


@dataclass(frozen=True, eq=False)
class ContactLaw:
    """The numbers of the law of each contact, ``|r_t| <= c + mu r_n``, ``v_n >= beta |v_t|``.

    Coulomb's law (8) has no cohesion ``c`` and no dilatancy ``beta``. The core reads the
    attributes by their names (`LawArrays` in ``src/python/arrays.rs``) and checks each number.
    """

    mu: Floats  # (n_c,) or (n_c, 2): friction coefficients
    # (n_c,): cohesion, a force, zero or positive; `None` if it is zero at all contacts.
    cohesion: Floats | None = None
    # (n_c,): dilatancy, from zero to `mu`; `None` if it is zero at all contacts.
    dilatancy: Floats | None = None

    __repr__ = short_repr

    @classmethod
    def check(
        cls,
        contacts: int,
        d: int,
        *,
        mu: ArrayLike,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
        ratio: float = RATIO,
    ) -> ContactLaw:
        """Check the arguments of a problem that are about its law.

        The two coefficients of one contact are within a factor ``ratio`` of each other.

        Raises `TypeError` or `ValueError`: an argument is wrong; the message names it.
        """
        law = cls(
            friction(mu, contacts, d, ratio=ratio),
            _check_number("cohesion", cohesion, contacts),
            _check_number("dilatancy", dilatancy, contacts),
        )
        if law.mu.ndim == 1:
            return law
        for what, values in law.without_mu().items():
            if values is not None:
                at = int(np.flatnonzero(values)[0])
                raise ValueError(
                    f"mu has two coefficients of each contact and {what} of contact {at} is "
                    f"{values[at]}: give one coefficient of each contact, or no {what}"
                )
        return law

    def without_mu(self) -> dict[str, Floats | None]:
        """The numbers beside friction by their names: arguments of a problem of this law.

        What makes another problem of a law takes them from here, so that none is lost.
        """
        return {name: getattr(self, name) for name in BESIDE_MU}

    def with_mu(self, mu: ArrayLike, d: int) -> ContactLaw:
        """The law with other friction coefficients, checked as in `check`."""
        return ContactLaw.check(
            len(self.mu), d, mu=mu, ratio=RATIO, **self.without_mu()
        )

    @property
    def is_coulomb(self) -> bool:
        """Whether there is nothing but friction: neither cohesion nor dilatancy."""
        return all(values is None for values in self.without_mu().values())

    def require_coulomb(self, what: str) -> None:
        """Refuse cohesion and dilatancy, for ``what`` does not take them.

        Raises `ValueError`: a contact has one of them; the message names it.
        """
        for argument, values in self.without_mu().items():
            if values is not None:
                at = int(np.flatnonzero(values)[0])
                raise ValueError(
                    f"{what} does not take {argument}, which is {values[at]} at contact {at}"
                )

    def arrays(self) -> dict[str, Floats]:
        """Arrays by the names of `Result.contacts`, for files and for comparison."""
        rest = self.without_mu().items()
        return {"mu": self.mu} | {
            name: value for name, value in rest if value is not None
        }


# The numbers of a contact beside its friction, by their names: those of the arguments of each
# problem, of `fem.contact.contact.Contact` and `Assembly`, and of datasets.
BESIDE_MU = tuple(field.name for field in fields(ContactLaw) if field.name != "mu")


def _check_number(what: str, value: ArrayLike | None, contacts: int) -> Floats | None:
    """One number of each contact, or ``None`` if all are zero."""
    if value is None:
        return None
    numbers = by_contact(what, value, contacts)
    return numbers if numbers.any() else None


def find_largest(mu: Floats) -> Floats:
    """The larger coefficient of each contact, ``(n_c,)``."""
    return mu if mu.ndim == 1 else np.asarray(mu.max(axis=1), np.float64)


def dissipation(mu: Floats, v_t: Floats) -> Floats:
    """``‖D v_t‖``, the work of friction per unit normal reaction, ``(n_c,)``."""
    if mu.ndim == 1:
        return np.asarray(mu * np.linalg.norm(v_t, axis=1), np.float64)
    return np.asarray(np.linalg.norm(mu * v_t, axis=1), np.float64)


def find_resisting(mu: Floats, v_t: Floats) -> Floats:
    """``D² v_t / ‖D v_t‖``, minus friction per unit normal reaction; zero without slip."""
    size = np.linalg.norm(v_t, axis=1)
    unit = v_t / np.where(size > 0, size, 1.0)[:, None]
    if mu.ndim == 1:
        return np.asarray(mu[:, None] * unit, np.float64)
    steep = np.linalg.norm(mu * unit, axis=1)
    return np.asarray(mu**2 * unit / np.where(steep > 0, steep, 1.0)[:, None])


def find_limit(mu: Floats, r_t: Floats) -> Floats:
    """The largest friction along ``r_t`` per unit normal reaction, ``(n_c,)``."""
    if mu.ndim == 1:
        return mu
    size = np.linalg.norm(r_t, axis=1)
    unit = r_t / np.where(size > 0, size, 1.0)[:, None]
    # The point s e of the ellipse has s ‖D⁻¹ e‖ = 1. D may have zeros: no D⁻¹ here.
    across = np.linalg.norm(mu[:, ::-1] * unit, axis=1)
    area = mu.prod(axis=1)
    reach = np.divide(area, across, out=np.zeros_like(area), where=across > 0)
    return np.asarray(reach, np.float64)


def project(
    tau: ArrayLike,
    mu: ArrayLike,
    base: ArrayLike | None = None,
    cohesion: ArrayLike | None = None,
) -> tuple[Floats, NDArray[np.int8]]:
    """Project onto Coulomb's cone or an elliptic cone, for each contact, in parallel.

    Parameters
    ----------
    tau
        Points to project, ``(n_c, d)``, normal first.
    mu
        Friction coefficient, a number or ``(n_c,)``. In space also ``(n_c, 2)``, one for
        each tangent, both positive or both zero: the cone is then ``‖D⁻¹ r_t‖ ≤ r_n``,
        ``D = diag(mu_1, mu_2)``.
    base
        Start state ``t0``, ``(n_c, d)``. ``tau`` is then an increment, which is projected
        onto ``ΔK_μ = K_μ - t0`` [dSF91, 53].
    cohesion
        Cohesion ``c``, a force, a number or ``(n_c,)``: the set is ``|r_t| <= c + mu r_n``,
        ``r_n >= 0``. Not with two coefficients.

    Returns
    -------
    t, status
        The projection ``(n_c, d)``, equation (12), and its `Status` ``(n_c,)``. With
        ``mu = 0`` a closed contact is ``SLIP``. With cohesion ``OPEN`` is ``t_n = 0``, for any
        tangential part.

    Examples
    --------
    >>> import bipot_rs as bp
    >>> t, status = bp.project([[1.0, 0.2], [1.0, 3.0], [-1.0, 0.5]], 0.5)
    >>> t
    array([[1. , 0.2],
           [2. , 1. ],
           [0. , 0. ]])
    >>> [bp.Status(s).name for s in status]
    ['STICK', 'SLIP', 'OPEN']
    """
    points = vectors("tau", tau, copy=False)
    contacts, d = points.shape
    law = ContactLaw.check(contacts, d, mu=mu, cohesion=cohesion, ratio=np.inf)
    start = None if base is None else floats("base", base, shape=points.shape)
    if start is not None:
        with np.errstate(over="ignore"):
            total = points + start
        if not np.isfinite(total).all():
            raise ValueError("base + tau overflows, expected numbers below 1e300")
    return _core.project(points, law, start)
