"""Where the repository and the data of the tests are."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
TESTS = ROOT / "tests" / "python"
DATA = TESTS / "data"
REFERENCE = TESTS / "data_reference"
