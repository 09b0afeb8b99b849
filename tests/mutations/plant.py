"""Planted faults: their list, and a source with one of them behind its switch."""

import tomllib
from pathlib import Path

LIST = Path(__file__).with_name("faults.toml")


def faults() -> list[dict[str, str]]:
    """The faults: file, line, the code in it, what replaces the code."""
    with LIST.open("rb") as file:
        return list(tomllib.load(file)["fault"])


def planted(fault: dict[str, str], number: int, text: str) -> str:
    """``text`` with the fault behind its switch.

    Raises `ValueError`: the line is not there exactly once, the code not once in the line, or
    one of the two codes is no whole expression, so that the switch would not compile.
    """
    line, code, wrong = fault["line"], fault["code"], fault["fault"]
    where = f"fault {number}, {fault['file']}"
    if text.count(line) != 1:
        raise ValueError(f"{where}: {text.count(line)} places read {line!r}, not one")
    if line.count(code) != 1:
        raise ValueError(
            f"{where}: {code!r} stands {line.count(code)} times in the line"
        )
    if any(not part or part[0] in " +*/=<>" for part in (code, wrong)):
        raise ValueError(f"{where}: {code!r} or {wrong!r} is no whole expression")
    if fault["file"].endswith(".rs"):
        choice = f"(if crate::planted({number}) {{ {wrong} }} else {{ {code} }})"
    else:
        choice = f"(({wrong}) if _planted({number}) else ({code}))"
    return text.replace(line, line.replace(code, choice))
