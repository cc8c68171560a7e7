"""Correlation sums and local slopes on paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynkit.analysis.dimension.scaling import Estimate, Outcome
from dynkit.plotting.figures import DOTS, ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynkit.analysis.dimension.dimension import CorrelationDimension

# beyond this the slopes say nothing, and would only stretch the axes
_UNKNOWN = 0.5


@print_style()
def draw_sums(dimension: CorrelationDimension, ax: Axes | None, label: str | None) -> Axes:
    """Draw the correlation sum against the radius, and the scaling region with its line."""
    sums, region = dimension.sums, dimension.region
    axes = shown_axes(ax)
    there = sums.pairs > 0
    axes.loglog(
        sums.radii[there], sums.values[there], markersize=1.6, label=label, color=ink(), **DOTS
    )
    if region is not None:
        inside = there & (sums.radii >= region.low) & (sums.radii <= region.high)
        radii, logs = sums.radii[inside], np.log(sums.values[inside])
        line = logs.mean() + region.slope * (np.log(radii) - np.log(radii).mean())
        axes.loglog(radii, np.exp(line), color=ink())
    axes.set_xlabel("radius $r$")
    axes.set_ylabel("correlation sum $C(r)$")
    _describe(dimension, axes)
    return axes


@print_style()
def draw_slopes(dimension: CorrelationDimension, ax: Axes | None, label: str | None) -> Axes:
    """Draw the local slopes with one standard error, the scaling region and both estimates."""
    slopes, region = dimension.local_slopes, dimension.region
    axes = shown_axes(ax)
    known = slopes.errors <= _UNKNOWN * np.maximum(slopes.values, 1.0)
    radii, values, errors = (a[known] for a in (slopes.radii, slopes.values, slopes.errors))
    axes.fill_between(radii, values - errors, values + errors, color=ink(0.8), linewidth=0.0)
    axes.semilogx(radii, values, color=ink(), label=label)
    if region is not None:
        ends = [region.low, region.high]
        axes.semilogx(ends, 2 * [region.slope], color=ink(), linestyle="--")
        if dimension.outcome in (Outcome.FOUND, Outcome.DRIFT):
            axes.semilogx(ends, 2 * [dimension.takens.value], color=ink(), linestyle=":")
    axes.set_xlabel("radius $r$")
    axes.set_ylabel(r"local slope $d \ln C / d \ln r$")
    _describe(dimension, axes)
    return axes


def _describe(dimension: CorrelationDimension, axes: Axes) -> None:
    region = dimension.region
    if region is None:
        axes.set_title(dimension.outcome.value)
        return
    axes.axvspan(region.low, region.high, color=ink(0.93), linewidth=0.0, zorder=0)
    found = Estimate(dimension.value, dimension.error)
    value = f"{found.value:.3f} \\pm {found.error:.3f}"
    title = f"$d_c = {value}$, {region.ratio:.3g}:1"
    if dimension.outcome is Outcome.DRIFT:
        title += f"\n{dimension.outcome.value}"
    axes.set_title(title)
