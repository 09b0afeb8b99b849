"""Draw docs/sheared_cube.png, the picture of the README.

`bipot run sheared_cube --plot` solves the shipped scene and draws it.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "sheared_cube.png"

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "bipot_rs", "run", "sheared_cube"]
        subprocess.run([*command, "--plot", "--out", folder], check=True)
        with Image.open(Path(folder) / "tractions.png") as picture:
            # 256 colours are enough here, and take a third of the bytes. Without k-means
            # thin lines would have the colours of others.
            picture.convert("RGB").quantize(256, kmeans=3).save(PICTURE, optimize=True)
    print(PICTURE)
