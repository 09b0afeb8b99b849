"""Data to draw: one step at the contacts, from a result, a step or a solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bipot_rs._lib.messages import make_type_error, meant
from bipot_rs._lib.types import Floats, Integers, Ints, OpenRecord, Record
from bipot_rs._lib.validation import floats
from bipot_rs.contact.law.frames import find_step_frames
from bipot_rs.contact.results.result import Result
from bipot_rs.contact.results.solution import Solution, Step
from bipot_rs.files.fields import unit
from bipot_rs.plots import triangles
from bipot_rs.scene.units import find_inconsistency

if TYPE_CHECKING:
    from bipot_rs.fem.assembly.assembly import Assembly
    from bipot_rs.scene.builder import Model
    from bipot_rs.scene.case import Case

# The argument ``contacts``: a mapping with points and frames, or the model.
ContactsArgument = Mapping[str, object] | object
# Arrays ``x``, ``frame``, ``area``, ``mu``, ``facets``, ``surface``, and the names of
# surfaces, which a user may give: they are checked where they are read.
ContactData: TypeAlias = Record
# What chooses contacts: all, or numbers.
Chosen = slice | NDArray[np.intp]


@dataclass(frozen=True)
class DrawnContacts:
    """One step at the contacts that are drawn."""

    x: Floats  # (n_c, d)
    frame: Floats | None  # (n_c, d, d) or None
    area: Floats | None  # (n_c,) or None
    mu: Floats | None  # (n_c,) or (n_c, 2) or None
    # reaction, status, gap, slip: as in a `Step`; `gap` is the normal part of the relative
    # displacement.
    reaction: Floats
    status: Integers
    gap: Floats
    slip: Floats
    units: Mapping[str, str]  # names by `"length"`, `"force"`, `"stress"`
    wear: Floats | None = None  # (n_c,) or None: depth worn off
    # (n_c,) or None: cohesion of unbroken contacts, zero at broken ones.
    cohesion: Floats | None = None
    # (n_c,) or None: number of the surface of each contact, if known.
    surface: Integers | None = None
    names: Sequence[str] = ()  # names `"body.surface"` of the surfaces by number
    said: str = ""  # `"load step 3 of 8"`, or "" if there is one step only
    # (m, k) or None: facets of a surface in 3D, as `triangles.check_facets`.
    facets: Ints | None = None
    # Triangles beside the facets: corners (t, 3, 3), their contacts and weights (t, 3, 4).
    patches: tuple[Floats, Ints, Floats] | None = None
    revolved: bool = False  # whether x is (r, z), of bodies of revolution

    @property
    def surfaces(self) -> list[tuple[str, NDArray[np.intp]]]:
        """Name and contacts of each surface; ("", all contacts) if surfaces are unknown."""
        if self.surface is None or not len(self.surface):
            return [("", np.arange(len(self.x)))]
        return [
            (self.names[k], np.flatnonzero(self.surface == k))
            for k in np.unique(self.surface)
        ]

    def part(self, chosen: Chosen) -> DrawnContacts:
        """Some of the contacts, chosen by a mask or by numbers."""
        arrays = ("x", "frame", "area", "mu", "reaction", "status", "gap", "slip")
        arrays_of_contacts = {
            name: getattr(self, name)
            for name in (*arrays, "wear", "cohesion", "surface")
        }
        cut: OpenRecord = {
            name: None if array is None else array[chosen]
            for name, array in arrays_of_contacts.items()
        }
        facets = self.facets
        if facets is not None:
            facets = triangles.part(facets, numbers(chosen, len(self.x)), len(self.x))
        patches = self.patches
        if patches is not None:
            number = np.full(len(self.x), -1)
            number[chosen] = np.arange(len(cut["x"]))
            x, of, weight = patches
            kept = (number[of] >= 0).all(axis=(1, 2))
            patches = x[kept], number[of[kept]], weight[kept]
        return replace(self, **cut, facets=facets, patches=patches)

    def spread(
        self, values: Floats, *, nearest: bool = False
    ) -> tuple[Floats, Floats, Ints]:
        """Places and values of the contacts and the corners of patches; these triangles.

        A corner has the mean of some contacts, or the value of the ``nearest`` of them.
        """
        if self.patches is None:
            return self.x, values, np.empty((0, 3), np.int64)
        x, of, weight = self.patches
        if nearest:
            weight = np.eye(weight.shape[2])[weight.argmax(axis=2)]
        at = np.sum(weight * values[of], axis=2).ravel()
        places = np.concatenate([self.x, x.reshape(-1, 3)])
        corners = np.arange(len(self.x), len(places)).reshape(-1, 3)
        return places, np.concatenate([values, at]), corners

    @property
    def isolated(self) -> NDArray[np.intp]:
        """Contacts on no facet; all if facets are unknown."""
        if self.facets is None:
            return np.arange(len(self.x))
        alone = triangles.alone(self.facets, len(self.x))
        return alone if self.patches is None else np.setdiff1d(alone, self.patches[1])

    @property
    def traction(self) -> Floats:
        """``reaction / area``, or the reaction if areas are unknown."""
        if self.area is None:
            return self.reaction
        return np.asarray(self.reaction / self.area[:, None])

    @property
    def traction_unit(self) -> str | None:
        """Unit of `traction`."""
        return unit("force" if self.area is None else "stress", self.units)

    @property
    def has_frame(self) -> Floats:
        """The frames; a `ValueError` if they are unknown."""
        if self.frame is None:
            raise ValueError(
                "the frames of the contacts are not known: pass frame= to "
                "ContactProblem, or contacts= to this function"
            )
        return self.frame

    def vectors(self, tangential: Floats) -> Floats:
        """Tangential vectors ``(n_c, d - 1)`` in global components, ``(n_c, d)``."""
        vectors = np.einsum("ck,ckd->cd", tangential, self.has_frame[:, 1:])
        return np.asarray(vectors, np.float64)


def contacts_of(result: object, given: ContactsArgument | None) -> ContactData:
    """Data of the contacts: those of ``contacts=``, else those of the result."""
    if given is None:
        return result.contacts if isinstance(result, Result) else {}
    if isinstance(given, Mapping):
        return given
    model, _ = model_of(given)
    if model is None and hasattr(given, "facets"):
        # The `Pairs` of surfaces.
        stored = result.contacts if isinstance(result, Result) else {}
        names = {"x": "points", "frame": "frame", "area": "area", "facets": "facets"}
        arrays = {name: getattr(given, there) for name, there in names.items()}
        return {"mu": stored.get("mu"), **arrays}
    if model is None:
        expected = "a mapping with x, frame, area, mu, the Pairs, or the model"
        raise make_type_error("contacts", given, expected)
    from bipot_rs.fem.contact_surface import surface_labels

    names = {"x": "points", "frame": "frame", "area": "area", "mu": "mu"}
    stored = {name: getattr(model, there) for name, there in names.items()}
    return stored | surface_labels(model)


def model_of(given: object) -> tuple[Assembly | None, Case | None]:
    """The `fem.Assembly` and, if there is one, the `Case` of an argument.

    The argument is a `fem.Assembly`, a `Case`, a `Model` (which is assembled) or a
    `ModelResult`; (None, None) for anything else.
    """
    if hasattr(given, "contact_dofs"):
        return cast("Assembly", given), None
    case: Case | None = getattr(given, "case", None)
    if case is None and hasattr(given, "parameter") and hasattr(given, "model"):
        case = cast("Case", given)
    if case is None and hasattr(type(given), "assemble"):
        case = cast("Model", given).assemble()
    return (None, None) if case is None else (case.model, case)


def require_model(given: object) -> tuple[Assembly, Case | None]:
    """As `model_of`; a `TypeError` if there is no model."""
    model, case = model_of(given)
    if model is None:
        raise make_type_error("model", given, "a Model, a Case or a ModelResult")
    return model, case


def units_of(result: object, units: Mapping[str, str] | None) -> Mapping[str, str]:
    """Names of units: those given, else those of the result."""
    names: Mapping[str, str] = getattr(result, "units", {}) if units is None else units
    if not isinstance(names, Mapping):
        raise make_type_error(
            "units", names, "a mapping from length, force and stress to their names"
        )
    if mistake := find_inconsistency(names):
        raise ValueError(f"units: {mistake}")
    return names


def steps_of(result: object) -> Result:
    """The `Result` itself; an error if it is something else, or has no steps."""
    if not isinstance(result, Result):
        raise make_type_error("result", result, "a Result")
    if not len(result):
        raise ValueError(f"result has no steps to draw: {result.message}")
    return result


def one_step(result: object, step: int) -> Solution:
    """A step of a result, or the solution itself."""
    if isinstance(result, Solution):
        return result
    path = steps_of(result)
    if not -len(path) <= step < len(path):
        raise ValueError(f"step is {step}, expected 0 to {len(path) - 1}")
    solution: Solution = path[step]
    return solution


def number_of(result: object, step: int) -> tuple[int, int] | None:
    """Index of a step of a `Result` on the whole path, and its length; None for a step."""
    if not isinstance(result, Result):
        return None
    count = result.first_step + len(result)
    return (step if step < 0 else result.first_step + step) % count, count


def describe_step_of(result: object, step: int) -> str:
    """``load step 3 of 8``; empty for a path of one step."""
    number = number_of(result, step)
    if number is None or number[1] == 1:
        return ""
    return f"load step {number[0] + 1} of {number[1]}"


def look(
    result: object,
    step: int = -1,
    *,
    contacts: ContactsArgument | None = None,
    on: ArrayLike | None = None,
    units: Mapping[str, str] | None = None,
) -> DrawnContacts:
    """Data to draw of a `Result`, a `Step` or a `Solution`.

    Raises `TypeError` or `ValueError`: an argument is missing, or of a wrong type or shape; the
    message names it.
    """
    solution = one_step(result, step)
    arrays_of_contacts = contacts_of(result, contacts)
    n, d = solution.reaction.shape
    if arrays_of_contacts.get("x") is None:
        way = "contacts= to this function"
        if isinstance(result, Result):
            way = f"points= to ContactProblem, or {way}"
        elif isinstance(result, Step):
            way = f"the whole result with step=, or {way}"
        raise ValueError(f"the places of the contacts are not known: pass {way}")
    mu = arrays_of_contacts.get("mu")
    both = (n, 2) if mu is not None and np.ndim(mu) == 2 else (n,)
    shapes = {"x": (n, d), "frame": (n, d, d), "area": (n,), "mu": both}
    shapes["cohesion"] = (n,)
    optional = {
        name: None
        if arrays_of_contacts.get(name) is None
        else floats(
            f"{name} of contacts", arrays_of_contacts[name], shape=shape, copy=False
        )
        for name, shape in shapes.items()
    }
    if optional["frame"] is not None:
        optional["frame"] = find_step_frames(solution, optional["frame"])
    broken = getattr(solution, "broken", None)
    if optional["cohesion"] is not None and broken is not None:
        optional["cohesion"] = np.where(broken, 0.0, optional["cohesion"])
    v = solution.relative_displacement
    fields = {
        "reaction": solution.reaction,
        "status": solution.status,
        "gap": v[:, 0],
        # In a problem in the reactions only, v is the displacement of its one step.
        "slip": getattr(solution, "slip", v[:, 1:]),
        "wear": getattr(solution, "wear", None),
    }
    patches = None
    if arrays_of_contacts.get("facets") is not None and "patch_x" in arrays_of_contacts:
        patches = tuple(arrays_of_contacts[f"patch_{k}"] for k in ("x", "of", "weight"))
    seen = DrawnContacts(
        units=units_of(result, units),
        surface=surface_of(arrays_of_contacts, n),
        names=names_of(arrays_of_contacts),
        said=describe_step_of(result, step),
        revolved=arrays_of_contacts.get("revolved") is not None,
        facets=facets_of(arrays_of_contacts, n) if d == 3 else None,
        patches=patches,
        **optional,  # type: ignore[arg-type]
        **fields,  # type: ignore[arg-type]
    )
    return seen if on is None else seen.part(selection(on, n, arrays_of_contacts))


def surface_of(data: ContactData, contacts: int) -> Ints | None:
    """Number of the surface of each contact, ``(n_c,)``; None if unknown."""
    surfaces = data.get("surface")
    if surfaces is None:
        return None
    numbers_of_surfaces = np.asarray(surfaces)
    if (
        numbers_of_surfaces.dtype.kind not in "iu"
        or numbers_of_surfaces.shape != (contacts,)
        or (numbers_of_surfaces < 0).any()
    ):
        raise ValueError(
            f"surface of contacts has entries of type {numbers_of_surfaces.dtype} and shape "
            f"{numbers_of_surfaces.shape}, expected ({contacts},) integers from 0"
        )
    return numbers_of_surfaces.astype(np.int64)


def facets_of(data: ContactData, contacts: int) -> Ints | None:
    """Facets of the contacts, ``(m, k)``; None if unknown."""
    facets = data.get("facets")
    return None if facets is None else triangles.check_facets(facets, contacts)


def numbers(chosen: Chosen, contacts: int) -> NDArray[np.intp]:
    """Numbers of the contacts that a slice, a mask or numbers choose."""
    chosen_contacts: NDArray[np.intp] = np.arange(contacts)[chosen]
    return chosen_contacts


def names_of(data: ContactData) -> list[str]:
    """Names of the surfaces by number; [] if surfaces are unknown."""
    surface = data.get("surface")
    if surface is None or not np.size(surface):
        return []
    names, count = data.get("surface_names"), int(np.max(surface)) + 1
    if names is None or len(names) < count:
        return [f"surface {k}" for k in range(count)]
    return [str(name) for name in names]


def selection(
    on: ArrayLike | str | None,
    contacts: int,
    known: ContactData = MappingProxyType({}),
) -> Chosen:
    """Contacts chosen by a mask, by numbers or by the name of a surface; default all."""
    if on is None:
        return slice(None)
    if isinstance(on, str):
        return _of_surface(on, known)
    chosen = np.asarray(on)
    if chosen.dtype == np.bool_:
        if chosen.shape != (contacts,):
            raise ValueError(f"on has shape {chosen.shape}, expected ({contacts},)")
        chosen = np.flatnonzero(chosen)
    elif chosen.dtype.kind not in "iu" or chosen.ndim != 1:
        raise TypeError(
            f"on has entries of type {chosen.dtype}, expected a mask or integers"
        )
    if not chosen.size:
        raise ValueError("on selects no contacts, expected one or more")
    if chosen.min() < 0 or chosen.max() >= contacts:
        raise ValueError(f"on is out of range, expected 0 to {contacts - 1}")
    return chosen


def _of_surface(name: str, data: ContactData) -> NDArray[np.intp]:
    """Numbers of the contacts on a surface, or on ``name 0``, ``name 1``, …."""
    names = names_of(data)
    if not names:
        raise ValueError(
            f"on is {name!r}, but the surfaces of the contacts are not known: pass the "
            "model as contacts=, or a mask as on="
        )
    wanted = {name, *(f"{name} {k}" for k in range(len(names)))}
    mine = [k for k, surface_name in enumerate(names) if surface_name in wanted]
    chosen = np.flatnonzero(np.isin(data["surface"], mine))
    if not chosen.size:
        raise ValueError(
            f"there is no contact on {name!r}, expected one of "
            f"{', '.join(names)}{meant(name, names)}"
        )
    return chosen
