"""Wrong arguments: every rank raises the same error, which names the argument."""

import json
import re

import numpy as np
import pytest

from support import mpi
from support.pressed_in_space import arrays

pytestmark = pytest.mark.xdist_group("ranks")
EXPECTED = {
    "gap": "ValueError: gap has 15 contacts and B 48 rows",
    "gap differs": "ValueError: gap differs between ranks",
    "mu": "ValueError: mu of contact 0 is -0.3",
    "fixed": "ValueError: fixed holds 192 at position 0",
    "area": "ValueError: area of contact 0 is 0.0",
    "gather": "ValueError: gather is -1, expected",
    "gather differs": "ValueError: gather differs between ranks",
    "coordinates": r"ValueError: coordinates has shape \(.*\), expected .* each degree",
    "coordinates, last": "ValueError: coordinates is inf at",
    "coordinates of a node": "ValueError: coordinates differ within 3",
    "coordinates, some": "ValueError: coordinates are given on some ranks only",
    "K is no Mat": "TypeError: K is a ndarray, expected a Mat",
    "K asymmetric": "ValueError: stiffness K is not symmetric at row",
    "K not finite": "ValueError: K is not finite at row 191, column 191: NaN",
    "supports": "NotIterativeError: .*free to move",
    "load": "ValueError: load of step 1 has 3 rows on rank 0",
    "load, an array": "TypeError: load of step 1 is a ndarray, expected a Vec",
    "load, infinite": "ValueError: load of step 1 is not finite",
    "prescribed": "ValueError: prescribed has shape",
    "prescribed differs": "ValueError: prescribed differs between ranks",
    "tol": "ValueError: tol is -1",
    "max_iterations": "NotConvergedError: load step 1",
    "on_step": "TypeError: on_step is 3",
    "start": "TypeError: start is",
}


def test_the_argument_is_named_on_every_rank() -> None:
    known, prescribed = arrays(3)
    told = mpi.run(2, "errors", **known, prescribed=prescribed)
    said = json.loads(str(told["said"]))
    assert said.keys() == EXPECTED.keys()
    assert {k: v for k, v in said.items() if not re.match(EXPECTED[k], v)} == {}


def test_a_path_in_two_parts_and_contacts_as_a_matrix_of_petsc() -> None:
    known, prescribed = arrays(4)
    given = known | {"prescribed": prescribed}
    parallel = mpi.run(2, "path", **given)
    # The second part starts from the same state and displacements, to the bit.
    assert np.array_equal(parallel["whole"], parallel["parts"])
    assert np.array_equal(parallel["slip"], parallel["slip_parts"])
    petsc = mpi.run(2, "with_matrix", **given)
    assert np.array_equal(parallel["whole"], petsc["reaction"])
