"""Options of PETSc, and what takes the place of a preconditioner that fails."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from support import mpi
from support.pressed_in_space import arrays

# η is 1e-12; the errors of the reactions are larger by the condition of the contacts.
TOL, CLOSE = 1e-12, 1e-10


@pytest.fixture(scope="module")
def block() -> tuple[dict[str, Any], Any]:
    known, prescribed = arrays(12)
    problem = bp.ContactProblem(**known, engine="direct")
    expected = problem.solve(prescribed=prescribed, tol=TOL)
    return known | {"prescribed": prescribed, "tol": TOL}, expected


@pytest.mark.parametrize(
    ("options", "name", "replaced"),
    [
        ("-bipot_pc_type hypre", "hypre", False),
        ("-bipot_pc_type ml", "ml", False),
        ("-bipot_pc_gamg_threshold 0.05 -bipot_ksp_type gcr", "gamg", False),
        # A diagonal alone does not converge in 400 steps that forget each other.
        (
            "-bipot_pc_type jacobi -bipot_ksp_gmres_restart 1",
            "cholesky (MUMPS)",
            True,
        ),
    ],
)
@pytest.mark.quick_variants("*True*", "*gamg*")
def test_options_of_the_user(
    options: str, name: str, replaced: bool, block: Any, tmp_path: Path
) -> None:
    given, expected = block
    found = mpi.run(tmp_path, "solve", 2, options=options, **given)
    assert mpi.changed(found["reaction"], expected.reaction) <= CLOSE
    assert np.array_equal(found["status"], expected.status)
    stats = json.loads(str(found["stats"]))
    assert stats["preconditioner"] == name
    said = "jacobi was replaced: it did not converge in 400 iterations"
    assert (said in stats["engine_reason"]) == replaced
