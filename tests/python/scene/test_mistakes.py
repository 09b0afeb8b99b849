"""Mistakes of newcomers and their messages: each message says what to do."""

import sys
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
