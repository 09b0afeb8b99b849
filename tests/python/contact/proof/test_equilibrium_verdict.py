"""Whether reactions balance the loads: verdicts as a linear programme, proofs without rounding."""

from time import perf_counter
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.optimize import linprog
from scipy.sparse import csr_array

import bipot_rs as bp
from bipot_rs.contact.proof.equilibrium import statics_of_rows
from support.bricks import lay_bricks
from support.contacts import rigid_rows
from support.heaps import is_carried, make_heap
from support.masonry import LIMITS, wall
from support.rational import excludes_balance
from support.whole_numbers import find_end, make_contacts

Array = NDArray[np.float64]


def rigid(
    R: Any, e: Array, mu: float | Array, d: int, **law: float | Array
) -> bp.ReducedProblem:
    """Rigid bodies: no compliance and no free displacement."""
    count = R.shape[0] // d
    nothing = csr_array((R.shape[0], R.shape[0]))
    return bp.ReducedProblem(nothing, np.zeros((count, d)), mu, rigid=(R, e), **law)


def check(problem: bp.ReducedProblem) -> str:
    """The verdict, after its proof has been checked."""
    found = problem.equilibrium()
    R, e = problem.rigid
    if found.verdict == "none":
        assert found.margin < 0
        assert np.isinf(found.excluded)
        d = problem.q.shape[1]
        assert excludes_balance(R, e, problem.mu, found.motion, d)
    if found.verdict == "balanced":
        # The default tolerance of a solution.
        assert problem.residual(found.reaction, np.zeros(len(e))) <= 1e-10
    return found.verdict


@pytest.mark.parametrize(
    "seeds", [range(12), pytest.param(range(5000), marks=pytest.mark.slow)]
)
def test_heaps_of_disks_are_decided_as_by_a_linear_programme(seeds: range) -> None:
    verdicts = []
    for seed in seeds:
        heap = make_heap(seed)
        if heap is None:
            continue
        problem = rigid(heap.R, heap.e, heap.mu, 2)
        verdict, solution = check(problem), problem.solve()
        assert (verdict == "balanced") == is_carried(heap), seed
        # Solved from the same programme, or refused with its proof and no other reason.
        assert solution.converged == is_carried(heap)
        assert "seems to slide away" not in solution.message
        verdicts.append(verdict)
    assert set(verdicts) == {"balanced", "none"}


@pytest.mark.parametrize("number", [1, 2, pytest.param(6, marks=pytest.mark.slow)])
def test_walls_are_decided_on_both_sides_of_their_limit(number: int) -> None:
    problem = bp.blocks.assemble(wall(number), 0.65)
    R, dead = problem.rigid
    live = problem.body_force((1.0, 0.0))
    limit = problem.limit_multiplier(dead, live)
    assert limit.upper == pytest.approx(LIMITS[number], abs=1e-6)
    # Programmes end at 1e-12; the proof takes up to 1e-7.
    assert limit.upper * (1 - 1e-6) <= limit.reached <= limit.upper
    # The mechanism proves the bound, without rounding.
    above = dead + limit.upper * (1 + 1e-14) * live
    assert excludes_balance(R, above, 0.65, limit.mechanism, 2)
    for factor, verdict in ((1 - 1e-6, "balanced"), (1 + 1e-6, "none")):
        load = dead + factor * limit.upper * live
        assert check(rigid(R, load, 0.65, 2)) == verdict


def block(load: Array, mu: float | Array) -> bp.ReducedProblem:
    """A cube of side 2 on a plane, on its four corners."""
    corners = np.array([[-1.0, -1, -1], [-1, 1, -1], [1, -1, -1], [1, 1, -1]])
    return rigid(rigid_rows(corners), load, mu, 3)


def test_a_block_with_two_coefficients_slides_on_an_ellipse() -> None:
    # Along (cos, sin) the friction of a weight of 1 is that of an ellipse with half-axes
    # 0.3 and 0.2, where no corner lifts.
    mu = np.tile([0.3, 0.2], (4, 1))
    for angle in np.linspace(0, 2 * np.pi, 7):
        side = np.array([np.cos(angle), np.sin(angle)])
        largest = 1 / np.hypot(side[0] / 0.3, side[1] / 0.2)
        for factor, verdict in ((0.999999, "balanced"), (1.000001, "none")):
            load = np.zeros(6)
            load[:2], load[2] = factor * largest * side, -1.0
            # It is pulled at its foot.
            load[3:] = np.cross([0, 0, -1.0], load[:3] * [1, 1, 0])
            assert check(block(load, mu)) == verdict, angle


@pytest.mark.parametrize("side", [0.0, 1e-6])
def test_nothing_holds_a_block_without_friction_against_a_sideways_load(
    side: float,
) -> None:
    load = np.array([side, 0.0, -1.0, 0.0, -side, 0.0])
    assert check(block(load, 0.0)) == ("none" if side else "balanced")


def test_a_wedge_presses_itself() -> None:
    # A disk between two walls: reactions balance each other without loads, and no motion
    # opens both contacts. Friction carries any weight.
    R = np.array([[1.0, 0, 0], [0, 1, 1], [-1, 0, 0], [0, -1, 1]])
    down = np.array([0.0, -1.0, 0.0])
    assert check(rigid(R, down, 0.3, 2)) == "balanced"
    assert check(rigid(R, down, 0.0, 2)) == "none"

    # Turned, rounding hides the motion; the proof excludes what is not rounding.
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    turned = rigid(R @ turn, turn.T @ down, 0.0, 2).equilibrium()
    assert turned.verdict == "none"
    assert turned.excluded > 1e9


def test_a_motion_on_the_border_of_a_dual_cone_is_a_proof() -> None:
    # The only motion slides at exactly the angle of friction.
    R = np.array([[5.0], [-3.0], [4.0]])
    assert check(rigid(R, np.array([3.0]), 1.0, 3)) == "none"
    assert check(rigid(R, np.array([-3.0]), 1.0, 3)) == "balanced"


@pytest.mark.parametrize("seed", range(20))
def test_contacts_that_hold_each_other_hide_no_verdict(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motions = int(rng.integers(2, 5))
    contacts = int(rng.integers(motions + 1, 8))
    R = rng.normal(size=(2 * contacts, motions))
    # Without friction; the first two hold each other.
    R[2] = -rng.uniform(0.5, 2) * R[0]
    e = 10 * rng.normal(size=motions)
    problem = rigid(R, e, 0.0, 2)
    carried = linprog(
        np.zeros(len(R) // 2), A_eq=R[::2].T, b_eq=-e, method="highs"
    ).success
    found = problem.equilibrium()
    assert found.verdict == ("balanced" if carried else "none")
    limit = problem.limit_multiplier(np.zeros(len(e)), e)
    assert limit.reached == (np.inf if carried else 0.0)
    # The bound is the share of the live load at which it is tried.
    assert limit.upper == np.inf if carried else limit.upper < 1e-8
    if not carried:
        # Without rounding the motion would exclude all reactions.
        assert found.excluded > 1e9
        assert limit.excluded > 1e9


@pytest.mark.parametrize(
    "seeds", [range(40), pytest.param(range(150), marks=pytest.mark.slow)]
)
def test_limits_of_contacts_that_hold_each_other(seeds: range) -> None:
    """A proof that excludes few reactions is 1e-4 of the loads above the limit at most."""
    loose = 0
    for seed in seeds:
        R, dead, mu = make_contacts(seed)
        live = np.random.default_rng(10**6 + seed).integers(-2, 3, R.shape[1])
        live = live.astype(float)
        if not np.abs(R).sum(axis=0).all() or not live.any():
            continue
        limit = rigid(R, dead, mu, 2).limit_multiplier(dead, live)
        exact = -find_end(-np.eye(2 * len(mu) + 1)[-1], R, dead, live, mu)
        size = 1 + exact if np.isfinite(exact) else 1.0
        np.testing.assert_allclose(limit.upper, exact, atol=2e-4 * size)
        # The tolerance of HiGHS.
        np.testing.assert_allclose(limit.reached, exact, atol=1e-7 * size)
        loose += np.isfinite(exact) and limit.upper > exact + 1e-6 * size
    assert loose <= 2  # of 144


def test_without_rigid_motions_nothing_is_to_be_balanced() -> None:
    free = bp.ReducedProblem(np.eye(2), [[1.0, 0.0]], 0.5).equilibrium()
    assert free.verdict == "balanced"
    assert free.margin == np.inf


def test_groups_do_not_hide_each_other() -> None:
    heavy, light = make_heap(0), make_heap(1)
    R = np.zeros((len(heavy.R) + len(light.R), len(heavy.e) + len(light.e)))
    R[: len(heavy.R), : len(heavy.e)] = heavy.R
    R[len(heavy.R) :, len(heavy.e) :] = light.R
    mu = np.repeat([heavy.mu, light.mu], [len(heavy.R) // 2, len(light.R) // 2])
    e = np.concatenate([1e9 * heavy.e, light.e])
    carried = is_carried(heavy) and is_carried(light)
    assert check(rigid(R, e, mu, 2)) == ("balanced" if carried else "none")


def test_a_live_load_that_contact_always_carries_has_no_limit() -> None:
    problem = block(np.zeros(6), 0.5)
    dead, live = np.zeros(6), np.zeros(6)
    dead[2] = live[2] = -1.0
    limit = problem.limit_multiplier(dead, live)
    assert limit.upper == np.inf
    assert limit.reached == np.inf
    assert limit.mechanism is None
    side = dead + np.array([0.6, 0, 0, 0, -0.6, 0])
    with pytest.raises(bp.NoEquilibriumError, match="e0 alone"):
        problem.limit_multiplier(side, live)


def test_a_heavier_foot_does_not_depend_on_units_or_numbering() -> None:
    heap = make_heap(4)
    order = np.random.default_rng(0).permutation(len(heap.R) // 2)
    rows = (2 * order[:, None] + [0, 1]).ravel()
    here = rigid(heap.R, heap.e, heap.mu, 2).equilibrium()
    there = rigid(heap.R[rows], 1e7 * heap.e, heap.mu, 2).equilibrium()
    assert here.verdict == there.verdict
    assert there.margin == pytest.approx(1e7 * here.margin, rel=1e-7)


def test_a_sparse_R_is_taken_as_a_dense_one() -> None:
    heap = make_heap(2)
    dense = rigid(heap.R, heap.e, heap.mu, 2)
    sparse = bp.ReducedProblem(
        dense.W, dense.q, heap.mu, rigid=(csr_array(heap.R), heap.e)
    )
    one, other = dense.equilibrium(), sparse.equilibrium()
    assert one.verdict == other.verdict
    assert one.margin == other.margin
    still = csr_array(np.column_stack([heap.R[:, 0], 0 * heap.R[:, 0]]))
    with pytest.raises(bp.FloatingBodyError, match="rigid motion 1 moves no contact"):
        bp.ReducedProblem(dense.W, dense.q, heap.mu, rigid=(still, heap.e[:2]))


@pytest.mark.parametrize("kind", [int, np.float32, bool])
def test_a_sparse_R_may_hold_other_numbers(kind: type) -> None:
    R = csr_array(np.array([[1, 0], [0, 1]]).astype(kind))
    assert check(rigid(R, np.array([-1.0, 0.5]), 0.5, 2)) == "balanced"


def test_cohesion_holds_a_block_beyond_friction() -> None:
    # Two corners hold 0.5 of the weight 1, and 0.1 each, at most.
    R = np.array([[1.0, 0, -1], [0, 1, 1], [1, 0, 1], [0, 1, 1]])
    friction, cohesion = np.tile([0.0, 0.5], 2), np.full(2, 0.1)
    statics = statics_of_rows(R, [2, 2], friction, cohesion)
    for side, verdict in ((0.7 - 1e-6, "balanced"), (-0.7 - 1e-6, "none")):
        load = np.array([-1.0, side, 0.0])
        decision = statics.decide(load)
        assert decision.verdict == verdict
        if verdict == "none":
            assert excludes_balance(R, load, 0.5, decision.motion, 2, cohesion=0.1)
    limit = statics.find_limit(np.array([-1.0, 0, 0]), np.array([0.0, 1, 0]))
    assert limit.upper == pytest.approx(0.7, rel=1e-7)
    # Without friction, cohesion alone; a weight may be as large as it likes.
    bare = statics_of_rows(R, [2, 2], np.zeros(4), cohesion)
    assert bare.decide(np.array([-5.0, 0.199, 0.0])).verdict == "balanced"
    assert bare.decide(np.array([-5.0, 0.201, 0.0])).verdict == "none"


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 5, 6])
def test_balanced_reactions_are_the_solution_of_rigid_bodies(seed: int) -> None:
    heap = make_heap(seed)
    problem = rigid(heap.R, heap.e, heap.mu, 2)
    found, solution = problem.equilibrium(), problem.solve()
    assert solution.converged == (found.verdict == "balanced") == is_carried(heap)
    if solution.converged:
        assert solution.iterations == 0
        assert not solution.relative_displacement.any()
        np.testing.assert_array_equal(solution.reaction, found.reaction)
        # An answer that is given is kept.
        again = problem.solve(start=0.5 * (solution.reaction + found.reaction))
        np.testing.assert_array_equal(again.reaction, solution.reaction)
        # A free displacement that a rigid motion undoes, to rounding, changes nothing.
        b = np.random.default_rng(seed).normal(size=len(heap.e))
        moved = bp.ReducedProblem(
            problem.W, (heap.R @ b).reshape(-1, 2), heap.mu, rigid=(heap.R, heap.e)
        ).solve()
        assert moved.converged
        assert moved.rigid_motion == pytest.approx(-b, rel=1e-9)
    else:
        assert solution.outcome is bp.Outcome.NO_EQUILIBRIUM


def test_a_free_displacement_that_is_not_rigid_counts() -> None:
    # A beam on three supports without friction, of which the middle one is too low.
    R = np.zeros((6, 2))
    R[0::2] = [[1.0, -1.0], [1.0, 0.0], [1.0, 1.0]]
    q = [[0.0, 0.0], [1e-3, 0.0], [0.0, 0.0]]
    problem = bp.ReducedProblem(csr_array((6, 6)), q, 0.0, rigid=(R, [-1.0, 0.0]))
    solution = problem.solve()
    assert solution.converged
    # Only the outer ones carry, half each.
    np.testing.assert_allclose(solution.reaction[:, 0], [0.5, 0, 0.5], atol=1e-9)


def test_others_exist_where_reactions_are_not_determined() -> None:
    load = np.array([0.1, 0, -1.0, 0, -0.1, 0])
    assert block(load, 0.5).solve().unique == "others exist"


def towers(count: int, height: int, side: float) -> bp.ReducedProblem:
    """Towers of square blocks of side and weight 1, each pushed to the side at its foot."""
    entries: list[tuple[int, int, float]] = []
    e = np.zeros((count * height, 3))
    e[:, 0] = -1.0
    e[::height, 1] = side
    for block in range(count * height):
        for corner, x in enumerate((-0.5, 0.5)):
            row = 4 * block + 2 * corner
            # The lower face of this block, and the upper one of the block below.
            lower = [] if block % height == 0 else [(block - 1, -1.0, 0.5)]
            for body, sign, y in ((block, 1.0, -0.5), *lower):
                entries += [(row, 3 * body, sign), (row, 3 * body + 2, sign * x)]
                entries += [
                    (row + 1, 3 * body + 1, sign),
                    (row + 1, 3 * body + 2, -sign * y),
                ]
    rows, columns, values = zip(*entries, strict=True)
    R = csr_array((values, (rows, columns)), (4 * count * height, 3 * count * height))
    nothing = csr_array((R.shape[0], R.shape[0]))
    q = np.zeros((R.shape[0] // 2, 2))
    return bp.ReducedProblem(nothing, q, 0.5, rigid=(R, e.ravel()))


def test_many_blocks_need_no_dense_R() -> None:
    # 1,600 rows and 1,200 motions. The push of a foot acts at its centre, so that the foot
    # turns at 0.5 times the weight of the tower, and slides there too.
    for side, outcome in ((9.0, "converged"), (11.0, "no_equilibrium")):
        problem = towers(20, 20, side)
        solution = problem.solve()
        assert str(solution.outcome) == outcome
        if outcome == "converged":
            assert problem.residual(solution.reaction) <= 1e-10
            assert solution.unique == "others exist"
            assert not solution.relative_displacement.any()
    # No tolerance is below rounding.
    problem = towers(20, 20, 9.0)
    solution = problem.solve(tol=1e-30)
    assert solution.converged
    assert 1e-30 < solution.tolerance < 1e-14
    assert str(problem.solve(max_seconds=1e-9).outcome) == "time_limit"
    # A sparse R gives the residual of a dense one, also where a has to be found: 288 motions.
    many = towers(16, 6, 1.0)
    R, e = many.rigid
    r, a = many.solve().reaction, np.random.default_rng(0).normal(size=len(e))
    dense = many.W.toarray()
    moved = (R @ a).reshape(r.shape)
    for q, noise in ((many.q, 0.0), (-moved, 0.0), (-moved, 1e-6)):
        r = r * (1 + noise)
        values = [
            bp.ReducedProblem(W, q, 0.5, rigid=(motions, e)).residual(r)
            for W, motions in ((many.W, R), (dense, R.toarray()))
        ]
        # Both are rounding, or the imbalance that the noise leaves.
        assert values[0] == pytest.approx(values[1], rel=1e-6, abs=1e-13)
        assert values[0] <= max(1e-12, 2 * noise)


@pytest.mark.parametrize(("height", "side"), [(4, 1.0), (20, 9.0)])
def test_many_blocks_follow_a_free_displacement_that_is_rigid(
    height: int, side: float
) -> None:
    """240 and 1,200 motions: the reactions are those at rest, and no solver runs."""
    still = towers(20, height, side)
    R, e = still.rigid
    b = np.random.default_rng(height).normal(size=len(e))
    assert len(b) > 200
    q = (R @ b).reshape(-1, 2)
    moved = bp.ReducedProblem(still.W, q, 0.5, rigid=(R, e)).solve()
    assert moved.converged
    assert moved.iterations == 0
    # Rounding of q by the condition of R, some hundred.
    np.testing.assert_allclose(moved.rigid_motion, -b, atol=1e-12)
    np.testing.assert_array_equal(moved.reaction, still.solve().reaction)
    # A foot slides where it carries less than the push.
    slides = towers(20, height, height + 1.0).rigid
    refused = bp.ReducedProblem(still.W, q, 0.5, rigid=slides).solve()
    assert refused.outcome is bp.Outcome.NO_EQUILIBRIUM


def test_a_limit_of_time_is_one_for_all_groups() -> None:
    # Forty towers are as many programmes: a sixteenth of the time ends within the first three,
    # also if the machine was slower while it was measured.
    problem = towers(40, 20, 9.0)
    seconds = []
    for _ in range(3):
        start = perf_counter()
        assert problem.equilibrium().verdict == "balanced"
        seconds.append(perf_counter() - start)
    part = min(seconds) / 16
    found = problem.equilibrium(max_seconds=part)
    assert found.verdict == "undecided"
    assert found.motion is None
    assert str(problem.solve(max_seconds=part).outcome) == "time_limit"


@pytest.mark.parametrize(
    ("shape", "side", "verdict"),
    [
        ((2, 2, 2), 0.1, "balanced"),
        ((2, 2, 2), 0.7, "none"),
        pytest.param((5, 5, 6), 0.1, "balanced", marks=pytest.mark.slow),
        pytest.param((5, 5, 6), 0.6, "none", marks=pytest.mark.slow),
        pytest.param((10, 10, 12), 0.1, "balanced", marks=pytest.mark.slow),
        pytest.param((10, 10, 12), 0.6, "none", marks=pytest.mark.slow),
    ],
)
def test_bricks_in_space(
    shape: tuple[int, int, int], side: float, verdict: str
) -> None:
    """Friction is 0.5: a load of 0.1 to the side is carried, of 0.6 it is not."""
    bricks = lay_bricks(shape, 1, side)
    nothing = csr_array((3 * bricks.contacts, 3 * bricks.contacts))
    problem = bp.ReducedProblem(
        nothing, np.zeros((bricks.contacts, 3)), 0.5, rigid=bricks[:2]
    )
    found = problem.equilibrium()
    assert found.verdict == verdict
    if found.reaction is not None:
        assert problem.residual(found.reaction, np.zeros(len(bricks.e))) <= 1e-10
    else:
        if bricks.contacts < 2000:
            # Rational arithmetic of more takes minutes.
            R = bricks.R.toarray()
            assert excludes_balance(R, bricks.e, 0.5, found.motion, 3)
        assert np.isinf(found.excluded)
    solution = problem.solve()
    assert solution.converged == (verdict == "balanced")


@pytest.mark.slow
def test_ranges_of_bricks_in_space() -> None:
    """Without a null space: the pressure of one corner, and a bound of its error."""
    bricks = lay_bricks((5, 5, 6), 1, 0.1)
    nothing = csr_array((3 * bricks.contacts, 3 * bricks.contacts))
    problem = bp.ReducedProblem(
        nothing, np.zeros((bricks.contacts, 3)), 0.5, rigid=bricks[:2]
    )
    interval = problem.reaction_range(0)
    assert interval.least == pytest.approx(0, abs=1e-8)
    assert interval.largest > interval.found > 0
    assert interval.gap <= 1e-7 * interval.largest
    for reaction in (interval.reaction_at_least, interval.reaction_at_largest):
        # Programmes in space end at 1e-10.
        assert problem.residual(reaction, np.zeros(len(bricks.e))) <= 1e-8


@pytest.mark.parametrize("softness", [1e-3, 1.0, 1e3])
def test_a_block_on_springs_is_pushed_to_its_limit(softness: float) -> None:
    # Two corners with equal springs: the friction of both is 0.5 of a weight of 1, however
    # the weight is shared.
    R = np.array([[1.0, 0, -1], [0, 1, 1], [1, 0, 1], [0, 1, 1]])
    dead, live = np.array([-1.0, 0, 0]), np.array([0.0, 1, 0])
    W, q = softness * np.eye(4), np.zeros((2, 2))
    limit = bp.ReducedProblem(W, q, 0.5, rigid=(R, dead)).limit_multiplier(dead, live)
    assert limit.upper == pytest.approx(0.5, rel=1e-9)
    assert 0.5 * (1 - 1e-3) <= limit.reached <= limit.upper
    loaded = bp.ReducedProblem(W, q, 0.5, rigid=(R, dead + limit.reached * live))
    assert loaded.residual(limit.reaction) <= 1e-9


def load_at_its_limit(rng: np.random.Generator, d: int) -> tuple[Array, Array, Array]:
    """``R``, ``e0`` and ``mu``: ``e0`` is balanced, and works on a motion that nothing resists.

    Contacts that press slide by the motion on the border of their dual cones, against their
    friction; the others open.
    """
    n, k = int(rng.integers(3, 9)), int(rng.integers(2, 4 if d == 2 else 7))
    R, mu, motion = (
        rng.normal(size=(n, d, k)),
        rng.uniform(0.1, 1, n),
        rng.normal(size=k),
    )
    pressed = rng.random(n) < 0.5
    t = rng.normal(size=(n, d - 1))
    t /= np.linalg.norm(t, axis=1)[:, None]
    pressure, slip = pressed * rng.uniform(0.1, 1, n), rng.uniform(0, 1, n)
    rise = mu * slip + ~pressed * rng.uniform(0.1, 1, n)
    v = np.column_stack([rise, -slip[:, None] * t])
    R += (v - R @ motion)[:, :, None] * motion / (motion @ motion)
    r = np.column_stack([pressure, (mu * pressure)[:, None] * t])
    R = R.reshape(n * d, k)
    return R, -R.T @ r.ravel(), mu


@pytest.mark.parametrize("d", [2, 3])
def test_the_largest_multiple_beside_a_load_at_its_limit_is_decided(d: int) -> None:
    """From both sides, whatever the live load: the multiplier is often zero."""
    decided = 0
    for seed in range(15):
        rng = np.random.default_rng(seed)
        R, e0, mu = load_at_its_limit(rng, d)
        limit = rigid(R, e0, mu, d).limit_multiplier(e0, e1 := rng.normal(size=len(e0)))
        if np.isinf(limit.upper):
            assert np.isinf(limit.reached)
            assert rigid(R, e1, mu, d).equilibrium().verdict == "balanced"
        else:
            # Loads count as balanced to 1e-10 of them.
            assert limit.reached <= limit.upper * (1 + 1e-9)
            above = e0 + (limit.upper + 1e-6) * e1
            assert rigid(R, above, mu, d).equilibrium().verdict != "balanced", seed
            decided += 1
    assert decided > 4


def draw_cohesive(rng: np.random.Generator, walls: int) -> tuple[Array, ...]:
    """``R``, ``e0``, ``e1``, ``mu``, cohesion of a body that a motion frees; ``walls`` oppose."""
    n = int(rng.integers(3, 6))
    mu, cohesion, slip = (
        rng.uniform(0, 1, n),
        rng.uniform(0.01, 1, n),
        rng.normal(size=n),
    )
    R, motion = rng.normal(size=(n, 2, 3)), rng.normal(size=3)
    rise = mu * abs(slip) + rng.random(n)
    mu[:walls] = rise[:walls] = 0
    v = np.column_stack([rise, slip])
    R += (v - R @ motion)[:, :, None] * motion / (motion @ motion)
    if walls:
        R[1, 0] = -2 * R[0, 0]
    live = rng.normal(size=3)
    live *= np.sign(live @ motion)
    return R.reshape(2 * n, 3), -R[:, 0].T @ rng.uniform(0, 1, n), live, mu, cohesion


@pytest.mark.parametrize("seed", range(24))
def test_the_limit_of_two_cohesive_bodies_is_the_smaller_one(seed: int) -> None:
    """Beside a linear programme for each body alone; no contact is of both."""
    rng = np.random.default_rng(seed)
    bodies, limits = [draw_cohesive(rng, walls) for walls in (0, 2 * (seed % 2))], []
    for R, dead, live, mu, cohesion in bodies:
        # Each side of each cone, |r_t| <= c + mu r_n; the last unknown is the multiplier.
        sides = np.kron(np.diag(mu), [[-1.0, 0], [-1, 0]])
        sides += np.kron(np.eye(len(mu)), [[0.0, 1], [0, -1]])
        alone = linprog(
            -np.eye(len(R) + 1)[-1],
            A_ub=np.column_stack([sides, 0 * sides[:, 0]]),
            b_ub=np.repeat(cohesion, 2),
            A_eq=np.column_stack([R.T, live]),
            b_eq=-dead,
            bounds=[(0, None), (None, None)] * len(mu) + [(0, None)],
            method="highs",
        )
        limits.append(alone.x[-1])
    rows = block_diag(*(body[0] for body in bodies))
    dead, live, mu, cohesion = map(np.concatenate, list(zip(*bodies, strict=True))[1:])
    limit = rigid(rows, dead, mu, 2, cohesion=cohesion).limit_multiplier(dead, live)
    exact = min(limits)
    # The tolerance of HiGHS; walls hold each other, and leave no proof nearer than this.
    np.testing.assert_allclose(limit.reached, exact, rtol=1e-7)
    assert -1e-7 <= limit.upper / exact - 1 <= (1e-4 if seed % 2 else 1e-7)


@pytest.mark.parametrize("cohesion", [1.0, 1e6, 1e9, 1e12, 1e15])
def test_cohesion_that_is_large_hides_no_loads(cohesion: float) -> None:
    """It holds more contacts than there are motions, in any direction."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        d = 2 + seed % 2
        R = rng.normal(size=(6 * d, 3 * (d - 1)))
        problem = rigid(R, rng.normal(size=3 * (d - 1)), 0.4, d, cohesion=cohesion)
        assert problem.equilibrium().verdict == "balanced", seed
