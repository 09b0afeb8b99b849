"""Names of units must be consistent: stress = force / length²; otherwise nothing runs."""

import json
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.scene import SceneError, read, units
from support.comparisons import refused

FITTING = [
    ("m", "N", "Pa"),
    ("mm", "N", "MPa"),
    ("mm", "kN", "GPa"),
    ("mm", "mN", "kPa"),
    ("m", "MN", "MPa"),
    ("µm", "µN", "MPa"),
    ("um", "uN", "MPa"),
    ("cm", "N", "N/cm²"),
    ("cm", "daN", "bar"),
    ("in", "lbf", "psi"),
    ("inch", "lb", "psi"),
    ("in", "kip", "ksi"),
    ("ft", "lbf", "psf"),
    ("mm", "N", "N/mm2"),
    ("mm", "N", "N / mm^2"),
    ("cm", "kgf", "kgf/cm²"),
    ("km", "N", "µPa"),
]
WRONG = [
    (("m", "N", "MPa"), "stress in MPa does not fit N / m², which is Pa"),
    (("mm", "N", "Pa"), "stress in Pa does not fit N / mm², which is MPa"),
    (("in", "lbf", "ksi"), "stress in ksi does not fit lbf / in², which is psi"),
    (("ft", "kN", "bar"), "stress in bar does not fit kN / ft²"),
    (("mm", "MPa", "N"), "force in MPa: that is a unit of stress"),
]


@pytest.mark.parametrize("names", FITTING)
def test_consistent_units(names: tuple[str, str, str]) -> None:
    assert units.find_inconsistency(dict(zip(units._SI, names, strict=True))) is None


@pytest.mark.parametrize(("names", "said"), WRONG)
def test_inconsistent_units(names: tuple[str, str, str], said: str) -> None:
    assert units.find_inconsistency(dict(zip(units._SI, names, strict=True))) == said


@pytest.mark.parametrize("length", ["m", "mm", "cm", "µm", "in", "ft"])
@pytest.mark.parametrize("force", ["N", "kN", "mN", "lbf", "kip", "kgf"])
def test_of_all_stresses_the_fitting_ones_pass(length: str, force: str) -> None:
    made = units.size("force", force) / units.size("length", length) ** 2  # type: ignore[operator]
    for stress in units._STRESSES:
        names = {"length": length, "force": force, "stress": stress}
        size = units.size("stress", stress)
        assert size is not None
        fits = units.find_inconsistency(names) is None
        assert fits is (abs(size / made - 1) < 1e-3)


@pytest.mark.parametrize(
    "names",
    [
        {"length": "mm", "stress": "Pa"},
        {"length": "parsec", "force": "N", "stress": "MPa"},
        {"length": "mm", "force": "-", "stress": "Pa"},
        {"length": "", "force": "N", "stress": "MPa"},
        {},
    ],
)
def test_unknown_units_are_not_checked(names: dict[str, str]) -> None:
    assert units.find_inconsistency(names) is None


def test_scenes_are_refused(bipot: Any) -> None:
    for command in ("run", "check"):
        status, out, _ = bipot(
            command, "two_blocks", "--set", 'units.stress="Pa"', "--json"
        )
        assert status == 2
        message = json.loads(out.splitlines()[-1])["message"]
        assert "units: stress in Pa does not fit N / mm², which is MPa" in message
    with pytest.raises(SceneError, match=r"units: stress in MPa does not fit N / m²"):
        bp.Model.from_toml("two_blocks").with_(**{"units.length": "m"}).assemble()
    assert read("two_blocks", ['units.length="parsec"']).units.length == "parsec"


def test_pictures_are_refused() -> None:
    result = bp.solve(
        np.eye(2), np.eye(2), [[-1.0, 0.0]], gap=[0.0], mu=0.3, points=[[0.0, 0.0]]
    )
    wrong = {"length": "mm", "force": "N", "stress": "Pa"}
    with refused(r"units: stress in Pa does not fit N / mm²"):
        bp.plots.tractions(result, units=wrong)
    result.units = wrong
    with refused(r"units: stress in Pa does not fit N / mm²"):
        bp.plots.force_displacement(result, [0.0])
