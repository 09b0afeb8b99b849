"""Matplotlib without a window, and the look that the figures share."""


def pyplot(font=9):
    """The module `matplotlib.pyplot`, with font sizes in points."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": font, "axes.titlesize": font + 1})
    return plt


def light_grid(axis):
    """Draw a light grid below the curves and no frame above and to the right."""
    axis.grid(color="0.9", lw=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
