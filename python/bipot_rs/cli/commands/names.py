"""Names that `bipot run` and the readers of its arguments share."""

from __future__ import annotations

# A tolerance that depends on the mesh.
ENOUGH = "discretisation"
# The engine that runs on several processes.
PETSC = "petsc"
