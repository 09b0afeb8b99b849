"""The recipes of `examples/` for stiffness from other programs agree with the scenes."""

import os
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import _core
from bipot_rs.scene import assemble, bodies, read
from support import places
from support.children import bipot

EXAMPLES = places.ROOT / "examples"
SYSTEM = Path("/usr/bin/python3")


def recipe(name: str) -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


def by_place(points: Any, reaction: Any) -> Any:
    """Reactions sorted by position."""
    order = np.lexsort(np.round(points, 9).T)
    return reaction[:, order]


def test_scikit_fem(capsys: pytest.CaptureFixture[str]) -> None:
    space = recipe("with_scikit_fem")
    result, arrays = space["solve"](6)
    assert result.success
    K, B = arrays["K"], arrays["B"]
    free = np.setdiff1d(np.arange(K.shape[0]), arrays["fixed"])
    for step in result:
        u = step.displacement
        out = K @ u - B.T @ step.reaction.ravel()
        # A backward stable solve: a few ε n of the largest stiffness times u.
        assert np.abs(out[free]).max() <= 1e-12 * abs(K).max() * np.abs(u).max()
        law = np.linalg.norm(step.reaction[:, 1:], axis=1) - 0.2 * step.reaction[:, 0]
        assert law.max() <= 1e-8 * step.reaction.max()
    # Symmetric at first, then held back, with closed and open contacts.
    force = np.einsum("sck,ckd->sd", result.reaction, arrays["frame"])
    assert abs(force[0, 0]) <= 1e-9 * force[0, 1]
    assert force[1, 0] < 0 < force[1, 1]
    assert {0, 1, 2} <= set(result.status.ravel().tolist())
    # Near the crown the bar is a parabola with its radius: the clearance of the scene.
    flat = bp.Model("as a scene")
    flat.material("steel", young=space["YOUNG"], poisson=space["POISSON"])
    flat.body(
        "block",
        material="steel",
        cell="quadrilateral",
        x=np.linspace(-2.0, 2.0, 13),
        y=np.linspace(0.0, 2.0, 7),
    )
    flat.support("block.top", x=flat.times(0.01, "drag"), y=-0.02)
    plane = {"point": [0, 0], "normal": [0, 1]}
    flat.contact("block.bottom", mu=0.2, plane=plane, clearance={"radius": 50.0})
    flat.path(drag=[0.0, 1.0])
    own_force = flat.solve().contact_force("block.bottom")
    # Normals rotate by x/R, 0.04 at the open ends of the bar, 0.02 where it is closed.
    np.testing.assert_allclose(force[:, 1], own_force[:, 1], rtol=0.02)
    space["main"]()
    assert "residual" in capsys.readouterr().out


def test_any_operator(capsys: pytest.CaptureFixture[str]) -> None:
    space = recipe("with_any_operator")
    result, model = space["solve"]()
    assert result.success
    lower = np.arange(model.n) >= model.offset[1]
    for step in result:
        out = (model.K @ step.displacement).reshape(-1, 2)
        at = lower.reshape(-1, 2)[:, 0]
        # The pull of the supports on one body is carried to the other: B transmits all of it.
        size = np.abs(out).max()
        np.testing.assert_allclose(
            out[at].sum(axis=0), -out[~at].sum(axis=0), atol=1e-9 * size
        )
        np.testing.assert_allclose(out.sum(axis=0), 0, atol=1e-9 * size)
    force = result.reaction.sum(axis=1)
    # The stiffness of the pair is between that of free and of held sides, over 4 mm × 4 mm.
    modulus = 210e3 * np.array([1 / (1 - 0.3**2), (1 - 0.3) / ((1 + 0.3) * 0.4)])
    assert modulus[0] * 0.01 < force[0, 0] < modulus[1] * 0.01
    assert force[1, 1] < 0 < force[1, 0]
    space["main"]()
    assert "step 1" in capsys.readouterr().out


def test_matrix_market(tmp_path: Path) -> None:
    space = recipe("with_matrix_market")
    space["write"](tmp_path)
    result = space["solve"](tmp_path)
    # The floor carries the pressure on the top, the left side carries the friction.
    assert result.reaction[0, :, 0].sum() == pytest.approx(40.0 * 50.0, rel=1e-9)
    options = [f"--{k}={k}.csv" for k in ("contacts", "load", "fixed")]
    run = bipot(
        "solve", "--stiffness=K.mtx", "--nodes=nodes.inp", *options, cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    read = bp.load(tmp_path / "out" / "K" / "result.h5")
    assert read.reaction.tobytes() == result.reaction.tobytes()


# The imports of a recipe, and the folder where Debian has them.
ELSEWHERE = {
    "with_getfem": ("getfem", "python3-getfem++"),
    "with_fenicsx": ("dolfinx.fem, ufl, mpi4py", "python3-dolfinx"),
}


def python_with(modules: str, package: str) -> str:
    """A Python with these packages, NumPy and SciPy, if there is one."""
    code = f"import {modules}, numpy, scipy.sparse"
    for python in (sys.executable, str(SYSTEM)):
        try:
            done = subprocess.run(
                [python, "-c", code], capture_output=True, check=False
            )
        except OSError:
            continue
        if done.returncode == 0:
            return python
    pytest.skip(f"no Python here has {modules} (Debian: {package})")


@pytest.mark.parametrize("name", ELSEWHERE)
def test_another_program(name: str, tmp_path: Path) -> None:
    """A cube of hexahedra, which is also a scene."""
    python = python_with(*ELSEWHERE[name])
    # The compiled core may be in another folder than the Python files.
    places = [Path(file or "").parents[1] for file in (_core.__file__, bp.__file__)]
    done = subprocess.run(
        [python, str(EXAMPLES / f"{name}.py"), str(tmp_path / "found.npz")],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, places))},
    )
    assert done.returncode == 0, done.stderr
    assert "step 1" in done.stdout
    arrays_of_run = np.load(tmp_path / "found.npz")
    scene = read("sheared_cube", ["mesh.n=6"])
    case = assemble(scene, bodies(scene))
    own_result = case.solve(tol=1e-12)
    reference = by_place(case.model.points, own_result.reaction)
    theirs = by_place(arrays_of_run["x"], arrays_of_run["reaction"])
    # Two assemblies of one element with exact quadrature; η of 1e-10, and the condition of
    # W, some hundreds.
    assert np.abs(theirs - reference).max() <= 1e-7 * np.abs(reference).max()
