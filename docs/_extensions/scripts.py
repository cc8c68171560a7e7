"""Pictures of the documentation: each script beside a page is executed, and draws one.

A script ``docs/gallery/henon.py`` draws ``docs/gallery/henon.png``: its ``figure``, or the
current figure of pyplot. It may write ``henon.gif`` itself. A picture that is newer than its script
and than the package is kept.
"""

from __future__ import annotations

import ast
import os
import runpy
import warnings
from contextlib import chdir
from pathlib import Path
from typing import TYPE_CHECKING, cast

from tests.pictures import overprinted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOCS = Path(__file__).parents[1]
FOLDERS = ("gallery", "concepts")
LONGEST = 25
"""Lines of code of a script of the gallery, without blank lines and its description."""

SECTIONS = {
    "Machines": (
        *("machine", "basins", "bilinear", "stick_slip", "hysteresis", "gears", "plane"),
        *("diagram", "spectrum", "pod", "toda", "resonances", "animation"),
    ),
    "Maps and flows": (
        *("henon", "ikeda", "cascade", "circle", "standard", "chua", "homoclinic", "galaxy"),
    ),
}
"""Headings of the gallery, and its scripts."""


def scripts() -> list[Path]:
    """Return all scripts."""
    return [path for folder in FOLDERS for path in sorted((DOCS / folder).glob("*.py"))]


def picture(script: Path) -> Path:
    """Return the path of the picture that a script draws."""
    film = script.with_suffix(".gif")
    return film if film.name in script.read_text(encoding="utf-8") else script.with_suffix(".png")


def draw(script: Path) -> None:
    """Execute a script and write its picture."""
    from matplotlib import pyplot as plt, rc_context

    plt.close("all")
    with chdir(script.parent), rc_context(), warnings.catch_warnings():
        warnings.simplefilter("error")
        names = runpy.run_path(str(script))
        figure = cast("Figure", names.get("figure") or plt.gcf())
    target = picture(script)
    if target.suffix == ".png":
        for texts in overprinted(figure):
            raise ValueError(f"{script.name}: {' and '.join(texts)} are printed over each other")
        figure.savefig(target, dpi=200)
    plt.close("all")


def draw_all() -> None:
    """Draw all pictures that are missing, or older than their script or than the package."""
    os.environ["MPLBACKEND"] = "agg"
    parts = [DOCS.parent / name for name in ("dynkit", "systems", "analysis")]
    sources = [path for part in parts for path in part.rglob("*.py")]
    changed = max(path.stat().st_mtime for path in sources)
    for script in scripts():
        target = picture(script)
        newest = max(changed, script.stat().st_mtime)
        if not target.exists() or target.stat().st_mtime < newest:
            draw(script)


def described(script: Path) -> tuple[str, str]:
    """Return the title of a script and the text below it."""
    text = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    title, _, text = text.partition("\n")
    return title.rstrip("."), text.strip()


def lines_of_code(script: Path) -> list[str]:
    """Return the lines of code after the description, without blank ones."""
    text = script.read_text(encoding="utf-8").split('"""', 2)[2]
    return [line for line in text.splitlines() if line.strip()]


def gallery_page() -> str:
    """Return the page of the gallery: a table of pictures, and each with its code."""
    lines = [
        "# Gallery",
        "",
        f"Each picture is drawn by the code below it, of {LONGEST} lines at most, when this page",
        "is built. A notebook shows it; in a script add `plt.show()`, or `figure.savefig(...)`.",
        "",
        "::::{grid} 2 3 4 4",
        ":gutter: 2",
        "",
    ]
    for name in (name for names in SECTIONS.values() for name in names):
        script = DOCS / "gallery" / f"{name}.py"
        title, _ = described(script)
        lines += [":::{grid-item-card}", f":link: picture-{name}", ":link-type: ref"]
        lines += [
            f":img-top: {picture(script).name}",
            ":class-card: thumbnail",
            "",
            title,
            ":::",
            "",
        ]
    lines += ["::::", ""]
    for heading, names in SECTIONS.items():
        lines += [f"## {heading}", ""]
        for name in names:
            script = DOCS / "gallery" / f"{name}.py"
            title, text = described(script)
            start = script.read_text(encoding="utf-8").split('"""', 2)[2].strip()
            lines += [f"(picture-{name})=", f"### {title}", "", text, ""]
            lines += [f"```{{image}} {picture(script).name}", ":class: picture", f":alt: {title}"]
            lines += ["```", "", "```python", start, "```", ""]
    return "\n".join(lines)
