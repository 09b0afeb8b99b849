"""Draws manufactured.png of verification.md, and faults.png of faults.md.

python docs/figures_verification.py
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import bipot_rs as bp

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests" / "python"))
from cases import faults, manufactured  # noqa: E402

COLOURS = {"STICK": "#0072B2", "SLIP": "#E69F00", "OPEN": "#7F7F7F"}
ELEMENTS = {"P1": "#56B4E9", "Q1": "#0072B2", "P2": "#E69F00", "Q2": "#D55E00"}


def draw_tractions(axes):
    """Exact tractions of the plane as lines, computed ones as marks."""
    solved = manufactured.solve(2, "Q1", 16)
    x, traction = solved.model.points[:, 0], solved.result.traction[0]
    fine = np.linspace(0, 1, 500)
    shear, normal = np.abs(manufactured.reaction(np.stack([fine, 0 * fine])))
    axes.plot(fine, normal, color="k", lw=1, label="$r_n$")
    axes.plot(
        fine, manufactured.MU * normal, color="k", lw=0.8, ls=":", label="$μ r_n$"
    )
    axes.plot(fine, shear, color="k", lw=0.8, ls="--", label="$|r_t|$")
    for name, colour in COLOURS.items():
        here = solved.result.status[0] == bp.Status[name]
        for component in np.abs(traction[here].T):
            axes.plot(x[here], component, "o", ms=3.5, color=colour)
    axes.set(xlabel="x", title="tractions in the plane, Q1, h = 1/16")
    axes.legend(frameon=False)


def draw_zones(axes):
    """The bottom of the cube: statuses, slips, and the exact ends of the zones."""
    solved = manufactured.solve(3, "Q1", 16)
    x, y, _ = solved.model.points.T
    for name, colour in COLOURS.items():
        here = solved.result.status[0] == bp.Status[name]
        axes.plot(x[here], y[here], "s", ms=4, color=colour, label=name.lower())
    slips = solved.result.status[0] == bp.Status.SLIP
    v = solved.result.relative_displacement[0]
    moved = np.einsum("cka,ck->ca", solved.model.frame[:, 1:], v[:, 1:])
    arrows = {"angles": "xy", "color": "k", "width": 0.006, "zorder": 3}
    axes.quiver(x[slips], y[slips], moved[slips, 0], moved[slips, 1], **arrows)
    across = np.linspace(0, 1, 100)
    for end in (manufactured.STICKS, manufactured.TOUCHES):
        bend = manufactured.BENT * (across - 0.5) ** 2
        axes.plot(end - bend, across, color="k", lw=1)
    axes.set(xlabel="x", ylabel="y", title="zones and slips in space, Q1, h = 1/16")
    axes.set_aspect("equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncol=3, frameon=False)


def draw_errors(axes):
    """Errors of u and of tractions against h."""
    for element, colour in ELEMENTS.items():
        cells = manufactured.SIZES[2, element]
        meshes = [manufactured.errors(2, element, n) for n in cells]
        h = [mesh.h for mesh in meshes]
        for field, line in (("displacement", "o-"), ("traction", "s--")):
            error = [getattr(mesh, field) for mesh in meshes]
            label = element if field == "displacement" else None
            axes.loglog(h, error, line, ms=3.5, lw=1, color=colour, label=label)
    for order, start in ((2, 1.2e-3), (2.5, 2.5e-6), (1.5, 1.5e-4)):
        h = np.array([1 / 64, 1 / 32])
        error = start * (h / h[0]) ** order
        axes.plot(h, error, color="k", lw=0.8)
        axes.annotate(f"{order:g}", (h[1], error[1]), fontsize=7)
    axes.set(xlabel="h", title="errors of u (—) and of tractions (- -)")
    axes.set_xticks([1 / 64, 1 / 16, 1 / 4], ["1/64", "1/16", "1/4"])
    axes.minorticks_off()
    axes.legend(frameon=False)


def draw_crack(axes):
    """Slips of the crack for ten cells on each half of it."""
    crack = faults.inclined_crack
    fine = crack.HALF * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 300))
    axes.plot(fine, 1e3 * crack.exact_slip(fine), color="k", lw=1, label="exact")
    for graded, colour in ((False, "#56B4E9"), (True, "#D55E00")):
        solved = faults.crack(10, graded)
        label = "graded cells" if graded else "equal cells"
        axes.plot(solved.x, 1e3 * solved.slip, "o", ms=3.5, color=colour, label=label)
    axes.set(xlabel="along the crack [m]", title="crack: slip [mm]")
    axes.legend(frameon=False)


def draw_faults(slips, tractions):
    """The fault of the reservoir: slips without friction, tractions when held."""
    reservoir = faults.reservoir
    fine = np.linspace(-280, 280, 2000)
    sliding = faults.fault(8, 0, 0, reservoir.smooth)
    held = faults.fault(8, 1, reservoir.COHESION, reservoir.depletion)
    slips.plot(reservoir.exact_slip(fine), fine, color="k", lw=1, label="exact")
    slips.plot(sliding.slip, sliding.z, "o", ms=3.5, color="#0072B2", label="h = a/8")
    slips.set(xlabel="slip of the right side, upwards [m]", ylabel="z [m]")
    slips.set_title("reservoir, without friction")
    exact = (reservoir.exact_pressure(fine), reservoir.exact_shear(fine))
    for k, (name, colour) in enumerate((("pressure", "#0072B2"), ("shear", "#E69F00"))):
        tractions.plot(exact[k] / 1e6, fine, color="k", lw=1)
        values = held.traction[:, k] / 1e6
        tractions.plot(values, held.z, "o", ms=3, color=colour, label=name)
    tractions.set(xlabel="traction [MPa]", title="reservoir, held")
    for axes in (slips, tractions):
        low, high = reservoir.LAYERS["left"]
        axes.axhspan(low, high, xmin=0, xmax=0.5, color="0.93")
        axes.axhspan(*reservoir.LAYERS["right"], xmin=0.5, xmax=1, color="0.93")
    slips.set_xticks([-0.18, -0.09, 0.0])
    slips.legend(frameon=False, loc="lower left")
    tractions.legend(frameon=False, loc="upper right", bbox_to_anchor=(0.95, 0.95))


def main():
    """Draw the pictures."""
    figure = Figure(figsize=(12, 4), layout="constrained")
    tractions, zones, errors = figure.subplots(1, 3)
    draw_tractions(tractions)
    draw_zones(zones)
    draw_errors(errors)
    figure.savefig(HERE / "manufactured.png", dpi=110)
    figure = Figure(figsize=(12, 4), layout="constrained")
    crack, slips, tractions = figure.subplots(1, 3)
    draw_crack(crack)
    draw_faults(slips, tractions)
    figure.savefig(HERE / "faults.png", dpi=110)


if __name__ == "__main__":
    main()
