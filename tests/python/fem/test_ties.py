"""Relations between displacements, compared with the null space of their matrix."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import null_space, subspace_angles

from bipot_rs import fem
from bipot_rs.fem.assembly.assembly import Support
from bipot_rs.fem.bodies.boundary import Symmetry
from bipot_rs.fem.constraints.references import Remote
from bipot_rs.fem.constraints.ties import Relations, make_ties
from support.comparisons import close, refused

Floats = NDArray[np.float64]
STEEL = fem.Material(200.0, 0.3)


def random_relations(seed: int) -> tuple[list[Relations], NDArray[Any], Floats]:
    """Relations that share degrees of freedom, some of them prescribed, and their matrix."""
    rng = np.random.default_rng(seed)
    n, blocks = 24, []
    for terms in (2, 3, 5):
        dofs = np.array([rng.permutation(n)[:terms] for _ in range(3)])
        blocks.append(Relations(dofs, rng.normal(size=dofs.shape)))
    fixed = np.sort(rng.permutation(n)[:5])
    C = np.zeros((9, n))
    row = 0
    for block in blocks:
        for dofs, values in zip(block.dofs, block.coefficients, strict=True):
            C[row, dofs] = values
            row += 1
    return blocks, fixed, C


@pytest.mark.parametrize("seed", range(12))
def test_the_columns_span_the_null_space(seed: int) -> None:
    blocks, fixed, C = random_relations(seed)
    n = C.shape[1]
    tied = make_ties(blocks, fixed, np.zeros((n // 2, 2)))
    T = tied.within.toarray()
    # Relations between prescribed values alone are not part of T.
    inside = np.vstack([C, np.zeros((0, n))])
    relations = tied.given.toarray()
    assert not np.isin(tied.dependent, fixed).any()
    assert not T[:, tied.dependent].any()
    # Entries are sums of a few products of size 1, over pivots of at least a tenth.
    close(T @ T, T, 1e-11)
    wanted = null_space(inside)
    allowed = T @ null_space(np.vstack([relations, np.eye(n)[tied.dependent]]))
    assert allowed.shape == wanted.shape
    assert subspace_angles(allowed, wanted).max() < 1e-9


def test_no_relations_change_nothing() -> None:
    tied = make_ties([], np.array([1]), np.zeros((3, 2)))
    K = sparse.csr_array(np.diag(np.arange(1.0, 7.0)))
    assert (tied.stiffness(K) != K).nnz == 0
    f = np.arange(6.0)
    assert tied.load(f) is f


def test_loads_that_were_changed_stay_the_same_bits() -> None:
    blocks, fixed, C = random_relations(0)
    tied = make_ties(blocks, fixed, np.zeros((12, 2)))
    f = np.random.default_rng(1).normal(size=C.shape[1])
    once = tied.load(f)
    assert tied.load(once) is once


def test_a_node_on_an_inclined_plane_is_refused() -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    mesh = fem.box([np.linspace(0, 1, 3)] * 2, "quadrilateral")
    mesh = type(mesh)(turn @ mesh.p, mesh.t, mesh.boundaries)
    with refused("on an inclined plane of symmetry and in a rigid"):
        fem.assemble(
            [fem.Body("it", mesh, STEEL)],
            [],
            symmetries=[Symmetry("it", "left")],
            remotes=[Remote("grip", "it", "top")],
        )


def test_an_inclined_plane_elsewhere_and_a_rigid_set() -> None:
    """The same model, rotated, has the rotated solution."""
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])

    def solved(Q: Floats) -> Floats:
        plain = fem.box([np.linspace(0, 1, 4)] * 2, "quadrilateral")
        mesh = type(plain)(Q @ plain.p, plain.t, plain.boundaries)
        model = fem.assemble(
            [fem.Body("it", mesh, STEEL)],
            [],
            [Support("it", None, (0, 1), at=Q @ np.zeros(2))],
            symmetries=[Symmetry("it", "left")],
            remotes=[Remote("grip", "it", "right")],
        )
        f = model.reference_force("grip", Q @ np.array([1.0, 0.5]), [0.2])
        u = model.problem().solve(f).displacement[0]
        assert model.prescribed([[0.0, 0.0]]).shape == model.fixed.shape
        return u[: model.nodes.size].reshape(-1, 2) @ Q

    straight, turned = solved(np.eye(2)), solved(turn)
    # Rounding times the condition of a small elastic body, 1e3.
    close(turned, straight, 1e-12)


def test_prescribed_values_that_contradict_a_relation() -> None:
    mesh = fem.box([np.linspace(0, 1, 3)] * 2, "quadrilateral")
    model = fem.assemble(
        [fem.Body("it", mesh, STEEL)],
        [],
        [Support("it", "top", (0, 1))],
        remotes=[Remote("grip", "it", "top", components=(0, 1), rotations=(2,))],
    )
    model.prescribed([[0.0, 0.1]], {"grip": [0.0, 0.1, 0.0]})
    with refused(r"contradict a rigid set.* by 0\.3: prescribe"):
        model.prescribed([[0.0, 0.1]], {"grip": [0.0, 0.4, 0.0]})
