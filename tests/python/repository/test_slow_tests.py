"""The list of slow variants names tests that exist, and a test that keeps a variant."""

import re
from pathlib import Path

from support import slow


def test_listed_tests_exist(repository: Path) -> None:
    texts: dict[str, str] = {}
    for name in slow.listed():
        file, _, test = name.partition("::")
        text = texts.setdefault(file, (repository / file).read_text(encoding="utf-8"))
        assert re.search(rf"^def {test.partition('[')[0]}\(", text, re.M), name


def test_a_function_keeps_its_fastest_variants(tmp_path: Path) -> None:
    times = {"a[1]": 5.0, "a[2]": 0.5, "a[3]": 0.6, "b[1]": 9.0, "c": 9.0, "d[1]": 0.2}
    case = '<testcase classname="tests.python.x" name="test_{}" time="{}"/>'
    rows = [case.format(name, seconds) for name, seconds in times.items()]
    junit = tmp_path / "times.xml"
    junit.write_text(f"<testsuites>{''.join(rows)}</testsuites>", encoding="utf-8")
    # 0.5 s stay; with 0.6 s the function exceeds a second. A single variant stays.
    expected = [f"tests/python/x.py::test_a[{k}]" for k in (1, 3)]
    assert slow.slow(junit) == expected
