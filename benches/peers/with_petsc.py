"""One body on a rigid plane by PETSc: Newton on the displacements, or a linear system.

    mpirun -n RANKS python -m mpi4py benches/peers/with_petsc.py FILE MODE --save ANSWER

Needs NumPy, mpi4py and petsc4py, not this package; `iterative_file.py` writes FILE. MODE
is ``newton``, semismooth Newton with flexible GMRES, or ``linear``, conjugate gradients
without contact, both with GAMG; further arguments are options of PETSc that replace
`OPTIONS`. The clock starts when each rank has its rows of K as NumPy arrays. Rank 0 prints
a JSON line and saves the displacements (``linear``) or reactions ``(steps, n_c, 3)``.
"""

import argparse
import json
import sys
from functools import partial

import numpy as np
import report
from alart_curnier import OPEN, SLIP, STICK, Law, linear_tolerance, search

# SOR fails on coarse levels, where an aggregate may have fewer motions than columns. New
# aggregates for each set of statuses save iterations, but take longer than these.
OPTIONS = (
    "-pc_type gamg -pc_gamg_threshold 0.01 -pc_gamg_reuse_interpolation 1 "
    "-mg_levels_pc_type jacobi"
)
try:
    import petsc4py

    petsc4py.init([sys.argv[0], *OPTIONS.split(), *sys.argv[1:]])
    from mpi4py import MPI
    from petsc4py import PETSc
except ImportError:
    raise SystemExit("petsc4py is not installed") from None

MOST_STEPS, MOST_KRYLOV, RESTART = 60, 400, 80


def read(path, rank):
    """The part of a rank, and what all ranks share."""
    with np.load(path) as file:
        arrays_of_rank = {n: file[n] for n in file.files if n.endswith(f".{rank}")}
        return {n.split(".")[0]: x for n, x in arrays_of_rank.items()} | {
            "n": int(file["n"])
        }


def stiffness(own):
    """K of the free degrees of freedom, with its rigid motions."""
    csr = [
        own.pop(name).astype(PETSc.IntType, copy=False)
        for name in ("indptr", "indices")
    ]
    size = own["load"].size, own["n"]
    K = PETSc.Mat().createAIJ((size, size), bsize=3, csr=(*csr, own.pop("data")))
    K.setOption(PETSc.Mat.Option.SPD, True)
    places = PETSc.Vec().createWithArray(own["nodes"].ravel(), bsize=3)
    K.setNearNullSpace(PETSc.NullSpace().createRigidBody(places))
    return K


def krylov(kind, A, P):
    """A Krylov method for A, with the preconditioner of P."""
    ksp = PETSc.KSP().create(A.comm)
    ksp.setType(kind)
    ksp.setOperators(A, P)
    if kind == "fgmres":
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setGMRESRestart(RESTART)
    ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
    ksp.setFromOptions()
    return ksp


def solve(ksp, b, x, tol):
    """Solve to a relative residual; the number of iterations."""
    ksp.setTolerances(rtol=tol, atol=0.0, max_it=MOST_KRYLOV)
    ksp.solve(b, x)
    if ksp.getConvergedReason() <= 0:
        raise SystemExit("the linear system was not solved")
    return ksp.getIterationNumber()


class Body:
    """K, the contacts of this rank, and the matrices of a Newton step.

    Held are all components of sticking contacts and the normal ones of sliding contacts. J
    is K with other rows for the tangents of sliding contacts, P its symmetric part.
    """

    def __init__(self, own, K, comm):
        self.K, self.comm, self.mu, self.gap = K, comm, own["mu"], own["gap"]
        self.first = K.getOwnershipRange()[0]
        self.places = own["contacts"][:, None] + np.arange(3)
        self.count = comm.allreduce(len(self.mu))
        # About 1/(2 W_ii) of a node of a surface.
        self.rho = 0.5 / (1 / K.getDiagonal().array[self.places]).mean(axis=1)
        self.x, self.y = K.createVecs()
        self.P = K.duplicate()
        self.P.setNearNullSpace(K.getNearNullSpace())
        self.P.setOption(PETSc.Mat.Option.SPD, True)
        J = PETSc.Mat().createPython(K.getSizes(), context=self, comm=comm)
        self.ksp, self.krylov = krylov("fgmres", J, self.P), 0

    def norm(self, values):
        """Euclidean norm over all ranks."""
        return np.sqrt(self.comm.allreduce(float((values**2).sum())))

    def merit(self, r, v, dr, dv, share):
        """Size of the natural map after a share of a step."""
        return self.norm(Law(r + share * dr, v + share * dv, self.mu, self.rho).F)

    def product(self, u):
        """K u."""
        self.x.array[:] = u
        self.K.mult(self.x, self.y)
        return self.y.array.copy()

    def changed(self, u):
        """K u, with the rows of J for the tangents of sliding contacts."""
        y, at = self.product(u), self.slides
        y[at[:, 1:]] -= self.law.mu_t * y[at[:, :1]]
        y[at[:, 1:]] += np.einsum("iab,ib->ia", self.law.springs, u[at[:, 1:]])
        return y

    def mult(self, _, x, y):
        """J x without held rows and columns; called by PETSc."""
        # Coarse motions move held places too.
        free = x.array_r.copy()
        free[self.held] = 0.0
        y.array[:] = self.changed(free)
        y.array[self.held] = 0.0

    def linearise(self, law, *, renew):
        """Set J, and with ``renew`` the preconditioner."""
        self.law, self.slides = law, self.places[law.status == SLIP]
        sticks = self.places[law.status == STICK]
        self.held = np.concatenate([sticks.ravel(), self.slides[:, 0]])
        if renew:
            self.K.copy(self.P, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            size = self.comm.allreduce(self.rho.sum()) / self.count
            self.P.zeroRowsColumns((self.first + self.held).astype(PETSc.IntType), size)
            tangents = (self.first + self.slides[:, 1:]).astype(PETSc.IntType)
            for rows, spring in zip(tangents, law.springs, strict=True):
                self.P.setValues(rows, rows, spring, addv=PETSc.InsertMode.ADD)
            self.P.assemble()
        self.ksp.getPC().setReusePreconditioner(not renew)

    def correction(self, e, v, tol):
        """Displacements of a Newton step, from e = K u - f."""
        prescribed, right, free = np.zeros_like(e), -e, np.ones(e.size, bool)
        free[self.held] = False
        prescribed[self.places] = -v
        prescribed[free] = 0.0
        right[self.slides[:, 1:]] = self.law.wanted
        b, du = self.K.createVecs()
        b.array[:] = np.where(free, right - self.changed(prescribed), 0.0)
        self.krylov += solve(self.ksp, b, du, tol)
        return np.where(free, du.array, prescribed)

    def step(self, u, f, before, closed, tol):
        """A load step from u: displacements, reactions, statuses, residual, Newton steps.

        ``before`` are its tangential displacements; ``closed`` contacts stick at first.
        """
        status, recent = None, []
        for steps in range(MOST_STEPS):
            e = self.product(u) - f
            r, v = e[self.places], u[self.places] - before
            v[:, 0] += self.gap
            if status is None:
                touches = v[:, 0] <= 0 if closed is None else closed
                law = Law(r, v, self.mu, self.rho, np.where(touches, STICK, OPEN))
                changes, residual = self.count, 1.0
            else:
                law = Law(r, v, self.mu, self.rho)
                changes = self.comm.allreduce(int((law.status != status).sum()))
                recent.append(self.norm(law.F))
                e[self.places] = 0.0
                residual = max(recent[-1], self.norm(e)) / self.norm(r)
                e[self.places] = r
                if residual <= tol:
                    return u, r, law.status, residual, steps
            self.linearise(law, renew=changes > 0)
            wanted = linear_tolerance(changes / self.count, residual, tol)
            du = self.correction(e, v, wanted)
            share = 1.0
            if status is not None and changes:
                dr, dv = (x[self.places] for x in (self.product(du), du))
                share = search(partial(self.merit, r, v, dr, dv), recent)
            u, status = u + share * du, law.status
        raise SystemExit("the statuses do not settle")


def newton(own, comm, tol):
    """The load path: reactions of each step, and the counts."""
    begin = MPI.Wtime()
    body = Body(own, stiffness(own), comm)
    made = MPI.Wtime()
    u, closed, before = np.zeros_like(own["load"]), None, np.zeros((len(body.mu), 3))
    reactions, residual, newton = [], 0.0, 0
    for f in own["forces"]:
        u, r, status, last, steps = body.step(u, f, before, closed, tol)
        closed, before[:, 1:] = status != OPEN, u[body.places[:, 1:]]
        reactions.append(r)
        residual, newton = max(residual, last), newton + steps
    clock = begin, made, MPI.Wtime()
    counts = {"newton": newton, "krylov": body.krylov, "residual": residual}
    parts = comm.gather(np.array(reactions))
    return parts and np.concatenate(parts, axis=1), clock, counts


def linear(own, comm, tol):
    """The displacements under one load, without contact."""
    begin = MPI.Wtime()
    K = stiffness(own)
    ksp = krylov("cg", K, K)
    ksp.setUp()
    made = MPI.Wtime()
    b, x = K.createVecs()
    b.array[:] = own["load"]
    iterations = solve(ksp, b, x, tol)
    clock = begin, made, MPI.Wtime()
    residual = (K * x - b).norm() / b.norm()
    parts = comm.gather(x.array)
    counts = {"newton": "", "krylov": iterations, "residual": residual}
    return parts and np.concatenate(parts), clock, counts


def main():
    """Solve, and print the JSON line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("mode", choices=("linear", "newton"))
    parser.add_argument("--save", required=True, help="the answer, as npz")
    parser.add_argument("--tol", type=float, default=1e-10)
    args, _ = parser.parse_known_args()
    comm = MPI.COMM_WORLD
    arrays_of_rank, run = (
        read(args.file, comm.rank),
        {"newton": newton, "linear": linear},
    )
    comm.Barrier()
    answer, (begin, made, end), counts = run[args.mode](arrays_of_rank, comm, args.tol)
    peaks = comm.gather(report.peak_mb())
    if comm.rank == 0:
        np.savez(args.save, answer=answer)
        parts = {"set-up": made - begin, "solve": end - made, "total": end - begin}
        line = {"seconds": parts, "peak_mb": sum(peaks), "ranks": comm.size}
        version = ".".join(map(str, PETSc.Sys.getVersion()))
        print(json.dumps(line | counts | {"version": version}), flush=True)


if __name__ == "__main__":
    main()
