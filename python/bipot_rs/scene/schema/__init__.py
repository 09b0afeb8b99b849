"""The tables of a scene as pydantic models; `Scene` is the root.

Pydantic checks each table by itself, `inconsistencies` checks them against each other. The
key `on` is ``"body.surface"``.
"""

from bipot_rs.scene.schema.consistency import (
    Known,
    inconsistencies,
    out_of_range,
)
from bipot_rs.scene.schema.contact import Clearance, Plane, Rigid, Touch
from bipot_rs.scene.schema.load import (
    BodyForce,
    Foundation,
    InitialStrain,
    Mirror,
    Prescribed,
    Pressure,
    Traction,
)
from bipot_rs.scene.schema.material import Elastic
from bipot_rs.scene.schema.mesh import Axis, Block, Mesh, MeshFile, Place, Within
from bipot_rs.scene.schema.path import Amplitude, Automatic, LoadPath
from bipot_rs.scene.schema.root import Scene, Solver, Units
from bipot_rs.scene.schema.table import AXES, KIND, Varying

__all__ = [
    "AXES",
    "KIND",
    "Amplitude",
    "Automatic",
    "Axis",
    "Block",
    "BodyForce",
    "Clearance",
    "Elastic",
    "Foundation",
    "InitialStrain",
    "Known",
    "LoadPath",
    "Mesh",
    "MeshFile",
    "Mirror",
    "Place",
    "Plane",
    "Prescribed",
    "Pressure",
    "Rigid",
    "Scene",
    "Solver",
    "Touch",
    "Traction",
    "Units",
    "Varying",
    "Within",
    "inconsistencies",
    "out_of_range",
]
