"""Every shipped scene from the command to its files, read by other libraries."""

import json
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.cli.run.output_folder import RESULT
from bipot_rs.scene.library import shipped
from support.runs import bipot, lines


@pytest.mark.parametrize("name", shipped())
@pytest.mark.slow
def test_a_shipped_scene_runs_and_its_files_agree(name: str, tmp_path: Path) -> None:
    run = bipot("run", name, "--json", "--plot", "--out", "here", cwd=tmp_path)
    *steps, last = lines(run.stdout)
    here = tmp_path / "here"
    assert last["success"]
    assert len(steps) == last["steps"]
    assert (here / "tractions.png").read_bytes().startswith(b"\x89PNG")
    result = bp.load(here / RESULT)
    d = result.reaction.shape[2]
    for k, (step, told) in enumerate(zip(result, steps, strict=True)):
        assert step.residual == told["residual"]
        contact = meshio.read(here / f"contact_{k:04d}.vtu").point_data
        force, local = contact["force"], contact["reaction_local"]
        pressed = np.einsum("cd,cd->c", force, contact["normal"])
        # Products with unit vectors, and sums in another order.
        rounding = 1e-12 * (np.linalg.norm(local, axis=1).sum() + 1e-300)
        assert np.abs(pressed - local[:, 0]).max() <= rounding
        assert np.array_equal(local[:, :d], step.reaction)
        total = sum(resultant["normal_force"] for resultant in told["forces"].values())
        assert abs(pressed.sum() - total) <= rounding
        body = meshio.read(here / f"result_{k:04d}.vtu").point_data["displacement"]
        with h5py.File(here / RESULT) as file:
            u = file[f"/steps/{k:04d}/displacement"][...]
        assert np.array_equal(body[:, :d], u[: len(body) * d].reshape(-1, d))
    told = bipot("info", str(here / RESULT), "--json", cwd=tmp_path).stdout
    assert json.loads(told)["steps"] == len(steps)
