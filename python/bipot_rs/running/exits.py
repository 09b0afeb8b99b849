"""Exit statuses of the command `bipot`."""

SOLVED, NO_ANSWER, BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 1, 2, 3, 130
