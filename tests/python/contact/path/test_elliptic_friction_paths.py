"""Friction with two coefficients on bodies: load paths, scenes, files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import diags_array

import bipot_rs as bp
from bipot_rs import fem, scene
from support.comparisons import close, near

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]
MU = np.array([0.3, 0.06])
GRAIN = ["contact.0.mu=[0.3, 0.06]", "contact.0.axis=[1.0, 1.0, 0.0]"]


def cube(*settings: str, n: int = 4) -> scene.Case:
    asked = scene.read("sheared_cube", [f"mesh.n={n}", *settings])
    return scene.assemble(asked, scene.bodies(asked))


def path() -> tuple[fem.Assembly, Array, Array]:
    """Press, then drag there and back, so that slip reverses. One coefficient pair per contact."""
    case = cube(*GRAIN)
    drag = np.array([0.0, 1.0, -0.5, 0.2])[:, None]
    pressed, moved = case.prescribed[0], case.prescribed[1] - case.prescribed[0]
    rng = np.random.default_rng(0)
    mu = MU * rng.uniform(0.5, 1.5, (len(case.model.mu), 2))
    return case.model, pressed + drag * moved, mu


def problem(model: fem.Assembly, mu: Any, **more: Any) -> bp.ContactProblem:
    return bp.ContactProblem(
        model.K, model.B, gap=model.gap, mu=mu, fixed=model.fixed, **more
    )


def test_a_path_agrees_with_the_scaled_problem() -> None:
    """r = T r̃ and ṽ = T v, with B and gap scaled by hand and Coulomb's μ, at every step."""
    model, moved, mu = path()
    result = problem(model, mu, area=model.area).solve(None, moved, tol=1e-12)
    largest = mu.max(axis=1)
    T = np.column_stack([np.ones(len(mu)), mu / largest[:, None]])
    by_hand = bp.ContactProblem(
        model.K,
        diags_array(T.ravel()) @ model.B,
        gap=model.gap,
        mu=largest,
        fixed=model.fixed,
    ).solve(None, moved, tol=1e-12)
    # The same numbers, up to the rounding of the products T r̃ and of quotients, which the
    # history carries through four steps; η = 1e-12 for each.
    for name, ours, theirs in (
        ("reaction", result.reaction, T * by_hand.reaction),
        ("v", result.relative_displacement, by_hand.relative_displacement / T),
        ("slip", result.slip, by_hand.slip / T[:, 1:]),
        ("u", result.displacement, by_hand.displacement),
    ):
        np.testing.assert_allclose(
            ours, theirs, atol=1e-10 * np.abs(theirs).max(), err_msg=name
        )
    np.testing.assert_array_equal(result.status, by_hand.status)
    np.testing.assert_array_equal(
        result.traction, result.reaction / model.area[:, None]
    )
    # Both stick and slip occur; otherwise the test would check nothing.
    assert {1, 2} <= set(result.status[-1])


def test_a_global_problem(tmp_path: Path) -> None:
    """FCLIB cannot store it."""
    model, moved, mu = path()
    free = np.setdiff1d(np.arange(model.n), model.fixed)
    f = -(model.K[:, model.fixed] @ moved[1])[free]
    w = np.zeros((len(mu), 3))
    w[:, 0] = model.gap
    global_problem = bp.fclib.GlobalProblem(
        model.K[free][:, free], model.B[:, free].T, f, w, mu
    )
    with pytest.raises(ValueError, match=r"mu has shape .*one friction coefficient"):
        bp.fclib.write(tmp_path / "x.hdf5", problem(model, mu).reduced(None, moved[1]))
    assert not list(tmp_path.iterdir())
    answer = global_problem.solve(tol=1e-12)
    straight = problem(model, mu).solve(None, moved[1], tol=1e-12)
    size = np.abs(straight.reaction).max()
    np.testing.assert_allclose(answer.reaction, straight.reaction[0], atol=1e-10 * size)
    u = straight.displacement[0, free]
    close(global_problem.velocity(answer), u, 1e-9)


class TestGrainOfTheCube:
    def test_the_reaction_of_a_long_slide_satisfies_the_law(self) -> None:
        """All nodes slide by 10 along x and the cube deforms by 0.05: slip is along x too."""
        case = cube(*GRAIN, "support.0.x.value=10.0")
        step = case.model.problem().solve(None, case.prescribed)[-1]
        assert (step.status != bp.Status.STICK).all()
        total = np.einsum("ck,ckd->d", step.reaction, case.model.frame)
        along, across = np.array([1, 1]) / np.sqrt(2), np.array([-1, 1]) / np.sqrt(2)
        slip = MU * [along[0], across[0]]
        shear = -MU * slip / np.linalg.norm(slip)
        expected = total[2] * (shear[0] * along + shear[1] * across)
        np.testing.assert_allclose(total[:2], expected, atol=0.02 * total[2])
        # The grain turns the reaction: nearly as much sideways as backwards.
        assert total[1] < 0.8 * total[0] < 0

    def test_the_axis_turns_with_the_coefficients(self) -> None:
        totals = []
        for mu, axis in (
            ("[0.3, 0.06]", "[0.0, 2.0, 5.0]"),
            ("[0.06, 0.3]", "[1.0, 0.0, 0.0]"),
        ):
            case = cube(f"contact.0.mu={mu}", f"contact.0.axis={axis}")
            step = case.model.problem().solve(None, case.prescribed, tol=1e-12)[-1]
            totals.append(np.einsum("ck,ckd->cd", step.reaction, case.model.frame))
        size = np.abs(totals[0]).max()
        # Two solves to η = 1e-12.
        np.testing.assert_allclose(totals[0], totals[1], atol=1e-9 * size)

    def test_frames_follow_the_axis(self) -> None:
        normals = np.array([[0.0, 0, 2], [0, -1, 1], [1, 1, 1]])
        frame = fem.frames(normals, [3.0, 1.0, 0.0])
        near(frame @ frame.swapaxes(1, 2), np.tile(np.eye(3), (3, 1, 1)), 4e-16)
        np.testing.assert_allclose(np.linalg.det(frame), 1.0, rtol=1e-15)
        # t1 is the direction without its normal part, so their product is the length of t1.
        n = normals / np.linalg.norm(normals, axis=1)[:, None]
        along = np.array([3.0, 1.0, 0.0])
        length = np.sqrt(10 - (n @ along) ** 2)
        np.testing.assert_allclose(frame[:, 1] @ along, length, rtol=1e-15)
        np.testing.assert_allclose(frame[:, 2] @ along, 0.0, atol=2e-15)

    def test_a_node_that_supports_hold_has_none(self) -> None:
        case = cube(*GRAIN, "support.0.on=cube.bottom", "support.0.z=0.0")
        np.testing.assert_array_equal(case.model.mu, np.zeros_like(case.model.mu))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["mu=[0.3,-0.1]"], "mu.1: should be greater than or equal"),
        (["mu=[0.3]"], "mu: number of entries should be at least 2"),
        (["axis=[1,0,0]"], "axis: needs two numbers in mu"),
        (["mu=[0.3,0.1]", "axis=[0,0,0]"], "axis: should not be zero"),
        (["mu=[0.3,0.1]", "axis=[1,0]"], "axis: should have 3 components"),
        (["mu=[0.3,0]", "axis=[1,1,0]"], "mu: should be two positive"),
        (["mu=[0.3,0.1]", "axis=[0,0,1]"], "axis is .* not parallel to the normal"),
    ],
)
def test_wrong_scenes(settings: list[str], said: str) -> None:
    with pytest.raises(scene.SceneError, match=said):
        cube(*(f"contact.0.{setting}" for setting in settings))


def test_in_the_plane_there_is_one_tangent() -> None:
    with pytest.raises(scene.SceneError, match="has two numbers, expected one"):
        scene.read("pressed_block", ["contact.0.mu=[0.3,0.1]", "contact.0.axis=[1,0]"])
    with pytest.raises(ValueError, match="in the plane there is one tangent"):
        fem.frames([[0.0, 1.0]], [1.0, 0.0])
