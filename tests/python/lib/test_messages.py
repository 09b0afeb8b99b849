"""Numbers and names in messages, with singular and plural."""

import numpy as np

import bipot_rs as bp
from bipot_rs._lib.messages import count_noun, duration, printable, size


def test_words_for_numbers() -> None:
    for words, told in (
        (count_noun(1, "iteration"), "1 iteration"),
        (count_noun(0, "iteration"), "0 iterations"),
        (count_noun(1, "entry"), "1 entry"),
        (count_noun(2, "entry"), "2 entries"),
        (size(0), "0 B"),
        (size(999), "999 B"),
        (size(1000), "1 kB"),
        (size(12_345_678), "12.3 MB"),
        (size(2.5e13), "25 TB"),
        (duration(0.01), "less than 1 s"),
        (duration(7.4), "about 7 s"),
        (duration(600), "about 10 min"),
        (duration(1e5), "about 28 h"),
    ):
        assert words == told


def test_printable_names_have_one_line() -> None:
    assert printable("plain, é and 接触") == "plain, é and 接触"
    assert printable("a\nb\tc\x1b[2J\udcff") == r"a\nb\tc\x1b[2J\udcff"


def test_a_solution_is_a_line() -> None:
    """It is one line for any number of contacts, as for a result."""
    problem = bp.ReducedProblem(np.eye(300), np.full((100, 3), -1.0), 0.3)
    solution = problem.solve()
    assert repr(solution) == (
        f"Solution(100 contacts, converged in {count_noun(solution.iterations, 'iteration')}, "
        f"residual {solution.residual:.1e}, held to 1.0e-10)"
    )
    result = bp.solve(np.eye(2), np.eye(2), gap=[-1.0], mu=0.3)
    assert repr(result[0]).startswith("Step(1 contact, converged in ")
    assert repr(result).startswith("Result(1 step, 1 contact, ")
