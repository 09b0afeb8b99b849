"""Pictures of every kind of contact surface, without changing matplotlib's global state."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.plots.run_figure import write_figure
from support.layout import overlaps


def contacts(x: Any, normal: Any) -> dict[str, Any]:
    frame = fem.frames(np.broadcast_to(normal, x.shape))
    return {"x": x, "area": np.full(len(x), 0.1), "mu": np.full(len(x), 0.3)} | {
        "frame": frame
    }


def grid(n: int) -> tuple[Any, Any]:
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    return u.ravel(), v.ravel()


def plane(n: int) -> dict[str, Any]:
    u, v = grid(n)
    return contacts(np.column_stack([u, v, 0 * u]), [0.0, 0.0, 1.0])


def ball() -> dict[str, Any]:
    out = np.random.default_rng(1).normal(size=(200, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    out = out[out[:, 2] < -0.8]
    return contacts(10 * out, -out)


def floor_and_wall() -> dict[str, Any]:
    """Each with its own coordinates and its own path."""
    floor, (u, v) = plane(5), grid(5)
    wall = contacts(np.column_stack([0 * u, u, v]), [1.0, 0.0, 0.0])
    both = {name: np.concatenate([floor[name], wall[name]]) for name in floor}
    names = ["block.bottom", "block.side"]
    return both | {"surface": np.repeat([0, 1], len(u)), "surface_names": names}


def figure_of(
    known: dict[str, Any], path: Path, steps: int, *, pressed: bool = True
) -> tuple[Figure, list[str], Any]:
    """The picture of steps with random forces and statuses, its texts, the statuses."""
    n, d = known["x"].shape
    K, nothing = np.eye(n * d), np.zeros(n * d)
    solved = bp.solve(K, K, nothing, gap=np.ones(n), mu=0.3)[0]
    of_steps = []
    for k in range(steps):
        random = np.random.default_rng(k)
        reaction = pressed * random.uniform(0, 1, (n, d))
        status = pressed * random.integers(0, 3, n).astype(np.int8)
        of_steps.append(replace(solved, reaction=reaction, status=status))
    units = {"length": "mm", "stress": "MPa"}
    about = {"contacts": known, "shape": (n, d), "success": True, "message": ""}
    kept: list[Figure] = []
    save = Figure.savefig

    def keep(figure: Figure, *a: Any, **k: Any) -> None:
        kept.append(figure)
        save(figure, *a, **k)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", keep)
        write_figure(path, bp.Result(of_steps, **about, units=units), title="It")
    assert path.read_bytes().startswith(b"\x89PNG")
    texts = [t.get_text() for t in kept[0].findobj(Text) if t.get_text()]
    return kept[0], texts, of_steps[0].status


def test_line(tmp_path: Path) -> None:
    x = np.column_stack([np.linspace(0, 1, 9), np.zeros(9)])
    _, texts, status = figure_of(contacts(x, [0.0, 1.0]), tmp_path / "a.png", 1)
    slipping = f"slip ({np.sum(status == 1)})"
    assert {"It", "traction [MPa]", "x [mm]", slipping} <= set(texts)
    assert "load step" not in texts  # one step is not a path


@pytest.mark.slow
def test_a_plane_where_nothing_is_pressed(tmp_path: Path) -> None:
    _, texts, _ = figure_of(plane(4), tmp_path / "a.png", 2, pressed=False)
    assert "open (16)" in texts


SCATTERED = np.random.default_rng(4).uniform(size=(30, 3))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("known", "steps", "expected"),
    [
        (
            plane(6),
            5,
            {"pressure [MPa]", "shear traction [MPa]", "load step", "y [mm]"},
        ),
        (contacts(SCATTERED, [0.0, 0.0, 1.0]), 1, {"pressure [MPa]"}),
        (ball(), 2, set()),
        (
            floor_and_wall(),
            3,
            {"x [mm]", "y [mm]", "z [mm]", "It, load step 3 of 3"},
        ),
    ],
    ids=["plane", "no plane", "ball", "two planes"],
)
def test_surfaces_in_space_can_be_read(
    known: Any, steps: int, expected: set[str], tmp_path: Path
) -> None:
    figure, texts, _ = figure_of(known, tmp_path / "a.png", steps)
    assert expected <= set(texts)
    assert overlaps(figure) == []
    for name in known.get("surface_names", ()):
        # Above its maps, and in the legend of the path.
        assert texts.count(name) == 2
