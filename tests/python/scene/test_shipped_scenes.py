"""The shipped scenes compared with their references, and mistakes in scene files."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bipot_rs import scene
from bipot_rs.scene.schema.mesh import Axis
from support import places
from support.comparisons import near
from support.faulty_scenes import MISTAKES

DATA = places.DATA
LETTER = {"pressed_block": "A", "sheared_cube": "B", "two_blocks": "D"}
Floats = NDArray[np.float64]


def solve(name: str, *settings: str, **options: Any) -> tuple[scene.Case, Any]:
    """Case and result of a scene, by default with its own tolerance."""
    read = scene.read(name, settings)
    case = scene.assemble(read, scene.bodies(read))
    options.setdefault("tol", read.solver.tol)
    return case, case.model.problem().solve(case.load, case.prescribed, **options)


def traction_error(r: Floats, reference: Floats, area: Floats) -> Floats:
    """Relative error of the tractions of each load step, in the norm of the area."""
    weight = 1 / area[:, None]
    error = (weight * (r - reference) ** 2).sum(axis=(1, 2))
    return np.sqrt(error / (weight * reference**2).sum(axis=(1, 2)))


@pytest.mark.parametrize(
    ("name", "n"),
    [
        ("pressed_block", 16),
        ("pressed_block", 32),
        ("pressed_block", 64),
        ("sheared_cube", 9),
        ("sheared_cube", 15),
        ("two_blocks", 8),
        ("two_blocks", 16),
        pytest.param("pressed_block", 128, marks=pytest.mark.slow),
        pytest.param("two_blocks", 24, marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow_variants("*-15", "two_blocks-16")
def test_reference(name: str, n: int) -> None:
    reference = np.load(DATA / f"{LETTER[name]}_{n}.npz")
    case, result = solve(name, f"mesh.n={n}")
    model = case.model
    distance, order = cKDTree(model.points).query(reference["x"])
    # The same grid points, computed by other expressions.
    assert distance.max() <= 1e-12 * np.ptp(reference["x"])
    np.testing.assert_allclose(model.area[order], reference["area"], rtol=1e-12)
    np.testing.assert_array_equal(model.mu[order], reference["mu"])
    np.testing.assert_array_equal(model.gap[order], reference["gap0"])
    # The accuracy that the references state.
    error = traction_error(result.reaction[:, order], reference["R"], reference["area"])
    assert np.all(error <= 1e-9), error
    np.testing.assert_array_equal(result.status[:, order], reference["status"])


@pytest.mark.parametrize(
    ("name", "n"),
    [("cattaneo_mindlin", 5), ("cattaneo_mindlin", 10), ("cyclic_cube", 5)],
)
@pytest.mark.quick_variants("cattaneo_mindlin-5")
def test_second_route(name: str, n: int, repository: Path, tmp_path: Path) -> None:
    """Independent code from the mesh on: SciPy's factorisation, a Newton method."""
    case, result = solve(name, f"mesh.n={n}")
    assert np.all(result.residual <= 1e-12)
    answer = tmp_path / "peer.npz"
    run = subprocess.run(
        [
            sys.executable,
            str(repository / "benches" / "peers" / "with_scipy.py"),
            name,
            str(n),
            f"--save={answer}",
            "--tol=1e-12",
        ],
        check=True,
        capture_output=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    peer = np.load(answer)
    assert json.loads(run.stdout)["contacts"] == len(peer["x"])
    distance, order = cKDTree(case.model.points).query(peer["x"])
    assert distance.max() <= 1e-12 * np.ptp(peer["x"])
    # Both residuals are below 1e-12; the conditions of W here are below 1e4.
    error = traction_error(result.reaction[:, order], peer["R"], peer["area"])
    assert np.all(error <= 1e-8), error


def test_second_method() -> None:
    """The paper's iteration with a smaller tolerance, on the scene with the longest history."""
    _, result = solve("cyclic_cube", "mesh.n=4")
    _, other = solve("cyclic_cube", "mesh.n=4", method="uzawa", tol=1e-13)
    area = np.ones(result.reaction.shape[1])
    error = traction_error(result.reaction, other.reaction, area)
    assert np.all(error <= 1e-8), error
    # A node exactly at the friction limit may be SLIP in one and STICK in the other. Then its
    # slip must be zero, to the same accuracy.
    length = np.linalg.norm(result.slip, axis=2)
    differs = result.status != other.status
    assert np.all(length[differs] <= 1e-8 * length.max())


def test_cattaneo_mindlin_approaches_the_closed_form() -> None:
    """Pressure and shear of two equal round bodies, for the discrete load."""
    n, radius, mu = 20, 100.0, 0.3
    case, result = solve("cattaneo_mindlin", f"mesh.n={n}")
    e_star = 210000.0 / (2 * (1 - 0.3**2))
    x = case.model.points[:, 0]
    p, q = (result.reaction[-1] / case.model.area[:, None]).T
    P, Q = result.reaction[-1].sum(axis=0)
    a = np.sqrt(4 * P * radius / (np.pi * e_star))
    p0 = 2 * P / (np.pi * a)
    c = a * np.sqrt(1 - abs(Q) / (mu * P))

    def ellipse(width: float) -> Floats:
        return np.sqrt(np.maximum(0, 1 - (x / width) ** 2))

    exact_p = p0 * ellipse(a)
    exact_q = np.sign(Q) * mu * p0 * (ellipse(a) - c / a * ellipse(c))
    # At n = 40 the errors 0.3 % and 0.9 % come from the finite blocks. At n = 20 the ends of
    # the zones, where the tractions are square roots, are resolved to h/2 = 0.0125 for
    # a = 1: √(0.025) of the peak over two cells, 1 % in the mean square.
    error_p = np.linalg.norm(p - exact_p) / np.linalg.norm(exact_p)
    error_q = np.linalg.norm(q - exact_q) / np.linalg.norm(exact_q)
    assert error_p <= 0.01
    assert error_q <= 0.03
    # Open outside, slip in a ring, stick in the middle.
    status = result.status[-1][np.argsort(x)]
    middle = len(x) // 2
    assert status[middle] == 2
    assert status[0] == status[-1] == 0
    assert np.all(np.diff(status[: middle + 1]) >= 0)
    assert np.all(np.diff(status[middle:]) <= 0)
    stuck = np.abs(x[result.status[-1] == 2])
    assert stuck.max() == pytest.approx(c, abs=1.5 * 0.5 / n)


def test_shipped_names() -> None:
    assert scene.shipped() == [
        "cattaneo_mindlin",
        "cyclic_cube",
        "drawn_sheet",
        "pressed_block",
        "pushed_punch",
        "raous_plate",
        "sheared_cube",
        "twisted_pad",
        "two_blocks",
    ]


@pytest.mark.parametrize(
    ("name", "n", "dofs", "contacts", "steps"),
    [
        ("pressed_block", 32, 2178, 33, 1),
        ("sheared_cube", 15, 12288, 256, 2),
        ("cattaneo_mindlin", 10, 7220, 61, 2),
        ("cattaneo_mindlin", 40, 50720, 241, 2),
        ("two_blocks", 8, 2430, 81, 2),
        ("cyclic_cube", 9, 3000, 100, 41),
        ("raous_plate", 32, 2178, 32, 5),
        ("pushed_punch", 40, 1724, 41, 4),
        ("drawn_sheet", 4, 1212, 162, 11),
        ("twisted_pad", 8, 1215, 73, 4),
    ],
)
def test_size_of_shipped_scenes(
    name: str, n: int, dofs: int, contacts: int, steps: int
) -> None:
    settings = [] if name != "cattaneo_mindlin" or n == 10 else [f"mesh.n={n}"]
    read = scene.read(name, settings)
    assert read.mesh is not None
    assert read.mesh.n == n
    case = scene.assemble(read, scene.bodies(read))
    assert (case.model.n, len(case.model.gap)) == (dofs, contacts)
    assert case.prescribed.shape == (steps, len(case.model.fixed))
    assert case.parameter.shape == (steps,)


def test_cyclic_path() -> None:
    read = scene.read("cyclic_cube", ["mesh.n=2"])
    case = scene.assemble(read, scene.bodies(read))
    top = case.model.fixed % 3 == 0
    k = np.arange(41)
    # First pressing alone, then forty steps of the sine.
    # The phase, up to 4π, is rounded: 4π ε of the amplitude.
    near(
        case.prescribed[:, top].T,
        np.tile(0.025 * np.sin(2 * np.pi * k / 20), (9, 1)),
        0.025 * 4 * np.pi * 2.3e-16,
    )


def test_a_ramp_takes_any_number_of_steps() -> None:
    for steps in (1, 4):
        read = scene.read("raous_plate", ["mesh.n=2", f"path.steps={steps}"])
        case = scene.assemble(read, scene.bodies(read))
        # Quarters are exact in binary.
        np.testing.assert_array_equal(case.parameter, np.arange(1, steps + 1) / steps)
        assert case.load is not None
        np.testing.assert_array_equal(case.load[0] * steps, case.load[-1])


def test_graded_grid() -> None:
    axis = Axis.model_validate({"from": 0.0, "to": 10.0, "cell": 1.0, "growth": 2.0})
    # 0 1 3 7 15 → clipped to 10; the last cell of 3 is not below half of 4.
    np.testing.assert_array_equal(axis.grid(None), [0, 1, 3, 7, 10])
    axis = Axis.model_validate({"from": 0.0, "to": -8.0, "cell": 1.0, "growth": 2.0})
    # The last cell would be 1, below half of 4: its inner point is removed.
    np.testing.assert_array_equal(axis.grid(None), [-8, -3, -1, 0])
    axis = Axis.model_validate(
        {"from": -8.0, "to": 4.0, "cell": 1.0, "uniform": [-1.0, 1.0], "growth": 2.0}
    )
    # From -1: cells of 2, 4, then a rest of 1, which is below half of 4. From 1: a cell of
    # 2, then a rest of 1, which is half of 2 and stays.
    np.testing.assert_array_equal(axis.grid(2), [-8, -3, -1, 0, 1, 3, 4])


@pytest.mark.parametrize(("settings", "problems"), MISTAKES)
def test_all_mistakes_are_reported(settings: list[str], problems: list[str]) -> None:
    with pytest.raises(scene.SceneError) as caught:
        scene.read("two_blocks", settings)
    messages = [str(mistake) for mistake in caught.value.mistakes]
    assert len(messages) == len(problems), messages
    for problem, start in zip(messages, problems, strict=True):
        assert problem.startswith(start)
        assert problem in str(caught.value)


@pytest.mark.parametrize("value", [".25", "+.25", "25.e-2", "0.25", " .25"])
def test_numbers_of_a_setting_may_lack_a_digit(value: str) -> None:
    assert scene.read("two_blocks", [f"contact.0.mu={value}"]).contact[0].mu == 0.25


def test_cohesion_of_a_scene_is_a_stress() -> None:
    """All contacts of a face of 100 mm × 100 mm carry 0.3 MPa times its area; corners a quarter."""
    read = scene.read("sheared_cube", ["mesh.n=3", "contact.0.cohesion=0.3"])
    cohesion = scene.assemble(read, scene.bodies(read)).model.cohesion
    # Rounding of sixteen terms.
    assert cohesion.sum() == pytest.approx(0.3 * 100.0 * 100.0, rel=1e-14)
    assert cohesion.max() == pytest.approx(4 * cohesion.min(), rel=1e-14)


def test_suggestions_for_keys_that_exist_elsewhere() -> None:
    """A key is looked for elsewhere in the scene, with one search for all mistakes."""
    table = scene.parse("sheared_cube", scene.text("sheared_cube"))
    contact = table["contact"][0]
    table["contact"] = [
        contact | {"cells": 3, "young": 1, "zzz": k} for k in range(300)
    ]
    table["body"]["cube"]["zzz"] = 1
    with pytest.raises(scene.SceneError) as caught:
        scene.check("mine", table)
    messages = [str(mistake) for mistake in caught.value.mistakes]
    (young,) = (f"material.{name}.young" for name in table["material"])
    for k in (0, 299):
        assert f"contact.{k}.young: unknown key, did you mean {young}?" in messages
        near = (
            "did you mean body.cube.x.cells or body.cube.y.cells or body.cube.z.cells?"
        )
        assert f"contact.{k}.cells: unknown key, {near}" in messages
        (meant,) = (line for line in messages if line.startswith(f"contact.{k}.zzz: "))
        assert meant.startswith(
            f"contact.{k}.zzz: unknown key, expected one of on, name, mu"
        )


def test_files_that_are_not_scenes(tmp_path: Path) -> None:
    with pytest.raises(scene.SceneError, match="neither a file nor one of cattaneo"):
        scene.read("nothing")
    broken = tmp_path / "broken.toml"
    broken.write_text("[mesh\nn = 3")
    with pytest.raises(scene.SceneError, match=r"is not TOML: .*line 1"):
        scene.read(str(broken))


def test_mistakes_found_on_the_mesh() -> None:
    read = scene.read("two_blocks", ["body.lower.x.to=90.0"])
    with pytest.raises(scene.SceneError, match="do not match"):
        scene.assemble(read, scene.bodies(read))


def test_loads_of_a_scene() -> None:
    case, _ = solve("pressed_block", "mesh.n=4")
    assert case.load is not None
    f = case.load[0].reshape(-1, 2)
    # -100 on a side of 40, -50 on a side of 40; rounding of a sum of five.
    np.testing.assert_allclose(f.sum(axis=0), [-4000, -2000], rtol=1e-14)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("pressed_block", ["mesh.n=8"]),
        ("sheared_cube", ["mesh.n=3"]),
        ("two_blocks", ["mesh.n=4"]),
        ("cattaneo_mindlin", ["mesh.n=5"]),
    ],
)
def test_linear_cells_on_the_same_grid(name: str, settings: list[str]) -> None:
    case, result = solve(name, *settings)
    linear, other = solve(name, *settings, "mesh.element=P1")
    # The same nodes, supports and contacts; the areas add up to the same surface.
    np.testing.assert_array_equal(linear.model.nodes, case.model.nodes)
    np.testing.assert_array_equal(linear.model.fixed, case.model.fixed)
    np.testing.assert_array_equal(linear.model.points, case.model.points)
    assert linear.model.area.sum() == pytest.approx(case.model.area.sum(), rel=1e-13)
    assert {kind for kind, _ in linear.model.cells} <= {"triangle", "tetra"}
    if case.load is not None:
        # Loads on edges are equal; in space the two triangles of a square differ from it.
        np.testing.assert_allclose(linear.load, case.load, atol=1e-12 * case.load.max())
    # Stiffer than with more functions: more energy for the same displacements.
    energy = [
        0.5 * r.displacement[0] @ (c.model.K @ r.displacement[0])
        for c, r in ((case, result), (linear, other))
    ]
    force = [abs(r.reaction[0, :, 0].sum()) for r in (result, other)]
    # Coarse meshes: they differ by 3 to 10 %, with discretisation errors of 10 to 30 %.
    assert energy[1] == pytest.approx(energy[0], rel=0.1)
    assert force[1] == pytest.approx(force[0], rel=0.1)
    counts = [
        [int((r.status[0] == k).sum()) for k in range(3)] for r in (result, other)
    ]
    # Zones agree except for nodes at their borders.
    assert np.abs(np.subtract(*counts)).max() <= 0.25 * len(case.model.gap)


def test_linear_cells_converge_to_the_same_solution() -> None:
    """Energies of both elements converge to each other, here with h to the power 1.5."""
    gaps = []
    for n in (4, 8, 16):
        energies = []
        for element in ("Q1", "P1"):
            case, result = solve(
                "pressed_block", f"mesh.n={n}", f"mesh.element={element}"
            )
            u = result.displacement[0]
            energies.append(0.5 * u @ (case.model.K @ u))
        gaps.append(abs(energies[1] / energies[0] - 1))
    # The energy error of each decreases with h² or, at the ends of contact, more slowly.
    assert gaps[0] / gaps[1] > 2**1.5
    assert gaps[1] / gaps[2] > 2**1.5


def test_triangles_of_a_scene_keep_the_given_element() -> None:
    scene_path = scene.read("pressed_block", ["body.block.cell=triangle", "mesh.n=2"])
    by_mesh = scene.read("pressed_block", ["mesh.element=P1", "mesh.n=2"])
    back = scene.read(
        "pressed_block", ["body.block.cell=triangle", "mesh.n=2", "mesh.element=Q1"]
    )
    kinds = [scene.bodies(read)[0].kind.of_mesh for read in (scene_path, by_mesh, back)]
    assert kinds == ["MeshTri1", "MeshTri1", "MeshQuad1"]


def test_unknown_element_is_refused() -> None:
    with pytest.raises(scene.SceneError, match=r"mesh.element: should be 'P1', 'Q1'"):
        scene.read("pressed_block", ["mesh.element=P3"])


def test_halved_grids_divide_every_simplex() -> None:
    """Each simplex of a grid is the union of 2^d of the halved one."""
    for name, n in (("pressed_block", 2), ("sheared_cube", 2)):
        meshes = []
        for size in (n, 2 * n):
            read = scene.read(name, [f"mesh.n={size}", "mesh.element=P1"])
            meshes.append(scene.bodies(read)[0].mesh)
        coarse, fine = meshes
        dim = coarse.p.shape[0]
        centre = fine.p[:, fine.t].mean(axis=1)
        inside = coarse.element_finder()(*centre)
        assert np.all(np.bincount(inside) == 2**dim)
        # No child is larger: all its corners are in the same closed simplex.
        x = coarse.p[:, coarse.t[:, inside]].transpose(2, 1, 0)
        matrix = np.concatenate([np.ones((*x.shape[:2], 1)), x], axis=2)
        corners = fine.p[:, fine.t].transpose(2, 1, 0)
        ones = np.concatenate([np.ones((*corners.shape[:2], 1)), corners], axis=2)
        barycentric = np.linalg.solve(matrix.swapaxes(1, 2), ones.swapaxes(1, 2))
        assert barycentric.min() >= -1e-12
