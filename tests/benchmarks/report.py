"""Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable


def table(title: str, head: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a table under a title."""
    cells = [[str(cell) for cell in row] for row in rows]
    print(f"\n### {title}\n")
    print("| " + " | ".join(head) + " |")
    print("| " + " | ".join("---" for _ in head) + " |")
    for row in cells:
        print("| " + " | ".join(row) + " |")
