"""Space-time surfaces: displacements of all masses over time."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from dynkit.analysis.motions import Motion, given_samples
from dynkit.core.cost import Cost
from dynkit.core.kept import cached_property
from dynkit.core.reprs import span
from dynkit.core.validation import Array, read_only
from dynkit.data.dataset import Dataset, described
from dynkit.data.result import Saved
from dynkit.plotting.figures import COLUMN_WIDTH, ink, print_style, shown_figure

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]

# Largest number of lines across a surface that print can separate, and largest number of points of
# the lines along it.
_LINES, _POINTS = 100, 500

# Height of a figure, in inches.
_HEIGHT = 2.5


@final
class SpaceTime(Saved):
    """Displacements of all masses at given times.

    Parameters
    ----------
    source : Attractor, ImpactRecord or (k, N) array_like
        An attractor of an impact oscillator is sampled exactly; an array contains displacements,
        one mass in each column.
    times : (k,) array_like, optional
        Ascending times; required for an array. For an attractor the default is as for
        `TimeSeries`.

    Attributes
    ----------
    times : (k,) array
    displacements : (k, N) array
    cost : Cost
        Seconds and samples.

    Raises
    ------
    ValueError
        When times do not ascend, shapes differ, a number is not finite, or the attractor has no
        masses.

    References
    ----------
    J. P. Cusumano, B.-Y. Bai, Chaos, Solitons & Fractals 3 (1993) 515-535, figures 13, 16 and 17.

    Examples
    --------
    >>> from dynkit.systems import ImpactChain
    >>> surface = SpaceTime(ImpactChain(frequency=0.87).attractor())
    >>> surface.displacements.shape
    (1200, 10)
    """

    def __init__(self, source: object, times: object = None) -> None:
        began = time.perf_counter()
        motion = self._motion = Motion.of(source)
        if motion is not None:
            if not motion.has_masses:
                raise ValueError(f"source must be a motion of masses; got {motion.system!r}")
            self.times, states = motion.sampled(times)
            self.displacements = read_only(states[:, : motion.system.degrees_of_freedom].copy())
        else:
            self.times, self.displacements = given_samples(times, source, (None, None))
        self.cost = Cost(time.perf_counter() - began, {"samples": len(self.times)})

    _stored: ClassVar = ("times", "displacements", "cost", "error")
    times: Array
    displacements: Array
    cost: Cost

    def dataset(self) -> Dataset:
        """Return the displacements as a dataset over ``time`` and ``mass``, numbered from 1."""
        return Dataset(
            {
                "time": ("time", self.times),
                "mass": ("mass", np.arange(1, self.displacements.shape[-1] + 1)),
            },
            {"displacement": (("time", "mass"), self.displacements)},
            described(
                "Displacements of all masses",
                cost=self.cost,
                error="estimate of the largest error of the displacements",
                displacement_error=self.error,
            ),
        )

    def __repr__(self) -> str:
        samples, masses = self.displacements.shape
        return f"<SpaceTime: {masses} masses, {samples} samples, times {span(self.times)}>"

    @cached_property
    def error(self) -> float:
        """Estimate of the largest error of the displacements; zero for an array."""
        return 0.0 if self._motion is None else self._motion.error_until(self.times)

    @print_style()
    def plot(self, ax: Axes3D | None = None) -> Axes3D:
        """Draw the displacements as a surface over time and the masses.

        At most 100 lines run across it, and the lines of the masses have at most 500 points; finer
        samples are thinned out.

        Parameters
        ----------
        ax : Axes3D, optional
            Axes made with ``projection="3d"``, in a figure without a layout engine, because
            constrained layout leaves wide margins around flat boxes; by default a new figure.

        Returns
        -------
        Axes3D

        Raises
        ------
        ValueError
            When the axes are not three-dimensional, or there are fewer than two masses or times.
        """
        k, n = self.displacements.shape
        if min(k, n) < 2:
            raise ValueError(f"displacements must be (2, 2) or more; got shape {(k, n)}")
        axes: Any = _shown_surface() if ax is None else ax
        if not hasattr(axes, "plot_surface"):
            raise ValueError(f"ax must be made with projection='3d'; got {axes!r}")
        _set_up(axes)
        shown = np.unique(np.append(np.arange(0, k, math.ceil(k / _POINTS)), k - 1))
        across, along = np.meshgrid(np.arange(1.0, n + 1.0), self.times[shown])
        axes.plot_surface(
            along,
            across,
            self.displacements[shown],
            rcount=_LINES,
            ccount=n,
            color=ink(1.0),
            edgecolor=ink(),
            linewidth=0.2,
            shade=False,
            clip_on=False,
        )
        axes.set_xlim(self.times[0], self.times[-1], view_margin=0.0)
        axes.set_ylim(1.0, n, view_margin=0.0)
        axes.yaxis.get_major_locator().set_params(integer=True)
        axes.set(xlabel="time $t$", ylabel="mass $j$", zlabel="displacement $x_j$")
        return axes


def _shown_surface() -> Any:
    figure = shown_figure(2.0 * COLUMN_WIDTH, _HEIGHT)
    # constrained layout would leave wide margins around the flat box
    figure.set_layout_engine("none")
    return figure.add_axes((-0.065, 0.02, 1.0, 1.0), projection="3d")


def _set_up(axes: Any) -> None:
    """Draw a flat box from above, without grid or colour, as wide as the axes."""
    axes.set_proj_type("ortho")
    axes.set_box_aspect((4.6, 1.7, 1.0), zoom=1.68)
    axes.view_init(elev=32.0, azim=-72.0)
    axes.grid(visible=False)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.fill = False
        axis.pane.set_edgecolor(ink(0.8))
    axes.tick_params(pad=-1.0)
    axes.zaxis.get_major_locator().set_params(nbins=5)
    axes.xaxis.labelpad, axes.yaxis.labelpad, axes.zaxis.labelpad = 4.0, -3.0, -7.0
