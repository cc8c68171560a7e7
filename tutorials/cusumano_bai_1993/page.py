"""`report.html`: the report as one page that needs no other file."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

from dynkit.data.atomic_files import whole
from tutorials.cusumano_bai_1993.markdown import inline, to_html, to_table
from tutorials.cusumano_bai_1993.section import LOOK, Section
from tutorials.cusumano_bai_1993.summary import HEAD, found, groups, pictures


def write_page(
    path: Path,
    title: str,
    opening: str,
    sections: Sequence[Section],
    closing: Sequence[tuple[str, str]],
) -> Path:
    """Write the page, and return its path.

    Parameters
    ----------
    path : Path
        Beside it stand the figures.
    title, opening : str
        The latter in Markdown.
    sections : sequence of Section
    closing : sequence of (str, str)
        Titles and texts, in Markdown, of what comes last.
    """
    links = [(section.item, section.title) for section in sections]
    nav = "".join(f'<a href="#{item}">{inline(name)}</a>' for item, name in links)
    drawn = "".join(
        _figure(path.parent / f"{name}.svg", title) for name, title in pictures(sections)
    )
    said = to_html(f"{found(sections)}\n\n{opening}")
    parts = [
        f"<h1>{inline(title)}</h1>",
        f'<div class="beside drawn"><div>{drawn}</div><div>{said}</div></div>',
        *(_group(name, rows) for name, rows in groups(sections)),
        f"<nav>{nav}</nav>",
        *(_section(section, path.parent) for section in sections),
        *(f"<section><h2>{name}</h2>{to_html(text)}</section>" for name, text in closing),
    ]
    template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    page = Template(template).substitute(title=escape(title), body="\n".join(parts))
    write_text(path, page)
    return path


def _group(name: str, rows: Sequence[Sequence[str]]) -> str:
    opened = " open" if name.startswith("Differences") else ""
    body = to_table(HEAD, rows)
    return f"<details{opened}><summary><h2>{inline(name)}</h2></summary>{body}</details>"


def write_text(path: Path, text: str) -> None:
    """Write a text; after any failure the old file is still there."""
    with whole("out", path) as stream:
        stream.write(text.encode())


def _section(section: Section, folder: Path) -> str:
    figures = "".join(_figure(folder / f"{name}.svg", section.title) for name in section.figures)
    said = "".join(
        f"<dt>{inline(finding.what)}</dt>"
        f"<dd><span>paper</span> {inline(finding.paper)}</dd>"
        f"<dd><span>found</span> {inline(finding.found)}</dd>"
        f"<dd><span>error</span> {inline(finding.error)}</dd>"
        for finding in section.findings
    )
    said = f'<dl class="said">{said}</dl>' if said else ""
    kind = "beside drawn" if figures else "beside"
    link = f'<p><a href="{escape(section.page)}">{LOOK}</a></p>' if section.page else ""
    drawn = f"<div>{figures}{link}</div>" if figures else ""
    return (
        f'<section id="{section.item}"><h2>{inline(section.title)}</h2>'
        f'<div class="{kind}">{drawn}<div>{said}{to_html(section.text)}</div></div></section>'
    )


def _figure(path: Path, title: str) -> str:
    data = b64encode(path.read_bytes()).decode("ascii")
    alternative = escape(f"{title} ({path.stem})")
    return f'<figure><img alt="{alternative}" src="data:image/svg+xml;base64,{data}"></figure>'
