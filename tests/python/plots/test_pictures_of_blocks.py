"""Pictures of rigid blocks."""

from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import plots
from support.masonry import assemble, box

pytest.importorskip("matplotlib")
from matplotlib.figure import Figure


def lines_of(ax: Any) -> dict[str, list[np.ndarray]]:
    """Points of the lines with each label; those without follow one that has it."""
    lines: dict[str, list[np.ndarray]] = {}
    name = ""
    for one in ax.lines:
        label = one.get_label()
        name = name if label.startswith("_") else label
        points = one.get_data_3d() if ax.name == "3d" else one.get_data()
        lines.setdefault(name, []).append(np.array(points).T)
    return lines


def column() -> bp.blocks.BlockProblem:
    blocks = [box("ground", (-9, -1), (9, 0), support=True)]
    return assemble([*blocks, box("a", (0, 0), (2, 2)), box("b", (0, 2), (2, 4))], 0.5)


def test_resultants_and_thrust_line() -> None:
    """The upper block presses by 4, one quarter from the left; the lower one by 8."""
    problem = column()
    reaction = np.zeros(problem.q.shape)
    below = problem.interface == [
        k for k, one in enumerate(problem.interfaces) if one.first == 0
    ]
    reaction[below, 0] = 4.0
    reaction[~below, 0] = np.where(problem.points[~below, 0] == 0, 3.0, 1.0)
    ax = plots.blocks(problem, reaction, names=True, units={"force": "kN"})
    lines = lines_of(ax)
    (thrust,) = lines.pop("thrust line")
    assert sorted(thrust.tolist()) == [[0.5, 2.0], [1.0, 0.0]]
    (name,) = lines
    assert name == "resultants, largest 8 kN"
    lengths = {
        round(float(np.ptp(x[:, 1])), 12): x.mean(axis=0).tolist() for x in lines[name]
    }
    # 12 % of the extent of 4 for the largest; the other in proportion.
    assert lengths == {0.48: [1.0, 0.0], 0.24: [0.5, 2.0]}
    # The ground is outside what is drawn.
    assert [text.get_text() for text in ax.texts] == ["a", "b"]


def test_a_figure_of_the_user_keeps_its_size() -> None:
    figure = Figure(figsize=(9.0, 2.0))
    plots.blocks(column(), ax=figure.add_subplot())
    assert figure.get_size_inches().tolist() == [9.0, 2.0]


def test_a_block_that_topples_has_a_hinge() -> None:
    problem = column()
    # The upper block turns about its lower right corner, (2, 2).
    motion = np.array([0, 0, 0, 1, 1, -1.0])
    lines = lines_of(plots.blocks(problem, motion=motion, scale=0.1))
    (hinge,) = lines["hinges"]
    assert hinge.tolist() == [[2.0, 2.0]]
    (moved,) = lines["moved"]
    # The corner stays, the one above it moves to the right by the height.
    assert np.abs(moved - [2, 2]).sum(axis=1).min() < 1e-12
    assert np.abs(moved - [2.2, 4]).sum(axis=1).min() < 1e-12


def test_blocks_in_space() -> None:
    ground = box("ground", (-1, -1, -1), (3, 3, 0), support=True)
    problem = assemble([ground, box("a", (0, 0, 0), (2, 2, 2))], 0.5)
    reaction = np.zeros(problem.q.shape)
    reaction[:, 0] = 2.0
    motion = np.array([0, 0, 1, 0, 0, 0.0])
    ax = plots.blocks(problem, reaction, motion)
    lines = lines_of(ax)
    assert len(lines["moved"]) == 6
    # All open alike.
    assert "hinges" not in lines
    (force,) = lines["resultants, largest 8"]
    assert np.abs(force.mean(axis=0) - [1, 1, 0]).max() < 1e-12


def test_refused_pictures_of_blocks() -> None:
    other: Any = bp.ReducedProblem([[1.0, 0], [0, 1]], [[0, 0.0]], 0.5)
    with pytest.raises(TypeError, match=r"expected what blocks\.assemble returns"):
        plots.blocks(other)
    with pytest.raises(ValueError, match=r"reaction has shape \(1, 2\), expected \(4"):
        plots.blocks(column(), [[0.0, 0.0]])
    with pytest.raises(ValueError, match=r"motion has shape \(2,\), expected \(6,\)"):
        plots.blocks(column(), motion=[0.0, 0.0])
