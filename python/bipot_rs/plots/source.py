"""What is drawn of a result: one step at the contacts, by whatever it was given as."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs.check import Array, floats
from bipot_rs.result import Result, Solution

# The places, or the model, where a result does not know them.
Given = Mapping[str, Any] | Any


@dataclass(frozen=True)
class Contacts:
    """One step at the contacts that are drawn.

    Attributes
    ----------
    x : (n_c, d)
    frame : (n_c, d, d) or None
    area : (n_c,) or None
    mu : (n_c,) or (n_c, 2) or None
    reaction, status, gap, slip
        As in a `Step`; ``gap`` is the normal part of the relative displacement.
    units
        Names by ``"length"``, ``"force"``, ``"stress"``.
    """

    x: Array
    frame: Array | None
    area: Array | None
    mu: Array | None
    reaction: Array
    status: NDArray[np.integer[Any]]
    gap: Array
    slip: Array
    units: Mapping[str, str]

    @property
    def traction(self) -> Array:
        """``reaction / area``, or the reaction itself where no areas are known."""
        if self.area is None:
            return self.reaction
        return np.asarray(self.reaction / self.area[:, None])

    @property
    def has_frame(self) -> Array:
        """The frames; a `ValueError` says how to give them."""
        if self.frame is None:
            raise ValueError(
                "the frames of the contacts are not known: give frame= to "
                "ContactProblem, or contacts= here"
            )
        return self.frame

    def vectors(self, tangential: Array) -> Array:
        """Tangential vectors ``(n_c, d - 1)`` in global components, ``(n_c, d)``."""
        found = np.einsum("ck,ckd->cd", tangential, self.has_frame[:, 1:])
        return np.asarray(found, np.float64)


def contacts_of(found: Any, given: Given | None) -> Mapping[str, Any]:
    """What is known of the contacts of a result, or of ``contacts=``."""
    if given is None:
        return found.contacts if isinstance(found, Result) else {}
    if hasattr(given, "contact_dofs"):
        names = {"x": "points", "frame": "frame", "area": "area", "mu": "mu"}
        return {name: getattr(given, there) for name, there in names.items()}
    if not isinstance(given, Mapping):
        raise TypeError(
            f"contacts is a {type(given).__name__}, expected a mapping with x, frame, "
            "area, mu, or the model"
        )
    return given


def units_of(found: Any, units: Mapping[str, str] | None) -> Mapping[str, str]:
    """Names of units: those given, else those that the result knows."""
    if units is None:
        known: Mapping[str, str] = getattr(found, "units", {})
        return known
    if not isinstance(units, Mapping):
        raise TypeError(
            f"units is a {type(units).__name__}, expected a mapping from length, force "
            "and stress to their names"
        )
    return units


def steps_of(found: Any) -> Result:
    """A path with steps, or an error."""
    if not isinstance(found, Result):
        raise TypeError(f"result is a {type(found).__name__}, expected a Result")
    if not len(found):
        raise ValueError(f"result has no steps to draw: {found.message}")
    return found


def one_step(found: Any, step: int) -> Solution:
    """A step of a result, or the solution itself."""
    if isinstance(found, Solution):
        return found
    path = steps_of(found)
    if not -len(path) <= step < len(path):
        raise ValueError(f"step is {step}, expected one of 0 to {len(path) - 1}")
    solution: Solution = path[step]
    return solution


def look(
    found: Any,
    step: int = -1,
    *,
    contacts: Given | None = None,
    where: ArrayLike | None = None,
    units: Mapping[str, str] | None = None,
) -> Contacts:
    """What is drawn of a `Result`, a `Step` or a `Solution`.

    Raises
    ------
    TypeError, ValueError
        What is missing or of a wrong kind or shape, by its name.
    """
    solution = one_step(found, step)
    known = contacts_of(found, contacts)
    n, d = solution.reaction.shape
    if known.get("x") is None:
        raise ValueError(
            "the places of the contacts are not known: give points= to ContactProblem, "
            "or contacts= here"
        )
    mu = known.get("mu")
    both = (n, 2) if mu is not None and np.ndim(mu) == 2 else (n,)
    shapes = {"x": (n, d), "frame": (n, d, d), "area": (n,), "mu": both}
    own = {
        name: None
        if known.get(name) is None
        else floats(f"{name} of contacts", known[name], shape=shape, copy=False)
        for name, shape in shapes.items()
    }
    v = solution.relative_displacement
    fields = {
        "reaction": solution.reaction,
        "status": solution.status,
        "gap": v[:, 0],
        # Of a problem in the reactions alone, v is that of its one step.
        "slip": getattr(solution, "slip", v[:, 1:]),
    }
    chosen = selection(where, n)
    cut = {k: None if a is None else a[chosen] for k, a in (own | fields).items()}
    return Contacts(units=units_of(found, units), **cut)  # type: ignore[arg-type]


def selection(where: ArrayLike | None, contacts: int) -> Any:
    """Which contacts: a mask or numbers, all without."""
    if where is None:
        return slice(None)
    chosen = np.asarray(where)
    if chosen.dtype == np.bool_:
        if chosen.shape != (contacts,):
            raise ValueError(f"where has shape {chosen.shape}, expected ({contacts},)")
        chosen = np.flatnonzero(chosen)
    elif chosen.dtype.kind not in "iu" or chosen.ndim != 1:
        raise TypeError(
            f"where has entries of type {chosen.dtype}, expected a mask or integers"
        )
    if not chosen.size:
        raise ValueError("where leaves no contacts to draw")
    if chosen.min() < 0 or chosen.max() >= contacts:
        raise ValueError(f"where names contacts outside of 0 to {contacts - 1}")
    return chosen
