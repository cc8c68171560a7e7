"""Figures 13, 16 and 17: displacements over time and the masses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from dynkit import OrbitLabel
from dynkit.analysis import SpaceTime
from dynkit.plotting.figures import print_style, save_figure
from dynkit.systems import ImpactAttractor
from tutorials.cusumano_bai_1993 import paper
from tutorials.cusumano_bai_1993.section import Finding, Section, table
from tutorials.cusumano_bai_1993.workshop import Stopwatch, Workshop

# Batches of successive impacts, from which errors of averages follow.
_BATCHES = 16
# Inches of a surface. Dots an inch: with more, files are large.
_WIDTH, _HEIGHT = 6.8, 2.5
_RESOLUTION = 300.0


def figure_13(workshop: Workshop) -> Section:
    """Make figure 13: the sticking motion."""
    watch = Stopwatch()
    with watch.time("simulation"):
        found = _surface(workshop, "13")
    finding = Finding(
        "shapes in figure 13", "spatially coherent", found.bending, f"{found.frequency_error:.0e}"
    )
    return _section(workshop, watch, "13", [found], finding)


def figure_16(workshop: Workshop) -> Section:
    """Make figure 16: chaos, and below it chaos with less damping."""
    watch = Stopwatch()
    with watch.time("simulation"):
        calm, wild, sticking = (_surface(workshop, name) for name in ("16a", "16b", "13"))
    finding = Finding(
        "shapes in figures 16a and 16b",
        "(a) somewhat more complex than figure 13, (b) more than (a)",
        f"(a) {calm.bending}, (b) {wild.bending}; figure 13: {sticking.bending}",
        f"{calm.frequency_error:.0e}, {wild.frequency_error:.0e}",
        sticking.frequency < calm.frequency < wild.frequency,
    )
    return _section(workshop, watch, "16", [calm, wild], finding)


def figure_17(workshop: Workshop) -> Section:
    """Make figure 17: P(1,3)."""
    watch = Stopwatch()
    with watch.time("simulation"):
        found, sticking = _surface(workshop, "17"), _surface(workshop, "13")
    finding = Finding(
        "edges in figure 17",
        "sharp: the masses are rapidly accelerated",
        f"the tip's velocity jumps by {found.part:.0f} % of its range; "
        f"figure 13: {sticking.part:.0f} %",
        f"{found.attractor.error:.0e}",
        found.part > sticking.part,
    )
    return _section(workshop, watch, "17", [found], finding)


@final
@dataclass(frozen=True, eq=False)
class _Surface:
    """A surface, and what is measured on its motion.

    Parameters
    ----------
    name : str
        Of the figure.
    attractor : ImpactAttractor
    space_time : SpaceTime
    frequency, frequency_error : float
        Root of <x K x> / <x x>: at rest, a normal mode has its own frequency there.
    jump, extent : float
        Largest jump of the tip's velocity at an impact, and the range of that velocity.
    """

    name: str
    attractor: ImpactAttractor
    space_time: SpaceTime
    frequency: float
    frequency_error: float
    jump: float
    extent: float

    @property
    def label(self) -> OrbitLabel:
        """Of the motion."""
        return self.attractor.label

    @property
    def bending(self) -> str:
        """How the shapes bend, in words."""
        return f"as bent as a mode of frequency {self.frequency:.3f}"

    @property
    def part(self) -> float:
        """The jump, in hundredths of the range."""
        return 100.0 * self.jump / self.extent


def _surface(workshop: Workshop, name: str) -> _Surface:
    frequency, damping, interval = paper.SURFACES[name]
    attractor = workshop.shown(frequency, damping)
    times = interval * np.arange(paper.STEPS + 1.0)
    bending, error = _bending(attractor)
    jump, extent = _jump(attractor, float(times[-1]))
    return _Surface(name, attractor, SpaceTime(attractor, times), bending, error, jump, extent)


def _bending(attractor: ImpactAttractor) -> tuple[float, float]:
    """Root of <x K x> / <x x>, averages over the motion, and its error by leaving batches out."""
    moments = attractor.second_moments(_BATCHES)
    products = moments.products
    bent = np.einsum("ij,bji->b", attractor.system.stiffness, products)
    size = np.einsum("bii->b", products)
    without = np.sqrt((bent.sum() - bent) / (size.sum() - size))
    frequency = float(np.sqrt(bent.sum() / size.sum()))
    scatter = float(np.sqrt((len(without) - 1) * np.var(without)))
    rounding = moments.error * products.shape[1] * float(moments.durations.sum() / size.sum())
    return frequency, scatter + frequency * rounding


def _jump(attractor: ImpactAttractor, end: float) -> tuple[float, float]:
    """The largest jump of the tip's velocity up to a time, and the range of that velocity."""
    record, r, tip = attractor.record, attractor.system.restitution, paper.MASSES - 1
    shown = record.time <= end
    after = record.velocity[shown, tip]
    jumps = (1.0 + 1.0 / r) * record.relative_velocity[shown]
    times = np.linspace(0.0, min(end, float(record.time[-1])), 10 * paper.STEPS + 1)
    between = record.sample(times)[1][:, tip]
    return float(jumps.max()), float(np.ptp(np.concatenate([between, after, after - jumps])))


def _section(
    workshop: Workshop,
    watch: Stopwatch,
    number: str,
    surfaces: Sequence[_Surface],
    finding: Finding,
) -> Section:
    with watch.time("drawing"), print_style():
        _draw(workshop, number, surfaces)
    natural = surfaces[0].attractor.system.natural_frequencies
    rows = [
        [
            surface.name,
            *(f"{value:g}" for value in paper.SURFACES[surface.name][:2]),
            surface.label,
            f"{surface.frequency:.4f}",
            f"{surface.frequency_error:.0e}",
            f"{surface.jump:.3f}",
            f"{surface.extent:.3f}",
        ]
        for surface in surfaces
    ]
    skipped = " and ".join(str(surface.attractor.transient) for surface in surfaces)
    text = (
        f"{paper.STEPS} steps of {paper.SURFACES[surfaces[0].name][2]:g}, after {skipped} skipped "
        "impacts from the paper's start; mass 10 is the tip. How much the shapes bend is told by "
        "$\\omega_s^2 = \\langle x^T K x\\rangle / \\langle x^T x\\rangle$, averages over the "
        "motion, in closed form from impact to impact: for a normal mode it gives the frequency of "
        f"that mode, {natural[0]:.3f} for the first, {natural[1]:.3f} for the second, "
        f"{natural[2]:.3f} for the third. Its error comes from {_BATCHES} batches of impacts. The "
        "last columns have the largest jump of the tip's velocity at an impact, and the range of "
        "that velocity.\n\n"
        + table(
            [
                "figure",
                "frequency",
                "damping",
                "motion",
                "$\\omega_s$",
                "error",
                "jump",
                "range",
            ],
            rows,
        )
    )
    item = f"figure-{number}"
    labels = " and ".join(dict.fromkeys(str(surface.label) for surface in surfaces))
    return Section(
        item, f"Figure {number}: {labels} in space and time", text, [finding], [item], watch.seconds
    )


def _draw(workshop: Workshop, number: str, surfaces: Sequence[_Surface]) -> None:
    from matplotlib.figure import Figure

    rows = len(surfaces)
    figure = Figure(figsize=(_WIDTH, _HEIGHT * rows))
    for row, surface in enumerate(surfaces):
        # the boxes are flat: they may overlap
        place = (-0.065, 1.0 - (row + 0.98) / rows, 1.0, 1.0 / rows)
        axes: Any = figure.add_axes(place, projection="3d")
        surface.space_time.plot(axes)
        if rows > 1:
            axes.text2D(0.1, 0.92, f"({surface.name[-1]})", transform=axes.transAxes)
    save_figure(figure, workshop.folder / f"figure-{number}", _RESOLUTION)
