"""Refused arguments, in one table: call, argument, value, type of the error, message.

Each call is valid but for one argument. The error names the argument and says what was found;
its message is one line that fits a terminal. Rows with a value that any array or any number
could have are made by `SPOILERS` and `NO_SCALARS`.
"""

import math
import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs.contact.law.contact_law import BESIDE_MU

Array = NDArray[np.float64]
NAN, INF = math.nan, math.inf


class Good(NamedTuple):
    """Arguments of a valid call; the last degree of freedom is prescribed."""

    K: Array
    B: Array
    gap: Array
    mu: Array
    fixed: NDArray[np.int64]
    load: Array
    prescribed: Array
    W: Array
    q: Array


def good(d: int, contacts: int) -> Good:
    """A stiffness of random springs."""
    rng = np.random.default_rng([d, contacts])
    n = d * contacts + 2
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    K = root @ root.T + np.eye(n)
    K = (K + K.T) / 2
    W = np.linalg.inv(K[: n - 2, : n - 2])
    return Good(
        K,
        np.eye(d * contacts, n),
        np.zeros(contacts),
        rng.uniform(0, 0.5, contacts),
        np.array([n - 1]),
        rng.normal(size=n),
        np.zeros(1),
        (W + W.T) / 2,
        rng.normal(size=(contacts, d)),
    )


# Two contacts in the plane on six degrees of freedom.
G = good(2, 2)


def problem(g: Good = G, **changed: Any) -> bp.ContactProblem:
    given = {"K": g.K, "B": g.B, "gap": g.gap, "mu": g.mu, "fixed": g.fixed}
    return bp.ContactProblem(**given | changed)


def reduced(g: Good = G, **changed: Any) -> bp.ReducedProblem:
    return bp.ReducedProblem(**{"W": g.W, "q": g.q, "mu": g.mu} | changed)


def whole(g: Good = G, **changed: Any) -> bp.fclib.GlobalProblem:
    given = {"M": g.K, "H": g.B.T, "f": g.load, "w": g.q, "mu": g.mu}
    return bp.fclib.GlobalProblem(**given | changed)


def project(g: Good = G, **changed: Any) -> Any:
    return bp.project(**{"tau": g.q, "mu": g.mu} | changed)


def wear(g: Good = G, **changed: Any) -> Any:
    given = {"load": [g.load, -g.load], "coefficient": 1e-9, "cycles": 3}
    return problem(g, area=[1.0, 1.0]).wear(**given | changed)


def state(_: Good = G, **changed: Any) -> bp.State:
    at = {"reaction": [[1.0, 0.0]], "relative_displacement": [[0.0, 0.0]]}
    return bp.State(**at | changed)


def moving_gaps(_: Good = G, **changed: Any) -> bp.MovingGaps:
    given = {"gap": [0.0], "frame": [np.eye(2)], "drag": [[0.0, 0.0]]}
    return bp.MovingGaps(**given | changed)


def few_digits(g: Good = G, **changed: Any) -> bp.ContactProblem:
    at = np.repeat([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], 2, axis=0)
    return problem(g, **{"coordinates": at, "stiffness_rtol": 1e-8} | changed)


Call = Callable[..., Any]


def method(name: str, make: Call, **given: str) -> Call:
    """A method of what ``make`` makes; ``given`` are the fields that it takes."""

    def call(g: Good = G, **changed: Any) -> Any:
        fields = {argument: getattr(g, field) for argument, field in given.items()}
        return getattr(make(g), name)(**fields | changed)

    call.__name__ = f"{make.__name__} {name}"
    return call


solve, follow = (
    method(name, problem, load="load", prescribed="prescribed")
    for name in ("solve", "follow")
)
step = method("reduced", problem, load="load")
reduced_solve, answers = method("solve", reduced), method("answers", reduced)
residual, whole_residual = (method("residual", it, r="q") for it in (reduced, whole))
velocity = method("velocity", whole, solution="q")
jvp, vjp, save, write = (method(k, solve) for k in ("jvp", "vjp", "save", "write"))
reduced_jvp, reduced_vjp = (method(name, reduced_solve) for name in ("jvp", "vjp"))


def refused(
    call: Call, argument: str, value: Any, error: Any, message: str, **more: Any
) -> None:
    """Check the type of the error, and its message for the argument and the words."""
    with pytest.raises((ValueError, TypeError)) as caught:
        call(**{argument: value}, **more)
    text = str(caught.value)
    assert type(caught.value) in (error if isinstance(error, tuple) else (error,))
    for part in (rf"\b{argument}\b", message):
        assert re.search(part, text), f"{part!r} not in {text!r}"
    assert "\n" not in text
    assert len(text) < 300


def put(array: Any, at: Any, value: Any) -> Array:
    """A copy with one entry changed."""
    array = np.array(array, dtype=float)
    array[at] = value
    return array


def rigid(R: Any = None, e: Any = None) -> Any:
    return (np.tile(np.eye(2), (2, 1)) if R is None else R), (
        np.zeros(2) if e is None else e
    )


class Drawn:
    """Neither a number nor an array."""


HALF = np.tril(G.K)
# The negative entry is away from contact.
LONE = np.diag([0, 0, 0, 0, -1.0, 0])
LONE[np.ix_(*[[0, 1, 2, 3, 5]] * 2)] = np.delete(np.delete(G.K, 4, 0), 4, 1)
FRAMES = [
    np.array([np.eye(2), wrong])
    for wrong in (
        np.zeros((2, 2)),
        2 * np.eye(2),
        [[1, 0], [0.1, 1]],
        1e200 * np.eye(2),
    )
]
OTHER = solve(good(2, 3))
VALUE, TYPE, EITHER = ValueError, TypeError, (ValueError, TypeError)
# The call, the argument, its value, the type of the error, what the message says besides.
TABLE: list[tuple[Call, str, Any, Any, str]] = [
    # Numbers that are not finite: the place.
    (problem, "K", put(G.K, (2, 2), NAN), VALUE, r"finite.*\b2\b"),
    (problem, "K", sparse.csr_array(put(G.K, (3, 3), INF)), VALUE, r"finite.*\b3\b"),
    (problem, "B", sparse.csr_array(put(G.B, (1, 1), NAN)), VALUE, r"finite.*\b1\b"),
    (problem, "gap", [0.0, NAN], VALUE, r"\b1\b.*finite"),
    (problem, "mu", [0.3, INF], VALUE, r"\b1\b.*finite"),
    (problem, "area", [1.0, NAN], VALUE, r"\b1\b.*finite"),
    (problem, "points", [[0.0, 0.0], [INF, 0.0]], VALUE, r"\b1\b"),
    (solve, "load", put(G.load, 2, NAN), VALUE, r"\b2\b.*finite|finite.*\b2\b"),
    (solve, "load", put([G.load] * 2, (1, 3), -INF), VALUE, "finite"),
    (solve, "prescribed", [NAN], VALUE, "finite"),
    (reduced, "q", put(G.q, (1, 0), NAN), VALUE, r"\b1\b"),
    (reduced, "rigid", rigid(np.full((4, 1), NAN), np.ones(1)), VALUE, "finite"),
    (reduced, "rigid", rigid(e=[INF, 0.0]), VALUE, "finite"),
    # Shapes: that found and that expected.
    (problem, "K", G.K[:3], VALUE, "square|shape"),
    (problem, "B", sparse.csr_array(np.eye(5)), VALUE, "5.*6"),
    (problem, "B", sparse.csr_array(np.ones((3, 6))), VALUE, r"\b3\b"),
    (problem, "gap", np.zeros(3), VALUE, "3.*[24]"),
    (problem, "gap", np.zeros((2, 3)), VALUE, "3"),
    (problem, "points", np.ones((2, 3)), VALUE, "3.*2"),
    (problem, "dim", 4, VALUE, "4.*2.*3"),
    (problem, "dim", 3, VALUE, "3"),
    (problem, "dim", np.array([2, 3]), VALUE, "dim"),
    (solve, "load", np.ones(3), VALUE, "3.*6"),
    (solve, "prescribed", [0.0, 0.0], VALUE, "2.*1"),
    (reduced, "W", G.W[:3], VALUE, "3.*4"),
    (reduced, "q", np.ones((1, 4)), VALUE, "4.*2.*3"),
    (reduced, "rigid", rigid(np.ones((3, 1)), np.ones(1)), VALUE, "3.*4"),
    (reduced, "rigid", rigid(np.ones((4, 2)), np.ones(1)), VALUE, "1.*2"),
    (reduced, "rigid", 5, TYPE, "pair|tuple|rigid"),
    (reduced, "rigid", sparse.csr_array((4, 1)), TYPE, "the pair"),
    (project, "tau", np.ones((2, 4)), VALUE, "4.*2.*3"),
    # Ranges.
    (problem, "mu", [0.3, -0.1], VALUE, r"contact 1\b.*-0\.1"),
    (reduced, "mu", [-0.1, 0.3], VALUE, r"contact 0\b.*-0\.1"),
    (project, "mu", -0.1, VALUE, r"-0\.1"),
    *((call, "mu", [0.3, 1.1e75], VALUE, r"contact 1 is 1\.1e\+75, expected at most 1e\+75: prod")
      for call in (problem, reduced, whole, project)),
    (problem, "dilatancy", "loose", EITHER, "dilatancy"),
    *(
        (problem, name, value, VALUE, message)
        for name, value, message in (
            ("cohesion", [0.1, -0.5], r"contact 1 is -0\.5, expected zero or pos"),
            ("cohesion", [0.1] * 3, "3.*2"),
            ("cohesion", [NAN, 0.0], r"\b0\b.*finite"),
            ("dilatancy", [0.0, 0.6], r"contact 1 is 0\.6, expected zero to mu"),
        )
    ),
    (reduced, "cohesion", [0.1, -0.5], VALUE, r"contact 1 is -0\.5, expected zero or pos"),
    (reduced, "cohesion", 1.1e150, VALUE, r"contact 0 is 1\.1e\+?150.*at most 1e150"),
    (reduced, "cohesion", [0.1] * 3, VALUE, "3.*2"),
    (reduced, "dilatancy", [0.0, -0.5], VALUE, r"contact 1 is -0\.5, expected zero to mu"),
    (reduced, "dilatancy", [0.0, 0.6], VALUE, r"contact 1 is 0\.6, expected zero to mu"),
    (problem, "area", [1.0, 0.0], VALUE, r"\b1\b.*positive"),
    (problem, "area", [-2.0, 1.0], VALUE, r"\b0\b.*-2.*positive"),
    (problem, "num_threads", 0, VALUE, r"\b0\b"),
    (problem, "num_threads", 1025, VALUE, "is 1025, expected 1 to 1024"),
    (reduced_solve, "num_threads", 2**70, VALUE, "1024"),
    (reduced_solve, "max_iterations", 10**30, VALUE, "max_iterations"),
    (solve, "max_iterations", 1.5, TYPE, "max_iterations"),
    *((call, "tol", tol, VALUE, "positive") for call in (solve, reduced_solve)
      for tol in (0, -1e-10)),
    *((call, "max_seconds", 0, VALUE, r"\b0\b.*positive") for call in (solve, reduced_solve)),
    *((call, "method", "magic", VALUE, "magic.*gauss_seidel.*uzawa|magic.*uzawa")
      for call in (solve, reduced_solve)),
    *((problem, "frame", frame, VALUE, "^frame of contact 1 has the rows") for frame in FRAMES),
    # Indices.
    (problem, "fixed", [[1], [2, 3]], VALUE, "not an array"),
    (problem, "fixed", [1, 6], VALUE, r"\b6\b"),
    (problem, "fixed", [-(2**62)], VALUE, str(-(2**62))),
    (problem, "fixed", [1, 2, 1], VALUE, r"\b1 repeated"),
    (problem, "fixed", [0.5], TYPE, "integer"),
    (problem, "fixed", ["1"], TYPE, "integer"),
    (problem, "fixed", [[0, 1]], VALUE, "dimension"),
    (problem, "fixed", np.arange(6) == 5, TYPE, "mask"),
    # Types.
    *((call, "friction", 0.3, TYPE, "friction")
      for call in (problem, solve, reduced, reduced_solve, project)),
    *((problem, name, None, EITHER, "object") for name in ("K", "B", "gap", "mu")),
    *((reduced, name, None, EITHER, "object") for name in ("W", "q", "mu")),
    (problem, "K", "stiffness", EITHER, "K"),
    (problem, "mu", "slippery", EITHER, "mu"),
    (problem, "K", sparse.coo_array(G.K).astype(complex), TYPE, "complex"),
    (reduced, "W", sparse.coo_array(G.W).astype(complex), TYPE, "complex"),
    (project, "tau", [np.ma.masked_array([1.0, 2.0], [False, True]), np.ones(2)], VALUE,
     "tau has masked"),
    (write, "path", "x.vtu", VALUE, r"NAME\.pvd"),
    # States of another problem.
    *((call, "start", start, VALUE, "shape") for call in (solve, step)
      for start in (OTHER, OTHER[0])),
    (reduced_solve, "start", reduced_solve(good(2, 3)), VALUE, r"\(3, 2\)"),
    (solve, "start", reduced_solve(good(2, 3)), EITHER, "Solution"),
    (reduced_solve, "start", reduced(rigid=rigid(e=[-1.0, 0.0])).solve(), VALUE,
     "2 rigid motions"),
    (state, "reaction", [[-1.0, 0.0]], VALUE, "pulls at contact 0: .* expected r_n >= 0"),
    (state, "reaction", [1.0, 0.0], VALUE, "has 1 dimension, expected 2"),
    (state, "reaction", [[NAN, 0.0]], VALUE, "is nan at"),
    (state, "reaction", [[1.0]], VALUE, r"has shape \(1, 1\)"),
    (state, "relative_displacement", [[0.0, 0.0, 0.0]], VALUE, r"has shape \(1, 3\)"),
    (state, "broken", [True, True], VALUE, r"\(2,\).*\(1,\)"),
    (state, "broken", [1], VALUE, "int64.*booleans"),
    (state, "broken", "no", VALUE, "booleans"),
    (state, "dilation", [NAN], VALUE, ""),
    (state, "dilation", [-1.0], VALUE, "of contact 0 is -1, expected zero or"),
    # Gaps of a step and of a path.
    (step, "gap", np.zeros((3, 2)), VALUE, r"has shape \(3, 2\), expected \(2,\) or"),
    (solve, "gap", np.zeros(5), VALUE, r"has shape \(5,\), expected \(2,\), \(steps, 2\) or"),
    (solve, "gap", np.zeros((3, 2, 3)), VALUE, r"has shape \(3, 2, 3\)"),
    (solve, "gap", np.full((4, 2), NAN), VALUE, r"is nan at \(0, 0\), expected finite numbers"),
    (moving_gaps, "gap", 0.0, VALUE, r"of the moving gaps has shape \(\)"),
    (moving_gaps, "gap", [NAN], VALUE, "of the moving gaps"),
    (moving_gaps, "drag", [0.0, 0.0], VALUE, r"of the moving gaps has shape \(2,\)"),
    (moving_gaps, "drag", [[0.0]], VALUE, r"of the moving gaps has shape \(1, 1\)"),
    (moving_gaps, "frame", [2 * np.eye(2)], VALUE, "frame of contact 0 has the rows"),
    (moving_gaps, "frame", np.eye(2), VALUE, "of the moving gaps has shape"),
    # Automatic load steps.
    (follow, "stops", [1.0, 1.0], VALUE, r"is \[1.0, 1.0\], expected ascending"),
    (follow, "stops", [], VALUE, "expected ascending"),
    (follow, "stops", [0.0, 1.0], VALUE, "the first above zero"),
    (follow, "first", 2.0, VALUE, "smallest, first and largest are"),
    (follow, "smallest", 0.0, VALUE, "smallest, first and largest are 0,"),
    (follow, "largest", "x", TYPE, "is 'x', expected a number"),
    (follow, "slip", -1.0, VALUE, "is -1, expected a positive length"),
    (follow, "load", [1.0], VALUE, r"has shape \(1,\), expected \(6,\)"),
    (follow, "load", lambda _: [1.0], VALUE, r"at s = 1 has shape \(1,\), expected \(6,\)"),
    (follow, "load", lambda _: [1.0, NAN] * 3, VALUE, "at s = 1 is nan"),
    (follow, "gap", lambda _: [0.0] * 3, VALUE, r"at s = 1 has shape \(3,\), expected"),
    (follow, "gap", [0.0, 0.0], TYPE, "expected a function, or None"),
    (follow, "on_step", 3, TYPE, "is 3, expected a function"),
    (follow, "method", 3, TYPE, "is 3, expected a name"),
    # Wear.
    (wear, "load", np.zeros((0, 6)), VALUE, "no load steps, expected a cycle of at least"),
    (wear, "coefficient", -1e-9, VALUE, "of contact 0 is -1e-09, expected zero or"),
    (wear, "coefficient", [1.0] * 3, VALUE, r"has shape \(3,\), expected a number"),
    (wear, "coefficient", NAN, VALUE, ""),
    (wear, "cycles", 0, VALUE, "is 0, expected"),
    (wear, "cycles", 1.5, EITHER, "is 1.5, expected"),
    (wear, "rtol", 0.0, VALUE, "is 0, expected a number between 0 and 1"),
    (wear, "jump", 1, TYPE, "is 1, expected a bool"),
    (wear, "on_cycle", 1, TYPE, "is 1, expected a function"),
    (wear, "start", 1, TYPE, "is"),
    # Derivatives.
    (problem, "gaps", "abc", TYPE, "gaps has entries of type"),
    (problem, "gaps", [[NAN, 0.0]], VALUE, r"gaps is nan at \(0, 0\)"),
    (reduced_jvp, "W", sparse.csr_array(np.diag([NAN, 1, 1, 1])), VALUE, "not finite"),
    (jvp, "load", np.ones(7), VALUE, "has shape"),
    (jvp, "load", np.ones((2, 6)), VALUE, "has 2 steps"),
    (jvp, "gap", np.ones(77), VALUE, "has shape"),
    (jvp, "mu", np.ones(77), VALUE, "has shape"),
    (jvp, "K", np.eye(7), VALUE, "has shape"),
    (jvp, "K", sparse.csr_array(np.triu(np.ones((6, 6)))), VALUE, "is not symmetric"),
    (vjp, "reaction", "much", TYPE, ""),
    (vjp, "slip", np.ones(3), VALUE, "has shape"),
    (reduced_jvp, "W", np.eye(3), VALUE, r"has shape \(3, 3\), expected \(4, 4\)"),
    (reduced_jvp, "q", [1.0], VALUE, "has shape"),
    (reduced_vjp, "reaction", [1.0], VALUE, "has shape"),
    # Stiffnesses.
    (few_digits, "stiffness_rtol", 0.0, VALUE, "is 0, expected the relative"),
    (few_digits, "stiffness_rtol", 0.1, VALUE, "above 0 and at most 0.001"),
    (few_digits, "stiffness_rtol", NAN, VALUE, "is nan"),
    (few_digits, "stiffness_rtol", "8", TYPE, "is '8', expected a number"),
    (few_digits, "coordinates", None, VALUE, "stiffness_rtol needs coordinates"),
    (problem, "K", HALF, VALUE, r"symmetric.*triangle only.*tril\(K, -1\)"),
    (problem, "K", HALF.T, VALUE, r"symmetric.*triangle only.*triu\(K, 1\)"),
    (problem, "K", put(put(G.K, (0, 1), G.K[0, 1] + 1e-5), (2, 3), 7.5), VALUE,
     r"symmetric.*\[2, 3\].*7\.5|symmetric.*\[3, 2\].*7\.5"),
    (problem, "K", G.K - 3 * np.eye(6), VALUE, "definite"),
    (problem, "K", put(G.K, (4, 4), -1.0), VALUE, r"definite"),
    (problem, "K", LONE, VALUE, r"\b4\b"),
    (problem, "K", put(G.K, (0, 0), -1e-3), VALUE, "indefinite"),
]  # fmt: skip


@pytest.mark.parametrize(
    "row", TABLE, ids=lambda row: f"{row[0].__name__}, {row[1]}: {row[4]}"
)
def test_an_argument_is_refused(row: tuple[Call, str, Any, Any, str]) -> None:
    call, argument, value, error, message = row
    refused(call, argument, value, error, message)


# Each array argument, with a valid value.
ARRAYS: dict[tuple[Call, str], Callable[[Good], Array]] = {
    (problem, "K"): lambda g: g.K,
    (problem, "B"): lambda g: g.B,
    (problem, "gap"): lambda g: g.gap,
    (problem, "mu"): lambda g: g.mu,
    (problem, "area"): lambda g: np.ones_like(g.gap),
    (problem, "points"): lambda g: np.ones_like(g.q),
    (problem, "frame"): lambda g: np.tile(np.eye(g.q.shape[1]), (len(g.q), 1, 1)),
    (solve, "load"): lambda g: g.load,
    (solve, "prescribed"): lambda g: g.prescribed,
    (step, "load"): lambda g: g.load,
    (reduced, "W"): lambda g: g.W,
    (reduced, "q"): lambda g: g.q,
    (reduced, "mu"): lambda g: g.mu,
    (reduced, "cohesion"): lambda g: 0 * g.mu,
    (reduced, "dilatancy"): lambda g: 0 * g.mu,
    (residual, "r"): lambda g: g.q,
    (reduced_solve, "start"): lambda g: g.q,
    (whole, "M"): lambda g: g.K,
    (whole, "H"): lambda g: g.B.T,
    (whole, "f"): lambda g: g.load,
    (whole, "w"): lambda g: g.q,
    (whole, "mu"): lambda g: g.mu,
    (whole_residual, "r"): lambda g: g.q,
    (velocity, "solution"): lambda g: g.q,
    (project, "tau"): lambda g: g.q,
    (project, "mu"): lambda g: g.mu,
    (project, "base"): lambda g: g.q,
}
# An array that is too long may be reported by the argument whose length it contradicts.
LENGTH = "shape|dimension|rows|columns|expected"


def _put(array: Array, value: Any, kind: Any = None) -> Any:
    spoiled = np.array(array, dtype=kind)
    spoiled.flat[spoiled.size // 2] = value
    return spoiled


def _masked(array: Array) -> Any:
    return np.ma.masked_array(array, _put(np.zeros(array.shape, bool), True))


SPOILERS: dict[str, tuple[Callable[[Array], Any], str]] = {
    "nan": (lambda a: _put(a, NAN), "nan|NaN"),
    "infinite": (lambda a: _put(a, -INF), "inf"),
    "longer": (lambda a: np.concatenate([a, a[:1]]), LENGTH),
    "wider": (lambda a: np.stack([a] * 2, axis=-1), LENGTH),
    "boxed": (lambda a: np.ones((1,) * (a.ndim + 1)), LENGTH),
    "text": (lambda a: a.astype(str), "type"),
    "objects": (lambda a: _put(a, None, object), "type object"),
    "complex": (lambda a: _put(a, 0j, complex), "complex"),
    "booleans": (lambda a: a > 0, "bool"),
    "masked": (_masked, "mask"),
    "dates": (lambda a: (a * 8).astype("m8[s]"), "type"),
    "too large": (lambda a: _put(a, np.longdouble("1e4000"), np.longdouble), ""),
    "ragged": (lambda a: [a.tolist(), [a.tolist()]], "array|type|shape|dimension"),
    "nothing": (lambda _: {"an": "object"}, "type|dimension"),
}


def _is_legal(argument: str, spoiler: str, d: int) -> bool:
    """A gap with all components, friction along two tangents, a path of one step."""
    return (
        (spoiler == "wider" and argument == "gap")
        or (spoiler == "wider" and argument == "mu" and d == 3)
        or (spoiler == "boxed" and argument == "prescribed")
    )


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("call", "argument"), ARRAYS, ids=[f"{c.__name__}-{a}" for c, a in ARRAYS]
)
def test_a_spoiled_array(call: Call, argument: str, d: int) -> None:
    for contacts in (2, 3):
        base = good(d, contacts)
        array = ARRAYS[call, argument](base)
        call(base, **{argument: array})  # the unchanged array works
        for name, (spoil, message) in SPOILERS.items():
            if _is_legal(argument, name, d):
                continue
            named = argument if message != LENGTH else ""
            with pytest.raises((ValueError, TypeError)) as caught:
                call(base, **{argument: spoil(array)})
            text = str(caught.value)
            assert type(caught.value) in (ValueError, TypeError), name
            assert re.search(rf"\b{named}", text), (name, text)
            assert re.search(message, text), (name, text)
            assert "\n" not in text
            assert len(text) < 300


SCALARS: list[tuple[Call, str]] = [
    *((call, name) for call in (solve, reduced_solve)
      for name in ("tol", "max_seconds", "max_iterations", "method")),
    (problem, "num_threads"), (reduced_solve, "num_threads"), (problem, "dim"),
    (answers, "restarts"), (answers, "seed"), (solve, "on_step"),
    (reduced_solve, "callback"), (solve, "start"),
]  # fmt: skip
# Values that are invalid for all of these arguments.
NO_SCALARS = (
    *(-1, -0.5, NAN, -INF, True, np.True_, "tight", b"auto", 1j, np.complex128(1e-9)),
    *([1e-9], {}, object(), np.ones(3), np.ma.masked, Fraction(-1, 3), 10**400),
    *(-(10**400), Drawn()),
)


@pytest.mark.parametrize(
    ("call", "argument"), SCALARS, ids=[f"{c.__name__}-{a}" for c, a in SCALARS]
)
def test_a_spoiled_scalar(call: Call, argument: str) -> None:
    for value in NO_SCALARS:
        refused(call, argument, value, EITHER, "")


@pytest.mark.parametrize("what", BESIDE_MU)
def test_what_is_not_derived_for_cohesion_and_dilatancy(what: str) -> None:
    law = {what: 0.1, "mu": 0.5, "area": np.ones(2)}
    refused(problem, "working_set", True, VALUE, "cohesion or dilatancy", **law)
    with pytest.raises(
        ValueError, match=f"wear is not derived for contacts with {what}"
    ):
        problem(**law).wear(np.zeros(6), coefficient=1.0, cycles=2)


@pytest.mark.parametrize("what", BESIDE_MU)
def test_cohesion_or_dilatancy_with_two_coefficients(what: str) -> None:
    g = good(3, 2)
    two = np.array([[0.3, 0.2], [0.3, 0.3]])
    assert reduced(g, mu=two, **{what: np.zeros(2)}).mu.shape == (2, 2)
    with pytest.raises(
        ValueError, match=rf"^mu has two coeff.* {what} of contact 1 is"
    ):
        reduced(g, mu=two, **{what: [0.0, 0.1]})


@pytest.mark.parametrize("form", ["csr", "csc", "bsr", "coo"])
@pytest.mark.parametrize(
    ("call", "argument"), [(problem, "K"), (problem, "B"), (reduced, "W")]
)
@pytest.mark.parametrize("fault", ["index", "negative", "pointer", "down"])
def test_a_broken_sparse_matrix(
    call: Call, argument: str, form: str, fault: str
) -> None:
    """SciPy's conversions would follow these indices out of the arrays."""
    matrix = sparse.csr_array(ARRAYS[call, argument](G))
    broken = (
        sparse.bsr_array(matrix, blocksize=(1, 1))
        if form == "bsr"
        else matrix.asformat(form, copy=True)
    )
    if form == "coo":
        indices = broken.row if fault in ("index", "pointer") else broken.col
        indices[1] = -1 if fault == "negative" else 10**6
    elif fault in ("index", "negative"):
        broken.indices[1] = -7 if fault == "negative" else 10**6
    elif fault == "pointer":
        broken.indptr[-1] += 10**6
    else:
        broken.indptr[1] = broken.indptr[-1]
        broken.indptr[2] = 0
    refused(call, argument, broken, VALUE, "broken sparse matrix")


@pytest.mark.parametrize("form", ["dense", "csr", "csc", "coo"])
def test_an_asymmetric_entry_is_named(form: str) -> None:
    base = good(2, 3)
    for i, j in ((0, 1), (5, 2), (7, 6), (3, 4)):
        for amount in (1e-6, 1.0, 1e3):
            spoiled = base.K.copy()
            spoiled[i, j] += amount
            if form != "dense":
                spoiled = sparse.csr_array(spoiled).asformat(form)
            place = rf"symmetric.*(\[{i}, {j}\]|\[{j}, {i}\])"
            refused(lambda K: problem(base, K=K), "K", spoiled, VALUE, place)


def test_arguments_that_are_wrong_together() -> None:
    with pytest.raises(ValueError, match="base"):
        bp.project([[1.7e308, 0.0]], 0.3, base=[[1.7e308, 0.0]])
    with pytest.raises(ValueError, match=r"load.*prescribed|prescribed.*load"):
        problem().solve([G.load] * 2, np.zeros((3, 1)))


@pytest.mark.needs_extra
def test_a_path_that_is_none() -> None:
    for call in (save, bp.load_result):
        for path in (3.0, None, ["x.h5"], np.ones(2)):
            refused(call, "path", path, TypeError, "")
