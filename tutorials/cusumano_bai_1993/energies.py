"""Figures 6a and 6b: the energy just after impact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.analysis import BifurcationDiagram, mark_values
from dynkit.plotting.figures import new_figure, print_style, save_figure
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.paper import SYMBOLS
from tutorials.cusumano_bai_1993.section import Finding, Section, table
from tutorials.cusumano_bai_1993.workshop import (
    SteadyTableChain,
    Stopwatch,
    Workshop,
    error_of,
    frequencies,
)

if TYPE_CHECKING:
    from dynkit import Sweep
    from tutorials.cusumano_bai_1993.arrays import Array

# A peak is looked for so far on both sides of the paper's.
_REACH = 0.05
_CONSTANT = {"figure-6a": "amplitude", "figure-6b": "velocity"}


def figure_6a(workshop: Workshop) -> Section:
    """Make figure 6a: constant table amplitude."""
    watch = Stopwatch()
    with watch.time("sweep"):
        sweep = workshop.sweep
        blow_up = workshop.blow_ups[0]
    with watch.time("error"):
        error, _ = workshop.sweep_error
    at, _ = _peak(blow_up.values, _largest(blow_up), paper.PEAKS[1])
    words = (
        "The motions of figure 4, by their energy $E = (v^T v + x^T A x)/2$ just after impact; "
        "errors as there. On the finer grid of figure 5 the largest energy near "
        f"{paper.PEAKS[1]:g} is at {at:g}."
    )
    return _section(workshop, sweep, watch, "figure-6a", words, error, paper.AXIS_6A)


def figure_6b(workshop: Workshop) -> Section:
    """Make figure 6b: constant table velocity."""
    watch = Stopwatch()
    chain = SteadyTableChain(
        masses=paper.MASSES,
        damping=paper.DAMPING,
        restitution=paper.RESTITUTION,
        offset=paper.OFFSET,
        frequency=paper.FREQUENCIES[0],
        table_velocity=paper.TABLE_VELOCITY,
    )
    with watch.time("sweep"):
        sweep = workshop.swept(chain, frequencies(paper.FREQUENCIES))
    with watch.time("error"):
        error, about_error = error_of(sweep)
    words = (
        f"The sweep of figure 4 with another amplitude at each frequency, {paper.TABLE_VELOCITY:g} "
        "over the frequency, so that the largest velocity of the table is always the same. "
        f"{about_error}"
    )
    return _section(workshop, sweep, watch, "figure-6b", words, error, paper.AXIS_6B)


def _section(
    workshop: Workshop,
    sweep: Sweep,
    watch: Stopwatch,
    item: str,
    words: str,
    error: str,
    axis: float,
) -> Section:
    constant = _CONSTANT[item]
    largest = _largest(sweep)
    peaks = [_peak(sweep.values, largest, near) for near in paper.PEAKS]
    with watch.time("drawing"), print_style():
        natural = workshop.chain(paper.FREQUENCIES[0]).natural_frequencies
        _draw(workshop, sweep, natural, peaks, item)
    rows = []
    for near, (at, height) in zip(paper.PEAKS, peaks, strict=True):
        place = int(np.flatnonzero(sweep.values == at)[0])
        closest = natural[np.argmin(abs(natural - at))]
        rows.append(
            [f"{near:g}", f"{at:g}", f"{height:.5f}", str(sweep.label(place)), f"{closest:.5f}"]
        )
    text = (
        f"{words} The largest energy of all is {largest.max():.4f} at frequency "
        f"{sweep.values[largest.argmax()]:g} (the paper's axis ends at {axis:g}); above frequency "
        f"1 the largest energies have a median of {np.median(largest[sweep.values > 1.0]):.5f}. "
        "The natural frequencies are marked above the axes.\n\n"
        f"Peaks: the frequency of the largest energy within {_REACH:g} of the paper's, on the "
        f"grid of {paper.FREQUENCIES[2]:g}.\n\n"
        + table(["paper", "found", "energy", "motion there", "nearest natural frequency"], rows)
    )
    return Section(
        item,
        f"Figure 6{item[-1]}: energy at constant table {constant}",
        text,
        [
            Finding(
                f"peaks, constant {constant}",
                " and ".join(f"{near:g}" for near in paper.PEAKS),
                " and ".join(f"{at:g}" for at, _ in peaks),
                f"step {paper.FREQUENCIES[2]:g}; states {error}",
                all(
                    f"{near:g}" == f"{at:g}"
                    for near, (at, _) in zip(paper.PEAKS, peaks, strict=True)
                ),
            )
        ],
        [item],
        watch.seconds,
    )


def _largest(sweep: Sweep) -> Array:
    """The largest energy at each value, (k,)."""
    return np.asarray(np.nanmax(sweep.observable("energy"), axis=1))


def _peak(values: Array, largest: Array, near: float) -> tuple[float, float]:
    """Where the largest energy is, near a frequency, and how large."""
    around = np.flatnonzero(abs(values - near) <= _REACH)
    place = around[np.argmax(largest[around])]
    return float(values[place]), float(largest[place])


def _draw(
    workshop: Workshop,
    sweep: Sweep,
    natural: Array,
    peaks: list[tuple[float, float]],
    item: str,
) -> None:
    figure, (axes,) = new_figure(height=2.6)
    diagram = BifurcationDiagram.of(sweep, labelled=False, symbols=SYMBOLS)
    diagram.plot(axes, observable="energy").margins(y=0.08)
    axes.set_ylim(bottom=0.0)
    marks = {rf"$\omega_{{{i}}}$": value for i, value in enumerate(natural.tolist(), 1)}
    mark_values(axes, marks)
    for at, height in peaks:
        axes.annotate(
            f"{at:g}",
            (at, height),
            xytext=(-4.0, 2.0),
            textcoords="offset points",
            fontsize=7.0,
        )
    save_figure(figure, workshop.folder / item)
