"""Whole jobs, mesh to written result, in turn with SciPy doing the same.

    python benches/whole_job.py                 # the table of benches/README.md
    python benches/whole_job.py sheared_cube=9,15 two_blocks=8

Each job is a process of its own, ours and the peer's one after the other, so that
both meet the same machine. `peer_scipy.py` says what the peer does; it writes no
VTU files and no table. Prints Markdown. Seconds are of one run; ``job`` is the sum of
the phases, mesh to written result, ``process`` the wall clock of the whole process
with its imports, and the ratio is that of the jobs. BLAS has one thread, unless
OPENBLAS_NUM_THREADS says otherwise: SuperLU calls it on blocks so small that a second
one made the peer up to ten times slower. Our own threads are BIPOT_NUM_THREADS.
"""

import json
import os
import platform
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.spatial import cKDTree

from bipot_rs.export import read_result

HERE = Path(__file__).resolve().parent
DATA = HERE.parent / "tests" / "python" / "data"
LETTER = {"pressed_block": "A", "sheared_cube": "B", "two_blocks": "D"}
JOBS = {
    "pressed_block": (32, 64, 128),
    "sheared_cube": (9, 15, 24),
    "cattaneo_mindlin": (10, 20, 40),
    "two_blocks": (8, 16, 24),
    "cyclic_cube": (9, 15),
}
PHASES = ("mesh", "assemble", "condense", "solve", "recover", "write")


def timed(*command):
    """Run a command; its seconds, and the lines of its output as JSON."""
    start = perf_counter()
    one = {"OPENBLAS_NUM_THREADS": "1"}
    run = subprocess.run(command, capture_output=True, text=True, env=one | os.environ)
    seconds = perf_counter() - start
    if run.returncode:
        raise SystemExit(f"{' '.join(command)}\n{run.stdout}{run.stderr}")
    return seconds, [json.loads(line) for line in run.stdout.splitlines()]


def traction_error(places, reaction, other):
    """Largest relative error of the tractions over the load steps."""
    distance, order = cKDTree(places).query(other["x"])
    if distance.max() > 1e-9 * np.ptp(places):
        raise SystemExit("the contact nodes are not those of the other route")
    weight = 1 / other["area"][None, :, None]
    error = (weight * (reaction[:, order] - other["R"]) ** 2).sum(axis=(1, 2))
    return np.sqrt(error / (weight * other["R"] ** 2).sum(axis=(1, 2))).max()


def job(name, n, folder):
    """Rows of the table for one scene and size: ours, and the peer's."""
    out, answer = folder / "ours", folder / "peer.npz"
    our_total, (*steps, ours) = timed(
        *(sys.executable, "-m", "bipot_rs", "run", name, "--json"),
        *("--set", f"mesh.n={n}", "--out", str(out)),
    )
    peer_total, (peer,) = timed(
        *(sys.executable, str(HERE / "peer_scipy.py"), name, str(n)),
        *("--save", str(answer)),
    )
    contacts, records, _ = read_result(out / "result.h5")
    reaction = np.array([record["reaction"] for record in records])
    theirs = np.load(answer)
    stored = DATA / f"{LETTER.get(name)}_{n}.npz"
    reference = np.load(stored) if stored.exists() else theirs
    seconds = ours["seconds"]
    our_job = sum(seconds[phase] for phase in PHASES)
    yield (
        f"{name}, {n}",
        f"{ours['dofs']:,}",
        str(ours["contacts"]),
        str(ours["steps"]),
        "bipot_rs",
        *(f"{seconds[phase]:.3g}" for phase in PHASES),
        *(f"{our_job:.3g}", f"{our_total:.3g}"),
        f"{max(step['residual'] for step in steps):.0e}",
        f"{traction_error(contacts['x'], reaction, reference):.0e}"
        + ("" if stored.exists() else " (to SciPy)"),
        f"{ours['peak_mb']:.0f}",
        f"{peer['seconds']['total'] / our_job:.1f}",
    )
    seconds = peer["seconds"]
    condense = seconds["factor"] + seconds["compliance"]
    error = traction_error(theirs["x"], theirs["R"], reference)
    yield (
        *("", "", "", ""),
        "SciPy",
        *("", f"{seconds['assemble']:.3g}", f"{condense:.3g}"),
        *(f"{seconds['solve']:.3g}", "", ""),
        *(f"{seconds['total']:.3g}", f"{peer_total:.3g}"),
        f"{peer['residual']:.0e}",
        f"{error:.0e}" if stored.exists() else "",
        f"{peer['peak_mb']:.0f}",
        "",
    )


def main():
    """Print the table."""
    jobs = dict(JOBS)
    if len(sys.argv) > 1:
        chosen = (argument.partition("=") for argument in sys.argv[1:])
        jobs = {name: tuple(map(int, sizes.split(","))) for name, _, sizes in chosen}
    packages = ("bipot-rs", "numpy", "scipy", "scikit-fem")
    versions = ", ".join(f"{package} {version(package)}" for package in packages)
    threads = ", ".join(
        f"{key}={os.environ[key]}"
        for key in ("BIPOT_NUM_THREADS", "OPENBLAS_NUM_THREADS")
        if key in os.environ
    )
    print(f"{platform.machine()}, {os.cpu_count()} cores; {versions}; {threads}\n")
    head = (
        *("scene, n", "dofs", "contacts", "steps", "program", *PHASES),
        *("job", "process"),
        *("residual", "traction error", "peak MB", "ratio"),
    )
    print("| " + " | ".join(head) + " |")
    print("|---" * len(head) + "|")
    for name, sizes in jobs.items():
        for n in sizes:
            with tempfile.TemporaryDirectory() as folder:
                for row in job(name, n, Path(folder)):
                    print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
