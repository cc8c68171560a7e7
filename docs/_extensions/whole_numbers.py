"""Numbers such as 1e-12 are not broken at their signs."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

_POWER = re.compile(r"(\d[\d.]*e-\d+)")


class WholeNumbers(SphinxPostTransform):
    """Put each into an element of its own, for which the style sheet forbids it."""

    default_priority = 900
    formats = ("html",)

    def run(self, **_: Any) -> None:
        for paragraph in list(self.document.findall(nodes.paragraph)):
            for text in list(paragraph.findall(nodes.Text)):
                pieces = _POWER.split(text.astext())
                if len(pieces) > 1 and not isinstance(text.parent, nodes.literal):
                    text.parent.replace(text, [_made(*both) for both in enumerate(pieces)])


def _made(place: int, piece: str) -> nodes.Node:
    return nodes.inline("", piece, classes=["number"]) if place % 2 else nodes.Text(piece)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register it."""
    app.add_post_transform(WholeNumbers)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
