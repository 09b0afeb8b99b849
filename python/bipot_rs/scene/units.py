"""Check that names of units are consistent: stress = force / length².

Nothing is converted. Names of units appear in tables and pictures; inconsistent ones would
make these wrong by powers of ten.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

_PREFIX = {
    "": 1.0,
    "n": 1e-9,
    "µ": 1e-6,
    "μ": 1e-6,
    "u": 1e-6,
    "m": 1e-3,
    "c": 1e-2,
    "d": 1e-1,
    "da": 1e1,
    "h": 1e2,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
}
# Units that take a prefix; the others with their value in m, N and Pa.
_SI = {"length": "m", "force": "N", "stress": "Pa"}
_INCH, _POUND = 0.0254, 4.4482216152605
_OTHERS: Mapping[str, Mapping[str, float]] = {
    "length": {
        **dict.fromkeys(("in", "inch", "inches", '"'), _INCH),
        **dict.fromkeys(("ft", "foot", "feet"), 12 * _INCH),
        "yd": 36 * _INCH,
        "mil": 1e-3 * _INCH,
        "micron": 1e-6,
        "Å": 1e-10,
    },
    "force": {
        **dict.fromkeys(("lbf", "lb", "lbs"), _POUND),
        **dict.fromkeys(("kip", "kips", "klbf"), 1e3 * _POUND),
        **dict.fromkeys(("kgf", "kp"), 9.80665),
        "gf": 9.80665e-3,
        "tf": 9806.65,
        "dyn": 1e-5,
    },
    "stress": {
        "psi": _POUND / _INCH**2,
        "ksi": 1e3 * _POUND / _INCH**2,
        "psf": _POUND / (12 * _INCH) ** 2,
        "ksf": 1e3 * _POUND / (12 * _INCH) ** 2,
        "bar": 1e5,
        "mbar": 1e2,
        "kbar": 1e8,
        "atm": 101325.0,
    },
}
# Names for the stress that force and length make, the most common first.
_STRESSES = ("Pa", "MPa", "kPa", "GPa", "psi", "ksi", "psf", "ksf", "kgf/cm²", "N/cm²")
# Some programs write the values of pounds and inches with fewer digits.
_DIGITS = 1e-4


def size(kind: str, name: str) -> float | None:
    """Value of a unit of ``"length"``, ``"force"`` or ``"stress"`` in m, N or Pa.

    None if the name is unknown, or of another kind.

    >>> size("length", "mm"), size("stress", "kN/cm²"), size("force", "MPa")
    (0.001, 10000000.0, None)
    """
    name = name.strip()
    if name in _OTHERS[kind]:
        return _OTHERS[kind][name]
    base = _SI[kind]
    if name.endswith(base) and name[: -len(base)] in _PREFIX:
        return _PREFIX[name[: -len(base)]]
    if kind == "stress" and (
        parts := re.fullmatch(r"(.+?)\s*/\s*(.+?)\s*(?:²|\^2|\*\*2|2)", name)
    ):
        force, length = size("force", parts[1]), size("length", parts[2])
        if force is not None and length is not None:
            # Powers of ten without the rounding of their quotients.
            return float(f"{force / length**2:.15g}")
    return None


def find_inconsistency(names: Mapping[str, str]) -> str | None:
    """Message about units of ``"length"``, ``"force"`` and ``"stress"``, None if consistent.

    >>> find_inconsistency({"length": "mm", "force": "N", "stress": "MPa"})
    >>> find_inconsistency({"length": "mm", "force": "kN", "stress": "bar"})
    'stress in bar does not fit kN / mm², which is GPa'
    >>> find_inconsistency({"length": "N"})
    'length in N: that is a unit of force'

    Unknown and missing names are not checked.
    """
    sizes: dict[str, float] = {}
    for kind in _SI:
        name = names.get(kind) or ""
        value = size(kind, name) if name else None
        if value is not None:
            sizes[kind] = value
            continue
        for other in _SI:
            if name and size(other, name) is not None:
                return f"{kind} in {name}: that is a unit of {other}"
    if len(sizes) < len(_SI):
        return None
    made = sizes["force"] / sizes["length"] ** 2
    if _equal(sizes["stress"], made):
        return None
    fitting = [unit for unit in _STRESSES if _equal(size("stress", unit) or 0.0, made)]
    length, force, stress = (names[kind].strip() for kind in _SI)
    of = f", which is {fitting[0]}" if fitting else ""
    return f"stress in {stress} does not fit {force} / {length}²{of}"


def _equal(stress: float, other: float) -> bool:
    return abs(stress / other - 1) <= _DIGITS
