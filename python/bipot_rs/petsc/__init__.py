"""Contact problems whose stiffness is a matrix of PETSc, on several processes.

Contact data are the same on all processes; ``K`` and the displacements are distributed. It
needs petsc4py and mpi4py, which are imported when a `ContactProblem` is made.
"""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from bipot_rs.petsc.problem import ContactProblem as ContactProblem
    from bipot_rs.petsc.result import Result as Result
    from bipot_rs.petsc.result import Step as Step

__getattr__, __dir__ = lazily(__name__)
__all__ = __dir__()
