"""Pictures of several surfaces, of curved surfaces, and of bodies."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.quiver import Quiver
from PIL import Image

import bipot_rs as bp
from bipot_rs import fem, plots
from bipot_rs.cli.study.folder import _print
from bipot_rs.plots import style as canvas
from support import places
from support.layout import overlaps

UNITS = {"length": "mm", "force": "N", "stress": "MPa"}


@pytest.fixture(scope="module")
def clamp() -> bp.Model:
    """A pad between a floor and a die that moves down; then the pad is pulled out."""
    made = bp.Model(title="Clamp", units=UNITS)
    made.material("steel", young=210e3, poisson=0.3)
    size = {"x": np.linspace(0.0, 20.0, 9), "y": np.linspace(0.0, 10.0, 5)}
    made.body("pad", material="steel", cell="quadrilateral", **size)
    down = {"point": [0.0, 10.0], "normal": [0.0, -1.0]}
    made.obstacle("die", plane=down, move={"y": -0.02})
    floor = {"point": [0.0, 0.0], "normal": [0.0, 1.0]}
    made.contact("pad.bottom", plane=floor, mu=0.3)
    made.contact("pad.top", against="die", mu=0.2)
    made.traction("pad.right", x=made.times(60.0, "pull"))
    made.path(steps=3, pull=[0.2, 0.6, 1.0])
    return made


@pytest.fixture(scope="module")
def clamped(clamp: bp.Model) -> Any:
    return clamp.solve()


def sorted_by_x(result: Any, name: str) -> Any:
    """The contacts of a surface, from left to right."""
    there = result.contacts_of(name)
    return there[np.argsort(result.contacts["x"][there, 0])]


@pytest.fixture(scope="module")
def ring() -> bp.Result:
    """A disc pushed to one side and rotated in a tight ring, on its own springs."""
    count = 24
    angle = np.random.default_rng(3).permutation(np.arange(count)) * 2 * np.pi / count
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    frame = fem.frames(-out)
    turned = np.stack([-out[:, 1], out[:, 0]], axis=1)
    load = np.zeros((2, count, 2))
    # Pressed, and rotated counter-clockwise so that all slip: r = -load of unit springs.
    load[:, :, 0] = -(1 + 0.5 * out[:, 0])
    load[:, :, 1] = np.einsum("ij,ij->i", turned, frame[:, 1]) * [[0.1], [0.9]]
    at = {"gap": np.zeros(count), "points": 3 * out, "frame": frame}
    K = np.eye(2 * count)
    return bp.solve(K, K, load.reshape(2, -1), mu=0.3, **at)


def labels(ax: Any) -> list[str]:
    return [t.get_text() for t in ax.get_legend().get_texts() if t.get_text().strip()]


def of_colour(ax: Any, k: int, style: str) -> Any:
    """The lines of one style for one surface."""
    return [
        line.get_data()
        for line in ax.get_lines()
        if line.get_color() == canvas.cycle(k) and line.get_linestyle() == style
    ]


def test_each_surface_has_its_lines(clamped: Any) -> None:
    ax = plots.tractions(clamped)
    assert labels(ax)[:2] == ["pad.bottom", "pad.top"]
    assert ax.get_xlabel() == "x [mm]"
    for k, name in enumerate(("pad.bottom", "pad.top")):
        order = sorted_by_x(clamped, name)
        (solid, *_), (dashed, *_) = (of_colour(ax, k, ls) for ls in ("-", "--"))
        np.testing.assert_array_equal(solid[0], clamped.contacts["x"][order, 0])
        np.testing.assert_array_equal(solid[1], clamped.traction[-1][order, 0])
        # On both surfaces the pull acts along x, and friction against it.
        t1 = clamped.contacts["frame"][order, 1, 0]
        np.testing.assert_array_equal(dashed[1], clamped.traction[-1][order, 1] * t1)
    assert overlaps(ax.figure) == []


@pytest.mark.parametrize(
    "draw", [plots.slip, plots.status_map, plots.resultants, plots.deformed]
)
@pytest.mark.slow_variants("deformed")
@pytest.mark.slow_variants("resultants")
def test_pictures_of_two_surfaces_can_be_read(
    clamped: Any, draw: Callable[..., Any]
) -> None:
    ax = draw(clamped)
    assert overlaps(ax.figure) == []
    if draw is not plots.deformed:
        texts = [t.get_text() for t in ax.texts]
        told = texts if draw is plots.status_map else labels(ax)
        assert {"pad.bottom", "pad.top"} <= set(told)


def test_zones_of_two_surfaces_are_apart(clamped: Any) -> None:
    ax = plots.status_map(clamped)
    low, high = (it for it in ax.collections if isinstance(it, QuadMesh))
    for image, name in ((low, "pad.bottom"), (high, "pad.top")):
        zones = clamped.status[:, sorted_by_x(clamped, name)]
        np.testing.assert_array_equal(image.get_array(), zones)
    ends = [np.asarray(image.get_coordinates())[..., 1] for image in (low, high)]
    assert ends[0].max() < ends[1].min()


def test_forces_of_two_surfaces_are_not_summed(clamped: Any) -> None:
    """A clamp presses from both sides: the sum is zero, each force is not."""
    ax = plots.resultants(clamped)
    for k, name in enumerate(("pad.bottom", "pad.top")):
        ((_, press),) = of_colour(ax, k, "-")
        total = clamped.reaction[:, clamped.contacts_of(name), 0].sum(axis=1)
        np.testing.assert_allclose(press, total, rtol=1e-12)
        assert (press > 1000).all()
    # The sum of both is the pull: 60 MPa on a height of 10 mm, of unit thickness.
    loop = plots.force_displacement(clamped).get_lines()[0]
    # Equilibrium, to the residual of 1e-12 for forces of 1e4 N.
    np.testing.assert_allclose(loop.get_ydata(), [120, 360, 600], rtol=1e-8)


def test_on_selects_a_surface_by_name(clamped: Any, tmp_path: Path) -> None:
    clamped.save(tmp_path / "a.h5")
    for result in (clamped, bp.load(tmp_path / "a.h5")):
        ax = plots.tractions(result, on="pad.top")
        assert "pad.top" not in labels(ax)
        (drawn,) = (it for it in ax.get_lines() if it.get_label() == "pressure")
        order = sorted_by_x(clamped, "pad.top")
        np.testing.assert_array_equal(drawn.get_ydata(), clamped.traction[-1][order, 0])
    with pytest.raises(ValueError, match=r"no contact on 'pad.tob'.*mean 'pad.top'"):
        plots.tractions(clamped, on="pad.tob")
    plain = bp.solve(np.eye(2), np.eye(2), [-1.0, 0], gap=[0], mu=0.3, points=[[0, 0]])
    with pytest.raises(ValueError, match="surfaces of the contacts are not known"):
        plots.tractions(plain, on="pad.top")


def test_resultants_of_a_curved_surface(ring: Any) -> None:
    """All contacts slip around the ring: friction is used up, without a force along x or y."""
    assert (ring.status[-1] == bp.Status.SLIP).all()
    ax = plots.resultants(ring)
    drawn = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    reaction = ring.reaction
    np.testing.assert_allclose(drawn["Σ normal"], reaction[..., 0].sum(axis=1))
    np.testing.assert_allclose(
        drawn["Σ |tangential|"], np.abs(reaction[..., 1]).sum(axis=1)
    )
    assert drawn["Σ |tangential|"][-1] == pytest.approx(0.3 * drawn["Σ normal"][-1])
    # The same sums in another order.
    np.testing.assert_allclose(drawn["force x"], ring.resultant[:, 0], rtol=1e-13)
    size = np.abs(ring.resultant).max()
    np.testing.assert_allclose(
        drawn["force y"], ring.resultant[:, 1], atol=1e-13 * size
    )
    # Normals cancel: the whole force drives the loop, and no sum limits it.
    loop = plots.force_displacement(ring)
    assert loop.get_lines()[0].get_label() == "force"
    assert loop.get_legend() is None
    main = np.linalg.svd(ring.resultant, full_matrices=False)[2][0]
    np.testing.assert_allclose(
        np.abs(loop.get_lines()[0].get_ydata()), np.abs(ring.resultant @ main)
    )


def test_shear_around_a_ring_has_one_sign(ring: Any) -> None:
    """Tangents of the frames reverse twice around the ring; the picture must not."""
    t1 = ring.contacts["frame"][:, 1]
    x = ring.contacts["x"]
    around = np.sign(x[:, 0] * t1[:, 1] - x[:, 1] * t1[:, 0])
    assert set(around) == {-1.0, 1.0}
    ax = plots.tractions(ring, units=UNITS)
    assert ax.get_xlabel() == "arc length from largest x, counter-clockwise [mm]"
    drawn = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    # The disc rotates counter-clockwise, friction on it acts clockwise.
    np.testing.assert_allclose(drawn["tangential"], -0.3 * drawn["normal"], rtol=1e-9)
    assert drawn["normal"][0] == drawn["normal"][-1] == drawn["normal"].max()


def test_title_names_the_step(clamped: Any) -> None:
    for step, title in ((0, "load step 1 of 3"), (-1, "load step 3 of 3")):
        for draw in (plots.tractions, plots.slip, plots.status_map):
            legend = draw(clamped, step=step).get_legend()
            assert legend.get_title().get_text() == title
        assert plots.deformed(clamped, step=step).get_title("left").endswith(title)
    # With a single step the title needs no step number.
    alone = plots.tractions(clamped[0], contacts=clamped.contacts)
    assert alone.get_legend().get_title().get_text() == ""


@pytest.fixture(scope="module")
def warm() -> bp.Model:
    """A bar held at one end that expands by heat against a wall."""
    made = bp.Model(title="Bar", units=UNITS)
    made.material("steel", young=210e3, poisson=0.3)
    size = {"x": np.linspace(0.0, 10.0, 5), "y": np.linspace(0.0, 2.0, 3)}
    made.body("bar", material="steel", cell="quadrilateral", plane="stress", **size)
    made.symmetry("bar.left")
    made.symmetry("bar.bottom")
    made.strain("bar", expansion=1e-5, temperature=made.times(100.0, "heat"))
    wall = {"point": [10.0, 0.0], "normal": [-1.0, 0.0]}
    made.contact("bar.right", plane=wall, mu=0.0)
    made.path(steps=2, heat=[0.5, 1.0])
    return made


def test_bodies_from_model_case_or_result(warm: bp.Model) -> None:
    """Held at both ends at 100 K: E α T = 210 MPa, which displacements alone do not show."""
    result, case = warm.solve(), warm.assemble()
    for step, stress in ((-1, 210.0), (0, 105.0)):
        for source in (warm, case, result, result.case.model):
            ax = plots.deformed(source, result, step=step)
            cells, *_ = (c for c in ax.collections if type(c) is PolyCollection)
            # The residual 1e-12 of the scene, after condensation.
            np.testing.assert_allclose(cells.get_array(), stress, rtol=1e-9)
    for arguments, error, said in (
        ((3, result), TypeError, "model is a int, expected a Model, a Case"),
        ((case, result[0]), ValueError, "the model has initial strains"),
        ((case,), TypeError, "result is a Case, expected"),
    ):
        with pytest.raises(error, match=said):
            plots.deformed(*arguments)


def test_margins_are_as_wide_as_arrows(clamped: Any) -> None:
    ax = plots.deformed(clamped)
    (arrows,) = (it for it in ax.collections if isinstance(it, Quiver))
    tails = arrows.XY - np.stack([arrows.U, arrows.V], axis=1)
    parts = [c for c in ax.collections if type(c) is PolyCollection]
    places = [path.vertices for part in parts for path in part.get_paths()]
    drawn = np.concatenate([tails, clamped.case.model.nodes, *places])
    low, high = np.transpose([ax.get_xlim(), ax.get_ylim()])
    margin = 0.03 * np.ptp(drawn, axis=0).max()
    np.testing.assert_allclose(low, drawn.min(axis=0) - margin, rtol=1e-12)
    np.testing.assert_allclose(high, drawn.max(axis=0) + margin, rtol=1e-12)
    # The figure has the aspect ratio of its content, except for labels.
    wide, tall = ax.figure.get_size_inches()
    assert tall < wide


def test_quantity_that_is_zero_everywhere() -> None:
    x = np.array([[u, v, 0.0] for u in range(4) for v in range(4)])
    known = {"x": x, "frame": fem.frames(np.tile([0.0, 0, 1], (16, 1)))}
    for load, quantity, told in (
        ([-1.0, 0.0, 0.0], "gap", "all contacts are closed"),
        ([-1.0, 0.1, 0.0], "slip", "no slip in the step"),
        ([1.0, 0.0, 0.0], "pressure", "all contacts are open"),
    ):
        solution = bp.ReducedProblem(np.eye(48), np.tile(load, (16, 1)), 0.3).solve()
        ax = plots.surface_map(solution, quantity, contacts=known)
        assert [t.get_text() for t in ax.texts] == [told]
        assert not ax.child_axes


BODY = ("--kind", "deformed")


@pytest.mark.slow
def test_the_command_draws_surfaces_bodies_and_animations(
    clamp: bp.Model, bipot: Any
) -> None:
    clamp.to_toml("clamp.toml")
    setting = ("--set", "contact.1.mu=0.25")
    assert bipot("run", "clamp.toml", *setting, "--json")[0] == 0
    folder = "out/clamp"
    drawn = set()
    asked = (
        (),
        ("--contact", "pad.top"),
        ("--along", "y"),
        ("--along", "arc", "--contact", "pad.bottom"),
        ("--kind", "slip", "--contact", "pad.top"),
        ("--kind", "resultants", "--contact", "pad.top"),
        ("--kind", "force_displacement", "--over", "pad.top"),
        *((*BODY, *more) for more in ((), ("--near", "0.1"), ("--scale", "7"))),
    )
    for more in asked:
        assert bipot("plot", folder, *more, "--out", "a.png") == (0, "a.png\n", "")
        drawn.add(Path("a.png").read_bytes())
    for more in (BODY, ("--kind", "slip", "--contact", "pad.top")):
        assert bipot("plot", folder, *more, "--out", "a.gif") == (0, "a.gif\n", "")
        drawn.add(Path("a.gif").read_bytes())
        with Image.open("a.gif") as read:
            assert read.n_frames == 3
    assert len(drawn) == len(asked) + 2
    for more, told in (
        (("--contact", "pad.tob"), "there is no contact on 'pad.tob', expected one of"),
        (("--along", "w"), "--along is 'w', expected x, y, z or arc"),
        (
            ("--kind", "resultants", "--along", "x"),
            "--along cannot be used with --kind",
        ),
        (
            ("--kind", "slip", "--scene", "x.toml"),
            "are only for --over and --kind deformed, pressure_3d",
        ),
        ((*BODY, "--contact", "pad.top"), "--contact cannot be used with"),
        # Without --scene the command knows the run's settings; with it they must be given.
        (
            (*BODY, "--scene", "clamp.toml"),
            "was not solved from 'clamp.toml' as it is now, or with other settings",
        ),
        (("--kind", "slip", "--near", "1"), "--near cannot be used with --kind slip"),
        ((*BODY, "--near", "0"), "near is 0.0, expected a positive number"),
        ((*BODY, "--scale", "-1"), "scale is -1.0, expected a positive number"),
        (("--step", "1", "--out", "b.gif"), "--step cannot be used with a GIF"),
        (
            ("--kind", "resultants", "--out", "b.gif"),
            "kind is 'resultants', a picture of all load steps, expected one of",
        ),
    ):
        refused(bipot, told, folder, *more)
    assert not Path("b.gif").exists()
    Path("clamp.toml").rename("moved.toml")
    refused(bipot, "give it with --scene", folder, *BODY)
    assert bipot("plot", folder, *BODY, "--scene", "moved.toml", *setting)[0] == 0


def refused(bipot: Any, told: str, *arguments: str) -> None:
    status, out, err = bipot("plot", *arguments)
    assert (status, out) == (2, "")
    assert told in " ".join(err.split())


def test_result_of_arrays_has_no_names(bipot: Any) -> None:
    bp.solve(np.eye(2), np.eye(2), [-1.0, 0], gap=[0], mu=0.3).save("a.h5")
    refused(bipot, "a.h5 is not the result of a scene, so that its mesh", "a.h5", *BODY)
    told = "--contact is 'a.b', but a.h5 has no names of surfaces"
    refused(bipot, told, "a.h5", "--contact", "a.b")


def test_the_table_of_a_curved_surface_has_its_force(bipot: Any) -> None:
    scene = places.ROOT / "examples" / "scenes" / "rolling_cylinder.toml"
    assert bipot("run", str(scene), "--set", "mesh.n=2", "--json")[0] == 0
    text = Path("out/rolling_cylinder/steps.csv").read_text().splitlines()
    row = dict(zip(text[0].split(","), text[-1].split(","), strict=True))
    result = bp.load("out/rolling_cylinder/result.h5")
    for k, axis in enumerate("xy"):
        told = float(row[f"force_{axis} of block.track"])
        # Summed in another order.
        assert told == pytest.approx(result.resultant[-1, k], rel=1e-12)
    size = np.abs(result.reaction[-1, :, 1]).sum()
    assert float(row["tangential_force of block.track"]) == pytest.approx(size)


def test_a_sweep_names_what_is_used_of_friction(
    capsys: pytest.CaptureFixture[str],
) -> None:
    row = {"outcome": "solved", "friction_used of a.flat": 0.5}
    both = row | {"friction_used of a.round": 0.25, "force_x of a.round": 1.0}
    for rows, heads in ((row, 1), (both, 2)):
        _print(["mu"], {0: rows}, "")
        told = capsys.readouterr().out
        assert ("Ft/(μFn)" in told) + ("Σ|rt|/(Σμrn)" in told) == heads


@pytest.mark.slow
def test_surfaces_off_one_plane_are_drawn_in_space(bipot: Any) -> None:
    """The message uses the words of the command line."""
    m = bp.Model("A block in a corner")
    m.material("soft", young=1.0, poisson=0.3)
    side = np.linspace(0.0, 1.0, 4)
    m.body("block", material="soft", cell="hexahedron", x=side, y=side, z=side)
    m.support("block.top", x=0, y=0, z=-1e-3)
    for name, normal in (("bottom", [0, 0, 1]), ("left", [1, 0, 0])):
        plane = {"point": [0, 0, 0], "normal": normal}
        m.contact(f"block.{name}", plane=plane, mu=0.3)
    m.to_toml("corner.toml")
    assert bipot("run", "corner.toml", "--json")[0] == 0
    told = "choose one surface (block.bottom, block.left), or a picture in 3D"
    chosen = ("out/corner", "--kind", "pressure_map")
    refused(bipot, told, *chosen)
    assert bipot("plot", *chosen, "--contact", "block.bottom")[0] == 0
    assert bipot("plot", "out/corner", "--kind", "pressure_3d")[0] == 0
    assert Path("out/corner/pressure_3d.png").stat().st_size > 10_000
