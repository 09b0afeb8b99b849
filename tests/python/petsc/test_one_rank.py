"""Small problems: K on the first rank, and the factor of the core as the preconditioner."""

from pathlib import Path
from typing import Any

import pytest

from support import mpi, two_blocks
from support.pressed_in_space import arrays

NAME = "factor on the first rank"


def solve(folder: Path, ranks: int, given: dict[str, Any], **more: Any) -> Any:
    parallel = mpi.run(folder, "solve", ranks, **given, **more, tol=mpi.TOL)
    return parallel, mpi.read_stats(parallel)


@pytest.mark.parametrize("ranks", [1, 3])
def test_one_body(ranks: int, tmp_path: Path) -> None:
    arrays_of_block, prescribed = arrays(6)
    n = arrays_of_block["K"].shape[0]
    arguments = arrays_of_block | {"prescribed": prescribed}
    parallel, stats = solve(tmp_path, ranks, arguments, gather=n)
    mpi.compare(parallel, mpi.solve_directly(arrays_of_block, prescribed=prescribed))
    assert stats["preconditioner"] == NAME
    _, other = solve(tmp_path, ranks, arguments, gather=n - 1)
    assert other["preconditioner"] == "gamg"
    # Only the unsymmetric part of the springs of slipping contacts is not in the factor;
    # where none slips one product is enough.
    assert stats["krylov"] < 0.6 * other["krylov"]


def test_mortar_between_bodies(tmp_path: Path) -> None:
    arrays_of_blocks, prescribed = two_blocks.arrays(10.0, 4, 5)
    arguments = arrays_of_blocks | {"prescribed": prescribed}
    parallel, stats = solve(tmp_path, 2, arguments, gather=10_000)
    mpi.compare(parallel, mpi.solve_directly(arrays_of_blocks, prescribed=prescribed))
    assert stats["preconditioner"] == NAME


def test_an_option_of_the_user_is_stronger(tmp_path: Path) -> None:
    arrays_of_block, prescribed = arrays(4)
    arguments = arrays_of_block | {"prescribed": prescribed, "gather": 10_000}
    _, stats = solve(tmp_path, 2, arguments, options="-bipot_pc_type gamg")
    assert stats["preconditioner"] == "gamg"


def test_a_matrix_that_the_core_cannot_factor(tmp_path: Path) -> None:
    arrays_of_block, prescribed = arrays(4)
    arguments = arrays_of_block | {"prescribed": prescribed, "gather": 10_000}
    parallel = mpi.run(tmp_path, "unfactored", 2, **arguments, tol=mpi.TOL)
    mpi.compare(parallel, mpi.solve_directly(arrays_of_block, prescribed=prescribed))
    stats = mpi.read_stats(parallel)
    assert stats["preconditioner"].startswith("cholesky")
    reason = f"{NAME} was replaced: it cannot be made: no factor today"
    assert stats["engine_reason"] == reason
