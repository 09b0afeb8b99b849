"""`project`: the projection onto Coulomb's cone, or onto the set of a law with cohesion."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import floats, vectors
from bipot_rs.contact.law.contact_law import ContactLaw


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
