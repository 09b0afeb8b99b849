"""What every test shares: where the repository is, and reproducible examples."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# In CI a red run must be red again on the next try; at home new examples are
# looked for at each run. No deadline: both run on machines shared with others.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("home", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "home")


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the source tree."""
    return Path(__file__).resolve().parents[2]
