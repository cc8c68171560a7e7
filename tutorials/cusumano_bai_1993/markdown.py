"""The Markdown of the report as HTML: paragraphs, tables, code, and formulas in simple LaTeX."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

_NAMES = {
    "omega": "ω",
    "gamma": "γ",
    "phi": "φ",
    "pi": "π",
    "sin": "sin",
    "langle": "⟨",
    "rangle": "⟩",
    "sqrt": "√",
}
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?(?: ?%)?")
_POWER = re.compile(r"[-+]?\d[\d.]*e[-+]\d+")


def to_html(text: str) -> str:
    r"""Return the HTML of a text in Markdown.

    Examples
    --------
    >>> print(to_html("The first $\\omega_1$ is `free`."))
    <p>The first <i>ω<sub>1</sub></i> is <code>free</code>.</p>
    """
    return "\n".join(_block(block) for block in text.strip().split("\n\n"))


def to_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an HTML table; cells are Markdown."""
    names = "".join(f"<th>{inline(name)}</th>" for name in head)
    body = "\n".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows)
    return (
        f'<div class="wide"><table>\n<thead><tr>{names}</tr></thead>\n<tbody>\n{body}\n'
        "</tbody></table></div>"
    )


def inline(text: str) -> str:
    """Return the HTML of a text without paragraphs: code, formulas, plain text."""
    parts = re.split(r"(`[^`]*`|\$[^$]*\$)", text)
    return "".join(_span(part) for part in parts)


def _block(block: str) -> str:
    lines = block.split("\n")
    if lines[0].startswith("| "):
        rows = [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines]
        return to_table(rows[0], rows[2:])
    if lines[0].startswith("### "):
        return f"<h3>{inline(lines[0][4:])}</h3>"
    return f"<p>{inline(' '.join(lines))}</p>"


def _cell(text: str) -> str:
    kind = ' class="number"' if _NUMBER.fullmatch(text) else ""
    return f"<td{kind}>{inline(text)}</td>"


def _span(part: str) -> str:
    if len(part) > 1 and part[0] == part[-1] == "`":
        return f"<code>{escape(part[1:-1])}</code>"
    if len(part) > 1 and part[0] == part[-1] == "$":
        return _formula(part[1:-1])
    return _POWER.sub(r'<span class="one">\g<0></span>', escape(part, quote=False))


def _formula(latex: str) -> str:
    text = escape(latex, quote=False)
    text = re.sub(r"\\([a-z]+) ?", lambda match: _NAMES.get(match[1], match[1]), text)
    text = re.sub(r"√\{([^{}]*)\}", r"√(\1)", text)
    for mark, tag in (("_", "sub"), ("^", "sup")):
        text = re.sub(rf"{re.escape(mark)}(?:\{{([^{{}}]*)\}}|(\w))", _Raised(tag), text)
    return f"<i>{text}</i>"


class _Raised:
    """What stands above or below the line."""

    def __init__(self, tag: str) -> None:
        self._tag = tag

    def __call__(self, match: re.Match[str]) -> str:
        return f"<{self._tag}>{match[1] or match[2]}</{self._tag}>"
