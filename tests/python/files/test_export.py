"""Result files are read back as written, and never half written."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from bipot_rs.files import export

CONTACTS = {
    "x": np.arange(6.0).reshape(3, 2),
    "mu": np.array([0.3, 0.3, 0.0]),
    "area": None,
}
STEP = {
    "load": 0.5,
    "residual": 1e-13,
    "reaction": np.ones((3, 2)),
    "status": np.array([0, 1, 2], dtype=np.int8),
    "iterations": 7,
    "outcome": "converged",
    "traction": None,
}


def test_result_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    export.write_result(
        path, CONTACTS, [STEP, STEP], complete=True, attributes={"scene": "it"}
    )
    contacts, steps, attributes, _ = export.read_saved(path)
    assert contacts.keys() == {"x", "mu"}
    np.testing.assert_array_equal(contacts["x"], CONTACTS["x"])
    assert attributes == {"scene": "it", "complete": True, "version": 1}
    assert len(steps) == 2
    step = steps[1]
    assert step.keys() == STEP.keys() - {"traction"}
    assert (step["load"], step["residual"]) == (0.5, 1e-13)
    assert (step["iterations"], step["outcome"]) == (7, "converged")
    assert step["status"].dtype == np.int8
    np.testing.assert_array_equal(step["reaction"], STEP["reaction"])


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
