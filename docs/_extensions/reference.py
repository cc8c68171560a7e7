"""The page of the reference that follows from the public names of `dynkit.analysis`."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import dynkit.analysis
from tests.public_classes import classes_met

HEADINGS = {False: "`dynkit.analysis`: measures", True: "Error against run time"}
"""Headings; the second is that of the package `work_precision`."""


def analysis_page() -> str:
    """Return the page: all public names, and below them the classes that their members return."""
    members = [getattr(dynkit.analysis, name) for name in dynkit.analysis.__all__]
    given = [kind for kind in classes_met() if kind not in members]
    given = [kind for kind in given if kind.__module__.startswith("dynkit.analysis.")]
    lines: list[str] = []
    for late, names in groupby(sorted(members, key=_is_late), key=_is_late):
        lines += [f"{'##' if late else '#'} {HEADINGS[late]}", ""]
        lines += _table("dynkit.analysis", (member.__name__ for member in names))
        lines += ["Classes that they return:", ""]
        lines += _table("dynkit", (_path(kind) for kind in given if _is_late(kind) == late))
    return "\n".join(lines)


def _is_late(member: object) -> bool:
    return ".work_precision." in member.__module__


def _path(kind: type) -> str:
    return f"~{kind.__module__.removeprefix('dynkit.')}.{kind.__name__}"


def _table(module: str, names: Iterable[str]) -> list[str]:
    head = ["```{eval-rst}", f".. currentmodule:: {module}", ".. autosummary::"]
    return [*head, "   :toctree: generated", "", *(f"   {name}" for name in names), "```", ""]
