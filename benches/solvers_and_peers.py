"""Time to η ≤ 1e-8 of bipot_rs, Siconos and a NumPy sweep, on the same W, q and μ.

    python benches/solvers_and_peers.py
    python benches/solvers_and_peers.py --seeds 10 --sets held,random

Each problem is solved in turn, on one thread, by bipot_rs, by the sweep of
`peers/sweep.py`, and by Siconos' projected Gauss–Seidel (NSGS) and Alart–Curnier Newton
(NSN_AC) with default parameters. Siconos runs in its own process
(`peers/siconos_reduced.py`) under the first Python that has it, or that of ``--siconos``;
only its driver is timed. `ReducedProblem.residual` computes η of every result. Siconos'
tolerance has another meaning: it is reduced by factors of ten until η is met, and only
that run counts. The peers get node-scaled variables with largest q = 1, the easiest form
of the problem for them: Siconos' error measures are absolute, so that in SI units it
stops at once or never, and with stiff and soft contacts together it stops too early.

bipot_rs has two rows: the call from Python, with checks and conversions of arrays, and
the solver alone, which corresponds to Siconos' driver.

Sets whose bodies only contact holds are left out, because the peers have no such
unknowns. Unsolved counts as infinite. The table of the README is rewritten if all sets and
seeds are solved.
"""

import json
import os
import select
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
import problems
import tables
from peers.commands import PEERS, pythons
from peers.sweep import sweep
from reference_solution import Scaled
from speed_against_error import timed

import bipot_rs as bp

TARGET = 1e-8
SETS = [name for name in problems.SETS if name != "floating"]
PROGRAMS = {
    "call": "bipot_rs auto, call from Python",
    "auto": "bipot_rs auto, solver alone",
    "sweep": "NumPy sweep",
    "NSGS": "Siconos NSGS",
    "NSN_AC": "Siconos NSN_AC",
}


class Siconos:
    """The process of Siconos; started again after a time limit."""

    def __init__(self, python, folder, limit):
        self.command = [python, str(PEERS / "siconos_reduced.py")]
        self.folder, self.limit, self.process = Path(folder), limit, None
        self.iterations = 0  # of the last answer

    def start(self):
        """Start the process; return whether it runs."""
        pipe, environment = subprocess.PIPE, {**os.environ, "PYTHONPATH": ""}
        self.process = subprocess.Popen(
            self.command,
            stdin=pipe,
            stdout=pipe,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
        )
        return bool(self.process.stdout.readline())

    def ask(self, solver, tol):
        """Solve the stored problem: reactions and seconds, ``None`` after the time limit."""
        if self.process is None:
            self.start()
        files = {
            "problem": self.folder / "problem.npz",
            "answer": self.folder / "r.npy",
        }
        question = {key: str(path) for key, path in files.items()}
        # More than it reaches within the time limit.
        question |= {"solver": solver, "tol": tol, "iterations": 1_000_000}
        self.process.stdin.write(json.dumps(question) + "\n")
        self.process.stdin.flush()
        ready, _, _ = select.select([self.process.stdout], [], [], self.limit)
        line = self.process.stdout.readline() if ready else ""
        if not line:
            self.close()
            return None
        told = json.loads(line)
        self.iterations = told["iterations"]
        return np.load(files["answer"]), told["seconds"]

    def close(self):
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stdin.close()
            self.process.stdout.close()
            self.process = None


def find(wanted, folder, limit):
    """Start Siconos under the given Python or any; ``None`` if it is not installed."""
    for python in [wanted] if wanted else pythons():
        siconos = Siconos(python, folder, limit)
        if siconos.start():
            return siconos
        siconos.close()
    print("Siconos: not installed", file=sys.stderr)
    return None


def meets_target(reduced, answer):
    """Whether η of the reactions meets the target."""
    return bool(np.isfinite(answer).all()) and reduced.residual(answer) <= TARGET


def bipot_seconds(reduced, limit):
    """Seconds of the call and of the solver within it; infinite if not solved."""
    seconds, answer = timed(reduced, tol=TARGET, max_seconds=limit)
    if not (answer.converged and meets_target(reduced, answer.reaction)):
        return np.inf, np.inf
    return seconds, min(answer.seconds, seconds)


def peer_seconds(peer, problem, reduced, siconos, limit):
    """Seconds of a peer to the target; infinite if it does not reach it."""
    scaled = Scaled(problem)
    largest = np.abs(scaled.q).max()
    W, q, mu, force = scaled.W, scaled.q / largest, problem.mu, largest * scaled.to_v
    if peer == "sweep":
        start = perf_counter()
        r = sweep(W, q, mu, TARGET, limit)
        seconds = perf_counter() - start
        return seconds if meets_target(reduced, r * force) else np.inf
    np.savez(siconos.folder / "problem.npz", W=W, q=q, mu=mu)
    for tol in 10.0 ** -np.arange(6, 15):
        answer = siconos.ask(peer, tol)
        if answer is None:
            break
        r, seconds = answer
        if meets_target(reduced, r * force):
            return seconds
    return np.inf


def compare(name, seeds, programs, siconos, limit):
    """Seconds of every program on every problem of a set, ``{program: (problems,)}``."""
    found = {program: [] for program in programs}
    for seed in seeds:
        problem = problems.SETS[name](seed)
        if problem.rigid is not None:
            continue
        reduced = bp.ReducedProblem(problem.W, problem.q, problem.mu)
        for program, seconds in zip(
            ("call", "auto"), bipot_seconds(reduced, limit), strict=True
        ):
            found[program].append(seconds)
        for peer in programs[2:]:
            found[peer].append(peer_seconds(peer, problem, reduced, siconos, limit))
    return {program: np.array(seconds) for program, seconds in found.items()}


def ratio(seconds, own):
    """Median of the ratios of the problems that at least one of the two solved."""
    either = np.isfinite(own) | np.isfinite(seconds)
    if not either.any():
        return np.inf
    return np.quantile(seconds[either] / own[either], 0.5, method="higher")


HEAD = tables.columns(
    "set | problems | program | solved | median, ms | 90 %, ms | "
    "time / call | time / solver"
)


def rows(name, found):
    """Row of each program for one set."""
    for program, seconds in found.items():
        middle, high = np.quantile(seconds, [0.5, 0.9], method="higher")
        ratios = (ratio(seconds, found[key]) for key in ("call", "auto"))
        figures = (1e3 * middle, 1e3 * high, *ratios)
        cells = (f"{x:.2g}" if x < np.inf else "∞" for x in figures)
        solved = int(np.isfinite(seconds).sum())
        yield (name, str(len(seconds)), PROGRAMS[program], str(solved), *cells)


def main():
    """Measure, and rewrite the table."""
    parser = tables.parser(__doc__)
    parser.add_argument("--sets", default=",".join(SETS))
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument(
        "--seconds-limit", type=float, default=5.0, help="for one solve"
    )
    parser.add_argument("--siconos", help="the Python that has it")
    args = parser.parse_args()
    limit, lines = args.seconds_limit, []
    whole = tables.whole(parser, args, "sets", "seeds", "first_seed")
    with tempfile.TemporaryDirectory() as folder:
        siconos = find(args.siconos, folder, limit)
        programs = list(PROGRAMS) if siconos else ["call", "auto", "sweep"]
        for name in args.sets.split(","):
            seeds = problems.seeds(name, args.seeds, args.first_seed)
            found = compare(name, seeds, programs, siconos, limit)
            for row in rows(name, found):
                print("| " + " | ".join(row) + " |", flush=True)
                lines.append(row)
        if siconos:
            siconos.close()
    tables.publish(
        "solvers and peers", tables.table(HEAD, lines), write=whole and not args.print
    )


if __name__ == "__main__":
    main()
