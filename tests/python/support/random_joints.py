"""Random joints of two plates in the classes that the iterative engine once refused."""

from typing import Any

import numpy as np
from scipy.sparse import block_diag, csr_array

from bipot_rs import fem

CLASSES = (
    "symmetry",
    "oblique",
    "groove",
    "mortar",
    "all",
)


def random_joint(kind: str, dim: int, seed: int) -> tuple[dict[str, Any], Any]:
    """Arguments of a `ContactProblem`, and its loads.

    A lower plate is clamped at its left end; an upper one lies on it, and shear springs
    of a support hold its right end. *symmetry* holds contact nodes along y and turns all
    tangents; *oblique* has a sloping plane under nodes that a support holds along z;
    *groove* has edge nodes with two contacts; *mortar* has plates that do not match.
    """
    rng = np.random.default_rng([seed, dim, CLASSES.index(kind)])

    def has(part: str) -> bool:
        return kind in (part, "all")

    n = int(rng.integers(2, 4))
    more = int(has("mortar"))
    contrast = 10 ** rng.uniform(0, 6) if rng.random() < 0.7 else 1.0

    def box(name: str, heights: tuple[float, float], cells: int, E: float) -> fem.Body:
        axes = [np.linspace(0.0, 2.0, 2 * cells + 1), np.linspace(0.0, 1.0, cells + 1)]
        axes = [*axes[: dim - 1], np.linspace(*heights, 3)]
        cell = "hexahedron" if dim == 3 else "quadrilateral"
        return fem.Body(name, fem.box(axes, cell), fem.Material(E, 0.3))

    up = -1
    low_E, up_E = rng.permutation([1.0, contrast])
    bodies = [
        box("low", (0.0, 0.5), n, float(low_E)),
        box("up", (0.5, 1.0), n + more, float(up_E)),
    ]
    pairing = "mortar" if more else "match"
    contacts = [
        fem.Contact("up", "bottom", 0.3, against=("low", "top"), pairing=pairing)
    ]
    normal = np.zeros(dim)
    if has("oblique"):
        slope = normal.copy()
        slope[[0, up]] = 0.6, 0.8
        contacts.append(fem.Contact("low", "bottom", 0.3, plane=(normal, slope)))
    if has("groove"):
        wall = normal.copy()
        wall[0] = -1.0
        at = 2.0 * np.eye(dim)[0]
        contacts.append(fem.Contact("up", "right", 0.2, plane=(at, wall)))
        at, down = np.eye(dim)[up], -np.eye(dim)[up]
        contacts.append(fem.Contact("up", "top", 0.2, plane=(at, down)))
    every = range(dim)
    supports = [fem.Support("low", "left", every)]
    symmetry = has("symmetry") and dim == 3
    if symmetry:
        supports += [fem.Support(name, "front", [1]) for name in ("low", "up")]
    if has("oblique"):
        edge = fem.Support("low", "bottom", [dim - 1])
        supports.append(edge)
    springs = [fem.Spring("up", "right", [0.1 * float(up_E)] * dim)]
    model = fem.assemble(bodies, contacts, supports, springs=springs)
    d, count = dim, len(model.gap)
    turn = np.tile(np.eye(d), (count, 1, 1))
    if d == 3:
        angle = rng.uniform(0, 2 * np.pi, count)
        turn[:, 1, 1] = turn[:, 2, 2] = np.cos(angle)
        turn[:, 1, 2] = np.sin(angle)
        turn[:, 2, 1] = -np.sin(angle)
    B = csr_array(block_diag(list(turn)) @ csr_array(model.B))
    frame = turn @ model.frame
    mu: Any = rng.uniform(0.1, 0.6, count)
    law: dict[str, Any] = {}
    choice = rng.integers(3)
    if choice == 1 and d == 3:
        mu = np.column_stack([mu, mu * rng.uniform(0.5, 2.0, count)])
    if choice == 2:
        law["cohesion"] = np.full(count, 1e-3)
    top = model.nodes[:, -1] > 1 - 1e-9
    parts = rng.uniform(0.5, 1.5, (2, top.sum()))
    load = np.zeros((3, *model.nodes.shape))
    load[:, top, -1] = -1e-2 * np.outer([1.0, 1.0, 1.2], parts[0])
    load[:, top, 0] = 4e-3 * np.outer([0.2, 1.0, -0.5], parts[1])
    force, length = 10 ** rng.uniform(-6, 6), 10 ** rng.uniform(-4, 4)
    problem = {
        "K": csr_array(model.K) * (force / length),
        "B": B,
        "gap": model.gap * length,
        "mu": mu,
        "fixed": model.fixed,
        "frame": frame,
        "points": model.points * length,
        "coordinates": np.repeat(model.nodes, d, axis=0) * length,
    }
    if "cohesion" in law:
        problem["cohesion"] = law["cohesion"] * force
    return problem, load.reshape(3, -1) * force
