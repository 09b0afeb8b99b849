"""Contacts between bodies, whose nodes may lie on different ranks."""

from pathlib import Path

import pytest

from support import mpi, two_blocks


@pytest.mark.parametrize(
    ("contrast", "upper", "lower"),
    [
        pytest.param(10.0, 8, 8, id="matching, stiff upper"),
        pytest.param(0.1, 8, 8, id="matching, soft upper"),
        pytest.param(10.0, 6, 8, id="mortar"),
        pytest.param(10.0, 16, 16, id="larger", marks=pytest.mark.slow),
    ],
)
def test_two_blocks(contrast: float, upper: int, lower: int, tmp_path: Path) -> None:
    arrays_of_blocks, prescribed = two_blocks.arrays(contrast, upper, lower)
    arguments = arrays_of_blocks | {"prescribed": prescribed, "tol": mpi.TOL}
    on_one_rank, two = (
        mpi.run(tmp_path, "solve", ranks, **arguments) for ranks in (1, 2)
    )
    expected = mpi.solve_directly(arrays_of_blocks, prescribed=prescribed)
    for parallel in (on_one_rank, two):
        mpi.compare(parallel, expected)
        # Multigrid that is not that of the glued bodies, or no filter, takes over 300.
        assert mpi.read_stats(parallel)["krylov"] <= 150
    assert mpi.changed(two["reaction"], on_one_rank["reaction"]) <= mpi.SAME
