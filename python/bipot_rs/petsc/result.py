"""Results whose displacements are Vecs of PETSc."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

from bipot_rs._lib.types import Communicator, Floats, PetscVec
from bipot_rs.contact.results import result, solution
from bipot_rs.contact.results.result import Result as WholeResult
from bipot_rs.petsc.agreement import do_together


class Step(solution.Step):
    """One load step. Arrays of contacts are whole on every rank.

    `displacement` is a Vec in the numbering of ``K``, each rank with its own rows. A pickle
    and a file do not hold it.
    """

    @property
    def displacement(self) -> PetscVec:  # type: ignore[override]
        """Displacement of all degrees of freedom, a Vec.

        Raises
        ------
        ValueError
            The step was read from a file or came from another process.
        """
        if self.computed.displacement is None:
            raise ValueError(
                "displacement is a Vec, which neither a file nor a pickle holds: use it "
                "in the program that solved the problem"
            )
        return self.computed.displacement  # type: ignore[return-value]

    def make_whole(self, displacement: Floats | None = None) -> solution.Step:
        """The step without its Vecs and its problem, with a whole displacement if given."""
        attributes = {field.name: getattr(self, field.name) for field in fields(self)}
        attributes["computed"] = solution.Computed(displacement)
        attributes |= dict.fromkeys(("load", "inquiry", "recovery"))
        return solution.Step(**attributes)

    def __getstate__(self) -> dict[str, object]:
        return super().__getstate__() | {
            "computed": replace(self.computed, displacement=None),
            "load": None,
        }


class Result(result.Result):
    """The steps of a load path; arrays of contacts are whole on every rank.

    `jvp` and `vjp` are those of `bipot_rs.Result`, which all ranks call with the same arrays
    of contacts: ``load`` and the cotangent of ``displacement`` are a Vec or a list of them,
    ``K`` a symmetric Mat with the layout of K. Of what they return, ``displacement`` and
    ``load`` are lists of Vecs, and ``K`` is a Mat. They raise `NotConvergedError` if the linear
    solver does not reach the accuracy of derivatives.
    """

    def __init__(
        self, *steps: Any, comm: Communicator | None = None, **keywords: Any
    ) -> None:
        super().__init__(*steps, **keywords)
        self._comm = comm

    @property
    def displacement(self) -> list[PetscVec]:  # type: ignore[override]
        """Displacement of each step, a list of Vecs."""
        return [step.displacement for step in self.steps]  # type: ignore[misc]

    def save(
        self, path: str | os.PathLike[str], *, displacements: bool | None = None
    ) -> None:
        """Write contacts and steps, without displacements, to an HDF5 file.

        All ranks call it and the first one writes.

        Raises
        ------
        OSError
            The file cannot be written; raised on every rank.
        ValueError
            ``displacements=True``: they are distributed.
        """
        if displacements:
            raise ValueError(
                "displacements=True: the displacements are distributed over the ranks, and "
                "this file holds the contacts; write the Vecs of result.displacement with "
                "PETSc"
            )
        self._write_once(lambda: self._make_whole().save(path, displacements=False))

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the contacts as a PVD series for ParaView; all ranks call it."""
        self._write_once(lambda: self._make_whole().write(path))

    def _make_whole(self) -> WholeResult:
        return WholeResult(
            [step.make_whole() for step in self.steps],  # type: ignore[attr-defined]
            contacts=self.contacts,
            shape=self.shape,
            seconds=self.seconds,
            success=self.success,
            message=self.message,
            units=self.units,
            remarks=self.remarks,
            first_step=self.first_step,
            mesh=self.mesh,
        )

    def _write_once(self, work: Callable[[], None]) -> None:
        comm = self._comm
        if comm is None:
            work()
        else:
            do_together(comm, lambda: work() if comm.rank == 0 else None)

    def __getstate__(self) -> dict[str, object]:
        return super().__getstate__() | {"_comm": None}
