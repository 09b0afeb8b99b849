"""Copies of results: of their numbers, with the same problem behind them."""

from __future__ import annotations

from collections.abc import Container
from copy import deepcopy
from typing import Any, TypeVar

T = TypeVar("T")


def copy_sharing(original: T) -> T:
    """A shallow copy with all attributes, also those that a pickle leaves out."""
    twin = object.__new__(type(original))
    twin.__dict__.update(original.__dict__)
    return twin


def deepcopy_sharing(original: T, memo: dict[int, Any], shared: Container[str]) -> T:
    """A deep copy which has the attributes ``shared`` themselves, not copies of them."""
    twin = copy_sharing(original)
    memo[id(original)] = twin
    for name, value in original.__dict__.items():
        if name not in shared:
            twin.__dict__[name] = deepcopy(value, memo)
    return twin
