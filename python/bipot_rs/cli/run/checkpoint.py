"""Load steps of a run on several ranks, kept on disk while it runs.

A rank that is killed takes the others with it, at any time: the launcher leaves them a
second or none. The complete load steps must therefore be in a file already.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from time import perf_counter

from bipot_rs.cli.run.output_files import Output
from bipot_rs.cli.run.output_folder import RESULT

# The file has all load steps and is written anew after each, unless that has taken this
# share of the time of the run so far; these first seconds are always granted.
_SHARE, _GRANTED = 0.05, 1.0


class Checkpoint:
    """A result file that is replaced after each load step.

    Parameters
    ----------
    draft
        Folder in which the file is prepared.
    path
        The file.
    attributes
        Attributes of the file.
    """

    def __init__(
        self, draft: Path, path: Path, attributes: Mapping[str, object]
    ) -> None:
        self.draft, self.path = draft, path
        self._attributes = attributes
        self._began = perf_counter()
        self._spent = 0.0
        # Load steps in the file.
        self.steps = 0

    def save(self, out: Output, *, always: bool = False) -> None:
        """Write the load steps reached, if that does not take too much of the time.

        Raises
        ------
        OSError
            The file cannot be written; an earlier one is unchanged.
        """
        began = perf_counter()
        limit = _GRANTED + _SHARE * (began - self._began)
        if len(out.reached) == self.steps or (self._spent > limit and not always):
            return
        out.result(complete=False, attributes=self._attributes)
        (self.draft / RESULT).replace(self.path)
        self.steps = len(out.reached)
        self._spent += perf_counter() - began
