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
    files = [f"--{k}={k}.csv" for k in ("contacts", "load", "fixed")]
    files += ["--stiffness=K.mtx", "--nodes=nodes.inp"]
    run = bipot("solve", *files, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    read = bp.load(tmp_path / "out" / "K" / "result.h5")
    assert read.reaction.tobytes() == result.reaction.tobytes()


def test_calculix(capsys: pytest.CaptureFixture[str]) -> None:
    """Files that CalculiX 2.20 wrote: its K and its result are those of a scene."""
    space = recipe("with_calculix")
    job = places.DATA / "stiffness" / "cube"
    K, row, deck = space["read"](job)
    m = bp.Model("cube")
    m.material("steel", young=210e3, poisson=0.3)
    side = {"from": 0.0, "to": 10.0, "cells": 2}
    m.body("cube", material="steel", cell="hexahedron", x=side, y=side, z=side)
    m.support("cube.top", x=m.times(0.004, "drag"), y=0.0, z=-0.01)
    plane = {"point": [0, 0, 0], "normal": [0, 0, 1]}
    m.contact("cube.bottom", plane=plane, mu=0.25)
    m.path(drag=[0.0, 1.0])
    case = m.assemble()
    number = {tuple(x): k for k, x in enumerate(case.model.nodes.tolist())}
    order = np.empty(len(row), np.int64)
    for (node, component), k in row.items():
        order[k] = 3 * number[tuple(deck.places[deck.node[node]])] + component - 1
    own = case.model.K.toarray()[np.ix_(order, order)]
    # The file has 14 digits.
    np.testing.assert_allclose(K.toarray(), own, atol=1e-13 * np.abs(own).max())
    result, points = space["solve"](job)
    reference = by_place(case.model.points, case.solve().reaction)
    found = by_place(points, result.reaction)
    assert np.abs(found - reference).max() <= 1e-9 * np.abs(reference).max()
    space["main"](str(job))
    assert "N normal" in capsys.readouterr().out


def test_ansys(tmp_path: Path) -> None:
    """The bar that comes with the reader: EA/L, raised by the held ends."""
    python = python_with("ansys.mapdl.reader", "PyPI: ansys-mapdl-reader")
    done = run_recipe(python, "with_ansys", tmp_path)
    force = float(done.split()[0])
    assert 1 < force / (16.9e6 / 5 * 0.01) < 1.02


# The imports of a recipe, and the package that has them.
ELSEWHERE = {
    "with_getfem": ("getfem", "Debian: python3-getfem++"),
    "with_fenicsx": ("dolfinx.fem, ufl, mpi4py", "Debian: python3-dolfinx"),
    "with_felupe": ("felupe", "PyPI: felupe"),
    "with_easyfea": ("EasyFEA", "PyPI: EasyFEA"),
    "with_nastran": ("pyyeti.nastran.op4, skfem", "PyPI: pyyeti"),
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
    pytest.skip(f"no Python here has {modules} ({package})")


def run_recipe(python: str, name: str, folder: Path, *arguments: str) -> str:
    """What a recipe prints."""
    # The compiled core may be in another folder than the Python files.
    paths = [Path(file or "").parents[1] for file in (_core.__file__, bp.__file__)]
    done = subprocess.run(
        [python, str(EXAMPLES / f"{name}.py"), *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", ELSEWHERE)
def test_another_program(name: str, tmp_path: Path) -> None:
    """A cube of hexahedra, which is also a scene."""
    python = python_with(*ELSEWHERE[name])
    told = run_recipe(python, name, tmp_path, str(tmp_path / "found.npz"))
    assert "step 1" in told
    arrays_of_run = np.load(tmp_path / "found.npz")
    scene = read("sheared_cube", ["mesh.n=6"])
    case = assemble(scene, bodies(scene))
    own_result = case.solve(tol=1e-12)
    reference = by_place(case.model.points, own_result.reaction)
    theirs = by_place(arrays_of_run["x"], arrays_of_run["reaction"])
    # Two assemblies of one element with exact quadrature; η of 1e-10, and the condition of
    # W, some hundreds.
    assert np.abs(theirs - reference).max() <= 1e-7 * np.abs(reference).max()
