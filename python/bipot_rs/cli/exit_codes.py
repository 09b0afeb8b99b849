"""Exit statuses of the command `bipot`."""

SOLVED, NO_ANSWER, BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 1, 2, 3, 130
# A fault of the program itself, EX_SOFTWARE of sysexits.
FAULT = 70
