"""Discretisation error of a mesh, as an energy, from equilibrated stresses."""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from bipot_rs.discretisation.estimator import BOUND as BOUND
    from bipot_rs.discretisation.estimator import INDICATOR as INDICATOR
    from bipot_rs.discretisation.estimator import (
        DiscretisationError as DiscretisationError,
    )
    from bipot_rs.discretisation.estimator import Estimator as Estimator
    from bipot_rs.discretisation.estimator import (
        discretisation_error as discretisation_error,
    )

__getattr__, __dir__ = lazily(__name__)
__all__ = __dir__()
