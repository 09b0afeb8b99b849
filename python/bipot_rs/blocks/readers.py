"""Readers of blocks: COMPAS JSON, OBJ, STL, and points in JSON."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bipot_rs._core as _core
from bipot_rs._lib.types import Floats, Ints, Record
from bipot_rs.blocks.block import Block
from bipot_rs.blocks.interfaces import Interface, make_interface


class BlockFile(NamedTuple):
    """What a file says of blocks.

    Attributes
    ----------
    blocks
        The blocks.
    interfaces
        Their interfaces; ``None`` if the file has none.
    keys
        Names of the blocks by the keys of their nodes, where blocks have other names.
    """

    blocks: list[Block]
    interfaces: list[Interface] | None
    keys: Mapping[str, str] = {}


def read(path: str | os.PathLike[str], *, density: float = 1.0) -> BlockFile:
    """Read blocks from a file.

    - ``.json`` of COMPAS: an assembly of blocks, as ``compas.json_dump`` writes it. A block
      has the name of its mesh, or the key of its node; ``is_support`` and interfaces are
      read.
    - ``.json`` with ``{"blocks": [{"name": ..., "points": ..., "faces": ..., "density":
      ..., "support": ...}]}``; all but name and points may be missing.
    - ``.obj``: an object or group (``o``, ``g``) is a block.
    - ``.stl`` and other meshes of triangles and quadrilaterals that meshio reads: each
      connected surface is a block, ``"0"``, ``"1"``.

    Parameters
    ----------
    path
        The file.
    density
        Density of blocks without their own.

    Raises
    ------
    OSError, ValueError
        The file cannot be read or has no blocks, or a block is not closed.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix == ".json":
        try:
            data = json.loads(file.read_text(encoding="utf-8-sig"))
            whole = _read_json(data, density)
        except (UnicodeDecodeError, json.JSONDecodeError) as error:
            raise ValueError(f"{file} is not JSON: {error}") from None
        except (AttributeError, IndexError, KeyError, TypeError) as error:
            wrong = f"{error} is missing" if isinstance(error, KeyError) else error
            raise ValueError(
                f"{file} has neither an assembly, as compas.json_dump writes it, nor a list "
                f"'blocks': {wrong}"
            ) from None
    elif suffix == ".obj":
        # Comments may have any encoding; a line may continue on the next one.
        text = file.read_text(encoding="utf-8-sig", errors="replace")
        lines = text.replace("\\\n", " ").splitlines()
        whole = BlockFile(_read_obj(file, lines, density), None)
    else:
        whole = BlockFile(_read_surfaces(file, density), None)
    if not whole.blocks:
        raise ValueError(f"{file} has no blocks")
    return whole


def _read_json(data: Record, density: float) -> BlockFile:
    if "blocks" in data:
        return BlockFile(
            [Block(**{"density": density} | b) for b in data["blocks"]], None
        )
    graph = data["data"]["graph"]["data"]
    nodes = {key: node for key, node in graph["node"].items() if node.get("block")}
    meshes = {key: node["block"]["data"] for key, node in nodes.items()}
    titles = [(mesh.get("attributes") or {}).get("name") for mesh in meshes.values()]
    # Names of meshes that do not tell the blocks apart give way to the keys of the nodes.
    named = len(set(titles)) == len(titles) and all(titles)
    blocks = []
    for title, (key, mesh) in zip(titles, meshes.items(), strict=True):
        place = {vertex: k for k, vertex in enumerate(mesh["vertex"])}
        points = [[v["x"], v["y"], v["z"]] for v in mesh["vertex"].values()]
        faces = [[place[str(v)] for v in face] for face in mesh["face"].values()]
        blocks.append(
            Block(
                str(title) if named else key,
                points,
                faces,
                density=density,
                support=bool(nodes[key].get("is_support")),
            )
        )
    number = {key: k for k, key in enumerate(nodes)}
    stored = [
        make_interface(blocks, number[u], number[v], shared["data"]["points"])
        for u, ends in graph["edge"].items()
        for v, edge in ends.items()
        for shared in edge.get("interfaces") or []
    ]
    keys = {key: block.name for key, block in zip(nodes, blocks, strict=True)}
    return BlockFile(blocks, stored or None, keys if named else {})


def _read_obj(file: Path, lines: Sequence[str], density: float) -> list[Block]:
    points: list[list[float]] = []
    faces: dict[str, list[list[int]]] = {}
    name = "0"
    for number, line in enumerate(lines, 1):
        word, *values = line.split() or [""]
        try:
            if word in ("o", "g"):
                name = " ".join(values) or name
                if word == "o" and name in faces:
                    raise ValueError("another object has this name")
            elif word == "v":
                x, y, z = map(float, values[:3])
                points.append([x, y, z])
            elif word == "f":
                # Numbers count from 1, or from the last corner if they are negative.
                corners = [int(value.split("/")[0]) for value in values]
                face = [k - 1 if k > 0 else len(points) + k for k in corners]
                faces.setdefault(name, []).append(face)
        except ValueError as error:
            raise ValueError(
                f"{file} cannot be read at line {number}, {line!r}: {error}"
            ) from None
    whole = np.array(points).reshape(-1, 3)
    return [_take_part(name, whole, part, density) for name, part in faces.items()]


def _read_surfaces(file: Path, density: float) -> list[Block]:
    from bipot_rs.mesh.readers import read_cells

    points, cells = read_cells(file)
    corners, joined = np.unique(points + 0.0, axis=0, return_inverse=True)
    faces = [
        joined.ravel()[face]
        for kind, rows in cells
        if kind in ("triangle", "quad", "polygon")
        for face in rows
    ]
    if not faces:
        return []
    start = np.concatenate(faces)
    end = np.concatenate([np.roll(face, -1) for face in faces])
    label = _core.connected(len(corners), start, end)
    parts: dict[int, list[Ints]] = {}
    for face in faces:
        parts.setdefault(int(label[face[0]]), []).append(face)
    return [
        _take_part(str(k), corners, part, density)
        for k, part in enumerate(parts.values())
    ]


def _take_part(
    name: str, points: Floats, faces: Sequence[Sequence[int] | Ints], density: float
) -> Block:
    """A block with the corners of its own faces."""
    used, local = np.unique(np.concatenate(faces), return_inverse=True)
    if used[-1] >= len(points) or used[0] < 0:
        raise ValueError(
            f"a face of block {name!r} has a corner that is not in the file"
        )
    bounds = np.cumsum([len(face) for face in faces])[:-1]
    return Block(name, points[used], np.split(local, bounds), density=density)
