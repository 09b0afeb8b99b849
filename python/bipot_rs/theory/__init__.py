"""The theory of de Saxcé and Feng (1991), statement by statement, as functions.

Materials with a bipotential, the contact law in all its forms, the functionals and
principles of the boundary-value problem, and its inequalities. Nothing here is needed
to solve a problem; numbers in square brackets, as in [dSF91, 54], are equations of the
paper, and docs/theory.md has those of this package.
"""
