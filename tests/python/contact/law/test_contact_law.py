"""`ContactLaw`: what makes another problem of a law loses none of its numbers."""

import pickle
from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.fclib import GlobalProblem

NUMBERS = [field.name for field in fields(ContactLaw) if field.name != "mu"]
LOAD = np.array([-4.0, 1.0, -4.0, 1.0])


def problem(**law: list[float]) -> bp.ContactProblem:
    return bp.ContactProblem(np.eye(4), np.eye(4), gap=[0.0, 0.0], mu=0.5, **law)


def reduced(**law: list[float]) -> bp.ReducedProblem:
    return bp.ReducedProblem(np.eye(4), -np.ones((2, 2)), 0.5, **law)


def of_global(skew: float, **law: list[float]) -> ContactLaw:
    """That of the local form, by the condensation or by LU."""
    M = np.eye(4)
    M[0, 2] = skew
    made = GlobalProblem(M, np.eye(4), LOAD, np.zeros((2, 2)), 0.5, **law)
    return made.reduced().law


MADE: dict[str, Callable[..., ContactLaw]] = {
    "problem": lambda **law: problem(**law).contacts.law,
    "pickled": lambda **law: pickle.loads(pickle.dumps(problem(**law))).contacts.law,
    "step": lambda **law: problem(**law).reduced(LOAD).law,
    "reduced": lambda **law: reduced(**law).law,
    "pickled reduced": lambda **law: pickle.loads(pickle.dumps(reduced(**law))).law,
    "global": lambda **law: of_global(0.0, **law),
    "global, asymmetric": lambda **law: of_global(0.125, **law),
    "other friction": lambda **law: problem(**law).contacts.law.with_mu(0.25, 2),
}


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("made", MADE)
def test_no_number_of_the_law_is_lost(made: str, name: str) -> None:
    law = MADE[made](**{name: [0.0, 0.125]})
    np.testing.assert_array_equal(getattr(law, name), [0.0, 0.125])
    assert not law.is_coulomb
    with pytest.raises(ValueError, match=f"it does not take {name}, which is 0.125"):
        law.require_coulomb("it")


@pytest.mark.parametrize("name", NUMBERS)
def test_the_law_of_a_path_with_other_friction(name: str) -> None:
    """`solve(mu=)` is the problem with these coefficients."""
    law = {name: [0.0, 0.125]}
    own = problem(**law)
    before = own.solve(LOAD).reaction
    one = own.solve(LOAD, mu=[0.125, 0.125])
    # The problem keeps its own.
    np.testing.assert_array_equal(own.solve(LOAD).reaction, before)
    assert not np.array_equal(one.reaction, before)
    other = bp.ContactProblem(np.eye(4), np.eye(4), gap=[0.0, 0.0], mu=0.125, **law)
    np.testing.assert_array_equal(one.reaction, other.solve(LOAD).reaction)
    np.testing.assert_array_equal(one.contacts[name], law[name])
