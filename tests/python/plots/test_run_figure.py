"""Pictures of every kind of contact surface, without changing matplotlib's global state."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pytest
from numpy.typing import NDArray

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.plots.run_figure import write_figure
from support.layout import overlaps


def contacts(x: NDArray[np.float64], normal: NDArray[np.float64]) -> dict[str, Any]:
    frame = fem.frames(np.broadcast_to(normal, x.shape))
    return {
        "x": x,
        "area": np.full(len(x), 0.1),
        "mu": np.full(len(x), 0.3),
        "frame": frame,
    }


def step(count: int, dim: int, k: int = 0) -> dict[str, Any]:
    random = np.random.default_rng(k)
    reaction = random.uniform(0, 1, (count, dim))
    return {
        "load": float(k),
        "reaction": reaction,
        "status": random.integers(0, 3, count).astype(np.int8),
    }


def path_of(known: dict[str, Any], steps: list[dict[str, Any]]) -> bp.Result:
    """A result with these contacts and steps."""
    n, d = known["x"].shape
    solved = bp.solve(
        np.eye(n * d), np.eye(n * d), np.zeros(n * d), gap=np.ones(n), mu=0.3
    )[0]
    fields = [
        {key: fields_of_step[key] for key in ("reaction", "status")}
        for fields_of_step in steps
    ]
    return bp.Result(
        [replace(solved, **fields_of_step) for fields_of_step in fields],
        contacts=known,
        shape=(n, d),
        success=True,
        message="",
        units={"length": "mm", "stress": "MPa"},
    )


def figure_of(monkeypatch: pytest.MonkeyPatch, path: Path, *arguments: Any) -> Any:
    """The picture written to ``path``, as a figure."""
    kept: list[Any] = []
    save = matplotlib.figure.Figure.savefig

    def keep(figure: Any, *a: Any, **k: Any) -> None:
        kept.append(figure)
        save(figure, *a, **k)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", keep)
    write_figure(path, path_of(*arguments), title="It")
    assert path.read_bytes().startswith(b"\x89PNG")
    return kept[0]


def drawn(monkeypatch: pytest.MonkeyPatch, path: Path, *arguments: Any) -> list[str]:
    """Titles, labels and legends of the picture written to ``path``."""
    from matplotlib.text import Text

    figure = figure_of(monkeypatch, path, *arguments)
    return [t.get_text() for t in figure.findobj(Text) if t.get_text()]


def test_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    x = np.column_stack([np.linspace(0, 1, 9), np.zeros(9)])
    plane = contacts(x, np.array([0.0, 1.0]))
    texts = drawn(monkeypatch, tmp_path / "a.png", plane, [step(9, 2)])
    counts = np.bincount(step(9, 2)["status"], minlength=3)
    for text in ("It", "traction [MPa]", "x [mm]", f"slip ({counts[1]})"):
        assert text in texts
    assert "load step" not in texts  # # one step is not a path


@pytest.mark.slow
def test_plane_and_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    u, v = np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 6))
    x = np.column_stack([u.ravel(), v.ravel(), 0 * u.ravel()])
    plane = contacts(x, np.array([0.0, 0.0, 1.0]))
    steps = [step(36, 3, k) for k in range(5)]
    texts = drawn(monkeypatch, tmp_path / "a.png", plane, steps)
    for text in (
        "pressure [MPa]",
        "shear traction [MPa]",
        "load step",
        "y [mm]",
    ):
        assert text in texts


def test_surfaces_that_are_not_one_plane(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    x = np.random.default_rng(4).uniform(size=(30, 3))
    texts = drawn(
        monkeypatch,
        tmp_path / "a.png",
        contacts(x, np.array([0.0, 0.0, 1.0])),
        [step(30, 3)],
    )
    assert "pressure [MPa]" in texts


@pytest.mark.slow
def test_a_ball_can_be_read(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    out = np.random.default_rng(1).normal(size=(200, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    out = out[out[:, 2] < -0.8]
    ball = contacts(10 * out, np.array([0.0, 0.0, 1.0])) | {"frame": fem.frames(-out)}
    steps = [step(len(out), 3, k) for k in range(2)]
    figure = figure_of(monkeypatch, tmp_path / "a.png", ball, steps)
    assert overlaps(figure) == []


@pytest.mark.slow
def test_each_plane_surface_has_its_own_maps(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A floor and a wall: each with its own coordinates and its own path."""
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5)))
    floor = contacts(np.column_stack([u, v, 0 * u]), np.array([0.0, 0.0, 1.0]))
    wall = contacts(np.column_stack([0 * u, u, v]), np.array([1.0, 0.0, 0.0]))
    both = {name: np.concatenate([floor[name], wall[name]]) for name in floor}
    both |= {
        "surface": np.repeat([0, 1], len(u)),
        "surface_names": ["block.bottom", "block.side"],
    }
    steps = [step(2 * len(u), 3, k) for k in range(3)]
    figure = figure_of(monkeypatch, tmp_path / "a.png", both, steps)
    assert overlaps(figure) == []
    from matplotlib.text import Text

    texts = [t.get_text() for t in figure.findobj(Text)]
    # Above its maps, and in the legend of the path.
    assert texts.count("block.bottom") == texts.count("block.side") == 2
    assert {"x [mm]", "y [mm]", "z [mm]", "It, load step 3 of 3"} <= set(texts)


def test_tractions_of_open_contact(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    u, v = np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 4))
    x = np.column_stack([u.ravel(), v.ravel(), 0 * u.ravel()])
    nothing = {
        "load": 0.0,
        "reaction": np.zeros((16, 3)),
        "status": np.zeros(16, np.int8),
    }
    plane = contacts(x, np.array([0.0, 0.0, 1.0]))
    assert "open (16)" in drawn(
        monkeypatch, tmp_path / "a.png", plane, [nothing, nothing]
    )
