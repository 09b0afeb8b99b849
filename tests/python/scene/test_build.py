"""Parts of scenes: meshes from files, moving obstacles, springs, strains."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem, scene
from bipot_rs import obstacle as ob
from bipot_rs.discretisation import Estimator
from bipot_rs.mesh.elements import KINDS
from bipot_rs.scene.histories import Histories
from support import places
from support.body_models import blocks
from support.children import bipot, resumed
from support.comparisons import bits, close, refused
from support.faulty_scenes import PARTS
from support.models_and_arrays import datasets, of_arrays, of_models
from support.rollers import block, roller
from support.spheres import icosphere

MESHES = places.DATA / "meshes"
# On the floor, and under a ceiling.
FLOOR = {"point": [0, 0], "normal": [0, 1]}
CEILING = {"point": [0, 0], "normal": [0, -1]}
# Residuals of 1e-12, times the condition of small elastic bodies, 1e3.
SOLVED = 1e-9


def of_file() -> bp.Model:
    """Two halves, of steel and brass, from a file of gmsh, on a floor."""
    m = bp.Model("Halves")
    m.material("steel", young=210e3, poisson=0.3)
    m.material("brass", young=100e3, poisson=0.35)
    mesh, halves = {"file": MESHES / "quad.msh"}, {"left": "steel", "right": "brass"}
    surface = {"side": {"within": {"x": [0.0, 0.0]}, "normal": [-1, 0]}}
    m.body("part", mesh=mesh, material=halves, surface=surface)
    m.support("part.side", x=0.0)
    m.traction("part.top", y=m.times(-10.0, "press"), x=m.times(3.0, "press"))
    m.strain("part.right", tensor=[[1e-4, 0], [0, 0]], amplitude="press")
    m.contact("part.base", plane=FLOOR, mu=0.2)
    m.path(press=[0.5, 1.0])
    return m


def mortar() -> bp.Model:
    """Two blocks with non-matching meshes, one of second order."""
    m = block(4, order=2)
    axes: Any = {"x": np.linspace(-0.3, 0.4, 4), "y": [0.0, 0.5, 1.0]}
    m.body("punch", material="soft", cell="triangle", **axes)
    m.support("punch.top", x=m.times(0.02, "drag"), y=-0.02)
    m.contact("punch.bottom", against="block.top", pairing="mortar", mu=0.4)
    m.path(drag=[0.0, 1.0])
    return m


@pytest.mark.parametrize(
    "made", [roller, of_file, mortar, blocks], ids=lambda f: f.__name__
)
@pytest.mark.quick_variants("of_file", "mortar")
def test_three_ways_to_the_same_bits(made: Any, tmp_path: Path) -> None:
    m = made()
    (tmp_path / "there").mkdir()
    m.to_toml(tmp_path / "there" / "it.toml")
    run = bipot("run", "there/it.toml", "--out", "here", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    case, result = m.assemble(), m.solve()
    assert result.reaction.any()
    raw = of_arrays(case.model).solve(
        case.load, case.prescribed, gap=case.gaps, tol=1e-12
    )
    for name, of_result in (("python", result), ("arrays", raw)):
        assert of_result.displacement.any()  # stores the displacement
        of_result.save(tmp_path / f"{name}.h5")
    by_python, by_arrays = (
        datasets(tmp_path / f"{n}.h5") for n in ("python", "arrays")
    )
    for name, content_of in datasets(tmp_path / "here" / "result.h5").items():
        assert by_python[name] == content_of, name
        if not of_models(name):
            assert by_arrays[name] == content_of, name


def same_gaps(one: bp.MovingGaps, other: bp.MovingGaps) -> bool:
    """Compare gaps, frames and displacements bitwise."""
    names = ("gap", "frame", "drag")
    return all(
        getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in names
    )


def test_the_obstacle_is_that_of_the_library() -> None:
    case = roller().assemble()
    way, press = np.array([0.0, 1.0, 0.5]), np.array([1.0, 1.0, 0.5])
    shift = np.column_stack([0.15 * way, -0.02 * press])
    motion = ob.Motion(shift, np.deg2rad(-4.0 * way), about=[-0.1, 1.0])
    disc = ob.Cylinder([-0.1, 1.0], 1.0)
    contact = fem.Contact("block", "top", 0.3, obstacle=disc, motion=motion)
    ground = fem.Support("block", "bottom", (0, 1))
    model = fem.assemble(case.model.bodies, [contact], [ground])
    assert same_gaps(model.gaps(3), case.gaps)
    assert model.frame.tobytes() == case.model.frame.tobytes()


def test_automatic_steps_of_an_obstacle() -> None:
    """Slip divides the steps; equal to the same load points, given or as functions of s."""
    assert bits(roller(automatic=True).solve(), roller().solve())
    case = roller(automatic={"slip": 0.004, "first": 0.5}).assemble()
    result = case.solve()
    assert len(result) > 4
    at = case.sampled(result.s)
    again = at.problem().solve(at.load, at.prescribed, gap=at.gaps, tol=1e-12)
    assert bits(result, again)
    # At the ends of load steps equal to those of load steps, bit by bit.
    whole = np.isin(result.s, [1.0, 2.0, 3.0])
    assert same_gaps(at.gaps[whole], case.gaps)
    # A pure translation is linear in between, and so are the gaps of a plane.
    m = block()
    move = {"x": 0.02, "y": -0.12}
    m.obstacle("flat", plane={"point": [0, 0.1], "normal": [0, -1]}, move=move)
    m.contact("block.top", against="flat", mu=0.2)
    m.path(steps=1, automatic={"first": 0.25})
    quarter = m.assemble().sampled([0.25]).gaps[0]
    np.testing.assert_allclose(quarter[:, 0], 0.1 - 0.03, rtol=1e-13)
    np.testing.assert_allclose(np.abs(quarter[:, 1]), 0.005, rtol=1e-13)


@pytest.mark.slow
def test_automatic_steps_of_an_obstacle_by_mortar() -> None:
    """Divided, equal to the same load points; undivided, equal to the load steps."""
    changes = {"contact.0.pairing": "mortar", "body.block.order": 2}
    whole = roller(automatic=True).with_(**changes)
    assert bits(whole.solve(), roller().with_(**changes).solve())
    result = roller(automatic={"slip": 0.004}).with_(**changes).solve()
    assert len(result) > 3
    at = result.case.sampled(result.s)
    again = at.problem().solve(at.load, at.prescribed, gap=at.gaps, tol=1e-12)
    assert bits(result, again)


@pytest.mark.slow
@pytest.mark.parametrize("automatic", [None, {"slip": 0.004}])
def test_a_moving_obstacle_is_resumed_to_the_same_files(
    automatic: Any, tmp_path: Path
) -> None:
    m = roller(automatic=automatic)
    m.to_toml(tmp_path / "it.toml")
    file = resumed("it.toml", "--out", "here", cwd=tmp_path)
    # The same in Python.
    read = bp.load(file)
    part = bp.ModelResult(read, m.assemble())
    part.steps = part.steps[:2]
    rest = m.solve(start=part)
    assert rest.reaction.tobytes() == read.reaction[2:].tobytes()


def test_another_mesh_in_the_file_is_not_resumed(tmp_path: Path) -> None:
    here = tmp_path / "quad.msh"
    here.write_bytes((MESHES / "quad.msh").read_bytes())
    m = of_file().with_(**{"body.part.mesh": str(here)})
    m.to_toml(tmp_path / "it.toml")
    assert bipot("run", "it.toml", cwd=tmp_path).returncode == 0
    here.write_bytes(here.read_bytes() + b"\n")
    run = bipot("run", "it.toml", "--resume", cwd=tmp_path)
    assert run.returncode == 2
    assert "belongs to another scene" in run.stderr


@pytest.mark.slow
def test_spheres_and_files_are_one_shape(tmp_path: Path) -> None:
    """A ball by its radius and by facets of size h agree to h²; it does not rotate."""
    meshio = pytest.importorskip("meshio")
    centre = [0.05, 0.05, 0.98]
    x, faces = icosphere(5)
    file = tmp_path / "ball.stl"
    meshio.Mesh(x + centre, [("triangle", faces)]).write(file)
    forces = []
    for shape in (
        {"sphere": {"centre": centre, "radius": 1.0}},
        {"surface": str(file)},
    ):
        m = block(4, 3)
        m.obstacle("ball", **shape)
        m.contact("block.top", against="ball", mu=0.3)
        forces.append(m.solve().contact_force("block.top")[0])
    close(forces[1], forces[0], 0.1)


def test_inside_of_a_bore() -> None:
    """A tight bore presses a block equally from all sides."""
    m = bp.Model()
    m.material("soft", young=1000.0, poisson=0.3)
    side = [-0.5, 0.0, 0.5]
    m.body("block", material="soft", cell="quadrilateral", x=side, y=side)
    radius = 0.999 * np.sqrt(0.5)
    m.obstacle("bore", cylinder={"point": [0, 0], "radius": radius}, inside=True)
    for name in ("left", "right", "bottom", "top"):
        m.contact(f"block.{name}", against="bore", mu=0.0)
    m.symmetry("block.left")
    (remark,) = [r for r in m.check() if "start inside" in r][:1]
    assert "the deepest by 0.000707107 at" in remark


def test_surfaces_by_geometry() -> None:
    """Equal to the named surfaces of the box, and parts of them."""
    half = {"within": {"x": [0, 0.5], "y": [0, 0]}}
    m = block(4, surface={"up": {"normal": [0, 1]}, "right half": half})
    m.pressure("block.up", 2.0)
    m.pressure("block.right half", 2.0)
    m.contact("block.left", plane={"point": [-0.5, 0], "normal": [1, 0]}, mu=0.1)
    case = m.assemble()
    (body,) = case.model.bodies
    np.testing.assert_array_equal(np.sort(body.facets("up")), body.facets("top"))
    assert -case.load[0].sum() == pytest.approx(2.0 * 1.5, rel=1e-14)


@pytest.mark.parametrize(
    ("settings", "kinds"),
    [
        ({}, ("quadrilateral", 1)),
        ({"body.block.order": 2}, ("quadrilateral", 2)),
        ({"mesh.element": "P2"}, ("triangle", 2)),
        ({"mesh.element": "Q2"}, ("quadrilateral", 2)),
        ({"mesh.element": "P1", "body.block.order": 2}, ("triangle", 1)),
        ({"body.block.cell": "triangle"}, ("triangle", 1)),
        ({"body.block.cell": "triangle", "mesh.element": "Q1"}, ("quadrilateral", 1)),
    ],
)
def test_orders(settings: dict[str, Any], kinds: tuple[str, int]) -> None:
    m = block().with_(**settings)
    m.contact("block.top", plane=CEILING, mu=0.1)
    (body,) = scene.bodies(m.scene)
    assert (body.kind.shape, body.kind.degree) == kinds


@pytest.mark.parametrize(
    ("file", "order", "degree"),
    [
        ("quad.msh", None, 1),
        ("quad.msh", 2, 2),
        ("quad9.msh", None, 2),
        ("quad9.msh", 1, 1),
        ("quad8.msh", 1, 1),
        ("tetra10.msh", 1, 1),
    ],
)
def test_orders_of_files(file: str, order: int | None, degree: int) -> None:
    """With straight cells, both orders have the same area and the same named parts."""
    m, d = bp.Model(), 3 if "tetra" in file else 2
    m.material("steel", young=210e3, poisson=0.3)
    mesh = {"file": str(MESHES / file)} | ({"order": order} if order else {})
    m.body("part", mesh=mesh, material="steel")
    plane = {"point": [0] * d, "normal": [0] * (d - 1) + [1]}
    m.contact("part.base", plane=plane, mu=0.2)
    (body,) = scene.bodies(m.scene)
    of_file = fem.Body("it", fem.read_mesh(MESHES / file), fem.Material(1.0, 0.0))
    assert KINDS[type(body.mesh)].degree == degree
    sizes = [b.volume().weights.sum() for b in (body, of_file)]
    assert set(body.mesh.boundaries) == set(of_file.mesh.boundaries)
    for name in of_file.mesh.boundaries:
        sizes += [b.surface(name, inside=True).weights.sum() for b in (body, of_file)]
    np.testing.assert_allclose(sizes[::2], sizes[1::2], rtol=1e-13)


def test_orthotropic_by_equal_numbers_is_isotropic() -> None:
    results = []
    for material in (
        {"young": 1000.0, "poisson": 0.3},
        {"young": [1000.0] * 3, "poisson": [0.3] * 3, "shear": [1000.0 / 2.6] * 3},
    ):
        m = block(3, 3).with_(**{"material.soft": material})
        m.pressure("block.left", 20.0)
        ceiling = {"point": [0, 0, -0.01], "normal": [0, 0, -1]}
        m.contact("block.top", plane=ceiling, mu=0.3)
        results.append(m.solve().reaction)
    close(results[1], results[0], SOLVED)


def test_springs() -> None:
    """A block between an approaching wall and springs k: the force of two springs in series."""
    m = bp.Model()
    m.material("soft", young=1000.0, poisson=0.0)
    side = np.linspace(0, 1, 4)
    m.body("block", material="soft", cell="quadrilateral", x=side, y=side)
    m.spring("block.left", normal=500.0)
    m.symmetry("block.bottom")
    m.obstacle("wall", plane={"point": [1, 0], "normal": [-1, 0]}, move={"x": -0.03})
    m.contact("block.right", against="wall", mu=0.0)
    # Springs hold the body, so there is no warning.
    assert m.check() == []
    force = m.solve().contact_force("block.right")
    np.testing.assert_allclose(force, [[-0.03 / (1 / 1000 + 1 / 500), 0]], atol=1e-8)


def test_heat_by_volume_and_tensor() -> None:
    """Isotropic heat equals a tensor of equal numbers; all volumes equal the body."""
    tensor = np.diag([5e-4] * 3)
    reactions = []
    for tables in (
        [{"on": "part", "expansion": 1e-5, "temperature": 50.0}],
        [{"on": "part", "tensor": tensor}],
        [
            {"on": "part.left", "expansion": [1e-5] * 3, "temperature": 50.0},
            {"on": "part.right", "tensor": tensor},
        ],
    ):
        m = of_file().with_(strain=[])
        for table in tables:
            m.strain(**table)
        reactions.append(m.solve().reaction)
    for other in reactions[1:]:
        close(other, reactions[0], SOLVED)


@pytest.mark.parametrize(("changes", "words"), PARTS, ids=lambda v: str(v)[:40])
def test_mistakes(changes: dict[str, Any], words: str) -> None:
    m = roller().with_(**changes)
    with pytest.raises(ValueError) as caught:
        m.assemble()
    assert words in str(caught.value)


def test_all_mistakes_of_files_are_reported(tmp_path: Path) -> None:
    m = of_file()
    m.body("gone", mesh=tmp_path / "gone.msh", material="steel")
    middle = {"file": MESHES / "quad.msh", "group": "middle"}
    m.body("other", mesh=middle, material="steel")
    m.to_toml(tmp_path / "it.toml")
    run = bipot("check", "it.toml", cwd=tmp_path)
    assert run.returncode == 2
    for words in (
        "2 mistakes",
        f"body.gone.mesh: the mesh {tmp_path / 'gone.msh'} does not exist",
        "body.other.mesh: the mesh ",
        "has no volume 'middle'; it has 'left', 'right'",
    ):
        assert words in run.stderr
    m = of_file()
    m.support("part.bse", y=0.0)
    m.contact("part.base", plane={"point": [0, 0, 0], "normal": [0, 0, 1]}, mu=0.2)
    m.strain("part.middle", tensor=[[1, 0], [0, 1]])
    with pytest.raises(scene.SceneError) as caught:
        m.assemble()
    assert [mistake.key for mistake in caught.value.mistakes] == [
        "support.1.on",
        "strain.1.on",
        "contact.1.plane.point",
        "contact.1.plane.normal",
    ]
    key = "body.part.surface"
    for changes, message in (
        ({key: {"base": {"normal": [0, 1]}}}, rf"{key}\.base: the mesh has"),
        (
            {key: {"side": {"within": {"x": [7, 8]}}}},
            rf"{key}\.side: no boundary facet",
        ),
        ({"body.part.material": {"left": "steel"}}, r"body\.part\.material: material"),
    ):
        with refused(message):
            of_file().with_(**changes).assemble()
    m = block()
    m.obstacle("die", surface=tmp_path / "die.stl")
    m.contact("block.top", against="die", mu=0.1)
    with refused(r"obstacle\.die: there is no file"):
        m.assemble()


def test_files_next_to_the_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "quad.msh").write_bytes((MESHES / "quad.msh").read_bytes())
    monkeypatch.chdir(tmp_path / "deep")
    m = of_file().with_(**{"body.part.mesh": "quad.msh"})
    by_cwd = m.solve().reaction
    m.to_toml(tmp_path / "it.toml")
    monkeypatch.chdir("/")
    read = bp.Model.from_toml(tmp_path / "it.toml")
    assert read.to_dict()["body"]["part"]["mesh"] == "deep/quad.msh"
    assert read.solve().reaction.tobytes() == by_cwd.tobytes()


def test_unsupported_models_of_the_discretisation_error() -> None:
    """Each gives a message; a plane obstacle in translation is supported and proved."""
    p1 = {"mesh.element": "P1"}

    def under(n: int = 3, **changes: Any) -> bp.Model:
        m = block(n).with_(**p1, **changes)
        m.contact("block.top", plane=CEILING, mu=0.0)
        return m

    heat = {"on": "block", "expansion": 1e-5, "temperature": 10.0}
    triangles = {"strain": [], "body.part.mesh": str(MESHES / "triangle.msh")}
    for model, words in (
        (under(strain=[heat]), "does not support initial strains"),
        (
            under(spring=[{"on": "block.left", "normal": 1.0}]),
            "does not support springs",
        ),
        (roller(mu=0.0).with_(**p1), "is curved"),
        (mortar(), "is 'mortar', expected 'match'"),
        (of_file().with_(**triangles), "several materials"),
    ):
        with refused(words):
            Estimator(model.assemble())
    flat = block(6).with_(**p1)
    flat.obstacle("flat", plane=CEILING, move={"y": -0.01})
    flat.contact("block.top", against="flat", mu=0.0)
    # The same block, pressed by moving its ground up.
    lifted = under(6, support=[{"on": "block.bottom", "x": 0.0, "y": 0.01}])
    results = [m.solve() for m in (flat, lifted)]
    one, other = (Estimator(r.case).error(r, 0) for r in results)
    assert one.kind == "guaranteed bound"
    assert other.total == pytest.approx(one.total)


def test_remarks_through_a_scene(tmp_path: Path) -> None:
    """Each remark is exact in `bipot check`, in Python, and before a run."""
    m = bp.Model("Two blocks", units=("mm", "N", "MPa"))
    m.material("steel", young=210e9, poisson=0.3)
    x, y = [0.0, 10.0, 20.0], np.array([-20.0, -10.0, 0.0])
    m.body("low", material="steel", cell="quadrilateral", x=x, y=y)
    m.body("high", material="steel", cell="quadrilateral", x=x, y=y + 19.5)
    m.support("low.bottom", x=0.0, y=0.0)
    m.support("low.left", y=0.002, within={"y": [-10.0, 0.0]})
    m.support("low.right", x=0.001, within={"y": [-10.0, 0.0]})
    m.contact("high.bottom", against="low.top", mu=0.0)
    m.contact("low.left", plane={"point": [-1.0, 0.0], "normal": [1.0, 0.0]}, mu=0.5)
    m.contact("low.top", plane={"point": [0, -30], "normal": [0, 1]}, mu=0.1)
    remarks = m.check()
    begin = [
        "3 of the 3 nodes of surface 'bottom' of body 'high' start inside",
        "surface 'top' of body 'low' faces away from what it may touch",
        "2 of the 3 nodes of surface 'left' of body 'low' have no friction",
        "1 of the 3 nodes of surface 'top' of body 'low' have no friction",
        "bodies 'low' and 'high' can move freely by translation along x of body",
        "units may be mixed: Young's modulus 2.1e+11 of body 'low'",
        "units may be mixed: Young's modulus 2.1e+11 of body 'high'",
        "surface 'left' of body 'low' may never touch: its nearest node, at (0, -20),",
        "surface 'top' of body 'low' may never touch: its nearest node, at (0, 0),",
    ]
    for remark, words in zip(remarks, begin, strict=True):
        assert remark.startswith(words)
    m.to_toml(tmp_path / "it.toml")
    told = json.loads(bipot("check", "it.toml", "--json", cwd=tmp_path).stdout)
    assert told["remarks"] == remarks
    run = bipot("run", "it.toml", cwd=tmp_path)
    for remark in remarks:
        assert f"  remark    {remark}\n" in run.stderr


def test_a_roller_turns_about_its_own_middle() -> None:
    """This is the default: about the origin it would sweep through the body."""
    m = block()
    m.path(way=[0.5, 1.0])
    disc, turn = {"point": [16.0, 23.0], "radius": 2.0}, {"angle": m.times(90.0, "way")}
    m.obstacle("roller", cylinder=disc, turn=turn)
    m.contact("block.top", against="roller", mu=0.3)
    motion = Histories(m.scene).make_motions()["roller"]
    assert motion is not None
    assert np.asarray(motion.about).tolist() == [16.0, 23.0]
    assert motion.degrees
    assert np.asarray(motion.rotation).tolist() == [45.0, 90.0]
