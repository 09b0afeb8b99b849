"""The names of matplotlib that pictures use, each imported when it is first used.

`bipot_rs.plots` can be imported without matplotlib.
"""

from typing import TYPE_CHECKING

from bipot_rs._lib.optional import lazily

if TYPE_CHECKING:
    from matplotlib import colormaps as colormaps
    from matplotlib.animation import PillowWriter as PillowWriter
    from matplotlib.artist import Artist as Artist
    from matplotlib.axes import Axes as Axes
    from matplotlib.axis import Axis as Axis
    from matplotlib.backend_bases import FigureCanvasBase as FigureCanvasBase
    from matplotlib.cm import ScalarMappable as ScalarMappable
    from matplotlib.collections import LineCollection as LineCollection
    from matplotlib.collections import PolyCollection as PolyCollection
    from matplotlib.colorbar import Colorbar as Colorbar
    from matplotlib.colors import Colormap as Colormap
    from matplotlib.colors import ListedColormap as ListedColormap
    from matplotlib.colors import LogNorm as LogNorm
    from matplotlib.colors import Normalize as Normalize
    from matplotlib.figure import Figure as Figure
    from matplotlib.figure import SubFigure as SubFigure
    from matplotlib.legend import Legend as Legend
    from matplotlib.lines import Line2D as Line2D
    from matplotlib.patches import Patch as Patch
    from matplotlib.quiver import Quiver as Quiver
    from matplotlib.ticker import FuncFormatter as FuncFormatter
    from matplotlib.ticker import MaxNLocator as MaxNLocator
    from matplotlib.tri import Triangulation as Triangulation
    from matplotlib.typing import ColorType as ColorType
    from mpl_toolkits.mplot3d import Axes3D as Axes3D  # type: ignore[import-untyped]
    from mpl_toolkits.mplot3d.art3d import Line3DCollection as Line3DCollection  # type: ignore[import-untyped]
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection as Poly3DCollection

__getattr__, __dir__ = lazily(__name__)
