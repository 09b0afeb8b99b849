"""Errors that all ranks raise together.

A rank that raised alone would leave the others waiting in their next message.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from bipot_rs._lib.types import Communicator

T = TypeVar("T")


def do_together(comm: Communicator, work: Callable[[], T]) -> T:
    """Do some work on this rank, which sends no messages; raise on all ranks or on none.

    If it fails on several ranks, all of them raise the error of the first one.
    """
    made, error = None, None
    try:
        made = work()
    except Exception as failed:  # noqa: BLE001 - raised again, by all ranks
        error = failed
    first = min(comm.allgather(comm.size if error is None else comm.rank))
    if first == comm.size:
        return made  # type: ignore[return-value]
    raise comm.bcast(_make_sendable(error), root=first) or RuntimeError


def _make_sendable(error: Exception | None) -> Exception | None:
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301 - an error of this process
    except Exception:  # noqa: BLE001 - whatever a foreign exception cannot do
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def check_same(comm: Communicator, **arrays: ArrayLike | None) -> None:
    """Raise ``ValueError`` if an array differs between ranks: contact data must not."""
    for name, array in arrays.items():
        value = b"" if array is None else np.ascontiguousarray(array).tobytes()
        shape = None if array is None else np.shape(array)
        digest = hashlib.sha256(value).hexdigest(), shape
        if len(set(comm.allgather(digest))) > 1:
            raise ValueError(
                f"{name} differs between ranks: contacts are the same on every rank, and "
                f"{name} holds all of them"
            )
