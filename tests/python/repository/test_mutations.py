"""Each planted fault of the list fits the current sources."""

import ast
from pathlib import Path

import pytest

from plant import faults, planted

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("number", range(1, len(faults()) + 1))
def test_a_fault_can_be_planted(number: int) -> None:
    fault = faults()[number - 1]
    text = (ROOT / fault["file"]).read_text("utf-8")
    changed = planted(fault, number, text)
    assert f"planted({number})" in changed
    assert changed.count("\n") == text.count("\n")
    if fault["file"].endswith(".py"):
        # Otherwise each test fails, whatever the fault, and it counts as found.
        ast.parse(changed)
