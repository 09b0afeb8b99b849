"""Exit statuses of the command `bipot`."""

from collections.abc import Iterable

SOLVED, NO_ANSWER, BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 1, 2, 3, 130
# A fault of the program itself, EX_SOFTWARE of sysexits.
FAULT = 70


class Ended(Exception):
    """A command that ends with this status and message, which another rank may have found."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


def worst(codes: Iterable[int]) -> int:
    """The exit status of several runs: bad input, then not converged, then no answer."""
    return max(codes, key=(SOLVED, NO_ANSWER, NOT_CONVERGED, BAD_INPUT).index)
