"""Calls with one wrong argument raise an error with a message.

Each test makes a valid call and changes one argument. The call must raise a
`ValueError` or `TypeError` that names the argument and what was found. It must not
return, and it must not raise anything else.
"""

import math
import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import sparse

import bipot_rs as bp
from bipot_rs import analytic, fem
from bipot_rs.files import export
from bipot_rs.plots import run_figure

Array = NDArray[np.float64]


class Good(NamedTuple):
    """Arguments of a valid call."""

    K: Array
    B: Array
    gap: Array
    mu: Array
    fixed: NDArray[np.int64]
    load: Array
    prescribed: Array
    W: Array
    q: Array


def good(d: int, contacts: int, seed: int) -> Good:
    """A stiffness of random springs, with the last degree of freedom prescribed."""
    rng = np.random.default_rng([d, contacts, seed])
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


def _problem(call: Good, **options: Any) -> bp.ContactProblem:
    given = {"gap": call.gap, "mu": call.mu, "fixed": call.fixed} | options
    return bp.ContactProblem(call.K, call.B, **given)


def _reduced(call: Good, **options: Any) -> bp.ReducedProblem:
    return bp.ReducedProblem(call.W, call.q, call.mu, **options)


def _global(call: Good, **spoiled: Any) -> bp.fclib.GlobalProblem:
    given = {"M": call.K, "H": call.B.T, "f": call.load, "w": call.q, "mu": call.mu}
    return bp.fclib.GlobalProblem(**(given | spoiled))


# Each function takes the valid arguments and the changed one.
Call = Callable[[Good, Any], Any]
ARRAYS: dict[str, tuple[Call, Callable[[Good], Array]]] = {
    "K": (lambda c, x: _problem(c._replace(K=x)), lambda c: c.K),
    "B": (lambda c, x: _problem(c._replace(B=x)), lambda c: c.B),
    "gap": (lambda c, x: _problem(c._replace(gap=x)), lambda c: c.gap),
    "mu": (lambda c, x: _problem(c._replace(mu=x)), lambda c: c.mu),
    "area": (lambda c, x: _problem(c, area=x), lambda c: np.ones_like(c.gap)),
    "points": (lambda c, x: _problem(c, points=x), lambda c: np.ones_like(c.q)),
    "frame": (
        lambda c, x: _problem(c, frame=x),
        lambda c: np.tile(np.eye(c.q.shape[1]), (len(c.q), 1, 1)),
    ),
    "load": (lambda c, x: _problem(c).solve(x), lambda c: c.load),
    "prescribed": (lambda c, x: _problem(c).solve(c.load, x), lambda c: c.prescribed),
    "load ": (lambda c, x: _problem(c).reduced(x), lambda c: c.load),
    "W": (lambda c, x: _reduced(c._replace(W=x)), lambda c: c.W),
    "q": (lambda c, x: _reduced(c._replace(q=x)), lambda c: c.q),
    "mu ": (lambda c, x: _reduced(c._replace(mu=x)), lambda c: c.mu),
    "rigid": (
        lambda c, x: _reduced(c, rigid=(x, np.zeros(c.q.shape[1]))),
        lambda c: np.tile(np.eye(c.q.shape[1]), (len(c.q), 1)),
    ),
    "rigid ": (
        lambda c, x: _reduced(
            c, rigid=(np.tile(np.eye(c.q.shape[1]), (len(c.q), 1)), x)
        ),
        lambda c: np.ones(c.q.shape[1]),
    ),
    "r": (lambda c, x: _reduced(c).residual(x), lambda c: c.q),
    "start": (lambda c, x: _reduced(c).solve(start=x), lambda c: c.q),
    "M": (lambda c, x: _global(c, M=x), lambda c: c.K),
    "H": (lambda c, x: _global(c, H=x), lambda c: c.B.T),
    "f": (lambda c, x: _global(c, f=x), lambda c: c.load),
    "w": (lambda c, x: _global(c, w=x), lambda c: c.q),
    "mu   ": (lambda c, x: _global(c, mu=x), lambda c: c.mu),
    "r ": (lambda c, x: _global(c).residual(x), lambda c: c.q),
    "solution": (lambda c, x: _global(c).velocity(x), lambda c: c.q),
    "tau": (lambda c, x: bp.project(x, c.mu), lambda c: c.q),
    "mu  ": (lambda c, x: bp.project(c.q, x), lambda c: c.mu),
    "base": (lambda c, x: bp.project(c.q, c.mu, base=x), lambda c: c.q),
}

# Changes of an array, and the words that the message must have besides the argument.
# A number from 0 to 1 chooses the place.
Spoiled = tuple[Any, str]


def _put(array: Array, where: float, value: Any) -> tuple[Array, int]:
    spoiled = np.array(array)
    at = min(int(where * spoiled.size), spoiled.size - 1)
    spoiled.flat[at] = value
    return spoiled, at


def _nan(array: Array, where: float) -> Spoiled:
    return _put(array, where, np.nan)[0], "nan|NaN"


def _infinite(array: Array, where: float) -> Spoiled:
    return _put(array, where, -np.inf)[0], "inf"


def _longer(array: Array, _: float) -> Spoiled:
    return np.concatenate([array, array[:1]]), str(len(array) + 1)


def _wider(array: Array, _: float) -> Spoiled:
    return np.stack([array] * 2, axis=-1), "shape|dimension"


def _scalar_in_a_box(array: Array, _: float) -> Spoiled:
    return np.ones((1,) * (array.ndim + 1)), "shape|dimension|columns"


def _text(array: Array, _: float) -> Spoiled:
    return array.astype(str), "type"


def _objects(array: Array, where: float) -> Spoiled:
    return _put(array.astype(object), where, None)[0], "type object"


def _complex(array: Array, where: float) -> Spoiled:
    return _put(array.astype(complex), where, 0j)[0], "complex"


def _booleans(array: Array, _: float) -> Spoiled:
    return array > 0, "bool"


def _masked(array: Array, where: float) -> Spoiled:
    mask = _put(np.zeros(array.shape, bool), where, True)[0]
    return np.ma.masked_array(array, mask), "mask"


def _ragged(array: Array, _: float) -> Spoiled:
    return [array.tolist(), [array.tolist()]], "array|type|shape|dimension"


def _nothing(_a: Array, _w: float) -> Spoiled:
    return {"an": "object"}, "type|dimension"


SPOILERS = (
    _nan,
    _infinite,
    _longer,
    _wider,
    _scalar_in_a_box,
    _text,
    _objects,
    _complex,
    _booleans,
    _masked,
    _ragged,
    _nothing,
)


def refused(call: Callable[[], Any], argument: str, *said: str) -> None:
    with pytest.raises((ValueError, TypeError)) as caught:
        call()
    message = str(caught.value)
    assert type(caught.value) in (ValueError, TypeError)
    for part in (rf"\b{argument.strip()}\b", *said):
        assert re.search(part, message), f"{part!r} not in {message!r}"
    # One line that fits a terminal.
    assert "\n" not in message
    assert len(message) < 300


@settings(max_examples=500, derandomize=True)
@given(
    argument=st.sampled_from(sorted(ARRAYS)),
    spoil=st.sampled_from(SPOILERS),
    d=st.sampled_from([2, 3]),
    contacts=st.integers(1, 4),
    where=st.floats(0, 1),
)
@pytest.mark.slow
def test_a_spoiled_array(
    argument: str,
    spoil: Callable[[Array, float], Spoiled],
    d: int,
    contacts: int,
    where: float,
) -> None:
    base = good(d, contacts, 0)
    call, taken = ARRAYS[argument]
    array = taken(base)
    call(base, array)  # # the unchanged array works
    spoiled, said = spoil(array, where)
    legal = (
        # These calls are also valid: a gap with all components, friction along two tangents, a
        # third row for one contact, a path of one step.
        (spoil is _wider and argument == "gap")
        or (spoil is _wider and argument.strip() == "mu" and d == 3)
        or (spoil is _longer and argument == "B" and d == 2 and contacts == 1)
        or (spoil is _scalar_in_a_box and argument == "prescribed")
    )
    if not legal:
        # An array that is too long may be reported by the argument whose length it contradicts.
        named = argument
        if spoil in (_longer, _wider, _scalar_in_a_box):
            named = rf"{argument.strip()}\b|\b(gap|q|W|B|K|M|H|f|w|mu|rigid|e of rigid)"
            said = "shape|dimension|rows|columns|expected"
        refused(lambda: call(base, spoiled), named, said)


SCALARS: dict[str, Call] = {
    "tol": lambda c, x: _problem(c).solve(c.load, tol=x),
    "tol ": lambda c, x: _reduced(c).solve(tol=x),
    "max_seconds": lambda c, x: _problem(c).solve(c.load, max_seconds=x),
    "max_seconds ": lambda c, x: _reduced(c).solve(max_seconds=x),
    "max_iterations": lambda c, x: _problem(c).solve(c.load, max_iterations=x),
    "max_iterations ": lambda c, x: _reduced(c).solve(max_iterations=x),
    "num_threads": lambda c, x: _problem(c, num_threads=x),
    "num_threads ": lambda c, x: _reduced(c).solve(num_threads=x),
    "dim": lambda c, x: _problem(c, dim=x),
    "method": lambda c, x: _problem(c).solve(c.load, method=x),
    "method ": lambda c, x: _reduced(c).solve(method=x),
    "restarts": lambda c, x: _reduced(c).answers(restarts=x),
    "seed": lambda c, x: _reduced(c).answers(seed=x),
    "on_step": lambda c, x: _problem(c).solve(c.load, on_step=x),
    "callback": lambda c, x: _reduced(c).solve(callback=x),
    "start": lambda c, x: _problem(c).solve(c.load, start=x),
}
# Values that are invalid for all of these arguments.
NO_SCALARS = (
    -1,
    -0.5,
    math.nan,
    -math.inf,
    True,
    np.True_,
    "tight",
    b"auto",
    1j,
    np.complex128(1e-9),
    [1e-9],
    {},
    object(),
    np.ones(3),
    np.ma.masked,
    Fraction(-1, 3),
    10**400,
    -(10**400),
    bp.Status,
)


@pytest.mark.parametrize("argument", SCALARS)
@pytest.mark.parametrize("value", NO_SCALARS, ids=lambda v: repr(v)[:20])
def test_a_spoiled_scalar(argument: str, value: Any) -> None:
    if value is bp.Status and argument in ("on_step", "callback"):
        return  # a class can be called
    refused(lambda: SCALARS[argument](good(2, 2, 0), value), argument)


@pytest.mark.parametrize("argument", ["tol", "tol ", "max_seconds", "max_seconds "])
def test_zero_is_no_limit(argument: str) -> None:
    refused(lambda: SCALARS[argument](good(2, 2, 0), 0), argument, r"\b0\b", "positive")


@settings(max_examples=60, derandomize=True)
@given(where=st.floats(0, 1), amount=st.floats(1e-9, 1e3), d=st.sampled_from([2, 3]))
def test_a_negative_friction_or_area_is_named(
    where: float, amount: float, d: int
) -> None:
    base = good(d, 3, 1)
    spoiled, at = _put(base.mu, where, -amount)
    for argument in ("mu", "mu ", "mu  "):
        refused(
            lambda a=argument: ARRAYS[a][0](base, spoiled),
            "mu",
            rf"contact {at}\b",
            re.escape(repr(-amount)),
        )
    refused(lambda: _problem(base, area=spoiled), "area", r"positive")


@settings(max_examples=100, derandomize=True)
@given(data=st.data(), d=st.sampled_from([2, 3]))
def test_spoiled_indices(data: st.DataObject, d: int) -> None:
    base = good(d, 2, 2)
    n = len(base.K)
    right = data.draw(
        st.lists(st.integers(d * 2, n - 1), unique=True, min_size=1, max_size=2)
    )
    at = data.draw(st.integers(0, len(right) - 1))
    kind = data.draw(
        st.sampled_from(["high", "low", "twice", "bool", "float", "text", "deep"])
    )
    spoiled: Any = list(right)
    said = "integer"
    if kind == "high":
        spoiled[at] = n + data.draw(st.integers(0, 2**62))
        said = str(spoiled[at])
    elif kind == "low":
        spoiled[at] = -data.draw(st.integers(1, 2**62))
        said = str(spoiled[at])
    elif kind == "twice":
        spoiled.append(spoiled[at])
        said = rf"\b{spoiled[at]} repeated"
    elif kind == "bool":
        spoiled, said = np.isin(np.arange(n), right), "mask"
    elif kind == "float":
        spoiled = np.array(right, float)
    elif kind == "text":
        spoiled = [str(i) for i in right]
    else:
        spoiled, said = [right], "dimension"
    refused(lambda: _problem(base, fixed=spoiled), "fixed", said)


@settings(max_examples=60, derandomize=True)
@given(data=st.data(), form=st.sampled_from(["dense", "csr", "csc", "coo"]))
def test_an_asymmetric_entry_is_named(data: st.DataObject, form: str) -> None:
    base = good(2, 3, 3)
    n = len(base.K)
    i = data.draw(st.integers(0, n - 1))
    j = data.draw(st.integers(0, n - 1).filter(lambda j: j != i))
    spoiled = base.K.copy()
    spoiled[i, j] += data.draw(st.floats(1e-6, 1e3))
    given = spoiled if form == "dense" else sparse.csr_array(spoiled).asformat(form)
    low, high = sorted((i, j))
    refused(
        lambda: _problem(base._replace(K=given)),
        "K",
        "symmetric",
        rf"\[{low}, {high}\]|\[{high}, {low}\]",
    )


@settings(max_examples=30, derandomize=True)
@given(where=st.floats(0, 1), below=st.floats(0.1, 10))
def test_an_indefinite_stiffness_is_refused(where: float, below: float) -> None:
    base = good(2, 2, 4)
    i = min(int(where * len(base.K)), len(base.K) - 2)
    spoiled = base.K.copy()
    spoiled[i, i] = -below
    refused(lambda: _problem(base._replace(K=spoiled)), "K", "indefinite")


@pytest.mark.parametrize("form", ["csr", "csc", "bsr", "coo"])
@pytest.mark.parametrize("argument", ["K", "B", "W"])
@pytest.mark.parametrize("fault", ["index", "negative", "pointer", "down"])
def test_a_broken_sparse_matrix_is_refused(
    argument: str, form: str, fault: str
) -> None:
    """SciPy's conversions would follow these indices out of the arrays."""
    base = good(2, 2, 5)
    call, taken = ARRAYS[argument]
    whole = sparse.csr_array(taken(base))
    broken = whole.asformat(form, copy=True)
    if form == "bsr":
        broken = sparse.bsr_array(whole, blocksize=(1, 1))
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
    refused(lambda: call(base, broken), argument, "index|pointers")


def test_a_state_of_another_problem() -> None:
    two, three = good(2, 2, 6), good(2, 3, 6)
    other = _problem(three).solve(three.load)
    for start in (other, other[0]):
        refused(
            lambda s=start: _problem(two).solve(two.load, start=s), "start", "shape"
        )
        refused(lambda s=start: _problem(two).reduced(two.load, start=s), "start")
    solution = _reduced(three).solve()
    refused(lambda: _reduced(two).solve(start=solution), "start", r"\(3, 2\)")
    refused(lambda: _problem(two).solve(two.load, start=solution), "start", "Solution")
    rigid = (np.tile(np.eye(2), (2, 1)), np.array([-1.0, 0.0]))
    held = bp.ReducedProblem(two.W, two.q, two.mu, rigid=rigid).solve()
    refused(lambda: _reduced(two).solve(start=held), "start", "2 rigid motions")


@pytest.mark.needs_extra
def test_paths() -> None:
    result = _problem(good(2, 2, 7)).solve(good(2, 2, 7).load)
    for bad in (3.0, None, ["x.h5"], np.ones(2)):
        refused(lambda b=bad: result.save(b), "path")
        refused(lambda b=bad: bp.load(b), "path")
    with pytest.raises(ValueError, match="points"):
        result.write("x.pvd")
    refused(lambda: result.write("x.vtu"), "path", r"NAME\.pvd")
    with pytest.raises(OSError, match="nowhere"):
        result.save("/nowhere/at/all.h5")


# Valid arguments of every function of `analytic`, by name.
CLOSED_FORMS: dict[str, dict[str, Any]] = {
    "contact_modulus": {"e1": 2.0, "nu1": 0.3, "e2": 3.0, "nu2": 0.2},
    "hertz_line": {"force": 1.0, "radius": 2.0, "e_star": 3.0},
    "hertz_sphere": {"force": 1.0, "radius": 2.0, "e_star": 3.0},
    "hertz_pressure": {"distance": [0.0, 0.5], "a": 1.0, "p0": 2.0},
    "partial_slip_traction": {
        "distance": [0.0, 0.5],
        "a": 1.0,
        "c": 0.4,
        "p0": 2.0,
        "mu": 0.3,
    },
    "cattaneo_mindlin_line": {
        "force": 1.0,
        "tangential": 0.1,
        "radius": 2.0,
        "e_star": 3.0,
        "mu": 0.3,
    },
    "mindlin_sphere": {
        "force": 1.0,
        "tangential": 0.1,
        "radius": 2.0,
        "e_star": 3.0,
        "mu": 0.3,
        "shear_compliance": 1.0,
    },
    "sheared_patch": {
        "height": [0.0, 1.0],
        "pressure": 1.0,
        "shear": 0.1,
        "young": 2.0,
    },
    "oedometer": {"height": [0.0, 1.0], "pressure": 1.0, "young": 2.0, "nu": 0.3},
    "bar_end_displacement": {"loads": [1.0, -1.0], "stiffness": 2.0, "limit": 3.0},
    "bar_cycle_dissipation": {
        "peak": 1.0,
        "stiffness": 2.0,
        "limit": 3.0,
        "element": 0.1,
    },
    "one_contact_branches": {"stiffness": np.eye(2), "load": [-1.0, 0.2], "mu": 0.3},
    "rotating_load": {"stiffness": 1.0, "force": 2.0, "limit": 1.0, "steps": 8},
    "flat_punch_pressure": {
        "x": [0.0, 0.5],
        "force": 1.0,
        "half_width": 1.0,
        "mu": 0.3,
        "beta": 0.2,
    },
}


def test_every_closed_form_is_called_here() -> None:
    public = {
        name
        for name, value in vars(analytic).items()
        if callable(value)
        and not name.startswith("_")
        and getattr(value, "__module__", "") == analytic.__name__
        and not isinstance(value, type)
    }
    assert public == set(CLOSED_FORMS)


@pytest.mark.parametrize(
    ("name", "argument"),
    [(name, argument) for name, known in CLOSED_FORMS.items() for argument in known],
)
def test_closed_forms(name: str, argument: str) -> None:
    function, known = getattr(analytic, name), CLOSED_FORMS[name]
    function(**known)
    for bad in (math.nan, -math.inf, "much", 1j, [[[1.0], [2.0, 3.0]]], {}, True):
        refused(lambda b=bad: function(**known | {argument: b}), argument)


@settings(max_examples=300, derandomize=True)
@given(
    name=st.sampled_from(sorted(CLOSED_FORMS)),
    exponents=st.lists(st.integers(-320, 308), min_size=6, max_size=6),
)
def test_closed_forms_return_numbers_or_raise(name: str, exponents: list[int]) -> None:
    known = CLOSED_FORMS[name]
    given = {
        key: value * 10.0**exponent if isinstance(value, float) else value
        for (key, value), exponent in zip(known.items(), exponents, strict=False)
    }
    try:
        answer = getattr(analytic, name)(**given)
    except ValueError:
        return
    flat = answer if name == "one_contact_branches" else np.atleast_1d(answer)
    for part in flat:
        numbers = part[1] + part[2] if isinstance(part, tuple) else part
        assert np.isfinite(np.asarray(numbers, float)).all()


def _bodies() -> tuple[fem.Body, fem.Assembly]:
    mesh = fem.box([[0.0, 1.0, 2.0], [0.0, 1.0]], "quadrilateral")
    body = fem.Body("block", mesh, fem.Material(1.0, 0.3))
    contact = fem.Contact("block", "bottom", 0.3, plane=([0.0, 0.0], [0.0, 1.0]))
    support = fem.Support("block", "top", (0, 1))
    return body, fem.assemble([body], [contact], [support])


@pytest.mark.needs_extra
def test_finite_elements() -> None:
    body, model = _bodies()
    plane = ([0.0, 0.0], [0.0, 1.0])

    def contact(**changed: Any) -> Any:
        known = {"body": "block", "surface": "bottom", "mu": 0.3, "plane": plane}
        return fem.assemble([body], [fem.Contact(**known | changed)])

    contact()
    for bad in (math.nan, -1.0, "rough", 1j, None, [0.3]):
        refused(lambda b=bad: contact(mu=b), "mu")
        refused(lambda b=bad: fem.Material(b, 0.3), "young")
    for bad in (math.nan, 0.5, -1.0, "soft", 1j):
        refused(lambda b=bad: fem.Material(1.0, b), "poisson")
    for bad in (math.nan, 0.0, "thick"):
        refused(lambda b=bad: fem.Material(1.0, 0.3, thickness=b), "thickness")
    for bad in (math.nan, "wide", [0.1, 0.2], [[0.1] * 3], 1j):
        refused(lambda b=bad: contact(clearance=b), "clearance")
        refused(lambda b=bad: contact(clearance=lambda _x: b), "clearance")
    for bad in ([0.0, 0.0], ([0.0, 0.0], [math.nan, 1.0]), ([0.0], [1.0]), (plane,)):
        refused(lambda b=bad: contact(plane=b), "plane")
    refused(lambda: contact(plane=([0, 0], [0, 0])), "normal")
    refused(lambda: contact(surface="underneath"), "underneath", "bottom")
    refused(lambda: contact(body="table"), "table", "block")
    refused(lambda: contact(plane=None), "obstacle")
    for bad in (math.nan, "hard", [1.0], [1.0, 2.0, 3.0], np.ones((2, 9, 9)), 1j):
        refused(lambda b=bad: model.traction("block", "top", b), "force on body")
        refused(lambda b=bad: model.body_force("block", b), "force on body")
    refused(lambda: model.pressure("block", "top", [1.0]), "value")  # type: ignore[arg-type]
    for values in ([], [[0.0]], [[0.0, math.nan]], [["a", "b"]], [[0.0] * 3]):
        refused(lambda v=values: model.prescribed(v), "values")
    for bad in ([1.0, 0.0], [[0.0, 0.0]], [[math.nan, 1.0]], [[1.0] * 4], [["x", "y"]]):
        refused(lambda b=bad: fem.frames(b), "normals?")
    for axes in ([[0.0, 1.0]], [[0.0], [1.0, 2.0]], [[0.0, math.nan], [0.0, 1.0]]):
        refused(lambda a=axes: fem.box(a, "quadrilateral"), "ax[ie]s")
    refused(lambda: fem.box([[0.0, 1.0]] * 2, "pentagon"), "cell", "pentagon")


@pytest.mark.needs_extra
def test_files_and_pictures(tmp_path: Any) -> None:
    _, model = _bodies()
    known = {"x": model.points, "area": model.area, "mu": model.mu}
    contacts = known | {"frame": model.frame}
    n = len(model.points)
    step = {"reaction": np.zeros((n, 2)), "status": np.zeros(n, np.int8)}
    picture = tmp_path / "x.png"
    for name in contacts:
        lacking = {k: v for k, v in contacts.items() if k != name}
        refused(lambda c=lacking: run_figure.tractions(picture, c, [step]), name)
        wrong = contacts | {name: np.ones((n + 1, 2, 2, 2))}
        refused(lambda c=wrong: run_figure.tractions(picture, c, [step]), name, "shape")
    for name in step:
        wrong_step = step | {name: np.full(n + 1, np.nan)}
        refused(lambda s=wrong_step: run_figure.tractions(picture, contacts, [s]), name)
    refused(lambda: run_figure.tractions(picture, contacts, []), "steps")
    assert not picture.exists()
    refused(lambda: export.write_result(3, {}, [], complete=True), "path")  # type: ignore[arg-type]
    not_ours = tmp_path / "text.h5"
    not_ours.write_text("no result")
    with pytest.raises(OSError, match=r"text\.h5|signature"):
        bp.load(not_ours)
