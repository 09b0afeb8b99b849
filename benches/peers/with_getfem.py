"""Solve a whole shipped scene with GetFEM.

    /usr/bin/python3 benches/peers/with_getfem.py SCENE N [--save FILE.npz] [--tol TOL]

Needs getfem and NumPy, not this package. GetFEM assembles K; its augmented Lagrangian brick
models Signorini and Coulomb node by node; its Newton method, with MUMPS, solves for
displacements and multipliers together. Prescribed unknowns are eliminated, which is faster
than its Dirichlet multipliers. Prints one JSON line; ``TOL`` is the residual of GetFEM.
"""

import numpy as np
import report
from scenes import scene, tributary

try:
    import getfem as gf
except ImportError:
    raise SystemExit("getfem is not installed") from None

gf.util_trace_level(0)
gf.util_warning_level(0)
# Among r = 0.1, 1 and 10 E h and the four variants of the brick this pair needs the fewest
# iterations on every scene; r = E h and above fails on some scenes.
AUGMENTATION = 0.1
VARIANT = 2
# The lower body is moved down by this distance, so that it shares no nodes with the upper
# one; its stiffness does not depend on its position.
APART = 1.0


def mesh_of(data):
    """One mesh of all bodies, the lower one moved down by `APART`."""
    *across, upper = data.bodies[0].grids
    lines = upper
    if len(data.bodies) == 2:
        lines = np.concatenate([data.bodies[1].grids[-1] - APART, upper])
    mesh = gf.Mesh("cartesian", *across, lines)
    if len(data.bodies) == 2:
        points, start = mesh.pts_from_cvid()
        height = np.add.reduceat(points[-1], start[:-1]) / np.diff(start)
        mesh.del_convex(mesh.cvid()[(height > -APART) & (height < 0)])
    return mesh


def assemble(data):
    """Function that assembles K; original coordinates and body of each node."""
    mesh, dim = mesh_of(data), len(data.bodies[0].grids)
    field = gf.MeshFem(mesh, dim)
    field.set_fem(gf.Fem(f"FEM_QK({dim},1)"))
    constant = gf.MeshFem(mesh, 1)
    constant.set_fem(gf.Fem(f"FEM_QK({dim},0)"))
    method = gf.MeshIm(mesh, gf.Integ(f"IM_GAUSS_PARALLELEPIPED({dim},3)"))
    lower = constant.basic_dof_nodes()[-1] < 0
    lame, shear = np.empty((2, len(lower)))
    for at, body in zip((~lower, lower), data.bodies, strict=False):
        lame[at] = (
            body.young * body.poisson / ((1 + body.poisson) * (1 - 2 * body.poisson))
        )
        shear[at] = body.young / (2 * (1 + body.poisson))

    def stiffness(unknowns):
        return gf.asm_linear_elasticity(method, unknowns, constant, lame, shear)

    nodes = field.basic_dof_nodes()[:, ::dim].copy()
    body = (nodes[-1] < -APART / 2).astype(int)
    nodes[-1, body == 1] += APART
    return field, stiffness, nodes, body


def ordered(at, nodes):
    """Nodes ordered by their coordinates."""
    return at[np.lexsort(nodes[:, at])]


def sparse_rows(columns, values, size):
    """Matrix with a few entries per row; entries of column -1 are left out."""
    matrix = gf.Spmat("empty", len(columns), size)
    for i, (js, vs) in enumerate(zip(columns, values, strict=True)):
        for j, v in zip(js, vs, strict=True):
            if j >= 0:
                matrix[i, int(j)] = v
    return matrix


def main():
    """Run one scene."""
    args = report.arguments(__doc__)
    data = scene(args.scene, args.n)
    clock = report.Clock()
    field, stiffness, nodes, body = assemble(data)
    dim, size = len(nodes), nodes.size
    last, eps = dim - 1, 1e-9 * np.ptp(nodes)
    contact = ordered(np.flatnonzero((np.abs(nodes[last]) < eps) & (body == 0)), nodes)
    if data.half_width is not None:
        contact = contact[np.abs(nodes[0, contact]) <= data.half_width + eps]
    paired = [contact]
    if len(data.bodies) == 2:
        lower = ordered(
            np.flatnonzero((np.abs(nodes[last]) < eps) & (body == 1)), nodes
        )
        paired.append(lower[np.abs(nodes[0, lower]) <= nodes[0, contact].max() + eps])
    mu = np.full(len(contact), data.mu)
    gap = np.zeros(len(contact))
    if data.radius is not None:
        gap = nodes[0, contact] ** 2 / (2 * data.radius)
    grids = data.bodies[0].grids
    area = tributary(grids[0])
    if dim == 3:
        area = np.outer(tributary(grids[1]), area).ravel()
    else:
        area = area[np.searchsorted(grids[0], nodes[0, contact] - eps)]
    f = np.zeros(size)
    if args.scene == "pressed_block":
        top = ordered(np.flatnonzero(nodes[1] > 40 - eps), nodes)
        side = ordered(np.flatnonzero(nodes[0] > 40 - eps), nodes)
        f[2 * top + 1] -= 50 * tributary(grids[0])
        f[2 * side] -= 100 * tributary(grids[1])
        held = np.flatnonzero(nodes[0] < eps)
        fixed, values = 2 * held, [np.zeros(len(held))]
        mu[nodes[0, contact] < eps] = 0.0
    else:
        top = np.flatnonzero(nodes[last] > nodes[last].max() - eps)
        fixed = (dim * top[:, None] + np.arange(dim)).ravel()
        values = [np.tile(u, len(top)) for u in data.top]
        if len(data.bodies) == 2:
            base = np.flatnonzero(nodes[last] < nodes[last].min() + eps)
            base = (dim * base[:, None] + np.arange(dim)).ravel()
            fixed = np.append(fixed, base)
            values = [np.append(v, np.zeros(len(base))) for v in values]
    free = np.setdiff1d(np.arange(size), fixed)
    at = np.full(size, -1)
    at[free] = np.arange(len(free))
    # To assemble twice takes a tenth of the time of extracting the free part.
    K = stiffness(field)
    inner = stiffness(gf.MeshFem("partial", field, free))
    clock.lap("assemble")

    signs = [1.0, -1.0][: len(paired)]
    normal = np.column_stack([at[dim * p + last] for p in paired])
    tangent = np.column_stack(
        [(at[dim * p[:, None] + np.arange(last)]).ravel() for p in paired]
    )
    BN = sparse_rows(normal, -np.tile(signs, (len(normal), 1)), len(free))
    BT = sparse_rows(tangent, np.tile(signs, (len(tangent), 1)), len(free))
    model = gf.Model("real")
    model.add_variable("u", len(free))
    model.add_variable("ln", len(contact))
    model.add_variable("lt", last * len(contact))
    cell = np.sqrt(area.mean()) if dim == 3 else area.mean()
    contact_stiffness = data.bodies[0].young * (cell if dim == 3 else 1.0)
    model.add_initialized_data("r", [AUGMENTATION * contact_stiffness])
    model.add_initialized_data("mu", mu)
    model.add_initialized_data("gap", gap)
    model.add_initialized_data("alpha", [1.0])
    model.add_initialized_data("gamma", [1.0])
    model.add_initialized_data("wt", np.zeros(len(free)))
    model.add_explicit_matrix("u", "u", inner, 1, 1)
    load = model.add_explicit_rhs("u", np.zeros(len(free)))
    model.add_basic_contact_brick(
        "u", "ln", "lt", "r", BN, BT, "mu", "gap", "alpha", VARIANT, "gamma", "wt"
    )
    # Start with closed contacts: with open ones a body without supports is free to move.
    model.set_variable("ln", np.full(len(contact), -1e-3 * contact_stiffness * cell))
    clock.lap("bricks")
    reactions, displacements, iterations = [], [], 0
    whole = np.zeros(size)
    for value in values:
        before = whole.copy()
        prescribed = np.zeros(size)
        prescribed[fixed] = value
        model.set_private_rhs(load, (f - K.mult(prescribed))[free])
        count, converged = model.solve(
            "max_res",
            args.tol,
            "max_iter",
            200,
            "lsolver",
            "mumps",
            "lsearch",
            "simplest",
        )
        if not converged:
            raise SystemExit(f"not converged in {count} iterations")
        iterations += count
        whole[fixed], whole[free] = value, model.variable("u")
        # The brick of 5.4 adds WT where its manual subtracts it.
        model.set_variable("wt", -whole[free])
        r = np.column_stack(
            [-model.variable("ln"), model.variable("lt").reshape(-1, last)]
        )
        reactions.append(r)

        def relative(u):
            parts = u.reshape(-1, dim)
            return parts[paired[0]] - (parts[paired[1]] if len(paired) == 2 else 0.0)

        v = np.column_stack(
            [relative(whole)[:, last] + gap, relative(whole - before)[:, :last]]
        )
        displacements.append(v)
        clock.step()
    report.write(
        args,
        clock,
        "GetFEM",
        nodes[:, contact].T,
        area,
        reactions,
        displacements,
        dofs=size,
        iterations=iterations,
        settings=f"augmented Lagrangian {VARIANT}, r = {AUGMENTATION:g} E h, MUMPS",
    )


if __name__ == "__main__":
    main()
