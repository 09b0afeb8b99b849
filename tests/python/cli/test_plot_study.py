"""`bipot plot` of a sweep: what is drawn, what is left out, and names of columns."""

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bipot_rs.cli.study import picture
from bipot_rs.cli.study.folder import write, write_record
from bipot_rs.cli.study.plan import StudyRecord

Bipot = Callable[..., tuple[int, str, str]]
UNITS = {"length": "mm", "force": "N", "stress": "MPa"}


def made(
    folder: Path,
    meshes: tuple[Any, ...] = (4, 8),
    *,
    surfaces: tuple[str, ...] = ("a.b",),
) -> None:
    """A study of mu and mesh.n: the pressure is mu times mesh.n.

    The row with the least mu ends early, and that with the largest has no values.
    """
    folder.mkdir(exist_ok=True)
    done: dict[int, dict[str, Any]] = {}
    for k, (n, mu) in enumerate(product(meshes, ("0.3", "0.1", "0.2", "0.4"))):
        done[k] = {"mesh.n": n, "contact.0.mu": mu, "message": ""}
        done[k]["outcome"] = {"0.1": "not converged", "0.4": "lost"}.get(mu, "solved")
        if mu != "0.4":
            pressure = float(mu) * (n if isinstance(n, int) else 1)
            names = [f"max_pressure of {surface}" for surface in surfaces]
            done[k] |= dict.fromkeys(names, pressure) | {"seconds": 0.5, "steps": 2}
    write(folder / "sweep.csv", ["mesh.n", "contact.0.mu"], done)
    record = StudyRecord("some", [], [], None, None, "A title", UNITS, "0", len(done))
    write_record(folder, record)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The axes of every picture of a study."""
    kept: list[Any] = []
    original = picture.style.axes_of

    def axes_of(*arguments: Any) -> Any:
        kept.append(original(*arguments))
        return kept[-1]

    monkeypatch.setattr(picture.style, "axes_of", axes_of)
    return kept


# Marks of solved rows, a mark for each series.
SOLVED = "os^DvP"


def points(ax: Any, markers: str) -> list[list[tuple[float, float]]]:
    """Points of each series that have one of the markers."""
    lines = [line for line in ax.get_lines() if line.get_marker() in markers]
    return [list(zip(*line.get_data(), strict=True)) for line in lines]


def test_a_series_for_each_value_of_another_key(bipot: Bipot, drawn: list[Any]) -> None:
    made(Path("here"))
    status, output, errors = bipot("plot", "here", "--x", "mu", "--y", "max_pressure")
    assert (status, output) == (0, "here/max_pressure_over_mu.png\n")
    assert Path("here/max_pressure_over_mu.png").stat().st_size > 10_000
    (ax,) = drawn
    # Solved rows are sorted by x and connected; the row that ended early is a cross.
    for marks, values in ((SOLVED, (0.2, 0.3)), ("x", (0.1,))):
        exact = np.array([[(mu, mu * n) for mu in values] for n in (4, 8)])
        assert np.array(points(ax, marks)) == pytest.approx(exact)
    legend = ax.get_legend()
    # In grey the colours of series are alike.
    assert [line.get_marker() for line in legend.get_lines()] == ["o", "s", "x"]
    assert legend.get_title().get_text() == "mesh.n"
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts == ["4", "8", "not solved to the end: last solved load step"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("contact.0.mu", "max pressure [MPa]")
    assert ax.figure.get_suptitle() == "A title\n2 of 8 rows without value"
    left_out = "contact.0.mu or max_pressure of a.b: row 4, 8 (lost)"
    assert errors == f"bipot: left out, without {left_out}\n"


def test_many_values_have_a_colour_bar(bipot: Bipot, drawn: list[Any]) -> None:
    made(Path("here"), tuple(range(2, 10)))
    asked = ("--x", "mu", "--y", "max_pressure", "--out", "it.pdf")
    assert bipot("plot", "here/sweep.csv", *asked)[0] == 0
    assert Path("it.pdf").exists()
    (ax,) = drawn
    assert len(points(ax, SOLVED)) == 8
    (bar,) = ax.child_axes
    assert bar.get_ylabel() == "mesh.n"
    assert bar.get_ylim() == (2, 9)
    # The colours are those of the bar, from dark to light.
    light = [sum(line.get_color()[:3]) for line in ax.get_lines()[::2]]
    assert light == sorted(light)


def test_names_are_no_numbers_but_may_be_series(bipot: Bipot, drawn: list[Any]) -> None:
    made(Path("here"), ("P1", "P2"))
    assert bipot("plot", "here", "--x", "mu", "--y", "max_pressure")[0] == 0
    texts = [text.get_text() for text in drawn[0].get_legend().get_texts()]
    assert texts[:2] == ["P1", "P2"]
    status, _, errors = bipot("plot", "here", "--x", "mesh.n", "--y", "max_pressure")
    assert status == 2
    assert "here/sweep.csv row 1: mesh.n is 'P1', expected a number" in errors


def test_figures_over_figures_are_not_connected(bipot: Bipot, drawn: list[Any]) -> None:
    made(Path("here"))
    assert bipot("plot", "here", "--x", "max_pressure", "--y", "seconds")[0] == 0
    (ax,) = drawn
    # The key with the most values does not divide the rows.
    assert [len(series) for series in points(ax, SOLVED)] == [2, 2]
    assert {line.get_linestyle() for line in ax.get_lines()} == {"None"}
    assert ax.get_ylabel() == "time [s]"


def test_wrong_arguments(bipot: Bipot) -> None:
    made(Path("here"))
    x = ("--x", "mu")
    for words, why in (
        ((*x, "--y", "max_presure"), "--y is 'max_presure', expected one of row"),
        ((*x, "--y", "max_presure"), "did you mean 'max_pressure'?"),
        (("--x", "Mu", "--y", "steps"), "did you mean 'mu'?"),
        (("--x", "contact.0.mo", "--y", "steps"), "did you mean 'contact.0.mu'?"),
        ((*x, "--y", "outcome"), "--y is 'outcome', which is a column without"),
        ((*x, "--y", "residual"), "no row with both contact.0.mu and residual"),
        (("--y", "steps"), "choose what to draw with --x and --y, of row, mesh.n"),
        ((*x, "--y", "steps", "--kind", "slip"), "there is no option --kind"),
        ((*x, "--y", "steps", "--step", "1"), "there is no option --step"),
        ((*x, "--y", "steps", "--out", "it.abc"), "cannot draw it.abc"),
    ):
        status, output, errors = bipot("plot", "here", *words)
        assert (status, output) == (2, "")
        assert why in errors
    assert not list(Path().rglob("*.png"))


def test_surfaces_are_named_if_there_are_several(
    bipot: Bipot, drawn: list[Any]
) -> None:
    made(Path("here"), surfaces=("a.b", "c.d"))
    errors = bipot("plot", "here", "--x", "mu", "--y", "max_pressure")[2]
    assert (
        "--y is 'max_pressure', expected one of max_pressure of a.b, max_pressure of c.d"
        in errors
    )
    assert bipot("plot", "here", "--x", "mu", "--y", "max_pressure of c.d")[0] == 0
    assert drawn[0].get_ylabel() == "max pressure of c.d [MPa]"
    assert Path("here/max_pressure_of_c_d_over_mu.png").exists()


def test_a_folder_of_a_run_has_no_columns(bipot: Bipot) -> None:
    bipot("run", "sheared_cube", "--set", "mesh.n=2", "--out", "run")
    status, _, errors = bipot("plot", "run", "--x", "mu", "--y", "steps")
    assert status == 2
    assert "--x and --y need the folder of a sweep, but run is not" in errors
