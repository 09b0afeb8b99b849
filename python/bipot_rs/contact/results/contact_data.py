"""The data of the contacts of a result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from numpy.typing import NDArray

# Names of arguments, and those of the data that they become.
_ARGUMENTS = {"points": "x"}


# The name decides on the type of the entries.
ContactArray: TypeAlias = NDArray[Any]
ContactArrays: TypeAlias = Mapping[str, ContactArray | None]


class ContactData(dict[str, ContactArray | None]):
    """Arrays by name, with the names of the arguments that they came from.

    ``data["points"]`` is ``data["x"]``. The mapping itself has each array once.

    >>> data = ContactData(x=None, mu=None)
    >>> list(data), data["points"] is data["x"]
    (['x', 'mu'], True)
    """

    def __missing__(self, name: str) -> ContactArray | None:
        if name in _ARGUMENTS and _ARGUMENTS[name] in self:
            return self[_ARGUMENTS[name]]
        names = ", ".join(self)
        raise KeyError(f"{name!r}: the contacts have {names}")

    def __repr__(self) -> str:
        shapes = (f"{k}: {None if a is None else a.shape}" for k, a in self.items())
        return f"ContactData({', '.join(shapes)})"

    def get(self, name: str, default: Any = None) -> Any:
        """As of any dictionary."""
        return super().get(name, super().get(_ARGUMENTS.get(name, name), default))
