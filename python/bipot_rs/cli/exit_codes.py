"""Exit statuses of the command `bipot`."""

from collections.abc import Iterable

SOLVED, NO_ANSWER, BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 1, 2, 3, 130
# A fault of the program itself, EX_SOFTWARE of sysexits.
FAULT = 70


class Ended(Exception):
    """A command that ends with this status and message."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


def describe_fault(error: BaseException) -> tuple[int, str]:
    """Status and message of an exception that no command expects."""
    text = " ".join(str(error).split())
    return FAULT, (
        f"internal error of bipot, {type(error).__name__}{': ' if text else ''}{text}; "
        "please report it with the traceback that BIPOT_TRACEBACK=1 prints"
    )


def worst(codes: Iterable[int]) -> int:
    """The exit status of several runs: bad input, then not converged, then no answer."""
    return max(codes, key=(SOLVED, NO_ANSWER, NOT_CONVERGED, BAD_INPUT).index)
