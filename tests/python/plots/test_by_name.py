"""Pictures by name from a result, and animations whose frames have the same scales."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.animation import PillowWriter
from matplotlib.collections import PolyCollection
from matplotlib.quiver import Quiver
from PIL import Image

import bipot_rs as bp
from bipot_rs import fem, plots
from bipot_rs.plots.by_name import KINDS


def block(dim: int, steps: int = 3) -> Any:
    """A block on a floor, pressed and dragged farther in each step."""
    cell = "quadrilateral" if dim == 2 else "hexahedron"
    m = bp.Model("Block", units={"length": "mm", "force": "N", "stress": "MPa"})
    m.material("soft", young=10.0, poisson=0.3)
    sides = dict.fromkeys("xyz"[:dim], np.linspace(0.0, 1.0, 4))
    m.body("block", material="soft", cell=cell, **sides)
    up = [0.0] * (dim - 1) + [1.0]
    m.contact("block.bottom", plane={"point": [0.0] * dim, "normal": up}, mu=0.3)
    held: dict[str, Any] = {"y": 0.0, "xyz"[dim - 1]: m.times(-0.02, "pull")}
    m.support("block.top", **held | {"x": m.times(0.01, "pull")})
    m.path(steps=steps, pull=np.linspace(1 / steps, 1, steps).tolist())
    return m.solve()


@pytest.fixture(scope="module")
def flat() -> Any:
    return block(2)


@pytest.fixture(scope="module")
def solid() -> Any:
    return block(3, steps=2)


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The axes of the frames, as they are written."""
    kept: list[Any] = []
    grab = PillowWriter.grab_frame

    def keep(writer: Any, **more: Any) -> None:
        kept.append(writer.fig.axes[0])
        grab(writer, **more)

    monkeypatch.setattr(PillowWriter, "grab_frame", keep)
    return kept


def test_the_usual_picture(flat: Any, solid: Any) -> None:
    assert flat.plot().get_ylabel() == "traction [MPa]"
    (bar,) = solid.plot(step=0).child_axes
    assert bar.get_ylabel() == "pressure [MPa]"
    off = {k: v for k, v in solid.contacts.items() if k != "facets"}
    curved = off["x"] + 0.1 * off["x"][:, :1] ** 2 * [0, 0, 1]
    assert solid.plot(contacts=off | {"x": curved}).name == "3d"


def values_of(ax: Any) -> list[Any]:
    arrays = [c.get_array() for c in ax.collections]
    return [None if a is None else np.asarray(a).tolist() for a in arrays]


def test_pictures_by_name_are_those_of_the_functions(solid: Any) -> None:
    for name, direct in (
        ("slip", plots.slip(solid)),
        ("shear_map", plots.surface_map(solid, "shear")),
        ("status_3d", plots.surface3d(solid.case, solid, "status")),
        ("deformed", plots.deformed(solid)),
    ):
        ax = solid.plot(name)
        assert ax.get_title("left") == direct.get_title("left")
        assert values_of(ax) == values_of(direct)


def test_facets_are_drawn_without_the_model(solid: Any, tmp_path: Path) -> None:
    """A result from a file has its facets; the model only adds the outlines."""
    solid.save(tmp_path / "a.h5")
    again = bp.load(tmp_path / "a.h5")
    for name in ("pressure_3d", "slip_3d"):
        alone, whole = (
            [values for values in values_of(result.plot(name)) if values is not None]
            for result in (again, solid)
        )
        assert alone[0] == whole[0]
        assert len(alone[0]) % 9 == 0
    with pytest.raises(ValueError, match="the mesh of the result is not known"):
        again.plot("deformed")
    again.plot("deformed", model=solid.case)


def test_wrong_arguments_of_pictures_by_name(
    flat: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    body, gif = (flat.plot, "deformed"), (flat.animate, "a.gif")
    square = [[0, 0], [1, 1]]
    for (call, *words), more, error, said in (
        ((flat.plot, "slop"), {}, ValueError, "kind is 'slop'.*mean 'slip'"),
        ((flat.plot, "slip"), {"scale": 2}, TypeError, "scale is no argument of"),
        ((flat.plot,), {"limits": (1, 1)}, ValueError, "limits are 1 and 1, expected"),
        (body, {"box": [[0, 0]]}, ValueError, "box has shape"),
        (body, {"box": [[0, 0], [0, 1]]}, ValueError, "box is flat"),
        (body, {"near": 1, "box": square}, ValueError, "near and box are given"),
        ((flat.animate, "a.png"), {}, ValueError, "path is 'a.png', expected"),
        ((*gif, "dissipation"), {}, ValueError, "of all load steps"),
        (gif, {"step": 1}, TypeError, "step cannot be given"),
        (gif, {"steps": [3]}, ValueError, "steps has 3, exp"),
        (gif, {"steps": []}, (TypeError, ValueError), "steps"),
        (gif, {"frames_per_second": 0}, ValueError, "frames_per_second is 0, expected"),
    ):
        with pytest.raises(error, match=said):
            call(*words, **more)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_gif_has_a_frame_for_each_step(
    flat: Any, seen: list[Any], tmp_path: Path
) -> None:
    file = flat.animate(tmp_path / "a.gif", dpi=40, frames_per_second=5)
    with Image.open(file) as read:
        assert (read.format, read.n_frames) == ("GIF", 3)
        assert read.info["duration"] == 200
    titles = [ax.get_legend().get_title().get_text() for ax in seen]
    assert titles == [f"load step {k} of 3" for k in (1, 2, 3)]
    # One vertical axis shows the values of all steps.
    (low, high), *others = (ax.get_ylim() for ax in seen)
    assert others == [(low, high)] * 2
    p = flat.traction[..., 0]
    assert high == pytest.approx(p.max() + 0.05 * (p.max() + 0.3 * p.max()), rel=1e-12)
    chosen = flat.animate(tmp_path / "b.gif", steps=[2], dpi=40)
    assert chosen.stat().st_size > 0
    assert len(seen) == 4


def bars(ax: Any) -> list[Any]:
    return [it for it in ax.collections if it.colorbar is not None]


@pytest.mark.parametrize("kind", ["pressure_map", "shear_3d", "slip", "deformed"])
@pytest.mark.quick_variants("pressure_map")
def test_frames_have_the_same_colours(
    solid: Any, kind: str, seen: list[Any], tmp_path: Path
) -> None:
    solid.animate(tmp_path / "a.gif", kind, dpi=30)
    (of_frames,) = {bars(ax)[0].get_clim() for ax in seen}
    of_steps = [bars(solid.plot(kind, step=k))[0].get_clim() for k in (0, 1)]
    low, high = np.transpose(of_steps)
    assert of_frames == (low.min(), high.max())
    # Steps differ, so that this is no accident.
    assert len(set(of_steps)) == 2
    for name in ("xlim", "ylim", *(["zlim"] if seen[0].name == "3d" else [])):
        assert len({getattr(ax, f"get_{name}")() for ax in seen}) == 1


@pytest.mark.slow
def test_frames_of_bodies_show_growing_displacements(
    flat: Any, seen: list[Any], tmp_path: Path
) -> None:
    """With one factor the body moves three times as far in the last step as in the first."""
    flat.animate(tmp_path / "a.gif", "deformed", dpi=30)
    (subtitle,) = {ax.get_title("left").split(",")[0] for ax in seen}
    factor = float(subtitle.removeprefix("displacements × "))
    model = flat.case.model
    cells = np.concatenate([c for _, c in model.cells])
    longest = []
    for k, ax in enumerate(seen):
        drawn, *_ = (c for c in ax.collections if type(c) is PolyCollection)
        corners = np.array([path.vertices[:4] for path in drawn.get_paths()])
        moved = model.nodes + factor * flat[k].displacement.reshape(-1, 2)
        np.testing.assert_allclose(corners, moved[cells], rtol=1e-14)
        (arrows,) = (c for c in ax.collections if isinstance(c, Quiver))
        longest.append(np.hypot(arrows.U, arrows.V).max())
    # Arrows: one length for one force in all frames. They also scale with the extent of
    # the bodies of the frame, within 5 %.
    force = np.linalg.norm(flat.reaction, axis=2).max(axis=1)
    assert longest / longest[-1] == pytest.approx(force / force[-1], rel=0.05)


@pytest.mark.slow
def test_a_step_without_values_has_the_bar_of_the_others(
    seen: list[Any], tmp_path: Path
) -> None:
    """Nothing slips in the first step."""
    points = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    load = np.tile([[-10.0, 0.0, 0.0], [-10.0, 5.0, 0.0]], (1, 4))
    at = {"points": points, "frame": fem.frames(np.tile([0.0, 0, 1], (4, 1)))}
    K, n = np.eye(12), 4
    result = bp.solve(K, K, load, gap=np.zeros(n), mu=0.3, area=np.ones(n), **at)
    for kind, told in (
        ("slip", "no slip in the step"),
        ("shear_map", "no friction acts"),
    ):
        seen.clear()
        result.animate(tmp_path / "a.gif", kind, dpi=30)
        first, last = seen
        assert first.child_axes[0].get_ylim() == last.child_axes[0].get_ylim()
        assert [t.get_text() for t in first.texts] == [told]


@pytest.mark.slow
def test_chosen_scales_are_kept(flat: Any, seen: list[Any], tmp_path: Path) -> None:
    flat.animate(tmp_path / "a.gif", limits=(-5.0, 20.0), dpi=30)
    # The strip of statuses is below the limits.
    assert all(ax.get_ylim()[1] == 20.0 > -5.0 > ax.get_ylim()[0] for ax in seen)


def test_an_earlier_file_survives_a_failure(
    flat: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "a.gif"
    target.write_text("earlier")

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(PillowWriter, "finish", full)
    with pytest.raises(OSError, match=r"cannot write .*a\.gif: No space"):
        flat.animate(target, steps=[0], dpi=30)
    assert target.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [target]


def test_every_function_of_a_result_has_a_name() -> None:
    """Except those of something else than a result."""
    others = {
        "animate",
        "blocks",
        "convergence",
        "plot",
        "reaction_band",
        "sensitivity",
    }
    named = {kind.draw.__name__ for kind in KINDS.values()}
    named = named - {"pressure_and_wear"} | {"wear"}
    assert named | others == set(plots.__all__)
