"""The package without JAX and PyTorch: who asks for them learns what to install."""

import subprocess
import sys

import pytest

# A machine without them, whatever this one has.
_WITHOUT = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("jax", "torch"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
import numpy as np
import bipot_rs as bp
[getattr(bp, name) for name in dir(bp)]
problem = bp.ContactProblem(np.eye(2), np.eye(2), gap=[0.0], mu=0.3)
try:
    getattr(bp, sys.argv[1]).solve(problem, [-1.0, 0.0])
except ModuleNotFoundError as error:
    print(error)
"""


@pytest.mark.parametrize(("library", "name"), [("jax", "jax"), ("torch", "torch")])
@pytest.mark.slow
def test_a_missing_library_is_named_with_its_extra(library: str, name: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _WITHOUT, library], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    wanted = (
        f"need {name}, which is not installed: run pip install 'bipot-rs[{library}]'"
    )
    assert wanted in done.stdout
