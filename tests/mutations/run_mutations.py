"""Plant each fault of ``faults.toml``, one at a time, and see that a test fails.

    python tests/mutations/run_mutations.py            # every fault: some minutes each ten faults
    python tests/mutations/run_mutations.py 3 17       # these only

The checkout is copied to ``out/mutations`` and every fault is compiled into that copy at
once, behind a switch that the environment variable ``BIPOT_FAULT`` sets: one compilation
serves all. The test of ``results.csv`` that found a fault runs first; where it passes or
is gone, all tests run until the first failure: for a fault of the core, those of the core
first; for one of the package, those of its folder first. The rows of these faults in
``results.csv`` are written anew.
Exit status 1: a fault was not found.
"""

import csv
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from time import perf_counter

from plant import faults, planted

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
COPY = ROOT / "out" / "mutations"
RESULTS = HERE / "results.csv"
SWITCH = "BIPOT_FAULT"
# Seconds of one run of tests, by their marker: some times what they take.
MOST = {"not slow": 600, "slow": 7200}

RUST_SWITCH = f"""
/// Whether the planted fault with this number is on.
pub fn planted(number: u32) -> bool {{
    static ON: std::sync::OnceLock<Option<u32>> = std::sync::OnceLock::new();
    let read = || std::env::var("{SWITCH}").ok()?.parse().ok();
    *ON.get_or_init(read) == Some(number)
}}
"""
PYTHON_SWITCH = f'''"""Whether a planted fault is on."""

import os

ON = int(os.environ.get("{SWITCH}", "0"))


def planted(number: int) -> bool:
    return number == ON
'''


def plant() -> None:
    """Copy the checkout, plant every fault, compile once."""
    COPY.mkdir(parents=True, exist_ok=True)
    kept = [
        "--exclude=./out",
        "--exclude=./target",
        "--exclude=./.venv",
        "--exclude=./.git",
    ]
    packed = subprocess.run(
        ["tar", "-c", *kept, "."], cwd=ROOT, capture_output=True, check=True
    )
    subprocess.run(["tar", "-x"], cwd=COPY, input=packed.stdout, check=True)
    python_files = set()
    for number, fault in enumerate(faults(), 1):
        path = COPY / fault["file"]
        path.write_text(planted(fault, number, path.read_text("utf-8")), "utf-8")
        if path.suffix == ".py":
            python_files.add(path)
    for path in python_files:
        text = path.read_text("utf-8")
        # After the docstring and `from __future__`, before the first use.
        first = re.search(r"^(?:import|from) (?!__future__)", text, re.MULTILINE)
        at = first.start() if first else len(text)
        switch = "from bipot_rs.planted_faults import planted as _planted\n"
        path.write_text(text[:at] + switch + text[at:], "utf-8")
    (COPY / "python/bipot_rs/planted_faults.py").write_text(PYTHON_SWITCH, "utf-8")
    crate = COPY / "src/lib.rs"
    text = crate.read_text("utf-8")
    crate.write_text(f"#![allow(unused_parens)]\n{text}{RUST_SWITCH}", "utf-8")
    build = ["cargo", "build", "--release", "--features", "python", "--lib"]
    subprocess.run(build, cwd=COPY, env=environment(0), check=True)
    built = COPY / "target/release/libbipot_rs.so"
    built.replace(COPY / "python/bipot_rs/_core.abi3.so")
    # Not within the time of the first run: on a busy machine this takes ten minutes.
    tests = ["cargo", "test", "--locked", "--test", "core", "--no-run"]
    subprocess.run(tests, cwd=COPY, env=environment(0), check=True)
    # Otherwise each test fails, whatever the fault, and it counts as found.
    imported = [sys.executable, "-c", "import bipot_rs.scene, bipot_rs.cli.app"]
    subprocess.run(imported, cwd=COPY, env=environment(0), check=True)


def environment(number: int) -> dict[str, str]:
    """Of a run with this fault on; 0 is none."""
    return {
        **os.environ,
        SWITCH: str(number),
        "PYTHONPATH": str(COPY / "python"),
        "CARGO_TARGET_DIR": str(COPY / "target"),
        "CARGO_PROFILE_RELEASE_LTO": "off",
        # The same examples in each run.
        "CI": "1",
        "PROPTEST_RNG_SEED": "19910722",
    }


def run(
    command: list[str], number: int, marked: str = "not slow"
) -> tuple[int | None, str]:
    """Run a command in the copy with this fault on: exit status, None after `MOST`; output."""
    process = subprocess.Popen(
        command,
        cwd=COPY,
        env=environment(number),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=MOST[marked])
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        output, _ = process.communicate()
        return None, output
    return process.returncode, output


def first(pattern: str, status: int | None, output: str) -> str:
    """The first test that failed; nothing if all passed."""
    if status == 0:
        return ""
    failed = re.findall(pattern, output, re.MULTILINE)
    # A fault that makes a solver run on is found too.
    ended = "no end" if status is None else f"exit status {status}"
    return failed[0] if failed else ended


def found_in_rust(number: int) -> str:
    """The first test of the core that fails; nothing if all pass."""
    tests = run(["cargo", "test", "--locked", "--test", "core"], number)
    failed = first(r"^test (\S+) \.\.\. FAILED", *tests)
    return failed and f"cargo test: {failed}"


def found_in_python(number: int, where: str = "", marked: str = "not slow") -> str:
    """The first Python test below the folder ``where`` that fails; nothing if all pass.

    The tests of the repository itself, such as of its layers, see the switches.
    """
    pytest = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
    folder = f"tests/python/{where}"
    which = [folder, "--ignore=tests/python/repository"]
    which += ["-m", marked, "-n", "2", "--dist", "loadgroup"]
    tests = run([*pytest, *which], number, marked)
    return first(r"^(?:FAILED|ERROR) (\S+)", *tests)


def found_again(number: int, test: str) -> str:
    """``test``, which found the fault before, if it fails again; nothing if not."""
    name = test.removeprefix("cargo test: ")
    if name != test:
        exact = ["cargo", "test", "--locked", "--test", "core", name, "--", "--exact"]
        return test if "FAILED" in run(exact, number)[1] else ""
    # Without its parameters: their names may have changed.
    function = test.partition("[")[0]
    if "::" not in function or not (COPY / function.partition("::")[0]).exists():
        return ""
    pytest = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
    _, output = run([*pytest, function], number)
    failed = re.findall(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
    return failed[0] if failed and "::" in failed[0] else ""


def found_by(number: int, file: str, test: str) -> str:
    """The first test that fails: ``test``, those of its room, elsewhere, then slow ones."""
    looks = [lambda: found_in_rust(number), lambda: found_in_python(number)]
    if not file.endswith(".rs"):
        looks.reverse()
        # Tests mirror the package.
        looks.insert(0, lambda: found_in_python(number, Path(file).parts[2]))
    looks.insert(0, lambda: found_again(number, test))
    looks.append(lambda: found_in_python(number, marked="slow"))
    return next(filter(None, (look() for look in looks)), "")


def main() -> int:
    every = faults()
    asked = [int(a) for a in sys.argv[1:]] or list(range(1, len(every) + 1))
    # A shell starts jobs in the background with SIGINT ignored, and so would be the programs
    # that the tests interrupt.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    plant()
    if not sys.argv[1:] and (failed := found_in_rust(0) or found_in_python(0)):
        sys.stderr.write(f"with no fault on, {failed} fails\n")
        return 2
    rows = known()
    lost = False
    for number in asked:
        start = perf_counter()
        fault = every[number - 1]
        before = rows[fault["what"]][2] if fault["what"] in rows else ""
        test = found_by(number, fault["file"], before)
        seconds = round(perf_counter() - start)
        lost |= not test
        rows[fault["what"]] = [fault["file"], fault["what"], test]
        found = test or "NOT FOUND"
        sys.stdout.write(f"{number:3} {seconds:4} s  {fault['what']}: {found}\n")
        sys.stdout.flush()
        write([rows[x["what"]] for x in every if x["what"] in rows])
    return int(lost)


def known() -> dict[str, list[str]]:
    """The rows of the table, by what the fault is."""
    if not RESULTS.exists():
        return {}
    with RESULTS.open(encoding="utf-8", newline="") as file:
        return {row[1]: row for row in list(csv.reader(file))[1:]}


def write(rows: list[list[str]]) -> None:
    """Write the table, in the order of the list of faults."""
    with RESULTS.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["file", "what", "first test that fails"])
        table.writerows(rows)


if __name__ == "__main__":
    sys.exit(main())
