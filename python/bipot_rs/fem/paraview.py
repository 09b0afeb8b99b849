"""Files for ParaView: bodies with stress, and contact surfaces."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bipot_rs._lib.types import AnyArray, Floats, Ints
from bipot_rs.contact.results.contact_fields import list_instants
from bipot_rs.contact.results.contact_fields import (
    make_contact_fields as fields_of_contacts,
)
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Step, recover_displacements
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.bodies.stress_recovery import COLUMNS, ROWS, MeanStress, von_mises
from bipot_rs.fem.contact_surface import contact_surface
from bipot_rs.files.series import Series, check_index, write_series

Instants = Sequence[Mapping[str, float]]


def write(path: str | os.PathLike[str], model: Assembly, steps: Sequence[Step]) -> None:
    """Write the bodies to ``DIR/NAME.pvd`` and contacts to ``DIR/NAME_contact.pvd``.

    Parameters
    ----------
    path
        ``DIR/NAME.pvd``; existing files of these names are replaced.
    model
        The bodies.
    steps
        A `Result`, or some of its steps. Missing displacements are computed. Units and
        the path parameter are written if a `Result` of a scene is given.

    Raises
    ------
    ValueError
        The name does not end in ``.pvd``, or displacements are missing and the steps were
        loaded without their problem.
    OSError
        A file cannot be written.
    """
    index = check_index(path)
    recover_displacements(list(steps))
    instants, units = None, None
    if isinstance(steps, Result):
        instants, units = steps.instants(), steps.units
    for _ in write_bodies(index, model, steps, instants=instants, units=units):
        pass
    contact = index.with_name(f"{index.stem}_contact{index.suffix}")
    write_contact(contact, model, steps, instants=instants, units=units)


def write_bodies(
    path: str | os.PathLike[str],
    model: Assembly,
    steps: Sequence[Step],
    of_cells: Iterable[Mapping[str, AnyArray]] | None = None,
    at_rest: Callable[[int], Floats | None] = lambda _: None,
    *,
    instants: Instants | None = None,
    units: Mapping[str, str] | None = None,
) -> Iterator[dict[str, AnyArray]]:
    """Write the bodies: displacements and contact fields at nodes, stress in cells.

    Each step is written when the next one is asked for; yields the fields of its cells.
    ``of_cells`` are further fields, one mapping for each step; ``at_rest`` returns that of
    `cell_fields` by the index of a step; ``instants`` are ``load`` and ``time`` of each step, by
    default its time for both; ``units`` as in `write_series`.
    """
    more = of_cells if of_cells is not None else ({} for _ in steps)
    when = list_instants(steps) if instants is None else instants
    series = BodySeries(path, model, units=units)
    for k, (step, fields) in enumerate(zip(steps, more, strict=True)):
        yield series.add(step, at_rest(k), fields, when[k])
    series.end()


@dataclass(frozen=True)
class Part:
    """The cells of a model that one of several processes writes."""

    number: int  # of this part
    count: int  # of all parts
    cells: Sequence[Ints]  # ascending numbers of the cells, for each body


class BodySeries:
    """The series of `write_bodies`, step by step; ``part`` are the cells to write."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        model: Assembly,
        part: Part | None = None,
        *,
        units: Mapping[str, str] | None = None,
    ) -> None:
        self._model = model
        # Nodes and cells to write; all without a part.
        self._nodes: slice | Ints = slice(None)
        self._cells: slice | Ints = slice(None)
        if part is None:
            self._means = [MeanStress(body) for body in model.bodies]
            self._series = Series(path, model.nodes, model.cells, units=units)
            return
        chosen = list(zip(model.bodies, part.cells, strict=True))
        self._means = [
            MeanStress(body, cells_of_part) for body, cells_of_part in chosen
        ]
        firsts = np.cumsum([0] + [body.mesh.nelements for body in model.bodies])
        self._cells = np.concatenate(
            [
                cells_of_part + first
                for cells_of_part, first in zip(part.cells, firsts, strict=False)
            ]
        )
        cells = [
            (kind, corners[cells_of_part])
            for (kind, corners), cells_of_part in zip(
                model.cells, part.cells, strict=True
            )
        ]
        touched = np.zeros(len(model.nodes), np.bool_)
        for _, corners in cells:
            touched[corners] = True
        self._nodes = np.flatnonzero(touched)
        number = np.cumsum(touched) - 1
        self._series = Series(
            path,
            model.nodes[self._nodes],
            [(kind, number[corners]) for kind, corners in cells],
            piece=part.number,
            pieces=part.count,
            units=units,
        )

    def add(
        self,
        step: Step,
        at_rest: Floats | None = None,
        more: Mapping[str, AnyArray] | None = None,
        instant: Mapping[str, float] | None = None,
    ) -> dict[str, AnyArray]:
        """Write the next step, and return the fields of its cells.

        ``at_rest`` and ``more`` are of all cells of all bodies.
        """
        model, cells_of_part = self._model, self._cells
        rest = None if at_rest is None else at_rest[cells_of_part]
        in_cells = cell_fields(model, step.displacement, rest, self._means) | {
            name: field[cells_of_part] for name, field in (more or {}).items()
        }
        fields = model.in_step(step).fields(
            step.displacement, step.reaction, step.status
        )
        chosen = {name: field[self._nodes] for name, field in fields.items()}
        self._series.add(chosen | dict(instant or {}), in_cells)
        return in_cells

    def end(self) -> None:
        """Write the index."""
        self._series.end()


def write_contact(
    path: str | os.PathLike[str],
    model: Assembly,
    steps: Sequence[Step],
    *,
    instants: Instants | None = None,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write the contact surfaces, with `contact_fields` at their nodes.

    Arguments are those of `write_bodies`.
    """
    when = list_instants(steps) if instants is None else instants
    fields = (
        {**contact_fields(model, step), **instant}
        for step, instant in zip(steps, when, strict=True)
    )
    write_series(path, model.points, contact_surface(model), fields, units=units)


def cell_fields(
    model: Assembly,
    displacement: Floats,
    at_rest: Floats | None = None,
    means: Sequence[MeanStress] | None = None,
) -> dict[str, Floats]:
    """``stress (cells, 6)``, xx, yy, zz, xy, yz, xz, and ``von_mises (cells,)`` [Pa].

    Mean values of the cells of all bodies, in their order. ``at_rest (cells, 3, 3)`` is
    the stress that initial strains add, `Case.stress_at_rest`. ``means``, one for each
    body, can be reused for many displacements; they may be of some cells only.
    """
    if means is None:
        means = [MeanStress(body) for body in model.bodies]
    tensors = np.concatenate(
        [
            mean(displacement[numbered.span], space=True)
            for mean, numbered in zip(means, model.numbered.values(), strict=True)
        ]
    )
    if at_rest is not None:
        tensors = tensors + at_rest
    return {"stress": tensors[:, ROWS, COLUMNS], "von_mises": von_mises(tensors)}


def contact_fields(model: Assembly, step: Step) -> dict[str, AnyArray]:
    """Fields at the contacts, acting on ``Contact.body``.

    Returns the fields of `bipot_rs.files.fields.OF_CONTACTS`, among them ``displacement`` [m],
    ``force`` [N] and ``traction`` [Pa] along global axes, ``pressure`` [Pa], ``slip`` of the
    step [m], remaining ``gap`` [m], ``status`` (0 open, 1 slip, 2 stick).
    """
    dofs = model.contact_dofs[:, :1] + np.arange(model.dim)
    contacts = {"frame": model.frame, "area": model.area}
    return fields_of_contacts(step, contacts, step.displacement[dofs])
