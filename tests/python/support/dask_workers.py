"""A dask scheduler with two workers on this machine, and work for them."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# Workers are started again by this program: those of LocalCluster may take a minute if they
# are killed soon after their start.
_CLUSTER = """
import subprocess, sys, threading, dask
from distributed import LocalCluster

def keep(address, more, alive, started):
    command = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-nanny"]
    command += ["--nthreads", "1", "--no-dashboard", "--death-timeout", "20", *more]
    while alive.is_set():
        process = subprocess.Popen(command)
        started.append(process)
        process.wait()

if __name__ == "__main__":
    memory, failures = sys.argv[1], int(sys.argv[2])
    dask.config.set({"distributed.scheduler.allowed-failures": failures})
    more = ["--resources", f"memory={memory}"] if float(memory) else []
    alive, started = threading.Event(), []
    alive.set()
    with LocalCluster(n_workers=0, dashboard_address=None) as cluster:
        arguments = (cluster.scheduler_address, more, alive, started)
        threads = [threading.Thread(target=keep, args=arguments) for _ in range(2)]
        for thread in threads:
            thread.start()
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
        alive.clear()
        for process in started:
            process.kill()
        for thread in threads:
            thread.join()
"""


@contextmanager
def two_workers(folder: Path, *, memory: float = 0, failures: int = 0) -> Iterator[str]:
    """Address of a scheduler whose workers each declare ``memory``, if it is not zero."""
    script = folder / "cluster.py"
    script.write_text(_CLUSTER)
    paths = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    process = subprocess.Popen(
        [sys.executable, str(script), str(memory), str(failures)],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.stdin.close()
        process.wait(30)
        process.stdout.close()


def row(number: int, killing: tuple[int, ...] = ()) -> Any:
    """Work of a row; that of some numbers kills the process of the worker."""
    if number in killing:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 99:
        raise RuntimeError("no")
    return number, os.getpid(), threading.get_ident()


def solved_then_killed(number: int, folder: Path) -> int:
    """A row whose process is killed after it has returned; next time it takes longer."""
    if number == 2:
        tries = len(list(folder.iterdir()))
        (folder / str(tries)).touch()
        if tries == 0:
            # Long enough to return.
            threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGKILL)).start()
        else:
            time.sleep(3.0)
    return number
