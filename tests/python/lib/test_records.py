"""The shared methods of frozen dataclasses: as those of the standard library."""

import copy
import dataclasses
import pickle
from dataclasses import FrozenInstanceError, field

import numpy as np
import pytest

from bipot_rs._lib.records import dataclass


class _Body:
    """Fields of the two classes that are compared."""

    a: float
    b: list[int] = field(default_factory=list, hash=False)
    c: int = field(default=3, compare=False)
    d: str = field(default="d", repr=False)


def _made(decorator, **options):
    fields = {**vars(_Body), "__annotations__": dict(_Body.__annotations__)}
    for name in ("__dict__", "__weakref__"):
        fields.pop(name, None)
    return decorator(frozen=True, **options)(type("Point", (), fields))


OURS, STANDARD = (_made(one) for one in (dataclass, dataclasses.dataclass))


@dataclass(frozen=True)
class Place:
    x: float
    y: float = 0.0

    @property
    def norm(self) -> float:
        return float(np.hypot(self.x, self.y))


@dataclass(frozen=True)
class Named(Place):
    name: str = ""


@dataclass(frozen=True, eq=False)
class Arrays:
    x: np.ndarray

    def __repr__(self) -> str:
        return "arrays"


@pytest.mark.parametrize(
    ("first", "second"),
    [((1.0,), (1.0,)), ((1.0, [2]), (1.0, [3])), ((1.0, [2], 4), (1.0, [2], 5))],
)
def test_equality_hash_and_text_are_those_of_the_standard_library(
    first: tuple, second: tuple
) -> None:
    ours, standard = ([made(*first), made(*second)] for made in (OURS, STANDARD))
    assert (ours[0] == ours[1]) is (standard[0] == standard[1])
    for mine, its in zip(ours, standard, strict=True):
        assert repr(mine) == repr(its)
        assert hash(mine) == hash(its)
        assert mine != its
        assert dataclasses.asdict(mine) == dataclasses.asdict(its)


def test_fields_cannot_be_set_or_deleted() -> None:
    place = Place(1.0)
    with pytest.raises(FrozenInstanceError, match="cannot assign to field 'x'"):
        place.x = 2.0
    with pytest.raises(FrozenInstanceError, match="cannot assign to field 'other'"):
        place.other = 2.0
    with pytest.raises(FrozenInstanceError, match="cannot delete field 'x'"):
        del place.x
    with pytest.raises(FrozenInstanceError):
        place.norm = 2.0
    assert place == Place(1.0)


def test_replaced_copied_and_pickled() -> None:
    named = Named(3.0, 4.0, "n")
    assert named.norm == 5.0
    assert dataclasses.replace(named, x=0.0) == Named(0.0, 4.0, "n")
    assert named != Place(3.0, 4.0)
    for same in (copy.deepcopy(named), pickle.loads(pickle.dumps(named))):
        assert same == named
        with pytest.raises(FrozenInstanceError):
            same.name = "m"


def test_methods_of_the_class_are_kept() -> None:
    arrays = Arrays(np.zeros(2))
    assert repr(arrays) == "arrays"
    assert arrays == arrays
    assert arrays != Arrays(np.zeros(2))
    assert hash(arrays) == object.__hash__(arrays)
