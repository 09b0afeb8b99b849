"""Results whose displacements are Vecs of PETSc."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

from numpy.typing import ArrayLike

from bipot_rs._lib.types import Communicator, Floats, PetscMat, PetscVec, Vectors
from bipot_rs.contact.results import result, solution
from bipot_rs.contact.results.derivatives import Gradient, Tangent
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
    """The steps of a load path; arrays of contacts are whole on every rank."""

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

    def jvp(  # type: ignore[override]
        self,
        load: Vectors | None = None,
        prescribed: ArrayLike | None = None,
        gap: ArrayLike | None = None,
        mu: ArrayLike | None = None,
        K: PetscMat | None = None,
        *,
        cohesion: ArrayLike | None = None,
        dilatancy: ArrayLike | None = None,
    ) -> Tangent:
        """Directional derivative, as `bipot_rs.Result.jvp`. All ranks call it.

        Parameters
        ----------
        load
            A Vec or a list of them.
        prescribed, gap, mu, cohesion, dilatancy
            As in `bipot_rs.Result.jvp`, the same on every rank.
        K
            A symmetric Mat with the layout of K.

        Returns
        -------
        Tangent
            ``displacement`` is a list of Vecs; all ranks read it.

        Raises
        ------
        NotConvergedError
            The linear solver does not converge to the accuracy of derivatives.
        TypeError, ValueError, NotDifferentiableError
            As `bipot_rs.Result.jvp`.
        """
        return super().jvp(
            load,  # type: ignore[arg-type]
            prescribed,
            gap,
            mu,
            K=K,  # type: ignore[arg-type]
            cohesion=cohesion,
            dilatancy=dilatancy,
        )

    def vjp(  # type: ignore[override]
        self,
        reaction: ArrayLike | None = None,
        displacement: Vectors | None = None,
        relative_displacement: ArrayLike | None = None,
        slip: ArrayLike | None = None,
    ) -> Gradient:
        """Gradient, as `bipot_rs.Result.vjp`. All ranks call it.

        Parameters
        ----------
        displacement
            A Vec for each step, the cotangent of `displacement`.
        reaction, relative_displacement, slip
            As in `bipot_rs.Result.vjp`, the same on every rank.

        Returns
        -------
        Gradient
            ``load`` is a list of Vecs and ``K`` a Mat with the layout and pattern of K; all
            ranks read them, and ``prescribed``.

        Raises
        ------
        NotConvergedError, TypeError, ValueError, NotDifferentiableError
            As `jvp`.
        """
        return super().vjp(reaction, displacement, relative_displacement, slip)  # type: ignore[arg-type]

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
