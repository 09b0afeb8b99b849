"""The sets of `tuning.py`: what each counts in a process of its own.

A set returns its work (products with W or K, Krylov iterations, operations of a factorisation,
load paths of wear) and the number of problems that are not solved, not decided or warned of.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Counts = dict[str, float]

# The methods of a set of reduced problems.
METHODS = {
    "reduced": ("auto",),
    "projections": ("nesterov", "uzawa", "uzawa_two_projection"),
    "penalties": ("return_mapping", "perturbed_lagrangian"),
    "principles": (
        "displacement_principle",
        "alternating_principles",
        "stress_principle",
        "minimising_sequence",
    ),
    "pivoting": ("pivoting",),
}
FLOATING = ("floating", "rigid")
# The iterations of a method that hardly converges.
MOST = 2000
# Shipped scenes, and their cells along a side.
CELLS = {"pressed_block": 10, "sheared_cube": 8, "two_blocks": 8, "cattaneo_mindlin": 6}
# Solutions of proofs are exact to this, so that a bound shows the proof and not the solver.
EXACT = 1e-12


def run_reduced(kind: str, seeds: int) -> Counts:
    """The products with W of the random sets of `problems.py`."""
    import problems

    import bipot_rs as bp

    work, unsolved = 0.0, 0
    names = set(problems.SETS) - {"scenes"}
    if kind not in {"reduced", "projections"}:
        names -= set(FLOATING)
    for name in sorted(names):
        for seed in range(seeds):
            p = problems.SETS[name](seed)
            reduced = bp.ReducedProblem(p.W, p.q, p.mu, rigid=p.rigid)
            for method in METHODS[kind]:
                most = None if kind == "reduced" else MOST
                solution = reduced.solve(method=method, max_iterations=most)
                unsolved += not solution.converged
                work += solution.work if solution.converged else 0.0
    return {"work": work, "unsolved": unsolved}


def run_proofs(_kind: str, seeds: int) -> Counts:
    """The logarithms of the error bounds, and questions without an answer."""
    import problems

    import bipot_rs as bp

    work, undecided = 0.0, 0
    for name in sorted(set(problems.SETS) - {"scenes"}):
        for seed in range(seeds):
            p = problems.SETS[name](seed)
            reduced = bp.ReducedProblem(p.W, p.q, p.mu, rigid=p.rigid)
            solution = reduced.solve(tol=EXACT)
            undecided += solution.unique == "unknown"
            undecided += str(reduced.existence().verdict) == "unknown"
            error = solution.error.relative
            undecided += error is None
            work += math.log(error) if error else 0.0
    return {"work": work, "unsolved": undecided}


def run_scenes(kind: str, _seeds: int) -> Counts:
    """The products with K, or the operations of the factorisation, of the shipped scenes."""
    from bipot_rs import scene

    work, unsolved = 0.0, 0
    engine = "iterative" if kind == "iterative" else "direct"
    many = {"pressed_block": 24, "cattaneo_mindlin": 8}
    for name, n in (many if kind == "candidates" else CELLS).items():
        read = scene.read(name, [f"mesh.n={n}"])
        case = scene.assemble(read, scene.bodies(read))
        problem = case.problem(engine=engine)
        if kind == "direct":
            work += problem.stats["flops"]
            continue
        result = problem.solve(case.load, case.prescribed)
        unsolved += not result.success
        work += float(sum(step.work for step in result))
    return {"work": work, "unsolved": unsolved}


def run_models(_kind: str, _seeds: int) -> Counts:
    """The work of all small shipped scenes, and the sentences that warn of them."""
    from bipot_rs import scene

    work, warnings = 0.0, 0
    small = {"raous_plate": 8, "pushed_punch": 4, "twisted_pad": 4, "cyclic_cube": 4}
    for name, n in (dict.fromkeys(CELLS, 6) | small).items():
        read = scene.read(name, [f"mesh.n={n}"])
        case = scene.assemble(read, scene.bodies(read))
        result = case.problem().solve(case.load, case.prescribed)
        work += float(sum(step.work for step in result))
        warnings += len(case.remarks()) + (not result.success)
    return {"work": work, "unsolved": warnings}


def run_discretisation(_kind: str, _seeds: int) -> Counts:
    """The products with W until the error of the mesh is reached, and its logarithm."""
    from bipot_rs import scene
    from bipot_rs.discretisation import Estimator
    from bipot_rs.discretisation.stopping import tolerance

    work = 0.0
    for name, n in {"cattaneo_mindlin": 10, "sheared_cube": 4}.items():
        read = scene.read(name, [f"mesh.n={n}"])
        case = scene.assemble(read, scene.bodies(read))
        enough = tolerance(Estimator(case), case.model.problem(), method="gauss_seidel")
        work += enough.work + abs(math.log(enough.discretisation))
    return {"work": work, "unsolved": 0}


def run_paths(_kind: str, _seeds: int) -> Counts:
    """The choice of the engine, the load paths of wear, and questions of existence."""
    import problems

    import bipot_rs as bp
    from bipot_rs.contact.path.choice import choose_engine

    work, undecided = 0.0, 0
    for free in 1000 * 2 ** np.arange(12):
        for contacts in (100, 400, 1600, 6400):
            for steps in (1, 8, 64, 512):
                chosen = choose_engine("auto", 3, int(free), contacts, steps, 8e9)[0]
                work += chosen == "iterative"
    spring = bp.ContactProblem(
        1e3 * np.eye(2), np.eye(2), gap=[-0.01], mu=0.0, area=[1e-4]
    )
    pull = np.array([[0.0, 4.0], [0.0, -4.0]])
    worn = spring.wear(pull, coefficient=1e-9, cycles=400, rtol=1e-3)
    work += len(worn.cycle)
    for name in FLOATING:
        for seed in range(4):
            p = problems.SETS[name](seed)
            reduced = bp.ReducedProblem(p.W, p.q, p.mu, rigid=p.rigid)
            undecided += str(reduced.existence().verdict) == "unknown"
    return {"work": work, "unsolved": undecided}


def make_strip(thickness: float, turn: float) -> tuple[Any, Any, Floats, Floats]:
    """K, B and gap of a free, turned steel strip of 1000 mm in the plane, and its nodes."""
    import bipot_rs as bp

    m = bp.Model("Strip")
    m.material("steel", young=2.1e5, poisson=0.3)
    m.body(
        "strip",
        material="steel",
        cell="quadrilateral",
        x=np.linspace(0.0, 1000.0, 101),
        y=np.linspace(0.0, thickness, 3),
    )
    m.support("strip.left", x=0.0, y=0.0)
    m.obstacle("floor", plane={"point": [0.0, 0.0], "normal": [0.0, 1.0]})
    m.contact("strip.bottom", against="floor", mu=0.3)
    model = m.assemble().model
    c, s = math.cos(turn), math.sin(turn)
    from scipy import sparse

    turned = sparse.kron(sparse.eye_array(len(model.nodes)), [[c, -s], [s, c]]).tocsr()
    return turned @ model.K @ turned.T, model.B @ turned.T, model.gap, model.nodes


def run_bodies(_kind: str, _seeds: int) -> Counts:
    """The free motions of strips without coordinates; refused or wrong ones are unsolved."""
    import bipot_rs as bp

    work, wrong = 0.0, 0
    for thickness in (0.5, 1.0, 2.0, 8.0, 32.0):
        for turn in (0.0, 0.3, 1.1):
            K, B, gap, nodes = make_strip(thickness, turn)
            left = np.flatnonzero(nodes[:, 0] < 1e-9)
            for fixed, free in (([2 * left[0]], 2), ([], 3), (None, 0)):
                held = [*(2 * left), *(2 * left + 1)] if fixed is None else fixed
                try:
                    problem = bp.ContactProblem(
                        K, B, gap=gap, mu=0.3, fixed=np.sort(held)
                    )
                except (bp.BipotError, ValueError):
                    wrong += 1
                    continue
                work += len(problem.rigid_motions)
                wrong += len(problem.rigid_motions) != free
    return {"work": work, "unsolved": wrong}


def run_petsc(_kind: str, _seeds: int) -> Counts:
    """The Krylov iterations of engine petsc on one rank; needs PETSc."""
    from bipot_rs.petsc.library import load

    PETSc, _ = load()
    from bipot_rs.petsc import ContactProblem
    from support.pressed_in_space import arrays as press
    from support.two_blocks import arrays as join

    work, unsolved = 0.0, 0
    for known, prescribed in (press(12), join(10.0, 6, 6), join(10.0, 5, 6)):
        K = known.pop("K")
        csr = K.indptr.astype(PETSc.IntType), K.indices.astype(PETSc.IntType), K.data
        matrix = PETSc.Mat().createAIJ(K.shape, bsize=3, csr=csr)
        problem = ContactProblem(matrix, known.pop("B"), **known)
        result = problem.solve(None, prescribed)
        unsolved += not result.success
        work += problem.stats["krylov"]
    return {"work": work, "unsolved": unsolved}


RUNS: dict[str, Callable[[str, int], Counts]] = {
    **dict.fromkeys(METHODS, run_reduced),
    **dict.fromkeys(("iterative", "direct", "candidates"), run_scenes),
    "proofs": run_proofs,
    "models": run_models,
    "discretisation": run_discretisation,
    "paths": run_paths,
    "bodies": run_bodies,
    "petsc": run_petsc,
}
