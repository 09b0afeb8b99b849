"""Bearing capacity of strip footings: N_c and N_γ of `theory.structure`, beside closed forms.

    python benches/bearing_capacity.py [N_c] [interval] [N_gamma]

A footing of half width 1 goes into half of a plane-strain ground of Mohr and Coulomb, as an
obstacle in contact with it. Loads are forces divided by the half width. Tables of
docs/paper/13-body-and-contact.md.
"""

import math
import sys
import time

import numpy as np

from bipot_rs import fem
from bipot_rs.mesh.boxes import box
from bipot_rs.mesh.elements import second_order
from bipot_rs.theory.limit_load import bound_load
from bipot_rs.theory.soil_body import Soil
from bipot_rs.theory.structure import Contacts, Structure
from bipot_rs.theory.structure_state import StepNotConvergedError

ROUGH = 10.0


def stretch(start, end, count, rate):
    """Ticks whose distances grow."""
    return start + (end - start) * np.expm1(rate * np.linspace(0, 1, count + 1)) / (
        np.expm1(rate)
    )


def footing(cells, phi, psi, mu=0.0, *, cohesion=1.0, weight=0.0, nu=0.45, wide=6.0):
    """The structure with so many cells under half of the footing, and the contact nodes."""
    near = np.linspace(0, 2, 2 * cells + 1)
    x = np.r_[near, stretch(2, wide, max(3, int(1.5 * cells)), 1.2)[1:]]
    deep = np.linspace(0, 1.5, int(1.5 * cells) + 1)
    y = -np.r_[deep, stretch(1.5, 4, max(2, cells), 1.0)[1:]][::-1]
    mesh = second_order(box([x, y], "quadrilateral"), serendipity=True)
    body = fem.Body("ground", mesh, fem.Material(200.0, nu))
    at = body.points
    sides = np.flatnonzero((at[:, 0] < 1e-9) | (at[:, 0] > wide - 1e-9))
    base = np.flatnonzero(at[:, 1] < -4 + 1e-9)
    foot = np.flatnonzero((at[:, 1] > -1e-9) & (at[:, 0] < 1 + 1e-9))
    foot = foot[np.argsort(at[foot, 0])]
    B = np.zeros((2 * len(foot), at.size))
    rows = np.arange(len(foot))
    B[2 * rows, 2 * foot + 1], B[2 * rows + 1, 2 * foot] = -1.0, 1.0
    fixed = np.unique(np.r_[2 * base, 2 * base + 1, 2 * sides])
    soil = Soil.of_body(body, phi, psi, cohesion, weight)
    contacts = Contacts(B, np.zeros(len(foot)), mu)
    return Structure([], [soil], contacts, fixed), foot, at


def press(structure, depth, count=16, start=None):
    """Force at the end of the path, or at the last step that was solved, and its depth."""
    contacts = structure.shape[0]
    state, reached, forces, step = start, 0.0, [0.0], depth / count
    while reached < depth * (1 - 1e-9):
        down = min(reached + step, depth)
        try:
            (state,) = structure.solve(
                gap=np.full((1, contacts), -down), start=state, tol=1e-8
            )
        except StepNotConvergedError:
            step /= 2
            if step < depth / count / 16:
                break
            continue
        reached = down
        forces.append(float(state.reaction[:, 0].sum()))
    return max(forces), reached, state


def prandtl(phi):
    """N_c of Prandtl and Reissner."""
    if not phi:
        return 2 + math.pi
    tan = math.tan(math.radians(phi))
    rise = math.tan(math.radians(45 + phi / 2)) ** 2
    return (math.exp(math.pi * tan) * rise - 1) / tan


def davis(phi, psi):
    """N_c by Davis' reduced strength."""
    f, p = math.radians(phi), math.radians(psi)
    eta = math.cos(p) * math.cos(f) / (1 - math.sin(p) * math.sin(f))
    return eta * prandtl(math.degrees(math.atan(eta * math.tan(f))))


def show(*cells):
    """A row of a table."""
    print("| " + " | ".join(str(cell) for cell in cells) + " |", flush=True)


def tabulate_n_c():
    """Smooth punch with associated flow, extrapolated in the size of the cells."""
    show("φ/ψ", "N_c, 2, 4, 6 cells", "extrapolated", "closed form", "difference")
    for phi, depth in ((0.0, 0.3), (20.0, 1.0), (30.0, 2.0)):
        values = []
        for cells in (2, 4, 6):
            structure, _, _ = footing(cells, phi, phi, nu=0.49 if not phi else 0.45)
            values.append(press(structure, depth)[0])
        _, limit = np.polyfit([1 / 4, 1 / 6], values[1:], 1)
        exact = prandtl(phi)
        show(
            f"{phi:g}",
            np.round(values, 3),
            f"{limit:.3f}",
            f"{exact:.3f}",
            f"{100 * (limit / exact - 1):+.2f} %",
        )


def tabulate_intervals(cells=2):
    """Own flow: the load reached, beside what is proved on this mesh and Davis' estimate."""
    show("φ/ψ", "reached", "at depth", "proved on this mesh", "associated", "Davis")
    for phi, psi in ((20.0, 10.0), (20.0, 0.0), (30.0, 10.0)):
        structure, _, _ = footing(cells, phi, psi)
        most, depth, _ = press(structure, 2.0 if phi > 20 else 1.0)
        limits = bound_with_footing(structure)
        show(
            f"{phi:g}/{psi:g}",
            f"{most:.3f}",
            f"{depth:.2f}",
            f"{limits.lower:.3f} to {limits.upper:.3f}",
            f"{prandtl(phi):.3f}",
            f"{davis(phi, psi):.3f}",
        )


def tabulate_n_gamma(cells=2, phi=30.0):
    """Ground with weight and little cohesion: N_γ for interfaces of several frictions."""
    show("μ", "N_γ, ψ = φ", "N_γ, ψ = 0", "bound of the mesh, associated")
    for mu in (0.0, 0.1, 0.3, ROUGH):
        row = []
        for psi in (phi, 0.0):
            structure, _, _ = footing(cells, phi, psi, mu, cohesion=0.05, weight=1.0)
            state = structure.solve(start=lateral(structure), tol=1e-8)[0]
            most, _, _ = press(structure, 0.4, start=state)
            row.append(f"{most:.3f}")
        bound = bound_with_footing(structure).upper
        show("rough" if mu == ROUGH else f"{mu:g}", *row, f"{bound:.3f}")


def lateral(structure):
    """Earth pressure at rest of the weight, K0 = 1 - sin φ."""
    rest = 1 - structure.soils[0].mu

    def stress(x):
        vertical = x[1]
        field = np.zeros((3, 3, *vertical.shape))
        field[1, 1] = vertical
        field[0, 0] = field[2, 2] = rest * vertical
        return field

    return structure.at_rest([stress])


def bound_with_footing(structure):
    """Proved limits of the force on the footing, with its contacts in the mechanism."""
    # The footing as a body that only moves down: one degree of freedom more.
    n = structure.n
    B = np.hstack([structure.matrix.toarray(), np.zeros((structure.gap.size, 1))])
    B[0::2, n] = 1.0
    contacts = Contacts(B, structure.gap, structure.contacts.law.mu)
    whole = Structure([], [extend(structure.points[0])], contacts, structure.fixed)
    whole.weight[:n] = structure.weight
    load = np.zeros(n + 1)
    load[n] = -1.0
    return bound_load(whole, load)


def extend(points):
    """Points with one column more, for the footing."""
    from scipy import sparse

    from bipot_rs.theory.points import PlasticPoints

    empty = sparse.csr_array((points.strain.shape[0], 1))
    return PlasticPoints(
        sparse.hstack([points.strain, empty]).tocsr(),
        points.weights,
        points.stiffness,
        mu=points.law.mu,
        dilatancy=points.law.dilatancy,
        cohesion=points.law.cohesion,
        apex=points.apex,
        components=points.components,
        poisson=points.poisson,
        shape=points.shape,
    )


def main(names):
    """The tables that are named, or all."""
    tables = {
        "N_c": tabulate_n_c,
        "interval": tabulate_intervals,
        "N_gamma": tabulate_n_gamma,
    }
    for name in names or tables:
        start = time.perf_counter()
        tables[name]()
        print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
