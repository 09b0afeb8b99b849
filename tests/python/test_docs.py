"""What the documents show works when pasted, and what they point to exists."""

import re
import runpy
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skfem
from skfem.models.elasticity import linear_elasticity

import bipot_rs as bp

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("*/README.md")]
)
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)|<img[^>]* src=\"([^\"]+)\"")


def blocks(text: str) -> list[tuple[int, str]]:
    """First line number and text of every Python block."""
    return [(text.count("\n", 0, m.start(1)) + 1, m[1]) for m in BLOCK.finditer(text)]


def anchors(text: str) -> set[str]:
    """Names that a heading can be linked by."""
    heads = re.findall(r"^#+ +(.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in heads}


def broken_links(page: Path) -> list[str]:
    """Links of a page to files, or to headings of this page, that are not there."""
    text = page.read_text(encoding="utf-8")
    prose = re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)
    found = []
    for match in LINK.finditer(prose):
        target = match[1] or match[2]
        if re.match(r"[a-z]+:", target):
            continue  # the web is not asked: it answers differently every day
        file, _, anchor = target.partition("#")
        there = (page.parent / file) if file else page
        if not there.exists() or (
            anchor
            and there.suffix == ".md"
            and anchor not in anchors(there.read_text(encoding="utf-8"))
        ):
            found.append(target)
    return found


def run(page: Path) -> dict[str, Any]:
    """Execute the Python blocks of a page one after the other; what they define."""
    space: dict[str, Any] = {"__name__": "__main__"}
    for line, text in blocks(page.read_text(encoding="utf-8")):
        # Padded, so that a traceback points at the line of the page.
        exec(compile("\n" * (line - 1) + text, str(page), "exec"), space)
    return space


@pytest.mark.parametrize(
    "page",
    [p for p in PAGES if blocks(p.read_text(encoding="utf-8"))],
    ids=lambda p: p.relative_to(ROOT).as_posix(),
)
def test_python_blocks_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    run(page)


def test_readme_example_is_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its stiffness is scikit-fem's, and its answer obeys statics and the law."""
    monkeypatch.chdir(tmp_path)
    space = run(ROOT / "README.md")
    n, K, result = space["n"], space["K"], space["result"]
    mesh = skfem.MeshQuad.init_tensor(*2 * [np.linspace(0, 1, n + 1)])
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad1()), intorder=2)
    reference = linear_elasticity(space["lam"], space["G"]).assemble(basis)
    # Its numbers: all u_x row by row from the base up, then all u_y.
    column, row = np.rint(mesh.p * n).astype(int)
    node = row * (n + 1) + column
    ours = np.empty(reference.shape[0], dtype=int)
    ours[basis.nodal_dofs] = [node, node + node.size]
    # Sums of few terms of the size of the largest: a few units of rounding.
    assert abs(K.tocsr()[ours][:, ours] - reference).max() <= 1e-14 * abs(K).max()

    assert result.success
    u, r = result.displacement[1], result.reaction[1].ravel()
    out_of_balance = K @ u - space["B"].T @ r
    out_of_balance[space["top"]] = 0.0  # the support's reactions
    # A backward stable solve leaves a few ε n of the largest stiffness times u.
    size = abs(K).max() * np.abs(u).max()
    assert np.abs(out_of_balance).max() <= 1e-12 * size
    v = result.relative_displacement[1].ravel()
    assert np.abs(space["B"] @ u - v).max() <= 1e-12 * np.abs(u).max()

    force = result.reaction.sum(axis=1)
    # The first step is symmetric; the second is pulled to +x, held back to -x.
    assert force[0, 0] > 0
    assert abs(force[0, 1]) <= 1e-9 * force[0, 0]  # tol = 1e-10 a node, 41 nodes
    assert -0.3 * force[1, 0] < force[1, 1] < 0
    assert {int(s) for s in result.status[1]} == {bp.Status.SLIP, bp.Status.STICK}

    # The file of the second step alone: held to tol, times the condition of W.
    answer = space["answer"]
    assert answer.converged
    size = np.abs(result.reaction[1]).max()
    assert np.abs(answer.reaction - result.reaction[1]).max() <= 1e-7 * size


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_resolve(page: Path) -> None:
    assert broken_links(page) == []


def test_broken_links_are_seen(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# A head: one\n[a](#a-head-one) [b](#two) [c](gone.md) [d](page.md)\n"
        '`[e](gone.md)`\n<img width=3 src="gone.png"> [f](https://example.org)\n'
    )
    assert broken_links(page) == ["#two", "gone.md", "gone.png"]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_commands_exist(page: Path) -> None:
    """`make X` in a document is a target of the Makefile."""
    for target in re.findall(
        r"(?:^|`)make ([a-z-]+)", page.read_text(encoding="utf-8"), re.M
    ):
        done = subprocess.run(
            ["make", "--question", "--always-make", "--dry-run", target],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        assert "No rule" not in done.stderr, done.stderr


def test_a_missing_command_is_seen() -> None:
    done = subprocess.run(
        ["make", "--dry-run", "no-such-target"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "No rule" in done.stderr


def rows(heading: str) -> list[list[str]]:
    """Cells of the table rows below a heading of the README, without its head."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = text.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_accuracy_is_what_the_readme_says() -> None:
    """Every bound of the table holds, and every case of the script has one."""
    cases = runpy.run_path(str(ROOT / "examples" / "accuracy.py"))["CASES"]
    bounds = {name: float(bound) for name, bound in rows("How right")}
    assert set(bounds) == set(cases)
    found = {name: case() for name, case in cases.items()}
    assert {n: e for n, e in found.items() if not e <= bounds[n]} == {}


def test_benchmarks_of_the_readme_are_measured_ones() -> None:
    """Its rows are copied from the tables of the benches, none retyped."""
    measured = (ROOT / "benches" / "README.md").read_text(encoding="utf-8")
    table = rows("How fast")
    assert table
    for row in table:
        assert "| " + " | ".join(row) + " |" in measured


def test_picture_is_small(repository: Path) -> None:
    picture = repository / "docs" / "sheared_cube.png"
    assert 10_000 < picture.stat().st_size < 300_000
