"""Discretisation error of a mesh, as an energy, from equilibrated stresses."""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from bipot_rs.discretisation.estimator import (
        BOUND,
        INDICATOR,
        DiscretisationError,
        Estimator,
        discretisation_error,
    )

__all__ = [
    "BOUND",
    "INDICATOR",
    "DiscretisationError",
    "Estimator",
    "discretisation_error",
]

__getattr__, __dir__ = lazily(__name__)
