"""Rigid motions show a wrong order of the degrees of freedom and accept a right one."""

import itertools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs._lib.validation import csr
from bipot_rs.contact.stiffness import dof_order
from support.matrix_and_tables import of_nodes
from support.orders import CELLS, body, by_component

pytestmark = pytest.mark.needs_extra

Floats = NDArray[np.float64]


def fit(K: Any, order: str, nodes: Floats) -> dof_order.Fit:
    dof_pattern = dof_order.fit_order(csr("K", K).parts, order, nodes.shape[1], nodes)
    assert dof_pattern is not None
    return dof_pattern


@pytest.mark.parametrize(("cell", "d", "order"), CELLS)
@pytest.mark.slow_variants("*-3-2")
def test_supports_and_few_digits_are_not_a_wrong_order(
    cell: str, d: int, order: int
) -> None:
    meshed = body(cell, d, order)
    K, x = fem.stiffness(meshed).tocsr(), meshed.points
    n = K.shape[0]
    rng = np.random.default_rng(2)
    sides = [meshed.nodes(name) for name in ("left", "bottom")]
    kinds = list(itertools.product((0, 1), ("penalty", "eliminated", "springs")))
    for side, kind in kinds:
        for components in ((0,), (1,), tuple(range(d))):
            held = np.concatenate([d * sides[side] + c for c in components])
            some = np.zeros(n)
            some[held] = 1.0
            if kind == "penalty":
                changed_K = K + sparse.diags_array(1e8 * K.diagonal() * some)
            elif kind == "springs":
                changed_K = K + sparse.diags_array(rng.random(n) * K.diagonal() * some)
            else:
                keep = sparse.diags_array(1 - some)
                changed_K = keep @ K @ keep + sparse.diags_array(some)
            assert fit(changed_K.tocsr(), "node", x).fits
    # A symmetry plane at 45 degrees, by penalty: the sums of its rows stay zero.
    across = np.zeros(n)
    across[d * sides[0]], across[d * sides[0] + 1] = 1.0, -1.0
    nodes = sparse.csc_array((across, (np.arange(n), np.arange(n) // d)))
    assert fit((K + 1e9 * nodes @ nodes.T).tocsr(), "node", x).fits
    for digits in (4, 6):
        changed_K = K.tocsr()
        changed_K.data = np.array([float(f"{v:.{digits}g}") for v in changed_K.data])
        assert fit(changed_K, "node", np.round(x, digits)).fits


def test_springs_without_rigid_motions_pass() -> None:
    parts = csr("K", np.eye(12)).parts
    assert dof_order.fit_order(parts, "node", 2, np.zeros((6, 2))) is None
    # A point between inclined springs, and a chain that cannot rotate.
    slope = csr("K", [[1.0, -1.0], [-1.0, 1.0]]).parts
    assert dof_order.fit_order(slope, "node", 2, np.zeros((1, 2))) is None
    chain = np.diag([1.0] + 6 * [2.0] + [1.0]) - np.eye(8, k=1) - np.eye(8, k=-1)
    both = sparse.csr_array(np.kron(chain, np.eye(2)))
    assert fit(both, "node", np.random.default_rng(0).random((8, 2))).fits
    assert dof_order.list_fitting(csr("K", both).parts, 2) == ["node"]


def test_warnings_of_contact_problem() -> None:
    """The warning gives the misfit and the order that fits better."""
    meshed = body("quadrilateral", 2)
    K, x = fem.stiffness(meshed).tocsr(), meshed.points
    n = K.shape[0]
    at = meshed.nodes("bottom")
    fixed = (2 * meshed.nodes("top")[:, None] + np.arange(2)).ravel()
    B = sparse.eye_array(n, format="csr")
    B = B[np.stack([2 * at + 1, 2 * at], axis=1).ravel()]
    arguments: dict[str, Any] = {"gap": np.zeros(len(at)), "mu": 0.3, "fixed": fixed}

    def warned(K: Any, B: Any, **options: Any) -> list[str]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            bp.ContactProblem(K, B, **arguments, **options)
        assert all(warning.filename == __file__ for warning in caught)
        return [str(warning.message) for warning in caught]

    nodes, components = np.repeat(x, 2, axis=0), np.tile(x, (2, 1))
    assert warned(K, B, coordinates=nodes) == []
    assert warned(K, B, coordinates=np.column_stack([nodes, np.zeros(n)])) == []
    assert warned(K, B, points=x[at]) == []
    (remark,) = warned(K, B, coordinates=components)
    assert "coordinates do not fit K: they are component after component" in remark
    assert "coordinates = numpy.repeat(nodes, d, axis=0) would fit" in remark
    shuffled = np.random.default_rng(3).permutation(len(x))
    (remark,) = warned(K, B, coordinates=np.repeat(x[shuffled], 2, axis=0))
    assert remark.endswith("give the coordinates in the order of the rows of K")
    # K has all u_x first, B has node after node: this is visible without coordinates.
    turned = by_component(n, 2)
    (remark,) = warned(K[turned][:, turned], B, points=x[at])
    assert remark.startswith("B does not fit K: the rigid translations of K are compo")
    assert "the columns of B at 5 contacts, first contact 0, are the" in remark
    (remark,) = warned(K[turned][:, turned], B, coordinates=components)
    assert "B does not fit coordinates: coordinates are component after" in remark
    # Frictionless pairs with normals only: two columns for two nodes are correct.
    rows = np.repeat(np.arange(0, 10, 2), 2)
    columns = (2 * np.column_stack([at, at - at.min() + 1]) + 1).ravel()
    normals = sparse.csr_array((np.ones(10), (rows, columns)), (10, n))
    assert warned(K, normals, coordinates=nodes) == []
    arguments["fixed"] = np.flatnonzero(np.isin(turned, fixed))
    assert warned(K[turned][:, turned], B[:, turned], points=x[at]) == []
    assert warned(K[turned][:, turned], B[:, turned], coordinates=components) == []


def test_large_matrices_are_checked_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    meshed = body("hexahedron", 3)
    K, x = fem.stiffness(meshed).tocsr(), meshed.points
    shuffled = x[np.random.default_rng(7).permutation(len(x))]
    whole = [fit(K, "node", places) for places in (x, shuffled)]
    monkeypatch.setattr(dof_order, "_BLOCK", 500)
    for places, expected in zip((x, shuffled), whole, strict=True):
        order = fit(K, "node", places)
        assert order.turned.tolist() == expected.turned.tolist()
        assert (order.rows, order.rotation) == (expected.rows, expected.rotation)


Run = Callable[..., tuple[int, str]]


@pytest.fixture
def run(bipot: Any) -> Run:
    """`bipot solve` of a block on a floor: its status, and its report with the errors."""
    meshed = body("quadrilateral", 2, aspect=2.0)
    K, bottom = sparse.csr_array(fem.stiffness(meshed)), meshed.nodes("bottom")
    pressed = "".join(f"{k + 1},20.0,-100.0\n" for k in meshed.nodes("top"))

    def run(
        *more: str, rows: Any = None, order: str = "node", held: bool = False
    ) -> tuple[int, str]:
        of = by_component(50, 2) if order == "component" else np.arange(50)
        some = np.isin(np.arange(50), 2 * bottom[:1]) * held
        stiff = sparse.csr_array(K + sparse.diags_array(1e6 * K.diagonal() * some))
        load = "node,fx,fy\n" + pressed
        command = of_nodes(stiff[of][:, of], meshed.points, bottom, load, rows)
        status, output, errors = bipot(*command, *more)
        assert "Warning" not in errors
        return status, output + " ".join(errors.split())

    return run


def test_orders_of_files(run: Run) -> None:
    def pressed() -> float:
        return float(bp.load("out/K/result.h5").reaction[-1, :, 0].sum())

    assert run()[0] == run("--order", "node")[0] == 0
    # The force on the floor is the sum of the pressing loads, 100 N per node.
    assert pressed() == pytest.approx(500.0, rel=1e-9)
    assert run("--order", "component", order="component")[0] == 0
    assert pressed() == pytest.approx(500.0, rel=1e-9)
    for more, order, said in (
        (["--order", "component"], "node", "the rows of nodes.csv as component after"),
        (["--order", "component"], "node", "--order node would fit"),
        ([], "component", "--order component would fit, component after"),
        (["--order", "nodes"], "node", "order is 'nodes', expected node or component"),
    ):
        status, message = run(*more, order=order)
        assert status == 2
        assert said in message


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.quick_variants("True")
def test_rows_of_nodes_in_another_order(held: bool, run: Run) -> None:
    rows = np.random.default_rng(5).permutation(25)
    for order in dof_order.ORDERS:
        for more in ([], ["--order", order]):
            code, said = run(*more, rows=rows, order=order, held=held)
            assert code == 2
            assert "the rows of nodes.csv sorted by label would fit" in said
    # Two nodes only: few rows show it, and other causes are possible.
    swapped = np.arange(25)
    swapped[[0, 1]] = 1, 0
    code, said = run(rows=swapped, held=held)
    assert code == 2
    assert "K times a rigid rotation is not zero in" in said
    assert ", first at node 2; if springs" in said
    code, said = run("--order", "node", rows=swapped, held=held)
    assert code == 0
    assert "remark: coordinates do not fit K" in said


def test_a_stiffness_with_node_labels(bipot: Any) -> None:
    meshed = body("triangle", 2)
    K, x = sparse.coo_matrix(fem.stiffness(meshed)), meshed.points
    load = f"node,fx,fy\n{meshed.nodes('top')[2] + 1},0,-1\n"
    entries = (
        f"{i // 2 + 1},{i % 2 + 1},{j // 2 + 1},{j % 2 + 1},{v:.17e}\n"
        for i, j, v in zip(K.row, K.col, K.data, strict=True)
    )
    labelled = "".join(entries)
    rng = np.random.default_rng(6)
    for places, code in ((x, 0), (x[rng.permutation(len(x))], 2)):
        # Rows in any order: the labels identify them.
        rows = rng.permutation(len(x))
        command = of_nodes(K, places, meshed.nodes("bottom"), load, rows)
        Path("K.mtx").write_text(labelled)
        status, _, errors = bipot(*command)
        assert status == code, errors
    assert "K.mtx does not fit the coordinates of its nodes in nodes.csv" in errors
    status, _, errors = bipot(*command, "--order", "node")
    assert status == 2
    assert "names its degrees of freedom by node" in errors


@pytest.mark.parametrize("seed", range(200))
@pytest.mark.quick_variants(*map(str, range(16)))
def test_any_body_in_any_order(seed: int) -> None:
    """Curved and graded bodies of every cell type, rotated and shuffled at random: the right
    order leaves only rounding errors; a wrong one leaves large forces in some rows.
    """
    rng = np.random.default_rng(seed)
    cell, d, order = CELLS[seed % len(CELLS)]
    meshed = body(
        cell, d, order, cells=int(rng.integers(2, 5)), aspect=10 ** rng.uniform(-2, 2)
    )
    x = meshed.points
    turn = np.linalg.qr(rng.normal(size=(d, d)))[0]
    rotation = sparse.kron(sparse.eye_array(len(x)), turn, format="csr")
    K = sparse.csr_array(rotation @ fem.stiffness(meshed) @ rotation.T)
    x = x @ turn.T + rng.normal(size=d)
    new = rng.permutation(len(x))
    dofs = (d * new[:, None] + np.arange(d)).ravel()
    K, x = K[dofs][:, dofs], x[new]
    turned = by_component(K.shape[0], d)
    for name, matrix in (("node", K), ("component", K[turned][:, turned])):
        right = fit(matrix, name, x)
        assert right.fits
        assert right.rows == right.still == right.turnable == K.shape[0]
        (other,) = {*dof_order.ORDERS} - {name}
        assert not fit(matrix, other, x).fits
    wrong = fit(K, "node", x[rng.permutation(len(x))])
    assert wrong.translates
    assert not wrong.fits


@pytest.mark.parametrize(("cell", "d", "order"), CELLS)
@pytest.mark.parametrize("aspect", [1.0, 100.0])
def test_two_nodes_or_axes_exchanged(
    cell: str, d: int, order: int, aspect: float
) -> None:
    """Exchanged axes are a linear field, visible only in the rows of the boundary."""
    meshed = body(cell, d, order, aspect=aspect)
    K, x = fem.stiffness(meshed).tocsr(), meshed.points
    swapped = np.arange(len(x))
    swapped[[3, 4]] = 4, 3
    for places in (x[swapped], x[:, ::-1]):
        wrong = fit(K, "node", places)
        assert wrong.translates
        assert not wrong.fits
