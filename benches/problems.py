"""Seeded sets of reduced problems; a seed always gives the same numbers.

`SETS` maps the name of a set to a function of the seed; the tables use seeds 0 to 149. Six
sets are random: elastic blocks whose top is prescribed (``held``), two blocks pressed
together (``two bodies``), blocks on one foundation (``islands``), blocks that only contact
holds (``floating``), symmetric positive definite matrices without a body (``random``), and
assemblies of rigid bodies, whose W does not have full rank (``rigid``). ``scenes`` are the
last two load steps of the shipped scenes, numbered.

Condensed blocks are stored in the folder named by BIPOT_CACHE, by default a folder in the
system's folder for temporary files.
"""

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """``v = W r + R a + q`` and ``Rᵀ r + e = 0`` with Coulomb's law, normal first.

    Attributes
    ----------
    name
        Set, seed and random choices.
    W, q, mu
        Compliance ``(d n_c, d n_c)``, free gap ``(n_c, d)``, friction ``(n_c,)``.
    rigid
        ``(R (d n_c, k), e (k,))`` of bodies that only contact holds, or ``None``.
    full_rank
        Whether W determines r; if not, only v is compared.
    """

    name: str
    W: Array
    q: Array
    mu: Array
    rigid: tuple[Array, Array] | None = None
    full_rank: bool = True


def folder() -> Path:
    """Folder of the stored condensed blocks."""
    default = Path(tempfile.gettempdir()) / "bipot_bench_problems"
    return Path(os.environ.get("BIPOT_CACHE", default))


def block(
    dim: int, n: int, poisson: float, *, height: float = 1.0, held: bool = True
) -> dict[str, Array]:
    """Unit block in `dim` dimensions, condensed onto the `n` nodes per side of its base.

    Young's modulus is 1; the height of the layers of cells grows by 1.6 from the base up.

    Returns
    -------
    W, x, and U0 or R, f
        Compliance; positions of the contacts ``(n_c, dim - 1)``; then for a held block
        the free gap ``(d n_c, dim)`` due to unit displacements ``n, t1[, t2]`` of its top;
        for a free block its rigid motions and the condensed loads ``(d n_c, 3)``: weight,
        pressure and shear of the top.
    """
    layers = 8 if dim == 2 else 5
    name = f"fe_{dim}_{n}_{poisson}_{layers}_{height}_{int(held)}.npz"
    path = folder() / name
    if not path.exists():
        made = _condense(dim, n, poisson, layers, height, held=held)
        path.parent.mkdir(parents=True, exist_ok=True)
        # Replaced in one step, because another process may read it.
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            np.savez(file, **made)
        Path(file.name).replace(path)
    with np.load(path) as stored:
        return dict(stored)


def _condense(
    dim: int, n: int, poisson: float, layers: int, height: float, *, held: bool
) -> dict[str, Array]:
    import skfem
    from scipy import sparse
    from scipy.sparse.linalg import splu
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    z = np.cumsum(np.r_[0, 1.6 ** np.arange(layers)])
    z = z / z[-1] * height
    x = np.linspace(0, 1, n)
    if dim == 2:
        mesh, element = skfem.MeshQuad.init_tensor(x, z), skfem.ElementQuad1()
    else:
        mesh, element = skfem.MeshHex.init_tensor(x, x, z), skfem.ElementHex1()
    basis = skfem.Basis(mesh, skfem.ElementVector(element))
    K = skfem.asm(linear_elasticity(*lame_parameters(1.0, poisson)), basis).tocsc()
    K = (K + K.T) / 2
    base = np.flatnonzero(mesh.p[-1] < 1e-9)
    base = base[np.lexsort(mesh.p[:-1, base])]
    order = [dim - 1, *range(dim - 1)]  # normal first, upwards
    contact = basis.nodal_dofs[np.ix_(order, base)].T.ravel()
    places = mesh.p[:-1][:, base].T

    def factor(A):
        options = {"SymmetricMode": True}
        return splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", options=options)

    if held:
        top = np.flatnonzero(mesh.p[-1] > height - 1e-9)
        fixed = basis.nodal_dofs[:, top].ravel()
        free = np.setdiff1d(np.arange(K.shape[0]), fixed)
        unit = np.zeros((K.shape[0], dim))
        for case, k in enumerate(order):
            unit[basis.nodal_dofs[k, top], case] = 1
        lu = factor(K[free][:, free])
        at = np.searchsorted(free, contact)
        W = compliance_by_solves(lu, at)
        U0 = lu.solve(-(K[free] @ unit))[at]
        return {"W": (W + W.T) / 2, "U0": U0, "x": places}

    # Unit springs on the contact nodes make K regular; they are subtracted from S.
    m = len(contact)
    springs = sparse.csc_matrix((np.ones(m), (contact, contact)), shape=K.shape)
    lu = factor(K + springs)
    force = np.zeros((K.shape[0], m))
    force[contact, np.arange(m)] = 1
    W = lu.solve(force)[contact]
    S = np.linalg.inv((W + W.T) / 2) - np.eye(m)
    S = (S + S.T) / 2
    R = _rigid_motions(mesh.p[:, base])
    gravity = skfem.LinearForm(lambda v, _: -v[dim - 1])
    shear = skfem.LinearForm(lambda v, _: v[0])
    facets = mesh.facets_satisfying(lambda x: np.isclose(x[-1], height))
    top = skfem.FacetBasis(mesh, skfem.ElementVector(element), facets=facets)
    assembled = [(gravity, basis), (gravity, top), (shear, top)]
    loads = np.column_stack([skfem.asm(form, on) for form, on in assembled])
    f = (S + np.eye(m)) @ lu.solve(loads)[contact]
    alpha = np.trace(S) / m
    W = np.linalg.inv(S + alpha * R @ R.T)
    return {"W": (W + W.T) / 2, "S": S, "R": R, "f": f, "x": places}


def compliance_by_solves(lu: Any, at: NDArray[np.int64]) -> Array:
    """Rows and columns ``at`` of the inverse of a factorised matrix, by blocks of solves."""
    W = np.empty((len(at), len(at)))
    for first in range(0, len(at), 256):
        columns = slice(first, min(first + 256, len(at)))
        force = np.zeros((lu.shape[0], len(at[columns])))
        force[at[columns], np.arange(force.shape[1])] = 1
        W[:, columns] = lu.solve(force)[at]
    return W


def _rigid_motions(x: Array) -> Array:
    """Orthonormal rigid motions at nodes `x (dim, n_c)`, normal (last axis) first."""
    dim, nodes = x.shape
    R = np.zeros((nodes, dim, 3 if dim == 2 else 6))
    R[:, range(dim), range(dim)] = 1
    R[:, 0, dim] = x[0] - 0.5
    R[:, 1, dim] = -x[-1]
    if dim == 3:
        R[:, 0, 4], R[:, 2, 4] = x[1] - 0.5, -x[2]
        R[:, 1, 5], R[:, 2, 5] = -(x[1] - 0.5), x[0] - 0.5
    return np.linalg.qr(R.reshape(nodes * dim, -1))[0]


def _gap(x: Array, kind: str, rng: np.random.Generator, height: float) -> Array:
    """Normal gaps at positions `x`; with ``graze`` half of the face touches to 1e-9."""
    if kind == "hertz":
        return height * 4 * ((x - 0.5) ** 2).sum(1)
    if kind == "rough":
        return height * rng.random(len(x))
    if kind == "wave":
        return height * 0.5 * (1 - np.prod(np.cos(6 * np.pi * x), axis=1))
    if kind == "graze":
        return height * (x[:, 0] > 0.5) * (1 + 1e-9 * rng.standard_normal(len(x)))
    return np.zeros(len(x))


def _push(dim: int, press: float, shear: float, angle: float) -> Array:
    """Displacement of the top in components ``n, t1[, t2]``."""
    return np.r_[-press, shear * np.cos(angle), shear * np.sin(angle)][:dim]


def held(seed: int) -> Problem:
    """Block with prescribed top, pressed and sheared in one step."""
    rng = np.random.default_rng(seed)
    dim = int(rng.integers(2, 4))
    n = int(rng.choice([20, 60, 150] if dim == 2 else [6, 10, 14]))
    poisson = float(rng.choice([0.3, 0.3, 0.4999]))
    body = block(dim, n, poisson)
    mu = float(rng.choice([0.0, 0.1, 0.3, 0.6, 1.0, 1.5, 2.0]))
    kind = str(rng.choice(["flat", "hertz", "rough", "wave", "graze"]))
    press = 10 ** rng.uniform(-3, -1.5)
    height = press * 10 ** rng.uniform(-1, 1)
    shear, angle = press * rng.uniform(0, 3), rng.uniform(0, 2 * np.pi)
    q = body["U0"] @ _push(dim, press, shear, angle)
    q[::dim] += _gap(body["x"], kind, rng, press if kind == "graze" else height)
    nodes = len(body["x"])
    friction = np.full(nodes, mu)
    if rng.random() >= 0.7:
        friction = mu * rng.uniform(0.2, 1.8, nodes)
    young = 10 ** rng.choice([0.0, 0.0, 11.0])
    name = f"held {seed}: d {dim}, n {n}, nu {poisson}, mu {mu}, {kind}, E {young:.0e}"
    return Problem(name, body["W"] / young, q.reshape(-1, dim), friction)


def two_bodies(seed: int) -> Problem:
    """Block on another with matching nodes; the ratio of their moduli is up to 1e8."""
    rng = np.random.default_rng(seed)
    dim = int(rng.integers(2, 4))
    n = int(rng.choice([20, 60] if dim == 2 else [6, 10]))
    upper = block(dim, n, 0.3)
    lower = block(dim, n, float(rng.choice([0.3, 0.4999])), height=0.5)
    ratio = 10 ** rng.uniform(-8, 8)
    press = 10 ** rng.uniform(-3, -1.5)
    angle = rng.uniform(0, 2 * np.pi)
    shear = press * rng.uniform(0, 3)
    mu = float(rng.choice([0.1, 0.3, 0.6, 1.0, 2.0]))
    q = upper["U0"] @ _push(dim, press, shear, angle)
    kind = str(rng.choice(["flat", "hertz", "rough"]))
    q[::dim] += _gap(upper["x"], kind, rng, press * rng.uniform(0.1, 2))
    W = upper["W"] + _mirrored(lower["W"], dim) / ratio
    name = f"two bodies {seed}: d {dim}, n {n}, ratio {ratio:.0e}, mu {mu}"
    return Problem(name, W, q.reshape(-1, dim), np.full(len(upper["x"]), mu))


def _mirrored(W: Array, dim: int) -> Array:
    """Compliance of the body turned upside down, below the contacts."""
    flip = np.tile(np.r_[-1.0, np.ones(dim - 1)], len(W) // dim)
    return W * flip[:, None] * flip[None, :]


def islands(seed: int) -> Problem:
    """Soft and stiff block, up to 1e8 apart, on one elastic foundation."""
    rng = np.random.default_rng(seed)
    n = int(rng.choice([20, 40]))
    island, ground = block(2, n, 0.3), block(2, 2 * n, 0.3, height=0.5)
    ratio = 10 ** rng.choice([-8.0, -4.0, 4.0, 8.0])
    press = 10 ** rng.uniform(-3, -1.5)
    shear = press * rng.uniform(-2, 2)
    mu = float(rng.choice([0.3, 0.6, 1.0, 2.0]))
    W = np.zeros((4 * n, 4 * n))
    W[: 2 * n, : 2 * n] = island["W"]
    W[2 * n :, 2 * n :] = island["W"] / ratio
    W += _mirrored(ground["W"], 2) / 10 ** rng.uniform(-2, 4)
    q = np.r_[island["U0"] @ [-press, shear], island["U0"] @ [-press, -shear]]
    q[::2] += press * rng.random(2 * n) * rng.choice([0.0, 1.0])
    name = f"islands {seed}: n {2 * n}, ratio {ratio:.0e}, mu {mu}"
    return Problem(name, W, q.reshape(-1, 2), np.full(2 * n, mu))


def floating(seed: int) -> Problem:
    """Block that only contact holds, sheared by less than the friction limit."""
    rng = np.random.default_rng(seed)
    dim = int(rng.integers(2, 4))
    n = int(rng.choice([20, 60] if dim == 2 else [6, 10]))
    body = block(dim, n, float(rng.choice([0.3, 0.4999])), height=0.5, held=False)
    mu = float(rng.choice([0.2, 0.4, 0.6, 1.0, 1.5]))
    press = 10 ** rng.uniform(-4, -2)
    shear = press * min(mu, 0.4) * rng.choice([0.0, 0.3, 0.6, 0.9, 0.97])
    shear *= np.sign(rng.standard_normal())
    f = body["f"] @ np.r_[press * rng.uniform(0, 1), press, shear]
    kind, R = str(rng.choice(["flat", "rough"])), body["R"]
    gap = _gap(body["x"], kind, rng, press * rng.uniform(0, 1))
    q = body["W"] @ (f - R @ (R.T @ f))
    q[::dim] += gap
    nodes = len(gap)
    name = f"floating {seed}: d {dim}, n {nodes}, mu {mu}, shear {shear / press:.2f}"
    mus = np.full(nodes, mu)
    return Problem(name, body["W"], q.reshape(-1, dim), mus, (R, R.T @ f))


def random(seed: int) -> Problem:
    """Positive definite W without a body: strong coupling, μ up to 2, several solutions."""
    rng = np.random.default_rng(seed)
    d, nodes = int(rng.integers(2, 4)), int(rng.choice([1, 2, 5, 20, 60]))
    m = nodes * d
    G = rng.standard_normal((m, m + 2))
    W = G @ G.T / m + 10 ** rng.uniform(-6, 0) * np.eye(m)
    scale = np.ones(m)
    if rng.random() < 0.5:
        scale = np.repeat(10 ** rng.uniform(-3, 3, nodes), d)
    W = W * scale[:, None] * scale[None, :]
    q = rng.standard_normal(m) * scale
    mu = rng.choice([0.3, 0.8, 1.0, 1.5, 2.0]) * np.ones(nodes)
    return Problem(f"random {seed}: d {d}, n {nodes}", W, q.reshape(-1, d), mu)


def rigid(seed: int) -> Problem:
    """Rigid bodies with more contact unknowns than motions, `W = H M⁻¹ Hᵀ`."""
    rng = np.random.default_rng(seed)
    bodies, each = int(rng.choice([1, 3, 8])), int(rng.choice([4, 8, 12]))
    nodes = bodies * each
    H = np.zeros((nodes * 3, bodies * 6))
    for i in range(nodes):
        b = i % bodies
        x = rng.uniform(-0.5, 0.5, 3)
        x[2] = -0.5
        n = np.r_[0, 0, 1.0] + 0.2 * rng.standard_normal(3) * (rng.random() < 0.3)
        n /= np.linalg.norm(n)
        t1 = np.cross(n, [0, 1.0, 0])
        t1 /= np.linalg.norm(t1)
        for k, axis in enumerate((n, t1, np.cross(n, t1))):
            row, first_column, below = H[i * 3 + k], 6 * b, 6 * (b - 1)
            row[first_column : first_column + 6] = *axis, *np.cross(x, axis)
            if b > 0 and i >= bodies and rng.random() < 0.5:
                row[below : below + 3] -= axis
                row[below + 3 : below + 6] -= np.cross(x + np.r_[0, 0, 1.0], axis)
    lightness = np.repeat(10 ** rng.uniform(-1, 1, bodies), 6)
    inverse_mass = np.tile([1, 1, 1, 6, 6, 6.0], bodies) * lightness
    along = np.arange(bodies * 6) % 6 < 2
    sideways = 0.5 * rng.standard_normal(bodies * 6)
    other = 0.2 * rng.standard_normal(bodies * 6)
    v = np.tile([0, 0, -1.0, 0, 0, 0], bodies) + np.where(along, sideways, other)
    mu = np.full(nodes, rng.choice([0.2, 0.5, 0.8, 1.0]))
    name = f"rigid {seed}: {bodies} bodies, n {nodes}"
    W = (H * inverse_mass) @ H.T
    return Problem(name, W, (H @ v).reshape(-1, 3), mu, full_rank=False)


@cache
def _scene_steps() -> tuple[Problem, ...]:
    """The last two load steps of every shipped scene, slip history included."""
    from bipot_rs import scene

    steps = []
    for name in scene.shipped():
        read = scene.read(name)
        case = scene.assemble(read, scene.bodies(read))
        problem = case.model.problem()
        path = problem.solve(case.load, case.prescribed, tol=1e-12)
        for k in range(max(len(path) - 2, 0), len(path)):
            load = None if case.load is None else case.load[k]
            before = path[k - 1] if k else None
            r = problem.reduced(load, case.prescribed[k], before)
            label = f"{name}, step {k}"
            steps.append(Problem(label, np.asarray(r.W), r.q, r.mu, r.rigid))
    return tuple(steps)


def scenes(seed: int) -> Problem:
    """Load step of a shipped scene, by its number."""
    return _scene_steps()[seed]


SETS: dict[str, Callable[[int], Problem]] = {
    "held": held,
    "two bodies": two_bodies,
    "islands": islands,
    "floating": floating,
    "random": random,
    "rigid": rigid,
    "scenes": scenes,
}


def seeds(name: str, count: int, first: int = 0) -> range:
    """Seeds of `count` problems of a set, or of as many as it has."""
    last = len(_scene_steps()) if name == "scenes" else first + count
    return range(first, min(first + count, last))
