"""The oracle agrees with closed forms, and its two algorithms agree with each other."""

import csv

import numpy as np
import pytest

from support.conditions import violation
from support.oracle import Problem, answers
from support.places import REFERENCE

DATA = REFERENCE


def test_each_violation_is_found() -> None:
    r, v = np.array([[1.0, -0.5]]), np.array([[0.0, 2.0]])
    assert violation(r, v, 0.5) == 0
    for wrong_r, wrong_v in [
        (-r, v),  # tension
        (r, np.array([[-1.0, 2.0]])),  # penetration
        (r, np.array([[1.0, 2.0]])),  # force at a distance
        (np.array([[1.0, -0.6]]), v),  # # outside the cone
        (np.array([[1.0, -0.4]]), v),  # slip below the limit
        (np.array([[1.0, 0.5]]), v),  # slip along the force
    ]:
        assert violation(wrong_r, wrong_v, 0.5) > 0.04
    turned = np.array([[0.0, 1.0, 1.0]])  # slip not opposite to the reaction
    assert violation(np.array([[1.0, -0.5, 0.0]]), turned, 0.5) > 0.04


def test_enumeration_finds_every_listed_branch() -> None:
    listed: dict[tuple[float, float], list[list[float]]] = {}
    with (DATA / "one_contact_branches.csv").open() as file:
        for row in csv.DictReader(file):
            values = [float(row[name]) for name in ("r_n", "r_t", "u_n", "u_t")]
            key = float(row["mu"]), float(row["f_t"])
            listed.setdefault(key, []).append(values)
    W = np.linalg.inv([[2.0, 0.5], [0.5, 1.0]])
    for (mu, f_t), rows in listed.items():
        problem = Problem(W, (W @ [-1.0, f_t])[None], mu)
        branches = sorted([*x.r[0], *x.v[0]] for x in answers(problem))
        assert len(branches) == len(rows)
        for got, want in zip(branches, sorted(rows), strict=True):
            # Twelve digits are printed.
            assert got == pytest.approx(want, rel=1e-11, abs=1e-11)
