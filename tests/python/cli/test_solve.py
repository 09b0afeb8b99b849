"""`bipot solve`: files of another program give bitwise the result of arrays."""

import csv
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.io import mmwrite

import bipot_rs as bp
from bipot_rs.cli.run import matrix_files
from bipot_rs.contact.results.tables import FORCES
from support.children import bipot, bipot_with
from support.matrix_and_tables import AXES, MODELS, labels, of_dofs, written
from support.models_and_arrays import arguments


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
    known = arguments(model) | {"area": model.area, "dim": model.dim}
    if by_dof:  # without coordinates, which decide the order of elimination
        del known["coordinates"]
    else:
        assert loaded.contacts["x"].tobytes() == model.points.tobytes()
    problem = bp.ContactProblem(**known)
    expected = problem.solve(case.load, case.prescribed, tol=1e-12)
    fields = ("reaction", "relative_displacement", "slip", "status", "displacement")
    for field in fields:
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
    label, u = labels(25), expected.displacement[0]
    with (tmp_path / "here" / "displacements.csv").open() as file:
        for row in csv.DictReader(file):
            (node,) = np.flatnonzero(label == int(row["node"]))
            exact = u[2 * node + AXES.index(row["component"])]
            close = pytest.approx(exact, abs=1e-9 * np.abs(u).max())
            assert float(row["displacement"]) == close
    with (tmp_path / "here" / "reactions.csv").open() as file:
        rows = list(csv.DictReader(file))
    statuses = [("open", "slip", "stick")[s] for s in expected.status[0]]
    assert [row["status"] for row in rows] == statuses
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
    files = (tmp_path / name for name in ("K.mtx", "contacts.csv", "nodes.csv"))
    read = matrix_files.read(*files)
    np.testing.assert_array_equal(read.gap, [0.25, 0.125])
    np.testing.assert_array_equal(read.B.toarray()[:2], [[0, 1, 0, -1], [1, 0, -1, 0]])
    assert read.area is None


def test_a_node_that_an_included_file_repeats(tmp_path: Path) -> None:
    (tmp_path / "K.mtx").write_text("")
    (tmp_path / "contacts.csv").write_text("node,nx,ny,mu\n7,0,1,0.3\n")
    (tmp_path / "more.inp").write_text("** more\n*NODE\n3, 1, 0\n7, 1, 1\n")
    deck = tmp_path / "nodes.inp"
    deck.write_text("*NODE\n7, 0, 0\n*INCLUDE, INPUT=more.inp\n")
    told = r"more\.inp line 4: repeats node 7 of .*nodes\.inp line 2$"
    with pytest.raises(ValueError, match=told):
        matrix_files.read(tmp_path / "K.mtx", tmp_path / "contacts.csv", deck)


Edit = Callable[[str], str]


def line(number: int, text: str) -> Edit:
    """Replace a line."""

    def edit(content: str) -> str:
        lines = content.splitlines()
        lines[number - 1] = text
        return "\n".join(lines)

    return edit


def market(kind: str, entries: str) -> str:
    return f"%%MatrixMarket matrix coordinate {kind} general\n{entries}\n"


# Of each file: a change, or its new text, and the message.
MISTAKES: dict[str, list[tuple[Edit | str, str]]] = {
    "K.mtx": [
        ("", "K.mtx has no entries"),
        ("1 1 2.0\n", "K.mtx line 1: is '1 1 2.0', expected row node"),
        ("1,1,1,1,2\n1,1,1,1,2\n", "assemble the element matrices first"),
        ("1,1,-2,1,2\n", "K.mtx line 1: '1,1,-2,1,2' belongs to an internal"),
        ("1,1,1,1,1_0\n", "K.mtx line 1: is '1,1,1,1,1_0'"),
        (market("pattern", "1 1 1\n1 1"), "its numbers are pattern, expected real"),
        (market("real", "1 2 1\n1 1 3"), "it has 1 rows and 2 columns"),
        (lambda text: text[:200], "is not a stiffness in Matrix Market format"),
    ],
    "nodes.inp": [
        (line(6, "13, x, 0"), "nodes.inp line 6: is '13, x, 0', expected"),
        (line(6, "13, 1_0, 0"), "nodes.inp line 6: is '13, 1_0, 0', exp"),
        (line(6, "13, 0, 0\n13, 1, 1"), "repeats node 13 of line "),
        (line(4, "*NODE, INPUT=more.inp"), "nodes in another file"),
        (
            lambda text: text.replace("*ELEMENT", "999, 0.0, 0.0\n*ELEMENT"),
            "K.mtx has 50 rows, expected 2 for each of the 26 nodes of nodes.inp",
        ),
    ],
    "contacts.csv": [
        ("", "contacts.csv is empty"),
        ("node,nx,ny,mu\n", "contacts.csv has no contacts"),
        (
            lambda text: text.replace(",", ";"),
            "line 1: has one column, 'node;nx;ny;mu;area;gap': expected names",
        ),
        (line(1, "node,nx,ny,nu,area,gap"), "line 1: there is no column mu"),
        (
            line(1, "nd,nx,ny,mu,area,gap"),
            "there is no column node, found nd, nx, ny, mu, area, gap: is it 'nd'?",
        ),
        (line(1, "node,nx,ny,mu,area,gab"), "column 'gab' is unknown"),
        (line(3, "1,0,2,0.3,1,0"), "contacts.csv line 3: there is no node 1"),
        (line(3, "1,0,2"), "line 3: has 3 entries, expected 6"),
        (line(3, "10,0,0,0.3,1,0"), "line 3: the normal is zero"),
        (line(3, "10,0,1,-0.3,1,0"), "mu is -0.3, expected zero or positive"),
        (line(3, "10,0,1,0.3,0,0"), "area is 0, expected a positive number"),
        (line(3, "10,0,1,,1,0"), "line 3: mu is '', expected a finite number"),
        (line(3, "10,0,1,0.3,1,inf"), "gap is 'inf', expected a finite number"),
    ],
    "load.csv": [
        (line(2, "0,10,a,0"), "load.csv line 2: fx is 'a', expected a finite"),
        (line(2, "0,10,1_0,0"), "load.csv line 2: fx is '1_0', expected"),
        (line(2, "0,1_0,1,0"), "load.csv line 2: node is '1_0', expected"),
        (line(2, "-1,10,1,0"), "load.csv line 2: step is -1, expected 0"),
        (line(2, "2,10,1,0"), "load.csv has step 2 but no step 1: "),
    ],
    "fixed.csv": [
        (line(2, "0,10.5,1,0"), "fixed.csv line 2: node is '10.5', expected an"),
        (
            lambda text: text + text.splitlines()[1] + "\n",
            "ux is already given on line 2",
        ),
    ],
}


@pytest.mark.parametrize("file", MISTAKES)
def test_mistakes_name_file_and_line(
    file: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    # In this process: a fork takes longer than to read the files.
    call = request.getfixturevalue("bipot")
    command, _ = written(tmp_path, "block")
    path = tmp_path / file
    right = path.read_text()
    for edit, words in MISTAKES[file]:
        path.write_text(edit if isinstance(edit, str) else edit(right))
        status, out, _ = call(*command, "--json")
        assert status == 2, words
        (last,) = map(json.loads, out.splitlines())
        assert words in last["message"]
        assert "\n" not in last["message"]


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    command, _ = written(tmp_path, "block")
    sparse.save_npz(tmp_path / "K.npz", sparse.identity(4, format="csr"))
    binary = [word.replace("K.mtx", "K.npz") for word in command]
    run = bipot(*binary, cwd=tmp_path)
    assert run.returncode == 2
    told = "K.npz is not a text file, expected a Matrix Market file, as scipy"
    assert told in run.stderr
    run = bipot(*command, "--method", "magic", cwd=tmp_path)
    assert (run.returncode, "magic" in run.stderr) == (2, True)
    shutil.rmtree(tmp_path / "out", ignore_errors=True)
    (tmp_path / "load.csv").unlink()
    run = bipot(*command, cwd=tmp_path)
    assert run.returncode == 2
    assert run.stderr == "bipot: load.csv: No such file or directory\n"
    assert not (tmp_path / "out").exists()


def test_degrees_of_freedom_without_nodes(tmp_path: Path) -> None:
    command, _ = written(tmp_path, "block", by_dof=True)
    path = tmp_path / "contacts.csv"
    for text, told in (
        (
            line(2, "0,50,0,1,0.3,1,0")(path.read_text()),
            "line 2: degree of freedom 50 is out of range: the stiffness has 50 (0 to 49)",
        ),
        (
            "dof_x,dof_y,other_x,other_y,nx,ny,mu\n0,1,4,,0,1,0.3\n",
            "line 2: other_y is empty but other_x is 4: give all",
        ),
        ("node,nx,ny,mu\n3,0,1,0.3\n", "names a node: give --nodes"),
    ):
        path.write_text(text)
        run = bipot(*command, cwd=tmp_path)
        assert run.returncode == 2
        assert told in run.stderr


def test_wrong_normals_give_a_remark(tmp_path: Path) -> None:
    """No contact closes: a correct solution, but hardly ever the intended one."""
    for normal, remarked in ((1, False), (-1, True)):
        contacts = f"dof_x,dof_y,nx,ny,mu,gap\n0,1,0,{normal},0.3,0\n"
        command = of_dofs(tmp_path, np.eye(2), contacts, "dof,force\n1,-1\n")
        run = bipot(*command, cwd=tmp_path)
        assert run.returncode == 0, run.stderr
        assert ("no contact closes in any load step" in run.stdout) is remarked
        assert ("that the normals point from the obstacle" in run.stdout) is remarked


# A bar on two nodes, and nodes that μ = 0.5 holds.
BAR = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2))
ON_BOTH = "dof_x,dof_y,nx,ny,mu\n0,1,0,1,0.5\n2,3,0,1,0.5\n"


def test_forces_of_the_contact_surface(tmp_path: Path) -> None:
    """Two nodes pressed by 1 N each and pulled by 0.4 N, of the 1 N that μ = 0.5 holds."""
    command = of_dofs(tmp_path, BAR, ON_BOTH, "dof,force\n1,-1\n3,-1\n0,0.4\n")
    run = bipot(*command, cwd=tmp_path)
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


def test_no_answer(tmp_path: Path) -> None:
    """Pulled harder than friction can carry."""
    load = "step,dof,force\n0,1,-1\n0,3,-1\n0,0,0.4\n1,1,-1\n1,3,-1\n1,0,1.5\n"
    command = of_dofs(tmp_path, BAR, ON_BOTH, load)
    run = bipot(*command, "--json", cwd=tmp_path)
    assert run.returncode == 1
    first, last = map(json.loads, run.stdout.splitlines())
    assert (first["step"], first["stick"]) == (0, 2)
    assert "load step 2: no solution exists" in last["message"]
    # Without --json; the second step is not reached.
    run = bipot(*command, cwd=tmp_path)
    assert run.stderr.startswith(
        f"load step 1 of 2: open 0, slip 0, stick 2, residual {first['residual']:.1e}\n"
        "bipot: load step 2: no solution exists"
    )
    # The solved step has its row, and the path is not called solved.
    assert re.search(r"^    1     0     0      2   2  0\.4 ", run.stdout, re.M)
    assert "solved" not in run.stdout
    kept = bp.load(tmp_path / "out" / "K" / "result.h5")
    assert (len(kept), kept.success) == (1, False)


def test_an_interrupt_keeps_the_steps(tmp_path: Path) -> None:
    command, _ = written(tmp_path, "blocks")

    def fault(step: int, *_: object) -> None:
        if step == 1:
            raise KeyboardInterrupt

    run = bipot_with(
        fault, "bipot_rs.cli.run.matrix_job:make_row", *command, cwd=tmp_path
    )
    assert run.returncode == 130
    kept = bp.load(tmp_path / "out" / "K" / "result.h5")
    assert (len(kept), kept.success, kept.message) == (1, False, "interrupted")
    shutil.rmtree(tmp_path / "out")
    (tmp_path / "out").write_text("no folder")
    assert bipot(*command, cwd=tmp_path).returncode == 2


def test_a_floating_body_is_named_by_its_node(tmp_path: Path) -> None:
    """The second node is a separate body that nothing touches."""
    (tmp_path / "nodes.csv").write_text("node,x,y\n3,0,0\n7,1,0\n")
    for contacts, more, told in (
        # Without --nodes there are no labels.
        ("dof_x,dof_y,nx,ny,mu\n0,1,0,1,0\n", (), r"degree of freedom 2(?!.*of node)"),
        (
            "node,nx,ny,mu\n3,0,1,0.3\n",
            ("--nodes", "nodes.csv"),
            r"\(degree of freedom [23] is [xy] of node 7\)$",
        ),
    ):
        command = of_dofs(tmp_path, np.diag([1.0, 1, 0, 0]), contacts)
        run = bipot(*command, *more, cwd=tmp_path)
        assert run.returncode == 1
        assert re.search(told, run.stderr.strip(), re.S)
