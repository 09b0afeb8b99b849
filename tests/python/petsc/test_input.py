"""Wrong arguments: every rank raises the same error, which names the argument."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from support import mpi
from support.pressed_in_space import arrays

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


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    arrays_of_block, prescribed = arrays(3)
    arguments = arrays_of_block | {"prescribed": prescribed}
    folder = tmp_path_factory.mktemp("errors")
    return dict(json.loads(str(mpi.run(folder, "errors", 2, **arguments)["said"])))


@pytest.mark.parametrize("name", EXPECTED)
def test_the_argument_is_named_on_every_rank(name: str, said: dict[str, str]) -> None:
    assert re.match(EXPECTED[name], said[name]), said[name]


def test_every_wrong_call_is_listed(said: dict[str, str]) -> None:
    assert said.keys() == EXPECTED.keys()


def test_a_path_in_two_parts(tmp_path: Path) -> None:
    arrays_of_block, prescribed = arrays(4)
    parallel = mpi.run(tmp_path, "path", 2, **arrays_of_block, prescribed=prescribed)
    # The second part starts from the same state and displacements, to the bit.
    assert np.array_equal(parallel["whole"], parallel["parts"])
    assert np.array_equal(parallel["slip"], parallel["slip_parts"])


def test_contacts_as_a_matrix_of_petsc(tmp_path: Path) -> None:
    arrays_of_block, prescribed = arrays(4)
    arguments = arrays_of_block | {"prescribed": prescribed}
    scipy, petsc = (
        mpi.run(tmp_path, task, 2, **arguments, tol=1e-12)
        for task in ("solve", "with_matrix")
    )
    assert np.array_equal(scipy["reaction"], petsc["reaction"])
