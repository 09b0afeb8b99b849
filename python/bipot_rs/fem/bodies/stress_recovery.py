"""Stress of a body from its displacement, and initial strains.

An initial strain, such as thermal expansion, is the strain that the material would have
without stress: ``σ = C : (ε(u) - ε0)``. It is given as a constant tensor ``(d, d)`` or
``(3, 3)``, as tensors at the quadrature points ``(d, d, cells, points)``, as a function of
the positions ``(d, cells, points)`` that returns one of these, or as a mapping from volume
names to such, zero elsewhere. In 2D a tensor ``(2, 2)`` has no strain out of the plane. In
plane strain this component causes stress, so thermal expansion must be a tensor
``(3, 3)``, as `thermal` returns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Floats, Ints
from bipot_rs._lib.validation import floats, shaped
from bipot_rs.fem.bodies.body import Body, Field
from bipot_rs.fem.bodies.elasticity import distinct_cells
from bipot_rs.fem.bodies.materials import elasticity
from bipot_rs.mesh.elements import inverse, jacobian

# The six components of a symmetric tensor in the order of VTK: xx, yy, zz, xy, yz, xz.
ROWS, COLUMNS = (0, 1, 2, 0, 1, 0), (0, 1, 2, 1, 2, 2)

Initial: TypeAlias = Field | Mapping[str, Field]


def stress(
    body: Body,
    displacement: ArrayLike,
    initial: Initial | None = None,
    *,
    space: bool = False,
) -> Floats:
    """Mean stress of each cell, ``(cells, d, d)`` [Pa].

    Parameters
    ----------
    displacement
        Displacement of the nodes of this body, ``(dim * nodes,)`` or ``(nodes, dim)`` [m].
    initial
        The initial strains that were applied as loads.
    space
        Whether to return ``(cells, 3, 3)`` in 2D too, with the stress out of the plane,
        which `von_mises` needs.
    """
    return MeanStress(body)(displacement, initial, space=space)


class MeanStress:
    """`stress` of one body, prepared once for many displacements.

    The material is constant in a cell, so that the mean stress is the stress of the mean
    strain: gradients are averaged once, without a displacement.

    ``body``: the body.
    ``cells``: the cells whose stress is wanted, ``(m,)``; the default is all. Initial strains
    need all.
    """

    def __init__(self, body: Body, cells: Ints | None = None) -> None:
        self.body = body
        self._cells = body.cells if cells is None else body.cells[cells]
        material = body.material_of_cells
        self._material = material if cells is None else material[cells]
        _, slopes, weights = body.kind.reference
        corners = body.points[self._cells]
        # Cells of a body of revolution differ by their radius.
        shapes, self._which = (
            (corners, np.arange(len(corners)))
            if body.axisymmetric
            else distinct_cells(corners)
        )
        inner, determinant = inverse(jacobian(shapes, slopes))
        share = weights[:, None] * np.abs(determinant)
        phi = body.kind.reference[0]
        r = np.einsum("pc,cq->qp", shapes[..., 0], phi)
        if body.axisymmetric:
            share *= r
        share /= share.sum(axis=0)
        # ∂_a φ_i, (i, a, shapes).
        self._slopes = np.einsum("qbi,qbac,qc->iac", slopes, inner, share)
        # φ_i / r, (i, cells).
        self._hoop = (
            np.einsum("iq,qp->ip", phi, share / r) if body.axisymmetric else None
        )

    def gradient(self, displacement: ArrayLike) -> Floats:
        """Mean of ``∂_a u_k`` in each cell, ``(k, a, cells)``."""
        u = _nodal(self.body, displacement)[self._cells]
        if self._slopes.shape[2] == 1:
            # Cells of one shape, as of a regular box, need no copy for each of them.
            gradients = np.einsum("ia,cik->kac", self._slopes[..., 0], u)
        else:
            gradients = np.einsum("iac,cik->kac", self._slopes[..., self._which], u)
        return np.asarray(gradients, np.float64)

    def __call__(
        self,
        displacement: ArrayLike,
        initial: Initial | None = None,
        *,
        space: bool = False,
    ) -> Floats:
        """As `stress`."""
        body = self.body
        d, gradient = body.dim, self.gradient(displacement)
        count = gradient.shape[2]
        strain = np.zeros((3, 3, count))
        strain[:d, :d] = 0.5 * (gradient + gradient.swapaxes(0, 1))
        if self._hoop is not None:
            radial = _nodal(body, displacement)[self._cells][..., 0]
            strain[2, 2] = np.einsum("ip,pi->p", self._hoop, radial)
        if initial is not None:
            weights = body.volume().weights
            share = weights / weights.sum(axis=1, keepdims=True)
            strain -= np.einsum("abcq,cq->abc", initial_strain(body, initial), share)
        six = np.empty((count, 6))
        for k, material in enumerate(body.materials):
            here = self._material == k
            law = elasticity(material, body.dim)[ROWS, COLUMNS][:, ROWS, COLUMNS]
            law[:, 3:] *= 2.0  # the mirrored component of a shear
            six[here] = np.einsum("st,tc->cs", law, strain[ROWS, COLUMNS][:, here])
        tensors = np.empty((count, 3, 3))
        tensors[:, ROWS, COLUMNS] = six
        tensors[:, COLUMNS, ROWS] = six
        return tensors if space else np.ascontiguousarray(tensors[:, :d, :d])


def stress_at_points(
    body: Body, displacement: ArrayLike, initial: Initial | None = None
) -> Floats:
    """Stress at the points of ``body.volume()``, ``(3, 3, cells, points)`` [Pa].

    Parameters as in `stress`.
    """
    gradient = gradient_at_points(body, _nodal(body, displacement))
    strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
    if initial is not None:
        strain -= initial_strain(body, initial)
    stresses = np.empty_like(strain)
    for k, material in enumerate(body.materials):
        here = body.material_of_cells == k
        law = elasticity(material, body.dim)
        stresses[:, :, here] = np.einsum("abcd,cdpq->abpq", law, strain[:, :, here])
    return stresses


def initial_strain(body: Body, initial: Initial) -> Floats:
    """Initial strain at the points of ``body.volume()``, ``(3, 3, cells, points)``."""
    places = body.volume().places
    strains = np.zeros((3, 3, *places.shape[1:]))
    if isinstance(initial, Mapping):
        covered = np.zeros(places.shape[1], dtype=np.bool_)
        for volume, value in initial.items():
            cells = body.volume_cells(volume)
            if covered[cells].any():
                raise ValueError(
                    f"initial strain of volume {volume!r} of body {body.name!r} covers "
                    "cells of another volume in the mapping: volumes must not overlap"
                )
            covered[cells] = True
            strains[:, :, cells] = _tensor(body, value, places[:, cells])
    else:
        strains[:] = _tensor(body, initial, places)
    return strains


def initial_forces(body: Body, initial: Initial) -> Floats:
    """Nodal forces ``(dim * nodes,)`` equivalent to an initial strain [N].

    ``∫ ∂_a φ_i σ0_ka`` with ``σ0 = C : ε0``, to be added to the load: K u minus these
    forces are the internal forces of ``σ = C : (ε(u) - ε0)``.
    """
    at_rest = np.zeros(body.points.size)
    return -internal_forces(body, stress_at_points(body, at_rest, initial))


def internal_forces(body: Body, stresses: Floats) -> Floats:
    """Nodal forces ``∫ ∂_a φ_i σ_ka``, ``(dim * nodes,)``, in equilibrium with stresses.

    ``stresses``: stresses at the points of ``body.volume()``, ``(3, 3, cells, points)``.
    """
    d = body.dim
    weights = body.depth * body.volume().weights
    cell = np.einsum(
        "qiap,kapq,pq->kpi", slopes_at_points(body), stresses[:d, :d], weights
    )
    if body.axisymmetric:
        cell[0] += np.einsum("pq,iqp->pi", stresses[2, 2] * weights, _over_radius(body))
    nodes, count = body.cells.ravel(), len(body.points)
    parts = [np.bincount(nodes, part.ravel(), minlength=count) for part in cell]
    return np.asarray(np.stack(parts, axis=1).ravel(), dtype=np.float64)


def thermal(
    expansion: ArrayLike,
    temperature: float | Callable[[Floats], ArrayLike],
    axes: ArrayLike | None = None,
) -> Field:
    """Initial strain of thermal expansion, ``(3, 3)`` or a function of the positions.

    Parameters
    ----------
    expansion
        Coefficient of thermal expansion [1/K], or one for each of the axes ``(3,)``.
    temperature
        Rise from the stress-free temperature [K], a number or a function of the positions
        ``(d, ...)`` that returns ``(...)``.
    axes
        Directions of the material as rows ``(3, 3)``, as ``material.directions``; default
        the coordinate axes.
    """
    alpha = shaped("expansion", expansion, (), (3,))
    rows = np.eye(3) if axes is None else floats("axes", axes, shape=(3, 3))
    unit = np.einsum("k,ki,kj->ij", np.broadcast_to(alpha, (3,)), rows, rows)
    if not callable(temperature):
        return np.asarray(unit * floats("temperature", temperature, shape=()))

    def strain(places: Floats) -> Floats:
        rise = floats("temperature", temperature(places))
        if rise.shape not in ((), places.shape[1:]):
            raise ValueError(
                f"temperature has shape {rise.shape}, expected {places.shape[1:]}"
            )
        whole = np.broadcast_to(rise, places.shape[1:])
        return np.asarray(np.multiply.outer(unit, whole), dtype=np.float64)

    return strain


def von_mises(stresses: ArrayLike) -> Floats:
    """Von Mises stress ``(...)`` of stresses ``(..., 3, 3)``."""
    tensors = floats("stresses", stresses)
    if tensors.shape[-2:] != (3, 3):
        raise ValueError(
            f"stresses has shape {tensors.shape}, expected (..., 3, 3): in 2D call stress "
            "with space=True, which includes the stress out of the plane"
        )
    trace = np.trace(tensors, axis1=-2, axis2=-1)[..., None, None]
    deviator = tensors - trace / 3 * np.eye(3)
    square = np.einsum("...ij,...ij->...", deviator, deviator)
    return np.asarray(np.sqrt(1.5 * square))


def _nodal(body: Body, displacement: ArrayLike) -> Floats:
    """Check a displacement, and give it the shape ``(nodes, d)``."""
    d, nodes = body.dim, len(body.points)
    nodal_values = floats("displacement", displacement)
    if nodal_values.shape not in ((d * nodes,), (nodes, d)):
        raise ValueError(
            f"displacement has shape {nodal_values.shape}, expected ({d * nodes},) or "
            f"({nodes}, {d}) for the nodes of body {body.name!r}"
        )
    return nodal_values.reshape(nodes, d)


def slopes_at_points(body: Body) -> Floats:
    """``∂_a φ_i`` at the points of the cells, ``(q, i, a, cells)``."""
    _, slopes, _ = body.kind.reference
    inner, _ = inverse(jacobian(body.points[body.cells], slopes))
    return np.asarray(np.einsum("qbi,qbac->qiac", slopes, inner), dtype=np.float64)


def gradient_at_points(
    body: Body, nodal: Floats, slopes: Floats | None = None
) -> Floats:
    """``∂_a u_k`` at the points of the cells, ``(3, 3, cells, points)``; hoop strain as 33.

    ``nodal``: displacement ``(nodes, d)``. ``slopes``: `slopes_at_points`, if known.
    """
    slopes = slopes_at_points(body) if slopes is None else slopes
    d, u = body.dim, nodal[body.cells]
    gradient = np.zeros((3, 3, slopes.shape[3], slopes.shape[0]))
    gradient[:d, :d] = np.einsum("qiap,pik->kapq", slopes, u)
    if body.axisymmetric:
        gradient[2, 2] = np.einsum("iqp,pi->pq", _over_radius(body), u[..., 0])
    return gradient


def _over_radius(body: Body) -> Floats:
    """``φ_i / r`` at the points of the cells, ``(i, q, cells)``."""
    phi = body.kind.reference[0]
    return np.asarray(phi[..., None] / body.volume().places[0].T)


def _tensor(body: Body, value: Field, places: Floats) -> Floats:
    what = f"initial strain of body {body.name!r}"
    value_given = floats(what, value(places) if callable(value) else value)
    d = value_given.shape[0] if value_given.ndim else 0
    shapes = [(k, k, *rest) for k in {body.dim, 3} for rest in ((), places.shape[1:])]
    if value_given.shape not in shapes:
        raise ValueError(
            f"{what} has shape {value_given.shape}, expected ({body.dim}, {body.dim}) or "
            f"(3, 3), followed by {places.shape[1:]} if it varies"
        )
    size = np.abs(value_given).max()
    if np.abs(value_given - value_given.swapaxes(0, 1)).max() > 1e-12 * size:
        raise ValueError(f"{what} is not symmetric")
    if value_given.ndim == 2:
        value_given = value_given[:, :, None, None]
    tensors = np.zeros((3, 3, *places.shape[1:]))
    tensors[:d, :d] = value_given
    if body.dim == 2 and (tensors[:2, 2].any()):
        raise ValueError(f"{what} has shear out of the plane, expected zeros there")
    return tensors
