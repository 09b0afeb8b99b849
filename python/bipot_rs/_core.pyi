"""The compiled core. Private: `bipot_rs` checks arguments before they come here.

Arrays are C-ordered; nodes are rows ``(n_c, d)``, components normal first. Friction
coefficients ``mu`` are ``(n_c,)``, or in space ``(n_c, 2)``. Of a ``law`` the attributes are
read.
"""

from collections.abc import Callable
from typing import Final, Protocol, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from bipot_rs._lib.types import Integers
from bipot_rs.contact.law.contact_law import ContactLaw

__all__ = [
    "METHODS",
    "CondensationForecast",
    "CondensationStats",
    "Condensed",
    "ConeSet",
    "ContactPath",
    "ContactTangent",
    "ContactVariables",
    "Decision",
    "LimitLoad",
    "LinearisedLaws",
    "LoadStep",
    "NewtonStep",
    "Path",
    "Primal",
    "PrimalPath",
    "PrimalTangent",
    "ProvedBound",
    "Reduced",
    "ReducedSolution",
    "SequenceFields",
    "Settings",
    "Statics",
    "StiffnessRows",
    "TangentSystem",
    "TangentView",
    "bodies",
    "build_profile",
    "combine_motions",
    "connected",
    "diagonal",
    "dof_directions",
    "find_outside",
    "follow",
    "free_motions",
    "is_sparse",
    "isotropic",
    "largest_friction",
    "largest_friction_ratio",
    "largest_reaction",
    "least_balanced",
    "least_work",
    "most_loose_bodies",
    "project",
    "resisting_rows",
    "respond_points",
    "return_heap",
    "rigid_motions",
    "stiffness",
    "sum_of_cells",
    "threads",
    "version",
]

_Floats = NDArray[np.float64]
# Of 32 or 64 bits.
_Indices = Integers
# Row pointers, column indices, values.
_Csr = tuple[_Indices, _Indices, _Floats]
# As `bodies` returns.
_Bodies = tuple[
    _Floats,
    NDArray[np.int64],
    _Floats,
    _Floats,
    _Floats,
    NDArray[np.int64],
    NDArray[np.int64],
]

build_profile: Final[str]
largest_friction: Final[float]
largest_friction_ratio: Final[float]
largest_reaction: Final[float]
least_balanced: Final[float]
least_work: Final[float]
most_loose_bodies: Final[int]
version: Final[str]
METHODS: Final[list[str]]

def threads() -> int:
    """How many are used where no argument says it."""

def stiffness(
    points: _Floats,
    cells: _Indices,
    slopes: _Floats,
    weights: _Floats,
    thickness: float,
    laws: _Floats,
    material: _Indices | None = None,
    part: tuple[_Indices, _Indices] | None = None,
    num_threads: int | None = None,
) -> _Csr:
    """`K` of a mesh ``(d, nodes)`` of cells of one kind ``(c, cells)``.

    ``slopes`` are ``∂φ_i/∂ξ_b`` at the quadrature points, ``(q, d, c)``. A row of ``laws``
    has λ and μ of a material, or all d⁴ entries of its tensor; ``material`` is the row
    of each cell. ``part`` has the nodes of the wanted rows, ascending, and the numbers of
    all nodes among the columns. A `ValueError` for a folded or flat cell has its number as
    ``cell``.
    """

def sum_of_cells(
    cells: _Indices,
    nodes: int,
    dim: int,
    matrices: _Floats,
    part: tuple[_Indices, _Indices] | None = None,
    num_threads: int | None = None,
) -> _Csr:
    """Sum of matrices of cells, for each cell ``(c, c, d, d)`` in one row; ``part`` as above."""

def project(
    tau: _Floats, law: ContactLaw, base: _Floats | None = None
) -> tuple[_Floats, NDArray[np.int8]]:
    """Projects every row of `tau` onto its cone, or increment set when `base` is given."""

def respond_points(tau: _Floats, points: _Floats) -> tuple[_Floats, _Floats, _Floats]:
    """Stress ``(m, d)``, flow ``(m, d)`` and derivative ``(m, d * d)`` of plastic points.

    ``tau (m, d)``, d = 2, 3, 4 or 6, are their stresses without flow. A row of ``points
    (m, 7)`` has the springs ρ_n and ρ_t; μ, the cohesion c and the dilatancy β; and H with
    the slip before: the limit of friction is ``c + μ r_n + H (‖v_t‖ - before)``.
    """

def isotropic(mu: _Floats, d: int) -> tuple[_Floats, _Floats]:
    """Factors ``(n_c, d)`` of components in which the law is Coulomb's, and its ``mu``.

    With these factors as the diagonal matrix ``T``, the law holds between ``T⁻¹ r`` and
    ``T v``.
    """

@final
class Settings:
    """The settings of a solve, checked once; a number out of range is a `ValueError`."""

    def __new__(
        cls,
        method: str,
        tol: float,
        max_iterations: int | None,
        max_seconds: float | None,
    ) -> Settings: ...
    @property
    def method(self) -> str: ...
    @property
    def tol(self) -> float: ...
    @property
    def max_iterations(self) -> int: ...
    @property
    def max_seconds(self) -> float | None:
        """None without a limit."""

@final
class ReducedSolution:
    """The solution of one problem, or the best point that was reached.

    The attributes are those of `bipot_rs.contact.results.solution.Solution`.
    """

    @property
    def reaction(self) -> _Floats: ...
    @property
    def relative_displacement(self) -> _Floats: ...
    @property
    def status(self) -> NDArray[np.int8]: ...
    @property
    def bipotential_gap(self) -> _Floats: ...
    @property
    def rigid_motion(self) -> _Floats | None: ...
    @property
    def free_motion(self) -> _Floats | None: ...
    @property
    def statuses_tried(self) -> int:
        """Number of statuses tried if this proves that there is no equilibrium, else 0."""
    @property
    def outcome(self) -> str: ...
    @property
    def residual(self) -> float: ...
    @property
    def tolerance(self) -> float: ...
    @property
    def iterations(self) -> int: ...
    @property
    def work(self) -> float: ...
    @property
    def history(self) -> _Floats: ...
    @property
    def minimising_sequence(self) -> SequenceFields | None: ...
    @property
    def bytes_beside(self) -> int:
        """Bytes of the transpose and the inverse of `W` that the solver keeps."""
    @property
    def seconds(self) -> float: ...

@final
class SequenceFields:
    """The fields of a minimising sequence, a row of `d n_c` numbers for each."""

    @property
    def reaction(self) -> _Floats: ...
    @property
    def balanced_reaction(self) -> _Floats: ...
    @property
    def relative_displacement(self) -> _Floats: ...
    @property
    def bifunctional(self) -> _Floats: ...

@final
class LoadStep:
    """A load step of a condensed problem."""

    @property
    def solution(self) -> ReducedSolution:
        """Its relative displacement is the total one, `B u + gap`."""
    @property
    def slip(self) -> _Floats:
        """Increment of the tangential relative displacement, `(n_c, d - 1)`."""
    @property
    def opened(self) -> NDArray[np.bool_]:
        """Contacts that are open by more than the tolerance."""
    @property
    def working_set(self) -> NDArray[np.int64] | None:
        """Numbers of the contacts that `W` was formed for; None if for all."""
    @property
    def working_motion(self) -> _Floats | None:
        """Amplitudes of rigid motions from which the next step begins."""

@final
class NewtonStep:
    """A load step that Newton made in the displacements."""

    @property
    def solution(self) -> ReducedSolution:
        """Its relative displacement is the total one, `B u + gap`."""
    @property
    def slip(self) -> _Floats:
        """Increment of the tangential relative displacement, `(n_c, d - 1)`."""
    @property
    def opened(self) -> NDArray[np.bool_]:
        """Contacts that are open by more than the tolerance."""
    @property
    def newton(self) -> int:
        """Number of Newton steps."""
    @property
    def krylov(self) -> int:
        """Number of iterations of the linear solver."""
    @property
    def reason(self) -> str | None:
        """Why it stalled, as part of a sentence."""
    @property
    def error_estimate(self) -> tuple[float, float] | None:
        """Relative errors of the reaction and of the relative displacement."""
    @property
    def bytes_multigrid(self) -> int:
        """Bytes of the largest multigrid hierarchy; 0 with another preconditioner."""

@final
class CondensationForecast:
    """Counts of the analysis of `K`, before the factorisation."""

    def as_dict(self) -> dict[str, object]:
        """The attributes by their names."""
    @property
    def bodies(self) -> int: ...
    @property
    def n_contact_dofs(self) -> int: ...
    @property
    def nnz_factor(self) -> int: ...
    @property
    def flops(self) -> float: ...
    @property
    def bytes_factor(self) -> int: ...
    @property
    def bytes_peak(self) -> int: ...
    @property
    def ordering(self) -> str: ...

@final
class CondensationStats:
    """Counts and seconds of a condensation, as in `ContactProblem.stats`."""

    def as_dict(self) -> dict[str, object]:
        """The attributes by their names."""
    @property
    def n(self) -> int: ...
    @property
    def n_contact_dofs(self) -> int: ...
    @property
    def nnz_factor(self) -> int: ...
    @property
    def flops(self) -> float: ...
    @property
    def bytes_factor(self) -> int: ...
    @property
    def bytes_peak(self) -> int: ...
    @property
    def bytes_compliance(self) -> int: ...
    @property
    def cond_S(self) -> float: ...
    @property
    def keeps_digits(self) -> bool:
        """Whether `W` keeps the digits of K; otherwise solutions are corrected with K."""
    @property
    def factor_kept(self) -> bool: ...
    @property
    def working_set(self) -> int | None:
        """Number of contacts at the start; None if `W` was formed for all."""
    @property
    def bodies(self) -> int: ...
    @property
    def islands(self) -> int: ...
    @property
    def rigid_motions(self) -> int: ...
    @property
    def rigid_motion_dofs(self) -> list[int]:
        """The most moved degree of freedom of each."""
    @property
    def rigid_motion_bodies(self) -> list[int]: ...
    @property
    def ordering(self) -> str: ...
    @property
    def orderings(self) -> int: ...
    @property
    def seconds_order(self) -> float: ...
    @property
    def seconds_symbolic(self) -> float: ...
    @property
    def seconds_factor(self) -> float: ...
    @property
    def seconds_compliance(self) -> float: ...

@final
class ProvedBound:
    """A proved bound of the error of a point; what is not available is None.

    The attributes are those of `bipot_rs.contact.results.error_bound.ErrorBound`.
    """

    @property
    def kind(self) -> str: ...
    @property
    def unique(self) -> bool: ...
    @property
    def gap(self) -> _Floats: ...
    @property
    def share(self) -> float | None: ...
    @property
    def reason(self) -> str | None:
        """A word for why there is no bound."""
    @property
    def which(self) -> int:
        """The contact, or the number of unknowns, of the reason."""
    @property
    def energy(self) -> float | None: ...
    @property
    def relative(self) -> float | None: ...
    @property
    def alone_within(self) -> float | None: ...
    @property
    def reaction(self) -> _Floats | None: ...
    @property
    def relative_displacement(self) -> _Floats | None: ...
    @property
    def contraction(self) -> float | None: ...
    @property
    def energy_by_gap(self) -> float | None: ...

@final
class Condensed:
    """`K`, `B`, gap and friction, condensed onto the contact set."""

    def __new__(
        cls,
        stiffness: _Csr,
        contact: _Csr,
        gap: _Floats,
        law: ContactLaw,
        fixed: _Indices,
        num_threads: int | None,
        places: _Floats | None = None,
        known: list[tuple[_Floats, _Floats]] | None = None,
        memory_limit: int | None = None,
        grow: bool | None = None,
        before: Condensed | None = None,
        on_forecast: Callable[[CondensationForecast], object] | None = None,
        kinematics: tuple[_Floats, _Floats, _Floats] | None = None,
    ) -> Condensed: ...
    @property
    def stats(self) -> CondensationStats:
        """Counts and seconds of the condensation."""
    def compliance(self) -> _Floats:
        """`W`, dense."""
    def sparse_compliance(self) -> tuple[list[int], list[int], _Floats] | None:
        """`W` in blocks where it is sparse."""
    def free_part(
        self, load: _Floats, prescribed: _Floats
    ) -> tuple[_Floats, _Floats, _Floats]:
        """`q` with the whole gap, the columns of `R` as rows, and `e`."""
    def make_inverse(self) -> None:
        """Makes the inverse of `W`, where there is one, before a step asks for it."""
    def displacements(
        self,
        states: list[tuple[_Floats, _Floats, _Floats, _Floats]],
        confirmed: list[tuple[_Floats, _Floats, _Floats]] | None = None,
    ) -> _Floats:
        """`u` of all degrees of freedom, a row each state.

        A state is total loads, prescribed displacements, reaction and rigid motion;
        ``confirmed`` are the relative displacements and gaps that ``B u + gap`` is held
        to, and what each step added to the tangential parts.
        """
    def stiffness(self) -> tuple[NDArray[np.int64], NDArray[np.int64], _Floats]:
        """Row pointers, columns and values of `K`, as far as anything depends on it."""
    def modes(self) -> _Floats:
        """What each rigid motion is at the contacts, a row each."""
    def with_law(self, law: ContactLaw) -> Condensed:
        """The same bodies and contacts with another law of its contacts."""
    def with_gap(self, gap: _Floats) -> Condensed:
        """The same bodies and contacts with other gaps ``(n_c, d)``."""
    def rotated(self, rotation: _Floats) -> Condensed:
        """The same bodies and contacts with `Q B` and `Q g`; rows of all `Q`."""
    def assess(
        self,
        load: _Floats,
        prescribed: _Floats,
        before: _Floats | None,
        reaction: _Floats,
    ) -> str:
        """What one solution of a step implies for the number of its solutions.

        `before` is the total relative displacement after the step before.
        """
    def forward_errors(
        self,
        load: _Floats,
        prescribed: _Floats,
        before: _Floats | None,
        reaction: _Floats,
        rigid: _Floats,
    ) -> tuple[float, float] | None:
        """Relative forward errors of a step, with `K` itself."""
    def error_bound(
        self,
        load: _Floats,
        prescribed: _Floats,
        before: _Floats | None,
        reaction: _Floats,
        reported: _Floats,
        rigid: _Floats,
    ) -> ProvedBound | None:
        """The bound of a step, whose total relative displacement is `reported`.

        None with a working set.
        """

@final
class Path:
    """A load path in progress; without a state it starts from the unloaded bodies."""

    def __new__(
        cls,
        problem: Condensed,
        start: tuple[_Floats, _Floats, NDArray[np.int8], _Floats] | None = None,
        working_set: tuple[NDArray[np.int64], _Floats, bool] | None = None,
    ) -> Path: ...
    def step(
        self,
        load: _Floats,
        prescribed: _Floats,
        gap: _Floats | None,
        settings: Settings,
    ) -> LoadStep:
        """One step to the total loads; the path moves on only where it converged.

        Without `gap` the gaps are those of the problem.
        """

@final
class Primal:
    """`K`, `B`, gap and friction, for Newton on the displacements."""

    def __new__(
        cls,
        stiffness: _Csr,
        contact: _Csr,
        gap: _Floats,
        law: ContactLaw,
        fixed: _Indices,
        num_threads: int | None,
        places: _Floats | None = None,
        has_copies: bool = False,
    ) -> Primal: ...
    @staticmethod
    def of_rows(
        rows: StiffnessRows, contact: _Csr, gap: _Floats, law: ContactLaw
    ) -> Primal:
        """The problem in space with `K` of all ``rows``, which are taken."""
    @property
    def bytes(self) -> tuple[int, int]:
        """Bytes of `K` in blocks, and a forecast of the bytes of all else."""
    def with_law(self, law: ContactLaw) -> Primal:
        """The same bodies and contacts with another law of its contacts."""
    def variables(self) -> ContactVariables:
        """The contacts, whose places are the unknowns."""
    def rotated(self, rotation: _Floats) -> Primal | None:
        """The same bodies and contacts with `Q B` and `Q g`; rows of all `Q`."""

@final
class StiffnessRows:
    """`K` of a mesh in space, in parts of its rows."""

    def __new__(
        cls, places: _Floats, fixed: _Indices, num_threads: int | None = None
    ) -> StiffnessRows: ...
    def append(self, part: _Csr, places: _Floats) -> bool:
        """Add the next rows, all of some nodes; whether their diagonal is positive.

        ``places`` are coordinates as of `bodies`.
        """
    def bodies(self, places: _Floats) -> _Bodies:
        """As `bodies`, of all rows, once."""

@final
class PrimalPath:
    """A load path in the displacements; without a state from the unloaded bodies."""

    def __new__(
        cls,
        problem: Primal,
        start: tuple[_Floats, _Floats, NDArray[np.int8]] | None = None,
        displacement: _Floats | None = None,
    ) -> PrimalPath: ...
    def step(
        self,
        load: _Floats,
        prescribed: _Floats,
        gap: _Floats | None,
        settings: Settings,
        again: bool = False,
        draft: bool = False,
    ) -> tuple[NewtonStep, _Floats]:
        """One step, as `Path.step`, and the displacements at its end.

        ``again`` makes the last step once more, with other loads, from its solution; ``draft``
        leaves out the estimate of its errors.
        """

@final
class ContactVariables:
    """The variables of contacts whose stiffness is held elsewhere.

    Values by places: `d` for each node of the interface.
    """

    def __new__(
        cls,
        contact: _Csr,
        gap: _Floats,
        law: ContactLaw,
        position: _Indices,
        fixed: int,
        blocks: _Floats,
        bodies: _Indices,
        held: _Indices,
    ) -> ContactVariables:
        """`contact` is `B` by places.

        `position` is the number of each place among the `fixed` prescribed degrees of
        freedom, `fixed` itself for a free one, `blocks` the diagonal blocks of `K`,
        `(nodes, d²)`, `bodies` the body of each node, and `held` is not zero for a body with
        a support.
        """
    def with_law(self, law: ContactLaw) -> ContactVariables:
        """The same contacts with another law, with one coefficient of each contact."""
    @property
    def places(self) -> int:
        """Number of places."""
    @property
    def join(self) -> bool:
        """Whether a contact joins nodes."""
    @property
    def nodes(self) -> NDArray[np.int64]:
        """Node of each contact with an unknown."""
    @property
    def absent(self) -> NDArray[np.bool_]:
        """Places without an unknown."""
    @property
    def diagonal(self) -> _Floats:
        """Estimate of the diagonal of `W`, `(n_c, d)`; zero without an unknown."""
    def offsets(self, prescribed: _Floats) -> _Floats:
        """Relative displacements of prescribed ones, `(n_c, d)`."""
    def moved(self, y: _Floats) -> _Floats:
        """Relative displacements `R y` of values by places, `(n_c, d)`."""
    def work(self, v: _Floats) -> _Floats:
        """`Rᵀ v` by places, of relative displacements `(n_c, d)`."""
    def transformation(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], _Floats]:
        """`T` by rows: row pointers, columns and values."""
    def to_own_variables(self, values: _Floats) -> None:
        """`B_s u_s` at the node of each contact, in place."""
    def to_displacements(self, values: _Floats) -> None:
        """`u = T y`, in place."""
    def to_local(self, values: _Floats) -> None:
        """`y = T⁻¹ u`, in place."""
    def forces_to_local(self, values: _Floats) -> None:
        """`Tᵀ f`, in place."""
    def terms_of_displacements(self, values: _Floats) -> None:
        """`|T| |y|`, in place."""
    def terms_of_forces(self, values: _Floats) -> None:
        """`|Tᵀ| f` for `f ≥ 0`, in place."""

@final
class ContactTangent:
    """The system of one Newton step at the places of the interface."""

    @property
    def held(self) -> NDArray[np.bool_]:
        """Places whose `dy` is known, or that have no unknown."""
    @property
    def known(self) -> _Floats:
        """`dy` at these places, zero elsewhere."""
    def clear(self, values: _Floats) -> None:
        """Set the held places to zero."""
    def add_laws(self, x: _Floats, out: _Floats) -> None:
        """Add to `A x` in `out` what the laws of sliding contacts add."""
    def pull(self, z: _Floats) -> None:
        """Make `u` of `z`: `Jᵀ z = A u` and what `add_transposed` adds."""
    def add_transposed(self, z: _Floats, out: _Floats) -> None:
        """Add the springs of `Jᵀ z` to `A u` in `out`."""
    def right_side(self, e: _Floats, moved: _Floats) -> _Floats:
        """The right side, from `e = A y − f` and `A` times `known`."""
    def springs(self) -> tuple[NDArray[np.int64], _Floats]:
        """Nodes of sliding contacts, and the symmetric part of each spring, `(m, d²)`."""

@final
class LinearisedLaws:
    """The linearised laws of one step in the form of a Newton step, by places."""

    @staticmethod
    def of(
        variables: ContactVariables,
        closed: _Indices,
        by_r: _Floats,
        by_v: _Floats,
    ) -> LinearisedLaws | None:
        """The laws of some contacts, `d` rows each; None if one determines nothing."""
    @property
    def statuses(self) -> NDArray[np.int8]:
        """The `Status` of each contact, whose preconditioner fits."""
    @property
    def tangent(self) -> ContactTangent:
        """The tangent without right sides."""
    def aim(self, s: _Floats, g: _Floats) -> tuple[ContactTangent, _Floats]:
        """The tangent for right sides of laws and places, and those of laws multiplied."""
    def reactions(self, s: _Floats, g: _Floats, dy: _Floats, moved: _Floats) -> _Floats:
        """`dr` of the laws, from multiplied right sides, `g`, `dy` and `A dy`."""
    def pulled(self, rho: _Floats, e: _Floats) -> _Floats:
        """`b` of the places in the transposed system; `e` changes."""
    def multipliers(
        self, rho: _Floats, e: _Floats, z: _Floats, moved: _Floats
    ) -> _Floats:
        """Multipliers of the laws, from the solution `z` and `A` times the pulled `z`."""

_V = TypeVar("_V")

class _Engine(Protocol[_V]):
    def may_be_soft(self) -> bool: ...
    def product(self, y: _V, /) -> _V: ...
    def add(self, y: _V, s: float, x: _V, /) -> _V: ...
    def at_places(self, y: _V, /) -> _Floats: ...
    def norm(self, y: _V, /) -> float: ...
    def largest(self, y: _V, /) -> float: ...
    def imbalance(self, e: _V, forces: _Floats, /) -> float: ...
    def terms(self, y: _V, /) -> tuple[float, _Floats]: ...
    def correction(
        self,
        tangent: ContactTangent,
        statuses: NDArray[np.int8],
        e: _V,
        tol: float,
        /,
    ) -> tuple[_V, int, bool] | None: ...
    def estimate(
        self, tangent: ContactTangent, statuses: NDArray[np.int8], e: _V, /
    ) -> _V | None: ...
    def agreed(self, decision: bool, /) -> bool: ...

@final
class ContactPath:
    """A load path whose long vectors and linear systems are those of a Python object."""

    def __new__(
        cls,
        variables: ContactVariables,
        start: tuple[_Floats, _Floats, NDArray[np.int8]] | None = None,
    ) -> ContactPath: ...
    def step(
        self,
        engine: _Engine[_V],
        start: _V,
        force: _V,
        prescribed: _Floats,
        gap: _Floats | None,
        settings: Settings,
        near: bool = False,
        draft: bool = False,
    ) -> tuple[NewtonStep, _V]:
        """One step, as `Path.step`, and the unknowns at its end.

        ``near`` says that the start has about the statuses of the solution, ``draft`` leaves out
        the estimate of its errors.
        `engine` is described in `src/primal/engine.rs`; `bipot_rs.petsc` has one.
        """

@final
class Statics:
    """The contacts of a question of statics: the motions that they resist, their cones."""

    def __new__(
        cls,
        rows: _Csr,
        motions: int,
        sizes: NDArray[np.int64],
        friction: _Floats,
        cohesion: _Floats,
    ) -> Statics: ...
    def decide(self, load: _Floats, max_seconds: float | None = None) -> Decision:
        """Whether reactions balance the loads on the motions."""
    def find_limit(self, dead: _Floats, live: _Floats) -> LimitLoad:
        """The largest multiple of the live load that reactions can balance beside the dead."""

@final
class ConeSet:
    """`h + G y` in circular cones, and `E y = f`: over it linear functions are minimised."""

    def __new__(
        cls,
        rows: _Csr,
        offset: _Floats,
        sizes: NDArray[np.int64],
        equations: _Csr,
        right: _Floats,
        unknowns: int,
    ) -> ConeSet: ...
    def minimise(self, cost: _Floats) -> tuple[_Floats, bool, float]:
        """The least `cost·y`, or a direction without one.

        Returns `y`, whether it is a point, and the gap to the bound from the multipliers.
        """

@final
class Decision:
    """Whether reactions balance the loads, with the proof."""

    @property
    def verdict(self) -> str: ...
    @property
    def reaction(self) -> _Floats:
        """All rows, in the cones."""
    @property
    def motion(self) -> _Floats:
        """Amounts of the motions; empty without a proof."""
    @property
    def margin(self) -> float: ...
    @property
    def relative_margin(self) -> float:
        """The margin over the mean load."""
    @property
    def inside(self) -> bool:
        """Whether the margin is more than rounding."""
    @property
    def excluded(self) -> float:
        """Length of the reactions that the motion excludes, relative to the loads."""
    @property
    def imbalance(self) -> float:
        """Relative to the loads."""

@final
class LimitLoad:
    """The largest multiple of a load, from both sides."""

    @property
    def upper(self) -> float: ...
    @property
    def mechanism(self) -> _Floats:
        """Amounts of the motions; empty if there is no bound."""
    @property
    def excluded(self) -> float:
        """Length of the reactions that the mechanism excludes, relative to the loads."""
    @property
    def reached(self) -> float | None: ...
    @property
    def reaction(self) -> _Floats | None: ...
    @property
    def dead(self) -> Decision:
        """The answer for the dead load alone."""

@final
class Reduced:
    """A reduced problem `v = W r + R a + q`, in the caller's numbering."""

    def __new__(
        cls,
        parts: list[tuple[list[int], _Floats, tuple[list[int], list[int]] | None]],
        q: _Floats,
        law: ContactLaw,
        modes: _Csr,
        load: _Floats,
    ) -> Reduced: ...
    @property
    def asymmetry(self) -> float:
        """Largest `|W_ij − W_ji|` over the largest entry."""
    def residual(self, reaction: _Floats, rigid: _Floats | None = None) -> float:
        """η at `(r, a)`; without `a`, at the rigid motion of least squares."""
    def is_contradiction(self, amounts: _Floats) -> bool:
        """Whether amounts of normal displacements prove that contacts contradict."""
    def solve(
        self,
        settings: Settings,
        reaction: _Floats | None,
        rigid: _Floats | None,
        num_threads: int | None,
        callback: Callable[[int, float, float], object] | None = None,
    ) -> ReducedSolution: ...
    def answers(self) -> tuple[list[ReducedSolution], bool] | None:
        """All solutions of a plane problem, found by trying all statuses.

        With whether there are no others; None for a problem that is too large for it, or
        not plane.
        """
    def assess(self, reaction: _Floats, num_threads: int | None = None) -> str:
        """What one solution implies for the number of solutions."""
    def forward_errors(
        self, reaction: _Floats, rigid: _Floats, num_threads: int | None = None
    ) -> tuple[float, float] | None:
        """Relative forward errors of reaction and relative displacement.

        By one further Newton correction; None if that is not determined.
        """
    def error_bounds(
        self,
        reactions: _Floats,
        points: int,
        rigid: _Floats,
        reported: _Floats | None = None,
        num_threads: int | None = None,
    ) -> list[ProvedBound]:
        """Bounds at several points, whose reactions are stacked.

        `reported` are the relative displacements that are reported for them.
        """
    def tangent(
        self, closed: _Indices, by_r: _Floats, by_v: _Floats
    ) -> TangentSystem | None:
        """The system of some contacts; nothing if it is singular."""

@final
class TangentView:
    """The contacts of a problem that close in a load path, for its derivatives."""

    def __new__(cls, problem: Condensed, contacts: _Indices) -> TangentView:
        """`contacts` are those that `W` is needed of."""
    @property
    def members(self) -> NDArray[np.int64]:
        """Numbers of the contacts that `W` is known of, ascending."""
    @property
    def diagonal(self) -> _Floats:
        """The diagonal of `W` of the members, ``(m, d)``."""
    @property
    def modes(self) -> _Floats:
        """Each rigid motion at the members, a row each."""
    def free_part(self, load: _Floats, prescribed: _Floats) -> tuple[_Floats, _Floats]:
        """`q` of the members without gaps, and `e`."""
    def product(self, reaction: _Floats, rigid: _Floats) -> _Floats:
        """`W r + R a` of the members."""
    def displacements(
        self, states: list[tuple[_Floats, _Floats, _Floats, _Floats]]
    ) -> _Floats:
        """`u` of total loads, prescribed displacements, reactions and rigid motions."""
    def system(
        self, closed: _Indices, by_r: _Floats, by_v: _Floats
    ) -> TangentSystem | None:
        """Factors the system of some members; nothing if it is singular.

        `closed` are places among the members. `by_r` and `by_v` have `d` rows for each.
        """

@final
class TangentSystem:
    """The factored system of the derivatives of one step."""

    @property
    def reciprocal_condition(self) -> float:
        """Estimate of the reciprocal condition, independent of units."""
    def solve(self, right: _Floats) -> _Floats:
        """`dr` of its contacts and `da`, a row for each right side."""
    def solve_transposed(self, right: _Floats) -> _Floats:
        """The same with the transposed matrix."""

@final
class PrimalTangent:
    """Linearised steps in the displacements, for their derivatives.

    The unknowns ``y`` of the problem, `order` numbers, take the place of rigid motions.
    """

    def __new__(cls, problem: Primal) -> PrimalTangent: ...
    @property
    def order(self) -> int:
        """Number of unknowns."""
    def stiffness(self) -> tuple[_Indices, _Indices, _Floats]:
        """`K` by rows, without the entries between prescribed degrees of freedom."""
    def force(self, load: _Floats, prescribed: _Floats) -> _Floats:
        """Forces on the unknowns."""
    def displacement(self, y: _Floats, prescribed: _Floats) -> _Floats:
        """Displacements of unknowns and prescribed displacements."""
    def solve(
        self, laws: LinearisedLaws, right: _Floats, transposed: bool
    ) -> _Floats | None:
        """Solves the system of laws of its variables; nothing if this does not converge.

        The right side has the rows of these laws, then those of the unknowns.
        """

def find_outside(values: _Floats, least: float, most: float) -> int | None:
    """Place of the first number, in the order of the memory, that is not from least to most."""

def is_sparse(blocks: int, contacts: int) -> bool:
    """Whether an island of so many blocks and contacts is kept sparse."""

def follow(
    paths: list[Path],
    cases: list[list[tuple[_Floats, _Floats, _Floats | None]]],
    settings: Settings,
) -> list[tuple[list[LoadStep], Exception | None]]:
    """Takes several paths through their steps, side by side.

    Of each the steps taken, of which the last may not have converged, and the exception
    that ended it.
    """

def bodies(
    stiffness: _Csr,
    places: _Floats,
    by_node: bool,
    num_threads: int | None = None,
) -> _Bodies:
    """The bodies of `K`, from the coordinates of its degrees of freedom.

    By degree of freedom the force of a dilation, which is zero inside a body, and the body; by
    body the work of shears, the least and the greatest coordinates, and the number of
    degrees of freedom, of all and of those without a support.
    """

def connected(count: int, first: _Indices, second: _Indices) -> NDArray[np.int64]:
    """The body of each of ``count`` nodes, of which pairs are coupled.

    Bodies are numbered in the order of their first nodes.
    """

def dof_directions(places: _Floats, d: int) -> NDArray[np.int64]:
    """The direction of each degree of freedom at ``places (n, 3)``.

    0, 1, 2 is a displacement along x, y, z; 3, 4, 5 a rotation about x, y, z; -1 means that
    the places do not tell. Degrees of freedom at one point are, in ascending order, the
    displacements of a node, then its rotations if there are as many as in a beam or a shell.
    If nodes of several bodies are at one point, consecutive numbers belong to one node.
    """

def rigid_motions(
    direction: NDArray[np.int64], arm: _Floats, d: int, reach: float
) -> _Floats:
    """Rigid motions of degrees of freedom at ``arm (n, 3)`` from the centre, ``(n, m)``.

    Translations by 1 along the axes, then rotations over ``reach``: ``m`` is 3 in the plane
    and 6 in space. An unknown direction gives zeros.
    """

def resisting_rows(
    rows: _Csr, motions: _Floats, wanted: _Indices
) -> tuple[NDArray[np.int64], _Floats, bool]:
    """The rows of `K` among those ``wanted`` that resist rigid motions.

    Their numbers; the forces relative to the terms of each row, ``(rows, m)``; and whether
    some are neither rounding nor those of a spring. ``motions (n, m)`` are those at all
    columns of the rows.
    """

def combine_motions(rows: _Floats) -> _Floats:
    """Amounts, as rows, of orthogonal combinations of motions.

    What the motions move in the ``rows (k, m)`` is orthogonal for two of them, too.
    """

def free_motions(rows: _Floats, accuracy: float = ...) -> _Floats:
    """Amounts of the motions that none of the ``rows (k, m)`` tells, orthonormal rows.

    A row is what the motions move at a support, a spring or a contact, to an ``accuracy``
    relative to the largest; the default is that of rows in double precision.
    """

def diagonal(stiffness: _Csr, num_threads: int | None = None) -> _Floats:
    """The diagonal of `K`, whose columns ascend in each row."""

def return_heap() -> None:
    """Returns freed arrays to the system, whatever a library of MPI has set."""
