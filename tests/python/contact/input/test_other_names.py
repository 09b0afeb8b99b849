"""Names that users know from the argument that they gave."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp

pytestmark = pytest.mark.needs_extra

K, B = 1000.0 * np.eye(4), np.eye(4)
CONTACTS: dict[str, Any] = {"gap": [0.0, 0.0], "mu": 0.3}
LOAD = [-10.0, 2.0, -10.0, 5.0]
POINTS = [[0.0, 0.0], [1.0, 0.0]]


def test_points_are_found_by_the_name_of_the_argument(tmp_path: Path) -> None:
    result = bp.solve(K, B, LOAD, points=POINTS, **CONTACTS)
    result.save(tmp_path / "a.h5")
    again = pickle.loads(pickle.dumps(result))
    for any_result in (result, again, bp.load_result(tmp_path / "a.h5")):
        np.testing.assert_array_equal(any_result.contacts["points"], POINTS)
        np.testing.assert_array_equal(any_result.contacts.get("points"), POINTS)
        # Not a second array: files and loops over the data have it once.
        assert "points" not in list(any_result.contacts)
    with pytest.raises(KeyError, match="'place': the contacts have x, normal"):
        result.contacts["place"]
    assert result.contacts.get("place") is None
    bare = bp.solve(K, B, LOAD, **CONTACTS)
    assert bare.contacts["points"] is None
