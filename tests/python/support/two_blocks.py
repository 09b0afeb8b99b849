"""A block on another, as arrays of `ContactProblem`: meshes that match, or mortar."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

import bipot_rs as bp
from support.models_and_arrays import arguments


def two_blocks(contrast: float = 10.0, upper: int = 8, lower: int = 8) -> bp.Model:
    """The upper block is held at its top, pressed and sheared; mortar unless n is equal."""
    m = bp.Model("Two blocks")
    m.material("lower", young=1000.0, poisson=0.3)
    m.material("upper", young=1000.0 * contrast, poisson=0.3)
    below, above = (np.linspace(0.0, 1.0, n + 1) for n in (lower, upper))
    kind = "hexahedron"
    m.body("low", material="lower", cell=kind, x=below, y=below, z=below - 1.0)
    m.body("high", material="upper", cell=kind, x=above, y=above, z=above)
    m.support("low.bottom", x=0.0, y=0.0, z=0.0)
    m.support("high.top", x=m.times(0.01, "shear"), y=0.0, z=m.times(-0.02, "press"))
    pairing = {} if upper == lower else {"pairing": "mortar"}
    m.contact("high.bottom", against="low.top", mu=0.3, **pairing)
    m.path(press=[0.6, 1.0], shear=[0.0, 1.0])
    return m


def arrays(*shape: Any) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Arguments of `ContactProblem`, and the prescribed displacements of two steps."""
    case = two_blocks(*shape).assemble()
    return arguments(case.model), case.prescribed
