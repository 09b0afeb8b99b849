"""A load of a scene along its path."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bipot_rs._lib.short_repr import short_repr
from bipot_rs._lib.types import Floats
from bipot_rs.fem.bodies.loads import Load
from bipot_rs.scene.schema.table import Varying


@dataclass(frozen=True)
class LoadHistory:
    """A load that changes along the path in proportion to a factor.

    Attributes
    ----------
    load : fem.Load or None
        The load for factor 1; None for a force or a moment at a reference point.
    number
        The value and amplitude in the scene, from which the factor is computed.
    nodal : (n,)
        Nodal forces for factor 1 [N].
    history : (steps,)
        Factor at the end of each load step; empty before the steps are known.
    """

    load: Load | None
    number: Varying
    nodal: Floats
    history: Floats = field(default_factory=lambda: np.zeros(0))

    __repr__ = short_repr
