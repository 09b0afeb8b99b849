"""Frozen dataclasses that share their methods.

`dataclasses.dataclass` compiles six functions from text for each frozen class. That takes
longer than everything else in an import: a tenth of the time of a small run. Here only
``__init__`` is compiled; the other methods are the same functions for all classes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:
    import dataclasses
    from reprlib import recursive_repr

    def dataclass(cls=None, /, *, frozen=False, eq=True, repr=True, **options):  # noqa: A002
        """As `dataclasses.dataclass`; a frozen class sets each field once, in ``__init__``.

        Equality, hash, representation and `dataclasses.FrozenInstanceError` are those of
        the standard library. A subclass of a frozen class also takes this decorator.
        """

        def wrap(cls):
            if not frozen:
                return dataclasses.dataclass(eq=eq, repr=repr, **options)(cls)
            methods = {"__setattr__": _set_once, "__delattr__": _refuse}
            if eq:
                methods |= {"__eq__": _equal, "__hash__": _hash}
            if repr:
                methods["__repr__"] = _represent
            own = {name for name in methods if name in vars(cls)}
            made = dataclasses.dataclass(eq=False, repr=False, **options)(cls)
            for name, method in methods.items():
                if name not in own:
                    setattr(made, name, method)
            return made

        return wrap if cls is None else wrap(cls)

    def _values(record, use):
        """Values of the fields for which ``use`` holds."""
        return tuple(
            getattr(record, f.name) for f in dataclasses.fields(record) if use(f)
        )

    def _set_once(self, name, value):
        if name in vars(self) or name not in self.__dataclass_fields__:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        vars(self)[name] = value

    def _refuse(_, name):
        raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")

    def _equal(self, other):
        if other.__class__ is not self.__class__:
            return NotImplemented
        mine, its = (_values(one, lambda f: f.compare) for one in (self, other))
        return mine == its

    def _hash(self):
        return hash(_values(self, lambda f: f.compare if f.hash is None else f.hash))

    @recursive_repr()
    def _represent(self):
        shown = ", ".join(
            f"{f.name}={getattr(self, f.name)!r}"
            for f in dataclasses.fields(self)
            if f.repr
        )
        return f"{type(self).__qualname__}({shown})"
