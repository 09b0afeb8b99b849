"""Wrong calls of the compiled core raise exceptions and do not panic.

`except Exception` does not catch a panic. Every call must return, or raise an ordinary
Python exception.
"""

import itertools
import random
import re
import resource
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import bipot_rs as bp
from bipot_rs import _core
from bipot_rs.contact.law.contact_law import ContactLaw
from support.children import forked, memory
from support.numpy_engine import NumpyEngine

pytestmark = pytest.mark.needs_extra

Call = Callable[..., Any]

EYE = (np.arange(5), np.arange(4), np.ones(4))
CUBE = (np.arange(7), np.arange(6), np.ones(6))
GAP, MU = np.full((2, 2), -0.1), np.full(2, 0.3)
LAW = ContactLaw(MU)
LOAD, NONE = np.array([-1.0, 0.1, -1.0, 0.1]), np.zeros(0)
ISLAND = [([0, 1], np.eye(4).ravel(), None)]
# Contact 1 sticks: by_v = I.
CLOSED, STICKS, ROWS, RIGHT = (
    np.array([1]),
    np.zeros((2, 2)),
    np.eye(2),
    np.ones((1, 2)),
)
# Two contacts of one body that does not turn, and no equations.
EYE_ROWS = (np.arange(5), np.tile(np.arange(2), 2), np.ones(4))
NO_ROWS = (np.zeros(1, np.int64), np.zeros(0, np.int64), NONE)
PUSH = np.array([-1.0, 0.1])


def csr(pointer: Any, index: Any, values: Any) -> tuple[Any, ...]:
    return np.array(pointer), np.array(index, np.int64), np.array(values, float)


# Values that are wrong for nearly every argument, but have a type that is accepted.
ODD: list[Any] = [
    None,
    True,
    -1,
    0,
    3,
    2**63,
    2**70,
    1e300,
    float("nan"),
    "x",
    "newton",
    b"",
    [],
    (),
    {},
    object(),
    1j,
    *map(np.zeros, (0, 2, 3, 4, 5, 16, (0, 2), (0, 3), (2, 2), (3, 2), (2, 3), (1, 2))),
    *map(np.zeros, ((2, 4), (2, 1), (4, 0), (2, 2, 2))),
    np.full((2, 2), np.nan),
    np.full((2, 2), 1e308),
    np.full((2, 2), 5e-324),
    np.full(2, np.nan),
    np.full(2, -1.0),
    np.full(4, np.inf),
    np.zeros(2, np.int64),
    np.array([0, 5]),
    np.array([-1, 0]),
    np.full(2, 9, np.int8),
    np.asfortranarray(np.ones((2, 2))),
    np.ones((4, 4))[::2, ::2],
    *(
        [(nodes, np.eye(4).ravel(), None)]
        for nodes in ([0, 1], [0, 0], [0, 7], [1, 0], [2**40, 0])
    ),
    [([0], np.eye(2).ravel(), None)],
    [([0, 1], np.full(16, np.nan), None)],
    [([0, 1], np.zeros(16), None)],
    [([0, 1], np.full(16, 1e308), None)],
    [([], np.zeros(0), None), *ISLAND],
    *(
        # Block rows with two diagonal blocks, and some inconsistent ones.
        [([0, 1], np.tile(np.eye(2).ravel(), 2), pattern)]
        for pattern in (
            ([0, 1, 2], [0, 1]),
            ([0, 1, 2], [0, 7]),
            ([0, 1, 9], [0, 1]),
            ([0, 2, 1], [0, 1]),
            ([1, 1, 2], [0, 1]),
            ([0, 1, 2], [0, 2**40]),
            ([0, 2], [0, 1]),
            ([0], []),
            ([], []),
            ([0, 1, 2], [0]),
            ([0, 2, 2], [1, 1]),
        )
    ),
    csr([0, 1, 2, 3, 9], range(4), np.ones(4)),
    csr([0, 3, 2, 1, 4], range(4), np.ones(4)),
    csr(range(5), [0, 1, 2, 9], np.ones(4)),
    csr([0], [], []),
    csr(np.zeros(0, np.int64), [], []),
    csr([0, 1, 2, 3, 2**62], range(4), np.ones(4)),
    csr([1, 1, 2, 3, 4], range(4), np.ones(4)),
    csr(range(5), [1, 0, 3, 2], np.ones(4)),
    *(
        csr(range(5), range(4), np.full(4, x))
        for x in (np.nan, -1.0, 0.0, 1e308, 1e-308)
    ),
    *(
        (np.zeros((n, 2)), np.zeros((m, 2)), np.zeros(k, np.int8), np.zeros(j))
        for n, m, k, j in ((2, 2, 2, 0), (3, 3, 3, 0), (2, 3, 2, 0), (2, 2, 2, 5))
    ),
    (np.full((2, 2), np.nan), np.zeros((2, 2)), np.full(2, 7, np.int8), np.ones(3)),
]


class Engine(NumpyEngine):
    """Keeps the last tangent."""

    tangent: Any = None

    def correction(self, tangent: Any, *rest: Any) -> Any:
        self.tangent = tangent
        return super().correction(tangent, *rest)


def seen_tangent(variables: Any) -> Any:
    """A tangent, which only a step makes."""
    engine = Engine(np.eye(4), variables, [])
    start = np.zeros(4)
    limits = _core.Settings("newton", 1e-10, 50, 1.0)
    _core.ContactPath(variables).step(engine, start, LOAD, NONE, None, limits)
    return engine.tangent


def within_law(call: Call, k: int) -> Call:
    """The call with its argument ``k``, friction coefficients, as a `ContactLaw`."""
    return lambda *args: call(*args[:k], ContactLaw(args[k]), *args[k + 1 :])


def entries() -> dict[str, tuple[Call, list[Any]]]:
    """Every function of the core with valid arguments."""
    condensed = _core.Condensed(EYE, EYE, GAP, LAW, np.zeros(0, np.int64), 2)
    held = _core.Reduced(ISLAND, GAP, LAW, NO_ROWS, NONE)
    floating = _core.Reduced(ISLAND, GAP, LAW, EYE_ROWS, np.array([-1.0, 0.1]))
    law = np.tile([0.0, 0.3], 2), np.zeros(2)
    statics = _core.Statics(EYE_ROWS, 2, np.array([2, 2]), *law)
    cones = _core.ConeSet(EYE_ROWS, np.ones(4), np.array([2, 2]), NO_ROWS, NONE, 2)
    tangents = _core.TangentView(condensed, CLOSED)
    linear = held.tangent(CLOSED, STICKS, ROWS)
    assert linear is not None
    limits = _core.Settings("auto", 1e-10, 50, 1.0)
    none, places = np.zeros(0, np.int64), np.repeat(np.eye(3)[:2], 2, axis=0)
    primal = _core.Primal(EYE, EYE, GAP, LAW, none, 2, places)
    space = np.repeat(np.eye(3)[:2], 3, axis=0)

    def all_rows() -> _core.StiffnessRows:
        rows = _core.StiffnessRows(space, none)
        rows.append(CUBE, space)
        return rows

    iterated, unknowns = _core.PrimalTangent(primal), np.ones(4)
    right = np.ones(ROWS.size // 2 + 4)
    of_primal = _core.LinearisedLaws.of(primal.variables(), CLOSED, STICKS, ROWS)
    # Two free nodes of one body that is held.
    free, blocks, body = np.zeros(4, np.int64), np.ones((2, 4)), np.zeros(2, np.int64)
    interface = [EYE, GAP, MU, free, 0, blocks, body, np.ones(1, np.int64)]
    variables = within_law(_core.ContactVariables, 2)(*interface)
    tangent = seen_tangent(variables)
    laws = _core.LinearisedLaws.of(variables, CLOSED, STICKS, ROWS)
    assert laws is not None
    # One square, its slopes at the centre.
    square = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
    cell = np.arange(4).reshape(4, 1)
    part = np.array([1, 3]), np.arange(4)
    slopes = np.array([[[-0.5, 0.5, 0.5, -0.5], [-0.5, -0.5, 0.5, 0.5]]])
    settings = [limits, None, None, 1]
    plain: list[tuple[Any, ...]] = [
        (_core.respond_points, GAP, np.ones((2, 7))),
        (condensed.free_part, LOAD, NONE),
        (tangent.add_laws, np.zeros(4), np.zeros(4)),
        (tangent.right_side, np.zeros(4), np.zeros(4)),
        (statics.decide, PUSH, 1.0),
        (statics.find_limit, PUSH, PUSH[::-1].copy()),
        (cones.minimise, PUSH),
        (laws.aim, GAP[:1], np.zeros(4)),
        (laws.reactions, GAP[:1], np.zeros(4), np.zeros(4), np.zeros(4)),
        (laws.pulled, GAP[:1], np.zeros(4)),
        (laws.multipliers, GAP[:1], np.zeros(4), np.zeros(4), np.zeros(4)),
        (_core.sum_of_cells, cell, 4, 2, np.ones((1, 64)), part, 1),
        (condensed.with_law, LAW),
        (condensed.with_gap, GAP),
        (held.residual, GAP, None),
        (floating.residual, GAP, np.zeros(2)),
        (_core.isotropic, MU, 3),
        (_core.isotropic, np.ones((2, 2)), 3),
        (held.is_contradiction, np.zeros(2)),
        (_core.find_outside, np.ones(3), 0.0, 2.0),
        (_core.is_sparse, 9, 3),
        (held.assess, GAP),
        (floating.assess, GAP),
        (held.error_bounds, GAP, 1, NONE, GAP),
        (floating.error_bounds, GAP, 1, np.zeros(2)),
        (held.forward_errors, GAP, NONE),
        (floating.forward_errors, GAP, np.zeros(2)),
        (held.tangent, CLOSED, STICKS, ROWS),
        (condensed.assess, LOAD, NONE, None, GAP),
        (condensed.error_bound, LOAD, NONE, None, GAP, GAP, NONE),
        (condensed.forward_errors, LOAD, NONE, None, GAP, NONE),
        (_core.TangentView, condensed, CLOSED),
        (tangents.free_part, LOAD, NONE),
        (tangents.product, GAP, NONE),
        (tangents.system, CLOSED, STICKS, ROWS),
        (linear.solve, RIGHT),
        (linear.solve_transposed, RIGHT),
        (_core.PrimalTangent, primal),
        (iterated.force, LOAD, NONE),
        (iterated.displacement, unknowns, NONE),
        (iterated.solve, of_primal, right, False),
        (iterated.solve, of_primal, right, True),
        (_core.StiffnessRows, space, np.array([0])),
        (_core.bodies, EYE, np.eye(4)[:, :2].copy(), True),
        (_core.diagonal, EYE),
        (_core.resisting_rows, EYE, np.eye(4), np.arange(4)),
        (_core.combine_motions, np.eye(4)[:2].copy()),
        (_core.free_motions, np.eye(4)[:2].copy(), 1e-12),
        (_core.Settings, "auto", 1e-10, 10, 1.0),
    ]
    direct = {
        f"{call.__qualname__} {k}": (call, list(args))
        for k, (call, *args) in enumerate(plain)
    }
    return direct | {
        "project": (within_law(_core.project, 1), [GAP, MU, None]),
        "Condensed": (
            within_law(lambda *a: _core.Condensed(*a, 1).compliance(), 3),
            [EYE, EYE, GAP, MU, np.zeros(0, np.int64)],
        ),
        "displacements": (
            lambda *state: condensed.displacements([state]),
            [LOAD, NONE, GAP, NONE],
        ),
        "displacements, two": (
            lambda *state: condensed.displacements([(LOAD, NONE, GAP, NONE), state]),
            [LOAD, NONE, GAP, NONE],
        ),
        "known": (
            lambda *loads: _core.Condensed(
                EYE, EYE, GAP, LAW, np.zeros(0, np.int64), 1, None, [loads], 10**6
            ),
            [LOAD, NONE],
        ),
        "working set": (
            lambda *arrays: _core.Path(
                within_law(_core.Condensed, 3)(
                    *arrays, np.zeros(0, np.int64), 1, None, None, None, True
                )
            ).step(LOAD, NONE, None, limits),
            [EYE, EYE, GAP, MU],
        ),
        "Primal": (
            lambda *a: _core.PrimalPath(within_law(_core.Primal, 3)(*a)).step(
                LOAD, NONE, None, limits
            ),
            [EYE, EYE, GAP, MU, none, 1, places],
        ),
        "Primal, with_law": (within_law(primal.with_law, 0), [MU]),
        "PrimalPath": (
            lambda *a: _core.PrimalPath(primal, *a).step(LOAD, NONE, None, limits),
            [None, None],
        ),
        "PrimalPath, step": (
            lambda *a: _core.PrimalPath(primal).step(*a),
            [LOAD, NONE, GAP, limits],
        ),
        "ContactVariables": (
            lambda *a: within_law(_core.ContactVariables, 2)(*a).transformation(),
            interface,
        ),
        "ContactVariables, with_law": (within_law(variables.with_law, 0), [MU]),
        "ContactVariables, change": (
            lambda *a: [
                change(*a)
                for change in (
                    variables.to_own_variables,
                    variables.to_displacements,
                    variables.to_local,
                    variables.forces_to_local,
                    variables.terms_of_displacements,
                    variables.terms_of_forces,
                )
            ],
            [np.zeros(4)],
        ),
        "ContactTangent": (
            lambda values: (tangent.clear(values), tangent.springs()),
            [np.zeros(4)],
        ),
        "ContactTangent, transposed": (
            lambda z, out: (tangent.pull(z), tangent.add_transposed(z, out)),
            [np.zeros(4), np.zeros(4)],
        ),
        "ContactVariables, values": (
            lambda y, v, fixed: (
                variables.moved(y),
                variables.work(v),
                variables.offsets(fixed),
            ),
            [np.zeros(4), GAP, NONE],
        ),
        "Statics": (
            lambda *a: _core.Statics(*a).decide(PUSH),
            [EYE_ROWS, 2, np.array([2, 2]), np.tile([0.0, 0.3], 2), np.zeros(2)],
        ),
        "ConeSet": (
            lambda *a: _core.ConeSet(*a).minimise(PUSH),
            [EYE_ROWS, np.ones(4), np.array([2, 2]), NO_ROWS, NONE, 2],
        ),
        "LinearisedLaws": (
            lambda *laws: _core.LinearisedLaws.of(variables, *laws),
            [CLOSED, STICKS, ROWS],
        ),
        "ContactPath": (lambda start: _core.ContactPath(variables, start), [None]),
        "ContactPath, step": (
            lambda *a: _core.ContactPath(variables).step(*a),
            [Engine(np.eye(4), variables, none), LOAD, LOAD, NONE, GAP, limits],
        ),
        "stiffness": (
            lambda *a: _core.stiffness(*a, num_threads=1),
            [square, cell, slopes, np.ones(1), 1.0, np.ones((1, 2)), None, part],
        ),
        "with_law": (within_law(condensed.with_law, 0), [MU]),
        "follow": (
            lambda *loads: _core.follow([_core.Path(condensed)], [[loads]], limits),
            [LOAD, NONE, GAP],
        ),
        "Path": (
            lambda start: _core.Path(condensed, start).step(LOAD, NONE, None, limits),
            [None],
        ),
        "step": (lambda *a: _core.Path(condensed).step(*a), [LOAD, NONE, GAP, limits]),
        "Reduced": (
            lambda *a: within_law(_core.Reduced, 2)(*a).solve(*settings),
            [ISLAND, GAP, MU, EYE_ROWS, np.array([-1.0, 0.1])],
        ),
        "solve": (lambda *a: held.solve(*a, 1), [limits, None, None]),
        "solve, floating": (lambda *a: floating.solve(*a, 1), [limits, GAP, NONE]),
        "TangentView, displacements": (
            lambda *a: tangents.displacements([a]),
            [LOAD, NONE, GAP, NONE],
        ),
        "StiffnessRows, append": (
            lambda *a: _core.StiffnessRows(space, none).append(*a),
            [CUBE, space],
        ),
        "StiffnessRows, bodies": (lambda at: all_rows().bodies(at), [space]),
        "Primal.of_rows": (
            lambda *a: _core.Primal.of_rows(all_rows(), *a),
            [CUBE, np.full((2, 3), -0.1), LAW],
        ),
        "connected": (
            lambda *pairs: _core.connected(4, *pairs),
            [np.array([0, 1]), np.array([1, 2])],
        ),
        "dof_directions": (lambda at: _core.dof_directions(at, 3), [places]),
        "rigid_motions": (
            lambda direction, arm, reach: _core.rigid_motions(direction, arm, 3, reach),
            [np.array([0, 1, 0, 1]), places, 1.0],
        ),
    }


ENTRIES = entries()


def named(name: str) -> tuple[Call, list[Any]]:
    """The first of this name."""
    return next(entry for key, entry in ENTRIES.items() if key.startswith(f"{name} "))


def spoiled(good: list[Any]) -> Iterator[list[Any]]:
    """Each argument replaced by each wrong value, then two at a time."""
    for k, odd in itertools.product(range(len(good)), ODD):
        yield [*good[:k], odd, *good[k + 1 :]]
    choose = random.Random(len(good))
    for _ in range(300):
        args = list(good)
        for k in choose.sample(range(len(good)), min(2, len(good))):
            args[k] = choose.choice(ODD)
        yield args


def test_every_function_of_the_core_is_called() -> None:
    called = {re.split("[,. ]", name)[0] for name in ENTRIES}
    # Constants, functions without an argument that could be wrong, and what is returned.
    rest = {
        "METHODS",
        "CondensationForecast",
        "CondensationStats",
        "LoadStep",
        "build_profile",
        "largest_friction",
        "largest_friction_ratio",
        "largest_reaction",
        "least_work",
        "Decision",
        "LimitLoad",
        "NewtonStep",
        "ProvedBound",
        "ReducedSolution",
        "return_heap",
        "SequenceFields",
        "threads",
        "version",
    }
    rest |= {"least_balanced", "most_loose_bodies"}  # constants
    assert set(_core.__all__) - rest <= called


def called(name: str, place: int, other: Any) -> None:
    """Calls with another argument at this place."""
    call, good = ENTRIES[name]
    call(*good[:place], other, *good[place + 1 :])


@pytest.mark.parametrize("name", ENTRIES)
def test_no_panic(name: str) -> None:
    call, good = ENTRIES[name]
    call(*good)
    failed = 0
    for args in spoiled(good):
        try:
            call(*args)
        except RuntimeError as error:
            # The message of a caught panic says so: it means a fault in the core.
            pytest.fail(f"{args}: {error}")
        except Exception:  # noqa: BLE001 - all that is left is BaseException
            failed += 1
    assert failed > 20


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda: named("Reduced.residual")[0](np.zeros((3, 2))),
            "reaction has length 3",
        ),
        (lambda: named("Reduced.assess")[0](GAP[:1]), "reaction"),
        (
            lambda: _core.Reduced(
                [([0, 0], np.eye(4).ravel(), None)], GAP, LAW, EYE_ROWS, NONE
            ),
            "contact 0 is out of range, or twice",
        ),
        (lambda: ENTRIES["Path"][0](tuple(x[:1] for x in ODD[-1])), "start"),
        (lambda: called("Statics", 1, 2**64 - 1), "motions of R has length 1844"),
        # 2 (2⁶³ − 1) + 6 is 4 in 64 bits.
        (lambda: called("ConeSet", 2, np.array([2**63 - 1] * 2 + [6])), "sizes has"),
    ],
)
def test_indices_beyond_an_array_are_reported(call: Call, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        call()


@pytest.mark.slow
def test_a_dense_W_of_a_hundred_thousand_contacts() -> None:
    """One body, every unknown in contact: S and W have 2e5 rows, 320 GB each."""
    n = 200_000
    eye = sparse.eye_array(n, format="csr")
    chain = sparse.diags_array([-1.0, 3.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    with pytest.raises(MemoryError, match=r"needs \d{12,} bytes"):
        bp.ContactProblem(chain, eye, gap=np.zeros(n // 2), mu=0.3)
    # If each contact has its own body, W is sparse; the dense W is made only on request.
    apart = bp.ContactProblem(eye, eye, gap=np.zeros(n // 2), mu=0.3)
    with pytest.raises(MemoryError, match=rf"needs {8 * n * n} bytes"):
        _ = apart.compliance
    assert apart.solve(-np.ones(n)).success


def test_absurd_sizes_are_refused_and_not_allocated() -> None:
    """Arrays that use no memory but have more than 2³¹ rows, in a process with 3 GB more."""
    eye, given = np.eye(2), {"gap": [0.0], "mu": 0.3}
    huge = np.lib.stride_tricks.as_strided(np.zeros(1), (2**31 + 4, 2), (0, 0))
    long, wide = np.broadcast_to(0.0, 2**40), np.broadcast_to(1.0, (2**17, 2**17))
    none = sparse.coo_array((2**31 + 2, 2**31 + 2))
    calls: list[Call] = [
        lambda: bp.project(huge, 0.3),
        lambda: bp.ReducedProblem(eye, huge, 0.3),
        lambda: bp.ReducedProblem(
            np.broadcast_to(0.0, (2**33, 2**33)), [[-1.0, 0]], 0.3
        ),
        lambda: bp.ReducedProblem(none, [[-1.0, 0]], 0.3),
        lambda: bp.ContactProblem(wide, eye, **given),
        lambda: bp.ContactProblem(eye, eye, gap=long, mu=0.3),
        lambda: bp.ContactProblem(eye, eye, **given, fixed=np.broadcast_to(1, 2**40)),
        lambda: bp.ContactProblem(eye, eye, **given).solve(
            np.broadcast_to(-1.0, (2**40, 2))
        ),
    ]

    def work() -> None:
        most = memory("VmSize") + 3 * 2**30
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        for call in calls:
            with pytest.raises((MemoryError, ValueError), match=r"\w"):
                call()

    assert forked(work).returncode == 0


@pytest.mark.parametrize("method", ["auto", "newton", "gauss_seidel", "nesterov"])
@pytest.mark.slow_variants("gauss_seidel")
def test_numbers_at_the_ends_of_doubles(method: str) -> None:
    """Entries of any size give no panic, no NaN and no wrong solution."""
    rng, refused = np.random.default_rng(17), 0
    sizes = (0.0, 5e-324, 1e-310, 1e-200, 1e-20, 1.0, 1e20, 1e200, 1e307)
    for _ in range(300):
        d = int(rng.integers(2, 4))
        n = int(rng.integers(1, 4))
        W = rng.normal(size=(n * d, n * d)) * rng.choice(sizes, size=(n * d, 1))
        if rng.random() < 0.5:
            W = np.abs(np.diag(W.diagonal()))
        q = rng.normal(size=(n, d)) * rng.choice(sizes, size=(n, 1))
        mu = np.minimum(np.abs(rng.normal(size=n)) * rng.choice(sizes, size=n), 1e308)
        try:
            problem = bp.ReducedProblem(W, q, mu)
        except ValueError:
            refused += 1  # the message asks for other units
            continue
        try:
            solution = problem.solve(method, max_iterations=50)
        except ValueError:
            refused += 1  # so does this one, for products of W that overflow
            continue
        for field in (solution.reaction, solution.relative_displacement):
            assert not np.isnan(field).any()
        assert not np.isnan(solution.residual)
        if solution.converged:
            assert np.isfinite(solution.reaction).all()
        assert solution.message
    assert refused < 200
