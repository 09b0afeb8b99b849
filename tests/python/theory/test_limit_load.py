"""Limit loads of a body of soil: proofs by mechanisms, refusals, a strip footing."""

import math
import pickle

import bearing_capacity
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

from bipot_rs import fem
from bipot_rs.contact.errors import NoEquilibriumError, NotConvergedError
from bipot_rs.fem.bodies.elasticity import nodal_forces
from bipot_rs.mesh.boxes import box
from bipot_rs.mesh.elements import second_order
from bipot_rs.theory.limit_load import LimitLoadError, bound_load, find_mechanism
from bipot_rs.theory.soil_body import Soil
from bipot_rs.theory.soils import DruckerPrager
from bipot_rs.theory.structure import Structure
from bipot_rs.theory.structure_state import StepNotConvergedError
from support.rational import excludes_balance

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]
ALPHA, APEX = 0.5, 1.0


def sine(beta: float, alpha: float = ALPHA) -> float:
    """sin of the angle of friction in plane strain, of a flow with β."""
    return alpha * math.sqrt((1 - beta**2 / 6) / 2) / (1 - alpha * beta / 6)


def strength(beta: float) -> float:
    """Strength of plane compression without lateral pressure."""
    return 2 * APEX * sine(beta) / (1 - sine(beta))


def block(beta: float, *, unit: float = 1.0, dim: int = 2) -> tuple[Structure, Array]:
    """A block between smooth planes of symmetry, and a unit pressure on its top."""
    cell = "quadrilateral" if dim == 2 else "tetrahedron"
    mesh = second_order(
        box([np.linspace(0, 1, 5 - dim)] * dim, cell), serendipity=dim == 2
    )
    body = fem.Body("block", mesh, fem.Material(100.0 * unit, 0.3))
    x = body.points
    fixed = [dim * np.flatnonzero(x[:, k] == 0) + k for k in range(dim)]
    soil = DruckerPrager(ALPHA, beta, APEX * unit)
    block = Soil.of_body(body, law=soil)
    structure = Structure([], [block], None, np.concatenate(fixed))
    axis = -unit * np.eye(dim)[-1]
    return structure, nodal_forces(body, body.surface("top"), axis)


@pytest.mark.parametrize("unit", [1.0, 1e6])
@pytest.mark.parametrize("beta", [0.0, 0.5])
def test_mechanism_of_plane_compression(beta: float, unit: float) -> None:
    # The limit of the criterion is that of associated flow, whatever the flow.
    structure, load = block(beta, unit=unit)
    limit = strength(ALPHA)
    # On both sides of the closed form, by more than the 1e-6 of the search.
    assert find_mechanism(structure, (1 - 3e-6) * limit * load) is None
    d = find_mechanism(structure, (1 + 3e-6) * limit * load)
    assert np.abs(d).max() == 1.0
    assert not d[structure.fixed].any()
    # The proof, by the definitions.
    (points,) = structure.points
    strain = points.strains(d)
    volume, shear = strain[:, 0], np.linalg.norm(strain[:, 1:], axis=1)
    # Cones are met to 1e-9 of the size of the direction.
    assert (ALPHA * shear - volume).max() < 1e-8
    spent = np.sum(points.weights * APEX * unit * volume)
    assert (1 + 3e-6) * limit * load @ d > spent * (1 + 1e-6)


@pytest.mark.slow
def test_mechanism_in_space() -> None:
    structure, load = block(0.2, dim=3)
    # Compression without lateral pressure: √(2/3) q = α (a + q/3).
    limit = 3 * ALPHA * APEX / (math.sqrt(6) - ALPHA)
    assert find_mechanism(structure, (1 - 1e-5) * limit * load) is None
    assert find_mechanism(structure, (1 + 1e-5) * limit * load) is not None
    # Without a load there is nothing to prove.
    assert find_mechanism(structure, 0 * load) is None


@pytest.mark.parametrize("method", ["newton", "displacements"])
@pytest.mark.quick_variants("newton")
def test_a_load_above_the_limit_is_refused(method: str) -> None:
    structure, load = block(0.2)
    factors = np.array([0.5, 1.0, 1.2])[:, None]
    with pytest.raises(LimitLoadError, match="the load of step 2 is above") as caught:
        structure.solve(factors * load, method=method)
    error = caught.value
    assert isinstance(error, NoEquilibriumError)
    assert [step.converged for step in error.steps] == [True] * 2
    copy = pickle.loads(pickle.dumps(error))
    assert str(copy) == str(error)
    assert np.array_equal(copy.mechanism, error.mechanism)
    assert len(copy.steps) == 2


@pytest.mark.slow
def test_between_the_limits_nothing_is_proved() -> None:
    # Above the limit of the own flow, below that of associated flow.
    structure, load = block(0.2)
    between = 0.5 * (strength(0.2) + strength(ALPHA))
    assert strength(0.2) < 0.995 * strength(ALPHA)
    factors = np.array([0.9, 1.1, between])[:, None]
    with pytest.raises(
        StepNotConvergedError, match="step 2 did not converge"
    ) as caught:
        structure.solve(factors * load)
    error = caught.value
    assert isinstance(error, NotConvergedError)
    assert len(error.steps) == 2
    copy = pickle.loads(pickle.dumps(error))
    # The slips have grown, and with them the work that the imbalance is relative to.
    assert copy.last.imbalance == error.last.imbalance > 1e-7
    # The last iterate obeys the law: only equilibrium is missing.
    assert error.last.gap_soil < 1e-12
    # Associated flow carries this load.
    associated, load = block(ALPHA)
    assert associated.solve(factors * load)[-1].converged


def test_a_load_near_the_limit_is_carried() -> None:
    structure, load = block(0.2)
    factors = strength(0.2) * np.array([0.9, 0.99, 0.999])[:, None]
    steps = structure.solve(factors * load)
    settled = [-step.displacement[1::2].min() for step in steps]
    # The settlement grows without bound as the load approaches the limit.
    assert settled[2] > 2 * settled[1] > 4 * settled[0]


@pytest.mark.parametrize("cells", [3, pytest.param(6, marks=pytest.mark.slow)])
def test_ground_above_its_limit_is_refused_without_rounding(cells: int) -> None:
    """280 and 1,260 plastic points below a smooth footing, the friction angle 20 degrees."""
    ground, foot, places = bearing_capacity.footing(cells, 20.0, 0.0)
    # A pressure of 1 by Simpson's rule on sides of three nodes.
    sides = np.diff(places[foot[::2], 0])
    load = np.zeros(ground.n)
    for k, side in enumerate(sides):
        load[2 * foot[2 * k : 2 * k + 3] + 1] -= side * np.array([1, 4, 1]) / 6
    limit = bound_load(ground, load).upper
    # Displacement elements and proofs are above the closed form.
    assert 1 < limit / bearing_capacity.prandtl(20.0) < 1.03
    assert find_mechanism(ground, 0.99 * limit * load) is None
    (points,), free = ground.points, ground.free
    strain = sparse.csr_array(points.strain)[:, free]
    borne = strain.T @ (points.weights[:, None] * points.rest).ravel()
    for share in (1.001, 2.7):
        motion = find_mechanism(ground, share * limit * load)
        moved, beyond = motion[free], share * limit * load[free] - borne
        assert excludes_balance(strain, beyond, points.law.mu, moved, points.d)
        assert excludes_balance(ground.B[:, free], beyond, 0.0, moved, 2)
