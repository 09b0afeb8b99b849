"""Compare the estimated discretisation error of scenes with the true one, under refinement.

    python benches/discretisation_error.py

On linear triangles and tetrahedra. The true error is the difference to a mesh that contains
the coarse one, with each cell cut in four (or eight) along each axis. Rows are of the last
load step; each mesh has its own load path. The second table shows the iterations saved by
stopping at the error of the mesh. Writes the two tables of
docs/paper/10-discretisation-error.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tables
from numpy.typing import NDArray

from bipot_rs import scene
from bipot_rs.discretisation import DiscretisationError, Estimator
from bipot_rs.discretisation.stopping import tolerance
from bipot_rs.fem import Body, box

Floats = NDArray[np.float64]

# Scene, settings, pairs of size and of the factor by which the reference is finer.
ROWS: tuple[tuple[str, tuple[str, ...], tuple[tuple[int, int], ...]], ...] = (
    ("cattaneo_mindlin", ("contact.0.mu=0.0",), ((5, 4), (10, 4), (20, 4))),
    ("cattaneo_mindlin", (), ((5, 4), (10, 4), (20, 4))),
    ("pressed_block", (), ((4, 8), (8, 8), (16, 8), (32, 8))),
    ("sheared_cube", ("contact.0.mu=0.0",), ((2, 4), (3, 4), (4, 4), (6, 4))),
    ("sheared_cube", (), ((2, 4), (3, 4), (4, 4), (6, 4))),
)
HEAD = tables.columns(
    "scene | mu | n | unknowns | kind | estimate | true | effectivity | "
    "term/B | contact/B"
)


@dataclass(frozen=True)
class Row:
    """One mesh: relative errors in the energy norm, and the term of either sign."""

    name: str
    mu: float
    n: int
    unknowns: int
    error: DiscretisationError
    true: float
    term: float

    @property
    def effectivity(self) -> float:
        """Estimated error over the true one."""
        return self.error.relative / self.true

    def cells(self) -> list[str]:
        """Cells of the table."""
        return [
            self.name,
            f"{self.mu:g}",
            str(self.n),
            str(self.unknowns),
            self.error.kind,
            f"{self.error.relative:.4f}",
            f"{self.true:.4f}",
            f"{self.effectivity:.2f}",
            f"{self.term / self.error.total:+.4f}",
            f"{self.error.contacts.sum() / self.error.total:.4f}",
        ]


def solved(
    name: str, settings: Sequence[str], bodies: Sequence[Body] | None = None
) -> tuple[scene.Case, Any]:
    """Solve a scene on P1 cells, or on the given meshes."""
    read = scene.read(name, ["mesh.element=P1", *settings])
    case = scene.assemble(read, scene.bodies(read) if bodies is None else bodies)
    return case, case.model.problem().solve(case.load, case.prescribed, tol=1e-12)


def finer(body: Body, cuts: int) -> tuple[Body, list[tuple[Floats, Any]]]:
    """Halve the cells of a box ``cuts`` times; also the steps that `prolonged` takes."""
    steps = []
    kind = "triangle" if body.dim == 2 else "tetrahedron"
    for _ in range(cuts):
        grids = [np.unique(x) for x in body.mesh.p]
        fine = [np.sort(np.concatenate([g, 0.5 * (g[1:] + g[:-1])])) for g in grids]
        mesh = box(fine, kind)
        # A new node is the middle of two coarse ones, on the edge that rises along all axes.
        place = [np.searchsorted(g, x) for g, x in zip(fine, mesh.p, strict=True)]
        shape = tuple(len(g) for g in grids)
        number = np.empty(shape, dtype=int)
        at = tuple(
            np.searchsorted(g, x) for g, x in zip(grids, body.mesh.p, strict=True)
        )
        number[at] = np.arange(body.mesh.p.shape[1])
        low = number[tuple(k // 2 for k in place)]
        high = number[tuple((k + 1) // 2 for k in place)]
        steps.append((low, high))
        body = Body(body.name, mesh, body.material)
    return body, steps


def prolonged(values: Floats, steps: Sequence[tuple[Any, Any]]) -> Floats:
    """Interpolate nodal values ``(nodes, k)`` of a coarse mesh to a fine one."""
    for low, high in steps:
        values = 0.5 * (values[low] + values[high])
    return values


def compare(name: str, settings: Sequence[str], n: int, factor: int) -> Row:
    """Estimate on one mesh, and the error against a mesh ``factor`` times as fine."""
    case, result = solved(name, [*settings, f"mesh.n={n}"])
    error = Estimator(case).error(result, -1)
    model, dim = case.model, case.model.dim
    pairs = [finer(body, int(np.log2(factor))) for body in model.bodies]
    fine, reference = solved(name, [*settings, f"mesh.n={n}"], [b for b, _ in pairs])
    ends = np.append(model.offset, model.n) // dim

    def to_fine(values: Floats) -> Floats:
        parts = [
            prolonged(values[ends[b] : ends[b + 1]], steps)
            for b, (_, steps) in enumerate(pairs)
        ]
        return np.concatenate(parts)

    u = result.displacement[-1]
    difference = reference.displacement[-1] - to_fine(u.reshape(-1, dim)).ravel()
    true = difference @ (fine.model.K @ difference)
    # t̂_n and ‖v̂_t‖ at the contacts of the fine mesh.
    nodal = np.zeros((len(model.nodes), dim))
    where = model.contact_dofs[:, 0] // dim
    nodal[where, 0] = error.traction[:, 0]
    nodal[where, 1:] = result.slip[-1]
    coarse = to_fine(nodal)[fine.model.contact_dofs[:, 0] // dim]
    area = fine.model.area
    pressure = reference.reaction[-1][:, 0] / area
    slip = np.linalg.norm(reference.slip[-1], axis=1)
    more = np.linalg.norm(coarse[:, 1:], axis=1) - slip
    mu = np.array([c.mu for c in model.contacts])[fine.model.group]
    term = float(np.sum(area * mu * (coarse[:, 0] - pressure) * more))
    energy = u @ (model.K @ u)
    return Row(name, float(mu[0]), n, model.n, error, np.sqrt(true / energy), term)


METHODS = ("auto", "gauss_seidel", "nesterov", "uzawa")
STOPS = (
    ("cattaneo_mindlin", 10),
    ("sheared_cube", 6),
    ("two_blocks", 6),
    ("pressed_block", 32),
)
STOP_HEAD = tables.columns(
    "scene | n | method | mesh error | tol | products to find it | products | "
    "products to 1e-10 | error left"
)


def stops(name: str, n: int) -> list[list[str]]:
    """Products with W to a tenth of the error of the mesh, and to 1e-10."""
    case, reference = solved(name, [f"mesh.n={n}"])
    problem, estimator = case.model.problem(), Estimator(case)
    K, exact = case.model.K, reference.displacement
    rows = []
    for method in METHODS:
        enough = tolerance(estimator, problem, method=method)
        options: dict[str, Any] = {"method": method, "max_iterations": 1_000_000}
        short, long = (
            problem.solve(case.load, case.prescribed, tol=tol, **options)
            for tol in (enough.tol, 1e-10)
        )
        left = short.displacement - exact
        size = np.sqrt(np.einsum("si,si->s", exact, (K @ exact.T).T))
        error = np.sqrt(np.einsum("si,si->s", left, (K @ left.T).T)) / size
        rows.append(
            [
                name,
                str(n),
                method,
                f"{enough.discretisation:.3f}",
                f"{enough.tol:.0e}",
                f"{enough.work:.0f}",
                f"{short.work.sum():.0f}",
                f"{long.work.sum():.0f}",
                f"{error.max():.0e}",
            ]
        )
    return rows


def main() -> None:
    """Measure, and write both tables."""
    args = tables.parser(__doc__ or "").parse_args()
    page = Path(__file__).parents[1] / "docs" / "paper" / "10-discretisation-error.md"
    rows = []
    for name, settings, sizes in ROWS:
        for n, factor in sizes:
            rows.append(compare(name, settings, n, factor).cells())
            print(*rows[-1], flush=True)
    if not args.print:
        tables.rewrite(page, "effectivity", tables.table(HEAD, rows))
    saved = [row for name, n in STOPS for row in stops(name, n)]
    for row in saved:
        print(*row)
    if not args.print:
        tables.rewrite(page, "stop rule", tables.table(STOP_HEAD, saved))


if __name__ == "__main__":
    main()
