"""The states of a contact, and the ways in which a solve ends."""

from enum import IntEnum, StrEnum


class Status(IntEnum):
    """State of a contact. Arrays of statuses have the type ``int8``."""

    OPEN = 0
    SLIP = 1
    STICK = 2


# "open", "slip", "stick": the name of status k is STATUS_NAMES[k].
STATUS_NAMES = tuple(status.name.lower() for status in Status)


class Outcome(StrEnum):
    """Why a solver stopped. The value is the word in results and files."""

    CONVERGED = "converged"
    STALLED = "stalled"
    ITERATION_LIMIT = "iteration_limit"
    TIME_LIMIT = "time_limit"
    NO_EQUILIBRIUM = "no_equilibrium"
