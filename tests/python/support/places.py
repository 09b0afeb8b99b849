"""Paths of the repository and of the data of the tests."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
TESTS = ROOT / "tests" / "python"
DATA = TESTS / "data"
REFERENCE = TESTS / "data_reference"
