"""The theory of de Saxcé and Feng (1991) as functions, statement by statement.

Materials with a bipotential, the contact law in all its forms, the functionals and
principles of the boundary-value problem, and its variational inequalities. The solvers do
not use it. Numbers such as [dSF91, 54] are equations of the paper; the equations of this
package are in docs/theory.md.
"""
