"""Errors carry their kind and fields, also in a pickle and with another message."""

import pickle

import numpy as np
import pytest

import bipot_rs as bp
import bipot_rs._core as _core
from bipot_rs.contact.errors import with_message
from bipot_rs.contact.law.contact_law import ContactLaw

ISLAND = [([0], np.eye(2).ravel(), None)]
GAP = np.array([[1.0, 0.0]])


def refused(mu: float = 0.5, modes: int = 0) -> Exception:
    """The error of a reduced problem of one contact."""
    with pytest.raises((ValueError, bp.BipotError)) as caught:
        _core.Reduced(
            ISLAND,
            GAP,
            ContactLaw(np.array([mu])),
            (np.zeros(3, np.int64), np.zeros(0, np.int64), np.zeros(0)),
            np.zeros(modes),
        )
    return caught.value


@pytest.mark.parametrize(
    ("error", "kind", "fields"),
    [
        (refused(mu=-1.0), "friction", {"node": 0, "mu": -1.0}),
        (refused(modes=1), "dependent_motion", {"mode": 0}),
    ],
)
def test_an_error_of_the_core(
    error: Exception, kind: str, fields: dict[str, object]
) -> None:
    pickled = pickle.loads(pickle.dumps(error))
    reworded = with_message(error, "in other words")
    assert str(reworded) == "in other words"
    assert str(pickled) == str(error) != str(reworded)
    for same in (error, pickled, reworded):
        assert type(same) is type(error)
        assert vars(same).items() >= {"kind": kind, **fields}.items()


def test_the_load_step_of_an_error() -> None:
    problem = bp.ContactProblem(
        np.eye(2), np.eye(2), gap=[1.0], mu=0.5, fixed=[0, 1], dim=2
    )
    with pytest.raises(bp.NoEquilibriumError) as caught:
        problem.solve(prescribed=[[0.0, 0.0], [-2.0, 0.0]])
    error = caught.value
    assert (error.step, error.kind, error.node) == (2, "contradictory_contact", 0)
    assert str(error) == f"load step 2: {error.reason}"
    assert error.result is not None
    assert error.result.message == str(error)
    assert error.at_step(5, 9) == f"load step 5 of 9: {error.reason}"
