"""The first mention of a term on a page links to the glossary."""

from __future__ import annotations

import re
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform
from sphinx.transforms.post_transforms import SphinxPostTransform

GLOSSARY = Path(__file__).parents[1] / "glossary.md"
COMMON = {"orbit", "error", "cost", "phase", "gap", "branch", "attractor", "at rest", "guard"}
"""Terms that are words of every page."""
PATTERNS = {"P(n,m)": r"P\((?:n|\d+),(?:m|\d+)\)", "P(inf,m)": r"P\(inf,(?:m|\d+)\)"}


@cache
def terms() -> tuple[str, ...]:
    """Return the terms of the glossary: lines with a definition below them."""
    lines = GLOSSARY.read_text(encoding="utf-8").splitlines()
    heads = [line for line, below in pairwise(lines) if below[:2] == ": "]
    return tuple(term.strip() for head in heads for term in head.split(", "))


def anchor(term: str) -> str:
    """Return the identifier of a term."""
    return "term-" + re.sub(r"[^a-z0-9]+", "-", term.lower()).strip("-")


@cache
def pattern() -> re.Pattern[str]:
    """Return what finds the terms in a text, longer ones first; a group for each, in order."""
    forms = [PATTERNS.get(term, rf"{re.escape(term)}s?") for term in linked()]
    return re.compile(r"(?<![\w-])(?:" + "|".join(f"({form})" for form in forms) + r")(?![\w-])")


@cache
def linked() -> tuple[str, ...]:
    """Return the terms that pages link to."""
    return tuple(sorted(set(terms()) - COMMON, key=lambda term: (-len(term), term)))


class Anchors(SphinxTransform):
    """Give the terms of the glossary identifiers."""

    default_priority = 900

    def apply(self, **_: Any) -> None:
        if self.env.docname == "glossary":
            for node in self.document.findall(nodes.term):
                node["ids"] += [anchor(term.strip()) for term in node.astext().split(", ")]


class Links(SphinxPostTransform):
    """Link the first mention of each term in the paragraphs of a page."""

    default_priority = 890
    formats = ("html",)

    def run(self, **_: Any) -> None:
        page = self.env.docname
        if page == "glossary" or page.startswith(("api/", "release-notes")):
            return
        left = set(linked())
        target = self.app.builder.get_relative_uri(page, "glossary")
        for paragraph in list(self.document.findall(nodes.paragraph)):
            for text in list(paragraph.findall(nodes.Text)):
                within = (nodes.literal, nodes.reference, nodes.math, nodes.caption)
                if not isinstance(text.parent, within):
                    _link(text, left, target)


def _link(text: nodes.Text, left: set[str], target: str) -> None:
    whole, last, pieces = text.astext(), 0, list[nodes.Node]()
    for found in pattern().finditer(whole):
        term = linked()[(found.lastindex or 1) - 1]
        if term not in left:
            continue
        left.remove(term)
        link = nodes.reference("", found[0], refuri=f"{target}#{anchor(term)}", internal=True)
        link["classes"] = ["term"]
        pieces += [nodes.Text(whole[last : found.start()]), link]
        last = found.end()
    if pieces:
        text.parent.replace(text, [*pieces, nodes.Text(whole[last:])])


def setup(app: Sphinx) -> dict[str, bool]:
    """Register both."""
    app.add_transform(Anchors)
    app.add_post_transform(Links)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
