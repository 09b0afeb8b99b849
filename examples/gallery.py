"""Draw all kinds of pictures of the shipped scenes into a folder.

``python examples/gallery.py [FOLDER [NAME...]]`` draws the named pictures, or all, into
FOLDER, which is ``gallery`` by default. The name ``site`` means the pictures of
docs/gallery.md. Pictures by PyVista are drawn only if it is installed.
"""

import sys
from collections.abc import Callable, Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import bipot_rs as bp
from bipot_rs import fem, scene

Made = tuple[scene.Case, bp.Result]

# Displacement at which the whole base slides, to and fro.
FAR = 0.07
SITE = (
    "tractions",
    "slip",
    "status_cube",
    "shear_cube",
    "surface3d_slip",
    "deformed_near",
    "loop",
    "dissipation",
    "status_shares",
    "convergence_two",
)


@cache
def solved(name: str, *settings: str) -> Made:
    """A shipped scene as arrays, and its result with units."""
    read = scene.read(name, settings)
    case = scene.assemble(read, scene.bodies(read))
    result = case.model.problem().solve(case.load, case.prescribed)
    result.units = read.units.model_dump()
    return case, result


def line() -> Made:
    """A cylinder on a block."""
    return solved("cattaneo_mindlin")


def cube() -> Made:
    """A cube that is pressed and sheared."""
    return solved("sheared_cube")


def two() -> Made:
    """A block on a block."""
    return solved("two_blocks")


def cycle() -> Made:
    """A cube that is dragged to and fro."""
    return solved("cyclic_cube", f"support.0.x.value={FAR}")


def middle_line(model: fem.Assembly) -> Any:
    """Mask of the contacts on the line along x closest to the middle of the base."""
    y = model.points[:, 1]
    nearest = y[np.argmin(np.abs(y - y.mean()))]
    return np.isclose(y, nearest, rtol=0, atol=1e-9 * np.ptp(y))


def tractions_cube() -> Any:
    """Tractions along the middle of the base of the cube."""
    case, result = cube()
    where = middle_line(case.model)
    return bp.plots.tractions(result, along=[1, 0, 0], on=where)


def loop() -> Any:
    """Force over the displacement of the top of the cube."""
    case, result = cycle()
    name = "displacement of the top"
    return bp.plots.force_displacement(result, FAR * case.parameter, name=name)


def with_mesh(draw: Callable[..., Any], made: Made, *names: str, **more: Any) -> Any:
    """A picture that needs the mesh as well as the result."""
    case, result = made
    return draw(case.model, result, *names, **more)


def pictures() -> dict[str, Callable[[], Any]]:
    """Name and drawing function of each picture. Scenes are solved when drawn."""
    plots = bp.plots
    body, space = plots.deformed, plots.surface3d
    drawn: dict[str, Callable[[], Any]] = {
        "tractions": lambda: plots.tractions(line()[1]),
        "tractions_plate": lambda: plots.tractions(solved("raous_plate")[1]),
        "tractions_cube": tractions_cube,
        "slip": lambda: plots.slip(line()[1]),
        "slip_cube": lambda: plots.slip(cube()[1]),
        "status": lambda: plots.status_map(line()[1]),
        "status_cube": lambda: plots.status_map(cube()[1]),
        "pressure_cube": lambda: plots.surface_map(cube()[1]),
        "shear_cube": lambda: plots.surface_map(cube()[1], "shear"),
        "deformed": lambda: with_mesh(body, solved("pressed_block")),
        "deformed_near": lambda: with_mesh(body, line(), near=0.3),
        "deformed_cube": lambda: with_mesh(body, cube()),
        "deformed_two": lambda: with_mesh(body, two()),
        "surface3d": lambda: with_mesh(space, cube()),
        "surface3d_slip": lambda: with_mesh(space, cube(), "slip"),
        "surface3d_status": lambda: with_mesh(space, two(), "status"),
        "resultants": lambda: plots.resultants(cycle()[1]),
        "status_shares": lambda: plots.status_shares(cycle()[1]),
        "loop": loop,
        "loop_of_contact": lambda: plots.force_displacement(cycle()[1]),
        "dissipation": lambda: plots.dissipation(cycle()[1]),
        "convergence": lambda: plots.convergence(cycle()[1][0]),
        "convergence_path": lambda: plots.convergence(cycle()[1]),
        "convergence_two": lambda: plots.convergence(two()[1]),
    }
    if find_spec("pyvista"):
        for quantity in ("pressure", "slip", "status"):
            drawn[f"pyvista_{quantity}"] = lambda quantity=quantity: with_mesh(
                space, cube(), quantity, backend="pyvista"
            )
    return drawn


def draw(
    folder: Path, names: Iterable[str] | None = None, dpi: int = 150
) -> list[Path]:
    """Draw the named pictures, or all, into a folder; return their files."""
    known = pictures()
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name in known if names is None else names:
        path, it = folder / f"{name}.png", known[name]()
        if hasattr(it, "screenshot"):
            it.screenshot(path)
        else:
            it.figure.savefig(path, dpi=dpi)
        written.append(path)
    return written


def for_pages(folder: Path) -> list[Path]:
    """Draw the pictures of docs/gallery.md with few colours, to keep the files small."""
    from PIL import Image  # a dependency of matplotlib

    written = draw(folder, SITE, dpi=120)
    for path in written:
        with Image.open(path) as read:
            few = read.convert("RGB").quantize(256, kmeans=3)
            few.save(path, optimize=True)
    return written


if __name__ == "__main__":
    folder, *chosen = sys.argv[1:] or ["gallery"]
    there = Path(folder)
    of_site = chosen == ["site"]
    for path in for_pages(there) if of_site else draw(there, chosen or None):
        print(path)
