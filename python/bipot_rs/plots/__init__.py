"""Pictures of contact, each a function that returns the axes it drew into.

>>> import bipot_rs as bp
>>> ax = bp.plots.tractions(result)  # doctest: +SKIP
>>> ax.figure.savefig("tractions.png")  # doctest: +SKIP

They take a `Result`, one of its steps or a `Solution`, where the mesh is needed the
model, and ``ax=`` to draw into; figures of their own are made without pyplot and belong
to whoever asked for them. Units stand in labels where they are known: by
``units={"length": "mm", "force": "N", "stress": "MPa"}``, or as ``result.units``.

Along a line `tractions`, `slip`; on a plane surface `surface_map`, `status_map`, `slip`;
on any surface in space `surface3d`; of the bodies `deformed`; over the load path
`resultants`, `status_shares`, `force_displacement`, `dissipation`; of the solver
`convergence`.
"""

from bipot_rs.plots.body import deformed
from bipot_rs.plots.convergence import convergence
from bipot_rs.plots.line import tractions
from bipot_rs.plots.path import (
    dissipation,
    force_displacement,
    resultants,
    status_shares,
)
from bipot_rs.plots.space import surface3d
from bipot_rs.plots.surface import slip, status_map, surface_map

__all__ = [
    "convergence",
    "deformed",
    "dissipation",
    "force_displacement",
    "resultants",
    "slip",
    "status_map",
    "status_shares",
    "surface3d",
    "surface_map",
    "tractions",
]
