"""H1–H26: hard cases."""

import json
import math
import subprocess
import sys
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs import analytic, fem
from cases.exact import a5, a12, a14, incline, nearest, verdict
from cases.published import pad
from cases.verification import Row, exact, exactly, near, same
from support.bars import bar_problem, lost, pulled
from support.bodies import block, uniform_shear
from support.contacts import K1, TOL, one_node
from support.places import TESTS
from support.pressed import cube

Array = NDArray[np.float64]
BRANCHES, STATICS, CLOSED = "enumeration", "statics", "closed form"


def reaction(*load: float, mu: float = 0.5, **options: Any) -> Array:
    result = one_node(load, mu, **options)
    return np.asarray(result.reaction[0, 0])


def h1() -> list[Row]:
    """Vertex of the cone."""
    loads = [0.0, 0.3, -0.3]
    got = [one_node([0.0, f], 0.5, stiffness=np.diag([2.0, 1.0])) for f in loads]
    pairs = {
        "r at the vertex": (np.zeros((3, 2)), [g.reaction[0, 0] for g in got]),
        "u at the vertex": (
            [[0.0, f] for f in loads],
            [g.displacement[0] for g in got],
        ),
    }
    return exactly(BRANCHES, 1e-10, pairs)


def h2() -> list[Row]:
    """No slip."""
    result: Any = one_node([-1.0, 0.0], 0.5)
    return [
        exact("r without shear", BRANCHES, [1, 0], result.reaction[0, 0], 1e-10),
        exact("slip without shear", BRANCHES, [0], result.slip[0, 0], 1e-15),
    ]


def h3() -> list[Row]:
    """Grazing gap."""
    got = [reaction(-1.0, 1.9, gap=gap) for gap in (0.0, 1e-16, -1e-16)]
    return [exact("r at a gap of 0, ±1e-16", BRANCHES, [[1.56, -0.78]] * 3, got, 1e-10)]


def h4() -> list[Row]:
    """No friction."""
    return [exact("r, μ = 0", BRANCHES, [1.75, 0], reaction(-1.0, 1.5, mu=0.0), 1e-10)]


def h5() -> list[Row]:
    """Huge friction."""
    got = reaction(-1.0, 1e3, mu=1e8, stiffness=np.diag([2.0, 1.0]))
    return [exact("r, μ = 1e8", BRANCHES, [1, -1000], got, 1e-10)]


def h6() -> list[Row]:
    """Penetration."""
    sticks, slips = (reaction(0, 0, mu=mu, gap=-0.1) for mu in (0.5, 0.1))
    branch = [0.184210526316, 0.0184210526316]
    return [
        exact("r after penetration, μ = 0.5", BRANCHES, [0.2, 0.05], sticks, 1e-10),
        near("r after penetration, μ = 0.1", BRANCHES, branch, slips, 1e-11),
    ]


def h7() -> list[Row]:
    """Duplicate contact."""
    W, q = np.array([[0.5, 0.1], [0.1, 1.0]]), np.array([[-1.0, 0.7]])
    twice = bp.ReducedProblem(np.tile(W, (2, 2)), np.tile(q, (2, 1)), 0.3)
    solution = twice.solve(tol=TOL)
    total, branch = solution.reaction.sum(axis=0), [2.12765957, -0.63829787]
    v_t = solution.relative_displacement[:, 1]
    return [
        near("sum of r of a duplicated contact", BRANCHES, branch, total, 1e-8),
        near("v_t of a duplicated contact", BRANCHES, [0.27446809] * 2, v_t, 1e-7),
    ]


def h8() -> list[Row]:
    """Redundant supports."""
    B = sparse.csr_array([[1.0, -1.0], [0, 0], [1, 0], [0, 0], [1, 1], [0, 0]])
    load = np.array([-1.0, 0.0])
    result: Any = bp.solve(1e-3 * np.eye(2), B, load, gap=np.zeros(3), mu=0.3, tol=TOL)
    total = result.reaction[0, :, 0].sum()
    return [exact("sum of r_n on three supports of a bar", STATICS, 1.0, total, 1e-10)]


def h9() -> list[Row]:
    """Floating, held."""
    rows = []
    for dim, motions in ((2, 3), (3, 6)):
        body = block((*(2, 1)[: dim - 1], 1.5), (2,) * dim, 10.0, 0.0)
        shear = [0.6, -0.2][: dim - 1]
        load = uniform_shear(body, 2.0, shear)
        result: Any = bp.solve(body.K, body.B, load, gap=body.gap, mu=0.4, tol=TOL)
        values = np.linalg.eigvalsh(body.K.toarray())
        free = int((values < 1e-10 * values[-1]).sum())
        forces = np.outer(body.area, [2.0, *(-s for s in shear)])
        of_block = f"of a free block, d = {dim}"
        rows += [
            same(f"rigid motions {of_block}", STATICS, str(motions), str(free)),
            exact(f"r {of_block}", CLOSED, forces, result.reaction[0], 1e-10),
        ]
    return rows


def outcome(K: Any, B: Any, load: Any, mu: float) -> str:
    """Name of the error, or the solution."""
    try:
        result = bp.solve(K, B, load, gap=np.zeros(B.shape[0] // 2), mu=mu)
    except bp.BipotError as error:
        return type(error).__name__
    return str(result.reaction)


def h10() -> list[Row]:
    """Drift."""
    body = block((2, 1), (2, 2), 100.0, 0.3)
    up = body.weight([0.0, 0.5])
    slider = outcome(
        np.ones((2, 2)), sparse.eye_array(2, format="csr"), np.array([-1, -2.5]), 2
    )
    refused = "NoEquilibriumError"
    return [
        same("block pulled up", STATICS, refused, outcome(body.K, body.B, up, 0.5)),
        same("slider that its spring cannot hold", BRANCHES, refused, slider),
    ]


def h11() -> list[Row]:
    """High friction, K definite."""
    want, got = [], []
    for mu in (2.1, 3.0, 10.0, 1e3):
        for f_t in np.linspace(-4, 4, 33) * max(1, mu / 3):
            branches = analytic.one_contact_branches(K1, [-1.0, f_t], mu)
            rows = [[*b.displacement, *b.reaction] for b in branches]
            pair = nearest(one_node([-1.0, f_t], mu), rows)
            # Loads and solutions grow with μ.
            size = np.abs(pair[0]).max()
            want.append(np.array(pair[0]) / size)
            got.append(pair[1] / size)
    return [exact("an answer for μ to 1000, 132 loads", BRANCHES, want, got, 1e-9)]


def h12() -> list[Row]:
    """Near-incompressible."""
    body = block((1, 1), (8, 8), 1.0, 0.4999999)
    walls = np.unique(np.append(body.dofs(0, 0.0, 0), body.dofs(0, 1.0, 0)))
    load = body.traction(1, 1.0, [0.0, -1.0])
    result: Any = bp.solve(body.K, body.B, load, gap=body.gap, mu=0.3, fixed=walls)
    r, what = np.outer(body.area, [1.0, 0.0]), "r of the column, ν = 0.4999999"
    return [exact(what, CLOSED, r, result.reaction[0], 1e-8)]


def h13() -> list[Row]:
    """Stiffness contrast."""
    grid = np.linspace(0, 1, 7)
    rows = []
    for lower, upper in ((1.0, 1e8), (1e8, 1.0)):
        bodies = [
            fem.Body(
                name, fem.box([grid, grid + low], "quadrilateral"), fem.Material(E, 0.3)
            )
            for name, low, E in (("lower", 0.0, lower), ("upper", 1.0, upper))
        ]
        model = fem.assemble(
            bodies,
            [
                fem.Contact("lower", "bottom", 0.3, plane=((0, 0), (0, 1))),
                fem.Contact("upper", "bottom", 0.3, against=("lower", "top")),
            ],
            [fem.Support(b.name, s, [0]) for b in bodies for s in ("left", "right")],
        )
        result: Any = model.problem().solve(model.traction("upper", "top", [0, -1]))
        per_stress = -float(analytic.oedometer(1.0, 1.0, 1.0, 0.3))
        top = -result.displacement[0].min()
        press = np.outer(model.area, [1.0, 0.0])
        what, shortened = f"E = {lower:g} under {upper:g}", 1 / lower + 1 / upper
        pairs = {
            f"shortening, {what}": (per_stress * shortened, top),
            f"r, {what}": (press, result.reaction[0]),
        }
        rows += exactly(CLOSED, 1e-10, pairs)
    return rows


def h14() -> list[Row]:
    """Units."""
    scales = [(s, c) for s in (1e-9, 1e9) for c in (1e-9, 1.0, 1e9)]
    two = [(2.0**s, 2.0**c) for s in (-30, 30) for c in (-30, 7, 30)]
    plain: Any = one_node([-1.0, 1.9], 0.5)

    def scaled(s: float, c: float) -> Any:
        return one_node([-c, 1.9 * c], 0.5, stiffness=K1 * (c / s))

    got = [scaled(s, c).reaction[0, 0] / c for s, c in scales]
    bits = (np.array_equal(scaled(s, c).reaction / c, plain.reaction) for s, c in two)
    what, told = (
        "bits in units scaled by powers of two",
        "equal" if all(bits) else "other",
    )
    return [
        exact("r in other units", BRANCHES, [[1.56, -0.78]] * 6, got, 1e-10),
        same(what, "unscaled units", "equal", told),
    ]


def h15() -> list[Row]:
    """Rotation, renumbering."""
    problem = cube()
    solution = problem.solve(tol=TOL)
    n = len(problem.q)
    order = np.random.default_rng(5).permutation(n)
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    other = bp.ReducedProblem(
        problem.W[np.ix_(rows, rows)], problem.q[order], problem.mu[order]
    )
    angle = 0.7
    frame = np.eye(3)
    frame[1:, 1:] = [
        [math.cos(angle), math.sin(angle)],
        [-math.sin(angle), math.cos(angle)],
    ]
    T = np.kron(np.eye(n), frame)
    turned = bp.ReducedProblem(T @ problem.W @ T.T, problem.q @ frame.T, problem.mu)
    r, renumbered = solution.reaction, other.solve(tol=TOL).reaction
    # Each has η = 1e-12; the condition of W is about 1e2.
    pairs = {
        "r, contacts renumbered": (r[order], renumbered),
        "r, tangents turned": (r, turned.solve(tol=TOL).reaction @ frame),
    }
    return exactly("the same problem", 1e-10, pairs)


def h16() -> list[Row]:
    """Bad input."""
    good = {"K": K1, "B": np.eye(2), "load": [-1.0, 0.3], "gap": [0.0], "mu": 0.5}
    bad: dict[str, Any] = {
        "K": [[math.nan, 0.5], [0.5, 1.0]],
        "B": [[1.0, 0.0], [0.0, math.inf]],
        "load": [math.nan, 0.0],
        "gap": [math.inf],
        "mu": -0.1,
    }
    rows = []
    for name, value in bad.items():
        arguments: dict[str, Any] = good | {name: value}
        K, B, load = (arguments.pop(key) for key in ("K", "B", "load"))
        got = "accepted"
        try:
            bp.solve(K, B, load, **arguments)
        except ValueError as error:
            got = f"ValueError, {name}" if name in str(error).split() else str(error)
        shown = json.dumps(value).replace("NaN", "nan")
        rows.append(same(f"{name} = {shown}", "contract", f"ValueError, {name}", got))
    return rows


def h17() -> list[Row]:
    """Empty."""
    load = np.array([-1.0, 0.3])
    result: Any = bp.solve(K1, sparse.csr_array((0, 2)), load, gap=[], mu=0, dim=2)
    u = np.linalg.solve(K1, load)
    return [exact("u without contacts", "NumPy", u, result.displacement[0], 1e-13)]


@cache
def many() -> dict[str, float]:
    """H18 in a child process."""
    script = str(TESTS / "cases" / "many_candidates.py")
    done = subprocess.run(
        [sys.executable, script, "100000"], check=True, capture_output=True, text=True
    )
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def h18() -> list[Row]:
    """Many candidates, few active."""
    figures = many()
    # A dense W takes (2e5)² doubles, 3.2e11 bytes; this is 1/300 of it.
    peak = "under 1 GB" if figures["bytes"] < 1e9 else f"{figures['bytes']:.2g} B"
    return [
        same("contacts of 100,000 candidates", CLOSED, "10", str(figures["contacts"])),
        exact("largest error of r", CLOSED, 0.0, figures["reaction"], 1e-10),
        exact("largest error of u", CLOSED, 0.0, figures["displacement"], 1e-10),
        same("peak memory", "320 GB for a dense W", "under 1 GB", peak),
    ]


def h19() -> list[Row]:
    """A thousand cycles."""
    problem, load = bar_problem()
    ends = np.array([30.0] + [-30.0, 30.0] * 1000)
    result: Any = problem.solve(pulled(load, ends), tol=1e-13)
    end, work = result.displacement[:, -1], lost(result)[1:].sum()
    what, closed = "end of the bar at 2001 reversals [m]", 0.009 * np.sign(ends)
    return [
        exact(what, CLOSED, closed, end, 1e-10),
        exact("friction work of 1000 cycles [J]", CLOSED, 361.25, work, 1e-9),
    ]


def h20() -> list[Row]:
    """Energy balance."""
    problem, load = bar_problem()
    half = np.arange(30.0, -30.0, -2.5)
    ends = np.concatenate([half, -half, [30.0]])
    result: Any = problem.solve(pulled(load, ends), tol=1e-13)
    u = result.displacement[:, -1]
    work = ((ends[1:] + ends[:-1]) / 2 * np.diff(u)).sum()
    return [exact("work of the load in a cycle [J]", CLOSED, 0.36125, work, 1e-13)]


def h23() -> list[Row]:
    """Limit of stick and slip."""
    rows = [
        same(f"incline, tan α = {s} μ", STATICS, want, verdict(*incline(s), 0.6))
        for s, want in ((0.999999, "held"), (1.000001, "no equilibrium"))
    ]
    limit = 0.3 * (12000 - 0.02)
    for share, want in ((1 - 1e-6, "stick"), (1 + 1e-6, "slip")):
        _, slip, _ = pad(limit * share)
        # Beyond the limit the springs carry 0.0036 N, over 4 N/mm.
        got = "slip" if np.abs(slip).max() > 1e-4 else "stick"
        rows.append(same(f"pad, {share:.6f} of its limit", STATICS, want, got))
    return rows


def h25() -> list[Row]:
    """Released contact."""
    path = [[-1.0, 1.5], [1.0, 1.5], [-1.0, 0.0]]
    result: Any = one_node(path, 0.3)
    free = np.linalg.solve(K1, path[1])
    # It slides back from u_t of the free step until r_t = μ r_n; with u_n = 0,
    # r_n = 1 + k_c u_t and k_t u_t = r_t.
    u_t = 0.3 / (K1[1, 1] - 0.3 * K1[0, 1])
    r_n = 1 + K1[0, 1] * u_t
    pairs = {
        "r released": ([0, 0], result.reaction[1, 0]),
        "u released": (free, result.displacement[1]),
        "r touching again": ([r_n, 0.3 * r_n], result.reaction[2, 0]),
    }
    return exactly(BRANCHES, 1e-10, pairs)


def h26() -> list[Row]:
    """A step of nothing."""
    result: Any = one_node([[-1.0, 1.5]] * 3, 0.3)
    r, slip = [1.521739130435, -0.456521739130], result.slip[1:, 0, 0]
    return [
        near(
            "r under a constant load", BRANCHES, [r] * 3, result.reaction[:, 0], 1e-11
        ),
        exact("slip of the later steps", BRANCHES, [0, 0], slip, 1e-10),
    ]


OWN = (h1, h2, h3, h4, h5, h6, h7, h8, h9, h10, h11, h12, h13, h14, h15, h16, h17)
OWN += (h18, h19, h20, h23, h25, h26)
CASES = {case.__name__: case for case in OWN} | {"h21": a5, "h22": a12, "h24": a14}
CASES = dict(sorted(CASES.items(), key=lambda pair: int(pair[0][1:])))
