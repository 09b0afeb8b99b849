"""One contact whose degrees of freedom are its own components, (u_n, u_t[, u_t2])."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp

Array = NDArray[np.float64]

# The solver reaches η <= 1e-12. With two unknowns, a condition below 10 and unit sizes,
# errors of r and u stay below 1e-10.
TOL = 1e-12
SMALL = 1e-10

# One plane contact with coupled normal and tangential stiffness; μ_c = k_t/k_c = 2.
K1 = np.array([[2.0, 0.5], [0.5, 1.0]])


def one_node(
    load: Any, mu: float, gap: float = 0.0, stiffness: Array = K1, **options: Any
) -> Any:
    """The path of this contact under `load`, (d,) or (steps, d)."""
    d = stiffness.shape[0]
    B = sparse.eye_array(d, format="csr")
    # The iterative engine asks for coordinates: this node stands anywhere.
    arguments = {"tol": TOL, "coordinates": np.zeros((d, d)), **options}
    return bp.solve(stiffness, B, np.array(load, float), gap=[gap], mu=mu, **arguments)
