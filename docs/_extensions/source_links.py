"""Links from pages of source to the reference lead to the object, whatever name it has there.

Sphinx takes one package for all objects of a module; some are documented under another one.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_LINK = re.compile(r'href="([^"#]+\.html)#([^"]+)"')


def mended(page: Path) -> str:
    """Return the page with the anchors that its targets have."""

    def anchored(link: re.Match[str]) -> str:
        target = page.parent / link[1]
        known = re.findall(r'id="([^"]+)"', target.read_text("utf-8")) if target.exists() else []
        if link[2] in known:
            return link[0]
        parts = link[2].split(".")
        for k in range(1, len(parts)):  # the longest name that both share
            same = [name for name in known if name.endswith("." + ".".join(parts[k:]))]
            if same:
                return f'href="{link[1]}#{same[0]}"'
        return f'href="{link[1]}"'

    return _LINK.sub(anchored, page.read_text("utf-8"))


def finish(app: Sphinx, failure: Exception | None) -> None:
    """Mend the pages of source after a build."""
    if failure is None and app.builder.format == "html":
        for page in Path(app.outdir, "_modules").rglob("*.html"):
            page.write_text(mended(page), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("build-finished", finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
