"""Complete numbers beside ticks, without an offset or a power of ten at the end of the axis."""

from __future__ import annotations

import math
from typing import Any, final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import Formatter

# Width of a letter in sizes of the type.
_LETTER = 0.6
# Numbers outside this range have a power of ten; doubles have no more decimals.
_PLAIN, _DECIMALS = (1e-4, 1e6), 15


@final
class WholeNumbers(Formatter):
    """Writes the complete number beside each tick; if they are too long, only beside some ticks."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        del pos
        return self.fix_minus(f"{x:.6g}")

    def format_ticks(self, values: Any) -> list[str]:
        axis: Any = self.axis
        low, high = sorted(axis.get_view_interval())
        seen = [value for value in values if low <= value <= high]
        largest = max(map(abs, seen), default=0.0)
        plain = largest == 0.0 or _PLAIN[0] <= largest < _PLAIN[1]
        power = 0 if plain else math.floor(math.log10(largest))
        scaled = np.asarray(values, dtype=float) / 10.0**power
        decimals = _decimals(scaled)
        texts = [self.fix_minus(f"{value:.{decimals}f}") for value in scaled]
        letters = 1 + max(map(len, texts), default=0) + (0 if plain else 4)
        if not plain:
            texts = [rf"{text}$\cdot 10^{{{power}}}$" for text in texts]
        if axis.axis_name != "x":
            return texts
        width = 72.0 * axis.axes.bbox.width / axis.axes.get_figure(root=True).dpi
        size = axis.get_major_ticks(1)[0].label1.get_size()
        step = max(1, math.ceil(_LETTER * size * letters * len(seen) / width))
        return [text if i % step == 0 else "" for i, text in enumerate(texts)]


def _decimals(values: Any) -> int:
    """Return the least number of decimals with an error below 1e-3 of the values' spacing."""
    apart = abs(np.diff(values)).min(initial=abs(values).max(initial=1.0))
    for decimals in range(_DECIMALS):
        if (abs(values - values.round(decimals)) <= 1e-3 * apart).all():
            return decimals
    return _DECIMALS


def write_whole_numbers(axes: Axes) -> Axes:
    """Let both axes write complete numbers beside their ticks, and return the axes."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(WholeNumbers())
    return axes
