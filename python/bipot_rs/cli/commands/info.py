"""``bipot info``: summarise a file or a folder in some ten lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bipot_rs._lib.byte_order import MARK, unmarked, without
from bipot_rs._lib.messages import counted, printable
from bipot_rs.cli.commands import info_fields
from bipot_rs.cli.commands.info_mesh import SUFFIXES, box, mesh
from bipot_rs.cli.commands.info_sweep import sweep
from bipot_rs.cli.matrix_files import MARKET, market_refuses
from bipot_rs.cli.output_folder import RESULT, SWEEP
from bipot_rs.contact.law.status import STATUS_NAMES

# Most load steps that are listed; of a longer path the first and the last are.
_STEPS = 3


def info(name: str) -> dict[str, Any]:
    """Summarise a result, a file for ParaView, a sweep, a problem, a mesh or a scene.

    Parameters
    ----------
    name
        A file, the folder of a run or a sweep, a folder of such folders, or a shipped scene.

    Returns
    -------
    dict
        ``kind``, figures by name, and ``lines`` for a terminal.

    Raises
    ------
    OSError, ValueError
        The file cannot be read, or is of another kind.
    """
    path = Path(name)
    if path.is_dir():
        if (path / RESULT).exists():
            return _result(path / RESULT)
        return sweep(path / SWEEP) if (path / SWEEP).exists() else _folder(path)
    if path.name == SWEEP:
        return sweep(path)
    if path.suffix.lower() in info_fields.SUFFIXES:
        return info_fields.fields(path)
    if path.suffix.lower() in SUFFIXES:
        return mesh(path)
    if path.suffix.lower() == ".mtx":
        return _matrix(path)
    if path.suffix not in (".h5", ".hdf5", ".hdf"):
        if path.is_file() and path.suffix not in ("", ".toml"):
            raise ValueError(
                f"{name} is a file {path.suffix}, expected a result (.h5), a sweep "
                f"({SWEEP}), a series for ParaView ({', '.join(info_fields.SUFFIXES)}), a "
                f"mesh ({', '.join(SUFFIXES)}), a matrix (.mtx), a problem (.hdf5) or a "
                "scene (.toml)"
            )
        return _scene(name)
    if not path.exists():
        raise OSError(f"there is no {path}")
    try:
        return _result(path)
    except ValueError as error:
        try:
            return _problem(path)
        except (OSError, ValueError):
            raise error from None


def _folder(path: Path) -> dict[str, Any]:
    """Summarise a folder of runs and sweeps, such as ``out``."""
    kinds = {RESULT: "run", SWEEP: "sweep"}
    inside = sorted(one for one in path.iterdir() if one.is_dir())
    found = {
        str(one): kind
        for one in inside
        for file, kind in kinds.items()
        if (one / file).exists()
    }
    if not found:
        raise ValueError(
            f"{path} is a folder without {RESULT} or {SWEEP}, and so are the folders in it"
        )
    many = [
        counted(list(found.values()).count(kind), kind)
        for kind in kinds.values()
        if kind in found.values()
    ]
    lines = [f"{path}: a folder of {' and '.join(many)}"]
    lines += [f"  {kind:<9} bipot info {printable(one)}" for one, kind in found.items()]
    return {"kind": "folder", "file": str(path), "holds": found, "lines": lines}


def _result(path: Path) -> dict[str, Any]:
    from bipot_rs.contact.results.saved_result import load
    from bipot_rs.contact.results.tables import row
    from bipot_rs.files.export import read_result

    contacts, steps, attributes = read_result(path)
    result = load(path)
    count = len(result)
    x = contacts.get("x")
    # A problem given as arrays may have no points.
    contacts_n, d = result.shape if count else (0 if x is None else len(x), 0)
    dim = (d or None) if x is None else x.shape[1]
    found: dict[str, Any] = {
        "kind": "result",
        "file": str(path),
        "scene": attributes.get("scene"),
        "complete": bool(attributes.get("complete")),
        "message": attributes.get("message", ""),
        "package": attributes.get("package"),
        "method": attributes.get("method"),
        "tol": attributes.get("tol"),
        "engine": attributes.get("engine"),
        "ranks": int(attributes["ranks"]) if "ranks" in attributes else None,
        "contacts": contacts_n if count or x is not None else None,
        "dim": dim,
        "steps": count,
        # The number of automatic steps is unknown, and other files lack it.
        "planned": int(attributes["planned"]) if "planned" in attributes else None,
    }
    source = found["scene"] or "a problem given as arrays"
    by = f"method {found['method'] or '-'}, tol {found['tol'] or '-'}"
    lines = [
        f"{path}: a result of {source}, {'' if found['complete'] else 'not '}complete",
        f"  message   {found['message'] or '-'}",
    ]
    if found["package"]:
        lines.append(f"  by        bipot_rs {found['package']}, {by}")
    if found["engine"]:
        parts = [found["engine"], attributes.get("preconditioner")]
        if found["ranks"]:
            parts.append(counted(found["ranks"], "rank"))
        lines.append(f"  engine    {', '.join(str(part) for part in parts if part)}")
    if dim is not None:
        where = f", {box(x)}" if x is not None and len(x) else ""
        lines.append(
            f"  contacts  {counted(contacts_n, 'contact')} in {dim} dimensions{where}"
        )
        lines.append(
            f"  friction  {_span(contacts.get('mu'))}; gap {_span(contacts.get('gap'))}"
        )
    if count:
        found["residual"] = float(result.residual.max())
        kept = result[0].computed.displacement
        found["displacements"] = None if kept is None else len(kept)
        moved = "no" if kept is None else len(kept)
        whole = found["planned"] or count
        missing = "" if count == whole else f" of {whole}"
        lines.append(
            f"  steps     {counted(count, 'load step')}{missing}, every residual at most "
            f"{found['residual']:.1e}; {moved} displacements each"
        )
        rows = [
            row(k, float(steps[k].get("load", k)), step)
            for k, step in enumerate(result)
        ]
        known = found["complete"] or found["planned"] is not None
        reached = "" if known else " reached"
        ends = list(range(count))
        if count > _STEPS:
            ends[1 : 1 - _STEPS] = []
        for before, k in zip([-1, *ends], ends, strict=False):
            one = rows[k]
            if k > before + 1:
                lines.append(f"  ...       {counted(k - before - 1, 'load step')}")
            lines.append(
                f"  load step {k + 1} of {whole}{reached}: open {one['open']}, slip "
                f"{one['slip']}, stick {one['stick']}, normal force "
                f"{result[k].reaction[:, 0].sum():.5g}"
            )
        last = rows[-1]
        found["last"] = {name: last[name] for name in STATUS_NAMES}
    return found | {"lines": lines}


def _matrix(path: Path) -> dict[str, Any]:
    """Summarise the header of a Matrix Market file; its entries are not read."""
    from scipy.io import mminfo

    name = printable(str(path))
    following = f"  next      bipot solve --stiffness {name} --contacts contacts.csv"
    found: dict[str, Any] = {"kind": "matrix", "file": str(path)}
    if not path.is_file():
        raise OSError(f"there is no {path}")
    with path.open("rb") as file:
        if (
            not without(file.read(len(MARK) + len(MARKET)))
            .lower()
            .startswith(MARKET.lower().encode())
        ):
            kind = "no Matrix Market file; perhaps a matrix as Abaqus writes it"
            return found | {"lines": [f"{name}: {kind}", following]}
    try:
        with unmarked(path) as source:
            rows, columns, entries, form, field, symmetry = mminfo(source)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{path} is not a valid Matrix Market file: {error}") from None
    found |= {
        "shape": [int(rows), int(columns)],
        "entries": int(entries),
        "symmetric": symmetry == "symmetric",
    }
    many = f"{counted(int(entries), 'entry')}, " if form == "coordinate" else ""
    lines = [
        f"{name}: a Matrix Market file, {rows} × {columns}",
        f"  holds     {many}{form}, {field}, {symmetry}",
    ]
    if rows == columns and market_refuses(field, symmetry) is None:
        lines.append(following)
    return found | {"lines": lines}


def _span(values: Any) -> str:
    if values is None or not np.size(values):
        return "-"
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _problem(path: Path) -> dict[str, Any]:
    from bipot_rs.contact.global_problem import GlobalProblem
    from bipot_rs.fclib import read

    problem = read(path)
    kind, offset = (
        ("global", problem.w)
        if isinstance(problem, GlobalProblem)
        else ("local", problem.q)
    )
    contacts, dim = offset.shape
    found = {
        "kind": "fclib",
        "file": str(path),
        "form": kind,
        "contacts": contacts,
        "dim": dim,
    }
    many = f"{counted(contacts, 'contact')} in {dim} dimensions"
    lines = [
        f"{path}: an FCLIB problem, {kind} form, {many}",
        f"  friction  {_span(problem.mu)}",
        f"  solve it  bipot fclib {printable(str(path))}",
    ]
    return found | {"lines": lines}


def _scene(name: str) -> dict[str, Any]:
    from bipot_rs.scene.reading import read

    scene = read(name)
    bodies = {
        body: " and ".join(dict.fromkeys(block.materials.values()))
        for body, block in scene.body.items()
    }
    steps = scene.path.count()
    found: dict[str, Any] = {
        "kind": "scene",
        "scene": name,
        "title": scene.title,
        "bodies": list(bodies),
        "contacts": [contact.on for contact in scene.contact],
        "steps": steps,
        "method": scene.solver.method,
        "engine": scene.solver.engine,
        "tol": scene.solver.tol,
    }
    units = ", ".join(
        f"{quantity} in {unit}"
        for quantity, unit in scene.units.model_dump().items()
        if unit
    )
    loads = [
        counted(len(entries), kind)
        for kind, entries in (
            ("support", scene.support),
            ("symmetry", scene.symmetry),
            ("spring", scene.spring),
            ("traction", scene.traction),
            ("pressure", scene.pressure),
            ("body force", scene.body_force),
            ("initial strain", scene.strain),
        )
        if entries
    ]
    touching = [
        f"{one.on} against {one.against or 'a plane'}, mu {one.mu}"
        for one in scene.contact
    ]
    parameter, solver = scene.path.parameter or "step number", scene.solver
    lines = [
        f"{name}: a scene, {scene.title or 'without a title'}",
        f"  units     {units or 'not named'}",
        "  bodies    " + ", ".join(f"{b} ({m})" for b, m in bodies.items()),
        f"  contacts  {', '.join(touching)}",
        f"  loads     {', '.join(loads) or 'none'}",
        f"  path      {counted(steps, 'load step')}, parameter: {parameter}",
        f"  solver    {solver.method}, tol {solver.tol}, engine {solver.engine}",
        f"  next      bipot check {name}, bipot run {name}",
    ]
    return found | {"lines": lines}
