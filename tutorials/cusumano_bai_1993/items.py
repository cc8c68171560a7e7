"""The items of the reproduction by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from tutorials.cusumano_bai_1993.branches import figure_4_branches
from tutorials.cusumano_bai_1993.chatter import figure_3
from tutorials.cusumano_bai_1993.diagrams import figure_4, figure_5
from tutorials.cusumano_bai_1993.differences import differences
from tutorials.cusumano_bai_1993.energies import figure_6a, figure_6b
from tutorials.cusumano_bai_1993.frequencies import table_a1
from tutorials.cusumano_bai_1993.measures.modes import figure_14, figure_15
from tutorials.cusumano_bai_1993.measures.table_1 import table_1
from tutorials.cusumano_bai_1993.orbits import (
    figure_7,
    figure_8,
    figure_9,
    figure_10,
    figure_11,
    figure_12,
)
from tutorials.cusumano_bai_1993.resonances import resonances
from tutorials.cusumano_bai_1993.section import Section
from tutorials.cusumano_bai_1993.surfaces import figure_13, figure_16, figure_17
from tutorials.cusumano_bai_1993.workshop import Workshop

MAKERS: Mapping[str, Callable[[Workshop], Section]] = {
    "table-a1": table_a1,
    "figure-3": figure_3,
    "figure-4": figure_4,
    "figure-4-branches": figure_4_branches,
    "figure-5": figure_5,
    "figure-6a": figure_6a,
    "figure-6b": figure_6b,
    "resonances": resonances,
    "figure-7": figure_7,
    "figure-8": figure_8,
    "figure-9": figure_9,
    "figure-10": figure_10,
    "figure-11": figure_11,
    "figure-12": figure_12,
    "figure-13": figure_13,
    "figure-14": figure_14,
    "figure-15": figure_15,
    "figure-16": figure_16,
    "figure-17": figure_17,
    "table-1": table_1,
    "differences": differences,
}
"""What makes each item, and writes its figures."""
