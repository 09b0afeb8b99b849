"""``README.md`` of a collection: what a file holds, and the rules of comparison."""

from __future__ import annotations

from collections.abc import Sequence

from collection.catalogue import PATHS
from collection.manifest import Row

FILES = """\
## What a file holds

A file is one load step in the HDF5 format of
[FCLIB](https://github.com/FrictionalContactLibrary/fclib): `NAME-0000.hdf5` is the first step
of the path NAME. The slip of earlier steps is part of `q` (or `w`), so that each file is a
complete problem. Components are normal first.

- Local form: `u = W r + V l + q`, `Vᵀ r + s = 0`. `V` are the rigid motions of bodies that
  contact alone holds; without such bodies there is no `V`. `R` is zero.
- Global form, where a dense `W` would be too large: `M v = H r + f`, `u = Hᵀ v + w`.
- `/solution` is the answer from which the path goes on. `u` and `r` are exact zeros where the
  law says so; other numbers are exact but for one rounding, to float64 and to 2⁻⁷⁵ of the largest.
- `/guesses` are the other known answers, if `answers` in `MANIFEST.csv` is larger than 1. Where
  `complete` is `yes`, all combinations of statuses were tried: there are no others.
- Without an answer (`answers` is 0) there is no `/solution`, and the one guess is a proof. Either
  `r = 0` and `u = V l` is a motion inside every dual cone, `u_n > μ |u_t|`, on which the loads do
  work, `s·l > 0`; or `u = 0` and `r` are normal forces with `W r = 0`, `Vᵀ r = 0`, `q·r < 0`.
- Where `determined` is `u`, reactions are not unique: compare `u`.
"""

RULES = """\
## Rules of comparison

1. **Start.** Each file is solved alone, from `r = 0`. A program may use the answer of the step
   before as its start; results then say so, and are not mixed with the others.
2. **Certificate.** A program is judged by its `r` (and `l`) alone. Scale each contact by
   `D = (tr W_ii / d)^(-1/2)`, so that `W → D W D`, `q → D q`, `r → r / D`: the result does not
   depend on units. With `u = W r + V l + q` and `F(r)_i = r_i − proj(r_i − ũ_i)`,
   `ũ = (u_n + μ |u_t|, u_t)`, where `proj` is the projection onto Coulomb's cone,

       η = |F(r)| / max(|r|, |F(0)|),

   or `|Vᵀ r + s| / |s|` in orthonormal columns of `V` if that is larger. A global problem is
   condensed first, which is not counted.
3. **Solved** to a target (1e-4, 1e-8, 1e-12) means η at most the target, or at most the rounding
   error of `W r + q` if that is larger. Any answer of several counts. A file without an answer is
   solved if the program says that there is none; not to converge is not enough.
   A path is solved if all its files are.
4. **Error.** Beside η, give the distance of `u` and `r` to the nearest reference, each relative
   to the largest entry of the reference (of `u`, `q` and `W r` for `u`). η small and the error
   large is a result worth reporting.
5. **Work** is counted in products with `W`, or with its rows: a sweep over all contacts is one
   product. Factorisations count by their floating-point operations divided by those of a product.
   Time is that of the solver on one thread, without reading and condensation.
6. **Limits.** State the limits of time and of work, and the version, parameters and machine.
   Parameters are the same for all files.
7. **Profiles** are those of Dolan and Moré, over paths: the cost of a path is the sum over its
   files, infinite if a file is not solved.
"""


def contents(row: Row) -> str:
    """What one file holds, for its ``description``."""
    if not row.answers:
        return "No answer exists; the guess is the proof."
    if row.answers > 1:
        whole = "all" if row.complete == "yes" else "known"
        return f"{row.answers} {whole} answers: /solution and /guesses."
    return "/solution is the reference answer."


def page(rows: Sequence[Row]) -> str:
    """Text of the page for the files of a folder."""
    paths = dict.fromkeys(row.path for row in rows)
    sizes = f"{min(r.contacts for r in rows):,} to {max(r.contacts for r in rows):,}"
    lines = [
        "# Load paths of quasi-static frictional contact",
        "",
        f"{len(paths)} load paths, {len(rows)} files, {sizes} contacts.",
        "`python -m collection DIR` writes all;",
        "`python -m collection --check DIR` checks every answer without a solver.",
        "`MANIFEST.csv` describes each file.",
        "",
        "| path | family | d | contacts | steps | answers | form | what happens |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in paths:
        rows_of_path = [row for row in rows if row.path == name]
        counts = sorted({row.answers for row in rows_of_path})
        answers = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
        first = rows_of_path[0]
        cells = (
            name,
            first.family,
            first.dim,
            f"{first.contacts:,}",
            len(rows_of_path),
            answers,
            first.form,
            PATHS[name].about,
        )
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines) + "\n\n" + FILES + "\n" + RULES
