"""What all arguments with numbers have in common."""

import numpy as np
import pytest

from bipot_rs import _core
from bipot_rs._lib.validation import floats


@pytest.mark.parametrize("wrong", [np.nan, -0.5, 1.5, np.inf, -np.inf])
def test_the_first_number_outside_a_range_is_found(wrong: float) -> None:
    """Also at the ends of the parts of 256 numbers that are compared at once."""
    for length in (1, 255, 256, 257, 600):
        values = np.linspace(0.0, 1.0, length)
        assert _core.find_outside(values, 0.0, 1.0) is None
        for at in {0, length // 2, length - 1, min(256, length - 1)}:
            changed = values.copy()
            changed[at] = changed[-1] = wrong
            assert _core.find_outside(changed, 0.0, 1.0) == at


def test_an_array_of_doubles_is_not_copied_where_it_need_not_be() -> None:
    plain = np.arange(6.0).reshape(2, 3)
    assert floats("x", plain, copy=False) is plain
    assert floats("x", plain) is not plain
    for other in (plain.T, plain[:, ::2], plain.astype(int), plain.astype(">f8")):
        taken = floats("x", other, copy=False)
        assert taken.flags.c_contiguous
        assert taken.dtype == np.float64
        assert np.array_equal(taken, other)


def test_numbers_beyond_doubles_are_refused() -> None:
    with pytest.raises(ValueError, match="x is inf at 1, expected finite numbers"):
        floats("x", np.array([1, "1e4000"], dtype=np.longdouble))
