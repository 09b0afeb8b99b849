"""The scenes of examples/scenes: each shows some features, and is right."""

import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import analytic, fem
from bipot_rs.fem.paraview import cell_fields
from support import places
from support.comparisons import close, near

SCENES = places.ROOT / "examples" / "scenes"
# Residuals of 1e-12, times the condition of small elastic bodies, 1e3.
SOLVED = 1e-9


def model(name: str, **changes: Any) -> bp.Model:
    return bp.Model.from_toml(SCENES / f"{name}.toml").with_(**changes)


@cache
def solved(name: str) -> Any:
    return model(name).solve()


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda p: p.stem)
def test_example_scenes_are_solved_without_warnings(path: Path) -> None:
    m = bp.Model.from_toml(path)
    assert m.check() == []
    assert solved(path.stem).success
    # Each scene names the command that runs it.
    assert f"bipot run {path.name}" in path.read_text()


def test_heated_bar() -> None:
    """Uniform stress of E (gap/L - α ΔT) along the bar, if that is negative."""
    result = solved("heated_bar")
    heat = 100 * np.array([0.25, 0.5, 0.75, 1.0, 0.5])
    pressure = 210e3 * np.maximum(1.2e-5 * heat - 0.05 / 100, 0)
    force = result.contact_force("bar.right")[:, 0]
    np.testing.assert_allclose(force, -50 * pressure, atol=SOLVED * 7350)
    case = result.case
    u, x = result[3].displacement.reshape(-1, 2), case.model.nodes
    # Heat and pressure both widen it laterally.
    wider = 1.2e-5 * 100 + 0.3 * pressure[3] / 210e3
    near(u, x * [5e-4, wider], SOLVED * 0.05)
    size = SOLVED * 210e3 * 1.2e-3
    for k in (0, 3, 4):
        # The stress from the displacement alone would ignore the heat.
        fields = cell_fields(case.model, result[k].displacement, case.stress_at_rest(k))
        expected = -pressure[k] * np.eye(6)[0]
        near(fields["stress"] - expected, 0, size)
        near(fields["von_mises"], pressure[k], size)


def test_blocks_not_matching() -> None:
    """A uniform pressure passes; both tops of the symmetric half-model widen equally."""
    result = solved("blocks_not_matching")
    near(
        result.traction[0],
        np.broadcast_to([100, 0], result.traction[0].shape),
        100 * SOLVED,
    )
    # Plane strain, -100 along y: u = (ν (1 + ν) p x, -(1 - ν²) p (y + 10))/E.
    x = result.case.model.nodes
    exact = 100 / 210e3 * (x + np.array([0, 10])) * [0.39, -0.91]
    close(result[0].displacement.reshape(-1, 2), exact, SOLVED)
    through = result.contact_force("upper.bottom")
    # Pulled by 1200 N at the end; the symmetry plane carries the rest.
    held = result.support_force("lower.bottom")
    np.testing.assert_allclose(held[:, 1], 2000, rtol=SOLVED)
    assert through[2, 0] < 0.9 * through[1, 0] < 0
    assert (result.status[2] == bp.Status.SLIP).any()


def test_rolling_and_sliding() -> None:
    """Rolling needs only a part of the friction force of sliding over the same distance."""
    rolled = solved("rolling_cylinder").contact_force("block.track")
    slid = model("rolling_cylinder", **{"obstacle.roller.turn.angle": 0.0}).solve()
    force = slid.contact_force("block.track")
    assert (np.abs(rolled[:, 0]) < 0.3 * 0.3 * -rolled[:, 1]).all()
    # Slides by 2 mm, a hundred times the elastic limit of stick. Normals lean by up to 3 mm
    # over 10 mm; by symmetry their part of the pressure along x is zero.
    closed = slid.status[-1] != bp.Status.OPEN
    assert (slid.status[-1][closed] == bp.Status.SLIP).all()
    shear = np.abs(slid.reaction[-1][:, 1]).sum()
    assert shear == pytest.approx(0.3 * slid.reaction[-1][:, 0].sum(), rel=SOLVED)
    assert force[-1, 0] > 0  # # it drags the block


def test_gmsh_two_bodies() -> None:
    """Two bodies from one file, in balance; the disc is dragged to slide, there and back."""
    result = solved("gmsh_two_bodies")
    through = result.contact_force("disc.arc")
    for name, sign in (("disc.top", 1), ("block.base", -1)):
        held = result.support_force(name)
        near(held + sign * through, 0, SOLVED * np.abs(through).max())
    ratio = through[:, 0] / through[:, 1]
    assert ratio[3] == pytest.approx(-0.2, rel=0.01)
    assert ratio[4] == pytest.approx(0.2, rel=0.01)
    # A cylinder on a plane, analytic.hertz_line: the contact width from the force.
    e_star = analytic.contact_modulus(210e3, 0.3, 110e3, 0.34)
    half, peak = analytic.hertz_line(through[1, 1], 10.0, e_star)
    x = result.case.model.points[:, 0]
    closed = x[result.status[1] != bp.Status.OPEN]
    # To one cell on either side.
    assert np.abs(closed).max() == pytest.approx(half, abs=0.2)
    assert result.traction[1, :, 0].max() == pytest.approx(peak, rel=0.1)


def test_the_mesh_is_made_by_its_script(tmp_path: Path) -> None:
    """The file equals the output of its script, cell by cell, to rounding."""
    pytest.importorskip("gmsh")
    script = tmp_path / "disc_on_block.py"
    script.write_text((SCENES / script.name).read_text())
    subprocess.run([sys.executable, str(script)], check=True, cwd=tmp_path)
    for group in ("disc", "block"):
        mine, kept = (
            fem.read_mesh(folder / "disc_on_block.msh", group)
            for folder in (tmp_path, SCENES)
        )
        assert set(mine.boundaries) == set(kept.boundaries)
        # Another version of gmsh may make another mesh; its area is equal to h².
        areas = [
            fem.Body("it", m, fem.Material(1.0, 0.0)).volume().weights.sum()
            for m in (mine, kept)
        ]
        assert areas[0] == pytest.approx(areas[1], rel=1e-3)
