"""Draws the picture of the chapter on friction that depends on direction.

python docs/paper/figures_anisotropic.py

Points and arrows are computed by the package: the ellipse by projection onto its cone,
the cube by its scene.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt

import bipot_rs as bp
from bipot_rs import scene

HERE = Path(__file__).parent
# Wong's colours, told apart by colour-blind eyes.
BLUE, RED, GREY = "#0072B2", "#D55E00", "#CCCCCC"
MU = np.array([0.3, 0.1])


def ellipse(axes):
    """Friction at unit pressure and the slip that it resists."""
    turn = np.linspace(0, 2 * np.pi, 400)
    axes.fill(
        *(MU[:, None] * [np.cos(turn), np.sin(turn)]), color=GREY, alpha=0.5, lw=0
    )
    axes.plot(*(MU[:, None] * [np.cos(turn), np.sin(turn)]), color="black", lw=1)
    # Points aside of the cone come back along its normals: the remainder is -v_t.
    side = np.arange(12) * np.pi / 6 + np.pi / 12
    out = np.column_stack(
        [np.zeros(12), MU[::-1] * np.stack([np.cos(side), np.sin(side)], 1)]
    )
    nearest, _ = bp.project(out, np.tile(MU, (12, 1)))
    friction, slip = nearest[:, 1:] / nearest[:, :1], (out - nearest)[:, 1:]
    slip /= np.linalg.norm(slip, axis=1)[:, None]
    zero = np.zeros(12)
    style = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.005}
    axes.quiver(zero, zero, *friction.T, color=RED, **style)
    axes.quiver(*friction.T, *(0.1 * slip.T), color=BLUE, **style)
    axes.set_aspect("equal")
    axes.set_xlim(-0.45, 0.45)
    axes.set_ylim(-0.3, 0.3)
    axes.set_xlabel("t1")
    axes.set_ylabel("t2")
    axes.set_title("friction $r_t / r_n$ (red), $-v_t$ (blue)", fontsize=10)


def cube(axes):
    """The base of a cube that is dragged across its grain."""
    grain = ["contact.0.mu=[0.3, 0.1]", "contact.0.axis=[1.0, 1.0, 0.0]"]
    # So far that every node slides.
    far = ["mesh.n=8", 'support.0.x={ value = 0.2, amplitude = "shear" }']
    asked = scene.read("sheared_cube", [*far, *grain])
    case = scene.assemble(asked, scene.bodies(asked))
    step = case.model.problem().solve(case.load, case.prescribed)[-1]
    tangents = case.model.frame[:, 1:]
    slip = np.einsum("ck,ckd->cd", step.slip, tangents)[:, :2]
    friction = np.einsum("ck,ckd->cd", step.traction[:, 1:], tangents)[:, :2]
    x, y = case.model.points[:, :2].T
    for shift in np.arange(-100, 101, 10):
        ends = np.clip([max(0, -shift), min(100, 100 - shift)], 0, 100)
        axes.plot(ends, ends + shift, color=GREY, lw=1, zorder=0)
    style = {"angles": "xy", "scale_units": "xy", "width": 0.004}
    longest = np.linalg.norm(slip, axis=1).max()
    axes.quiver(x, y, *slip.T, color=BLUE, scale=longest / 11, **style)
    most = np.median(np.linalg.norm(friction, axis=1))
    axes.quiver(x, y, *friction.T, color=RED, scale=most / 8, **style)
    axes.set_aspect("equal")
    axes.set_xlim(-12, 118)
    axes.set_ylim(-14, 112)
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    axes.set_title("slip (blue), friction (red), grain (grey)", fontsize=10)


def main():
    """Draw both."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), width_ratios=[6, 5])
    ellipse(left)
    cube(right)
    figure.tight_layout()
    figure.savefig(
        HERE / "11-anisotropic-friction.png", dpi=110, metadata={"Software": None}
    )
    plt.close(figure)


if __name__ == "__main__":
    main()
