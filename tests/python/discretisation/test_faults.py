"""A fault that cohesion holds; its closed forms without and with slip are in `cases.faults`."""

import numpy as np
import pytest

import bipot_rs as bp
from cases.faults import reservoir
from support.comparisons import near


def test_cohesion_holds_the_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """With an initial compression of 22 MPa, all between -a and a slips without it."""
    monkeypatch.setattr(reservoir, "INITIAL", 22e6)
    held = reservoir.solve(4, 1, reservoir.COHESION, reservoir.depletion)
    loose = reservoir.solve(4, 1, 0, reservoir.depletion)
    assert (held.result.status[-1] == bp.Status.STICK).all()
    assert not held.result.broken.any()
    # Neither more nor less shear than that of an intact fault.
    stronger = reservoir.solve(4, 1, 1e3 * reservoir.COHESION, reservoir.depletion)
    near(held.traction, stronger.traction, 1e-8 * 22e6)
    inside = np.abs(loose.z) <= reservoir.A
    assert (loose.slip[inside] < -0.02).all()  # m, downwards
