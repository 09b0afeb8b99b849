"""Draw the layers of the package and what each uses: `python docs/draw_architecture.py`.

The order comes from the contract in pyproject.toml, the text beside a name from the first
line of the layer's docstring. The width of an arrow grows with the number of imports.
"""

import ast
import tomllib
from collections import Counter
from functools import cache
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "python" / "bipot_rs"
PICTURE = ROOT / "docs" / "architecture.svg"
BOX, ROW, LEFT, WIDE = 30, 42, 10, 560


def layers() -> list[str]:
    """Names from the top, which may use all others, to the bottom, which uses none."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (contract,) = (
        contract
        for contract in settings["tool"]["importlinter"]["contracts"]
        if contract["type"] == "layers" and contract["containers"] == ["bipot_rs"]
    )
    return [name for name in contract["layers"] if not name.startswith("__")]


@cache
def imports(text: str) -> list[tuple[str, list[str]]]:
    """Module and names of each import, those within functions included."""
    found: list[tuple[str, list[str]]] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found += ((alias.name, []) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            found.append((node.module or "", [alias.name for alias in node.names]))
    return found


def arrows(layers: list[str]) -> Counter[tuple[str, str]]:
    """Number of imports that each layer makes from each other one."""
    arrows_of_layers: Counter[tuple[str, str]] = Counter()
    for file in PACKAGE.rglob("*.py"):
        user = file.relative_to(PACKAGE).with_suffix("").parts[0]
        for module, names in imports(file.read_text(encoding="utf-8")):
            package, *path = module.split(".")
            used = (path[:1] or names) if package == "bipot_rs" else []
            both = [(user, name) for name in used if name != user]
            arrows_of_layers.update(pair for pair in both if set(pair) <= set(layers))
    return arrows_of_layers


def sentence(name: str) -> str:
    """The first line of the docstring of a layer."""
    file = PACKAGE / name / "__init__.py"
    file = file if file.exists() else PACKAGE / f"{name}.py"
    return (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").split(
        "\n"
    )[0]


def picture() -> str:
    """SVG text: a box for each layer, an arc from a layer to each that it uses."""
    names = layers()
    top = {name: LEFT + ROW * row for row, name in enumerate(names)}
    counts = sorted(arrows(names).items())
    # The longest arc spans all rows; it is the widest.
    size = (LEFT + WIDE + 30 + 12 * len(names) + 20, 2 * LEFT + ROW * len(names) - 12)
    box = f'viewBox="0 0 {size[0]} {size[1]}" width="{size[0]}" height="{size[1]}"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {box} font-family="sans-serif">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for (user, used), count in counts:
        start, end = top[user] + BOX / 2 + 5, top[used] + BOX / 2 - 5
        out = LEFT + WIDE + 16 + 16 * abs(end - start) / ROW
        width = 0.6 + 0.35 * min(count, 12) ** 0.5
        lines.append(
            f'<path d="M{LEFT + WIDE},{start:g} C{out:g},{start:g} {out:g},{end:g} '
            f'{LEFT + WIDE + 6},{end:g}" fill="none" stroke="#8a8a8a" '
            f'stroke-width="{width:.2f}"><title>{user} uses {used}: {count} imports'
            "</title></path>"
        )
    for used in sorted({used for (_, used), _ in counts}):
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
