"""A problem holds its parts, and inherits nothing."""

import numpy as np

import bipot_rs as bp


def test_a_problem_holds_its_parts() -> None:
    assert bp.ContactProblem.__mro__ == (bp.ContactProblem, object)
    problem = bp.ContactProblem(np.eye(4), np.eye(4), gap=[0.0, 0.1], mu=0.3, fixed=[3])
    assert problem.contacts.shape == (2, 2)
    np.testing.assert_array_equal(problem.contacts.gap_by_component, [[0, 0], [0.1, 0]])
    assert (problem.loading.n, problem.loading.fixed) == (4, 1)
    assert problem.stiffness.options.free == 3
    contacts = problem.contacts
    # K has no entries between prescribed degrees of freedom then.
    problem.update(2 * np.eye(4))
    assert problem.contacts is contacts
    np.testing.assert_array_equal(problem.stiffness.core.stiffness()[2], [2.0] * 3)
