"""The choice of the engine by a forecast of time and memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bipot_rs._lib.messages import size
from bipot_rs.contact import tuning

if TYPE_CHECKING:
    from bipot_rs._lib.types import CsrMatrix

ENGINES = ("auto", "direct", "iterative")

# Methods that the iterative engine has: semismooth Newton.
METHODS = ("auto", "newton")

# Bytes of the entries of W for each pair of contacts in space.
_PAIR = 72


def check_method(method: str, engine: str) -> None:
    """Refuse a method that an engine in the displacements does not have."""
    if method not in METHODS:
        raise ValueError(
            f"method is {method!r}, but engine={engine!r} has only "
            f"{' and '.join(map(repr, METHODS))}: use engine='direct'"
        )


def joins_surfaces(operator: CsrMatrix, d: int) -> bool:
    """Whether the contacts of B have more nodes than the two of a matching pair, as of mortar."""
    # The engines are named where the help of commands must not load NumPy.
    import numpy as np

    rows, n = operator.shape
    row = np.repeat(np.arange(rows), np.diff(operator.indptr))
    return len(np.unique(row // d * n + operator.indices // d)) > 2 * (rows // d)


def forecast_bytes(free: int, contacts: int) -> float:
    """Forecast of the memory of the direct engine in space."""
    return float(
        tuning.FACTOR_BYTES * (free / 1e6) ** tuning.FACTOR_GROWTH
        + _PAIR * float(contacts) ** 2
    )


def choose_engine(
    engine: str,
    d: int,
    free: int,
    contacts: int,
    steps: int | None,
    available: float | None,
    *,
    method: str = "auto",
    needs_compliance: bool = False,
    before: str | None = None,
    copies: int = 0,
) -> tuple[str, str]:
    """Choose the engine of a load path, and say why.

    ``engine``: the one asked for. ``d, free, contacts, steps``: dimension, number of free degrees
    of freedom, of contacts and of load steps; without ``steps`` the choice may be ``"auto"``.
    ``available``: bytes that the direct engine may use; None if unknown.
    ``method``: that of the load steps. ``needs_compliance``: whether the problem has options of
    the direct engine. ``before``: the engine of the step that the path continues from.
    ``copies``: contacts without a node of their own, as of mortar of second order. Their
    statuses may not settle: 7,098 unknowns took 15 s by iteration, and 0.1 s directly.
    Raises `ValueError`: the engine asked for does not have the method.

    >>> choose_engine("auto", 3, 12_000, 400, None, 8e9)
    ('direct', 'a small problem, factorised once')
    >>> choose_engine("auto", 3, 148_000, 1369, None, 8e9)
    ('auto', 'the load path decides')
    >>> choose_engine("auto", 3, 148_000, 1369, 2, 8e9)
    ('iterative', 'a factorisation would take longer than 2 load steps')
    >>> choose_engine("auto", 3, 148_000, 1369, 200, 8e9)
    ('iterative', 'with 1369 contacts a direct load step takes longer')
    >>> choose_engine("auto", 3, 148_000, 400, 200, 8e9)
    ('direct', 'one factorisation serves 200 load steps')
    >>> choose_engine("auto", 3, 148_000, 1369, 2, 8e9, copies=1369)
    ('direct', 'most contacts have no node of their own')
    >>> choose_engine("auto", 3, 1_060_000, 5041, 100, 8e9)
    ('iterative', 'the factor would take 33.2 GB of 8 GB')
    """
    if engine == "iterative":
        check_method(method, engine)
    if engine != "auto":
        return engine, "it was asked for"
    if d == 2:
        return "direct", "the problem is plane"
    if free < tuning.LEAST_ITERATIVE:
        return "direct", "a small problem, factorised once"
    if needs_compliance:
        return "direct", "loads or working_set is given"
    if method not in METHODS:
        return "direct", f"the method {method!r} needs W"
    if steps is None:
        return "auto", "the load path decides"
    if before is not None:
        return before, "it solved the step that the path continues from"
    needed = forecast_bytes(free, contacts)
    if available is not None and needed > available:
        return (
            "iterative",
            f"the factor would take {size(needed)} of {size(available)}",
        )
    if 2 * copies > contacts:
        return "direct", "most contacts have no node of their own"
    plural = "load step" if steps == 1 else "load steps"
    if steps * tuning.DOFS_PER_STEP <= free:
        return "iterative", f"a factorisation would take longer than {steps} {plural}"
    if contacts >= tuning.MANY_CONTACTS:
        return "iterative", f"with {contacts} contacts a direct load step takes longer"
    return "direct", f"one factorisation serves {steps} {plural}"
