"""The problem of a scene on several ranks: K in parts, everything else on each rank.

Meshes, B, gaps, supports and loads are the same on all ranks; they are small. Outside of this
module all arrays have the numbering of the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from bipot_rs._lib.types import Floats, PetscVec
from bipot_rs.contact.errors import FloatingBodyError, NotIterativeError
from bipot_rs.contact.path.choice import check_method
from bipot_rs.contact.path.load_steps import last_step
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.results.solution import Computed
from bipot_rs.contact.results.solution import Step as WholeStep
from bipot_rs.contact.results.state import Start
from bipot_rs.fem.checks.free_bodies import describe_free_bodies
from bipot_rs.fem.constraints.references import with_points
from bipot_rs.petsc import tuning
from bipot_rs.petsc.engine import NO_FRAMES
from bipot_rs.petsc.library import load
from bipot_rs.petsc.problem import ContactProblem
from bipot_rs.petsc.result import Result, Step
from bipot_rs.petsc.run.numbering import assemble_stiffness, share_nodes
from bipot_rs.petsc.run.ranks import World
from bipot_rs.scene.case import Case


class DistributedProblem:
    """The contact problem of a case on the ranks of MPI, as `Case.solve` uses it.

    ``numbering``: the nodes of each rank.
    ``problem``: a `bipot_rs.petsc.ContactProblem`.
    """

    def __init__(self, case: Case, ranks: World) -> None:
        model = case.model
        if isinstance(model.moving, MovingGaps):
            raise ValueError(NO_FRAMES)
        library = load()
        self._ranks = ranks
        self.numbering = numbering = share_nodes(library, ranks, model)
        self._K = assemble_stiffness(library, ranks, model, numbering)
        contact = model.B.tocoo()
        entries = contact.data, (contact.row, numbering.place[contact.col])
        self._ties = model.ties
        points = with_points(model.nodes, model.references)[numbering.nodes]
        kinematics = None if model.ties is None else model.find_kinematics()
        latches = model.find_latches()
        try:
            self.problem = ContactProblem(
                self._K,
                sparse.csr_array(entries, shape=contact.shape),
                gap=model.gap,
                **model.law,
                fixed=numbering.place[model.fixed],
                coordinates=np.repeat(points, model.dim, axis=0),
                area=model.area,
                points=model.points,
                frame=model.frame,
                gather=tuning.GATHERED_UNKNOWNS,
                _motions=None if kinematics is None else kinematics[1][numbering.rows],
                _latches=latches and (numbering.place[latches[0]], latches[1]),
            )
        except (FloatingBodyError, NotIterativeError) as error:
            # Meshes and supports are the same on all ranks, and so is what they say.
            problems = list(describe_free_bodies(model, rough=True))
            if not problems and isinstance(error, NotIterativeError):
                raise model.name_cause(error, "petsc") from None
            if not problems:
                raise
            raise FloatingBodyError("; ".join(problems)) from error

    @property
    def stats(self) -> Mapping[str, object]:
        """Counts of the problem, the number of ranks, and what has shared the nodes."""
        return {
            **self.problem.stats,
            "ranks": self._ranks.count,
            "partition": self.numbering.partitioner,
        }

    def solve(
        self,
        load: ArrayLike | None,
        prescribed: ArrayLike,
        *,
        method: str = "auto",
        start: Start | None = None,
        on_step: Callable[[int, WholeStep], object] | None = None,
        **others: Any,
    ) -> Result:
        """`ContactProblem.solve` with loads in the numbering of the model.

        ``others`` are its other keywords. The steps that ``on_step`` gets have displacements
        on rank 0 only.
        """
        check_method(method, "petsc")
        loads = None
        if load is not None:
            loads = [self._make_vector(row) for row in np.asarray(load)]
        return self.problem.solve(
            loads,
            prescribed,
            start=self._prepare_start(start),
            on_step=self._gather_before(on_step),
            **others,
        )

    def follow(
        self,
        load: Callable[[float], Floats],
        prescribed: Callable[[float], Floats],
        *,
        method: str = "auto",
        start: Start | None = None,
        on_step: Callable[[int, WholeStep], object] | None = None,
        **others: Any,
    ) -> Result:
        """`ContactProblem.follow` with loads in the numbering of the model, as `solve`."""
        check_method(method, "petsc")
        return self.problem.follow(
            lambda s: self._make_vector(load(s)),
            prescribed,
            start=self._prepare_start(start),
            on_step=self._gather_before(on_step),
            **others,
        )

    def _make_vector(self, values: Floats) -> PetscVec:
        """A Vec from an array ``(n,)`` in the numbering of the model."""
        vector = self._K.createVecRight()
        vector.array[:] = values[self.numbering.rows]
        return vector

    def _gather_vector(self, vector: PetscVec) -> Floats | None:
        """A Vec as array ``(n,)`` in the numbering of the model, on rank 0."""
        ranks, place = self._ranks, self.numbering.place
        whole = np.empty(len(place) if ranks.first else 0)
        into = [whole, self.numbering.counts.tolist()] if ranks.first else None
        ranks.comm.Gatherv(np.ascontiguousarray(vector.array_r), into, root=0)
        if not ranks.first:
            return None
        u = whole[place]
        return u if self._ties is None else self._ties.displacement(u)

    def _gather_before(
        self, on_step: Callable[[int, WholeStep], object] | None
    ) -> Callable[[int, WholeStep], None]:
        """Call ``on_step`` with steps whose displacements are whole."""

        def gather(k: int, step: WholeStep) -> None:
            of_path = cast("Step", step)
            whole = of_path.make_whole(self._gather_vector(of_path.displacement))
            if on_step is not None:
                on_step(k, whole)

        return gather

    def _prepare_start(self, start: Start | None) -> WholeStep | None:
        """The last step of an earlier run, with its displacement as a Vec."""
        last = last_step(start)
        if last is None:
            return None
        u = self._ranks.broadcast(last.computed.displacement)
        if u is not None and self._ties is not None:
            u = self._ties.unknowns(u)
        vector = None if u is None else self._make_vector(u)
        return replace(last, computed=Computed(vector))  # type: ignore[arg-type]
