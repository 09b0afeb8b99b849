"""Problems and solutions in another process: the same numbers to the bit.

A pickle holds the arguments of a problem. The receiver condenses them again and must
get the same bits, in every result.
"""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem

pytestmark = pytest.mark.needs_extra


def asked(problem: Any, load: Any, prescribed: Any) -> tuple[list[Any], Any]:
    """Numbers of a path, and its result."""
    result = problem.solve(load, prescribed)
    told = [result.reaction, result.relative_displacement, result.displacement]
    told += [result.residual, [step.error_estimate for step in result]]
    return [*told, problem.compliance, problem.rigid_motions], result


def bits(values: Any) -> list[bytes | str]:
    return [v.tobytes() if isinstance(v, np.ndarray) else repr(v) for v in values]


def block(**contact: Any) -> fem.Assembly:
    cells = np.linspace(0.0, 1.0, 9)
    body = fem.Body(
        "block", fem.box([cells, cells], "quadrilateral"), fem.Material(3.1e9, 0.3)
    )
    touching = fem.Contact(
        "block", "bottom", **({"mu": 0.4, "plane": ((0, 0), (0, 1))} | contact)
    )
    return fem.assemble([body], [touching], [fem.Support("block", "top", (0, 1))])


def supported() -> tuple[bp.ContactProblem, Any, Any]:
    """Prescribed displacements, areas, frames, coordinates and non-zero gaps."""
    model = block(clearance=lambda x: 1e-5 * x[:, 0] ** 2)
    moves = [model.prescribed([top]) for top in ((0, -1e-3), (4e-4, -1e-3))]
    return model.problem(num_threads=1), None, moves


def held_by_contact() -> tuple[bp.ContactProblem, Any, Any]:
    """No supports: K is singular, and the rigid motions are found again."""
    model = block()
    pressed = model.pressure("block", "top", 1e6)
    pulled = model.body_force("block", (1e5, 0.0))
    problem = bp.ContactProblem(model.K, model.B, gap=model.gap, mu=0.4)
    return problem, [pressed, pressed + pulled], None


def two_tangents() -> tuple[bp.ContactProblem, Any, Any]:
    """Friction that depends on direction is solved in scaled variables."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(12, 12))
    K = root @ root.T + 12 * np.eye(12)
    B = np.eye(9, 12)
    load = rng.normal(size=(2, 12)) - np.tile([2.0, 0, 0], 4)
    mu = np.array([[0.2, 0.4], [0.3, 0.3], [0.0, 0.0]])
    return bp.ContactProblem(K, B, gap=np.zeros(3), mu=mu, fixed=[11]), load, [[0.1]]


def known_loads() -> tuple[bp.ContactProblem, Any, Any]:
    """The factor was dropped, the stiffness was kept."""
    model = block()
    moves = np.array([model.prescribed([(0, -1e-3)])])
    problem = bp.ContactProblem(
        model.K, model.B, gap=model.gap, mu=0.4, fixed=model.fixed, loads=(None, moves)
    )
    return problem, None, moves


CASES = [supported, held_by_contact, two_tangents]


@pytest.mark.parametrize("case", CASES)
def test_pickles_of_problems_and_results(case: Any) -> None:
    problem, load, prescribed = case()
    numbers, result = asked(problem, load, prescribed)
    again = pickle.loads(pickle.dumps(problem))
    assert bits(asked(again, load, prescribed)[0]) == bits(numbers)
    # It was computed before pickling, so the copy has it; a copy that lost it says so.
    kept = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(kept[0].displacement, result.displacement[0])
    lost = pickle.loads(pickle.dumps(problem.solve(load, prescribed)))
    with pytest.raises(ValueError, match="displacement was not computed"):
        _ = lost[0].displacement


@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy])
def test_copies(copied: Any) -> None:
    problem, load, prescribed = supported()
    again = copied(problem)
    before = bits(asked(problem, load, prescribed)[0])
    assert bits(asked(again, load, prescribed)[0]) == before
    again.update(2 * block().K)
    assert bits(asked(problem, load, prescribed)[0]) == before


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy])
@pytest.mark.quick_variants("two_tangents")
def test_copies_of_results_have_derivatives(copied: Any, case: Any) -> None:
    problem, load, prescribed = case()
    result = problem.solve(load, prescribed)
    again = copied(result)
    direction = np.sin(np.arange(result.reaction[-1].size))
    gap = direction.reshape(result.reaction[-1].shape)
    change = result.jvp(gap=gap)
    told = [change.reaction, change.displacement, change.slip, result.displacement]
    change = again.jvp(gap=gap)
    assert bits([change.reaction, change.displacement, change.slip]) == bits(told[:3])
    assert bits([again.displacement, again[0].error_estimate]) == bits(
        [told[3], result[0].error_estimate]
    )
    again[0].reaction[:] = 0.0
    assert result[0].reaction.any() == (copied is copy.deepcopy)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.quick_variants("two_tangents")
def test_derivatives_in_another_process(case: Any) -> None:
    """What is computed on first use is computed before they are sent."""
    problem, load, prescribed = case()
    result = problem.solve(load, prescribed)
    tangent = result.jvp(mu=0.1)
    gradient = result.vjp(reaction=np.cos(result.reaction / result.reaction.max()))
    copies = pickle.loads(pickle.dumps((tangent, gradient)))
    for original, other in zip((tangent, gradient), copies, strict=True):
        for name in original.__dict__.keys() - {"result", "_recover", "_adjoint", "K"}:
            np.testing.assert_array_equal(
                getattr(other, name), getattr(original, name), err_msg=name
            )
    assert copies[0].displacement.any()
    assert (copies[1].K != gradient.K).nnz == 0
    assert copies[1].load.any()


def test_derivatives_without_a_factor_are_pickled_without_displacements() -> None:
    problem, _, _ = known_loads()
    result = problem.solve()
    tangent, gradient = pickle.loads(
        pickle.dumps((result.jvp(mu=0.1), result.vjp(reaction=result.reaction)))
    )
    assert tangent.reaction.any()
    assert gradient.mu.any()
    for asked_for in ("displacement", "load", "prescribed", "K"):
        with pytest.raises(ValueError, match="came from another process"):
            getattr(tangent if asked_for == "displacement" else gradient, asked_for)


def test_known_loads() -> None:
    problem, _, _ = known_loads()
    again = pickle.loads(pickle.dumps(problem))
    assert not again.stats["factor_kept"]
    np.testing.assert_array_equal(again.solve().reaction, problem.solve().reaction)


def test_the_current_stiffness_is_pickled() -> None:
    """Neither the caller's array, which may have changed since, nor the first stiffness."""
    model = block()
    K = model.K.copy()
    problem = bp.ContactProblem(K, model.B, gap=model.gap, mu=0.4, fixed=model.fixed)
    moves = model.prescribed([(4e-4, -1e-3)])
    problem.update(3.0 * K)
    K.data[:] = np.nan
    again = pickle.loads(pickle.dumps(problem))
    np.testing.assert_array_equal(
        again.solve(prescribed=moves).reaction, problem.solve(prescribed=moves).reaction
    )


def test_a_problem_is_no_larger_than_its_matrices() -> None:
    problem, _, _ = supported()
    # For each entry of K and B a value and an 8-byte column; the rest is small.
    entries = block().K.nnz + 2 * block().B.nnz
    assert len(pickle.dumps(problem)) <= 16 * entries + 60 * problem.stats["n"] + 4000


@pytest.mark.parametrize("kind", [np.asarray, sparse.csr_array])
def test_reduced_problems(kind: Any) -> None:
    W = np.array([[2, 0.5, 0.25, 0], [0.5, 1, 0, 0], [0.25, 0, 2, 0.5], [0, 0, 0.5, 1]])
    q = [[-1.0, 0.75], [-0.5, -2.0]]
    border = np.tile(np.eye(2), (2, 1)), [-3.0, 0.125]
    for rigid in (None, border):
        problem = bp.ReducedProblem(kind(W), q, [0.5, 0.25], rigid=rigid)
        again = pickle.loads(pickle.dumps(problem))
        mine, theirs = problem.solve(), again.solve()
        assert bits([mine.reaction, mine.residual]) == bits(
            [theirs.reaction, theirs.residual]
        )
        assert mine.rigid_motion is None or np.array_equal(
            mine.rigid_motion, theirs.rigid_motion
        )


def test_other_public_objects_are_pickled() -> None:
    """Bounds, verdicts, solutions, global problems: with every number they hold."""
    W, q = np.array([[2.0, 0.5], [0.5, 1.0]]), [[-1.0, 0.75]]
    problem = bp.ReducedProblem(W, q, 0.1)
    solution = problem.solve()
    for thing in (solution.error, problem.existence(), solution):
        again = pickle.loads(pickle.dumps(thing))
        for name, value in vars(thing).items():
            if name == "computed":
                assert repr(again.computed) == repr(value)
            elif name != "inquiry":
                np.testing.assert_equal(getattr(again, name), value)
    answers = problem.answers()
    again = pickle.loads(pickle.dumps(answers))
    assert again.complete is answers.complete
    np.testing.assert_array_equal(again[0].reaction, answers[0].reaction)
    whole = bp.fclib.GlobalProblem(np.eye(2), np.eye(2), [-1.0, 0.2], [[0, 0]], 0.3)
    mine, theirs = whole.solve(), pickle.loads(pickle.dumps(whole)).solve()
    np.testing.assert_array_equal(mine.reaction, theirs.reaction)
