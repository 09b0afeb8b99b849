"""Random load paths of every kind, and their derivatives by finite differences."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp

Array = NDArray[np.float64]
KINDS = (
    "held",
    "prescribed",
    "floating",
    "bodies",
    "elliptic",
    "frictionless",
    "moving",
    "continued",
    "working set",
    "mortar",
)
# Fields of a result that have derivatives.
FIELDS = ("reaction", "displacement", "relative_displacement", "slip")
# η of the solutions that are compared: the last Newton step leaves rounding.
TOL = 1e-13


@dataclass(frozen=True)
class Data:
    """The data of a load path; adding a direction gives a neighbour."""

    load: Array
    prescribed: Array
    gap: Array
    mu: Array
    K: Array

    def moved(self, by: "Data", amount: float) -> "Data":
        return Data(
            *(
                getattr(self, name) + amount * getattr(by, name)
                for name in ("load", "prescribed", "gap", "mu", "K")
            )
        )


@dataclass(frozen=True)
class Given:
    """A problem without its data."""

    B: Array
    fixed: Array
    gap: Array
    per_step: bool = False
    more: dict[str, Any] = field(default_factory=dict)
    before: bp.Result | None = None

    def problem(self, data: Data) -> bp.ContactProblem:
        return bp.ContactProblem(
            sparse.csr_array(data.K),
            sparse.csr_array(self.B),
            gap=self.gap if self.per_step else data.gap,
            mu=data.mu,
            fixed=self.fixed,
            num_threads=1,
            engine="direct",
            **self.more,
        )

    def solve(self, data: Data) -> bp.Result:
        gap = data.gap if self.per_step else None
        return self.problem(data).solve(
            data.load, data.prescribed, tol=TOL, gap=gap, start=self.before
        )


def random_path(kind: str, d: int, seed: int) -> tuple[Given, Data]:
    """A problem of one to four contacts and a path of one to four steps; `kind` is of `KINDS`."""
    rng = np.random.default_rng([KINDS.index(kind), d, seed])
    contacts, steps = int(rng.integers(1, 5)), int(rng.integers(1, 5))
    m = d * contacts
    n = m + int(rng.integers(1, 4))
    B = np.zeros((m, n))
    B[:, :m] = np.eye(m)
    fixed = np.empty(0, np.int64)
    more: dict[str, Any] = {}
    if kind == "floating":
        K, B = _floating(rng, contacts, d)
        n = len(K)
    elif kind == "bodies":
        # Two bodies, each with the contact nodes of its side.
        n = 2 * m
        K = np.zeros((n, n))
        K[:m, :m], K[m:, m:] = _definite(rng, m), _definite(rng, m)
        B = np.hstack([np.eye(m), -np.eye(m)])
    else:
        K = _definite(rng, n)
        if kind in ("mortar", "prescribed"):
            B += 0.2 * rng.normal(size=B.shape)
    if kind == "prescribed":
        fixed = np.sort(rng.choice(np.arange(m, n), size=1))
    if kind == "working set":
        more["working_set"] = True
    mu = np.zeros(contacts)
    if kind != "frictionless":
        two = kind == "elliptic" and d == 3
        mu = rng.uniform(0.1, 0.7, (contacts, 2) if two else contacts)
    per_step = kind == "moving"
    gap = 0.3 * np.abs(rng.normal(size=(contacts, d)))
    gap[:, 1:] = 0.1 * rng.normal(size=(contacts, d - 1))
    path_problem = Given(B, fixed, gap, per_step, more)
    gaps = gap + 0.2 * rng.normal(size=(steps, contacts, d)) if per_step else gap
    load = _loads(rng, kind, B, contacts, d, steps)
    prescribed = 0.5 * rng.normal(size=(steps, len(fixed)))
    data = Data(load, prescribed, gaps, mu, K)
    if kind == "continued":
        first = path_problem.solve(data)
        path_problem = replace(path_problem, before=first)
        data = replace(data, load=data.load + _loads(rng, kind, B, contacts, d, steps))
    return path_problem, data


def _definite(rng: np.random.Generator, n: int) -> Array:
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    K = root @ root.T + 0.5 * np.eye(n)
    return (K + K.T) / 2


def _floating(rng: np.random.Generator, contacts: int, d: int) -> tuple[Array, Array]:
    """Springs between contact nodes, which leave all translations free."""
    m = d * contacts
    K = np.zeros((m + d, m + d))
    for i in range(contacts + 1):
        for j in range(i):
            pair = np.zeros((d, m + d))
            pair[:, d * i : d * i + d] = np.eye(d)
            pair[:, d * j : d * j + d] = -np.eye(d)
            K += pair.T @ np.diag(rng.uniform(1, 2, d)) @ pair
    return K, np.eye(m + d)[:m]


def _loads(
    rng: np.random.Generator, kind: str, B: Array, contacts: int, d: int, steps: int
) -> Array:
    """Pressure that changes and sometimes ends, and tangential loads that turn round."""
    pushed = rng.normal(size=(steps, contacts, d))
    pushed[:, :, 0] = -1.5 + pushed[:, :, 0]
    load = pushed.reshape(steps, -1) @ B + 0.1 * rng.normal(size=(steps, B.shape[1]))
    if kind == "floating":
        # Pressed on all contacts, with a tangential load inside the cones.
        load = np.zeros((steps, B.shape[1]))
        middle = rng.uniform(0.5, 1.5, (steps, contacts))
        for i in range(contacts):
            load[:, d * i] = -middle[:, i]
            load[:, d * i + 1 : d * i + d] = 0.08 * rng.normal(size=(steps, d - 1))
    return load


def random_direction(data: Data, seed: int) -> Data:
    """Changes of all data."""
    rng = np.random.default_rng([7, seed])
    change = rng.normal(size=data.K.shape)
    # On the pattern of K, and without work on the rigid motions of a floating body.
    change = 0.05 * (change + change.T) * (data.K != 0)
    sizes = np.linalg.svd(data.K, compute_uv=False)
    if sizes.min() < 1e-12 * sizes.max():
        change = 0.05 * data.K
    return Data(
        rng.normal(size=data.load.shape),
        rng.normal(size=data.prescribed.shape),
        0.3 * rng.normal(size=data.gap.shape),
        0.1 * rng.normal(size=data.mu.shape) * (data.mu > 0),
        change,
    )


def jvp(result: bp.Result, by: Data) -> Any:
    return result.jvp(by.load, by.prescribed, by.gap, by.mu, K=by.K)


def differences(
    solve: Callable[[float], bp.Result], h: float, names: tuple[str, ...] = FIELDS
) -> dict[str, Array] | None:
    """Central differences of the fourth order; None if a status changes.

    ``solve(t)`` is the result at the data moved by ``t`` times the direction.
    """
    results = [solve(t * h) for t in (-2, -1, 1, 2)]
    if any((r.status != results[0].status).any() for r in results):
        return None
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12 * h)
    return {
        name: sum(w * getattr(r, name) for w, r in zip(weights, results, strict=True))
        for name in names
    }


def apart(found: Any, expected: dict[str, Array]) -> float:
    """Largest difference of derivatives, each relative to the largest of its field."""
    worst, least = (
        0.0,
        1e-3 * max(np.abs(e).max(initial=0.0) for e in expected.values()),
    )
    for name, reference in expected.items():
        size = max(np.abs(reference).max(initial=0.0), least)
        off = np.abs(getattr(found, name) - reference).max(initial=0.0)
        worst = max(worst, off / size if size else off)
    return worst


def cotangents(result: bp.Result, seed: int) -> dict[str, Array]:
    rng = np.random.default_rng([11, seed])
    return {name: rng.normal(size=getattr(result, name).shape) for name in FIELDS}


def products(gradient: Any, by: Data) -> float:
    """⟨vjp, d⟩."""
    names = ("load", "prescribed", "gap", "mu")
    terms = (np.sum(getattr(gradient, name) * getattr(by, name)) for name in names)
    return float(sum(terms) + (gradient.K * sparse.csr_array(by.K)).sum())


def solvable(
    seeds: Iterable[int], kinds: tuple[str, ...] = KINDS
) -> Iterator[tuple[str, Given, Data, bp.Result, int]]:
    """The random paths of some seeds that have a solution: all kinds in turn."""
    for seed in seeds:
        kind, d = kinds[seed % len(kinds)], 2 + (seed // len(kinds)) % 2
        try:
            path_problem, data = random_path(kind, d, seed)
            result = path_problem.solve(data)
        except bp.BipotError:
            continue
        yield f"{kind}, d = {d}, seed {seed}", path_problem, data, result, seed
