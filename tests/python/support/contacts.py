"""One contact whose degrees of freedom are its own components; contacts of a rigid body."""

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


def rigid_rows(points: Array, axes: Any = None) -> Array:
    """R of contacts at ``(n_c, d)`` of one rigid body: translations, then rotations.

    ``axes (n_c, d, d)``, normal first; by default all normals are the last axis.
    """
    n, d = points.shape
    axes = np.roll(np.eye(d), 1, axis=0) if axes is None else np.asarray(axes)
    axes = np.broadcast_to(axes, (n, d, d))
    arm = np.broadcast_to(points[:, None], axes.shape)
    if d == 2:
        turn = arm[..., :1] * axes[..., 1:] - arm[..., 1:] * axes[..., :1]
    else:
        turn = np.cross(arm, axes)
    return np.concatenate([axes, turn], axis=2).reshape(n * d, -1)
