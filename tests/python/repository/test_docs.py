"""Examples in the documents work when pasted, and their links lead to existing targets."""

import contextlib
import doctest
import importlib
import io
import os
import re
import runpy
import shutil
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bipot_rs as bp
from bipot_rs import fem
from bipot_rs.cli.entry import call
from bipot_rs.scene.schema.root import Scene
from support.places import ROOT

PAGES = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("*/README.md")]
)
MESHES = sorted(
    path
    for suffix in ("msh", "inp", "json")
    for path in ROOT.glob(f"docs/**/*.{suffix}")
)
BLOCK = re.compile(
    r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", re.MULTILINE | re.DOTALL
)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)|<img[^>]* src=\"([^\"]+)\"")


def same(printed: str, shown: str) -> bool:
    """Whether words agree, and numbers to the digits that are shown.

    Two units in the last place are allowed: half a unit for the rounding of the shown digits,
    the rest for machines that add in another order. ``...`` stands for any text.
    """
    number = f"({NUMBER.pattern})"
    # Words and numbers in turn, words first.
    parts = re.split(number, " ".join(shown.split()))
    pattern = "".join(number if n % 2 else _words(p) for n, p in enumerate(parts))
    match = re.fullmatch(pattern, " ".join(printed.split()), re.DOTALL)
    return match is not None and all(
        abs(Decimal(there) - Decimal(here)) <= 2 * _unit(here)
        for there, here in zip(match.groups(), parts[1::2], strict=True)
    )


def _unit(number: str) -> Decimal:
    """One unit in the last place of a number as shown; a whole number is exact."""
    last = Decimal(number).as_tuple().exponent
    return Decimal(10) ** last if re.search(r"[.e]", number.lower()) else Decimal(0)


def _words(part: str) -> str:
    # Exactly three dots; a longer row of dots is part of the output.
    split = re.split(r"(?<!\.)(\.{3})(?!\.)", part)
    return "".join(".*" if word == "..." else re.escape(word) for word in split)


def anchors(text: str) -> set[str]:
    """Names by which headings can be linked."""
    heads = re.findall(r"^#+ +(.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in heads}


def broken_links(page: Path) -> list[str]:
    """Links of a page to missing files, or to missing headings of the page itself."""
    text = page.read_text(encoding="utf-8")
    prose = re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)
    broken = []
    for match in LINK.finditer(prose):
        target = match[1] or match[2]
        if re.match(r"[a-z]+:", target):
            continue  # # web links are not checked, because servers are not always reachable
        file, _, anchor = target.partition("#")
        there = (page.parent / file) if file else page
        if not there.exists() or (
            anchor
            and there.suffix == ".md"
            and anchor not in anchors(there.read_text(encoding="utf-8"))
        ):
            broken.append(target)
    return broken


def run(page: Path) -> dict[str, Any]:
    """Execute the Python blocks of a page in order; return the names they define."""
    text, space = page.read_text(encoding="utf-8"), {"__name__": "__main__"}
    for block in BLOCK.finditer(text):
        # Padded, so that a traceback shows the line of the page.
        line = text.count("\n", 0, block.start(1))
        code = compile("\n" * line + block[1], str(page), "exec")
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(code, space)
        told, shown = printed.getvalue(), block[2]
        assert shown is None or same(told, shown), f"line {line + 1}: {told}"
    return space


def with_meshes(page: Path, folder: Path) -> None:
    """Meshes that pages read, placed where a reader in the folder of the page has them."""
    for mesh in MESHES:
        there = Path(os.path.normpath(folder / os.path.relpath(mesh, page.parent)))
        if there.is_relative_to(folder):
            there.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(mesh, there)


SLOW = [
    *("*-error.md", "*-gmsh.md", "*model.md*", "*-3d.md", "*-results.md", "*-study.md"),
    *("*body.md*", "*-and-contact.md", "*-deck.md", "*-arch.md", "docs/masonry.md"),
    *("docs/collection.md", "docs/gallery.md", "docs/published.md"),
    *(
        f"docs/tutorials/{name}.md"
        for name in (
            *("bolted-lap-joint", "compas-assembly", "fretting", "identification"),
            *("punch_shape", "sensitivities", "uncertainty", "wear"),
        )
    ),
]


@pytest.mark.parametrize(
    "page",
    [p for p in PAGES if BLOCK.search(p.read_text(encoding="utf-8"))],
    ids=lambda p: p.relative_to(ROOT).as_posix(),
)
@pytest.mark.slow_variants(*SLOW)
def test_python_blocks_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_meshes(page, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    run(page)


SCENES = [
    (page, text)
    for page in PAGES
    for text in re.findall(r"^```toml\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)
]


@pytest.mark.parametrize(
    ("page", "scene"), SCENES, ids=[page.stem for page, _ in SCENES]
)
def test_scenes_of_pages_are_solved(page: Path, scene: str, tmp_path: Path) -> None:
    file = tmp_path / f"{page.stem}.toml"
    file.write_text(scene, encoding="utf-8")
    settings = ["--set", "mesh.n=4", "--set", "contact.0.mu=0.2"]
    words = ["run", str(file), *settings, "--out", str(tmp_path / "out")]
    assert call(words) in (0, None)
    result = bp.load(tmp_path / "out" / "result.h5")
    assert result.success
    assert bp.Status.SLIP in result.status[-1]


def test_readme_examples_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The model and the arrays made from its stiffness: the same problem to rounding."""
    monkeypatch.chdir(tmp_path)
    space = run(ROOT / "README.md")
    model, arrays = space["result"].reaction, space["same"].reaction
    # The two orders of elimination round apart, at a condition of K of 1e4.
    assert np.abs(arrays - model).max() <= 1e-11 * np.abs(model).max()
    assert model[1, :, 1].sum() < 0 < model[:, :, 0].sum()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["inclined_crack", "depleting_reservoir"])
def test_programs_print_what_a_page_shows(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"))["main"]()
    page = (ROOT / "docs" / "faults.md").read_text("utf-8")
    shown = re.findall(r"^```text\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    printed = capsys.readouterr().out
    assert any(same(printed, text) for text in shown), printed


EXCERPT = re.compile(r"^```py\n(.*?)^```", re.MULTILINE | re.DOTALL)


def test_excerpts_of_examples_are_verbatim() -> None:
    """Blocks that need a program which may be missing here are lines of an example."""
    excerpts = 0
    for page in PAGES:
        text = page.read_text("utf-8")
        names = re.findall(r"\((?:\.\./)*(examples/\w+\.py)\)", text)
        sources = [(ROOT / name).read_text("utf-8") for name in names]
        for excerpt in EXCERPT.findall(text):
            assert any(excerpt in source for source in sources), f"{page}: {excerpt}"
            excerpts += 1
    assert excerpts >= 6


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_resolve(page: Path) -> None:
    assert broken_links(page) == []


def test_every_key_of_a_scene_is_on_its_page() -> None:
    page = (ROOT / "docs" / "scenes.md").read_text("utf-8")
    scene = Scene.model_json_schema(by_alias=True)
    tables = (scene, *scene["$defs"].values())
    keys = {key for table in tables for key in table.get("properties", {})}
    # A list is written in their place: grid points of an axis, factors of an amplitude.
    keys -= {"points", "table"}
    # In fenced and indented blocks, and between backticks.
    fenced = re.compile(r"^```.*?^```|^ {4}[^\n]*", re.MULTILINE | re.DOTALL)
    code = [*fenced.findall(page), *re.findall("`[^`]+`", fenced.sub("", page))]
    absent = keys - set(re.findall(r"\w+", " ".join(code)))
    assert not absent, f"docs/scenes.md does not say what they do: {sorted(absent)}"


def test_every_public_name_is_in_the_reference() -> None:
    """Each is documented on one page, and listed on the first page of the reference."""
    pages = {p.stem: p.read_text("utf-8") for p in (ROOT / "docs/api").glob("*.md")}
    index = pages.pop("index")
    rest = "\n".join(pages.values())
    documented = re.findall(r"auto(?:class|function|exception):: (\S+)", rest)
    for name in set(bp.__all__) - {"fclib", "plots"}:
        assert documented.count(name) == 1, name
        assert re.search(rf"^   {name}$", index, re.MULTILINE), name
    assert "automodule:: bipot_rs.fclib" in rest
    # Names of modules that are not loaded with the package need a place too, unless the page
    # documents the whole module.
    assert re.search(r"automodule:: bipot_rs.obstacle\n```", rest)
    for module in (fem, bp.plots):
        names = set(module.__all__) - {"FACES"}
        (page,) = (
            text
            for text in pages.values()
            if f"automodule:: {module.__name__}\n" in text
        )
        assert names <= set(re.findall(r"auto(?:class|function):: (\S+)", page))


# Those of the last row must have examples.
EXAMPLES = (
    *("_lib.machine", "contact.errors", "contact.global_problem", "contact.reduced"),
    *("contact.proof.existence", "fclib", "plots.style"),
    *("contact.results.error_bound", "contact.results.result", "obstacle.motion"),
    *("contact.results.solution", "contact.results.state"),
    *("contact.law.contact_law", "contact.one_call", "contact.problem"),
)


@pytest.mark.parametrize("module", EXAMPLES)
def test_examples_of_docstrings(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = doctest.testmod(importlib.import_module(f"bipot_rs.{module}"))
    assert outcome.failed == 0
    assert outcome.attempted or module not in EXAMPLES[-3:]


def rows(heading: str) -> list[list[str]]:
    """Cells of the table rows below a heading of the README, without the header."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = text.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


@pytest.mark.slow
def test_accuracy_is_what_the_readme_says() -> None:
    """Every bound of the table holds, and every case of the script has one."""
    cases = runpy.run_path(str(ROOT / "examples" / "accuracy.py"))["CASES"]
    bounds = {name: float(bound) for name, bound in rows("How right")}
    assert set(bounds) == set(cases)
    errors = {name: case() for name, case in cases.items()}
    assert {n: e for n, e in errors.items() if not e <= bounds[n]} == {}
