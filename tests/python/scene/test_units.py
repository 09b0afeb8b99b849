"""Names of units must be consistent: stress = force / length²; otherwise nothing runs."""

import itertools
import json
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs.scene import SceneError, read, units

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
    (
        ("m", "N", "MPa"),
        (
            'stress in MPa does not fit N / m², which is Pa: stress = "Pa", length = "mm" or '
            'force = "MN" would fit'
        ),
    ),
    (
        ("mm", "N", "Pa"),
        (
            'stress in Pa does not fit N / mm², which is MPa: stress = "MPa", length = "m" or '
            'force = "µN" would fit'
        ),
    ),
    (
        ("mm", "kN", "MPa"),
        (
            'stress in MPa does not fit kN / mm², which is GPa: stress = "GPa" or force = "N" '
            "would fit"
        ),
    ),
    (
        ("in", "lbf", "ksi"),
        (
            'stress in ksi does not fit lbf / in², which is psi: stress = "psi" or force = '
            '"kip" would fit'
        ),
    ),
    (("mm", "MPa", "N"), "force in MPa: that is a unit of stress"),
]


@pytest.mark.parametrize("names", FITTING)
def test_consistent_units(names: tuple[str, str, str]) -> None:
    assert units.find_inconsistency(dict(zip(units._SI, names, strict=True))) is None


@pytest.mark.parametrize(("names", "said"), WRONG)
def test_inconsistent_units(names: tuple[str, str, str], said: str) -> None:
    assert units.find_inconsistency(dict(zip(units._SI, names, strict=True))) == said


def test_suggested_units_are_consistent() -> None:
    """For all known names, the suggested unit is consistent, and consistent units pass."""
    common = units._COMMON
    wrong = 0
    for length, force, stress in itertools.product(*(common[k] for k in units._SI)):
        names = {"length": length, "force": force, "stress": stress}
        sizes = {kind: units.size(kind, name) for kind, name in names.items()}
        assert None not in sizes.values()
        ratio = sizes["stress"] * sizes["length"] ** 2 / sizes["force"]  # type: ignore[operator]
        message = units.find_inconsistency(names)
        assert (message is None) is (abs(ratio - 1) < 1e-3)
        if message is None:
            continue
        wrong += 1
        _, _, advice = message.partition(": ")
        for kind, quoted in (
            part.split(" = ")
            for part in advice.removesuffix(" would fit")
            .replace(" or ", ", ")
            .split(", ")
            if part
        ):
            assert units.find_inconsistency(names | {kind: quoted.strip('"')}) is None
    assert wrong > 700


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
    with pytest.raises(ValueError, match=r"units: stress in Pa does not fit N / mm²"):
        bp.plots.tractions(result, units=wrong)
    result.units = wrong
    with pytest.raises(ValueError, match=r"units: stress in Pa does not fit N / mm²"):
        bp.plots.force_displacement(result, [0.0])
