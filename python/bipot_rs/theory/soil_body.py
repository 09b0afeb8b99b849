"""A body of soil: its mesh, its elasticity, and the plastic points of its quadrature.

Strains and stresses of fields are vectors of six components, as `soils.mandel` makes them.
Cells are of second order with reduced quadrature: quadrilaterals of 8 nodes with 2 × 2
points, hexahedra of 20 nodes with 2 × 2 × 2, triangles of 6 nodes with 3 points and
tetrahedra of 10 nodes with 4.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import CsrMatrix, Floats
from bipot_rs._lib.validation import floats, integers, number, shaped
from bipot_rs.fem.bodies.body import Body, Field, Quadrature
from bipot_rs.fem.bodies.elasticity import nodal_forces
from bipot_rs.fem.bodies.materials import Material
from bipot_rs.mesh.elements import inverse, jacobian, make_mesh
from bipot_rs.mesh.kinds import reference_of
from bipot_rs.theory.points import PlasticPoints, check_ratio
from bipot_rs.theory.soils import DruckerPrager, mandel

LAWS = ("mohr-coulomb", "drucker-prager")
# Without friction the apex is this many cohesions above zero: a mean tension beyond is
# refused after the step. A larger number would only cost digits.
_FAR = 1000.0
# Cells by their space and number of nodes.
_CELLS = {
    (2, 6): "triangle6",
    (2, 8): "quad8",
    (3, 10): "tetra10",
    (3, 20): "hexahedron20",
}
# Rows of `PlasticPoints.components`: the volume strain, then minus the deviator.
_PLANE_COULOMB = np.array(
    [[1.0, 1, 0, 0, 0, 0], [-1, 1, 0, 0, 0, 0], [0, 0, 0, 0, 0, -math.sqrt(2)]]
)
_SPACE = -np.array(
    [
        [-1.0, -1, -1, 0, 0, 0],
        [1 / math.sqrt(2), -1 / math.sqrt(2), 0, 0, 0, 0],
        [1 / math.sqrt(6), 1 / math.sqrt(6), -2 / math.sqrt(6), 0, 0, 0],
        *np.eye(6)[3:],
    ]
)


class Soil:
    """An elastic body with the flow of Mohr and Coulomb or of Drucker and Prager.

    Parameters
    ----------
    points, cells
        Nodes ``(nodes, d)`` [m], and those of each cell in the order of VTK. The nodes are
        numbered as in ``body.points``.
    E, nu
        Young's modulus [Pa] and Poisson's ratio.
    phi, psi
        Angles of friction and of dilatancy, ``0 <= psi <= phi < 90`` [degrees].
    cohesion
        c >= 0 [Pa]; positive without friction.
    weight
        Weight per volume, along the last axis downwards [N/m³].
    law
        ``"mohr-coulomb"``, in plane strain only, where the stress across the plane must
        stay the intermediate one; or ``"drucker-prager"``, whose cone has the limit states
        of these angles in plane strain, and in space contains the compressive edges of the
        pyramid. Or a `soils.DruckerPrager`, which has the numbers of the angles.

    Attributes
    ----------
    body
        Mesh and elasticity, a `fem.Body`, as `fem.assemble` takes it.
    quadrature
        The points, with their positions and weights.

    Raises
    ------
    TypeError, ValueError
        A wrong argument; linear cells.
    """

    def __init__(
        self,
        points: ArrayLike,
        cells: ArrayLike,
        E: float,
        nu: float,
        phi: float | None = None,
        psi: float | None = None,
        cohesion: float = 0.0,
        weight: float = 0.0,
        law: str | DruckerPrager = "mohr-coulomb",
    ) -> None:
        x, corners = floats("points", points, ndim=2), integers("cells", cells)
        vtk = _CELLS.get((x.shape[1], corners.shape[-1]))
        if vtk is None:
            raise ValueError(_describe_cells(x.shape[1], corners.shape[-1]))
        if not len(corners):
            raise ValueError("cells is empty, expected one cell or more")
        if corners.min() < 0 or corners.max() >= len(x):
            raise ValueError(
                f"cells has nodes from {corners.min()} to {corners.max()}, expected 0 to "
                f"{len(x) - 1}, rows of points"
            )
        mesh, _ = make_mesh(vtk, x, corners.astype(np.int64))
        self._fill(Body("soil", mesh, Material(E, nu)), phi, psi, cohesion, weight, law)

    @classmethod
    def of_body(
        cls,
        body: Body,
        phi: float | None = None,
        psi: float | None = None,
        cohesion: float = 0.0,
        weight: float = 0.0,
        law: str | DruckerPrager = "mohr-coulomb",
    ) -> Soil:
        """The soil with the mesh, names and elasticity of a body of isotropic materials."""
        if not isinstance(body, Body):
            raise make_type_error("body", body, "a bipot_rs.fem.Body")
        soil = cls.__new__(cls)
        soil._fill(body, phi, psi, cohesion, weight, law)
        return soil

    def _fill(
        self,
        body: Body,
        phi: float | None,
        psi: float | None,
        cohesion: float,
        weight: float,
        law: str | DruckerPrager,
    ) -> None:
        if body.kind.vtk not in _CELLS.values():
            raise ValueError(_describe_cells(body.dim, body.cells.shape[1], body.name))
        self.body, x = body, body.points[body.cells]
        shape, slopes, weights = reference_of(body.kind.shape, body.kind.of_cell, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            inner, volumes = inverse(jacobian(x, slopes))
        folded = np.flatnonzero((volumes * volumes[0] <= 0).any(axis=0))
        if len(folded):
            raise ValueError(
                f"cell {folded[0]} of body {body.name!r} is folded or flat, expected nodes in "
                "the order of VTK, and those between corners near the middle of their sides"
            )
        # Of the shape functions, (cells, points, corners, d).
        self._gradients = np.einsum("qbi,qbac->cqia", slopes, inner)
        self.quadrature = Quadrature(
            corners=body.cells,
            phi=shape,
            places=np.einsum("pcd,cq->dpq", x, shape),
            weights=(weights[:, None] * np.abs(volumes)).T,
            normals=None,
            nodes=len(body.points),
        )
        self._moduli = _moduli(body)
        self._weight = number("weight", weight)
        if not math.isfinite(self._weight):
            raise ValueError(f"weight is {weight}, expected a finite number")
        self._plane = False
        if isinstance(law, DruckerPrager):
            if phi is not None or psi is not None or cohesion:
                raise ValueError(
                    "phi, psi and cohesion are given with a DruckerPrager, whose numbers "
                    "are in their place: leave them out"
                )
            numbers = law.friction, law.dilatancy, 0.0, law.apex
        else:
            numbers = self._read_angles(phi, psi, cohesion, law)
        self.mu, self.dilatancy, self.cohesion, self.apex = numbers

    def _read_angles(
        self, phi: float | None, psi: float | None, cohesion: float, law: object
    ) -> tuple[float, float, float, float]:
        """μ, β, c and a of the points."""
        if law not in LAWS:
            raise ValueError(
                f"law is {law!r}, expected {', '.join(map(repr, LAWS))} or a DruckerPrager"
            )
        if phi is None or psi is None:
            raise ValueError("phi or psi is missing: give both angles in degrees")
        friction = check_ratio("phi", phi, 0.0, 90.0)
        dilatancy = number("psi", psi)
        if not 0 <= dilatancy <= friction:
            raise ValueError(f"psi is {psi}, expected 0 to {phi} (phi)")
        c = number("cohesion", cohesion)
        if not (c >= 0 and math.isfinite(c)) or c == friction == 0:
            raise ValueError(
                f"cohesion is {cohesion}, expected zero or positive, and positive where phi "
                "is 0"
            )
        angle, sine = math.radians(friction), math.sin(math.radians(friction))
        beta = math.sin(math.radians(dilatancy))
        self._plane = law == "mohr-coulomb"
        if self._plane and self.body.dim == 3:
            raise ValueError(
                "law is 'mohr-coulomb' in space, expected 'drucker-prager': the edges of "
                "its pyramid are not the law of a contact"
            )
        a = c / math.tan(angle) if friction else _FAR * c
        if self._plane:
            return (sine, beta, 0.0, a) if friction else (0.0, 0.0, c, a)
        if self.body.dim == 2:
            # The flow in plane strain dilates by ψ, and its limit states have φ.
            beta = math.sqrt(2 * beta**2 / (1 + beta**2 / 3))
            root = math.sqrt((1 - beta**2 / 6) / 2)
            # Associated flow is associated to the last bit.
            same = dilatancy == friction
            alpha = beta if same else sine / (root + sine * beta / 6)
            shear = math.sqrt(2) * c
        else:
            alpha = 2 * math.sqrt(6) * sine / (3 - sine)
            beta = 2 * math.sqrt(6) * beta / (3 - beta)
            shear = math.sqrt(8 / 3) * c
        return (alpha, beta, 0.0, a) if friction else (0.0, 0.0, shear, a)

    @property
    def load(self) -> Floats:
        """Nodal forces of the weight, ``(d nodes,)`` [N]."""
        down = -self._weight * np.eye(self.body.dim)[-1]
        return nodal_forces(self.body, self.quadrature, down)

    def make_points(self, n: int, first: int) -> PlasticPoints:
        """The points in a structure of ``n`` degrees of freedom, its own from ``first`` on."""
        body, weights = self.body, self.body.depth * self.quadrature.weights
        bulk, shear = np.repeat(self._moduli, weights.shape[1], axis=1)
        poisson = (3 * bulk - 2 * shear) / (2 * (3 * bulk + shear))
        plane, space = self._plane, body.dim == 3
        if plane:
            X, springs = _PLANE_COULOMB, [bulk + shear / 3, shear]
        else:
            X = _SPACE if space else _SPACE[[0, 1, 2, 5]]
            springs = [bulk, 2 * shear]
        return PlasticPoints(
            self._strain_matrix(X, n, first),
            weights.ravel(),
            np.column_stack(springs),
            mu=self.mu,
            dilatancy=self.dilatancy,
            cohesion=self.cohesion,
            apex=self.apex,
            components=X,
            poisson=poisson if plane else None,
            shape=weights.shape,
        )

    def _strain_matrix(self, X: Floats, n: int, first: int) -> CsrMatrix:
        """``X ε`` at the points of the displacements of nodes, CSR ``(d m, n)``."""
        body, gradients = self.body, self._gradients
        dim, d = body.dim, len(X)
        cells, q, corners, _ = gradients.shape
        # Gradient ∂_a u_k of unit displacements: (cells, q, corner, component, a, k).
        gradient = np.zeros((cells, q, corners, dim, 3, 3))
        for k in range(dim):
            gradient[:, :, :, k, :dim, k] = gradients
        strain = mandel(0.5 * (gradient + gradient.swapaxes(-1, -2))) @ X.T
        dofs = first + dim * body.cells[:, None, :, None] + np.arange(dim)
        rows = d * np.arange(cells * q).reshape(cells, q, 1, 1, 1) + np.arange(d)
        matrix: CsrMatrix = sparse.coo_array(
            (
                strain.ravel(),
                (
                    np.broadcast_to(rows, strain.shape).ravel(),
                    np.broadcast_to(dofs[..., None], strain.shape).ravel(),
                ),
            ),
            shape=(d * cells * q, n),
        ).tocsr()
        matrix.eliminate_zeros()
        return matrix

    def read_stress(self, stress: Field) -> Floats:
        """Stresses of a state, ``(cells, points, 6)``.

        Parameters
        ----------
        stress
            A constant tensor ``(3, 3)``, tensors ``(3, 3, cells, points)``, a function of
            the positions ``(d, cells, points)`` that returns one of these, or the vectors
            of a state [Pa].
        """
        places = self.quadrature.places
        shape = places.shape[1:]
        given = stress(places) if callable(stress) else stress
        tensors = shaped("stress", given, (3, 3), (3, 3, *shape), (*shape, 6))
        if tensors.shape == (*shape, 6):
            return tensors
        skew = tensors - tensors.swapaxes(0, 1)
        if np.abs(skew).max() > 1e-12 * np.abs(tensors).max():
            raise ValueError("stress is not symmetric, expected symmetric tensors")
        if tensors.ndim == 2:
            tensors = tensors[..., None, None]
        vectors = mandel(np.moveaxis(tensors, (0, 1), (-2, -1)))
        return np.array(np.broadcast_to(vectors, (*shape, 6)))


def _describe_cells(dim: int, nodes: int, name: str = "soil") -> str:
    """The message about cells that a soil does not take."""
    linear = nodes <= 2**dim
    reason = (
        "linear cells lock, because the flow prescribes their volume strain"
        if linear
        else "other cells have motions that their reduced quadrature does not strain"
    )
    return (
        f"body {name!r} has cells of {nodes} nodes in {dim}D, expected 6 or 8 nodes in 2D, 10 "
        f"or 20 in 3D: {reason}"
    )


def _moduli(body: Body) -> Floats:
    """Bulk and shear modulus of each cell, ``(2, cells)``."""
    pairs = []
    for material in body.materials:
        if not isinstance(material, Material):
            raise ValueError(
                f"body {body.name!r} has an orthotropic material, expected isotropic ones"
            )
        if body.dim == 2 and (material.plane_stress or material.axisymmetric):
            raise ValueError(
                f"body {body.name!r} is in plane stress or axisymmetric, expected plane strain "
                "or 3D"
            )
        lame_lambda, lame_mu = material.lame(3)
        pairs.append((lame_lambda + 2 * lame_mu / 3, lame_mu))
    return np.array(pairs)[body.material_of_cells].T
