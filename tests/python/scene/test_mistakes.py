"""Mistakes of newcomers and their messages: each message says what to do."""

import sys
from pathlib import Path
from typing import Any

import pytest

from bipot_rs._lib.messages import meant, nearest
from bipot_rs.cli.run import cost_forecast
from bipot_rs.scene import read


@pytest.fixture
def said(bipot: Any) -> Any:
    """Standard error of a command that ends with a bad input and prints nothing else."""

    def run(*arguments: str) -> str:
        status, out, err = bipot(*arguments)
        assert (status, out) == (2, "")
        assert err.startswith("bipot: ")
        return str(err).removeprefix("bipot: ").rstrip()

    return run


RUN = ("run", "sheared_cube")
# A setting of `sheared_cube`, and what is said about it.
SETTINGS = [
    ('material.steel.young="7E"', "material.steel.young: should be a valid number,"),
    ('support.0.z="x"', "support.0.z: should be a valid number"),
    ('support.0.z={ value = "x" }', "support.0.z.value: should be a valid number"),
    (
        'pressure=[{ on = "cube.top", value = { amplitude = "a" } }]',
        "pressure.0.value: should be a valid number; write amplitude as a key",
    ),
    ('path.amplitude.press=[1.0, "x"]', "path.amplitude.press.1: should be a valid"),
    ("n=6", "n: unknown key, did you mean mesh.n?"),
    ("mesh.N=6", "did you mean mesh.n?"),
    ("mu=0.1", "did you mean contact.0.mu?"),
    ("material.steel.youngs=1", "did you mean material.steel.young?"),
    ("material.steel.E=1", "unknown key, expected one of young, poisson"),
    ("material.steal.young=1", "there is no material 'steal', expected one of steel,"),
    ("contact.mu=0.1", "contact is a list of 1 entry, expected contact.0"),
]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("sheared_cube",), "to solve a scene: bipot run sheared_cube"),
        (("mine.toml",), "to solve a scene: bipot run mine.toml"),
        (("mine",), "to solve a scene: bipot run mine.toml"),
        (("torque",), "bipot --help lists the commands"),
        (("chek", "sheared_cube"), "did you mean 'check'"),
        (("run", "shered_cube"), "did you mean 'sheared_cube'?"),
        (("run", "pressed-block"), "did you mean 'pressed_block'?"),
        (("run", "SHEARED_CUBE"), "did you mean 'sheared_cube'?"),
        (("run", "sheared_cube.toml"), "did you mean 'sheared_cube'?"),
        (("run", "mein.toml"), "did you mean 'mine.toml'?"),
        (("run", "mine"), "did you mean 'mine.toml'?"),
        (("sweep",), "required: SCENE; bipot sweep --help lists the"),
        (("scenes", "two_block"), "did you mean 'two_blocks'?"),
        (("run", "."), "is a folder, expected a TOML file"),
        *(((*RUN, "--set", setting), said) for setting, said in SETTINGS),
        ((*RUN, "--set", "mesh.n", "6"), "--set takes KEY=VALUE in one piece"),
        ((*RUN, "--method", "newtom"), "did you mean 'newton'?"),
        ((*RUN, "--tol", "2"), "tol is 2, expected a positive number below 1"),
        ((*RUN, "--out", "mine.toml/x"), "choose another with --out DIR"),
        ((*RUN, "--out", "mine.toml"), "mine.toml is a file, expected a folder"),
    ],
)
def test_command_line(
    arguments: tuple[str, ...], sentence: str, said: Any, monkeypatch: Any
) -> None:
    """Before meshing: a wrong method must not be reported after minutes of it."""

    def never(*_: object) -> None:
        raise AssertionError("the mesh is made")

    monkeypatch.setattr("bipot_rs.scene.build.bodies", never)
    Path("mine.toml").write_text("")
    told = said(*arguments)
    assert sentence in told
    assert "\n" not in told


def test_an_unknown_option_with_json(bipot: Any) -> None:
    """The message is in the last line of standard output."""
    status, out, _ = bipot("run", "--json", "sheared_cube", "--fast")
    assert status == 2
    assert "there is no option --fast" in out


def test_too_large_mesh_is_refused_before_meshing(
    said: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cost_forecast, "available", lambda: 8_000_000_000)
    told = said(*RUN, "--set", "mesh.n=150")
    # 150³ hexahedra with (8·3)² entries of six bytes.
    assert "take 11.7 GB, but only 8 GB" in told
    assert "mesh.n up to 132 would fit" in told
    # The largest mesh that is said to fit is accepted, and one more cell is not.
    cost_forecast.fits(read("sheared_cube", ["mesh.n=132"]))
    with pytest.raises(MemoryError):
        cost_forecast.fits(read("sheared_cube", ["mesh.n=133"]))
    # Unknown free memory is no limit.
    monkeypatch.setattr(cost_forecast, "available", lambda: None)
    cost_forecast.fits(read("sheared_cube", ["mesh.n=150"]))


def test_without_the_library_for_files(
    said: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    told = said(*RUN, "--set", "mesh.n=2")
    assert "files need h5py, which is not installed" in told
    assert "pip install" in told


def test_mistakes_are_reported_together(said: Any) -> None:
    """Mistakes within tables come first, then contradictions between readable tables."""
    told = said(*RUN, "--set", "mesh.m=3", "--set", "contact.0.mu=-1")
    assert told.count("\n") == 2
    assert "mesh.m: unknown key" in told
    assert "contact.0.mu: should be greater than or equal to 0" in told
    unknown = ("contact.0.on=cube.botom", "contact.0.against=nothing")
    told = said(*RUN, *(word for s in unknown for word in ("--set", s)))
    assert "there is no surface 'cube.botom'" in told
    told = said(*RUN, "--set", "material.steel.young=1e99")
    assert "material.steel.young: is 1e+99, expected zero or a magnitude" in told


@pytest.mark.parametrize(
    ("word", "found"),
    [
        ("Alpha-Beta", "alpha_beta"),
        ("alpah_beta", "alpha_beta"),
        ("gamma", "gamma"),
        ("omega", ""),
        ("", ""),
        ("where", "on"),
        ("surface", "on"),
    ],
)
def test_nearest(word: str, found: str) -> None:
    names = ["alpha_beta", "gamma", "x", "on"]
    assert nearest(word, names) == found
    expected = f", did you mean {found!r}?" if found and found != word else ""
    assert meant(word, names) == expected
