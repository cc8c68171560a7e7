"""The items of the reproduction by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from dynkit.cli.reproduce.branches import figure_4_branches
from dynkit.cli.reproduce.chatter import figure_3
from dynkit.cli.reproduce.diagrams import figure_4, figure_5
from dynkit.cli.reproduce.differences import differences
from dynkit.cli.reproduce.energies import figure_6a, figure_6b
from dynkit.cli.reproduce.frequencies import table_a1
from dynkit.cli.reproduce.section import Section
from dynkit.cli.reproduce.workshop import Workshop

MAKERS: Mapping[str, Callable[[Workshop], Section]] = {
    "table-a1": table_a1,
    "figure-3": figure_3,
    "figure-4": figure_4,
    "figure-4-branches": figure_4_branches,
    "figure-5": figure_5,
    "figure-6a": figure_6a,
    "figure-6b": figure_6b,
    "differences": differences,
}
"""What makes each item, and writes its figures."""
