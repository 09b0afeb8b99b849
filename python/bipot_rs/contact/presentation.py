"""Pictures and tables of a load path, as methods of `Result`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from bipot_rs._lib.validation import one_of
from bipot_rs.contact.results import tables

if TYPE_CHECKING:
    from bipot_rs.contact.results.solution import Step

TABLES = ("steps", "contacts")


class Presentation:
    """Methods of `Result` that show it: `plot`, `animate` and `table`."""

    if TYPE_CHECKING:
        steps: tuple[Step, ...]
        contacts: dict[str, Any]

        def _load(self, k: int) -> float: ...

    def plot(self, kind: str | None = None, **options: Any) -> Any:
        """Draw a picture by its name, see `bipot_rs.plots.plot`.

        Parameters
        ----------
        kind
            Name of the picture, as ``bipot plot --kind``: ``"slip"``, ``"deformed"``,
            ``"pressure_map"``, …. Default: ``"tractions"`` in 2D, in 3D ``"pressure_map"``,
            or ``"pressure_3d"`` if the surface is not flat.
        options
            Arguments of the function of the picture, such as ``step``, ``where``, ``ax``.

        Returns
        -------
        matplotlib.axes.Axes
            ``result.plot().figure.savefig("a.png")`` writes the picture.

        Raises
        ------
        ModuleNotFoundError
            matplotlib is not installed.
        TypeError, ValueError
            A wrong argument; the message names it.
        """
        # By the package, which imports it on first use: pictures are above this layer.
        import bipot_rs

        return bipot_rs.plots.plot(self, kind, **options)

    def animate(
        self,
        path: str | os.PathLike[str],
        kind: str | None = None,
        *,
        steps: ArrayLike | None = None,
        frames_per_second: float = 4.0,
        dpi: float = 100.0,
        **options: Any,
    ) -> Path:
        """Write a GIF with one frame for each load step, see `bipot_rs.plots.animate`.

        All frames have the same scales. Arguments as there; those of `plot` are ``kind``
        and ``options``.
        """
        import bipot_rs

        written: Path = bipot_rs.plots.animate(
            self,
            path,
            kind,
            steps=steps,
            frames_per_second=frames_per_second,
            dpi=dpi,
            **options,
        )
        return written

    def table(self, rows: str = "steps") -> Any:
        """The numbers of the path as a table: a pandas ``DataFrame`` if pandas is installed.

        Otherwise it is a structured array of NumPy with the same columns: in both
        ``table["residual"]`` is a column.

        Parameters
        ----------
        rows
            ``"steps"``: a row for each load step. Columns are those of ``steps.csv`` of the
            command line: ``step`` from 0, ``load``, the load parameter, which is ``step +
            1`` for a path of arrays; the numbers of contacts ``open``, ``slip`` and
            ``stick``; ``normal_force``, ``tangential_force`` and ``friction_used`` (NaN if
            nothing presses), for several surfaces with `` of body.surface``, if the frames
            of the contacts are known; ``residual``, ``iterations``, ``seconds``; with wear
            ``cycle``, ``worn_volume`` and ``largest_depth``.

            ``"contacts"``: a row for each contact in each step. Columns are ``step``,
            ``contact``, ``surface``, ``x``, ``y``, ``z``, ``area``, ``mu``, ``status``
            (``"open"``, ``"slip"`` or ``"stick"``), and components ``_n``, ``_t1``, ``_t2``
            of ``reaction``, ``traction``, ``relative_displacement`` and ``slip``, as in
            `Step`; with wear ``wear``. Columns of unknown data are left out.

        Raises
        ------
        ValueError
            ``rows`` is neither of these.
        """
        one_of("rows", rows, TABLES)
        found: Mapping[str, Any]
        if rows == "contacts":
            found = tables.of_contacts(self.steps, self.contacts)
        else:
            loads = [self._load(k) for k in range(len(self.steps))]
            found = tables.of_steps(self.steps, loads, self.contacts)
        return tables.framed(found)
