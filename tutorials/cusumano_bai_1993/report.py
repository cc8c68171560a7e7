"""`report.md` and `report.html`: what the paper says and what was found, side by side."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from dynkit import __version__
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.page import write_page, write_text
from tutorials.cusumano_bai_1993.section import LOOK, Section, table
from tutorials.cusumano_bai_1993.summary import HEAD, found, groups, pictures

_TITLE = "Cusumano & Bai (1993), reproduced"
_OPENING = """\
J. P. Cusumano, B.-Y. Bai, "Period-infinity periodic motions, chaos, and spatial coherence in a 10
degree of freedom impact oscillator", Chaos, Solitons & Fractals 3 (1993) 515-535.

All numbers found are computed by the run that wrote this report. All quantities are dimensionless.
"""


def write_report(
    folder: Path, sections: Sequence[Section], compiling: float, seconds: float
) -> Path:
    """Write the report, as Markdown and as a page, and return the page's path."""
    times = [[section.item, f"{section.total:.2f}", _parts(section)] for section in sections]
    left_out = [item for item in paper.ITEMS if item not in [each.item for each in sections]]
    cost = [
        table(["item", "seconds", "of which"], times),
        f"Compiling or loading the kernels: {compiling:.1f} s. In all: {seconds:.1f} s.",
        _machine(),
    ]
    if left_out:
        cost.append(f"Left out of this run: {', '.join(left_out)}.")
    closing = "\n\n".join(cost)
    parts = [
        f"# {_TITLE}",
        *(f"![{title}]({name}.png)" for name, title in pictures(sections)),
        f"{found(sections)}\n\n{_OPENING}",
        *(f"## {name}\n\n{table(HEAD, rows)}" for name, rows in groups(sections)),
        *(_written(section) for section in sections),
        f"## Cost\n\n{closing}",
    ]
    write_text(folder / "report.md", "\n\n".join(part.strip() for part in parts) + "\n")
    return write_page(folder / "report.html", _TITLE, _OPENING, sections, [("Cost", closing)])


def _written(section: Section) -> str:
    figures = [
        f"![{section.title}]({name}.png)\n\n[as SVG]({name}.svg)" for name in section.figures
    ]
    page = [f"[{LOOK}]({section.page})"] if section.page else []
    return "\n\n".join([f"## {section.title}", *figures, *page, section.text])


def _parts(section: Section) -> str:
    return ", ".join(f"{name} {seconds:.2f}" for name, seconds in section.seconds.items())


def _machine() -> str:
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "matplotlib"))
    return (
        f"dynkit {__version__}, Python {platform.python_version()}, {libraries}; "
        f"{platform.machine()}, {os.cpu_count()} processors."
    )
