"""Faulty scenes, in one place for all tests of mistakes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import bipot_rs as bp

_TORUS = {"centre": [0, 0], "axis": [0, 0, 0], "major_radius": 1, "minor_radius": 1}
# Settings of `two_blocks`, and the start of the message for each mistake.
_MISTAKES: list[tuple[str, ...]] = [
    ("mesh.m=9", "mesh.m: unknown key"),
    ("solve.tol=1", "solve: unknown key"),
    (
        "contact.0.mu=-1; mesh.n=0; foo=1",
        "mesh.n: should be greater than 0, got 0",
        "contact.0.mu: should be greater than or equal to 0, got -1",
        "foo: unknown key",
    ),
    ("mesh.n=2.5", "mesh.n: should be a valid integer"),
    ("body.upper.x.from=nan", "body.upper.x.from: should be a finite number"),
    ("mesh=3", "mesh: should be a table, got 3"),
    (
        "mesh.n=9",
        "body.upper.z: cells is not a whole number of cells for mesh.n = 9: 4.5",
        "body.lower.z: ",
    ),
    (
        "obstacle.o.torus={centre=[0,0],axis=[0,0,0],major_radius=1,minor_radius=1}",
        "obstacle.o: is not used",
        "obstacle.o.torus.minor_radius: should be less than major_radius",
        "obstacle.o.torus.centre: should have 3 components",
        "obstacle.o.torus.axis: should not be zero",
    ),
    ("contact.1.mu=0.1", "--set contact.1.mu: contact is a list of 1 entry"),
    ("contact.0.cohesion=-1.0", "contact.0.cohesion: should be greater than or equal"),
    ("contact.0.dilatancy=9.0", "contact.0.dilatancy: should be at most mu, which is"),
    (
        "contact.0.mu=[0.3,0.2]; contact.0.axis=[1.0,0.0,0.0]; contact.0.cohesion=1.0",
        "contact.0.cohesion: needs one number in mu, got two",
    ),
    ("mesh.n", "--set mesh.n: should be KEY=VALUE"),
    ("mesh.n.k=3", "--set mesh.n.k: mesh.n is not a table"),
    (
        "body.upper.material=wood; contact.0.on=upper.under",
        "body.upper.material: there is no material 'wood', expected one of steel",
        "contact.0.on: there is no surface 'upper.under', expected one of upper",
    ),
    ("path.amplitude.shear=[1.0]; path.steps=3", "path.amplitude.shear: has 1 factor"),
    (
        "contact.0.on=bottom; support.0.on=tip",
        "support.0.on: there is no body 'tip', expected one of upper, lower",
        "contact.0.on: there is no body 'bottom', did you mean upper.bottom or",
    ),
    (
        "support.0.surface=upper.top; contact.0.where=upper.bottom",
        "support.0.surface: unknown key, did you mean support.0.on?",
        "contact.0.where: unknown key, did you mean contact.0.on?",
    ),
    ("path.amplitude.wind=[1.0, 2.0]", "path.amplitude.wind: is not used"),
    ("path.parameter=wind", "path.parameter: there is no amplitude 'wind'"),
    ("contact.0.against=upper.top", "contact.0.against: should be a surface of"),
    (
        "contact.0.plane={point=[0.0, 0.0, 0.0], normal=[0.0, 0.0, 1.0]}",
        "contact.0: needs exactly one of plane and against",
    ),
    (
        "body.upper.cell=triangle",
        "body: some bodies have two",
        "body.upper.z: remove it",
    ),
    (
        "path.amplitude.shear={wave='sine', period=20.0}",
        "path.steps: is missing, amplitude 'shear' is a wave",
    ),
    (
        "path.amplitude.shear={wave='sine'}; path.steps=2",
        "path.amplitude.shear.period: is missing",
    ),
    (
        "solver.method=newt; solver.tol=2.0; contact.0.mu=[1.0, 2.0]",
        "contact.0.axis: is missing",
        "solver: method is 'newt', expected one of",
        "solver: tol is 2",
    ),
    (
        "solver.method=newt; mesh.n=0",
        "mesh.n: should be greater than 0",
        "solver: method is 'newt', expected",
    ),
    (
        "path.amplitude.shear={wave='ramp', period=2.0}; path.steps=2",
        "path.amplitude.shear.period: remove it, a ramp",
    ),
]
MISTAKES = [(settings.split("; "), messages) for settings, *messages in _MISTAKES]
# Settings of `cyclic_cube` that no machine can solve, and their messages.
ABSURD: list[tuple[list[str], str]] = [
    (["mesh.n=1000000000"], "mesh.n: should be less than or equal to 1000000"),
    (["mesh.n=100000"], "body.cube: has 1000030000300001 nodes, whose stiffness"),
    (["mesh.n=-3"], "mesh.n: should be greater than 0"),
    (["mesh.n=nan"], "mesh.n: should be a valid integer"),
    (["path.steps=1000000000"], "path.steps: should be less than or equal"),
    (["path.steps=1000000", "mesh.n=40"], "path: has 1000000 load steps of 68921"),
    (["body.cube.x.cells='n/0'"], "body.cube.x.cells: should be a valid number, got"),
    (["body.cube.x.to=1e300"], "body.cube.x.to: is 1e+300, expected zero or"),
    (["body.cube.x={from=0.0, to=1.0, cell=1e-12}"], "body.cube.x: cells from"),
    (["material.steel.young=" + "[" * 100_000], "material.steel.young: should be"),
    (["path" + ".a" * 10_000 + "=1"], "path.a: unknown key"),
]
# Bytes that are not a scene.
NO_TOML = [
    b"",
    b"\xff\xfe",
    b"\0" * 100,
    b"a = " + b"[" * 100_000,
    b"[mesh]\nn = 3\n" * 2,
]
# Changes of a roller on a block (`rollers.roller`), and their messages.
_PARTS: list[tuple[str, Any, str]] = [
    ("body.block.mesh", "a.msh", "body.block.cell: is for a box, but this body has a"),
    ("body.block.material", {"a": "soft"}, "body.block.material: there is no volume"),
    ("body.block.surface.top", {"normal": [0, 1]}, "a box has a surface of this name"),
    ("body.block.surface.a", {}, "body.block.surface.a: needs within or normal"),
    ("body.block.surface.a", {"normal": [0, 1, 0]}, "a.normal: should have 2"),
    ("body.block.surface.a", {"within": {}}, "a.within: is empty"),
    ("material.soft.young", [1.0, 2.0, 3.0], "material.soft: an orthotropic material"),
    ("material.soft.shear", [1.0, 2.0], "material.soft.shear: number of entries"),
    (
        "material.soft",
        {
            "young": [1.0, 1.0, 1.0],
            "poisson": [0.9, 0.9, 0.9],
            "shear": [1.0, 1.0, 1.0],
        },
        "material.soft: poisson is",
    ),
    ("contact.0.against", "disk", "there is no obstacle 'disk', expected one of disc"),
    ("contact.0.against", "block", "'block' is a body, expected an obstacle"),
    ("contact.0.pairing", "nodes", "contact.0.pairing: should be 'match' or"),
    (
        "obstacle.disc.sphere",
        {"centre": [0, 0], "radius": 1.0},
        "obstacle.disc: needs exactly one",
    ),
    ("obstacle.disc.move", {}, "obstacle.disc.move: has no component"),
    ("obstacle.disc.move", {"z": 1.0}, "obstacle.disc.move.z: remove it"),
    ("obstacle.disc.turn.axis", [0, 0, 1], "turn.axis: remove it, the scene has two"),
    ("obstacle.disc.turn.about", [0, 0, 1], "turn.about: should have 2 components"),
    ("obstacle.disc.cylinder.radius", -1.0, "cylinder.radius: should be greater than"),
    ("obstacle.other", {"torus": _TORUS}, "obstacle.other.torus: needs a scene of"),
    ("obstacle.other", {"surface": "a.stl"}, "obstacle.other: is not used"),
    ("symmetry", [{"on": "block.lid"}], "there is no surface 'block.lid'"),
    ("spring", [{"on": "block.top"}], "spring.0: needs stiffness, or normal"),
    (
        "spring",
        [{"on": "block.top", "stiffness": [1.0, 2.0, 3.0]}],
        "have 2 components",
    ),
    (
        "spring",
        [{"on": "block.top", "normal": -1.0}],
        "spring.0.normal: should be greater",
    ),
    ("strain", [{"on": "block"}], "strain.0: needs expansion and temperature, or"),
    ("strain", [{"on": "blck", "tensor": [[1, 0], [0, 1]]}], "no body 'blck'"),
    ("strain", [{"on": "block", "tensor": [[1, 0], [1, 1]]}], "should be symmetric"),
    (
        "strain",
        [{"on": "block", "tensor": [[1, 0], [1]]}],
        "strain.0.tensor.1: number of",
    ),
    ("strain", [{"on": "block", "expansion": 1.0}], "needs expansion and temperature"),
    (
        "strain",
        [{"on": "block", "expansion": 1.0, "temperature": 1.0, "amplitude": "way"}],
        "strain.0.amplitude: needs tensor",
    ),
    (
        "strain",
        [{"on": "block", "tensor": [[1, 0], [0, 1]], "amplitude": "heat"}],
        "strain.0.amplitude: there is no amplitude 'heat'",
    ),
    (
        "obstacle.disc.move.x.amplitude",
        "heat",
        "obstacle.disc.move.x.amplitude: there is",
    ),
]
PARTS = [({key: value}, said) for key, value, said in _PARTS]


class Faulty(NamedTuple):
    """A scene as the command line takes it, and how its run ends."""

    name: str  # a shipped name or a file
    settings: list[str]  # values of `--set`
    status: int  # exit status of `bipot run`


def block(n: int = 2) -> bp.Model:
    """A block in the plane without supports."""
    m = bp.Model("Block")
    m.material("soft", young=1000.0, poisson=0.3)
    side = {"from": 0.0, "to": 1.0, "cells": n}
    m.body("block", material="soft", cell="quadrilateral", x=side, y=side)
    return m


def pair(pairing: str, *, cells: int = 3) -> bp.Model:
    """Two blocks, one on the other, both without supports."""
    m = block()
    side = {"from": 0.0, "to": 1.0, "cells": cells}
    below = {"from": -1.0, "to": 0.0, "cells": 2}
    m.body("base", material="soft", cell="quadrilateral", x=side, y=below)
    m.contact("block.bottom", against="base.top", mu=0.3, pairing=pairing)
    m.traction("block.top", y=-1.0)
    return m


FLOOR = {"point": [0.0, 0.0], "normal": [0.0, 1.0]}


def late() -> Iterator[tuple[str, bp.Model, int]]:
    """Faults that appear only in meshes, in the condensation or in the solution."""
    for pairing, cells in (("match", 2), ("mortar", 3), ("mortar", 2), ("nodes", 3)):
        yield f"floating_{pairing}_{cells}", pair(pairing, cells=cells), 1
    yield "no_match", pair("match", cells=3), 2
    m = block()
    m.body(
        "alone",
        **(m.to_dict()["body"]["block"] | {"x": {"from": 3.0, "to": 4.0, "cells": 2}}),
    )
    m.support("block.top", x=0.0, y=-0.01)
    m.contact("block.bottom", plane=FLOOR, mu=0.3)
    yield "a_body_alone", m, 1
    m = block()
    m.contact("block.bottom", plane=FLOOR, mu=0.0)
    m.traction("block.top", x=1.0, y=-1.0)
    yield "pushed_along_ice", m, 1
    m = block()
    m.contact("block.bottom", plane=FLOOR, mu=0.3)
    m.traction("block.top", y=1.0)
    yield "pulled_away", m, 1
    m = block()
    m.support("block.top", x=0.0, y=0.0)
    m.support("block.top", x=0.1, y=0.0)
    m.contact("block.bottom", plane=FLOOR, mu=0.3)
    yield "supports_that_contradict", m, 2
    m = block()
    m.support("block.top", x=0.3, y=-0.1)
    m.contact("block.bottom", plane=FLOOR, mu=0.3)
    m.solver(method="uzawa", max_iterations=1)
    yield "out_of_iterations", m, 3
    m = block()
    m.support("block.top", x=0.0, within={"x": [5.0, 6.0]})
    m.contact("block.bottom", plane=FLOOR, mu=0.3)
    yield "a_support_of_nothing", m, 2
    m = block()
    m.body("other", material="soft", mesh="gone.inp")
    m.support("other.a", x=0.0)
    m.contact("block.bottom", plane=FLOOR, mu=0.3)
    yield "a_mesh_that_is_not_there", m, 2


def faulty(folder: Path, roller: bp.Model) -> Iterator[Faulty]:
    """All faulty scenes; those that are files are written into ``folder``."""
    for settings, _ in MISTAKES:
        yield Faulty("two_blocks", settings, 2)
    for settings, _ in ABSURD:
        yield Faulty("cyclic_cube", settings, 2)
    for k, content in enumerate(NO_TOML):
        (folder / f"no_toml_{k}.toml").write_bytes(content)
        yield Faulty(f"no_toml_{k}.toml", [], 2)
    for k, (changes, _) in enumerate(PARTS):
        roller.with_(**changes).to_toml(folder / f"part_{k}.toml")
        yield Faulty(f"part_{k}.toml", [], 2)
    for name, model, status in late():
        model.to_toml(folder / f"{name}.toml")
        yield Faulty(f"{name}.toml", [], status)
    (folder / "a_folder.toml").mkdir()
    yield Faulty("a_folder.toml", [], 2)
    yield Faulty("nothing.toml", [], 2)
    yield Faulty("", [], 2)
