"""Accuracy with a nearly incompressible K, where no other test has an exact solution.

In the plane, and with differences of stiffness, the stability studies compare with solutions
of many digits, and the verification with closed forms.
"""

from fractions import Fraction

import numpy as np
import pytest
import skfem
from skfem.models.elasticity import lame_parameters, linear_elasticity

import bipot_rs as bp
from support.bodies import block

EPS = float(np.finfo(float).eps)


@pytest.mark.parametrize("cells", [2, 4])
@pytest.mark.parametrize("nu", [0.3, 0.4999, 0.4999999])
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_a2_oedometer_in_space(mu: float, nu: float, cells: int) -> None:
    """Between smooth walls the shortening is p H / M, M = E (1 - ν)/((1 + ν)(1 - 2ν))."""
    body = block([1.0] * 3, [cells] * 3, 1.0, nu)
    walls = [body.dofs(k, end, k) for k in range(2) for end in (0.0, 1.0)]
    load = body.traction(2, 1.0, [0.0, 0.0, -1.0])
    fixed = np.unique(np.concatenate(walls))
    result = bp.solve(body.K, body.B, load, gap=body.gap, mu=mu, fixed=fixed)
    u = np.zeros(body.K.shape[0])
    modulus = (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    u[body.basis.nodal_dofs[-1]] = -body.basis.mesh.p[-1] / modulus
    r = np.outer(body.area, np.eye(3)[0])
    # Entries of K are as large as 1/(1 - 2ν). Their rounding, and that of the factor,
    # changes the problem to one with a slightly different ν.
    bound = 1e-12 + 2 * EPS / (1 - 2 * nu)
    assert np.abs(result.displacement[0] - u).max() <= bound * np.abs(u).max()
    assert np.abs(result.reaction[0] - r).max() <= bound * body.area.max()


@pytest.mark.parametrize("nu", [0.4999999, 0.5 - 1e-9, 0.5 - 1e-12])
@pytest.mark.parametrize(
    ("mu", "f_t"), [(0.3, 1.5), (0.3, -1.5), (0.3, 0.1), (0.0, 1.0), (0.45, 2.0)]
)
def test_h12_one_triangle(mu: float, f_t: float, nu: float) -> None:
    """The corner of a right triangle whose other nodes are held, in plane strain."""
    corners = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    mesh = skfem.MeshTri(corners, np.array([[0], [1], [2]]))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    K = linear_elasticity(*lame_parameters(1.0, nu)).assemble(basis).toarray()
    corner = basis.nodal_dofs[[1, 0], 0]
    K = K[np.ix_(corner, corner)]
    r = bp.solve(K, np.eye(2), np.array([-1.0, f_t]), gap=[0.0], mu=mu).reaction[0, 0]

    def slip(k_t: Fraction, k_c: Fraction) -> list[float]:
        limit = (1 if f_t > 0 else -1) * Fraction(mu)
        r_n = 1 + k_c * (Fraction(f_t) - limit) / (k_t + limit * k_c)
        return [float(r_n), float(-limit * r_n)]

    if abs(f_t) <= mu:
        np.testing.assert_allclose(r, [1.0, -f_t], rtol=1e-8)
        return
    # K is used as given; its closed form has no cancellation.
    exact = slip(Fraction(K[1, 1]), Fraction(K[0, 1]))
    np.testing.assert_allclose(r, exact, rtol=1e-8)
    # As ν → 1/2, K tends to ½ l_x l_y λ g gᵀ, g = -(1/l_x, 1/l_y), and k_t/k_c to
    # l_y/l_x = 2. The difference is 1 - 2ν times a coefficient of order one.
    limit = slip(Fraction(2), Fraction(1))
    np.testing.assert_allclose(r, limit, rtol=1e-8 + 10 * (1 - 2 * nu))
