"""What other systems answer differently; .github/workflows/wheels.yml tests on them."""

import os
import subprocess
import sys
from pathlib import Path


def test_output_in_an_encoding_without_greek(tmp_path: Path) -> None:
    """A pipe on Windows has such an encoding: μ of a summary is then written as its code."""
    code = (
        "import sys\nfrom bipot_rs.cli.entry import call\n"
        "sys.exit(call(['run', 'sheared_cube', '--set', 'mesh.n=2', '--out', 'here']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        encoding="utf-8",
        cwd=tmp_path,
        env=os.environ | {"PYTHONIOENCODING": "cp1252"},
    )
    assert done.returncode == 0, done.stderr
    assert "\\u03bc" in done.stdout + done.stderr
