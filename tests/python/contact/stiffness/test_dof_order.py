"""Rigid motions show a wrong order of the degrees of freedom and accept a right one."""

import csv
import itertools
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from scipy.io import mmwrite

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs._lib.validation import csr
from bipot_rs.contact.stiffness import dof_order
from support.children import bipot
from support.orders import CELLS, body, by_component

pytestmark = pytest.mark.needs_extra

Floats = NDArray[np.float64]


def fit(K: Any, order: str, nodes: Floats) -> dof_order.Fit:
    dof_pattern = dof_order.of_order(csr("K", K).parts, order, nodes.shape[1], nodes)
    assert dof_pattern is not None
    return dof_pattern


@pytest.mark.parametrize(("cell", "d", "order"), CELLS)
@pytest.mark.parametrize("aspect", [1.0, 100.0])
def test_orders_of_meshes(cell: str, d: int, order: int, aspect: float) -> None:
    """The right order leaves only rounding errors; a wrong one leaves large forces in some rows."""
    meshed = body(cell, d, order, aspect=aspect)
    K, x = fem.stiffness(meshed).tocsr(), meshed.points
    n = K.shape[0]
    turned = by_component(n, d)
    by = {"node": K, "component": K[turned][:, turned].tocsr()}
    for name, matrix in by.items():
        right = fit(matrix, name, x)
        assert right.fits
        assert right.rows == right.still == right.turnable == n
        assert right.translation <= 1e-14
        # Six nodes on a side with aspect ratio 100 cancel four digits.
        assert right.rotation <= 1e-11
        other = next(o for o in dof_order.ORDERS if o != name)
        wrong = fit(matrix, other, x)
        assert not wrong.fits
    rng = np.random.default_rng(1)
    first = np.arange(len(x))
    first[[3, 4]] = 4, 3
    for rows in (rng.permutation(len(x)), first):
        wrong = fit(K, "node", x[rows])
        assert wrong.translates
        assert not wrong.fits
        assert wrong.rotation > 0.03
    # Axes exchanged: a linear field, visible only in the rows of the boundary.
    assert not fit(K, "node", x[:, ::-1]).fits


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
    assert dof_order.of_order(parts, "node", 2, np.zeros((6, 2))) is None
    # A point between inclined springs, and a chain that cannot rotate.
    slope = csr("K", [[1.0, -1.0], [-1.0, 1.0]]).parts
    assert dof_order.of_order(slope, "node", 2, np.zeros((1, 2))) is None
    chain = np.diag([1.0] + 6 * [2.0] + [1.0]) - np.eye(8, k=1) - np.eye(8, k=-1)
    both = sparse.csr_array(np.kron(chain, np.eye(2)))
    assert fit(both, "node", np.random.default_rng(0).random((8, 2))).fits
    assert dof_order.fitting(csr("K", both).parts, 2) == ["node"]


def test_warnings_of_contact_problem() -> None:
    """The warning gives the misfit and the order that fits better."""
    meshed = body("quadrilateral", 2)
    K, x = fem.stiffness(meshed).tocsr(), meshed.points
    n = K.shape[0]
    at = meshed.nodes("bottom")
    fixed = (2 * meshed.nodes("top")[:, None] + np.arange(2)).ravel()
    rows = np.arange(2 * len(at))
    columns = np.stack([2 * at + 1, 2 * at], axis=1).ravel()
    B = sparse.csr_array((np.ones(len(rows)), (rows, columns)), (2 * len(at), n))
    arguments: dict[str, Any] = {"gap": np.zeros(len(at)), "mu": 0.3, "fixed": fixed}

    def warned(K: Any, B: Any, **options: Any) -> list[str]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            bp.ContactProblem(K, B, **arguments, **options)
        assert all(meshed.filename == __file__ for meshed in caught)
        return [str(meshed.message) for meshed in caught]

    nodes, components = np.repeat(x, 2, axis=0), np.tile(x, (2, 1))
    assert warned(K, B, coordinates=nodes) == []
    assert warned(K, B, coordinates=np.column_stack([nodes, np.zeros(n)])) == []
    assert warned(K, B, points=x[at]) == []
    # Supported as by skfem.enforce, but kept symmetric.
    (remark,) = warned(K, B, coordinates=components)
    assert remark.startswith(
        "coordinates do not fit K: they are component after component, all u_x, then all "
        "u_y; K times a rigid "
    )
    assert "does not cancel, expected only rounding errors" in remark
    assert "coordinates = numpy.repeat(nodes, d, axis=0) would fit" in remark
    shuffled = np.random.default_rng(3).permutation(len(x))
    (remark,) = warned(K, B, coordinates=np.repeat(x[shuffled], 2, axis=0))
    assert "K times a rigid rotation is not zero in" in remark
    assert remark.endswith("give the coordinates in the order of the rows of K")
    # K has all u_x first, B has node after node: this is visible without coordinates.
    turned = by_component(n, 2)
    (remark,) = warned(K[turned][:, turned], B, points=x[at])
    assert remark == (
        "B does not fit K: the rigid translations of K are component after component, all "
        "u_x, then all u_y, but the columns of B at 5 contacts, first contact 0, are the "
        "components of one node if the order is node after node, degree of freedom = d * row "
        "+ component; give K, B and coordinates in one order"
    )
    (remark,) = warned(K[turned][:, turned], B, coordinates=components)
    assert remark.startswith(
        "B does not fit coordinates: coordinates are component after"
    )
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


@pytest.fixture
def files(tmp_path: Path) -> Any:
    """A block on a floor as files, with any order of nodes and of components."""
    meshed = body("quadrilateral", 2, aspect=2.0)
    x, n = meshed.points, meshed.points.size
    K = fem.stiffness(meshed).tocsr()
    bottom, top = meshed.nodes("bottom"), meshed.nodes("top")

    def table(name: str, header: str, rows: Any) -> None:
        with (tmp_path / name).open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(header.split())
            writer.writerows(rows)

    def write(
        rows: Any = slice(None), order: str = "node", supports: bool = False
    ) -> None:
        of = by_component(n, 2) if order == "component" else np.arange(n)
        matrix = K
        if supports:
            some = np.zeros(n)
            some[2 * bottom[[0]]] = 1.0
            matrix = (K + sparse.diags_array(1e6 * K.diagonal() * some)).tocsr()
        mmwrite(
            tmp_path / "K.mtx",
            sparse.coo_matrix(matrix[of][:, of]),
            symmetry="symmetric",
            precision=17,
        )
        label = np.arange(1, len(x) + 1)
        listed = np.column_stack([label, x]).tolist()
        kept = np.arange(len(x))[rows]
        table(
            "nodes.csv", "node x y", ([int(listed[k][0]), *listed[k][1:]] for k in kept)
        )
        table("contacts.csv", "node nx ny mu", ([label[k], 0, 1, 0.3] for k in bottom))
        table("load.csv", "node fx fy", ([label[k], 20.0, -100.0] for k in top))

    def run(*more: str, as_json: bool = True) -> tuple[int, Any]:
        command = ["solve", "--stiffness", "K.mtx", "--contacts", "contacts.csv"]
        command += ["--nodes", "nodes.csv", "--load", "load.csv", *more]
        done = bipot(*command, *(["--json"] if as_json else []), cwd=tmp_path)
        if not as_json:
            assert "Warning" not in done.stderr
            return done.returncode, done.stdout
        assert done.stderr == ""
        return done.returncode, json.loads(done.stdout.splitlines()[-1])

    return write, run


def test_orders_of_files(files: Any, tmp_path: Path) -> None:
    write, run = files

    def pressed() -> float:
        reaction = bp.load(tmp_path / "out" / "K" / "result.h5").reaction
        return float(reaction[-1, :, 0].sum())

    write()
    assert run()[0] == run("--order", "node")[0] == 0
    # The force on the floor is the sum of the pressing loads, 100 N per node.
    assert pressed() == pytest.approx(500.0, rel=1e-9)
    code, last = run("--order", "component")
    assert code == 2
    assert (
        "K.mtx does not fit the rows of nodes.csv as component after" in last["message"]
    )
    assert "--order node would fit" in last["message"]
    write(order="component")
    code, last = run()
    assert code == 2
    assert (
        "as node after node, degree of freedom = d * row + component" in last["message"]
    )
    assert "--order component would fit, component after" in last["message"]
    assert run("--order", "component")[0] == 0
    assert pressed() == pytest.approx(500.0, rel=1e-9)
    code, last = run("--order", "nodes")
    assert code == 2
    assert last["message"] == "order is 'nodes', expected node or component"


@pytest.mark.parametrize("supports", [False, True])
@pytest.mark.quick_variants("True")
def test_rows_of_nodes_in_another_order(supports: bool, files: Any) -> None:
    write, run = files
    rows = np.random.default_rng(5).permutation(25)
    for order in dof_order.ORDERS:
        write(rows=rows, order=order, supports=supports)
        for more in ([], ["--order", order]):
            code, last = run(*more)
            assert code == 2
            assert "K times a rigid " in last["message"]
            assert "the rows of nodes.csv sorted by label would fit" in last["message"]
    # Two nodes only: few rows show it, and other causes are possible.
    swapped = np.arange(25)
    swapped[[0, 1]] = 1, 0
    write(rows=swapped, supports=supports)
    code, last = run()
    assert code == 2
    assert "K times a rigid rotation is not zero in" in last["message"]
    assert ", first at node 2; if springs" in last["message"]
    done = run("--order", "node", as_json=False)
    assert done[0] == 0
    assert "remark: coordinates do not fit K" in done[1]


def test_a_stiffness_with_node_labels(tmp_path: Path) -> None:
    meshed = body("triangle", 2)
    K, x = sparse.coo_matrix(fem.stiffness(meshed)), meshed.points
    lines = [
        f"{i // 2 + 1},{i % 2 + 1},{j // 2 + 1},{j % 2 + 1},{v:.17e}"
        for i, j, v in zip(K.row, K.col, K.data, strict=True)
    ]
    (tmp_path / "K.dat").write_text("\n".join(lines) + "\n")
    contacts = "".join(f"{k + 1},0,1,0.3\n" for k in meshed.nodes("bottom"))
    (tmp_path / "contacts.csv").write_text("node,nx,ny,mu\n" + contacts)
    (tmp_path / "load.csv").write_text(
        f"node,fx,fy\n{meshed.nodes('top')[2] + 1},0,-1\n"
    )
    command = ["solve", "--stiffness", "K.dat", "--contacts", "contacts.csv"]
    command += ["--nodes", "nodes.csv", "--load", "load.csv"]
    rng = np.random.default_rng(6)
    for places, code in ((x, 0), (x[rng.permutation(len(x))], 2)):
        # Rows in any order: the labels identify them.
        rows = [
            f"{k + 1},{places[k, 0]!r},{places[k, 1]!r}\n"
            for k in rng.permutation(len(x))
        ]
        text = "node,x,y\n" + "".join(rows).replace("np.float64(", "").replace(")", "")
        (tmp_path / "nodes.csv").write_text(text)
        run = bipot(*command, cwd=tmp_path)
        assert run.returncode == code, run.stderr
    assert "K.dat does not fit the coordinates of its nodes in nodes.csv" in run.stderr
    run = bipot(*command, "--order", "node", cwd=tmp_path)
    assert run.returncode == 2
    assert "names its degrees of freedom by node" in run.stderr


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200))
def test_any_body_in_any_order(seed: int) -> None:
    """Curved and graded bodies of every cell type, rotated and shuffled at random."""
    rng = np.random.default_rng(seed)
    cell, d, order = CELLS[seed % len(CELLS)]
    meshed = body(
        cell, d, order, cells=int(rng.integers(2, 5)), aspect=10 ** rng.uniform(-2, 2)
    )
    x = meshed.points
    turn = np.linalg.qr(rng.normal(size=(d, d)))[0]
    rotation = np.kron(np.eye(len(x)), turn)
    K = sparse.csr_array(rotation @ fem.stiffness(meshed).toarray() @ rotation.T)
    x = x @ turn.T + rng.normal(size=d)
    new = rng.permutation(len(x))
    dofs = (d * new[:, None] + np.arange(d)).ravel()
    K, x = K[dofs][:, dofs], x[new]
    assert fit(K, "node", x).fits
    assert not fit(K, "component", x).fits
    turned = by_component(K.shape[0], d)
    assert fit(K[turned][:, turned], "component", x).fits
    assert not fit(K[turned][:, turned], "node", x).fits
    assert not fit(K, "node", x[rng.permutation(len(x))]).fits
