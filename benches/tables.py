"""Tables of a Markdown page that a program writes: what stands between two markers.

    <!-- NAME, written by PROGRAM -->
    | … |
    <!-- end of NAME -->

Everything outside is left as it is, to the byte.
"""

import re
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in rows:
        if len(row) != len(head):
            raise ValueError(f"{len(row)} cells below a head of {len(head)}: {row}")
        lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines)


def replaced(page: str, name: str, text: str) -> str:
    """The page with ``text`` between the markers of ``name``, which must be there once."""
    begin = rf"<!-- {re.escape(name)}, written by [^>]* -->\n"
    end = f"<!-- end of {name} -->"
    pattern = re.compile(rf"({begin}).*?({re.escape(end)})", re.DOTALL)
    if len(pattern.findall(page)) != 1 or page.count(end) != 1:
        raise ValueError(f"markers of {name}: there must be one pair")
    return pattern.sub(lambda m: m[1] + text.strip("\n") + "\n" + m[2], page)


def rewrite(path: Path, name: str, text: str) -> None:
    """Replace a table of a file; the file is the old one or the new one, never half."""
    page = replaced(path.read_text(encoding="utf-8"), name, text)
    new = path.with_suffix(".new")
    new.write_text(page, encoding="utf-8")
    new.replace(path)


def folder(quick: bool) -> Path:
    """Where pages and sheets are written: here, or a copy for a quick look."""
    if not quick:
        return HERE
    copy = HERE.parent / "out" / "bench"
    copy.mkdir(parents=True, exist_ok=True)
    page, own = HERE / "README.md", copy / "README.md"
    # Copied anew when the page has changed, for its markers may have.
    if not own.exists() or own.stat().st_mtime < page.stat().st_mtime:
        shutil.copy(page, own)
    return copy


def figures(x: float | None) -> str:
    """Three figures, without an exponent from 1e-3 to 1e6."""
    if x is None:
        return ""
    if x == 0 or not 1e-3 <= abs(x) < 1e6:
        return f"{x:.3g}"
    return f"{float(f'{x:.3g}'):,.10g}"
