"""Numbers, names and suggestions in messages."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping


def count_noun(number: int, noun: str) -> str:
    """``1 entry``, ``2 entries``."""
    if number == 1:
        return f"1 {noun}"
    if noun.endswith("y") and noun[-2:-1] not in "aeiou":
        return f"{number} {noun[:-1]}ies"
    return f"{number} {noun}s"


def place(x: Iterable[float]) -> str:
    """Coordinates of a point: ``(0.5, 1)``."""
    return "(" + ", ".join(f"{c:g}" for c in x) + ")"


def size(count: float) -> str:
    """Bytes to three digits, in a suitable unit.

    >>> size(512), size(123456), size(4.5e9)
    ('512 B', '123 kB', '4.5 GB')
    """
    for unit, value in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= value:
            return f"{count / value:.3g} {unit}"
    return f"{int(count)} B"


def duration(time: float) -> str:
    """Seconds, minutes or hours as text; a forecast is accurate to one digit at most."""
    if time < 1:
        return "less than 1 s"
    if time < 90:
        return f"about {time:.0f} s"
    if time < 5400:
        return f"about {time / 60:.0f} min"
    return f"about {time / 3600:.0f} h"


def make_type_error(what: str, value: object, expected: str) -> TypeError:
    """Error of an argument ``what`` of a wrong type; ``expected`` is the end of the message."""
    return TypeError(f"{what} is a {type(value).__name__}, expected {expected}")


def printable(text: str) -> str:
    """``text`` on one line, unprintable characters escaped: file names may contain them."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode() for c in text
    )


# Earlier and other words for keys, arguments and options, and the one that replaces them.
RENAMED = dict.fromkeys(("where", "surface", "face", "facets", "region"), "on")


def nearest(word: str, known: Iterable[str]) -> str:
    """The known name that replaces or resembles ``word``, or ""; case and ``-`` are ignored."""
    from difflib import get_close_matches

    def plain(name: str) -> str:
        return name.lower().replace("-", "_")

    names = {plain(name): name for name in known}
    dashes = len(word) - len(word.lstrip("-"))
    renamed = "_" * dashes + RENAMED.get(plain(word[dashes:]), " ")
    if renamed in names:
        return names[renamed]
    similar = get_close_matches(plain(word), names, n=1, cutoff=0.6)
    return names[similar[0]] if similar else ""


def meant(word: str, known: Iterable[str]) -> str:
    """``, did you mean 'x'?``, or "" without a similar name."""
    similar = nearest(word, known)
    return f", did you mean {similar!r}?" if similar and similar != word else ""


def instead(word: str, known: Collection[str], hint: str = "") -> str:
    """End of a message about an unknown name: the known names, else ``hint``.

    >>> "there is no 'a'" + instead("a", ["b", "c"])
    "there is no 'a', expected one of b, c"
    >>> "there is no 'a'" + instead("a", [], "its mesh names no surface")
    "there is no 'a': its mesh names no surface"
    """
    if known:
        return f", expected one of {', '.join(known)}{meant(word, known)}"
    return f": {hint}" if hint else ""


def body_of(dof: int, bodies: Mapping[str, int] | None) -> str:
    """``body 'name'`` for the body that has a degree of freedom.

    ``bodies`` maps each name to its first degree of freedom; None if there are no names.

    >>> body_of(7, {"upper": 0, "lower": 6}), body_of(7, None)
    ("body 'lower'", 'the body of degree of freedom 7')
    """
    first = [(at, name) for name, at in (bodies or {}).items() if at <= dof]
    return (
        f"body {max(first)[1]!r}" if first else f"the body of degree of freedom {dof}"
    )
