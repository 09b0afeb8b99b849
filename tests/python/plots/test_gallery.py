"""Pictures that the program draws of the shipped scenes, as on its pages."""

import re
import runpy
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

from support.places import ROOT


@pytest.fixture(scope="module")
def gallery() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "examples" / "gallery.py"))


# One scene that is solved within a second, and one with the mesh.
@pytest.mark.parametrize(
    "name", ["tractions", "status", "slip", "deformed", "deformed_near"]
)
@pytest.mark.quick_variants("tractions")
def test_pictures_are_drawn(gallery: dict[str, Any], name: str, tmp_path: Path) -> None:
    (written,) = gallery["draw"](tmp_path, [name], dpi=50)
    picture = plt.imread(written)[..., :3]
    # The picture is neither empty nor full.
    ink = np.mean((picture < 0.98).any(axis=2))
    assert 0.02 < ink < 0.9


def test_the_page_shows_what_the_script_draws(gallery: dict[str, Any]) -> None:
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    shown = re.findall(r"\(gallery/(\w+)\.png\)", page)
    assert shown == list(gallery["SITE"])
    assert set(shown) <= set(gallery["pictures"]())
    for name in shown:
        # Stored in the repository, so it must be small.
        assert 2_000 < (ROOT / f"docs/gallery/{name}.png").stat().st_size < 60_000
