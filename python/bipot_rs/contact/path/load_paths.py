"""Load paths of a prepared problem."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.types import Floats
from bipot_rs._lib.validation import Csr, Settings
from bipot_rs.contact.messages import remarks
from bipot_rs.contact.path.engine import Engine
from bipot_rs.contact.path.load_path import Following
from bipot_rs.contact.path.load_steps import Held, Loading
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.contact.path.prepared import Prepared
from bipot_rs.contact.results.solution import Step
from bipot_rs.contact.sensitivity.model import PathModel
from bipot_rs.contact.sensitivity.path import Differentiable

if TYPE_CHECKING:
    from bipot_rs.contact.results.state import Start


class LoadPaths(Prepared):
    """The part of a `ContactProblem` that begins load paths."""

    # Inclined supports, rigid sets and cyclic symmetries, which change every load.
    _held: Held | None = None
    # Arrays of the contacts, for results and files.
    _contacts: dict[str, NDArray[Any] | None]
    _mu: Floats
    _contact: Csr
    _loading: Loading
    # Whether ``gaps`` of the problem are by component.
    _gaps_by_component: bool
    _remarks: tuple[str, ...]
    _strength: remarks.Strength | None

    def _following(
        self,
        engine: Engine,
        mu: Floats,
        chosen: Settings,
        start: Start | None,
        gap: ArrayLike | MovingGaps | Callable[[float], Any] | None = None,
    ) -> Following:
        shape, contacts = self._shape[1:], self._contacts | {"mu": mu}
        before, known = self._remarks, self._strength

        def said(steps: Sequence[Step]) -> tuple[str, ...]:
            return (*before, *remarks.of_path(steps, contacts, known))

        return Following(
            engine,
            contacts,
            mu,
            shape,
            chosen,
            start,
            condense=self._seconds,
            bodies=self._bodies,
            known=self._known,
            remarks=said,
            model=Differentiable(
                PathModel(
                    self._contact.matrix,
                    self._fixed,
                    np.shape(np.asarray(self._contacts["gap"])),
                    self._by_component(gap),
                    self._loading.held,
                )
            ),
            held=self._held,
        )

    def _by_component(
        self, gap: ArrayLike | MovingGaps | Callable[[float], Any] | None
    ) -> bool | None:
        """Whether the gaps of steps are by component; None without gaps of steps."""
        if gap is None:
            own = self._loading.gaps
            return None if own is None else self._gaps_by_component
        if isinstance(gap, MovingGaps):
            return False
        return callable(gap) or np.ndim(gap) == 3
