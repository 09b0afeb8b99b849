"""The table of `make coverage`."""

from typing import Any

from coverage_table import count_reached, summarise

FILE = "/somewhere/src/law/cone.rs"


def copy(count: int, when_true: int, when_false: int) -> dict[str, Any]:
    """A copy of a function with one region of code, one gap, and one branch."""
    return {
        "filenames": [FILE],
        "regions": [[3, 1, 5, 2, count, 0, 0, 0], [5, 2, 6, 1, 0, 0, 0, 3]],
        "branches": [[4, 8, 4, 12, when_true, when_false, 0, 0, 4]],
    }


def test_a_place_is_reached_if_any_copy_is() -> None:
    elsewhere = {**copy(0, 0, 0), "filenames": ["/somewhere/src/lawless.rs"]}
    functions = [copy(0, 0, 0), copy(2, 2, 0), elsewhere]
    files = count_reached({"data": [{"functions": functions}]}, ["src/law"])
    assert list(files) == ["src/law/cone.rs"]
    assert summarise(files["src/law/cone.rs"]) == [1, 1, 2, 1]
