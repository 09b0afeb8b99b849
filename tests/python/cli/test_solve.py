"""`bipot solve`: files of another program give bitwise the result of arrays."""

import csv
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy import sparse
from scipy.io import mmwrite

import bipot_rs as bp
from bipot_rs.cli.solve import matrix_files
from bipot_rs.contact.results.tables import FORCES
from support.children import bipot, bipot_with
from support.matrix_and_tables import AXES, MODELS, labels, written


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("by_dof", [False, True], ids=["nodes", "dofs"])
def test_files_give_bitwise_the_result_of_arrays(
    name: str, by_dof: bool, tmp_path: Path
) -> None:
    command, case = written(tmp_path, name, by_dof=by_dof)
    run = bipot(*command, "--out", "here", "--tol", "1e-12", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    model = case.model
    loaded = bp.load(tmp_path / "here" / "result.h5")
    assert loaded.success
    if not by_dof:
        assert loaded.contacts["x"].tobytes() == model.points.tobytes()
    options: dict[str, Any] = {
        "gap": model.gap,
        "mu": model.mu,
        "area": model.area,
        "fixed": model.fixed,
        "dim": model.dim,
    }
    if not by_dof:  # which decides the order of elimination
        options["coordinates"] = np.repeat(model.nodes, model.dim, axis=0)
    problem = bp.ContactProblem(model.K, model.B, **options)
    expected = problem.solve(case.load, case.prescribed, tol=1e-12)
    for field in (
        "reaction",
        "relative_displacement",
        "slip",
        "status",
        "displacement",
    ):
        assert getattr(loaded, field).tobytes() == getattr(expected, field).tobytes()
    for index in ("contact.pvd", "result.pvd"):
        assert (tmp_path / "here" / index).exists() is not by_dof


@pytest.mark.parametrize("form", ["lower", "upper", "both"])
def test_stiffness_by_nodes(form: str, tmp_path: Path) -> None:
    """Another numbering of the degrees of freedom gives the same solution."""
    command, case = written(tmp_path, "block", form=form)
    run = bipot(*command, "--out", "here", "--tol", "1e-12", "--json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    loaded = bp.load(tmp_path / "here" / "result.h5")
    expected = case.solve(tol=1e-12)
    size = np.abs(expected.reaction).max()
    # η of 1e-12, and the condition of W, some hundreds here.
    assert np.abs(loaded.reaction - expected.reaction).max() <= 1e-9 * size
    *_, last = map(json.loads, run.stdout.splitlines())
    assert (last["dofs"], last["contacts"], last["success"]) == (50, 5, True)
    # Tables by node labels.
    label = labels(25)
    with (tmp_path / "here" / "displacements.csv").open() as file:
        rows = list(csv.DictReader(file))
    u = {(int(r["node"]), r["component"]): float(r["displacement"]) for r in rows}
    for (node, component), value in u.items():
        at = 2 * int(np.flatnonzero(label == node)[0]) + AXES.index(component)
        assert value == pytest.approx(
            expected.displacement[0, at],
            abs=1e-9 * np.abs(expected.displacement).max(),
        )
    with (tmp_path / "here" / "reactions.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == [
        ("open", "slip", "stick")[s] for s in expected.status[0]
    ]
    assert sum(float(row["f_y"]) for row in rows) == pytest.approx(2000.0, rel=1e-9)
    assert [float(row["r_n"]) for row in rows] == loaded.reaction[0, :, 0].tolist()


def test_gaps_of_listed_nodes(tmp_path: Path) -> None:
    """The default gap is the distance of the nodes along the normal."""
    eye = sparse.identity(4, format="coo")
    mmwrite(tmp_path / "K.mtx", eye, symmetry="symmetric")
    (tmp_path / "nodes.csv").write_text("node, x, y\n7, 0, 0.5\n3, 0.1, 0.25\n")
    (tmp_path / "contacts.csv").write_text(
        "# one that knows its distance, and one that is told it\n"
        "node,other,nx,ny,mu,gap\n7,3,0,2,0.3,\n\n7,3,0,1,0.3,0.125\n"
    )
    arrays_read = matrix_files.read(
        tmp_path / "K.mtx", tmp_path / "contacts.csv", tmp_path / "nodes.csv"
    )
    np.testing.assert_array_equal(arrays_read.gap, [0.25, 0.125])
    np.testing.assert_array_equal(
        arrays_read.B.toarray()[:2], [[0, 1, 0, -1], [1, 0, -1, 0]]
    )
    assert arrays_read.area is None


Edit = Callable[[str], str]


def line(number: int, text: str) -> Edit:
    """Replace a line."""

    def edit(content: str) -> str:
        lines = content.splitlines()
        lines[number - 1] = text
        return "\n".join(lines)

    return edit


@pytest.mark.parametrize(
    ("file", "edit", "words"),
    [
        ("K.mtx", lambda _: "", "K.mtx has no entries"),
        (
            "K.mtx",
            lambda _: "1 1 2.0\n",
            "K.mtx line 1: is '1 1 2.0', expected row node",
        ),
        (
            "K.mtx",
            lambda _: "1,1,1,1,2\n1,1,1,1,2\n",
            "assemble the element matrices first",
        ),
        (
            "K.mtx",
            lambda _: "1,1,-2,1,2\n",
            "K.mtx line 1: '1,1,-2,1,2' belongs to an internal",
        ),
        (
            "K.mtx",
            lambda _: "%%MatrixMarket matrix coordinate pattern general\n1 1 1\n1 1\n",
            "its numbers are pattern, expected real",
        ),
        (
            "K.mtx",
            lambda _: "%%MatrixMarket matrix coordinate real general\n1 2 1\n1 1 3\n",
            "it has 1 rows and 2 columns",
        ),
        (
            "K.mtx",
            lambda text: text[:200],
            "is not a stiffness in Matrix Market format",
        ),
        ("nodes.inp", line(6, "13, x, 0"), "nodes.inp line 6: is '13, x, 0', expected"),
        ("nodes.inp", line(6, "13, 0, 0\n13, 1, 1"), "repeats node 13 of line "),
        ("nodes.inp", line(4, "*NODE, INPUT=more.inp"), "nodes in another file"),
        (
            "nodes.inp",
            lambda text: text.replace("*ELEMENT", "999, 0.0, 0.0\n*ELEMENT"),
            "K.mtx has 50 rows, expected 2 for each of the 26 nodes of nodes.inp",
        ),
        (
            "contacts.csv",
            line(3, "1,0,2,0.3,1,0"),
            "contacts.csv line 3: there is no node 1",
        ),
        (
            "contacts.csv",
            line(3, "1,0,2"),
            "contacts.csv line 3: has 3 entries, expected 6",
        ),
        (
            "contacts.csv",
            line(1, "node,nx,ny,nu,area,gap"),
            "line 1: there is no column mu",
        ),
        (
            "contacts.csv",
            line(1, "nd,nx,ny,mu,area,gap"),
            "line 1: there is no column node, found nd, nx, ny, mu, area, gap: is it 'nd'?",
        ),
        ("contacts.csv", line(1, "node,nx,ny,mu,area,gab"), "column 'gab' is unknown"),
        ("contacts.csv", lambda _: "node,nx,ny,mu\n", "contacts.csv has no contacts"),
        ("contacts.csv", lambda _: "", "contacts.csv is empty"),
        (
            "load.csv",
            line(2, "0,10,a,0"),
            "load.csv line 2: fx is 'a', expected a finite",
        ),
        ("load.csv", line(2, "-1,10,1,0"), "load.csv line 2: step is -1, expected 0"),
        ("load.csv", line(2, "2,10,1,0"), "load.csv has step 2 but no step 1: "),
        (
            "contacts.csv",
            lambda text: text.replace(",", ";"),
            "contacts.csv line 1: has one column, 'node;nx;ny;mu;area;gap': expected names",
        ),
        ("load.csv", line(2, "0,10,1_0,0"), "load.csv line 2: fx is '1_0', expected"),
        ("load.csv", line(2, "0,1_0,1,0"), "load.csv line 2: node is '1_0', expected"),
        ("nodes.inp", line(6, "13, 1_0, 0"), "nodes.inp line 6: is '13, 1_0, 0', exp"),
        ("K.mtx", lambda _: "1,1,1,1,1_0\n", "K.mtx line 1: is '1,1,1,1,1_0'"),
        (
            "fixed.csv",
            line(2, "0,10.5,1,0"),
            "fixed.csv line 2: node is '10.5', expected an",
        ),
        (
            "fixed.csv",
            lambda text: text + text.splitlines()[1] + "\n",
            "ux is already given on line 2",
        ),
        *(
            ("contacts.csv", line(3, f"10,{row}"), f"contacts.csv line 3: {words}")
            for row, words in (
                ("0,0,0.3,1,0", "the normal is zero"),
                ("0,1,-0.3,1,0", "mu is -0.3, expected zero or positive"),
                ("0,1,0.3,0,0", "area is 0, expected a positive number"),
                ("0,1,,1,0", "mu is '', expected a finite number"),
                ("0,1,0.3,1,inf", "gap is 'inf', expected a finite number"),
            )
        ),
    ],
)
def test_mistakes_name_file_and_line(
    file: str, edit: Edit, words: str, tmp_path: Path
) -> None:
    command, _ = written(tmp_path, "block")
    path = tmp_path / file
    path.write_text(edit(path.read_text()))
    run = bipot(*command, "--json", cwd=tmp_path)
    assert run.returncode == 2
    (last,) = map(json.loads, run.stdout.splitlines())
    assert words in last["message"]
    assert "\n" not in last["message"]


def test_a_matrix_that_is_not_text(tmp_path: Path) -> None:
    command, _ = written(tmp_path, "block", by_dof=True)
    sparse.save_npz(tmp_path / "K.npz", sparse.identity(4, format="csr"))
    command[command.index("--stiffness") + 1] = "K.npz"
    run = bipot(*command, cwd=tmp_path)
    assert run.returncode == 2
    assert (
        "K.npz is not a text file, expected a Matrix Market file, as scipy"
        in run.stderr
    )


def test_a_missing_file(tmp_path: Path) -> None:
    command, _ = written(tmp_path, "block")
    (tmp_path / "load.csv").unlink()
    run = bipot(*command, cwd=tmp_path)
    assert run.returncode == 2
    assert run.stderr == "bipot: load.csv: No such file or directory\n"
    assert not (tmp_path / "out").exists()


def test_degrees_of_freedom_without_nodes(tmp_path: Path) -> None:
    command, _ = written(tmp_path, "block", by_dof=True)
    path = tmp_path / "contacts.csv"
    path.write_text(line(2, "0,50,0,1,0.3,1,0")(path.read_text()))
    run = bipot(*command, cwd=tmp_path)
    assert run.returncode == 2
    assert (
        "line 2: degree of freedom 50 is out of range: the stiffness has 50 (0 to 49)"
        in run.stderr
    )
    path.write_text("dof_x,dof_y,other_x,other_y,nx,ny,mu\n0,1,4,,0,1,0.3\n")
    run = bipot(*command, cwd=tmp_path)
    assert run.returncode == 2
    assert "line 2: other_y is empty but other_x is 4: give all" in run.stderr
    path.write_text("node,nx,ny,mu\n3,0,1,0.3\n")
    run = bipot(*command, cwd=tmp_path)
    assert "names a node: give --nodes" in run.stderr


def test_wrong_normals_give_a_remark(tmp_path: Path) -> None:
    """No contact closes: a correct solution, but hardly ever the intended one."""
    mmwrite(tmp_path / "K.mtx", sparse.identity(2, format="coo"), symmetry="symmetric")
    (tmp_path / "load.csv").write_text("dof,force\n1,-1\n")
    command = ["solve", "--stiffness", "K.mtx", "--contacts", "contacts.csv"]
    for normal, remarked in ((1, False), (-1, True)):
        (tmp_path / "contacts.csv").write_text(
            f"dof_x,dof_y,nx,ny,mu,gap\n0,1,0,{normal},0.3,0\n"
        )
        run = bipot(*command, "--load", "load.csv", cwd=tmp_path)
        assert run.returncode == 0, run.stderr
        assert ("no contact closes in any load step" in run.stdout) is remarked
        assert ("that the normals point from the obstacle" in run.stdout) is remarked


def test_forces_of_the_contact_surface(tmp_path: Path) -> None:
    """Two nodes pressed by 1 N each and pulled by 0.4 N, of the 1 N that μ = 0.5 holds."""
    K = sparse.coo_matrix(np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2)))
    mmwrite(tmp_path / "K.mtx", K, symmetry="symmetric")
    (tmp_path / "contacts.csv").write_text(
        "dof_x,dof_y,nx,ny,mu\n0,1,0,1,0.5\n2,3,0,1,0.5\n"
    )
    (tmp_path / "load.csv").write_text("dof,force\n1,-1\n3,-1\n0,0.4\n")
    command = ["solve", "--stiffness", "K.mtx", "--contacts", "contacts.csv"]
    run = bipot(*command, "--load", "load.csv", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    head, row = (
        next(line for line in run.stdout.splitlines() if re.match(start, line)).split()
        for start in (" step ", "    1 ")
    )
    told = dict(zip(head, row, strict=True))
    assert (told["Fn"], told["Ft"], told["Ft/(μFn)"]) == ("2", "0.4", "0.4000")
    assert "solved: 1 load step, every residual at most" in run.stdout
    with (tmp_path / "out" / "K" / "steps.csv").open(newline="") as file:
        (step,) = csv.DictReader(file)
    forces = [float(step[f"{k} of contacts"]) for k in FORCES]
    np.testing.assert_allclose(forces, (2.0, 0.4, 0.4), rtol=1e-9)


def test_no_answer_and_floating_bodies(tmp_path: Path) -> None:
    """Pulled harder than friction can carry; and bodies that contact cannot hold."""
    K = sparse.coo_matrix(np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2)))
    mmwrite(tmp_path / "K.mtx", K, symmetry="symmetric")
    (tmp_path / "contacts.csv").write_text(
        "dof_x,dof_y,nx,ny,mu\n0,1,0,1,0.5\n2,3,0,1,0.5\n"
    )
    (tmp_path / "load.csv").write_text(
        "step,dof,force\n0,1,-1\n0,3,-1\n0,0,0.4\n1,1,-1\n1,3,-1\n1,0,1.5\n"
    )
    command = ["solve", "--stiffness", "K.mtx", "--contacts", "contacts.csv"]
    run = bipot(*command, "--load", "load.csv", "--json", cwd=tmp_path)
    assert run.returncode == 1
    first, last = map(json.loads, run.stdout.splitlines())
    assert (first["step"], first["stick"]) == (0, 2)
    assert "load step 2: no solution exists" in last["message"]
    # Without --json; the second step is not reached.
    run = bipot(*command, "--load", "load.csv", cwd=tmp_path)
    assert run.stderr.startswith(
        f"load step 1 of 2: open 0, slip 0, stick 2, residual {first['residual']:.1e}\n"
        "bipot: load step 2: no solution exists"
    )
    # The solved step has its row, and the path is not called solved.
    assert re.search(r"^    1     0     0      2   2  0\.4 ", run.stdout, re.M)
    assert "solved" not in run.stdout
    kept = bp.load(tmp_path / "out" / "K" / "result.h5")
    assert (len(kept), kept.success) == (1, False)
    # The second node is a separate body that nothing touches.
    mmwrite(tmp_path / "K.mtx", sparse.diags_array([1.0, 1, 0, 0]).tocoo())
    (tmp_path / "contacts.csv").write_text("dof_x,dof_y,nx,ny,mu\n0,1,0,1,0\n")
    run = bipot(*command, cwd=tmp_path)
    assert run.returncode == 1
    assert "degree of freedom 2" in run.stderr
    # Without --nodes there are no labels.
    assert "of node" not in run.stderr


def test_an_interrupt_keeps_the_steps(tmp_path: Path) -> None:
    command, _ = written(tmp_path, "blocks")

    def fault(step: int, *_: object) -> None:
        if step == 1:
            raise KeyboardInterrupt

    run = bipot_with(fault, "bipot_rs.cli.solve.job:make_row", *command, cwd=tmp_path)
    assert run.returncode == 130
    kept = bp.load(tmp_path / "out" / "K" / "result.h5")
    assert (len(kept), kept.success, kept.message) == (1, False, "interrupted")
    whole = bipot(*command, cwd=tmp_path)
    assert whole.returncode == 0
    with h5py.File(tmp_path / "out" / "K" / "result.h5") as file:
        assert len(file["steps"]) == 2
    shutil.rmtree(tmp_path / "out")
    (tmp_path / "out").write_text("no folder")
    assert bipot(*command, cwd=tmp_path).returncode == 2


def test_a_floating_body_is_named_by_its_node(tmp_path: Path) -> None:
    mmwrite(tmp_path / "K.mtx", sparse.diags_array([1.0, 1, 0, 0]).tocoo())
    (tmp_path / "nodes.csv").write_text("node,x,y\n3,0,0\n7,1,0\n")
    (tmp_path / "contacts.csv").write_text("node,nx,ny,mu\n3,0,1,0.3\n")
    command = ["solve", "--stiffness", "K.mtx", "--contacts", "contacts.csv"]
    run = bipot(*command, "--nodes", "nodes.csv", cwd=tmp_path)
    assert run.returncode == 1
    assert re.search(
        r"\(degree of freedom [23] is [xy] of node 7\)$", run.stderr.strip()
    )
