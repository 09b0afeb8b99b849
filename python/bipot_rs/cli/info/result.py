"""``bipot info`` of a result file: contacts, load steps, engine and residual."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.messages import count_noun
from bipot_rs.cli.info.mesh import box
from bipot_rs.contact.law.status import STATUS_NAMES

# Most load steps that are listed; of a longer path the first and the last are.
_STEPS = 3


def summarise(path: Path) -> dict[str, object]:
    """Summarise a result file.

    Returns ``kind``, figures by name, and ``lines`` for a terminal.
    Raises `OSError` or `ValueError`: there is no file, or it is not a result.
    """
    from bipot_rs.contact.results.saved_result import load
    from bipot_rs.contact.results.tables import BROKEN, make_row
    from bipot_rs.files.export import read_saved

    if not path.exists():
        raise OSError(f"there is no {path}")
    contacts, steps, attributes, _ = read_saved(path)
    result = load(path)
    count = len(result)
    x = contacts.get("x")
    # A problem given as arrays may have no points.
    contacts_n, d = result.shape if count else (0 if x is None else len(x), 0)
    dim = (d or None) if x is None else x.shape[1]
    ranks = int(attributes["ranks"]) if "ranks" in attributes else None
    summary: dict[str, object] = {
        "kind": "result",
        "file": str(path),
        "scene": attributes.get("scene"),
        "complete": bool(attributes.get("complete")),
        "message": attributes.get("message", ""),
        "package": attributes.get("package"),
        "method": attributes.get("method"),
        "tol": attributes.get("tol"),
        "engine": attributes.get("engine"),
        "ranks": ranks,
        "contacts": contacts_n if count or x is not None else None,
        "dim": dim,
        "steps": count,
        # The number of automatic steps is unknown, and other files lack it.
        "planned": int(attributes["planned"]) if "planned" in attributes else None,
    }
    source = summary["scene"] or "a problem given as arrays"
    by = f"method {summary['method'] or '-'}, tol {summary['tol'] or '-'}"
    lines = [
        f"{path}: a result of {source}, {'' if summary['complete'] else 'not '}complete",
        f"  message   {summary['message'] or '-'}",
    ]
    if summary["package"]:
        lines.append(f"  by        bipot_rs {summary['package']}, {by}")
    if summary["engine"]:
        parts = [summary["engine"], attributes.get("preconditioner")]
        if ranks:
            parts.append(count_noun(ranks, "rank"))
        lines.append(f"  engine    {', '.join(str(part) for part in parts if part)}")
    if dim is not None:
        where = f", {box(x)}" if x is not None and len(x) else ""
        lines.append(
            f"  contacts  {count_noun(contacts_n, 'contact')} in {dim} dimensions{where}"
        )
        numbers = [f"{_span(contacts.get('mu'))}; gap {_span(contacts.get('gap'))}"]
        numbers += [
            f"{name} {_span(contacts[name])}"
            for name in ("cohesion", "dilatancy")
            if name in contacts
        ]
        lines.append(f"  friction  {'; '.join(numbers)}")
    if count:
        summary["residual"] = float(result.residual.max())
        kept = result[0].computed.displacement
        summary["displacements"] = None if kept is None else len(kept)
        moved = "no" if kept is None else len(kept)
        whole = summary["planned"] or count
        missing = "" if count == whole else f" of {whole}"
        lines.append(
            f"  steps     {count_noun(count, 'load step')}{missing}, every residual at most "
            f"{summary['residual']:.1e}; {moved} displacements each"
        )
        rows = [
            make_row(k, float(steps[k].get("load", k)), step)
            for k, step in enumerate(result)
        ]
        is_counted = summary["complete"] or summary["planned"] is not None
        reached = "" if is_counted else " reached"
        ends = list(range(count))
        if count > _STEPS:
            ends[1 : 1 - _STEPS] = []
        for before, k in zip([-1, *ends], ends, strict=False):
            row = rows[k]
            if k > before + 1:
                lines.append(f"  ...       {count_noun(k - before - 1, 'load step')}")
            counts = {
                name: row[name] for name in (*STATUS_NAMES, BROKEN) if name in row
            }
            listed = ", ".join(f"{name} {count}" for name, count in counts.items())
            lines.append(
                f"  load step {k + 1} of {whole}{reached}: {listed}, normal force "
                f"{result[k].reaction[:, 0].sum():.5g}"
            )
            summary["last"] = counts
    return summary | {"lines": lines}


def _span(values: ArrayLike | None) -> str:
    if values is None or not np.size(values):
        return "-"
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
