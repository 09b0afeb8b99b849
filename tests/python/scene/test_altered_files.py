"""Readers of altered scenes and damaged files: an error with a message, or right content."""

import json
import random
import re
import tomllib
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bipot_rs as bp
from bipot_rs._lib.machine import peak_mb
from bipot_rs.scene import SceneError, assemble, bodies, read, shipped, text
from support import collection
from support.bars import bar_problem, pulled
from support.children import bipot, forked
from support.comparisons import refused
from support.faulty_scenes import ABSURD, NO_TOML

# Values that a typing error or an attacker may put into a file.
_INTEGERS = (0, -1, 10**9, -(10**9), 10**400, True)
_REALS = (1e308, -1e308, 1e-308, 5e-324, float("nan"), float("inf"), -0.0)
_WORDS = ("", "n", "n/0", "0*n", "0/n", "9e9*n", "nonsense", "\U0001f980")
_LISTS = ([], [[]], [0.0], [1.0, 0.0], [0.0] * 7)
_TABLES = ({}, {"x": 0}, {"value": 1e300}, {"points": [0.0, 0.0]}, {"table": []})
NASTY = (*_INTEGERS, *_REALS, *_WORDS, *_LISTS, *_TABLES)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to all entries of a table."""
    keys = value if isinstance(value, dict) else range(len(value))
    for key in keys:
        yield (*path, key)
        if isinstance(value[key], (dict, list)):
            yield from places(value[key], (*path, key))


def altered(draw: Callable[..., Any], table: dict[str, Any]) -> None:
    """Drop, rename, add, replace or nest an entry of a table, in place."""
    path = draw(st.sampled_from(list(places(table))))
    at: Any = table
    for key in path[:-1]:
        at = at[key]
    key = path[-1]
    change = draw(st.sampled_from(["drop", "rename", "add", "scale", "nest", "put"]))
    if change == "drop":
        del at[key]
    elif change == "rename" and isinstance(at, dict):
        at[f"{key}x"] = at.pop(key)
    elif change == "add" and isinstance(at, dict):
        at["nothing_of_the_kind"] = draw(st.sampled_from(NASTY))
    elif change == "scale" and isinstance(at[key], (int, float)):
        factor = draw(st.sampled_from([-1, 0, 1e3, 1e-3, 1e150, 1e-150]))
        at[key] = float(at[key]) * factor if abs(at[key]) < 1e300 else 0
    elif change == "nest":
        at[key] = [at[key]] if draw(st.booleans()) else {"x": at[key]}
    else:
        at[key] = draw(st.sampled_from(NASTY))


def damaged(content: bytes, count: int, seed: int) -> Iterator[bytes]:
    """A file with bits flipped, bytes replaced, parts missing, moved or added."""
    random_ = random.Random(seed)
    for k in range(count):
        data = bytearray(content)
        # The start of an HDF5 file has dense metadata; the rest is large in comparison.
        reach = len(data) if k % 2 else min(len(data), 4096)
        at = random_.randrange(reach)
        kind = k % 6
        if kind < 2:
            data[at] ^= 1 << random_.randrange(8)
        elif kind == 2:
            for _ in range(8):
                data[random_.randrange(reach)] = random_.randrange(256)
        elif kind == 3:
            del data[at:]
        elif kind == 4:
            data[at : at + 64] = bytes(64)
        else:
            data[at:at] = random_.randbytes(random_.randrange(1, 64))
        yield bytes(data)


def survives_damage(
    read: Callable[[Path], Any], same: Callable[[Any], bool], path: Path, count: int
) -> None:
    """Check a reader on damaged copies of a file.

    Each copy is read in a child process, which must neither crash nor hang: ``read`` raises
    ``OSError`` or ``ValueError`` with one sentence, or returns content that is the ``same``.
    """
    assert same(read(path)), "the file must be in order to begin with"
    copy = path.with_name(f"damaged-{path.name}")
    copies = list(damaged(path.read_bytes(), count, seed=0))
    refused = 0
    for first in range(0, count, 25):
        # Several copies per child: starting a child takes longer than reading a file.
        def work(first: int = first) -> int:
            return _refusals(read, same, copy, copies[first : first + 25])

        run = forked(work, seconds=60)
        assert 0 <= run.returncode <= 25, f"copies from {first} on: {run.returncode}"
        refused += run.returncode
    assert refused > 0, "no damage was noticed"


def _refusals(
    read: Callable[[Path], Any],
    same: Callable[[Any], bool],
    copy: Path,
    contents: list[bytes],
) -> int:
    """How many of the contents are refused."""
    refused = 0
    for number, content in enumerate(contents):
        copy.write_bytes(content)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                words = "read" if same(read(copy)) else ""
        except (OSError, ValueError) as error:
            refused += 1
            words = str(error)
        assert words, f"copy {number}: an error without words, or another content"
        assert "\n" not in words, f"copy {number}: {words}"
    return refused


def in_one_line(error: Exception, fate: str) -> str:
    assert re.fullmatch(".+", str(error)), str(error)
    return fate


def check_scene(path: Path, table: dict[str, Any]) -> str:
    """Outcome of a scene: ``refused``, ``no answer`` or ``solved``."""
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    try:
        scene = read(str(path))
    except SceneError as error:
        for mistake in error.mistakes:
            assert mistake.key or mistake.message.startswith("is not TOML: ")
            assert "\n" not in mistake.message
        return "refused"
    try:
        case = assemble(scene, bodies(scene))
    except SceneError as error:
        return in_one_line(error, "refused")
    if len(case.parameter) > 50 or case.model.n > 8000:
        return "large"
    try:
        problem = case.model.problem()
        result = problem.solve(
            case.load,
            case.prescribed,
            method=scene.solver.method,
            tol=scene.solver.tol,
            max_iterations=2000,
        )
    except (ValueError, bp.BipotError) as error:
        return in_one_line(error, "no answer")
    assert np.isfinite(result.reaction).all()
    assert np.isfinite(result.displacement).all()
    assert (result.residual <= [step.tolerance for step in result]).all()
    return "solved"


# Small enough to be solved some hundred times.
SMALL = {"pressed_block": 4, "cattaneo_mindlin": 10, "two_blocks": 4}


@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", shipped())
@pytest.mark.quick_variants("raous_plate")
def test_altered_scenes(name: str, tmp_path: Path) -> None:
    def small() -> dict[str, Any]:
        table = tomllib.loads(text(name))
        table["mesh"]["n"] = SMALL.get(name, 2)
        return table

    @settings(
        max_examples=40,
        suppress_health_check=[HealthCheck.too_slow],
        derandomize=True,
    )
    @given(st.data())
    def one(data: Any) -> None:
        table = small()
        for _ in range(data.draw(st.integers(1, 2))):
            altered(data.draw, table)
        check_scene(tmp_path / "scene.toml", table)

    assert check_scene(tmp_path / "scene.toml", small()) == "solved"
    one()


@pytest.mark.parametrize(("arguments", "words"), ABSURD)
@pytest.mark.slow_variants("*arguments10*", "arguments8-*")
def test_sizes_beyond_memory_are_refused(
    arguments: list[str], words: str, tmp_path: Path
) -> None:
    settings = [part for setting in arguments for part in ("--set", setting)]
    before = peak_mb()
    run = bipot("run", "cyclic_cube", *settings, "--json", cwd=tmp_path)
    assert (run.returncode, run.stderr) == (2, "")
    (last,) = map(json.loads, run.stdout.splitlines())
    assert words in last["message"]
    assert last["seconds"]["mesh"] == 0
    # The child is a fork of this process and starts with its memory. A refused run adds
    # some tens of megabytes, not the gigabytes of the problem.
    assert last["peak_mb"] < before + 300


@pytest.mark.parametrize("content", NO_TOML)
def test_files_that_are_not_a_scene(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_bytes(content)
    run = bipot("run", "scene.toml", cwd=tmp_path)
    assert run.returncode == 2
    assert run.stderr.startswith("bipot: scene 'scene.toml'")


def result_file(folder: Path) -> tuple[Path, bp.Result]:
    problem, load = bar_problem(6)
    result = problem.solve(pulled(load, 30 * np.sin(np.arange(4.0))))
    assert np.isfinite(result.displacement).all()
    result.save(folder / "a.h5")
    return folder / "a.h5", result


@pytest.mark.timeout(120)
@pytest.mark.slow
def test_damaged_results(tmp_path: Path) -> None:
    path, result = result_file(tmp_path)
    names = ("reaction", "relative_displacement", "slip", "status", "displacement")

    def same(found: bp.Result) -> bool:
        told = [(r.success, r.message) for r in (found, result)]
        return told[0] == told[1] and all(
            np.array_equal(getattr(found, name), getattr(result, name))
            for name in names
        )

    survives_damage(bp.load, same, path, count=200)


@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", ["d2_fcp00031", "rods_2_3c"])
@pytest.mark.slow_variants("rods_2_3c")
@pytest.mark.slow
def test_damaged_problems(name: str, tmp_path: Path) -> None:
    path = tmp_path / "problem.hdf5"
    path.write_bytes(collection.path(name).read_bytes())

    def same(found: bp.ReducedProblem | bp.fclib.GlobalProblem) -> bool:
        """Other numbers give another problem, which must be solved or refused."""
        try:
            solution = found.solve(max_iterations=20)
        except (ValueError, bp.BipotError) as error:
            return "\n" not in str(error)
        return bool(np.isfinite(solution.reaction).all())

    survives_damage(bp.fclib.read, same, path, count=100)


# Files of HDF5 that call themselves results, by what is wrong with their content.
ALIENS: dict[str, tuple[Callable[[Any, Any], Any], str]] = {
    "names": (lambda _, steps: steps.create_group("first"), "invalid literal"),
    "file in place of a group": (
        lambda _, steps: steps.update({"0000": 1.0}),
        "has no attribute",
    ),
    "nothing in a step": (
        lambda _, steps: steps.create_group("0000"),
        "step 0: .* missing",
    ),
    "huge": (
        lambda contacts, _: contacts.create_dataset(
            "gap", shape=(10**12,), dtype="f8", chunks=(10**6,)
        ),
        r"contacts/gap claim 8000000000000 bytes, more than the file has",
    ),
    "zeros": (
        lambda contacts, _: contacts.create_dataset(
            "x", data=np.zeros((1000, 3)), compression="gzip"
        ),
        r"contacts/x claim 24000 bytes, more than the file has",
    ),
    "names of one array": (
        lambda contacts, _: contacts.update(
            dict.fromkeys(
                [f"x{k}" for k in range(100)],
                contacts.create_dataset("it", data=np.zeros((100, 3))),
            )
        ),
        r"contacts/\w+ claim \d+ bytes, more than the file has",
    ),
    "strings": (
        lambda contacts, _: contacts.create_dataset(
            "names", data=["a" * 10**6] * 2, dtype=h5py.string_dtype()
        ),
        "contacts/names has entries without a fixed size",
    ),
    "no steps": (lambda _, steps: steps.parent.pop("steps"), "steps"),
}


@pytest.mark.parametrize("kind", ["empty", *ALIENS])
def test_other_files_of_hdf5(kind: str, tmp_path: Path) -> None:
    words = "its format is not 'bipot-result'"
    with h5py.File(tmp_path / "b.h5", "w") as file:
        if kind != "empty":
            file.attrs.update(format="bipot-result", version=1, complete=True)
            fill, words = ALIENS[kind]
            fill(file.create_group("contacts"), file.create_group("steps"))
    with refused(words) as error:
        bp.load(tmp_path / "b.h5")
    assert "b.h5 is not a result that can be read" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("reaction", np.zeros((6, 3))),
        ("reaction", np.full((6, 2), np.nan)),
        ("reaction", np.array(["text"] * 6, dtype="S4")),
        ("status", np.full(6, 3, np.int8)),
        ("slip", np.zeros((6, 2))),
        ("residual", np.inf),
        ("residual", np.zeros(3)),
    ],
)
def test_damaged_steps_are_refused(name: str, value: object, tmp_path: Path) -> None:
    path, _ = result_file(tmp_path)
    with h5py.File(path, "r+") as file:
        del file.attrs["sealed"]
        del file[f"steps/0001/{name}"]
        file[f"steps/0001/{name}"] = value
    with refused(f"a.h5 .*step 1: .*{name}"):
        bp.load(path)


def test_paths_that_are_not_files(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        bp.load(tmp_path / "nothing.h5")
    with pytest.raises(OSError, match="is not a file"):
        bp.load(tmp_path)
    with pytest.raises(OSError, match="is not a file"):
        bp.load("/dev/zero")
