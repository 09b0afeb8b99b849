"""Options of PETSc, and what takes the place of a preconditioner that fails."""

from pathlib import Path
from typing import Any

import pytest

from support import mpi
from support.pressed_in_space import arrays


@pytest.fixture(scope="module")
def block() -> tuple[dict[str, Any], Any]:
    arrays_of_block, prescribed = arrays(12)
    expected = mpi.solve_directly(arrays_of_block, prescribed=prescribed)
    return arrays_of_block | {"prescribed": prescribed, "tol": mpi.TOL}, expected


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
    arguments, expected = block
    parallel = mpi.run(tmp_path, "solve", 2, options=options, **arguments)
    mpi.compare(parallel, expected)
    stats = mpi.read_stats(parallel)
    assert stats["preconditioner"] == name
    reason = "jacobi was replaced: it did not converge in 400 iterations"
    assert (reason in stats["engine_reason"]) == replaced
