"""The problem of a scene on several ranks: K in parts, everything else on each rank.

Meshes, B, gaps, supports and loads are the same on all ranks; they are small. The nodes are
shared, each rank assembles its rows of K, and the numbering of K has the nodes of rank 0
first, then those of rank 1, and so on. Outside of this module all arrays have the numbering
of the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from bipot_rs._lib.types import Floats, Ints
from bipot_rs.cli.ranks import World
from bipot_rs.contact.errors import FloatingBodyError, NotIterativeError
from bipot_rs.contact.path.choice import check_method
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Computed, Step
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.fem.checks.free_bodies import unheld
from bipot_rs.fem.partition import by_coordinates, neighbours
from bipot_rs.petsc.library import Library, load
from bipot_rs.petsc.partition import by_graph
from bipot_rs.scene.case import Case

# Parts of a graph may differ in size by this fraction; bisection is exact.
_UNEQUAL = 0.1

# Unknowns up to which a factor on the first rank replaces multigrid.
_SMALL = 1000


@dataclass(frozen=True)
class Numbering:
    """The nodes in the order of K, rank after rank, ascending within a rank.

    Attributes
    ----------
    owner : (nodes,)
        Rank of each node.
    how
        What has shared the nodes.
    order : (n,)
        Degree of freedom of the model of each row of K.
    place : (n,)
        Row of K of each degree of freedom of the model.
    own : (m,)
        Nodes of this rank.
    counts : (ranks,)
        Number of rows of each rank.
    rank
        This rank.
    """

    owner: Ints
    how: str
    order: Ints
    place: Ints
    own: Ints
    counts: Ints
    rank: int

    @classmethod
    def of(cls, owner: Ints, how: str, rank: int, count: int, dim: int) -> Numbering:
        """Number the nodes of each rank."""
        nodes = np.argsort(owner, kind="stable")
        order = (dim * nodes[:, None] + np.arange(dim)).ravel()
        place = np.empty_like(order)
        place[order] = np.arange(order.size)
        counts = dim * np.bincount(owner, minlength=count)
        own = np.flatnonzero(owner == rank)
        return cls(owner, how, order, place, own, counts, rank)

    @property
    def rows(self) -> Ints:
        """Degrees of freedom of the model of the rows of this rank."""
        first = int(self.counts[: self.rank].sum())
        return self.order[first : first + int(self.counts[self.rank])]


def share(library: Library, ranks: World, model: Assembly) -> Numbering:
    """Share the nodes of a model: by its graph, or by coordinates without a partitioner.

    Each rank gets about as many nodes, wherever they are. Contacts need no special place,
    because their data are on all ranks.
    """
    nodes, count = len(model.nodes), ranks.count
    found = None
    if count > 1:
        ends = np.arange(count + 1) * nodes // count
        with ranks.together():
            first, last = (int(end) for end in ends[ranks.number :][:2])
            rows = neighbours(model.bodies, first, last)
        found = by_graph(library, ranks.comm, rows, nodes)
    owner, how = (None, "") if found is None else found
    if owner is None or _unequal(owner, count):
        owner, how = by_coordinates(model.nodes, count), "coordinates"
    return Numbering.of(owner, how, ranks.number, count, model.dim)


def _unequal(owner: Ints, count: int) -> bool:
    sizes = np.bincount(owner, minlength=count)
    return bool(np.ptp(sizes) > _UNEQUAL * sizes.mean() or not sizes.all())


def stiffness(
    library: Library, ranks: World, model: Assembly, numbering: Numbering
) -> Any:
    """K as a matrix of PETSc, assembled in parts."""
    PETSc = library.PETSc
    with ranks.together():
        rows = model.stiffness_rows(numbering.own)
        index = rows.indptr.astype(PETSc.IntType, copy=False)
        columns = numbering.place.astype(PETSc.IntType)[rows.indices]
        made = sparse.csr_array((rows.data, columns, index), shape=rows.shape)
        made.sort_indices()
        del rows, columns
    sizes = made.shape
    K = PETSc.Mat().createAIJ(
        (sizes, sizes),
        bsize=model.dim,
        csr=(made.indptr, made.indices, made.data),
        comm=ranks.comm,
    )
    K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return K


class Distributed:
    """The contact problem of a case on the ranks of MPI, as `Case.solve` uses it.

    Attributes
    ----------
    numbering
        The nodes of each rank.
    problem
        A `bipot_rs.petsc.ContactProblem`.
    """

    def __init__(self, case: Case, ranks: World) -> None:
        from bipot_rs.petsc.engine import NO_FRAMES
        from bipot_rs.petsc.problem import ContactProblem

        model = case.model
        if isinstance(model.moving, MovingGaps):
            raise ValueError(NO_FRAMES)
        library = load()
        self._ranks, self._model = ranks, model
        self.numbering = numbering = share(library, ranks, model)
        self._K = K = stiffness(library, ranks, model, numbering)
        contact = model.B.tocoo()
        entries = contact.data, (contact.row, numbering.place[contact.col])
        try:
            self.problem = ContactProblem(
                K,
                sparse.csr_array(entries, shape=contact.shape),
                gap=model.gap,
                mu=model.mu,
                fixed=numbering.place[model.fixed],
                coordinates=np.repeat(model.nodes[numbering.own], model.dim, axis=0),
                area=model.area,
                points=model.points,
                frame=model.frame,
                gather=_SMALL,
            )
        except (FloatingBodyError, NotIterativeError) as error:
            # Meshes and supports are the same on all ranks, and so is what they say.
            problems = list(unheld(model, rough=True))
            if not problems:
                raise
            raise FloatingBodyError("; ".join(problems)) from error

    @property
    def stats(self) -> Mapping[str, Any]:
        """Those of the problem, with the number of ranks and what has shared the nodes."""
        return {
            **self.problem.stats,
            "ranks": self._ranks.count,
            "partition": self.numbering.how,
        }

    def solve(
        self,
        load: ArrayLike | None,
        prescribed: ArrayLike,
        *,
        gap: ArrayLike | None = None,
        method: str = "auto",
        tol: float = 1e-10,
        max_iterations: int | None = None,
        start: Result | None = None,
        on_step: Callable[[int, Step], object] | None = None,
    ) -> Any:
        """`ContactProblem.solve` with loads in the numbering of the model.

        Displacements of the steps are on rank 0 only.
        """
        check_method(method, "petsc")
        loads = (
            None if load is None else [self._vector(row) for row in np.asarray(load)]
        )
        return self.problem.solve(
            loads,
            prescribed,
            gap=gap,
            tol=tol,
            max_iterations=max_iterations,
            start=self._started(start),
            on_step=self._told(on_step),
        )

    def follow(
        self,
        load: Callable[[float], Floats],
        prescribed: Callable[[float], Floats],
        *,
        gap: Callable[[float], Floats] | None,
        method: str = "auto",
        start: Result | None = None,
        on_step: Callable[[int, Step], object] | None = None,
        **settings: Any,
    ) -> Any:
        """`ContactProblem.follow` with loads in the numbering of the model, as `solve`."""
        check_method(method, "petsc")
        return self.problem.follow(
            lambda s: self._vector(load(s)),
            prescribed,
            gap=gap,
            start=self._started(start),
            on_step=self._told(on_step),
            **settings,
        )

    def _vector(self, values: Floats) -> Any:
        """A Vec from an array ``(n,)`` in the numbering of the model."""
        made = self._K.createVecRight()
        made.array[:] = values[self.numbering.rows]
        return made

    def _whole(self, vector: Any) -> Floats | None:
        """A Vec as array ``(n,)`` in the numbering of the model, on rank 0."""
        ranks = self._ranks
        own = np.ascontiguousarray(vector.array_r)
        found = np.empty(self._model.n) if ranks.first else None
        into = None if found is None else [found, self.numbering.counts.tolist()]
        ranks.comm.Gatherv(own, into, root=0)
        if found is None:
            return None
        return found[self.numbering.place]

    def _told(
        self, on_step: Callable[[int, Step], object] | None
    ) -> Callable[[int, Step], None]:
        """Convert each step before it is passed on."""

        def told(k: int, step: Step) -> None:
            u = self._whole(step.displacement)
            if on_step is not None:
                on_step(k, plain(step, u))

        return told

    def _started(self, start: Result | None) -> Result | None:
        """A result of an earlier run, with the last displacement as a Vec."""
        if start is None or not len(start):
            return None
        *others, last = start.steps
        u = self._ranks.broadcast(last.computed.displacement)
        vector = None if u is None else self._vector(u)
        whole = _with(last, Step, computed=Computed(vector))
        return Result(
            [*others, whole],
            contacts=start.contacts,
            shape=last.reaction.shape,
            success=start.success,
            message=start.message,
            first_step=start.first_step,
        )


def plain(step: Step, displacement: Floats | None) -> Step:
    """A step without the problem and the vectors of PETSc."""
    computed = Computed(displacement)
    return _with(step, Step, computed=computed, load=None, recovery=None, inquiry=None)


def _with(step: Step, kind: type[Step], **changed: Any) -> Step:
    known = {field.name: getattr(step, field.name) for field in fields(kind)}
    return kind(**(known | changed))


def part_of_cells(model: Assembly, numbering: Numbering) -> Sequence[Ints]:
    """Cells of each body that this rank writes: those whose first node it owns."""
    found, before = [], 0
    for body in model.bodies:
        first = before + body.cells[:, 0]
        found.append(np.flatnonzero(numbering.owner[first] == numbering.rank))
        before += len(body.points)
    return found
