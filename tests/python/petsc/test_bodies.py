"""Bodies with their stiffness in parts: the answers of the direct engine."""

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.petsc.bodies import rigid_motions
from support import mpi, two_blocks
from support.body_models import floating, on_springs, sliding_freely
from support.pressed_in_space import arrays, pressed
from support.random_joints import random_joint

pytestmark = pytest.mark.xdist_group("ranks")
Case = tuple[dict[str, Any], dict[str, Any]]
# The factor of the core as the preconditioner, for problems of at most ``gather`` rows.
FACTOR = "factor on the first rank"


def block(n: int) -> Case:
    known, prescribed = arrays(n)
    return known, {"prescribed": prescribed}


def blocks(*shape: Any) -> Case:
    known, prescribed = two_blocks.arrays(*shape)
    return known, {"prescribed": prescribed}


def check(
    case: Case, ranks: int, task: str = "solve", **more: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Compare ranks with the direct engine; return their arrays and `stats`."""
    known, path = case
    found = mpi.run(ranks, task, **known, **path, **more, tol=mpi.TOL)
    mpi.compare(found, mpi.solve_directly(known, **path))
    return found, mpi.read_stats(found)


# Two steps; each linear system takes some ten iterations. Multigrid between bodies that is
# not that of the glued bodies, or no filter, takes over 300.
BODIES = {
    "block": (block, (8,), 200),
    "larger block": (block, (24,), 200),
    "matching, stiff upper": (blocks, (10.0, 8, 8), 150),
    "matching, soft upper": (blocks, (0.1, 8, 8), 150),
    "mortar": (blocks, (10.0, 6, 8), 150),
    "larger": (blocks, (10.0, 16, 16), 150),
}


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.quick_variants("block", "*soft upper", "mortar")
def test_one_rank_and_two(name: str) -> None:
    """Nodes of contacts between bodies may lie on different ranks."""
    make, shape, most = BODIES[name]
    case = make(*shape)
    (one, stats), (two, stats_of_two) = (check(case, ranks) for ranks in (1, 2))
    assert max(stats["krylov"], stats_of_two["krylov"]) <= most
    assert mpi.changed(two["reaction"], one["reaction"]) <= mpi.SAME
    kept = [stats_of_two[key] for key in ("engine", "ranks", "preconditioner")]
    assert kept == ["petsc", 2, "gamg"]
    if make is block:
        assert mpi.changed(two["displacement"], one["displacement"]) <= mpi.SAME
        # Slips are differences of displacements.
        apart = np.abs(two["slip"] - one["slip"]).max()
        assert apart <= mpi.SAME * np.abs(two["displacement"]).max()


def without_coordinates() -> Case:
    known, path = block(6)
    del known["coordinates"]
    return known, path


@pytest.mark.parametrize(
    ("make", "ranks", "d"),
    [
        pytest.param(lambda: mpi.of_model(pressed(8, dim=2)), 3, 2, id="plane"),
        pytest.param(
            lambda: mpi.of_model(pressed(5, mu=[0.3, 0.15], axis=[1.0, 0.0, 0.0])),
            2,
            3,
            id="two coefficients",
            marks=pytest.mark.slow,
        ),
        pytest.param(lambda: mpi.of_model(floating()), 2, 3, id="contact alone"),
        pytest.param(lambda: mpi.of_model(on_springs()), 2, 3, id="springs"),
        pytest.param(without_coordinates, 2, 3, id="no coordinates"),
    ],
)
def test_answers_are_those_of_the_direct_engine(
    make: Callable[[], Case], ranks: int, d: int
) -> None:
    check(make(), ranks, d=d)


@pytest.mark.slow_variants("0.0")
@pytest.mark.parametrize("beta", [0.0, 0.1])
def test_cohesion_that_breaks(beta: float) -> None:
    """A block is sheared, lifted at one side and pressed again."""
    known, (_, sheared) = arrays(4)
    fixed = known["fixed"]
    along, upwards = known["coordinates"][fixed, 0], fixed % 3 == 2
    press = sheared[upwards].max()
    lift = np.where(upwards, -2.5 * press * along / along.max(), 0.0)
    path = {"prescribed": np.stack([sheared, sheared + lift, 0.5 * sheared])}
    count = len(known["gap"])
    known |= {"cohesion": np.full(count, 0.02), "dilatancy": np.full(count, beta)}
    broken = mpi.solve_directly(known, **path).broken
    assert 0 < broken[1].sum() < count
    for ranks in (1, 2):
        found, _ = check((known, path), ranks)
        assert np.array_equal(found["broken"], broken)


@pytest.mark.slow_variants("10000")
@pytest.mark.parametrize("gather", [0, 10_000])
def test_a_motion_without_energy(gather: int) -> None:
    """Nothing resists a motion along x: all else is determined."""
    known, path = mpi.of_model(sliding_freely())
    expected = mpi.solve_directly(known, **path)
    parallel = mpi.run(2, "solve", **known, **path, tol=mpi.TOL, gather=gather)
    assert mpi.changed(parallel["reaction"], expected.reaction) <= mpi.CLOSE
    assert np.array_equal(parallel["status"], expected.status)
    u, other = (
        displacement.reshape(len(expected), -1, 3)
        for displacement in (parallel["displacement"], expected.displacement)
    )
    shift = (u - other).mean(axis=1, keepdims=True) * [1.0, 0.0, 0.0]
    assert mpi.changed(u - shift, other) <= mpi.CLOSE


# Krylov iterations: a third more than 710, 234, 1122, 562 and 1341. A start that does not keep the
# statuses of the iteration before takes 1602, 317, 2254, 853 and 3639.
@pytest.mark.parametrize(
    ("kind", "dim", "seed", "most"),
    [
        ("groove", 2, 2, 950),
        ("oblique", 2, 0, 310),
        ("groove", 3, 2, 1500),
        ("oblique", 3, 0, 750),
        ("symmetry", 3, 0, 1800),
    ],
)
@pytest.mark.slow_variants("*-3-*")
def test_contacts_that_share_nodes_or_are_held_obliquely(
    kind: str, dim: int, seed: int, most: int
) -> None:
    problem, load = random_joint(kind, dim, seed)
    known = {k: v for k, v in problem.items() if k not in ("frame", "points")}
    expected = bp.ContactProblem(**known, engine="direct").solve(load, tol=mpi.TOL)
    given = known | {"load": load, "d": dim}
    for ranks in (1, 2):
        found = mpi.run(ranks, "solve", **given, tol=mpi.TOL)
        # Contrasts up to 1e6 cost the direct engine four digits.
        assert mpi.changed(found["displacement"], expected.displacement) <= 1e-8
        assert (found["status"] == expected.status).all()
        assert found["residual"].max() <= 10 * mpi.TOL
        assert mpi.read_stats(found)["krylov"] <= most
    if kind == "oblique":
        found = mpi.run(2, "refused_derivatives", **given)
        assert "ValueError: contacts share nodes" in str(found["message"])


@pytest.mark.parametrize("ranks", [1, 3])
def test_a_small_body_is_factored_on_one_rank(ranks: int) -> None:
    case = block(6)
    n = case[0]["K"].shape[0]
    (_, stats), (_, other) = (check(case, ranks, gather=n - k) for k in (0, 1))
    assert (stats["preconditioner"], other["preconditioner"]) == (FACTOR, "gamg")
    # Only the unsymmetric part of the springs of slipping contacts is not in the factor;
    # where none slips one product is enough.
    assert stats["krylov"] < 0.6 * other["krylov"]


def test_small_bodies_by_mortar() -> None:
    _, stats = check(blocks(10.0, 4, 5), 2, gather=10_000)
    assert stats["preconditioner"] == FACTOR


def test_a_matrix_that_the_core_cannot_factor() -> None:
    _, stats = check(block(4), 2, "unfactored", gather=10_000)
    assert stats["preconditioner"].startswith("cholesky")
    reason = f"{FACTOR} was replaced: it cannot be made: no factor today"
    assert stats["engine_reason"] == reason


@pytest.mark.parametrize(
    ("options", "name", "reason"),
    [
        ("-bipot_pc_type hypre", "hypre", ""),
        ("-bipot_pc_type ml", "ml", ""),
        # Smaller than ``gather``, and not factored.
        ("-bipot_pc_type gamg", "gamg", ""),
        ("-bipot_pc_type gamg -bipot_ksp_type gcr", "gamg", ""),
        # A diagonal alone does not converge in 400 steps that forget each other.
        (
            "-bipot_pc_type jacobi -bipot_ksp_gmres_restart 1",
            "cholesky (MUMPS)",
            "jacobi was replaced: it did not converge in 400 iterations",
        ),
    ],
)
@pytest.mark.quick_variants("*jacobi*", "*gamg*")
def test_options_of_the_user(options: str, name: str, reason: str) -> None:
    n = 12 if "jacobi" in options else 6
    _, stats = check(block(n), 2, options=options, gather=10_000)
    assert stats["preconditioner"] == name
    assert reason in stats["engine_reason"]


def test_k_is_never_gathered() -> None:
    """No rank ever holds more of K than its own rows and what belongs to the interface."""
    known, path = block(8)
    K, contacts = known["K"], len(known["gap"])
    ranks = json.loads(str(mpi.run(3, "rows", **known, **path)["ranks"]))
    whole = K.data.nbytes
    assert sum(rank["own"] for rank in ranks) == K.shape[0]
    for rank in ranks:
        # Rows that PETSc hands out are those of this rank; calls that could gather others
        # raise.
        assert rank["handed_out"] == rank["own"]
        # Values of the interface, and numbers of pieces and bodies: no values of K. The
        # contacts (three numbers each) are the whole interface of a rigid obstacle.
        assert rank["bytes_gather"] == 8 * 3 * contacts
        assert rank["received_making"] < whole / 10
        gathers = rank["gathers"] * rank["bytes_gather"]
        # Besides these, the decision of the first rank for each Newton step, and checks.
        assert rank["received"] < gathers + 200 * (rank["newton"] + 50)
        # Memory of Python: the copy of the own rows (12 bytes an entry), and less than as
        # much again for their numbers. The whole K would take more.
        share = rank["own"] / K.shape[0]
        assert rank["peak"] < 2.5 * 1.5 * whole * share + 1e7


@pytest.mark.parametrize(("d", "motions"), [(2, 3), (3, 6)])
def test_motions_of_a_rank_without_nodes(d: int, motions: int) -> None:
    """The box around all nodes comes from the other ranks."""
    corner = {"min": np.zeros(d), "max": np.ones(d)}

    class Ranks:
        def Allreduce(self, _own: Any, whole: Any, op: str) -> None:
            whole[:] = corner[op]

    ranks: Any = Ranks()
    names: Any = SimpleNamespace(MIN="min", MAX="max")
    found = rigid_motions(ranks, names, np.zeros((0, d)), 0, d)
    assert found.shape == (0, motions)
