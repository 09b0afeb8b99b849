"""Loads at which the walls of docs/masonry.md move: exact states of rigid joints, and a load path.

    python benches/moving_states.py
    python benches/moving_states.py --walls 3 --print
    python benches/moving_states.py --walls 6 --starts 0 --paths

In a moving state the push does the work 1, reactions in the friction cones balance weight and
push times λ, and Coulomb's law holds with W = 0. Each start solves the problem with a prescribed
push and small compliances of the joints, equal or random. Its statuses make the law linear in
reactions, motion and λ, so linear programmes give the smallest and largest λ with these
statuses. `judge` reads neither statuses nor the solver's certificate: only its number says that
a state is one, so statuses of a solve that did not converge are starts like any others.

One more start are convex problems with given slips, which need no solver of this package, at
smaller and smaller compliance. From the smallest load a search goes on: contacts on the border
of two statuses change one after the other, as long as the load falls.

The load path has equal compliances of all joints. The push is raised by steps, each from the
last reactions; a step without a converged solution in time is refined. Rewrites the table of
`docs/masonry.md` and the rows of what was measured in `results/moving_states.csv`.
"""

from typing import NamedTuple

import numpy as np
import tables
from scipy import sparse
from scipy.optimize import linprog
from scipy.sparse.linalg import splu

import bipot_rs as bp

MU = 0.65
PAGE = tables.HERE.parent / "docs" / "masonry.md"
SHEET = "moving_states.csv"
HEAD = tables.columns(
    "wall | largest static load λ_a | loads of moving states by their starts | smallest found"
    " | end of the load path"
)
# Rows of the CSV file that are moving states: by the solver, by given slips, by the search.
MOVING = {"moving", "slips", "search"}
# Rows of bricks from the bottom, as on the page.
A, B = [0.5, 1, 1, 1, 1, 0.5], [1, 1, 1, 1, 1]
C, D = [1, 1, 1, 1], [0.5, 1, 1, 1, 0.5]
E, F = [0.5, 1, -1, 1, 0.5], [1, 0.5, -1, 0.5, 1]
G, H = [1, -1, 1, -1, 1], [0.5, 0.5, -1, 0.5, 0.5, -1, 0.5, 0.5]
I, J = [0.5, *[1] * 6, 0.5], [1] * 7  # noqa: E741
K, L = [0.5, 1, -1, 1, 1, -1, 1, 0.5], [1, 0.5, -1, 0.5, 1, 0.5, -1, 0.5, 1]
WINDOWS = [K, L, K, L, K]
WALLS = {
    1: [A, B] * 3,
    2: [A, B] * 5,
    3: [C, D, C, E, F, E, F, E, C, D, C],
    4: [A, B, A, G, H, G, H, G, A, B, A],
    6: [I, J, I, J, *WINDOWS, J, I, J, *WINDOWS, J, I, J, I],
}
# Compliance of the joints in units of a wall whose heaviest brick weighs 1. At ten times more the
# loads of walls 2 and 3 still depend on it; at a hundredth most solves end before 1e-10.
COMPLIANCE = 1e-5
SECONDS, TOL = 40.0, 1e-10
# Largest residual of an exact state: rounding of sums over the contacts of a block.
EXACT = 1e-12
# Parts of the largest reaction or displacement of a contact below which it counts as none. They
# sort what a compliance leaves over from what is there; `judge` knows nothing of them.
NO_FORCE, NO_SLIP, ON_THE_CONE = 1e-7, 1e-5, 1e-4
# A contact is on the border of two statuses if it misses the other by this part of the largest
# reaction or displacement: vertices of linear programmes end near 1e-15.
BORDER = 1e-9
# Compliances of the problems with given slips, passes with each, and the change of the slips, as
# part of them, at which they end. At 1e-6 the statuses of wall 6 are not yet those of a state.
COMPLIANCES, PASSES, SETTLED = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8), 400, 1e-8
# Linear programmes of the search; a fall of the load below FALL counts as none.
PROGRAMMES, FALL = 1500, 1e-9
# First and last step of the load path, as parts of λ_a.
FIRST, LAST = 0.05, 1e-3


class Wall(NamedTuple):
    """Motions of the contacts, loads in weights of the heaviest brick, and the problem."""

    R: sparse.csr_array
    weight: np.ndarray
    push: np.ndarray
    mu: np.ndarray
    problem: bp.blocks.BlockProblem


class State(NamedTuple):
    """Reactions ``(n_c, 2)``, motion of the blocks ``(k,)`` and multiplier of the push."""

    reaction: np.ndarray
    motion: np.ndarray
    load: float


def build(number):
    """The wall on the ground."""
    sides = [[-1, -1], [5, -1], [5, 0], [-1, 0]]
    blocks = [bp.blocks.Block("ground", sides, support=True)]
    for row, lengths in enumerate(WALLS[number]):
        x, y = 0.0, 0.175 * (np.array([0, 0, 1, 1]) + row)
        for length in lengths:
            if length > 0:
                corners = 0.4 * np.array([x, x + length, x + length, x])
                outline = np.column_stack([corners, y])
                blocks.append(bp.blocks.Block(f"{row}.{x:g}", outline))
            x += abs(length)
    return prepare(bp.blocks.assemble(blocks, MU))


def prepare(problem):
    """Weight and horizontal push of blocks, scaled."""
    weight, push = problem.body_force([0, -1]), problem.body_force([1, 0])
    unit = np.abs(weight).max()
    R = sparse.csr_array(problem.rigid[0])
    return Wall(R, weight / unit, push / unit, problem.mu, problem)


def find_moving(wall, compliance):
    """A state near a moving one, for the ``compliance (2 n_c,)``, and the outcome."""
    forward = wall.push / (wall.push @ wall.push)
    across = np.linalg.svd(wall.push[None])[2][1:].T
    solution = bp.ReducedProblem(
        np.diag(compliance),
        (wall.R @ forward).reshape(-1, 2),
        wall.mu,
        rigid=(wall.R @ across, across.T @ wall.weight),
    ).solve(tol=TOL, max_seconds=SECONDS)
    r = solution.reaction
    load = -forward @ (wall.weight + wall.R.T @ r.ravel())
    # The motion that leaves the least of the displacements to the compliances.
    moved = solution.relative_displacement.ravel() - compliance * r.ravel()
    motion = np.linalg.lstsq(wall.R.toarray(), moved)[0]
    return State(r, motion, load), solution.outcome


def solve_convex(wall, compliance, slip):
    """The state of an associated law at given slips, by an interior-point method.

    Minimises ``½ δ |r|² + μ slip·r_n - λ`` over reactions in the cones that balance the loads.
    """
    m = len(wall.mu)
    # Multiples y >= 0 of the edges of cones: r_n = (y_0 + y_1)/(2 μ), r_t = (y_0 - y_1)/2.
    half = 0.5 / wall.mu
    edges = sparse.block_diag([[[h, h], [0.5, -0.5]] for h in half], format="csr")
    rows, push = sparse.csr_array(wall.R.T @ edges), wall.push
    inside = edges.T @ sparse.diags_array(compliance) @ edges
    soft = sparse.bsr_array(inside, blocksize=(2, 2)).data
    cost = np.repeat(wall.mu * slip * half, 2)
    y, z = np.ones(2 * m), np.ones(2 * m)
    motion, load = push / (push @ push), 0.0

    def multiply(blocks, x):
        return (blocks @ x.reshape(m, 2, 1)).ravel()

    def reach(y, dy, z, dz):
        ends = (-(x / dx)[dx < 0] for x, dx in ((y, dy), (z, dz)))
        return min(1.0, *(end.min(initial=np.inf) for end in ends))

    for _ in range(60):
        gap = y @ z / (2 * m)
        left = multiply(soft, y) + cost + rows.T @ motion
        imbalance = rows @ y + wall.weight + load * push
        lacks = gap, np.abs(left - z).max(), np.abs(imbalance).max()
        if max(lacks) < EXACT:
            break
        inverse = np.linalg.inv(soft + (z / y).reshape(m, 2, 1) * np.eye(2))
        middle = sparse.bsr_array((inverse, np.arange(m), np.arange(m + 1)))
        border = push[:, None]
        matrix = [[-(rows @ middle @ rows.T), border], [border.T, None]]
        factor = splu(sparse.block_array(matrix, format="csc"))
        work = push @ motion
        # Predictor and corrector of Mehrotra.
        aim = np.zeros(2 * m)
        for corrects in (False, True):
            right = aim / y - left
            missed = imbalance + rows @ multiply(inverse, right)
            dx = factor.solve(np.append(-missed, 1 - work))
            dy = multiply(inverse, right - rows.T @ dx[:-1])
            dz = (aim - z * dy) / y - z
            share = reach(y, dy, z, dz)
            if not corrects:
                after = (y + share * dy) @ (z + share * dz) / (2 * m)
                aim = (after / gap) ** 3 * gap - dy * dz
        share = min(1.0, 0.995 * share)
        y, z = y + share * dy, z + share * dz
        motion, load = motion + share * dx[:-1], load + share * dx[-1]
    return State((edges @ y).reshape(m, 2), motion, load)


def approach(wall, ratios):
    """States with compliances ``ratios (2 n_c,)`` times smaller and smaller numbers."""
    slip = np.zeros(len(wall.mu))
    for compliance in COMPLIANCES:
        for _ in range(PASSES):
            state = solve_convex(wall, compliance * ratios, slip)
            moved = wall.R @ state.motion + compliance * ratios * state.reaction.ravel()
            change = np.abs(moved[1::2]) - slip
            # Undamped passes go to and fro.
            slip = slip + 0.5 * change
            pressed = state.reaction[:, 0] > BORDER * np.abs(state.reaction).max()
            if np.linalg.norm(change[pressed]) < SETTLED * np.linalg.norm(slip):
                break
        yield state


def change_statuses(wall, state, is_open, sticks, slip):
    """Statuses that differ in one contact, which is on the border of both."""
    r, v = state.reaction, (wall.R @ state.motion).reshape(-1, 2)
    force, length = BORDER * np.abs(r).max(), BORDER * np.abs(v).max()
    free, still = r[:, 0] <= force, np.abs(v).max(axis=1) <= length
    slides = (v[:, 0] <= length) & (wall.mu * r[:, 0] - np.abs(r[:, 1]) <= force)
    allowed = [
        (free, True, False, 0.0),
        (still, False, True, 0.0),
        *(
            (
                slides & (way * v[:, 1] >= -length) & (way * r[:, 1] <= force),
                False,
                False,
                way,
            )
            for way in (1.0, -1.0)
        ),
    ]
    for may, opened, stuck, way in allowed:
        new = may & ~((is_open == opened) & (sticks == stuck) & (slip == way))
        for contact in np.flatnonzero(new):
            changed = is_open.copy(), sticks.copy(), slip.copy()
            for status, value in zip(changed, (opened, stuck, way), strict=True):
                status[contact] = value
            yield changed


def descend(wall, state, statuses):
    """The state at the end of the search from an exact one, and how many programmes it took."""
    rng, count = np.random.default_rng(0), 0
    while True:
        others = list(change_statuses(wall, state, *statuses))
        for choice in rng.permutation(len(others)):
            count += 1
            states = find_range(wall, *others[choice])
            falls = states and states[0].load < state.load - FALL
            if falls and judge(wall, states[0]) <= EXACT:
                state, statuses = states[0], others[choice]
                break
            if count == PROGRAMMES:
                return state, count
        else:
            return state, count


def sort_contacts(wall, state, no_slip=NO_SLIP):
    """Contacts that are open and that stick, and the direction of slip of the others."""
    r, v = state.reaction, (wall.R @ state.motion).reshape(-1, 2)
    is_open = r[:, 0] <= NO_FORCE * np.abs(r).max()
    slips = np.abs(v[:, 1]) > no_slip * np.abs(v).max()
    spare = wall.mu * r[:, 0] - np.abs(r[:, 1])
    slips &= (spare < ON_THE_CONE * np.abs(r).max()) & ~is_open
    return is_open, ~is_open & ~slips, np.where(slips, np.sign(v[:, 1]), 0.0)


def find_range(wall, is_open, sticks, slip):
    """States of the smallest and the largest load with these statuses, W = 0; none: empty."""
    n, k = wall.R.shape
    unit = sparse.eye_array(n, format="csr")
    friction = sparse.diags_array(wall.mu) @ unit[::2]
    tangent, v_n, v_t = unit[1::2], wall.R[::2], wall.R[1::2]
    moves, toward = slip != 0, sparse.diags_array(slip)
    push = sparse.csr_array(wall.push[:, None])
    # Columns: reactions, motion, multiplier. Balance and the work of the push come first.
    equal = sparse.block_array(
        [
            [wall.R.T, None, push],
            [None, push.T, None],
            [unit[np.repeat(is_open, 2)], None, None],
            [None, wall.R[np.repeat(sticks, 2)], None],
            [None, v_n[moves], None],
            [(tangent + toward @ friction)[moves], None, None],
        ]
    )
    right = np.zeros(equal.shape[0])
    right[: k + 1] = [*-wall.weight, 1.0]
    at_most = sparse.block_array(
        [
            [None, -v_n[is_open], sparse.csr_array((is_open.sum(), 1))],
            [(tangent - friction)[sticks], None, None],
            [-(tangent + friction)[sticks], None, None],
            [None, -(toward @ v_t)[moves], None],
            [-friction[moves], None, None],
        ]
    )
    states = []
    for sign in (1.0, -1.0):
        result = linprog(
            [*np.zeros(n + k), sign],
            A_ub=at_most,
            b_ub=np.zeros(at_most.shape[0]),
            A_eq=equal,
            b_eq=right,
            bounds=(None, None),
        )
        if result.status == 0:
            x = result.x
            states.append(State(x[:n].reshape(-1, 2), x[n:-1], float(x[-1])))
    return states


def judge(wall, state):
    """How far a state is from a moving state with W = 0: 0 if it is one.

    The largest of: imbalance; the work of the push, less 1; forces outside the cones;
    penetration; the smaller of normal force and gap; friction that does not oppose a slip with
    all its strength. Forces are relative to the weight of the heaviest brick, 1, and
    displacements to the largest.
    """
    r_n, r_t = state.reaction.T
    v_n, v_t = (wall.R @ state.motion).reshape(-1, 2).T
    size = np.hypot(v_n, v_t).max()
    loads = wall.weight + state.load * wall.push
    faults = [
        np.abs(wall.R.T @ state.reaction.ravel() + loads),
        np.abs([wall.push @ state.motion - 1.0]),
        np.abs(r_t) - wall.mu * r_n,
        -v_n / size,
        np.minimum(r_n, v_n / size),
        np.abs(r_t * np.abs(v_t) + wall.mu * r_n * v_t) / size,
    ]
    return float(max(fault.max() for fault in faults))


def follow_path(wall, limit):
    """Largest load with a solution for equal compliances, the last step, and the residual."""
    n = len(wall.mu)
    load, step, reaction, residual = 0.7 * limit, FIRST * limit, None, np.inf
    while True:
        trial = load + step
        problem = bp.ReducedProblem(
            np.eye(2 * n),
            np.zeros((n, 2)),
            wall.mu,
            rigid=(wall.R.toarray(), wall.weight + trial * wall.push),
        )
        solution = problem.solve(start=reaction, tol=TOL, max_seconds=SECONDS)
        print(f"  path {trial:.5f} {solution.outcome}", flush=True)
        if solution.converged:
            load, reaction, residual = trial, solution.reaction, solution.residual
        elif step > LAST * limit:
            step /= 4
        else:
            return load, step, residual


def measure(number, starts, path):
    """Rows of the CSV file: one for the static load, each range of states, and the path."""
    wall = build(number)
    static = wall.problem.limit_multiplier(wall.weight, wall.push)

    def row(kind, start, low, high, residual, outcome=""):
        return {
            "wall": number,
            "kind": kind,
            "start": start,
            "low": f"{low:.6f}",
            "high": f"{high:.6f}",
            "residual": f"{residual:.1e}",
            "outcome of the start": outcome,
        }

    gap = 1 - static.reached / static.upper
    yield row("static", "", static.reached, static.upper, gap)

    def find_states(state, no_slip=NO_SLIP):
        statuses = sort_contacts(wall, state, no_slip)
        states = find_range(wall, *statuses)
        return statuses, states, max((judge(wall, s) for s in states), default=np.inf)

    for start in range(starts):
        ratios = 10 ** np.random.default_rng(start).uniform(-1, 1, wall.R.shape[0])
        compliance = COMPLIANCE * (ratios if start else np.ones_like(ratios))
        state, outcome = find_moving(wall, compliance)
        _, states, residual = find_states(state)
        print(f"  start {start} {outcome}, judged {residual:.1e}", flush=True)
        if residual <= EXACT:
            loads = [state.load for state in states]
            yield row("moving", start, min(loads), max(loads), residual, outcome)
    lowest = None
    equal = approach(wall, np.ones(wall.R.shape[0]))
    for compliance, state in zip(COMPLIANCES, equal, strict=True):
        # The smaller the compliance, the smaller the slips that are not those of elastic joints.
        for no_slip in (NO_SLIP, NO_SLIP / 10):
            statuses, states, residual = find_states(state, no_slip)
            print(f"  compliance {compliance:g}, judged {residual:.1e}", flush=True)
            if residual <= EXACT:
                low, high = states[0], states[-1]
                start = f"{compliance:g}, {no_slip:g}"
                yield row("slips", start, low.load, high.load, residual)
                if lowest is None or low.load < lowest[0].load:
                    lowest = low, statuses
    if lowest is not None:
        state, count = descend(wall, *lowest)
        yield row("search", count, state.load, state.load, judge(wall, state))
    if path:
        load, step, residual = follow_path(wall, static.upper)
        yield row("path", "", load, load + step, residual)


def write_table(rows):
    """The table of the page."""
    lines = []
    for number in dict.fromkeys(str(row["wall"]) for row in rows):
        ends: dict[str, list[tuple[str, str]]] = {}
        for row in rows:
            if str(row["wall"]) == number:
                ends.setdefault(row["kind"], []).append((row["low"], row["high"]))
        ranges = sorted({*ends.get("moving", []), *ends.get("slips", [])})
        smallest = min(
            (low for kind, found in ends.items() for low, _ in found if kind in MOVING),
            default="none computed",
        )
        lines.append(
            (
                number,
                ends["static"][0][1],
                ", ".join(a if a == b else f"{a} to {b}" for a, b in ranges)
                or "none computed",
                smallest,
                " to ".join(end for pair in ends.get("path", []) for end in pair)
                or "not computed",
            )
        )
    return tables.table(HEAD, lines)


def main():
    """Measure the walls and rewrite the table."""
    parser = tables.parser(__doc__)
    parser.add_argument("--walls", type=int, nargs="+", default=list(WALLS))
    parser.add_argument("--starts", type=int, default=8, help="per wall")
    parser.add_argument("--paths", type=int, nargs="*", default=[1, 3, 4])
    args = parser.parse_args()
    sheet = tables.RESULTS / SHEET
    for number in args.walls:
        rows = []
        for row in measure(number, args.starts, number in args.paths):
            print(row, flush=True)
            rows.append(row)
        if not args.print:
            others = tables.read_rows(sheet) if sheet.exists() else []
            measured = {(str(row["wall"]), row["kind"]) for row in rows}
            # What is not found any more goes too, but not what was not asked.
            asked = MOVING if args.starts else MOVING - {"moving"}
            measured |= {(str(number), kind) for kind in asked}
            rows += [r for r in others if (r["wall"], r["kind"]) not in measured]
            tables.write_rows(sheet, sorted(rows, key=lambda row: int(row["wall"])))
            tables.rewrite(PAGE, "moving walls", write_table(tables.read_rows(sheet)))


if __name__ == "__main__":
    main()
