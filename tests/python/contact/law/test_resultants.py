"""Resultant forces of contact surfaces, and their table and sentences."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from bipot_rs.cli.progress import Progress
from bipot_rs.cli.run.report import format_steps, list_closing
from bipot_rs.contact.law.resultants import list_resultants
from support.pressed_in_space import pressed

RANDOM = np.random.default_rng(8)


def frames(count: int, d: int) -> np.ndarray:
    """Orthonormal frames, right-handed or left-handed."""
    return np.linalg.qr(RANDOM.standard_normal((count, d, d)))[0]


def flat_frames(count: int, d: int) -> np.ndarray:
    """Frames of one plane, with different tangents."""
    bases = frames(count, d)
    bases[:, 0] = bases[0, 0]
    for k in range(1, d):
        for j in range(k):
            on = np.sum(bases[:, k] * bases[:, j], axis=1, keepdims=True)
            bases[:, k] -= on * bases[:, j]
        bases[:, k] /= np.linalg.norm(bases[:, k], axis=1, keepdims=True)
    return bases


@pytest.mark.parametrize("d", [2, 3])
def test_resultants_are_sums_of_vectors(d: int) -> None:
    reaction = np.abs(RANDOM.standard_normal((12, d)))
    frame, mu = flat_frames(12, d), RANDOM.uniform(0.1, 0.9, 12)
    group = np.arange(12) % 3
    totals = list_resultants(reaction, frame, mu, group, 3)
    for k, total_of_surface in enumerate(totals):
        of_group = group == k
        total = np.sum(
            [reaction[i] @ frame[i] for i in np.flatnonzero(of_group)], axis=0
        )
        drag = total - (total @ frame[0, 0]) * frame[0, 0]
        assert not total_of_surface.curved
        # A sum of four vectors of order one.
        assert total_of_surface.tangential == pytest.approx(
            np.linalg.norm(drag), rel=1e-13
        )
        np.testing.assert_allclose(total_of_surface.force, total, rtol=0, atol=1e-14)
        assert total_of_surface.normal == pytest.approx(
            reaction[of_group, 0].sum(), abs=1e-14
        )
        limit = mu[of_group] @ reaction[of_group, 0]
        assert total_of_surface.limit == pytest.approx(limit, abs=1e-14)
        used = np.linalg.norm(drag) / limit
        assert total_of_surface.used == pytest.approx(used, rel=1e-12)


def ring(count: int) -> np.ndarray:
    """Frames of a closed ring in the plane, normals inwards, tangents in either direction."""
    angle = 2 * np.pi * np.arange(count) / count
    normal = -np.stack([np.cos(angle), np.sin(angle)], axis=1)
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    tangent[::3] *= -1
    return np.stack([normal, tangent], axis=1)


@pytest.mark.parametrize("curve", [ring(9), frames(9, 3)])
def test_rotation_in_a_ring_uses_friction_without_a_force(
    curve: np.ndarray,
) -> None:
    """Each contact is at its limit, in any direction: the ratio is one, to rounding."""
    d = curve.shape[1]
    mu = np.full(len(curve), 0.4)
    reaction = np.zeros((len(curve), d))
    reaction[:, 0] = 2.0
    way = RANDOM.standard_normal((len(curve), d - 1))
    if d == 2:
        # All forces act in the same sense of rotation.
        way[:, 0] = np.where(np.arange(len(curve)) % 3 == 0, -1.0, 1.0)
    reaction[:, 1:] = 0.8 * way / np.linalg.norm(way, axis=1, keepdims=True)
    (total_of_ring,) = list_resultants(
        reaction, curve, mu, np.zeros(len(curve), np.int64), 1
    )
    assert total_of_ring.curved
    assert total_of_ring.used == pytest.approx(1, rel=1e-14)
    assert total_of_ring.normal == pytest.approx(2.0 * len(curve), rel=1e-14)
    np.testing.assert_allclose(
        total_of_ring.force, np.einsum("ik,ikd->d", reaction, curve), atol=1e-13
    )
    if d == 2:
        np.testing.assert_allclose(total_of_ring.force, 0, atol=1e-13)


def test_two_coefficients_on_a_curved_surface_reach_their_limit() -> None:
    """The limit is the extent of the ellipse along the friction of each contact."""
    mu = RANDOM.uniform(0.1, 0.9, (7, 2))
    way = RANDOM.standard_normal((7, 2))
    press = RANDOM.uniform(1, 2, 7)
    # On the edge of the cone: ‖D⁻¹ r_t‖ = r_n.
    rim = way / np.linalg.norm(way / mu, axis=1, keepdims=True) * press[:, None]
    group = np.zeros(7, np.int64)
    reaction = np.column_stack([press, rim])
    (total_of_ring,) = list_resultants(reaction, frames(7, 3), mu, group, 1)
    assert total_of_ring.used == pytest.approx(1, rel=1e-13)
    reaction[:, 1:] = 0
    (still,) = list_resultants(reaction, frames(7, 3), mu, group, 1)
    assert still.used == 0
    assert still.limit == pytest.approx(press @ mu.max(axis=1), rel=1e-14)


def test_without_friction_used_is_none() -> None:
    (total_of_ring,) = list_resultants(
        np.array([[2.0, 0.0]]), np.eye(2)[None], np.zeros(1), np.zeros(1, np.int64), 1
    )
    assert total_of_ring.used is None


def path(count: int, surfaces: int = 1) -> list[dict[str, object]]:
    names = [f"block.side{k}" for k in range(surfaces)]
    return [
        {
            "step": k,
            "load": np.sin(np.pi * k),
            "open": 1,
            "slip": 20,
            "stick": 0,
            "residual": 1e-15,
            "iterations": 3,
            "seconds": 0.01,
            **{f"normal_force of {name}": 1234.5 for name in names},
            **{f"tangential_force of {name}": 1e-12 for name in names},
            **{f"friction_used of {name}": None for name in names},
        }
        for k in range(count)
    ]


def printed(rows: list[dict[str, object]], width: int) -> list[str]:
    return format_steps(rows, title="A", unit="N", width=width).splitlines()


@pytest.mark.parametrize("width", [75, 80, 100, 200])
def test_a_narrow_table_has_fewer_columns_and_whole_cells(width: int) -> None:
    lines = printed(path(3), width)
    assert max(map(len, lines)) <= width
    head = lines[2]
    assert "Ft/(μFn)" in head
    assert "Fn [N]" in head
    assert "residual" in head
    assert ("seconds" in head) == (width >= 100)
    assert not any("…" in line for line in lines)


@pytest.mark.parametrize("width", [75, 100, 200])
def test_a_curved_surface_has_its_own_column_heads(width: int) -> None:
    rows = [
        {**row, "force_x of block.side0": 3.0, "force_y of block.side0": -4e-13}
        for row in path(3)
    ]
    lines = printed(rows, width)
    assert max(map(len, lines)) <= width
    head = lines[2]
    for name in ("Σrn [N]", "Σ|rt| [N]", "Σ|rt|/(Σμrn)"):
        assert name in head
    assert "Fn" not in head
    # steps.csv always has the same columns.
    assert ("Fx [N]" in head, "Fy [N]" in head) == ((width > 75,) * 2)
    if width > 75:
        cells = lines[4].split()
        at = cells.index("3")
        # A sum that balances leaves rounding.
        assert cells[at + 1] == "0"


def test_a_long_path_shows_both_ends() -> None:
    lines = printed(path(500), 200)
    assert len(lines) < 60
    assert any(line.lstrip().startswith("499 ") for line in lines)
    assert lines[-1] == "all 500 load steps are in steps.csv"


def test_many_surfaces_have_a_row_each_below_the_table() -> None:
    rows = path(2, surfaces=3)
    rows[-1] |= {
        "torque of block.side2": 7.25,
        "bolt_force of a": 3.5,
        "shortening of a": 0.5,
    }
    rows[0] |= dict.fromkeys(rows[-1].keys() - rows[0].keys(), 0.0)
    lines = printed(rows, 200)
    head = lines[2].split()
    assert "tension" in head
    assert "Fn" not in head
    below = "\n".join(lines).partition("at the end")[2].splitlines()
    rest = {line.split()[0]: line.split()[1:] for line in below if "block" in line}
    assert rest["block.side0"] == rest["block.side1"] == ["1234.5", "0", "-"]
    assert rest["block.side2"] == ["1234.5", "0", "-", "7.25"]


def test_the_sentence_at_the_end() -> None:
    rows = path(2)
    told = list_closing(rows, 1e-12, "out/a")
    assert told[0] == (
        "solved: 2 load steps, every residual at most 1.0e-15 (asked for 1.0e-12). "
        "At the end 20 of 21 contacts slip, 1 are open."
    )
    # Without a friction force the sentence does not say that friction is used up.
    assert not any("remark" in line for line in told)
    for row in rows:
        row["friction_used of block.side0"] = 0.9
    assert "no friction is left" in list_closing(rows, 1e-12, "out/a")[1]
    for row in rows:
        row.update(open=21, slip=0)
    told = list_closing(rows, 1e-12, "out/a")
    assert told[0].endswith("At the end all 21 contacts are open.")
    assert "no contact closes" in told[1]


def test_a_path_of_unknown_length(capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(6, None, quiet=False) as progress:
        progress.step(path(1)[0])
    assert capsys.readouterr().err.startswith("load step 1: load 0, open 1, slip 20")


def test_paraview_has_the_forces_in_global_axes(tmp_path: Path) -> None:
    """They are those that B transposed gives the nodes."""
    case = pressed(3).assemble()
    model, result = case.model, case.solve(case.problem())
    result.write(tmp_path / "contacts.pvd")
    at = model.contact_dofs[:, :1] + np.arange(3)
    for k, step in enumerate(result):
        force = meshio.read(tmp_path / f"contacts_{k:04}.vtu").point_data["force"]
        nodal = (model.B.T @ step.reaction.ravel())[at]
        # The same products, in another order.
        np.testing.assert_allclose(force, nodal, atol=1e-14 * np.abs(nodal).max())
        assert force[:, 0].any()
