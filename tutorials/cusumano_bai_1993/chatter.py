"""Figure 3: the ratio of successive flight times in a sticking event."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynkit.analysis import ChatterRatios
from dynkit.plotting.figures import new_figure, print_style, save_figure
from dynkit.systems import ImpactChain, ImpactState
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.arrays import Array
from tutorials.cusumano_bai_1993.drawing import DOTS
from tutorials.cusumano_bai_1993.section import Finding, Section, table
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop

# Bounces over which the ratios are compared with the restitution, and those that are drawn.
_FIRST, _LAST, _DRAWN = 50, 300, 340
# Ratios of rounded flights are astray so far from the limit; not counted are the first.
_ASTRAY, _UNEVEN = 0.01, 20
# A power is fitted to so many ratios; it is one when it differs by less.
_FITTED, _LINEAR = 10, 0.1


def figure_3(workshop: Workshop) -> Section:
    """Make figure 3."""
    watch = Stopwatch()
    chain = workshop.chain(paper.PEAKS[1])
    with watch.time("simulation"):
        start = _before_sticking(chain)
        bouncing = chain.replace(chatter_tolerance=0.0)
        flights = _flights(bouncing, start, _DRAWN + 20)
        # the same flights as differences of times that count from one start, as in the paper
        times = bouncing.simulate(impacts=len(flights), start=start).time
    chatter = ChatterRatios(flights)
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = np.diff(times, prepend=0.0)[chatter.begin :]
        rounded = lengths[1:] / lengths[:-1]
    limit = paper.RESTITUTION
    deviation = chatter.deviation(limit, first=_FIRST, last=_LAST)
    rounding = chatter.deviation(limit, first=_LAST - 99, last=_LAST)
    with watch.time("drawing"), print_style():
        _draw(workshop, chatter, rounded[:_DRAWN], limit)
    rows = [
        [
            bounce,
            f"{chatter.flights[bounce]:.2e}",
            f"{chatter.ratios[bounce - 1]:.12f}",
            f"{chatter.ratios[bounce - 1] - limit:+.1e}",
            f"{rounded[bounce - 1]:.6g}".replace("nan", "-"),  # of two flights of no length
        ]
        for bounce in (1, 5, 10, 20, 50, 80, 100, 200, 300)
    ]
    text = (
        f"One sticking event at frequency {chain.frequency} (restitution {limit}), with the "
        "replacement of chatter by contact switched off. The paper's ratios follow the restitution "
        f"for about {paper.DIVERGENCE} bounces, until flights are as short as the rounding of the "
        "time; here each flight is found by itself, and its length is not a difference of times. "
        "The open circles are the same flights as differences of times that count from the last "
        f"long flight: they {astray(rounded, limit)}.\n\n"
        + table(
            ["bounce", "flight time", "ratio", "less the restitution", "from rounded times"], rows
        )
        + f"\n\nLargest distance of the ratio from the restitution over bounces {_FIRST} to "
        f"{_LAST}: {deviation:.1e}; over the last hundred of them {rounding:.1e}, which is taken "
        f"as the error. {approach(chatter, limit, 10.0 * rounding)}"
    )
    return Section(
        "figure-3",
        "Figure 3: flight times in a sticking event",
        text,
        [
            Finding(
                "limit of the ratio",
                f"{limit}, up to bounce {paper.DIVERGENCE} or so",
                f"{np.median(chatter.ratios[_LAST - 100 : _LAST]):.12g}; within {deviation:.0e} of "
                f"{limit} from bounce {_FIRST} to {_LAST}",
                f"{rounding:.0e}",
                bool(abs(np.median(chatter.ratios[_LAST - 100 : _LAST]) - limit) < 0.005),
            )
        ],
        ["figure-3"],
        watch.seconds,
    )


def astray(ratios: Array, limit: float) -> str:
    """Return from which bounce on ratios of rounded flights are far from their limit.

    The first ratios, of flights that are not short yet, are not looked at.
    """
    far = np.flatnonzero(~(abs(ratios[_UNEVEN:] - limit) < _ASTRAY))
    if not len(far):
        return f"stay within {_ASTRAY:g} of it over {len(ratios)} bounces"
    return f"go astray by more than {_ASTRAY:g} at bounce {_UNEVEN + int(far[0]) + 1}"


def approach(chatter: ChatterRatios, limit: float, least: float) -> str:
    """Return how the ratios approach a limit, as long as they are farther from it than `least`."""
    away = abs(chatter.ratios - limit)
    count = int(np.argmax(away <= least)) if (away <= least).any() else len(away)
    if count < _FITTED:
        return f"The ratio is within {least:.0e} of it from bounce {count + 1} on."
    power = np.polyfit(np.log(chatter.flights[:count]), np.log(away[:count]), 1)[0]
    words = f"Up to bounce {count} the distance falls as the power {power:.2f} of the flight time"
    if abs(power - 1.0) < _LINEAR and count >= _FIRST:
        return f"{words}: what is left at bounce {_FIRST} is the approach to the limit, no error."
    return f"{words}."


def _before_sticking(chain: ImpactChain) -> ImpactState:
    """The state on the settled motion after its longest flight, which ends in a chatter."""
    state = chain.attractor(transient=5000, impacts=1).final
    longest, start = 0.0, state
    for _ in range(200):
        record = chain.simulate(impacts=1, start=state)
        if record.time[0] > longest:
            longest, start = float(record.time[0]), record.final
        state = record.final
    return start


def _flights(chain: ImpactChain, state: ImpactState, count: int) -> Array:
    """Flight times, (count,), each to full precision: every flight has a clock of its own."""
    flights = np.empty(count)
    for i in range(count):
        record = chain.simulate(impacts=1, start=state)
        flights[i] = record.time[0]
        state = record.final
    return flights


def _draw(workshop: Workshop, chatter: ChatterRatios, rounded: Array, limit: float) -> None:
    figure, (above, below) = new_figure(height=4.4, rows=2)
    open_circles: dict[str, Any] = {
        **DOTS,
        "markersize": 2.4,
        "markeredgewidth": 0.4,
        "markeredgecolor": "0.45",
        "color": "none",
    }
    bounces = chatter.bounces[: len(rounded)]
    above.axhline(limit, color="0.6", linewidth=0.8, label=f"restitution $r = {limit}$", zorder=0)
    above.plot(bounces, rounded, **open_circles, label="differences of times")
    chatter.plot(above, label="each flight by itself")
    above.set_ylim(0.47, 1.05)
    above.legend(loc="lower left", bbox_to_anchor=(0.05, 0.0))
    # no logarithm of a ratio that meets its limit to the last bit
    least = np.spacing(limit) / 2.0
    below.plot(bounces, np.maximum(abs(rounded - limit), least), **open_circles)
    distance = np.maximum(abs(chatter.ratios - limit), least)
    below.plot(chatter.bounces, distance, markersize=1.6, color="black", **DOTS)
    below.set_yscale("log")
    below.set_xlabel("bounce number $n$")
    below.set_ylabel(r"distance to the restitution")
    for axes in (above, below):
        axes.set_xlim(0.0, len(rounded))
    save_figure(figure, workshop.folder / "figure-3")
