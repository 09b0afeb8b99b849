"""The theory of de Saxcé and Feng (1991) as functions, statement by statement.

Materials with a bipotential, the contact law in all its forms, the functionals and
principles of the boundary-value problem, and its variational inequalities. The solvers do
not use it. Numbers such as [dSF91, 54] are equations of the paper; the equations of this
package are in docs/theory.md.
"""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from bipot_rs.theory.soil_body import Soil as Soil
    from bipot_rs.theory.structure import Contacts as Contacts
    from bipot_rs.theory.structure import Structure as Structure

__getattr__, __dir__ = lazily(__name__)
__all__ = __dir__()
