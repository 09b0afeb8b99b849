"""Numbers and names in a sentence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping


def counted(number: int, noun: str) -> str:
    """``1 entry``, ``2 entries``."""
    if number == 1:
        return f"1 {noun}"
    if noun.endswith("y") and noun[-2:-1] not in "aeiou":
        return f"{number} {noun[:-1]}ies"
    return f"{number} {noun}s"


def printable(text: str) -> str:
    """On one line, in characters that any terminal takes: file names hold all but /."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode() for c in text
    )


def nearest(word: str, known: Iterable[str]) -> str:
    """The known name that was probably meant, or nothing: case and ``-`` do not count."""
    from difflib import get_close_matches

    def plain(name: str) -> str:
        return name.lower().replace("-", "_")

    names = {plain(name): name for name in known}
    found = get_close_matches(plain(word), names, n=1, cutoff=0.6)
    return names[found[0]] if found else ""


def meant(word: str, known: Iterable[str]) -> str:
    """``, did you mean 'x'?``, or nothing."""
    found = nearest(word, known)
    return f", did you mean {found!r}?" if found and found != word else ""


def body_of(dof: int, bodies: Mapping[str, int] | None) -> str:
    """``body 'name'``, whose degree of freedom it is, or what it is known by.

    ``bodies`` are their names, each with its first degree of freedom.

    >>> body_of(7, {"upper": 0, "lower": 6}), body_of(7, None)
    ("body 'lower'", 'the body of degree of freedom 7')
    """
    first = [(at, name) for name, at in (bodies or {}).items() if at <= dof]
    return (
        f"body {max(first)[1]!r}" if first else f"the body of degree of freedom {dof}"
    )
