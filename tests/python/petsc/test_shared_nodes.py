"""Contacts that share nodes, or that supports hold obliquely: the answers of the direct engine."""

from pathlib import Path

import pytest

import bipot_rs as bp
from support import mpi
from support.random_joints import random_joint


# Krylov iterations: a third more than 710, 234, 1122, 562 and 1341. A start that does not keep the
# statuses of the iteration before takes 1602, 317, 2254, 853 and 3639.
@pytest.mark.parametrize(
    ("kind", "dim", "seed", "most"),
    [
        ("groove", 2, 2, 950),
        ("oblique", 2, 0, 310),
        pytest.param("groove", 3, 2, 1500, marks=pytest.mark.slow),
        ("oblique", 3, 0, 750),
        pytest.param("symmetry", 3, 0, 1800, marks=pytest.mark.slow),
    ],
)
def test_random_joints(
    kind: str, dim: int, seed: int, most: int, tmp_path: Path
) -> None:
    problem, load = random_joint(kind, dim, seed)
    known = {k: v for k, v in problem.items() if k not in ("frame", "points")}
    expected = bp.ContactProblem(**known, engine="direct").solve(load, tol=mpi.TOL)
    given = {"load": load, "d": dim, "tol": mpi.TOL}
    for ranks in (1, 2):
        found = mpi.run(tmp_path, "solve", ranks, **known, **given)
        # Contrasts up to 1e6 cost the direct engine four digits.
        assert mpi.changed(found["displacement"], expected.displacement) <= 1e-8
        assert (found["status"] == expected.status).all()
        assert found["residual"].max() <= 10 * mpi.TOL
        assert mpi.read_stats(found)["krylov"] <= most


def test_derivatives_are_refused(tmp_path: Path) -> None:
    problem, load = random_joint("oblique", 2, 0)
    known = {k: v for k, v in problem.items() if k not in ("frame", "points")}
    found = mpi.run(tmp_path, "refused_derivatives", 2, **known, load=load, d=2)
    assert "ValueError: contacts share nodes" in str(found["message"])
