"""The table [wear] of a scene: its mistakes, its cycles, and the run."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.cli.entry import call
from bipot_rs.plots.line import pressure_and_wear
from bipot_rs.scene.build import bodies
from bipot_rs.scene.case import assemble
from bipot_rs.scene.reading import read
from support.comparisons import refused

# The contact of Cattaneo and Mindlin on a coarse mesh: pressed, then moved to and fro.
FRETTING = (
    "mesh.n=3",
    "path.amplitude.shear=[0.0, 1.0, -1.0]",
    "wear.coefficient=1e-5",
    "wear.cycles=60",
    "wear.steps=2",
)


def case_of(*more: str) -> Any:
    scene_read = read("cattaneo_mindlin", [*FRETTING, *more])
    return assemble(scene_read, bodies(scene_read))


def run(folder: Path, *more: str) -> int:
    settings = [part for setting in FRETTING for part in ("--set", setting)]
    out = ["--out", str(folder)]
    return int(call(["run", "cattaneo_mindlin", *settings, *out, *more]) or 0)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("wear.coefficient=-1.0", "wear.coefficient: should be greater than or equal"),
        ("wear.cycles=0", "wear.cycles: should be greater than 0"),
        ("wear.steps=4", "wear.steps: is 4, but the path has only 3 load steps"),
        ("wear.rtol=1.0", "wear.rtol: should be less than 1"),
        ("wear.jmp=true", "wear.jmp: unknown key, did you mean wear.jump?"),
        ("path.automatic=true", "path.automatic: remove it, wear repeats"),
        ("solver.engine='petsc'", "solver.engine: should not be 'petsc'"),
        ("solver.tol='discretisation'", "solver.tol: should be a number for wear"),
    ],
)
def test_mistakes(setting: str, message: str) -> None:
    with refused(re.escape(message)):
        read("cattaneo_mindlin", [*FRETTING, setting])


def test_the_cycle_is_the_end_of_the_path() -> None:
    case = case_of()
    problem = case.problem()
    wear = case.wear(problem)
    pressed = problem.solve(prescribed=case.prescribed[0], tol=1e-12)
    again = problem.wear(
        prescribed=case.prescribed[1:],
        coefficient=1e-5,
        cycles=60,
        start=pressed,
        tol=1e-12,
    )
    np.testing.assert_array_equal(wear.depth, again.depth)
    assert wear.depth[-1].max() > 0
    with refused(r"the scene has \[wear\], which `bipot run`"):
        case.solve()
    plain = read("cattaneo_mindlin", ["mesh.n=3"])
    with refused(r"the scene has no \[wear\]"):
        assemble(plain, bodies(plain)).wear()


def test_a_model_wears() -> None:
    m = bp.Model("block")
    m.material("steel", young=1000.0, poisson=0.3)
    axis = np.linspace(0.0, 1.0, 4)
    m.body("block", material="steel", cell="quadrilateral", x=axis, y=axis)
    m.support("block.top", x=m.times(0.05, "shear"), y=-0.01)
    m.contact("block.bottom", plane={"point": [0, 0], "normal": [0, 1]}, mu=0.3)
    m.path(shear=[1.0, -1.0])
    m.wear(coefficient=1e-6, cycles=4, jump=False)
    wear = m.assemble().wear()
    assert wear.cycle.tolist() == [1, 2, 3, 4]
    assert (np.diff(wear.total_volume) > 0).all()
    with refused(r"model.assemble\(\).wear\(\)"):
        m.solve()


@pytest.mark.slow
def test_a_run_writes_a_row_and_a_field_for_each_cycle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "--plot") == 0
    printed = capsys.readouterr()
    assert "worn volume" in printed.out
    assert "solved: 60 cycles, " in printed.out
    assert "load paths solved for 60 cycles; " in printed.out
    assert "cycle 60 of 60: depth " in printed.err
    wear = case_of().wear()
    with (tmp_path / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["cycle"]) for row in rows] == wear.cycle.tolist()
    volumes = [float(row["worn_volume"]) for row in rows]
    # Sums in another order.
    np.testing.assert_allclose(volumes, wear.total_volume, rtol=1e-12)
    depths = [float(row["largest_depth"]) for row in rows]
    np.testing.assert_array_equal(depths, wear.depth.max(axis=1))
    result = bp.load_result(tmp_path / "result.h5")
    np.testing.assert_array_equal([step.wear for step in result], wear.depth)
    last = (tmp_path / f"contact_{len(rows) - 1:04d}.vtu").read_bytes()
    assert b'Name="wear_depth"' in last
    # Pictures of the file.
    for kind in ("wear", "tractions"):
        assert call(["plot", str(tmp_path), "--kind", kind]) in (0, None)
        assert (tmp_path / f"{kind}.png").stat().st_size > 2_000


def test_the_lines_of_json_have_the_cycle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "--json") == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines[-2]["cycle"] == 60
    assert lines[-2]["worn_volume"] > lines[0]["worn_volume"] > 0


def test_options_without_meaning_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for option in ("--resume", "--fclib", "--error"):
        assert run(tmp_path, option) == 2
        assert f"bipot: {option} " in capsys.readouterr().err
        assert not (tmp_path / "result.h5").exists()


def test_pictures_of_wear() -> None:
    case = case_of("wear.jump=false")
    wear = case.wear()
    depth = bp.plots.wear(wear, cycles=[1, 30, 60])
    lines = depth.get_lines()
    assert [line.get_label() for line in lines] == ["cycle 1", "cycle 30", "cycle 60"]
    order = np.argsort(case.model.points[:, 0])
    np.testing.assert_array_equal(lines[1].get_ydata(), wear.depth[29][order])
    low, high = depth.get_ylim()
    # Downwards, as into the body.
    assert low > high == 0
    pressure = bp.plots.wear(wear.ends, "pressure", cycles=60)
    (line,) = pressure.get_lines()
    np.testing.assert_array_equal(line.get_ydata(), wear.pressure[-1][order])
    above, below = pressure_and_wear(wear).figure.axes
    assert len(above.get_lines()) == len(below.get_lines()) >= 3
    with refused(r"cycles has 70, which was jumped over or not"):
        bp.plots.wear(wear, cycles=70)
    path = case.problem().solve(prescribed=case.prescribed)
    with refused("result has no wear"):
        bp.plots.wear(path)
    with refused("quantity is 'volume'"):
        bp.plots.wear(wear, "volume")
