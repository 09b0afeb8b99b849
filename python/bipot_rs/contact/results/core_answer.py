"""What the core answers about one problem, as fields of `Solution`."""

from __future__ import annotations

from typing import Any

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact.law.status import Outcome


def read_solution_fields(raw: dict[str, Any]) -> dict[str, Any]:
    """Fields of `Solution` in the answer of the core."""
    taken = (
        "reaction",
        "relative_displacement",
        "status",
        "residual",
        "tolerance",
        "iterations",
        "work",
        "history",
        "bipotential_gap",
        "seconds",
    )
    rigid, free = raw["rigid_motion"], raw["free_motion"]
    sequence = raw.get("minimising_sequence")
    if sequence is not None:
        from bipot_rs.contact.results.minimising_sequence import read_sequence

        sequence = read_sequence(sequence, raw["reaction"].shape)
    return {name: raw[name] for name in taken} | {
        "outcome": Outcome(raw["outcome"]),
        "rigid_motion": rigid if len(rigid) else None,
        "stats": {"bytes_beside_W": raw["bytes_beside"]}
        | {name: raw[name] for name in ("newton", "krylov") if name in raw},
        "free_motion": free if len(free) else None,
        "minimising_sequence": sequence,
        "statuses_tried": raw["statuses_tried"],
    }


def find_opening(raw: dict[str, Any], mu: Floats) -> Floats:
    """Ratio of opening to slip that the free motion contains: mu for a proof, else zero.

    A proof lies in the dual cone; a direction of divergence is a displacement.
    """
    return mu if raw["outcome"] == Outcome.NO_EQUILIBRIUM else np.zeros_like(mu)
