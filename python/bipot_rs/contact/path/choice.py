"""The choice of the engine by a forecast of time and memory."""

from __future__ import annotations

from bipot_rs._lib.messages import size

ENGINES = ("auto", "direct", "iterative")

# Steps of an adaptive path between two stops.
ADAPTIVE_STEPS = 8

# Methods that the iterative engine has: semismooth Newton.
METHODS = ("auto", "newton")

# In space, from this number of free degrees of freedom on, the first load step takes less
# time by iteration (benches/results/scale.csv).
LEAST = 15_000
# A direct condensation takes as long as one iterative step for so many free degrees of
# freedom: its work grows with their square, that of a step in proportion.
PER_STEP = 1_500
# From this number of contacts on, a step of the direct engine, whose work grows with the
# cube of that number, takes longer than an iterative one.
MANY_CONTACTS = 1_000

# Work of an iterative load step for each degree of freedom [flop], in the units in which
# the direct engine does 20 Gflop/s on a core.
STEP_FLOPS = 2e5

# Model of the memory of the direct engine in space: the factor of a cube of 10⁶ degrees of
# freedom, and its growth; W takes 72 bytes for each pair of contacts.
_FACTOR, _GROWTH = 29e9, 1.34
_PAIR = 72


def check_method(method: str, engine: str) -> None:
    """Refuse a method that an engine in the displacements does not have."""
    if method not in METHODS:
        raise ValueError(
            f"method is {method!r}, but engine={engine!r} has only "
            f"{' and '.join(map(repr, METHODS))}: use engine='direct'"
        )


def direct_bytes(free: int, contacts: int) -> float:
    """Forecast of the memory of the direct engine in space."""
    return float(_FACTOR * (free / 1e6) ** _GROWTH + _PAIR * float(contacts) ** 2)


def choose(
    free: int, contacts: int, steps: int, available: float | None
) -> tuple[str, str]:
    """Choose the engine of a load path in space, and say why.

    Parameters
    ----------
    free, contacts, steps
        Number of free degrees of freedom, of contacts and of load steps.
    available
        Bytes that the direct engine may use; None if unknown.

    >>> choose(12_000, 400, 2, 8e9)
    ('direct', '12000 free degrees of freedom are few')
    >>> choose(148_000, 1369, 2, 8e9)
    ('iterative', 'a factorisation would take longer than 2 load steps')
    >>> choose(148_000, 1369, 200, 8e9)
    ('iterative', 'with 1369 contacts a direct load step takes longer')
    >>> choose(148_000, 400, 200, 8e9)
    ('direct', 'one factorisation serves 200 load steps')
    >>> choose(1_060_000, 5041, 100, 8e9)
    ('iterative', 'the factor would take 33.2 GB of 8 GB')
    """
    if free < LEAST:
        return "direct", f"{free} free degrees of freedom are few"
    needed = direct_bytes(free, contacts)
    if available is not None and needed > available:
        return (
            "iterative",
            f"the factor would take {size(needed)} of {size(available)}",
        )
    plural = "load step" if steps == 1 else "load steps"
    if steps * PER_STEP <= free:
        return "iterative", f"a factorisation would take longer than {steps} {plural}"
    if contacts >= MANY_CONTACTS:
        return "iterative", f"with {contacts} contacts a direct load step takes longer"
    return "direct", f"one factorisation serves {steps} {plural}"
