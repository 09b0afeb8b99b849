"""Formulas in plain text, as these pages write them, to MathML.

The pages keep their formulas readable as text: ``K u = f + Bᵀ r``, ``‖r_t‖ ≤ μ r_n``. A
formula is read from left to right:

- ``_`` and ``^`` put the next letters, number or ``{group}`` below and above; so do the
  characters ᵀ ⁻ ² ₀ and their like. A star and a prime are superscripts.
- ``a/b`` without spaces is a fraction of what stands directly beside the stroke, and ``√``
  applies to what follows it. Parentheses that only serve them are left out.
- Words of two letters or more are text, except names of functions, and differentials as ``dA``.
- ``‖`` and ``|`` open where an operand may begin, else they close.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from html import escape

_RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ᵀᵏⁱ", "0123456789+−Tki", strict=True))
_LOWERED = dict(zip("₀₁₂₃₄₅₆₇₈₉₊₋ₙₖ", "0123456789+−nk", strict=True))
_ACCENTS = {"\u0302": "^", "\u0303": "~", "\u0304": "¯", "\u0307": "˙"}
_CLOSING = {"(": ")", "[": "]", "{": "}"}
_BARS = "‖|"
# Read as operators although they are letters or have other forms in MathML.
_LARGE = {"Σ": "∑", "∫": "∫"}
_PREFIX = "∂∇"
_OPERATORS = "=≤≥≠∈∋⊥⇔⇒→←↦≻≽+−·⊕,;:<>×…¬≈±"
_FUNCTIONS = {"det", "diag", "inf", "max", "min", "prox", "proj", "sup", "sym", "tr"}
_UNDER = {"inf", "max", "min", "sup"}

_TOKEN = re.compile(
    r"(?P<space>\s+)"
    r"|(?P<number>\d+(?:\.\d+)?)"
    r"|(?P<code>[a-z]{3,}_[a-z]{3,})"
    r"|(?P<differential>d[α-ω])"
    r"|(?P<name>[a-z]{3,}(?=_))"
    r"|(?P<word>[A-Za-zé]{2,}(?:'s)?)"
    rf"|(?P<raised>[{''.join(_RAISED)}]+)"
    rf"|(?P<lowered>[{''.join(_LOWERED)}]+)"
    r"|(?P<one>.[\u0302\u0303\u0304\u0307]*)"
)


@dataclass(frozen=True)
class Token:
    """A piece of a formula: its kind, its text, and whether a space stands before it."""

    kind: str
    text: str
    spaced: bool


def tokens(text: str) -> list[Token]:
    """The pieces of a formula."""
    found, spaced = [], False
    for match in _TOKEN.finditer(_apart(text)):
        kind = match.lastgroup or ""
        if kind == "space":
            spaced = True
            continue
        if found and found[-1].text in ("_", "^") and not spaced:
            found.append(
                Token(kind, match[0], False)
            )  # an index, whatever it looks like
        else:
            found += _pieces(kind, match[0], spaced)
        spaced = False
    return found


def _apart(text: str) -> str:
    """Letters and their accents as characters of their own; signs as ``≠`` are kept."""
    return "".join(
        unicodedata.normalize("NFD", c) if c.isalpha() and c != "é" else c for c in text
    )


def _pieces(kind: str, text: str, spaced: bool) -> list[Token]:
    """A run of letters as a function, a differential, a product of letters, or a word."""
    if kind != "word":
        return [Token(kind, text, spaced)]
    if text in _FUNCTIONS:
        return [Token("function", text, spaced)]
    if re.fullmatch(r"d[a-zA-Z]", text) and text not in ("de", "do"):
        return [Token("differential", text, spaced)]
    if re.search(r"[A-Z]", text[1:]):
        letters = re.findall(r"d[A-Z]$|.", text)
        first = Token("one", letters[0], spaced)
        return [first, *(Token("one", letter, False) for letter in letters[1:])]
    return [Token("word", text, spaced)]


def mathml(text: str) -> str:
    """The MathML of a formula in one line, without the element ``math``."""
    return Reader(tokens(text)).sequence()


def _row(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"<mrow>{''.join(items)}</mrow>"


def fenced(opening: str, inner: str, closing: str) -> str:
    """Brackets, which grow only around what is higher than a line of text."""
    high = any(f"<{tag}" in inner for tag in ("mfrac", "munder", "msqrt", "mtable"))
    grows = "" if high else ' stretchy="false"'
    return (
        f'<mrow><mo fence="true" form="prefix"{grows}>{opening}</mo>{inner}'
        f'<mo fence="true" form="postfix"{grows}>{closing}</mo></mrow>'
    )


def _letter(text: str) -> str:
    """A letter with its accents."""
    # Capital letters of Greek are upright in this field.
    upright = ' mathvariant="normal"' if "Α" <= text[0] <= "Ω" else ""
    made = f"<mi{upright}>{escape(text[0])}</mi>"
    for accent in text[1:]:
        made = f'<mover accent="true">{made}<mo>{_ACCENTS[accent]}</mo></mover>'
    return made


def _script(text: str) -> str:
    """What stands above or below: up to two letters are indices, more are a word."""
    parts = []
    for piece in re.findall(
        r"[A-Za-z]+|\d+|.[\u0302\u0303\u0304\u0307]*", _apart(text)
    ):
        if re.fullmatch(r"[A-Za-z]{3,}", piece):
            parts.append(f"<mi>{piece}</mi>")
        elif piece[0].isdigit() or piece == "½":
            parts.append(f"<mn>{piece}</mn>")
        elif piece[0].isalpha():
            letters = re.findall(r".[\u0302\u0303\u0304\u0307]*", piece)
            parts += [_letter(letter) for letter in letters]
        elif not piece.isspace():
            parts.append(f"<mo>{escape(piece)}</mo>")
    return _row(parts)


def _raised(text: str) -> str:
    """Raised characters; a transpose is upright, unlike an exponent."""
    plain = _script("".join(_RAISED[c] for c in text))
    upright = '<mi mathvariant="normal">T</mi>'
    return plain.replace("<mi>T</mi>", upright) if "ᵀ" in text else plain


@dataclass(frozen=True)
class _Atom:
    """One operand: its MathML, that without its parentheses, and its scripts."""

    body: str
    bare: str
    below: str = ""
    above: str = ""
    large: bool = False

    def made(self, *, bare: bool = False) -> str:
        """MathML; ``bare`` leaves out parentheses, unless scripts belong to them."""
        if not (self.below or self.above):
            return self.bare if bare else self.body
        kind = "munderover" if self.large else "msubsup"
        if not self.above:
            kind = "munder" if self.large else "msub"
        elif not self.below:
            kind = "mover" if self.large else "msup"
        return f"<{kind}>{self.body}{self.below}{self.above}</{kind}>"


class Reader:
    """Reads pieces of a formula one after the other."""

    def __init__(self, pieces: list[Token]) -> None:
        self._pieces = pieces
        self._at = 0

    def _next(self, ahead: int = 0) -> Token:
        at = self._at + ahead
        return self._pieces[at] if at < len(self._pieces) else Token("end", "", False)

    def sequence(self, until: str = "") -> str:
        """What stands before the closing sign ``until``, which is passed over."""
        items: list[str] = []
        operand = False  # whether an operand has just ended
        while (piece := self._next()).kind != "end":
            if until and piece.text == until and (until not in _BARS or operand):
                self._at += 1
                break
            if piece.kind == "word" or self._article():
                items.append(self._words(first=not items))
                # As in ‖slip‖; before a bar that opens, a space stands.
                operand = not self._next().spaced
            elif piece.text in _OPERATORS or piece.text in "/.)]}∎":
                items.append(self._operator())
                # A closing sign without its opening one ends an operand.
                operand = piece.text in ")]}"
            else:
                items.append(self._operand())
                operand = True
        return _row(items or ["<mrow></mrow>"])

    def _operator(self) -> str:
        piece = self._next()
        self._at += 1
        if piece.text in ".∎":
            return f"<mtext>{piece.text}</mtext>"
        return f"<mo>{escape(piece.text)}</mo>"

    def _words(self, *, first: bool) -> str:
        """Consecutive words; the article "a" among them is no variable."""
        words: list[str] = []
        while True:
            piece = self._next()
            if piece.kind != "word" and not self._article():
                # Spaces at the ends of an element are dropped, unless they do not break.
                before = "" if first else "\u00a0"
                after_them = "\u00a0" if piece.spaced else ""
                text = escape(" ".join(words))
                return f"<mtext>{before}{text}{after_them}</mtext>"
            words.append(piece.text)
            self._at += 1

    def _article(self) -> bool:
        """Whether a word follows the letter "a"."""
        piece, after = self._next(), self._next(1)
        return (
            piece.text == "a" and piece.spaced and after.spaced and after.kind == "word"
        )

    def _operand(self) -> str:
        """An operand, or a fraction of two."""
        upper = self._atom()
        stroke, lower = self._next(), self._next(1)
        tight = not stroke.spaced and not lower.spaced and lower.kind != "end"
        if stroke.text != "/" or not tight:
            return upper.made()
        self._at += 1
        return f"<mfrac>{upper.made(bare=True)}{self._atom().made(bare=True)}</mfrac>"

    def _atom(self) -> _Atom:
        """A letter, number or group, with what stands above and below it."""
        piece = self._next()
        self._at += 1
        body, bare, large, after = self._body(piece)
        below, above = self._scripts()
        made = _Atom(body, bare, below, above, large)
        if not after:
            return made
        # A function or a sign before an operand, which belongs to it.
        if piece.text in _PREFIX and self._begins() and not self._next().spaced:
            own = f"<mrow>{made.made()}{self._atom().made()}</mrow>"
        else:
            own = f"<mrow>{made.made()}<mspace width='0.17em'/></mrow>"
        return _Atom(own, own)

    def _begins(self) -> bool:
        """Whether an operand begins."""
        piece = self._next()
        return piece.kind == "one" and piece.text[0].isalpha()

    def _body(self, piece: Token) -> tuple[str, str, bool, bool]:
        """MathML with and without parentheses; whether scripts go below; a prefix."""
        text = piece.text
        if text in _CLOSING or text in _BARS:
            closing = _CLOSING.get(text, text)
            inner = self.sequence(closing)
            body = fenced(text, inner, closing)
            return body, inner if text == "(" else body, False, False
        if text == "√":
            body = f"<msqrt>{self._atom().made(bare=True)}</msqrt>"
            return body, body, False, False
        prefix = text in _LARGE or text in _PREFIX or piece.kind == "function"
        prefix = prefix and self._next().text != "("
        body = self._single(piece)
        return body, body, text in _UNDER or text == "Σ", prefix

    def _single(self, piece: Token) -> str:
        text = piece.text
        if text in _LARGE:
            return f"<mo>{_LARGE[text]}</mo>"
        if text in _PREFIX:
            return f'<mo form="prefix">{text}</mo>'
        if piece.kind == "number" or text == "½":
            return f"<mn>{text}</mn>"
        if piece.kind == "code":
            return f"<mtext class='code'>{text}</mtext>"
        if piece.kind in ("function", "name"):
            return f"<mi>{text}</mi>"
        if piece.kind == "differential":
            return f'<mrow><mi mathvariant="normal">d</mi>{_letter(text[1:])}</mrow>'
        if text[0].isalpha():
            return _letter(text)
        return f"<mo>{escape(text)}</mo>"

    def _scripts(self) -> tuple[str, str]:
        """What stands below and above the atom before."""
        below, above = "", []
        while True:
            piece = self._next()
            if piece.spaced:
                break
            if piece.kind == "lowered":
                self._at += 1
                below += _script("".join(_LOWERED[c] for c in piece.text))
            elif piece.kind == "raised":
                self._at += 1
                above.append(_raised(piece.text))
            elif piece.text in ("*", "'"):
                self._at += 1
                above.append(f"<mo>{'*' if piece.text == '*' else '′'}</mo>")
            elif piece.text == "_" and self._next(1).kind != "end":
                self._at += 1
                below += self._marked()
            elif piece.text == "^" and self._next(1).kind != "end":
                self._at += 1
                above.append(self._marked())
            else:
                break
        return below, _row(above) if above else ""

    def _marked(self) -> str:
        """The letters, number or group after ``_`` or ``^``."""
        piece = self._next()
        self._at += 1
        if piece.text == "{":
            return self.sequence("}")
        text = piece.text
        if text == "−":
            text += self._next().text
            self._at += 1
        # An index may have two parts, as in W_tt,ii.
        while self._next().text == "," and not (
            self._next().spaced or self._next(1).spaced
        ):
            if self._next(1).kind not in ("word", "one"):
                break
            text += "," + self._next(1).text
            self._at += 2
        return _script(text)
