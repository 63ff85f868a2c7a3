"""Tables and curves as HTML for notebooks, without files, scripts or styles.

They have the colour of the notebook (``currentColor``), which suits light and dark notebooks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Final, NewType

import numpy as np
from numpy.typing import ArrayLike

from rtamt import Verdict
from rtamt.errors import shown

Markup = NewType("Markup", str)
"""HTML with all foreign texts escaped."""

_POINTS: Final = 100
"""The maximum number of parts of a curve; each is drawn by its minimum and maximum."""

_WIDTH: Final = 120
_HEIGHT: Final = 24


def plain(text: object) -> Markup:
    """Return a foreign text, escaped.

    Example:
        >>> plain("x < 3 & y")
        'x &lt; 3 &amp; y'
    """
    return Markup(escape(shown(str(text))))


def code(text: object) -> Markup:
    """Return a formula or a name as code.

    Example:
        >>> code("x < 3")
        '<code>x &lt; 3</code>'
    """
    return Markup(f"<code>{plain(text)}</code>")


def verdict(value: Verdict, text: str) -> Markup:
    """Return a verdict in its colour, and the remark after its name in a text.

    Example:
        >>> verdict(Verdict.VIOLATED, "VIOLATED by how it ended").endswith(
        ...     "</span> by how it ended"
        ... )
        True
    """
    return Markup(value._repr_html_() + plain(text.removeprefix(value.name)))


def table(head: Sequence[str], rows: Iterable[Sequence[Markup]]) -> Markup:
    """Return a table with a line of heads.

    Example:
        >>> table(["name"], [[plain("a")], [code("b")]])
        '<table><tr><th>name</th></tr><tr><td>a</td></tr><tr><td><code>b</code></td></tr></table>'
    """
    lines = ["".join(f"<th>{plain(cell)}</th>" for cell in head)]
    lines += ["".join(f"<td>{cell}</td>" for cell in row) for row in rows]
    return Markup(f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>")


def curve(values: ArrayLike, label: str) -> Markup:
    """Return a curve over samples, with a line at 0 if values lie on both sides.

    Infinite values and nan interrupt the curve.
    """
    heights = np.asarray(values, dtype=np.float64)
    finite = np.isfinite(heights)
    if not finite.any():
        return Markup("")
    least, most = float(heights[finite].min()), float(heights[finite].max())
    if least < most:
        down = 2 + (most - heights) * ((_HEIGHT - 4) / (most - least))
    else:
        down = np.full(len(heights), _HEIGHT / 2)
    step = max(1, -(-len(heights) // _POINTS))
    path, pen = [], "M"
    for begin in range(0, len(heights), step):
        part = down[begin : begin + step]
        known = part[finite[begin : begin + step]]
        if len(known) < len(part):
            pen = "M"
        if not len(known):
            continue
        x = _WIDTH * begin / max(1, len(heights) - 1)
        ends = [known[0]] if step == 1 else [known.min(), known.max()]
        for y in ends if known[0] <= known[-1] else ends[::-1]:
            path.append(f"{pen}{x:.4g} {y:.3g}")
            pen = "L"
    zero = ""
    if least < 0 < most:
        y = 2 + most * ((_HEIGHT - 4) / (most - least))
        zero = (
            f'<path d="M0 {y:.3g}H{_WIDTH}" stroke="currentColor" stroke-dasharray="2" '
            'opacity=".5"/>'
        )
    drawn = f'<path d="{"".join(path)}" stroke="currentColor" stroke-linecap="round" fill="none"/>'
    return _picture(f"{zero}{drawn}", label)


def bar(share: float, low: float, high: float, label: str) -> Markup:
    """Return a share and its interval on a line from 0 to 1."""
    left, right = _WIDTH * low, _WIDTH * high
    return _picture(
        f'<path d="M0 12H{_WIDTH}" stroke="currentColor" opacity=".25"/>'
        f'<rect x="{left:.4g}" y="8" width="{right - left:.4g}" height="8" '
        'fill="currentColor" opacity=".4"/>'
        f'<circle cx="{_WIDTH * share:.4g}" cy="12" r="4" fill="currentColor"/>',
        label,
    )


def _picture(drawn: str, label: str) -> Markup:
    return Markup(
        f'<svg role="img" aria-label="{plain(label)}" width="{_WIDTH}" height="{_HEIGHT}" '
        f'viewBox="0 0 {_WIDTH} {_HEIGHT}" overflow="visible">{drawn}</svg>'
    )
