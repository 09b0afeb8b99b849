"""One condensation for many loads, other values and other friction."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from support.bodies import block, uniform_shear
from support.comparisons import bits, near, refused

BODY = block([4.0, 2.0], [16, 8], 100.0, 0.3)
FIXED = np.concatenate([BODY.dofs(1, 2.0, k) for k in range(2)])


def problem(**more: Any) -> bp.ContactProblem:
    given = {"K": BODY.K, "B": BODY.B, "gap": BODY.gap, "mu": 0.4, "fixed": FIXED}
    return bp.ContactProblem(**given | {"area": BODY.area} | more)


def steps(count: int = 4) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    load = np.array([uniform_shear(BODY, 0.2, [0.05 * k]) for k in range(count)])
    moved = np.zeros((count, len(FIXED)))
    moved[:, FIXED % 2 == 1] = -0.01
    moved += 1e-4 * rng.normal(size=moved.shape)
    return load, moved


def test_known_loads_give_the_same_answer_without_the_factor() -> None:
    load, moved = steps()
    kept, dropped = problem(), problem(loads=(load, moved))
    # S has the same bits; loads pass the factor as a block and not one by one.
    for by_loads, other in (
        (dropped.solve(), kept.solve(load, moved)),
        (dropped.solve(load[1], moved[1]), kept.solve(load[1], moved[1])),
    ):
        assert np.array_equal(by_loads.status, other.status)
        size = np.abs(other.reaction).max()
        near(by_loads.reaction, other.reaction, 1e-10 * size)
    assert not dropped.stats["factor_kept"]
    assert kept.stats["factor_kept"]
    assert np.array_equal(dropped.compliance, kept.compliance)


def test_what_is_asked_without_the_factor() -> None:
    load, moved = steps()
    dropped = problem(loads=(load, moved))
    assert dropped.solve()[0].error_estimate is None
    with refused(r"displacements need the factor .* `loads=`"):
        _ = dropped.solve().displacement
    with refused("not among the loads given as `loads=`"):
        dropped.solve(load[0], 2 * moved[0])
    with refused("tuple of 3"):
        problem(loads=(load, moved, moved))


def test_displacements_are_saved_if_there_is_a_factor(tmp_path: Path) -> None:
    load, moved = steps()
    path = tmp_path / "r.h5"
    kept = problem()
    kept.solve(load, moved).save(path)
    whole = kept.solve(load, moved).displacement
    assert np.array_equal(bp.load(path).displacement, whole)
    lost = "displacement was not computed"
    for saved in (
        lambda: kept.solve(load, moved).save(path, displacements=False),
        lambda: problem(loads=(load, moved)).solve().save(path),
    ):
        saved()
        with refused(lost):
            _ = bp.load(path).displacement
    with refused(lost):
        bp.load(path).save(path, displacements=True)
    with refused("displacements need the factor"):
        problem(loads=(load, moved)).solve().save(path, displacements=True)
    bp.load(path).save(path)
    kept.solve(load, moved).save(path, displacements=True)
    assert np.array_equal(bp.load(path).displacement, whole)


def test_bodies_that_keep_their_factor() -> None:
    """A slender cantilever, whose cond(S) is about (length / height)^4; no supports."""
    beam = block([1.0, 0.01], [100, 2], 100.0, 0.3)
    ends = np.concatenate([beam.dofs(0, 0.0, k) for k in range(2)])
    slender = {"K": beam.K, "B": beam.B, "gap": beam.gap + 1e-5, "fixed": ends}
    slender["area"] = beam.area
    for given, load in (
        (slender, beam.weight([0.0, -1e-6])),
        ({"fixed": None}, uniform_shear(BODY, 0.2, [0.02])),
    ):
        with_loads = problem(**given, loads=load)
        assert with_loads.stats["factor_kept"]
        assert bits(with_loads.solve(), problem(**given).solve(load))
    assert problem(**slender, loads=beam.weight([0.0, -1.0])).stats["cond_S"] > 1e6


def test_a_body_without_a_factor_beside_one_that_has_lost_digits() -> None:
    """Corrections with K need the displacements of both."""
    beam = block([1.0, 0.01], [100, 2], 100.0, 0.3)
    ends = np.concatenate([beam.dofs(0, 0.0, k) for k in range(2)])
    n = BODY.K.shape[0]
    both = {
        "K": sparse.block_diag([BODY.K, beam.K]),
        "B": sparse.block_diag([BODY.B, beam.B]),
        "gap": np.concatenate([BODY.gap, beam.gap + 1e-5]),
        "fixed": np.concatenate([FIXED, n + ends]),
        "area": None,
    }
    load = np.concatenate(
        [uniform_shear(BODY, 0.2, [0.02]).ravel(), beam.weight([0.0, -1e-6])]
    )
    with_loads = problem(**both, loads=load)
    assert not with_loads.stats["keeps_digits"]
    assert with_loads.stats["factor_kept"]
    assert bits(with_loads.solve(), problem(**both).solve(load))


def test_updates_of_the_stiffness() -> None:
    """The same pattern needs no ordering; an update that fails changes nothing."""
    load, moved = steps()
    updated = problem()
    before = updated.solve(load, moved)
    # The times reported are those of the first analysis.
    ordered = updated.stats["seconds_order"]
    n = BODY.K.shape[0]
    softer = block([4.0, 2.0], [16, 8], 37.0, 0.2).K
    far = sparse.coo_array(([1e-9, 1e-9], ([0, n - 1], [n - 1, 0])), shape=(n, n))
    for K in (softer, sparse.csr_array(BODY.K + far)):
        updated.update(K)
        assert (updated.stats["seconds_order"] == ordered) == (K is softer)
        with refused("indefinite"):
            updated.update(-1.0 * BODY.K)
        with refused(r"K has shape .* expected"):
            updated.update(np.eye(3))
        assert bits(updated.solve(load, moved), problem(K=K).solve(load, moved))
    # Earlier results keep the stiffness that they were solved with.
    assert bits(before, problem().solve(load, moved))


def test_each_of_many_paths_equals_the_single_path() -> None:
    load, moved = steps()
    shared = problem()
    before = shared.solve(load[0], moved[0])
    mu = np.linspace(0, 1, len(BODY.gap))
    cases = [
        {"load": load, "prescribed": moved},
        {"load": load, "prescribed": moved, "mu": 0.1},
        {"load": load[2], "prescribed": moved[2], "start": before},
        {"prescribed": moved[1], "mu": mu},
        {},
    ]
    results = shared.solve_many(cases)
    assert [result.success for result in results] == [True] * 5
    # A displacement has the same bits alone as together with others.
    assert bits(results[0], shared.solve(load, moved))
    assert bits(results[1], problem(mu=0.1).solve(load, moved))
    assert bits(results[2], shared.solve(load[2], moved[2], start=before))
    varied = problem(mu=mu).solve(prescribed=moved[1])
    assert bits(results[3], varied)
    assert np.array_equal(results[1].contacts["mu"], np.full(len(BODY.gap), 0.1))
    # Each step uses the friction coefficients of its own case.
    assert results[3][0].unique == varied[0].unique


def test_a_path_that_fails_does_not_affect_the_others() -> None:
    free = problem(fixed=None)
    rests = uniform_shear(BODY, 0.2, [0.02])
    slides = uniform_shear(BODY, 0.2, [0.2])
    good, bad, none = free.solve_many(
        [
            {"load": rests},
            {"load": [rests, slides]},
            {"load": [rests, slides], "mu": 0.0},
        ]
    )
    assert good.success
    assert bits(good, free.solve(rests))
    assert not bad.success
    assert len(bad) == 1
    assert "load step 2" in bad.message
    assert not none.success
    assert len(none) == 0


@pytest.mark.parametrize(
    ("case", "error", "said"),
    [
        ({"mu": -1.0}, ValueError, r"case 1: mu"),
        ({"load": np.ones(3)}, ValueError, r"case 1: load has shape \(3,\)"),
        ({"loads": None}, TypeError, "case 1 has 'loads'"),
        (3, TypeError, "case 1 is a int"),
        ({"start": 3}, TypeError, "case 1: start is a int"),
    ],
)
def test_a_wrong_case_is_named(case: Any, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        problem().solve_many([{}, case])


def test_a_memory_limit_raises_before_the_work() -> None:
    needs = problem().stats["bytes_peak"]
    with pytest.raises(
        MemoryError,
        match=rf"needs {needs} bytes, more than the {needs - 1} of memory_limit",
    ):
        problem(memory_limit=needs - 1)
    assert problem(memory_limit=2**40).solve(*steps()).success
    assert problem(memory_limit=2 * needs).solve(*steps()).success
    with refused("memory_limit"):
        problem(memory_limit=0)
