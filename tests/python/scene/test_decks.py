"""Scenes from decks: what they mean, against closed forms, and what is listed by line."""

import itertools
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp

AREA, LOWER, UPPER = 6.0, 2.0, 3.0


def column(*, split: bool = True) -> str:
    """Two boxes on each other, 2 by 3 and 2 and 3 high, of 2 x 2 x 2 cells each.

    With ``split`` each has an element set, else both are ALL.
    """
    lines, blocks = ["*NODE"], []
    for b, (low, high) in enumerate(((0.0, LOWER), (LOWER, LOWER + UPPER))):
        ends = ((low, high), (0, 3), (0, 2))
        grid = itertools.product(*(np.linspace(*e, 3) for e in ends))
        lines += [f"{27 * b + k}, {x}, {y}, {z}" for k, (z, y, x) in enumerate(grid, 1)]
        name = ("LOW", "UP")[b] if split else "ALL"
        blocks.append(f"*ELEMENT, TYPE=C3D8R, ELSET={name}")
        for k, (z, y, x) in enumerate(itertools.product(range(2), repeat=3), 1):
            first = 27 * b + 1 + x + 3 * y + 9 * z
            base = [first, first + 1, first + 4, first + 3]
            cell = [8 * b + k, *base, *(n + 9 for n in base)]
            blocks.append(", ".join(map(str, cell)))
    sets = ["*NSET, NSET=FLOOR, GENERATE\n1, 9", "*NSET, NSET=ROOF, GENERATE\n46, 54"]
    sides = ", ".join(str(n) for n in range(1, 55, 3))
    sets += [f"*NSET, NSET=SIDES\n{sides}", "*ELSET, ELSET=HIGHEST, GENERATE\n13, 16"]
    for name, side, first in (("FACE", 2, 5), ("FOOT", 1, 9), ("TOP", 2, 13)):
        sets.append(f"*SURFACE, NAME={name}, TYPE=ELEMENT")
        sets += [f"{k}, S{side}" for k in range(first, first + 4)]
    return "\n".join([*lines, *blocks, *sets]) + "\n"


MATERIALS = """*MATERIAL, NAME=SOFT
*ELASTIC
{soft}, 0.
*DENSITY
2.E-2
*MATERIAL, NAME=HARD-1
*ELASTIC
{hard}, 0.
*DENSITY
3.D-2
"""
SECTIONS = """*SOLID SECTION, ELSET=LOW, MATERIAL=SOFT
*SOLID SECTION, ELSET=UP, MATERIAL=hard-1
"""
PAIR = """*SURFACE INTERACTION, NAME=DRY
*FRICTION
0.25,
*CONTACT PAIR, INTERACTION=DRY,
TYPE=SURFACE TO SURFACE
FOOT, FACE
"""
HELD = "*BOUNDARY\nFLOOR, 1, 3\nROOF, 1, 2\n"


DECK = column() + MATERIALS.format(soft="1e4", hard="2e4") + SECTIONS + PAIR


def solve(deck: str, bipot: Any, **files: str) -> tuple[Any, str]:
    """The result and the text of the scene that `bipot new` writes."""
    Path("decks").mkdir(exist_ok=True)
    for name, text in {"job": deck, **files}.items():
        Path(f"decks/{name}.inp").write_text(text)
    status, out, err = bipot("new", "scene", "--from", "decks/job.inp")
    assert (status, err) == (0, ""), err
    assert out.endswith(": bipot check scene.toml, bipot run scene.toml\n")
    text = Path("scene.toml").read_text()
    assert ("see the head of scene.toml" in out) == ("\n# line " in text)
    return bp.Model.from_toml("scene.toml").solve(), text


LOADS = {
    "surface": "*DSLOAD\nTOP, P, {p}\n",
    "cells": "*DLOAD\nHIGHEST, P2, {p}\n",
    "traction": "*DSLOAD\nTOP, TRVEC, {p}, 0., 0., -1.\n",
    "nodes": "*CLOAD\nROOF, 3, {nodal}\n",
    "every node": "*CLOAD\n" + "".join(f"{k}, 3, {{nodal}}\n" for k in range(46, 55)),
    "displacement": "*BOUNDARY\nROOF, 3, 3, {down}\n",
}


@pytest.mark.parametrize("split", [True, False])
@pytest.mark.parametrize("load", LOADS)
def test_a_column_under_load(load: str, split: bool, bipot: Any) -> None:
    """u = p (L1/E1 + L2/E2) with ν = 0, and the pressure p in the contact."""
    rng = np.random.default_rng(0)
    soft, hard = rng.uniform(1e3, 2e5, 2)
    p = rng.uniform(1.0, 20.0)
    hard = hard if split else soft
    down = -p * (LOWER / soft + UPPER / hard)
    parts = [
        "*HEADING\n a column\n*INCLUDE, INPUT=mesh.inp\n",
        MATERIALS.format(soft=soft, hard=hard),
        SECTIONS if split else "*SOLID SECTION, ELSET=ALL, MATERIAL=SOFT\n",
        PAIR + HELD + "*STEP\n*STATIC\n",
        LOADS[load].format(p=p, nodal=-p * AREA / 9, down=down) + "*END STEP\n",
    ]
    result, text = solve("".join(parts), bipot, mesh=column(split=split))
    force = result.contact_force("FOOT")[-1]
    np.testing.assert_allclose(force, [0, 0, p * AREA], atol=1e-9 * p * AREA)
    nodes = result.case.model.nodes
    # The rows after those of the nodes belong to rigid sets.
    moved = result[-1].displacement.reshape(-1, 3)[: len(nodes)]
    top = moved[nodes[:, 2] == LOWER + UPPER, 2]
    # The resultant of equal forces on nodes, spread evenly.
    assert ("*CLOAD on ROOF is spread evenly" in text) == (load == "nodes")
    if load == "every node":
        # Unequal tractions do more work on the same mean displacement below them.
        assert 1.001 * down > top.mean() > 1.5 * down
    else:
        # Printed decimals of the deck are exact; K of a few hundred unknowns loses four digits.
        np.testing.assert_allclose(top, down, rtol=1e-9, atol=1e-11)


def test_steps_amplitudes_and_friction(bipot: Any) -> None:
    """Pressed by a force that grows by a table, then sheared until it slides: F = μ N."""
    p, far = 8.0, 0.5
    deck = (
        DECK
        + "*AMPLITUDE, NAME=GROWS\n0., 0., 1., 0.75, 4., 1.\n"
        + "*BOUNDARY\nFLOOR, PINNED\n"
        # The first step frees the sides, which were held before it.
        + "*BOUNDARY\nSIDES, 1\n"
        + "*STEP, INC=100\n*STATIC\n1., 4.\n*BOUNDARY, OP=NEW\nFLOOR, PINNED\nROOF, 1, 2\n"
        + f"*DSLOAD, AMPLITUDE=GROWS\nTOP, P, {p}\n*NODE FILE\nU\n*END STEP\n"
        + f"*STEP\n*STATIC\n*BOUNDARY\nROOF, 1, , {far}\n*END STEP\n"
        + "*STEP\n*STATIC\n*DSLOAD, OP=NEW\nTOP, P, 4.\n*END STEP\n"
    )
    result, text = solve(deck, bipot)
    assert bipot("run", "scene.toml", "--out", "out")[0] == 0
    force = result.contact_force("FOOT")
    pressed = np.array([0.75, 1.0, 1.0, 0.5]) * p * AREA
    np.testing.assert_allclose(force[:, 2], pressed, rtol=1e-9)
    np.testing.assert_allclose(force[2:, 0], -0.25 * pressed[2:], rtol=1e-9)
    assert "is not taken" not in text
    assert 'name = "FOOT"' in text


def test_gravity_and_symmetry(bipot: Any) -> None:
    """The contact carries the weight of the upper block; a side is held by its nodes."""
    deck = (
        DECK
        + "*NSET, NSET=PAIR\n50, 53\n*BOUNDARY\nFLOOR, ENCASTRE\nSIDES, XSYMM\n46, 2\n"
        + "*STEP\n*FREQUENCY\n3\n*END STEP\n"
        + "*STEP\n*STATIC\n*DLOAD\nUP, GRAV, 9.81, 0., 0., -1.\n"
        # Three forces on one node, of which one is a set's.
        + "*CLOAD\nPAIR, 3, -2.\n50, 3, -3.\n50, 2, -1.\n*END STEP\n"
    )
    result, text = solve(deck, bipot)
    weight = 3e-2 * 9.81 * AREA * UPPER + 2 * 2 + 3
    assert result.contact_force("FOOT")[-1, 2] == pytest.approx(weight, rel=1e-9)
    held = {"on": "UP", "at": [0.0, 0.0, 5.0], "y": 0.0}
    assert held in tomllib.loads(text)["support"]


def test_a_plane_deck_with_thickness(bipot: Any) -> None:
    nodes = ((0, 0), (4, 0), (4, 1), (0, 1), (0, 1), (4, 1), (4, 3), (0, 3))
    lines = ["*NODE", *(f"{k}, {x}, {y}" for k, (x, y) in enumerate(nodes, 1))]
    deck = """
*ELEMENT, TYPE=CPS4, ELSET=A\n1, 1, 2, 3, 4
*ELEMENT, TYPE=CPS4, ELSET=B\n2, 5, 6, 7, 8
*SURFACE, NAME=LOW\n1, S3\n*SURFACE, NAME=HIGH\n2, S1
*NSET, NSET=GROUND\n1, 2
*MATERIAL, NAME=M\n*ELASTIC\n1000., 0.3
*SOLID SECTION, ELSET=A, MATERIAL=M\n0.5
*SOLID SECTION, ELSET=B, MATERIAL=M\n0.5,
*CONTACT PAIR, INTERACTION=SMOOTH\nHIGH, LOW
*BOUNDARY\nGROUND, 2\n1, 1\n5, 1
*STEP\n*STATIC\n*DLOAD\n2, P3, 3.\n*END STEP
"""
    result, _ = solve("\n".join(lines) + deck, bipot)
    assert result.contact_force("HIGH")[-1, 1] == pytest.approx(3 * 4 * 0.5, rel=1e-12)
    # Plane stress with free sides: -p/E times the height.
    up = result[-1].displacement.reshape(-1, 2)[:, 1].min()
    assert up == pytest.approx(-3 / 1000 * 3, rel=1e-9)


def test_what_is_not_taken_is_listed_by_line(bipot: Any) -> None:
    # A line of the deck, and after a bar why it is not taken.
    lines = """*TIE, NAME=T | *TIE is not taken
A, B
*STEP, NLGEOM | *STEP has NLGEOM, which is not taken
*STATIC
*BOUNDARY, TYPE=VELOCITY | *BOUNDARY has TYPE, which is not taken
ROOF, 3, 3, 1.
*BOUNDARY
ROOF, 3, 3, -0.001
*CLOAD
1, 4, 2. | *CLOAD 4 on 1 is not taken
*DLOAD
LOW, CENTRIF, 1., 0., 0., 0., 0., 0., 1. | *DLOAD CENTRIF on LOW is not taken
*TEMPERATURE | *TEMPERATURE is not taken
ROOF, 20.
*END STEP
*STEP
*STATIC
*BOUNDARY
SIDES, 1 | *BOUNDARY begins after step 1: not taken
*END STEP
*STEP
*FREQUENCY | *FREQUENCY is not static: its step is not taken
10
*BOUNDARY
ROOF, 3, 3, 5.
*END STEP""".splitlines()
    before = DECK + HELD
    deck = before + "\n".join(line.partition(" | ")[0] for line in lines) + "\n"
    _, text = solve(deck, bipot)
    notes = [line[2:] for line in text.splitlines() if line.startswith("# line")]
    assert sorted(notes) == sorted(
        f"line {before.count(chr(10)) + k}: {why}"
        for k, line in enumerate(lines, 1)
        if (why := line.partition(" | ")[2])
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("ROOF, 1, 2", "RUFF, 1, 2", "there are no nodes 'RUFF'"),
        ("1e4, 0.", "1e4, x", "is '1e4, x', expected numbers"),
        (
            "ELSET=UP, MATERIAL=hard-1",
            "ELSET=UP, MATERIAL=hurd",
            "material 'HURD' has no",
        ),
        ("*SOLID SECTION", "*SHELL SECTION", "has no *SOLID SECTION with cells"),
        ("*NODE", "*INCLUDE, INPUT=decks/no.inp", "includes 'decks/no.inp', which"),
        ("*NODE", "*INCLUDE, INPUT=job.inp", "includes 'job.inp', in a circle"),
        ("ROOF, 1, 2", "ROOF", ": *BOUNDARY has fewer than 2 entries"),
        ("ROOF, 1, 2", "ROOF, 0", "has component 0, expected 1 to 6"),
        ("1e4, 0.\n", "", "*ELASTIC has fewer than 2 entries"),
        ("FOOT, FACE\n", "FOOT\n", "*CONTACT PAIR has fewer than 2 entries"),
    ],
)
def test_a_faulty_deck_is_refused(old: str, new: str, said: str, bipot: Any) -> None:
    Path("job.inp").write_text((DECK + HELD).replace(old, new))
    status, _, err = bipot("new", "--from", "job.inp")
    assert status == 2
    assert said in err
    assert [path.name for path in Path().iterdir()] == ["job.inp"]
