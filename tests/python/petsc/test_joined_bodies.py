"""Contacts between bodies, whose nodes may lie on different ranks."""

import json
from pathlib import Path

import numpy as np
import pytest

import bipot_rs as bp
from support import mpi, two_blocks

TOL = 1e-12
# η is 1e-12; the errors of the reactions are larger by the condition of the contacts.
CLOSE = 1e-10
# Between numbers of ranks only the order of sums and the aggregates differ.
SAME = 1e-11


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
    known, prescribed = two_blocks.arrays(contrast, upper, lower)
    given = known | {"prescribed": prescribed, "tol": TOL}
    one, two = (mpi.run(tmp_path, "solve", ranks, **given) for ranks in (1, 2))
    expected = bp.ContactProblem(**known, engine="direct").solve(
        prescribed=prescribed, tol=TOL
    )
    for found in (one, two):
        assert mpi.changed(found["reaction"], expected.reaction) <= CLOSE
        assert mpi.changed(found["displacement"], expected.displacement) <= CLOSE
        assert np.array_equal(found["status"], expected.status)
        # Multigrid that is not that of the glued bodies, or no filter, takes over 300.
        assert json.loads(str(found["stats"]))["krylov"] <= 150
    assert mpi.changed(two["reaction"], one["reaction"]) <= SAME
