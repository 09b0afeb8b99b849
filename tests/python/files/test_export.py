"""Result files of many steps, and other files."""

from pathlib import Path

import h5py
import pytest

from bipot_rs.files import export


@pytest.mark.slow
def test_more_than_9999_steps_stay_in_order(tmp_path: Path) -> None:
    steps = [{"load": float(k)} for k in range(10_001)]
    export.write_result(tmp_path / "a.h5", {}, steps, complete=True)
    _, back, _, _ = export.read_saved(tmp_path / "a.h5")
    assert [step["load"] for step in back] == list(range(10_001))
    with h5py.File(tmp_path / "a.h5") as file:
        assert "00000" in file["steps"]
        assert "10000" in file["steps"]


def test_other_files_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "b.h5", "w"):
        pass
    with pytest.raises(ValueError, match="is not a result"):
        export.read_saved(tmp_path / "b.h5")
    with h5py.File(tmp_path / "c.h5", "w") as file:
        file.attrs.update(format="bipot-result", version=99)
    with pytest.raises(ValueError, match="version 99"):
        export.read_saved(tmp_path / "c.h5")
