"""Figures of correlation sums and local slopes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dynkit.analysis.dimension.scaling import Estimate, LocalSlopes, Outcome, Scaling
from dynkit.analysis.dimension.sums import CorrelationSums
from dynkit.plotting.figures import DOTS, ink, print_style, shown_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# largest relative error of drawn slopes: less accurate ones would only stretch the axes
_UNKNOWN = 0.5


@print_style()
def draw_sums(
    sums: CorrelationSums, scaling: Scaling, error: float, ax: Axes | None, label: str | None
) -> Axes:
    """Draw the correlation sum against the radius, and the scaling region with its line.

    `error` is that of the dimension.
    """
    region = scaling.region
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
    axes.set(xlabel="radius $r$", ylabel="correlation sum $C(r)$")
    _describe(scaling, error, axes)
    return axes


@print_style()
def draw_slopes(
    slopes: LocalSlopes,
    scaling: Scaling,
    takens: Estimate,
    error: float,
    ax: Axes | None,
    label: str | None,
) -> Axes:
    """Draw the local slopes with one standard error, the scaling region and both estimates.

    `error` is that of the dimension.
    """
    region = scaling.region
    axes = shown_axes(ax)
    known = slopes.errors <= _UNKNOWN * np.maximum(slopes.values, 1.0)
    radii, values, errors = (a[known] for a in (slopes.radii, slopes.values, slopes.errors))
    axes.fill_between(radii, values - errors, values + errors, color=ink(0.8), linewidth=0.0)
    axes.semilogx(radii, values, color=ink(), label=label)
    if region is not None:
        ends = [region.low, region.high]
        axes.semilogx(ends, 2 * [region.slope], color=ink(), linestyle="--")
        if scaling.outcome in (Outcome.FOUND, Outcome.DRIFT):
            axes.semilogx(ends, 2 * [takens.value], color=ink(), linestyle=":")
    axes.set(xlabel="radius $r$", ylabel=r"local slope $d \ln C / d \ln r$")
    _describe(scaling, error, axes)
    return axes


def _describe(scaling: Scaling, error: float, axes: Axes) -> None:
    region = scaling.region
    if region is None:
        axes.set_title(scaling.outcome.value)
        return
    axes.axvspan(region.low, region.high, color=ink(0.93), linewidth=0.0, zorder=0)
    decades = math.log10(region.ratio)
    title = f"$d_c = {region.slope:.3f} \\pm {error:.3f}$ over {decades:.1f} decades"
    if scaling.outcome is Outcome.DRIFT:
        title += f"\n{scaling.outcome.value}"
    axes.set_title(title)
