"""Pictures of contact; each function returns the axes it drew into.

>>> import bipot_rs as bp
>>> ax = bp.plots.tractions(result)  # doctest: +SKIP
>>> ax.figure.savefig("tractions.png")  # doctest: +SKIP

The functions take a `Result`, one of its steps or a `Solution`, and the model if they need
the mesh. They draw into the axes ``ax=``, or into a new figure, made without pyplot. Labels
show units if they are known, from ``units={"length": "mm", "force": "N", "stress": "MPa"}``
or ``result.units``.

Along a line: `tractions`, `slip`, `wear`, `reaction_band`. On a flat surface: `surface_map`,
`status_map`, `slip`. On any surface in 3D: `surface3d`. Bodies: `deformed`. Rigid blocks:
`blocks`. Load path: `resultants`, `status_shares`, `force_displacement`, `dissipation`.
Derivatives: `sensitivity`. Solver: `convergence`. By name: `plot`; all load steps as a GIF:
`animate`.
"""

from bipot_rs.plots.blocks import blocks
from bipot_rs.plots.body import deformed
from bipot_rs.plots.by_name import animate, plot
from bipot_rs.plots.convergence import convergence
from bipot_rs.plots.line import reaction_band, tractions, wear
from bipot_rs.plots.path import (
    dissipation,
    force_displacement,
    resultants,
    status_shares,
)
from bipot_rs.plots.sensitivity import sensitivity
from bipot_rs.plots.space import surface3d
from bipot_rs.plots.surface import slip, status_map, surface_map

__all__ = [
    "animate",
    "blocks",
    "convergence",
    "deformed",
    "dissipation",
    "force_displacement",
    "plot",
    "reaction_band",
    "resultants",
    "sensitivity",
    "slip",
    "status_map",
    "status_shares",
    "surface3d",
    "surface_map",
    "tractions",
    "wear",
]
