"""Every case of the verification page holds, and the page is made from the cases.

Cases that other files test in detail have short rows here. Ids that are tested only here
have a test with their name.
"""

import re
from functools import cache

import pytest

import cases.exact
import cases.hard
import cases.plane
import cases.published
import cases.space
from cases import verification
from cases.verification import PAGE, Row
from support.places import TESTS

# Cases run once for their own test and for the page, in one worker.
pytestmark = pytest.mark.xdist_group("verification")
for module in (cases.exact, cases.published, cases.hard, cases.plane, cases.space):
    module.CASES.update({name: cache(case) for name, case in module.CASES.items()})

NUMBERS = cases.exact.CASES | cases.published.CASES | cases.hard.CASES
REFINED = cases.plane.CASES | cases.space.CASES
# No other file tests these.
OWN = {"p1", "p2", "p3", "p4", "p6", "p7", "p8", "h9", "h11", "h18", "h23"}


@cache
def page() -> str:
    return verification.page(fine=False, randomised=False)


def check(name: str) -> None:
    assert [row for row in NUMBERS[name]() if not row.holds()] == []


def refined(name: str, *, fine: bool = False) -> None:
    assert [table for table in REFINED[name](fine) if not table.holds()] == []


@pytest.mark.parametrize("name", sorted(set(NUMBERS) - OWN))
@pytest.mark.slow_variants("a1", "a12", "h19", "h22")
def test_numbers(name: str) -> None:
    check(name)


def test_a7_hertz_line() -> None:
    refined("a7")


def test_a8_hertz_sphere() -> None:
    refined("a8")


def test_a9_cattaneo_mindlin_line() -> None:
    refined("a9")


@pytest.mark.slow
def test_a10_mindlin_sphere() -> None:
    refined("a10")


@pytest.mark.slow
def test_a13_flat_punch() -> None:
    refined("a13")


def test_p1_plate() -> None:
    check("p1")


def test_p2_cylinder_on_block() -> None:
    check("p2")


def test_p3_sliding_pad() -> None:
    check("p3")


@pytest.mark.slow
def test_p4_sphere() -> None:
    check("p4")


@pytest.mark.slow
def test_p6_ring_between_plates() -> None:
    check("p6")


@pytest.mark.slow
def test_p7_sheet_under_a_blank_holder() -> None:
    check("p7")


def test_p8_pin_in_a_lug() -> None:
    check("p8")


def test_h9_floating_bodies_are_held() -> None:
    check("h9")


def test_h11_high_friction_has_an_answer() -> None:
    check("h11")


@pytest.mark.slow
def test_h18_many_candidates_few_active() -> None:
    check("h18")


def test_h23_limit_of_stick_and_slip() -> None:
    check("h23")


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(REFINED))
def test_finer_meshes(name: str) -> None:
    refined(name, fine=True)


@pytest.mark.slow
def test_the_page_has_every_line() -> None:
    """All but the lines of the finest meshes and of random problems, in order."""
    written = iter(PAGE.read_text(encoding="utf-8").splitlines())
    missing = [line for line in page().splitlines() if line not in written]
    assert missing == []


@pytest.mark.slow
def test_the_page_is_what_the_cases_make() -> None:
    assert PAGE.read_text(encoding="utf-8") == verification.page(fine=True)


def test_every_id_has_a_test_of_its_name() -> None:
    ids = [f"a{i}" for i in range(1, 15)] + [f"h{i}" for i in range(1, 27)]
    ids += [f"p{i}" for i in range(1, 9)]
    texts = [path.read_text(encoding="utf-8") for path in TESTS.rglob("*.py")]
    named = {
        m[1] for t in texts for m in re.finditer(r"^def test_([ahp]\d+)_", t, re.M)
    }
    assert set(ids) - named == set()
    rows = set(re.findall(r"^\| ([AHP]\d+) \|", PAGE.read_text("utf-8"), re.M))
    assert {i.upper() for i in ids} == rows


def test_a_wrong_number_does_not_hold() -> None:
    assert verification.exact("", "", [1.0, 2.0], [1.0, 2.0 + 3e-10], 1e-9).holds()
    assert not verification.exact("", "", [1.0, 2.0], [1.0, 2.1], 1e-9).holds()
    assert not verification.exact("", "", [1.0], [float("nan")], 1e-9).holds()
    assert not Row("", "", "held", "lost").holds()
    (table, *_) = cases.plane.a7()
    assert table.holds()
    assert not table._replace(error=table.error[::-1]).holds()
    assert not table._replace(order=4.0).holds()
    assert not table._replace(within=table.error[-1] / 2).holds()


@pytest.mark.parametrize(
    ("x", "bound"),
    [(0.0123, "2e-02"), (0.02, "2e-02"), (9.5e-3, "1e-02"), (1e-10, "1e-10")],
)
def test_bounds_are_rounded_up(x: float, bound: str) -> None:
    assert verification.power(x) == bound
