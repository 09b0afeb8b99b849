"""The iterative engine gives the answers of the direct one, or says that it cannot."""

import pickle
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.contact.errors import NotIterativeError
from bipot_rs.contact.path.prepared import PreparedStiffness
from support.body_models import floating, on_a_ball, on_springs, order_two, warmed
from support.pressed_in_space import arrays, pressed
from support.rollers import roller
from support.runs import bipot

# Both engines reach η = 1e-12 in the smallest units of the scene. Errors of the reactions
# are larger by the condition of the contacts, and those of the steps of a path add up.
CLOSE = 1e-9


MODELS: dict[str, Callable[[], bp.Model]] = {
    "hexahedra": pressed,
    "tetrahedra": lambda: pressed(cell="tetrahedron"),
    "second order": order_two,
    "plane": lambda: pressed(10, dim=2),
    "triangles": lambda: pressed(10, dim=2, cell="triangle"),
    "no friction": lambda: pressed(mu=0.0),
    "friction by direction": lambda: pressed(mu=[0.5, 0.1], axis=[1.0, 0.0, 0.0]),
    "large friction": lambda: pressed(mu=3.0),
    "a ball that moves back": on_a_ball,
    "held by contact alone": floating,
    "springs": on_springs,
    "initial strain": warmed,
    "a roller": roller,
    "automatic steps": lambda: roller({"slip": 0.05}),
}


def solved(model: bp.Model, engine: str) -> Any:
    model.solver(engine=engine, tol=1e-12)
    return model.solve()


@pytest.mark.parametrize("name", MODELS)
def test_both_engines_agree(name: str) -> None:
    direct = solved(MODELS[name](), "direct")
    iterative = solved(MODELS[name](), "iterative")
    assert len(direct) == len(iterative)
    for ours, theirs in zip(iterative, direct, strict=True):
        assert ours.converged
        assert "krylov" in ours.stats
        assert "krylov" not in theirs.stats
        for what in ("reaction", "displacement"):
            a, b = getattr(ours, what), getattr(theirs, what)
            assert np.abs(a - b).max() <= CLOSE * np.abs(b).max(), what
        # A status may differ where a contact is on the border of two.
        closed = np.linalg.norm(theirs.reaction, axis=1)
        clear = closed > 1e-6 * closed.max()
        slips = np.linalg.norm(theirs.slip, axis=1)
        clear &= (slips > 1e-6 * slips.max()) | (theirs.status == bp.Status.STICK)
        np.testing.assert_array_equal(ours.status[clear], theirs.status[clear])


@pytest.mark.parametrize("n", [6, 12])
def test_work_does_not_grow_with_the_mesh(n: int) -> None:
    """Krylov iterations of both steps; the trial programs took 60 to 80 at any size."""
    result = solved(pressed(n), "iterative")
    assert sum(step.stats["krylov"] for step in result) <= 90
    assert sum(step.stats["newton"] for step in result) <= 20


@pytest.mark.parametrize("poisson", [0.45, 0.49, 0.499])
def test_nearly_incompressible(poisson: float) -> None:
    model = pressed(6).with_(**{"material.soft.poisson": poisson})
    direct, ours = solved(model, "direct"), solved(model, "iterative")
    assert ours.success
    np.testing.assert_allclose(
        ours.reaction, direct.reaction, rtol=0, atol=CLOSE * direct.reaction.max()
    )


@pytest.mark.parametrize("located", [True, False])
def test_units_do_not_matter(located: bool) -> None:
    reference = None
    for factor in (1.0, 2.0**40, 2.0**-60, 1e-9, 1e30):
        arguments, prescribed = arrays(factor=factor)
        if not located:
            del arguments["coordinates"]
        problem = bp.ContactProblem(**arguments, engine="iterative")
        r = problem.solve(prescribed=prescribed).reaction / factor
        reference = r if reference is None else reference
        assert np.abs(r - reference).max() <= CLOSE * np.abs(reference).max()


def test_threads_do_not_change_a_bit() -> None:
    arguments, prescribed = arrays(8)
    first_run, two = (
        bp.ContactProblem(**arguments, engine="iterative", num_threads=k).solve(
            prescribed=prescribed
        )
        for k in (1, 2)
    )
    np.testing.assert_array_equal(first_run.reaction, two.reaction)
    np.testing.assert_array_equal(first_run.displacement, two.displacement)


@pytest.mark.parametrize("located", [True, False])
def test_degrees_of_freedom_by_components(located: bool) -> None:
    arguments, prescribed = arrays()
    n = arguments["K"].shape[0]
    order = np.arange(n).reshape(-1, 3).T.ravel()
    other = arguments | {
        "K": arguments["K"].tocsr()[order][:, order],
        "B": arguments["B"].tocsr()[:, order],
        "fixed": np.argsort(order)[arguments["fixed"]],
        "coordinates": arguments["coordinates"][order],
    }
    if not located:
        del arguments["coordinates"], other["coordinates"]
    a, b = (
        bp.ContactProblem(**permuted, engine="iterative").solve(prescribed=prescribed)
        for permuted in (arguments, other)
    )
    assert np.abs(a.reaction - b.reaction).max() <= CLOSE * a.reaction.max()


class TestWithoutCoordinates:
    """Nodes and near-null vectors come from K and B."""

    @pytest.mark.parametrize("n", [6, 12])
    def test_the_answer_and_the_work(self, n: int) -> None:
        arguments, prescribed = arrays(n)
        direct = bp.ContactProblem(**arguments, engine="direct").solve(
            prescribed=prescribed, tol=1e-12
        )
        del arguments["coordinates"]
        ours = bp.ContactProblem(**arguments, engine="iterative").solve(
            prescribed=prescribed, tol=1e-12
        )
        r = direct.reaction
        assert np.abs(ours.reaction - r).max() <= CLOSE * r.max()
        np.testing.assert_array_equal(ours.status, direct.status)
        # With coordinates 90 are enough; the vectors that replace the rotations are rough.
        assert sum(step.stats["krylov"] for step in ours) <= 150

    def test_a_body_without_supports_is_refused(self) -> None:
        """Whether contact holds it, only its rigid motions tell."""
        arguments, _ = arrays()
        del arguments["coordinates"], arguments["fixed"]
        with pytest.raises(NotIterativeError, match=r"coordinates.*engine='direct'"):
            bp.ContactProblem(**arguments, engine="iterative")

    @pytest.mark.parametrize("n", [4, 6, 8, 9])
    def test_a_body_that_can_turn_is_refused(self, n: int) -> None:
        """Two nodes are held: the body turns about the line through them, and K resists this by
        its rounding, which differs with the size.
        """
        arguments, _ = arrays(n)
        del arguments["coordinates"]
        arguments["fixed"] = arguments["fixed"].reshape(-1, 3)[:2].ravel()
        with pytest.raises(NotIterativeError, match=r"coordinates.*engine='direct'"):
            bp.ContactProblem(**arguments, engine="iterative")


def test_a_path_continues_and_survives_a_pickle() -> None:
    arguments, prescribed = arrays()
    problem = bp.ContactProblem(**arguments, engine="iterative")
    whole = problem.solve(prescribed=prescribed)
    first = problem.solve(prescribed=prescribed[:1])
    again = pickle.loads(pickle.dumps(problem))
    assert again.stats["engine"] == "iterative"
    for problem_of_path in (problem, again):
        rest = problem_of_path.solve(prescribed=prescribed[1:], start=first)
        np.testing.assert_array_equal(rest.reaction[0], whole.reaction[1])


def test_a_path_with_open_contacts_continues_to_the_same_bits() -> None:
    case = on_a_ball().assemble()
    model = case.model
    made = [
        bp.ContactProblem(
            model.K,
            model.B,
            gap=model.gap,
            mu=model.mu,
            fixed=model.fixed,
            coordinates=np.repeat(model.nodes, 3, axis=0),
            engine="iterative",
        )
        for _ in range(2)
    ]
    whole = made[0].solve(prescribed=case.prescribed)
    rest = made[1].solve(prescribed=case.prescribed[2:], start=whole[1])
    assert (whole[1].status == bp.Status.OPEN).any()
    np.testing.assert_array_equal(rest.reaction[0], whole.reaction[2])
    np.testing.assert_array_equal(rest.displacement[0], whole.displacement[2])


def test_many_cases_and_other_friction() -> None:
    arguments, prescribed = arrays()
    mus = (0.1, 0.6)
    cases = [{"prescribed": prescribed, "mu": mu} for mu in mus]
    problem = bp.ContactProblem(**arguments, engine="iterative")
    for mu, path_result in zip(mus, problem.solve_many(cases), strict=True):
        direct = bp.ContactProblem(**arguments | {"mu": mu}, engine="direct")
        r = direct.solve(prescribed=prescribed).reaction
        assert np.abs(path_result.reaction - r).max() <= CLOSE * r.max()


def test_the_direct_engine_replaces_it_where_it_stalls(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """ν so close to a half that multigrid does not converge."""
    arguments, prescribed = arrays()
    model = pressed(4).with_(**{"material.soft.poisson": 0.4999999}).assemble().model
    arguments["K"] = model.K
    problem = bp.ContactProblem(**arguments, engine="iterative")
    replaced = problem.solve(prescribed=prescribed)
    direct = bp.ContactProblem(**arguments, engine="direct").solve(
        prescribed=prescribed
    )
    r = direct.reaction
    # The entries of K round away half of the digits for this ν.
    assert np.abs(replaced.reaction - r).max() <= 1e-6 * r.max()
    if "krylov" not in replaced[0].stats:
        assert "stalled" in problem.stats["engine_reason"]

    def refused(*_args: Any) -> Any:
        raise MemoryError("the factor does not fit")

    monkeypatch.setattr(PreparedStiffness, "_condense", refused)
    small = bp.ContactProblem(**arguments, engine="iterative")
    outcome = small.solve_many([{"prescribed": prescribed}])[0]
    if outcome.success:
        assert np.abs(outcome.reaction - r).max() <= 1e-6 * r.max()
    else:
        assert "not converged" in outcome.message


def test_the_summary_names_the_engine() -> None:
    arguments, _ = arrays()
    text = str(bp.ContactProblem(**arguments, engine="iterative"))
    assert "engine" in text
    assert "iterative: it was asked for" in text


def test_a_slender_body_is_right_or_left_to_the_direct_engine() -> None:
    """Rows of K balance to the last digit long before the bending does."""
    m = bp.Model("Strip")
    m.material("steel", young=210e9, poisson=0.3)
    long, high = np.linspace(0, 1.0, 81), np.linspace(0, 2e-3, 3)
    m.body("strip", material="steel", cell="quadrilateral", x=long, y=high)
    m.support("strip.left", x=0.0, y=0.0)
    m.contact("strip.bottom", plane={"point": [0, -1e-4], "normal": [0, 1]}, mu=0.2)
    m.body_force("strip", y=m.times(-7.7e4, "weight"))
    m.path(weight=[0.2, 1.0])
    direct, ours = solved(m, "direct"), solved(m, "iterative")
    u = direct.displacement
    # The amplification of the rounding of K by bending is about 1e6.
    assert np.abs(ours.displacement - u).max() <= 1e-8 * np.abs(u).max()


def test_a_body_that_can_turn_is_refused() -> None:
    """Two contact nodes: the body turns about the line through them."""
    arguments, _ = arrays()
    few = arguments | {
        "B": arguments["B"][:6],
        "gap": arguments["gap"][:2],
        "mu": 0.3,
        "fixed": None,
    }
    with pytest.raises(NotIterativeError, match="free to move"):
        bp.ContactProblem(**few, engine="iterative")
    with pytest.raises(bp.FloatingBodyError):
        bp.ContactProblem(**few)


def test_few_digits_of_a_floating_body_are_no_springs() -> None:
    """Rounded entries resist rigid motions as weak springs would."""
    arguments, _ = arrays()
    arguments["fixed"] = None
    bp.ContactProblem(**arguments, engine="iterative")
    rounded = arguments["K"].copy()
    rounded.data = np.array([float(f"{x:.6e}") for x in rounded.data])
    with pytest.raises(NotIterativeError, match="few digits"):
        bp.ContactProblem(**arguments | {"K": rounded}, engine="iterative")


class TestRefusals:
    """Each names the reason and the way out."""

    def test_other_methods(self) -> None:
        arguments, prescribed = arrays()
        problem = bp.ContactProblem(**arguments, engine="iterative")
        with pytest.raises(ValueError, match=r"'uzawa'.*engine='direct'"):
            problem.solve(prescribed=prescribed, method="uzawa")

    def test_the_compliance(self) -> None:
        arguments, prescribed = arrays()
        problem = bp.ContactProblem(**arguments, engine="iterative")
        with pytest.raises(ValueError, match=r"compliance W.*engine='direct'"):
            _ = problem.compliance
        step = problem.solve(prescribed=prescribed)[-1]
        assert step.unique == "unknown"
        assert "engine='direct'" in step.error.reason

    def test_unknown_engine(self) -> None:
        arguments, _ = arrays()
        with pytest.raises(ValueError, match="engine is 'iterativ', expected"):
            bp.ContactProblem(**arguments, engine="iterativ")

    def test_asymmetric_stiffness(self) -> None:
        arguments, _ = arrays()
        wrong = arguments["K"].tolil()
        wrong[0, 1] += 1.0
        with pytest.raises(ValueError, match="not symmetric"):
            bp.ContactProblem(**arguments | {"K": wrong.tocsr()}, engine="iterative")


def test_the_file_names_the_engine(tmp_path: Any) -> None:
    out = tmp_path / "out"
    asked = ("--set", "mesh.n=5", "--engine", "iterative", "--out", "out")
    bipot("run", "sheared_cube", *asked, cwd=tmp_path)
    with h5py.File(out / "result.h5") as file:
        assert file.attrs["engine"] == "iterative"
    assert bp.load(out / "result.h5")[-1].stats["krylov"] > 0
