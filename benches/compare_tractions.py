"""Error of the tractions of a run against a reference, and nodes with a wrong status."""

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

DATA = Path(__file__).resolve().parent.parent / "tests" / "python" / "data"
LETTER = {"pressed_block": "A", "sheared_cube": "B", "two_blocks": "D"}


def stored(scene, n):
    """Stored reference of a mesh: x, area, mu, R, v; ``None`` if there is none."""
    path = DATA / f"{LETTER.get(scene)}_{n}.npz"
    if not path.exists():
        return None
    with np.load(path) as file:
        arrays = {key: file[key] for key in ("x", "area", "mu", "R", "u", "gap0")}
    v = arrays.pop("u").copy()
    v[1:, :, 1:] = np.diff(v, axis=0)[..., 1:]
    v[..., 0] += arrays.pop("gap0")
    return arrays | {"v": v}


def statuses(R, v, mu):
    """Status of each load step and node: 0 open, 1 slip, 2 stick.

    One rule for all programs, the projection of ``R - ρ v``. For a solution the status
    does not depend on ρ > 0, which only scales v to the size of R. The second result
    tells whether the node is far from the border between two statuses. On a border, for
    example where a load path reverses, rounding decides, and both statuses are right.
    """
    rho = np.abs(R).max() / np.abs(v).max()
    tau = R - rho * v
    n, t = tau[..., 0], np.linalg.norm(tau[..., 1:], axis=-1)
    bound = mu * np.maximum(n, 0.0)
    slips = (t > bound) | (mu == 0)
    # Tractions are right to 1e-8 in the mean; the error of a node may be ten times as large.
    near = 1e-7 * np.abs(tau).max()
    clear = (np.abs(n) > near) & ((n < 0) | (mu == 0) | (np.abs(t - bound) > near))
    return np.where(n <= 0, 0, np.where(slips, 1, 2)), clear


def nearest(points, wanted):
    """Index of the point at each wanted place; raises `ValueError` if one is missing."""
    distance, order = cKDTree(points).query(wanted)
    if distance.max() > 1e-9 * np.ptp(points):
        raise ValueError("the contact nodes differ from those of the reference")
    return order


def compare(run, reference):
    """Largest traction error of the load steps, and number of different statuses.

    The error of ``R / area`` in the L2 norm of the contact face, relative to the reference.
    """
    order = nearest(run.x, reference["x"])
    if run.R.shape != reference["R"].shape:
        raise ValueError(f"{run.R.shape} reactions for {reference['R'].shape}")
    weight = 1 / reference["area"][None, :, None]
    R, v, mu = run.R[:, order], run.v[:, order], reference["mu"]
    square = (weight * (R - reference["R"]) ** 2).sum(axis=(1, 2))
    error = np.sqrt(square / (weight * reference["R"] ** 2).sum(axis=(1, 2))).max()
    expected, clear = statuses(reference["R"], reference["v"], mu)
    computed_statuses, _ = statuses(R, v, mu)
    return float(error), int(((computed_statuses != expected) & clear).sum())
