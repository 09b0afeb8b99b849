"""Draw the layers of the package and what each uses: `python docs/draw_architecture.py`.

The order is that of the contract in pyproject.toml, the sentence of a layer the first line
of its docstring, and the width of an arrow the number of imports.
"""

import ast
import tomllib
from collections import Counter
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "python" / "bipot_rs"
PICTURE = ROOT / "docs" / "architecture.svg"
BOX, ROW, LEFT, WIDE = 30, 42, 10, 560


def layers() -> list[str]:
    """Names from the top, which may use all others, to the bottom."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (contract,) = (
        contract
        for contract in settings["tool"]["importlinter"]["contracts"]
        if contract["type"] == "layers"
    )
    return [name for name in contract["layers"] if not name.startswith("__")]


def arrows(names: list[str]) -> Counter[tuple[str, str]]:
    """How many imports one layer has of another, those within functions included."""
    found: Counter[tuple[str, str]] = Counter()
    for file in PACKAGE.rglob("*.py"):
        user = file.relative_to(PACKAGE).with_suffix("").parts[0]
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                parts = (node.module or "").split(".")
                heads = parts[1:2] or [alias.name for alias in node.names]
                used = [head for head in heads if parts[0] == "bipot_rs"]
            elif isinstance(node, ast.Import):
                paths = [alias.name.split(".") for alias in node.names]
                used = [path[1] for path in paths if path[0] == "bipot_rs" and path[1:]]
            else:
                continue
            both = [(user, name) for name in used if name != user]
            found.update(pair for pair in both if set(pair) <= set(names))
    return found


def sentence(name: str) -> str:
    """The first line of the docstring of a layer."""
    file = PACKAGE / name / "__init__.py"
    file = file if file.exists() else PACKAGE / f"{name}.py"
    return (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").split(
        "\n"
    )[0]


def picture() -> str:
    """The SVG: boxes from top to bottom, an arc from each layer to each that it uses."""
    names = layers()
    top = {name: LEFT + ROW * row for row, name in enumerate(names)}
    found = sorted(arrows(names).items())
    # The longest arc spans all rows; it is the widest.
    size = (LEFT + WIDE + 30 + 12 * len(names) + 20, 2 * LEFT + ROW * len(names) - 12)
    box = f'viewBox="0 0 {size[0]} {size[1]}" width="{size[0]}" height="{size[1]}"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {box} font-family="sans-serif">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for (user, used), count in found:
        start, end = top[user] + BOX / 2 + 5, top[used] + BOX / 2 - 5
        out = LEFT + WIDE + 16 + 16 * (end - start) / ROW
        width = 0.6 + 0.35 * min(count, 12) ** 0.5
        lines.append(
            f'<path d="M{LEFT + WIDE},{start:g} C{out:g},{start:g} {out:g},{end:g} '
            f'{LEFT + WIDE + 6},{end:g}" fill="none" stroke="#8a8a8a" '
            f'stroke-width="{width:.2f}"><title>{user} uses {used}: {count} imports'
            "</title></path>"
        )
    for used in sorted({used for (_, used), _ in found}):
        y = top[used] + BOX / 2 - 5
        lines.append(f'<path d="M{LEFT + WIDE},{y:g} l8,-3 v6 z" fill="#8a8a8a"/>')
    for name, y in top.items():
        lines.append(
            f'<rect x="{LEFT}" y="{y}" width="{WIDE}" height="{BOX}" rx="4" '
            'fill="#eef3f8" stroke="#4a6a8a"/>'
            f'<text x="{LEFT + 8}" y="{y + 19}" font-size="13" font-weight="bold">{name}'
            f'</text><text x="{LEFT + 118}" y="{y + 19}" font-size="11">'
            f"{escape(sentence(name))}</text>"
        )
    return "\n".join([*lines, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
