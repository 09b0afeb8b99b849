"""``bipot info`` of a scene: bodies, contacts, loads and solver."""

from __future__ import annotations

from bipot_rs._lib.messages import count_noun


def summarise(name: str) -> dict[str, object]:
    """Summarise a scene: a file, or a shipped one.

    Returns ``kind``, figures by name, and ``lines`` for a terminal.
    Raises `SceneError`: it cannot be read.
    """
    from bipot_rs.scene.reading import read

    scene = read(name)
    bodies = {
        body: " and ".join(dict.fromkeys(block.materials.values()))
        for body, block in scene.body.items()
    }
    steps = scene.path.count()
    summary: dict[str, object] = {
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
        count_noun(len(entries), kind)
        for kind, entries in (
            ("support", scene.support),
            ("symmetry", scene.symmetry),
            ("spring", scene.spring),
            ("traction", scene.traction),
            ("pressure", scene.pressure),
            ("body force", scene.body_force),
            ("initial strain", scene.strain),
            ("bolt", scene.bolt),
        )
        if entries
    ]
    touching = [
        f"{pair.name + ': ' if pair.name else ''}{pair.on} against "
        f"{pair.against or 'a plane'}, mu {pair.mu}"
        + "".join(
            f", {name} {getattr(pair, name):g}"
            for name in ("cohesion", "dilatancy")
            if getattr(pair, name)
        )
        for pair in scene.contact
    ]
    parameter, solver = scene.path.parameter or "step number", scene.solver
    lines = [
        f"{name}: a scene, {scene.title or 'without a title'}",
        f"  units     {units or 'not named'}",
        "  bodies    " + ", ".join(f"{b} ({m})" for b, m in bodies.items()),
        f"  contacts  {', '.join(touching)}",
        f"  loads     {', '.join(loads) or 'none'}",
        f"  path      {count_noun(steps, 'load step')}, parameter: {parameter}",
        f"  solver    {solver.method}, tol {solver.tol}, engine {solver.engine}",
        f"  next      bipot check {name}, bipot run {name}",
    ]
    return summary | {"lines": lines}
