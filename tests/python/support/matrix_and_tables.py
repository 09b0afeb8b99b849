"""Files of a stiffness and its tables, as another program writes them."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse
from scipy.io import mmwrite

import bipot_rs as bp

MODELS = {
    "block": bp.Model.from_toml("pressed_block").with_(**{"mesh.n": 4}),
    "blocks": bp.Model.from_toml("two_blocks").with_(**{"mesh.n": 2}),
}


# Labels as other programs give them: not sorted, with numbers missing.
AXES = "xyz"


def labels(count: int) -> Any:
    return 10 + 3 * np.random.default_rng(1).permutation(count)


def of_dofs(folder: Path, K: Any, contacts: str, load: str = "") -> list[str]:
    """The files of a small problem, of degrees of freedom alone, and their command."""
    mmwrite(folder / "K.mtx", sparse.coo_matrix(K), symmetry="symmetric", precision=17)
    (folder / "contacts.csv").write_text(contacts)
    command = ["solve", "--stiffness", "K.mtx", "--contacts", "contacts.csv"]
    if load:
        (folder / "load.csv").write_text(load)
        command += ["--load", "load.csv"]
    return command


def of_nodes(
    K: Any, nodes: Any, contacts: Any, load: str = "", rows: Any = None, up: int = 1
) -> list[str]:
    """The same by nodes of the plane ``(n, 2)``, in the working folder: ``rows`` of the nodes,
    and contacts with normals along y. Labels are from 1.
    """
    table = "node,nx,ny,mu\n" + "".join(f"{k + 1},0,{up},0.3\n" for k in contacts)
    command = of_dofs(Path(), K, table, load)
    kept = range(len(nodes)) if rows is None else rows
    places = (f"{k + 1},{nodes[k, 0].item()!r},{nodes[k, 1].item()!r}\n" for k in kept)
    Path("nodes.csv").write_text("node,x,y\n" + "".join(places))
    return [*command, "--nodes", "nodes.csv"]


def written(
    folder: Path, name: str, *, form: str = "market", by_dof: bool = False
) -> tuple[list[str], Any]:
    """The files of a model, the arguments for them, and its case."""
    case = MODELS[name].assemble()
    model, dim = case.model, case.model.dim
    label = labels(len(model.nodes))

    def table(file: str, header: str, rows: Any) -> None:
        with (folder / file).open("w", newline="") as out:
            writer = csv.writer(out)
            writer.writerow(header.split())
            writer.writerows(rows)

    if form == "market":
        mmwrite(
            folder / "K.mtx",
            sparse.coo_matrix(model.K),
            symmetry="symmetric",
            precision=17,
        )
    else:
        K = sparse.coo_matrix(model.K)
        lines = ["** as written by a matrix output", "*MATRIX INPUT, NAME=K"]
        for i, j, v in zip(K.row, K.col, K.data, strict=True):
            keep = {"lower": i >= j, "upper": i <= j, "both": True}[form]
            if keep:
                at = (label[i // dim], i % dim + 1, label[j // dim], j % dim + 1)
                lines.append("{},{}, {},{}, {:.17e}".format(*at, v))
        (folder / "K.mtx").write_text("\n".join(lines) + "\n")
    arguments = ["--stiffness", "K.mtx", "--contacts", "contacts.csv"]
    places = [
        f"{label[k]}, " + ", ".join(f"{c!r}" for c in x.tolist())
        for k, x in enumerate(model.nodes)
    ]
    (folder / "nodes.inp").write_text(
        "*HEADING\na job\n** all of them\n*Node, nset=all\n"
        + "\n".join(places)
        + "\n*ELEMENT, type=none\n1, 2, 3\n"
    )
    axes = AXES[:dim]
    pair = (model.contact_dofs[:, 1] >= 0).any()
    normal = [f.tolist() for f in 2 * model.frame[:, 0]]
    if by_dof:
        header = "dof_" + " dof_".join(axes)
        dofs_of_sides = [[d + k for k in range(dim)] for d in model.contact_dofs[:, 0]]
        if pair:
            header += " other_" + " other_".join(axes)
            for row, d in zip(dofs_of_sides, model.contact_dofs[:, 1], strict=True):
                row += [d + k for k in range(dim)]
    else:
        arguments += ["--nodes", "nodes.inp"]
        header = "node other" if pair else "node"
        dofs_of_sides = [
            [label[d // dim] for d in row if d >= 0] for row in model.contact_dofs
        ]
    header += " n" + " n".join(axes) + " mu area gap"
    rows = zip(dofs_of_sides, normal, model.mu, model.area, model.gap, strict=True)
    table("contacts.csv", header, ([*o, *n, m, a, g] for o, n, m, a, g in rows))
    steps = range(len(case.prescribed))
    if case.load is not None:
        arguments += ["--load", "load.csv"]
        f = case.load
        if by_dof:
            entries = [(k, d, f[k, d]) for k in steps for d in np.flatnonzero(f[k])]
            table("load.csv", "step dof force", entries)
        else:
            nodal = f.reshape(len(f), -1, dim)
            nodes = [
                (k, i) for k in steps for i in np.flatnonzero(nodal[k].any(axis=1))
            ]
            table(
                "load.csv",
                "step node f" + " f".join(axes),
                ([k, label[i], *nodal[k, i]] for k, i in nodes),
            )
    if len(model.fixed):
        arguments += ["--fixed", "fixed.csv"]
        if by_dof:
            entries = [
                (k, d, u)
                for k in steps
                for d, u in zip(model.fixed, case.prescribed[k], strict=True)
            ]
            table("fixed.csv", "step dof value", entries)
        else:
            rows_ = []
            for k in steps:
                at = dict(zip(model.fixed.tolist(), case.prescribed[k], strict=True))
                rows_ += [
                    [k, label[i], *(at.get(dim * i + c, "") for c in range(dim))]
                    for i in sorted({d // dim for d in at})
                ]
            table("fixed.csv", "step node u" + " u".join(axes), rows_)
    return ["solve", *arguments], case
