"""A stiffness written with few digits: its rigid motions are restored, and only these.

The bound of all comparisons with the full stiffness: an entry written with D digits has
a relative error of at most τ = 10^(1-D)/2. Such errors e change the elastic energy by
at most ``|e|ᵀ |K| |e| τ``, once rigid motions cost nothing: a few τ for compressible
bodies, for any supports and in all units.
"""

import json
import pickle
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from skfem import MeshTet

import bipot_rs as bp
import bipot_rs._core as _core
from bipot_rs import fem
from support.comparisons import bits, refused
from support.contacts import rigid_rows
from support.matrix_and_tables import of_dofs, of_nodes

pytestmark = pytest.mark.needs_extra

Array = NDArray[np.float64]
EPS = float(np.finfo(np.float64).eps)
# Times τ: the energy above, and friction, through which errors of u change r.
CONDITION = 20.0
# Metres and newtons, millimetres and newtons, and an unusual system.
UNITS = {"m N": (1.0, 1.0), "mm N": (1e3, 1.0), "odd": (3e-7, 5e8)}


class Case(NamedTuple):
    """A block on a plane, loaded by its weight and by a pressing and pushing load on top."""

    K: Any
    B: Any
    gap: Array
    fixed: NDArray[np.int64]
    load: Array
    at: Array
    dim: int

    def problem(self, K: Any = None, **given: Any) -> bp.ContactProblem:
        given = {"coordinates": self.at, "fixed": self.fixed} | given
        K = self.K if K is None else K
        return bp.ContactProblem(K, self.B, gap=self.gap, mu=0.3, **given)


def written(K: Any, digits: int) -> Any:
    """K after its entries were written as text with that many significant digits."""
    K = sparse.csr_array(K, copy=True)
    K.data = np.array([float(f"{value:.{digits - 1}e}") for value in K.data])
    return K


def case(
    cell: str,
    held: bool,
    units: str = "m N",
    cells: int = 4,
    length: float = 1.5,
    nu: float = 0.3,
    degree: int = 1,
    weight: float = 0.5,
) -> Case:
    m, newton = UNITS[units]
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    across = np.linspace(0, 1, cells + 1) * m
    long = np.linspace(0, length, int(1.5 * cells) + 1) * m
    mesh = fem.box([long, *[across] * (dim - 1)], cell)
    if degree == 2:
        mesh = fem.second_order(mesh)
    body = fem.Body("it", mesh, fem.Material(7e4 * newton / m**2, nu))
    normal = np.eye(dim)[-1]
    contact = fem.Contact("it", "bottom", 0.3, plane=(0 * normal, normal))
    supports = [fem.Support("it", "left", range(dim))] if held else []
    model = fem.assemble([body], [contact], supports)
    push = np.zeros(dim)
    push[0], push[-1] = 0.1, -1.0
    load = model.traction("it", "top", newton / m**2 * push)
    load += model.body_force("it", -weight * newton / m**3 * normal)
    at = np.repeat(model.nodes, dim, axis=0)
    return Case(model.K, model.B, model.gap, model.fixed, load, at, dim)


def rigid(at: Array, dim: int, about: Array | None = None) -> Array:
    """Rigid motions about the middle or a point, for degrees of freedom node by node."""
    x = at[::dim] - (at.mean(axis=0) if about is None else about)
    return rigid_rows(x / np.abs(x).max(), np.eye(dim))


def used(problem: bp.ContactProblem) -> Any:
    """The stiffness that was condensed, with both triangles."""
    pointer, column, value = problem.stiffness.core.stiffness()
    low = sparse.tril(sparse.csr_array((value, column, pointer)))
    return sparse.csr_array(low + sparse.triu(low.T, 1))


def off(K: Any, Z: Array) -> float:
    """The largest entry of K Z relative to the sum of sizes in a row of K."""
    return float((np.abs(K @ Z) / np.asarray(abs(K).sum(axis=1)).reshape(-1, 1)).max())


def apart(found: Array, expected: Array) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def agree(given: Case, digits: int, left: int, condition: float) -> None:
    """Compare K of few digits, which leaves some rigid motions, with K."""
    tau = 0.5 * 10.0 ** (1 - digits)
    whole = given.problem()
    problem = given.problem(written(given.K, digits), stiffness_rtol=10.0**-digits)
    full, result = whole.solve(given.load), problem.solve(given.load)
    assert problem.stats["rigid_motions"] == whole.stats["rigid_motions"] == left
    assert 0 < problem.stats["rigid_motions_off"] <= 2 * tau
    # Where K has as many digits as its own rounding, 64 ε, this counts too.
    bound = condition * (tau + 64 * EPS)
    assert apart(result.displacement, full.displacement) <= bound
    off_r = apart(result.reaction, full.reaction)
    assert off_r <= bound
    estimate = result[0].error_estimate
    assert estimate is not None
    assert off_r <= 10 * estimate[0] + bound * EPS / tau
    assert estimate[0] <= bound
    if left == (3 if given.dim == 2 else 6):
        Z = rigid(given.at, given.dim)
        # The limit in Rust for K as fem assembles it: 64.
        assert off(used(problem), Z) <= 32 * EPS
        balance = Z.T @ (given.load + given.B.T @ result.reaction[0].ravel())
        # The tolerance of the residual.
        assert np.abs(balance).max() <= 1e-10 * np.abs(given.load).sum()


@pytest.mark.parametrize("digits", [6, 10])
def test_the_error_without_it_suggests_stiffness_rtol(digits: int) -> None:
    """Not if digits do not explain the error."""
    data = case("quadrilateral", False)
    K = written(data.K, digits)
    values = np.linalg.eigvalsh(K.toarray())
    assert values[0] < 0
    with refused("indefinite") as caught:
        data.problem(K, coordinates=None)
    message = str(caught.value)
    told = re.search(r"most negative eigenvalue is (\S+) of the largest", message)
    assert told
    assert float(told[1]) == pytest.approx(values[0] / values[-1], rel=0.1)
    offered = re.search(r"stiffness_rtol=(\S+), .* coordinates,", message)
    assert offered
    problem = data.problem(K, stiffness_rtol=float(offered[1]))
    assert problem.stats["rigid_motions"] == 3
    with refused(r"eigenvalue is -1\.0e\+00 of the") as caught:
        bp.ContactProblem(np.diag([1.0, -1.0]), np.eye(2), gap=[0.0], mu=0.3)
    assert "stiffness_rtol" not in str(caught.value)


def test_a_large_indefinite_stiffness() -> None:
    """Its eigenvalue is found without a full matrix."""
    data = case("quadrilateral", False, cells=36)
    assert data.K.shape[0] > 3000
    with refused(r"eigenvalue is -\d\.\de-(09|10|11) of .*1e-"):
        data.problem(written(data.K, 8), coordinates=None)


def condensed(K: Any, kept: NDArray[np.int64]) -> Array:
    """The stiffness of some degrees of freedom, the others without load."""
    K = K.toarray()
    rest = np.setdiff1d(np.arange(len(K)), kept)
    inside = np.linalg.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, kept)])
    S = K[np.ix_(kept, kept)] - K[np.ix_(kept, rest)] @ inside
    return (S + S.T) / 2


def with_energies(S: Array, energies: Array) -> Array:
    """S with other least eigenvalues, relative to the largest."""
    values, vectors = np.linalg.eigh(S)
    values[: len(energies)] = energies * values[-1]
    S = vectors * values @ vectors.T
    return (S + S.T) / 2


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
@pytest.mark.slow_variants("hexahedron")
def test_a_condensed_stiffness(cell: str) -> None:
    """A dense superelement whose rigid motions have negative eigenvalues beyond rounding."""
    data = case(cell, False, cells=3)
    kept = np.flatnonzero((data.load != 0) | (abs(data.B).sum(axis=0) > 0))
    kept = np.flatnonzero(
        np.isin(np.arange(len(data.load)) // data.dim, kept // data.dim)
    )
    m = 3 if data.dim == 2 else 6
    S = with_energies(condensed(data.K, kept), -3e-13 * np.linspace(1, 0.3, m))
    superelement = data._replace(
        K=S, B=data.B[:, kept], load=data.load[kept], at=data.at[kept]
    )
    with refused(r"eigenvalue is -\d\.\de-1\d .*stiffness_rtol"):
        superelement.problem(coordinates=None)
    problem = superelement.problem(stiffness_rtol=1e-12)
    assert problem.stats["rigid_motions"] == m
    # Rows of a full matrix sum to more than its eigenvalue.
    assert 0 < problem.stats["rigid_motions_off"] <= 1e-11
    assert off(used(problem), rigid(superelement.at, data.dim)) <= 16 * EPS
    # 1e-12 of the entries, times the condition of the block, some hundreds.
    full = data.problem().solve(data.load)
    result = problem.solve(superelement.load)
    if not np.delete(data.load, kept).any():
        assert apart(result.reaction, full.reaction) <= 1e-9


@pytest.mark.parametrize(
    "seed",
    [*range(6), *(pytest.param(s, marks=pytest.mark.slow) for s in range(6, 60))],
)
def test_the_rounding_of_condensed_stiffness_is_no_stiffness(seed: int) -> None:
    """A floating body, condensed by the caller: its rigid motions have any energy up to some
    4 n ε, of either sign."""
    rng = np.random.default_rng(seed)
    cell = str(rng.choice(["triangle", "quadrilateral", "tetrahedron", "hexahedron"]))
    units, cells = str(rng.choice(list(UNITS))), int(rng.integers(2, 4))
    length, nu = rng.uniform(0.8, 4.0), rng.uniform(0, 0.45)
    data = case(cell, False, units, cells, length, nu, weight=0.0)
    B = data.B.toarray()
    kept = np.flatnonzero(B.any(axis=0) | (data.load != 0))
    S, free = condensed(data.K, kept), 3 * (data.dim - 1)
    if seed % 2:
        # Below what the sums above leave, as another elimination might.
        S = with_energies(S, -EPS * rng.uniform(4, 26, free))
    problem = bp.ContactProblem(S, B[:, kept], gap=data.gap, mu=0.3)
    assert problem.stats["rigid_motions"] == free
    reaction = problem.solve(data.load[kept]).reaction
    # Condensing amplifies the rounding of K by its condition, some 1e4.
    assert apart(reaction, data.problem().solve(data.load).reaction) <= 1e-9


def frame(height: float, units: tuple[float, float]) -> tuple[Any, Array]:
    """A portal of beams in the plane, three degrees of freedom per node."""
    m, newton = units
    x = np.array([[0, 0], [0, 0.5], [0.1, 1], [1, 1.1], [1.2, 0]]) * m
    EA, EI = 2e8 * newton, 2e8 * newton * height**2 / 12 * m**2
    K = np.zeros((15, 15))
    for a in range(4):
        t = x[a + 1] - x[a]
        L = np.linalg.norm(t)
        c, s = t / L
        turn = np.kron(np.eye(2), [[c, s, 0], [-s, c, 0], [0, 0, 1]])
        k = np.zeros((6, 6))
        k[np.ix_([0, 3], [0, 3])] = EA / L * np.array([[1, -1], [-1, 1]])
        # Bending by forces and by moments at the ends.
        sway, bend = np.array([2, L, -2, L]), np.array([0, 1, 0, -1])
        k[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = (
            EI / L * (3 / L**2 * np.outer(sway, sway) + np.outer(bend, bend))
        )
        at = slice(3 * a, 3 * a + 6)
        K[at, at] += turn.T @ k @ turn
    return (K + K.T) / 2, np.repeat(x, 3, axis=0)


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("digits", [7, 10])
def test_nodes_with_rotations(units: str, digits: int) -> None:
    """A frame on two feet: beams mix forces and moments, which have different units."""
    K, at = frame(0.1, UNITS[units])
    load = np.zeros(15)
    load[[6, 7, 10]] = np.array([20.0, -100.0, -100.0]) * UNITS[units][1]
    given = {"B": np.eye(15)[[1, 0, 13, 12]], "gap": np.zeros(2), "mu": 0.8}
    full = bp.ContactProblem(K, **given, coordinates=at)
    some = bp.ContactProblem(
        written(K, digits), **given, coordinates=at, stiffness_rtol=10.0**-digits
    )
    assert full.stats["rigid_motions"] == some.stats["rigid_motions"] == 3
    expected, restored = full.solve(load), some.solve(load)
    # Axial and bending stiffness share entries and differ by a factor of 1200.
    tau = 1200 * 0.5 * 10.0 ** (1 - digits)
    assert apart(restored.reaction, expected.reaction) <= tau
    assert apart(restored.displacement, expected.displacement) <= tau


def test_bodies_with_nodes_at_the_same_points() -> None:
    """Two blocks, one on the other, with coincident nodes: each is restored separately."""
    g = np.linspace(0, 1, 4)
    bodies = [
        fem.Body(name, fem.box([g, g - low], "quadrilateral"), fem.Material(7e4, 0.3))
        for name, low in (("lower", 1), ("upper", 0))
    ]
    contact = fem.Contact("upper", "bottom", 0.3, against=("lower", "top"))
    ground = fem.Contact("lower", "bottom", 0.3, plane=((0, -1), (0, 1)))
    model = fem.assemble(bodies, [contact, ground])
    load = model.traction("upper", "top", [0.1, -1.0])
    at = np.repeat(model.nodes, 2, axis=0)
    data = Case(model.K, model.B, model.gap, model.fixed, load, at, 2)
    full, some = data.problem(), data.problem(written(model.K, 8), stiffness_rtol=1e-8)
    assert full.stats["rigid_motions"] == some.stats["rigid_motions"] == 6
    expected, restored = full.solve(load), some.solve(load)
    assert apart(restored.reaction, expected.reaction) <= 20 * CONDITION * 5e-8


@pytest.mark.parametrize(
    ("places", "d", "expected"),
    [
        ([[0, 0], [0, 0], [1, 0], [1, 0]], 2, [0, 1, 0, 1]),
        ([[0, 0], [1, 0], [0, 0], [1, 0]], 2, [0, 0, 1, 1]),
        ([[0, 0]] * 3 + [[1, 0]] * 3, 2, [0, 1, 5, 0, 1, 5]),
        ([[0, 0]] * 2 + [[1, 0]] * 2 + [[-0.0, 0]] * 2, 2, [0, 1, 0, 1, 0, 1]),
        ([[0, 0]] * 6 + [[1, 0]] * 3, 3, [0, 1, 2, 3, 4, 5, 0, 1, 2]),
        ([[0, 0]], 2, [-1]),
    ],
)
def test_directions_by_coordinates(places: Any, d: int, expected: list[int]) -> None:
    at = np.zeros((len(places), 3))
    at[:, :2] = places
    assert _core.dof_directions(at, d).tolist() == expected


@pytest.mark.parametrize("claimed", [9, 12])
def test_fewer_digits_than_given(claimed: int) -> None:
    data = case("quadrilateral", False)
    with refused("typically by") as caught:
        data.problem(written(data.K, 6), stiffness_rtol=10.0**-claimed)
    message = str(caught.value)
    told = re.search(r"typically by (\S+) of the", message)
    offered = re.search(r"give stiffness_rtol=([\de-]+)", message)
    assert told
    assert offered
    assert 1e-7 < float(told[1]) < 5e-6
    problem = data.problem(written(data.K, 6), stiffness_rtol=float(offered[1]))
    assert problem.stats["rigid_motions"] == 3


def test_wrong_coordinates() -> None:
    data, thirds = case("quadrilateral", False), case("quadrilateral", False, cells=3)
    alone = data.at.copy()
    alone[7, 0] += 0.1
    for given, at, said in (
        (data, np.roll(data.at, 2, axis=0), r"not for rotations.*check the numbering"),
        (data, alone, "of whole nodes: at the point of degree of freedom 6"),
        (data, data.at[:, ::-1], "and the axes"),
        (thirds, np.round(thirds.at, 5), "Give the coordinates with all digits"),
    ):
        with pytest.raises(ValueError, match=said):
            given.problem(written(given.K, 8), coordinates=at, stiffness_rtol=1e-8)


def test_an_asymmetric_stiffness() -> None:
    data = case("quadrilateral", False)
    K = data.K.tolil()
    K[0, 1] *= 1.01
    with refused("not symmetric"):
        data.problem(sparse.csr_array(K), stiffness_rtol=1e-8)
    with refused("lower triangle only"):
        data.problem(sparse.csr_array(sparse.tril(data.K)), stiffness_rtol=1e-8)
    # Each entry is rounded separately, from slightly different values.
    K = written(data.K, 8)
    K.data *= 1 + 1e-8 * np.sin(np.arange(K.nnz))
    assert data.problem(K, stiffness_rtol=1e-8).stats["rigid_motions"] == 3


def test_update_pickle_and_threads() -> None:
    data = case("quadrilateral", False)
    K, other = written(data.K, 8), written(2 * data.K, 8)
    problem, threaded = (
        data.problem(K, stiffness_rtol=1e-8, num_threads=k) for k in (1, 2)
    )
    first = problem.solve(data.load)
    again = pickle.loads(pickle.dumps(problem))
    for another in (again, threaded):
        assert bits(another.solve(data.load), first)
        assert another.stats["rigid_motions_off"] == problem.stats["rigid_motions_off"]
    problem.update(other)
    fresh = data.problem(other, stiffness_rtol=1e-8)
    assert bits(problem.solve(data.load), fresh.solve(data.load))
    with refused("typically by"):
        problem.update(written(data.K, 5))
    assert problem.stats["rigid_motions_off"] == fresh.stats["rigid_motions_off"]


def test_the_result_reports_the_error_of_K(tmp_path: Path) -> None:
    data = case("quadrilateral", False)
    problem = data.problem(written(data.K, 8), stiffness_rtol=1e-8)
    result = problem.solve(data.load)
    (remark,) = result.remarks
    assert "a relative error of 1e-08" in remark
    assert f"an error of {problem.stats['rigid_motions_off']:.1e}" in remark
    assert "relative error 1e-08" in str(result)
    assert result[0].error_estimate[0] >= 1e-8
    result.save(tmp_path / "it.h5")
    assert bp.load(tmp_path / "it.h5").remarks == (remark,)
    plain = data.problem().solve(data.load)
    assert plain.remarks == ()
    assert plain[0].error_estimate[0] < 1e-12
    assert "rigid_motions_off" not in data.problem().stats


def test_the_estimate_for_a_nearly_incompressible_body() -> None:
    """Entries have the size of λ, the energy that of μ: 1e4 times the error of the digits."""
    data = case("quadrilateral", True, nu=0.4999)
    full = data.problem().solve(data.load)
    result = data.problem(written(data.K, 8), stiffness_rtol=1e-8).solve(data.load)
    estimate = result[0].error_estimate
    assert estimate[1] > 1e-7
    assert apart(result.displacement, full.displacement) <= estimate[1] <= 1e-3


def test_the_command(tmp_path: Path, bipot: Any) -> None:
    data = case("quadrilateral", False)
    bottom = np.flatnonzero(data.at[::2, 1] == 0)
    K, digits = written(data.K, 8), ["--stiffness-rtol", "1e-8"]
    load = "dof,force\n" + "".join(
        f"{k},{f!r}\n" for k, f in enumerate(data.load.tolist()) if f
    )
    contacts = "".join(f"{2 * k},{2 * k + 1},0,1,0.3\n" for k in bottom)
    command = of_dofs(tmp_path, K, "dof_x,dof_y,nx,ny,mu\n" + contacts, load)
    status, _, errors = bipot(*command, *digits)
    assert status == 2
    assert "--stiffness-rtol needs --nodes" in errors
    command = of_nodes(K, data.at[::2], bottom, load)
    command += ["--out", "here", "--tol", "1e-12"]
    status, _, errors = bipot(*command)
    assert status == 2
    assert "stiffness_rtol" in errors
    status, output, _ = bipot(*command, *digits)
    assert status == 0
    assert "a relative error of 1e-08" in output
    _, output, _ = bipot(*command, *digits, "--json")
    assert 0 < json.loads(output.splitlines()[-1])["rigid_motions_off"] < 5e-8
    result = bp.load(tmp_path / "here" / "result.h5")
    full = data.problem().solve(data.load)
    assert apart(result.reaction, full.reaction) <= CONDITION * 5e-8


def random_case(rng: np.random.Generator) -> tuple[Case, int, int]:
    """A turned block with random cells, supports and units; digits; its rigid motions."""
    cell = str(rng.choice(["triangle", "quadrilateral", "tetrahedron", "hexahedron"]))
    cells = int(rng.integers(2, 5))
    units = str(rng.choice(list(UNITS)))
    length, nu = 10 ** rng.uniform(-0.5, 1.5), rng.uniform(0, 0.45)
    data = case(cell, False, units, cells, length, nu)
    d = data.dim
    turn = np.linalg.qr(rng.standard_normal((d, d)))[0]
    n = len(data.load)
    nodes = sparse.kron(sparse.eye_array(n // d), turn.T)
    K = sparse.csr_array(nodes @ data.K @ nodes.T)
    K = sparse.csr_array((K + K.T) / 2)
    away = data.at @ turn + rng.uniform(-5, 5, d) * np.ptp(data.at)
    turned = data._replace(
        K=K,
        B=sparse.csr_array(data.B @ nodes.T),
        load=nodes @ data.load,
        at=away,
    )
    left = 3 if d == 2 else 6
    held = int(rng.integers(0, 4))
    if held == 1:  # one node
        turned = turned._replace(fixed=np.arange(d))
        left = 1 if d == 2 else 3
    elif held == 2:  # a spring at one node, along its own direction
        way = rng.standard_normal(d)
        spring = K.diagonal().mean() * np.outer(way, way) / (way @ way)
        added = sparse.coo_array(
            (spring.ravel(), np.indices((d, d)).reshape(2, -1)), K.shape
        )
        turned = turned._replace(K=sparse.csr_array(K + added))
        left -= 1
    elif held == 3:  # one end
        ends = np.flatnonzero(data.at[::d, 0] == 0)
        turned = turned._replace(fixed=np.concatenate([d * ends + k for k in range(d)]))
        left = 0
    return turned, int(rng.integers(6, 13)), left


RANDOM = pytest.mark.parametrize("seed", range(520))


@RANDOM
@pytest.mark.quick_variants(*map(str, {*range(20)} - {10, 13, 15}))
def test_random_blocks(seed: int) -> None:
    data, digits, left = random_case(np.random.default_rng(seed))
    # Factors of the shape, of thirty and of springs: a long body bends.
    agree(data, digits, left, 20 * CONDITION)


def test_second_order() -> None:
    agree(case("quadrilateral", False, cells=2, degree=2), 8, 3, CONDITION)


@RANDOM
@pytest.mark.parametrize("fault", ["fewer digits", "other nodes"])
@pytest.mark.quick_variants(
    *(f"{f}-{k}" for f in ("fewer digits", "other nodes") for k in range(8))
)
def test_random_blocks_are_refused(fault: str, seed: int) -> None:
    """K with two or three digits less than stated; nodes with an offset or at random."""
    rng = np.random.default_rng((1000 if fault == "fewer digits" else 2000) + seed)
    data, digits, _ = random_case(rng)
    claimed = digits
    if fault == "fewer digits":
        digits = min(digits, 9)
        claimed = digits + int(rng.integers(2, 4))
    else:
        nodes = data.at[:: data.dim]
        order = np.roll(np.arange(len(nodes)), 1)
        order = rng.permutation(len(nodes)) if seed % 2 else order
        data = data._replace(at=np.repeat(nodes[order], data.dim, axis=0))
    with refused(r"coordinates|digits|stiffness_rtol"):
        data.problem(written(data.K, digits), stiffness_rtol=10.0**-claimed)


class Body(NamedTuple):
    """A stiffness, and the coordinates of its degrees of freedom, node by node."""

    K: Any
    at: Array

    def restore(self, K: Any, rtol: float) -> Any:
        """The restored stiffness. All degrees of freedom have contacts."""
        n, d = self.at.shape
        gap = np.zeros(n // d)
        problem = bp.ContactProblem(
            K, np.eye(n), gap=gap, mu=0.3, coordinates=self.at, stiffness_rtol=rtol
        )
        assert problem.stats["rigid_motions"] >= (3 if d == 2 else 6)
        return used(problem)


def random_body(rng: np.random.Generator, cell: str, nu: float, finer: int = 0) -> Body:
    """A box, or a cube whose tetrahedra were divided, often with moved nodes or turned.

    With ν = 0, many entries are the rounding of terms that cancel; where nodes are moved by
    little, whole sets of entries are small.
    """
    d = 2 if cell in ("triangle", "quadrilateral") else 3
    if cell == "divided":
        mesh: Any = MeshTet().refined(1 + finer)
    else:
        most = 4 + finer
        steps = [rng.uniform(0.5, 1.5, rng.integers(1, most)) for _ in range(d)]
        mesh = fem.box([np.concatenate([[0.0], np.cumsum(s)]) for s in steps], cell)
    points = mesh.doflocs * rng.uniform(0.3, 3.0, (d, 1))
    way = rng.integers(3)
    if way == 1:
        points += 10 ** rng.uniform(-9, -2) * rng.uniform(-1, 1, points.shape)
    elif way == 2:
        points = np.linalg.qr(rng.standard_normal((d, d)))[0] @ points
    body = fem.Body("it", type(mesh)(points, mesh.t), fem.Material(7e4, nu))
    model = fem.assemble([body], [])
    return Body(model.K, np.repeat(model.nodes, d, axis=0))


def disturbed(K: Any, digits: int, rng: np.random.Generator) -> Any:
    """K with errors of its last digit: written, or at random up to the limit."""
    if rng.integers(2):
        return written(K, digits)
    low = sparse.tril(K, format="csr")
    low.data *= 1 + 10.0**-digits * rng.uniform(-1, 1, low.nnz)
    return sparse.csr_array(low + sparse.tril(low, -1).T)


def least_change(K: Any, at: Array, rtol: float) -> tuple[Array, float]:
    """The least change of the entries of K in its lower triangle, by dense least squares.

    It is relative to the uncertainty of an entry: ``rtol`` of it, and 8 ε of the geometric
    mean of its two diagonals for the rounding of the assembly. Entries off the diagonal count
    twice. The second value is how much of it the rounding of K decides: it is larger where
    small entries alone balance a row.
    """
    n, d = at.shape
    full = K.toarray()
    roots = np.sqrt(np.diag(full))
    size = rtol * np.abs(full) + 8 * EPS * np.outer(roots, roots)
    row, column = np.nonzero(np.tril(full))
    weight = size[row, column] * np.where(row == column, 1.0, np.sqrt(0.5))
    equations, errors = [], []
    for i in range(n):
        other = np.where(row == i, column, np.where(column == i, row, -1))
        for z in rigid(at, d, at[i]).T:
            equations.append(np.where(other >= 0, z[other], 0.0) * weight)
            errors.append(full[i] @ z)
    G, b = np.array(equations), np.array(errors)
    norm = np.linalg.norm(G, axis=1)
    G, b = G[norm > 0] / norm[norm > 0, None], b[norm > 0] / norm[norm > 0]
    # Smaller singular values belong to the symmetry of Zᵀ K Z, which always holds.
    change, _, _, sizes = np.linalg.lstsq(G, -b, rcond=1e-10)
    out = np.zeros_like(full)
    out[row, column] = change
    return out, EPS / rtol / sizes[sizes > 1e-10 * sizes[0]].min()


CELLS = ["tetrahedron", "divided", "hexahedron", "triangle", "quadrilateral"]


def check_restored(seed: int, finer: int = 0) -> None:
    """A rounded stiffness is restored by the least change, within its digits."""
    rng = np.random.default_rng(seed)
    cell = CELLS[seed % len(CELLS)]
    body = random_body(rng, cell, float(rng.choice([0.0, 0.0, 0.3])), finer)
    digits = int(rng.integers(6, 9))
    rtol = 10.0**-digits
    K = disturbed(body.K, digits, rng)
    found = body.restore(K, rtol)
    # The limit of the core for a rigid motion is 64.
    assert off(found, rigid(body.at, body.at.shape[1])) <= 16 * EPS, seed
    roots = np.sqrt(K.diagonal())
    size = rtol * abs(K).toarray() + 8 * EPS * np.outer(roots, roots)
    moved = np.tril((found - K).toarray() / size)
    # A written digit is right to five units of rtol; entries share the errors of rows.
    assert np.abs(moved).max() <= 10, seed
    if K.shape[0] > 150:
        return
    moved *= np.sqrt(2) - (np.sqrt(2) - 1) * np.eye(len(moved))
    least, rounding = least_change(K, body.at, rtol)
    # LSQR leaves less than 1e-6; each row has a few roundings.
    bound = (1e-6 + 10 * rounding) * np.linalg.norm(least)
    assert np.linalg.norm(moved) <= np.linalg.norm(least) + bound, seed
    assert np.linalg.norm(moved - least) <= bound, seed


@pytest.mark.parametrize(
    "seeds",
    [
        *([k] for k in (0, 3, 4, 8, 9, 12, 13, 14, 18, 19)),
        pytest.param([16, *range(1000, 1300)], marks=pytest.mark.slow),
    ],
)
def test_restored_by_the_least_change(seeds: Sequence[int]) -> None:
    for seed in seeds:
        check_restored(seed, finer=seed % 2 if seed >= 1000 else 0)


@pytest.mark.parametrize("seed", range(8))
def test_a_wrong_small_entry(seed: int) -> None:
    """Its error hides below the digits of its row, but not below its own.

    A truss on a square with one diagonal. At the two other corners the bars are nearly along
    the axes, and only entries of 1e-4 couple x and y.
    """
    rng = np.random.default_rng(seed)
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    x += 1e-4 * rng.uniform(-1, 1, x.shape)
    K = np.zeros((8, 8))
    for a, b in [(0, 1), (2, 3), (0, 2), (1, 3), (0, 3)]:
        along = (x[b] - x[a]) / np.linalg.norm(x[b] - x[a])
        ends = np.zeros(8)
        ends[2 * a : 2 * a + 2], ends[2 * b : 2 * b + 2] = along, -along
        K += np.outer(ends, ends)
    it = Body(sparse.csr_array(K), np.repeat(x, 2, axis=0))
    assert off(it.restore(it.K, 1e-8), rigid(it.at, 2)) <= 16 * EPS
    K[3, 2] *= 1 + 1e-4
    K[2, 3] = K[3, 2]
    wrong = sparse.csr_array(K)
    with refused("must change by") as caught:
        it.restore(wrong, 1e-8)
    offered = re.search(r"give stiffness_rtol=([\de-]+)", str(caught.value))
    assert offered
    assert off(it.restore(wrong, float(offered[1])), rigid(it.at, 2)) <= 16 * EPS
