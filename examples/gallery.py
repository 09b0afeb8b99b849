"""Draws every picture that the program makes, from the shipped scenes, into a folder.

``python examples/gallery.py [FOLDER]``; the folder is ``gallery`` if none is given. Those
by PyVista are drawn where it is installed.
"""

import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import bipot_rs as bp
from bipot_rs import fem, scene

Made = tuple[scene.Case, bp.Result]


def solved(name: str, *settings: str) -> Made:
    """A shipped scene as arrays, and its result, which knows the units."""
    read = scene.read(name, settings)
    case = scene.assemble(read, scene.bodies(read))
    result = case.model.problem().solve(case.load, case.prescribed)
    result.units = read.units.model_dump()
    return case, result


def middle_line(model: fem.Model) -> Any:
    """Contacts of a cube's bottom that lie on the line along x nearest to its middle."""
    y = model.points[:, 1]
    nearest = y[np.argmin(np.abs(y - y.mean()))]
    return np.isclose(y, nearest, rtol=0, atol=1e-9 * np.ptp(y))


def pictures() -> dict[str, Callable[[], Any]]:
    """Names of the pictures, and what draws each."""
    line, line_path = solved("cattaneo_mindlin")
    block, block_path = solved("pressed_block")
    _, plate_path = solved("raous_plate")
    cube, cube_path = solved("sheared_cube")
    two, two_path = solved("two_blocks")
    # Dragged so far that it slides as a whole, to and fro.
    far = 0.07
    cycle, cycle_path = solved("cyclic_cube", f"support.0.x.value={far}")
    plots = bp.plots
    along = {"along": [1, 0, 0], "where": middle_line(cube.model)}
    drawn: dict[str, Callable[[], Any]] = {
        "tractions": lambda: plots.tractions(line_path),
        "tractions_plate": lambda: plots.tractions(plate_path),
        "tractions_cube": lambda: plots.tractions(cube_path, **along),
        "slip": lambda: plots.slip(line_path),
        "slip_cube": lambda: plots.slip(cube_path),
        "status": lambda: plots.status_map(line_path),
        "status_cube": lambda: plots.status_map(cube_path),
        "pressure_cube": lambda: plots.surface_map(cube_path),
        "shear_cube": lambda: plots.surface_map(cube_path, "shear"),
        "deformed": lambda: plots.deformed(block.model, block_path),
        "deformed_near": lambda: plots.deformed(line.model, line_path, near=0.3),
        "deformed_cube": lambda: plots.deformed(cube.model, cube_path),
        "deformed_two": lambda: plots.deformed(two.model, two_path),
        "surface3d": lambda: plots.surface3d(cube.model, cube_path),
        "surface3d_slip": lambda: plots.surface3d(cube.model, cube_path, "slip"),
        "surface3d_status": lambda: plots.surface3d(two.model, two_path, "status"),
        "resultants": lambda: plots.resultants(cycle_path),
        "status_shares": lambda: plots.status_shares(cycle_path),
        "loop": lambda: plots.force_displacement(
            cycle_path, far * cycle.parameter, name="displacement of the top"
        ),
        "loop_of_contact": lambda: plots.force_displacement(cycle_path),
        "dissipation": lambda: plots.dissipation(cycle_path),
        "convergence": lambda: plots.convergence(cycle_path[0]),
        "convergence_path": lambda: plots.convergence(cycle_path),
        "convergence_two": lambda: plots.convergence(two_path),
    }
    if find_spec("pyvista"):
        for quantity in ("pressure", "slip", "status"):
            drawn[f"pyvista_{quantity}"] = lambda quantity=quantity: plots.surface3d(
                cube.model, cube_path, quantity, backend="pyvista"
            )
    return drawn


def draw(folder: Path) -> list[Path]:
    """Write all pictures into a folder; their names."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, picture in pictures().items():
        path, it = folder / f"{name}.png", picture()
        if hasattr(it, "screenshot"):
            it.screenshot(path)
        else:
            it.figure.savefig(path, dpi=150)
        written.append(path)
    return written


if __name__ == "__main__":
    for path in draw(Path(*sys.argv[1:] or ["gallery"])):
        print(path)
