"""What the documents show works when pasted, and what they point to exists."""

import re
import subprocess
from pathlib import Path

import pytest

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
    space: dict[str, object] = {"__name__": "__main__"}
    for line, text in blocks(page.read_text(encoding="utf-8")):
        # Padded, so that a traceback points at the line of the page.
        exec(compile("\n" * (line - 1) + text, str(page), "exec"), space)


def test_readme_has_a_python_block() -> None:
    assert blocks((ROOT / "README.md").read_text(encoding="utf-8"))


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
