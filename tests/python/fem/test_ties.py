"""Relations between displacements, compared with the null space of their matrix."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import null_space, subspace_angles
from scipy.spatial.transform import Rotation

from bipot_rs import fem
from bipot_rs.fem.assembly.assembly import Support
from bipot_rs.fem.bodies.boundary import Symmetry
from bipot_rs.fem.checks.inspection import inspect
from bipot_rs.fem.constraints.references import Remote
from bipot_rs.fem.constraints.ties import Relations, make_ties
from bipot_rs.fem.resultants import reference_force, support_force
from support.boxes import box, placed
from support.comparisons import close, near, refused

Floats = NDArray[np.float64]
STEEL = fem.Material(200.0, 0.3)


def random_relations(seed: int) -> tuple[list[Relations], NDArray[Any], Floats]:
    """Relations that share degrees of freedom, some of them prescribed, and their matrix."""
    rng = np.random.default_rng(seed)
    n, blocks, rows = 24, [], []
    for terms in (2, 3, 5):
        dofs = np.array([rng.permutation(n)[:terms] for _ in range(3)])
        blocks.append(Relations(dofs, rng.normal(size=dofs.shape)))
        rows.append(np.einsum("kt,ktn->kn", blocks[-1].coefficients, np.eye(n)[dofs]))
    return blocks, np.sort(rng.permutation(n)[:5]), np.vstack(rows)


@pytest.mark.parametrize("seed", range(12))
def test_the_columns_span_the_null_space(seed: int) -> None:
    blocks, fixed, C = random_relations(seed)
    n = C.shape[1]
    tied = make_ties(blocks, fixed, np.zeros((n // 2, 2)))
    T = tied.within.toarray()
    assert not np.isin(tied.dependent, fixed).any()
    assert not T[:, tied.dependent].any()
    # Entries are sums of a few products of size 1, over pivots of at least a tenth.
    near(T @ T, T, 1e-11 * np.abs(T).max())
    # Relations between prescribed values alone are not part of T.
    given = [tied.given.toarray(), np.eye(n)[tied.dependent]]
    wanted, allowed = null_space(C), T @ null_space(np.vstack(given))
    assert allowed.shape == wanted.shape
    assert subspace_angles(allowed, wanted).max() < 1e-9
    # Loads that were changed stay the same bits.
    once = tied.load(np.random.default_rng(1).normal(size=n))
    assert tied.load(once) is once


@pytest.mark.parametrize("sides", [("left",), ("left", "front")])
@pytest.mark.parametrize("point", [(0.5, 0.5, 2.0), (0.3, -0.4, 1.0)])
def test_force_at_a_rigid_set_on_planes(sides: Any, point: Any) -> None:
    """It turns with the body: planes take the force across them, however inclined."""
    straight, mesh = np.eye(3), box("hexahedron", 2)

    def carried(Q: Floats) -> Floats:
        model = fem.assemble(
            [fem.Body("it", placed(mesh, Q @ mesh.p), STEEL)],
            [],
            symmetries=[Symmetry("it", side) for side in sides],
            remotes=[Remote("grip", "it", "top", Q @ point)],
            springs=[fem.Spring("it", "right", 5.0)],
        )
        f = model.reference_force("grip", Q @ [1.3, 0.7, -2.0], Q @ [0.1, 0.2, 0.3])
        steps = model.problem().solve(f)
        force, moment = reference_force(model, steps, "grip")
        (warning,) = inspect(model)
        assert f"'grip' determine {1 + len(sides)} of the 6 components" in warning
        return np.concatenate([force[0] @ Q, moment[0] @ Q])

    wanted = carried(straight)
    assert not wanted[0]
    assert wanted[2] == pytest.approx(-2.0)
    for vector in ([0.0, 0.0, 0.4], [0.3, -0.4, 0.5]):
        turned = Rotation.from_rotvec(vector).as_matrix()
        # Rounding times the condition of a small elastic body, 1e3.
        close(carried(turned), wanted, 1e-11)


@pytest.mark.parametrize(
    ("components", "moved"),
    [((0,), [0.01]), ((1,), [0.02]), ((0, 1), [-0.006, 0.008])],
)
def test_supports_of_nodes_on_a_plane(components: Any, moved: Floats) -> None:
    """The plane takes force across itself alone: along it, supports balance the loads."""
    across, along = np.array([0.8, 0.6]), np.array([-0.6, 0.8])
    mesh = box("quadrilateral")
    body = fem.Body(
        "it",
        placed(mesh, np.outer(across, mesh.p[0]) + np.outer(along, mesh.p[1])),
        STEEL,
    )
    held = Support("it", "bottom", components)
    model = fem.assemble([body], [], [held], symmetries=[Symmetry("it", "left")])
    f = np.random.default_rng(0).normal(size=model.n)
    result = model.problem().solve(f, model.prescribed([moved]))
    u = result.displacement[0].reshape(-1, 2)
    bottom = model.nodes @ along < 1e-9
    near(u[bottom][:, components], np.tile(moved, (bottom.sum(), 1)), 1e-14)
    near(u[model.nodes @ across < 1e-9] @ across, 0.0, 1e-14 * np.abs(u).max())
    total = f.reshape(-1, 2).sum(axis=0) + support_force(model, result, "it.bottom")[0]
    # Rounding of the stiffness of 200 times displacements of 0.1.
    assert abs(total @ along) < 1e-12


def test_prescribed_values_that_contradict_a_relation() -> None:
    grip = Remote("grip", "it", "top", components=(0, 1), rotations=(2,))
    body, held = (
        fem.Body("it", box("quadrilateral"), STEEL),
        Support("it", "top", (0, 1)),
    )
    model = fem.assemble([body], [], [held], remotes=[grip])
    model.prescribed([[0.0, 0.1]], {"grip": [0.0, 0.1, 0.0]})
    with refused(r"contradict .*a rigid set.* by 0\.3: prescribe"):
        model.prescribed([[0.0, 0.1]], {"grip": [0.0, 0.4, 0.0]})
