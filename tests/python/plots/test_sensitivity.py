"""Pictures of a gradient show its derivatives by contact, with units and one-sided contacts."""

from typing import Any

import numpy as np
import pytest
from matplotlib.collections import PathCollection, PolyCollection

import bipot_rs as bp
from bipot_rs import plots
from bipot_rs.plots.style import beyond

UNITS = {"length": "mm", "force": "N", "stress": "MPa"}


def springs(points: Any, load: Any, **law: Any) -> tuple[bp.ContactProblem, Any]:
    """Points on springs of their own, of 1000 N/mm, that touch a wall."""
    n, d = np.shape(points)
    law = {"mu": 0.3, "points": points} | law
    K, B = 1e3 * np.eye(n * d), np.eye(n * d)
    return bp.ContactProblem(K, B, gap=np.zeros(n), **law), np.ravel(load)


@pytest.fixture(scope="module")
def row() -> Any:
    """Three points: one sticks, one slips, one is pulled with just its friction limit.

    The number is the sum of the friction forces. At a slipping point r_t = -μ r_n with
    r_n = 10 N - 1000 N/mm × gap: the derivatives are -10 N by μ, 300 N/mm by the gap.
    """
    points = [[2.0, 0.0], [0.0, 0.0], [1.0, 0.0]]
    load = [[-10.0, 1.0], [-10.0, 5.0], [-10.0, 3.0]]
    problem, load = springs(points, load)
    result = problem.solve(load)
    result.units = UNITS
    bar = np.zeros_like(result.reaction)
    bar[:, :, 1] = 1.0
    return result.vjp(reaction=bar)


def rings(ax: Any) -> list[Any]:
    shown = [it for it in ax.collections if isinstance(it, PathCollection)]
    return [place for it in shown for place in it.get_offsets().tolist()]


def test_a_line_shows_the_derivative_of_each_contact(row: Any) -> None:
    ax = plots.sensitivity(row, "gap", of="friction", unit="N")
    x, y = ax.get_lines()[0].get_data()
    np.testing.assert_array_equal(x, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(y, row.gap[[1, 2, 0]])
    # Entries of K and W are powers of ten: only the solver's rounding is left.
    np.testing.assert_allclose(y[[0, 2]], [300.0, 0.0], rtol=1e-12, atol=1e-10)
    assert ax.get_xlabel() == "x [mm]"
    by_mu = plots.sensitivity(row, of="friction", unit="N")
    assert by_mu.get_lines()[0].get_ydata()[0] == pytest.approx(-10.0, rel=1e-12)
    for more, label in (
        ({"by": "gap", "of": "friction", "unit": "N"}, "d(friction) / d(gap) [N/mm]"),
        ({"of": "friction", "unit": "N"}, "d(friction) / d(μ) [N]"),
        # The unit is left out if one part is unknown.
        ({"by": "gap"}, "d(number) / d(gap)"),
        ({"by": "gap", "unit": "N", "units": {}}, "d(number) / d(gap)"),
        ({"by": "gap", "unit": "N/mm"}, "d(number) / d(gap) [(N/mm)/mm]"),
    ):
        assert plots.sensitivity(row, **more).get_ylabel() == label


def test_one_sided_contacts_have_rings(row: Any) -> None:
    np.testing.assert_array_equal(row.one_sided, [[False, False, True]])
    ax = plots.sensitivity(row)
    assert rings(ax) == [[1.0, row.mu[2]]]
    assert ax.get_legend().get_texts()[-1].get_text() == "one-sided (1)"
    assert rings(plots.sensitivity(row, on=[0, 1])) == []


def test_gaps_of_one_step_or_of_all() -> None:
    problem, load = springs([[0.0, 0.0], [1.0, 0.0]], [[-10.0, 1.0], [-10.0, 5.0]])
    result = problem.solve([load, 2 * load])
    # r_n = 10 N - 1000 N/mm × gap, in each step that of its own gap.
    bar = np.zeros_like(result.reaction)
    bar[:, :, 0] = [[1.0, 0.0], [3.0, 0.0]]
    gradient = result.vjp(reaction=bar)

    def drawn(**more: Any) -> Any:
        return plots.sensitivity(gradient, "gap", **more).get_lines()[0].get_ydata()

    np.testing.assert_allclose(drawn(step=0), [-1e3, 0.0], rtol=1e-12)
    np.testing.assert_allclose(drawn(step=-1), [-3e3, 0.0], rtol=1e-12)
    np.testing.assert_allclose(drawn(), [-4e3, 0.0], rtol=1e-12)


def test_a_map_has_colours_symmetric_about_zero() -> None:
    points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]
    frame = np.tile(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), (4, 1, 1))
    load = [[-10.0, 5, 0], [-10, 1, 0], [-10, 1, 0], [-20, -8, 0]]
    problem, load = springs(points, load, mu=np.full((4, 2), 0.3), frame=frame)
    result = problem.solve(load)
    bar = np.zeros_like(result.reaction)
    bar[:, :, 1] = 1.0
    ax = plots.sensitivity(result.vjp(reaction=bar), of="friction", unit="N")
    (image,) = (c for c in ax.collections if type(c) is PolyCollection)
    # Both coefficients of a contact change alike; r_t1 = ∓μ r_n where it slips.
    shown = np.asarray(image.get_array())
    # The nearest piece of twelve beside a corner is half a piece away from it.
    assert shown.min() == pytest.approx(-10.0, abs=10 / 12)
    assert shown.max() == pytest.approx(20.0, abs=2 * 20 / 12)
    assert image.get_clim() == pytest.approx((-20.0, 20.0), rel=1e-9)
    assert image.colorbar.extend == "neither"


def test_arrows_of_the_bar_show_larger_values() -> None:
    cases = {"neither": [-1, 1], "min": [-2, 1], "max": [0, 2], "both": [-2, 2]}
    for sides, values in cases.items():
        assert beyond(np.array(values, float), -1.0, 1.0) == sides


def test_wrong_arguments_are_named(row: Any) -> None:
    for more, error, says in (
        ({"by": "load"}, ValueError, "by is 'load', expected 'mu' or 'gap'"),
        ({"by": "mu", "step": 0}, ValueError, "step is given, but the friction"),
        ({"by": "gap", "step": 3}, ValueError, "step is 3, expected 0 to 0"),
        ({"on": [7]}, ValueError, "on is out of range, expected 0 to 2"),
        ({"ax": 3}, TypeError, "ax is a int"),
    ):
        with pytest.raises(error, match=says):
            plots.sensitivity(row, **more)
    with pytest.raises(TypeError, match=r"gradient.*a gradient of Result\.vjp"):
        plots.sensitivity(row.result)
