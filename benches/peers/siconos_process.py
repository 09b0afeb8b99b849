"""Siconos in a process of its own, under the first Python that has it."""

import json
import os
import select
import subprocess
import sys
from pathlib import Path

import numpy as np
from peers.commands import PEERS, pythons


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
