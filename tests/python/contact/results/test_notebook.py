"""Results in notebooks and programs: pictures, bars, short texts, pressures, datasets."""

import sys
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.contact.path import load_path
from support.bars import bar_problem, pulled
from support.children import forked

AREA, X = np.array([0.5, 2.0]), np.array([[0.0, 0.0], [1.0, 0.0]])


def two_contacts(**options: Any) -> bp.Result:
    """Two points on springs, pressed and pulled in three steps."""
    K = 1e3 * np.eye(4)
    problem = bp.ContactProblem(K, np.eye(4), gap=0.0, mu=0.3, dim=2, **options)
    return problem.solve(np.outer([1.0, 2.0, 3.0], [-10.0, 5.0, -4.0, 0.5]))


def test_pressure_and_shear_are_the_parts_of_the_traction() -> None:
    result = two_contacts(area=AREA, points=X)
    assert result.traction is not None
    np.testing.assert_array_equal(result.pressure, result.reaction[..., 0] / AREA)
    np.testing.assert_array_equal(
        result.shear_traction, result.reaction[..., 1:] / AREA[:, None]
    )
    np.testing.assert_array_equal(result[1].pressure, result.pressure[1])
    np.testing.assert_array_equal(result[1].shear_traction, result.shear_traction[1])
    np.testing.assert_array_equal(result.points, X)


@pytest.mark.parametrize(
    ("name", "argument"),
    [("pressure", "area"), ("shear_traction", "area"), ("points", "points")],
)
def test_what_is_not_known_is_refused_by_name(name: str, argument: str) -> None:
    result = two_contacts()
    assert result.traction is None
    with pytest.raises(ValueError, match=f"{argument}= to ContactProblem"):
        getattr(result, name)
    if name != "points":
        with pytest.raises(ValueError, match="area= to ContactProblem"):
            getattr(result[0], name)


def test_one_gap_for_all_contacts() -> None:
    """As of one for each; B of six rows has two or three contacts."""
    K, load = 1e3 * np.eye(6), -np.arange(1.0, 7.0)
    for d, more in (
        (2, {"dim": 2}),
        (3, {"dim": 3}),
        (3, {"points": np.zeros((2, 3))}),
    ):
        many, one = (
            bp.ContactProblem(K, np.eye(6), gap=gap, mu=0.3, **more).solve(load)
            for gap in (np.full(6 // d, 1e-3), 1e-3)
        )
        np.testing.assert_array_equal(one.reaction, many.reaction)
    with pytest.raises(ValueError, match="B has 6 rows: give dim=2 or dim=3"):
        bp.ContactProblem(K, np.eye(6), gap=1e-3, mu=0.3)
    four = bp.ContactProblem(K[:4, :4], np.eye(4), gap=0.0, mu=0.3)
    by_step = four.solve(load[:4], gap=2e-3)
    expected = four.solve(load[:4], gap=[2e-3, 2e-3])
    np.testing.assert_array_equal(by_step.reaction, expected.reaction)


@pytest.mark.parametrize("library", ["tqdm", "rich"])
@pytest.mark.parametrize("adaptive", [False, True])
def test_progress_counts_steps_up_to_the_end(
    library: str, adaptive: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends: list[float] = []

    class Bar:
        def __init__(self, total: float = 0, unit: str = "step") -> None:
            assert unit == "step"
            self.total, self.now = total, 0.0

        def update(self, more: float) -> None:
            self.now += more

        def add_task(self, name: str, total: float) -> int:
            assert name == "load steps"
            self.total = total
            return 7

        def advance(self, task: int, more: float) -> None:
            assert task == 7
            self.update(more)

        def __enter__(self) -> None: ...
        def __exit__(self, *_: object) -> None:
            ends.extend((self.now, self.total))

    class Module:
        tqdm = Progress = Bar

    def find(name: str) -> type[Module]:
        if name.partition(".")[0] != library:
            raise ModuleNotFoundError(name=name)
        return Module

    monkeypatch.setattr(load_path, "import_module", find)
    problem, load = bar_problem()
    called: list[int] = []
    keywords: dict[str, Any] = {
        "progress": True,
        "on_step": lambda k, _: called.append(k),
    }
    if adaptive:
        result = problem.follow(30.0 * load, stops=[0.5, 2.0], largest=0.3, **keywords)
    else:
        result = problem.solve(pulled(load, np.linspace(0, 30, 5)), **keywords)
    assert called == list(range(len(result)))
    total = 2.0 if adaptive else len(result)
    assert ends == pytest.approx([total, total], rel=1e-12)  # sums of the steps round


def test_progress_is_a_bool_and_is_off_by_default(capsys: Any) -> None:
    problem, load = bar_problem()
    problem.solve(load)
    assert capsys.readouterr() == ("", "")
    with pytest.raises(TypeError, match="progress is 1, expected a bool"):
        problem.solve(load, progress=1)  # type: ignore[arg-type]


def test_a_picture_for_notebooks_without_pyplot() -> None:
    """In its own process: another test may have imported pyplot."""
    pytest.importorskip("matplotlib")
    result = two_contacts(points=X, area=AREA)

    def child() -> None:
        sys.modules.pop("matplotlib.pyplot", None)
        for ax in (result.plot(), bp.plots.convergence(result)):
            assert ax._repr_png_().startswith(b"\x89PNG")
        assert "matplotlib.pyplot" not in sys.modules

    assert forked(child, seconds=60).returncode == 0


@pytest.mark.needs_extra
def test_dataset_has_the_arrays_by_name() -> None:
    pytest.importorskip("xarray")
    result = two_contacts(area=AREA, points=X)
    data = result.to_xarray()
    pressed = data.traction.sel(component="n").isel(step=-1)
    np.testing.assert_array_equal(pressed, result.pressure[-1])
    sheared = data.slip.sel(tangent="t1").sum("step")
    np.testing.assert_array_equal(sheared, result.slip[..., 0].sum(axis=0))
    np.testing.assert_array_equal(data["load"], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(data.x, X[:, 0])
    assert data.status.dtype == np.int8
    assert "traction" not in two_contacts().to_xarray()


def test_texts_of_objects_with_forty_contacts_are_short() -> None:
    n = 40
    W, q = np.eye(3 * n), np.tile([-1.0, 0.2, 0.1], (n, 1))
    reduced = bp.ReducedProblem(W, q, 0.3)
    R, e = np.tile(np.eye(3), (n, 1)), np.array([-1.0, 0.1, 0.0])
    held = bp.ReducedProblem(W, q, 0.3, rigid=(R, e))
    problem = bp.ContactProblem(W, W, gap=0.0, mu=0.3, dim=3, points=q, area=np.ones(n))
    solution, result = reduced.solve(), problem.solve(q.ravel())
    frame, drag = np.tile(np.eye(3), (1, n, 1, 1)), np.zeros((1, n, 3))
    rest = bp.ReducedProblem(0 * W, 0 * q, 0.3, rigid=(R, e))
    things = [reduced, solution, solution.error, reduced.existence(), reduced.answers()]
    things += [solution.jvp(q=q), solution.vjp(q), held.equilibrium()]
    things += [held.limit_multiplier(e, e[::-1]), rest.reaction_range(0)]
    things += [problem, problem.contacts, problem.contacts.law, problem.loading]
    things += [problem.stiffness, result, result[0], result.contacts]
    things += [result[0].computed, result.jvp(mu=1.0), result.vjp(q)]
    things.append(bp.State(reaction=result[0].reaction, relative_displacement=0 * q))
    things.append(bp.MovingGaps(gap=drag[..., 0], frame=frame, drag=drag))
    for thing in things:
        assert len(repr(thing).splitlines()) <= 20
        assert len(repr(thing)) <= 2000
