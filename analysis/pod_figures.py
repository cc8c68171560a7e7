"""Figures of proper orthogonal decompositions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynkit.core.validation import Array
from dynkit.plotting.figures import COLUMN_WIDTH, ink, print_style, shown_axes, shown_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.analysis.regimes import RegimeChange

# Styles that distinguish curves in black and white.
_STYLES, _MARKERS = ("-", "--", ":", "-."), ("o", "s", "^", "D")


@print_style()
def draw_cumulative(
    cumulative: Array,
    change: RegimeChange | None,
    ax: Axes | None,
    rank: int,
    share: float,
    label: str | None,
) -> Axes:
    """Draw the cumulative power; see `POD.plot`."""
    from matplotlib.ticker import MaxNLocator

    axes = shown_axes(ax)
    numbers = np.arange(1, len(cumulative) + 1)
    drawn = sum(line.get_marker() in _MARKERS for line in axes.lines)
    (line,) = axes.plot(
        numbers, cumulative, color=ink(), marker=_MARKERS[drawn % len(_MARKERS)],
        markersize=2.8, markerfacecolor=ink(drawn % 2),
        markeredgewidth=0.6, linewidth=0.8, label=label, linestyle=_STYLES[drawn % len(_STYLES)],
    )  # fmt: skip
    axes.annotate(
        "",
        xy=(rank, float(cumulative[rank - 1])),
        xytext=(0.0, -16.0),
        textcoords="offset points",
        arrowprops={"arrowstyle": "->", "linewidth": 0.6, "color": line.get_color()},
    )
    if not drawn:
        _mark_share(axes, share)
    axes.set(xlabel="number of modes", ylabel="cumulative power")
    if change is not None:
        axes.set_title(str(change), fontsize="small")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return axes


def _mark_share(axes: Axes, share: float) -> None:
    axes.axhline(share, color=ink(0.7), linewidth=0.5, zorder=0)
    axes.annotate(
        f"{100.0 * share:g} %",
        xy=(1.0, share),
        xycoords=axes.get_yaxis_transform(),
        xytext=(-3.0, -3.0),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=7.0,
    )


@print_style()
def draw_modes(
    modes: Array, ax: Sequence[Axes] | None, count: int, others: Array | None
) -> list[Axes]:
    """Draw modes (N, N) beside others (N, m), if any, of length one; see `POD.plot_modes`."""
    from matplotlib.ticker import MaxNLocator

    axes = _panels(count) if ax is None else list(ax)
    numbers = np.arange(1, len(modes) + 1)
    for k, panel in enumerate(axes):
        mode = modes[:, k]
        panel.axhline(0.0, color=ink(0.7), linewidth=0.5, zorder=0)
        panel.plot(numbers, mode, "o-", color=ink(), markersize=2.4, label="proper orthogonal")
        if others is None:
            panel.set_title(f"mode {k + 1}")
        else:
            cosines = mode @ others
            j = int(np.argmax(abs(cosines)))
            panel.plot(
                numbers, others[:, j] * np.copysign(1.0, cosines[j]), "s--", color=ink(),
                markersize=2.6, markerfacecolor=ink(1.0), markeredgewidth=0.6, label="normal",
            )  # fmt: skip
            panel.set_title(f"mode {k + 1}; normal mode {j + 1}: MAC {cosines[j] ** 2:.3f}")
        of = "coordinate" if others is None else "mass"
        panel.set(xlabel=f"{of} $j$", ylabel="amplitude")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[0].legend()
    return axes


def _panels(count: int) -> list[Axes]:
    columns = 1 if count == 1 else 2
    rows = -(-count // columns)
    figure = shown_figure(columns * COLUMN_WIDTH, 2.2 * rows)
    axes = figure.subplots(rows, columns, squeeze=False)
    panels: list[Axes] = list(axes.ravel())
    for spare in panels[count:]:
        figure.delaxes(spare)
    return panels[:count]
