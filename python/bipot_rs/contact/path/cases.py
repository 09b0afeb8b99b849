"""Several load paths of one problem, in parallel."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

import bipot_rs._core as _core
from bipot_rs._lib.messages import make_type_error
from bipot_rs._lib.types import Record
from bipot_rs.contact.errors import with_message
from bipot_rs.contact.path.direct import DirectPath
from bipot_rs.contact.path.load_path import PathSolver, has_frames
from bipot_rs.contact.path.load_steps import Loading, Totals
from bipot_rs.contact.path.moving_gaps import list_components
from bipot_rs.contact.results.result import Result

Case = Record
T = TypeVar("T")
_KEYS = ("load", "prescribed", "gap", "mu", "start")


def solve_cases(
    cases: Iterable[Case],
    loading: Loading,
    begin_paths: Callable[[int], Callable[[Case], PathSolver]],
    settings: _core.Settings,
) -> list[Result]:
    """Solve the load path of each case; see `ContactProblem.solve_many`.

    ``cases``: for each path a mapping with any of the keys ``load``, ``prescribed``, ``gap``,
    ``mu`` and ``start``.
    ``loading``: checks the loads.
    ``begin_paths``: chooses the engine for a number of load steps, and returns the function
    that begins the path of a case.
    """
    if not isinstance(cases, Iterable):
        raise TypeError(
            f"cases is a {type(cases).__name__}, expected a list of mappings, one for "
            "each path"
        )
    cases = list(cases)
    for k, case in enumerate(cases):
        _check_case(k, case)

    def totals_of(case: Case) -> list[Totals]:
        load, prescribed, gap, start = (
            case.get(key) for key in ("load", "prescribed", "gap", "start")
        )
        return loading.list_totals(load, prescribed, gap, start)

    totals = _for_each(cases, totals_of)
    paths = _for_each(cases, begin_paths(sum(map(len, totals))))
    parts = zip(paths, totals, strict=True)
    direct = [path.path.core for path in paths if isinstance(path.path, DirectPath)]
    changing = any(path.has_memory for path in paths)
    if len(direct) < len(paths) or changing or any(map(has_frames, paths, totals)):
        # Each linear system uses all threads; frames or laws change from step to step.
        return [path.solve_all(steps) for path, steps in parts]
    plain = [
        [(f, u, None if gap is None else list_components(gap)) for f, u, gap in steps]
        for steps in totals
    ]
    answers = _core.follow(direct, plain, settings)
    return [
        path.take_all(steps, answer)
        for (path, steps), answer in zip(parts, answers, strict=True)
    ]


def _for_each(cases: list[Case], make: Callable[[Case], T]) -> list[T]:
    """``make`` of each case; an error names the case."""
    made = []
    for k, case in enumerate(cases):
        try:
            made.append(make(case))
        except (TypeError, ValueError) as error:
            raise with_message(error, f"case {k}: {error}") from None
    return made


def _check_case(k: int, case: object) -> None:
    expected = f"{', '.join(_KEYS[:-1])} or {_KEYS[-1]}"
    if not isinstance(case, Mapping):
        raise make_type_error(f"case {k}", case, f"a mapping with {expected}")
    unknown = sorted(set(map(str, case)) - set(_KEYS))
    if unknown:
        raise TypeError(f"case {k} has {unknown[0]!r}, expected {expected}")
