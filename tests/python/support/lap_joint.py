"""Half of a lap joint whose meshes do not match, and whose edges have two contacts."""

from typing import Any

import numpy as np

from bipot_rs import fem

STEEL = fem.Material(210e3, 0.3)


def lap_joint(n: int, *, symmetric: bool) -> tuple[fem.Assembly, Any, Any]:
    """The model, its load, and the prescribed displacements of three steps.

    A washer presses the upper plate against the lower one; the upper plate is pulled off a
    stop. The front is a plane of symmetry, or held by supports across it, where mortar leaves
    contacts without a node of their own.
    """

    def plate(name: str, x: tuple[float, float, int], y: int, z: Any) -> fem.Body:
        axes = [np.linspace(x[0], x[1], x[2] + 1), np.linspace(0, 10, y + 1)]
        mesh = fem.box([*axes, np.linspace(z[0], z[1], z[2] + 1)], "hexahedron")
        return fem.Body(name, mesh, STEEL)

    bodies = [
        plate("lower", (0, 40, 4 * n), 2 * n, (0, 5, n)),
        plate("upper", (20, 60, 5 * n), 2 * n + 1, (5, 10, n)),
        plate("washer", (24, 36, 2 * n), 2 * n, (10, 12, max(2, n // 2))),
        plate("stop", (16, 20, n // 2), 2 * n, (5, 10, n + 1)),
    ]
    pairs = [
        (("upper", "bottom"), ("lower", "top"), 0.2),
        (("washer", "bottom"), ("upper", "top"), 0.15),
        (("stop", "right"), ("upper", "left"), 0.1),
    ]
    contacts = [
        fem.Contact(*on, mu, against=against, pairing="mortar")
        for on, against, mu in pairs
    ]
    supports = [
        fem.Support("lower", "left", (0, 1, 2)),
        fem.Support("stop", "left", (0, 1, 2)),
        fem.Support("upper", "right", (0, 2)),
    ]
    fronts = [(body.name, "front") for body in bodies]
    planes = [fem.Symmetry(*on) for on in fronts if symmetric]
    supports += [fem.Support(*on, (1,)) for on in fronts if not symmetric]
    model = fem.assemble(bodies, contacts, supports, symmetries=planes)
    load = model.traction("washer", "top", [0.0, 0.0, -60.0])
    held = [np.zeros(3), np.zeros(3)]
    across = [] if symmetric else [np.zeros(1)] * 4
    steps = [
        model.prescribed([*held, [pull, 0.0], *across]) for pull in (-4e-3, 1e-2, 2e-2)
    ]
    return model, np.tile(load, (3, 1)), np.array(steps)
