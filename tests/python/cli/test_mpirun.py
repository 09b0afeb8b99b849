"""`mpirun -n N bipot run --engine petsc`: its answers, its files, and how it ends."""

import os
import re
import signal
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.cli.run.output_folder import RESULT, UNFINISHED
from support import children, many_ranks
from support.children import strays
from support.many_ranks import Run, bipot, bipot_with
from support.runs import FILES

pytestmark = pytest.mark.xdist_group("ranks")
# η is 1e-12; the errors of the reactions are larger by the condition of the contacts.
CLOSE = 1e-10
# A run ends 10 s after a rank has failed, and starts within the other 20 on a busy machine.
# Without an end it waits for ever, or sleeps for 100 s.
SOON = 30
PETSC = ("--engine", "petsc", "--out", "here")
LONG = ("run", "cyclic_cube", "--set", "mesh.n=3", "--set", "path.steps=6", *PETSC)
# Makes rank 1 wait in a call of PETSc, or do something else, in the load step with this
# number: on_step is called on all ranks.
AT_STEP = """
import os, signal, time
from bipot_rs.petsc.result import Step
make_whole = Step.make_whole
count = [0]
def at(step, u):
    count[0] += 1
    if count[0] == {step}:
        {what}
    return make_whole(step, u)
Step.make_whole = at
"""


def both(ranks: int, *run: str, cwd: Path) -> tuple[bp.Result, bp.Result]:
    """The results of the direct engine, in ``one``, and of ranks, in ``here``."""
    run = ("run", *run, "--tol", "1e-12", "--json")
    # First, because it is skipped without PETSc.
    done = bipot(ranks, *run, *PETSC, cwd=cwd)
    assert (done.status, done.errors) == (0, ""), done.output + done.errors
    *lines, last = done.lines  # each is printed once
    assert [line["step"] for line in lines] == list(range(len(lines)))
    assert (last["success"], last["ranks"], last["steps"]) == (True, ranks, len(lines))
    alone = children.bipot(*run, "--engine", "direct", "--out", "one", cwd=cwd)
    assert alone.returncode == 0, alone.stderr
    single, several = (bp.load(cwd / name / RESULT) for name in ("one", "here"))
    assert np.array_equal(several.status, single.status)
    return single, several


def changed(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference, relative to the largest expected value."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def scene(folder: Path, text: str) -> str:
    (folder / "it.toml").write_text(text, encoding="utf-8")
    return "it.toml"


BOX = """
[material.steel]
young = 210000.0
poisson = 0.3
[body.block]
material = "steel"
cell = "{cell}"
order = {order}
x = {{ from = 0.0, to = 4.0, cells = 4 }}
y = {{ from = 0.0, to = 3.0, cells = 3 }}
z = {{ from = 0.0, to = 2.0, cells = 2 }}
"""
CUBES = BOX.format(cell="hexahedron", order=1)
SHEARED = """
[[support]]
on = "block.top"
x = { value = 0.002, amplitude = "shear" }
y = 0.0
z = -0.001
[path]
parameter = "shear"
[path.amplitude]
shear = [0.0, 0.6, 1.0]
"""
ON_A_PLANE = """
[[contact]]
on = "block.bottom"
plane = { point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0] }
mu = 0.3
"""
MOVING = """
[obstacle.table]
plane = { point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0] }
move = { x = { value = 0.004, amplitude = "shear" } }
[[contact]]
on = "block.bottom"
against = "table"
mu = 0.3
"""
# The normals of its contacts follow it.
ROLLING = MOVING.replace(
    "plane = { point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0] }",
    "sphere = { centre = [2.0, 1.5, -5000.0], radius = 5000.0 }",
)


def shrunk() -> str:
    """A hub on a shaft that overlaps it, both bodies of revolution."""
    m = bp.Model()
    m.material("steel", young=210e3, poisson=0.3)
    for name, x, y in (
        ("shaft", (0.0, 2.0, 4), (-1.0, 4.0, 10)),
        ("hub", (2.0, 4.0, 5), (0.0, 3.0, 7)),
    ):
        sides = {
            axis: dict(zip(("from", "to", "cells"), side, strict=True))
            for axis, side in (("x", x), ("y", y))
        }
        kind = {"plane": "axisymmetric", "cell": "quadrilateral"}
        m.body(name, material="steel", **kind, **sides)
    pair = {"against": "shaft.right", "pairing": "mortar"}
    m.contact("hub.left", **pair, mu=0.15, clearance=-0.002)
    m.support("shaft.bottom", y=0.0)
    m.traction("hub.top", y=m.times(12.0, "pull"))
    m.path(parameter="pull", pull=[0.0, 1.0])
    return m.to_toml()


SCENES = {
    "block": CUBES + SHEARED + ON_A_PLANE,
    "tetrahedra": BOX.format(cell="tetrahedron", order=1) + SHEARED + ON_A_PLANE,
    "order 2": BOX.format(cell="hexahedron", order=2) + SHEARED + ON_A_PLANE,
    "moving obstacle": CUBES + SHEARED + MOVING,
    "springs and loads": CUBES
    + SHEARED.replace("y = 0.0\nz = -0.001\n", "")
    + ON_A_PLANE
    + '[[spring]]\non = "block.left"\nnormal = 2e5\ntangential = 1e5\n'
    + '[[pressure]]\non = "block.top"\nvalue = 20.0\n'
    + '[[body_force]]\non = "block"\nz = -1.0\n'
    + '[[strain]]\non = "block"\nexpansion = 1e-5\ntemperature = 10.0\n',
    "axisymmetric": shrunk(),
    # Nodes of an edge have two contacts.
    "shared nodes": CUBES
    + SHEARED
    + ON_A_PLANE
    + ON_A_PLANE.replace("bottom", "left").replace(
        "[0.0, 0.0, 1.0]", "[1.0, 0.0, 0.0]"
    ),
    # In step 2 the second bolt pulls at the first, whose shortening is locked.
    "bolts": CUBES
    + ON_A_PLANE.replace("bottom", "right").replace(
        "[0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0]",
        "[4.0, 0.0, 0.0], normal = [1.0, 0.0, 0.0]",
    )
    + '[[support]]\non = "block.left"\nx = 0.0\ny = 0.0\nz = 0.0\n'
    + "".join(
        f'[[bolt]]\nname = "{name}"\nsection = "block"\nforce = {force}\n'
        f"step = [{step}, {step}]\n"
        f"plane = {{ point = [{x}, 0.0, 0.0], normal = [1.0, 0.0, 0.0] }}\n"
        for name, x, force, step in (("a", 1.0, 400.0, 1), ("b", 3.0, 300.0, 2))
    )
    + '[[traction]]\non = "block.top"\ny = { value = 4.0, amplitude = "shear" }\n'
    + '[path]\nparameter = "shear"\n[path.amplitude]\nshear = [0.0, 0.0, 0.5, 1.0]\n',
    # Contact nodes of an edge are held along a tangent, and contact alone holds the block.
    "held edge": CUBES
    + ON_A_PLANE
    + '[[support]]\non = "block.left"\ny = 0.0\n[[traction]]\non = "block.top"\nz = -80.0\n'
    + 'x = { value = 20.0, amplitude = "shear" }\n[path]\nparameter = "shear"\n'
    + "[path.amplitude]\nshear = [0.0, 0.6, 1.0]\n",
    "remote point": CUBES
    + SHEARED.replace("[[support]]\non", "[remote.top]\non").replace(
        'x = { value = 0.002, amplitude = "shear" }\ny = 0.0\nz = -0.001\n',
        'move.x = { value = 0.002, amplitude = "shear" }\nmove.y = 0.0\nturn.x = 0.0\n'
        "force.z = -600.0\n",
    )
    + ON_A_PLANE,
    "adaptive": CUBES
    + SHEARED.replace(
        'parameter = "shear"', 'parameter = "shear"\nautomatic = {slip=4e-4}'
    )
    + ON_A_PLANE,
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.quick_variants("moving obstacle", "bolts")
def test_answers_are_those_of_the_direct_engine(name: str, tmp_path: Path) -> None:
    single, several = both(3, scene(tmp_path, SCENES[name]), cwd=tmp_path)
    arrays = ["displacement", "relative_displacement", "reaction"]
    if name == "shared nodes":  # two contacts that stick share their force anyhow
        arrays.remove("reaction")
    for array in arrays:
        assert changed(getattr(several, array), getattr(single, array)) <= CLOSE, array
    assert several.success
    if name == "bolts":
        for array in ("bolt_force", "shortening"):
            ours, theirs = (
                np.array([getattr(step, array) for step in it])
                for it in (several, single)
            )
            assert changed(ours, theirs) <= CLOSE, array
        assert several[1].bolt_force == pytest.approx([300.0, 300.0])
    for key, value in single.contacts.items():
        if value is None or value.dtype.kind != "f":
            np.testing.assert_array_equal(several.contacts[key], value)
        else:  # the two Pythons have versions of NumPy that sum in another order
            np.testing.assert_allclose(several.contacts[key], value, rtol=1e-14, atol=0)


@pytest.mark.parametrize(
    "run",
    [
        ("two_blocks", "--set", "mesh.n=4"),
        ("two_blocks", "--set", "mesh.n=4", "--set", "contact.0.pairing=mortar"),
        ("raous_plate", "--set", "mesh.n=8"),
        ("twisted_pad",),
    ],
    ids=["two blocks", "mortar", "plane", "rigid set"],
)
@pytest.mark.quick_variants("mortar")
def test_shipped_scenes(run: tuple[str, ...], tmp_path: Path) -> None:
    single, several = both(2, *run, cwd=tmp_path)
    assert changed(several.reaction, single.reaction) <= CLOSE


def preconditioner(folder: Path) -> str:
    with h5py.File(folder / "here" / RESULT) as file:
        return str(file.attrs["preconditioner"])


def test_files_of_a_run(tmp_path: Path) -> None:
    run = ("run", "two_blocks", "--set", "mesh.n=4", *PETSC)
    done = bipot(2, *run, "--plot", cwd=tmp_path)
    assert done.status == 0, done.errors
    here = tmp_path / "here"
    steps = {f"result_{k:04d}_{r:04d}.vtu" for k in range(2) for r in range(2)}
    for k in range(2):
        steps |= {f"result_{k:04d}.pvtu", f"contact_{k:04d}.vtu"}
    names = {path.name for path in here.iterdir()}
    assert names == FILES | steps | {"tractions.png"}
    # The table, the progress and the names of the files appear once.
    assert done.output.count("solved: 2 load steps") == 1
    assert done.errors.count("load step 2 of 2") == 1
    assert "2 ranks" in done.errors
    assert len((here / "steps.csv").read_text().splitlines()) == 3
    assert preconditioner(tmp_path) == "gamg"
    # Without options of the user this scene is small enough for one rank.
    assert bipot(2, *run, cwd=tmp_path, options="").status == 0
    assert preconditioner(tmp_path) == "factor on the first rank"


@pytest.mark.slow
def test_parts_for_paraview_are_the_bodies(tmp_path: Path) -> None:
    """The pieces have the cells and fields of the file that one process writes."""
    both(3, "two_blocks", "--set", "mesh.n=4", cwd=tmp_path)
    here = tmp_path / "here"
    index = ET.parse(here / "result.pvd").getroot()
    steps = [item.attrib["file"] for item in index.iter("DataSet")]
    assert steps == ["result_0000.pvtu", "result_0001.pvtu"]
    # The load of the scene, as in the index that one process writes.
    for name in ("result.pvd", "contact.pvd"):
        for folder in (here, tmp_path / "one"):
            sets = ET.parse(folder / name).getroot().iter("DataSet")
            assert [a.attrib["timestep"] for a in sets] == ["0", "1"]
    for k, name in enumerate(steps):
        whole = meshio.read(tmp_path / "one" / f"result_{k:04d}.vtu")
        listing = ET.parse(here / name).getroot()
        assert listing.attrib["type"] == "PUnstructuredGrid"
        files = [here / entry.attrib["Source"] for entry in listing.iter("Piece")]
        assert len(files) == 3
        listed = {
            place: [a.attrib for a in listing.find(f".//P{place}")]
            for place in ("PointData", "CellData")
        }
        assert {a["Name"] for a in listed["PointData"]} == set(whole.point_data)
        assert {a["Name"] for a in listed["CellData"]} == set(whole.cell_data)
        pieces = [meshio.read(file) for file in files]
        for file, piece in zip(files, pieces, strict=True):
            assert piece.field_data.keys() == {"load", "time", "units"}
            for about, value in whole.field_data.items():
                np.testing.assert_array_equal(piece.field_data[about], value)
            # Types and numbers of components are those of the listing.
            tree = ET.parse(file).getroot()
            for place, expected in listed.items():
                arrays = [a.attrib for a in tree.find(f".//{place}")]
                for mine, theirs in zip(arrays, expected, strict=True):
                    assert {key: mine[key] for key in theirs} == theirs
            assert cells(piece)
            compare(whole, piece)
        assert sum(map(cells, pieces)) == cells(whole)


def cells(mesh: meshio.Mesh) -> int:
    return sum(len(block.data) for block in mesh.cells)


def fields(mesh: meshio.Mesh) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Name, places and values of each field, at nodes and in the middle of cells."""
    for name, field in mesh.point_data.items():
        yield f"points {name}", mesh.points, field
    middles = [mesh.points[block.data].mean(axis=1) for block in mesh.cells]
    for name, field in mesh.cell_data.items():
        yield f"cells {name}", np.concatenate(middles), np.concatenate(field)


def compare(whole: meshio.Mesh, piece: meshio.Mesh) -> None:
    """Fields by position; two bodies may have nodes in one place, with other fields."""
    expected = {name: (places, values) for name, places, values in fields(whole)}
    for name, places, values in fields(piece):
        there, known = expected[name]
        scale = max(float(np.abs(known).max()), 1e-300)
        for place, value in zip(places, values, strict=True):
            same = known[np.abs(there - place).max(axis=1) < 1e-6]
            assert min(np.abs(value - e).max() for e in same) <= 1e-8 * scale, name


@pytest.mark.parametrize(
    "run", [many_ranks.bipot_with, many_ranks.bipot], ids=["no mpirun", "mpirun"]
)
@pytest.mark.quick_variants("no mpirun")
def test_one_rank(run: Any, tmp_path: Path) -> None:
    """The files are those of any other run; the scene names the engine."""
    file = scene(tmp_path, SCENES["block"] + '[solver]\nengine = "petsc"\n')
    done = run(int(run is bipot), "run", file, "--out", "here", cwd=tmp_path)
    assert done.status == 0, done.errors
    assert (tmp_path / "here" / "result_0002.vtu").exists()
    assert preconditioner(tmp_path)
    assert len(bp.load(tmp_path / "here" / RESULT)) == 3


# Kills a rank in the fourth load step.
KILL = AT_STEP.format(step=4, what="os.kill(os.getpid(), signal.SIGKILL)")


def ends_whole(folder: Path, ranks: int, *run: str) -> Run:
    """The run continues to its last load step, and leaves no draft."""
    done = bipot(ranks, *run, "--resume", cwd=folder)
    assert done.status == 0, done.errors
    assert len(bp.load(folder / "here" / RESULT)) == 6
    assert strays(folder / "here") == []
    return done


def three(path: Path, at: int) -> None:
    """The file has the steps before the fourth, in which rank ``at`` fails.

    If that is not rank 0, then rank 0 may have kept the fourth step already.
    """
    loaded = bp.load(path)
    assert len(loaded) in ({3} if at == 0 else {3, 4})
    assert not loaded.success


def soon(done: Run, status: int, *words: str) -> None:
    """The run ended in time, with a status and a message."""
    assert done.status == status, done.output + done.errors
    assert done.seconds <= SOON
    for word in words:
        assert word in done.output + done.errors
    assert "Traceback" not in done.errors


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("nothing", *PETSC), 2, "nothing"),
        (("sheared_cube", "--set", "mesh.n=x", *PETSC), 2, "mesh.n"),
        (("sheared_cube", "--method", "uzawa", *PETSC), 2, "engine='petsc'"),
        (("sheared_cube", "--fclib", *PETSC), 2, "--fclib"),
        (("sheared_cube", "--error", *PETSC), 2, "--error"),
        (("sheared_cube", "--tol", "discretisation", *PETSC), 2, "whole K"),
        (("sheared_cube", *PETSC[:-1], "/proc/x"), 2, "/proc/x"),
        (("sheared_cube", "--set", "solver.max_iterations=1", *PETSC), 3, ""),
    ],
)
@pytest.mark.quick_variants("*-nothing", "*-3-")
def test_errors_of_all_ranks(
    arguments: tuple[str, ...], status: int, words: str, tmp_path: Path
) -> None:
    """One message, and the status of one process."""
    done = bipot(2, "run", *arguments, cwd=tmp_path)
    soon(done, status, words)
    assert done.errors.count("bipot: ") == 1
    # They are no errors of a rank.
    assert "rank 1 of" not in done.errors
    again = bipot(2, "run", *arguments, "--json", cwd=tmp_path)
    assert again.status == status
    assert not again.lines[-1]["success"]
    assert sum("success" in line for line in again.lines) == 1


ROLLS = CUBES + SHEARED + ROLLING
FORCED = CUBES + SHEARED + MOVING.replace("move =", "force =")
FREE = SCENES["block"] + "[body.other]" + CUBES.split("[body.block]")[1]


REMEDY = "use engine='direct' or 'iterative'"


@pytest.mark.parametrize(
    ("text", "status", "words"),
    [
        (FREE, 1, ("body 'other' can move freely",)),
        (ROLLS, 2, ("an obstacle turns, or is curved and moves", REMEDY)),
        (FORCED, 2, (f"does not support obstacle.table.force: {REMEDY}",)),
    ],
    ids=["free", "frames", "loaded obstacle"],
)
@pytest.mark.quick_variants("frames")
def test_scenes_that_are_refused(
    text: str, status: int, words: tuple[str, ...], tmp_path: Path
) -> None:
    done = bipot(2, "run", scene(tmp_path, text), *PETSC, cwd=tmp_path)
    soon(done, status, *words)


MESH = """
import pathlib, bipot_rs.mesh.readers as it
read = it.read_mesh
def other(path, *rest):
    return read("absent.msh", *rest)
it.read_mesh = other
"""


@pytest.mark.slow
def test_a_rank_without_its_mesh(repository: Path, tmp_path: Path) -> None:
    file = str(repository / "examples" / "scenes" / "gmsh_two_bodies.toml")
    done = bipot_with(2, "run", file, *PETSC, cwd=tmp_path, fault=MESH)
    soon(done, 2, "rank 1 of 2", "absent.msh")
    assert not (tmp_path / "here" / RESULT).exists()


@pytest.mark.slow
def test_a_rank_with_another_file(tmp_path: Path) -> None:
    """As where a file system is not shared."""
    (tmp_path / "other").mkdir()
    scene(tmp_path / "other", SCENES["tetrahedra"])
    run = ("run", scene(tmp_path, SCENES["block"]), *PETSC)
    done = bipot_with(2, *run, cwd=tmp_path, fault="import os; os.chdir('other')")
    soon(done, 2, "rank 1 of 2", "another scene")


# The disk of a rank is full when it writes its part of the bodies, or its third result.
FULL = """
import resource, bipot_rs.fem.paraview as bodies, bipot_rs.files.export as export
add, write, count = bodies.BodySeries.add, export._digest, [0]
def full(size):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
def add_full(*given, **named):
    full(500)
    return add(*given, **named)
def write_full(*given):
    count[0] += 1
    if count[0] == 3:
        full(5000)
    return write(*given)
"""


IN_PETSC = """
import bipot_rs.petsc.engine as it
from bipot_rs.petsc.result import Step
make_whole, product, steps = Step.make_whole, it.VectorOperations.product, [0]
def counted(*given):
    steps[0] += 1
    return make_whole(*given)
def failing(*given):
    if steps[0] == 2:
        raise MemoryError("no memory here")
    return product(*given)
Step.make_whole, it.VectorOperations.product = counted, failing
"""


FULL_DISK = ("cannot write", os.strerror(27))
MEMORY = "raise MemoryError('no memory here')"
# What fails on a rank, the exit status, parts of the message, and the load steps kept.
FAULTS: dict[str, tuple[str, int, tuple[str, ...], set[int]]] = {
    "agreement": (AT_STEP.format(step=3, what=MEMORY), 2, ("no memory here",), {2, 3}),
    # The others would wait for ever: after some seconds the rank that fails ends them.
    "PETSc": (IN_PETSC, 2, ("no memory here", "2 load steps complete"), {2}),
    "our fault": (
        AT_STEP.format(step=3, what="raise RuntimeError('strange')"),
        70,
        ("internal error", "strange"),
        {2, 3},
    ),
    "disk of bodies": (FULL + "bodies.BodySeries.add = add_full", 2, FULL_DISK, {6}),
    # The load steps are those of the last checkpoint, which is whole.
    "disk of results": (FULL + "export._digest = write_full", 2, FULL_DISK, {2}),
}


@pytest.mark.parametrize(
    ("name", "rank"),
    # Rank 0 writes the results.
    [(name, rank) for name in FAULTS for rank in (0, 1)][:-1],
)
@pytest.mark.quick_variants("disk of bodies-1")
def test_an_error_of_one_rank(name: str, rank: int, tmp_path: Path) -> None:
    fault, status, words, steps = FAULTS[name]
    done = bipot_with(2, *LONG, "--json", cwd=tmp_path, fault=fault, at=rank)
    soon(done, status)
    *_, last = done.lines
    assert last["message"].startswith(f"rank {rank} of 2: ")
    assert all(word in last["message"] for word in words)
    assert not last["success"]
    loaded = bp.load(tmp_path / "here" / RESULT)
    assert len(loaded) in steps
    if 6 in steps:
        assert strays(tmp_path / "here") == []
    else:
        assert not loaded.success


@pytest.mark.parametrize("rank", [0, 1])
@pytest.mark.slow_variants("0")
def test_a_killed_rank(rank: int, tmp_path: Path) -> None:
    """The launcher ends the others, and names the rank; the run goes on to the same result."""
    run = (*LONG, "--tol", "1e-12")
    done = bipot_with(2, *run, cwd=tmp_path, fault=KILL, at=rank)
    assert done.status != 0
    assert done.seconds <= SOON
    assert "signal 9" in done.errors
    three(tmp_path / "here" / RESULT, rank)
    # Another number of ranks continues it.
    resumed = ends_whole(tmp_path, 3, *run)
    assert re.search("continuing after [34] load steps", resumed.errors)
    assert (tmp_path / "here" / "result_0005.pvtu").exists()
    ended = bipot(2, *run, "--resume", "--json", cwd=tmp_path)
    assert ended.status == 0
    assert "already complete" in ended.lines[-1]["message"]
    assert bipot(2, *run[:-3], "there", *run[-2:], cwd=tmp_path).status == 0
    loaded, whole = (bp.load(tmp_path / name / RESULT) for name in ("here", "there"))
    assert np.array_equal(loaded.status, whole.status)
    assert changed(loaded.reaction, whole.reaction) <= CLOSE
    assert changed(loaded.displacement, whole.displacement) <= CLOSE


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_mpirun(number: signal.Signals, tmp_path: Path) -> None:
    slow = AT_STEP.format(step=4, what="time.sleep(100)")
    process = many_ranks.started(2, *LONG, cwd=tmp_path, fault=slow)
    result = tmp_path / "here" / RESULT
    deadline = time.monotonic() + 60
    while not (result.exists() and len(bp.load(result)) >= 3):
        if time.monotonic() > deadline:
            process.kill()
            raise AssertionError("the run does not reach the third load step")
        time.sleep(0.05)
    process.send_signal(number)
    done = many_ranks.ended(process, 60)
    assert done.status != 0
    assert done.seconds <= SOON
    three(result, 1)
    ends_whole(tmp_path, 2, *LONG)


@pytest.mark.slow
def test_a_signal_to_one_rank(tmp_path: Path) -> None:
    """As a scheduler that sends it to the ranks itself: the run ends as interrupted."""
    fault = AT_STEP.format(step=4, what="os.kill(os.getpid(), signal.SIGTERM)")
    for rank in (0, 1):
        done = bipot_with(2, *LONG, cwd=tmp_path, fault=fault, at=rank)
        soon(done, 143, "interrupted")
        three(tmp_path / "here" / RESULT, rank)


@pytest.mark.slow
def test_a_result_of_another_run_stays_until_the_end(tmp_path: Path) -> None:
    here = tmp_path / "here"
    run = ("run", "sheared_cube", "--set", "mesh.n=2", "--out", "here")
    assert children.bipot(*run, cwd=tmp_path).returncode == 0
    before = (here / RESULT).read_bytes()
    assert bipot_with(2, *LONG, cwd=tmp_path, fault=KILL).status != 0
    assert (here / RESULT).read_bytes() == before
    three(here / UNFINISHED, 1)
    ends_whole(tmp_path, 2, *LONG)
    assert not (here / UNFINISHED).exists()
    # The files of one process, with which the folder began, are gone.
    names = [path.name for path in here.iterdir()]
    assert not [name for name in names if re.fullmatch(r"result_\d{4}\.vtu", name)]


def test_mpirun_without_the_engine(tmp_path: Path) -> None:
    """Each process solves the whole scene; a remark says what would share it."""
    run = ("run", "sheared_cube", "--set", "mesh.n=2", "--out", "here")
    done = bipot(2, *run, cwd=tmp_path)
    assert done.status == 0
    assert "--engine petsc would share it" in done.errors
