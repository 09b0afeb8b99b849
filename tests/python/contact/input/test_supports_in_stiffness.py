"""Supports in K, or removed degrees of freedom: messages with the fault and the remedy."""

from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.io import mmwrite

import bipot_rs as bp
from bipot_rs import fem
from support.matrix_and_tables import of_nodes
from support.orders import body

pytestmark = pytest.mark.needs_extra


@pytest.fixture
def block() -> dict[str, Any]:
    meshed = body("quadrilateral", 2)
    model = fem.assemble(
        [meshed],
        [fem.Contact("a", "bottom", 0.3, plane=([0, 0], [0, 1]))],
        [fem.Support("a", "top", (0, 1))],
    )
    return {"model": model, "K": model.K, "B": model.B, "fixed": model.fixed}


def enforced(K: Any, held: Any) -> Any:
    """As ``skfem.enforce(K, D=held)``: rows of the identity, columns unchanged."""
    free = np.ones(K.shape[0])
    free[held] = 0.0
    return (sparse.diags_array(free) @ K + sparse.diags_array(1 - free)).tocsr()


def test_enforced(block: dict[str, Any]) -> None:
    K = enforced(block["K"], block["fixed"])
    count, first = len(block["fixed"]), block["fixed"][0]
    lower = sparse.tril(block["K"]).tocsr()
    other = block["K"].copy()
    other[0, 1] *= 2
    for matrix, said in (
        (
            K,
            rf"not symmetric.*; {count} rows of K, first {first}, contain the diagonal",
        ),
        (K, r"but the columns more: supports were written into K, as by skfem.enforce"),
        (K.T.tocsr(), rf"; {count} columns of K, .* but the rows more: supports were"),
        (enforced(block["K"], [3]), r"; 1 row of K, first 3, contains the diagonal"),
        (lower, "stores its lower triangle only"),
        # An asymmetry of another kind.
        (other, r"is not symmetric((?!skfem).)*$"),
    ):
        with pytest.raises(ValueError, match=said):
            bp.ContactProblem(matrix, block["B"], gap=block["model"].gap, mu=0.3)


def test_condensed(block: dict[str, Any]) -> None:
    n = block["K"].shape[0]
    kept = np.setdiff1d(np.arange(n), block["fixed"])
    K, B = block["K"][kept][:, kept], block["B"]
    told: dict[str, Any] = {"gap": block["model"].gap, "mu": 0.3}
    for stiffness, contacts, said in (
        (
            K,
            B,
            r"expected 40 columns, as many as K.* by skfem.condense, but not from B\?",
        ),
        (
            block["K"],
            B[:, kept],
            "removed from B, as by skfem.condense, but not from K",
        ),
        # The results of these functions, passed on unchanged.
        ((K, kept, np.zeros(n), kept), B, "K is a tuple of 4 that begins with"),
        ((block["K"], np.zeros(n)), B, "K is a tuple of 2 that begins with"),
    ):
        with pytest.raises((ValueError, TypeError), match=said):
            bp.ContactProblem(stiffness, contacts, **told)
    whole = bp.ContactProblem(block["K"], B, **told, fixed=block["fixed"])
    with pytest.raises(
        ValueError,
        match=r"K has shape \(40, 40\), expected \(50, 50\) as before, including",
    ):
        whole.update(K)
    # K and B both condensed: an ordinary problem with the same solution.
    load = np.zeros(n)
    load[1::2] = -1.0
    other = bp.ContactProblem(K, B[:, kept], **told).solve(load[kept])
    assert np.allclose(whole.solve(load).reaction, other.reaction, rtol=0, atol=1e-9)


def test_condensed_in_a_file(block: dict[str, Any], bipot: Any) -> None:
    K, kept = block["K"], np.setdiff1d(np.arange(50), block["fixed"])
    for stiffness, *said in (
        (
            K[kept][:, kept],
            "K.mtx has 40 rows, expected 2 for each of the 25 nodes of nodes.csv: if",
            "give the whole stiffness and --fixed",
        ),
        (
            enforced(K, block["fixed"]),
            "supports were written into K, as by skfem.enforce",
        ),
    ):
        command = of_nodes(stiffness, block["model"].nodes, [0])
        # As it stands, both triangles of the enforced K too.
        mmwrite("K.mtx", sparse.coo_matrix(stiffness), symmetry="general", precision=17)
        status, _, errors = bipot(*command)
        assert status == 2
        for words in said:
            assert words in errors
