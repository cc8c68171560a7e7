"""Animations of records: the sketch of the machine in motion, above a time series."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from dynkit.core.validation import Array, in_interval, positive_integer
from dynkit.plotting.figures import ink, new_figure, print_style
from dynkit.systems.impact.records.event_counts import element_names
from dynkit.systems.impact.records.sketch import MASS_DISTANCE, ROOM, Pose, sketch

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

    from dynkit.systems.impact.impact_map import ImpactMap

_PERIODS, _INTERVAL, _FADES = 6.0, 40, 4.0
"""Number of periods shown by default; milliseconds between frames; number of frames in which the
mark of an impact fades."""

_REACH = 0.75
"""Largest change of a distance between masses, relative to that distance in the sketch."""


@print_style()
def animate(
    record: Any, begin: float | None, end: float | None, frames: int, element: str | None
) -> FuncAnimation:
    """Animate a record; see `ImpactRecord.animate`."""
    from matplotlib.animation import FuncAnimation

    count = positive_integer("frames", frames)
    last = float(record.time[-1]) if len(record.time) else 0.0
    until = in_interval("end", last if end is None else end, 0.0, last)
    shown = _PERIODS * 2.0 * math.pi / record.system.frequency
    since = in_interval("begin", max(until - shown, 0.0) if begin is None else begin, 0.0, until)
    times = np.linspace(since, until, count)
    figure, (above, below) = new_figure(7.0, 4.2, rows=2)
    record.plot(below, element, begin=since, end=until)
    now = below.axvline(since, color=ink(), linewidth=1.2)
    poses = poses_at(record, times)
    limits = _limits(above, record.system, poses)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")

    def show(k: int) -> list[Any]:
        # faster than clearing the axes, after which their ticks would be computed again
        for drawn in (*above.lines, *above.patches, *above.collections, *above.texts):
            drawn.remove()
        sketch(above, record.system, poses[k])
        above.set(xlim=limits[0], ylim=limits[1])
        now.set_xdata([times[k]] * 2)
        return []

    class Film(FuncAnimation):
        def _repr_html_(self) -> str:
            return str(self.to_jshtml(default_mode="loop"))

    return Film(figure, show, frames=count, interval=_INTERVAL, blit=False)


def poses_at(record: Any, times: Array) -> list[Pose]:
    """Poses of the machine at times (k,), in units of the sketch."""
    system, names = record.system, element_names(record.system)
    x = record.sample(times)[0]
    scale = _scale(system, x)
    gaps, slips = (
        {
            name: record.observable(f"{name}.{what}", times)
            for name in names
            for what in kinds
            if f"{name}.{what}" in system.observables
        }
        for kinds in (("gap", "stretch"), ("slip_velocity",))
    )
    fading = _FADES * (times[-1] - times[0]) / max(len(times) - 1, 1)
    struck = {name: _since(record, names.index(name), times) for name in gaps}
    shift = scale * x
    margin = MASS_DISTANCE * (x.shape[1] - 1) + ROOM + max(float(shift[:, -1].max()), 0.0)
    return [
        Pose(
            shift[i],
            {name: scale * float(gap[i]) for name, gap in gaps.items()},
            {name: 1.0 - ago[i] / fading for name, ago in struck.items() if ago[i] < fading},
            [name for name, slip in slips.items() if slip[i] == 0.0],
            margin,
        )
        for i in range(len(times))
    ]


def _since(record: Any, element: int, times: Array) -> Array:
    """Times since the last impact with a stop, (k,); infinite before the first one."""
    hits = np.append(-math.inf, record.time[record.element == element])
    return np.asarray(times - hits[np.searchsorted(hits, times, side="right") - 1])


def _limits(ax: Any, system: ImpactMap, poses: list[Pose]) -> Any:
    """Limits (2, 2) of both axes that contain all poses; the extreme poses are drawn for this."""
    numbers = np.array([[*pose.shift, *pose.gaps.values()] for pose in poses])
    found = []
    for k in {*numbers.argmin(axis=0).tolist(), *numbers.argmax(axis=0).tolist()}:
        ax.clear()
        sketch(ax, system, poses[k])
        found.append([ax.get_xlim(), ax.get_ylim()])
    low, high = np.min(found, axis=0)[:, 0], np.max(found, axis=0)[:, 1]
    return np.stack([low, high], axis=1)


def _scale(system: ImpactMap, x: Array) -> float:
    """Units of the sketch per unit of length, so that masses do not overlap."""
    tied = abs(system.stiffness.sum(axis=1)) > 0.0
    apart = abs(np.diff(x, axis=1)).max(initial=0.0)
    reach = max(apart, abs(x[:, tied]).max(initial=0.0)) or abs(x).max(initial=0.0)
    return _REACH * ROOM / float(reach) if reach else 1.0
