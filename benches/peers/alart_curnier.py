"""Newton's method for the law of Alart and Curnier, for `with_petsc.py`."""

import numpy as np

OPEN, SLIP, STICK = range(3)
# Bound of 1 - c/|x_t|, which is zero where a sliding contact is about to stick.
LEAST_SLIP = 1e-6
MOST_HALVINGS = 6
# Relative residual of a linear system while more than `MANY` of the statuses change, while
# some do, and after.
MANY, COARSE, MIDDLE, FINE = 0.002, 1e-2, 1e-5, 1e-8


class Law:
    """The contacts of one rank at reactions r and relative displacements v, normal first.

    With x = r - rho v, c = mu (x_n)₊ and t = x_t/|x_t|, ``F`` is r at an open contact,
    rho v at a sticking one, and (rho v_n, r_t - c t) at a sliding one: the natural map of
    the law.
    """

    def __init__(self, r, v, mu, rho, status=None):
        x = r - rho[:, None] * v
        length = np.linalg.norm(x[:, 1:], axis=1)
        c = mu * np.maximum(x[:, 0], 0)
        if status is None:
            status = np.where(x[:, 0] <= 0, OPEN, np.where(length <= c, STICK, SLIP))
        length = np.maximum(length, np.finfo(float).tiny)
        self.status, at = status, status == SLIP
        self.F = np.where((status == STICK)[:, None], rho[:, None] * v, r)
        self.F[at, 0] = (rho * v[:, 0])[at]
        self.F[at, 1:] -= (c / length)[at, None] * x[at, 1:]
        # At sliding contacts, with g = c/|x_t|: mu t; I - t tᵀ; and M = (∂F_t/∂r_t)⁻¹.
        t, g = (
            (x[:, 1:] / length[:, None])[at],
            np.minimum(c / length, 1 - LEAST_SLIP)[at],
        )
        along, across = t[:, :, None] * t[:, None, :], np.eye(2)
        across = across - along
        self.mu_t = mu[at, None] * t
        self.springs = (rho[at] * g / (1 - g))[:, None, None] * across
        M = along + across / (1 - g)[:, None, None]
        # -M F_t, and -rho mu t dv_n with the known dv_n = -v_n.
        self.wanted = -np.einsum("iab,ib->ia", M, self.F[at, 1:])
        self.wanted += self.F[at, :1] * self.mu_t


def linear_tolerance(changed, residual, tol):
    """Relative residual of a linear system, with a share of the statuses changed."""
    wanted = COARSE if changed > MANY else MIDDLE if changed else FINE
    return max(wanted, 0.1 * tol / max(residual, tol))


def search(merit, recent):
    """The longest share of a step that is better than the worst of four points, or 1."""
    for share in 0.5 ** np.arange(MOST_HALVINGS + 1):
        if merit(share) <= (1 - 1e-4 * share) * max(recent[-4:]):
            return share
    return 1.0
