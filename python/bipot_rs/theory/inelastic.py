"""The method of displacements alone, [dSF91, 37-38], for bodies that are not elastic.

It applies to every body whose material has potentials; here trusses of bars with linear
hardening. Contact has Coulomb friction, with its bipotential (54).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats, MatrixLike
from bipot_rs._lib.validation import coulomb, csr, floats, integer, number

# After this many halvings of a Newton step, only rounding remains.
_HALVINGS = 30
_NEWTON = 100
_MULTIPLIERS = 200


@dataclass(frozen=True, eq=False)
class HardeningBars:
    """Bars with linear kinematic hardening over one step: an explicit standard material.

    A bar with plastic elongation ``p`` has the force ``N = k (e - p)`` and yields when
    ``|N - h p| = N_y``. The implicit step from ``p0`` to ``p`` has the potential
    ``V(e) = min_p ½ k (e - p)² + ½ h p² + N_y |p - p0|``, which is convex with the
    continuous derivative ``N``, and the dual potential
    ``W(N) = ½ N²/k + N p0 - ½ h p0² + ½ max(|N - h p0| - N_y, 0)²/h``.

    Attributes
    ----------
    stiffness, hardening, limit
        ``k``, ``h`` [force/length], positive, and ``N_y`` [force], infinite for an elastic
        bar; ``(n_b,)``.
    plastic
        ``p0``, ``(n_b,)`` [length].

    Raises
    ------
    TypeError, ValueError
        A wrong argument.
    """

    stiffness: Floats
    hardening: Floats
    limit: Floats
    plastic: Floats

    def __post_init__(self) -> None:
        k = floats("stiffness", self.stiffness, ndim=1)
        for name in ("stiffness", "hardening", "limit", "plastic"):
            value = floats(name, getattr(self, name), shape=k.shape, finite=False)
            wrong = np.isnan(value) if name == "plastic" else ~(value > 0)
            if wrong.any():
                at = int(np.argmax(wrong))
                kind = "number" if name == "plastic" else "positive number"
                raise ValueError(
                    f"{name} of bar {at} is {value[at]}, expected a {kind}"
                )
            object.__setattr__(self, name, value)

    def potential(self, e: Floats) -> Floats:
        """``V`` of each bar at elongations ``e`` [work]."""
        p = self.yielded(e)
        spent = np.where(
            p == self.plastic, 0.0, self._limit() * np.abs(p - self.plastic)
        )
        return 0.5 * self.stiffness * (e - p) ** 2 + 0.5 * self.hardening * p**2 + spent

    def force(self, e: Floats) -> Floats:
        """``N = ∂V(e)``, (38a) [force]."""
        return self.stiffness * (e - self.yielded(e))

    def tangent(self, e: Floats) -> Floats:
        """Derivative of ``N``: ``k``, or ``k h/(k + h)`` where the bar yields."""
        k, h = self.stiffness, self.hardening
        return np.where(self.yielded(e) == self.plastic, k, k * h / (k + h))

    def dual(self, N: Floats) -> Floats:
        """``W`` of each bar [work]: ``V(e) + W(N) >= N e``, with equality on the law."""
        over = np.maximum(np.abs(N - self.hardening * self.plastic) - self._limit(), 0)
        stored = N * self.plastic - 0.5 * self.hardening * self.plastic**2
        return 0.5 * N**2 / self.stiffness + stored + 0.5 * over**2 / self.hardening

    def yielded(self, e: Floats) -> Floats:
        """Plastic elongation ``p`` at the end of the step, where the next step starts."""
        trial = self.stiffness * (e - self.plastic) - self.hardening * self.plastic
        over = np.maximum(np.abs(trial) - self._limit(), 0.0)
        return self.plastic + np.sign(trial) * over / (self.stiffness + self.hardening)

    def _limit(self) -> Floats:
        # An infinite limit would give inf - inf.
        return np.minimum(self.limit, np.finfo(float).max)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrussSolution:
    """Result of `Truss.solve`.

    Attributes
    ----------
    displacement, force, reaction
        ``u (n,)``, bar forces ``(n_b,)`` and contact forces ``(n_c, d)``.
    converged
        Whether the change of the friction limits fell below the tolerance.
    bifunctional
        ``B`` (23) of each pass, ``(passes, 2)`` [work]: of the new ``u`` with the reactions
        of the pass before, and with its own, as `Truss.bifunctional` computes it.
    """

    displacement: Floats
    force: Floats
    reaction: Floats
    converged: bool
    bifunctional: Floats


class Truss:
    """Bars and contacts with friction, solved by displacements alone.

    Parameters
    ----------
    bars
        Law of the bars. The bars alone must make the structure stable.
    C
        Elongations ``e = C u``, ``(n_b, n)``.
    B, gap, mu
        As in `ContactProblem`; the tangential part of ``gap (n_c, d)`` is the history.
    load
        ``(n,)``, total.

    Raises
    ------
    TypeError, ValueError
        A wrong argument.
    """

    def __init__(
        self,
        bars: HardeningBars,
        C: MatrixLike,
        B: MatrixLike,
        load: ArrayLike,
        *,
        gap: ArrayLike,
        mu: ArrayLike,
    ) -> None:
        if not isinstance(bars, HardeningBars):
            raise TypeError(f"bars is a {type(bars).__name__}, expected HardeningBars")
        self.bars = bars
        self._C = csr("C", C).matrix.toarray()
        self._B = csr("B", B).matrix.toarray()
        if self._C.shape[0] != len(bars.stiffness):
            raise ValueError(
                f"C has shape {self._C.shape}, expected {len(bars.stiffness)} rows, one "
                "for each bar"
            )
        n = self._C.shape[1]
        self._gap = floats("gap", gap, ndim=2)
        if self._B.shape != (self._gap.size, n):
            raise ValueError(
                f"B has shape {self._B.shape}, expected ({self._gap.size}, {n})"
            )
        self._load = floats("load", load, shape=(n,))
        self._mu = coulomb(mu, len(self._gap))
        elastic = self._C.T * bars.stiffness @ self._C
        # A penalty ten times the mean stiffness makes the multipliers converge quickly, and
        # costs the Newton matrix only one digit.
        self._rho = 10 * float(np.trace(elastic)) / n

    def relative_displacement(self, u: Floats) -> Floats:
        """``v = B u + gap``, ``(n_c, d)``."""
        return np.asarray((self._B @ u).reshape(self._gap.shape) + self._gap)

    def solve(self, *, tol: float = 1e-12, max_iterations: int = 200) -> TrussSolution:
        """Iterate (37), (38), starting without friction.

        Each pass minimises ``Σ V(C u) - load·u + Σ s ‖v_t‖`` over ``v_n >= 0``, with the
        friction limits ``s = μ r_n`` of the pass before. This is (37), because only these
        terms of ``β = V + W`` and ``b`` depend on ``u``. Its multipliers are the reactions
        (38b), and (38a) gives the forces of the bars.

        Reactions obey the limits of the pass before, so that they lie in the cone only when
        the iteration has converged. The step in ``u`` never increases ``B``; the update (38)
        may, because it minimises nothing.

        Parameters
        ----------
        tol
            Stop when the limits change by less, relative to the largest reaction.
        max_iterations
            Largest number of passes.

        Raises
        ------
        TypeError, ValueError
            A wrong argument.
        """
        tol = number("tol", tol)
        if not tol > 0:
            raise ValueError(f"tol is {tol}, expected a positive number")
        limit = integer("max_iterations", max_iterations, least=1)
        n = self._C.shape[1]
        u, r = np.zeros(n), np.zeros_like(self._gap)
        s = np.zeros(len(self._gap))
        history: list[tuple[float, float]] = []
        converged = False
        for _ in range(limit):
            last = r
            u, r = self._tresca(u, r, s)
            history.append((self.bifunctional(u, last), self.bifunctional(u, r)))
            before, s = s, self._mu * r[:, 0]
            if np.abs(s - before).max(initial=0.0) <= tol * np.abs(r).max(initial=0.0):
                converged = True
                break
        return TrussSolution(
            displacement=u,
            force=self.bars.force(self._C @ u),
            reaction=r,
            converged=converged,
            bifunctional=np.array(history),
        )

    def bifunctional(self, u: Floats, r: Floats) -> float:
        """``B`` (23) at ``u`` and at ``r``, scaled back into the cone.

        ``Σ V(C u) + W(N) - N·C u + Σ r·ṽ``, where the bar forces ``N`` are in equilibrium
        with the load and these reactions. If ``u`` does not penetrate, ``B`` is not
        negative, and zero at a solution only.
        """
        held = r.copy()
        held[:, 0] = np.maximum(r[:, 0], 0.0)
        drag = np.linalg.norm(r[:, 1:], axis=1)
        limit = self._mu * held[:, 0]
        share = np.divide(limit, drag, where=drag > limit, out=np.ones(len(r)))
        held[:, 1:] *= share[:, None]
        w = self._newton(u, self._load + self._B.T @ held.ravel(), None)
        e, N = self._C @ u, self.bars.force(self._C @ w)
        body = float(np.sum(self.bars.potential(e) + self.bars.dual(N) - N * e))
        v = self.relative_displacement(u)
        slip = np.linalg.norm(v[:, 1:], axis=1)
        return body + float(np.sum(held * v) + np.sum(limit * slip))

    def _tresca(self, u: Floats, r: Floats, s: Floats) -> tuple[Floats, Floats]:
        """Minimise the convex function of (37) by augmented multipliers, [dSF91, IV]."""
        for _ in range(_MULTIPLIERS):
            u = self._newton(u, self._load, (r, s))
            before, r = r, self._project_reactions(r, u, s)[0]
            change = np.abs(r - before).max(initial=0.0)
            if change <= 1e-14 * np.abs(r).max(initial=0.0):
                break
        return u, r

    def _project_reactions(
        self, r: Floats, u: Floats, s: Floats
    ) -> tuple[Floats, Floats]:
        """Projection of ``r - rho v`` onto ``r_n >= 0``, ``‖r_t‖ <= s``, and its derivative."""
        x = r - self._rho * self.relative_displacement(u)
        contacts, d = x.shape
        slope = np.zeros((contacts, d, d))
        out = x.copy()
        out[:, 0] = np.maximum(x[:, 0], 0.0)
        slope[:, 0, 0] = x[:, 0] > 0
        drag = np.linalg.norm(x[:, 1:], axis=1)
        for i in range(contacts):
            across = np.eye(d - 1)
            if drag[i] > s[i]:
                m = x[i, 1:] / drag[i]
                out[i, 1:] = s[i] * m
                across = s[i] / drag[i] * (across - np.outer(m, m))
            slope[i, 1:, 1:] = across
        return out, slope

    def _newton(
        self, u: Floats, load: Floats, held: tuple[Floats, Floats] | None
    ) -> Floats:
        """Minimise ``Σ V(C u) - load·u``, with augmented contact terms if ``held`` is given.

        The function is convex. In the plane its derivative is piecewise linear, and Newton's
        method with a line search ends at the minimum after finitely many steps.
        """
        C, B, rho = self._C, self._B, self._rho
        contacts, d = self._gap.shape

        def parts(at: Floats) -> tuple[float, Floats, Floats]:
            e = C @ at
            N = self.bars.force(e)
            value = float(self.bars.potential(e).sum() - load @ at)
            slope = C.T @ N - load
            size = np.abs(C.T) @ np.abs(N) + np.abs(load)
            if held is not None:
                r, _ = self._project_reactions(held[0], at, held[1])
                # The Moreau envelope of the support function: ‖x‖² - ‖x - r‖².
                x = held[0] - rho * self.relative_displacement(at)
                value += float(np.sum(r * (2 * x - r))) / (2 * rho)
                slope = slope - B.T @ r.ravel()
                size = size + np.abs(B.T) @ np.abs(r).ravel()
            return value, slope, size

        value, slope, size = parts(u)
        for _ in range(_NEWTON):
            if (np.abs(slope) <= 1e-15 * size).all():
                break
            H = C.T * self.bars.tangent(C @ u) @ C
            if held is not None:
                _, derivative = self._project_reactions(held[0], u, held[1])
                blocks = B.reshape(contacts, d, -1)
                H += rho * np.einsum("ika,ikl,ilb->ab", blocks, derivative, blocks)
            step = np.linalg.solve(H, -slope)
            worst = float(np.abs(slope).max())
            for _ in range(_HALVINGS):
                new = parts(u + step)
                # The value must fall or, where its change is rounding, the gradient.
                if new[0] < value or float(np.abs(new[1]).max()) < 0.5 * worst:
                    break
                step = step / 2
            else:
                break
            u = u + step
            value, slope, size = new
        return u
