"""Draws the pictures of the chapters on materials, prox, contact law and Uzawa's algorithm.

python docs/paper/figures_law.py

Figs. 1 to 3 of the paper are among them; points, arrows and sets are computed by the
package, from the materials and laws that the chapters describe.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Circle, Polygon

import bipot_rs as bp
from bipot_rs.theory import law as laws
from bipot_rs.theory import materials, soils

HERE = Path(__file__).parent
# Wong's colours, told apart by colour-blind eyes.
BLACK, BLUE, RED, GREEN, ORANGE = "#000000", "#0072B2", "#D55E00", "#009E73", "#E69F00"
GREY = "#DDDDDD"


def save(figure, name):
    """Write a PNG of at most 150 kB."""
    figure.tight_layout()
    figure.savefig(
        HERE / name, dpi=110, bbox_inches="tight", metadata={"Software": None}
    )
    plt.close(figure)


def arrow(axes, start, end, colour, style="-|>", **options):
    """An arrow between two points."""
    axes.annotate(
        "",
        xy=end,
        xytext=start,
        arrowprops={
            "arrowstyle": style,
            "color": colour,
            "shrinkA": 0,
            "shrinkB": 0,
            "lw": 1.6,
            **options,
        },
    )


def bare(axes, x, y):
    """Equal axes through the origin, named, without numbers."""
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)
    axes.axhline(0, color=BLACK, lw=0.7, zorder=0)
    axes.axvline(0, color=BLACK, lw=0.7, zorder=0)
    axes.text(axes.get_xlim()[1], -0.06, x, ha="right", va="top")
    axes.text(0.06, axes.get_ylim()[1], y, ha="left", va="top")


def cone(axes, mu, vertex, reach, colour=GREY, *, polar=False):
    """The cone of Coulomb from its vertex, or its polar, in (tangent, normal)."""
    x0, y0 = vertex
    if polar:
        corners = [
            (x0, y0),
            (x0 - reach, y0 - mu * reach),
            (x0 + reach, y0 - mu * reach),
        ]
        corners = [
            *corners[:2],
            (x0 - reach, y0 - reach),
            (x0 + reach, y0 - reach),
            corners[2],
        ]
    else:
        corners = [
            (x0, y0),
            (x0 - mu * reach, y0 + reach),
            (x0 + mu * reach, y0 + reach),
        ]
    axes.add_patch(
        Polygon(corners, facecolor=colour, edgecolor=BLACK, lw=0.8, zorder=0)
    )


def materials_figure():
    """Bipotential of friction along the slip, and a soil in its meridian plane."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.2))
    slip = np.linspace(-1, 1, 401)
    start = materials.Start.unloaded(np.zeros(slip.size), 2)
    contact = materials.Coulomb(0.5, start)
    x = np.column_stack([np.zeros_like(slip), -slip])
    for pressure, colour in ((1.0, BLUE), (2.0, GREEN), (3.0, ORANGE)):
        y = np.tile([pressure, -0.5 * pressure], (slip.size, 1))
        left.plot(
            slip,
            contact.bipotential(x, y),
            color=colour,
            label=f"b, $t_n$ = {pressure:.0f}",
        )
        left.plot(slip, (x * y).sum(axis=1), "--", color=colour, lw=1)
    left.plot([], [], "--", color=BLACK, lw=1, label="x·y, friction at its limit")
    left.set_xlabel("slip $\\Delta u_t$ at zero gap")
    left.set_ylabel("energy")
    left.legend(frameon=False)
    left.set_title("Coulomb: b ≥ x·y, equal where friction opposes slip", fontsize=10)

    soil = soils.DruckerPrager(0.8, 0.25, 0.6)
    mean = np.linspace(-3, soil.apex, 50)
    limit = soil.friction * (soil.apex - mean)
    right.fill_between(mean, 0, limit, color=GREY, zorder=0)
    right.plot(mean, limit, color=BLACK, label="criterion, slope α")
    deviator = np.array([1.0, -1.0, 0, 0, 0, 0]) / np.sqrt(2)
    for at in (-2.2, -1.2, -0.3):
        s = soil.friction * (soil.apex - at)
        y = at * np.array([1.0, 1, 1, 0, 0, 0]) + s * deviator
        level = float(soil.plastic_potential(y))
        line = np.linspace(at - 0.5, at + 0.5, 2)
        right.plot(
            line,
            level - soil.dilatancy * line,
            color=RED,
            label="plastic potential, slope β" if at == -2.2 else None,
        )
        flow = soil.flow(y)
        # In the plane of (σ_m, |s|) the partner of σ_m is ε_v.
        arrow(right, (at, s), (at + 0.6 * flow[:3].sum(), s + 0.6), BLUE)
    # At the apex a cone of strains is admissible: ε_v >= β|e|.
    size = 0.9
    for share in np.linspace(0, 1, 4):
        e = size * (1 - share)
        volume = np.sqrt(size**2 - e**2) if share else soil.dilatancy * size
        arrow(right, (soil.apex, 0), (soil.apex + volume, e), BLUE)
    right.plot([], [], color=BLUE, label="flow $(\\varepsilon_v, |e|)$")
    right.set_xlabel("mean stress $\\sigma_m$")
    right.set_ylabel("deviator $|s|$")
    right.set_aspect("equal")
    right.set_ylim(0, 4)
    right.set_xlim(-3, 2.6)
    right.legend(frameon=False, loc="upper right")
    right.set_title("Drucker–Prager: flow normal to its potential", fontsize=10)
    save(figure, "2-materials.png")


def plastic_step(trial, bulk, shear):
    """The structure of one material point: stress to plastic strain."""

    def strain(y):
        lost = trial - y
        volume = lost[..., :3].sum(axis=-1, keepdims=True)
        spread = np.array([1.0, 1, 1, 0, 0, 0]) * volume / 3
        return (lost - spread) / (2 * shear) + spread / (3 * bulk)

    return strain


def uzawa_figure():
    """A soil's stress on its way back to the criterion, and how fast it comes."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4.2))
    soil = soils.DruckerPrager(0.8, 0.25, 0.6)
    unit = np.array([1.0, 1, 1, 0, 0, 0])
    deviator = np.array([1.0, -1.0, 0, 0, 0, 0]) / np.sqrt(2)
    bulk, shear = 2.0, 1.5
    mean = np.linspace(-3, soil.apex, 2)
    left.fill_between(mean, 0, soil.friction * (soil.apex - mean), color=GREY, zorder=0)
    left.plot(mean, soil.friction * (soil.apex - mean), color=BLACK)
    for at, s, colour, name in (
        (-1.6, 3.4, BLUE, "to the surface"),
        (0.9, 1.0, GREEN, "to the apex"),
        (-2.0, 1.0, ORANGE, "elastic"),
    ):
        trial = at * unit + s * deviator
        path = materials.uzawa(soil, plastic_step(trial, bulk, shear), trial, 0.8, 60)
        p = path[:, :3].mean(axis=1)
        q = np.linalg.norm(path - p[:, None] * unit, axis=1)
        left.plot(p, q, "o-", color=colour, ms=3.5, lw=1, label=name)
        left.plot(p[-1], q[-1], "s", color=colour, ms=8, mfc="none")
    left.set_xlabel("mean stress $\\sigma_m$")
    left.set_ylabel("deviator $|s|$")
    left.set_xlim(-3, 1.3)
    left.set_ylim(0, 3.7)
    left.legend(frameon=False)
    left.set_title("iterates from the trial stress, r = 0.8", fontsize=10)

    trial = -1.6 * unit + 3.4 * deviator
    strain = plastic_step(trial, bulk, shear)
    end = materials.uzawa(soil, strain, trial, 2.0, 2000)[-1]
    for r, colour in ((0.4, BLUE), (0.8, GREEN), (1.6, ORANGE), (3.2, RED)):
        path = materials.uzawa(soil, strain, trial, r, 60)
        error = np.linalg.norm(path - end, axis=1) / np.linalg.norm(end)
        right.semilogy(np.maximum(error, 1e-16), color=colour, label=f"r = {r}")
    right.set_xlabel("iteration")
    right.set_ylabel("relative error of the stress")
    right.legend(frameon=False)
    right.set_title("r decides the way, not the end", fontsize=10)
    save(figure, "4-uzawa.png")


def sliding_figure():
    """[dSF91, Fig. 1]: the normal to the cone at a sliding contact."""
    figure, axes = plt.subplots(figsize=(6.2, 4.8))
    mu, t0 = 0.6, np.array([0.9, 0.25])
    start = materials.Start([t0], [[0.0, 0.0]], [0.0])
    contact = materials.Coulomb(mu, start)
    t, slip = np.array([2.2, mu * 2.2]), -1.3
    du, dt = np.array([[0.0, slip]]), (t - t0)[None]
    if laws.by_sliding_normal(contact, du, dt, 1.0)[0] > 1e-14:
        raise ValueError("the pair of Fig. 1 is not on the law")
    axes.set_xlim(-2.9, 3.1)
    axes.set_ylim(-1.3, 3.2)
    bare(axes, "$\\Delta t_t$", "$\\Delta t_n$")
    cone(axes, mu, (-t0[1], -t0[0]), 3.9)
    axes.text(-0.75, 2.2, "$\\Delta K_\\mu$", fontsize=13)
    at = dt[0, ::-1]
    normal = np.array([-slip, -mu * abs(slip)])
    printed = np.array([slip, -mu * abs(slip)])
    way = np.array([slip, 0.0])
    arrow(axes, at, at + normal, BLUE)
    arrow(axes, at, at + printed, RED, linestyle="--")
    arrow(axes, at, at + way, GREEN)
    axes.plot(*at, "o", color=BLACK)
    axes.text(at[0] + 0.12, at[1] + 0.12, "$\\Delta t$", fontsize=12)
    axes.text(
        *(at + normal + [-0.75, -0.3]),
        "$(-\\mu|\\Delta u_t|,\\,-\\Delta u_t)$",
        color=BLUE,
        fontsize=12,
    )
    axes.text(*(at + way + [-0.1, 0.12]), "$\\Delta u_t$", color=GREEN, fontsize=12)
    axes.text(
        *(at + printed + [-1.25, -0.32]), "as printed in (61)", color=RED, fontsize=10
    )
    axes.plot(-t0[1], -t0[0], "o", color=BLACK, ms=4)
    axes.text(-t0[1] + 0.12, -t0[0] - 0.1, "$-t^0$", fontsize=12, va="top")
    save(figure, "5-sliding.png")


def residuals_figure():
    """Each form of the law, beside what a pair lacks of it."""
    figure, panels = plt.subplots(1, 2, figsize=(10.5, 4.2), sharey=True)
    sizes = np.logspace(-8, -0.5, 40)
    n = sizes.size
    start = materials.Start(
        np.tile([0.4, 0.1, -0.2], (n, 1)), np.zeros((n, 3)), np.full(n, 0.3)
    )
    law = materials.Coulomb(0.5, start)
    turned = np.column_stack([0 * sizes, np.cos(sizes), np.sin(sizes)])
    pressed = np.tile([1.0, -0.5, 0.0], (n, 1))
    lifted = turned.copy()
    lifted[:, 0], lifted[:, 1:] = sizes, [1.0, 0.0]
    for axes, v, title in (
        (panels[0], lifted, "a sliding contact lifted by δ"),
        (panels[1], turned, "slip turned by δ"),
    ):
        du = v.copy()
        du[:, 0] -= start.opening
        for name, form in laws.FORMS.items():
            colour = RED if name == "(54)" else BLUE
            axes.loglog(
                sizes, form(law, du, pressed - start.reaction, 1.0), color=colour, lw=1
            )
        axes.set_xlabel("δ")
        axes.set_title(title, fontsize=10)
    panels[0].set_ylabel("residual [force]")
    panels[0].plot([], [], color=RED, label="(54), an energy over |ṽ| and |t|")
    panels[0].plot([], [], color=BLUE, label="the nine other forms")
    panels[0].legend(frameon=False)
    save(figure, "5-residuals.png")


def one_projection_figure():
    """[dSF91, Fig. 2]: predictor (80) and corrector (81) in three statuses."""
    figure, panels = plt.subplots(1, 3, figsize=(12, 4.4))
    mu, t0, opening = 0.6, np.array([0.7, 0.2]), 0.25
    start = materials.Start([t0], [[0.0, 0.0]], [opening])
    contact = materials.Coulomb(mu, start)
    cases = (
        ("(a) no contact", [0.5, 0.3], [1.75, -0.4]),
        ("(b) adhesive friction", [0.3, 0.1], [-1.3, 0.35]),
        ("(c) sliding", [1.2, 0.3], [0.3, -1.0]),
    )
    statuses = []
    for axes, (title, dt, du) in zip(panels, cases, strict=True):
        axes.set_xlim(-2.2, 2.6)
        axes.set_ylim(-2.6, 2.4)
        bare(axes, "$\\Delta t_t$", "$\\Delta t_n$")
        vertex = (-t0[1], -t0[0])
        cone(axes, mu, vertex, 4.0)
        cone(axes, mu, vertex, 4.0, "#F3E3C8", polar=True)
        y, x = np.array([dt]), -np.array([du])
        tau = y[0] - [
            du[0] + opening + mu * abs(du[1]),
            du[1],
        ]
        end = contact.prox_at(y + x, x, 1.0)[0]
        statuses.append(int(bp.project([tau], mu, base=[t0])[1][0]))
        axes.plot(*dt[::-1], "o", color=BLACK)
        axes.text(dt[1] - 0.1, dt[0] - 0.12, "$\\Delta t^i$", ha="right", va="top")
        arrow(axes, dt[::-1], tau[::-1], ORANGE)
        axes.plot(*tau[::-1], "D", color=ORANGE)
        axes.text(tau[1] + 0.15, tau[0], "$\\Delta\\tau^{i+1}$", va="center")
        if not np.allclose(tau, end):
            arrow(axes, tau[::-1], end[::-1], BLUE)
        axes.plot(*end[::-1], "s", color=BLUE, ms=9, mfc="none", mew=2)
        left = end[1] < 0.6
        axes.text(
            end[1] - 0.2 if left else end[1] + 0.1,
            end[0] + 0.18,
            "$\\Delta t^{i+1}$",
            ha="right" if left else "left",
            color=BLUE,
        )
        axes.text(-0.9, 1.95, "$\\Delta K_\\mu$")
        axes.text(-1.9, -2.4, "polar cone, printed as $\\Delta K_\\mu^*$", fontsize=9)
        axes.set_title(title, pad=14)
    if statuses != [bp.Status.OPEN, bp.Status.STICK, bp.Status.SLIP]:
        raise ValueError(f"the statuses of Fig. 2 are {statuses}")
    save(figure, "8-one-projection.png")


def two_projections_figure():
    """[dSF91, Fig. 3]: (85) on the half-line, (87) on the disc."""
    figure, panels = plt.subplots(1, 3, figsize=(12, 4.0))
    mu, t0, opening = 0.6, np.array([0.7, 0.2, 0.1]), 0.1
    start = materials.Start([t0], [[0.0, 0.0, 0.0]], [opening])
    axes = panels[0]
    axes.set_xlim(-2.2, 2.2)
    axes.set_ylim(-1, 1)
    bare(axes, "$\\Delta t_n$", "")
    axes.plot([-t0[0], 2.2], [0, 0], color=GREY, lw=9, solid_capstyle="butt", zorder=0)
    dt_n, du_n = 0.4, 1.9
    limit = materials.frictionless(start)
    tau = dt_n - du_n - opening
    y, x = np.array([[dt_n, -0.2, -0.1]]), np.array([[-du_n, 0, 0]])
    end = limit.prox(y + x, 1.0)[0, 0]
    arrow(axes, (dt_n, 0.3), (tau, 0.3), ORANGE)
    arrow(axes, (tau, 0.12), (end, 0.12), BLUE)
    axes.plot(dt_n, 0, "o", color=BLACK)
    axes.plot(tau, 0, "D", color=ORANGE)
    axes.plot(end, 0, "s", color=BLUE, ms=9, mfc="none", mew=2)
    axes.text(dt_n, -0.25, "$\\Delta t_n^i$", ha="center")
    axes.text(tau, -0.25, "$\\Delta\\tau_n^{i+1}$", ha="center")
    axes.text(end, -0.25, "$-t_n^0 = \\Delta t_n^{i+1}$", ha="center", color=BLUE)
    axes.set_title("(a) no contact")

    dt_n = 1.3
    pressed = materials.Tresca(mu * (t0[0] + dt_n), start)
    for axes, title, dt, du in (
        (panels[1], "(b) adhesive friction", [0.5, 0.2], [0.95, 0.8]),
        (panels[2], "(c) sliding", [0.6, 0.4], [-1.0, -0.9]),
    ):
        axes.set_xlim(-2.2, 2.2)
        axes.set_ylim(-1.8, 1.8)
        bare(axes, "$\\Delta t_{t1}$", "$\\Delta t_{t2}$")
        axes.add_patch(
            Circle(-t0[1:], float(pressed.limit[0]), facecolor=GREY, edgecolor=BLACK)
        )
        tau = np.subtract(dt, du)
        y, x = np.array([[dt_n, *dt]]), np.array([[0.0, *np.negative(du)]])
        end = pressed.prox(y + x, 1.0)[0, 1:]
        axes.plot(*dt, "o", color=BLACK)
        axes.text(dt[0] + 0.1, dt[1] - 0.35, "$\\Delta t_t^i$")
        arrow(axes, dt, tau, ORANGE)
        axes.plot(*tau, "D", color=ORANGE)
        if not np.allclose(tau, end):
            arrow(axes, tau, end, BLUE)
        axes.plot(*end, "s", color=BLUE, ms=9, mfc="none", mew=2)
        axes.text(tau[0] - 0.1, tau[1] + 0.15, "$\\Delta\\tau_t^{i+1}$", ha="right")
        axes.text(end[0] + 0.15, end[1] - 0.32, "$\\Delta t_t^{i+1}$", color=BLUE)
        axes.text(-0.9, 0.65, "$\\Delta K_\\mu(\\Delta t_n)$")
        axes.plot(*-t0[1:], "+", color=BLACK)
        axes.set_title(title)
    save(figure, "8-two-projections.png")


if __name__ == "__main__":
    materials_figure()
    uzawa_figure()
    sliding_figure()
    residuals_figure()
    one_projection_figure()
    two_projections_figure()
