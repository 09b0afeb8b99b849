"""Linear systems of Newton steps: flexible GMRES of PETSc and what preconditions it."""
