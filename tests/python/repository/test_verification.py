"""Every case of the verification page holds, and the page is made from the cases."""

from functools import cache

import pytest

import cases.exact
import cases.faults
import cases.hard
import cases.manufactured
import cases.plane
import cases.published
import cases.revolution
import cases.space
from cases import verification
from cases.verification import PAGE

# Cases run once for their own test and for the page, in one worker.
pytestmark = pytest.mark.xdist_group("verification")
MODULES = (cases.exact, cases.published, cases.hard, cases.plane, cases.space)
for module in (*MODULES, cases.faults, cases.manufactured, cases.revolution):
    module.CASES.update({name: cache(case) for name, case in module.CASES.items()})

NUMBERS = cases.exact.CASES | cases.published.CASES | cases.hard.CASES
REFINED = cases.plane.CASES | cases.space.CASES | cases.manufactured.CASES
REFINED |= cases.faults.CASES | cases.revolution.CASES


@cache
def page() -> str:
    return verification.page(fine=False)


@pytest.mark.parametrize("name", sorted(NUMBERS))
@pytest.mark.slow_variants("a1", "a12", "h18", "h19", "h22", "p4", "p6", "p7", "p8")
def test_numbers(name: str) -> None:
    assert [row for row in NUMBERS[name]() if not row.holds()] == []


def test_tractions_of_a_crack() -> None:
    assert [row for row in cases.faults.crack_tractions() if not row.holds()] == []


@pytest.mark.parametrize("name", sorted(REFINED))
@pytest.mark.slow_variants("a8", "a9", "a10", "a13", "a19")
def test_refined_meshes(name: str) -> None:
    assert [table for table in REFINED[name](False) if not table.holds()] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(REFINED))
def test_finer_meshes(name: str) -> None:
    assert [table for table in REFINED[name](True) if not table.holds()] == []


@pytest.mark.slow
def test_the_page_has_every_line() -> None:
    """All but the lines of the finest meshes, in order."""
    written = iter(PAGE.read_text(encoding="utf-8").splitlines())
    missing = [line for line in page().splitlines() if line not in written]
    assert missing == []


@pytest.mark.slow
def test_the_page_is_what_the_cases_make() -> None:
    assert PAGE.read_text(encoding="utf-8") == verification.page(fine=True)
