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
    nodes, cells = [], []
    for b, (low, high) in enumerate(((0.0, LOWER), (LOWER, LOWER + UPPER))):
        start = 27 * b
        grid = itertools.product(
            *(np.linspace(*e, 3) for e in ((low, high), (0, 3), (0, 2)))
        )
        nodes += [f"{start + k}, {x}, {y}, {z}" for k, (z, y, x) in enumerate(grid, 1)]
        for z, y, x in itertools.product(range(2), repeat=3):
            first = start + 1 + x + 3 * y + 9 * z
            base = [first, first + 1, first + 4, first + 3]
            corners = ", ".join(map(str, [*base, *(n + 9 for n in base)]))
            cells.append(f"{8 * b + len(cells) % 8 + 1}, {corners}")
    names = ("LOW", "UP") if split else ("ALL", "ALL")
    blocks = [
        f"*ELEMENT, TYPE=C3D8R, ELSET={name}\n" + "\n".join(cells[8 * b : 8 * b + 8])
        for b, name in enumerate(names)
    ]
    sets = [
        "*NSET, NSET=FLOOR, GENERATE\n1, 9",
        "*NSET, NSET=ROOF, GENERATE\n46, 54",
        "*NSET, NSET=SIDES\n" + ", ".join(str(n) for n in range(1, 55, 3)),
        "*SURFACE, NAME=FACE, TYPE=ELEMENT\n"
        + "\n".join(f"{k}, S2" for k in range(5, 9)),
        "*SURFACE, NAME=FOOT, TYPE=ELEMENT\n"
        + "\n".join(f"{k}, S1" for k in range(9, 13)),
        "*SURFACE, NAME=TOP, TYPE=ELEMENT\n"
        + "\n".join(f"{k}, S2" for k in range(13, 17)),
        "*ELSET, ELSET=HIGHEST, GENERATE\n13, 16",
    ]
    return "\n".join(["*NODE", *nodes, *blocks, *sets]) + "\n"


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


def solve(deck: str, bipot: Any, **files: str) -> tuple[Any, str]:
    """The result and the text of the scene that `bipot new` writes."""
    Path("decks").mkdir(exist_ok=True)
    Path("decks/job.inp").write_text(deck)
    for name, text in files.items():
        Path(f"decks/{name}.inp").write_text(text)
    status, out, err = bipot("new", "scene", "--from", "decks/job.inp")
    assert (status, err) == (0, ""), err
    assert out.endswith(": bipot check scene.toml, bipot run scene.toml\n")
    assert bipot("run", "scene.toml", "--out", "out")[0] == 0
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
@pytest.mark.parametrize("seed", range(2))
def test_a_column_under_load(load: str, split: bool, seed: int, bipot: Any) -> None:
    """u = p (L1/E1 + L2/E2) with ν = 0, and the pressure p in the contact."""
    rng = np.random.default_rng(seed)
    soft, hard = rng.uniform(1e3, 2e5, 2)
    p = rng.uniform(1.0, 20.0)
    if not split:
        hard = soft
    down = -p * (LOWER / soft + UPPER / hard)
    sections = SECTIONS if split else "*SOLID SECTION, ELSET=ALL, MATERIAL=SOFT\n"
    deck = (
        "*HEADING\n a column\n*INCLUDE, INPUT=mesh.inp\n"
        + MATERIALS.format(soft=soft, hard=hard)
        + sections
        + PAIR
        + HELD
        + "*STEP\n*STATIC\n"
        + LOADS[load].format(p=p, nodal=-p * AREA / 9, down=down)
        + "*END STEP\n"
    )
    result, text = solve(deck, bipot, mesh=column(split=split))
    # Printed decimals of the deck are exact; K of a few hundred unknowns loses four digits.
    near = {"rtol": 1e-9, "atol": 1e-11}
    force = result.contact_force("FOOT")[-1]
    np.testing.assert_allclose(force, [0, 0, p * AREA], atol=1e-9 * p * AREA)
    nodes = result.case.model.nodes
    # The rows after those of the nodes belong to rigid sets.
    moved = result[-1].displacement.reshape(-1, 3)[: len(nodes)]
    top = moved[nodes[:, 2] == LOWER + UPPER]
    # The resultant of equal forces on nodes, spread evenly.
    assert ("*CLOAD on ROOF is spread evenly" in text) == (load == "nodes")
    if load == "every node":
        # Unequal tractions do more work on the same mean displacement below them.
        assert 1.001 * down > top[:, 2].mean() > 1.5 * down
        return
    np.testing.assert_allclose(top[:, 2], down, **near)


def test_steps_amplitudes_and_friction(bipot: Any) -> None:
    """Pressed by a force that grows by a table, then sheared until it slides: F = μ N."""
    p, far = 8.0, 0.5
    deck = (
        column()
        + MATERIALS.format(soft=1e4, hard=2e4)
        + SECTIONS
        + PAIR
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
    force = result.contact_force("FOOT")
    pressed = np.array([0.75, 1.0, 1.0, 0.5]) * p * AREA
    np.testing.assert_allclose(force[:, 2], pressed, rtol=1e-9)
    np.testing.assert_allclose(force[2:, 0], -0.25 * pressed[2:], rtol=1e-9)
    assert "is not taken" not in text
    assert 'name = "FOOT"' in text


def test_gravity_and_symmetry(bipot: Any) -> None:
    """The contact carries the weight of the upper block; a side is held by its nodes."""
    deck = (
        column()
        + MATERIALS.format(soft=1e4, hard=2e4)
        + SECTIONS
        + PAIR
        + "*NSET, NSET=PAIR\n50, 53\n*BOUNDARY\nFLOOR, ENCASTRE\nSIDES, XSYMM\n46, 2\n"
        + "*STEP\n*FREQUENCY\n3\n*END STEP\n"
        + "*STEP\n*STATIC\n*DLOAD\nUP, GRAV, 9.81, 0., 0., -1.\n"
        # Three forces on one node, of which one is a set's.
        + "*CLOAD\nPAIR, 3, -2.\n50, 3, -3.\n50, 2, -1.\n*END STEP\n"
    )
    result, text = solve(deck, bipot)
    weight = 3e-2 * 9.81 * AREA * UPPER + 2 * 2 + 3
    assert result.contact_force("FOOT")[-1, 2] == pytest.approx(weight, rel=1e-9)
    assert {"on": "UP", "at": [0.0, 0.0, 5.0], "y": 0.0} in tomllib.loads(text)[
        "support"
    ]


def test_a_plane_deck_with_thickness(bipot: Any) -> None:
    deck = """*NODE
1, 0, 0
2, 4, 0
3, 4, 1
4, 0, 1
5, 0, 1
6, 4, 1
7, 4, 3
8, 0, 3
*ELEMENT, TYPE=CPS4, ELSET=A
1, 1, 2, 3, 4
*ELEMENT, TYPE=CPS4, ELSET=B
2, 5, 6, 7, 8
*SURFACE, NAME=LOW
1, S3
*SURFACE, NAME=HIGH
2, S1
*NSET, NSET=GROUND
1, 2
*MATERIAL, NAME=M
*ELASTIC
1000., 0.3
*SOLID SECTION, ELSET=A, MATERIAL=M
0.5
*SOLID SECTION, ELSET=B, MATERIAL=M
0.5,
*CONTACT PAIR, INTERACTION=SMOOTH
HIGH, LOW
*BOUNDARY
GROUND, 2
1, 1
5, 1
*STEP
*STATIC
*DLOAD
2, P3, 3.
*END STEP
"""
    result, _ = solve(deck, bipot)
    assert result.contact_force("HIGH")[-1, 1] == pytest.approx(3 * 4 * 0.5, rel=1e-12)
    # Plane stress with free sides: -p/E times the height.
    up = result[-1].displacement.reshape(-1, 2)[:, 1].min()
    assert up == pytest.approx(-3 / 1000 * 3, rel=1e-9)


def test_what_is_not_taken_is_listed_by_line(bipot: Any) -> None:
    before = column() + MATERIALS.format(soft=1e4, hard=2e4) + SECTIONS + PAIR + HELD
    at = before.count("\n")
    more = """*TIE, NAME=T
A, B
*STEP, NLGEOM
*STATIC
*BOUNDARY, TYPE=VELOCITY
ROOF, 3, 3, 1.
*BOUNDARY
ROOF, 3, 3, -0.001
*CLOAD
1, 4, 2.
*DLOAD
LOW, CENTRIF, 1., 0., 0., 0., 0., 0., 1.
*TEMPERATURE
ROOF, 20.
*END STEP
*STEP
*STATIC
*BOUNDARY
SIDES, 1
*END STEP
*STEP
*FREQUENCY
10
*BOUNDARY
ROOF, 3, 3, 5.
*END STEP
"""
    _, text = solve(before + more, bipot)
    notes = [line[2:] for line in text.splitlines() if line.startswith("# line")]
    assert notes == [
        f"line {at + k}: {why}"
        for k, why in (
            (1, "*TIE is not taken"),
            (3, "*STEP has NLGEOM, which is not taken"),
            (5, "*BOUNDARY has TYPE, which is not taken"),
            (13, "*TEMPERATURE is not taken"),
            (22, "*FREQUENCY is not static: its step is not taken"),
            (19, "*BOUNDARY begins after step 1: not taken"),
            (10, "*CLOAD 4 on 1 is not taken"),
            (12, "*DLOAD CENTRIF on LOW is not taken"),
        )
    ]


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
        (
            "*NODE",
            "*INCLUDE, INPUT=decks/no.inp",
            "includes 'decks/no.inp', which does not",
        ),
        ("*NODE", "*INCLUDE, INPUT=job.inp", "includes 'job.inp', in a circle"),
        ("ROOF, 1, 2", "ROOF", ": *BOUNDARY has fewer than 2 entries"),
        ("ROOF, 1, 2", "ROOF, 0", "has component 0, expected 1 to 6"),
        ("1e4, 0.\n", "", "*ELASTIC has fewer than 2 entries"),
        ("FOOT, FACE\n", "FOOT\n", "*CONTACT PAIR has fewer than 2 entries"),
    ],
)
def test_a_faulty_deck_is_refused(old: str, new: str, said: str, bipot: Any) -> None:
    text = column() + MATERIALS.format(soft="1e4", hard=2e4) + SECTIONS + PAIR + HELD
    Path("job.inp").write_text(text.replace(old, new))
    status, _, err = bipot("new", "--from", "job.inp")
    assert status == 2
    assert said in err
    assert [path.name for path in Path().iterdir()] == ["job.inp"]
