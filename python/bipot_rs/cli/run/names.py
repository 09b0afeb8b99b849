"""Names that `bipot run` and its arguments share."""

from __future__ import annotations

from bipot_rs.contact.path.choice import ENGINES as OF_ARRAYS

# A tolerance that depends on the mesh.
ENOUGH = "discretisation"
# The engine that runs on several processes.
PETSC = "petsc"
# The engines of a scene.
ENGINES = (*OF_ARRAYS, PETSC)
