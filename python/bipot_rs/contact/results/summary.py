"""Summary of a problem or a solution in about six lines.

It is written as text or, in notebooks, as a table of HTML. It uses known values only:
nothing is solved or factored for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bipot_rs._lib.messages import count_noun, size
from bipot_rs._lib.types import AnyArray, Floats, Integers, Record
from bipot_rs.contact.law.contact_law import ContactLaw
from bipot_rs.contact.law.status import STATUS_NAMES

Row = tuple[str, str]
# A title, and rows of a name and a text.
Summary = tuple[str, Sequence[Row]]

_SPACE = {2: "in the plane", 3: "in space"}


def format_text(summary: Summary) -> str:
    """Lines for a terminal.

    >>> print(format_text(("A block", [("W", "4 x 4"), ("friction", "0.3")])))
    A block
      W         4 x 4
      friction  0.3
    """
    title, rows = summary
    width = max((len(name) for name, _ in rows), default=0)
    return "\n".join([title, *(f"  {name:<{width}}  {text}" for name, text in rows)])


def format_html(summary: Summary) -> str:
    """Table for a notebook, with all texts escaped.

    >>> format_html(("A < B", [("q", "0")]))
    '<table><caption>A &lt; B</caption><tr><th>q</th><td>0</td></tr></table>'
    """
    from html import escape

    title, rows = summary
    cells = (
        f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>"
        for name, text in rows
    )
    return f"<table><caption>{escape(title)}</caption>{''.join(cells)}</table>"


def describe_places(contacts: int, d: int) -> str:
    """Number of contacts, and their dimension.

    >>> describe_places(1, 2)
    '1 contact in the plane'
    """
    return " ".join(filter(None, (count_noun(contacts, "contact"), _SPACE.get(d, ""))))


def describe_statuses(status: Integers) -> str:
    """Contacts by status.

    >>> describe_statuses(np.array([0, 2, 2], np.int8))
    '1 open, 0 slip, 2 stick'
    """
    return ", ".join(
        f"{int(np.sum(status == k))} {name}" for k, name in enumerate(STATUS_NAMES)
    )


def describe_forces(reaction: Floats, frame: Floats | None = None) -> str:
    """Sums of the normal forces and of the friction forces as vectors.

    ``reaction``: ``(n_c, d)``, normal first.
    ``frame``: rows ``n, t1[, t2]`` of each contact, ``(n_c, d, d)``. Without them friction is
    summed as if the tangents of all contacts were the same.

    >>> describe_forces(np.array([[3.0, 1.0], [1.0, 1.0]]))
    'normal 4 in total, friction 2 (50 % of normal)'
    """
    press = float(reaction[:, 0].sum())
    if frame is None:
        drag = reaction[:, 1:].sum(axis=0)
    else:
        drag = np.einsum("ck,ckd->d", reaction[:, 1:], frame[:, 1:])
    size = float(np.linalg.norm(drag))
    share = f" ({100 * size / press:.3g} % of normal)" if press > 0 else ""
    return f"normal {press:.5g} in total, friction {size:.5g}{share}"


def describe_friction(mu: Floats) -> str:
    """Smallest and largest friction coefficient.

    >>> describe_friction(np.array([0.3, 0.3])), describe_friction(np.array([0.0, 0.3]))
    ('mu = 0.3', 'mu from 0 to 0.3, 1 contact without friction')
    """
    if not mu.size:
        return "none"
    low, high = float(mu.min()), float(mu.max())
    words = f"mu = {low:g}" if low == high else f"mu from {low:g} to {high:g}"
    without = int(np.sum(mu.reshape(len(mu), -1).max(axis=1) == 0))
    if 0 < without < len(mu):
        words += f", {count_noun(without, 'contact')} without friction"
    return words if mu.ndim == 1 else f"{words}, by direction"


def describe_law(law: ContactLaw) -> list[tuple[str, str]]:
    """Rows of the numbers of a law other than friction, for a summary.

    >>> law = ContactLaw(np.array([0.5, 0.5]), np.array([0.0, 2.0]))
    >>> describe_law(law)
    [('cohesion', 'from 0 to 2')]
    """
    rows = []
    for name, values in law.without_mu().items():
        if values is not None:
            low, high = f"{values.min():g}", f"{values.max():g}"
            rows.append((name, low if low == high else f"from {low} to {high}"))
    return rows


def describe_gaps(gap: Floats) -> str:
    """Smallest and largest normal gap, and how many are negative.

    >>> describe_gaps(np.array([-0.5, 1.0])), describe_gaps(np.zeros(2))
    ('from -0.5 to 1, negative at 1 contact', '0')
    """
    if not gap.size:
        return "none"
    low, high = f"{gap.min():.4g}", f"{gap.max():.4g}"
    words = low if low == high else f"from {low} to {high}"
    below = int(np.sum(gap < 0))
    return f"{words}, negative at {count_noun(below, 'contact')}" if below else words


def format_seconds(taken: float) -> str:
    """Time to three digits.

    >>> format_seconds(0.0123), format_seconds(75.0)
    ('12.3 ms', '75 s')
    """
    return f"{taken:.3g} s" if taken >= 1 else f"{1e3 * taken:.3g} ms"


def summarise_problem(
    shape: tuple[int, int, int],
    fixed: int,
    arrays: Mapping[str, AnyArray | None],
    stats: Record,
    remarks: Sequence[str] = (),
) -> Summary:
    """Summary of a `ContactProblem`."""
    n, contacts, d = shape
    gap = np.asarray(arrays["gap"])
    dofs = f"{fixed} prescribed degrees of freedom"
    common = [
        ("gap", describe_gaps(gap[:, 0] if gap.ndim > 1 else gap)),
        ("friction", describe_friction(np.asarray(arrays["mu"]))),
    ]
    if not stats["bytes_factor"] and stats["engine"] != "direct":
        rows = [
            ("supports", dofs),
            *common,
            ("engine", f"{stats['engine']}: {stats['engine_reason']}"),
            ("memory", f"stiffness {size(stats['bytes_stiffness'])}"),
        ]
    else:
        left = count_noun(stats["rigid_motions"], "rigid motion")
        held = f"{left} held by contact alone"
        if not stats["rigid_motions"]:
            held = "supports hold them"
        kept = size(stats["bytes_factor"]) if stats["factor_kept"] else "not kept"
        factor = f"factor {kept} ({count_noun(stats['nnz_factor'], 'entry')})"
        W, peak = size(stats["bytes_compliance"]), size(stats["bytes_peak"])
        took = format_seconds(stats["seconds_condense"])
        rows = [
            ("bodies", f"{stats['bodies']}, {dofs}, {held}"),
            *common,
            ("memory", f"{factor}, W {W}, at most {peak}"),
            ("condensed in", f"{took}, ordering by {stats['ordering']}"),
        ]
    title = f"{count_noun(n, 'degree')} of freedom, {describe_places(contacts, d)}"
    return f"ContactProblem: {title}", [
        *rows,
        *(("remark", remark) for remark in remarks),
    ]
