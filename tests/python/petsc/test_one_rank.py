"""Small problems: K on the first rank, and the factor of the core as the preconditioner."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support import mpi, two_blocks
from support.pressed_in_space import arrays

TOL = 1e-12
# η is 1e-12; the errors of the reactions are larger by the condition of the contacts.
CLOSE = 1e-10
NAME = "factor on the first rank"


def solved(folder: Path, ranks: int, given: dict[str, Any], **more: Any) -> Any:
    found = mpi.run(folder, "solve", ranks, **given, **more, tol=TOL)
    return found, json.loads(str(found["stats"]))


def compare(found: Any, known: dict[str, Any], prescribed: Any) -> None:
    problem = bp.ContactProblem(**known, engine="direct")
    expected = problem.solve(prescribed=prescribed, tol=TOL)
    assert mpi.changed(found["reaction"], expected.reaction) <= CLOSE
    assert mpi.changed(found["displacement"], expected.displacement) <= CLOSE
    assert np.array_equal(found["status"], expected.status)


@pytest.mark.parametrize("ranks", [1, 3])
def test_one_body(ranks: int, tmp_path: Path) -> None:
    known, prescribed = arrays(6)
    n = known["K"].shape[0]
    given = known | {"prescribed": prescribed}
    found, stats = solved(tmp_path, ranks, given, gather=n)
    compare(found, known, prescribed)
    assert stats["preconditioner"] == NAME
    _, other = solved(tmp_path, ranks, given, gather=n - 1)
    assert other["preconditioner"] == "gamg"
    # Only the unsymmetric part of the springs of slipping contacts is not in the factor;
    # where none slips one product is enough.
    assert stats["krylov"] < 0.6 * other["krylov"]


def test_mortar_between_bodies(tmp_path: Path) -> None:
    known, prescribed = two_blocks.arrays(10.0, 4, 5)
    given = known | {"prescribed": prescribed}
    found, stats = solved(tmp_path, 2, given, gather=10_000)
    compare(found, known, prescribed)
    assert stats["preconditioner"] == NAME


def test_an_option_of_the_user_is_stronger(tmp_path: Path) -> None:
    known, prescribed = arrays(4)
    given = known | {"prescribed": prescribed, "gather": 10_000}
    _, stats = solved(tmp_path, 2, given, options="-bipot_pc_type gamg")
    assert stats["preconditioner"] == "gamg"


def test_a_matrix_that_the_core_cannot_factor(tmp_path: Path) -> None:
    known, prescribed = arrays(4)
    given = known | {"prescribed": prescribed, "gather": 10_000}
    found = mpi.run(tmp_path, "unfactored", 2, **given, tol=TOL)
    compare(found, known, prescribed)
    stats = json.loads(str(found["stats"]))
    assert stats["preconditioner"].startswith("cholesky")
    reason = f"{NAME} was replaced: it cannot be made: no factor today"
    assert stats["engine_reason"] == reason
