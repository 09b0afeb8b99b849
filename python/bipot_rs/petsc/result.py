"""Results whose displacements are Vecs of PETSc."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

from numpy.typing import ArrayLike

from bipot_rs._lib.types import Communicator, PetscMat, PetscVec, Vectors
from bipot_rs.contact.path import load_path
from bipot_rs.contact.results import result, solution
from bipot_rs.contact.results.derivatives import Gradient, Tangent
from bipot_rs.contact.results.result import Result as WholeResult
from bipot_rs.petsc.agreement import agreed


class Step(solution.Step):
    """One load step. Arrays of contacts are whole on every rank.

    `displacement` is a Vec in the numbering of ``K``, each rank with its own rows. A pickle
    and a file do not hold it.
    """

    @classmethod
    def of(cls, step: solution.Step) -> Step:
        """The same step, with a Vec."""
        known = {f.name: getattr(step, f.name) for f in fields(step)}
        return cls(**known)

    @property
    def displacement(self) -> PetscVec:  # type: ignore[override]
        """Displacement of all degrees of freedom, a Vec.

        Raises
        ------
        ValueError
            The step was read from a file or came from another process.
        """
        if "u" not in self._kept:
            raise ValueError(
                "displacement is a Vec, which neither a file nor a pickle holds: use it "
                "in the program that solved the problem"
            )
        return self._kept["u"]  # type: ignore[return-value]

    def without_vectors(self) -> solution.Step:
        """The step without its Vecs, the same on every rank."""
        return replace(
            self, _kept={}, load=None, prescribed=None, _problem=None, _recover=None
        )

    def __getstate__(self) -> dict[str, object]:
        return super().__getstate__() | {"_kept": {}, "load": None}


class Result(result.Result):
    """The steps of a load path; arrays of contacts are whole on every rank."""

    _comm: Communicator | None = None

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
        self._write_once(lambda: self._whole().save(path, displacements=False))

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the contacts as a PVD series for ParaView; all ranks call it."""
        self._write_once(lambda: self._whole().write(path))

    def jvp(  # type: ignore[override]
        self,
        load: Vectors | None = None,
        prescribed: ArrayLike | None = None,
        gap: ArrayLike | None = None,
        mu: ArrayLike | None = None,
        K: PetscMat | None = None,
    ) -> Tangent:
        """Directional derivative, as `bipot_rs.Result.jvp`. All ranks call it.

        Parameters
        ----------
        load
            A Vec or a list of them.
        prescribed, gap, mu
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
        return super().jvp(load, prescribed, gap, mu, K=K)  # type: ignore[arg-type]

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

    def _whole(self) -> WholeResult:
        whole = WholeResult(
            [Step.without_vectors(step) for step in self.steps],  # type: ignore[arg-type]
            contacts=self.contacts,
            shape=self._shape,
            seconds=self.seconds,
            success=self.success,
            message=self.message,
            units=self.units,
            remarks=self._remarks,
        )
        whole._first = self._first
        whole._mesh = self._mesh
        return whole

    def _write_once(self, work: Callable[[], None]) -> None:
        comm = self._comm
        if comm is None:
            work()
        else:
            agreed(comm, lambda: work() if comm.rank == 0 else None)

    def __getstate__(self) -> dict[str, object]:
        return super().__getstate__() | {"_comm": None}


class Following(load_path.Following):
    """A load path whose steps are being solved, with Vecs as displacements."""

    comm: Communicator | None = None

    def _made(self, *asked: Any) -> Step:
        return Step.of(super()._made(*asked))

    def result(self, success: bool = True, message: str | None = None) -> Result:
        """Make the `Result` of the steps so far."""
        whole = super().result(success, message)
        made = Result.__new__(Result)
        vars(made).update(vars(whole))
        made._comm = self.comm
        return made
