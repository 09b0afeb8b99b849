"""The shipped scenes compared with their references, and mistakes in scene files."""

import json
import runpy
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
from support.comparisons import near, refused
from support.faulty_scenes import MISTAKES

DATA = places.DATA
LETTER = {"pressed_block": "A", "sheared_cube": "B", "two_blocks": "D"}
Floats = NDArray[np.float64]


def assembled(name: str, *settings: str) -> scene.Case:
    read = scene.read(name, settings)
    return scene.assemble(read, scene.bodies(read))


def solve(name: str, *settings: str, **options: Any) -> tuple[scene.Case, Any]:
    """Case and result of a scene, by default with its own tolerance."""
    case = assembled(name, *settings)
    options.setdefault("tol", scene.read(name, settings).solver.tol)
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
def test_second_route(
    name: str,
    n: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Independent code from the mesh on: SciPy's factorisation, a Newton method."""
    case, result = solve(name, f"mesh.n={n}")
    assert np.all(result.residual <= 1e-12)
    answer, program = tmp_path / "peer.npz", places.ROOT / "benches/peers/with_scipy.py"
    arguments = [str(program), name, str(n), f"--save={answer}", "--tol=1e-12"]
    monkeypatch.syspath_prepend(program.parent)
    monkeypatch.setattr(sys, "argv", arguments)
    runpy.run_path(str(program), run_name="__main__")
    peer = np.load(answer)
    assert json.loads(capsys.readouterr().out)["contacts"] == len(peer["x"])
    distance, order = cKDTree(case.model.points).query(peer["x"])
    assert distance.max() <= 1e-12 * np.ptp(peer["x"])
    # Both residuals are below 1e-12; the conditions of W here are below 1e4.
    error = traction_error(result.reaction[:, order], peer["R"], peer["area"])
    assert np.all(error <= 1e-8), error


@pytest.mark.parametrize(
    ("name", "n", "dofs", "contacts", "steps"),
    [
        ("pressed_block", 32, 2178, 33, 1),
        ("sheared_cube", 15, 12288, 256, 2),
        ("cattaneo_mindlin", 10, 7220, 61, 2),
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
    assert name in scene.shipped()
    assert len(scene.shipped()) == 9
    read = scene.read(name)
    assert read.mesh is not None
    assert read.mesh.n == n
    case = assembled(name)
    assert (case.model.n, len(case.model.gap)) == (dofs, contacts)
    assert case.prescribed.shape == (steps, len(case.model.fixed))
    assert case.parameter.shape == (steps,)


def test_cyclic_path() -> None:
    case = assembled("cyclic_cube", "mesh.n=2")
    top = case.model.fixed % 3 == 0
    # First pressing alone, then forty steps of the sine.
    sine = 0.025 * np.sin(2 * np.pi * np.arange(41) / 20)
    # The phase, up to 4π, is rounded: 4π ε of the amplitude.
    near(case.prescribed[:, top].T, np.tile(sine, (9, 1)), 0.025 * 4 * np.pi * 2.3e-16)


@pytest.mark.parametrize("steps", [1, 4])
def test_a_ramp_takes_any_number_of_steps(steps: int) -> None:
    case = assembled("raous_plate", "mesh.n=2", f"path.steps={steps}")
    # Quarters are exact in binary.
    np.testing.assert_array_equal(case.parameter, np.arange(1, steps + 1) / steps)
    assert case.load is not None
    np.testing.assert_array_equal(case.load[0] * steps, case.load[-1])


@pytest.mark.parametrize(
    ("axis", "n", "grid"),
    [
        # 0 1 3 7 15 → clipped to 10; the last cell of 3 is not below half of 4.
        ({"from": 0.0, "to": 10.0}, None, [0, 1, 3, 7, 10]),
        # The last cell would be 1, below half of 4: its inner point is removed.
        ({"from": 0.0, "to": -8.0}, None, [-8, -3, -1, 0]),
        # From -1: cells of 2, 4, then a rest of 1, which is below half of 4. From 1: a
        # cell of 2, then a rest of 1, which is half of 2 and stays.
        (
            {"from": -8.0, "to": 4.0, "uniform": [-1.0, 1.0]},
            2,
            [-8, -3, -1, 0, 1, 3, 4],
        ),
    ],
)
def test_graded_grid(axis: dict[str, Any], n: int | None, grid: list[int]) -> None:
    made = Axis.model_validate({"cell": 1.0, "growth": 2.0} | axis).grid(n)
    np.testing.assert_array_equal(made, grid)


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
    settings = ("mesh.n=3", "contact.0.cohesion=0.3")
    cohesion = assembled("sheared_cube", *settings).model.cohesion
    # Rounding of sixteen terms.
    assert cohesion.sum() == pytest.approx(0.3 * 100.0 * 100.0, rel=1e-14)
    assert cohesion.max() == pytest.approx(4 * cohesion.min(), rel=1e-14)


def test_suggestions_for_keys_that_exist_elsewhere() -> None:
    """A key is looked for elsewhere in the scene, with one search for all mistakes."""
    table = scene.parse("sheared_cube", scene.text("sheared_cube"))
    wrong = table["contact"][0] | {"cells": 3, "young": 1}
    table["contact"] = [wrong | {"zzz": k} for k in range(300)]
    table["body"]["cube"]["zzz"] = 1
    with pytest.raises(scene.SceneError) as caught:
        scene.check("mine", table)
    messages = "\n".join(str(mistake) for mistake in caught.value.mistakes)
    (young,) = (f"material.{name}.young" for name in table["material"])
    cells = " or ".join(f"body.cube.{axis}.cells" for axis in "xyz")
    for k in (0, 299):
        for key, said in (
            ("young", f"did you mean {young}?"),
            ("cells", f"did you mean {cells}?"),
            ("zzz", "expected one of on, name, mu"),
        ):
            assert f"contact.{k}.{key}: unknown key, {said}" in messages


def test_files_that_are_not_scenes(tmp_path: Path) -> None:
    with refused("neither a file nor one of cattaneo"):
        scene.read("nothing")
    broken = tmp_path / "broken.toml"
    broken.write_text("[mesh\nn = 3")
    with refused(r"is not TOML: .*line 1"):
        scene.read(str(broken))
    with refused(r"mesh.element: should be 'P1', 'Q1'"):
        scene.read("pressed_block", ["mesh.element=P3"])
    with refused("do not match"):
        assembled("two_blocks", "body.lower.x.to=90.0")


def test_loads_of_a_scene() -> None:
    case, _ = solve("pressed_block", "mesh.n=4")
    assert case.load is not None
    f = case.load[0].reshape(-1, 2)
    # -100 on a side of 40, -50 on a side of 40; rounding of a sum of five.
    np.testing.assert_allclose(f.sum(axis=0), [-4000, -2000], rtol=1e-14)


@pytest.mark.parametrize(
    ("name", "n"),
    [
        ("pressed_block", 8),
        ("sheared_cube", 3),
        ("two_blocks", 4),
        ("cattaneo_mindlin", 5),
    ],
)
def test_linear_cells_on_the_same_grid(name: str, n: int) -> None:
    case, result = solve(name, f"mesh.n={n}")
    linear, other = solve(name, f"mesh.n={n}", "mesh.element=P1")
    # The same nodes, supports and contacts; the areas add up to the same surface.
    for field in ("nodes", "fixed", "points"):
        ours, theirs = getattr(linear.model, field), getattr(case.model, field)
        np.testing.assert_array_equal(ours, theirs)
    assert linear.model.area.sum() == pytest.approx(case.model.area.sum(), rel=1e-13)
    assert {kind for kind, _ in linear.model.cells} <= {"triangle", "tetra"}
    if case.load is not None:
        # Loads on edges are equal; in space the two triangles of a square differ from it.
        np.testing.assert_allclose(linear.load, case.load, atol=1e-12 * case.load.max())
    # Coarse meshes differ by 3 to 10 %, with discretisation errors of 10 to 30 %.
    assert energy(linear, other) == pytest.approx(energy(case, result), rel=0.1)
    counts = [np.bincount(r.status[0], minlength=3) for r in (result, other)]
    # Zones agree except for nodes at their borders.
    assert np.abs(np.subtract(*counts)).max() <= 0.25 * len(case.model.gap)


def energy(case: scene.Case, result: Any) -> float:
    u = result.displacement[0]
    return float(0.5 * u @ (case.model.K @ u))


def test_linear_cells_converge_to_the_same_solution() -> None:
    """Energies of both elements converge to each other, here with h to the power 1.5."""
    gaps = []
    for n in (4, 8, 16):
        one, other = (
            energy(*solve("pressed_block", f"mesh.n={n}", f"mesh.element={element}"))
            for element in ("Q1", "P1")
        )
        gaps.append(abs(other / one - 1))
    # The energy error of each decreases with h² or, at the ends of contact, more slowly.
    assert gaps[0] / gaps[1] > 2**1.5
    assert gaps[1] / gaps[2] > 2**1.5


@pytest.mark.parametrize("name", ["pressed_block", "sheared_cube"])
def test_halved_grids_divide_every_simplex(name: str) -> None:
    """Each simplex of a grid is the union of 2^d of the halved one."""
    coarse, fine = (
        scene.bodies(scene.read(name, [f"mesh.n={n}", "mesh.element=P1"]))[0].mesh
        for n in (2, 4)
    )
    inside = coarse.element_finder()(*fine.p[:, fine.t].mean(axis=1))
    assert np.all(np.bincount(inside) == 2 ** coarse.p.shape[0])

    def corners(x: Floats) -> Floats:
        """Corners of cells ``(d, corners, cells)`` after a one, as matrices."""
        x = x.transpose(2, 1, 0)
        return np.concatenate([np.ones((*x.shape[:2], 1)), x], axis=2).swapaxes(1, 2)

    # No child is larger: all its corners are in the same closed simplex.
    matrix = corners(coarse.p[:, coarse.t[:, inside]])
    assert np.linalg.solve(matrix, corners(fine.p[:, fine.t])).min() >= -1e-12
