"""Figures 4 and 5: the bifurcation diagram and its blow-ups."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from dynkit.analysis import BifurcationDiagram
from dynkit.plotting.figures import new_figure, save_figure
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.paper import SYMBOLS
from tutorials.cusumano_bai_1993.section import Finding, Section, table
from tutorials.cusumano_bai_1993.workshop import (
    Stopwatch,
    Workshop,
    error_of,
)

if TYPE_CHECKING:
    from dynkit import Sweep

# Intervals of one label that the report lists have so many values.
_LISTED = 5


def figure_4(workshop: Workshop) -> Section:
    """Make figure 4, and compare its labels."""
    watch = Stopwatch()
    with watch.time("sweep"):
        sweep = workshop.sweep
    with watch.time("labels"):
        diagram = BifurcationDiagram.of(sweep, symbols=SYMBOLS)
    with watch.time("error"):
        error, words = workshop.sweep_error
    with watch.time("drawing"):
        figure, (axes,) = new_figure(height=3.1)
        diagram.plot(axes).set_ylim(0.0, None)
        save_figure(figure, workshop.folder / "figure-4")
    rows, agreeing = [], 0
    for frequency, expected in paper.LABELS.items():
        place = int(np.argmin(abs(sweep.values - frequency)))
        label = sweep.label(place)
        agreeing += str(label) == expected
        rows.append(
            [
                f"{frequency:g}",
                expected,
                str(label),
                "yes" if str(label) == expected else "no",
                f"{label.recurrence:.0e}",
                label.simulated,
            ]
        )
    velocity = sweep.observable("relative_velocity")
    cost = sweep.cost
    text = (
        f"{velocity.size} points: {len(sweep)} frequencies from {sweep.values[0]:g} to "
        f"{sweep.values[-1]:g} in steps of {paper.FREQUENCIES[2]:g}, at each of them "
        f"{paper.TRANSIENT} impacts skipped and {paper.KEPT} kept, each started from the last "
        f"state before it. The relative velocity just after impact reaches "
        f"{np.nanmax(velocity):.3f}; the paper's axis ends at {paper.AXIS_4}. "
        f"{cost.counts['impacts']} impacts and {cost.counts['contacts']} intervals of sticking "
        f"took {cost.seconds:.2f} s. {words}\n\n"
        "Above the axes the bar changes between black and white with every change of label; the "
        "widest intervals are named.\n\n"
        "Labels along the sweep. What is expected is what an independent computation gave. "
        "Recurrence is the distance of states one period apart, relative to the "
        "largest state; impacts are those that the label was decided from.\n\n"
        + table(["frequency", "expected", "found", "agrees", "recurrence", "impacts"], rows)
        + "\n\n"
        + _shares(sweep)
    )
    return Section(
        "figure-4",
        "Figure 4: bifurcation diagram",
        text,
        [
            Finding(
                "labels along the sweep",
                f"{len(rows)} expected",
                f"{agreeing} of {len(rows)} agree",
                f"states {error}",
                agreeing == len(rows),
            ),
            Finding(
                "relative velocity",
                f"axis 0 to {paper.AXIS_4}",
                f"0 to {np.nanmax(velocity):.3f}",
                f"{error}",
                bool(np.nanmax(velocity) <= paper.AXIS_4),
            ),
        ],
        ["figure-4"],
        watch.seconds,
    )


def figure_5(workshop: Workshop) -> Section:
    """Make figure 5: both blow-ups, one under the other."""
    watch = Stopwatch()
    with watch.time("sweep"):
        sweeps = workshop.blow_ups
    figure, panels = new_figure(height=5.6, rows=len(sweeps))
    parts, findings = [], []
    for sweep, top, axes in zip(sweeps, paper.AXES_5, panels, strict=True):
        with watch.time("labels"):
            diagram = BifurcationDiagram.of(sweep, symbols=SYMBOLS)
        with watch.time("error"):
            error, words = error_of(sweep)
        with watch.time("drawing"):
            diagram.plot(axes).set_ylim(0.0, top)
        part, found = _blow_up(diagram, sweep, words)
        parts.append(part)
        findings.append(
            Finding(
                f"sticking motions, {sweep.values[0]:g} to {sweep.values[-1]:g}",
                "three in both blow-ups",
                found,
                f"states {error}",
            )
        )
    with watch.time("drawing"):
        save_figure(figure, workshop.folder / "figure-5")
    return Section(
        "figure-5",
        "Figure 5: blow-ups",
        "\n\n".join(parts),
        findings,
        ["figure-5"],
        watch.seconds,
    )


def _blow_up(diagram: BifurcationDiagram, sweep: Sweep, words: str) -> tuple[str, str]:
    """What is said of one blow-up, and its motions with sticking."""
    wide = [interval for interval in diagram.intervals if interval.count >= _LISTED]
    sticking = dict.fromkeys(each.label for each in wide if each.label.startswith("P(inf"))
    others = {
        each.label
        for each in diagram.intervals
        if each.label.startswith("P(inf") and each.label not in sticking
    }
    found = ", ".join(sticking) or "none"
    if others:
        found += f", and {len(others)} in fewer than {_LISTED} successive values"
    rows = [
        [interval.label, f"{interval.low:.4f}", f"{interval.high:.4f}", interval.count]
        for interval in wide
    ]
    highest = np.nanmax(sweep.observable("relative_velocity"))
    step = sweep.values[1] - sweep.values[0]
    part = (
        f"### {sweep.values[0]:g} to {sweep.values[-1]:g}\n\n"
        f"{len(sweep)} frequencies in steps of {step:g}, the first from the state that figure 4 "
        f"has there; {sweep.cost.seconds:.2f} s. The relative velocity reaches {highest:.4f}; the "
        f"axis is the paper's. {words} Motions with sticking: {found}.\n\n"
        f"Intervals of {_LISTED} values and more:\n\n"
        + table(["label", "from", "to", "values"], rows)
    )
    return part, found


def _shares(sweep: Sweep) -> str:
    """The commonest labels of a sweep."""
    counts = Counter(map(str, sweep.labels)).most_common()
    named = ", ".join(f"{label} {count}" for label, count in counts[:16])
    more = f", and {len(counts) - 16} more labels" if len(counts) > 16 else ""
    return f"Values by label: {named}{more}."
