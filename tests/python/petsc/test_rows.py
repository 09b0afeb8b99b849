"""No rank ever holds more of K than its own rows and what belongs to the interface."""

import json
from pathlib import Path

from support import mpi
from support.pressed_in_space import arrays

RANKS = 4


def test_k_is_never_gathered(tmp_path: Path) -> None:
    arrays_of_block, prescribed = arrays(12)
    K, contacts = arrays_of_block["K"], len(arrays_of_block["gap"])
    parallel = mpi.run(
        tmp_path, "rows", RANKS, **arrays_of_block, prescribed=prescribed
    )
    ranks = json.loads(str(parallel["ranks"]))
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
