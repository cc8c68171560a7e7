"""The figure of the resonances: energy and contact along the branches, over the sweep."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynkit.plotting.figures import print_style
from tutorials.cusumano_bai_1993.drawing import DOTS
from tutorials.cusumano_bai_1993.paper import SYMBOLS
from tutorials.cusumano_bai_1993.resonances.branches import contacts_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dynkit import Sweep
    from tutorials.cusumano_bai_1993.arrays import Array
    from tutorials.cusumano_bai_1993.resonances.branches import Ridge

# How much is shown on both sides of a branch, in lengths of it.
_MARGIN = 0.6
_DOTS: dict[str, Any] = {**DOTS, "color": "0.6", "markersize": 2.2}
_ENDS: dict[str, Any] = {
    **DOTS,
    "marker": "D",
    "color": "black",
    "markeredgewidth": 0.8,
    "markersize": 4.0,
}


def draw(ridges: Sequence[Ridge], sweep: Sweep) -> Figure:
    """Return the figure: a column for each resonance."""
    from matplotlib.figure import Figure

    with print_style():
        figure = Figure(figsize=(6.8, 3.8))
        panels = figure.subplots(2, len(ridges), sharex="col", squeeze=False)
        for column, ridge in enumerate(ridges):
            upper, lower = panels[:, column]
            low, high = float(ridge.frequencies.min()), float(ridge.frequencies.max())
            reach = _MARGIN * (high - low)
            lower.set_xlim(low - reach, high + reach)
            shown = (sweep.values >= low - reach) & (sweep.values <= high + reach)
            places = np.flatnonzero(shown).tolist()
            _energies(upper, ridge, sweep, places)
            _contacts(lower, ridge, sweep, places)
            lower.set_xlabel(rf"frequency ${SYMBOLS['frequency']}$")
        panels[0, 0].set_ylabel("energy after impacts")
        panels[1, 0].set_ylabel("contact, share of period")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _energies(axes: Axes, ridge: Ridge, sweep: Sweep, places: Sequence[int]) -> None:
    energies = sweep.observable("energy")[list(places)]
    axes.plot(sweep.values[list(places)], energies, label=None, **_DOTS)
    if len(places):
        axes.plot([], [], label="sweep of figure 6a", **_DOTS)
    _curve(axes, ridge, ridge.energies)
    axes.set_ylim(bottom=0.0)
    axes.set_title(ridge.branch.label)


def _contacts(axes: Axes, ridge: Ridge, sweep: Sweep, places: Sequence[int]) -> None:
    for place in places:
        contacts = contacts_of(sweep, place)
        frequency = float(sweep.values[place])
        period = 2.0 * np.pi * ridge.periods / frequency
        shares = (contacts[:, 1] - contacts[:, 0]) / period if len(contacts) else np.zeros(1)
        axes.plot(np.full(len(shares), frequency), shares, **_DOTS)
    _curve(axes, ridge, ridge.contacts)
    axes.set_ylim(bottom=-0.06 * float(ridge.contacts.max()))


def _curve(axes: Axes, ridge: Ridge, values: Array) -> None:
    """Stable orbits are solid, unstable ones dashed; the ends are marked."""
    named = {}
    inner = ridge.branch.stable[np.argsort(ridge.branch.parameter)]
    for stable, places in _parts(np.concatenate([inner[:1], inner, inner[-1:]])):
        style = "-" if stable else "--"
        name = "stable orbits" if stable else "unstable orbits"
        axes.plot(
            ridge.frequencies[places],
            values[places],
            style,
            color="black",
            linewidth=1.1,
            label=None if name in named else name,
        )
        named[name] = True
    ends = ridge.frequencies[[0, -1]], values[[0, -1]]
    axes.plot(*ends, label="ends (CB)", markerfacecolor="white", **_ENDS)


def _parts(stable: NDArray[np.bool_]) -> Iterator[tuple[bool, slice]]:
    """Runs of points of one kind, each with the first point of the next."""
    cuts = np.flatnonzero(np.diff(stable.astype(int))) + 1
    edges = [0, *cuts.tolist(), len(stable)]
    for begin, end in pairwise(edges):
        yield bool(stable[begin]), slice(begin, min(end + 1, len(stable)))
