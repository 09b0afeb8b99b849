"""Records of arrays: a repr that fits a screen, and copies."""

from __future__ import annotations

from collections.abc import Container
from copy import deepcopy
from dataclasses import fields
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


# Arrays up to this size are shown with their numbers.
_FEW = 6
# Longest line, and longest text of one value.
_LINE, _WIDE = 88, 78


def short_repr(self: DataclassInstance) -> str:
    """``__repr__`` of a dataclass, in lines of at most 88 characters.

    >>> import dataclasses
    >>> @dataclasses.dataclass
    ... class Found:
    ...     x: object
    ...     gap: object
    ...     __repr__ = short_repr
    >>> Found(np.zeros((40, 3)), np.zeros(2))
    Found(x=array (40, 3), gap=array([0., 0.]))
    """
    lines = [f"{type(self).__name__}("]
    shown = [attribute.name for attribute in fields(self) if attribute.repr]
    for k, name in enumerate(shown):
        end = ")" if k == len(shown) - 1 else ", "
        item = f"{name}={_short(getattr(self, name))}{end}"
        if len(lines[-1]) + len(item.rstrip()) > _LINE and lines[-1].strip():
            lines.append("  ")
        lines[-1] += item
    return "\n".join(line.rstrip() for line in lines)


def _short(value: object) -> str:
    if isinstance(value, np.ndarray) and value.size > _FEW:
        return f"array {value.shape}"
    if hasattr(value, "nnz") and hasattr(value, "shape"):
        return f"sparse {value.shape}, {value.nnz} entries"
    if isinstance(value, tuple | list) and value:
        inner = ", ".join(_short(entry) for entry in value)
        text = f"({inner})" if isinstance(value, tuple) else f"[{inner}]"
        kind = type(value[0]).__name__
        return text if _fits(text) else f"{len(value)} × {kind}"
    text = repr(value)
    if isinstance(value, str) and not _fits(text):
        return f"{text[: _WIDE - 2]}…{text[-1]}"
    return text if _fits(text) else f"{type(value).__name__}(…)"


def _fits(text: str) -> bool:
    return len(text) <= _WIDE and "\n" not in text


T = TypeVar("T")


def copy_sharing(original: T) -> T:
    """A shallow copy with all attributes, also those that a pickle leaves out."""
    twin = object.__new__(type(original))
    twin.__dict__.update(original.__dict__)
    return twin


def deepcopy_sharing(original: T, memo: dict[int, object], shared: Container[str]) -> T:
    """A deep copy which has the attributes ``shared`` themselves, not copies of them."""
    twin = copy_sharing(original)
    memo[id(original)] = twin
    for name, value in original.__dict__.items():
        if name not in shared:
            twin.__dict__[name] = deepcopy(value, memo)
    return twin
